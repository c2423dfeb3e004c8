//! Statistics of a render, as `--stats` writes them.

use super::progressive::RoundStatistics;
use crate::bricks::{AtlasCounts, BrickCounters};
use crate::integrators::{Counters, RadiosityView, ShadowCounters};
use crate::memory::Resident;
use crate::radiosity::RadiosityReport;
use crate::scene::{MapKind, RenderPlan};
use serde::{Deserialize, Serialize};

/// Seconds by step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct Times {
    /// Reading and building the scene.
    pub scene: f64,
    /// Pass 1.
    pub photons: f64,
    /// Filling the irradiance cache.
    pub cache: f64,
    /// Pass 2.
    pub pixels: f64,
}

/// Memory by step, and of the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct MemoryStatistics {
    /// Bytes of triangles and their normals.
    pub meshes: u64,
    /// Bytes of Embree's hierarchies; `None` where Embree's memory is not counted.
    pub hierarchy: Option<u64>,
    /// Memory of the process once the scene is built; `None` where the system does not report it.
    pub scene: Option<Resident>,
    /// Memory of the process once the photon maps are built.
    pub photons: Option<Resident>,
    /// Memory of the process once the irradiance cache is filled, where there is one.
    pub cache: Option<Resident>,
    /// Memory of the process once the picture is rendered.
    pub pixels: Option<Resident>,
}

/// Counts and fluxes of the photons of one light. Fluxes are in watts, per channel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotonStatistics {
    /// Number of the light.
    pub light: u32,
    /// Photons emitted.
    pub emitted: u64,
    /// Photons stored.
    pub stored: u64,
    /// Hits on surfaces.
    pub bounces: u64,
    /// Photons that hit nothing.
    pub missed: u64,
    /// Photons cut off at the depth limit.
    pub truncated: u64,
    /// Photons that hit an interface from another medium than the interface states.
    pub medium_mismatches: u64,
    /// Flux that left the light towards the aim.
    pub flux_emitted: [f64; 3],
    /// Flux absorbed.
    pub flux_absorbed: [f64; 3],
    /// Flux that left the scene.
    pub flux_escaped: [f64; 3],
    /// Flux of photons cut off at the depth limit.
    pub flux_truncated: [f64; 3],
}

/// One photon map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapStatistics {
    /// Kind of the map.
    pub map: MapKind,
    /// Photons asked for.
    pub asked: u64,
    /// Whether its photons were read from a file. The photon counts are then those of the original tracing.
    #[serde(default)]
    pub from_file: bool,
    /// Whether tracing was stopped before all photons were emitted.
    pub stopped: bool,
    /// Photons stored.
    pub photons: u64,
    /// Photons emitted.
    pub emitted: u64,
    /// Bytes of memory for photons and search structure.
    pub bytes: u64,
    /// Seconds to trace.
    pub seconds_tracing: f64,
    /// Seconds to build the search structure.
    pub seconds_building: f64,
    /// Photons by light.
    pub lights: Vec<PhotonStatistics>,
}

/// A file that photons were read from.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhotonMapFile {
    /// Its name.
    pub file: String,
    /// Its size in bytes.
    pub bytes: u64,
    /// Seconds to read it; [`Times::photons`] does not include them.
    pub seconds_reading: f64,
    /// Whether precomputed irradiance was also read from it.
    pub irradiance: bool,
}

/// Illumination maps of all objects together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct IlluminationStatistics {
    /// Their sizes.
    #[serde(flatten)]
    pub sizes: crate::photons::IlluminationSizes,
    /// Seconds to sum photons up.
    pub seconds: f64,
}

/// Photons in media that scatter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MediaStatistics {
    /// Beams of caustics.
    pub beams: u64,
    /// Photons at points: caustics for rays along beams, and light that was scattered before.
    pub points: u64,
    /// Photons emitted.
    pub emitted: u64,
    /// Bytes of memory.
    pub bytes: u64,
    /// Seconds to trace and to build the search structures.
    pub seconds: f64,
}

/// The irradiance atlas on disk, and what was read of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct AtlasStatistics {
    /// Sizes.
    #[serde(flatten)]
    pub counts: AtlasCounts,
    /// Bytes that the cache may take.
    pub budget: u64,
    /// Look-ups of bricks, filling the irradiance cache included.
    pub lookups: BrickCounters,
    /// Share of the look-ups of bricks that read no file, in percent.
    pub hit_percent: f64,
    /// Look-ups of bricks for each gather ray that read the atlas.
    pub bricks_per_ray: f64,
}

/// Adaptive camera samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AdaptiveStatistics {
    /// Pilot samples: camera samples of every pixel of the whole picture, from which the other samples are distributed.
    pub pilot: u32,
    /// Fewest samples of a pixel.
    pub fewest: u32,
    /// Most samples of a pixel.
    pub most: u32,
    /// Mean samples per pixel over the whole picture.
    pub mean: f64,
}

/// The irradiance cache.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct CacheStatistics {
    /// Records.
    pub records: u64,
    /// Hemispheres that were left out because their light was not finite.
    pub rejected: u64,
    /// Rays and lookups while it was filled.
    pub counters: Counters,
}

/// Direct and shadow photons of one light, and the decisions based on them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ShadowStatistics {
    /// Number of the light.
    pub light: u32,
    /// Rays traced through the scene.
    pub rays: u64,
    /// Rays that crossed nothing.
    pub missed: u64,
    /// Surfaces crossed.
    pub crossings: u64,
    /// Hits at edges and corners that were merged into another crossing.
    pub merged: u64,
    /// Crossings beyond the number that is kept per ray.
    pub dropped: u64,
    /// Direct photons stored.
    pub direct_photons: u64,
    /// Shadow photons stored.
    pub shadow_photons: u64,
    /// Bytes of memory of the structure built from them.
    pub bytes: u64,
    /// Decisions at shaded points.
    #[serde(flatten)]
    pub decisions: ShadowCounters,
    /// Share of shadow rays that were saved, in percent of those needed without shadow photons.
    pub rays_saved_percent: f64,
}

/// Time and memory of the process.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ProcessStatistics {
    /// Wall-clock seconds since it started.
    pub wall: f64,
    /// Processor seconds of all threads.
    pub cpu: f64,
    /// Peak memory in bytes; `None` where the system does not report it.
    pub peak_memory: Option<u64>,
}

/// A radiosity solution and how it is shown.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RadiosityStatistics {
    /// How it is shown.
    pub view: RadiosityView,
    /// Its figures.
    #[serde(flatten)]
    pub solution: RadiosityReport,
}

/// The complete statistics that `--stats` writes.
#[derive(Clone, Debug, Serialize)]
pub struct Statistics {
    /// Version of this layout.
    pub schema: u32,
    /// Name of the scene.
    pub scene: String,
    /// Settings.
    pub settings: super::Settings,
    /// The plan: what was built, and why.
    pub plan: RenderPlan,
    /// Seconds by step.
    pub times: Times,
    /// Memory by step.
    pub memory: MemoryStatistics,
    /// Number of threads.
    pub threads: usize,
    /// Mean camera samples taken per pixel: fewer than requested where the render was stopped.
    pub samples: u64,
    /// Photon maps.
    pub maps: Vec<MapStatistics>,
    /// The file that the maps were read from; `None` where photons were traced.
    pub photon_map_file: Option<PhotonMapFile>,
    /// Shadow photons, by light; empty where they are not used.
    pub shadows: Vec<ShadowStatistics>,
    /// Seconds to trace and sort shadow photons.
    pub seconds_shadows: f64,
    /// Seconds to precompute irradiance.
    pub seconds_irradiance: f64,
    /// Bytes of precomputed irradiance.
    pub irradiance_bytes: u64,
    /// The irradiance cache, where there is one.
    pub cache: Option<CacheStatistics>,
    /// Illumination maps, where there are any.
    pub illumination: Option<IlluminationStatistics>,
    /// Photons in media, where there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub media: Option<MediaStatistics>,
    /// The irradiance atlas on disk, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub atlas: Option<AtlasStatistics>,
    /// The radiosity solution, where the picture shows one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radiosity: Option<RadiosityStatistics>,
    /// Adaptive samples, where they were requested.
    pub adaptive: Option<AdaptiveStatistics>,
    /// Bytes of the distributions that guide directions.
    pub guide_bytes: u64,
    /// Rays and lookups of pass 2.
    pub counters: Counters,
    /// Segments per camera ray: the mean ray depth.
    pub mean_depth: f64,
    /// Mean number of segments from the eye to the lookup behind a diffuse reflection, over these paths (including those that fill the
    /// cache): the mean depth of image-sampling rays of section 6 of Jensen 1996. Zero where there are no such paths.
    pub mean_path_depth: f64,
    /// Samples that were not finite and were left out.
    pub rejected_samples: u64,
    /// Rounds, where the picture was rendered progressively.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rounds: Option<RoundStatistics>,
    /// Time and memory of the process, where they are known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub process: Option<ProcessStatistics>,
    /// Warnings.
    pub warnings: Vec<String>,
}
