"""cardioid as a render engine of Blender 4.2 and later.

The scene is written as a scene file of cardioid (TOML) with a model beside it (GLB); the program renders it as a process of its
own; its layers become Blender's passes. What cardioid does not model is reported, with the name of the object or material.

Modules that touch Blender: `register` imports them, so that all others can be imported, and tested, by plain Python:

- `units`, `framing`, `surface`, `glb`, `toml_text`: from Blender's values to those of cardioid;
- `program`: the command line, its messages and its progress;
- `exr`, `passes`: from the program's layers to Blender's passes.
"""

_MODULES = ("settings", "panels", "engine")


def _loaded():
    from importlib import import_module

    return [import_module(f".{name}", __package__) for name in _MODULES]


def register():
    for module in _loaded():
        module.register()


def unregister():
    for module in reversed(_loaded()):
        module.unregister()
