"""Blender's camera as that of a scene file. Works on anything that has the attributes of Blender's cameras."""

from math import degrees, pi

from .framing import Lens, frame_of, lens_radius, whole_frame
from .lamps import column, upright


class SceneError(Exception):
    """Why a scene cannot be rendered, for the user."""


def frame_and_table(name, camera, matrix, size, border, notices, focus=None):
    """The frame to render and the table `[camera]`. `focus`: where the object in focus is, if there is one."""
    who = f"camera '{name}'"
    eye, back, up = (column(matrix, index) for index in (3, 2, 1))
    length = sum(x * x for x in back) ** 0.5
    forward = tuple(-x / length for x in back)
    table = {"eye": upright(eye), "at": upright(tuple(a + b for a, b in zip(eye, forward))), "up": upright(up)}
    if camera.type == "PANO":
        _panorama(who, camera, table, size)
        return whole_frame(*size, border), table
    lens = Lens(
        camera.lens,
        camera.sensor_width,
        camera.sensor_height,
        camera.sensor_fit,
        camera.shift_x,
        camera.shift_y,
        camera.ortho_scale if camera.type == "ORTHO" else None,
    )
    frame = frame_of(lens, *size, border)
    if camera.type == "ORTHO":
        table |= {"type": "orthographic", "height": frame.pixel * frame.height}
    elif camera.type == "PERSP":
        table["fov"] = frame.fov
    else:
        raise SceneError(f"{who} is of the kind {camera.type}, which is not modelled; change its type to Perspective")
    dof = camera.dof
    if dof.use_dof and dof.aperture_fstop > 0.0:
        if camera.type == "ORTHO":
            notices.add(who, "depth of field of an orthographic camera is not modelled; all is sharp")
            return frame, table
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


def _panorama(who, camera, table, size):
    """Completes the table of a panorama. Only those of all directions, and fisheyes with even rings, are modelled."""
    kind = camera.panorama_type
    if kind == "EQUIRECTANGULAR":
        limits = (camera.latitude_min, camera.latitude_max, camera.longitude_min, camera.longitude_max)
        if any(abs(a - b) > 1e-4 for a, b in zip(limits, (-pi / 2, pi / 2, -pi, pi))):
            raise SceneError(f"{who} shows a part of all directions, which is not modelled; set its latitudes and longitudes to the whole")
        table["type"] = "panorama"
    elif kind == "FISHEYE_EQUIDISTANT":
        if size[0] != size[1]:
            raise SceneError(f"{who} is a fisheye, and its picture has to be a square; set the resolution so")
        table |= {"type": "fisheye", "fov": degrees(camera.fisheye_fov)}
    else:
        raise SceneError(
            f"{who} is a panorama of the kind {kind}, which is not modelled; choose Equirectangular, Fisheye Equidistant or a perspective camera"
        )
