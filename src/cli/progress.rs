//! Progress bars, the stop signal and the time limit.

use cardioid::image_io::library_failure;
use cardioid::render::Observer;
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicI32, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The first signal that asked for a stop; 0 before any.
static SIGNAL: AtomicI32 = AtomicI32::new(0);

/// Catches Ctrl-C, SIGTERM and SIGHUP. The first signal stops rendering and writes the picture so far; the second ends the
/// program at once. Files are written under another name first, so none is left half-written.
pub(crate) fn catch_interrupts() {
    let mut signals = match Signals::new([SIGINT, SIGTERM, SIGHUP]) {
        Ok(signals) => signals,
        Err(error) => {
            say!("warning: Ctrl-C will end the program without a picture: {error}");
            return;
        }
    };
    std::thread::spawn(move || {
        for signal in signals.forever() {
            if SIGNAL.compare_exchange(0, signal, Ordering::SeqCst, Ordering::SeqCst).is_err() {
                std::process::exit(i32::from(exit_code(signal)));
            }
            say!("\nstopping; what is there will be written (once more to quit at once)");
        }
    });
}

/// Ends the program, without a picture, when its standard input ends. For a pipe that is when the process at the other end is
/// gone.
pub(crate) fn end_with_input() {
    std::thread::spawn(|| {
        // An error counts as the end, too.
        let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
        std::process::exit(1);
    });
}

/// Exit code of a run that was stopped by a signal: 128 plus the number of the signal, as in shells. `None` without a signal.
pub(crate) fn interrupted() -> Option<u8> {
    Some(SIGNAL.load(Ordering::Relaxed)).filter(|&signal| signal != 0).map(exit_code)
}

fn exit_code(signal: i32) -> u8 {
    u8::try_from(128 + signal).unwrap_or(u8::MAX)
}

/// A duration in nanoseconds; it fits for some centuries.
fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

/// How progress is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressKind {
    /// Bars where standard error is a terminal, nothing elsewhere.
    Bar,
    /// For other programs: lines of JSON on standard output, at most ten a second beyond the first and the last of each step.
    Json,
}

/// The step of which lines of JSON tell.
struct Step {
    name: String,
    /// `None` where its length is not known.
    total: Option<u64>,
    /// Units of the last line.
    told: Option<u64>,
    /// Time of the last line.
    at: Instant,
}

impl Step {
    /// Writes a line. A reader that is gone does not end the render.
    fn tell(&mut self, done: u64, start: Instant) {
        let mut line = json!({ "step": self.name, "seconds": start.elapsed().as_secs_f64() });
        if let Some(total) = self.total {
            line["done"] = done.into();
            line["total"] = total.into();
        }
        let mut output = std::io::stdout().lock();
        let _ = writeln!(output, "{line}").and_then(|()| output.flush());
        (self.told, self.at) = (Some(done), Instant::now());
    }
}

/// Shows the progress of each step: a bar on a terminal, or lines of JSON.
pub(crate) struct Console {
    bar: Mutex<ProgressBar>,
    visible: bool,
    /// Whether lines of JSON are written, and the step that they tell of.
    lines: Option<Mutex<Option<Step>>>,
    is_quiet: bool,
    start: Instant,
    /// Nanoseconds from the start until rendering stops; the largest number without a limit.
    limit: AtomicU64,
}

impl Console {
    /// `limit` is the time from now until rendering stops.
    pub(crate) fn new(quiet: bool, limit: Option<Duration>) -> Self {
        Self {
            bar: Mutex::new(ProgressBar::hidden()),
            visible: !quiet && std::io::stderr().is_terminal(),
            lines: None,
            is_quiet: quiet,
            start: Instant::now(),
            limit: AtomicU64::new(limit.map_or(u64::MAX, nanoseconds)),
        }
    }

    /// The same console, which shows progress in this way.
    pub(crate) fn showing(self, kind: ProgressKind) -> Self {
        match kind {
            ProgressKind::Bar => self,
            ProgressKind::Json => Self { visible: false, lines: Some(Mutex::new(None)), ..self },
        }
    }

    /// Writes the first line of a step.
    fn tell_step(&self, name: &str, total: Option<u64>) {
        if let Some(lines) = &self.lines {
            let mut step = Step { name: name.to_owned(), total, told: None, at: self.start };
            step.tell(0, self.start);
            *lines.lock().unwrap_or_else(PoisonError::into_inner) = Some(step);
        }
    }

    /// Writes a line of progress, where the last one is old enough or the step is done.
    fn tell_progress(&self, done: u64) {
        /// Shortest time between two lines.
        const INTERVAL: Duration = Duration::from_millis(100);
        let Some(lines) = &self.lines else { return };
        if let Some(step) = lines.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
            let is_last = step.total.is_some_and(|total| done >= total);
            // Threads may tell of their work in another order than they did it.
            if step.told.is_none_or(|told| done > told) && (is_last || step.at.elapsed() >= INTERVAL) {
                step.tell(done, self.start);
            }
        }
    }

    /// Reserves part of the time limit for the work after rendering.
    pub(crate) fn reserve(&self, time: Duration) {
        let limit = self.limit.load(Ordering::Relaxed);
        if limit != u64::MAX {
            self.limit.store(limit.saturating_sub(nanoseconds(time)), Ordering::Relaxed);
        }
    }

    /// Shows a step of unknown length, with the elapsed time.
    pub(crate) fn busy(&self, what: &str) {
        self.tell_step(what, None);
        if !self.visible {
            return;
        }
        let style = ProgressStyle::with_template("{msg} {spinner} {elapsed}")
            .unwrap_or_else(|_| ProgressStyle::default_spinner());
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(10))
            .with_style(style)
            .with_message(what.to_owned());
        bar.enable_steady_tick(Duration::from_millis(200));
        let mut current = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        current.finish_and_clear();
        *current = bar;
    }

    /// Removes the bar.
    pub(crate) fn finish(&self) {
        self.bar.lock().unwrap_or_else(PoisonError::into_inner).finish_and_clear();
    }
}

impl Observer for Console {
    fn begin(&self, step: &str, total: u64) {
        self.tell_step(step, Some(total));
        if !self.visible {
            return;
        }
        let style =
            ProgressStyle::with_template("{msg:24} [{bar:40}] {percent:>3} %  {elapsed} , {eta} left")
                .unwrap_or_else(|_| ProgressStyle::default_bar())
                .progress_chars("=> ");
        let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr_with_hz(10))
            .with_style(style)
            .with_message(step.to_owned());
        let mut current = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        current.finish_and_clear();
        *current = bar;
    }

    fn advance(&self, done: u64) {
        self.tell_progress(done);
        if self.visible {
            self.bar.lock().unwrap_or_else(PoisonError::into_inner).set_position(done);
        }
    }

    fn foresee(&self, left: Duration, remedy: &str) {
        /// Shorter waits are not reported.
        const PATIENCE: Duration = Duration::from_secs(10);
        if self.is_quiet || left < PATIENCE {
            return;
        }
        let told = || say!("note: about {:.0} s more; {remedy}", left.as_secs_f64());
        self.bar.lock().unwrap_or_else(PoisonError::into_inner).suspend(told);
    }

    fn should_stop(&self) -> bool {
        self.is_cancelled() || self.deadline().is_some_and(|deadline| Instant::now() >= deadline)
    }

    fn is_cancelled(&self) -> bool {
        // Without OpenImageIO no result could be written.
        interrupted().is_some() || library_failure().is_some()
    }

    fn deadline(&self) -> Option<Instant> {
        let limit = Some(self.limit.load(Ordering::Relaxed)).filter(|&limit| limit != u64::MAX)?;
        self.start.checked_add(Duration::from_nanos(limit))
    }
}
