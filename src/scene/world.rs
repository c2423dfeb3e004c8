//! Surfaces, where they stand, and the queries that find them.

use super::contact::{Borders, Contacts};
use super::illuminated::IlluminatedShape;
use super::layered::Site;
use super::material::Material;
use super::misfits::Misfits;
use super::render_space::RenderSpace;
use super::shading::Shading;
use super::surface::{
    DiffuseHit, HitPoint, Placement, SurfaceInteraction, TriangleEdge, TrianglePoint, between, within_reach,
};
use super::texture::MaterialTexture;
use crate::bsdf::Dielectric;
use crate::embree::{CommittedScene, Procedural, RawHit, TriangleBuffers};
use crate::lights::{Light, LightChoice, LightId};
use crate::math::{Ray, Rgb, unit};
use crate::media::{AIR, Crossing, Medium, MediumId, Surroundings};
use crate::sampling::{Distribution1D, Sobol, warp};
use crate::textures::VertexData;
use glam::{Vec3, Vec3A};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Triangles with what shading needs beyond their corners.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Corners.
    pub buffers: TriangleBuffers,
    /// Unit normals at the vertices, for interpolation; `None` for flat shading.
    pub normals: Option<Arc<Vec<Vec3>>>,
    /// What textures need at the vertices, where the material has some.
    pub data: Option<Arc<VertexData>>,
}

impl Mesh {
    /// Interpolated normal, on the side of `geometric`.
    #[inline]
    fn shading_normal(&self, primitive: u32, uv: [f32; 2], geometric: Vec3) -> Vec3 {
        let Some(normals) = &self.normals else { return geometric };
        let [a, b, c] = self.buffers.triangles()[primitive as usize].map(|v| normals[v as usize]);
        let normal = a * (1.0 - uv[0] - uv[1]) + b * uv[0] + c * uv[1];
        match unit(normal) {
            Some(n) if n.dot(geometric) >= 0.0 => n,
            Some(n) => -n,
            None => geometric,
        }
    }
}

/// What Embree knows about a surface.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// Triangles.
    Mesh(Mesh),
    /// An exact or procedural shape.
    Procedural(Arc<dyn Procedural>),
}

/// A surface: geometry and what it is made of.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Name in the scene file, and where it stands there, for messages.
    pub name: String,
    /// Geometry.
    pub geometry: Geometry,
    /// The normal is the opposite of the geometry's own.
    pub flip_normal: bool,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// The same for each part of an object whose parts differ; empty where they do not.
    pub part_materials: Vec<u32>,
    /// The light that this surface is, if it emits.
    pub light: Option<LightId>,
    /// Where photons are summed up in an illumination map instead of being kept in photon maps.
    pub illumination: Option<Arc<IlluminatedShape>>,
}

impl Surface {
    /// All materials that the surface has somewhere.
    pub fn all_materials(&self) -> impl Iterator<Item = u32> + '_ {
        let own = self.part_materials.is_empty().then_some(self.material);
        own.into_iter().chain(self.part_materials.iter().copied())
    }
}

/// What stands behind a geometry number of the top-level Embree scene.
#[derive(Clone, Debug)]
pub enum Node {
    /// A surface in render space: index into [`Scene::surfaces`].
    Surface(u32),
    /// An instance: its geometry number `g` is surface `first + g`.
    Instance {
        /// Surface of the prototype's geometry 0.
        first: u32,
        /// Where it stands.
        placement: Box<Placement>,
    },
}

/// A sphere around a surface, as projection maps see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Centre.
    pub center: Vec3,
    /// Radius, with room for the rounding of the surface.
    pub radius: f32,
    /// How dense caustic photons are to be in the directions of this surface: its specularity times what the scene file
    /// asks for. Zero for what casts no caustics.
    pub density: f32,
    /// Index into [`Scene::surfaces`].
    pub surface: u32,
    /// Corners of a box around the surface.
    pub bounds: [Vec3; 2],
}

impl Target {
    /// A sphere that casts no caustics, of surface 0, and the box around it.
    pub fn of_sphere(center: Vec3, radius: f32) -> Self {
        Self { center, radius, density: 0.0, surface: 0, bounds: [center - radius, center + radius] }
    }
}

/// What is known of a light beside what it emits.
#[derive(Clone, Debug, PartialEq)]
pub struct LightNote {
    /// Name in the scene file, for messages.
    pub name: String,
    /// Photons in proportion to other lights of the same flux; positive.
    pub photons: f32,
}

/// Everything a scene is made of.
#[derive(Debug)]
pub struct SceneParts {
    /// Name, for messages and metadata.
    pub name: String,
    /// The committed top-level scene.
    pub embree: CommittedScene,
    /// By geometry number of `embree`.
    pub nodes: Vec<Node>,
    /// All surfaces.
    pub surfaces: Vec<Surface>,
    /// Materials and their names.
    pub materials: Vec<(String, Material)>,
    /// Textures by material; may be shorter than the materials, and empty where there are none.
    pub textures: Vec<MaterialTexture>,
    /// Media; the first is air.
    pub media: Vec<Medium>,
    /// Lights.
    pub lights: Vec<Light>,
    /// Map to the world.
    pub space: RenderSpace,
    /// Bounds of all surfaces in render space: centre and radius.
    pub bounds: (Vec3, f32),
    /// Spheres around the surfaces in render space: what photons are aimed at.
    pub targets: Vec<Target>,
    /// By light: name in the scene file, and photons in proportion to others of the same flux.
    pub light_notes: Vec<LightNote>,
    /// Width of a pixel of the picture at distance 1: how fine textures are read. 0 for as fine as they are.
    pub pixel: f32,
}

/// An immutable scene.
#[derive(Debug)]
pub struct Scene {
    parts: SceneParts,
    /// Those of the targets that cast caustics.
    casters: Vec<Target>,
    /// Lights by their flux; `None` where there is no light.
    light_power: Option<Distribution1D>,
    light_choice: LightChoice,
    /// Lights that a ray into the open may meet.
    open: Vec<LightId>,
    /// Where surfaces touch that bound media or emit; `None` where none do.
    contacts: Option<Contacts>,
    /// Media of bodies that overlap at places where there are too many of them to be followed.
    overfull: Mutex<BTreeSet<MediumId>>,
    /// Surfaces whose interfaces contradict where rays are.
    misfits: Misfits,
    /// Whether any material bounds a medium.
    has_interfaces: bool,
    /// By light, the bodies in front of it and behind it; found when first asked for.
    light_media: OnceLock<Vec<LightMedia>>,
}

/// The bodies that a light is in.
#[derive(Clone, Copy, Debug, Default)]
pub struct LightMedia {
    /// On the side of its normal, and on its back.
    pub sides: [Surroundings; 2],
    /// Whether one of its sides is in more than one medium.
    pub divided: bool,
}

impl Scene {
    /// A scene of these parts.
    pub fn new(mut parts: SceneParts) -> Self {
        let contacts = Contacts::find(&parts);
        if let Some(contacts) = &contacts {
            for (number, surface) in parts.surfaces.iter().enumerate() {
                let light = surface.light.filter(|_| contacts.touches(number));
                if let Some(Light::Area(light)) = light.and_then(|id| parts.lights.get_mut(id as usize)) {
                    light.keep_clear(contacts.reach());
                }
            }
        }
        let radius = parts.bounds.1;
        let flux = parts.lights.iter().map(|light| light.flux(radius).max_element());
        let light_power = Distribution1D::new(flux);
        let light_choice = LightChoice::new(&parts.lights, radius);
        let is_open = |id: &LightId| {
            let light = &parts.lights[*id as usize];
            light.is_at_infinity() && !light.is_delta()
        };
        let open = (0..parts.lights.len() as LightId).filter(is_open).collect();
        let casters = parts.targets.iter().filter(|target| target.density > 0.0).copied().collect();
        let has_interfaces = parts.materials.iter().any(|(_, material)| material.media().is_some());
        let (light_media, overfull) = (OnceLock::new(), Mutex::default());
        let misfits = Misfits::of(if has_interfaces { parts.surfaces.len() } else { 0 });
        Self {
            parts,
            casters,
            light_power,
            light_choice,
            open,
            contacts,
            overfull,
            misfits,
            has_interfaces,
            light_media,
        }
    }

    /// Name of the scene.
    pub fn name(&self) -> &str {
        &self.parts.name
    }

    /// All surfaces.
    pub fn surfaces(&self) -> &[Surface] {
        &self.parts.surfaces
    }

    /// Whether any surface has an illumination map.
    pub fn has_illumination_maps(&self) -> bool {
        self.parts.surfaces.iter().any(|surface| surface.illumination.is_some())
    }

    /// A surface.
    #[inline]
    pub fn surface(&self, interaction: &SurfaceInteraction) -> &Surface {
        &self.parts.surfaces[interaction.surface as usize]
    }

    /// Materials and their names.
    pub fn materials(&self) -> &[(String, Material)] {
        &self.parts.materials
    }

    /// Material of a hit.
    #[inline]
    pub fn material(&self, interaction: &SurfaceInteraction) -> &Material {
        &self.parts.materials[interaction.material as usize].1
    }

    /// Media; index 0 is air.
    pub fn media(&self) -> &[Medium] {
        &self.parts.media
    }

    /// A medium.
    #[inline]
    pub fn medium(&self, id: MediumId) -> &Medium {
        &self.parts.media[id as usize]
    }

    /// Lights.
    pub fn lights(&self) -> &[Light] {
        &self.parts.lights
    }

    /// Radiance from outside along the unit `direction`, in which a ray meets nothing: of all lights there, each times the
    /// `weight` of its number, given the density per solid angle with which its samples are drawn.
    #[inline]
    pub fn outside(&self, direction: Vec3, weight: impl Fn(LightId, &dyn Fn() -> f32) -> f32) -> Rgb {
        let mut sum = Rgb::ZERO;
        for &id in &self.open {
            let light = &self.parts.lights[id as usize];
            if let Some(radiance) = light.outside(direction) {
                sum += radiance * weight(id, &|| light.outside_pdf(direction));
            }
        }
        sum
    }

    /// Radiance of emitters alone along a ray of unit direction within `medium`: of the surface that it meets, or from outside.
    pub fn emission_along(&self, ray: &Ray, mut medium: Surroundings) -> Rgb {
        let Some((hit, _)) = self.intersect_within(ray, &mut medium) else {
            return self.outside(ray.direction, |_, _| 1.0);
        };
        let Some(id) = self.surface(&hit).light else { return Rgb::ZERO };
        let Light::Area(area) = &self.parts.lights[id as usize] else { return Rgb::ZERO };
        let emitted = area.emitted(hit.is_front()) * hit.glow;
        let medium = self.medium(medium.medium());
        if medium.is_clear() { emitted } else { emitted * medium.transmittance(hit.distance) }
    }

    /// Which lights get shadow rays.
    pub fn light_choice(&self) -> &LightChoice {
        &self.light_choice
    }

    /// Lights in proportion to their flux; `None` where nothing emits.
    pub fn light_power(&self) -> Option<&Distribution1D> {
        self.light_power.as_ref()
    }

    /// Map to the world.
    pub fn space(&self) -> &RenderSpace {
        &self.parts.space
    }

    /// Centre and radius of a sphere around all surfaces, render space.
    pub fn bounds(&self) -> (Vec3, f32) {
        self.parts.bounds
    }

    /// Spheres around all surfaces, render space; one for each place where an instance puts one.
    pub fn targets(&self) -> &[Target] {
        &self.parts.targets
    }

    /// Those of them that cast caustics.
    pub fn casters(&self) -> &[Target] {
        &self.casters
    }

    /// Name of a light in the scene file, and how many photons it is to get.
    pub fn light_note(&self, light: usize) -> &LightNote {
        &self.parts.light_notes[light]
    }

    /// True where point or parallel lights shine on specular surfaces: light that only photons find.
    pub fn has_hidden_caustics(&self) -> bool {
        !self.casters.is_empty() && self.parts.lights.iter().any(Light::is_delta)
    }

    /// The surface that Embree hit: index into [`Self::surfaces`].
    #[inline]
    pub fn surface_of(&self, hit: &RawHit) -> u32 {
        match &self.parts.nodes[hit.instance.unwrap_or(hit.geometry) as usize] {
            Node::Surface(index) => *index,
            Node::Instance { first, .. } => first + hit.geometry,
        }
    }

    /// The Embree scene, for benchmarks that trace bare rays.
    pub fn embree(&self) -> &CommittedScene {
        &self.parts.embree
    }

    /// What stands behind each geometry number.
    pub fn nodes(&self) -> &[Node] {
        &self.parts.nodes
    }

    /// The nearest surface along `ray`, whose direction must have unit length.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<SurfaceInteraction> {
        let hit = self.parts.embree.intersect(ray)?;
        Some(self.met(ray, &hit))
    }

    /// Surfaces that touch somewhere, at least one of which bounds media or emits: pairs of indices into [`Self::surfaces`]. Two that
    /// come so near that rays look twice may be among them.
    pub fn touching(&self) -> &[[u32; 2]] {
        self.contacts.as_ref().map_or(&[], Contacts::pairs)
    }

    /// Distance, render space, beyond which no surfaces of the scene touch.
    pub fn contact_distance(&self) -> f32 {
        self.contacts.as_ref().map_or(0.0, Contacts::distance)
    }

    /// What a ray meets where Embree hit something: [`Self::interaction`], or of surfaces that lie at the same place the one
    /// that comes first.
    #[inline(always)]
    pub fn met(&self, ray: &Ray, hit: &RawHit) -> SurfaceInteraction {
        let mut found = self.plain_interaction(ray, hit);
        let mut first = *hit;
        if let Some(contacts) = &self.contacts
            && contacts.may_touch(found.surface, found.point.position)
        {
            self.first_of_contact(contacts, &mut found, &mut first);
        }
        if !self.parts.textures.is_empty() {
            self.add_textures(&mut found, &first);
        }
        found
    }

    /// Whether anything lies on the segment.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.parts.embree.occluded(ray)
    }

    /// Turns Embree's hit into a point with its error bound, and looks up the textures of its material. That surface by itself:
    /// [`Self::met`] is what a ray meets.
    #[inline(always)]
    pub fn interaction(&self, ray: &Ray, hit: &RawHit) -> SurfaceInteraction {
        let mut found = self.plain_interaction(ray, hit);
        if !self.parts.textures.is_empty() {
            self.add_textures(&mut found, hit);
        }
        found
    }

    /// [`Self::interaction`] without textures.
    #[inline(always)]
    pub(super) fn plain_interaction(&self, ray: &Ray, hit: &RawHit) -> SurfaceInteraction {
        if let (Node::Surface(index), None) = (&self.parts.nodes[hit.geometry as usize], hit.instance) {
            let surface = &self.parts.surfaces[*index as usize];
            if let Geometry::Mesh(mesh) = &surface.geometry {
                // Nearly every hit there is.
                let corners = mesh.buffers.corners(hit.primitive);
                let (point, retreat) = HitPoint::on_triangle_along(corners, hit.uv, ray, hit.t)
                    .unwrap_or_else(|| (flat_hit(corners, -ray.direction), 0.0));
                let shading_normal = mesh.shading_normal(hit.primitive, hit.uv, point.normal);
                let retreat = if retreat > 0.0 {
                    self.retreat_at(ray, &point, corners.map(Vec3::from_array), retreat)
                } else {
                    Vec3::ZERO
                };
                return found(ray, hit, *index, surface, (point, retreat), shading_normal);
            }
        }
        self.general_interaction(ray, hit, true)
    }

    /// Looks up the textures of the material of a hit.
    #[inline(never)]
    fn add_textures(&self, found: &mut SurfaceInteraction, hit: &RawHit) {
        let Some(texture) = self.texture_of(found.material) else { return };
        texture.apply(found, &self.parts.space, self.parts.pixel);
        let surface = &self.parts.surfaces[found.surface as usize];
        if let (Some(layers), Geometry::Mesh(mesh)) = (&texture.layers, &surface.geometry)
            && let Some(data) = &mesh.data
        {
            let placement = match hit.instance.map(|instance| &self.parts.nodes[instance as usize]) {
                Some(Node::Instance { placement, .. }) => Some(&**placement),
                _ => None,
            };
            let (primitive, uv, flipped) = (hit.primitive, hit.uv, surface.flip_normal);
            let site = Site { mesh, data, placement, primitive, uv, pixel: self.parts.pixel, flipped };
            layers.apply(found, &site);
        }
        found.shading_normal = within_reach(found.shading_normal, found.point.normal);
    }

    /// Textures of a material, if it has any.
    fn texture_of(&self, material: u32) -> Option<&MaterialTexture> {
        self.parts.textures.get(material as usize).filter(|texture| !texture.is_plain())
    }

    /// What a photon needs of its hit where that is as simple as most are: a flat triangle of a Lambert surface,
    /// outside of instances and met on a side that reflects. `None` elsewhere, for [`Self::interaction`].
    #[inline(always)]
    pub fn diffuse_hit(&self, ray: &Ray, hit: &RawHit) -> Option<DiffuseHit> {
        let (Node::Surface(index), None) = (&self.parts.nodes[hit.geometry as usize], hit.instance) else {
            return None;
        };
        let surface = &self.parts.surfaces[*index as usize];
        let Geometry::Mesh(Mesh { buffers, normals: None, .. }) = &surface.geometry else { return None };
        let Material::Lambert { reflectance, two_sided } = self.parts.materials[surface.material as usize].1
        else {
            return None;
        };
        if self.texture_of(surface.material).is_some() {
            return None;
        }
        let point = TrianglePoint::new(buffers.corners(hit.primitive), hit.uv)?.closer(ray, hit.t);
        if let Some(contacts) = &self.contacts
            && contacts.may_touch(*index, point.position.into())
        {
            return None;
        }
        let cosine = -point.normal.dot(Vec3A::from(ray.direction));
        let reflects = two_sided || (cosine > 0.0) != surface.flip_normal;
        let facing = if cosine > 0.0 { point.normal } else { -point.normal };
        let is_plain = reflects
            && cosine != 0.0
            && reflectance.max_element() > 0.0
            && !point.is_at_edge(hit.uv, ray, point.offset());
        is_plain.then_some(DiffuseHit { point, facing, reflectance, surface: *index })
    }

    /// [`SurfaceInteraction::retreat`] with a way `back` where another surface rises from the edge of the triangle that the `point` of
    /// a ray lies next to, and zero where the surface goes on there, or ends: what looks ahead from so far back, along the triangle and
    /// out of it, meets one whose plane has the place in it by rounding.
    #[cold]
    fn retreat_at(&self, ray: &Ray, point: &HitPoint, corners: [Vec3; 3], back: f32) -> Vec3 {
        /// How far ahead, in heights above the triangle: as far as what leans back by 80 degrees.
        const AHEAD: f32 = 8.0;
        /// For the errors of both.
        const ROOM: f32 = 16.0;
        let wo = -ray.direction;
        let Some(edge) = TriangleEdge::nearest(corners, point.uv, point.offset) else { return wo * back };
        let start = point.moved_towards(wo) + wo * back;
        let from_place = start - point.position;
        let height = from_place.dot(point.normal).abs();
        let ahead = AHEAD * height - from_place.dot(edge.out).min(0.0) + ROOM * edge.error;
        let look = Ray { t_max: ahead, ..Ray::new(start, edge.out) };
        let Some(hit) = self.parts.embree.intersect(&look) else { return Vec3::ZERO };
        let met = start + edge.out * hit.t;
        let other = self.facing_normal(&look, &hit);
        if !((met - point.position).dot(other).abs() <= ROOM * edge.error) {
            return Vec3::ZERO;
        }
        let own = if wo.dot(point.normal) < 0.0 { -point.normal } else { point.normal };
        self.free_retreat(start, wo * back, between([own, other], edge.error, edge.most))
    }

    /// `back` to `start`, and `off` from there where nothing is in the way, as at a corner of three surfaces.
    #[cold]
    fn free_retreat(&self, start: Vec3, back: Vec3, off: Vec3) -> Vec3 {
        if off == Vec3::ZERO || self.occluded(&Ray::segment(start, start + 2.0 * off)) {
            back
        } else {
            back + off
        }
    }

    /// [`Self::interaction`] for procedural objects and instances, and any surface where it `looks` at no edges.
    #[inline(never)]
    fn general_interaction(&self, ray: &Ray, hit: &RawHit, looks: bool) -> SurfaceInteraction {
        let (index, placement) = match &self.parts.nodes[hit.instance.unwrap_or(hit.geometry) as usize] {
            Node::Surface(index) => (*index, None),
            Node::Instance { first, placement } => (first + hit.geometry, Some(placement)),
        };
        let surface = &self.parts.surfaces[index as usize];
        let (mut part, mut retreat) = (0, Vec3::ZERO);
        let (mut point, mut shading_normal) = match &surface.geometry {
            Geometry::Mesh(mesh) => {
                let corners = mesh.buffers.corners(hit.primitive);
                let point = HitPoint::on_triangle(corners, hit.uv)
                    .unwrap_or_else(|| flat_hit(corners, -ray.direction));
                if let Some(placement) = placement.filter(|_| looks) {
                    let back = placement.retreat(corners, &point, ray, hit.t);
                    if back > 0.0 {
                        let corner = |p: [f32; 3]| {
                            placement.to_world.transform_point3(Vec3::from_array(p).as_dvec3()).as_vec3()
                        };
                        let world = point.transformed(placement);
                        retreat = self.retreat_at(ray, &world, corners.map(corner), back);
                    }
                }
                (point, mesh.shading_normal(hit.primitive, hit.uv, point.normal))
            }
            Geometry::Procedural(object) => {
                let local = placement.map_or(*ray, |placement| placement.ray_to_object(ray));
                let refined = object.refine(hit.primitive, &local, hit.t);
                part = refined.part;
                let point = HitPoint::on_procedural(&refined);
                if let Some(edge) = refined.edge.as_ref().filter(|_| looks) {
                    let placement = placement.map(|placement| &**placement);
                    let wo = -ray.direction;
                    if let Some((back, off)) = point.retreat_from(edge, placement, (&local, hit.t, wo)) {
                        let place = placement.map_or(point, |placement| point.transformed(placement));
                        retreat = self.free_retreat(place.moved_towards(wo) + back, back, off);
                    }
                }
                (point, refined.shading_normal.as_vec3())
            }
        };
        if let Some(placement) = placement {
            let is_flat = shading_normal == point.normal;
            point = point.transformed(placement);
            shading_normal = if is_flat { point.normal } else { placement.normal_to_world(shading_normal) };
        }
        let mut found = found(ray, hit, index, surface, (point, retreat), shading_normal);
        if let Some(&material) = surface.part_materials.get(part as usize) {
            found.material = material;
        }
        found
    }

    /// How far the surface at `position`, with the unit `normal`, goes on along the unit `tangent`, as seen from that
    /// place: up to where something rises out of it, or where it ends. `None` where it goes on for `radius`.
    ///
    /// One ray that comes down to the surface at the far end tells both in the open, from a height of `lift` in radii
    /// ([`Self::feeler_lift`]). What rises less than that, and surfaces that face like this one within 45 degrees (its own
    /// curvature), are passed over.
    pub fn surface_reach(
        &self,
        (position, normal): (Vec3, Vec3),
        tangent: Vec3,
        radius: f32,
        lift: f32,
    ) -> Option<f32> {
        /// Share of the radius at which the ray meets a plane surface.
        const LANDING: f32 = 0.95;
        let start = position + normal * (lift * radius);
        let direction = tangent * radius - normal * (lift / LANDING * radius);
        match self.intersect_any_direction(&Ray { origin: start, direction, t_max: 1.0 }) {
            Some((t, facing)) if facing.dot(normal) < SAME_SURFACE_COS => Some(t * radius),
            Some(_) => None,
            None => self.surface_end((position, normal), tangent, radius, lift),
        }
    }

    /// Height in radii from which feelers around a place start, where there is nothing within `headroom` above it: a
    /// twentieth, or half of the way up to what is there.
    pub fn feeler_lift(headroom: f32, radius: f32) -> f32 {
        const LIFT: f32 = 0.05;
        if headroom < LIFT * radius { 0.5 * headroom / radius } else { LIFT }
    }

    /// How far one can go from `position` along the unit `normal` of the surface there before something is in the way; infinite where
    /// that is farther than `within`. What is so close that rounding may have put the place beyond it is passed over.
    pub fn headroom(&self, position: Vec3, normal: Vec3, within: f32) -> f32 {
        let up = Ray { t_max: within, ..Ray::new(position + normal * ROUNDED, normal) };
        self.parts.embree.intersect(&up).map_or(f32::INFINITY, |hit| ROUNDED + hit.t)
    }

    /// Whether a free way leads from `start`, a place in the open, to `place` on a surface that faces along the unit `normal`:
    /// a straight segment, which ends as close above the surface as places can be told apart.
    pub fn is_way_free(&self, start: Vec3, place: Vec3, normal: Vec3) -> bool {
        !self.occluded(&Ray::segment(start, off_surface(place, normal)))
    }

    /// Whether a free way leads from a hit to `place` on a surface that faces along the unit `normal` on the side of the hit: back
    /// along the ray that found the hit, which was free, up to where the tangent planes of both places lie well below, and
    /// straight on from there. What is low against the distance of the two is passed over.
    ///
    /// Whatever the shapes, such a way leads through no closed surface.
    pub fn connects(&self, hit: &SurfaceInteraction, place: Vec3, normal: Vec3) -> bool {
        let offset = hit.point.position - place;
        let distance = offset.length();
        let rise = WAY_RISE * distance;
        let (here, there) = (hit.wo.dot(hit.facing_normal()), hit.wo.dot(normal));
        let over_here = rise / here;
        let over_there = if there > 0.0 { (rise - offset.dot(normal)) / there } else { 0.0 };
        let back = over_here.max(over_there).min(0.5 * hit.distance);
        // Not a number where the ray grazes the surface and the places are the same.
        let back = if back > 0.0 { back } else { 0.0 };
        let start = hit.start_towards(hit.wo) + hit.wo * back;
        self.is_way_free(start, place, normal)
    }

    /// Whether a free way leads from `centre`, on a surface that faces along the unit `up` and has this much `headroom`, to `place`
    /// on one that faces along `normal`: up to where the tangent planes of both lie well below, and straight on from there.
    pub fn connects_upwards(
        &self,
        (centre, up): (Vec3, Vec3),
        headroom: f32,
        (place, normal): (Vec3, Vec3),
    ) -> bool {
        let offset = centre - place;
        let rise = WAY_RISE * offset.length();
        let over_there = (rise - offset.dot(normal)) / up.dot(normal).max(f32::MIN_POSITIVE);
        let height = rise.max(over_there).min(0.5 * headroom);
        self.is_way_free(off_surface(centre, up) + up * height, place, normal)
    }

    /// Where a surface ends along `tangent`, by bisection with rays straight down; `None` where it goes on after all,
    /// curving away.
    fn surface_end(
        &self,
        (position, normal): (Vec3, Vec3),
        tangent: Vec3,
        radius: f32,
        lift: f32,
    ) -> Option<f32> {
        const STEPS: u32 = 5;
        let is_supported = |distance: f32| {
            let origin = position + tangent * distance + normal * (lift * radius);
            // A surface that has turned by less than 45 degrees lies no deeper than this.
            let down = Ray { origin, direction: -normal * (lift * radius + distance), t_max: 1.0 };
            self.intersect_any_direction(&down)
                .is_some_and(|(_, facing)| facing.dot(normal) >= SAME_SURFACE_COS)
        };
        if is_supported(radius) {
            return None;
        }
        let (mut low, mut high) = (0.0, radius);
        for _ in 0..STEPS {
            let middle = 0.5 * (low + high);
            if is_supported(middle) { low = middle } else { high = middle }
        }
        Some(0.5 * (low + high))
    }

    /// Parameter and facing normal of the nearest hit of a ray whose direction may have any length.
    fn intersect_any_direction(&self, ray: &Ray) -> Option<(f32, Vec3)> {
        let hit = self.parts.embree.intersect(ray)?;
        Some((hit.t, self.facing_normal(ray, &hit)))
    }

    /// The surface at `position` that faces along the unit `normal`, for places of which no more is known, as those of
    /// photons: what a ray straight down from a little above meets. `None` where that finds none, or one that faces
    /// elsewhere.
    pub fn surface_at(&self, position: Vec3, normal: Vec3) -> Option<SurfaceInteraction> {
        let down = Ray { origin: position + normal * ROUNDED, direction: -normal, t_max: 2.0 * ROUNDED };
        let hit = self.met(&down, &self.parts.embree.intersect(&down)?);
        (hit.facing_normal().dot(normal) >= SAME_SURFACE_COS).then_some(hit)
    }

    /// Unit geometric normal of a hit on the side of the ray.
    #[inline]
    fn facing_normal(&self, ray: &Ray, hit: &RawHit) -> Vec3 {
        if let (Node::Surface(index), None) = (&self.parts.nodes[hit.geometry as usize], hit.instance)
            && let Geometry::Mesh(mesh) = &self.parts.surfaces[*index as usize].geometry
        {
            let [a, b, c] = mesh.buffers.corners(hit.primitive).map(Vec3::from_array);
            if let Some(normal) = (b - a).cross(c - a).try_normalize() {
                return if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
            }
        }
        self.general_interaction(ray, hit, false).facing_normal()
    }

    /// Media on the near and far side of a hit, as its material states them; `None` where the surface bounds no media.
    #[inline]
    fn stated_sides(&self, hit: &SurfaceInteraction) -> Option<[MediumId; 2]> {
        let [inside, outside] = self.material(hit).media()?;
        Some(if hit.is_front() { [outside, inside] } else { [inside, outside] })
    }

    /// Media that are on the near and far side of a hit for a ray within `current`; `None` where the surface bounds no media.
    #[inline]
    fn sides(&self, current: &Surroundings, hit: &SurfaceInteraction) -> Option<[MediumId; 2]> {
        let [near, far] = self.stated_sides(hit)?;
        if hit.borders.is_empty() {
            return Some(current.sides(near, far, &self.parts.media));
        }
        let crossing = self.crossing(*current, hit)?;
        Some([crossing.before.medium(), crossing.after.medium()])
    }

    /// What a ray within `current` crosses at a hit; `None` where the surface bounds no media.
    fn crossing(&self, current: Surroundings, hit: &SurfaceInteraction) -> Option<Crossing> {
        let [near, far] = self.stated_sides(hit)?;
        let crossing = if hit.borders.is_empty() {
            current.crossing(near, far, &self.parts.media)
        } else {
            hit.borders.crossing(current, &self.parts.media)?
        };
        if crossing.is_full {
            self.note_overfull(&crossing, far);
        }
        Some(crossing)
    }

    #[cold]
    fn note_overfull(&self, crossing: &Crossing, entered: MediumId) {
        // What is in there is whole whatever a thread that had it did.
        let mut overfull = self.overfull.lock().unwrap_or_else(PoisonError::into_inner);
        overfull.extend(crossing.before.media().chain(Some(entered).filter(|&id| id != AIR)));
    }

    /// Names of the media of bodies that rays found overlapping at one place, where those were more than
    /// [`crate::media::MOST_MEDIA`] and could not all be followed. Empty where that did not happen.
    pub fn overfull(&self) -> Vec<&str> {
        let overfull = self.overfull.lock().unwrap_or_else(PoisonError::into_inner);
        overfull.iter().map(|&id| self.medium(id).name.as_str()).collect()
    }

    /// [`Self::crossing`] for what passes the place of a hit whatever is there: also borders that an opaque surface covers.
    #[inline]
    fn crossing_behind(&self, current: Surroundings, hit: &SurfaceInteraction) -> Option<Crossing> {
        if hit.borders.is_empty() {
            return self.crossing(current, hit);
        }
        hit.borders.crossing(current, &self.parts.media)
    }

    /// [`Self::intersect`] for a ray within `current`, which passes the borders of bodies that are not there because another
    /// one fills the place. `current` is then where the ray arrives; the distance is that of the whole way. And whether
    /// there were such borders.
    #[inline]
    pub fn intersect_within(
        &self,
        ray: &Ray,
        current: &mut Surroundings,
    ) -> Option<(SurfaceInteraction, bool)> {
        let hit = self.intersect(ray)?;
        match self.hidden(*current, &hit) {
            None => Some((hit, false)),
            Some(after) => self.intersect_behind(ray, hit, after, current),
        }
    }

    /// Where a ray is behind a border that is not there; `None` for all other surfaces.
    #[inline]
    pub fn hidden(&self, current: Surroundings, hit: &SurfaceInteraction) -> Option<Surroundings> {
        let [near, far] = self.sides(&current, hit)?;
        if near != far {
            return None;
        }
        self.crossing(current, hit).map(|crossing| crossing.after)
    }

    #[cold]
    fn intersect_behind(
        &self,
        ray: &Ray,
        mut hit: SurfaceInteraction,
        after: Surroundings,
        current: &mut Surroundings,
    ) -> Option<(SurfaceInteraction, bool)> {
        // More than that is a ray that does not get on.
        const BORDERS: u32 = 1000;
        *current = after;
        for _ in 0..BORDERS {
            let passed = hit.distance;
            hit = self.intersect(&hit.spawn(ray.direction))?;
            hit.distance += passed;
            match self.hidden(*current, &hit) {
                None => return Some((hit, true)),
                Some(after) => *current = after,
            }
        }
        None
    }

    /// BSDF and frame at a hit of a ray within `current`: where bodies overlap, an interface is one between what is really on
    /// both of its sides.
    #[inline]
    pub fn shading_within(&self, hit: &SurfaceInteraction, current: Surroundings) -> Shading {
        let material = self.material(hit);
        let Some(stated) = material.media() else { return hit.shading(material) };
        let Some([near, far]) = self.sides(&current, hit) else { return hit.shading(material) };
        let [inside, outside] = if hit.is_front() { [far, near] } else { [near, far] };
        if [inside, outside] == stated {
            return hit.shading(material);
        }
        let ior = |id| f64::from(self.medium(id).ior);
        hit.shading_between(material, Some(Dielectric::new(ior(outside), ior(inside))))
    }

    /// Where a ray is after scattering from within `current` into `direction`; `None` where by rounding the direction is
    /// on the other side of the surface than it was drawn for.
    #[inline]
    pub fn medium_after(
        &self,
        current: Surroundings,
        hit: &SurfaceInteraction,
        shading: &Shading,
        direction: Vec3,
        transmission: bool,
    ) -> Option<Surroundings> {
        let passes = direction.dot(shading.geometric) * hit.wo.dot(shading.geometric) < 0.0;
        if passes != transmission {
            return None;
        }
        if !transmission {
            return Some(current);
        }
        Some(self.crossing_behind(current, hit).map_or(current, |crossing| crossing.after))
    }

    /// Where a ray is that meets the border of a body from inside without having entered it, as the border says; `None` where
    /// it is within `current` by all that the hit tells. The scene's interfaces contradict each other then.
    #[inline]
    pub fn mismatch(&self, hit: &SurfaceInteraction, current: Surroundings) -> Option<Surroundings> {
        if hit.borders.is_empty() && current.is_within(self.stated_sides(hit)?[0]) && !current.is_full() {
            return None;
        }
        let crossing = self.crossing(current, hit).filter(|crossing| !crossing.fits)?;
        self.misfits.note(hit.surface);
        Some(crossing.before)
    }

    /// Names of the surfaces at which [`Self::mismatch`] found most of what contradicts, the worst first.
    pub fn mismatched(&self) -> Vec<&str> {
        let names = self.misfits.worst().into_iter().map(|id| self.parts.surfaces[id as usize].name.as_str());
        let mut seen = BTreeSet::new();
        names.filter(|name| seen.insert(*name)).collect()
    }

    /// The bodies around `point`, by asking rays in many directions which they leave: the majority decides. None where no ray
    /// meets an interface.
    pub fn medium_at(&self, point: Vec3) -> Surroundings {
        self.medium_around(&[(point, Vec3::ZERO)]).0
    }

    /// The bodies that each light is in.
    pub fn light_media(&self) -> &[LightMedia] {
        self.light_media.get_or_init(|| {
            let of_light = |light: &Light| {
                let (front, front_divided) = self.medium_around(&light.points(false));
                let two_sided = matches!(light, Light::Area(area) if area.is_two_sided());
                let (back, back_divided) =
                    if two_sided { self.medium_around(&light.points(true)) } else { (front, false) };
                LightMedia { sides: [front, back], divided: front_divided || back_divided }
            };
            self.parts.lights.par_iter().map(of_light).collect()
        })
    }

    /// [`Self::medium_at`] by the votes of all `points`, each by rays on the side of its normal where that is not zero; and
    /// whether more than a quarter of the votes that were cast are for others.
    pub fn medium_around(&self, points: &[(Vec3, Vec3)]) -> (Surroundings, bool) {
        const RAYS: u32 = 32;
        if !self.has_interfaces {
            return (Surroundings::AIR, false);
        }
        let sequence = Sobol::new(0x006d_6564_6975_6d00);
        let mut votes: Vec<(Surroundings, u32)> = Vec::new();
        for &(point, normal) in points {
            for index in 0..RAYS {
                let direction = warp::square_to_sphere(sequence.sample_2d(0, index));
                let below = direction.dot(normal).min(0.0);
                let direction = direction - normal * (2.0 * below);
                let Some(found) = self.left_along(Ray::new(point, direction)) else { continue };
                match votes.iter_mut().find(|(known, _)| *known == found) {
                    Some((_, count)) => *count += 1,
                    None => votes.push((found, 1)),
                }
            }
        }
        let all: u32 = votes.iter().map(|(_, count)| count).sum();
        // Of equals the first, which is that of the first ray.
        let best = votes.iter().rev().max_by_key(|(_, count)| count);
        best.map_or((Surroundings::AIR, false), |&(found, count)| (found, 4 * (all - count) > all))
    }

    /// The bodies that a ray leaves without having entered them; `None` where it meets no interface. Opaque surfaces do not
    /// bound media and are passed.
    fn left_along(&self, mut ray: Ray) -> Option<Surroundings> {
        // A ray that crosses more surfaces than this says nothing; the others decide.
        const CROSSINGS: u32 = 1000;
        let (mut start, mut at, mut found) = (Surroundings::AIR, Surroundings::AIR, false);
        for _ in 0..CROSSINGS {
            let Some(hit) = self.intersect(&ray) else { return found.then_some(start) };
            let [near, far] =
                [hit.is_front(), !hit.is_front()].map(|front| self.material(&hit).medium_on(front));
            let alone = near.zip(far).filter(|_| hit.borders.is_empty());
            for (near, far) in alone.into_iter().chain(hit.borders.each()) {
                let crossing = at.crossing(near, far, &self.parts.media);
                found = true;
                // A border that names both media says what fills the place, which is a contradiction within another body.
                if !crossing.fits && crossing.before != at && (far == AIR || at == Surroundings::AIR) {
                    start = start.crossing(AIR, near, &self.parts.media).after;
                }
                at = crossing.after;
            }
            ray = hit.spawn(ray.direction);
        }
        None
    }
}

#[inline(always)]
fn found(
    ray: &Ray,
    hit: &RawHit,
    index: u32,
    surface: &Surface,
    (mut point, retreat): (HitPoint, Vec3),
    mut shading_normal: Vec3,
) -> SurfaceInteraction {
    if surface.flip_normal {
        point.normal = -point.normal;
        shading_normal = -shading_normal;
    }
    SurfaceInteraction {
        point,
        shading_normal: within_reach(shading_normal, point.normal),
        wo: -ray.direction,
        distance: hit.t,
        surface: index,
        primitive: hit.primitive,
        material: surface.material,
        tint: Rgb::ONE,
        glow: Rgb::ONE,
        painted: None,
        borders: Borders::default(),
        retreat,
    }
}

/// How far from where it was found a surface may lie by rounding, render space, where no coordinate is much beyond one: what
/// single precision resolves there, 64 times over.
const ROUNDED: f32 = 64.0 * f32::EPSILON;

/// A place just above a surface of which position and unit normal are known: by what rounding may do to the position, and to where
/// a ray meets a triangle as large as the scene.
fn off_surface(position: Vec3, normal: Vec3) -> Vec3 {
    position + normal * (f32::EPSILON * (2.0 + 8.0 * position.abs().max_element()))
}

/// Height over the distance of two places that a way between them has above their surfaces: 11 degrees. What is lower is passed
/// over, as an obstacle that is small against the distance.
const WAY_RISE: f32 = 0.2;

/// Surfaces whose normals are this close count as one: 45 degrees, as for photons.
const SAME_SURFACE_COS: f32 = std::f32::consts::FRAC_1_SQRT_2;

/// The hit of a triangle that has no area in `f32`, which Embree reports only through rounding: its first corner,
/// facing the ray.
#[cold]
fn flat_hit(corners: [[f32; 3]; 3], normal: Vec3) -> HitPoint {
    let [a, b, c] = corners.map(Vec3::from_array);
    let extent = (b - a).abs().max((c - a).abs());
    HitPoint {
        position: a,
        normal,
        offset: extent.max_element() + 4.0 * f32::EPSILON * a.abs().max_element(),
        uv: glam::Vec2::ZERO,
    }
}
