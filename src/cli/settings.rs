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

    /// Photons in an estimate from the global map.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    global_nearest: Option<u32>,

    /// Photons in an estimate from the caustic map.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    caustic_nearest: Option<u32>,

    /// Radius of estimates from the global map: all photons within it, instead of the nearest.
    #[arg(long, value_name = "METRES", value_parser = radius, conflicts_with = "global_nearest")]
    global_radius: Option<f64>,

    /// Radius of estimates from the caustic map: all photons within it, instead of the nearest.
    #[arg(long, value_name = "METRES", value_parser = radius, conflicts_with = "caustic_nearest")]
    caustic_radius: Option<f64>,

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

    /// Whether estimates shrink where more photons change them in one direction only, as at the edge of a caustic.
    #[arg(long, value_name = "BOOL")]
    differential_check: Option<bool>,

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

fn radius(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(radius) if radius > 0.0 && radius.is_finite() => Ok(radius),
        _ => Err("a radius is a number of metres above zero".to_owned()),
    }
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
            global_nearest: self.global_nearest,
            caustic_nearest: self.caustic_nearest,
            global_radius: self.global_radius,
            caustic_radius: self.caustic_radius,
            kernel,
            estimator: self.estimator.map(|estimator| match estimator {
                EstimatorArg::AsPrinted => Estimator::AsPrinted,
                EstimatorArg::Corrected => Estimator::Corrected,
            }),
            search: self.search.map(|search| match search {
                SearchArg::Sphere => SearchRegion::Sphere,
                SearchArg::Disc => SearchRegion::Disc,
            }),
            differential_check: self.differential_check,
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
