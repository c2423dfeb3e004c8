//! Scattering where the shading normal differs from the geometric normal, by interpolation, bumps or normal maps.
//!
//! A BSDF scatters around the shading normal `z`, and some of its directions lie on the wrong side of the surface, whose
//! geometric normal is `n`. That light is not absorbed. A rule for each lobe redirects it by a map of directions that preserves
//! solid angles. The total reflected and transmitted light is therefore exactly that of the BSDF:
//!
//! - **Specular and highly glossy lobes are folded**: a direction on the wrong side of the surface is mirrored about the
//!   surface, `w - 2 (w.n) n`. The image in a mirror has no seam there. (Keller et al., "The Iray Light Transport
//!   Simulation and Rendering System", 2017, also bend the direction back to the surface, but to a single direction just above it,
//!   which has no adjoint for photons.)
//! - **The diffuse lobe is turned**: the share [`Bend::kept`] of each direction keeps the direction; the rest is rotated by the
//!   rotation from `z` to `n`, as if the lobe stood on `n`. The share is that of Chiang, Li & Burley, "Taming the Shadow Terminator"
//!   (SIGGRAPH 2019 Talks): one where light comes from high above the surface, falling smoothly to zero at its horizon, so that the
//!   light on coarse meshes ends without steps. Their method loses the rest.
//!
//! Seen from between the planes of both normals, the shading normal faces away. The caller then replaces it by the geometric
//! normal.
//!
//! Photons follow the adjoint of these rules, [`Bent::scatter_photon`]: the density of flux through the surface contains the
//! geometric cosine where radiance contains the cosine to the shading normal (Veach 1997, section 5.3).

use super::{Bsdf, BsdfSample, Lobe, TransportMode, sides_agree};
use crate::math::Rgb;
use crate::sampling::mix;
use glam::{Vec2, Vec3};

/// The geometric normal where it differs from the shading normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bend {
    /// The geometric normal in the shading frame, unit length, on the side of `z`.
    normal: Vec3,
}

impl Bend {
    /// For the geometric `normal` in the shading frame, with `normal.z >= 0`.
    pub fn new(normal: Vec3) -> Self {
        Self { normal }
    }

    /// Whether a direction is on the same side of both normals.
    #[inline]
    fn agrees(&self, w: Vec3) -> bool {
        sides_agree(w, Vec3::Z, self.normal)
    }

    /// Share of the diffuse light from `w` that the lobe around the shading normal keeps: `-g^3 + g^2 + g` for `g = (n.w) / ((z.w)
    /// (n.z)) < 1`, and one for larger `g` (Chiang, Li & Burley 2019).
    #[inline]
    fn kept(&self, w: Vec3) -> f32 {
        let cosine = w.dot(self.normal);
        kept_of(cosine, w.z, self.normal.z)
    }

    /// [`Self::kept`] of [`Self::turned_back`], without the rotation: the `z` of the rotated direction is the cosine of `w` to the
    /// geometric normal.
    #[inline]
    fn kept_turned_back(&self, w: Vec3) -> f32 {
        let cosine = w.dot(self.normal);
        kept_of(2.0 * self.normal.z * cosine - w.z, cosine, self.normal.z)
    }

    /// `w` mirrored about the surface.
    #[inline]
    fn folded(&self, w: Vec3) -> Vec3 {
        w - self.normal * (2.0 * w.dot(self.normal))
    }

    /// `w` rotated by the rotation from `z` to `n`.
    #[inline]
    fn turned(&self, w: Vec3) -> Vec3 {
        self.rotated(w, Vec3::new(-self.normal.y, self.normal.x, 0.0))
    }

    /// The inverse of [`Self::turned`].
    #[inline]
    fn turned_back(&self, w: Vec3) -> Vec3 {
        self.rotated(w, Vec3::new(self.normal.y, -self.normal.x, 0.0))
    }

    /// `w` rotated around `axis`, whose length is the sine of the angle.
    #[inline]
    fn rotated(&self, w: Vec3, axis: Vec3) -> Vec3 {
        let across = axis.cross(w);
        w + across + axis.cross(across) / (1.0 + self.normal.z)
    }

    /// Light from `w` (towards the light, shading frame) that a Lambertian lobe reflects, over the flux that arrives at the surface and
    /// its reflectance: the factor on the power of a photon. At most about 1.25 over the cosine between the normals.
    pub fn lambert_share(&self, w: Vec3) -> f32 {
        let cosine = w.dot(self.normal);
        if !(cosine > 0.0) {
            return 0.0;
        }
        let kept = self.kept(w);
        let around_shading = if kept > 0.0 { kept * (w.z / cosine) } else { 0.0 };
        around_shading + (1.0 - self.kept_turned_back(w))
    }
}

/// [`Bend::kept`] from the cosines of a direction to the geometric normal (`cosine`) and to the shading normal (`z`), and the cosine
/// `between` the normals.
#[inline]
fn kept_of(cosine: f32, z: f32, between: f32) -> f32 {
    if !(z > 0.0 && cosine > 0.0) {
        return 0.0;
    }
    let g = cosine / (z * between);
    if g < 1.0 { g * (1.0 + g * (1.0 - g)) } else { 1.0 }
}

/// Largest share of turned light for which the BSDF is evaluated only in the direction `wi` itself. The turned direction is then close
/// to it, and a photon is only one of many in an estimate.
const LITTLE_TURNED: f32 = 0.2;

/// A BSDF on a surface with such normals, seen from `wo`, which is on the same side of both.
#[derive(Clone, Copy, Debug)]
pub struct Bent<'a> {
    /// The model.
    pub bsdf: &'a Bsdf,
    /// Direction to the previous vertex, in the shading frame.
    pub wo: Vec3,
    /// The geometric normal.
    pub bend: Bend,
}

/// Another random number, derived by a hash from those that sampled a direction; the same in every run.
fn further(u_lobe: f32, u: Vec2) -> f32 {
    let bits = |x: f32, y: f32| u64::from(x.to_bits()) << 32 | u64::from(y.to_bits());
    (mix(mix(bits(u.x, u.y)) ^ bits(u_lobe, 0.0)) >> 40) as f32 / 16_777_216.0
}

impl Bent<'_> {
    /// Value of the BSDF's `lobe` times the cosine of `wi`, 1/sr; zero for [`Lobe::Specular`].
    pub fn eval_with_cosine(&self, lobe: Lobe, wi: Vec3, mode: TransportMode) -> Rgb {
        self.sum(lobe, wi, Rgb::ZERO, |w| self.bsdf.eval(lobe, self.wo, w, mode) * w.z.abs())
    }

    /// The diffuse lobe over [`Bend::lambert_share`] and the cosine to the geometric normal, 1/sr: the mean of the BSDF over the two
    /// directions that lead to `wi`, weighted by the light that each contributes.
    pub fn eval_photon(&self, wi: Vec3) -> Rgb {
        let Self { bsdf, wo, bend } = *self;
        let cosine = wi.dot(bend.normal);
        if !(cosine > 0.0 && wo.dot(bend.normal) > 0.0) {
            return Rgb::ZERO;
        }
        let f = |w: Vec3| bsdf.eval(Lobe::Diffuse, wo, w, TransportMode::Radiance);
        let kept = bend.kept(wi);
        let straight = if kept > 0.0 { kept * wi.z } else { 0.0 };
        let turned = (1.0 - bend.kept_turned_back(wi)) * cosine;
        let share = turned / (straight + turned);
        if !(share > LITTLE_TURNED) {
            f(wi)
        } else if straight > 0.0 {
            f(wi) * (1.0 - share) + f(bend.turned_back(wi)) * share
        } else {
            f(bend.turned_back(wi))
        }
    }

    /// Density per solid angle, 1/sr, with which [`Self::sample_lobe`] samples `wi`; zero for [`Lobe::Specular`].
    pub fn pdf_solid_angle(&self, lobe: Lobe, wi: Vec3) -> f32 {
        self.sum(lobe, wi, 0.0, |w| self.bsdf.pdf_solid_angle(lobe, self.wo, w))
    }

    /// Sum over the directions around the shading normal that are mapped to `wi`, each with its share.
    #[inline]
    fn sum<T>(&self, lobe: Lobe, wi: Vec3, zero: T, of: impl Fn(Vec3) -> T) -> T
    where
        T: std::ops::Add<Output = T> + std::ops::Mul<f32, Output = T>,
    {
        let Self { wo, bend, .. } = *self;
        let cosine = wi.dot(bend.normal);
        let mut sum = zero;
        match lobe {
            Lobe::Specular => {}
            Lobe::Diffuse => {
                if !(cosine * wo.dot(bend.normal) > 0.0) {
                    return sum;
                }
                let kept = bend.kept(wi);
                if kept > 0.0 {
                    sum = sum + of(wi) * kept;
                }
                let back = bend.turned_back(wi);
                let rest = 1.0 - bend.kept(back);
                if rest > 0.0 {
                    sum = sum + of(back) * rest;
                }
            }
            Lobe::Glossy => {
                if bend.agrees(wi) {
                    sum = sum + of(wi);
                }
                let folded = bend.folded(wi);
                if cosine != 0.0 && folded.z != 0.0 && !bend.agrees(folded) {
                    sum = sum + of(folded);
                }
            }
        }
        sum
    }

    /// Like [`Bsdf::sample_lobe`].
    pub fn sample_lobe(&self, lobe: Lobe, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        self.moved(self.bsdf.sample_lobe(lobe, self.wo, u_lobe, u, mode)?, further(u_lobe, u))
    }

    /// Like [`Bsdf::sample`].
    pub fn sample(&self, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        self.moved(self.bsdf.sample(self.wo, u_lobe, u, mode)?, further(u_lobe, u))
    }

    /// Maps a direction sampled around the shading normal to its final direction, by a random number.
    fn moved(&self, sample: BsdfSample, u: f32) -> Option<BsdfSample> {
        let Self { bend, wo, .. } = *self;
        let wi = match sample.lobe {
            Lobe::Diffuse => self.diffuse_direction(sample.wi, u),
            Lobe::Glossy | Lobe::Specular if bend.agrees(sample.wi) => sample.wi,
            Lobe::Glossy | Lobe::Specular => bend.folded(sample.wi),
        };
        let side = wi.dot(bend.normal) * wo.dot(bend.normal);
        if side == 0.0 || (side < 0.0) != sample.transmission {
            return None;
        }
        let pdf_solid_angle = match sample.lobe {
            Lobe::Specular => sample.pdf_solid_angle,
            lobe => self.pdf_solid_angle(lobe, wi),
        };
        Some(BsdfSample { wi, pdf_solid_angle, ..sample })
    }

    /// Final direction of the diffuse lobe for a direction `w` sampled around the shading normal, by a random number.
    #[inline]
    pub fn diffuse_direction(&self, w: Vec3, u: f32) -> Vec3 {
        if u < self.bend.kept(w) { w } else { self.bend.turned(w) }
    }

    /// Directions in which a photon that arrived from `wo` may continue, with throughput for flux. They are the adjoint of the rules for
    /// paths, term by term; an estimate uses their sum. Directions between the planes of both normals are excluded, because from there a
    /// path uses the geometric normal.
    pub fn scatter_photon(&self, u_lobe: f32, u: Vec2) -> [Option<BsdfSample>; 3] {
        let Self { bsdf, wo, bend } = *self;
        let mode = TransportMode::Flux;
        let arrived = wo.dot(bend.normal).abs();
        // `from` is the direction around the shading normal that is mapped to `wo`, with a share.
        let leaving = |sample: BsdfSample, from: Vec3, share: f32| {
            if !bend.agrees(sample.wi) {
                return None;
            }
            let leaves = sample.wi.dot(bend.normal);
            let cosines = (from.z.abs() / arrived) * (leaves.abs() / sample.wi.z.abs());
            let throughput = sample.throughput * (share * cosines);
            let transmission = leaves * wo.dot(bend.normal) < 0.0;
            (throughput.is_finite() && throughput != Rgb::ZERO).then_some(BsdfSample {
                throughput,
                transmission,
                ..sample
            })
        };
        let straight = bsdf.sample(wo, u_lobe, u, mode).and_then(|sample| {
            leaving(sample, wo, if sample.lobe == Lobe::Diffuse { bend.kept(wo) } else { 1.0 })
        });
        let back = bend.turned_back(wo);
        let rest = if wo.dot(bend.normal) > 0.0 { 1.0 - bend.kept(back) } else { 0.0 };
        let turned = (rest > 0.0)
            .then(|| leaving(bsdf.sample_lobe(Lobe::Diffuse, back, u_lobe, u, mode)?, back, rest))
            .flatten();
        let from = bend.folded(wo);
        let folded = (from.z != 0.0 && !bend.agrees(from))
            .then(|| bsdf.sample(from, u_lobe, u, mode).filter(|sample| sample.lobe != Lobe::Diffuse))
            .flatten()
            .and_then(|sample| leaving(sample, from, 1.0));
        [straight, turned, folded]
    }
}
