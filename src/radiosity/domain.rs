//! The part of a surface that a patch covers: a triangle, or a rectangle of a chart.

use super::polygon::MOST_CORNERS;
use crate::shapes::Chart;
use arrayvec::ArrayVec;
use glam::{DVec2, DVec3};

/// A part of a surface, render space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Domain {
    /// A triangle of a mesh, or a quarter of one, and so on.
    Triangle {
        /// Corners; the order gives the side of the normal.
        corners: [DVec3; 3],
    },
    /// A rectangle of the coordinates of a chart.
    Rectangle {
        /// Index into [`super::Model::charts`].
        chart: u32,
        /// Smallest coordinates.
        low: DVec2,
        /// Largest coordinates.
        high: DVec2,
    },
}

/// Nodes and weights of a rule of degree 5 on the triangle (Radon 1948): barycentric coordinates of the second and third corner.
const TRIANGLE_RULE: [(f64, f64, f64); 7] = {
    const A: f64 = 0.059_715_871_789_769_82;
    const B: f64 = 0.470_142_064_105_115_1;
    const C: f64 = 0.797_426_985_353_087_3;
    const D: f64 = 0.101_286_507_323_456_34;
    const NEAR: f64 = 0.132_394_152_788_506_2;
    const FAR: f64 = 0.125_939_180_544_827_15;
    [
        (1.0 / 3.0, 1.0 / 3.0, 0.225),
        (A, B, NEAR),
        (B, A, NEAR),
        (B, B, NEAR),
        (C, D, FAR),
        (D, C, FAR),
        (D, D, FAR),
    ]
};

/// Nodes and weights of Gauss's rule with three nodes on `[0, 1]`.
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_31, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// Nodes of a quadrature over a domain: positions with weights that sum to one.
pub(super) type Nodes = ArrayVec<(DVec3, f64), 9>;

impl Domain {
    /// The point of the domain to which the unit square maps `u`, with equal areas.
    pub(super) fn point(&self, charts: &[Chart], u: DVec2) -> DVec3 {
        match self {
            Self::Triangle { corners: [a, b, c] } => {
                // The map of Heitz, "A Low-Distortion Map Between Triangle and Square" (2019), which keeps strata compact.
                let half = 0.5 * u;
                let offset = half.y - half.x;
                let (s, t) = if offset > 0.0 { (half.x, half.y + offset) } else { (half.x - offset, half.y) };
                *a + (*b - *a) * s + (*c - *a) * t
            }
            Self::Rectangle { chart, low, high } => charts[*chart as usize].point(low + (high - low) * u),
        }
    }

    /// Nodes of a quadrature of degree 5.
    pub(super) fn nodes(&self, charts: &[Chart]) -> Nodes {
        match self {
            Self::Triangle { corners: [a, b, c] } => TRIANGLE_RULE
                .iter()
                .map(|&(s, t, weight)| (*a + (*b - *a) * s + (*c - *a) * t, weight))
                .collect(),
            Self::Rectangle { .. } => GAUSS
                .iter()
                .flat_map(|&(x, wx)| GAUSS.map(|(y, wy)| (self.point(charts, DVec2::new(x, y)), wx * wy)))
                .collect(),
        }
    }

    /// Area.
    pub(super) fn area(&self, charts: &[Chart]) -> f64 {
        match self {
            Self::Triangle { corners: [a, b, c] } => 0.5 * (*b - *a).cross(*c - *a).length(),
            Self::Rectangle { chart, low, high } => {
                let sides = high - low;
                charts[*chart as usize].area() * sides.x * sides.y
            }
        }
    }

    /// Unit normal at a point, on the side of the domain's own orientation.
    pub(super) fn normal(&self, charts: &[Chart], at: DVec3) -> DVec3 {
        match self {
            Self::Triangle { corners: [a, b, c] } => (*b - *a).cross(*c - *a).normalize_or_zero(),
            Self::Rectangle { chart, .. } => charts[*chart as usize].normal(at),
        }
    }

    /// Whether the domain lies in a plane.
    pub(super) fn is_flat(&self, charts: &[Chart]) -> bool {
        match self {
            Self::Triangle { .. } => true,
            Self::Rectangle { chart, .. } => charts[*chart as usize].is_flat(),
        }
    }

    /// Corners of the outline. Edges of a disc are divided, as they are curved.
    pub(super) fn outline(&self, charts: &[Chart]) -> ArrayVec<DVec3, MOST_CORNERS> {
        /// Pieces of a curved edge.
        const PIECES: usize = MOST_CORNERS / 4;
        match self {
            Self::Triangle { corners } => corners.iter().copied().collect(),
            Self::Rectangle { chart, .. } => {
                let is_straight = matches!(charts[*chart as usize], Chart::Parallelogram { .. });
                let pieces = if is_straight { 1 } else { PIECES };
                let corners = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y, DVec2::ZERO].map(|corner| corner);
                corners
                    .windows(2)
                    .flat_map(|ends| {
                        (0..pieces).map(move |i| ends[0].lerp(ends[1], i as f64 / pieces as f64))
                    })
                    .map(|place| self.point(charts, place))
                    .collect()
            }
        }
    }

    /// A point close to a corner, by its number in the order of [`Local::weights`].
    pub(super) fn near_corner(&self, charts: &[Chart], corner: usize) -> DVec3 {
        /// Distance from the corner, as a share of the way to the middle.
        const INSIDE: f64 = 0.05;
        match self {
            Self::Triangle { corners } => {
                let middle = corners.iter().sum::<DVec3>() / 3.0;
                corners[corner % 3].lerp(middle, INSIDE)
            }
            Self::Rectangle { .. } => {
                let at = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y][corner % 4];
                self.point(charts, at.lerp(DVec2::splat(0.5), INSIDE))
            }
        }
    }

    /// For each corner of a quarter of a domain of this kind, the weights of the corners of the whole.
    pub(super) fn corners_of_quarter(&self, quarter: u32) -> [[f64; 4]; 4] {
        match self {
            Self::Triangle { .. } => {
                let corners = [DVec3::X, DVec3::Y, DVec3::Z];
                let own = Self::Triangle { corners }.quarters()[quarter as usize % 4];
                let Self::Triangle { corners: [a, b, c] } = own else { return [[0.25; 4]; 4] };
                [a, b, c, a].map(|at| Local::Triangle(at).weights())
            }
            Self::Rectangle { .. } => {
                let low = 0.5 * DVec2::new(f64::from(quarter % 2), f64::from(quarter / 2 % 2));
                let around = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
                around.map(|corner| Local::Rectangle(low + 0.5 * corner).weights())
            }
        }
    }

    /// The four quarters, of equal area: of a triangle those at its corners and the middle one, of a rectangle row by row.
    pub(super) fn quarters(&self) -> [Self; 4] {
        match *self {
            Self::Triangle { corners: [a, b, c] } => {
                // Symmetric in both ends, so that triangles with a common edge divide it at the same point to the bit.
                let (ab, bc, ca) = (0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [bc, ca, ab]]
                    .map(|corners| Self::Triangle { corners })
            }
            Self::Rectangle { chart, low, high } => {
                let middle = 0.5 * (low + high);
                let part = |low: DVec2, high: DVec2| Self::Rectangle { chart, low, high };
                [
                    part(low, middle),
                    part(DVec2::new(middle.x, low.y), DVec2::new(high.x, middle.y)),
                    part(DVec2::new(low.x, middle.y), DVec2::new(middle.x, high.y)),
                    part(middle, high),
                ]
            }
        }
    }
}

/// Where a point lies inside a domain: coordinates that are followed from a patch to its quarters.
#[derive(Clone, Copy, Debug)]
pub(super) enum Local {
    /// Barycentric coordinates.
    Triangle(DVec3),
    /// Coordinates in `[0, 1]^2`.
    Rectangle(DVec2),
}

impl Local {
    /// Coordinates of `position` in `domain`; `place` are its coordinates in the chart.
    pub(super) fn of(domain: &Domain, position: DVec3, place: DVec2) -> Self {
        match domain {
            Domain::Triangle { corners: [a, b, c] } => {
                let (u, v, w) = (*b - *a, *c - *a, position - *a);
                let normal = u.cross(v);
                let scale = normal.length_squared().max(f64::MIN_POSITIVE);
                let (s, t) = (w.cross(v).dot(normal) / scale, u.cross(w).dot(normal) / scale);
                let shares = DVec3::new(1.0 - s - t, s, t).max(DVec3::ZERO);
                Self::Triangle(shares / shares.element_sum().max(f64::MIN_POSITIVE))
            }
            Domain::Rectangle { low, high, .. } => {
                Self::Rectangle(((place - low) / (high - low)).clamp(DVec2::ZERO, DVec2::ONE))
            }
        }
    }

    /// The quarter that the point lies in, and its coordinates there.
    pub(super) fn quarter(self) -> (u32, Self) {
        match self {
            Self::Triangle(at) => {
                let double = 2.0 * at;
                for (i, corner) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
                    if at.dot(corner) > 0.5 {
                        return (i as u32, Self::Triangle((double - corner).max(DVec3::ZERO)));
                    }
                }
                (3, Self::Triangle((DVec3::ONE - double).max(DVec3::ZERO)))
            }
            Self::Rectangle(at) => {
                let side = DVec2::new(f64::from(u8::from(at.x >= 0.5)), f64::from(u8::from(at.y >= 0.5)));
                let index = side.x as u32 + 2 * side.y as u32;
                (index, Self::Rectangle((2.0 * at - side).clamp(DVec2::ZERO, DVec2::ONE)))
            }
        }
    }

    /// Weights of the corners of the patch: barycentric or bilinear. Corners of a rectangle go around it.
    pub(super) fn weights(self) -> [f64; 4] {
        match self {
            Self::Triangle(at) => [at.x, at.y, at.z, 0.0],
            Self::Rectangle(DVec2 { x, y }) => [(1.0 - x) * (1.0 - y), x * (1.0 - y), x * y, (1.0 - x) * y],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn domains() -> (Vec<Chart>, Vec<Domain>) {
        let center = DVec3::new(0.1, 0.2, 0.3);
        let charts = vec![
            Chart::parallelogram(center, DVec3::X * 0.3, DVec3::new(0.1, 0.5, 0.0)).unwrap(),
            Chart::sphere(center, 0.4).unwrap(),
            Chart::cylinder(center, center + DVec3::Y, 0.2).unwrap(),
            Chart::disc(center, DVec3::ONE, 0.4).unwrap(),
        ];
        let (low, high) = (DVec2::new(0.25, 0.5), DVec2::new(0.5, 0.75));
        let mut all: Vec<Domain> = (0..4).map(|chart| Domain::Rectangle { chart, low, high }).collect();
        all.push(Domain::Triangle {
            corners: [center, center + DVec3::X, center + DVec3::new(0.2, 0.7, 0.1)],
        });
        (charts, all)
    }

    #[test]
    fn quarters_share_the_area_and_hold_their_points() {
        let (charts, domains) = domains();
        for domain in domains {
            let quarters = domain.quarters();
            for (i, quarter) in quarters.iter().enumerate() {
                let share = quarter.area(&charts) / domain.area(&charts);
                assert!((share - 0.25).abs() < 1e-12, "{domain:?}: {share}");
                let u = DVec2::new(0.3, 0.6);
                let position = quarter.point(&charts, u);
                let place = match domain {
                    Domain::Rectangle { chart, .. } => charts[chart as usize].locate(position),
                    Domain::Triangle { .. } => DVec2::ZERO,
                };
                let (found, inside) = Local::of(&domain, position, place).quarter();
                assert_eq!(found as usize, i, "{domain:?}");
                // The weights of the corners give the point back.
                let weights = inside.weights();
                if let Domain::Triangle { corners } = quarter {
                    let sum: DVec3 =
                        corners.iter().zip(weights).map(|(corner, weight)| *corner * weight).sum();
                    assert!(sum.distance(position) < 1e-12);
                }
                assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn quadratures_are_exact_for_polynomials() {
        let (charts, domains) = domains();
        for domain in domains {
            let nodes = domain.nodes(&charts);
            assert!((nodes.iter().map(|(_, weight)| weight).sum::<f64>() - 1.0).abs() < 1e-14);
            if !matches!(domain, Domain::Triangle { .. } | Domain::Rectangle { chart: 0, .. }) {
                continue;
            }
            let value = |p: DVec3| (p.x - 0.2).powi(3) * (p.y + 0.1).powi(2);
            let by_rule: f64 = nodes.iter().map(|&(p, weight)| weight * value(p)).sum();
            const N: usize = 400;
            let by_grid: f64 = (0..N * N)
                .map(|i| DVec2::new((i % N) as f64 + 0.5, (i / N) as f64 + 0.5) / N as f64)
                .map(|u| value(domain.point(&charts, u)))
                .sum::<f64>()
                / (N * N) as f64;
            assert!((by_rule / by_grid - 1.0).abs() < 1e-4, "{domain:?}: {by_rule} {by_grid}");
        }
    }
}
