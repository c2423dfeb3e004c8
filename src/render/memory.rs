//! Memory of photon maps, computed before any photon is traced.

use super::settings::Settings;
use crate::memory::{MOST_PHOTONS, MemoryError, available_memory};
use crate::scene::{MapKind, RenderPlan};
use serde::Serialize;

/// Bytes per photon in a finished map: 20, plus its share of the search tree.
const MAP_BYTES: f64 = 20.25;

/// Peak bytes per photon while a map is traced and built: first the photons of the tasks and their concatenation, then the concatenated
/// photons and the map.
const BUILD_BYTES: f64 = 40.5;

/// Bytes of precomputed irradiance per photon of a map.
const IRRADIANCE_BYTES: f64 = 27.0 / super::maps::IRRADIANCE_STRIDE as f64;

/// Peak bytes per beam in a medium: the record, 16 pieces with their middles and the tree over them, and the point where it collides.
const BEAM_BYTES: f64 = 1000.0;

/// Peak bytes per photon at a point of a medium.
const POINT_BYTES: f64 = 130.0;

/// Photons to store in each map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct PhotonCounts {
    /// Photons in the global map; zero where there is none.
    pub global: u64,
    /// Photons in the caustic map; zero where there is none.
    pub caustic: u64,
}

/// Which maps get precomputed irradiance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Precomputed {
    global: bool,
    caustic: bool,
}

impl Precomputed {
    /// The maps for which a render with this plan precomputes irradiance.
    pub(super) fn of(settings: &Settings, plan: &RenderPlan) -> Self {
        Self {
            global: plan.final_gather.build && settings.precomputed_irradiance,
            caustic: plan.caustics_at_points.build,
        }
    }
}

/// Bytes of finished maps.
pub(super) fn finished(counts: PhotonCounts, irradiance: Precomputed) -> f64 {
    let bytes = |precomputed| MAP_BYTES + if precomputed { IRRADIANCE_BYTES } else { 0.0 };
    counts.global as f64 * bytes(irradiance.global) + counts.caustic as f64 * bytes(irradiance.caustic)
}

/// Peak bytes: the global map is built first and kept while the caustic map is built.
pub(super) fn at_worst(counts: PhotonCounts, irradiance: Precomputed) -> f64 {
    let before = finished(PhotonCounts { caustic: 0, ..counts }, irradiance);
    (counts.global as f64 * BUILD_BYTES).max(before + counts.caustic as f64 * BUILD_BYTES)
}

impl PhotonCounts {
    /// Photons of the maps that `plan` builds: the counts of `settings`, or counts in the same proportion that fill the photon memory of
    /// `settings`.
    pub fn of(settings: &Settings, plan: &RenderPlan) -> Self {
        let asked = |build: bool, photons: u64| if build { photons } else { 0 };
        let counts = Self {
            global: asked(plan.global_map.build, settings.global_photons),
            caustic: asked(plan.caustic_map.build, settings.caustic_photons),
        };
        let bytes = finished(counts, Precomputed::of(settings, plan));
        match settings.photons_memory {
            Some(memory) if bytes > 0.0 => {
                let factor = memory as f64 / bytes;
                let scaled = |photons: u64| (photons as f64 * factor).floor() as u64;
                Self { global: scaled(counts.global), caustic: scaled(counts.caustic) }
            }
            _ => counts,
        }
    }

    /// The count of one map.
    pub fn for_map(self, kind: MapKind) -> u64 {
        match kind {
            MapKind::Caustic => self.caustic,
            MapKind::Global => self.global,
        }
    }

    /// Checks that a map and this machine can hold the photons.
    ///
    /// # Errors
    /// If they cannot. The error names the photons, their memory, and a remedy.
    pub fn check(self, settings: &Settings, plan: &RenderPlan) -> Result<(), MemoryError> {
        let available = available_memory();
        self.check_against(Precomputed::of(settings, plan), available)?;
        let asked = |build: bool, count: u64| if build { count } else { 0 };
        let beams = asked(plan.volume_caustics.build, settings.volume_beams);
        let photons = asked(plan.volume_map.build, settings.volume_photons);
        let needed = (beams as f64 * BEAM_BYTES + photons as f64 * POINT_BYTES) as u64;
        match available {
            Some(available) if needed > available => {
                Err(MemoryError::Media { beams, photons, needed, available })
            }
            _ => Ok(()),
        }
    }

    fn check_against(self, irradiance: Precomputed, available: Option<u64>) -> Result<(), MemoryError> {
        for (map, asked) in [("global", self.global), ("caustic", self.caustic)] {
            if asked > MOST_PHOTONS {
                return Err(MemoryError::Count { map, asked });
            }
        }
        let needed = at_worst(self, irradiance) as u64;
        match available {
            Some(available) if needed > available => {
                Err(MemoryError::Available { global: self.global, caustic: self.caustic, needed, available })
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photons::{Photon, PhotonClass, PhotonMap};
    use crate::sampling::{Rng, Stream};
    use glam::Vec3;

    #[test]
    fn a_map_takes_what_is_foreseen() {
        let mut rng = Rng::new(0, Stream::Measure, 0);
        let photons: Vec<Photon> = (0..200_000)
            .map(|_| {
                let position = rng.next_2d().extend(rng.next_f32());
                Photon::new(position, Vec3::ONE, Vec3::Y, Vec3::Y, PhotonClass::Direct, 0.5)
            })
            .collect();
        let count = photons.len() as f64;
        let map = PhotonMap::build(photons, 1);
        let bytes = map.memory_bytes() as f64 / count;
        assert!((bytes / MAP_BYTES - 1.0).abs() < 0.01, "{bytes}");
    }

    #[test]
    fn too_many_photons_are_refused_with_a_remedy() {
        let counts = PhotonCounts { global: 100_000_000, caustic: 200_000_000 };
        let all = Precomputed { global: true, caustic: true };
        let needed = at_worst(counts, all);
        assert!((needed - (100e6 * (20.25 + 6.75) + 200e6 * 40.5)).abs() < 1.0, "{needed}");
        let kept = finished(counts, all);
        assert!((kept - 300e6 * (20.25 + 6.75)).abs() < 1.0, "{kept}");
        assert_eq!(counts.check_against(all, Some(needed as u64)), Ok(()));
        assert_eq!(counts.check_against(all, None), Ok(()));
        let refused = counts.check_against(all, Some(4_000_000_000)).unwrap_err().to_string();
        for part in ["10.8 GB", "4.0 GB are available", "--caustic-photons", "--photons-memory 1.6GB"] {
            assert!(refused.contains(part), "no `{part}` in {refused}");
        }
        let beyond = PhotonCounts { global: 1 << 40, caustic: 0 };
        let refused = beyond.check_against(Precomputed::default(), None).unwrap_err().to_string();
        assert!(refused.contains("1099511627776 photons in the global map"), "{refused}");
    }
}
