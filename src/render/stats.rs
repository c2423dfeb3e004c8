use super::progressive::RoundStatistics;
use crate::integrators::{Counters, ShadowCounters};
use crate::memory::Resident;
use crate::scene::{MapKind, RenderPlan};
use serde::{Deserialize, Serialize};

/// Seconds by step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
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

/// Memory by step, and what the scene takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct MemoryStatistics {
    /// Bytes of triangles and their normals.
    pub meshes: u64,
    /// Bytes of Embree's hierarchies, where its memory is counted.
    pub hierarchy: Option<u64>,
    /// Once the scene is built; none where the system does not tell.
    pub scene: Option<Resident>,
    /// Once the photon maps are built.
    pub photons: Option<Resident>,
    /// Once the irradiance cache is filled, where there is one.
    pub cache: Option<Resident>,
    /// Once the picture is rendered.
    pub pixels: Option<Resident>,
}

/// What became of the photons of one light. Fluxes in watts, per channel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotonStatistics {
    /// Number of the light.
    pub light: u32,
    /// Photons emitted.
    pub emitted: u64,
    /// Photons stored.
    pub stored: u64,
    /// Surfaces met.
    pub bounces: u64,
    /// Photons that met nothing.
    pub missed: u64,
    /// Photons cut off at the depth limit.
    pub truncated: u64,
    /// Photons that met an interface in another medium than it states.
    pub medium_mismatches: u64,
    /// Flux that left the light towards the aim.
    pub flux_emitted: [f64; 3],
    /// Flux absorbed.
    pub flux_absorbed: [f64; 3],
    /// Flux that left the scene.
    pub flux_escaped: [f64; 3],
    /// Flux cut off.
    pub flux_truncated: [f64; 3],
}

/// One photon map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapStatistics {
    /// Which map.
    pub map: MapKind,
    /// Photons asked for.
    pub asked: u64,
    /// Whether its photons were read from a file; the counts of the photons are then those of when they were traced.
    #[serde(default)]
    pub from_file: bool,
    /// Whether tracing was stopped before all photons were emitted.
    pub stopped: bool,
    /// Photons stored.
    pub photons: u64,
    /// Photons emitted.
    pub emitted: u64,
    /// Memory, photons and search structure.
    pub bytes: u64,
    /// Seconds to trace.
    pub seconds_tracing: f64,
    /// Seconds to build the search structure.
    pub seconds_building: f64,
    /// By light.
    pub lights: Vec<PhotonStatistics>,
}

/// A file that photons were read from.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhotonMapFile {
    /// Its name.
    pub file: String,
    /// Bytes of it.
    pub bytes: u64,
    /// Seconds to read it, before `photons` of the times.
    pub seconds_reading: f64,
    /// Whether precomputed irradiance was taken from it too.
    pub irradiance: bool,
}

/// Illumination maps of all objects together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct IlluminationStatistics {
    /// How large they became.
    #[serde(flatten)]
    pub sizes: crate::photons::IlluminationSizes,
    /// Seconds to sum photons up.
    pub seconds: f64,
}

/// Camera samples of pixels by variance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AdaptiveStatistics {
    /// Camera samples of every pixel of the whole picture before it is decided who gets more.
    pub pilot: u32,
    /// Fewest that a pixel got.
    pub fewest: u32,
    /// Most that a pixel got.
    pub most: u32,
    /// Mean over the whole picture.
    pub mean: f64,
}

/// The irradiance cache.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct CacheStatistics {
    /// Records.
    pub records: u64,
    /// Hemispheres whose light was not finite and which were left out.
    pub rejected: u64,
    /// Rays and look-ups of filling it.
    pub counters: Counters,
}

/// Direct and shadow photons of one light, and what they decided.
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
    /// Hits at edges and corners that were the same crossing as another.
    pub merged: u64,
    /// Crossings beyond what is kept of one ray.
    pub dropped: u64,
    /// Direct photons stored.
    pub direct_photons: u64,
    /// Shadow photons stored.
    pub shadow_photons: u64,
    /// Memory of what is kept of them.
    pub bytes: u64,
    /// What was decided at the points that were shaded.
    #[serde(flatten)]
    pub decisions: ShadowCounters,
    /// Shadow rays saved of those that full shadow rays would have needed, percent.
    pub rays_saved_percent: f64,
}

/// What a process took of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ProcessStatistics {
    /// Seconds on the clock since it started.
    pub wall: f64,
    /// Seconds of the processor, all threads.
    pub cpu: f64,
    /// Most memory that it held at a time, bytes; `None` where the system does not tell.
    pub peak_memory: Option<u64>,
}

/// Everything that `--stats` writes.
#[derive(Clone, Debug, Serialize)]
pub struct Statistics {
    /// Version of this layout.
    pub schema: u32,
    /// Scene.
    pub scene: String,
    /// Settings.
    pub settings: super::Settings,
    /// What was built, and why.
    pub plan: RenderPlan,
    /// Seconds by step.
    pub times: Times,
    /// Bytes by step.
    pub memory: MemoryStatistics,
    /// Threads.
    pub threads: usize,
    /// Camera samples taken per pixel; of the asked-for ones where the render was stopped.
    pub samples: u64,
    /// Photon maps.
    pub maps: Vec<MapStatistics>,
    /// The file that they were read from; none where photons were traced.
    pub photon_map_file: Option<PhotonMapFile>,
    /// Shadow photons, by light; empty where they are not used.
    pub shadows: Vec<ShadowStatistics>,
    /// Seconds to trace and sort them.
    pub seconds_shadows: f64,
    /// Seconds to precompute irradiance.
    pub seconds_irradiance: f64,
    /// Bytes of precomputed irradiance.
    pub irradiance_bytes: u64,
    /// The irradiance cache, where there is one.
    pub cache: Option<CacheStatistics>,
    /// Illumination maps, where there are some.
    pub illumination: Option<IlluminationStatistics>,
    /// Samples by variance, where they were asked for.
    pub adaptive: Option<AdaptiveStatistics>,
    /// Bytes of the distributions that guide directions.
    pub guide_bytes: u64,
    /// Rays and look-ups of pass 2.
    pub counters: Counters,
    /// Segments per camera ray: the mean ray depth.
    pub mean_depth: f64,
    /// Segments from the eye to the look-up behind a diffuse reflection, mean over these paths (filling the cache included):
    /// the mean depth of image-sampling rays of section 6 of Jensen 1996. Zero where there are none.
    pub mean_path_depth: f64,
    /// Samples that were not finite and were left out.
    pub rejected_samples: u64,
    /// Rounds, where the picture was rendered in rounds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rounds: Option<RoundStatistics>,
    /// What the process took, where it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub process: Option<ProcessStatistics>,
    /// Warnings.
    pub warnings: Vec<String>,
}
