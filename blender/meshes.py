"""Evaluated meshes of Blender as primitives of a GLB file."""

import numpy

from .glb import FLOAT, UNSIGNED_INT


class Meshes:
    """The meshes of one GLB file."""

    def __init__(self, glb, notices):
        self._glb, self._notices = glb, notices

    def primitives(self, mesh, looks, who):
        """The primitives of a mesh. `looks`: for each of its materials the number in the file or None, the names of its UV maps, and the
        name of its colour attribute or None; None for faces that are not there."""
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        if count == 0:
            return []
        corners = numpy.empty(3 * count, numpy.int32)
        mesh.loop_triangles.foreach_get("loops", corners)
        materials = numpy.empty(count, numpy.int32)
        mesh.loop_triangles.foreach_get("material_index", materials)
        materials = numpy.clip(materials, 0, len(looks) - 1)
        of_corner = numpy.empty(len(mesh.loops), numpy.int32)
        mesh.loops.foreach_get("vertex_index", of_corner)
        positions = numpy.empty(3 * len(mesh.vertices), numpy.float32)
        mesh.vertices.foreach_get("co", positions)
        positions = positions.reshape(-1, 3)
        is_flat = mesh.normals_domain == "FACE"
        needs_corners = mesh.normals_domain == "CORNER" or any(look and (look[1] or look[2] is not None) for look in looks)
        if needs_corners:
            # One vertex for each corner of a face.
            attributes, indices = {"POSITION": self._vectors(positions[of_corner], bounds=True)}, corners
        else:
            attributes, indices = {"POSITION": self._vectors(positions, bounds=True)}, of_corner[corners]
        if not is_flat:
            source = mesh.corner_normals if needs_corners else mesh.vertex_normals
            normals = numpy.empty(3 * len(source), numpy.float32)
            source.foreach_get("vector", normals)
            attributes["NORMAL"] = self._vectors(normals.reshape(-1, 3))
        indices = indices.reshape(-1, 3)
        coordinates = {}
        found = []
        for number, look in enumerate(looks):
            if look is None:
                continue
            own = indices[materials == number]
            if not len(own):
                continue
            material, uv_maps, colours = look
            used = dict(attributes)
            for place, name in enumerate(uv_maps[:2]):
                if name not in coordinates:
                    coordinates[name] = self._coordinates(mesh, name, who)
                if coordinates[name] is not None:
                    used[f"TEXCOORD_{place}"] = coordinates[name]
            if colours is not None:
                used |= self._colours(mesh, colours, of_corner, who)
            if len(uv_maps) > 2:
                self._notices.add(who, "a material reads more than two UV maps; pictures on the others show one colour")
            data = numpy.ascontiguousarray(own, dtype="<u4").tobytes()
            primitive = {"attributes": used, "indices": self._glb.numbers(data, UNSIGNED_INT, "SCALAR")}
            found.append(primitive if material is None else primitive | {"material": material})
        return found

    def _vectors(self, values, bounds=False):
        box = (values.min(axis=0), values.max(axis=0)) if bounds else None
        return self._glb.numbers(numpy.ascontiguousarray(values, dtype="<f4").tobytes(), FLOAT, "VEC3", box)

    def _colours(self, mesh, name, of_corner, who):
        """Colours of corners, linear."""
        layers = mesh.color_attributes
        layer = layers.get(name) if name else (layers[layers.render_color_index] if len(layers) else None)
        if layer is None:
            self._notices.add(who, f"the colour attribute '{name}' is missing; its surface is white")
            return {}
        values = numpy.empty(4 * len(layer.data), numpy.float32)
        layer.data.foreach_get("color", values)
        values = values.reshape(-1, 4)
        if layer.domain == "POINT":
            values = values[of_corner]
        data = numpy.ascontiguousarray(values[:, :3], dtype="<f4").tobytes()
        return {"COLOR_0": self._glb.numbers(data, FLOAT, "VEC3")}

    def _coordinates(self, mesh, name, who):
        layers = mesh.uv_layers
        layer = layers.get(name) if name else next((layer for layer in layers if layer.active_render), layers.active)
        if layer is None:
            what = f"the UV map '{name}' is missing" if name else "it has no UV map"
            self._notices.add(who, f"{what}; pictures on it show one colour")
            return None
        values = numpy.empty(2 * len(mesh.loops), numpy.float32)
        layer.uv.foreach_get("vector", values)
        values = values.reshape(-1, 2)
        # glTF has v pointing down.
        values[:, 1] = 1.0 - values[:, 1]
        return self._glb.numbers(numpy.ascontiguousarray(values, dtype="<f4").tobytes(), FLOAT, "VEC2")
