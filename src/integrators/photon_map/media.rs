//! Light that media scatter, read from photons in media (Jensen & Christensen 1998).

use super::PhotonMapIntegrator;
use super::gather::{Gain, Start, cone_of};
use crate::film::Aov;
use crate::integrators::Scratch;
use crate::lights::Receiver as LightReceiver;
use crate::math::{Ray, Rgb};
use crate::media::{End, Losses};
use crate::photons::Reading;
use crate::sampling::SampleStream;
use crate::transport::{Collision, MisPartner, Stretch};
use glam::{Vec2, Vec3};

/// Places on each stretch from which lights are sampled: what the shadow rays cost is little beside the search for photons.
const PLACES: u32 = 4;

impl PhotonMapIntegrator<'_> {
    /// Radiance that arrives at the start of a stretch of a path from the eye of the light scattered on it, over the weight of the stretch,
    /// by part of the picture. `throughput` is that of the path at the start of the stretch.
    pub(super) fn scattered_along(
        &self,
        stretch: &Stretch<'_>,
        throughput: Rgb,
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> [(Aov, Rgb); 3] {
        scratch.counters.media_lookups += 1;
        let area = self.kernel_area();
        let reads = self.maps.media.reading(stretch.medium.medium(), stretch.volume, area) == Reading::Along;
        let direct = self.direct.scattered(stretch, (throughput, !reads, PLACES), samples, scratch);
        let light = self.maps.media.along(stretch, area, reads);
        let followed =
            if reads { Gain::default() } else { self.followed(stretch, throughput, samples, scratch) };
        [
            (Aov::Direct, direct + followed.direct),
            (Aov::Caustics, light.caustics),
            (Aov::Indirect, light.indirect + followed.indirect),
        ]
    }

    /// The indirect light of [`Self::scattered_along`] from one collision and one direction of the phase function, and the direct light that
    /// this direction finds, weighted against light sampling.
    fn followed(
        &self,
        stretch: &Stretch<'_>,
        throughput: Rgb,
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> Gain {
        let [x, y, u, _] = samples.splits(1).get_4d(0);
        let mut rng = stretch.rng;
        let Stretch { line, volume, medium, .. } = *stretch;
        let flight = volume.fly(&line, stretch.length, throughput, Losses::Weighted, &mut rng);
        let End::Scattered { t, weight } = flight.end else { return Gain::default() };
        let weight = weight * volume.coefficients().albedo();
        let (position, phase) = (line.at(t).as_vec3(), volume.phase());
        let sample = phase.sample(-line.direction().as_vec3(), Vec2::new(x, y));
        let from = LightReceiver { position, normal: Vec3::ZERO };
        let collision = Collision { stretch: *stretch, t, position, distance: t as f32, phase };
        let start = Start {
            ray: Ray::new(position, sample.wi),
            medium,
            partner: Some(MisPartner { from, pdf: sample.pdf }),
            collided: Some((&collision, throughput)),
            indirect: true,
            recursion: 0,
            weight: (throughput * weight).max_element(),
            depth: 1,
            travelled: t as f32,
            cone: cone_of(1, sample.pdf),
        };
        let found = self.gather(&start, u, scratch);
        Gain { indirect: weight * found.indirect, direct: weight * found.direct, bias: Rgb::ZERO }
    }

    /// Radiance of the light that a medium scatters at a collision towards `wo`, over the weight of the collision, and whether that is all
    /// of it: near `walk`, where the path first collided, it may lack indirect light, and direct light is then weighted against directions
    /// of the phase function.
    pub(super) fn scattered_at(
        &self,
        collision: &Collision<'_>,
        (wo, walk): (Vec3, Vec3),
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> (Rgb, bool) {
        scratch.counters.media_lookups += 1;
        let stretch = &collision.stretch;
        let (medium, area) = (stretch.medium.medium(), self.kernel_area());
        let is_all = match self.maps.media.reading(medium, stretch.volume, area) {
            Reading::Along => true,
            Reading::Beyond(width) => walk.distance(collision.position) > width,
            Reading::Never => false,
        };
        let direct = self.direct.at_collision(collision, (wo, !is_all), samples, scratch);
        let light = self.maps.media.at(medium, stretch.volume, (collision.position, wo), area);
        (direct + light.caustics + if is_all { light.indirect } else { Rgb::ZERO }, is_all)
    }

    /// Area of kernels in media, as a share of that outside of progressive rendering.
    fn kernel_area(&self) -> f32 {
        self.settings.narrowing.map_or(1.0, |narrowing| narrowing.radius_share * narrowing.radius_share)
    }
}
