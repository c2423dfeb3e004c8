//! Jobs: settings, passes, tiles, progress, statistics.

mod adaptive;
mod job;
mod maps;
mod memory;
mod observer;
mod pretrace;
mod probe;
mod settings;
mod stats;

pub use adaptive::SampleCounts;
pub use job::{RenderError, RenderRequest, Rendered, Stop, render};
pub use maps::{MapReport, PassOne, build_maps, build_maps_seen};
pub use memory::{MemoryError, PhotonCounts};
pub use observer::{Observer, Silent};
pub use pretrace::finest_distances;
pub use probe::{ProbeEstimator, ProbePoint, ProbeRequest, Probed, ProbedSurface, Reading, probe};
pub use settings::*;
pub use stats::{
    AdaptiveStatistics, CacheStatistics, IlluminationStatistics, MapStatistics, PhotonStatistics,
    ShadowStatistics, Statistics, Times,
};
