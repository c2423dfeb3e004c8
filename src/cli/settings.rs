//! Options for the settings of a render: one for each row of the settings table. They override the settings of the scene file.

use cardioid::settings::{
    Asked, Group, Kind, Named, Overrides, Parameter, Quality, SETTINGS, SHORTCUTS, Setting, Shortcut,
    count_within,
};
use clap::builder::{BoolValueParser, PossibleValue, PossibleValuesParser, TypedValueParser, ValueParser};
use clap::error::ErrorKind;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, Error, FromArgMatches};

/// The setting after which the help lists the options that stand for several settings.
const BEFORE_SHORTCUTS: &str = "spp";

/// Settings from the command line.
#[derive(Clone, Debug, Default)]
pub(crate) struct SettingsArgs {
    asked: Overrides,
    /// Photons of the global map; the caustic map gets a proportional number.
    photons: Option<u64>,
    no_caustics: bool,
}

impl SettingsArgs {
    /// The settings of the command line over those of the scene file.
    pub(crate) fn over(&self, scene: &Overrides) -> Overrides {
        let preset = self.asked.quality.or(scene.quality).unwrap_or(Quality::DEFAULT).settings();
        let caustic_by_ratio = self.photons.map(|photons| {
            let ratio = preset.caustic_photons as f64 / preset.global_photons as f64;
            (photons as f64 * ratio).round() as u64
        });
        let caustic_photons = match self.no_caustics {
            true => Some(0),
            false => self.asked.caustic_photons.or(caustic_by_ratio),
        };
        let asked = Overrides {
            global_photons: self.asked.global_photons.or(self.photons),
            caustic_photons,
            volume_beams: if self.no_caustics { Some(0) } else { self.asked.volume_beams },
            ..self.asked.clone()
        };
        asked.over(scene.clone())
    }
}

impl Args for SettingsArgs {
    fn augment_args(mut command: Command) -> Command {
        for group in Group::ALL {
            for setting in SETTINGS.iter().filter(|setting| setting.group == group) {
                command = command.args(options(setting));
                if setting.name == BEFORE_SHORTCUTS {
                    command = command.args(SHORTCUTS.iter().map(shortcut));
                }
            }
        }
        command
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for SettingsArgs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let mut args = Self::default();
        args.update_from_arg_matches(matches)?;
        Ok(args)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        for setting in SETTINGS {
            if let Some(value) = value_of(setting, matches)? {
                setting.ask(&mut self.asked, value);
            }
        }
        if let Some(&Asked::Count(photons)) = matches.get_one("photons") {
            self.photons = Some(photons);
        }
        self.no_caustics |= matches.get_flag("no-caustics");
        Ok(())
    }
}

/// The value given for a setting, with the number that belongs to one of its choices.
fn value_of(setting: &Setting, matches: &ArgMatches) -> Result<Option<Asked>, Error> {
    let given = matches.get_one::<Asked>(setting.name).copied();
    let Kind::Choice { parameter: Some(parameter), .. } = setting.kind else { return Ok(given) };
    match (given, matches.get_one::<Asked>(parameter.name)) {
        (Some(Asked::Choice(name, _)), Some(_)) if name != parameter.of => {
            let Parameter { name: own, of, .. } = parameter;
            let setting = setting.name;
            let message = format!(
                "--{own} belongs to the {of}, and --{setting} is another: leave --{own} out, or write --{setting} {of}\n"
            );
            Err(Error::raw(ErrorKind::ArgumentConflict, message))
        }
        (_, Some(&Asked::Number(number))) => Ok(Some(Asked::Choice(parameter.of, Some(number)))),
        (given, _) => Ok(given),
    }
}

/// The option of a setting, and the option of the number that belongs to it.
fn options(setting: &Setting) -> Vec<Arg> {
    let default = setting.defaults().words();
    let arg = described(setting.name, setting.help(), setting.details(), &default)
        .help_heading(setting.group.heading())
        .action(ArgAction::Set)
        .value_name(setting.kind.placeholder())
        .value_parser(parser(setting.kind))
        .conflicts_with_all(setting.in_place_of);
    let arg = match setting.bare {
        Some(bare) => arg.num_args(0..=1).default_missing_value(bare),
        None => arg,
    };
    let mut args = vec![arg];
    if let Kind::Choice { parameter: Some(parameter), .. } = setting.kind {
        let default = parameter.default.to_string();
        let arg = described(parameter.name, parameter.help.to_owned(), Vec::new(), &default)
            .help_heading(setting.group.heading())
            .action(ArgAction::Set)
            .value_name("K")
            .value_parser(parser(parameter.kind()));
        args.push(arg);
    }
    args
}

fn shortcut(shortcut: &Shortcut) -> Arg {
    let arg = described(shortcut.name, shortcut.help(), shortcut.details(), "")
        .help_heading(Group::First.heading())
        .conflicts_with_all(shortcut.conflicts);
    match shortcut.kind {
        Some(kind) => arg.action(ArgAction::Set).value_name(kind.placeholder()).value_parser(parser(kind)),
        None => arg.action(ArgAction::SetTrue),
    }
}

/// An option with its help: one line for `-h`, the whole text for `--help`.
fn described(name: &'static str, help: String, details: Vec<String>, default: &str) -> Arg {
    let default = if default.is_empty() { String::new() } else { format!("[default: {default}]") };
    let line = help.trim_end_matches('.').to_owned();
    let short = if default.is_empty() { line.clone() } else { format!("{line} {default}") };
    let first = if details.is_empty() { line } else { help };
    let paragraphs = [first].into_iter().chain(details).chain(Some(default).filter(|text| !text.is_empty()));
    let long = paragraphs.collect::<Vec<_>>().join("\n\n");
    Arg::new(name).long(name).help(short).long_help(long)
}

fn parser(kind: Kind) -> ValueParser {
    match kind {
        Kind::Flag => BoolValueParser::new().map(Asked::Flag).into(),
        Kind::Choice { names, .. } => {
            let possible = |named: &'static Named| {
                PossibleValue::new(named.name).help(named.help().trim_end_matches('.').to_owned())
            };
            let parser = PossibleValuesParser::new(names.iter().map(possible));
            parser.try_map(move |name| kind.parse(&name)).into()
        }
        Kind::Count { .. } | Kind::Number { .. } | Kind::Length | Kind::Memory => {
            ValueParser::new(move |text: &str| kind.parse(text))
        }
    }
}

/// A count from 1 to the largest `u32`.
pub(crate) fn count_from_one(text: &str) -> Result<u32, String> {
    // The range is that of the type.
    count_within(text, 1, u64::from(u32::MAX)).map(|number| number as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardioid::settings::{Kernel, ShadowMode};
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Command {
        #[command(flatten)]
        settings: SettingsArgs,
    }

    fn asked(line: &[&str]) -> Result<Overrides, Error> {
        let line = [&["cardioid"], line].concat();
        Ok(Command::try_parse_from(line)?.settings.over(&Overrides::default()))
    }

    #[test]
    fn shadow_photons_are_bounded_where_no_mode_is_named() {
        for (line, mode) in [
            (&[] as &[_], None),
            (&["--shadow-photons"], Some(ShadowMode::Bounded)),
            (&["--shadow-photons", "--spp", "2"], Some(ShadowMode::Bounded)),
            (&["--shadow-photons", "as-printed"], Some(ShadowMode::AsPrinted)),
            (&["--shadow-photons", "off"], Some(ShadowMode::Off)),
        ] {
            assert_eq!(asked(line).unwrap().shadow_photons, mode, "{line:?}");
        }
    }

    #[test]
    fn the_filter_constant_belongs_to_the_cone() {
        for (line, kernel) in [
            (&["--cone-k", "1.5"] as &[_], Kernel::Cone { k: 1.5 }),
            (&["--kernel", "cone", "--cone-k", "1.5"], Kernel::Cone { k: 1.5 }),
            (&["--kernel", "cone"], Kernel::Cone { k: 1.0 }),
            (&["--kernel", "gaussian"], Kernel::Gaussian),
        ] {
            assert_eq!(asked(line).unwrap().kernel, Some(kernel), "{line:?}");
        }
        let error = asked(&["--kernel", "gaussian", "--cone-k", "1.5"]).unwrap_err();
        assert!(error.to_string().contains("--cone-k belongs to the cone"), "{error}");
    }

    #[test]
    fn every_setting_is_an_option_and_says_its_default() {
        let command = SettingsArgs::augment_args(clap::Command::new("cardioid"));
        for setting in SETTINGS {
            let arg = command.get_arguments().find(|arg| arg.get_long() == Some(setting.name)).unwrap();
            let help = arg.get_help().unwrap().to_string();
            let default = setting.defaults().words();
            assert!(help.contains(&setting.help()[..setting.help().len() - 1]), "{help}");
            assert!(default.is_empty() || help.contains(&format!("[default: {default}]")), "{help}");
        }
        command.debug_assert();
    }

    #[test]
    fn counts_stand_for_each_other_and_not_beside() {
        let photons = asked(&["--photons", "400k", "--quality", "draft"]).unwrap();
        assert_eq!((photons.global_photons, photons.caustic_photons), (Some(400_000), Some(800_000)));
        let none = asked(&["--photons", "400k", "--no-caustics"]).unwrap();
        assert_eq!((none.global_photons, none.caustic_photons), (Some(400_000), Some(0)));
        for line in [
            ["--photons", "1", "--photons-memory", "1GB"],
            ["--caustic-photons", "1", "--photons-memory", "1GB"],
            ["--global-nearest", "1", "--global-radius", "1"],
            ["--caustic-nearest", "1", "--caustic-radius", "1"],
        ] {
            assert_eq!(asked(&line).unwrap_err().kind(), ErrorKind::ArgumentConflict, "{line:?}");
        }
        let zero = asked(&["--no-caustics", "--caustic-photons", "5"]).unwrap_err();
        assert_eq!(zero.kind(), ErrorKind::ArgumentConflict);
    }
}
