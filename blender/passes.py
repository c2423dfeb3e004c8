"""From the layers of cardioid (docs/images.md) to Blender's passes. Rows from the bottom, as Blender has them."""

import struct

import numpy

#: Depth of what is infinitely far, as Blender's own engines write it.
FAR = 1e10

#: Layers of light that become passes of the same name.
LIGHT = ("emission", "direct", "specular", "caustics", "indirect")


def _stacked(picture, names):
    return numpy.stack([picture.channels[name][::-1] for name in names], axis=-1)


def combined(picture):
    """The picture, opaque."""
    opaque = numpy.ones_like(picture.channels["R"])
    return numpy.concatenate([_stacked(picture, "RGB"), opaque[..., None]], axis=-1)


def layer(picture, name):
    """A layer of colours; None where the file has none."""
    names = [f"{name}.{channel}" for channel in "RGB"]
    return _stacked(picture, names) if names[0] in picture.channels else None


def normal(picture):
    """Normals in Blender's axes."""
    x, y, z = (picture.channels[f"normal.{channel}"][::-1] for channel in "XYZ")
    return numpy.stack([x, -z, y], axis=-1)


def depth(picture, frame):
    """Distance along the view; of a panorama, distance from the eye, as Blender has it."""
    distance = picture.channels["depth.Z"][::-1]
    length = 1.0
    if frame.is_perspective:
        x0, y0, x1, y1 = picture.window
        right = (numpy.arange(x0, x1) + 0.5 - 0.5 * frame.width) * frame.pixel
        down = (numpy.arange(y0, y1) + 0.5 - 0.5 * frame.height)[::-1] * frame.pixel
        length = numpy.sqrt(1.0 + right[None, :] ** 2 + down[:, None] ** 2)
    along = numpy.where(numpy.isfinite(distance), distance / length, FAR)
    return along[..., None].astype(numpy.float32)


def rounds(picture):
    """Number of rounds of progressive rendering that a picture is the mean of; 0 for others."""
    kind, data = picture.attributes.get("cardioid/rounds", ("", b""))
    if kind == "double":
        return round(struct.unpack("<d", data)[0])
    return round(struct.unpack("<f", data)[0]) if kind == "float" else 0


def flat(values):
    """Numbers in the order in which `RenderPass.rect.foreach_set` takes them."""
    return numpy.ascontiguousarray(values, dtype=numpy.float32).reshape(-1)
