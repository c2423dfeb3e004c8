//! Which renders a sweep consists of: points to start from, and each knob one step down and up from there.

use crate::photons::{Estimator, Kernel};
use crate::render::{GuideKind, IntegratorKind, Overrides, Quality, Settings, ShadowMode};
use crate::scene::RenderPlan;

/// A point of a sweep around which knobs are turned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {
    /// A preset.
    Preset(Quality),
    /// So many rounds of progressive rendering.
    Rounds(u64),
}

impl Base {
    /// As people call it.
    pub fn name(self) -> String {
        match self {
            Self::Preset(Quality::Draft) => "draft".to_owned(),
            Self::Preset(Quality::Preview) => "preview".to_owned(),
            Self::Preset(Quality::Final) => "final".to_owned(),
            Self::Preset(Quality::Reference) => "reference".to_owned(),
            Self::Rounds(1) => "1 round".to_owned(),
            Self::Rounds(n) => format!("{n} rounds"),
        }
    }

    /// What is asked for to get there.
    pub fn overrides(self) -> Overrides {
        match self {
            Self::Preset(quality) => Overrides {
                quality: Some(quality),
                integrator: Some(IntegratorKind::PhotonMap),
                ..Overrides::default()
            },
            Self::Rounds(rounds) => Overrides {
                integrator: Some(IntegratorKind::Progressive),
                rounds: Some(rounds),
                ..Overrides::default()
            },
        }
    }

    /// The same for the command line.
    fn options(self) -> Vec<String> {
        match self {
            Self::Preset(_) => options(&[("quality", self.name()), ("integrator", "photon-map".to_owned())]),
            Self::Rounds(n) => {
                options(&[("integrator", "progressive".to_owned()), ("rounds", n.to_string())])
            }
        }
    }
}

fn options(pairs: &[(&str, String)]) -> Vec<String> {
    pairs.iter().flat_map(|(name, value)| [format!("--{name}"), value.clone()]).collect()
}

/// A knob, turned by one step.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// The knob's option, without dashes.
    pub knob: &'static str,
    /// Its value at the point where one starts.
    pub from: String,
    /// The value tried.
    pub to: String,
    /// By what factor time is expected to grow at most: only to see whether there is time left for it.
    pub cost: f64,
}

/// One render of a sweep, but for its seed.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Where it starts.
    pub base: Base,
    /// What is turned; `None` for the point itself.
    pub step: Option<Step>,
    /// Options of `cardioid render`.
    pub options: Vec<String>,
}

impl Cell {
    fn of(base: Base, step: Option<Step>) -> Self {
        let mut all = base.options();
        if let Some(step) = &step {
            // The last of equal options is the one that would count, but the command line takes each once.
            if let Some(at) = all.iter().position(|option| option.strip_prefix("--") == Some(step.knob)) {
                all.drain(at..at + 2);
            }
            all.extend(options(&[(step.knob, step.to.clone())]));
        }
        Self { base, step, options: all }
    }

    /// As people call it.
    pub fn name(&self) -> String {
        match &self.step {
            None => self.base.name(),
            Some(step) => format!("{}, {} {}", self.base.name(), step.knob, step.to),
        }
    }
}

/// All cells around `bases`: first the points themselves, then their knobs. `state` tells settings and plan at a point, since
/// only knobs of what is built there are turned; `wanted` leaves out knobs.
pub fn sweep(
    bases: &[Base],
    state: impl Fn(Base) -> (Settings, RenderPlan),
    wanted: impl Fn(&str) -> bool,
) -> Vec<Cell> {
    let points = bases.iter().map(|&base| Cell::of(base, None));
    let turned = bases.iter().flat_map(|&base| {
        let (settings, plan) = state(base);
        let steps = steps(&settings, &plan).into_iter().filter(|step| wanted(step.knob));
        steps.map(|step| Cell::of(base, Some(step))).collect::<Vec<_>>()
    });
    points.chain(turned).collect()
}

/// Names of all knobs.
pub const KNOBS: [&str; 17] = [
    "rounds",
    "spp",
    "global-photons",
    "caustic-photons",
    "caustic-nearest",
    "kernel",
    "gather-samples",
    "cache-error",
    "cache-samples",
    "irradiance-cache",
    "light-samples",
    "shadow-photons",
    "guide",
    "estimator",
    "precomputed-irradiance",
    "visible-kernel",
    "approximate-weight",
];

fn steps(settings: &Settings, plan: &RenderPlan) -> Vec<Step> {
    let mut steps = Vec::new();
    let mut count = |knob, from: u64, factor: u64| {
        let mut add = |to: u64, cost| {
            if to > 0 && to != from {
                steps.push(Step { knob, from: from.to_string(), to: to.to_string(), cost });
            }
        };
        add(from / factor, 1.0);
        add(from.saturating_mul(factor), factor as f64);
    };
    let (gathers, caches) = (plan.final_gather.build, plan.irradiance_cache.build);
    if let Some(rounds) = settings.rounds.filter(|_| settings.integrator == IntegratorKind::Progressive) {
        count("rounds", rounds, 2);
    }
    count("spp", settings.spp.into(), 2);
    if plan.global_map.build {
        count("global-photons", settings.global_photons, 4);
    }
    if plan.caustic_map.build {
        count("caustic-photons", settings.caustic_photons, 4);
        count("caustic-nearest", settings.caustic_nearest.into(), 2);
    }
    if gathers {
        count("gather-samples", settings.gather_samples.into(), 2);
    }
    if caches {
        count("cache-samples", settings.cache_samples.into(), 2);
    }
    if plan.light_sampling.build {
        count("light-samples", settings.light_samples.into(), 4);
    }
    let mut choice = |knob, from: &str, to: &[&str], cost| {
        let others = to.iter().filter(|&&to| to != from);
        steps.extend(others.map(|&to| Step { knob, from: from.to_owned(), to: to.to_owned(), cost }));
    };
    if plan.caustic_map.build {
        choice(
            "kernel",
            kernel_name(settings.kernel),
            &["constant", "cone", "epanechnikov", "gaussian"],
            1.2,
        );
    }
    if caches {
        let error = settings.cache_error;
        let to = |factor: f32| ((error * factor).clamp(0.01, 1.0) * 1000.0).round() / 1000.0;
        let (less, more) = (to(1.5).to_string(), to(1.0 / 1.5).to_string());
        choice("cache-error", &error.to_string(), &[&less], 1.0);
        choice("cache-error", &error.to_string(), &[&more], 2.5);
        choice("irradiance-cache", "true", &["false"], 4.0);
    }
    if plan.light_sampling.build && settings.integrator == IntegratorKind::PhotonMap {
        let mode = match settings.shadow_photons {
            ShadowMode::Off => "off",
            ShadowMode::AsPrinted => "as-printed",
            ShadowMode::Bounded => "bounded",
        };
        choice("shadow-photons", mode, &["off", "as-printed", "bounded"], 1.5);
    }
    if gathers {
        let guide = match settings.guide {
            GuideKind::None => "none",
            GuideKind::Photons => "photons",
        };
        choice("guide", guide, &["none", "photons"], 2.0);
        choice("precomputed-irradiance", flag(settings.precomputed_irradiance), &["true", "false"], 5.0);
        choice("approximate-weight", &settings.approximate_weight.to_string(), &["0", "0.05"], 2.0);
    }
    if plan.global_map.build || plan.caustic_map.build {
        let estimator = match settings.estimator {
            Estimator::AsPrinted => "as-printed",
            Estimator::Corrected => "corrected",
        };
        choice("estimator", estimator, &["corrected", "as-printed"], 1.2);
        choice("visible-kernel", flag(settings.visible_kernel), &["true", "false"], 2.0);
    }
    steps
}

fn flag(value: bool) -> &'static str {
    if value { "true" } else { "false" }
}

fn kernel_name(kernel: Kernel) -> &'static str {
    match kernel {
        Kernel::Constant => "constant",
        Kernel::Cone { .. } => "cone",
        Kernel::Epanechnikov => "epanechnikov",
        Kernel::Gaussian => "gaussian",
    }
}
