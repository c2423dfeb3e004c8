//! Memory estimate of a render, part by part and phase by phase, and its check against the limit.

use super::error::MemoryError;
use super::system::free_memory;
use serde::Serialize;

/// Bytes of Embree's hierarchy for each triangle: 67 were measured on meshes of a million triangles and more; the rest is margin.
const HIERARCHY: u64 = 72;

/// Bytes for each triangle while the hierarchy is built, in addition to the finished hierarchy.
const BUILDING: u64 = 40;

/// Bytes of film for each pixel: the sums of all layers, and twice their values while they are written.
pub(crate) const FILM: u64 = 450;

/// Bytes of the program and of the data that its libraries hold. The pages of the libraries themselves, 90 MB, are backed by
/// their files, so the system reclaims them when it needs the memory.
const PROGRAM: u64 = 60_000_000;

/// Bytes of a light or an emitting shape: its description, the object itself, and its entries in the tables for light sampling.
/// Measured with ten and thirty thousand of each kind: 2.1 to 4.2 kB.
pub(crate) const LIGHT: u64 = 4200;

/// Bytes of an instance: its description and the object itself. Measured with as many: 1.0 to 1.3 kB.
pub(crate) const INSTANCE: u64 = 1300;

/// Estimated bytes by use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct MemoryEstimate {
    /// Triangles of all mesh files.
    pub triangles: u64,
    /// Meshes from files, as shared by Embree and the renderer.
    pub meshes: u64,
    /// Additional memory while files are read one after the other.
    pub reading: u64,
    /// Lights and instances.
    pub lights: u64,
    /// Textures that stay in memory.
    pub textures: u64,
    /// Voxels of media, and bounds on the density of others.
    pub voxels: u64,
    /// Embree's hierarchy.
    pub hierarchy: u64,
    /// Additional memory while the hierarchy is built.
    pub building: u64,
    /// Photon maps and precomputed irradiance.
    pub photons: u64,
    /// Additional memory while photons are traced and their trees are built.
    pub tracing: u64,
    /// Tables that aim photons, in memory only while photons are traced.
    pub aiming: u64,
    /// The picture.
    pub film: u64,
}

impl MemoryEstimate {
    /// The estimate for the hierarchy over `triangles` triangles.
    pub(crate) fn of_triangles(triangles: u64) -> Self {
        let (hierarchy, building) = (triangles.saturating_mul(HIERARCHY), triangles.saturating_mul(BUILDING));
        Self { triangles, hierarchy, building, ..Self::default() }
    }

    /// Bytes at the peak.
    pub fn peak(&self) -> u64 {
        self.worst().1.iter().map(|&(_, bytes)| bytes).fold(0, u64::saturating_add)
    }

    /// Name of the phase with the highest use, and its parts.
    pub(super) fn worst(&self) -> (&'static str, Vec<(&'static str, u64)>) {
        let always = [
            ("the program", PROGRAM),
            ("meshes", self.meshes),
            ("lights and instances", self.lights),
            ("textures", self.textures),
            ("voxels of media", self.voxels),
        ];
        let scene = ("Embree's hierarchy", self.hierarchy);
        let moments = [
            ("while files are read", vec![("reading", self.reading)]),
            ("while Embree's hierarchy is built", vec![scene, ("building it", self.building)]),
            (
                "while photons are traced",
                vec![
                    scene,
                    ("photon maps", self.photons),
                    ("building them", self.tracing),
                    ("tables of lights", self.aiming),
                ],
            ),
            (
                "while the picture is rendered",
                vec![scene, ("photon maps", self.photons), ("the picture", self.film)],
            ),
        ];
        let sum = |parts: &[(&str, u64)]| parts.iter().map(|&(_, bytes)| bytes).fold(0, u64::saturating_add);
        let [first, others @ ..] = moments;
        let worst = others.into_iter().fold(first, |a, b| if sum(&b.1) > sum(&a.1) { b } else { a });
        (worst.0, always.into_iter().chain(worst.1).collect())
    }

    /// The parts of that phase as text for a message.
    pub(super) fn parts(&self) -> String {
        let (_, parts) = self.worst();
        // Parts below half a megabyte would print as 0 MB.
        let parts = parts.iter().filter(|(_, bytes)| *bytes >= 500_000);
        parts.map(|(what, bytes)| format!("{what} {}", megabytes(*bytes))).collect::<Vec<_>>().join(", ")
    }

    /// Refuses an estimate above `limit` or, without a limit, above the free memory of the machine.
    ///
    /// # Errors
    /// The estimate, part by part, and what to do.
    pub fn check(&self, limit: Option<u64>) -> Result<(), MemoryError> {
        self.check_against(limit, free_memory())
    }

    fn check_against(&self, limit: Option<u64>, available: Option<u64>) -> Result<(), MemoryError> {
        match limit.or(available) {
            Some(most) if self.peak() > most => {
                Err(MemoryError::Scene { estimate: *self, most, is_limit: limit.is_some() })
            }
            _ => Ok(()),
        }
    }
}

/// A number of bytes as text for messages.
pub(crate) fn megabytes(bytes: u64) -> String {
    match bytes {
        0..10_000_000_000 => format!("{:.0} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_moment_counts_and_is_told_part_by_part() {
        let estimate = MemoryEstimate {
            triangles: 20_000_000,
            meshes: 360_000_000,
            reading: 100_000_000,
            hierarchy: 1_440_000_000,
            building: 800_000_000,
            photons: 30_000_000,
            tracing: 20_000_000,
            film: 900_000_000,
            ..MemoryEstimate::default()
        };
        assert_eq!(estimate.peak(), PROGRAM + 360_000_000 + 1_440_000_000 + 30_000_000 + 900_000_000);
        assert!(estimate.check_against(Some(3_000_000_000), Some(1)).is_ok());
        assert!(estimate.check_against(None, None).is_ok());
        let message = estimate.check_against(Some(2_000_000_000), None).unwrap_err().to_string();
        for part in [
            "20.0 million triangles",
            "2790 MB while the picture is rendered",
            "the program 60 MB",
            "meshes 360 MB",
            "picture 900 MB",
            "--memory-limit",
            "2000 MB",
        ] {
            assert!(message.contains(part), "no `{part}` in {message}");
        }
        let message = estimate.check_against(None, Some(2_000_000_000)).unwrap_err().to_string();
        assert!(message.contains("2000 MB are available"), "{message}");
        assert!(!message.contains("  "), "{message}");
    }
}
