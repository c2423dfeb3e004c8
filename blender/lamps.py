"""Blender's lights as lights and emitters of a scene file.

Works on anything that has the attributes of Blender's lights; a matrix is four rows of four numbers.
"""

from math import cos, degrees, pi, sin, sqrt

from . import units
from .nodes import Graph, tree_of

#: Corners of the polygon that stands for an ellipse.
_CORNERS = 96


def upright(vector):
    """A point or a direction in the axes of scene files: y up."""
    x, y, z = vector
    return (float(x), float(z), -float(y))


def column(matrix, index):
    return tuple(matrix[row][index] for row in range(3))


def _length(vector):
    return sqrt(sum(x * x for x in vector))


def _unit(vector):
    length = _length(vector)
    return tuple(x / length for x in vector) if length > 0.0 else (0.0, 0.0, 1.0)


def _times(vector, factor):
    return tuple(factor * x for x in vector)


def _plus(*vectors):
    return tuple(sum(parts) for parts in zip(*vectors))


def _colour(light, who, notices):
    """Colour times power, with what the nodes of the light say."""
    colour = tuple(light.color)
    if getattr(light, "use_temperature", False):
        colour = tuple(a * b for a, b in zip(colour, light.temperature_color))
    strength = light.energy * 2.0 ** getattr(light, "exposure", 0.0)
    tree = tree_of(light)
    if tree is not None:
        graph = Graph(who, notices)
        own = graph.ended(lambda: _emitted(graph, tree), (1.0, 1.0, 1.0), "its plain colour and power are used")
        colour = tuple(a * b for a, b in zip(colour, own))
    return units.scaled(colour, strength)


def _emitted(graph, tree):
    """Colour times strength that the nodes of a light give it."""
    output = tree.get_output_node("CYCLES")
    found = graph.source(output.inputs["Surface"]) if output else None
    if found is None or found[0] is None:
        return (0.0, 0.0, 0.0)
    node, _, stack = found
    if node.type != "EMISSION":
        graph.say(f"the node '{node.name}' of the light is not modelled; its plain colour and power are used")
        return (1.0, 1.0, 1.0)
    return units.scaled(graph.colour(node.inputs["Color"], stack), graph.number(node.inputs["Strength"], stack))


def tables(name, light, matrix, notices):
    """What stands for a light: pairs of a header and a table, and files as pairs of a name's ending and a text.

    A table that names a file has its ending in `file`; the writer of the scene gives it its name.
    """
    who = f"light '{name}'"
    power = _colour(light, who, notices)
    if min(power) < 0.0:
        notices.add(who, "a negative light is not modelled; it gives none")
        power = tuple(max(channel, 0.0) for channel in power)
    if max(power) <= 0.0:
        return [], None
    if not getattr(light, "use_shadow", True):
        notices.add(who, "it casts shadows, although they are off")
    if not getattr(light, "normalize", True):
        notices.add(who, "its power is that of the whole light, although it is not normalized")
    place = upright(column(matrix, 3))
    towards = upright(_times(column(matrix, 2), -1.0))
    kind = light.type
    if kind == "POINT":
        return _point(name, power, place, light.shadow_soft_size), None
    if kind == "SPOT":
        return _spot(name, who, light, power, place, towards, notices)
    if kind == "SUN":
        table = {"name": name, "type": "directional", "direction": _unit(towards), "irradiance": power}
        angle = degrees(light.angle)
        if angle >= 0.001:
            table["angular-diameter"] = min(angle, 180.0)
        return [("[[lights]]", table)], None
    if kind == "AREA":
        return _area(name, who, light, power, place, matrix, notices), None
    notices.add(who, f"lights of the kind {kind} are not modelled; it is left out")
    return [], None


def _point(name, power, place, radius):
    if radius <= 0.0:
        return [("[[lights]]", {"name": name, "type": "point", "position": place, "power": power})]
    radiance = units.scaled(power, units.sphere_radiance(1.0, radius))
    table = {"name": name, "type": "sphere", "center": place, "radius": float(radius), "emission": {"radiance": radiance}}
    return [("[[shapes]]", table)]


def _spot(name, who, light, power, place, towards, notices):
    if light.shadow_soft_size > 0.0:
        notices.add(who, "the size of a spot is not modelled; its shadows are sharp")
    if light.use_square:
        notices.add(who, "a square spot is not modelled; it is round")
    intensity = units.scaled(power, units.point_intensity(1.0))
    half = 0.5 * light.spot_size
    table = {"name": name, "position": place, "direction": _unit(towards)}
    if light.spot_blend <= 0.0:
        angle = degrees(half)
        table |= {"type": "spot", "intensity": intensity, "outer-angle": angle, "inner-angle": angle}
        return [("[[lights]]", table)], None
    axis = _unit(towards)
    along = (1.0, 0.0, 0.0) if abs(axis[0]) < 0.9 else (0.0, 0.0, 1.0)
    table |= {"type": "ies", "file": "ies", "scale": intensity, "along": along}
    return [("[[lights]]", table)], units.spot_profile(half, light.spot_blend)


def _area(name, who, light, power, place, matrix, notices):
    if light.spread < pi - 1e-3:
        notices.add(who, f"a spread of {degrees(light.spread):.0f} degrees is not modelled; its light goes in all directions")
    across, along = upright(column(matrix, 0)), upright(column(matrix, 1))
    size_x = light.size * _length(across)
    is_even = light.shape in ("SQUARE", "DISK")
    size_y = (light.size if is_even else light.size_y) * _length(along)
    across, along = _unit(across), _unit(along)
    if size_x <= 0.0 or size_y <= 0.0:
        notices.add(who, "it has no size, and gives no light; give it a size or make it a point light")
        return []
    normal = upright(_times(column(matrix, 2), -1.0))
    round_one = light.shape in ("DISK", "ELLIPSE")
    area = size_x * size_y * (pi / 4.0 if round_one else 1.0)
    table = {"name": name}
    if not round_one:
        edge_u, edge_v = _times(across, size_x), _times(along, -size_y)
        corner = _plus(place, _times(edge_u, -0.5), _times(edge_v, -0.5))
        table |= {"type": "quad", "corner": corner, "edge-u": edge_u, "edge-v": edge_v}
    elif abs(size_x - size_y) <= 1e-6 * size_x:
        table |= {"type": "disc", "center": place, "normal": _unit(normal), "radius": 0.5 * size_x}
    else:
        # A polygon of the area of the ellipse.
        step = 2.0 * pi / _CORNERS
        grown = sqrt(step / sin(step))
        points = [
            _plus(place, _times(across, 0.5 * grown * size_x * cos(i * step)), _times(along, -0.5 * grown * size_y * sin(i * step)))
            for i in range(_CORNERS)
        ]
        table |= {"type": "mesh", "vertices": points, "faces": [list(range(_CORNERS))]}
    table["emission"] = {"radiance": units.scaled(power, units.area_radiance(1.0, area))}
    return [("[[shapes]]", table)]
