"""Settings of the engine, by the names of the program's options, and the preferences of the add-on."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty


class CardioidPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    program: StringProperty(
        name="Program",
        description="The program cardioid, or its folder. Empty: the one on PATH",
        subtype="FILE_PATH",
    )

    def draw(self, _context):
        self.layout.prop(self, "program")


def program_preference():
    """The path in the preferences; empty where there is none."""
    addon = bpy.context.preferences.addons.get(__package__)
    return addon.preferences.program if addon and addon.preferences else ""


class CardioidSceneSettings(bpy.types.PropertyGroup):
    quality: EnumProperty(
        name="quality",
        description="Preset that all other settings start from; each takes several times as long as the one before",
        items=(
            ("draft", "draft", "Seconds: to see whether the scene is right"),
            ("preview", "preview", "A good idea of the final picture"),
            ("final", "final", "What one publishes"),
            ("reference", "reference", "What one measures others against"),
        ),
        default="preview",
    )
    integrator: EnumProperty(
        name="integrator",
        description="How the picture is computed",
        items=(
            ("photon-map", "photon-map", "Photon maps and final gathering"),
            ("progressive", "progressive", "Photon maps in rounds, whose error falls as long as they go on; each power of two is shown"),
            ("path", "path", "Unbiased path tracing; finds no caustics of point, spot and sun lights"),
            ("photons", "photons", "One photon map shown directly"),
        ),
        default="photon-map",
    )
    rounds: IntProperty(
        name="rounds", description="Rounds of the progressive integrator; 0 for those of the preset", min=0, default=0
    )
    seed: IntProperty(name="seed", description="The same seed gives the same picture", min=0, default=0)
    time_limit: FloatProperty(
        name="time-limit",
        description="Seconds after which a frame ends with what is there; 0 for no limit",
        min=0.0,
        default=0.0,
    )
    extra: StringProperty(
        name="more options",
        description="Options of `cardioid render`, as on the command line: --spp 64 --caustic-photons 2e6",
    )
    folder: StringProperty(
        name="keep files in",
        description="Folder for the scene file, the model and the pictures. Empty: a temporary one, which is removed",
        subtype="DIR_PATH",
    )


class CardioidMaterialSettings(bpy.types.PropertyGroup):
    is_border: BoolProperty(
        name="Border of a body",
        description="Light that passes is bent as at the border of a body even where the mesh is open, as the surface of a pool is. "
        "Without it an open mesh is a sheet, as a window is",
        default=False,
    )


_CLASSES = (CardioidPreferences, CardioidSceneSettings, CardioidMaterialSettings)


def register():
    for kind in _CLASSES:
        bpy.utils.register_class(kind)
    bpy.types.Scene.cardioid = PointerProperty(type=CardioidSceneSettings)
    bpy.types.Material.cardioid = PointerProperty(type=CardioidMaterialSettings)


def unregister():
    del bpy.types.Material.cardioid
    del bpy.types.Scene.cardioid
    for kind in reversed(_CLASSES):
        bpy.utils.unregister_class(kind)
