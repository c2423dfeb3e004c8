"""Blender's light in the units of cardioid: radiant flux (W), radiance (W/(m^2 sr)), intensity (W/sr), irradiance (W/m^2).

Blender gives point, spot and area lights in watts of radiant flux, and the sun in W/m^2 on a surface that faces it. A spot is a
point light of that power with all light outside of the cone removed. Colours of materials and the world are radiance as they are.
`tests/blender/inside_light.py` measures each of these on the program and on Cycles.
"""

from math import cos, pi, sqrt

#: Luminous efficacy of one watt, lm/W, by which glTF's nits and candelas become watts (docs/gltf.md).
LUMENS_PER_WATT = 683.0


def scaled(colour, factor):
    """The colour times a number."""
    return tuple(factor * channel for channel in colour)


def point_intensity(watts):
    """Intensity (W/sr) of a point light of this flux, and of a spot inside its cone."""
    return watts / (4.0 * pi)


def sphere_radiance(watts, radius):
    """Radiance of a sphere of this flux; radius in metres."""
    return watts / (4.0 * pi * pi * radius * radius)


def area_radiance(watts, area):
    """Radiance of a flat emitter of this flux with one side; area in square metres."""
    return watts / (pi * area)


def absorption(colour, density):
    """Absorption coefficient (1/m) of Blender's Volume Absorption: what is not the colour, times the density."""
    return tuple(max(density, 0.0) * (1.0 - share) for share in _shares(colour))


def scattering(colour, density):
    """Scattering coefficient (1/m) of Blender's Volume Scatter: the colour times the density."""
    return tuple(max(density, 0.0) * max(channel, 0.0) for channel in colour)


def principled_absorption(colour, absorbing, density):
    """Absorption coefficient (1/m) of Blender's Principled Volume: what is neither its colour nor the root of the colour of absorption."""
    shares = zip(_shares(colour), _shares(absorbing))
    return tuple(max(density, 0.0) * (1.0 - share) * (1.0 - sqrt(kept)) for share, kept in shares)


def _shares(colour):
    return tuple(min(max(channel, 0.0), 1.0) for channel in colour)


def spot_falloff(cosine, half_angle, blend):
    """Share of a spot's intensity in a direction with this cosine to its axis; half angle of the cone in radians."""
    edge = cos(half_angle)
    width = (1.0 - edge) * blend
    if cosine <= edge:
        return 0.0
    if width <= 0.0 or cosine >= edge + width:
        return 1.0
    t = (cosine - edge) / width
    return t * t * (3.0 - 2.0 * t)


def spot_profile(half_angle, blend, steps=180):
    """A photometric file (LM-63) of a spot: 683 cd on the axis, so that its scale in the scene file is W/sr on the axis.

    Intensities of such files are bilinear in the angle: `steps` angles lie between the edge of the cone and the angle from which
    the intensity is whole.
    """
    from math import acos, degrees

    half_angle = min(half_angle, pi / 2)
    edge = cos(half_angle)
    whole = acos(min(1.0, edge + (1.0 - edge) * blend))
    angles = [0.0]
    angles += [degrees(whole + (half_angle - whole) * i / steps) for i in range(steps + 1)]
    angles += [90.0]
    # Angles that are the same to the last written digit are one.
    kept = []
    for angle in angles:
        if not kept or angle - kept[-1] > 1e-6:
            kept.append(angle)
    from math import radians

    def candela(angle):
        return LUMENS_PER_WATT * spot_falloff(cos(radians(angle)), half_angle, blend)

    lines = ["IESNA:LM-63-2002", "TILT=NONE"]
    lines.append(f"1 -1 1 {len(kept)} 1 1 2 0 0 0")
    lines.append("1 1 0")
    lines += _wrapped(f"{angle:.7f}" for angle in kept)
    lines.append("0")
    lines += _wrapped(f"{candela(angle):.6f}" for angle in kept)
    return "\n".join(lines) + "\n"


def _wrapped(words, per_line=8):
    words = list(words)
    return [" ".join(words[i : i + per_line]) for i in range(0, len(words), per_line)]
