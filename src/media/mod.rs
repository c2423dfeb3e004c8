//! Media: what fills the space between surfaces.
//!
//! [`Medium`] is the medium of a body, and [`MediumStack`] resolves bodies that overlap. [`Volume`] with its
//! [`Coefficients`], [`Phase`] and [`density::Density`] describes a scattering medium, and samples the places where it
//! scatters light. `docs/media.md` has the formulae.

mod coefficients;
pub mod density;
mod distance;
mod glow;
mod medium_stack;
mod phase;
mod presets;
mod tracking;
#[cfg(test)]
mod validation;
mod vdb;
mod volume;

pub use coefficients::{CoefficientError, Coefficients};
pub use distance::{DistanceSample, Distances, Equiangular, Exponential, PlaceSample, collision_density};
pub use glow::Glow;
pub use medium_stack::{Crossing, MOST_MEDIA, MediumStack};
pub use phase::{Lobe, Phase, PhaseError, PhaseSample};
pub use presets::{NAMED_MEDIA, NamedMedium};
pub use tracking::{End, Flight, Losses};
pub use vdb::{DENSITY, FLAMES, TEMPERATURE, VdbError, VdbGrid, VdbSize, read_vdb, vdb_size};
pub use volume::Volume;

use crate::math::Rgb;
use crate::spectra::{Line, LineIndices};
use std::sync::Arc;

/// Index of a medium in its scene; 0 is air. The type is small, because rays carry many of them.
pub type MediumId = u16;

/// Largest number of media in a scene, including air.
pub const MOST_MEDIA_OF_SCENE: usize = MediumId::MAX as usize + 1;

/// The medium that fills space by default.
pub const AIR: MediumId = 0;

/// The medium of a body.
#[derive(Clone, Debug)]
pub struct Medium {
    /// Name in the scene file.
    pub name: String,
    /// Index of refraction; at the d line where it depends on the wavelength.
    pub ior: f32,
    /// The index at each wavelength; `None` where it is the same at all.
    pub dispersion: Option<LineIndices>,
    /// Absorption coefficient, per unit of render space; zero where there is a `volume`, which has its own.
    pub absorption: Rgb,
    /// Scattering, absorption and emission in the medium; `None` where nothing scatters.
    pub volume: Option<Arc<Volume>>,
    /// Rank of the medium: where bodies overlap, the one with the least rank fills the place. No two media have the
    /// same rank.
    pub rank: u32,
}

impl Medium {
    /// Whether it refracts all light as `other` does.
    pub fn is_index_matched(&self, other: &Self) -> bool {
        self.ior == other.ior && self.dispersion == other.dispersion
    }

    /// Index of refraction at a wavelength.
    #[inline]
    pub fn ior_at(&self, line: Line) -> f32 {
        self.dispersion.as_ref().map_or(self.ior, |indices| indices.at(line))
    }

    /// Share of the radiance that is left after `distance` in render space: `exp(-sigma_a d)` (Beer-Lambert).
    #[inline]
    pub fn transmittance(&self, distance: f32) -> Rgb {
        let depth = self.absorption * distance;
        Rgb::new((-depth.x).exp(), (-depth.y).exp(), (-depth.z).exp())
    }

    /// Whether it absorbs anything, in its volume too.
    pub fn absorbs(&self) -> bool {
        let in_volume = |volume: &Arc<Volume>| volume.coefficients().absorption() != Rgb::ZERO;
        !self.is_clear() || self.volume.as_ref().is_some_and(in_volume)
    }

    /// True where [`Self::absorption`] is zero; a `volume` is ignored.
    #[inline]
    pub fn is_clear(&self) -> bool {
        self.absorption == Rgb::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transmittance_over_the_range_of_optical_depth() {
        let medium = |sigma| Medium {
            name: String::new(),
            ior: 1.0,
            dispersion: None,
            absorption: Rgb::splat(sigma),
            volume: None,
            rank: 0,
        };
        for tau in [0.0f64, 1e-6, 0.1, 1.0, 10.0, 80.0] {
            let t = f64::from(medium(tau as f32).transmittance(1.0).x);
            assert!((t / (-f64::from(tau as f32)).exp() - 1.0).abs() < 1e-6, "{tau}: {t}");
        }
        assert_eq!(medium(700.0).transmittance(1.0), Rgb::ZERO);
        assert_eq!(medium(0.0).transmittance(f32::MAX), Rgb::ONE);
    }
}
