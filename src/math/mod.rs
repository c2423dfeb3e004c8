//! Basic geometry: rays, bounds, frames, compact encodings and rounding bounds.
//!
//! Positions and directions inside the renderer are `f32` in *render space* (see `docs/conventions.md`): the
//! scene recentred and scaled by a power of two so that it fits the unit sphere. Computations before that step, or
//! with higher demands on precision, use `f64`.

mod bounds;
mod equal_area;
mod frame;
mod octahedral;
mod ray;
mod rgbe;
pub mod rounding;

pub use bounds::Bounds3;
pub use equal_area::{equal_area_direction, equal_area_square};
pub use frame::Frame;
pub use octahedral::{octahedral_decode, octahedral_encode, octahedral_encode_two};
pub use ray::Ray;
pub use rgbe::Rgbe;

/// A linear Rec. 709 colour: radiance, flux, reflectance or throughput, one `f32` per channel.
pub type Rgb = glam::Vec3;

/// Relative luminance of a linear Rec. 709 colour.
pub fn luminance(colour: Rgb) -> f32 {
    colour.dot(Rgb::new(0.2126, 0.7152, 0.0722))
}

/// `v / |v|`, or `None` where the length is zero or not finite.
///
/// All code in this crate that normalizes a possibly degenerate vector uses this function.
pub fn unit(v: glam::Vec3) -> Option<glam::Vec3> {
    let scale = v.abs().max_element();
    // `max_element` may skip NaN.
    if !(v.is_finite() && scale > 0.0) {
        return None;
    }
    // The vector is scaled first, so that the squared length of neither 1e-30 nor 1e30 leaves the range of `f32`.
    let scaled = v / scale;
    Some(scaled / scaled.length())
}

/// `v / |v|` in `f64`, or `None` where the length is zero or not finite.
pub fn unit_f64(v: glam::DVec3) -> Option<glam::DVec3> {
    let scale = v.abs().max_element();
    if !(v.is_finite() && scale > 0.0) {
        return None;
    }
    let scaled = v / scale;
    Some(scaled / scaled.length())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn unit_survives_the_range_of_f32() {
        for scale in [1e-38f32, 1e-30, 1e-10, 1.0, 1e10, 1e30, 3e37] {
            let u = unit(Vec3::new(1.0, 2.0, -2.0) * scale).unwrap();
            assert!((u - Vec3::new(1.0, 2.0, -2.0) / 3.0).length() < 1e-6, "{scale}: {u}");
        }
        assert!(unit(Vec3::ZERO).is_none());
        for nan in
            [Vec3::new(f32::NAN, 1.0, 0.0), Vec3::new(0.0, f32::NAN, 1.0), Vec3::new(1.0, 0.0, f32::NAN)]
        {
            assert!(unit(nan).is_none() && unit_f64(nan.as_dvec3()).is_none());
        }
        assert!(unit(Vec3::new(f32::INFINITY, 1.0, 0.0)).is_none());
    }
}
