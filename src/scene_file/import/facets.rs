//! Transmission through rough facets, for the diffuse base of `roughplastic`. Mitsuba multiplies the base by the transmission of
//! the facets on the way in and on the way out, which shadowing and masking reduce. The layers of this renderer lose no light to
//! shadowing and masking. A single factor on the base makes the diffuse part equally bright under uniform light.

use crate::bsdf::fresnel_dielectric;
use std::f64::consts::TAU;

/// Distribution of the facets' slopes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Distribution {
    Ggx,
    Beckmann,
}

/// Steps of the numerical integration over cosines, slopes and azimuths.
const COSINES: usize = 24;
const SLOPES: usize = 48;
const AZIMUTHS: usize = 16;

impl Distribution {
    /// The squared tangent of the facet angle below which `share` of the projected area lies.
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

    /// Mean over the facets for light from a direction with this cosine. `of` maps the cosine between direction and facet, and
    /// the cosine between facet and surface, to the share of the light that the facet passes on and the cosine of the direction
    /// in which it leaves.
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

    /// Light transmitted through facets from outside, into a medium of relative index `eta`.
    fn transmitted(self, cosine: f64, alpha: f64, eta: f64) -> f64 {
        self.mean(cosine, alpha, &|on_facet, up| {
            let share = 1.0 - f64::from(fresnel_dielectric(on_facet as f32, eta as f32));
            let inside = (1.0 - (1.0 - on_facet * on_facet) / (eta * eta)).max(0.0).sqrt();
            // Cosine of the refracted direction `(on_facet / eta - inside) m - w / eta`, for the facet normal m and the incident
            // direction w.
            let leaves = (on_facet / eta - inside) * up - cosine / eta;
            (if leaves < 0.0 { share } else { 0.0 }, leaves)
        })
    }

    /// Light reflected by facets; `fresnel` is the reflectance for a cosine with the facet.
    fn reflected(self, cosine: f64, alpha: f64, fresnel: &dyn Fn(f64) -> f64) -> f64 {
        self.mean(cosine, alpha, &|on_facet, up| {
            let leaves = 2.0 * on_facet * up - cosine;
            (if leaves > 0.0 { fresnel(on_facet) } else { 0.0 }, leaves)
        })
    }
}

/// Cosine-weighted mean over the hemisphere.
fn over_hemisphere(of: impl Fn(f64) -> f64) -> f64 {
    (0..COSINES).map(|i| of(((i as f64 + 0.5) / COSINES as f64).sqrt())).sum::<f64>() / COSINES as f64
}

/// The factor on the diffuse base of a plastic with relative index `eta` and facets of this slope.
pub(crate) fn diffuse_factor(distribution: Distribution, alpha: f64, eta: f64) -> f64 {
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

    /// Smooth facets need no factor, apart from the error of Schlick's formula; rougher facets lose more light.
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

    /// The upward reflection of fully reflecting facets is below one, and is one where they are smooth.
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
