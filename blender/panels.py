"""Panels of the engine, and Blender's own that make sense with it."""

import bpy

ENGINE = "CARDIOID"

#: Panels of all engines, by the beginning of their names, that say what cardioid does not do, or what a panel below says better.
_LEFT_OUT = (
    "DATA_PT_light",
    # It shares the engines of the one above.
    "NODE_DATA_PT_light",
    "RENDER_PT_freestyle",
    "RENDER_PT_gpencil",
    "RENDER_PT_grease_pencil",
    "RENDER_PT_stereoscopy",
    "VIEWLAYER_PT_freestyle",
    "MATERIAL_PT_freestyle",
)

#: Panels of EEVEE that show the nodes of materials and worlds, lights, and the focus of cameras.
_OF_EEVEE = (
    "EEVEE_MATERIAL_PT_context_material",
    "EEVEE_MATERIAL_PT_surface",
    "EEVEE_MATERIAL_PT_volume",
    "EEVEE_WORLD_PT_surface",
    "EEVEE_WORLD_PT_volume",
    "DATA_PT_EEVEE_light",
    "DATA_PT_camera_dof",
    "DATA_PT_camera_dof_aperture",
)


def _own(context):
    return context.engine == ENGINE


class CARDIOID_PT_render(bpy.types.Panel):
    bl_label = "cardioid"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"

    @classmethod
    def poll(cls, context):
        return _own(context)

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        settings = context.scene.cardioid
        layout.prop(settings, "quality")
        layout.prop(settings, "integrator")
        if settings.integrator == "progressive":
            layout.prop(settings, "rounds")
        layout.prop(settings, "seed")
        layout.prop(settings, "time_limit")
        layout.prop(settings, "extra")
        layout.prop(settings, "folder")


class CARDIOID_PT_passes(bpy.types.Panel):
    bl_label = "Passes"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "view_layer"

    @classmethod
    def poll(cls, context):
        return _own(context)

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layer = context.view_layer
        column = layout.column(heading="Data")
        column.prop(layer, "use_pass_z")
        column.prop(layer, "use_pass_normal")
        column.prop(layer, "use_pass_diffuse_color", text="Diffuse Color")
        layout.label(text="emission, direct, specular, caustics and indirect are always there")


class CARDIOID_PT_material(bpy.types.Panel):
    bl_label = "cardioid"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "material"

    @classmethod
    def poll(cls, context):
        return _own(context) and context.material is not None

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.prop(context.material.cardioid, "is_border")


_CLASSES = (CARDIOID_PT_render, CARDIOID_PT_passes, CARDIOID_PT_material)


def _blenders_panels():
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", None)
        if engines is None or panel.__name__.startswith(_LEFT_OUT):
            continue
        if "BLENDER_RENDER" in engines or panel.__name__ in _OF_EEVEE:
            yield engines


def register():
    for kind in _CLASSES:
        bpy.utils.register_class(kind)
    for engines in _blenders_panels():
        engines.add(ENGINE)


def unregister():
    for engines in _blenders_panels():
        engines.discard(ENGINE)
    for kind in reversed(_CLASSES):
        bpy.utils.unregister_class(kind)
