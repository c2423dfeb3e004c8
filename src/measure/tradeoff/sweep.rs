//! The renders of a sweep: base points, and each knob one step down and up from there. A knob is a setting that a sweep varies.

use crate::scene::RenderPlan;
use crate::settings::{
    Choices, IntegratorKind, Kind, Overrides, Part, Quality, SETTINGS, Setting, Settings, Turn,
};

/// Base point of a sweep, from which knobs are varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {
    /// A preset.
    Preset(Quality),
    /// A number of rounds of progressive rendering.
    Rounds(u64),
}

impl Base {
    /// Name for tables.
    pub fn name(self) -> String {
        match self {
            Self::Preset(quality) => quality.name().to_owned(),
            Self::Rounds(1) => "1 round".to_owned(),
            Self::Rounds(n) => format!("{n} rounds"),
        }
    }

    /// Settings of this base point.
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

    /// The settings as command line options.
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

/// A step of one knob.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// The knob's option, without dashes.
    pub knob: &'static str,
    /// Its value at the base point.
    pub from: String,
    /// The value tried.
    pub to: String,
    /// Upper estimate of the factor by which time grows. It only serves to decide whether there is time for the render.
    pub cost: f64,
}

/// One render of a sweep, without its seed.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Base point.
    pub base: Base,
    /// Step of a knob; `None` for the base point itself.
    pub step: Option<Step>,
    /// Options of `cardioid render`.
    pub options: Vec<String>,
}

impl Cell {
    fn of(base: Base, step: Option<Step>) -> Self {
        let mut all = base.options();
        if let Some(step) = &step {
            // The command line accepts each option only once, so the former value is removed.
            if let Some(at) = all.iter().position(|option| option.strip_prefix("--") == Some(step.knob)) {
                all.drain(at..at + 2);
            }
            all.extend(options(&[(step.knob, step.to.clone())]));
        }
        Self { base, step, options: all }
    }

    /// Name for tables.
    pub fn name(&self) -> String {
        match &self.step {
            None => self.base.name(),
            Some(step) => format!("{}, {} {}", self.base.name(), step.knob, step.to),
        }
    }
}

/// All cells around `bases`: first the base points, then their knobs. `state` returns settings and plan at a base point, since only knobs
/// of features that are built there are varied. `wanted` selects knobs.
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

/// Names of all knobs, in the order of variation.
pub fn knobs() -> Vec<&'static str> {
    SETTINGS.iter().filter(|setting| setting.knob.is_some()).map(|setting| setting.name).collect()
}

/// The steps of all knobs that matter for the plan.
fn steps(settings: &Settings, plan: &RenderPlan) -> Vec<Step> {
    let knobs = SETTINGS.iter().filter_map(|setting| Some((setting, setting.knob?)));
    let built = knobs.filter(|(_, knob)| is_built(knob.part, settings, plan));
    built.flat_map(|(setting, knob)| steps_of(setting, knob.turn, &setting.text(settings))).collect()
}

/// Whether a setting that belongs to `part` matters.
fn is_built(part: Part, settings: &Settings, plan: &RenderPlan) -> bool {
    match part {
        Part::Picture => true,
        Part::Rounds => settings.integrator == IntegratorKind::Progressive,
        Part::GlobalMap => plan.global_map.build,
        Part::CausticMap => plan.caustic_map.build,
        Part::AnyMap => plan.global_map.build || plan.caustic_map.build,
        Part::Gathering => plan.final_gather.build,
        Part::Cache => plan.irradiance_cache.build,
        Part::LightSampling => plan.light_sampling.build,
        Part::ShadowPhotons => plan.light_sampling.build && settings.integrator == IntegratorKind::PhotonMap,
    }
}

/// The steps of one knob from the value `from`, which is empty where the setting has no value.
fn steps_of(setting: &Setting, turn: Turn, from: &str) -> Vec<Step> {
    let turned: Vec<(String, f64)> = match (turn, setting.kind) {
        (Turn::Factor(factor), Kind::Count { least, most }) => {
            let Ok(count) = from.parse::<u64>() else { return Vec::new() };
            let (down, up) = (count / factor, count.saturating_mul(factor).min(most));
            let counts = [(down, 1.0), (up, factor as f64)];
            // A count of zero would give another picture.
            let counts = counts.into_iter().filter(|&(to, _)| to >= least.max(1));
            counts.map(|(to, cost)| (to.to_string(), cost)).collect()
        }
        (Turn::Scaled(factors), Kind::Number { least, most, .. }) => {
            let Ok(number) = from.parse::<f64>() else { return Vec::new() };
            let to = |factor: f64| ((number * factor).clamp(least, most) * 1000.0).round() / 1000.0;
            factors.iter().map(|&(factor, cost)| (to(factor).to_string(), cost)).collect()
        }
        (Turn::Values(values, cost), _) => values.iter().map(|&to| (to.to_owned(), cost)).collect(),
        (Turn::Others(cost), Kind::Flag) => ["true", "false"].map(|to| (to.to_owned(), cost)).to_vec(),
        (Turn::Others(cost), Kind::Choice { names, .. }) => {
            names.iter().map(|named| (named.name.to_owned(), cost)).collect()
        }
        // The turn does not fit the kind of setting; the table has no such row (test `every_knob_turns`).
        _ => Vec::new(),
    };
    let others = turned.into_iter().filter(|(to, _)| to != from);
    others.map(|(to, cost)| Step { knob: setting.name, from: from.to_owned(), to, cost }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_knob_turns() {
        for setting in SETTINGS {
            let Some(knob) = setting.knob else { continue };
            for settings in [Quality::Final.settings(), Quality::Final.progressive_settings()] {
                let from = setting.text(&settings);
                let steps = steps_of(setting, knob.turn, &from);
                assert!(!steps.is_empty() || from.is_empty(), "{}", setting.name);
                for Step { to, from, cost, .. } in steps {
                    assert!(
                        setting.kind.parse(&to).is_ok() && to != from && cost >= 1.0,
                        "{} {to}",
                        setting.name
                    );
                }
            }
        }
    }

    #[test]
    fn steps_are_kept_within_the_limits() {
        let turns = |name: &str, from: &str| -> Vec<(String, f64)> {
            let setting = SETTINGS.iter().find(|setting| setting.name == name).unwrap();
            let steps = steps_of(setting, setting.knob.unwrap().turn, from);
            steps.into_iter().map(|step| (step.to, step.cost)).collect()
        };
        let owned = |steps: &[(&str, f64)]| -> Vec<(String, f64)> {
            steps.iter().map(|&(to, cost)| (to.to_owned(), cost)).collect()
        };
        assert_eq!(turns("spp", "16"), owned(&[("8", 1.0), ("32", 2.0)]));
        assert_eq!(turns("spp", "1"), owned(&[("2", 2.0)]));
        assert_eq!(turns("global-photons", "0"), []);
        assert_eq!(turns("cache-samples", "4"), owned(&[("8", 2.0)]));
        assert_eq!(turns("cache-error", "0.25"), owned(&[("0.375", 1.0), ("0.167", 2.5)]));
        assert_eq!(turns("cache-error", "1"), owned(&[("0.667", 2.5)]));
        assert_eq!(turns("visible-kernel", "false"), owned(&[("true", 2.0)]));
        assert_eq!(turns("rounds", ""), []);
        assert_eq!(turns("kernel", "cone").len(), 3);
    }
}
