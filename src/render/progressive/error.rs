//! Error estimate of a picture from its two independent halves.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Estimate of the relative error of a progressive picture: the root of the mean over pixels and channels of (t - r)^2 / (r^2 + f).
/// The floor f is a hundredth of the square of the picture's mean, so that black pixels count without dominating and the unit of light
/// does not matter. Cardioid's `compare` prints the true error as `relrmse_u`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorEstimate {
    /// Rounds that the picture consists of.
    pub rounds: u64,
    /// Error from noise and bias together.
    pub error: f64,
    /// Error from noise.
    pub noise: f64,
    /// Error from bias.
    pub bias: f64,
    /// Pixels that are far brighter in one half than in the other. A path hit something small and bright there by chance, and the error
    /// is unknown.
    pub glints: u64,
    /// Error from noise of all other pixels.
    pub noise_without_glints: f64,
}

/// A pixel is a glint where a channel differs between the halves by more than this factor times the root of the darker value squared plus
/// the floor: a chance hit is then nearly all of its mean. Two halves determine neither the true brightness of such a pixel nor its error;
/// it counts as wrong by about its whole value.
const GLINT: f64 = 4.0;

/// Floor that is added to the square of a radiance in relative errors, over the square of the picture's mean.
const FLOOR: f64 = 0.01;

/// The error of the picture that the two halves form, where each half has the given number of rounds. `pixels` gives the means of the
/// picture and of its bias in the even and the odd half, pixel by pixel. `None` where a half has no rounds or the picture is black.
///
/// The halves e and o, of n_e and n_o rounds, are independent of each other, as they share neither camera samples nor photons.
/// So the variance of the whole is that of e - o times n_e n_o / n^2. The expectation of the product of the two bias estimates is the
/// square of their mean, free of their noise.
pub fn error_of_halves<I: Iterator<Item = [[DVec3; 2]; 2]>>(
    pixels: impl Fn() -> I,
    rounds: [u64; 2],
) -> Option<ErrorEstimate> {
    let (even, odd) = (rounds[0] as f64, rounds[1] as f64);
    let all = even + odd;
    let whole = |e: DVec3, o: DVec3| (e * even + o * odd) / all;
    let mut sum = DVec3::ZERO;
    let mut count = 0.0;
    for [[e, _], [o, _]] in pixels() {
        sum += whole(e, o).abs();
        count += 1.0;
    }
    let mean = sum.element_sum() / (3.0 * count);
    if rounds.contains(&0) || !(mean > 0.0 && mean.is_finite()) {
        return None;
    }
    // Values are divided by the mean first, so that no square overflows or underflows.
    let (mut noise, mut other_noise, mut bias, mut glints) = (0.0, 0.0, 0.0, 0);
    for [[e, e_bias], [o, o_bias]] in pixels() {
        let difference = (e - o) / mean;
        let square = |value: DVec3| value * value + FLOOR;
        let of_pixel = (difference * difference / square(whole(e, o) / mean)).element_sum();
        let darker = square(e.abs().min(o.abs()) / mean);
        let is_glint = (difference * difference).cmpgt(GLINT * GLINT * darker).any();
        noise += of_pixel;
        if is_glint {
            glints += 1;
        } else {
            other_noise += of_pixel;
        }
        bias += (e_bias / mean * (o_bias / mean) / square(whole(e, o) / mean)).element_sum();
    }
    let [noise, other_noise] =
        [noise, other_noise].map(|sum| sum / (3.0 * count) * (even * odd) / (all * all));
    // The estimate may be negative by chance where there is hardly any bias.
    let bias = (bias / (3.0 * count)).max(0.0);
    let rounds = rounds[0] + rounds[1];
    Some(ErrorEstimate {
        rounds,
        error: (noise + bias).sqrt(),
        noise: noise.sqrt(),
        bias: bias.sqrt(),
        glints,
        noise_without_glints: other_noise.sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::{Film, HalvedSum, LayerSet, PixelSample, Precision};
    use crate::math::Rgb;
    use crate::sampling::{Rng, Stream};

    fn estimate(halves: &[Film; 2], rounds: [u64; 2]) -> Option<ErrorEstimate> {
        error_of_halves(|| HalvedSum::means_with(None, halves, Precision::Exact), rounds)
    }

    /// Halves with uniform noise of this standard deviation per round, and bias estimates around `bias` with the same noise.
    fn halves(rounds: [u64; 2], deviation: f64, bias: f64, scale: f64) -> [Film; 2] {
        let layers = LayerSet { bias: true, ..LayerSet::default() };
        let mut rng = Rng::new(5, Stream::Measure, 0);
        rounds.map(|rounds| {
            let mut film = Film::new(64, 64, None, layers).unwrap();
            for _ in 0..rounds {
                let mut tile = film.tile(film.rect()).unwrap();
                for (x, y) in film.rect().pixels() {
                    let mut noise = || deviation * 12f64.sqrt() * (rng.next_f64() - 0.5);
                    let mut value = |mean: f64| Rgb::splat(((mean + noise()) * scale) as f32);
                    let mut sample = PixelSample { bias: value(bias), ..PixelSample::default() };
                    sample.radiance[0] = value(1.0);
                    tile.add(x, y, 1.0, &sample);
                }
                film.merge(&tile).unwrap();
            }
            film
        })
    }

    #[test]
    fn noise_and_bias_are_told_apart() {
        for (rounds, scale) in [([8, 8], 1.0), ([9, 8], 1e-25), ([20, 1], 1e20)] {
            let found = estimate(&halves(rounds, 0.5, 0.1, scale), rounds).unwrap();
            let n = (rounds[0] + rounds[1]) as f64;
            // 4096 independent pixels: the estimate of a variance is certain to 2.2 %; three standard errors on the root.
            let noise = 0.5 / n.sqrt() / 1.01f64.sqrt();
            assert!((found.noise / noise - 1.0).abs() < 0.05, "{rounds:?}: {found:?} {noise}");
            // The tolerance is proportional to the noise of the estimate: 0.25 / sqrt(n_e n_o) / 64 on the square.
            let certain = 3.0 * 0.25 / ((rounds[0] * rounds[1]) as f64).sqrt() / 64.0;
            assert!((found.bias.powi(2) - 0.01 / 1.01).abs() < certain, "{rounds:?}: {found:?}");
            assert!((found.error.powi(2) - found.noise.powi(2) - found.bias.powi(2)).abs() < 1e-12);
        }
    }

    #[test]
    fn what_one_half_alone_has_met_is_not_taken_for_light() {
        let rounds = [8, 8];
        let mut films = halves(rounds, 0.5, 0.0, 1.0);
        let before = estimate(&films, rounds).unwrap();
        assert_eq!((before.glints, before.noise_without_glints), (0, before.noise));
        let mut tile = films[0].tile(films[0].rect()).unwrap();
        let mut sample = PixelSample::default();
        sample.radiance[0] = Rgb::splat(9_000.0);
        tile.add(3, 4, 1.0, &sample);
        films[0].merge(&tile).unwrap();
        let found = estimate(&films, rounds).unwrap();
        assert_eq!(found.glints, 1);
        assert!((found.noise_without_glints / before.noise - 1.0).abs() < 0.5, "{found:?} {before:?}");
        // One of 4096 pixels is wrong by its whole value.
        let (added, all) = (found.noise.powi(2) - found.noise_without_glints.powi(2), 1.0 / 4096.0);
        assert!((added / all - 1.0).abs() < 0.05, "{found:?}");
    }

    #[test]
    fn nothing_is_known_of_one_round_or_of_darkness() {
        assert_eq!(estimate(&halves([1, 0], 0.5, 0.0, 1.0), [1, 0]), None);
        assert_eq!(estimate(&halves([1, 1], 0.5, 0.0, 0.0), [1, 1]), None);
    }
}
