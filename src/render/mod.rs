//! Jobs: settings, passes, tiles, progress, statistics.

mod estimate;
mod job;
mod maps;
mod memory;
mod observer;
mod saved;
mod settings;
mod stats;
mod table;

pub use estimate::MemoryEstimate;
pub use job::{RenderError, RenderRequest, Rendered, Stop, render, render_with_maps};
pub use maps::{MapReport, PassOne, build_maps};
pub use memory::{MemoryError, PhotonCounts};
pub use observer::{Observer, Silent};
pub use saved::{SavedMaps, SavedMapsError, trace_photon_maps, write_photon_maps};
pub use settings::*;
pub use stats::{
    CacheStatistics, MapStatistics, MemoryStatistics, PhotonMapFile, PhotonStatistics, Resident,
    ShadowStatistics, Statistics, Times,
};
