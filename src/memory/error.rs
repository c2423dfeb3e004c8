//! Errors for renders that would need too much memory, with what to ask for instead.

use super::estimate::{MemoryEstimate, megabytes};

/// A tree counts its points in 32 bits. This leaves room for the 10 % by which the number of photons may exceed the request.
pub(crate) const MOST_PHOTONS: u64 = 3_900_000_000;

/// Why a render is refused for its memory.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MemoryError {
    /// More photons than one map can index.
    #[error(
        "{asked} photons in the {map} map are more than a map holds; ask for at most {MOST_PHOTONS} with \
         --{map}-photons"
    )]
    Count {
        /// "global" or "caustic".
        map: &'static str,
        /// Number of photons asked for.
        asked: u64,
    },
    /// Photon maps that do not fit into the memory of this machine.
    #[error(
        "{global} global and {caustic} caustic photons take {:.1} GB while their maps are built, and {:.1} GB are \
         available; ask for fewer with --global-photons and --caustic-photons, or for as many as fit into some memory, \
         for example --photons-memory {:.1}GB",
        *.needed as f64 / 1e9, *.available as f64 / 1e9, 0.4 * *.available as f64 / 1e9
    )]
    Available {
        /// Global photons asked for.
        global: u64,
        /// Caustic photons asked for.
        caustic: u64,
        /// Bytes that the photon maps take at the peak.
        needed: u64,
        /// Bytes that are free.
        available: u64,
    },
    /// More photons in media than the machine has memory for.
    #[error(
        "{beams} beams and {photons} photons in media take {:.1} GB of memory, and {:.1} GB are available: ask for fewer \
         (--volume-beams, --volume-photons)",
        *.needed as f64 / 1e9, *.available as f64 / 1e9
    )]
    Media {
        /// Beams asked for.
        beams: u64,
        /// Photons at points asked for.
        photons: u64,
        /// Bytes that they take at the peak.
        needed: u64,
        /// Bytes that are free.
        available: u64,
    },
    /// A scene that, all parts together, exceeds the limit or the free memory.
    #[error(
        "{} takes {} {}: {}; and {} {}; {}",
        match estimate.triangles {
            0..50_000 => "the scene".to_owned(),
            triangles => format!("a scene of {:.1} million triangles", triangles as f64 / 1e6),
        },
        megabytes(estimate.peak()),
        estimate.worst().0,
        estimate.parts(),
        megabytes(*most),
        if *is_limit { "are allowed by --memory-limit" } else { "are available" },
        if *is_limit {
            "raise the limit, or render a smaller mesh, a smaller picture or fewer photons"
        } else {
            "render a smaller mesh, a smaller picture or fewer photons, or set --memory-limit if you know better"
        },
    )]
    Scene {
        /// The estimate, part by part.
        estimate: MemoryEstimate,
        /// Bytes that are allowed.
        most: u64,
        /// Whether `most` is a limit that the user set; otherwise it is the free memory of the machine.
        is_limit: bool,
    },
}
