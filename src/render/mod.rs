//! Jobs: settings, passes, tiles, progress, statistics.

mod job;
mod maps;
mod memory;
mod observer;
mod probe;
mod settings;
mod stats;

pub use job::{RenderError, RenderRequest, Rendered, Stop, render};
pub use maps::{MapReport, PassOne, build_maps};
pub use memory::{MemoryError, PhotonCounts};
pub use observer::{Observer, Silent};
pub use probe::{ProbeEstimator, ProbePoint, ProbeRequest, Probed, ProbedSurface, Reading, probe};
pub use settings::*;
pub use stats::{CacheStatistics, MapStatistics, PhotonStatistics, ShadowStatistics, Statistics, Times};
