//! Options that choose how a picture is computed; they go over those of the scene file.

use cardioid::photons::{Estimator, Kernel, SearchRegion};
use cardioid::render::{GuideKind, IntegratorKind, MapKind, Overrides, Quality, ShadowMode, Show};
use clap::{Args, ValueEnum};

/// Settings of the renderer.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Method")]
pub(crate) struct SettingsArgs {
    /// Preset that all other settings start from. Each takes several times as long as the one before.
    #[arg(long, value_enum)]
    quality: Option<QualityArg>,

    /// How the picture is computed.
    #[arg(long, value_enum)]
    integrator: Option<IntegratorArg>,

    /// Map that `--integrator photons` shows.
    #[arg(long, value_enum)]
    map: Option<MapArg>,

    /// Seed of all random numbers: the same seed gives the same bits.
    #[arg(long, value_name = "N", value_parser = seed)]
    seed: Option<u64>,

    /// Camera samples per pixel. Time in proportion; noise falls with the root.
    #[arg(long, value_name = "N", value_parser = count_from_one)]
    spp: Option<u32>,

    /// Photons in the global map; the caustic map keeps its ratio to it. 21 bytes each; time in proportion.
    ///
    /// Counts may be written 500000, 500_000, 500k, 0.5M or 5e5, here and in all options below.
    #[arg(long, value_name = "N", value_parser = count)]
    photons: Option<u64>,

    /// Photons in the global map alone.
    #[arg(long, value_name = "N", value_parser = count)]
    global_photons: Option<u64>,

    /// Photons in the caustic map.
    #[arg(long, value_name = "N", value_parser = count)]
    caustic_photons: Option<u64>,

    /// No caustic map: surfaces do not get the light that comes by way of specular ones alone.
    #[arg(long, conflicts_with = "caustic_photons")]
    no_caustics: bool,

    /// Whether photons are aimed by projection maps, rather than sent wherever the lights shine: changes noise, not light.
    #[arg(long, value_name = "BOOL")]
    aim_photons: Option<bool>,

    /// As many photons as fit into this memory, for example 2GB; the maps keep their ratio.
    #[arg(long, value_name = "BYTES", value_parser = bytes, conflicts_with_all = ["photons", "global_photons", "caustic_photons"])]
    photons_memory: Option<u64>,

    /// Photons in an estimate from the global map. More: smoother, blurred wider, slower.
    #[arg(long, value_name = "N", value_parser = count_from_one)]
    global_nearest: Option<u32>,

    /// Photons in an estimate from the caustic map. More: smoother, blurred wider, slower.
    #[arg(long, value_name = "N", value_parser = count_from_one)]
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

    /// Final gather rays per camera sample: less noise in indirect light, and most of the time of many scenes.
    #[arg(long, value_name = "N", value_parser = count_from_one)]
    gather_samples: Option<u32>,

    /// Distribution rays at the first highly glossy surface of a camera sample; deeper ones get fewer.
    #[arg(long, value_name = "N", value_parser = count_from_one)]
    glossy_samples: Option<u32>,

    /// What helps to draw the directions of gather rays and paths: pays where indirect light comes from few directions.
    #[arg(long, value_enum)]
    guide: Option<GuideArg>,

    /// Whether gather rays read irradiance precomputed at the photons: much faster than an estimate for each of them.
    #[arg(long, value_name = "BOOL")]
    precomputed_irradiance: Option<bool>,

    /// Shadow rays per light and camera sample: less noise in soft shadows.
    #[arg(long, value_name = "N", value_parser = count_from_one)]
    light_samples: Option<u32>,

    /// Whether estimates leave out what cannot be seen from their centre (not by default with `as-printed`).
    #[arg(long, value_name = "BOOL")]
    visible_kernel: Option<bool>,

    /// Camera samples of a pixel nearer than this share of the radius of a caustic estimate share it; 0 for none.
    #[arg(long, value_name = "SHARE", value_parser = share)]
    caustic_reuse: Option<f32>,

    /// Where shadow rays are traced: everywhere, or only where shadow photons leave open whether a light is seen. Without a
    /// mode: bounded.
    #[arg(long, value_enum, value_name = "MODE", num_args = 0..=1, default_missing_value = "bounded")]
    shadow_photons: Option<ShadowArg>,

    /// Rays that place shadow photons, of all lights together.
    #[arg(long, value_name = "N", value_parser = count)]
    shadow_photon_rays: Option<u64>,

    /// What `--integrator photons` shows.
    #[arg(long, value_enum)]
    show: Option<ShowArg>,

    /// Longest path, in surfaces; what is cut off is counted, and told where it matters.
    #[arg(long, value_name = "N", value_parser = count_from_one)]
    max_depth: Option<u32>,

    /// Whether indirect light of Lambertian surfaces is interpolated between few places.
    #[arg(long, value_name = "BOOL")]
    irradiance_cache: Option<bool>,

    /// Largest error of that interpolation (Ward's a), 0.01 to 1: smaller is better and slower.
    #[arg(long, value_name = "A", value_parser = cache_error)]
    cache_error: Option<f32>,

    /// Gather rays for each place of the cache.
    #[arg(long, value_name = "N", value_parser = cache_samples)]
    cache_samples: Option<u32>,

    /// Whether objects that the scene gives illumination maps have them; otherwise photon maps serve everywhere.
    #[arg(long, value_name = "BOOL")]
    illumination_maps: Option<bool>,

    /// Whether pixels get camera samples by the variance around them, --spp on average: for less noise where there is most. The
    /// EXR then has a layer with the counts.
    #[arg(long, value_name = "BOOL", num_args = 0..=1, default_missing_value = "true")]
    adaptive: Option<bool>,

    /// Behind a diffuse reflection, surfaces nearer than this share of the scene's radius are computed accurately.
    #[arg(long, value_name = "SHARE", value_parser = share)]
    accurate_distance: Option<f32>,

    /// Paths of which less than this share arrives are evaluated from the maps alone.
    #[arg(long, value_name = "SHARE", value_parser = share)]
    approximate_weight: Option<f32>,

    /// Whether lamps in glass and mirrors are looked for before the picture is rendered: where they are smaller than a pixel,
    /// samples meet them by chance alone otherwise, as white dots. What is met more rarely still is dimmed by how rare it is, and
    /// behind a glossy reflection such lamps are blurred, but for `--integrator path`.
    #[arg(long, value_name = "BOOL", num_args = 0..=1, default_missing_value = "true")]
    glints: Option<bool>,

    /// Rounds of `--integrator progressive`; samples and photons are those of each round. As many as there is time for
    /// where only --time-limit or --target-error is given.
    #[arg(long, value_name = "N", value_parser = rounds)]
    rounds: Option<u64>,

    /// Stop when the estimate of the relative error is down to this, for example 0.02; in rounds, which are then the way to
    /// compute.
    #[arg(long, value_name = "E", value_parser = target_error)]
    target_error: Option<f64>,
}

fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("write a whole number from 0 to {}", u64::MAX))
}

fn cache_samples(text: &str) -> Result<u32, String> {
    count_within(text, 4, u64::from(u32::MAX)).map(|rays| rays as u32)
}

/// A number of rounds.
fn rounds(text: &str) -> Result<u64, String> {
    count_within(text, 1, u64::MAX)
}

fn target_error(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(error) if (1e-6..=10.0).contains(&error) => Ok(error),
        _ => Err("write a number from 0.000001 to 10, for example 0.02 for 2 %".to_owned()),
    }
}

fn cache_error(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(a) if (0.01..=1.0).contains(&a) => Ok(a),
        _ => Err("write a number from 0.01 to 1, for example 0.25".to_owned()),
    }
}

fn share(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("write a number from 0 to 1, for example 0.2".to_owned()),
    }
}

/// A whole number, as people write large ones: `500000`, `500_000`, `500k`, `0.5M` or `5e5`.
pub(crate) fn count(text: &str) -> Result<u64, String> {
    count_within(text, 0, u64::MAX)
}

/// [`count`] from `least` to `most`.
fn count_within(text: &str, least: u64, most: u64) -> Result<u64, String> {
    /// From here on an `f64` has not every whole number.
    const LIMIT: u64 = 1 << 53;
    let message = || {
        let most = most.min(LIMIT - 1);
        format!("write a whole number from {least} to {most}, for example 500000, 500k, 1.5M or 5e5")
    };
    let within = |number| if (least..=most).contains(&number) { Ok(number) } else { Err(message()) };
    let plain = text.replace('_', "");
    if let Ok(number) = plain.parse() {
        return within(number);
    }
    // As a power of ten in the text, so that the number is rounded once, from what was written.
    let written = match plain.strip_suffix(['k', 'K']).map(|rest| (rest, 3)).or_else(|| {
        let million = plain.strip_suffix('M').map(|rest| (rest, 6));
        million.or_else(|| plain.strip_suffix('G').map(|rest| (rest, 9)))
    }) {
        Some((rest, power)) => format!("{rest}e{power}"),
        None => plain,
    };
    match written.parse::<f64>() {
        Ok(number) if number.fract() == 0.0 && (0.0..LIMIT as f64).contains(&number) => within(number as u64),
        Ok(number) if (0.0..LIMIT as f64).contains(&number) => {
            Err(format!("{number} is not a whole number; write {:.0}", number.ceil()))
        }
        _ => Err(message()),
    }
}

/// [`count`] from 1 to the largest `u32`.
pub(crate) fn count_from_one(text: &str) -> Result<u32, String> {
    // The bound is that of the type.
    count_within(text, 1, u64::from(u32::MAX)).map(|number| number as u32)
}

fn radius(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(radius) if radius > 0.0 && radius.is_finite() => Ok(radius),
        _ => Err("write a number of metres above 0, for example 0.05".to_owned()),
    }
}

pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    let message = || {
        "write a number of bytes from 1kB to 1000000GB with its unit (kB, MB or GB), for example 500MB"
            .to_owned()
    };
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
        _ => Err("write a number of at least 1, for example 1.1".to_owned()),
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
                IntegratorArg::Progressive => IntegratorKind::Progressive,
            }),
            map: self.map.map(|map| match map {
                MapArg::Global => MapKind::Global,
                MapArg::Caustic => MapKind::Caustic,
            }),
            seed: self.seed,
            spp: self.spp,
            global_photons: self.global_photons.or(self.photons),
            caustic_photons: if self.no_caustics {
                Some(0)
            } else {
                self.caustic_photons.or(caustic_by_ratio)
            },
            aim_photons: self.aim_photons,
            photons_memory: self.photons_memory,
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
            glossy_samples: self.glossy_samples,
            guide: self.guide.map(|guide| match guide {
                GuideArg::None => GuideKind::None,
                GuideArg::Photons => GuideKind::Photons,
            }),
            precomputed_irradiance: self.precomputed_irradiance,
            light_samples: self.light_samples,
            visible_kernel: self.visible_kernel,
            caustic_reuse: self.caustic_reuse,
            shadow_photons: self.shadow_photons.map(|mode| match mode {
                ShadowArg::Off => ShadowMode::Off,
                ShadowArg::AsPrinted => ShadowMode::AsPrinted,
                ShadowArg::Bounded => ShadowMode::Bounded,
            }),
            shadow_photon_rays: self.shadow_photon_rays,
            show: self.show.map(|show| match show {
                ShowArg::Radiance => Show::Radiance,
                ShowArg::Classes => Show::Classes,
            }),
            max_depth: self.max_depth,
            irradiance_cache: self.irradiance_cache,
            illumination_maps: self.illumination_maps,
            adaptive: self.adaptive,
            cache_error: self.cache_error,
            cache_samples: self.cache_samples,
            accurate_distance: self.accurate_distance,
            approximate_weight: self.approximate_weight,
            glints: self.glints,
            rounds: self.rounds,
            target_error: self.target_error,
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
    /// Rounds of photon maps and final gathering, whose error falls as long as they go on.
    Progressive,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum GuideArg {
    /// Nothing: directions are drawn from BSDFs alone.
    None,
    /// Photons: more rays go where much light came from.
    Photons,
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

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ShadowArg {
    /// Everywhere (without the option).
    Off,
    /// Not where the ten nearest photons are all direct or all shadow photons (section 4.1 of Jensen 1996).
    AsPrinted,
    /// Not where enough photons agree that, with 99 % confidence, less than 1 % of the light is otherwise.
    Bounded,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ShowArg {
    /// The radiance that the photons make (the default).
    Radiance,
    /// Each photon as a disc: direct white, indirect blue, caustic yellow, shadow red.
    Classes,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        settings: SettingsArgs,
    }

    #[test]
    fn shadow_photons_are_bounded_where_no_mode_is_named() {
        for (line, mode) in [
            (&["cardioid"] as &[_], None),
            (&["cardioid", "--shadow-photons"], Some(ShadowMode::Bounded)),
            (&["cardioid", "--shadow-photons", "--spp", "2"], Some(ShadowMode::Bounded)),
            (&["cardioid", "--shadow-photons", "as-printed"], Some(ShadowMode::AsPrinted)),
            (&["cardioid", "--shadow-photons", "off"], Some(ShadowMode::Off)),
        ] {
            let asked = Command::try_parse_from(line).unwrap().settings.over(&Overrides::default());
            assert_eq!(asked.shadow_photons, mode, "{line:?}");
        }
    }

    #[test]
    fn counts_as_people_write_them() {
        for (text, number) in [
            ("0", 0),
            ("1e6", 1_000_000),
            ("2.5e5", 250_000),
            ("200_000", 200_000),
            ("500k", 500_000),
            ("2.3k", 2300),
            ("1.1M", 1_100_000),
            ("0.3G", 300_000_000),
            ("18446744073709551615", u64::MAX),
        ] {
            assert_eq!(count(text), Ok(number), "{text}");
        }
        for text in ["", "-1", "-1e3", "1e", "k", "1e400", "nan", "inf", "1e17", "many", "1m", "5 000"] {
            assert!(count(text).is_err_and(|message| message.contains("5e5")), "{text}");
        }
        assert!(count("2.5").is_err_and(|message| message.contains("write 3")));
        assert!(count("0.0005k").is_err());
        for text in ["0", "5G", "1e18", "99999999999999999999"] {
            let told = count_from_one(text).unwrap_err();
            assert!(told.contains("from 1 to 4294967295"), "{text}: {told}");
        }
        assert!(count("1e18").is_err_and(|message| message.contains("from 0 to 9007199254740991")));
        assert_eq!(count_from_one("4e9"), Ok(4_000_000_000));
    }
}
