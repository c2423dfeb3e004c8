"""Reads the EXR files of cardioid: scan lines of all channels, uncompressed or by ZIP. Writes pictures of radiance.

Blender's own reader (`RenderLayer.load_from_file`) fills passes by name alone, knows no window of a larger picture, and warns of each
channel of a pass that a file lacks: cardioid's pictures have no alpha. Format: https://openexr.com/en/latest/OpenEXRFileLayout.html
"""

import struct
import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy

_TYPES = {0: ("<u4", 4), 1: ("<f2", 2), 2: ("<f4", 4)}
#: Scan lines in a chunk, by compression: none, and ZIP of one and of sixteen lines.
_LINES = {0: 1, 2: 1, 3: 16}


class ExrError(Exception):
    pass


@dataclass
class Picture:
    """`window`: the pixels that are there, as (x0, y0, x1, y1) in the whole picture; the ends are not among them. `channels`: by name,
    rows from the top."""

    window: tuple
    whole: tuple
    channels: dict
    attributes: dict

    @property
    def size(self):
        return (self.window[2] - self.window[0], self.window[3] - self.window[1])


def read(path):
    """Reads a file. Raises ExrError where it cannot be read."""
    with open(path, "rb") as file:
        data = file.read()
    try:
        return _parse(data)
    except (struct.error, IndexError, ValueError, KeyError, zlib.error, UnicodeDecodeError) as error:
        raise ExrError(f"{path} is damaged or of a kind that is not read ({error}); render it again") from error


def _parse(data):
    magic, version = struct.unpack_from("<II", data)
    if magic != 20000630:
        raise ValueError("no EXR file")
    if version & ~0xFF & ~0x400:
        raise ValueError("tiles, depth or several parts")
    attributes, position = _header(data, 8)
    compression = attributes["compression"][1][0]
    if compression not in _LINES:
        raise ValueError(f"compression {compression}")
    channels = _channels(attributes["channels"][1])
    x0, y0, x1, y1 = _box(attributes["dataWindow"])
    width, height = x1 - x0, y1 - y0
    if width <= 0 or height <= 0:
        raise ValueError("no pixels")
    line_bytes = width * sum(_TYPES[kind][1] for _, kind in channels)
    per_chunk = _LINES[compression]
    count = -(-height // per_chunk)
    offsets = struct.unpack_from(f"<{count}Q", data, position)
    rows = numpy.empty((height, line_bytes), numpy.uint8)

    def read_chunk(offset):
        y, size = struct.unpack_from("<ii", data, offset)
        lines = min(per_chunk, y1 - y)
        if not y0 <= y < y1 or size < 0 or offset + 8 + size > len(data):
            raise ValueError("a chunk outside of the picture or the file")
        packed = data[offset + 8 : offset + 8 + size]
        rows[y - y0 : y - y0 + lines] = _unpacked(packed, lines * line_bytes, compression).reshape(lines, line_bytes)

    # Large pieces of work in zlib and numpy, which leave the interpreter to other threads.
    with ThreadPoolExecutor() as threads:
        list(threads.map(read_chunk, offsets))
    found, start = {}, 0
    for name, kind in channels:
        dtype, size = _TYPES[kind]
        values = numpy.ascontiguousarray(rows[:, start : start + width * size]).view(dtype)
        found[name] = values.astype(numpy.float32, copy=False)
        start += width * size
    whole = _box(attributes["displayWindow"])
    return Picture((x0, y0, x1, y1), whole, found, attributes)


def colours(values):
    """A file of three channels without compression. `values`: red, green and blue, rows from the top."""
    height, width, _ = values.shape

    def attribute(name, kind, data):
        return f"{name}\0{kind}\0".encode() + struct.pack("<I", len(data)) + data

    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channels = b"".join(name + b"\0" + struct.pack("<IIII", 2, 0, 1, 1) for name in (b"B", b"G", b"R")) + b"\0"
    header = struct.pack("<II", 20000630, 2) + attribute("channels", "chlist", channels)
    header += attribute("compression", "compression", b"\0") + attribute("dataWindow", "box2i", box)
    header += attribute("displayWindow", "box2i", box) + attribute("lineOrder", "lineOrder", b"\0")
    header += attribute("pixelAspectRatio", "float", struct.pack("<f", 1.0))
    header += attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0.0, 0.0))
    header += attribute("screenWindowWidth", "float", struct.pack("<f", 1.0)) + b"\0"
    chunk = 8 + 12 * width
    lines = numpy.empty((height, chunk), numpy.uint8)
    lines[:, :4] = numpy.arange(height, dtype="<i4")[:, None].view(numpy.uint8)
    lines[:, 4:8] = numpy.full((height, 1), 12 * width, "<i4").view(numpy.uint8)
    # Channels in the order of their names.
    planes = numpy.ascontiguousarray(numpy.moveaxis(values[..., 2::-1], 2, 1), dtype="<f4")
    lines[:, 8:] = planes.reshape(height, -1).view(numpy.uint8)
    offsets = len(header) + 8 * height + chunk * numpy.arange(height, dtype="<u8")
    return header + offsets.tobytes() + lines.tobytes()


def _header(data, position):
    attributes = {}
    while data[position] != 0:
        name, position = _text(data, position)
        kind, position = _text(data, position)
        (size,) = struct.unpack_from("<I", data, position)
        attributes[name] = (kind, data[position + 4 : position + 4 + size])
        position += 4 + size
    return attributes, position + 1


def _text(data, position):
    end = data.index(b"\0", position)
    return data[position:end].decode(), end + 1


def _channels(data):
    channels, position = [], 0
    while data[position] != 0:
        name, position = _text(data, position)
        kind, _, across, down = struct.unpack_from("<IIII", data, position)
        if (across, down) != (1, 1):
            raise ValueError("channels of fewer pixels")
        channels.append((name, kind))
        position += 16
    return channels


def _box(attribute):
    x0, y0, x1, y1 = struct.unpack("<4i", attribute[1])
    return (x0, y0, x1 + 1, y1 + 1)


def _unpacked(packed, length, compression):
    # A chunk that would grow by compression is stored as it is.
    if compression == 0 or len(packed) == length:
        raw = numpy.frombuffer(packed, numpy.uint8)
        if len(raw) != length:
            raise ValueError("a chunk of another size")
        return raw
    coded = numpy.frombuffer(zlib.decompress(packed), numpy.uint8).copy()
    if len(coded) != length:
        raise ValueError("a chunk of another size")
    # Differences to the byte before, around 128; then the bytes at even places before those at odd ones.
    coded[1:] -= 128
    coded = numpy.cumsum(coded, dtype=numpy.uint8)
    half = (length + 1) // 2
    raw = numpy.empty(length, numpy.uint8)
    raw[0::2], raw[1::2] = coded[:half], coded[half:]
    return raw
