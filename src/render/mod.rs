//! Jobs: settings, passes, tiles, progress, statistics.

mod job;
mod maps;
mod memory;
mod observer;
mod settings;
mod stats;

pub use job::{RenderError, RenderRequest, Rendered, Stop, render};
pub use maps::{MapReport, PassOne, build_maps, build_maps_for};
pub use memory::{MemoryError, PhotonCounts};
pub use observer::{Observer, Silent};
pub use settings::*;
pub use stats::{CacheStatistics, MapStatistics, PhotonStatistics, ShadowStatistics, Statistics, Times};
