//! Spheres, cylinders and discs, whole or in part.

use super::error::{Fault, fail};
use super::import::tessellate::grid;
use super::object::Object;
use crate::scene_file::description::GeometryDescription;
use crate::scene_file::mesh::TriangleMesh;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Segments around and along a whole shape.
const AROUND: f64 = 256.0;
const ALONG: f64 = 128.0;

/// A surface of revolution around z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Quadric {
    /// Between two polar angles, which count from -z.
    Sphere {
        radius: f64,
        from: f64,
        to: f64,
        around: f64,
    },
    Cylinder {
        radius: f64,
        low: f64,
        high: f64,
        around: f64,
    },
    Disc {
        radius: f64,
        inner: f64,
        height: f64,
        around: f64,
    },
}

impl Quadric {
    /// The shape that a directive describes.
    pub(super) fn read(object: &Object) -> Result<Self, Fault> {
        let positive = |name: &str, usual: f64| object.within(name, usual, 1e-30..=1e30);
        let radius = positive("radius", 1.0)?;
        let around = object.within("phimax", 360.0, 0.0..=360.0)?.to_radians();
        if around == 0.0 {
            return fail(
                object.place_of("phimax"),
                "`phimax` is 0: nothing is left of the shape",
                "write up to 360",
            );
        }
        let range = -1e30..=1e30;
        Ok(match object.kind.as_str() {
            "sphere" => {
                let ends =
                    [object.within("zmin", -radius, range.clone())?, object.within("zmax", radius, range)?];
                let [low, high] = ends.map(|z| (z / radius).clamp(-1.0, 1.0));
                let [from, to] = [(-low.min(high)).acos(), (-low.max(high)).acos()];
                if from >= to {
                    let message = "`zmin` and `zmax` leave nothing of the sphere";
                    return fail(
                        object.place_of("zmin"),
                        message,
                        "write two different heights within its radius",
                    );
                }
                Self::Sphere { radius, from, to, around }
            }
            "cylinder" => {
                let ends = [object.within("zmin", -1.0, range.clone())?, object.within("zmax", 1.0, range)?];
                if ends[0] == ends[1] {
                    let message = "`zmin` and `zmax` of the cylinder are the same";
                    return fail(object.place_of("zmin"), message, "write two different heights");
                }
                Self::Cylinder { radius, low: ends[0].min(ends[1]), high: ends[0].max(ends[1]), around }
            }
            _ => {
                let inner = object.within("innerradius", 0.0, 0.0..=1e30)?;
                if inner >= radius {
                    let message = "`innerradius` is not below the radius of the disc";
                    return fail(object.place_of("innerradius"), message, "write a smaller number");
                }
                Self::Disc { radius, inner, height: object.within("height", 0.0, range)?, around }
            }
        })
    }

    /// A whole sphere.
    pub(super) fn ball(radius: f64) -> Self {
        Self::Sphere { radius, from: 0.0, to: PI, around: TAU }
    }

    /// The exact shape, for a whole one.
    pub(super) fn exact(&self) -> Option<GeometryDescription> {
        match *self {
            Self::Sphere { radius, from, to, around } if from == 0.0 && to == PI && around == TAU => {
                Some(GeometryDescription::Sphere { center: DVec3::ZERO, radius })
            }
            Self::Cylinder { radius, low, high, around } if around == TAU => {
                Some(GeometryDescription::Cylinder {
                    base: DVec3::new(0.0, 0.0, low),
                    top: DVec3::new(0.0, 0.0, high),
                    radius,
                })
            }
            Self::Disc { radius, inner, height, around } if inner == 0.0 && around == TAU => {
                Some(GeometryDescription::Disc {
                    center: DVec3::new(0.0, 0.0, height),
                    normal: DVec3::Z,
                    radius,
                })
            }
            _ => None,
        }
    }

    /// A bound on the number of its vertices as triangles.
    pub(super) fn vertices(&self) -> u64 {
        let rows = if matches!(self, Self::Sphere { .. }) { ALONG + 1.0 } else { 2.0 };
        ((AROUND + 1.0) * rows) as u64
    }

    /// The shape as triangles, with the coordinates that pbrt gives it.
    pub(super) fn tessellated(&self) -> TriangleMesh {
        let steps = |share: f64, whole: f64| ((share * whole).ceil() as u32).max(4);
        match *self {
            Self::Sphere { radius, from, to, around } => {
                grid(steps(around / TAU, AROUND), steps((to - from) / PI, ALONG), |u, v| {
                    let ((sin, cos), (sin_v, cos_v)) =
                        ((around * u).sin_cos(), (from + (to - from) * v).sin_cos());
                    let normal = DVec3::new(sin_v * cos, sin_v * sin, -cos_v);
                    (normal * radius, normal)
                })
            }
            Self::Cylinder { radius, low, high, around } => grid(steps(around / TAU, AROUND), 1, |u, v| {
                let (sin, cos) = (around * u).sin_cos();
                (DVec3::new(radius * cos, radius * sin, low + (high - low) * v), DVec3::new(cos, sin, 0.0))
            }),
            Self::Disc { radius, inner, height, around } => {
                grid(steps(around / TAU, AROUND), 1, |u, v| {
                    let (sin, cos) = (around * u).sin_cos();
                    // The second coordinate runs inwards.
                    let r = radius + (inner - radius) * v;
                    (DVec3::new(r * cos, r * sin, height), DVec3::Z)
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(mesh: &TriangleMesh) -> f64 {
        super::super::mesh::areas(mesh, &glam::DAffine3::IDENTITY).iter().sum()
    }

    /// Parts have the areas of their closed forms, and triangles face the way of their normals.
    #[test]
    fn parts_have_their_areas() {
        let half = Quadric::Sphere { radius: 2.0, from: 0.0, to: PI / 2.0, around: PI };
        let tube = Quadric::Cylinder { radius: 0.5, low: -1.0, high: 3.0, around: PI / 2.0 };
        let ring = Quadric::Disc { radius: 3.0, inner: 1.0, height: 5.0, around: TAU };
        for (shape, wanted) in [(half, 4.0 * PI), (tube, PI), (ring, 8.0 * PI)] {
            let mesh = shape.tessellated();
            assert!((area(&mesh) / wanted - 1.0).abs() < 2e-3, "{shape:?}: {}", area(&mesh));
            let normals = mesh.normals.as_ref().unwrap();
            for triangle in &mesh.triangles {
                let [a, b, c] = mesh.positions.corners(*triangle);
                assert!((b - a).cross(c - a).dot(normals[triangle[0] as usize].as_dvec3()) > 0.0);
            }
            assert!(shape.exact().is_none());
        }
        // The lower half of a sphere is below its middle.
        let lowest = half.tessellated().bounds();
        assert!((lowest.min.z + 2.0).abs() < 1e-9 && lowest.max.z < 1e-9, "{lowest:?}");
    }
}
