//! Shading of a hit: how it scatters light when its shading and geometric normals may differ.

use crate::bsdf::{Bend, Bent, Bsdf, BsdfSample, Lobe, TransportMode};
use crate::math::{Frame, Rgb};
use crate::sampling::mix;
use glam::{Vec2, Vec3};

/// Another random number, derived by a hash from one that is also used elsewhere.
fn refreshed(u: f32) -> f32 {
    (mix(u64::from(u.to_bits())) >> 40) as f32 / 16_777_216.0
}

/// How a hit scatters light: a BSDF and its frame. Directions are given in the frame.
#[derive(Clone, Copy, Debug)]
pub struct Shading {
    /// The model.
    pub bsdf: Bsdf,
    /// Frame of the shading normal.
    pub frame: Frame,
    /// Geometric normal on the side of the frame's normal.
    pub geometric: Vec3,
    /// Direction back along the ray, in the frame.
    pub wo_local: Vec3,
    /// The geometric normal in the frame, where it differs from the shading normal.
    pub bend: Option<Bend>,
    /// Whether it refracts light by an index that depends on the wavelength.
    pub disperses: bool,
}

impl Shading {
    pub(super) fn new(bsdf: Bsdf, frame: Frame, geometric: Vec3, wo_local: Vec3) -> Self {
        let bend = (frame.z != geometric).then(|| Bend::new(frame.to_local(geometric)));
        Self { bsdf, frame, geometric, wo_local, bend, disperses: false }
    }

    /// The BSDF corrected for the geometric normal; `None` where both normals are the same.
    #[inline]
    pub fn bent(&self) -> Option<Bent<'_>> {
        self.bend.map(|bend| Bent { bsdf: &self.bsdf, wo: self.wo_local, bend })
    }

    /// Value of the BSDF's `lobe`, for paths from the camera: 1/sr, to be multiplied by [`Self::cosine`].
    #[inline]
    pub fn eval(&self, lobe: Lobe, wi: Vec3) -> Rgb {
        let mode = TransportMode::Radiance;
        match self.bent() {
            None => self.bsdf.eval(lobe, self.wo_local, wi, mode),
            Some(bent) => bent.eval_with_cosine(lobe, wi, mode),
        }
    }

    /// The cosine of incidence that [`Self::eval`] does not contain. It is one where the normals differ, because each term of that value
    /// then contains its own cosine.
    #[inline]
    pub fn cosine(&self, wi: Vec3) -> f32 {
        if self.bend.is_none() { wi.z.abs() } else { 1.0 }
    }

    /// Factor of the diffuse lobe on the power of a photon as stored in the map, 1/sr. Photons already contain the share of a Lambertian
    /// surface ([`Bend::lambert_share`]).
    #[inline]
    pub fn eval_photon(&self, wi: Vec3) -> Rgb {
        match self.bent() {
            None => self.bsdf.eval(Lobe::Diffuse, self.wo_local, wi, TransportMode::Radiance),
            Some(bent) => bent.eval_photon(wi),
        }
    }

    /// Direction of light at a Lambertian lobe, for the world direction `w` sampled around the shading normal in proportion to its
    /// cosine, and a random number. It is `w` itself where the normals are the same.
    #[inline]
    pub fn diffuse_direction(&self, w: Vec3, u: f32) -> Vec3 {
        match self.bent() {
            None => w,
            Some(bent) => self.frame.to_world(bent.diffuse_direction(self.frame.to_local(w), refreshed(u))),
        }
    }

    /// Density per solid angle, 1/sr, with which [`Self::sample_lobe`] samples `wi`.
    #[inline]
    pub fn pdf_solid_angle(&self, lobe: Lobe, wi: Vec3) -> f32 {
        match self.bent() {
            None => self.bsdf.pdf_solid_angle(lobe, self.wo_local, wi),
            Some(bent) => bent.pdf_solid_angle(lobe, wi),
        }
    }

    /// [`Bsdf::sample_lobe`] for paths from the camera.
    #[inline]
    pub fn sample_lobe(&self, lobe: Lobe, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let mode = TransportMode::Radiance;
        match self.bent() {
            None => self.bsdf.sample_lobe(lobe, self.wo_local, u_lobe, u, mode),
            Some(bent) => bent.sample_lobe(lobe, u_lobe, u, mode),
        }
    }

    /// [`Bsdf::sample`] for paths from the camera.
    #[inline]
    pub fn sample(&self, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let mode = TransportMode::Radiance;
        match self.bent() {
            None => self.bsdf.sample(self.wo_local, u_lobe, u, mode),
            Some(bent) => bent.sample(u_lobe, u, mode),
        }
    }
}
