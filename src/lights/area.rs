use super::tree::{LightBounds, LightTree};
use super::{LightSample, Receiver};
use crate::math::rounding::UNIT_ROUNDOFF;
use crate::math::{Rgb, unit_f64};
use crate::sampling::{Distribution1D, ONE_MINUS_EPSILON, refined};
use crate::shapes::{EmitterShape, Patch, Sphere};
use crate::textures::Glow;
use glam::{DVec3, Vec2, Vec3};
use std::sync::Arc;

/// A surface that emits the same radiance in every direction on its side, and from every point, or what a picture says.
#[derive(Clone, Debug)]
pub struct AreaLight {
    /// One exact shape, or the triangles of a mesh by primitive number.
    pieces: Vec<EmitterShape>,
    /// Pieces in proportion to their area.
    choice: Distribution1D,
    /// Pieces by what they may contribute to a place; where they are many. Power is area.
    tree: Option<LightTree>,
    radiance: Rgb,
    two_sided: bool,
    /// Emits on the side opposite to the shape's own normal.
    flip_normal: bool,
    /// One over the density of a start per area (and side), which is the same on all pieces.
    area_over_pdf: f32,
    /// Radius of the largest piece: what rounding errors near it scale with.
    extent: f32,
    /// Distance off the surface at which photons start and shadow rays end, where that is more than its own rounding: beyond
    /// surfaces that touch it.
    clearance: f32,
    /// Area of all pieces, one side.
    area: f64,
    /// Where the radiance is less in places: a factor on it, and the corners of each piece.
    glow: Option<(Arc<Glow>, Vec<[u32; 3]>)>,
    /// Mean factor over the surface; one where there is no glow.
    mean: DVec3,
}

/// Where a photon leaves an area light.
#[derive(Clone, Copy, Debug)]
pub struct EmissionStart {
    /// Position on the surface.
    pub position: Vec3,
    /// Unit normal on the side that emits here.
    pub normal: Vec3,
    /// One over the density of the start per area (and side).
    pub area_over_pdf: f32,
    /// On the side away from the light's normal.
    pub back: bool,
    /// Factor on the light's radiance here.
    pub glow: Rgb,
    offset: f32,
}

impl EmissionStart {
    /// The position moved off the surface to the side of `direction`.
    pub fn off_surface(&self, direction: Vec3) -> Vec3 {
        self.position + self.normal * self.offset.copysign(direction.dot(self.normal))
    }

    /// Where a shadow ray from `from` ends, so that it does not meet the light itself.
    ///
    /// A ray of a length brings errors of its own to its end, however small the light there: its direction is a rounded
    /// difference, and Embree takes corners relative to the ray's origin. Along the normal they come to 12 roundoffs of the
    /// way, to first order: 1 for the direction, 1 for the corners, 2 for the plane through them, 3 for each of the two
    /// products whose quotient is the ray's parameter, and 2 for that quotient; rounded up for the terms of second order.
    fn end_of_ray(&self, from: Vec3) -> Vec3 {
        /// Roundoffs of the way.
        const OF_WAY: f32 = 16.0;
        let way = from - self.position;
        let offset = self.offset + OF_WAY * UNIT_ROUNDOFF * self.normal.abs().dot(way.abs());
        self.position + self.normal * offset.copysign(way.dot(self.normal))
    }
}

/// Up to so many pieces are chosen by area alone.
const FEW_PIECES: usize = 8;

impl AreaLight {
    /// What it is the surface of, in words.
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

    /// A light of these pieces (one for an exact shape, one for each triangle of a mesh). `None` where there is none.
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

    /// Lets photons start, and shadow rays end, at least so far off the surface: beyond what touches it.
    pub(crate) fn keep_clear(&mut self, clearance: f32) {
        self.clearance = clearance;
    }

    /// What bounds the light of all pieces.
    pub(super) fn bounds(&self) -> Option<LightBounds> {
        let pieces = || self.pieces.iter().map(|piece| piece_bounds(piece, self.two_sided, self.flip_normal));
        let of_area =
            self.tree.as_ref().map(|tree| *tree.whole()).or_else(|| pieces().reduce(LightBounds::union))?;
        let radiance = self.radiance.as_dvec3() * self.mean;
        Some(LightBounds { power: of_area.power * radiance.max_element(), ..of_area })
    }

    /// Middle and radius of a sphere around all pieces: itself, where it is one. `None` where there is none.
    pub fn bounding_sphere(&self) -> Option<(DVec3, f64)> {
        if let [EmitterShape::Sphere(sphere)] = self.pieces.as_slice() {
            return Some((sphere.center(), sphere.radius()));
        }
        let bounds = self.bounds()?.bounds;
        Some((bounds.center(), bounds.radius()))
    }

    /// The same light with its radiance multiplied by `glow`; `corners` are those of each piece, all of them triangles. Pieces
    /// are chosen by what they emit. `None` where their areas cannot be summed up.
    pub fn with_glow(mut self, glow: Arc<Glow>, corners: Vec<[u32; 3]>) -> Option<Self> {
        /// Of the mean: what a piece is taken to emit at least, as means over pieces are estimates.
        const FLOOR: f64 = 0.01;
        let areas: Vec<f64> = self.pieces.iter().map(EmitterShape::area).collect();
        let means: Vec<DVec3> = corners.iter().map(|&corners| glow.mean(corners).as_dvec3()).collect();
        let flux: DVec3 = areas.iter().zip(&means).map(|(&area, &mean)| mean * area).sum();
        self.mean = flux / self.area;
        // Where means find nothing at all, only area is left to go by.
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

    /// Radiance it emits, where nothing dims it.
    pub fn radiance(&self) -> Rgb {
        self.radiance
    }

    /// Area of all pieces, one side.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Radiance seen from the `front` (the side of the surface's normal, after flipping) or the back.
    pub fn emitted(&self, front: bool) -> Rgb {
        if front || self.two_sided { self.radiance } else { Rgb::ZERO }
    }

    /// Flux per channel: `pi L A`, from each side that emits.
    pub fn flux(&self) -> DVec3 {
        let sides = if self.two_sided { 2.0 } else { 1.0 };
        self.radiance.as_dvec3() * self.mean * (std::f64::consts::PI * self.area() * sides)
    }

    /// True where a sample's contribution has no bound, or the light can surround a point, so that most of what is drawn
    /// uniformly is wasted. False for a rectangle and for a sphere seen from outside: what they cover is drawn by solid
    /// angle.
    pub fn needs_bsdf_sampling(&self) -> bool {
        match self.pieces.as_slice() {
            [EmitterShape::Quad(quad)] => !quad.is_rectangle(),
            [EmitterShape::Sphere(_)] => self.emits_inward(),
            _ => true,
        }
    }

    /// Whether all of its pieces are plane.
    pub fn is_flat(&self) -> bool {
        let is_round =
            |piece: &EmitterShape| matches!(piece, EmitterShape::Sphere(_) | EmitterShape::Cylinder(_));
        !self.pieces.iter().any(is_round)
    }

    /// Of a closed shape.
    fn emits_inward(&self) -> bool {
        self.two_sided || self.flip_normal
    }

    /// The only piece, where it is a sphere around `from` that emits inward. The points of the sphere itself belong to
    /// those inside, wherever rounding put them: it reflects there.
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
        // On the light itself rounding would decide the side, and the back of a lamp be lit by its front: a flat one
        // fills half of all directions there.
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

    /// Density per solid angle with which [`super::Light::sample_li`] draws, for the receiver, the direction to `position`
    /// on primitive `primitive` of the surface.
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

    /// Draws where a photon leaves: uniform over the area, and over the sides where both emit.
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

    /// [`Self::sample_start`] on the side of the normal or its `back`. The density, per area and side, is the same.
    #[inline]
    pub fn sample_side(&self, back: bool, u: Vec2) -> EmissionStart {
        self.start(back, self.refined_x(u), u)
    }

    /// The first coordinate, with more digits where it has to choose between pieces as well.
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

    /// A bound on where [`Self::sample_side`] goes for random numbers from `low` to `high`.
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

    /// Shapes or triangles that it consists of.
    pub fn piece_count(&self) -> usize {
        self.pieces.len()
    }

    /// Whether both sides emit.
    pub fn is_two_sided(&self) -> bool {
        self.two_sided
    }

    /// A piece, its probability, and the point with what the choice left of its first coordinate.
    #[inline]
    fn choose(&self, u: Vec2) -> (usize, f32, Vec2) {
        if self.is_chosen() { self.choose_by(refined(u), u) } else { (0, 1.0, u) }
    }

    /// A point on the light as photons leave it.
    #[inline]
    fn start_at(&self, position: DVec3, normal: DVec3) -> EmissionStart {
        let start = start_at(position, normal, self.extent);
        EmissionStart { offset: start.offset.max(self.clearance), ..start }
    }

    /// [`Self::choose`] by `x` in place of the first coordinate.
    #[inline]
    fn choose_by(&self, x: f64, u: Vec2) -> (usize, f32, Vec2) {
        if !self.is_chosen() {
            return (0, 1.0, Vec2::new((x as f32).min(ONE_MINUS_EPSILON), u.y));
        }
        let (piece, probability, rest) = self.choice.sample(x);
        (piece, probability, Vec2::new(rest, u.y))
    }

    /// True where there is more than one piece.
    #[inline]
    fn is_chosen(&self) -> bool {
        self.pieces.len() > 1
    }
}

/// What bounds the light of a piece for a radiance of one.
fn piece_bounds(piece: &EmitterShape, two_sided: bool, flip_normal: bool) -> LightBounds {
    let patch = piece.patch(Vec2::ZERO, Vec2::ONE);
    // Seen from afar a sphere shows a quarter of its area, and a cylinder no more than the part of one over pi.
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

/// A point computed in `f64` on the light, with the bound of [`crate::embree::SurfacePoint`] on its rounding.
#[inline]
fn start_at(position: DVec3, normal: DVec3, extent: f32) -> EmissionStart {
    // Wide enough for triangles as well, which Embree tests in f32 after moving their corners to the ray's origin.
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
