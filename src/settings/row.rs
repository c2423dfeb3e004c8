//! A row of the table of settings.

use super::choices::Quality;
use super::kind::{Asked, Kind};
use super::table::{Overrides, Settings};
use super::text::paragraphs;

/// All that is known of a setting but its field.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// Option without dashes, key in scene files, and name in statistics.
    pub name: &'static str,
    /// The values it takes.
    pub kind: Kind,
    /// Unit of the value; empty where it has none.
    pub unit: &'static str,
    /// Where the help lists it.
    pub group: Group,
    /// What of saved photon maps depends on it.
    pub maps: Maps,
    /// Settings that this one takes the place of: with one of them it is refused on one command line, and it gives way where one of
    /// them is asked for later.
    pub in_place_of: &'static [&'static str],
    /// The value that the option alone means, where it may stand alone.
    pub bare: Option<&'static str>,
    /// Why scene files have no such key; empty where they have.
    pub not_in_scene_files: &'static str,
    /// How `cardioid tradeoff` turns it, where it does.
    pub knob: Option<Knob>,
    /// The comment of its declaration.
    pub(super) about: &'static str,
    pub(super) set: fn(&mut Overrides, Asked),
    pub(super) text: fn(&Settings) -> String,
    pub(super) key: fn(&Settings) -> String,
}

/// Groups of settings, in the order of the help.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// What a user needs first.
    First,
    /// How many photons, and where they go.
    Photons,
    /// How photon maps are read.
    Estimates,
    /// What camera samples trace.
    Sampling,
    /// Indirect light that is interpolated.
    Cache,
}

impl Group {
    /// All of them, in the order of the help.
    pub const ALL: [Self; 5] = [Self::First, Self::Photons, Self::Estimates, Self::Sampling, Self::Cache];

    /// Heading in the help and on the page of settings.
    pub fn heading(self) -> &'static str {
        match self {
            Self::First => "Settings",
            Self::Photons => "Expert settings: photons",
            Self::Estimates => "Expert settings: estimates from photon maps",
            Self::Sampling => "Expert settings: sampling",
            Self::Cache => "Expert settings: irradiance cache",
        }
    }
}

/// What of saved photon maps depends on a setting. Every row says it, so that no setting is added without asking.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Maps {
    /// Nothing: it decides which maps are built, or how they are read.
    Nothing,
    /// Photons: maps that were traced with another value are refused.
    Photons,
    /// The number of photons, which is compared by itself, once memory has been looked at.
    Counts,
    /// The irradiance precomputed at photons: it is computed anew where the value is another.
    Irradiance,
}

/// How `cardioid tradeoff` turns a setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knob {
    /// What must be built for the setting to matter.
    pub part: Part,
    /// The values it is turned to.
    pub turn: Turn,
}

/// Parts of a render that settings belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Every picture.
    Picture,
    /// Progressive rendering.
    Rounds,
    /// The global map.
    GlobalMap,
    /// The caustic map.
    CausticMap,
    /// Either map.
    AnyMap,
    /// Final gathering.
    Gathering,
    /// The irradiance cache.
    Cache,
    /// Shadow rays to points of lights.
    LightSampling,
    /// Shadow photons, which answer for some of those.
    ShadowPhotons,
}

/// Which values a knob is turned to, and by what factor time is expected to grow at most: only to see whether there is time left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turn {
    /// A count, one step down and one up by this factor; time rises in proportion.
    Factor(u64),
    /// A number times each factor, rounded to three decimals and kept within the limits of the setting, with the cost of each.
    Scaled(&'static [(f64, f64)]),
    /// Each of these values, at this cost.
    Values(&'static [&'static str], f64),
    /// Each other choice, at this cost.
    Others(f64),
}

/// An option of the command line that stands for other settings.
#[derive(Clone, Copy, Debug)]
pub struct Shortcut {
    /// Option without dashes.
    pub name: &'static str,
    /// The values it takes; `None` where it takes none.
    pub kind: Option<Kind>,
    /// Options that it is refused with.
    pub conflicts: &'static [&'static str],
    pub(super) about: &'static str,
}

/// Defaults as texts, empty where a setting has none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Defaults {
    /// The same in all presets, also in progressive rendering.
    One(String),
    /// Of each preset in the order of [`Quality::ALL`], without and with progressive rendering.
    Several {
        /// Without.
        presets: Vec<String>,
        /// With; `None` where they are the same.
        in_rounds: Option<Vec<String>>,
    },
}

impl Setting {
    /// What it is, in one line.
    pub fn help(&self) -> String {
        paragraphs(self.about).into_iter().next().unwrap_or_default()
    }

    /// What else there is to say, paragraph by paragraph.
    pub fn details(&self) -> Vec<String> {
        paragraphs(self.about).into_iter().skip(1).collect()
    }

    /// Asks for a value of the setting's kind; one of another kind is left out.
    pub fn ask(&self, asked: &mut Overrides, value: Asked) {
        (self.set)(asked, value);
    }

    /// The value in `settings` as users write it; empty where there is none.
    pub fn text(&self, settings: &Settings) -> String {
        (self.text)(settings)
    }

    /// The value in `settings` as text that is equal for equal values alone.
    pub fn key(&self, settings: &Settings) -> String {
        (self.key)(settings)
    }

    /// What it is where nobody asks for anything else.
    pub fn defaults(&self) -> Defaults {
        let presets: Vec<String> =
            Quality::ALL.iter().map(|&quality| self.text(&quality.settings())).collect();
        let in_rounds: Vec<String> =
            Quality::ALL.iter().map(|&quality| self.text(&quality.progressive_settings())).collect();
        // The preset itself.
        if self.name == "quality" {
            return Defaults::One(self.text(&Quality::DEFAULT.settings()));
        }
        // It says by itself whether there are rounds.
        if self.name == "integrator" {
            return Defaults::One(presets[0].clone());
        }
        let is_one = presets.iter().chain(&in_rounds).all(|text| *text == presets[0]);
        if is_one {
            return Defaults::One(presets[0].clone());
        }
        let in_rounds = Some(in_rounds).filter(|texts| *texts != presets);
        Defaults::Several { presets, in_rounds }
    }
}

impl Defaults {
    /// In words, for the help; empty where there is no default.
    pub fn words(&self) -> String {
        let each = |texts: &[String]| -> String {
            if texts.iter().all(|text| *text == texts[0]) {
                return texts[0].clone();
            }
            let named = Quality::ALL.iter().zip(texts).map(|(quality, text)| {
                let name = super::Choices::name(*quality);
                format!("{name} {text}")
            });
            named.collect::<Vec<_>>().join(", ")
        };
        match self {
            Self::One(text) => text.clone(),
            Self::Several { presets, in_rounds } => {
                let presets = each(presets);
                let in_rounds = in_rounds.as_deref().map(|texts| format!("in rounds {}", each(texts)));
                let parts = [Some(presets).filter(|text| !text.is_empty()), in_rounds];
                parts.into_iter().flatten().collect::<Vec<_>>().join("; ")
            }
        }
    }
}

impl Shortcut {
    /// What it is, in one line.
    pub fn help(&self) -> String {
        paragraphs(self.about).into_iter().next().unwrap_or_default()
    }

    /// What else there is to say, paragraph by paragraph.
    pub fn details(&self) -> Vec<String> {
        paragraphs(self.about).into_iter().skip(1).collect()
    }
}
