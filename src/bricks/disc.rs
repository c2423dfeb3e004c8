//! Oriented discs: what a brick map is built from.

use crate::math::Rgb;
use glam::Vec3;
use std::io::{self, Write};

/// A piece of a surface with its irradiance, made from the photons near one photon (Christensen & Batali 2004, section 4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// Centre, render space.
    pub position: Vec3,
    /// Unit normal on the side that is lit.
    pub normal: Vec3,
    /// Radius of the disc, render space: how far its irradiance is spread over voxels.
    pub radius: f32,
    /// Detail that the irradiance resolves, render space: the radius within which its photons lie. Voxels become no smaller than this asks
    /// for. It is at least [`Self::radius`], which is smaller where an obstacle is near.
    pub detail: f32,
    /// Irradiance in W m^-2, cosine included, times the power factor of render space.
    pub irradiance: Rgb,
}

impl Disc {
    /// Whether all numbers are finite, radii are positive, and the irradiance is not negative.
    pub fn is_sound(&self) -> bool {
        self.position.is_finite()
            && (self.normal.length_squared() - 1.0).abs() < 1e-3
            && self.radius > 0.0
            && self.radius.is_finite()
            && self.detail > 0.0
            && self.detail.is_finite()
            && self.irradiance.is_finite()
            && self.irradiance.min_element() >= 0.0
    }

    /// Half the sides of the box around the disc: a circle of radius r reaches `r sqrt(1 - n_i^2)` along axis i.
    pub(super) fn half_sides(&self) -> Vec3 {
        self.radius * (Vec3::ONE - self.normal * self.normal).max(Vec3::ZERO).map(f32::sqrt)
    }
}

/// Writes discs as PLY (binary, little-endian) for other tools: position in metres, normal, radius in metres, irradiance in W m^-2 as `red`,
/// `green` and `blue`, single precision. `to_metres` maps a position of render space, `metres` is a length of one in metres, and `per_power`
/// the factor from irradiance in render space to W m^-2.
///
/// # Errors
/// If writing to `out` fails.
pub fn write_discs_as_ply(
    out: &mut impl Write,
    discs: &[Disc],
    to_metres: impl Fn(Vec3) -> glam::DVec3,
    (metres, per_power): (f64, f64),
) -> io::Result<()> {
    write!(out, "ply\nformat binary_little_endian 1.0\ncomment irradiance on oriented discs, by cardioid\n")?;
    writeln!(out, "element vertex {}", discs.len())?;
    for name in ["x", "y", "z", "nx", "ny", "nz", "radius", "red", "green", "blue"] {
        writeln!(out, "property float {name}")?;
    }
    writeln!(out, "end_header")?;
    for disc in discs {
        let position = to_metres(disc.position).as_vec3();
        let irradiance = (disc.irradiance.as_dvec3() * per_power).as_vec3();
        let radius = (f64::from(disc.radius) * metres) as f32;
        let normal = disc.normal;
        let numbers = position.to_array().into_iter().chain(normal.to_array());
        for number in numbers.chain([radius]).chain(irradiance.to_array()) {
            out.write_all(&number.to_le_bytes())?;
        }
    }
    Ok(())
}
