//! What rough facets let pass, for the diffuse base of `roughplastic`: Mitsuba multiplies it by what facets transmit on the way in and on the
//! way out, of which shadowing and masking take a part; the layers here lose nothing to them. One factor on the base makes the
//! diffuse part as bright under even light.

use crate::bsdf::fresnel_dielectric;
use std::f64::consts::TAU;

/// Distribution of the slopes of facets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Distribution {
    Ggx,
    Beckmann,
}

/// Steps over cosines, slopes and azimuths.
const COSINES: usize = 24;
const SLOPES: usize = 48;
const AZIMUTHS: usize = 16;

impl Distribution {
    /// The squared tangent of the facets below which lies this share of the projected area.
    fn tan_squared(self, share: f64, alpha: f64) -> f64 {
        match self {
            Self::Ggx => alpha * alpha * share / (1.0 - share),
            Self::Beckmann => -alpha * alpha * (1.0 - share).ln(),
        }
    }

    /// Smith's masking for a direction of this cosine (Walter et al. 2007, equations 27 and 34).
    fn masking(self, cosine: f64, alpha: f64) -> f64 {
        let cosine = cosine.abs().clamp(1e-6, 1.0);
        let tangent = (1.0 - cosine * cosine).sqrt() / cosine;
        match self {
            Self::Ggx => 2.0 / (1.0 + (1.0 + (alpha * tangent).powi(2)).sqrt()),
            Self::Beckmann => {
                let a = 1.0 / (alpha * tangent).max(1e-9);
                if a >= 1.6 {
                    return 1.0;
                }
                (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a)
            }
        }
    }

    /// The mean over a facet of what `of` says for the cosine between direction and facet, and the direction that it sends light to (as
    /// the cosine with the surface): of the light that arrives from a direction of this cosine.
    fn mean(self, cosine: f64, alpha: f64, of: &dyn Fn(f64, f64) -> (f64, f64)) -> f64 {
        let sine = (1.0 - cosine * cosine).sqrt();
        let mut sum = 0.0;
        for slope in 0..SLOPES {
            let tan_squared = self.tan_squared((slope as f64 + 0.5) / SLOPES as f64, alpha);
            let up = 1.0 / (1.0 + tan_squared).sqrt();
            let across = (1.0 - up * up).sqrt();
            for azimuth in 0..AZIMUTHS {
                let phi = TAU * (azimuth as f64 + 0.5) / AZIMUTHS as f64;
                let on_facet = sine * across * phi.cos() + cosine * up;
                if on_facet <= 0.0 {
                    continue;
                }
                let (share, leaves) = of(on_facet, up);
                if share > 0.0 {
                    let masked = self.masking(cosine, alpha) * self.masking(leaves, alpha);
                    sum += share * masked * on_facet / (cosine * up);
                }
            }
        }
        sum / (SLOPES * AZIMUTHS) as f64
    }

    /// Transmitted through facets from outside, to a medium of relative index `eta`.
    fn transmitted(self, cosine: f64, alpha: f64, eta: f64) -> f64 {
        self.mean(cosine, alpha, &|on_facet, up| {
            let share = 1.0 - f64::from(fresnel_dielectric(on_facet as f32, eta as f32));
            let inside = (1.0 - (1.0 - on_facet * on_facet) / (eta * eta)).max(0.0).sqrt();
            // Along -m, but for what is left of the direction across it.
            let leaves = (on_facet / eta - inside) * up - cosine / eta;
            (if leaves < 0.0 { share } else { 0.0 }, leaves)
        })
    }

    /// Reflected by facets, by `fresnel` of the cosine with the facet.
    fn reflected(self, cosine: f64, alpha: f64, fresnel: &dyn Fn(f64) -> f64) -> f64 {
        self.mean(cosine, alpha, &|on_facet, up| {
            let leaves = 2.0 * on_facet * up - cosine;
            (if leaves > 0.0 { fresnel(on_facet) } else { 0.0 }, leaves)
        })
    }
}

/// The mean over the hemisphere, weighted by the cosine.
fn over_hemisphere(of: impl Fn(f64) -> f64) -> f64 {
    (0..COSINES).map(|i| of(((i as f64 + 0.5) / COSINES as f64).sqrt())).sum::<f64>() / COSINES as f64
}

/// The factor on the diffuse base of a plastic of relative index `eta` with facets of this slope.
pub(super) fn diffuse_factor(distribution: Distribution, alpha: f64, eta: f64) -> f64 {
    if alpha < 1e-3 || eta < 1.001 {
        return 1.0;
    }
    let passed = over_hemisphere(|cosine| distribution.transmitted(cosine, alpha, eta));
    let back = |cosine: f64| f64::from(fresnel_dielectric(cosine as f32, (1.0 / eta) as f32));
    let thrown_back = over_hemisphere(|cosine| distribution.reflected(cosine, alpha, &back));
    let f0 = ((eta - 1.0) / (eta + 1.0)).powi(2);
    let schlick = |cosine: f64| f0 + (1.0 - f0) * (1.0 - cosine).powi(5);
    let left = 1.0 - over_hemisphere(|cosine| Distribution::Ggx.reflected(cosine, alpha, &schlick));
    let factor = passed * passed / (eta * eta * (1.0 - thrown_back) * left);
    if factor.is_finite() { factor.clamp(0.0, 1.5) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smooth facets need no factor, but for what Schlick's formula differs; and rougher ones lose more.
    #[test]
    fn rough_facets_darken_the_base() {
        for distribution in [Distribution::Ggx, Distribution::Beckmann] {
            let of = |alpha: f64| diffuse_factor(distribution, alpha, 1.5);
            assert!((of(0.01) - 1.0).abs() < 0.02, "{}", of(0.01));
            assert!(of(0.1) > of(0.4) && of(0.4) > of(1.0), "{} {} {}", of(0.1), of(0.4), of(1.0));
        }
        assert_eq!(diffuse_factor(Distribution::Ggx, 0.0, 1.5), 1.0);
        assert!(diffuse_factor(Distribution::Ggx, 1.0, 9.0).is_finite());
    }

    /// What facets that reflect everything send up again is below one, and is one where they are smooth.
    #[test]
    fn masking_takes_a_part() {
        let all = |_: f64| 1.0;
        for distribution in [Distribution::Ggx, Distribution::Beckmann] {
            let smooth = distribution.reflected(0.7, 0.01, &all);
            assert!((smooth - 1.0).abs() < 0.01, "{smooth}");
            let rough = distribution.reflected(0.7, 0.6, &all);
            assert!(rough > 0.5 && rough < 0.98, "{rough}");
        }
    }
}
