"""Blender's materials as surfaces: the nodes of the shaders, and what of them cannot be told."""

from .nodes import Graph, tree_of
from .surface import Amount, Medium, Surface, added, black, matt, mixed
from .units import absorption, principled_absorption, scaled, scattering


def surface_of(material, notices):
    """The surface of a material; None where light passes as if nothing were there. Without a material it is grey, as in Blender."""
    if material is None:
        return matt((0.8, 0.8, 0.8))
    graph = Graph(f"material '{material.name}'", notices)
    return graph.ended(lambda: _of_material(graph, material), black(), "it is black")


def _of_material(graph, material):
    tree = tree_of(material)
    if tree is None:
        surface = Surface(
            base=Amount(tuple(material.diffuse_color)[:3]),
            metallic=Amount(material.metallic),
            roughness=Amount(material.roughness),
        )
        return surface
    output = tree.get_output_node("CYCLES")
    if output is None:
        graph.say("there is no output of the material; it is black")
        return black()
    found = graph.source(output.inputs["Surface"])
    if found is None and graph.source(output.inputs["Volume"]) is not None:
        # A volume alone has no surface.
        surface = None
    else:
        surface = _of_socket(graph, output.inputs["Surface"], ())
    surface = _with_volume(graph, output.inputs["Volume"], surface)
    displaced = graph.source(output.inputs["Displacement"])
    if displaced is not None:
        graph.say("displacement is not modelled; the surface is where its mesh is")
    own = getattr(material, "cardioid", None)
    if surface is not None and own is not None and own.is_border:
        if surface.transmission > 0.0:
            surface.is_border = True
        else:
            graph.say("it is to be the border of a body, and is not, because it transmits no light")
    if surface is not None and surface.transmission > 0.0 and surface.alpha != Amount(1.0):
        graph.say("its alpha is not used, because it is glass")
        surface.alpha = Amount(1.0)
    return surface


def _of_socket(graph, socket, stack):
    found = graph.source(socket, stack)
    if found is None or found[0] is None:
        # Nothing is linked: Blender shows black.
        return black()
    node, _, stack = found
    shade = _SHADERS.get(node.type)
    if shade is None:
        graph.say(f"the shader '{node.name}' is not modelled; the surface is black")
        return black()
    return shade(graph, node, stack)


def _principled(graph, node, stack):
    inputs = node.inputs

    def number(name):
        return graph.number(inputs[name], stack) if name in inputs else 0.0

    surface = Surface(
        base=graph.base(inputs["Base Color"], stack),
        metallic=graph.amount(inputs["Metallic"], stack),
        roughness=graph.amount(inputs["Roughness"], stack),
        alpha=graph.amount(inputs["Alpha"], stack),
        ior=max(number("IOR"), 1.0),
        transmission=min(max(number("Transmission Weight"), 0.0), 1.0),
        coat=min(max(number("Coat Weight"), 0.0), 1.0),
        coat_roughness=number("Coat Roughness"),
    )
    if number("IOR") < 1.0:
        graph.say("an index of refraction below 1 is not modelled; it is 1")
    level = 2.0 * max(number("Specular IOR Level"), 0.0)
    tint = graph.colour(inputs["Specular Tint"], stack)
    surface.specular = min(level, 1.0)
    surface.specular_colour = scaled(tint, max(level, 1.0))
    if min(tint) < 1.0 and (surface.metallic.texture or surface.metallic.value > 0.0):
        graph.say("the tint of the edges of metal is not modelled; it turns white at grazing angles")
    if "Thin Wall" in inputs and inputs["Thin Wall"].default_value:
        graph.say("a thin wall is a sheet where its mesh is open, and a body of glass where it is closed")
    if surface.transmission > 0.0 and level != 1.0:
        graph.say("its Specular IOR Level does not count at the border of glass: Fresnel's formula holds there")
    if surface.transmission > 0.0 and surface.base.texture:
        graph.say("its colour tints what it transmits by the picture itself")
    strength = number("Emission Strength")
    if strength > 0.0:
        emitted = graph.amount(inputs["Emission Color"], stack)
        surface.emission_texture = emitted.texture
        surface.emission = (strength,) * 3 if emitted.texture else scaled(emitted.value, strength)
    surface.normal, surface.normal_scale = graph.normal(inputs["Normal"], stack)
    _check_alpha(graph, surface)
    for name, what in (
        ("Subsurface Weight", "subsurface scattering is not modelled; its colour is on the surface"),
        ("Sheen Weight", "sheen is not modelled; it is left out"),
        ("Thin Film Thickness", "a thin film is not modelled; it is left out"),
        ("Diffuse Roughness", "diffuse roughness is not modelled; the diffuse part is Lambertian"),
    ):
        if name in inputs and (inputs[name].is_linked or inputs[name].default_value > 0.0):
            graph.say(what)
    anisotropic = inputs["Anisotropic"] if "Anisotropic" in inputs else None
    if anisotropic is not None and (anisotropic.is_linked or anisotropic.default_value > 0.0):
        graph.say("anisotropy is not modelled; the gloss is the same in all directions")
    if surface.coat > 0.0:
        if abs(number("Coat IOR") - 1.5) > 1e-6:
            graph.say("the index of the coat is 1.5")
        if min(graph.colour(inputs["Coat Tint"], stack)) < 1.0:
            graph.say("the tint of the coat is not modelled; it is clear")
        if inputs["Coat Normal"].is_linked:
            graph.say("normals of the coat are not modelled; it has those of the surface")
    return surface


def _check_alpha(graph, surface):
    """A picture of alpha has to be that of the colour."""
    alpha = surface.alpha.texture
    if alpha is None:
        return
    base = surface.base.texture
    same = base and base.image == alpha.image and base.placement == alpha.placement
    if not (same and alpha.channel == "A"):
        graph.say("alpha comes from another picture than the colour, which is not modelled; the surface is opaque")
        surface.alpha = Amount(1.0)


def _diffuse(graph, node, stack):
    surface = matt(graph.base(node.inputs["Color"], stack))
    if graph.number(node.inputs["Roughness"], stack) > 0.0:
        graph.say("diffuse roughness is not modelled; the surface is Lambertian")
    surface.normal, surface.normal_scale = graph.normal(node.inputs["Normal"], stack)
    return surface


def _glossy(graph, node, stack):
    """The same reflectance at all angles: an index of 0 stands for that in glTF."""
    colour = graph.amount(node.inputs["Color"], stack)
    roughness = graph.amount(node.inputs["Roughness"], stack)
    if colour.texture:
        surface = Surface(base=colour, metallic=Amount(1.0), roughness=roughness)
        graph.say("a glossy shader with a picture is a metal of its colours, which is whiter at grazing angles")
    else:
        surface = Surface(base=Amount((0.0, 0.0, 0.0)), roughness=roughness, ior=0.0, specular_colour=colour.value)
    anisotropy = node.inputs["Anisotropy"] if "Anisotropy" in node.inputs else None
    if anisotropy is not None and (anisotropy.is_linked or anisotropy.default_value != 0.0):
        graph.say("anisotropy is not modelled; the gloss is the same in all directions")
    surface.normal, surface.normal_scale = graph.normal(node.inputs["Normal"], stack)
    return surface


def _metallic(graph, node, stack):
    if getattr(node, "fresnel_type", "F82") != "F82":
        graph.say("a metal by physical indices is not modelled; its colour at right angles is used")
    colour = graph.amount(node.inputs["Base Color"], stack)
    surface = Surface(base=colour, metallic=Amount(1.0), roughness=graph.amount(node.inputs["Roughness"], stack))
    if "Edge Tint" in node.inputs and min(tuple(node.inputs["Edge Tint"].default_value)[:3]) < 1.0:
        graph.say("the edge tint of a metal is not modelled; it turns white at grazing angles")
    surface.normal, surface.normal_scale = graph.normal(node.inputs["Normal"], stack)
    return surface


def _glass(graph, node, stack):
    if node.type == "BSDF_REFRACTION":
        graph.say("a refraction shader reflects too here, as glass does")
    surface = Surface(
        base=Amount(graph.colour(node.inputs["Color"], stack)),
        roughness=Amount(graph.number(node.inputs["Roughness"], stack)),
        ior=max(graph.number(node.inputs["IOR"], stack), 1.0),
        transmission=1.0,
        tints_each_border=True,
    )
    if graph.number(node.inputs["IOR"], stack) < 1.0:
        graph.say("an index of refraction below 1 is not modelled; it is 1")
    surface.normal, surface.normal_scale = graph.normal(node.inputs["Normal"], stack)
    return surface


def _transparent(graph, node, stack):
    colour = graph.colour(node.inputs["Color"], stack)
    if min(colour) < 1.0:
        if max(colour) <= 0.0:
            return black()
        graph.say("a coloured transparent shader is not modelled; light passes unchanged")
    return None


def _emission(graph, node, stack):
    surface = black()
    strength = graph.number(node.inputs["Strength"], stack)
    colour = graph.amount(node.inputs["Color"], stack)
    if strength < 0.0:
        graph.say("a negative emission is not modelled; it is none")
        return surface
    surface.emission_texture = colour.texture
    surface.emission = (strength,) * 3 if colour.texture else scaled(colour.value, strength)
    return surface


def _like_matt(what):
    def shade(graph, node, stack):
        graph.say(what)
        return matt(graph.amount(node.inputs["Color"], stack))

    return shade


def _mix(graph, node, stack):
    factor = graph.source(node.inputs[0], stack)
    if factor is not None and factor[0] is not None and factor[0].type == "LIGHT_PATH":
        graph.say("what a mixed shader is depends on the kind of ray; it is what the camera sees")
        share = 1.0 if factor[1].name == "Is Camera Ray" else 0.0
    else:
        share = min(max(graph.number(node.inputs[0], stack, "the share of a mixed shader"), 0.0), 1.0)
    # The other side is not asked where it does not count, so that it is not told of either.
    one = _of_socket(graph, node.inputs[1], stack) if share < 1.0 else None
    two = _of_socket(graph, node.inputs[2], stack) if share > 0.0 else None
    if share in (0.0, 1.0):
        return two if share else one
    surface, is_whole = mixed(one, two, share)
    if not is_whole:
        graph.say(f"the mixed shader '{node.name}' is not modelled; it is the heavier of its two shaders alone")
    return surface


def _add(graph, node, stack):
    surface, is_whole = added(_of_socket(graph, node.inputs[0], stack), _of_socket(graph, node.inputs[1], stack))
    if not is_whole:
        graph.say(f"the added shader '{node.name}' is not modelled; it is one of its two shaders alone")
    return surface


_SHADERS = {
    "BSDF_PRINCIPLED": _principled,
    "BSDF_DIFFUSE": _diffuse,
    "BSDF_GLOSSY": _glossy,
    "BSDF_ANISOTROPIC": _glossy,
    "BSDF_METALLIC": _metallic,
    "BSDF_GLASS": _glass,
    "BSDF_REFRACTION": _glass,
    "BSDF_TRANSPARENT": _transparent,
    "BSDF_TRANSLUCENT": _like_matt("a translucent shader is not modelled; it reflects instead"),
    "BSDF_SHEEN": _like_matt("a sheen shader is not modelled; it is diffuse"),
    "BSDF_TOON": _like_matt("a toon shader is not modelled; it is diffuse"),
    "SUBSURFACE_SCATTERING": _like_matt("subsurface scattering is not modelled; its colour is on the surface"),
    "EMISSION": _emission,
    "MIX_SHADER": _mix,
    "ADD_SHADER": _add,
}


def _with_volume(graph, socket, surface):
    """The surface with what is inside of it, which needs a surface that light passes."""
    inside = medium_of(graph, graph.source(socket))
    if inside is None or max(inside.absorption + inside.scattering) <= 0.0:
        return surface
    if surface is None:
        # A volume without a surface: a border that does not bend light.
        surface = Surface(
            base=Amount((1.0, 1.0, 1.0)), roughness=Amount(0.0), ior=1.0, transmission=1.0, tints_each_border=True
        )
    if surface.transmission <= 0.0:
        graph.say("its volume is not seen, because its surface transmits no light")
        return surface
    surface.inside = inside
    if surface.scatters:
        if surface.transmission < 1.0 or surface.base.texture or min(surface.base.value) < 1.0:
            graph.say("around a volume that scatters, the surface is clear glass, without a colour of its own")
        if surface.roughness.texture or surface.normal or surface.coat > 0.0 or surface.emits:
            graph.say("around a volume that scatters, pictures, coat and emission of the surface are not modelled")
    return surface


def medium_of(graph, found):
    """What a volume shader stands for, by its source; None where there is none, or none that is modelled."""
    if found is None or found[0] is None:
        return None
    node, _, stack = found
    inputs = node.inputs
    if node.type == "ADD_SHADER":
        parts = [medium_of(graph, graph.source(socket, stack)) or Medium() for socket in inputs]
        return _sum(graph, *parts)
    if node.type == "VOLUME_ABSORPTION":
        colour, density = graph.colour(inputs["Color"], stack), graph.number(inputs["Density"], stack)
        return Medium(absorption=absorption(colour, density))
    if node.type == "VOLUME_SCATTER":
        colour, density = graph.colour(inputs["Color"], stack), graph.number(inputs["Density"], stack)
        return Medium(scattering=scattering(colour, density), **_phase(graph, node, stack))
    if node.type == "PRINCIPLED_VOLUME":
        colour, density = graph.colour(inputs["Color"], stack), graph.number(inputs["Density"], stack)
        absorbing = graph.colour(inputs["Absorption Color"], stack)
        if graph.number(inputs["Emission Strength"], stack) > 0.0 or graph.number(inputs["Blackbody Intensity"], stack) > 0.0:
            graph.say("light that its volume emits is not modelled")
        return Medium(
            principled_absorption(colour, absorbing, density), scattering(colour, density), **_phase(graph, node, stack)
        )
    if node.type == "VOLUME_COEFFICIENTS":
        # Blender has these as vectors.
        taken, scattered, emitted = (
            tuple(max(x, 0.0) for x in inputs[f"{name} Coefficients"].default_value)
            for name in ("Absorption", "Scatter", "Emission")
        )
        if max(emitted) > 0.0:
            graph.say("light that its volume emits is not modelled")
        return Medium(taken, scattered, **_phase(graph, node, stack))
    graph.say(f"the volume '{node.name}' is not modelled; it is left out")
    return None


def _phase(graph, node, stack):
    kind = getattr(node, "phase", "HENYEY_GREENSTEIN")
    if kind == "RAYLEIGH":
        return {"phase": "rayleigh"}
    if kind != "HENYEY_GREENSTEIN":
        graph.say(f"the phase function {kind} is not modelled; that of Henyey and Greenstein is used")
    return {"g": min(max(graph.number(node.inputs["Anisotropy"], stack), -0.99), 0.99)}


def _sum(graph, one, two):
    """Two media in the same place. Where both scatter, directions are those of the mean."""
    weights = [sum(medium.scattering) for medium in (one, two)]
    absorbed, scattered = (
        tuple(a + b for a, b in zip(*sides))
        for sides in ((one.absorption, two.absorption), (one.scattering, two.scattering))
    )
    if min(weights) > 0.0 and (one.g, one.phase) != (two.g, two.phase):
        graph.say("volumes that scatter in different ways are mixed; they scatter by their mean")
        g = (weights[0] * one.g + weights[1] * two.g) / sum(weights)
        return Medium(absorbed, scattered, g)
    first = one if weights[0] > 0.0 else two
    return Medium(absorbed, scattered, first.g, first.phase)
