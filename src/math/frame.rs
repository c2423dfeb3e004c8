//! Orthonormal frames.

use glam::Vec3;

/// A right-handed orthonormal frame; `z` is the normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// First tangent.
    pub x: Vec3,
    /// Second tangent.
    pub y: Vec3,
    /// Normal.
    pub z: Vec3,
}

impl Frame {
    /// A frame around the unit vector `z`, without branches or square roots
    /// (Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017).
    #[inline]
    pub fn from_z(z: Vec3) -> Self {
        let sign = 1f32.copysign(z.z);
        let a = -1.0 / (sign + z.z);
        let b = z.x * z.y * a;
        Self {
            x: Vec3::new(1.0 + sign * z.x * z.x * a, sign * b, -sign * z.x),
            y: Vec3::new(b, sign + z.y * z.y * a, -z.y),
            z,
        }
    }

    /// A frame around the unit vector `z` whose `x` is the normalized projection of `tangent` onto the surface. Where the projection
    /// vanishes, the frame is that of [`Self::from_z`].
    #[inline]
    pub fn with_tangent(z: Vec3, tangent: Vec3) -> Self {
        // The projection is done twice: for a tangent nearly parallel to the normal, rounding leaves a normal component after the first.
        let within = |v: Vec3| super::unit(v - z * z.dot(v));
        match super::unit(tangent).and_then(within).and_then(within) {
            Some(x) => Self { x, y: z.cross(x), z },
            None => Self::from_z(z),
        }
    }

    /// Coordinates of the world vector `v` in this frame.
    #[inline]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.x.dot(v), self.y.dot(v), self.z.dot(v))
    }

    /// The world vector with local coordinates `v`.
    #[inline]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orthonormal_everywhere() {
        for i in 0..1000 {
            let phi = i as f32 * 2.399_963;
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / 1000.0;
            let r = (1.0 - z * z).sqrt();
            for n in [Vec3::new(r * phi.cos(), r * phi.sin(), z), Vec3::Z, Vec3::NEG_Z] {
                let f = Frame::from_z(n);
                assert!(f.x.dot(f.y).abs() < 1e-6 && f.x.dot(n).abs() < 1e-6 && f.y.dot(n).abs() < 1e-6);
                assert!((f.x.cross(f.y) - n).length() < 1e-5);
                assert!((f.to_world(f.to_local(Vec3::ONE)) - Vec3::ONE).length() < 1e-5);
            }
        }
    }
}
