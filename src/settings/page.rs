//! `docs/settings.md`, made from the table. A test compares the page with the table; `CARDIOID_UPDATE_PAGES=1` makes the same test
//! write it:
//!
//! ```sh
//! CARDIOID_UPDATE_PAGES=1 cargo test --profile dev-fast --lib settings::page
//! ```

use super::kind::Kind;
use super::row::{Defaults, Group, Maps, Setting};
use super::table::{SETTINGS, SHORTCUTS};
use std::fmt::Write;

const HEAD: &str = "\
# Settings

<!-- Made from src/settings/table.rs; `CARDIOID_UPDATE_PAGES=1 cargo test --lib settings::page` writes it anew. -->

Every setting has one name: `--spp 64` on the command line, `spp = 64` under `[render]` in a scene file, `\"spp\": 64` in `--stats`
and in the metadata of pictures (but for `cone-k`, which is part of `kernel` there). The limits are the same everywhere. The command line goes over the scene file, and that over the
preset, which `quality` names. Large numbers may be written `200_000` or `2e5`, on the command line also `200k` or `0.2M`.

*Default* has one value where all presets agree; otherwise those of `draft`, `preview`, `final` and `reference`, and after \"in
rounds\" those of `integrator = \"progressive\"`. What each setting costs and buys is measured in [quality.md](quality.md).
";

const TAIL: &str = "\
## Settings that act on others

- `caustic-radius` goes over `caustic-nearest`, and `global-radius` over `global-nearest`; but a count on the command line goes over a
  radius of the scene file.
- `target-error` without `integrator` means progressive rendering; then, and with `integrator = \"progressive\"`, the defaults are those
  in rounds. It says by itself when to end: `rounds` then has no default.
- `estimator = \"as-printed\"` turns `visible-kernel` off unless that is asked for: the printed formulas know nothing of it.
- `cone-k` alone means `kernel = \"cone\"`; with another kernel it is refused.
";

/// The page.
pub fn page() -> String {
    let mut page = HEAD.to_owned();
    for group in Group::ALL {
        let _ = write!(
            page,
            "\n## {}\n\n| name | values | default | meaning |\n|---|---|---|---|\n",
            group.heading()
        );
        for setting in SETTINGS.iter().filter(|setting| setting.group == group) {
            write_setting(&mut page, setting);
        }
    }
    page.push_str("\n## Options that stand for others\n\nOn the command line alone.\n\n| option | meaning |\n|---|---|\n");
    for shortcut in SHORTCUTS {
        let placeholder = shortcut.kind.map_or(String::new(), |kind| format!(" {}", kind.placeholder()));
        let meaning = meaning(shortcut.help(), shortcut.details());
        let _ = writeln!(page, "| `--{}{placeholder}` | {meaning} |", shortcut.name);
    }
    let _ = write!(page, "\n{TAIL}{}", saved_maps());
    page
}

fn write_setting(page: &mut String, setting: &Setting) {
    let mut meaning = meaning(setting.help(), setting.details());
    if let Some(bare) = setting.bare {
        let _ = write!(meaning, " `--{}` alone means `{bare}`.", setting.name);
    }
    if !setting.not_in_scene_files.is_empty() {
        let _ = write!(meaning, " On the command line alone: {}.", setting.not_in_scene_files);
    }
    let own = values(&setting.kind, setting.unit);
    let _ = writeln!(page, "| `{}` | {own} | {} | {meaning} |", setting.name, default(setting));
    if let Kind::Choice { parameter: Some(parameter), .. } = setting.kind {
        let _ = writeln!(
            page,
            "| `{}` | {} | {} | {} |",
            parameter.name,
            values(&parameter.kind(), ""),
            grouped(&parameter.default.to_string()),
            parameter.help
        );
    }
}

/// Help and details in a cell of a table; pages of the documents become links.
fn meaning(help: String, details: Vec<String>) -> String {
    let text = [vec![help], details].concat().join(" ");
    let words = text.split(' ').map(|word| {
        let bare = word.trim_matches(['(', ')', '.', ',', ';', ':']);
        match bare.strip_prefix("docs/") {
            Some(page) => word.replace(bare, &format!("[{page}]({page})")),
            None => word.to_owned(),
        }
    });
    words.collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

/// What a setting takes, in a cell of a table.
fn values(kind: &Kind, unit: &str) -> String {
    match *kind {
        Kind::Flag => "`true`, `false`".to_owned(),
        Kind::Count { least, most } => {
            format!("{}{} to {}", words(unit), grouped(&least.to_string()), power(most))
        }
        Kind::Number { noun, least, most, .. } => {
            let noun = if noun == "share" { "share, " } else { "" };
            format!("{noun}{least} to {most}")
        }
        Kind::Length => "length above 0: in metres, in a scene file in its unit".to_owned(),
        Kind::Memory => "memory with its unit, `500MB`, `2GB`".to_owned(),
        Kind::Choice { names, .. } => {
            let each = names.iter().map(|named| {
                let help = named.help();
                format!("`{}`: {}", named.name, help.trim_end_matches('.'))
            });
            each.collect::<Vec<_>>().join("; ").replace('|', "\\|")
        }
    }
}

fn words(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!("{unit}, ") }
}

/// Large limits as powers of two.
fn power(most: u64) -> String {
    match most {
        u64::MAX => "2^64 - 1".to_owned(),
        _ if most.is_power_of_two() && most > 1000 => format!("2^{}", most.trailing_zeros()),
        _ => grouped(&most.to_string()),
    }
}

/// Long whole numbers in groups of three digits, as they may be written.
fn grouped(text: &str) -> String {
    if text.len() < 5 || !text.bytes().all(|byte| byte.is_ascii_digit()) {
        return text.to_owned();
    }
    let mut grouped = String::new();
    for (index, digit) in text.chars().enumerate() {
        if index > 0 && (text.len() - index).is_multiple_of(3) {
            grouped.push('_');
        }
        grouped.push(digit);
    }
    grouped
}

/// Defaults in a cell of a table.
fn default(setting: &Setting) -> String {
    let each = |texts: &[String]| {
        let shown = |text: &String| if text.is_empty() { "none".to_owned() } else { grouped(text) };
        match texts.iter().all(|text| *text == texts[0]) {
            true => shown(&texts[0]),
            false => texts.iter().map(shown).collect::<Vec<_>>().join(", "),
        }
    };
    match setting.defaults() {
        Defaults::One(text) => each(&[text]),
        Defaults::Several { presets, in_rounds: None } => each(&presets),
        Defaults::Several { presets, in_rounds: Some(rounds) } => {
            format!("{}; in rounds {}", each(&presets), each(&rounds))
        }
    }
}

/// What saved photon maps depend on.
fn saved_maps() -> String {
    let names = |maps: Maps| {
        let names = SETTINGS.iter().filter(|setting| setting.maps == maps);
        names.map(|setting| format!("`{}`", setting.name)).collect::<Vec<_>>().join(", ")
    };
    format!(
        "\n## Saved photon maps\n\nPhotons in a file of `cardioid photons` ([photon-map-files.md](photon-map-files.md)) depend on {}, and \
         on their\nnumber ({}). The irradiance in it is computed anew where one of these\ndiffers: {}; `precomputed-irradiance` decides whether it is there. No other setting matters to the\nfile.\n",
        names(Maps::Photons),
        names(Maps::Counts),
        names(Maps::Irradiance)
    )
}

#[cfg(test)]
mod tests {
    use super::super::choices::{Choices, Quality};
    use super::*;
    use std::path::Path;

    #[test]
    fn docs_settings_md_is_what_the_table_says() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/settings.md");
        let made = page();
        if std::env::var_os("CARDIOID_UPDATE_PAGES").is_some() {
            std::fs::write(&file, &made).unwrap();
        }
        let kept = std::fs::read_to_string(&file).unwrap_or_default();
        let differs = made.lines().zip(kept.lines()).find(|(made, kept)| made != kept);
        assert!(
            made == kept,
            "docs/settings.md is not what the table of settings says; run this test with CARDIOID_UPDATE_PAGES=1. {differs:?}"
        );
    }

    #[test]
    fn the_page_has_every_setting_and_the_presets() {
        let page = page();
        for setting in SETTINGS {
            assert!(page.contains(&format!("| `{}` |", setting.name)), "{}", setting.name);
        }
        for &quality in Quality::ALL {
            assert!(page.contains(&format!("`{}`", quality.name())));
        }
        for part in [
            "| `cone-k` | 1 to 1000 | 1 |",
            "4, 16, 64, 1024; in rounds 4",
            "500_000, 5_000_000",
            "samples, 1 to 2^24",
        ] {
            assert!(page.contains(part), "no {part} in {page}");
        }
        assert!(page.contains("[shadow-photons.md](shadow-photons.md)"));
    }
}
