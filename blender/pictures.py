"""Blender's images as pictures in a GLB file: as they are where they are PNG, JPEG or WebP, and otherwise as PNG."""

import os
import struct
import zlib

import numpy

_MAGIC = ((b"\x89PNG", "image/png"), (b"\xff\xd8\xff", "image/jpeg"), (b"RIFF", "image/webp"))


def png(pixels):
    """A PNG of 8 bits. `pixels`: bytes by row from the top, three or four channels."""
    height, width, channels = pixels.shape
    rows = numpy.zeros((height, width * channels + 1), numpy.uint8)
    rows[:, 1:] = pixels.reshape(height, -1)

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, {3: 2, 4: 6}[channels], 0, 0, 0)
    parts = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 6)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


def to_srgb(linear):
    """Encodes by the curve of sRGB."""
    linear = numpy.clip(linear, 0.0, 1.0)
    return numpy.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def to_linear(encoded):
    """Decodes the curve of sRGB."""
    return numpy.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def pixels_of(image):
    """The numbers of an image, four channels, rows from the top. Those of bytes are encoded as in their file."""
    width, height = image.size
    values = numpy.empty(width * height * 4, numpy.float32)
    image.pixels.foreach_get(values)
    return values.reshape(height, width, 4)[::-1]


class Pictures:
    """The pictures of one GLB file, each written once."""

    def __init__(self, glb, notices, path_of):
        """`path_of(image)`: its absolute path."""
        self._glb, self._notices, self._path_of = glb, notices, path_of
        self._slots = {}

    def slot(self, uv_maps, is_colour=True):
        """A function from textures to tables of a material, whose UV maps are written in this order."""

        def table(texture):
            key = (texture.image.name_full, texture.wrap, is_colour)
            if key not in self._slots:
                data, mime = self._encoded(texture.image, is_colour)
                self._slots[key] = self._glb.picture(data, mime, texture.image.name, texture.wrap)
            return _table(self._slots[key], texture, uv_maps)

        return table

    def slot_of_both(self, uv_maps, who):
        """A function from roughness and metal to the table of their picture: green and blue."""

        def table(roughness, metallic):
            one, two = roughness.texture, metallic.texture
            placed = one or two
            if one and two and one.placement != two.placement:
                self._notices.add(who, "pictures of roughness and metal are placed differently; both are placed as that of roughness")
            key = tuple((t.image.name_full, t.channel) if t else None for t in (one, two)) + (placed.wrap,)
            if key not in self._slots:
                same = one and two and one.image == two.image and (one.channel, two.channel) == ("G", "B")
                if same:
                    data, mime = self._encoded(one.image, False)
                else:
                    data, mime = self._packed(one, two), "image/png"
                self._slots[key] = self._glb.picture(data, mime, f"roughness and metal of {who}", placed.wrap)
            return _table(self._slots[key], placed, uv_maps)

        return table

    def _packed(self, roughness, metallic):
        """Roughness in green, metal in blue; what has no picture is whole, and a factor makes it what it is."""
        layers = [self._channel(texture) if texture else None for texture in (roughness, metallic)]
        height, width = max((layer.shape for layer in layers if layer is not None), key=lambda shape: shape[0] * shape[1])
        result = numpy.full((height, width, 3), 255, numpy.uint8)
        for place, layer in ((1, layers[0]), (2, layers[1])):
            if layer is not None:
                # The smaller of two pictures is enlarged, each pixel to a block.
                rows = numpy.arange(height) * layer.shape[0] // height
                columns = numpy.arange(width) * layer.shape[1] // width
                result[..., place] = numpy.round(255.0 * numpy.clip(layer[rows][:, columns], 0.0, 1.0))
        return png(result)

    def _channel(self, texture):
        values = pixels_of(texture.image)
        place = {"R": 0, "G": 1, "B": 2, "A": 3}.get(texture.channel)
        if texture.image.colorspace_settings.name == "sRGB" and not texture.image.is_float and place != 3:
            values = values.copy()
            values[..., :3] = to_linear(values[..., :3])
        if place is not None:
            return values[..., place]
        # As Blender turns a colour into a number: its luminance.
        return values[..., :3] @ numpy.array([0.2126, 0.7152, 0.0722], numpy.float32)

    def _encoded(self, image, is_colour):
        who = f"image '{image.name}'"
        if image.source in ("SEQUENCE", "MOVIE", "TILED"):
            self._notices.add(who, f"a picture of the kind {image.source} is not modelled; its first part is used")
        space = image.colorspace_settings.name
        is_encoded = space == "sRGB"
        is_plain = space in ("Non-Color", "Linear Rec.709", "Raw")
        if not image.is_dirty and not image.is_float and (is_encoded if is_colour else is_plain):
            data = self._file(image)
            mime = next((mime for magic, mime in _MAGIC if data and data.startswith(magic)), None)
            if mime:
                return data, mime
        if not image.has_data and 0 in tuple(image.size):
            self._notices.add(who, "its file is missing; it is pink, as in Blender")
            return png(numpy.full((1, 1, 3), (255, 0, 255), numpy.uint8)), "image/png"
        if not (is_encoded or is_plain):
            self._notices.add(who, f"the colour space {space} is taken as that of sRGB")
            is_encoded = not image.is_float
        values = pixels_of(image).copy()
        if image.is_float:
            # Numbers of float images are linear whatever their file.
            if values[..., :3].max(initial=0.0) > 1.0:
                self._notices.add(who, "values above 1 are cut to 1 in pictures of surfaces")
            is_encoded = False
        if is_colour and not is_encoded:
            values[..., :3] = to_srgb(values[..., :3])
        elif is_encoded and not is_colour:
            values[..., :3] = to_linear(values[..., :3])
        return png(numpy.round(255.0 * numpy.clip(values, 0.0, 1.0)).astype(numpy.uint8)), "image/png"

    def _file(self, image):
        if image.packed_file:
            return bytes(image.packed_file.data)
        path = self._path_of(image)
        if image.source == "FILE" and path and os.path.isfile(path):
            with open(path, "rb") as file:
                return file.read()
        return None


def _table(index, texture, uv_maps):
    table = {"index": index}
    number = uv_maps.index(texture.uv)
    if number:
        table["texCoord"] = number
    if texture.transform:
        offset, rotation, scale = texture.transform
        table["extensions"] = {"KHR_texture_transform": {"offset": list(offset), "rotation": rotation, "scale": list(scale)}}
    return table
