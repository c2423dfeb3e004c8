//! Cameras.

use crate::math::{Ray, unit_f64};
use glam::{DVec3, Vec2, Vec3};

/// A pinhole camera in render space.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    eye: Vec3,
    forward: DVec3,
    /// Half the picture plane at distance 1: to the right and up.
    right: DVec3,
    up: DVec3,
}

impl Camera {
    /// A camera at `eye` that sees `at` in the middle of the picture; `vertical_fov` is the full angle in degrees
    /// and `aspect` is width over height. Positions in render space, `f64` so that the view direction of a distant
    /// camera keeps its precision.
    ///
    /// `None` where `eye` and `at` coincide, `up` is parallel to the view, or the angle is not in `(0, 180)`.
    pub fn look_at(eye: DVec3, at: DVec3, up: DVec3, vertical_fov: f64, aspect: f64) -> Option<Self> {
        if !(vertical_fov > 0.0 && vertical_fov < 180.0 && aspect > 0.0) {
            return None;
        }
        let forward = unit_f64(at - eye)?;
        let right = unit_f64(forward.cross(unit_f64(up)?)).filter(|_| {
            // Closer to parallel than this, the picture's roll would be rounding noise.
            forward.cross(up.normalize_or_zero()).length() > 1e-9
        })?;
        let half = (vertical_fov.to_radians() * 0.5).tan();
        Some(Self {
            eye: eye.as_vec3(),
            forward,
            right: right * (half * aspect),
            up: right.cross(forward) * half,
        })
    }

    /// The ray through `position` on the picture, which runs over `[0, 1]^2` with row 0 on top. Unit direction.
    pub fn ray(&self, position: Vec2) -> Ray {
        let x = f64::from(position.x) * 2.0 - 1.0;
        let y = 1.0 - f64::from(position.y) * 2.0;
        let direction = self.forward + self.right * x + self.up * y;
        Ray::new(self.eye, (direction / direction.length()).as_vec3())
    }

    /// Position of the eye.
    pub fn eye(&self) -> Vec3 {
        self.eye
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_of_the_picture() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 90.0, 2.0).unwrap();
        let corner = camera.ray(Vec2::ZERO).direction;
        let want = Vec3::new(-2.0, 1.0, -1.0) / 6f32.sqrt();
        assert!((corner - want).length() < 1e-6, "{corner}");
        assert!((camera.ray(Vec2::splat(0.5)).direction - Vec3::NEG_Z).length() < 1e-6);
    }

    #[test]
    fn impossible_cameras() {
        let camera = |at, up, fov| Camera::look_at(DVec3::ZERO, at, up, fov, 1.0);
        assert!(camera(DVec3::ZERO, DVec3::Y, 40.0).is_none());
        assert!(camera(DVec3::Y, DVec3::Y, 40.0).is_none());
        assert!(camera(DVec3::Z, DVec3::ZERO, 40.0).is_none());
        assert!(camera(DVec3::Z, DVec3::Y, 180.0).is_none());
        assert!(camera(DVec3::Z, DVec3::Y, f64::NAN).is_none());
    }
}
