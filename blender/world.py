"""Blender's world as the environment or the sky of a scene file.

Works on anything that has the attributes of Blender's worlds and nodes.
"""

from math import cos, degrees, exp, sin

from . import units
from .materials import medium_of
from .nodes import Graph, tree_of

#: Turn of an environment image, degrees: Blender has +x in its middle, and scene files have -z.
_MIDDLE = -90.0

_NISHITA = ("NISHITA", "SINGLE_SCATTERING", "MULTIPLE_SCATTERING")


def tables(world, notices):
    """The tables of its lights, none where the world is black, and the image that the first one needs, whose place is its `image`."""
    if world is None:
        return [], None
    graph = Graph(f"world '{world.name}'", notices)
    return graph.ended(lambda: _of_world(graph, world), ([], None), "it is black")


def _of_world(graph, world):
    tree = tree_of(world)
    if tree is None:
        return _constant(tuple(world.color)), None
    output = tree.get_output_node("CYCLES")
    if output is None:
        return [], None
    found = graph.source(output.inputs["Surface"])
    if found is None or found[0] is None:
        return [], None
    return _of_shader(graph, *found)


def medium(world, notices):
    """What fills the world; None where that is nothing."""
    tree = tree_of(world) if world is not None else None
    output = tree.get_output_node("CYCLES") if tree is not None else None
    if output is None:
        return None
    graph = Graph(f"world '{world.name}'", notices)
    found = graph.ended(lambda: medium_of(graph, graph.source(output.inputs["Volume"])), None, "its volume is left out")
    if found is None or max(found.absorption + found.scattering) <= 0.0:
        return None
    graph.say("its volume fills a box around the scene, half as large again; Blender's has no end")
    return found


def _constant(radiance):
    if max(radiance) <= 0.0:
        return []
    return [{"type": "environment", "radiance": tuple(max(channel, 0.0) for channel in radiance)}]


def _of_shader(graph, node, _origin, stack):
    if node.type == "MIX_SHADER":
        factor = graph.source(node.inputs[0], stack)
        by_ray = factor is not None and factor[0] is not None and factor[0].type == "LIGHT_PATH"
        if by_ray:
            graph.say("what the world shows the camera and what lights the scene differ; the light is shown too")
            share = 0.0
        else:
            share = graph.number(node.inputs[0], stack)
            if 0.0 < share < 1.0:
                graph.say("mixed shaders of the world are not modelled; it is the heavier one alone")
        found = graph.source(node.inputs[2 if share > 0.5 else 1], stack)
        return _of_shader(graph, *found) if found and found[0] else ([], None)
    if node.type not in ("BACKGROUND", "EMISSION"):
        graph.say(f"the shader '{node.name}' of the world is not modelled; it is black")
        return [], None
    strength = graph.number(node.inputs["Strength"], stack)
    if strength <= 0.0:
        return [], None
    found = graph.source(node.inputs["Color"], stack)
    if found is not None and found[0] is not None:
        picture, _, inner = found
        if picture.type == "TEX_ENVIRONMENT":
            return _image(graph, picture, inner, strength)
        if picture.type == "TEX_SKY":
            return _sky(graph, picture, inner, strength), None
    return _constant(units.scaled(graph.colour(node.inputs["Color"], stack), strength)), None


def _turn(graph, node, stack):
    """Turn around z of the directions that a texture is looked up by, radians."""
    # A physical sky of Blender 5.2 has no directions to look up.
    found = graph.source(node.inputs["Vector"], stack) if "Vector" in node.inputs else None
    if found is None or found[0] is None:
        return 0.0
    inner, origin, stack = found
    if inner.type == "TEX_COORD" and origin.name == "Generated":
        return 0.0
    if inner.type != "MAPPING":
        graph.say(f"the world is turned by the node '{inner.name}', which is not modelled; it is not turned")
        return 0.0
    return _turn(graph, inner, stack) + mapping_turn(graph, inner)


def mapping_turn(graph, node):
    turn = tuple(node.inputs["Rotation"].default_value)
    if any(node.inputs[name].is_linked for name in ("Location", "Rotation", "Scale") if name in node.inputs):
        graph.say(f"values of the node '{node.name}' are linked, which is not modelled; its plain ones are used")
    if abs(turn[0]) > 1e-6 or abs(turn[1]) > 1e-6:
        graph.say("a world that is turned around x or y is not modelled; only its turn around z is")
    place = tuple(node.inputs["Location"].default_value) if "Location" in node.inputs else (0.0,) * 3
    scale = tuple(node.inputs["Scale"].default_value)
    if max(abs(x) for x in place) > 1e-6 or max(abs(x - 1.0) for x in scale) > 1e-6:
        graph.say("a world that is moved or scaled is not modelled; only its turn around z is")
    if node.vector_type == "TEXTURE":
        return -turn[2]
    return turn[2]


def _image(graph, node, stack, strength):
    if node.image is None:
        graph.say("its picture is missing; Blender shows that in pink, and here it gives no light")
        return [], None
    if node.projection != "EQUIRECTANGULAR":
        graph.say(f"the projection {node.projection} is not modelled; the picture is taken as equirectangular")
    # Directions are turned before they are looked up, so that the picture turns the other way.
    rotation = _MIDDLE - degrees(_turn(graph, node, stack))
    return [{"type": "environment", "image": "", "rotation": rotation, "scale": float(strength)}], node.image


#: Blender's physical skies: the sun's irradiance (W/m^2, red, green, blue) above the air; what a clear air and its dust take of it at
#: the zenith, as exponents; and the brightness of the sky over that of Hosek and Wilkie. Measured on Cycles 4.2 and 5.2 at elevations
#: of 15, 45 and 80 degrees: the sun's light is within 2 % of this, that of the whole sky on level ground within 8 %.
_SINGLE = ((163.8, 143.7, 133.9), (0.0517, 0.1016, 0.2376), 0.0266, 0.41)
_MULTIPLE = ((179.6, 165.3, 151.9), (0.0689, 0.1256, 0.2534), 0.0266, 0.6)

#: Blender's other skies have a scale of their own. Measured as above, within 5 % and 15 %.
_SCALES = {"HOSEK_WILKIE": 0.0098, "PREETHAM": 0.068}


def air_mass(elevation):
    """Length of the way through the air over that at the zenith (Kasten & Young 1989); elevation in radians."""
    above = degrees(max(elevation, 0.0))
    return 1.0 / (sin(max(elevation, 0.0)) + 0.50572 * (above + 6.07995) ** -1.6364)


def sun_irradiance(elevation, kind, air, dust):
    """Irradiance (W/m^2) of a surface that faces the sun of Blender's physical skies."""
    outside, clear, dusty, _ = _MULTIPLE if kind == "MULTIPLE_SCATTERING" else _SINGLE
    mass = air_mass(elevation)
    return tuple(e * exp(-(air * c + dust * dusty) * mass) for e, c in zip(outside, clear))


def _sky(graph, node, stack, strength):
    turn = _turn(graph, node, stack)
    sun = None
    if node.sky_type in _NISHITA:
        elevation, rotation = node.sun_elevation, node.sun_rotation
        # Towards the sun, in Blender's axes: its turn is clockwise from +y.
        towards = (cos(elevation) * sin(rotation), cos(elevation) * cos(rotation), sin(elevation))
        dust = getattr(node, "dust_density", getattr(node, "aerosol_density", 1.0))
        sky = {"turbidity": min(max(1.2 + dust, 1.0), 10.0)}
        scale = strength * (_MULTIPLE if node.sky_type == "MULTIPLE_SCATTERING" else _SINGLE)[3]
        graph.say("its sky is that of Hosek and Wilkie, which is nearly as bright on level ground, and of other colours")
        if node.sun_disc:
            irradiance = sun_irradiance(elevation, node.sky_type, node.air_density, dust)
            sun = units.scaled(irradiance, strength * node.sun_intensity)
    else:
        towards = tuple(node.sun_direction)
        sky = {"turbidity": min(max(node.turbidity, 1.0), 10.0)}
        scale = strength * _SCALES.get(node.sky_type, 1.0)
        if node.sky_type == "HOSEK_WILKIE":
            sky["albedo"] = min(max(node.ground_albedo, 0.0), 1.0)
        else:
            graph.say("its sky is that of Hosek and Wilkie, which is nearly as bright on level ground")
    x, y, z = towards
    # The directions in which the sky is looked up are turned, so that it turns the other way.
    x, y = x * cos(turn) + y * sin(turn), y * cos(turn) - x * sin(turn)
    if z < 0.0:
        graph.say("a sun below the horizon is not modelled; it stands on it, and gives no light of its own")
        z, sun = 0.0, None
    if (x, y, z) == (0.0, 0.0, 0.0):
        z = 1.0
    tables = [{"type": "sky", "sun-direction": (x, z, -y), "sun": False, "scale": float(scale)} | sky]
    if sun and max(sun) > 0.0:
        disc = {"type": "directional", "direction": (-x, -z, y), "irradiance": sun}
        if degrees(node.sun_size) >= 0.001:
            disc["angular-diameter"] = degrees(node.sun_size)
        tables.append(disc)
    return tables
