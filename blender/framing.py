"""Blender's camera as that of cardioid: a picture whose optical axis is in its middle, and a window of it.

A camera with a shift sees a window beside the middle of a larger picture, so it is rendered as that (`--crop`), to the nearest pixel.
"""

from dataclasses import dataclass
from math import atan, ceil, degrees


@dataclass(frozen=True)
class Lens:
    """What a perspective camera of Blender says. Lengths of sensor and focal length in millimetres."""

    focal_length: float
    sensor_width: float = 36.0
    sensor_height: float = 24.0
    sensor_fit: str = "AUTO"
    shift_x: float = 0.0
    shift_y: float = 0.0


@dataclass(frozen=True)
class Frame:
    """The picture to render: its size, its vertical field of view, and the window that Blender shows, in pixels from the top left."""

    width: int
    height: int
    fov: float
    window: tuple

    @property
    def is_whole(self):
        return self.window == (0, 0, self.width, self.height)


def frame_of(lens, width, height, border=None):
    """The frame for a picture of Blender of `width` x `height` pixels. `border`: the part of it that is rendered, in pixels from the
    lower left as (x0, y0, x1, y1)."""
    fit = lens.sensor_fit
    if fit == "AUTO":
        # The larger side of the picture gets the width of the sensor.
        fitted, sensor = max(width, height), lens.sensor_width
    elif fit == "HORIZONTAL":
        fitted, sensor = width, lens.sensor_width
    else:
        fitted, sensor = height, lens.sensor_height
    pixel = sensor / lens.focal_length / fitted
    right, up = lens.shift_x * fitted, lens.shift_y * fitted
    wider, higher = _beyond(right), _beyond(up)
    full_width, full_height = width + 2 * wider, height + 2 * higher
    x0, y0 = wider + round(right), higher - round(up)
    left, low, end, high = border or (0, 0, width, height)
    window = (x0 + left, y0 + height - high, x0 + end, y0 + height - low)
    fov = degrees(2.0 * atan(0.5 * pixel * full_height))
    return Frame(full_width, full_height, fov, window)


def _beyond(pixels):
    """Pixels that the picture grows by on each side for a shift."""
    return ceil(abs(round(pixels)))


def border_pixels(width, height, low_x, high_x, low_y, high_y):
    """Blender's border, shares of the picture from its lower left, in whole pixels, as Blender rounds it."""
    return (int(low_x * width), int(low_y * height), int(high_x * width), int(high_y * height))


def lens_radius(focal_length, f_number):
    """Radius of the lens in metres; focal length in millimetres."""
    return 1e-3 * focal_length / (2.0 * f_number)
