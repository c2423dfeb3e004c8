//! Estimates shared by the camera samples of one pixel: an estimate that blurs light over many pixels has the same value for all of
//! them.

use crate::integrators::Scratch;
use crate::math::Rgb;
use arrayvec::ArrayVec;
use glam::Vec3;

/// Number of estimates kept: those for what a pixel shows directly and through specular surfaces.
const REMEMBERED: usize = 4;

/// Smallest cosine between the normals of places that may share an estimate: 10 degrees, so that small round objects share theirs too.
const LEAST_COSINE: f32 = 0.985;

/// Largest distance from the tangent plane for places of the same surface, as a share of the distance allowed within the plane.
const LARGEST_STEP: f32 = 0.1;

/// Caustic irradiance at a point, with its validity radius.
#[derive(Clone, Copy, Debug)]
struct Known {
    position: Vec3,
    normal: Vec3,
    reach: f32,
    irradiance: Rgb,
}

/// The kept estimates of one pixel.
#[derive(Clone, Debug, Default)]
pub(in crate::integrators) struct Remembered {
    all: ArrayVec<Known, REMEMBERED>,
    next: usize,
}

impl Remembered {
    /// The irradiance of an estimate that is valid here.
    pub(super) fn at(&self, position: Vec3, normal: Vec3) -> Option<Rgb> {
        let holds = |known: &&Known| {
            let offset = position - known.position;
            offset.length_squared() <= known.reach * known.reach
                && normal.dot(known.normal) >= LEAST_COSINE
                && offset.dot(known.normal).abs() <= LARGEST_STEP * known.reach
        };
        self.all.iter().find(holds).map(|known| known.irradiance)
    }

    /// Keeps an estimate; it replaces the oldest where there is no room.
    pub(super) fn note(&mut self, position: Vec3, normal: Vec3, reach: f32, irradiance: Rgb) {
        if !(reach > 0.0) {
            return;
        }
        let known = Known { position, normal, reach, irradiance };
        if let Err(full) = self.all.try_push(known) {
            self.all[self.next] = full.element();
            self.next = (self.next + 1) % REMEMBERED;
        }
    }

    fn clear(&mut self) {
        self.all.clear();
        self.next = 0;
    }
}

impl Scratch {
    /// Discards the estimates of another pixel, so that pixels do not depend on the order in which they are rendered.
    pub fn begin_pixel(&mut self) {
        self.remembered.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holds_near_the_place_on_the_same_surface_alone() {
        let mut scratch = Scratch::default();
        let all = &mut scratch.remembered;
        assert!(all.at(Vec3::ZERO, Vec3::Z).is_none());
        all.note(Vec3::ZERO, Vec3::Z, 0.1, Rgb::ONE);
        assert_eq!(all.at(Vec3::X * 0.09, Vec3::Z), Some(Rgb::ONE));
        assert!(all.at(Vec3::X * 0.11, Vec3::Z).is_none());
        assert!(all.at(Vec3::ZERO, Vec3::NEG_Z).is_none(), "the other side");
        assert!(all.at(Vec3::ZERO, Vec3::new(0.2, 0.0, 0.98)).is_none(), "another slope");
        assert!(all.at(Vec3::Z * 0.05, Vec3::Z).is_none(), "a step above");
        assert!(all.at(Vec3::NAN, Vec3::Z).is_none());
        // Estimates with a zero radius, as next to a wall, are not kept.
        all.note(Vec3::Y, Vec3::Z, 0.0, Rgb::ONE);
        all.note(Vec3::Y, Vec3::Z, f32::NAN, Rgb::ONE);
        assert!(all.at(Vec3::Y, Vec3::Z).is_none());
        // The oldest estimate is replaced first.
        (1..=REMEMBERED).for_each(|i| all.note(Vec3::X * i as f32, Vec3::Z, 0.1, Rgb::splat(i as f32)));
        assert!(all.at(Vec3::ZERO, Vec3::Z).is_none());
        assert_eq!(all.at(Vec3::X * 4.0, Vec3::Z), Some(Rgb::splat(4.0)));
        scratch.begin_pixel();
        assert!(scratch.remembered.at(Vec3::X * 4.0, Vec3::Z).is_none());
    }
}
