//! Scene geometry and ray queries.

use super::contact::{Borders, Contacts};
use super::layered::{Coverage, Site};
use super::material::Material;
use super::misfits::Misfits;
use super::parts::{Geometry, LightNote, Mesh, Node, SceneParts, Surface, Target};
use super::render_space::RenderSpace;
use super::surface::{
    DiffuseHit, HitPoint, SurfaceInteraction, TriangleEdge, TrianglePoint, between, within_reach,
};
use super::texture::MaterialTexture;
use crate::embree::{CommittedScene, RawHit};
use crate::lights::{Light, LightChoice, LightId};
use crate::math::{Ray, Rgb};
use crate::media::{Medium, MediumId, MediumStack};
use crate::sampling::Distribution1D;
use glam::{Vec3, Vec3A};
use std::collections::BTreeSet;
use std::sync::{Mutex, OnceLock};

/// An immutable scene.
#[derive(Debug)]
pub struct Scene {
    pub(super) parts: SceneParts,
    /// Targets that are caustic casters.
    pub(super) casters: Vec<Target>,
    /// Distribution of the lights by flux; `None` where there is no light.
    pub(super) light_power: Option<Distribution1D>,
    pub(super) light_choice: LightChoice,
    /// Lights that a ray can hit when it leaves the scene.
    pub(super) open: Vec<LightId>,
    /// Places where surfaces touch that bound media or emit; `None` where there are none.
    pub(super) contacts: Option<Contacts>,
    /// Media of overlapping bodies, at places where more bodies overlap than can be followed.
    pub(super) overfull: Mutex<BTreeSet<MediumId>>,
    /// Surfaces whose interfaces contradict the medium stacks of rays.
    pub(super) misfits: Misfits,
    /// Whether any material bounds a medium.
    pub(super) has_interfaces: bool,
    /// Whether any medium scatters.
    scatters: bool,
    /// Whether the index of refraction of any medium depends on the wavelength.
    pub(super) disperses: bool,
    /// For each light, the bodies in front of it and behind it; computed at first use.
    pub(super) light_media: OnceLock<Vec<LightMedia>>,
}

/// The bodies that contain a light.
#[derive(Clone, Copy, Debug, Default)]
pub struct LightMedia {
    /// Medium stacks on the side of its normal and on its back.
    pub sides: [MediumStack; 2],
    /// Whether one of its sides lies in more than one medium.
    pub divided: bool,
}

impl Scene {
    /// Builds a scene from these parts.
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
        // A null interface bends no light and casts no caustics.
        let is_null = |target: &Target| {
            let surface = &parts.surfaces[target.surface as usize];
            surface.all_materials().all(|material| is_null_border(&parts, material))
        };
        let is_caster = |target: &&Target| target.density > 0.0 && !is_null(target);
        let casters = parts.targets.iter().filter(is_caster).copied().collect();
        let has_interfaces = parts.materials.iter().any(|(_, material)| material.media().is_some());
        let scatters = parts.media.iter().any(|medium| medium.volume.is_some());
        let disperses = parts.media.iter().any(|medium| medium.dispersion.is_some());
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
            scatters,
            disperses,
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

    /// Materials, each with its name.
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

    /// Whether any medium of the scene scatters or emits light.
    #[inline]
    pub fn scatters(&self) -> bool {
        self.scatters
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

    /// Radiance from outside the scene along the unit `direction` of a ray that hits nothing. Sums over all lights there, each
    /// multiplied by its `weight`, a function of the light's number and of the density per solid angle of its samples.
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

    /// How lights are chosen for shadow rays.
    pub fn light_choice(&self) -> &LightChoice {
        &self.light_choice
    }

    /// Distribution of the lights in proportion to their flux; `None` where nothing emits.
    pub fn light_power(&self) -> Option<&Distribution1D> {
        self.light_power.as_ref()
    }

    /// Transform between world and render space.
    pub fn space(&self) -> &RenderSpace {
        &self.parts.space
    }

    /// Centre and radius of a sphere around all surfaces, render space.
    pub fn bounds(&self) -> (Vec3, f32) {
        self.parts.bounds
    }

    /// Spheres around all surfaces, render space; one for each placement by an instance.
    pub fn targets(&self) -> &[Target] {
        &self.parts.targets
    }

    /// Targets that are caustic casters.
    pub fn casters(&self) -> &[Target] {
        &self.casters
    }

    /// Name of a light in the scene file, and its relative number of photons.
    pub fn light_note(&self, light: usize) -> &LightNote {
        &self.parts.light_notes[light]
    }

    /// Whether point or parallel lights shine on specular surfaces: only photons find that light.
    pub fn has_hidden_caustics(&self) -> bool {
        !self.casters.is_empty() && self.parts.lights.iter().any(Light::is_delta)
    }

    /// The surface that Embree hit, by its index into [`Self::surfaces`].
    #[inline]
    pub fn surface_of(&self, hit: &RawHit) -> u32 {
        match &self.parts.nodes[hit.instance.unwrap_or(hit.geometry) as usize] {
            Node::Surface(index) => *index,
            Node::Instance { first, .. } => first + hit.geometry,
        }
    }

    /// The Embree scene, for benchmarks that trace plain rays.
    pub fn embree(&self) -> &CommittedScene {
        &self.parts.embree
    }

    /// Textures of the materials, in the order of [`Self::materials`].
    pub fn textures(&self) -> &[MaterialTexture] {
        &self.parts.textures
    }

    /// The surface or instance behind each geometry number.
    pub fn nodes(&self) -> &[Node] {
        &self.parts.nodes
    }

    /// The nearest surface along `ray`, whose direction must have unit length.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<SurfaceInteraction> {
        let hit = self.parts.embree.intersect(ray)?;
        Some(self.met(ray, &hit))
    }

    /// Surfaces that touch somewhere, at least one of which bounds media or emits: pairs of indices into [`Self::surfaces`]. A pair may
    /// also be listed if it is only so close that rays search for contacts there.
    pub fn touching(&self) -> &[[u32; 2]] {
        self.contacts.as_ref().map_or(&[], Contacts::pairs)
    }

    /// Distance, render space, beyond which no surfaces of the scene touch.
    pub fn contact_distance(&self) -> f32 {
        self.contacts.as_ref().map_or(0.0, Contacts::distance)
    }

    /// The surface that a ray meets where Embree reported a hit: [`Self::interaction`], or, of several surfaces at the same place, the
    /// one that comes first.
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

    /// Whether any geometry lies on the segment.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.parts.embree.occluded(ray)
    }

    /// Converts Embree's hit into a point with its error bound, and looks up the textures of its material. Considers that surface alone;
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
                // Nearly all hits take this branch.
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

    /// Whether a surface lets rays through where its material is transparent or cut out.
    pub fn has_holes(&self, surface: &Surface) -> bool {
        surface.all_materials().any(|material| {
            let layers = self.texture_of(material).and_then(|texture| texture.layers.as_ref());
            layers.is_some_and(|layers| layers.coverage != Coverage::Whole)
        })
    }

    /// Textures of a material; `None` where it has none.
    fn texture_of(&self, material: u32) -> Option<&MaterialTexture> {
        self.parts.textures.get(material as usize).filter(|texture| !texture.is_plain())
    }

    /// The data that a photon needs of its hit in the most common case: a flat triangle of a Lambert surface, outside of instances, hit
    /// on a reflecting side. `None` in all other cases, which use [`Self::interaction`].
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

    /// [`SurfaceInteraction::retreat`] by the distance `back`, where another surface rises from the triangle's edge next to `point`.
    /// Zero where the surface continues or ends at the edge. A search ray that starts at this distance and leads along the triangle and
    /// out of it must meet a surface whose plane contains the point to within rounding.
    #[cold]
    fn retreat_at(&self, ray: &Ray, point: &HitPoint, corners: [Vec3; 3], back: f32) -> Vec3 {
        /// Length of the search ray, in heights above the triangle: it reaches surfaces that lean back by 80 degrees.
        const AHEAD: f32 = 8.0;
        /// Room for the errors of both surfaces.
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

    /// The offset `back`, which leads to `start`, plus `off` where nothing blocks it from there, as it may at a corner of three
    /// surfaces.
    #[cold]
    fn free_retreat(&self, start: Vec3, back: Vec3, off: Vec3) -> Vec3 {
        if off == Vec3::ZERO || self.occluded(&Ray::segment(start, start + 2.0 * off)) {
            back
        } else {
            back + off
        }
    }

    /// [`Self::interaction`] for procedural objects and instances; and for any surface, without a search for edges, where `looks` is
    /// false.
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

    /// Unit geometric normal of a hit on the side from which the ray arrived.
    #[inline]
    pub(super) fn facing_normal(&self, ray: &Ray, hit: &RawHit) -> Vec3 {
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
}

/// Whether a material is a null interface: it bounds a medium that scatters, towards a medium with the same index of refraction.
fn is_null_border(parts: &SceneParts, material: u32) -> bool {
    let Material::Dielectric { inside, outside, .. } = parts.materials[material as usize].1 else {
        return false;
    };
    let [a, b] = [inside, outside].map(|id| &parts.media[usize::from(id)]);
    a.is_index_matched(b) && (a.volume.is_some() || b.volume.is_some())
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

/// The hit of a triangle without area in `f32`, which Embree reports only through rounding: its first corner, facing the ray.
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
