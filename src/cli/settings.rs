//! Options that choose how a picture is computed; they go over those of the scene file.

use cardioid::photons::{Estimator, Kernel, SearchRegion};
use cardioid::render::{IntegratorKind, MapKind, Overrides, Quality};
use clap::{Args, ValueEnum};

/// Settings of the renderer.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Method")]
pub(crate) struct SettingsArgs {
    /// Preset that all other settings start from.
    #[arg(long, value_enum)]
    quality: Option<QualityArg>,

    /// How the picture is computed.
    #[arg(long, value_enum)]
    integrator: Option<IntegratorArg>,

    /// Map that `--integrator photons` shows.
    #[arg(long, value_enum)]
    map: Option<MapArg>,

    /// Seed of all random numbers: the same seed gives the same bits.
    #[arg(long)]
    seed: Option<u64>,

    /// Camera samples per pixel.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    spp: Option<u32>,

    /// Photons in the global map; the caustic map keeps its ratio to it.
    #[arg(long, value_name = "N")]
    photons: Option<u64>,

    /// Photons in the global map alone.
    #[arg(long, value_name = "N")]
    global_photons: Option<u64>,

    /// Photons in the caustic map.
    #[arg(long, value_name = "N")]
    caustic_photons: Option<u64>,

    /// As many photons as fit into this memory, for example 2GB; the maps keep their ratio.
    #[arg(long, value_name = "BYTES", value_parser = bytes, conflicts_with_all = ["photons", "global_photons", "caustic_photons"])]
    photons_memory: Option<u64>,

    /// Photons in an estimate from the global map.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    global_nearest: Option<u32>,

    /// Photons in an estimate from the caustic map.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    caustic_nearest: Option<u32>,

    /// Kernel of caustic estimates.
    #[arg(long, value_enum)]
    kernel: Option<KernelArg>,

    /// Filter constant of the cone kernel, at least 1.
    #[arg(long, value_name = "K", value_parser = cone_constant)]
    cone_k: Option<f32>,

    /// Free of the known bias of density estimates, or as the formulas are printed.
    #[arg(long, value_enum)]
    estimator: Option<EstimatorArg>,

    /// Region in which photons are searched.
    #[arg(long, value_enum)]
    search: Option<SearchArg>,

    /// Final gather rays per camera sample.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    gather_samples: Option<u32>,

    /// Whether gather rays read irradiance precomputed at the photons.
    #[arg(long, value_name = "BOOL")]
    precomputed_irradiance: Option<bool>,

    /// Shadow rays per light and camera sample.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    light_samples: Option<u32>,

    /// Whether estimates leave out what cannot be seen from their centre (not by default with `as-printed`).
    #[arg(long, value_name = "BOOL")]
    visible_kernel: Option<bool>,

    /// Longest path, in surfaces.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    max_depth: Option<u32>,
}

fn bytes(text: &str) -> Result<u64, String> {
    let message = || "write a number of bytes with kB, MB or GB, for example 500MB".to_owned();
    let at = text.find(|c: char| c.is_ascii_alphabetic()).ok_or_else(message)?;
    let (number, unit) = text.split_at(at);
    let factor = match unit.to_ascii_lowercase().as_str() {
        "b" => 1.0,
        "kb" => 1e3,
        "mb" => 1e6,
        "gb" => 1e9,
        _ => return Err(message()),
    };
    let bytes = number.trim().parse::<f64>().map_err(|_| message())? * factor;
    if (1000.0..1e15).contains(&bytes) { Ok(bytes as u64) } else { Err(message()) }
}

fn cone_constant(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(k) if k >= 1.0 && k.is_finite() => Ok(k),
        _ => Err("the filter constant is a number of at least 1".to_owned()),
    }
}

impl SettingsArgs {
    /// What was asked for here, over what the scene file asks for.
    pub(crate) fn over(&self, scene: &Overrides) -> Overrides {
        let quality = self.quality.map(Quality::from);
        let preset = quality.or(scene.quality).unwrap_or(Quality::Preview).settings();
        let caustic_by_ratio = self.photons.map(|photons| {
            let ratio = preset.caustic_photons as f64 / preset.global_photons as f64;
            (photons as f64 * ratio).round() as u64
        });
        let kernel = match (self.kernel, self.cone_k) {
            (Some(KernelArg::Cone), k) => Some(Kernel::Cone { k: k.unwrap_or(1.0) }),
            (None, Some(k)) => Some(Kernel::Cone { k }),
            (Some(KernelArg::Constant), _) => Some(Kernel::Constant),
            (Some(KernelArg::Epanechnikov), _) => Some(Kernel::Epanechnikov),
            (Some(KernelArg::Gaussian), _) => Some(Kernel::Gaussian),
            (None, None) => None,
        };
        Overrides {
            quality,
            integrator: self.integrator.map(|integrator| match integrator {
                IntegratorArg::PhotonMap => IntegratorKind::PhotonMap,
                IntegratorArg::Photons => IntegratorKind::Photons,
                IntegratorArg::Path => IntegratorKind::Path,
            }),
            map: self.map.map(|map| match map {
                MapArg::Global => MapKind::Global,
                MapArg::Caustic => MapKind::Caustic,
            }),
            seed: self.seed,
            spp: self.spp,
            global_photons: self.global_photons.or(self.photons),
            caustic_photons: self.caustic_photons.or(caustic_by_ratio),
            photons_memory: self.photons_memory,
            global_nearest: self.global_nearest,
            caustic_nearest: self.caustic_nearest,
            kernel,
            estimator: self.estimator.map(|estimator| match estimator {
                EstimatorArg::AsPrinted => Estimator::AsPrinted,
                EstimatorArg::Corrected => Estimator::Corrected,
            }),
            search: self.search.map(|search| match search {
                SearchArg::Sphere => SearchRegion::Sphere,
                SearchArg::Disc => SearchRegion::Disc,
            }),
            gather_samples: self.gather_samples,
            precomputed_irradiance: self.precomputed_irradiance,
            light_samples: self.light_samples,
            visible_kernel: self.visible_kernel,
            max_depth: self.max_depth,
        }
        .over(scene.clone())
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum QualityArg {
    /// Seconds: to see whether the scene is right.
    Draft,
    /// A good idea of the final picture (the default).
    Preview,
    /// What one publishes.
    Final,
    /// What one measures others against.
    Reference,
}

impl From<QualityArg> for Quality {
    fn from(quality: QualityArg) -> Self {
        match quality {
            QualityArg::Draft => Self::Draft,
            QualityArg::Preview => Self::Preview,
            QualityArg::Final => Self::Final,
            QualityArg::Reference => Self::Reference,
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum IntegratorArg {
    /// Photon maps and final gathering (the default).
    PhotonMap,
    /// A photon map shown directly.
    Photons,
    /// Unbiased path tracing, the reference.
    Path,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum MapArg {
    /// All photons on diffuse surfaces.
    Global,
    /// Photons that met only specular surfaces.
    Caustic,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum KernelArg {
    /// The same weight for all photons.
    Constant,
    /// Weights that fall linearly with distance (the default).
    Cone,
    /// 1 - (d/r)^2.
    Epanechnikov,
    /// A Gaussian.
    Gaussian,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum EstimatorArg {
    /// Eq. (3) and (5) of Jensen 1996 to the letter.
    AsPrinted,
    /// Without their bias of N/(N-1) (the default).
    Corrected,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SearchArg {
    /// A sphere.
    Sphere,
    /// A sphere flattened along the normal (the default).
    Disc,
}
