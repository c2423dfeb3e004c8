"""Blender's camera as that of a scene file. Works on anything that has the attributes of Blender's cameras."""

from .framing import Lens, frame_of, lens_radius
from .lamps import column, upright


class SceneError(Exception):
    """Why a scene cannot be rendered, for the user."""


def frame_and_table(name, camera, matrix, size, border, notices, focus=None):
    """The frame to render and the table `[camera]`. `focus`: where the object in focus is, if there is one."""
    who = f"camera '{name}'"
    if camera.type != "PERSP":
        raise SceneError(f"{who} is of the kind {camera.type}, and cardioid has perspective cameras alone; change its type to Perspective")
    lens = Lens(
        camera.lens, camera.sensor_width, camera.sensor_height, camera.sensor_fit, camera.shift_x, camera.shift_y
    )
    frame = frame_of(lens, *size, border)
    eye, back, up = (column(matrix, index) for index in (3, 2, 1))
    length = sum(x * x for x in back) ** 0.5
    forward = tuple(-x / length for x in back)
    table = {
        "eye": upright(eye),
        "at": upright(tuple(a + b for a, b in zip(eye, forward))),
        "up": upright(up),
        "fov": frame.fov,
    }
    dof = camera.dof
    if dof.use_dof and dof.aperture_fstop > 0.0:
        table["lens-radius"] = lens_radius(camera.lens, dof.aperture_fstop)
        distance = dof.focus_distance
        if focus is not None:
            distance = sum(f * (a - b) for f, a, b in zip(forward, focus, eye))
        if distance <= 0.0:
            notices.add(who, "what is in focus is behind it; there is no depth of field")
            del table["lens-radius"]
        else:
            table["focus-distance"] = float(distance)
        if dof.aperture_blades or dof.aperture_ratio != 1.0:
            notices.add(who, "the blades and the ratio of its aperture are not modelled; it is round")
    return frame, table
