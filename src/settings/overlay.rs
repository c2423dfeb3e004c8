//! What becomes of what was asked for: presets, and settings that change the default of another one.

use super::choices::{Estimator, IntegratorKind, Quality};
use super::table::{Overrides, Settings};

impl Quality {
    /// The settings of this preset.
    pub fn settings(self) -> Settings {
        Settings::of_preset(self, false)
    }

    /// The settings of this preset in progressive rendering: it says how many rounds, and each is the same.
    pub fn progressive_settings(self) -> Settings {
        Settings { integrator: IntegratorKind::Progressive, ..Settings::of_preset(self, true) }
    }
}

impl From<&Overrides> for Settings {
    fn from(asked: &Overrides) -> Self {
        let quality = asked.quality.unwrap_or(Quality::DEFAULT);
        // An error to stop at is one of rounds, where nothing else is asked for.
        let by_error = asked.integrator.is_none() && asked.target_error.is_some();
        let mut preset = match asked.integrator == Some(IntegratorKind::Progressive) || by_error {
            true => quality.progressive_settings(),
            false => quality.settings(),
        };
        // The printed formulas know nothing of visible kernels.
        if asked.estimator == Some(Estimator::AsPrinted) {
            preset.visible_kernel = false;
        }
        // An error to stop at says by itself when to end.
        if asked.target_error.is_some() {
            preset.rounds = None;
        }
        Self::resolved(asked, preset)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Asked, SETTINGS};
    use super::*;

    #[test]
    fn a_count_asked_for_later_goes_over_a_radius() {
        let below = Overrides { global_radius: Some(0.1), caustic_radius: Some(0.2), ..Overrides::default() };
        let above = Overrides { caustic_nearest: Some(30), ..Overrides::default() };
        let both = Settings::from(&above.over(below));
        assert_eq!((both.global_radius, both.caustic_radius, both.caustic_nearest), (Some(0.1), None, 30));
    }

    #[test]
    fn some_settings_change_the_default_of_another() {
        let printed = Overrides { estimator: Some(Estimator::AsPrinted), ..Overrides::default() };
        assert!(!Settings::from(&printed).visible_kernel);
        assert!(Settings::from(&Overrides { visible_kernel: Some(true), ..printed }).visible_kernel);
        let by_error = Overrides { target_error: Some(0.1), ..Overrides::default() };
        let settings = Settings::from(&by_error);
        assert_eq!((settings.integrator, settings.rounds), (IntegratorKind::Progressive, None));
        let both = Settings::from(&Overrides { rounds: Some(3), ..by_error });
        assert_eq!((both.rounds, both.spp), (Some(3), 4));
    }

    /// Each row asks for its own field, and the defaults are within the limits.
    #[test]
    fn rows_and_fields_belong_together() {
        for quality in Quality::ALL {
            for preset in [quality.settings(), quality.progressive_settings()] {
                let fields = serde_json::to_value(&preset).unwrap();
                let fields = fields.as_object().unwrap();
                assert_eq!(fields.len(), SETTINGS.len());
                let mut asked = Overrides::default();
                for setting in SETTINGS {
                    assert!(fields.contains_key(setting.name), "{}", setting.name);
                    let text = setting.text(&preset);
                    if text.is_empty() {
                        continue;
                    }
                    let value = match setting.kind.parse(&text) {
                        // Written without a unit.
                        Err(_) if setting.kind == super::super::Kind::Memory => {
                            Asked::Count(text.parse().unwrap())
                        }
                        parsed => parsed.unwrap_or_else(|told| panic!("--{} {text}: {told}", setting.name)),
                    };
                    setting.ask(&mut asked, value);
                }
                assert_eq!(Settings::resolved(&asked, Quality::Draft.settings()).spp, preset.spp);
                let mut resolved = Settings::from(&asked);
                resolved.rounds = preset.rounds;
                assert_eq!(resolved, preset);
            }
        }
    }

    #[test]
    fn names_are_unique_and_those_named_are_there() {
        let mut names: Vec<&str> = SETTINGS.iter().map(|setting| setting.name).collect();
        for setting in SETTINGS {
            assert!(setting.in_place_of.iter().all(|other| names.contains(other)), "{}", setting.name);
            assert!(setting.help().ends_with('.'), "{}", setting.name);
            assert!(!setting.name.contains('_'));
        }
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), SETTINGS.len());
    }
}
