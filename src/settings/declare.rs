//! The macro behind the table: from one row for each setting the structs, the overlay, the presets and the list of rows.

/// `snake_case` to `kebab-case`, at compile time.
pub(super) const fn dashed<const N: usize>(name: &str) -> [u8; N] {
    let name = name.as_bytes();
    let mut dashed = [0; N];
    let mut i = 0;
    while i < N {
        dashed[i] = if name[i] == b'_' { b'-' } else { name[i] };
        i += 1;
    }
    dashed
}

/// The value of one preset.
pub(super) fn of_preset<T: Copy>(at: usize, presets: [T; 4], in_rounds: Option<[T; 4]>) -> T {
    in_rounds.unwrap_or(presets)[at]
}

/// The name of a field with dashes.
macro_rules! name_of {
    ($name:ident) => {{
        const NAME: &str = stringify!($name);
        const DASHED: [u8; NAME.len()] = $crate::settings::declare::dashed(NAME);
        match std::str::from_utf8(&DASHED) {
            Ok(name) => name,
            Err(_) => NAME,
        }
    }};
}

/// The type by which a field is asked for: `None` leaves the choice to somebody else.
macro_rules! asked_type {
    (Option<$of:ident>) => { Option<$of> };
    ($of:ident) => { Option<$of> };
}

/// What was asked for, and otherwise the preset.
macro_rules! resolved {
    ($asked:expr, $preset:expr, Option<$of:ident>) => {
        $asked.or($preset)
    };
    ($asked:expr, $preset:expr, $of:ident) => {
        $asked.unwrap_or($preset)
    };
}

macro_rules! given_or {
    ($default:expr;) => {
        $default
    };
    ($default:expr; $given:expr) => {
        $given
    };
}

/// Declares [`Settings`](super::Settings), [`Overrides`](super::Overrides) and [`SETTINGS`](super::SETTINGS).
///
/// A row is a field with its comment, of which the first paragraph is the help; then what `Setting` says of it. `presets` has the
/// defaults of draft, preview, final and reference, `in_rounds` those of progressive rendering where they are others.
macro_rules! settings {
    ($(
        $(#[doc = $about:literal])*
        $name:ident: $type:ident $(<$of:ident>)? {
            kind: $kind:expr,
            $(unit: $unit:literal,)?
            group: $group:ident,
            presets: $presets:expr,
            $(in_rounds: $in_rounds:expr,)?
            maps: $maps:ident,
            $(in_place_of: [$($other:ident),+],)?
            $(bare: $bare:literal,)?
            $(not_in_scene_files: $why:literal,)?
            $(knob: $part:ident by $turn:expr,)?
        }
    )+) => {
        /// Everything decided.
        #[derive(Clone, Debug, PartialEq, serde::Serialize)]
        #[serde(rename_all = "kebab-case")]
        pub struct Settings {
            $( $(#[doc = $about])* pub $name: $type $(<$of>)?, )+
        }

        /// Settings that somebody asked for; `None` leaves the choice to who comes before: command line over scene file over
        /// preset.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct Overrides {
            $( $(#[doc = $about])* pub $name: asked_type!($type $(<$of>)?), )+
        }

        impl Overrides {
            /// These, and where they are silent those of `below`; but none of those in whose place one of these is.
            #[must_use]
            pub fn over(self, below: Self) -> Self {
                Self {
                    $( $name: self.$name.or(below.$name.filter(|_| true $($(&& self.$other.is_none())+)?)), )+
                }
            }
        }

        impl Settings {
            /// The defaults of a preset.
            pub(super) fn of_preset(quality: Quality, is_in_rounds: bool) -> Self {
                let at = Quality::ALL.iter().position(|&other| other == quality).unwrap_or(0);
                Self {
                    $( $name: $crate::settings::declare::of_preset(
                        at,
                        $presets,
                        given_or!(None; $(Some($in_rounds).filter(|_| is_in_rounds))?),
                    ), )+
                }
            }

            /// What was asked for, and otherwise `preset`.
            pub(super) fn resolved(asked: &Overrides, preset: Self) -> Self {
                Self {
                    $( $name: resolved!(asked.$name, preset.$name, $type $(<$of>)?), )+
                }
            }
        }

        /// All settings, in the order of their declaration.
        pub static SETTINGS: &[Setting] = &[$(Setting {
            name: name_of!($name),
            kind: $kind,
            unit: given_or!(""; $($unit)?),
            group: Group::$group,
            maps: Maps::$maps,
            in_place_of: given_or!(&[]; $(&[$(name_of!($other)),+])?),
            bare: given_or!(None; $(Some($bare))?),
            not_in_scene_files: given_or!(""; $($why)?),
            knob: given_or!(None; $(Some(Knob { part: Part::$part, turn: $turn }))?),
            about: concat!($($about, "\n"),*),
            set: |asked, value| {
                if let Some(value) = FromAsked::from_asked(value) {
                    asked.$name = Some(value);
                }
            },
            text: |settings| Field::text(&settings.$name),
            key: |settings| Field::key(&settings.$name),
        }),+];
    };
}

pub(super) use {asked_type, given_or, name_of, resolved, settings};
