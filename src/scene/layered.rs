//! Layered materials, whose parameters come from images and from the vertices of meshes and are evaluated at each hit.

use super::parts::Mesh;
use super::surface::{Placement, SurfaceInteraction};
use crate::bsdf::{Body, Layered, LayeredParameters};
use crate::camera::PixelSpread;
use crate::embree::{Cutout, TriangleBuffers};
use crate::math::{Rgb, unit};
use crate::textures::{Glow, TextureSlot, VertexData};
use glam::{Vec2, Vec3, Vec4};
use std::sync::Arc;

/// How alpha determines whether the surface is present.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Coverage {
    /// The surface is present everywhere.
    #[default]
    Whole,
    /// The surface is present where alpha is at least this value.
    Mask(f32),
    /// Alpha is the share of rays that hit the surface.
    Blend,
}

/// A glTF material: factors, and textures that multiply them.
#[derive(Clone, Debug, PartialEq)]
pub struct LayeredMaterial {
    /// The factors. Their roughnesses are not used; [`Self::roughness`] and [`Self::coat_roughness`] replace them.
    pub factors: LayeredParameters,
    /// Alpha of the base colour.
    pub alpha: f32,
    /// How alpha is interpreted.
    pub coverage: Coverage,
    /// `roughnessFactor`, the square root of the slope of the microfacets.
    pub roughness: f32,
    /// `clearcoatRoughnessFactor`.
    pub coat_roughness: f32,
    /// `anisotropyStrength` and `anisotropyRotation`, radians.
    pub anisotropy: [f32; 2],
    /// Factors on the slopes of the normals of base and coat.
    pub normal_scales: [f32; 2],
    /// Whether vertex colours multiply the base colour.
    pub coloured: bool,
    /// Base colour and alpha.
    pub base: Option<TextureSlot>,
    /// Roughness in green, metallic in blue.
    pub metallic_roughness: Option<TextureSlot>,
    /// Normals of the base.
    pub normal: Option<TextureSlot>,
    /// Transmission, in red.
    pub transmission: Option<TextureSlot>,
    /// Specular, in alpha.
    pub specular: Option<TextureSlot>,
    /// Colour of specular reflection.
    pub specular_colour: Option<TextureSlot>,
    /// Direction in red and green, strength in blue.
    pub anisotropy_map: Option<TextureSlot>,
    /// Coat, in red.
    pub coat: Option<TextureSlot>,
    /// Roughness of the coat, in green.
    pub coat_roughness_map: Option<TextureSlot>,
    /// Normals of the coat.
    pub coat_normal: Option<TextureSlot>,
    /// Texture that multiplies the emission.
    pub emission: Option<TextureSlot>,
    /// The material shows its base colour independently of the light: it emits the colour and reflects nothing.
    pub unlit: bool,
}

impl Default for LayeredMaterial {
    /// The default material of glTF: rough white metal.
    fn default() -> Self {
        Self {
            factors: LayeredParameters::default(),
            alpha: 1.0,
            coverage: Coverage::Whole,
            roughness: 1.0,
            coat_roughness: 0.0,
            anisotropy: [0.0; 2],
            normal_scales: [1.0; 2],
            coloured: false,
            base: None,
            metallic_roughness: None,
            normal: None,
            transmission: None,
            specular: None,
            specular_colour: None,
            anisotropy_map: None,
            coat: None,
            coat_roughness_map: None,
            coat_normal: None,
            emission: None,
            unlit: false,
        }
    }
}

/// A layered material evaluated at a hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Painted {
    /// The BSDF model; the normal of its coat is set together with the frame.
    pub bsdf: Layered,
    /// Tangent along the surface, not of unit length; zero where nothing depends on it.
    pub tangent: Vec3,
    /// Unit normal of the coat, on the side of the surface's own normal; `None` where the coat follows the base.
    pub coat_normal: Option<Vec3>,
}

/// The point of a hit on its mesh.
pub(super) struct Site<'a> {
    pub mesh: &'a Mesh,
    pub data: &'a VertexData,
    pub placement: Option<&'a Placement>,
    pub primitive: u32,
    /// Barycentric coordinates of the second and third corner.
    pub uv: [f32; 2],
    /// Width of a pixel.
    pub pixel: PixelSpread,
    /// Whether the surface's normal is opposite to the mesh's.
    pub flipped: bool,
}

impl Site<'_> {
    fn triangle(&self) -> [u32; 3] {
        self.mesh.buffers.triangles()[self.primitive as usize]
    }

    /// Edges in render space, from the first corner.
    fn edges(&self) -> [Vec3; 2] {
        let [a, b, c] = self.mesh.buffers.corners(self.primitive).map(Vec3::from_array);
        [b - a, c - a].map(|edge| self.to_world(edge))
    }

    fn to_world(&self, v: Vec3) -> Vec3 {
        self.placement.map_or(v, |placement| placement.to_world.transform_vector3(v.as_dvec3()).as_vec3())
    }
}

/// Footprint of a pixel in texture space: the share of an image that a pixel covers (1 for the whole image), for the coordinate set that
/// a slot reads.
struct Footprint {
    /// Area that a pixel covers over the area of the triangle's parallelogram.
    share: f32,
    corners: [[Vec2; 2]; 3],
    sets: [Vec2; 2],
}

impl Footprint {
    fn of(site: &Site<'_>, distance: f32) -> Self {
        let triangle = site.triangle();
        let (corners, sets) = (site.data.corner_sets(triangle), site.data.sets(triangle, site.uv));
        let [u, v] = site.edges();
        let area = u.cross(v).length();
        let width = site.pixel.at(distance);
        let share = width * width / area;
        Self { share: if share.is_finite() { share } else { 0.0 }, corners, sets }
    }

    fn look_up(&self, slot: &TextureSlot) -> Vec4 {
        let [a, b, c] = self.corners.map(|sets| slot.coordinates(sets));
        slot.at(self.sets, self.share * (b - a).perp_dot(c - a).abs())
    }

    fn or_one(&self, slot: &Option<TextureSlot>) -> Vec4 {
        slot.as_ref().map_or(Vec4::ONE, |slot| self.look_up(slot))
    }
}

/// Slopes of the microfacets along the tangent and across it, from a roughness and a strength of anisotropy (KHR_materials_anisotropy).
fn slopes(roughness: f32, strength: f32) -> [f32; 2] {
    let across = roughness * roughness;
    [across + (1.0 - across) * strength * strength, across]
}

impl LayeredMaterial {
    /// All textures that the material has.
    pub fn slots(&self) -> impl Iterator<Item = &TextureSlot> {
        self.named_slots().map(|(_, slot)| slot)
    }

    /// The same with the names of the parameters that they give.
    pub fn named_slots(&self) -> impl Iterator<Item = (&'static str, &TextureSlot)> {
        let slots = [
            ("colour", &self.base),
            ("metallic and roughness", &self.metallic_roughness),
            ("normal", &self.normal),
            ("transmission", &self.transmission),
            ("specular", &self.specular),
            ("specular colour", &self.specular_colour),
            ("anisotropy", &self.anisotropy_map),
            ("coat", &self.coat),
            ("roughness of the coat", &self.coat_roughness_map),
            ("normal of the coat", &self.coat_normal),
            ("emission", &self.emission),
        ];
        slots.into_iter().filter_map(|(name, slot)| Some((name, slot.as_ref()?)))
    }

    /// Whether the material is the same everywhere, so that no texture or vertex data is looked up at hits.
    pub fn is_even(&self) -> bool {
        self.slots().next().is_none() && !self.coloured && self.anisotropy[0] == 0.0
    }

    /// A model that represents the material in the decisions about what is built for a scene: it has every part that the material has
    /// anywhere, with the smallest roughness.
    pub fn representative(&self) -> Layered {
        if self.unlit {
            return Layered::new(&LayeredParameters {
                base: Rgb::ZERO,
                specular: 0.0,
                metallic: 0.0,
                ..self.factors
            });
        }
        let mean = |slot: &Option<TextureSlot>| slot.as_ref().map_or(Vec4::ONE, |slot| slot.texture.mean());
        let least = |slot: &Option<TextureSlot>| slot.as_ref().map_or(Vec4::ONE, |slot| slot.texture.least());
        let roughness = self.roughness * least(&self.metallic_roughness).y;
        let coat_roughness = self.coat_roughness * least(&self.coat_roughness_map).y;
        let strength = self.anisotropy[0] * mean(&self.anisotropy_map).z;
        Layered::new(&LayeredParameters {
            base: self.factors.base * mean(&self.base).truncate(),
            metallic: self.factors.metallic * mean(&self.metallic_roughness).z,
            roughness: slopes(roughness, strength),
            transmission: self.factors.transmission * mean(&self.transmission).x,
            specular: self.factors.specular * mean(&self.specular).w,
            specular_colour: self.factors.specular_colour * mean(&self.specular_colour).truncate(),
            coat: self.factors.coat * mean(&self.coat).x,
            coat_roughness: coat_roughness * coat_roughness,
            ..self.factors
        })
    }

    /// Evaluates the material at a hit.
    pub(super) fn apply(&self, hit: &mut SurfaceInteraction, site: &Site<'_>) {
        let triangle = site.triangle();
        let look = Footprint::of(site, hit.distance);
        let colour = if self.coloured { site.data.colour(triangle, site.uv) } else { Vec4::ONE };
        let base = (look.or_one(&self.base) * colour).truncate();
        if self.unlit {
            hit.glow = base.clamp(Rgb::ZERO, Rgb::ONE);
            return;
        }
        hit.glow = look.or_one(&self.emission).truncate();
        let metallic_roughness = look.or_one(&self.metallic_roughness);
        let mut strength = self.anisotropy[0];
        let (mut turn, mut tangent, mut coat_normal) = (Vec2::X, Vec3::ZERO, None);
        if let Some(map) = self.anisotropy_map.as_ref().filter(|_| strength > 0.0) {
            let value = look.look_up(map);
            strength *= value.z;
            turn = (Vec2::new(value.x, value.y) * 2.0 - 1.0).normalize_or(Vec2::X);
        }
        let smooth_normal = hit.shading_normal;
        if let Some(slot) = self.normal.as_ref() {
            let texel = look.look_up(slot);
            if let Some(normal) = perturbed(site, hit, smooth_normal, slot, texel, self.normal_scales[0]) {
                hit.shading_normal = normal;
            }
        }
        if self.factors.coat > 0.0 {
            let slot = self.coat_normal.as_ref();
            let normal = slot.and_then(|slot| {
                perturbed(site, hit, smooth_normal, slot, look.look_up(slot), self.normal_scales[1])
            });
            let normal = normal.unwrap_or(smooth_normal);
            coat_normal = (normal != hit.shading_normal).then_some(normal);
        }
        if strength > 0.0 {
            let (along, across) = tangents(site, hit, smooth_normal, None);
            let turn = Vec2::from_angle(self.anisotropy[1]).rotate(turn);
            tangent = along * turn.x + across * turn.y;
        }
        let roughness = self.roughness * metallic_roughness.y;
        let coat_roughness = self.coat_roughness * look.or_one(&self.coat_roughness_map).y;
        let bsdf = Layered::new(&LayeredParameters {
            base: self.factors.base * base,
            metallic: self.factors.metallic * metallic_roughness.z,
            roughness: slopes(roughness, strength),
            transmission: self.factors.transmission * look.or_one(&self.transmission).x,
            specular: self.factors.specular * look.or_one(&self.specular).w,
            specular_colour: self.factors.specular_colour * look.or_one(&self.specular_colour).truncate(),
            coat: self.factors.coat * look.or_one(&self.coat).x,
            coat_roughness: coat_roughness * coat_roughness,
            ..self.factors
        });
        hit.painted = Some(Painted { bsdf, tangent, coat_normal });
    }

    /// Whether the material describes an interface between media.
    pub fn is_interface(&self) -> bool {
        matches!(self.factors.body, Body::Interface(_))
    }

    /// Whether rays can pass through the material, everywhere or in places.
    pub fn has_holes(&self) -> bool {
        match self.coverage {
            Coverage::Whole => false,
            Coverage::Mask(cutoff) => {
                cutoff > 0.0 && (self.alpha < cutoff || self.base.is_some() || self.coloured)
            }
            Coverage::Blend => self.alpha < 1.0 || self.base.is_some() || self.coloured,
        }
    }
}

/// Unit tangent and bitangent in the surface, orthogonal to the unit `normal` (on the surface's own side). They come from the file, or
/// else follow the coordinates that `slot` reads (or the first set). The bitangent points to the top of the image.
fn tangents(
    site: &Site<'_>,
    hit: &SurfaceInteraction,
    normal: Vec3,
    slot: Option<&TextureSlot>,
) -> (Vec3, Vec3) {
    let triangle = site.triangle();
    let within = |v: Vec3| unit(v - normal * normal.dot(v));
    // The image stays the same on a surface that is turned inside out, because the normal of the mesh decides.
    let own = if site.flipped { -normal } else { normal };
    if let Some((tangent, sign)) = site.data.tangent(triangle, site.uv)
        && let Some(tangent) = within(site.to_world(tangent))
    {
        return (tangent, own.cross(tangent) * sign);
    }
    let [a, b, c] = site.data.corner_sets(triangle).map(|sets| match slot {
        Some(slot) => slot.coordinates(sets),
        None => sets[0],
    });
    let ([e1, e2], (d1, d2)) = (site.edges(), (b - a, c - a));
    let determinant = d1.perp_dot(d2);
    let along_u = (e1 * d2.y - e2 * d1.y) * determinant;
    let along_v = (e2 * d1.x - e1 * d2.x) * determinant;
    match unit(along_u).and_then(within) {
        Some(tangent) => {
            let bitangent = own.cross(tangent);
            // v increases downwards in the image.
            (tangent, if bitangent.dot(along_v) > 0.0 { -bitangent } else { bitangent })
        }
        None => {
            let frame = crate::math::Frame::from_z(hit.point.normal);
            let tangent = within(frame.x).or_else(|| within(frame.y)).unwrap_or(Vec3::X);
            (tangent, own.cross(tangent))
        }
    }
}

/// The normal that a texel of a normal map encodes; `None` where it is no direction or lies below the surface.
fn perturbed(
    site: &Site<'_>,
    hit: &SurfaceInteraction,
    normal: Vec3,
    slot: &TextureSlot,
    texel: Vec4,
    scale: f32,
) -> Option<Vec3> {
    let local = texel.truncate() * 2.0 - 1.0;
    let (x, y) = (local.x * scale, local.y * scale);
    let (tangent, bitangent) = tangents(site, hit, normal, Some(slot));
    unit(tangent * x + bitangent * y + normal * local.z).filter(|n| n.dot(hit.point.normal) > 0.0)
}

/// Alpha test for a mesh whose material has holes.
#[derive(Debug)]
pub struct AlphaCutout {
    material: Arc<LayeredMaterial>,
    data: Arc<VertexData>,
    buffers: TriangleBuffers,
}

impl AlphaCutout {
    /// The alpha test for a mesh with these buffers and vertices.
    pub fn new(material: Arc<LayeredMaterial>, data: Arc<VertexData>, buffers: TriangleBuffers) -> Self {
        Self { material, data, buffers }
    }
}

impl Cutout for AlphaCutout {
    fn coverage(&self, primitive: u32, uv: [f32; 2]) -> f32 {
        let Some(&triangle) = self.buffers.triangles().get(primitive as usize) else { return 1.0 };
        let material = &self.material;
        let mut alpha = material.alpha;
        if let Some(slot) = &material.base {
            alpha *= slot.at(self.data.sets(triangle, uv), 0.0).w;
        }
        if material.coloured {
            alpha *= self.data.colour(triangle, uv).w;
        }
        match material.coverage {
            Coverage::Whole => 1.0,
            Coverage::Mask(cutoff) => f32::from(u8::from(alpha >= cutoff)),
            Coverage::Blend => alpha,
        }
    }
}

/// Emission texture of a material on a mesh; `None` where nothing modulates the emission.
pub fn glow_of(material: &LayeredMaterial, data: &Arc<VertexData>) -> Option<Glow> {
    let (slot, coloured) =
        if material.unlit { (&material.base, material.coloured) } else { (&material.emission, false) };
    let varies = slot.is_some() || coloured && !data.colours.is_empty();
    varies.then(|| Glow { slot: slot.clone(), coloured, data: Arc::clone(data) })
}
