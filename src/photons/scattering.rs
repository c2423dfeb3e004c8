//! Directions in which a photon may continue from a surface, also where shading and geometric normals differ.

use crate::bsdf::{Bend, Bsdf, BsdfSample, TransportMode, sides_agree};
use crate::math::Frame;
use crate::sampling::ONE_MINUS_EPSILON;
use crate::scene::{Shading, SurfaceInteraction};
use glam::{Vec2, Vec3};

/// The random number that chooses a lobe, remapped so that it chooses only highly glossy and specular lobes, and the
/// share of light that these lobes carry.
pub(super) fn without_diffuse(shading: &Shading, u_lobe: f32) -> (f32, f32) {
    let [diffuse, glossy, specular] = shading.bsdf.lobe_weights(shading.wo_local);
    let total = diffuse + glossy + specular;
    let share = diffuse / total;
    if !(diffuse > 0.0 && total > diffuse) {
        return (u_lobe, 1.0);
    }
    ((share + (1.0 - share) * u_lobe).min(ONE_MINUS_EPSILON), 1.0 - share)
}

/// Share of the light that a surface mirrors or refracts: mean over the hemisphere, weighted by the cosine.
pub(super) fn mirrored_share(bsdf: &Bsdf) -> f32 {
    const DIRECTIONS: u8 = 4;
    let share = |i: u8| {
        let cosine = ((f32::from(i) + 0.5) / f32::from(DIRECTIONS)).sqrt();
        let sine = ((1.0 - cosine) * (1.0 + cosine)).sqrt();
        let [_, glossy, specular] = bsdf.lobe_weights(Vec3::new(sine, 0.0, cosine));
        glossy + specular
    };
    ((0..DIRECTIONS).map(share).sum::<f32>() / f32::from(DIRECTIONS)).clamp(f32::MIN_POSITIVE, 1.0)
}

/// A BSDF sample and its direction.
pub(super) type Scattered = (BsdfSample, Vec3);

/// A direction sampled from the BSDF.
pub(super) fn sampled(shading: &Shading, u_lobe: f32, u: Vec2) -> Option<Scattered> {
    let sample = shading.bsdf.sample(shading.wo_local, u_lobe, u, TransportMode::Flux)?;
    Some((sample, shading.frame.to_world(sample.wi)))
}

/// A direction from a Lambertian surface whose shading normal differs. Its light leaves as from any Lambertian surface,
/// so the direction is sampled around the geometric normal, and no cosine at grazing angles divides the weight.
pub(super) fn sampled_around_geometric(
    hit: &SurfaceInteraction,
    shading: &Shading,
    u: Vec2,
) -> Option<Scattered> {
    let frame = Frame::from_z(shading.geometric);
    let sample = shading.bsdf.sample(frame.to_local(hit.wo), 0.0, u, TransportMode::Flux)?;
    let direction = frame.to_world(sample.wi);
    // The adjoint of a camera path that arrives from `direction`: it uses the geometric normal where the shading normal
    // faces away from it.
    let sees_shading = sides_agree(direction, hit.shading_normal, hit.point.normal);
    let share = if sees_shading { shading_share(hit) } else { 1.0 };
    Some((BsdfSample { throughput: sample.throughput * share, ..sample }, direction))
}

/// Directions in which light continues from a surface whose normals differ. Each is a term of the adjoint of camera
/// paths: terms from directions that see the shading normal, and one from directions where it faces away and a path
/// uses the geometric one, `flat`.
pub(super) fn candidates(
    hit: &SurfaceInteraction,
    shading: &Shading,
    flat: &Shading,
    (u_lobe, u): (f32, Vec2),
) -> [Option<Scattered>; 4] {
    let seen = match shading.bent() {
        Some(bent) => bent.scatter_photon(u_lobe, u),
        // Light that arrives from behind the shading normal.
        None => [None; 3],
    };
    let [a, b, c] = seen.map(|sample| sample.map(|sample| (sample, shading.frame.to_world(sample.wi))));
    let faces_away = |direction: Vec3| !sides_agree(direction, hit.shading_normal, hit.point.normal);
    [a, b, c, sampled(flat, u_lobe, u).filter(|&(_, direction)| faces_away(direction))]
}

/// Chooses one of several directions in proportion to the light that goes there, and gives it the light of all.
pub(super) fn one_of(candidates: [Option<Scattered>; 4], u: impl FnOnce() -> f32) -> Option<Scattered> {
    let weight = |found: &Option<Scattered>| found.map_or(0.0, |(sample, _)| sample.throughput.max_element());
    let total: f32 = candidates.iter().map(weight).sum();
    let mut left = u() * total;
    let chosen = candidates.iter().position(|found| {
        let weight = weight(found);
        let is_here = weight > 0.0 && left < weight;
        left -= weight;
        is_here
    });
    // Rounding may leave a remainder at the end.
    let chosen = chosen.or_else(|| candidates.iter().rposition(|found| weight(found) > 0.0))?;
    let (sample, direction) = candidates[chosen]?;
    let throughput = sample.throughput * (total / sample.throughput.max_element());
    Some((BsdfSample { throughput, ..sample }, direction))
}

/// Light that a Lambertian surface reflects at `hit`, over what it would reflect with the geometric normal as shading
/// normal: the share of a photon's power that the map stores ([`crate::bsdf::Bend::lambert_share`]). Zero for light
/// from below the horizon of the shading normal.
pub(super) fn shading_share(hit: &SurfaceInteraction) -> f32 {
    if hit.shading_normal == hit.point.normal {
        return 1.0;
    }
    let side = 1f32.copysign(hit.wo.dot(hit.point.normal));
    let frame = Frame::from_z(hit.shading_normal * side);
    Bend::new(frame.to_local(hit.point.normal * side)).lambert_share(frame.to_local(hit.wo))
}
