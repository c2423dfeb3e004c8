//! Area lights: surfaces that emit.

use super::tree::{LightBounds, LightTree};
use super::{LightSample, Receiver};
use crate::math::rounding::UNIT_ROUNDOFF;
use crate::math::{Rgb, unit_f64};
use crate::sampling::{Distribution1D, ONE_MINUS_EPSILON, refined};
use crate::shapes::{EmitterShape, Patch, Sphere};
use crate::textures::Glow;
use glam::{DVec3, Vec2, Vec3};
use std::sync::Arc;

/// A surface whose emitting side has the same radiance in all directions. The radiance is also the same at all points, or given by a
/// texture.
#[derive(Clone, Debug)]
pub struct AreaLight {
    /// A single exact shape, or the triangles of a mesh by primitive number.
    pieces: Vec<EmitterShape>,
    /// Distribution of the pieces in proportion to their area (or emission, see [`Self::with_glow`]).
    choice: Distribution1D,
    /// Light tree over the pieces, where there are many. Its power is area.
    tree: Option<LightTree>,
    radiance: Rgb,
    two_sided: bool,
    /// Whether the light emits on the side opposite to the shape's own normal.
    flip_normal: bool,
    /// One over the density of emission points per area (and side), which is the same on all pieces.
    area_over_pdf: f32,
    /// Radius of the largest piece, which scales rounding errors near it.
    extent: f32,
    /// Distance from the surface at which photons start and shadow rays end, where it exceeds the surface's own rounding: it must be
    /// beyond surfaces in contact with the light.
    clearance: f32,
    /// Area of all pieces on one side.
    area: f64,
    /// Factor on the radiance where it varies, with the corners of each piece.
    glow: Option<(Arc<Glow>, Vec<[u32; 3]>)>,
    /// Mean factor over the surface; one without a glow.
    mean: DVec3,
}

/// Starting point of a photon on an area light.
#[derive(Clone, Copy, Debug)]
pub struct EmissionStart {
    /// Position on the surface.
    pub position: Vec3,
    /// Unit normal on the emitting side.
    pub normal: Vec3,
    /// One over the density of the starting point per area (and side).
    pub area_over_pdf: f32,
    /// Whether the photon leaves on the side opposite to the light's normal.
    pub back: bool,
    /// Factor on the light's radiance here.
    pub glow: Rgb,
    offset: f32,
}

impl EmissionStart {
    /// The position, moved off the surface to the side of `direction`.
    pub fn off_surface(&self, direction: Vec3) -> Vec3 {
        self.position + self.normal * self.offset.copysign(direction.dot(self.normal))
    }

    /// End point of a shadow ray from `from`, chosen such that the ray does not hit the light itself.
    ///
    /// A ray has errors at its end that grow with its length, however small the light is: its direction is a rounded difference, and
    /// Embree subtracts the ray's origin from the corners. Along the normal these errors are 12 roundoffs of the length, to first order:
    /// 1 for the direction, 1 for the corners, 2 for the plane through them, 3 for each of the two products whose quotient is the ray's
    /// parameter, and 2 for that quotient. The bound is rounded up for the terms of second order.
    fn end_of_ray(&self, from: Vec3) -> Vec3 {
        /// Number of roundoffs of the length.
        const OF_WAY: f32 = 16.0;
        let way = from - self.position;
        let offset = self.offset + OF_WAY * UNIT_ROUNDOFF * self.normal.abs().dot(way.abs());
        self.position + self.normal * offset.copysign(way.dot(self.normal))
    }
}

/// Up to this number, pieces are chosen by area alone.
const FEW_PIECES: usize = 8;

impl AreaLight {
    /// Description of the shape in words.
    pub fn shape(&self) -> String {
        match self.pieces.as_slice() {
            [EmitterShape::Sphere(_)] => "sphere".to_owned(),
            [EmitterShape::Cylinder(_)] => "cylinder".to_owned(),
            [EmitterShape::Disc(_)] => "disc".to_owned(),
            [EmitterShape::Quad(_)] => "quad".to_owned(),
            [EmitterShape::Triangle(_)] => "mesh of one triangle".to_owned(),
            pieces => format!("mesh of {} triangles", pieces.len()),
        }
    }

    /// A light with these pieces: one for an exact shape, one for each triangle of a mesh. `None` where there are no pieces.
    pub fn new(pieces: Vec<EmitterShape>, radiance: Rgb, two_sided: bool, flip_normal: bool) -> Option<Self> {
        let choice = Distribution1D::new(pieces.iter().map(EmitterShape::area))?;
        let extent = pieces.iter().map(|piece| piece.bounds().radius()).fold(0.0, f64::max) as f32;
        let sides = if two_sided { 2.0 } else { 1.0 };
        let area_over_pdf = (sides * choice.total()) as f32;
        let area = choice.total();
        let many = pieces.len() > FEW_PIECES;
        let bounds = |piece: &EmitterShape| piece_bounds(piece, two_sided, flip_normal);
        let tree = if many { LightTree::new(&pieces.iter().map(bounds).collect::<Vec<_>>()) } else { None };
        let (glow, mean) = (None, DVec3::ONE);
        Some(Self {
            pieces,
            choice,
            tree,
            radiance,
            two_sided,
            flip_normal,
            area_over_pdf,
            extent,
            clearance: 0.0,
            area,
            glow,
            mean,
        })
    }

    /// Sets the smallest distance from the surface at which photons start and shadow rays end, so that both are beyond surfaces in
    /// contact with it.
    pub(crate) fn keep_clear(&mut self, clearance: f32) {
        self.clearance = clearance;
    }

    /// Bounds of the light of all pieces.
    pub(super) fn bounds(&self) -> Option<LightBounds> {
        let pieces = || self.pieces.iter().map(|piece| piece_bounds(piece, self.two_sided, self.flip_normal));
        let of_area =
            self.tree.as_ref().map(|tree| *tree.whole()).or_else(|| pieces().reduce(LightBounds::union))?;
        let radiance = self.radiance.as_dvec3() * self.mean;
        Some(LightBounds { power: of_area.power * radiance.max_element(), ..of_area })
    }

    /// Centre and radius of a sphere around all pieces; for a sphere, the sphere itself. `None` where there are no bounds.
    pub fn bounding_sphere(&self) -> Option<(DVec3, f64)> {
        if let [EmitterShape::Sphere(sphere)] = self.pieces.as_slice() {
            return Some((sphere.center(), sphere.radius()));
        }
        let bounds = self.bounds()?.bounds;
        Some((bounds.center(), bounds.radius()))
    }

    /// The same light with its radiance multiplied by `glow`. `corners` are those of each piece; all pieces must be triangles. Pieces
    /// are then chosen by their emission. `None` where their areas cannot be summed.
    pub fn with_glow(mut self, glow: Arc<Glow>, corners: Vec<[u32; 3]>) -> Option<Self> {
        /// Smallest assumed emission of a piece as a share of the mean emission, because the means over pieces are estimates.
        const FLOOR: f64 = 0.01;
        let areas: Vec<f64> = self.pieces.iter().map(EmitterShape::area).collect();
        let means: Vec<DVec3> = corners.iter().map(|&corners| glow.mean(corners).as_dvec3()).collect();
        let flux: DVec3 = areas.iter().zip(&means).map(|(&area, &mean)| mean * area).sum();
        self.mean = flux / self.area;
        // Where the means find no emission at all, pieces are chosen by area.
        let floor = if self.mean == DVec3::ZERO { 1.0 } else { FLOOR * self.mean.max_element() };
        let weights = areas.iter().zip(&means).map(|(area, mean)| area * mean.max_element().max(floor));
        self.choice = Distribution1D::new(weights)?;
        self.glow = Some((glow, corners));
        Some(self)
    }

    /// Factor on the radiance at a point of a piece.
    fn glow_at(&self, piece: usize, position: DVec3) -> Rgb {
        match (&self.glow, self.pieces.get(piece)) {
            (Some((glow, corners)), Some(EmitterShape::Triangle(triangle))) => corners
                .get(piece)
                .map_or(Rgb::ONE, |&corners| glow.at(corners, triangle.barycentric(position), 0.0)),
            _ => Rgb::ONE,
        }
    }

    /// Radiance where no factor reduces it.
    pub fn radiance(&self) -> Rgb {
        self.radiance
    }

    /// Area of all pieces on one side.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Radiance seen from the `front` (the side of the surface's normal, after flipping) or from the back.
    pub fn emitted(&self, front: bool) -> Rgb {
        if front || self.two_sided { self.radiance } else { Rgb::ZERO }
    }

    /// Flux per channel: `pi L A` from each side that emits.
    pub fn flux(&self) -> DVec3 {
        let sides = if self.two_sided { 2.0 } else { 1.0 };
        self.radiance.as_dvec3() * self.mean * (std::f64::consts::PI * self.area() * sides)
    }

    /// Whether the contribution of a sample is unbounded, or the light can surround a point so that most uniform samples would be
    /// wasted. False for a rectangle and for a sphere seen from outside, which are sampled by solid angle.
    pub fn needs_bsdf_sampling(&self) -> bool {
        match self.pieces.as_slice() {
            [EmitterShape::Quad(quad)] => !quad.is_rectangle(),
            [EmitterShape::Sphere(_)] => self.emits_inward(),
            _ => true,
        }
    }

    /// Whether all of its pieces are flat.
    pub fn is_flat(&self) -> bool {
        let is_round =
            |piece: &EmitterShape| matches!(piece, EmitterShape::Sphere(_) | EmitterShape::Cylinder(_));
        !self.pieces.iter().any(is_round)
    }

    /// Whether the light emits inwards, if its shape is closed.
    fn emits_inward(&self) -> bool {
        self.two_sided || self.flip_normal
    }

    /// The only piece, if it is a sphere around `from` that emits inwards. Points on the sphere itself count as inside, wherever
    /// rounding placed them, because the sphere reflects there.
    fn dome(&self, from: Vec3) -> Option<&Sphere> {
        match self.pieces.as_slice() {
            [EmitterShape::Sphere(sphere)] if self.emits_inward() => {
                let slack = f64::from(8.0 * UNIT_ROUNDOFF * (from.abs().max_element() + self.extent));
                sphere.encloses(from.as_dvec3(), slack).then_some(sphere)
            }
            _ => None,
        }
    }

    pub(super) fn sample_li(&self, at: &Receiver, u: Vec2) -> Option<LightSample> {
        let from = at.position;
        let (piece, probability, u) = match &self.tree {
            Some(tree) => {
                let (piece, probability, rest) = tree.sample(at, refined(u))?;
                (piece, probability, Vec2::new(rest, u.y))
            }
            None => self.choose(u),
        };
        let reference = from.as_dvec3();
        let sample = match self.dome(from) {
            Some(sphere) => sphere.sample_inside(reference, u)?,
            None => self.pieces[piece].sample_solid_angle(reference, u)?,
        };
        let to_light = sample.position - reference;
        let normal = if self.flip_normal { -sample.normal } else { sample.normal };
        let start = self.start_at(sample.position, normal);
        // On the light itself rounding would decide the side, and the back of the light would be lit by its own front, which fills half
        // of all directions there if the light is flat.
        let height = -to_light.dot(normal);
        let rounding = start.normal.abs().dot(from.abs()) * (2.0 * UNIT_ROUNDOFF);
        if height.abs() <= f64::from(start.offset + rounding) {
            return None;
        }
        let radiance = self.emitted(height > 0.0) * self.glow_at(piece, sample.position);
        if radiance == Rgb::ZERO {
            return None;
        }
        let pdf = sample.pdf_solid_angle * probability;
        let wi = unit_f64(to_light)?.as_vec3();
        Some(LightSample {
            wi,
            radiance_over_pdf: radiance / pdf,
            pdf_solid_angle: pdf,
            target: Some(start.end_of_ray(from)),
            distance: to_light.length() as f32,
        })
        .filter(|sample| sample.radiance_over_pdf.is_finite())
    }

    /// Density per solid angle with which [`super::Light::sample_li`] samples, for the receiver, the direction to `position` on
    /// primitive `primitive` of the surface.
    pub fn pdf_solid_angle(&self, at: impl Into<Receiver>, primitive: u32, position: Vec3) -> f32 {
        let at = at.into();
        let from = at.position;
        if self.dome(from).is_some() {
            return Sphere::PDF_INSIDE;
        }
        let piece = if self.pieces.len() == 1 { 0 } else { primitive as usize };
        let Some(shape) = self.pieces.get(piece) else { return 0.0 };
        let probability = match &self.tree {
            Some(tree) => tree.probability(&at, piece),
            None => self.choice.probability(piece),
        };
        probability * shape.pdf_solid_angle(from.as_dvec3(), position.as_dvec3())
    }

    /// Samples the starting point of a photon: uniform over the area, and over both sides where both emit.
    #[inline]
    pub fn sample_start(&self, u: Vec2) -> EmissionStart {
        let x = self.refined_x(u);
        let (back, x) = if self.two_sided {
            let doubled = x * 2.0;
            (doubled >= 1.0, doubled.fract())
        } else {
            (false, x)
        };
        self.start(back, x, u)
    }

    /// [`Self::sample_start`] on the side of the normal or on its `back`. The density per area and side is the same.
    #[inline]
    pub fn sample_side(&self, back: bool, u: Vec2) -> EmissionStart {
        self.start(back, self.refined_x(u), u)
    }

    /// The first coordinate, with additional digits where it also selects a piece.
    #[inline]
    fn refined_x(&self, u: Vec2) -> f64 {
        if self.is_chosen() { refined(u) } else { f64::from(u.x) }
    }

    #[inline]
    fn start(&self, back: bool, x: f64, u: Vec2) -> EmissionStart {
        let (piece, probability, u) = self.choose_by(x, u);
        let sample = self.pieces[piece].sample_area(u);
        let area_over_pdf = match self.glow {
            None => self.area_over_pdf,
            Some(_) => {
                let sides = if self.two_sided { 2.0 } else { 1.0 };
                (sides * self.pieces[piece].area() / f64::from(probability)) as f32
            }
        };
        let normal = if self.flip_normal != back { -sample.normal } else { sample.normal };
        EmissionStart {
            area_over_pdf,
            back,
            glow: self.glow_at(piece, sample.position),
            ..self.start_at(sample.position, normal)
        }
    }

    /// Bound on the starting points of [`Self::sample_side`] for random numbers from `low` to `high`.
    pub fn patch(&self, back: bool, low: Vec2, high: Vec2) -> Option<Patch> {
        let high = high.min(Vec2::splat(ONE_MINUS_EPSILON));
        let ((first, _, from), (last, _, to)) = (self.choose(low), self.choose(high));
        let patch = if first == last {
            Some(self.pieces[first].patch(from, to))
        } else {
            let whole = |piece: &EmitterShape| piece.patch(Vec2::ZERO, Vec2::ONE);
            Patch::union(&self.pieces[first..=last].iter().map(whole).collect::<Vec<_>>())
        };
        patch.map(|patch| if self.flip_normal != back { patch.flipped() } else { patch })
    }

    /// Number of shapes or triangles.
    pub fn piece_count(&self) -> usize {
        self.pieces.len()
    }

    /// Whether both sides emit.
    pub fn is_two_sided(&self) -> bool {
        self.two_sided
    }

    /// Selects a piece; returns it, its probability, and the point with the remainder of its first coordinate.
    #[inline]
    fn choose(&self, u: Vec2) -> (usize, f32, Vec2) {
        if self.is_chosen() { self.choose_by(refined(u), u) } else { (0, 1.0, u) }
    }

    /// A point on the light as a starting point of photons.
    #[inline]
    fn start_at(&self, position: DVec3, normal: DVec3) -> EmissionStart {
        let start = start_at(position, normal, self.extent);
        EmissionStart { offset: start.offset.max(self.clearance), ..start }
    }

    /// [`Self::choose`] with `x` in place of the first coordinate.
    #[inline]
    fn choose_by(&self, x: f64, u: Vec2) -> (usize, f32, Vec2) {
        if !self.is_chosen() {
            return (0, 1.0, Vec2::new((x as f32).min(ONE_MINUS_EPSILON), u.y));
        }
        let (piece, probability, rest) = self.choice.sample(x);
        (piece, probability, Vec2::new(rest, u.y))
    }

    /// Whether there is more than one piece.
    #[inline]
    fn is_chosen(&self) -> bool {
        self.pieces.len() > 1
    }
}

/// Bounds of the light of a piece with a radiance of one.
fn piece_bounds(piece: &EmitterShape, two_sided: bool, flip_normal: bool) -> LightBounds {
    let patch = piece.patch(Vec2::ZERO, Vec2::ONE);
    // From afar a sphere shows a quarter of its area, and a cylinder at most its area over pi.
    let shown = match piece {
        EmitterShape::Sphere(_) => 0.25,
        EmitterShape::Cylinder(_) => std::f64::consts::FRAC_1_PI,
        _ => 1.0,
    };
    LightBounds {
        bounds: piece.bounds(),
        power: piece.area() * shown,
        axis: if flip_normal { -patch.axis } else { patch.axis },
        spread: patch.spread,
        reach: std::f64::consts::FRAC_PI_2,
        two_sided,
    }
}

/// A point on the light computed in `f64`, with the bound of [`crate::embree::SurfacePoint`] on its rounding.
#[inline]
fn start_at(position: DVec3, normal: DVec3, extent: f32) -> EmissionStart {
    // Wide enough also for triangles, which Embree tests in f32 after it has subtracted the ray's origin from the corners.
    let (rounded, n) = (position.as_vec3(), normal.as_vec3());
    let error = (rounded.abs() + Vec3::splat(2.0 * extent)) * (4.0 * UNIT_ROUNDOFF);
    EmissionStart {
        position: rounded,
        normal: n,
        area_over_pdf: 0.0,
        back: false,
        glow: Rgb::ONE,
        offset: 2.0 * n.abs().dot(error + rounded.abs() * UNIT_ROUNDOFF),
    }
}
