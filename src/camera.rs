//! Cameras.

use crate::math::{Ray, unit_f64};
use crate::sampling::warp;
use glam::{DVec3, Vec2, Vec3};

/// A thin lens: a disc around the eye, and the plane that it makes sharp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Radius of the disc.
    pub radius: f64,
    /// Distance of the plane from the eye, along the view.
    pub focus: f64,
}

/// A camera in render space: a pinhole, or a thin lens.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    eye: Vec3,
    forward: DVec3,
    /// Half the picture plane at distance 1: to the right and up.
    right: DVec3,
    up: DVec3,
    lens: Option<Lens>,
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
            lens: None,
        })
    }

    /// The same camera with a lens; a pinhole still where its numbers are not above zero.
    #[must_use]
    pub fn with_lens(self, lens: Lens) -> Self {
        let is_one = lens.radius > 0.0 && lens.focus > 0.0 && (lens.radius + lens.focus).is_finite();
        Self { lens: is_one.then_some(lens), ..self }
    }

    /// The same camera with left and right of its picture exchanged.
    #[must_use]
    pub fn mirrored(self) -> Self {
        Self { right: -self.right, ..self }
    }

    /// The lens, if it is not a pinhole.
    pub fn lens(&self) -> Option<Lens> {
        self.lens
    }

    /// The ray of [`Self::ray`]'s position that leaves the lens at a point uniform over its disc: through the point of the
    /// sharp plane that the pinhole would see. Without a lens that ray itself.
    pub fn ray_through(&self, position: Vec2, u: Vec2) -> Ray {
        let Some(lens) = self.lens else { return self.ray(position) };
        let d = warp::square_to_disc(u).as_dvec2() * lens.radius;
        let across = |v: DVec3| v.normalize_or_zero();
        let start = across(self.right) * d.x + across(self.up) * d.y;
        let sharp = self.towards(position) * lens.focus;
        let direction = sharp - start;
        let origin = (self.eye.as_dvec3() + start).as_vec3();
        Ray::new(origin, (direction / direction.length()).as_vec3())
    }

    /// The ray through `position` on the picture, which runs over `[0, 1]^2` with row 0 on top. Unit direction.
    pub fn ray(&self, position: Vec2) -> Ray {
        let direction = self.towards(position);
        Ray::new(self.eye, (direction / direction.length()).as_vec3())
    }

    /// From the eye to a position on the picture plane at distance 1.
    fn towards(&self, position: Vec2) -> DVec3 {
        let x = f64::from(position.x) * 2.0 - 1.0;
        let y = 1.0 - f64::from(position.y) * 2.0;
        self.forward + self.right * x + self.up * y
    }

    /// The position on the picture that shows a unit `direction` of the pinhole, as [`Self::ray`]; `None` where it leads backwards.
    pub fn position_of(&self, direction: Vec3) -> Option<Vec2> {
        let direction = direction.as_dvec3();
        let along = direction.dot(self.forward);
        if !(along > 0.0) {
            return None;
        }
        let across = |half: DVec3| (direction.dot(half) / (along * half.length_squared())) as f32;
        let at = Vec2::new(across(self.right), -across(self.up));
        Some(at * 0.5 + Vec2::splat(0.5))
    }

    /// Heights of the picture by which its most distant point moves, at most, where a `direction` in view turns by an angle of this
    /// tangent: a bound on the longest axis of the image of a narrow cone over that tangent.
    pub fn stretch(&self, direction: Vec3) -> f32 {
        let cosine = direction.as_dvec3().dot(self.forward).max(1e-3);
        // A cone of up to 17 degrees reaches beyond its middle, where the picture is stretched more.
        (0.5 / self.up.length() * 1.5 / (cosine * cosine)) as f32
    }

    /// Position of the eye.
    pub fn eye(&self) -> Vec3 {
        self.eye
    }
}

/// A camera sample: its ray, and those beside it.
#[derive(Clone, Copy, Debug)]
pub struct CameraRay<'a> {
    /// Of unit direction.
    pub ray: Ray,
    camera: &'a Camera,
    place: FilmPlace,
    /// In [0, 1)^2, as [`Camera::ray_through`] takes it.
    lens: Vec2,
}

/// A place in a pixel.
#[derive(Clone, Copy, Debug)]
pub struct FilmPlace {
    /// Pixels of the picture.
    pub size: Vec2,
    /// Centre of the pixel, in pixels.
    pub center: Vec2,
    /// From there, pixels to the right and down.
    pub offset: Vec2,
}

impl<'a> CameraRay<'a> {
    /// The ray of `camera` through a place of the picture and the point `lens` of the lens, as [`Camera::ray_through`].
    pub fn new(camera: &'a Camera, place: FilmPlace, lens: Vec2) -> Self {
        let position = (place.center + place.offset) / place.size;
        Self { ray: camera.ray_through(position, lens), camera, place, lens }
    }

    /// Where in its pixel it is.
    pub fn place(&self) -> &FilmPlace {
        &self.place
    }

    /// The ray so many `pixels` to the right and down, through the same point of the lens.
    pub fn beside(&self, pixels: Vec2) -> Ray {
        let position = (self.place.center + self.place.offset + pixels) / self.place.size;
        self.camera.ray_through(position, self.lens)
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

    /// Rays of a lens through one position meet on the sharp plane, and elsewhere fill a disc whose radius is that of the
    /// lens times the distance from the plane over that of the plane.
    #[test]
    fn circle_of_confusion() {
        let lens = Lens { radius: 0.1, focus: 2.0 };
        let at = DVec3::new(1.0, 2.0, 3.0);
        let pinhole = Camera::look_at(at, DVec3::ZERO, DVec3::Y, 50.0, 1.5).unwrap();
        let camera = pinhole.with_lens(lens);
        let forward = -at.normalize();
        let position = Vec2::new(0.2, 0.7);
        let sharp = {
            let direction = pinhole.ray(position).direction.as_dvec3();
            at + direction * (lens.focus / direction.dot(forward))
        };
        for depth in [0.5, 1.0, 2.0, 5.0] {
            let center = at + (sharp - at) * (depth / lens.focus);
            let (mut most, mut squares, n) = (0f64, 0.0, 64);
            for i in 0..n * n {
                let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
                let ray = camera.ray_through(position, u);
                let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
                assert!((origin - at).dot(forward).abs() < 1e-6);
                let way = (depth - (origin - at).dot(forward)) / direction.dot(forward);
                let off = (origin + direction * way - center).length();
                most = most.max(off);
                squares += off * off / f64::from(n * n);
            }
            let radius = lens.radius * (depth - lens.focus).abs() / lens.focus;
            assert!(most <= radius + 2e-6 && most > 0.98 * radius, "{depth}: {most} {radius}");
            assert!((squares - 0.5 * radius * radius).abs() < 0.01 * radius * radius + 1e-10, "{depth}");
        }
        assert_eq!(
            pinhole.ray_through(position, Vec2::splat(0.9)).direction,
            pinhole.ray(position).direction
        );
        assert!(pinhole.with_lens(Lens { radius: 0.0, focus: 1.0 }).lens().is_none());
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
