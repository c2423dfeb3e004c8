"""Blender's camera as that of cardioid: a picture whose optical axis is in its middle, and a window of it.

A camera with a shift sees a window beside the middle of a larger picture, so it is rendered as that (`--crop`), to the nearest pixel.
"""

from dataclasses import dataclass
from math import atan, degrees


@dataclass(frozen=True)
class Lens:
    """What a camera of Blender with a flat picture says. Lengths of sensor and focal length in millimetres. `scale`: of an orthographic
    camera, the extent of the fitted side in the scene; None for a perspective one."""

    focal_length: float
    sensor_width: float = 36.0
    sensor_height: float = 24.0
    sensor_fit: str = "AUTO"
    shift_x: float = 0.0
    shift_y: float = 0.0
    scale: float = None


@dataclass(frozen=True)
class Frame:
    """The picture to render, and the window of it that Blender shows, in pixels from the top left.

    `pixel`: the side of a pixel on a plane at the distance of one of a perspective camera; in the scene of an orthographic one; None of
    a panorama.
    """

    width: int
    height: int
    window: tuple
    pixel: float = None
    is_perspective: bool = True

    @property
    def is_whole(self):
        return self.window == (0, 0, self.width, self.height)

    @property
    def fov(self):
        """The vertical field of view of the whole picture, degrees."""
        return degrees(2.0 * atan(0.5 * self.pixel * self.height))


def frame_of(lens, width, height, border=None):
    """The frame for a picture of Blender of `width` x `height` pixels. `border`: the part of it that is rendered, in pixels from the
    lower left as (x0, y0, x1, y1)."""
    # The side that the sensor fits; in an automatic fit the larger side of the picture gets the width of the sensor.
    upwards = lens.sensor_fit == "VERTICAL" or lens.sensor_fit == "AUTO" and height > width
    fitted = height if upwards else width
    sensor = lens.sensor_height if lens.sensor_fit == "VERTICAL" else lens.sensor_width
    right, up = round(lens.shift_x * fitted), round(lens.shift_y * fitted)
    full = (width + 2 * abs(right), height + 2 * abs(up))
    window = _window(abs(right) + right, abs(up) - up, width, height, border)
    is_perspective = lens.scale is None
    pixel = sensor / lens.focal_length / fitted if is_perspective else lens.scale / fitted
    return Frame(*full, window, pixel, is_perspective)


def whole_frame(width, height, border=None):
    """The frame of a panorama."""
    return Frame(width, height, _window(0, 0, width, height, border), is_perspective=False)


def _window(x0, y0, width, height, border):
    left, low, end, high = border or (0, 0, width, height)
    return (x0 + left, y0 + height - high, x0 + end, y0 + height - low)


def place(table, frame, point):
    """Column and row, in pixels of the whole picture from its top left, where the camera of a scene file sees a point; None where it is
    behind. All in the axes of scene files."""
    eye, at, up = table["eye"], table["at"], table["up"]
    forward = _unit([a - b for a, b in zip(at, eye)])
    right = _unit(_cross(forward, up))
    above = _cross(right, forward)
    offset = [a - b for a, b in zip(point, eye)]
    x, y, z = (sum(a * b for a, b in zip(offset, axis)) for axis in (right, above, forward))
    if z <= 0.0:
        return None
    size = frame.pixel * z if frame.is_perspective else frame.pixel
    return 0.5 * frame.width + x / size, 0.5 * frame.height - y / size


def _cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _unit(vector):
    length = sum(x * x for x in vector) ** 0.5
    return [x / length for x in vector]


def border_pixels(width, height, low_x, high_x, low_y, high_y):
    """Blender's border, shares of the picture from its lower left, in whole pixels, as Blender rounds it."""
    return (int(low_x * width), int(low_y * height), int(high_x * width), int(high_y * height))


def lens_radius(focal_length, f_number):
    """Radius of the lens in metres; focal length in millimetres."""
    return 1e-3 * focal_length / (2.0 * f_number)
