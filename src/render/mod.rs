//! Jobs: settings, passes, tiles, progress, statistics.

mod settings;

pub use settings::*;
