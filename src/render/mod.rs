//! Jobs: settings, passes, tiles, progress, statistics.

mod job;
mod maps;
mod memory;
mod observer;
mod progressive;
mod settings;
mod stats;

pub use job::{RenderError, RenderRequest, Rendered, Stop, render};
pub use maps::{MapReport, PassOne, build_maps};
pub use memory::{MemoryError, PhotonCounts};
pub use observer::{Observer, Silent};
pub use progressive::{
    Checkpoint, CheckpointError, ErrorEstimate, RoundStatistics, Rounds, error_of_halves, render_in_rounds,
};
pub use settings::*;
pub use stats::{
    CacheStatistics, MapStatistics, PhotonStatistics, ProcessStatistics, ShadowStatistics, Statistics, Times,
};
