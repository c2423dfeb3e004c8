//! Who follows a long computation: shows its progress, and may end it.

use std::time::{Duration, Instant};

/// Follows a render: shows progress, and may ask it to stop.
pub trait Observer: Sync {
    /// A step begins, of `total` units.
    fn begin(&self, step: &str, total: u64);

    /// So many units of the present step are done.
    fn advance(&self, done: u64);

    /// Asked often, from all threads: true stops the render as soon as what is under way is whole.
    fn should_stop(&self) -> bool;

    /// Asked in pass 1, where stopping leaves no picture: true only where none is wanted any more. Once true it stays so.
    fn is_cancelled(&self) -> bool {
        self.should_stop()
    }

    /// Told once, where that is known early, how long what is under way is likely to go on, and what makes it shorter.
    fn foresee(&self, _left: Duration, _remedy: &str) {}

    /// When rendering is to end, if that is known: tracing photons then takes no more than a share of the time that is
    /// left (`PHOTON_SHARE` in `render/maps.rs`).
    fn deadline(&self) -> Option<Instant> {
        None
    }
}

/// Watches nothing and never stops.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Observer for Silent {
    fn begin(&self, _step: &str, _total: u64) {}

    fn advance(&self, _done: u64) {}

    fn should_stop(&self) -> bool {
        false
    }
}
