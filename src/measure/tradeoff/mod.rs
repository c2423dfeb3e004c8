//! Speed against accuracy: cost and benefit of settings on one scene, the Pareto front, and the effect of each step of a setting.
//! `cardioid tradeoff` runs the renders.

mod figures;
mod html;
mod plot;
mod sweep;
mod tables;

pub use figures::{
    Compared, Crossing, CrossingKnown, SeedFigures, WORST_SHARE, crossing, distance_to_front, figures, front,
    reference_noise,
};
pub use html::{Shown, html};
pub use plot::svg;
pub use sweep::{Base, Cell, Step, knobs, sweep};
pub use tables::{crossing_table, csv, front_table, knob_table, points_table};

/// Result of one cell of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The cell.
    pub cell: Cell,
    /// Number of seeds of the renders.
    pub seeds: u64,
    /// Wall-clock seconds for one picture: median over seeds.
    pub wall: f64,
    /// Processor seconds of all threads: median over seeds.
    pub cpu: f64,
    /// Peak memory of the process in bytes; `None` where the system does not report it.
    pub memory: Option<u64>,
    /// Number of photons in all maps of a picture.
    pub photons: u64,
    /// Errors against the reference.
    pub compared: Compared,
}

/// A sweep of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// The scene's name.
    pub scene: String,
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// Threads of each render.
    pub threads: usize,
    /// Origin of the reference.
    pub reference: String,
    /// Results of the rendered cells.
    pub outcomes: Vec<Outcome>,
    /// Cells that failed or for which there was no time: name and reason.
    pub missing: Vec<(String, String)>,
}

impl Sweep {
    /// Whether a few pixels cause most of the error in most renders. Figures are then those of all other pixels.
    pub fn has_glints(&self) -> bool {
        /// Ratio of the error of the other pixels to that of all, below which this holds.
        const REST: f64 = 0.5;
        let is_glinting = |outcome: &&Outcome| {
            let Compared { all, but_worst } = outcome.compared;
            but_worst.error < REST * all.error
        };
        2 * self.outcomes.iter().filter(is_glinting).count() > self.outcomes.len()
    }

    /// The figures of an outcome that tables show.
    pub fn figures(&self, outcome: &Outcome) -> SeedFigures {
        if self.has_glints() { outcome.compared.but_worst } else { outcome.compared.all }
    }

    /// A note about the figures; empty where all pixels count.
    pub fn note(&self) -> String {
        if !self.has_glints() {
            return String::new();
        }
        format!(
            "Something small and bright is met by chance here, a lamp as glass or polished metal shows it: a few pixels make up most of the \
             error, and neither the renders nor the reference know what they should be. So all figures leave out {} % of the pixels, \
             those that are farthest off in any of a cell's pictures; tradeoff.csv has the error of all pixels as well.",
            100.0 * WORST_SHARE
        )
    }

    /// (Processor seconds, error) of each outcome.
    pub fn points(&self) -> Vec<(f64, f64)> {
        self.outcomes.iter().map(|outcome| (outcome.cpu, self.figures(outcome).error)).collect()
    }

    /// Indices of the outcomes that no other beats in both processor time and error, sorted by time.
    pub fn front(&self) -> Vec<usize> {
        front(&self.points())
    }

    /// The outcome at the base point from which a cell varies one setting.
    fn base_of(&self, outcome: &Outcome) -> Option<&Outcome> {
        self.outcomes.iter().find(|other| other.cell.base == outcome.cell.base && other.cell.step.is_none())
    }
}

/// A number with three significant digits.
fn digits(x: f64) -> String {
    match x.abs() {
        a if !a.is_finite() => "-".to_owned(),
        0.0 => "0".to_owned(),
        a => {
            let decimals = (2 - a.log10().floor() as i32).clamp(0, 6) as usize;
            format!("{x:.decimals$}")
        }
    }
}

/// A share in percent.
fn percent(x: f64) -> String {
    if x.is_finite() { format!("{} %", digits(100.0 * x)) } else { "-".to_owned() }
}
