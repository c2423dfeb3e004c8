//! Estimates the memory that photon maps add to a render, before photons are traced.

use super::memory::{PhotonCounts, Precomputed, at_worst, finished};
use super::settings::Settings;
use crate::memory::MemoryEstimate;
use crate::photons::{FEW_LIGHTS, FEW_TARGETS, LEAST_FOR_A_TABLE};
use crate::scene::{RenderPlan, Scene};

/// Bytes of the table that aims photons of the global map, per light that has one.
const HEADINGS: u64 = 9000;

/// Bytes of the table that aims photons of the caustic map, per light with more than a few casters to distinguish. The value is for a
/// small light, the usual case.
const CASTERS: u64 = 26_000;

/// A light usually emits at most this many photons per stored photon. The estimate of tables for the global map uses this ratio.
const EMITTED_PER_STORED: u64 = 8;

impl MemoryEstimate {
    /// This estimate plus the photon maps of `scene` that `settings` require.
    #[must_use]
    pub fn with_photons(self, settings: &Settings, plan: &RenderPlan, scene: &Scene) -> Self {
        let counts = PhotonCounts::of(settings, plan);
        let irradiance = Precomputed::of(settings, plan);
        let photons = finished(counts, irradiance) as u64;
        let tracing = (at_worst(counts, irradiance) as u64).saturating_sub(photons);
        Self { photons, tracing, aiming: aiming(settings, counts, scene), ..self }
    }
}

/// Bytes of the tables that aim photons: the larger of the two maps' totals.
fn aiming(settings: &Settings, counts: PhotonCounts, scene: &Scene) -> u64 {
    let lights = scene.lights().len() as u64;
    if !settings.aim_photons {
        return 0;
    }
    let with_table = match counts.global {
        0 => 0,
        photons => lights.min(photons.saturating_mul(EMITTED_PER_STORED) / LEAST_FOR_A_TABLE + FEW_LIGHTS),
    };
    let with_casters = if counts.caustic > 0 && scene.casters().len() > FEW_TARGETS { lights } else { 0 };
    with_table.saturating_mul(HEADINGS).max(with_casters.saturating_mul(CASTERS))
}
