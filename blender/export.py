"""Writes an evaluated scene of Blender as a scene file of cardioid, with a model and pictures beside it."""

import os
from dataclasses import dataclass

import bpy
import numpy

from . import camera, exr, framing, lamps, materials, surface, toml_text, world
from .glb import Glb
from .meshes import Meshes
from .pictures import Pictures, pixels_of, to_linear

_SOLID = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
_SILENT = {"EMPTY", "ARMATURE", "LATTICE", "CAMERA", "SPEAKER", "LIGHT"}


@dataclass
class Exported:
    scene: str
    frame: object


def write(depsgraph, folder, size, border, notices):
    """Writes the scene into a folder. `size`: pixels of the whole picture; `border`: the part that is rendered, from the lower left.

    Raises camera.SceneError where there is nothing, or no camera, that can be rendered.
    """
    scene = depsgraph.scene
    writer = _Writer(depsgraph, folder, notices)
    frame, camera_table = writer.camera(scene, size, border)
    writer.objects()
    tables = [("[camera]", camera_table), ("[film]", {"width": frame.width, "height": frame.height})]
    tables += writer.models()
    if not any(header == "[[shapes]]" for header, _ in tables + writer.lights):
        raise camera.SceneError("there is nothing to render: no object is a surface, and none is visible in renders; add one")
    tables += writer.lights
    tables += writer.world(getattr(depsgraph.view_layer, "world_override", None) or scene.world)
    path = os.path.join(folder, "scene.toml")
    with open(path, "w", encoding="utf-8") as file:
        file.write(toml_text.document(tables, [("name", scene.name)]))
    _check_settings(scene, notices)
    return Exported(path, frame)


def _check_settings(scene, notices):
    render = scene.render
    who = f"scene '{scene.name}'"
    space = getattr(getattr(bpy.data, "colorspace", None), "working_space", "Linear Rec.709")
    if space != "Linear Rec.709":
        notices.add(who, f"the working space {space} is not modelled; colours are taken as those of Linear Rec.709")
    if render.use_motion_blur:
        notices.add(who, "motion blur is not modelled; the picture is sharp")
    if render.film_transparent:
        notices.add(who, "a transparent film is not modelled; the world is seen")
    if abs(render.pixel_aspect_x - render.pixel_aspect_y) > 1e-6:
        notices.add(who, "pixels that are not square are not modelled; they are square")


@dataclass(frozen=True)
class _Look:
    """How a material is written. `model`: the file of its meshes; the rest as `Meshes.primitives` takes it."""

    model: str
    number: int
    uv_maps: tuple
    colours: str


class _Model:
    """A GLB file. `tables`: what the scene file says of it, but for its shape; `shape`: that."""

    def __init__(self, notices, tables, shape):
        self.glb = Glb()
        self.meshes = Meshes(self.glb, notices)
        self.tables, self.shape = tables, shape


class _Writer:
    def __init__(self, depsgraph, folder, notices):
        self.depsgraph, self.folder, self.notices = depsgraph, folder, notices
        self.lights = []
        self._override = depsgraph.view_layer.material_override
        # Faces without a material have one of the file, so that this one is never seen; the scene file wants it.
        grey = [("[materials.grey]", {"type": "lambert", "reflectance": 0.8})]
        self._models = {"model": _Model(notices, grey, {"materials": "file", "material": "grey"})}
        path_of = lambda image: bpy.path.abspath(image.filepath, library=image.library)  # noqa: E731
        self._pictures = Pictures(self._models["model"].glb, notices, path_of)
        self._looks = {}
        self._shared = {}
        self._names = {}
        self._camera = None

    def camera(self, scene, size, border):
        eye = scene.camera
        if eye is None:
            raise camera.SceneError("the scene has no camera; add one")
        eye = eye.evaluated_get(self.depsgraph)
        focus = None
        if eye.data.dof.use_dof and eye.data.dof.focus_object:
            focus = tuple(eye.data.dof.focus_object.evaluated_get(self.depsgraph).matrix_world.translation)
        frame, table = camera.frame_and_table(eye.name, eye.data, _rows(eye.matrix_world), size, border, self.notices, focus)
        self._camera = (table, frame)
        return frame, table

    def _is_seen(self, point):
        """Whether a point lies in the picture."""
        table, frame = self._camera
        if frame.pixel is None:
            return True
        found = framing.place(table, frame, lamps.upright(point))
        x0, y0, x1, y1 = frame.window
        return found is not None and x0 <= found[0] < x1 and y0 <= found[1] < y1

    def objects(self):
        for instance in self.depsgraph.object_instances:
            thing = instance.object
            if not instance.show_self:
                continue
            if thing.type == "LIGHT":
                self._light(thing, instance.matrix_world)
            elif thing.type in _SOLID:
                self._solid(thing, instance.matrix_world)
            elif thing.type not in _SILENT:
                self.notices.add(f"object '{thing.name}'", f"objects of the kind {thing.type} are not modelled; it is left out")

    def _light(self, thing, matrix):
        who = f"light '{thing.name}'"
        if getattr(getattr(thing.data, "cycles", None), "is_portal", False):
            self.notices.add(who, "a portal is no light of its own; it is left out")
            return
        self._check_linking(thing, who)
        name = self._unique(thing.name)
        tables, text = lamps.tables(name, thing.data, _rows(matrix), self.notices)
        for header, table in tables:
            if text is not None and "file" in table:
                table["file"] = f"light-{len(self.lights)}.{table['file']}"
                with open(os.path.join(self.folder, table["file"]), "w", encoding="ascii") as file:
                    file.write(text)
            if header == "[[shapes]]" and self._is_seen(tuple(matrix.translation)):
                self.notices.add(who, "the camera may see it as a bright shape, where Cycles hides lights; move it out of the picture")
            self.lights.append((header, table))

    def _check_linking(self, thing, who):
        linking = getattr(thing, "light_linking", None)
        if linking and (linking.receiver_collection or linking.blocker_collection):
            self.notices.add(who, "light linking is not modelled; all objects get its light and cast its shadows")

    def _unique(self, name):
        """Names of lights are unique in a scene file."""
        number = self._names[name] = self._names.get(name, 0) + 1
        return name if number == 1 else f"{name} ({number})"

    def _solid(self, thing, matrix):
        who = f"object '{thing.name}'"
        if thing.is_holdout:
            self.notices.add(who, "a holdout is not modelled; it is seen")
        if getattr(thing, "is_shadow_catcher", False):
            self.notices.add(who, "a shadow catcher is not modelled; it is seen")
        if not all(
            getattr(thing, f"visible_{ray}", True) for ray in ("camera", "diffuse", "glossy", "transmission", "shadow", "volume_scatter")
        ):
            self.notices.add(who, "visibility by the kind of ray is not modelled; all rays see it")
        self._check_linking(thing, who)
        if any(system.settings.type == "HAIR" and system.settings.render_type == "PATH" for system in thing.particle_systems):
            self.notices.add(who, "its hair is not modelled; it is left out")
        slots = [slot.material for slot in thing.material_slots] or [None]
        if self._override:
            slots = [self._override] * len(slots)
        # Objects that share an evaluated mesh and its materials share it in the file.
        key = (thing.data.as_pointer(), tuple(material.as_pointer() if material else 0 for material in slots))
        if thing.type != "MESH":
            key = (thing.original.as_pointer(),) + key
        if key not in self._shared:
            self._shared[key] = self._written(thing, slots, who)
        columns = [matrix[row][column] for column in range(4) for row in range(4)]
        for model, mesh in self._shared[key]:
            self._models[model].glb.place(thing.name, mesh, columns)

    def _written(self, thing, slots, who):
        """Writes the mesh of an object: pairs of a model and the number of the mesh in it."""
        looks = [self._look(material) for material in slots]
        try:
            mesh = thing.to_mesh()
        except RuntimeError:
            # What Blender has no mesh for, as an empty text.
            return []
        found = []
        for name in dict.fromkeys(look.model for look in looks if look):
            own = [(look.number, look.uv_maps, look.colours) if look and look.model == name else None for look in looks]
            model = self._models[name]
            primitives = model.meshes.primitives(mesh, own, who)
            if primitives:
                found.append((name, model.glb.mesh(thing.name, primitives)))
        thing.to_mesh_clear()
        return found

    def _look(self, material):
        """The look of a material; None where light passes as if nothing were there."""
        key = material.as_pointer() if material else 0
        if key not in self._looks:
            found = materials.surface_of(material, self.notices)
            name = material.name if material else "without a material"
            if found is None:
                self._looks[key] = None
            elif found.scatters:
                self._looks[key] = _Look(self._body(found), None, (), None)
            else:
                who, maps = f"material '{name}'", tuple(found.uv_maps)
                slot, both = self._pictures.slot(maps), self._pictures.slot_of_both(maps, who)
                plain = self._pictures.slot(maps, is_colour=False)
                written = surface.material(found, name, lambda texture: plain(texture) if texture == found.normal else slot(texture), both)
                self._looks[key] = _Look("model", self._models["model"].glb.material(written), maps, found.base.colours)
        return self._looks[key]

    def _body(self, found):
        """The model of bodies whose inside scatters, which a scene file says beside it."""
        name = f"body-{len(self._models)}"
        border = {"type": "dielectric", "inside": name, "roughness": float(found.roughness.value) ** 2}
        tables = [(f"[media.{name}]", found.inside.table(found.ior)), (f"[materials.{name}]", border)]
        self._models[name] = _Model(self.notices, tables, {"material": name})
        return name

    def models(self):
        """Writes the GLB files, and yields the tables that name them."""
        tables = []
        for name, model in self._models.items():
            if model.glb.is_empty:
                continue
            with open(os.path.join(self.folder, f"{name}.glb"), "wb") as file:
                file.write(model.glb.to_bytes())
            shape = {"name": name, "type": "mesh", "file": f"{name}.glb"} | model.shape
            tables += model.tables + [("[[shapes]]", shape)]
        return tables

    def world(self, own):
        visible = getattr(own, "cycles_visibility", None)
        kinds = ("camera", "diffuse", "glossy", "transmission", "scatter")
        if visible and not all(getattr(visible, kind, True) for kind in kinds):
            self.notices.add(f"world '{own.name}'", "visibility by the kind of ray is not modelled; all rays see it")
        inside = world.medium(own, self.notices)
        filled = [("[media.world]", inside.table(1.0) | {"fills": "scene"})] if inside else []
        tables, image = world.tables(own, self.notices)
        for table, name in zip(tables, ("world", "sun of the world")):
            table["name"] = self._unique(name)
        if image is not None:
            path = self._environment(image)
            if path is None:
                self.notices.add(f"world '{own.name}'", "its picture is missing; it gives no light")
                return filled
            tables[0]["image"] = path
        return filled + [("[[lights]]", table) for table in tables]

    def _environment(self, image):
        """The path of a picture of radiance."""
        path = bpy.path.abspath(image.filepath, library=image.library)
        ready = image.source == "FILE" and not image.packed_file and not image.is_dirty and os.path.isfile(path)
        if ready and path.lower().endswith((".hdr", ".exr")) and image.colorspace_settings.name == "Linear Rec.709":
            return os.path.abspath(path)
        if 0 in tuple(image.size):
            return None
        values = pixels_of(image)[..., :3].copy()
        if not image.is_float and image.colorspace_settings.name == "sRGB":
            values = to_linear(values)
        path = os.path.join(self.folder, "world.exr")
        with open(path, "wb") as file:
            file.write(exr.colours(values))
        return path


def _rows(matrix):
    return [tuple(row) for row in matrix]
