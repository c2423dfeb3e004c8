"""A surface as glTF and cardioid describe it (docs/gltf.md), and its material in a GLB file."""

from dataclasses import dataclass, field
from math import exp, sqrt

from .units import LUMENS_PER_WATT


@dataclass(frozen=True)
class Texture:
    """A picture on a surface. `channel`: None for its colour, or one of R, G, B, A. `uv`: the name of a UV map, or None for that which
    renders. `transform`: offset, rotation and scale as KHR_texture_transform has them."""

    image: object
    channel: str = None
    uv: str = None
    transform: tuple = None
    wrap: int = 10497

    @property
    def placement(self):
        return (self.uv, self.transform, self.wrap)


@dataclass(frozen=True)
class Amount:
    """A number or a colour, or the picture or the colours of vertices that stand for it: `colours` is the name of a colour attribute,
    and empty for that which renders."""

    value: object
    texture: Texture = None
    colours: str = None


@dataclass(frozen=True)
class Medium:
    """What fills a body: coefficients in 1/m, and the mean cosine of what it scatters, or another phase function by its name."""

    absorption: tuple = (0.0, 0.0, 0.0)
    scattering: tuple = (0.0, 0.0, 0.0)
    g: float = 0.0
    phase: str = None

    def table(self, ior):
        """The table `[media.NAME]` of a scene file."""
        table = {"ior": float(ior), "absorption": self.absorption, "scattering": self.scattering}
        return table | ({"phase": self.phase} if self.phase else {"g": self.g})


@dataclass
class Surface:
    base: Amount = field(default_factory=lambda: Amount((0.8, 0.8, 0.8)))
    metallic: Amount = field(default_factory=lambda: Amount(0.0))
    roughness: Amount = field(default_factory=lambda: Amount(0.5))
    alpha: Amount = field(default_factory=lambda: Amount(1.0))
    ior: float = 1.5
    #: Factor on the reflectance of dielectric facets, and their colour.
    specular: float = 1.0
    specular_colour: tuple = (1.0, 1.0, 1.0)
    transmission: float = 0.0
    #: Whether light that passes a border is multiplied by the colour, or by its root (Principled).
    tints_each_border: bool = False
    #: What is inside, where light passes.
    inside: Medium = Medium()
    #: Whether its mesh is the border of a body even where it is open.
    is_border: bool = False
    #: Radiance, W/(m^2 sr).
    emission: tuple = (0.0, 0.0, 0.0)
    emission_texture: Texture = None
    normal: Texture = None
    normal_scale: float = 1.0
    coat: float = 0.0
    coat_roughness: float = 0.03

    @property
    def emits(self):
        return max(self.emission) > 0.0

    @property
    def scatters(self):
        """Whether its inside scatters, which glTF cannot say."""
        return max(self.inside.scattering) > 0.0

    @property
    def textures(self):
        amounts = (self.base, self.metallic, self.roughness, self.alpha)
        found = [amount.texture for amount in amounts] + [self.emission_texture, self.normal]
        return [texture for texture in found if texture]

    @property
    def uv_maps(self):
        """The UV maps that it reads, in the order in which they are written."""
        maps = []
        for texture in self.textures:
            if texture.uv not in maps:
                maps.append(texture.uv)
        return maps


def matt(colour):
    """A Lambertian surface."""
    return Surface(base=Amount(colour) if not isinstance(colour, Amount) else colour, roughness=Amount(1.0), specular=0.0)


def black():
    return matt((0.0, 0.0, 0.0))


def _clamped(colour):
    return [min(max(float(channel), 0.0), 1.0) for channel in colour]


def material(surface, name, slot, slot_of_both, double_sided=True):
    """The material in JSON. `slot(texture)` and `slot_of_both(roughness, metallic)` yield tables of textures, `index` and more."""
    extensions = {}
    pbr = {"metallicFactor": surface.metallic.value, "roughnessFactor": surface.roughness.value}
    if surface.roughness.texture or surface.metallic.texture:
        pbr["metallicRoughnessTexture"] = slot_of_both(surface.roughness, surface.metallic)
        # A picture holds whole values; a plain one stays a factor.
        for key, amount in (("roughnessFactor", surface.roughness), ("metallicFactor", surface.metallic)):
            if amount.texture:
                pbr[key] = 1.0
    has_volume = surface.transmission > 0.0 and (max(surface.inside.absorption) > 0.0 or surface.is_border)
    if surface.base.colours is not None:
        colour = [1.0, 1.0, 1.0]
    elif surface.base.texture:
        colour = [1.0, 1.0, 1.0]
        pbr["baseColorTexture"] = slot(surface.base.texture)
    else:
        colour = _clamped(surface.base.value)
        if surface.transmission > 0.0:
            # Without a volume the importer takes the root at each border of a body.
            if has_volume and not surface.tints_each_border:
                colour = [sqrt(channel) for channel in colour]
            elif not has_volume and surface.tints_each_border:
                colour = [channel * channel for channel in colour]
    pbr["baseColorFactor"] = colour + [1.0 if surface.alpha.texture else min(max(surface.alpha.value, 0.0), 1.0)]
    result = {"name": name, "pbrMetallicRoughness": pbr, "doubleSided": double_sided}
    if surface.alpha.texture or surface.alpha.value < 1.0:
        result["alphaMode"] = "BLEND"
    if surface.ior != 1.5:
        extensions["KHR_materials_ior"] = {"ior": surface.ior}
    if surface.specular != 1.0 or tuple(surface.specular_colour) != (1.0, 1.0, 1.0):
        extensions["KHR_materials_specular"] = {
            "specularFactor": surface.specular,
            "specularColorFactor": [float(channel) for channel in surface.specular_colour],
        }
    if surface.transmission > 0.0:
        extensions["KHR_materials_transmission"] = {"transmissionFactor": surface.transmission}
        if has_volume:
            volume = {"thicknessFactor": 1.0}
            most = max(surface.inside.absorption)
            if most > 0.0:
                volume["attenuationDistance"] = 1.0 / most
                volume["attenuationColor"] = [exp(-channel / most) for channel in surface.inside.absorption]
            extensions["KHR_materials_volume"] = volume
    if surface.coat > 0.0:
        extensions["KHR_materials_clearcoat"] = {
            "clearcoatFactor": surface.coat,
            "clearcoatRoughnessFactor": surface.coat_roughness,
        }
    if surface.normal:
        result["normalTexture"] = dict(slot(surface.normal), scale=surface.normal_scale)
    if surface.emits:
        # The file has nits, and 683 of them are one W/(m^2 sr).
        nits = [LUMENS_PER_WATT * channel for channel in surface.emission]
        strength = max(nits)
        result["emissiveFactor"] = [channel / strength for channel in nits]
        extensions["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
        if surface.emission_texture:
            result["emissiveTexture"] = slot(surface.emission_texture)
    if extensions:
        result["extensions"] = extensions
    return result


def mixed(one, two, share):
    """Two surfaces mixed, `share` of the second, and whether the result is what was asked for; otherwise it is the heavier one."""
    if share <= 0.0:
        return one, True
    if share >= 1.0:
        return two, True
    if one is None or two is None:
        # Nothing (Transparent BSDF) and a surface: light passes beside it.
        surface, there = (two, share) if one is None else (one, 1.0 - share)
        if surface is None:
            return None, True
        if surface.alpha.texture or surface.transmission > 0.0:
            return surface, False
        surface.alpha = Amount(surface.alpha.value * there)
        return surface, True
    plain = all(is_matt(surface) for surface in (one, two))
    if plain:
        colour = tuple((1.0 - share) * a + share * b for a, b in zip(one.base.value, two.base.value))
        surface = matt(colour)
        surface.emission = tuple((1.0 - share) * a + share * b for a, b in zip(one.emission, two.emission))
        return surface, not (one.emission_texture or two.emission_texture)
    return (two if share > 0.5 else one), False


def is_matt(surface):
    """Whether it is Lambertian, of a plain colour."""
    return (
        surface.specular == 0.0
        and surface.metallic == Amount(0.0)
        and surface.transmission == 0.0
        and surface.alpha == Amount(1.0)
        and surface.coat == 0.0
        and not surface.base.texture
        and surface.base.colours is None
        and not surface.normal
    )


def added(one, two):
    """Two surfaces added, and whether the result is what was asked for: one of them has to emit and reflect nothing."""
    if one is None or two is None:
        # Transparent and something: the light of an emitter goes beside what passes.
        surface = one or two
        if surface is None:
            return None, True
        return surface, False
    for emitter, other in ((one, two), (two, one)):
        if is_matt(emitter) and max(emitter.base.value) == 0.0:
            if other.emission_texture and emitter.emission_texture:
                return other, False
            if (other.emits and emitter.emission_texture) or (emitter.emits and other.emission_texture):
                return other, False
            other.emission = tuple(a + b for a, b in zip(other.emission, emitter.emission))
            other.emission_texture = other.emission_texture or emitter.emission_texture
            return other, True
    return one, False
