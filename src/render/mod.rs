//! Rendering of pictures: photon pass, pixel pass, progressive rounds, time and memory limits, statistics.
// The lints make a new variant of a setting a compile error until every match handles it.
#![deny(clippy::wildcard_enum_match_arm, clippy::match_wildcard_for_single_variants)]

mod adaptive;
mod atlas;
mod batches;
mod estimate;
mod glints;
mod maps;
mod memory;
mod pace;
mod pixel_footprint;
mod pixels;
mod probe;
mod progressive;
mod radiosity;
mod saved;
mod settings;
mod stats;
mod table;
mod visible_emitters;
mod warnings;

pub use crate::memory::{MemoryError, MemoryEstimate, Resident, allowed_memory};
pub use crate::observer::{Observer, Silent};
pub use adaptive::SampleCounts;
pub use atlas::{
    AtlasDescription, AtlasError, AtlasGroup, AtlasParams, BrickReport, BrickRequest, build_irradiance_atlas,
    open_irradiance_atlas, trace_photon_atlas,
};
pub use maps::{ForPicture, MapReport, PassOne, build_maps, build_maps_from, photon_budget};
pub use memory::PhotonCounts;
pub use pixel_footprint::finest_distances;
pub use pixels::{RenderError, RenderRequest, Rendered, Stop, render, render_with_atlas, render_with_maps};
pub use probe::{
    PROBE_BATCHES, ProbeEstimator, ProbePoint, ProbeRequest, Probed, ProbedSurface, Reading, probe,
};
pub use progressive::{
    BLOCK, Checkpoint, CheckpointError, ErrorEstimate, MergeError, Merged, PartError, PartHeader,
    PartOutcome, PartRange, RoundSize, RoundStatistics, Rounds, blank_checkpoint_bytes, blank_part_bytes,
    blocks_of, error_of_halves, is_part_of, merge_parts, parse_checkpoint_bytes, parse_part_bytes,
    render_in_rounds, render_part, rounds_needed,
};
pub use radiosity::render_radiosity;
pub use saved::{SavedMaps, SavedMapsError, trace_photon_maps, write_photon_maps};
pub use settings::{GuideKind, IntegratorKind, MapKind, Overrides, Quality, Settings, ShadowMode, Show};
pub use stats::{
    AdaptiveStatistics, AtlasStatistics, CacheStatistics, IlluminationStatistics, MapStatistics,
    MediaStatistics, MemoryStatistics, PhotonMapFile, PhotonStatistics, ProcessStatistics,
    RadiosityStatistics, ShadowStatistics, Statistics, Times,
};
