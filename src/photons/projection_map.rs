//! Projection maps (Jensen & Christensen 1995, section 3.1): the directions in which a light sees caustic casters.
//!
//! The paper makes a map at each of some positions on a light, enters the bounding spheres of objects, and sends more
//! photons where they are specular. Here positions are cells that together cover the light. For each cell, every sphere
//! is enlarged by the radius of the cell, so that no direction from any point of the cell to a caster is missing. A
//! photon is then aimed at the sphere itself as seen from its start, with the density of all spheres in that direction.

use super::direction_bins::{Cone, DirectionBins};
use crate::lights::{AreaLight, PointLight, SpotLight};
use crate::math::{Frame, unit};
use crate::sampling::{Distribution1D, Distribution2D, ONE_MINUS_EPSILON, warp};
use crate::scene::Target;
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Rows and columns of the map of one cell.
const BINS: (usize, usize) = (32, 64);

/// Cells along one side of a light that is as large as the scene; for smaller lights in proportion to their size.
const CELLS_PER_SCENE: f32 = 24.0;
/// Largest number of cells along one side.
const MOST_CELLS: usize = 8;

/// Up to this number of casters, a cell tests each caster for a direction; beyond it, only those that the map lists
/// there.
const FEW: usize = 8;

/// Least cosine in the estimate of flux towards a caster, however small the cosines are at the sampled points of the
/// cell.
const LEAST_COSINE: f32 = 0.02;

/// A caster and the probability with which a photon is aimed at it.
#[derive(Clone, Copy, Debug)]
struct Aimed {
    center: Vec3,
    radius: f32,
    probability: f32,
}

/// `1 - cos` of the half angle of a sphere seen from `apex`; `None` from inside.
#[inline]
pub(super) fn one_minus_cos(apex: Vec3, center: Vec3, radius: f32) -> Option<f32> {
    let distance = (center - apex).length();
    (distance > radius).then(|| warp::sphere_one_minus_cos(radius, distance))
}

impl Aimed {
    /// Density per solid angle of sampling `direction` from `apex`, including the probability of this caster.
    #[inline]
    fn pdf(&self, apex: Vec3, normal: Option<Vec3>, direction: Vec3) -> f32 {
        match one_minus_cos(apex, self.center, self.radius) {
            Some(size) => {
                let Some(axis) = unit(self.center - apex) else { return 0.0 };
                // 1 - cos(angle) as half the squared chord, which keeps its precision for narrow cones.
                let inside = 0.5 * (direction - axis).length_squared() <= size;
                if inside { self.probability * warp::cone_pdf(size) } else { 0.0 }
            }
            None => self.probability * everywhere_pdf(normal, direction),
        }
    }
}

/// Density of the directions sampled for a caster that contains the origin: cosine-weighted where there is a normal.
fn everywhere_pdf(normal: Option<Vec3>, direction: Vec3) -> f32 {
    normal.map_or(1.0 / (4.0 * PI), |normal| warp::cosine_hemisphere_pdf(normal.dot(direction)))
}

/// The map of one cell of positions.
#[derive(Clone, Debug)]
pub(super) struct PositionCell {
    /// Side of the light, and the rectangle of the unit square whose points start in this cell.
    back: bool,
    low: Vec2,
    size: Vec2,
    casters: Vec<Aimed>,
    choice: Option<Distribution1D>,
    /// The bins, where there are more than [`FEW`] casters.
    bins: Option<DirectionBins>,
    /// Flux towards casters, per area and radiance, or per intensity.
    flux: f64,
}

/// Position and orientation of a cell.
pub(super) struct Place {
    /// Sphere around its positions.
    pub center: Vec3,
    pub radius: f32,
    /// Mean normal.
    pub axis: Vec3,
    /// Largest angle to the axis at which light is emitted.
    pub limit: f32,
    back: bool,
    low: Vec2,
    size: Vec2,
}

impl Place {
    /// The cells of an area light, column after column, first those of the front, then those of the back; and the
    /// number of rows in a column. The number of cells follows from the size of the light relative to the scene.
    pub(super) fn all_of(light: &AreaLight, scene_radius: f32) -> Option<(Vec<Self>, usize)> {
        let whole = light.patch(false, Vec2::ZERO, Vec2::ONE)?;
        let relative = (whole.radius as f32 / scene_radius).min(1.0);
        let side = ((CELLS_PER_SCENE * relative).ceil() as usize).clamp(1, MOST_CELLS);
        let (columns, rows) = if light.piece_count() > MOST_CELLS { (side * side, 1) } else { (side, side) };
        let size = Vec2::new(1.0 / columns as f32, 1.0 / rows as f32);
        let mut places = Vec::with_capacity(2 * columns * rows);
        let sides: &[bool] = if light.is_two_sided() { &[false, true] } else { &[false] };
        for &back in sides {
            for column in 0..columns {
                for row in 0..rows {
                    let low = Vec2::new(column as f32, row as f32) * size;
                    let patch = light.patch(back, low, low + size)?;
                    places.push(Self {
                        center: patch.center.as_vec3(),
                        radius: patch.radius as f32 * (1.0 + 1e-6),
                        axis: patch.axis.as_vec3(),
                        limit: (FRAC_PI_2 + patch.spread as f32).min(PI),
                        back,
                        low,
                        size,
                    });
                }
            }
        }
        Some((places, rows))
    }

    /// A point that emits in all directions.
    pub(super) fn at(position: Vec3) -> Self {
        Self {
            center: position,
            radius: 0.0,
            axis: Vec3::Y,
            limit: PI,
            back: false,
            low: Vec2::ZERO,
            size: Vec2::ONE,
        }
    }

    /// A point that emits within a cone.
    pub(super) fn of_spot(light: &SpotLight) -> Self {
        let (axis, limit) = light.extent();
        Self { axis, limit, ..Self::at(light.position) }
    }
}

impl PositionCell {
    fn new(place: &Place, light: Shining<'_>, targets: &[Target]) -> Self {
        let (mut casters, mut cones, mut fluxes) = (Vec::new(), Vec::new(), Vec::new());
        for target in targets {
            let cone = Cone::of(place.center, place.radius, target);
            if !cone.meets(place.axis, place.limit) {
                continue;
            }
            let flux = flux_towards(place, light, target) * f64::from(target.density);
            if flux > 0.0 {
                casters.push(Aimed { center: target.center, radius: target.radius, probability: 1.0 });
                cones.push(cone);
                fluxes.push(flux);
            }
        }
        let choice = Distribution1D::new(fluxes.iter().copied());
        if let Some(choice) = &choice {
            for (index, caster) in casters.iter_mut().enumerate() {
                caster.probability = choice.probability(index);
            }
        }
        Self {
            back: place.back,
            low: place.low,
            size: place.size,
            bins: (casters.len() > FEW).then(|| DirectionBins::new(place.axis, BINS, place.limit, &cones)),
            flux: choice.as_ref().map_or(0.0, Distribution1D::total),
            casters,
            choice,
        }
    }

    /// Samples a unit direction from `apex`, a point of the cell, to a caster. `normal` is given for a light whose
    /// emission includes the cosine to it. Also returns one over the density per solid angle.
    #[inline]
    pub(super) fn aim(&self, apex: Vec3, normal: Option<Vec3>, u: Vec2) -> Option<(Vec3, f32)> {
        let (chosen, rest) = match &self.choice {
            Some(choice) if self.casters.len() > 1 => {
                let (index, _, rest) = choice.sample(f64::from(u.x));
                (index, Vec2::new(rest, u.y))
            }
            _ => (0, u),
        };
        let caster = self.casters.get(chosen)?;
        let (direction, mut pdf) = match one_minus_cos(apex, caster.center, caster.radius) {
            Some(size) => {
                let axis = unit(caster.center - apex)?;
                let direction = Frame::from_z(axis).to_world(warp::square_to_cone(rest, size));
                (direction, caster.probability * warp::cone_pdf(size))
            }
            None => {
                let direction = match normal {
                    Some(normal) => Frame::from_z(normal).to_world(warp::square_to_cosine_hemisphere(rest)),
                    None => warp::square_to_sphere(rest),
                };
                (direction, caster.probability * everywhere_pdf(normal, direction))
            }
        };
        let mut add = |index: usize| {
            if index != chosen {
                pdf += self.casters[index].pdf(apex, normal, direction);
            }
        };
        match &self.bins {
            None => (0..self.casters.len()).for_each(add),
            Some(bins) => bins.at(direction).iter().for_each(|&index| add(index as usize)),
        }
        (pdf > 0.0 && pdf.is_finite()).then(|| (direction, 1.0 / pdf))
    }

    /// Whether a photon may be aimed in `direction` from some point of the cell.
    #[cfg(test)]
    fn is_marked(&self, direction: Vec3) -> bool {
        self.bins.as_ref().is_none_or(|bins| !bins.at(direction).is_empty())
    }
}

/// Sample points for a start in a cell and for a direction from there, for [`flux_towards`].
fn start_and_direction(i: u32) -> (Vec2, Vec2) {
    // Hammersley points, and the same points with the coordinates shifted by different amounts.
    let u = Vec2::new((i as f32 + 0.5) / SAMPLES as f32, i.reverse_bits() as f32 / 2f32.powi(32));
    (u, (Vec2::new(u.y, u.x) + Vec2::new(0.5 / SAMPLES as f32, 0.618)).fract())
}

/// The kind of emitter at a place.
#[derive(Clone, Copy)]
enum Shining<'a> {
    /// A surface.
    Area(&'a AreaLight),
    /// A point with the same intensity in all directions.
    Point,
    /// A point whose intensity depends on the direction.
    Spot(&'a SpotLight),
}

/// Number of samples of a cell for the division of photons among casters and cells.
const SAMPLES: u32 = 16;

/// Flux from a cell towards a target without occlusion: per area and radiance (cosine included) where the cell is part
/// of a surface, per intensity otherwise. It is the root mean square over starts in the cell, the division of photons
/// with the least variance of their power.
fn flux_towards(place: &Place, light: Shining<'_>, target: &Target) -> f64 {
    let everything = if matches!(light, Shining::Area(_)) { PI } else { 4.0 * PI };
    let solid_angle = |from: Vec3| -> Option<(f32, Vec3)> {
        let size = one_minus_cos(from, target.center, target.radius)?;
        Some((TAU * size, unit(target.center - from)?))
    };
    let sample = |i: u32| -> f32 {
        let (place_u, heading) = start_and_direction(i);
        let light = match light {
            Shining::Area(light) => light,
            Shining::Point => {
                return solid_angle(place.center).map_or(everything, |(solid_angle, _)| solid_angle);
            }
            Shining::Spot(spot) => {
                let (size, axis) = solid_angle(place.center).unwrap_or((everything, Vec3::Z));
                let local = warp::square_to_cone(heading, size / TAU);
                // There may be light between the samples.
                return size
                    * spot
                        .factor(Frame::from_z(axis).to_world(local))
                        .max(LEAST_COSINE * spot.factor(place.axis));
            }
        };
        let start = light.sample_side(place.back, place.low + place_u * place.size);
        let Some((solid_angle, axis)) = solid_angle(start.position) else { return everything };
        let local = warp::square_to_cone(heading, solid_angle / TAU);
        let cosine = Frame::from_z(axis).to_world(local).dot(start.normal);
        (solid_angle * cosine.max(LEAST_COSINE)).min(everything)
    };
    let squares: f64 = (0..SAMPLES).map(|i| f64::from(sample(i)).powi(2)).sum();
    (squares / f64::from(SAMPLES)).sqrt()
}

/// Places on a light, and directions from there, where caustic photons leave it.
#[derive(Clone, Debug)]
pub(super) struct ProjectionMap {
    /// Column after column of `rows`, first those of the front, then those of the back.
    cells: Vec<PositionCell>,
    rows: usize,
    /// Distribution of cells by their flux towards casters; `None` for a single cell.
    choice: Option<Distribution2D>,
    /// Flux towards casters per radiance, or per intensity.
    flux: f64,
}

/// A start in a cell.
pub(super) struct Departure<'a> {
    /// The cell.
    pub cell: &'a PositionCell,
    /// Whether it is on the back of the light.
    pub back: bool,
    /// Point of the unit square for the place on that side.
    pub place: Vec2,
    /// Factor on the reciprocal density of uniformly sampled places.
    pub factor: f32,
}

impl ProjectionMap {
    /// The map of an area light; `None` where no point of it faces a caster.
    pub(super) fn of_area(light: &AreaLight, scene_radius: f32, casters: &[Target]) -> Option<Self> {
        let (places, rows) = Place::all_of(light, scene_radius)?;
        let cells: Vec<PositionCell> =
            places.iter().map(|place| PositionCell::new(place, Shining::Area(light), casters)).collect();
        let fluxes: Vec<f64> = cells.iter().map(|cell| cell.flux).collect();
        // Cells have the same area.
        let sides = if light.is_two_sided() { 2.0 } else { 1.0 };
        let flux = fluxes.iter().sum::<f64>() / fluxes.len() as f64 * light.area() * sides;
        let choice = Distribution2D::new(&fluxes, rows)?;
        let choice = (cells.len() > 1).then_some(choice);
        Some(Self { cells, rows, choice, flux })
    }

    /// The map of a point light; `None` where there is no caster.
    pub(super) fn of_point(light: &PointLight, casters: &[Target]) -> Option<Self> {
        let place = Place::at(light.position);
        let cell = PositionCell::new(&place, Shining::Point, casters);
        let flux = cell.flux;
        (flux > 0.0).then(|| Self { cells: vec![cell], rows: 1, choice: None, flux })
    }

    /// The map of a light at a point whose intensity depends on the direction; `None` where it illuminates no caster.
    /// Its flux is per factor on the intensity.
    pub(super) fn of_spot(light: &SpotLight, casters: &[Target]) -> Option<Self> {
        let cell = PositionCell::new(&Place::of_spot(light), Shining::Spot(light), casters);
        let flux = cell.flux;
        (flux > 0.0).then(|| Self { cells: vec![cell], rows: 1, choice: None, flux })
    }

    /// Flux towards casters per radiance, or per intensity, which determines the number of photons of the light.
    /// Casters behind each other count twice.
    pub(super) fn flux(&self) -> f64 {
        self.flux
    }

    /// Samples a place in proportion to the flux of the cells towards casters.
    #[inline]
    pub(super) fn depart(&self, u: Vec2) -> Departure<'_> {
        let Some(choice) = &self.choice else {
            let cell = &self.cells[0];
            return Departure { cell, back: cell.back, place: u, factor: 1.0 };
        };
        let ((column, row), probability, rest) = choice.sample(u);
        let cell = &self.cells[column * self.rows + row];
        let place = (cell.low + rest * cell.size).min(Vec2::splat(ONE_MINUS_EPSILON));
        Departure { cell, back: cell.back, place, factor: 1.0 / (probability * self.cells.len() as f32) }
    }
}

/// Starts of parallel light that meets a caster: the discs of the spheres, perpendicular to the light.
#[derive(Clone, Debug)]
pub(super) struct DiscMap {
    casters: Vec<Aimed>,
    choice: Distribution1D,
}

impl DiscMap {
    /// `None` where there is no caster.
    pub(super) fn new(targets: &[Target]) -> Option<Self> {
        let size = |target: &Target| f64::from(target.density) * f64::from(target.radius).powi(2);
        let choice = Distribution1D::new(targets.iter().map(size))?;
        let aimed = |(index, target): (usize, &Target)| Aimed {
            center: target.center,
            radius: target.radius,
            probability: choice.probability(index),
        };
        Some(Self { casters: targets.iter().enumerate().map(aimed).collect(), choice })
    }

    /// Area of the discs, weighted by density; overlaps count twice.
    pub(super) fn area(&self) -> f64 {
        f64::from(PI) * self.choice.total()
    }

    /// Samples a point that light along the unit `direction` passes on its way to a caster; also returns one over its
    /// density per area.
    #[inline]
    pub(super) fn sample(&self, direction: Vec3, u: Vec2) -> Option<(Vec3, f32)> {
        let (chosen, rest) = if self.casters.len() > 1 {
            let (index, _, rest) = self.choice.sample(f64::from(u.x));
            (index, Vec2::new(rest, u.y))
        } else {
            (0, u)
        };
        let caster = self.casters.get(chosen)?;
        let frame = Frame::from_z(direction);
        let d = warp::square_to_disc(rest) * caster.radius;
        let point = caster.center + frame.x * d.x + frame.y * d.y;
        let share = |caster: &Aimed| caster.probability / (PI * caster.radius * caster.radius);
        let mut pdf = share(caster);
        for (index, other) in self.casters.iter().enumerate() {
            let across = (point - other.center).reject_from_normalized(direction);
            if index != chosen && across.length_squared() <= other.radius * other.radius {
                pdf += share(other);
            }
        }
        (pdf > 0.0 && pdf.is_finite()).then(|| (point, 1.0 / pdf))
    }
}

#[cfg(test)]
mod tests;
