//! Validation of the renderer against closed forms (`cardioid validate`): scenes with known results, each estimated with several seeds.
//!
//! Unbiased estimates must agree within the noise between seeds. The test is Student's t, at a level that Sidak's correction distributes
//! over all such rows: a suite without a defect fails once in [`FALSE_ALARMS`] runs. The standard error must be below half a percent, as
//! noise could otherwise hide any error. Biased estimates must stay within a stated bound.

mod caustics;
mod density;
mod direct;
mod glass;
mod media;
mod rooms;
mod stage;

use crate::embree::Device;
use crate::render::{Observer, RenderError};
use crate::scene_file::{BuildError, SceneFileError};
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};
use std::fmt::Write;
use std::sync::Arc;

/// A suite without a defect fails once in this many runs with different seeds.
pub const FALSE_ALARMS: f64 = 1000.0;

/// Largest standard error of an unbiased estimate, over the exact value.
pub const MOST_NOISE: f64 = 0.005;

/// Largest error from single precision, over the exact value, where there is no noise.
pub const ROUNDING: f64 = 5e-5;

/// Claim about an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Claim {
    /// The mean equals the exact value.
    Unbiased,
    /// The mean is within this share of the exact value.
    Within(f64),
}

/// Result for one quantity and one method.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Section of the report.
    pub section: &'static str,
    /// Description of the quantity.
    pub what: String,
    /// The method.
    pub by: &'static str,
    /// Unit of the values.
    pub unit: &'static str,
    /// Exact value from the closed form.
    pub exact: f64,
    /// Mean over seeds.
    pub mean: f64,
    /// Standard error of the mean, from the spread over seeds.
    pub standard_error: f64,
    /// The claim that must hold.
    pub claim: Claim,
    /// Whether the claim holds.
    pub passed: bool,
}

impl Row {
    /// Relative deviation of the mean from the exact value.
    pub fn deviation(&self) -> f64 {
        self.mean / self.exact - 1.0
    }

    /// Whether the row fails only because of too much noise, so that its mean may be correct.
    pub fn is_undecided(&self, quantile: f64) -> bool {
        let bound = match self.claim {
            Claim::Unbiased => ROUNDING,
            Claim::Within(bound) => bound,
        };
        let off = (self.mean - self.exact).abs();
        !self.passed && off <= quantile * self.standard_error + bound * self.exact.abs()
    }

    fn judge(&mut self, quantile: f64) {
        let off = (self.mean - self.exact).abs();
        let exact = self.exact.abs();
        self.passed = match self.claim {
            Claim::Unbiased => {
                off <= quantile * self.standard_error + ROUNDING * exact
                    && self.standard_error <= MOST_NOISE * exact
            }
            Claim::Within(bound) => off <= bound * exact,
        };
    }
}

/// Results of the whole suite.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Validation {
    /// Number of seeds of each row.
    pub seeds: u64,
    /// Largest deviation of an unbiased mean, in standard errors.
    pub quantile: f64,
    /// Rows, grouped by section.
    pub rows: Vec<Row>,
}

/// An error that prevents the validation.
#[derive(Debug, thiserror::Error)]
pub enum ValidateError {
    /// A scene of the suite cannot be parsed.
    #[error("a scene of the suite is wrong: {0}")]
    Scene(#[from] SceneFileError),
    /// A scene cannot be built, or Embree reported an error.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The photon maps or a picture cannot be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A probed point has no surface, or a picture lacks the layer.
    #[error("{0} is missing from what was estimated")]
    Missing(&'static str),
    /// There are too few seeds for a standard error.
    #[error("{0} seeds tell no noise: take two at least, sixteen for bounds that mean something")]
    Seeds(u64),
    /// The observer stopped the validation.
    #[error("stopped")]
    Stopped,
}

/// A row before it is measured.
struct Expected {
    what: String,
    by: &'static str,
    exact: f64,
    claim: Claim,
}

/// An experiment: one run gives one value for each row.
struct Experiment {
    section: &'static str,
    unit: &'static str,
    rows: Vec<Expected>,
    estimate: Box<Estimate>,
}

type Estimate = dyn Fn(u64) -> Result<Vec<f64>, ValidateError>;

/// Names of methods in tables.
mod by {
    pub(super) const PATHS: &str = "paths";
    pub(super) const GATHER: &str = "photon map";
    pub(super) const PHOTONS: &str = "photons alone";
    pub(super) const FLUX: &str = "flux of photons";
    pub(super) const CACHE: &str = "irradiance cache";
    pub(super) const ESTIMATE: &str = "density estimate";
    pub(super) const RAYS: &str = "a ray";
}

/// Runs the suite. The result does not depend on the number of threads.
///
/// # Errors
/// If a scene cannot be built or rendered, or if the observer stopped the run.
pub fn validate(
    device: &Arc<Device>,
    seeds: u64,
    observer: &dyn Observer,
) -> Result<Validation, ValidateError> {
    if seeds < 2 {
        return Err(ValidateError::Seeds(seeds));
    }
    let mut experiments = Vec::new();
    experiments.extend(direct::experiments(device)?);
    experiments.extend(rooms::experiments(device)?);
    experiments.extend(glass::experiments(device)?);
    experiments.extend(caustics::experiments(device)?);
    experiments.extend(media::experiments(device)?);
    experiments.extend(density::experiments());
    observer.begin("validating", experiments.len() as u64 * seeds);
    let mut done = 0;
    let mut rows = Vec::new();
    for Experiment { section, unit, rows: expected, estimate } in experiments {
        let mut sums = vec![(0.0, 0.0); expected.len()];
        for seed in 0..seeds {
            if observer.should_stop() {
                return Err(ValidateError::Stopped);
            }
            let values = estimate(seed)?;
            assert_eq!(values.len(), expected.len(), "{section}: a number for each row");
            for ((sum, squares), (value, row)) in sums.iter_mut().zip(values.iter().zip(&expected)) {
                // Sums are taken relative to the exact value, so that squares do not lose precision.
                let off = value - row.exact;
                *sum += off;
                *squares += off * off;
            }
            done += 1;
            observer.advance(done);
        }
        let n = seeds as f64;
        for (Expected { what, by, exact, claim }, (sum, squares)) in expected.into_iter().zip(sums) {
            let off = sum / n;
            let variance = ((squares - sum * off) / (n - 1.0)).max(0.0);
            let (mean, standard_error) = (exact + off, (variance / n).sqrt());
            rows.push(Row { section, what, by, unit, exact, mean, standard_error, claim, passed: false });
        }
    }
    let unbiased = rows.iter().filter(|row| row.claim == Claim::Unbiased).count();
    let quantile = quantile(unbiased, seeds);
    rows.iter_mut().for_each(|row| row.judge(quantile));
    Ok(Validation { seeds, quantile, rows })
}

/// Two-sided limit in standard errors for the mean over `seeds`. The probability that any of `rows` exceeds it is one in [`FALSE_ALARMS`].
fn quantile(rows: usize, seeds: u64) -> f64 {
    let each = 1.0 - (1.0 - 1.0 / FALSE_ALARMS).powf(1.0 / rows.max(1) as f64);
    StudentsT::new(0.0, 1.0, seeds as f64 - 1.0)
        .map_or(f64::INFINITY, |distribution| distribution.inverse_cdf(1.0 - 0.5 * each))
}

impl Validation {
    /// Whether all rows passed.
    pub fn passed(&self) -> bool {
        self.rows.iter().all(|row| row.passed)
    }

    /// Rows that failed.
    pub fn failures(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| !row.passed)
    }

    /// A Markdown page with a table for each section.
    pub fn to_markdown(&self) -> String {
        let mut text = format!(
            "# Accuracy\n\nWritten by `cardioid validate`: scenes whose answer is known in closed form, each estimated with {} seeds. \
             *Unbiased* rows have to agree within {:.1} standard errors of the mean over seeds (Student's t, shared out over the rows \
             after Sidak so that a suite without a flaw fails once in {FALSE_ALARMS:.0}) and {ROUNDING:.0e} for single precision, \
             with a standard error below {} %; the others within the bound beside them.\n",
            self.seeds,
            self.quantile,
            100.0 * MOST_NOISE,
        );
        let mut section = "";
        for row in &self.rows {
            // Writing to a string cannot fail.
            if row.section != section {
                section = row.section;
                let _ = write!(
                    text,
                    "\n## {section}\n\n| quantity | by | exact | estimated | off by | standard error | has to be | |\n\
                     |---|---|---|---|---|---|---|---|\n"
                );
            }
            let claim = match row.claim {
                Claim::Unbiased => "unbiased".to_owned(),
                Claim::Within(bound) => format!("within {} %", trimmed(100.0 * bound)),
            };
            let _ = writeln!(
                text,
                "| {} | {} | {:.6} {} | {:.6} | {:+.3} % | {:.3} % | {claim} | {} |",
                row.what,
                row.by,
                row.exact,
                row.unit,
                row.mean,
                100.0 * row.deviation(),
                100.0 * row.standard_error / row.exact.abs(),
                match (row.passed, row.is_undecided(self.quantile)) {
                    (true, _) => "holds",
                    (false, true) => "too noisy",
                    (false, false) => "**fails**",
                },
            );
        }
        let (held, all) = (self.rows.iter().filter(|row| row.passed).count(), self.rows.len());
        let _ = write!(text, "\n{held} of {all} hold.\n");
        let noisy = self.rows.iter().filter(|row| row.is_undecided(self.quantile)).count();
        if noisy > 0 {
            let _ = write!(text, "\n{noisy} are too noisy to tell with {} seeds; take more.\n", self.seeds);
        }
        text
    }
}

/// The number without trailing zeros.
fn trimmed(x: f64) -> String {
    let text = format!("{x:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(mean: f64, standard_error: f64, claim: Claim) -> Row {
        Row {
            section: "a section",
            what: "a thing".to_owned(),
            by: by::PATHS,
            unit: "W",
            exact: 2.0,
            mean,
            standard_error,
            claim,
            passed: false,
        }
    }

    #[test]
    fn verdicts() {
        let judged = |mean, error, claim| {
            let mut row = row(mean, error, claim);
            row.judge(4.0);
            row.passed
        };
        assert!(judged(2.019, 0.005, Claim::Unbiased));
        assert!(!judged(2.021, 0.005, Claim::Unbiased), "too far");
        assert!(!judged(2.0, 0.011, Claim::Unbiased), "too noisy");
        assert!(judged(2.000_09, 0.0, Claim::Unbiased), "rounding");
        assert!(!judged(2.000_2, 0.0, Claim::Unbiased));
        assert!(judged(1.981, 0.5, Claim::Within(0.01)));
        assert!(!judged(1.979, 0.0, Claim::Within(0.01)));
        assert!(!judged(f64::NAN, 0.0, Claim::Within(0.01)) && !judged(f64::NAN, 0.0, Claim::Unbiased));
    }

    /// With few seeds a mean may deviate by its noise, which is not a defect.
    #[test]
    fn noise_is_no_defect() {
        let undecided = |mean, error, claim| {
            let mut row = row(mean, error, claim);
            row.judge(4.0);
            row.is_undecided(4.0)
        };
        assert!(undecided(2.03, 0.011, Claim::Unbiased) && undecided(1.95, 0.01, Claim::Within(0.01)));
        assert!(!undecided(2.03, 0.005, Claim::Unbiased) && !undecided(1.95, 0.001, Claim::Within(0.01)));
        assert!(!undecided(2.0, 0.001, Claim::Unbiased), "holds");
        assert!(!undecided(f64::NAN, 0.1, Claim::Unbiased));
    }

    #[test]
    fn quantiles() {
        // Two-sided 0.1 % of Student's t with 15 degrees of freedom, from tables: 4.073.
        assert!((quantile(1, 16) - 4.073).abs() < 1e-3, "{}", quantile(1, 16));
        assert!(quantile(60, 16) > quantile(1, 16) && quantile(60, 16) > quantile(60, 64));
        assert!((1.0..1e3).contains(&quantile(100, 4)));
    }

    #[test]
    fn the_page_names_what_fails() {
        let mut rows = vec![row(2.0, 0.001, Claim::Unbiased), row(3.0, 0.001, Claim::Within(0.02))];
        rows.iter_mut().for_each(|row| row.judge(4.0));
        let validation = Validation { seeds: 16, quantile: 4.0, rows };
        assert!(!validation.passed() && validation.failures().count() == 1);
        let page = validation.to_markdown();
        assert!(
            page.contains("+50.000 % | 0.050 % | within 2 % | **fails** |") && page.contains("1 of 2 hold")
        );
        assert_eq!(page.matches("## a section").count(), 1);
    }
}
