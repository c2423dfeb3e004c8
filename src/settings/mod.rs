//! The settings of a render: one table, from which everything that knows settings is made.
//!
//! A setting is declared once, in `table`: its name, type, limits, unit, default in each preset, group and help, whether photons
//! depend on it, and how `cardioid tradeoff` turns it. From that come
//!
//! - [`Settings`] and [`Overrides`], the overlay of what was asked for (`declare.rs`);
//! - the options of the command line and the keys of `[render]` in scene files, with the same limits ([`SETTINGS`], [`Kind`]);
//! - the names and values in `--stats`, metadata of pictures and checkpoints (what [`Settings`] serializes to);
//! - which saved photon maps are those that a render would trace ([`Maps`]);
//! - the knobs of `cardioid tradeoff` ([`Knob`]);
//! - `docs/settings.md` ([`page`]).
//!
//! To add a setting, add a row to the table and use its field; nothing else that lists settings has to change.
//!
//! This room uses no other.
// A new choice of a setting does not compile until each match says what it means there.
#![deny(clippy::wildcard_enum_match_arm, clippy::match_wildcard_for_single_variants)]

mod choices;
mod declare;
mod kind;
mod overlay;
mod page;
mod row;
mod table;
mod text;

pub use choices::{
    Choices, Estimator, GuideKind, IntegratorKind, Kernel, MapKind, Named, Quality, SearchRegion, ShadowMode,
    Show, Wavelengths,
};
pub use kind::{Asked, Kind, Parameter, count, count_within, memory};
pub use page::page;
pub use row::{Defaults, Group, Knob, Maps, Part, Setting, Shortcut, Turn};
pub use table::{Overrides, SETTINGS, SHORTCUTS, Settings};
