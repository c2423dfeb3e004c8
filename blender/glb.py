"""Writes glTF 2.0 as GLB: meshes with their materials and pictures. No lights and no camera, which are in the scene file."""

import json
import struct

FLOAT, UNSIGNED_INT = 5126, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
_BYTES = {FLOAT: 4, UNSIGNED_INT: 4}
_PARTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}

#: From Blender's axes (z up) to those of glTF (y up): x, z, -y; by columns, as glTF writes matrices.
Z_UP = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]


class Glb:
    """A file in the making. All that is added is in the axes of Blender; one node turns it upright."""

    def __init__(self, generator="cardioid for Blender"):
        self.json = {
            "asset": {"version": "2.0", "generator": generator},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"name": "Blender", "matrix": Z_UP, "children": []}],
        }
        self._chunks = []
        self._length = 0

    def _add(self, group, item):
        self.json.setdefault(group, []).append(item)
        return len(self.json[group]) - 1

    def _view(self, data, target=None):
        padding = -self._length % 4
        self._chunks += [b"\0" * padding, bytes(data)]
        self._length += padding
        view = {"buffer": 0, "byteOffset": self._length, "byteLength": len(data)}
        if target:
            view["target"] = target
        self._length += len(data)
        return self._add("bufferViews", view)

    def numbers(self, data, component, kind, bounds=None):
        """Numbers as little-endian bytes. `bounds`: the least and the largest of positions."""
        count = len(data) // (_BYTES[component] * _PARTS[kind])
        target = ELEMENT_ARRAY_BUFFER if component == UNSIGNED_INT else ARRAY_BUFFER
        accessor = {"bufferView": self._view(data, target), "componentType": component, "count": count, "type": kind}
        if bounds:
            accessor["min"], accessor["max"] = ([float(x) for x in side] for side in bounds)
        return self._add("accessors", accessor)

    def picture(self, data, mime, name, wrap=10497):
        """A picture, encoded; yields the number of its texture."""
        image = self._add("images", {"name": name, "mimeType": mime, "bufferView": self._view(data)})
        sampler = self._add("samplers", {"magFilter": 9729, "minFilter": 9987, "wrapS": wrap, "wrapT": wrap})
        return self._add("textures", {"source": image, "sampler": sampler})

    def material(self, material):
        """A material, as JSON."""
        used = self.json.setdefault("extensionsUsed", [])
        for name in material.get("extensions", {}):
            if name not in used:
                used.append(name)
        for slot in _slots(material):
            if "extensions" in slot and "KHR_texture_transform" not in used:
                used.append("KHR_texture_transform")
        if not used:
            del self.json["extensionsUsed"]
        return self._add("materials", material)

    def mesh(self, name, primitives):
        return self._add("meshes", {"name": name, "primitives": primitives})

    def place(self, name, mesh, matrix):
        """Places a mesh by a matrix of 16 numbers, by columns."""
        node = self._add("nodes", {"name": name, "mesh": mesh, "matrix": [float(x) for x in matrix]})
        self.json["nodes"][0]["children"].append(node)

    @property
    def is_empty(self):
        return len(self.json["nodes"]) == 1

    def to_bytes(self):
        document = dict(self.json)
        binary = b"".join(self._chunks)
        binary += b"\0" * (-len(binary) % 4)
        if binary:
            document["buffers"] = [{"byteLength": len(binary)}]
        text = json.dumps(document, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        if binary:
            chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def _slots(item):
    """All tables of textures in a material."""
    if isinstance(item, dict):
        if "index" in item:
            yield item
        for inner in item.values():
            yield from _slots(inner)
