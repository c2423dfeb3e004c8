//! Cameras.

use crate::math::{Ray, unit_f64};
use crate::sampling::warp;
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// A thin lens: a disc around the eye, and the plane that it makes sharp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Radius of the disc.
    pub radius: f64,
    /// Distance of the plane from the eye, along the view.
    pub focus: f64,
}

/// How directions or points become places on the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Projection {
    /// Rays through one point.
    Perspective,
    /// Parallel rays, from the plane through the eye across the view.
    Orthographic,
    /// All directions: the angle around `up` across the picture, the angle above the horizon down it.
    Equirectangular,
    /// The angle from the view in proportion to the distance from the middle of the picture; `half` at the rim, radians.
    Fisheye { half: f64 },
}

/// Width of a pixel by the distance along its ray. Rays of a pinhole spread by an angle; parallel ones do not spread.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelSpread {
    /// Width of a pixel where its rays start, render space.
    pub width: f32,
    /// By how much its width grows with each unit of distance.
    pub angle: f32,
}

impl PixelSpread {
    /// Width of a pixel at a distance along its ray.
    #[inline]
    pub fn at(&self, distance: f32) -> f32 {
        self.width + self.angle * distance
    }

    /// Between a ray and that of the next pixel.
    pub fn between(ray: &Ray, beside: &Ray) -> Self {
        Self {
            width: (beside.origin - ray.origin).length(),
            angle: (beside.direction - ray.direction).length(),
        }
    }
}

/// A disc on the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureDisc {
    /// Its centre, over `[0, 1]^2` with row 0 on top.
    pub center: Vec2,
    /// Its radius, heights of the picture.
    pub radius: f32,
}

/// A camera in render space: perspective or orthographic, each with or without a thin lens, a panorama or a fisheye.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    eye: Vec3,
    forward: DVec3,
    /// Half the picture plane, to the right and up: at distance 1 of a pinhole, and of parallel rays as it is. Panorama and fisheye:
    /// unit vectors.
    right: DVec3,
    up: DVec3,
    /// Half the height of the picture plane.
    half: f64,
    /// Width over height of the picture.
    aspect: f64,
    projection: Projection,
    lens: Option<Lens>,
}

impl Camera {
    /// A perspective camera at `eye` that sees `at` in the middle of the picture; `vertical_fov` is the full angle in degrees
    /// and `aspect` is width over height. Positions in render space, `f64` so that the view direction of a distant
    /// camera keeps its precision.
    ///
    /// `None` where `eye` and `at` coincide, `up` is parallel to the view, or the angle is not in `(0, 180)`.
    pub fn look_at(eye: DVec3, at: DVec3, up: DVec3, vertical_fov: f64, aspect: f64) -> Option<Self> {
        if !(vertical_fov > 0.0 && vertical_fov < 180.0) {
            return None;
        }
        let half = (vertical_fov.to_radians() * 0.5).tan();
        Self::placed(eye, at, up, aspect, (half, Projection::Perspective))
    }

    /// A camera of parallel rays that start on the plane through `eye` across the view, over a rectangle of this `height` (render
    /// space) around `eye`; `None` as for [`Self::look_at`].
    pub fn orthographic(eye: DVec3, at: DVec3, up: DVec3, height: f64, aspect: f64) -> Option<Self> {
        if !(height > 0.0 && height.is_finite()) {
            return None;
        }
        Self::placed(eye, at, up, aspect, (0.5 * height, Projection::Orthographic))
    }

    /// A camera that sees all directions from `eye`, with `at` in the middle of the picture as far as the horizon goes: rows of the
    /// picture are lines of equal angle above the plane across `up`, from +90 degrees on top to -90, and columns of equal angle around
    /// `up`. `None` as for [`Self::look_at`].
    pub fn equirectangular(eye: DVec3, at: DVec3, up: DVec3, aspect: f64) -> Option<Self> {
        let level = Self::placed(eye, at, up, aspect, (1.0, Projection::Equirectangular))?;
        let (right, up) = (unit_f64(level.right)?, unit_f64(up)?);
        Some(Self { forward: unit_f64(up.cross(right))?, right, up, ..level })
    }

    /// An equidistant fisheye: directions up to half of `angle` (degrees, above 0, at most 360) from the view fill the largest disc on
    /// the picture, each at a distance from its middle in proportion to the angle. `None` as for [`Self::look_at`].
    pub fn fisheye(eye: DVec3, at: DVec3, up: DVec3, angle: f64, aspect: f64) -> Option<Self> {
        if !(angle > 0.0 && angle <= 360.0) {
            return None;
        }
        let half = 0.5 * angle.to_radians();
        let camera = Self::placed(eye, at, up, aspect, (1.0, Projection::Fisheye { half }))?;
        Some(Self { right: unit_f64(camera.right)?, up: unit_f64(camera.up)?, ..camera })
    }

    fn placed(
        eye: DVec3,
        at: DVec3,
        up: DVec3,
        aspect: f64,
        (half, projection): (f64, Projection),
    ) -> Option<Self> {
        if !(aspect > 0.0 && aspect.is_finite()) {
            return None;
        }
        let forward = unit_f64(at - eye)?;
        let right = unit_f64(forward.cross(unit_f64(up)?)).filter(|_| {
            // Closer to parallel than this, the picture's roll would be rounding noise.
            forward.cross(up.normalize_or_zero()).length() > 1e-9
        })?;
        Some(Self {
            eye: eye.as_vec3(),
            forward,
            right: right * (half * aspect),
            up: right.cross(forward) * half,
            half,
            aspect,
            projection,
            lens: None,
        })
    }

    /// The same camera with a lens; as it was where the numbers of the lens are not above zero, and for panorama and fisheye.
    #[must_use]
    pub fn with_lens(self, lens: Lens) -> Self {
        let is_one = lens.radius > 0.0 && lens.focus > 0.0 && (lens.radius + lens.focus).is_finite();
        let has_plane = matches!(self.projection, Projection::Perspective | Projection::Orthographic);
        Self { lens: (is_one && has_plane).then_some(lens), ..self }
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

    /// Whether its rays start at different points that may be far from one another: those of a lens are taken for one.
    pub fn has_parallel_rays(&self) -> bool {
        self.projection == Projection::Orthographic
    }

    /// Whether the left edge of its picture continues the right one.
    pub fn wraps_around(&self) -> bool {
        self.projection == Projection::Equirectangular
    }

    /// Whether a position of the picture shows anything: the corners outside the disc of a fisheye are black.
    pub fn shows(&self, position: Vec2) -> bool {
        match self.projection {
            Projection::Fisheye { .. } => self.disc_offset(position).length_squared() <= 1.0,
            Projection::Perspective | Projection::Orthographic | Projection::Equirectangular => true,
        }
    }

    /// The ray of [`Self::ray`]'s position that leaves the lens at a point uniform over its disc: through the point of the
    /// sharp plane that the pinhole would see. Without a lens that ray itself.
    pub fn ray_through(&self, position: Vec2, u: Vec2) -> Ray {
        let Some(lens) = self.lens else { return self.ray(position) };
        let d = warp::square_to_disc(u).as_dvec2() * lens.radius;
        let across = |v: DVec3| v.normalize_or_zero();
        let start = across(self.right) * d.x + across(self.up) * d.y;
        let (origin, view) = match self.projection {
            Projection::Orthographic => (self.on_plane(position), self.forward),
            _ => (self.eye.as_dvec3(), self.towards(position)),
        };
        let direction = view * lens.focus - start;
        Ray::new((origin + start).as_vec3(), (direction / direction.length()).as_vec3())
    }

    /// The ray through `position` on the picture, which runs over `[0, 1]^2` with row 0 on top. Unit direction.
    pub fn ray(&self, position: Vec2) -> Ray {
        match self.projection {
            Projection::Orthographic => Ray::new(self.on_plane(position).as_vec3(), self.forward.as_vec3()),
            _ => {
                let direction = self.towards(position);
                Ray::new(self.eye, (direction / direction.length()).as_vec3())
            }
        }
    }

    /// A position of the picture from -1 to 1, to the right and up.
    fn centred(position: Vec2) -> (f64, f64) {
        (f64::from(position.x) * 2.0 - 1.0, 1.0 - f64::from(position.y) * 2.0)
    }

    /// Where parallel rays start.
    fn on_plane(&self, position: Vec2) -> DVec3 {
        let (x, y) = Self::centred(position);
        self.eye.as_dvec3() + self.right * x + self.up * y
    }

    /// From the middle of the disc of a fisheye to a position, to the right and up, over its radius.
    fn disc_offset(&self, position: Vec2) -> DVec2 {
        let (x, y) = Self::centred(position);
        DVec2::new(x * self.aspect.max(1.0), y / self.aspect.min(1.0))
    }

    /// From the eye to a position on the picture: on the plane at distance 1 of a pinhole, else a unit vector.
    fn towards(&self, position: Vec2) -> DVec3 {
        let (x, y) = Self::centred(position);
        match self.projection {
            Projection::Perspective => self.forward + self.right * x + self.up * y,
            Projection::Orthographic => self.forward,
            Projection::Equirectangular => {
                let ((sin, cos), (height, level)) = ((PI * x).sin_cos(), (FRAC_PI_2 * y).sin_cos());
                (self.forward * cos + self.right * sin) * level + self.up * height
            }
            Projection::Fisheye { half } => {
                let from_middle = self.disc_offset(position);
                let radius = from_middle.length();
                if radius == 0.0 {
                    return self.forward;
                }
                // Beyond the rim there is nothing to see; searches that look there all the same get the direction opposite the view.
                let (sin, cos) = (radius * half).min(PI).sin_cos();
                let across = (self.right * from_middle.x + self.up * from_middle.y) / radius;
                self.forward * cos + across * sin
            }
        }
    }

    /// The position on the picture that shows a unit `direction` of a camera whose rays start at one point, as [`Self::ray`]; `None` where
    /// the picture does not extend so far back, and for parallel rays.
    pub fn position_of(&self, direction: Vec3) -> Option<Vec2> {
        let direction = direction.as_dvec3();
        let along = direction.dot(self.forward);
        match self.projection {
            Projection::Perspective => {
                if !(along > 0.0) {
                    return None;
                }
                let across = |half: DVec3| (direction.dot(half) / (along * half.length_squared())) as f32;
                let at = Vec2::new(across(self.right), -across(self.up));
                Some(at * 0.5 + Vec2::splat(0.5))
            }
            Projection::Orthographic => None,
            Projection::Equirectangular => {
                let x = direction.dot(self.right).atan2(along) / PI;
                let y = direction.dot(self.up).clamp(-1.0, 1.0).asin() / FRAC_PI_2;
                Some(Vec2::new((0.5 + 0.5 * x) as f32, (0.5 - 0.5 * y) as f32))
            }
            Projection::Fisheye { half } => {
                let across = DVec2::new(direction.dot(self.right), direction.dot(self.up));
                let angle = across.length().atan2(along);
                if angle > half {
                    return None;
                }
                let at = across.normalize_or_zero() * (angle / half);
                let (x, y) = (at.x / self.aspect.max(1.0), at.y * self.aspect.min(1.0));
                Some(Vec2::new((0.5 + 0.5 * x) as f32, (0.5 - 0.5 * y) as f32))
            }
        }
    }

    /// A disc that contains what the picture shows of all directions up to an angle of the tangent `tangent` from a unit `direction`:
    /// the image of a narrow cone. `None` where it is not in view, or has no image that is narrow.
    pub fn image_of_cone(&self, direction: Vec3, tangent: f32) -> Option<PictureDisc> {
        let center = self.position_of(direction)?;
        let height = match self.projection {
            Projection::Perspective => {
                let cosine = direction.as_dvec3().dot(self.forward).max(1e-3);
                // A cone of up to 17 degrees reaches beyond its middle, where the picture is stretched more. The image of a cone is
                // longest towards the corners.
                return Some(PictureDisc {
                    center,
                    radius: (0.5 / self.up.length() * 1.5 / (cosine * cosine)) as f32 * tangent,
                });
            }
            Projection::Orthographic => return None,
            Projection::Equirectangular => {
                let angle = f64::from(tangent).atan();
                let level = direction.as_dvec3().dot(self.up).clamp(-1.0, 1.0).asin().abs() + angle;
                // A cone around a pole fills rows.
                if level >= FRAC_PI_2 {
                    return None;
                }
                let across = (angle.sin() / (level - angle).cos()).asin() / (2.0 * PI) * self.aspect;
                // What is widest lies nearer to the pole.
                (angle / PI).hypot(across)
            }
            Projection::Fisheye { half } => {
                let from_view = f64::from(direction.dot(self.forward.as_vec3())).clamp(-1.0, 1.0).acos();
                let angle = f64::from(tangent).atan();
                // Circles around the view are stretched by their angle over its sine.
                if from_view + angle > 0.75 * PI {
                    return None;
                }
                let stretch = (from_view + angle) / (from_view + angle).sin();
                angle * stretch / half * 0.5 * self.aspect.min(1.0)
            }
        };
        Some(PictureDisc { center, radius: height as f32 })
    }

    /// A disc that contains what a picture of parallel rays shows of a sphere; `None` for other cameras, and behind the plane where rays
    /// start.
    pub fn image_of_sphere(&self, center: DVec3, radius: f64) -> Option<PictureDisc> {
        if self.projection != Projection::Orthographic {
            return None;
        }
        let from_eye = center - self.eye.as_dvec3();
        let along = from_eye.dot(self.forward);
        if !(along > -radius) {
            return None;
        }
        // What is out of focus is wider.
        let blur = self.lens.map_or(0.0, |lens| lens.radius * (1.0 + (along + radius) / lens.focus));
        let across = |half: DVec3| (from_eye.dot(half) / half.length_squared()) as f32;
        let at = Vec2::new(across(self.right), -across(self.up));
        let radius = ((radius + blur) * 0.5 / self.up.length()) as f32;
        Some(PictureDisc { center: at * 0.5 + Vec2::splat(0.5), radius })
    }

    /// How far a pixel reaches in the middle of a picture of `height` pixels, from one ray to the next one below.
    pub fn spread(&self, height: u32) -> PixelSpread {
        let rows = f64::from(height);
        let (width, angle) = match self.projection {
            Projection::Perspective => (0.0, 2.0 * self.half / rows),
            Projection::Orthographic => (2.0 * self.half / rows, 0.0),
            Projection::Equirectangular => (0.0, PI / rows),
            Projection::Fisheye { half } => (0.0, 2.0 * half / (rows * self.aspect.min(1.0))),
        };
        PixelSpread { width: width as f32, angle: angle as f32 }
    }

    /// Position of the eye; of parallel rays, the middle of the plane on which they start.
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

    /// A view to -z with right +x and up +y.
    fn front(make: impl Fn(DVec3, DVec3, DVec3) -> Option<Camera>) -> Camera {
        make(DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 2.0, 0.0), DVec3::Y).unwrap()
    }

    #[test]
    fn parallel_rays_start_on_the_plane() {
        let camera = front(|eye, at, up| Camera::orthographic(eye, at, up, 4.0, 2.0));
        for (position, start) in [
            (Vec2::new(0.5, 0.5), Vec3::new(1.0, 2.0, 3.0)),
            (Vec2::new(0.0, 0.0), Vec3::new(-3.0, 4.0, 3.0)),
            (Vec2::new(1.0, 0.75), Vec3::new(5.0, 1.0, 3.0)),
        ] {
            let ray = camera.ray(position);
            assert!((ray.origin - start).length() < 1e-5 && ray.direction == Vec3::NEG_Z, "{position}");
        }
        let spread = camera.spread(100);
        assert!((spread.at(7.0) - 0.04).abs() < 1e-7);
        let beside = PixelSpread::between(&camera.ray(Vec2::splat(0.5)), &camera.ray(Vec2::new(0.5, 0.51)));
        assert!((beside.at(7.0) - 0.04).abs() < 1e-5, "{beside:?}");
        // A sphere of radius 0.5 is a disc of a quarter of half the height; behind the plane it is not in view.
        let disc = camera.image_of_sphere(DVec3::new(3.0, 3.0, -9.0), 0.5).unwrap();
        assert!((disc.center - Vec2::new(0.75, 0.25)).length() < 1e-6 && (disc.radius - 0.125).abs() < 1e-6);
        assert!(camera.image_of_sphere(DVec3::new(3.0, 3.0, 9.0), 0.5).is_none());
    }

    /// Parallel rays through a lens meet on the sharp plane where the ray of the pinhole does.
    #[test]
    fn a_lens_of_parallel_rays() {
        let pinhole = front(|eye, at, up| Camera::orthographic(eye, at, up, 4.0, 2.0));
        let camera = pinhole.with_lens(Lens { radius: 0.2, focus: 2.0 });
        let at = Vec2::new(0.1, 0.3);
        let sharp = pinhole.ray(at).origin + Vec3::NEG_Z * 2.0;
        for u in [Vec2::new(0.1, 0.2), Vec2::new(0.9, 0.6), Vec2::splat(0.5)] {
            let ray = camera.ray_through(at, u);
            let reached = ray.origin + ray.direction * (2.0 / -ray.direction.z);
            assert!(
                (reached - sharp).length() < 1e-5 && (ray.origin - pinhole.ray(at).origin).length() <= 0.2001
            );
        }
    }

    #[test]
    fn a_panorama_shows_all_around() {
        let camera = front(|eye, at, up| Camera::equirectangular(eye, at, up, 2.0));
        let level = |x: f32| camera.ray(Vec2::new(x, 0.5)).direction;
        for (x, want) in
            [(0.5, Vec3::NEG_Z), (0.75, Vec3::X), (0.25, Vec3::NEG_X), (0.0, Vec3::Z), (1.0, Vec3::Z)]
        {
            assert!((level(x) - want).length() < 1e-6, "{x}: {}", level(x));
        }
        let raised = camera.ray(Vec2::new(0.75, 1.0 / 3.0)).direction;
        assert!((raised - Vec3::new(0.75f32.sqrt(), 0.5, 0.0)).length() < 1e-6, "{raised}");
        assert!((camera.ray(Vec2::new(0.3, 0.0)).direction - Vec3::Y).length() < 1e-6);
        // The horizon stays level where the view is not.
        let tilted = Camera::equirectangular(DVec3::ZERO, DVec3::new(0.0, 3.0, -4.0), DVec3::Y, 2.0).unwrap();
        assert!((tilted.ray(Vec2::splat(0.5)).direction - Vec3::NEG_Z).length() < 1e-6);
        assert!((level(0.75) + camera.mirrored().ray(Vec2::new(0.75, 0.5)).direction).length() < 1e-6);
    }

    #[test]
    fn a_fisheye_has_angles_for_distances() {
        for (angle, aspect) in [(180.0, 1.0), (360.0, 2.0), (90.0, 0.5)] {
            let camera = front(|eye, at, up| Camera::fisheye(eye, at, up, angle, aspect));
            for share in [0.0, 0.25, 0.5, 0.99] {
                let r = 0.5 * share * if aspect < 1.0 { 1.0 } else { 1.0 / aspect };
                let ray = camera.ray(Vec2::new(0.5 + r as f32, 0.5));
                let turn = (0.5f64 * angle * share).to_radians();
                let want = DVec3::new(turn.sin(), 0.0, -turn.cos()).as_vec3();
                assert!((ray.direction - want).length() < 1e-5, "{angle} {share}: {}", ray.direction);
            }
            assert!(camera.shows(Vec2::splat(0.5)) && !camera.shows(Vec2::ZERO));
        }
    }

    /// What a position shows is shown at that position; and all of a narrow cone around it lies in the disc of the cone.
    #[test]
    fn positions_of_what_they_show() {
        let cameras = [
            front(|eye, at, up| Camera::look_at(eye, at, up, 50.0, 1.5)),
            front(|eye, at, up| Camera::equirectangular(eye, at, up, 2.0)),
            front(|eye, at, up| Camera::equirectangular(eye, at, up, 1.3)),
            front(|eye, at, up| Camera::fisheye(eye, at, up, 180.0, 1.0)),
            front(|eye, at, up| Camera::fisheye(eye, at, up, 200.0, 1.5)),
        ];
        let (tangent, mut discs) = (0.1f32, 0);
        for camera in cameras {
            for i in 0..400 {
                let at = Vec2::new((i % 20) as f32 + 0.5, (i / 20) as f32 + 0.5) / 20.0;
                if !camera.shows(at) {
                    continue;
                }
                let direction = camera.ray(at).direction;
                let found = camera.position_of(direction).unwrap();
                assert!((found - at).length() < 1e-5, "{camera:?} {at} {found}");
                let Some(disc) = camera.image_of_cone(direction, tangent) else { continue };
                discs += 1;
                let frame = crate::math::Frame::from_z(direction);
                for k in 0..16 {
                    let around = Vec2::from_angle(k as f32 * 0.4) * tangent * 0.999;
                    let rim = frame.to_world(around.extend(1.0)).normalize();
                    let Some(place) = camera.position_of(rim) else { continue };
                    let apart = (place - disc.center) * Vec2::new(camera.aspect as f32, 1.0);
                    // Across the seam of a panorama.
                    if apart.x.abs() < 0.5 * camera.aspect as f32 {
                        assert!(
                            apart.length() <= disc.radius * 1.0001,
                            "{camera:?} {at}: {apart} {}",
                            disc.radius
                        );
                    }
                }
            }
        }
        assert!(discs > 1200, "{discs}");
    }

    #[test]
    fn impossible_cameras() {
        let camera = |at, up, fov| Camera::look_at(DVec3::ZERO, at, up, fov, 1.0);
        assert!(camera(DVec3::ZERO, DVec3::Y, 40.0).is_none());
        assert!(camera(DVec3::Y, DVec3::Y, 40.0).is_none());
        assert!(camera(DVec3::Z, DVec3::ZERO, 40.0).is_none());
        assert!(camera(DVec3::Z, DVec3::Y, 180.0).is_none());
        assert!(camera(DVec3::Z, DVec3::Y, f64::NAN).is_none());
        let (eye, at, up) = (DVec3::ZERO, DVec3::Z, DVec3::Y);
        for height in [0.0, -1.0, f64::INFINITY, f64::NAN] {
            assert!(Camera::orthographic(eye, at, up, height, 1.0).is_none());
        }
        for angle in [0.0, 360.1, f64::NAN] {
            assert!(Camera::fisheye(eye, at, up, angle, 1.0).is_none());
        }
        assert!(Camera::equirectangular(eye, at, DVec3::Z, 2.0).is_none());
    }
}
