//! Octahedral encoding of unit vectors.

use glam::{Vec3, Vec4, Vec4Swizzles};

/// Encodes a unit vector in `2 * bits` bits with the octahedral map. Each coordinate is rounded to the nearest of
/// `2^bits - 1` steps (Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors",
/// JCGT 3(2), 2014). `bits` is at most 16.
///
/// An odd number of levels puts the six axes exactly on the grid, so that the normal of an axis-aligned wall
/// survives unchanged.
pub fn octahedral_encode(v: Vec3, bits: u32) -> u32 {
    octahedral_encode_two([v, v], [bits, bits])[0]
}

/// [`octahedral_encode`] of two vectors at once, which fill the four lanes of a register.
#[inline]
pub fn octahedral_encode_two(v: [Vec3; 2], bits: [u32; 2]) -> [u32; 2] {
    let [a, b] = v;
    let steps = |bits: u32| ((1u32 << bits) - 2) as f32;
    let (steps_a, steps_b) = (steps(bits[0]), steps(bits[1]));
    let xy = Vec4::new(a.x, a.y, b.x, b.y);
    let z = Vec4::new(a.z, a.z, b.z, b.z);
    let upper = xy / (xy.abs() + xy.yxwz().abs() + z.abs());
    let lower = (Vec4::ONE - upper.yxwz().abs()) * Vec4::ONE.copysign(upper);
    let plane = Vec4::select(z.cmplt(Vec4::ZERO), lower, upper);
    let unit = (plane * 0.5 + 0.5).max(Vec4::ZERO).min(Vec4::ONE);
    // Adding 2^23 rounds to an integer in the low bits. This is faster than `round`, which is a function call where the processor has no
    // such instruction, and than a cast, which checks its range.
    let rounded = unit * Vec4::new(steps_a, steps_a, steps_b, steps_b) + 8_388_608.0;
    let [ax, ay, bx, by] = rounded.to_array();
    let whole = |c: f32| c.to_bits() & 0xffff;
    [whole(ax) << bits[0] | whole(ay), whole(bx) << bits[1] | whole(by)]
}

/// The unit vector of [`octahedral_encode`]. The error is largest in the middle of the octahedron's faces, where it
/// reaches `sqrt(18) / (2^bits - 2)` radians: 4 degrees for 6 bits, 1 degree for 8.
pub fn octahedral_decode(code: u32, bits: u32) -> Vec3 {
    let steps = ((1u32 << bits) - 2) as f32;
    let mask = (1u32 << bits) - 1;
    let expand = |c: u32| (c as f32).min(steps) / steps * 2.0 - 1.0;
    let (x, y) = (expand(code >> bits & mask), expand(code & mask));
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    let v = Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z);
    v / v.length()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip_error() {
        for bits in [6u32, 8, 12, 16] {
            let mut worst = 0f32;
            for i in 0..200_000 {
                let phi = i as f32 * 2.399_963;
                let z = 1.0 - 2.0 * (i as f32 + 0.5) / 200_000.0;
                let r = (1.0 - z * z).sqrt();
                let v = Vec3::new(r * phi.cos(), r * phi.sin(), z);
                worst = worst.max((octahedral_decode(octahedral_encode(v, bits), bits) - v).length());
            }
            // The documented bound is of first order; the margin allows for curvature.
            let bound = 18f32.sqrt() / ((1u32 << bits) - 2) as f32;
            assert!(worst < 1.02 * bound && worst > 0.5 * bound, "{bits} bits: {worst} against {bound}");
        }
    }

    #[test]
    fn axes_are_exact() {
        for v in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z] {
            for bits in [6, 8] {
                assert_eq!(octahedral_decode(octahedral_encode(v, bits), bits), v);
            }
        }
    }

    #[test]
    fn every_code_decodes_to_a_unit_vector() {
        for code in 0..1u32 << 12 {
            assert!((octahedral_decode(code, 6).length() - 1.0).abs() < 1e-6);
        }
    }
}
