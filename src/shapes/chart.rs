//! Charts: area-preserving coordinates on surfaces, for illumination maps.

use super::{ShapeError, finite, positive_radius, tangents};
use crate::math::unit_f64;
use glam::{DAffine3, DVec2, DVec3};
use std::f64::consts::{FRAC_1_PI, PI, TAU};

/// Coordinates in `[0, 1]^2` on a surface. Equal areas in the square are equal areas on the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Chart {
    /// A parallelogram, along its edges.
    Parallelogram {
        /// Corner at zero.
        corner: DVec3,
        /// `duals[i] . (p - corner)` is coordinate `i`.
        duals: [DVec3; 2],
        /// Lengths of the edges.
        lengths: DVec2,
        /// Unit normal along the cross product of the first edge with the second.
        normal: DVec3,
        /// Area.
        area: f64,
    },
    /// A sphere, by azimuth and height (Lambert's cylindrical projection).
    Sphere {
        /// Centre.
        center: DVec3,
        /// Radius.
        radius: f64,
    },
    /// The side of a cylinder, by azimuth and height.
    Cylinder {
        /// Centre of the lower end.
        base: DVec3,
        /// Unit vectors: the axis, and two perpendicular to it.
        frame: [DVec3; 3],
        /// Length.
        height: f64,
        /// Radius.
        radius: f64,
    },
    /// A disc, by the concentric map of Shirley & Chiu (1997).
    Disc {
        /// Centre.
        center: DVec3,
        /// Unit vectors: the normal, and two perpendicular to it.
        frame: [DVec3; 3],
        /// Radius.
        radius: f64,
    },
}

impl Chart {
    /// The chart of the parallelogram with these edges.
    pub fn parallelogram(corner: DVec3, edge_u: DVec3, edge_v: DVec3) -> Result<Self, ShapeError> {
        let cross = finite(finite(edge_u)?.cross(finite(edge_v)?))?;
        let normal = unit_f64(cross).ok_or(ShapeError::NoArea)?;
        let area = cross.length();
        // Each dual lies in the plane and is perpendicular to the other edge.
        let duals = [edge_v.cross(normal) / area, normal.cross(edge_u) / area];
        let lengths = DVec2::new(edge_u.length(), edge_v.length());
        Ok(Self::Parallelogram { corner: finite(corner)?, duals, lengths, normal, area })
    }

    /// The chart of a sphere.
    pub fn sphere(center: DVec3, radius: f64) -> Result<Self, ShapeError> {
        Ok(Self::Sphere { center: finite(center)?, radius: positive_radius(radius)? })
    }

    /// The chart of the side of a cylinder.
    pub fn cylinder(base: DVec3, top: DVec3, radius: f64) -> Result<Self, ShapeError> {
        let axis = unit_f64(finite(top)? - finite(base)?).ok_or(ShapeError::NoArea)?;
        let (x, y) = tangents(axis);
        let height = (top - base).length();
        Ok(Self::Cylinder { base, frame: [axis, x, y], height, radius: positive_radius(radius)? })
    }

    /// The chart of a disc.
    pub fn disc(center: DVec3, normal: DVec3, radius: f64) -> Result<Self, ShapeError> {
        let normal = unit_f64(finite(normal)?).ok_or(ShapeError::NoArea)?;
        let (x, y) = tangents(normal);
        Ok(Self::Disc { center: finite(center)?, frame: [normal, x, y], radius: positive_radius(radius)? })
    }

    /// Approximate coordinates of the surface point nearest to `p`.
    pub fn locate(&self, p: DVec3) -> DVec2 {
        let place = match self {
            Self::Parallelogram { corner, duals, .. } => {
                DVec2::new(duals[0].dot(p - corner), duals[1].dot(p - corner))
            }
            Self::Sphere { center, radius } => {
                let v = p - center;
                DVec2::new(turn(v.x, v.y), 0.5 * (1.0 + v.z / radius))
            }
            Self::Cylinder { base, frame: [axis, x, y], height, .. } => {
                let v = p - base;
                DVec2::new(turn(v.dot(*x), v.dot(*y)), v.dot(*axis) / height)
            }
            Self::Disc { center, frame: [_, x, y], radius } => {
                let v = (p - center) / *radius;
                0.5 * (1.0 + square_of_disc(DVec2::new(v.dot(*x), v.dot(*y))))
            }
        };
        place.clamp(DVec2::ZERO, DVec2::ONE)
    }

    /// The surface point with these coordinates, the inverse of [`Self::locate`].
    pub fn point(&self, place: DVec2) -> DVec3 {
        match self {
            Self::Parallelogram { corner, .. } => {
                let [u, v] = self.edges();
                corner + place.x * u + place.y * v
            }
            Self::Sphere { center, radius } => {
                let height = 2.0 * place.y - 1.0;
                let (s, c) = (TAU * place.x).sin_cos();
                let across = (1.0 - height * height).max(0.0).sqrt();
                center + *radius * DVec3::new(across * c, across * s, height)
            }
            Self::Cylinder { base, frame: [axis, x, y], height, radius } => {
                let (s, c) = (TAU * place.x).sin_cos();
                base + *axis * (place.y * height) + *radius * (*x * c + *y * s)
            }
            Self::Disc { center, frame: [_, x, y], radius } => {
                let d = disc_of_square(2.0 * place - 1.0);
                center + *radius * (*x * d.x + *y * d.y)
            }
        }
    }

    /// The edges of a parallelogram; zero for other charts.
    fn edges(&self) -> [DVec3; 2] {
        match self {
            Self::Parallelogram { duals: [a, b], normal, .. } => {
                let (u, v) = (b.cross(*normal), normal.cross(*a));
                [u / a.dot(u), v / b.dot(v)]
            }
            Self::Sphere { .. } | Self::Cylinder { .. } | Self::Disc { .. } => [DVec3::ZERO; 2],
        }
    }

    /// The same chart under a similarity with this factor on lengths.
    ///
    /// # Errors
    /// Where numbers leave the range of a chart.
    pub fn transformed(&self, transform: &DAffine3, scale: f64) -> Result<Self, ShapeError> {
        let point = |p: DVec3| transform.transform_point3(p);
        let turn = |v: DVec3| transform.transform_vector3(v) / scale;
        match self {
            Self::Parallelogram { corner, .. } => {
                let [u, v] = self.edges().map(|edge| transform.transform_vector3(edge));
                Self::parallelogram(point(*corner), u, v)
            }
            Self::Sphere { center, radius } => Self::sphere(point(*center), radius * scale),
            Self::Cylinder { base, frame, height, radius } => Ok(Self::Cylinder {
                base: finite(point(*base))?,
                frame: frame.map(turn),
                height: height * scale,
                radius: positive_radius(radius * scale)?,
            }),
            Self::Disc { center, frame, radius } => Ok(Self::Disc {
                center: finite(point(*center))?,
                frame: frame.map(turn),
                radius: positive_radius(radius * scale)?,
            }),
        }
    }

    /// Whether the surface lies in a plane.
    pub fn is_flat(&self) -> bool {
        matches!(self, Self::Parallelogram { .. } | Self::Disc { .. })
    }

    /// Area of the surface.
    pub fn area(&self) -> f64 {
        match self {
            Self::Parallelogram { area, .. } => *area,
            Self::Sphere { radius, .. } => 2.0 * TAU * radius * radius,
            Self::Cylinder { height, radius, .. } => TAU * radius * height,
            Self::Disc { radius, .. } => PI * radius * radius,
        }
    }

    /// Largest lengths along both coordinates.
    pub fn lengths(&self) -> DVec2 {
        match self {
            Self::Parallelogram { lengths, .. } => *lengths,
            Self::Sphere { radius, .. } => DVec2::new(TAU * radius, PI * radius),
            Self::Cylinder { height, radius, .. } => DVec2::new(TAU * radius, *height),
            Self::Disc { radius, .. } => DVec2::splat(2.0 * radius),
        }
    }

    /// Whether the first coordinate wraps around.
    pub fn goes_round(&self) -> bool {
        matches!(self, Self::Sphere { .. } | Self::Cylinder { .. })
    }

    /// Unit normal at the surface point near `p`: outward, or by the orientation of the edges.
    pub fn normal(&self, p: DVec3) -> DVec3 {
        match self {
            Self::Parallelogram { normal, .. } => *normal,
            Self::Sphere { center, .. } => (p - center).normalize_or_zero(),
            Self::Cylinder { base, frame: [axis, ..], .. } => {
                let v = p - base;
                (v - *axis * v.dot(*axis)).normalize_or_zero()
            }
            Self::Disc { frame: [normal, ..], .. } => *normal,
        }
    }

    /// Approximate distance of `p` from the surface, which distinguishes the faces of a body.
    pub fn distance(&self, p: DVec3) -> f64 {
        match self {
            Self::Parallelogram { corner, normal, .. } => normal.dot(p - corner).abs(),
            Self::Sphere { center, radius } => ((p - center).length() - radius).abs(),
            Self::Cylinder { base, frame: [axis, ..], radius, .. } => {
                let v = p - base;
                ((v - *axis * v.dot(*axis)).length() - radius).abs()
            }
            Self::Disc { center, frame: [normal, ..], .. } => normal.dot(p - center).abs(),
        }
    }
}

/// Azimuth in turns, in `[0, 1]`.
fn turn(x: f64, y: f64) -> f64 {
    let azimuth = y.atan2(x) / TAU;
    if azimuth < 0.0 { azimuth + 1.0 } else { azimuth }
}

/// Maps the unit disc to `[-1, 1]^2`; circles become outlines of squares.
fn square_of_disc(p: DVec2) -> DVec2 {
    let radius = p.length();
    if radius == 0.0 {
        return DVec2::ZERO;
    }
    if p.x.abs() >= p.y.abs() {
        let a = radius.copysign(p.x);
        DVec2::new(a, a * 4.0 * FRAC_1_PI * (p.y / p.x).atan())
    } else {
        let b = radius.copysign(p.y);
        DVec2::new(b * 4.0 * FRAC_1_PI * (p.x / p.y).atan(), b)
    }
}

/// The inverse of [`square_of_disc`].
fn disc_of_square(p: DVec2) -> DVec2 {
    if p == DVec2::ZERO {
        return p;
    }
    if p.x.abs() >= p.y.abs() {
        let (s, c) = (0.25 * PI * p.y / p.x).sin_cos();
        p.x * DVec2::new(c, s)
    } else {
        let (s, c) = (0.25 * PI * p.x / p.y).sin_cos();
        p.y * DVec2::new(s, c)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};
    use crate::shapes::{Cylinder, Disc, Quad, Sphere};
    use glam::Vec2;

    /// Points uniform over the area are uniform over the coordinates: chi-square over 8 by 8 elements, beyond 130 with a
    /// probability of 1e-6 (63 degrees of freedom).
    #[test]
    fn equal_areas_everywhere() {
        let (center, axis) = (DVec3::new(0.3, -1.0, 2.0), DVec3::new(0.2, 0.9, -0.4));
        let sphere = Sphere::new(center, 0.7).unwrap();
        let cylinder = Cylinder::new(center, center + axis, 0.4).unwrap();
        let disc = Disc::new(center, axis, 1.3).unwrap();
        let edges = (DVec3::new(2.0, 0.1, 0.0), DVec3::new(0.5, 0.0, -1.0));
        let quad = Quad::new(center, edges.0, edges.1).unwrap();
        type Sampler<'a> = Box<dyn Fn(Vec2) -> (DVec3, DVec3) + 'a>;
        let cases: [(Chart, Sampler<'_>, f64); 4] = [
            (
                Chart::sphere(center, 0.7).unwrap(),
                Box::new(|u| sphere.sample_area(u)).map_point(),
                sphere.area(),
            ),
            (
                Chart::cylinder(center, center + axis, 0.4).unwrap(),
                Box::new(|u| cylinder.sample_area(u)).map_point(),
                cylinder.area(),
            ),
            (
                Chart::disc(center, axis, 1.3).unwrap(),
                Box::new(|u| disc.sample_area(u)).map_point(),
                disc.area(),
            ),
            (
                Chart::parallelogram(center, edges.0, edges.1).unwrap(),
                Box::new(|u| quad.sample_area(u)).map_point(),
                quad.area(),
            ),
        ];
        for (chart, sample, area) in cases {
            assert!((chart.area() / area - 1.0).abs() < 1e-12, "{chart:?}");
            let mut rng = Rng::new(3, Stream::Measure, 0);
            let mut counts = [0u32; 64];
            const COUNT: u32 = 64_000;
            for _ in 0..COUNT {
                let (p, normal) = sample(rng.next_2d());
                assert!(chart.distance(p) < 1e-9 && chart.normal(p).dot(normal) > 0.999_999, "{chart:?}");
                let place = chart.locate(p);
                assert!(chart.point(place).distance(p) < 1e-9, "{chart:?}");
                assert!(place.cmpge(DVec2::ZERO).all() && place.cmple(DVec2::ONE).all());
                let element = (place * 8.0).as_uvec2().min(glam::UVec2::splat(7));
                counts[(element.y * 8 + element.x) as usize] += 1;
            }
            let expected = f64::from(COUNT) / 64.0;
            let chi: f64 = counts.iter().map(|&n| (f64::from(n) - expected).powi(2) / expected).sum();
            assert!(chi < 130.0, "{chart:?}: {chi}");
        }
    }

    trait MapPoint<'a> {
        fn map_point(self) -> Box<dyn Fn(Vec2) -> (DVec3, DVec3) + 'a>;
    }

    impl<'a, F: Fn(Vec2) -> crate::shapes::AreaSample + 'a> MapPoint<'a> for Box<F> {
        fn map_point(self) -> Box<dyn Fn(Vec2) -> (DVec3, DVec3) + 'a> {
            Box::new(move |u| {
                let sample = self(u);
                (sample.position, sample.normal)
            })
        }
    }
}
