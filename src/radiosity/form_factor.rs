//! Step 2: form factors between elements, by closed forms where nothing is in the way and by rays for what is.

use super::model::{Element, Model, OFF};
use super::polygon::{MOST_CORNERS, point_to_polygon};
use crate::math::Ray;
use crate::sampling::{Rng, Stream};
use crate::scene::Scene;
use arrayvec::ArrayVec;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// Most strata along each coordinate of a patch; rays go from each stratum of one patch to each of the other.
pub const MOST_STRATA: u32 = 8;

/// How light is exchanged between two elements. It holds for both directions: `A_i F_ij = A_j F_ji` by construction, to the bit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Exchange {
    /// `A_i F_ij`, area times form factor, render space.
    pub exchange: f64,
    /// Standard error of the exchange: what two quadratures of the unoccluded factor differ by, and the noise of the visibility.
    pub error: f64,
    /// Share of the light between the two that nothing stops.
    pub seen: f64,
    /// By element: largest minus smallest form factor to the other one, over the points of the element. It tells where a patch is too
    /// large for its illumination to be constant, as at the edge of a shadow.
    pub spread: [f64; 2],
}

/// An element as the computation of form factors needs it.
#[derive(Clone, Debug)]
struct View<'a> {
    model: &'a Model,
    element: &'a Element,
    outline: ArrayVec<DVec3, MOST_CORNERS>,
    nodes: ArrayVec<(DVec3, DVec3, f64), 9>,
}

impl<'a> View<'a> {
    fn new(model: &'a Model, element: &'a Element) -> Self {
        let outline = if element.is_flat { element.domain.outline(&model.charts) } else { ArrayVec::new() };
        let nodes = element.domain.nodes(&model.charts);
        let nodes = nodes.into_iter().map(|(p, weight)| (p, model.normal(element, p), weight)).collect();
        Self { model, element, outline, nodes }
    }

    /// Form factor from a small area to the whole element, without occlusion.
    fn seen_from(&self, position: DVec3, normal: DVec3) -> f64 {
        if self.element.is_flat {
            let height = (position - self.element.center).dot(self.element.normal);
            return if height > 0.0 { point_to_polygon(position, normal, &self.outline) } else { 0.0 };
        }
        let (mut sum, mut weights) = (0.0, 0.0);
        for &(y, facing, weight) in &self.nodes {
            // Undefined for a point with itself.
            let Some(kernel) = kernel((position, normal), (y, facing)) else { continue };
            sum += weight * kernel;
            weights += weight;
        }
        if weights > 0.0 { (self.element.area * sum / weights).min(1.0) } else { 0.0 }
    }

    /// Mean form factor from the element to `other`, and the smallest and largest at its points.
    fn to(&self, other: &Self) -> (f64, f64, f64) {
        let mut found = (0.0, f64::INFINITY, 0.0f64);
        for &(position, normal, weight) in &self.nodes {
            let factor = other.seen_from(position, normal);
            found = (found.0 + weight * factor, found.1.min(factor), found.2.max(factor));
        }
        found
    }
}

/// Form factor from a small area to an element, without occlusion.
pub(super) fn factor_from(model: &Model, element: &Element, position: DVec3, normal: DVec3) -> f64 {
    let reach =
        if element.is_flat { element.radius * element.normal.cross(normal).length() } else { element.radius };
    if (element.center - position).dot(normal) + reach <= 0.0 {
        return 0.0;
    }
    if !element.is_flat {
        return View::new(model, element).seen_from(position, normal);
    }
    let height = (position - element.center).dot(element.normal);
    if height > 0.0 {
        point_to_polygon(position, normal, &element.domain.outline(&model.charts))
    } else {
        0.0
    }
}

/// `cos cos / (pi r^2)` between two small areas, 1/area; `None` where they coincide.
fn kernel((x, nx): (DVec3, DVec3), (y, ny): (DVec3, DVec3)) -> Option<f64> {
    let way = y - x;
    let square = way.length_squared();
    if !(square > 1e-20) {
        return None;
    }
    let (a, b) = (way.dot(nx), -way.dot(ny));
    Some(if a > 0.0 && b > 0.0 { a * b / (PI * square * square) } else { 0.0 })
}

/// Whether some point of `a` may see the front of some point of `b`, and the other way around; false where one is behind the other.
pub(super) fn may_face(a: &Element, b: &Element) -> bool {
    // Coplanar neighbours must not count by rounding.
    let slack = 1e-9;
    let faces = |a: &Element, b: &Element| {
        !a.is_flat || (b.center - a.center).dot(a.normal) > -reach(b, a.normal) + slack
    };
    // Half the extent of an element along a direction.
    fn reach(element: &Element, direction: DVec3) -> f64 {
        if element.is_flat {
            element.radius * element.normal.cross(direction).length()
        } else {
            element.radius
        }
    }
    faces(a, b) && faces(b, a)
}

/// Computes exchanges.
#[derive(Clone, Copy, Debug)]
pub(super) struct FormFactors<'a> {
    pub(super) scene: &'a Scene,
    /// Strata along each coordinate of each of the two patches.
    pub(super) strata: u32,
    pub(super) seed: u64,
}

impl FormFactors<'_> {
    /// The exchange between two elements, the same whichever comes first.
    pub(super) fn between(&self, model: &Model, i: u32, j: u32) -> Exchange {
        if i > j {
            let found = self.between(model, j, i);
            return Exchange { spread: [found.spread[1], found.spread[0]], ..found };
        }
        let (a, b) = (&model.elements[i as usize], &model.elements[j as usize]);
        if i == j && a.is_flat || !may_face(a, b) {
            return Exchange::default();
        }
        let (p, q) = (View::new(model, a), View::new(model, b));
        let (to_q, least_q, most_q) = p.to(&q);
        let (to_p, least_p, most_p) = if i == j { (to_q, least_q, most_q) } else { q.to(&p) };
        let (by_p, by_q) = (a.area * to_q, b.area * to_p);
        let spread = [most_q - least_q, most_p - least_p];
        // The integral over the element on which the form factor varies less is the more accurate one.
        let free = if a.area * spread[0] <= b.area * spread[1] { by_p } else { by_q };
        if !(free > 0.0) {
            return Exchange::default();
        }
        let seen = self.visibility((&p, &q), (i, j));
        let varies = |mean: f64, spread: f64, range: f64| spread * seen.share + mean * range;
        Exchange {
            exchange: free * seen.share,
            error: ((by_p - by_q) * seen.share).hypot(free * seen.error),
            seen: seen.share,
            spread: [varies(to_q, spread[0], seen.ranges[0]), varies(to_p, spread[1], seen.ranges[1])],
        }
    }

    /// The share of the light between two elements that nothing stops.
    fn visibility(&self, (p, q): (&View<'_>, &View<'_>), (i, j): (u32, u32)) -> Visibility {
        const MOST: usize = (MOST_STRATA * MOST_STRATA) as usize;
        let side = self.strata.clamp(1, MOST_STRATA);
        let count = (side * side) as usize;
        let mut rng = Rng::new(self.seed, Stream::Radiosity, u64::from(i) << 32 | u64::from(j));
        // Sums by stratum of both elements: light, and light that arrives.
        let (mut of_p, mut of_q) = ([(0.0, 0.0); MOST], [(0.0, 0.0); MOST]);
        let mut point = |view: &View<'_>, stratum: usize| {
            let cell = DVec2::new((stratum % side as usize) as f64, (stratum / side as usize) as f64);
            let u = (cell + DVec2::new(rng.next_f64(), rng.next_f64())) / f64::from(side);
            let position = view.element.domain.point(&view.model.charts, u);
            (position, view.model.normal(view.element, position))
        };
        for (s, at_p) in of_p[..count].iter_mut().enumerate() {
            for (t, at_q) in of_q[..count].iter_mut().enumerate() {
                let (x, y) = (point(p, s), point(q, t));
                let Some(weight) = kernel(x, y).filter(|weight| *weight > 0.0) else { continue };
                let (from, to) = ((x.0 + x.1 * OFF).as_vec3(), (y.0 + y.1 * OFF).as_vec3());
                let arrives = if self.scene.occluded(&Ray::segment(from, to)) { 0.0 } else { weight };
                for sums in [&mut *at_p, at_q] {
                    sums.0 += weight;
                    sums.1 += arrives;
                }
            }
        }
        let all = of_p[..count].iter().fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1));
        let share = if all.0 > 0.0 { all.1 / all.0 } else { 1.0 };
        let rays = (count * count) as f64;
        // What no ray has met may still be there: the rule of succession.
        let least = 1.0 / (rays + 2.0);
        let range = |sums: &[(f64, f64)]| {
            let shares = sums.iter().filter(|sum| sum.0 > 0.0).map(|sum| sum.1 / sum.0);
            let (low, high) = shares.fold((f64::INFINITY, 0.0f64), |(a, b), x| (a.min(x), b.max(x)));
            if high >= low { (high - low).max(least) } else { least }
        };
        let smoothed = (share * rays + 1.0) / (rays + 2.0);
        let is_mixed = share > 0.0 && share < 1.0;
        Visibility {
            share,
            error: if is_mixed { (smoothed * (1.0 - smoothed) / rays).sqrt() } else { 0.0 },
            ranges: [range(&of_p[..count]), range(&of_q[..count])],
        }
    }
}

/// Visibility between two elements.
#[derive(Clone, Copy, Debug)]
struct Visibility {
    /// Share of the light that arrives.
    share: f64,
    /// Its standard error, an upper bound that stratification does not reach.
    error: f64,
    /// By element: largest minus smallest share over its strata.
    ranges: [f64; 2],
}
