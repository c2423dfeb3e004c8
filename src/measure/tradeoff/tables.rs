//! Sweeps as CSV and as Markdown tables.

use super::figures::{CrossingKnown, crossing};
use super::{Base, Outcome, Sweep, digits, distance_to_front, percent};
use std::fmt::Write as _;

/// All outcomes as CSV, one per line.
pub fn csv(sweep: &Sweep) -> String {
    let front = sweep.front();
    let mut text = "point,knob,from,to,seeds,wall_s,cpu_s,memory_bytes,photons,error,error_se,noise,bias,on_front,options,error_of_all\n"
        .to_owned();
    for (i, outcome) in sweep.outcomes.iter().enumerate() {
        let Outcome { cell, seeds, wall, cpu, memory, photons, compared } = outcome;
        let figures = sweep.figures(outcome);
        let (knob, from, to) = match &cell.step {
            Some(step) => (step.knob, &*step.from, &*step.to),
            None => ("", "", ""),
        };
        let memory = memory.map_or_else(String::new, |bytes| bytes.to_string());
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{},{knob},{from},{to},{seeds},{wall:.3},{cpu:.3},{memory},{photons},{:.6},{:.6},{:.6},{:.6},{},{},{:.6}",
            cell.base.name(),
            figures.error,
            figures.uncertainty,
            figures.noise,
            figures.bias,
            u8::from(front.contains(&i)),
            cell.options.join(" "),
            compared.all.error
        );
    }
    text
}

/// Table of the Pareto front, sorted by time.
pub fn front_table(sweep: &Sweep) -> String {
    let rows = sweep.front().into_iter().map(|i| &sweep.outcomes[i]);
    outcomes_table(sweep, rows, |_| None)
}

/// Table of the base points and their distance from the front: the ratio of the error to that of the front at the same processor time.
pub fn points_table(sweep: &Sweep) -> String {
    let (points, front) = (sweep.points(), sweep.front());
    let distance = |outcome: &Outcome| {
        Some(distance_to_front(&points, &front, (outcome.cpu, sweep.figures(outcome).error)))
    };
    outcomes_table(sweep, sweep.outcomes.iter().filter(|outcome| outcome.cell.step.is_none()), distance)
}

fn outcomes_table<'a>(
    sweep: &Sweep,
    rows: impl Iterator<Item = &'a Outcome>,
    distance: impl Fn(&Outcome) -> Option<f64>,
) -> String {
    let mut lines = Vec::new();
    let mut has_distance = false;
    for outcome in rows {
        let Outcome { cell, wall, cpu, memory, .. } = outcome;
        let figures = sweep.figures(outcome);
        let mut line = format!(
            "| {} | {} | {} | {} | {} +- {} | {} | {} |",
            cell.name(),
            digits(*wall),
            digits(*cpu),
            memory.map_or_else(|| "-".to_owned(), |bytes| format!("{:.0} MB", bytes as f64 / 1e6)),
            percent(figures.error),
            percent(figures.uncertainty),
            percent(figures.noise),
            percent(figures.bias),
        );
        if let Some(distance) = distance(outcome) {
            has_distance = true;
            let _ = write!(line, " {distance:.2} |");
        }
        lines.push(line);
    }
    let (name, rule) = if has_distance { (" error over the front's |", "---|") } else { ("", "") };
    format!(
        "| settings | seconds | processor s | memory | error | noise | bias |{name}\n|---|---|---|---|---|---|---|{rule}\n{}\n",
        lines.join("\n")
    )
}

/// Table of the cost and benefit of each step of each knob, as factors relative to its base point. The last column, error^2 x time, is the
/// work for the same error if all of it were noise: below one the step pays.
pub fn knob_table(sweep: &Sweep) -> String {
    let mut text = "| from | knob | step | processor s | error | noise | bias | error^2 x time |\n|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    for outcome in &sweep.outcomes {
        let (Some(step), Some(base)) = (&outcome.cell.step, sweep.base_of(outcome)) else { continue };
        let factor = |get: &dyn Fn(&Outcome) -> f64| {
            let factor = get(outcome) / get(base);
            if factor.is_finite() { format!("x {factor:.2}") } else { "-".to_owned() }
        };
        let _ = writeln!(
            text,
            "| {} | {} | {} to {} | {} | {} | {} | {} | {} |",
            outcome.cell.base.name(),
            step.knob,
            step.from,
            step.to,
            factor(&|o| o.cpu),
            factor(&|o| sweep.figures(o).error),
            factor(&|o| sweep.figures(o).noise),
            factor(&|o| sweep.figures(o).bias),
            factor(&|o| sweep.figures(o).error.powi(2) * o.cpu),
        );
    }
    text
}

/// Table of the rounds at which progressive rendering reaches the error of each preset, and their cost; `None` where there are no rounds or
/// no presets.
pub fn crossing_table(sweep: &Sweep) -> Option<String> {
    let points = || sweep.outcomes.iter().filter(|outcome| outcome.cell.step.is_none());
    let mut rounds: Vec<(f64, f64, f64)> = points()
        .filter_map(|outcome| match outcome.cell.base {
            Base::Rounds(n) => Some((n as f64, outcome.cpu, sweep.figures(outcome).error)),
            Base::Preset(_) => None,
        })
        .collect();
    rounds.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut lines = String::new();
    for preset in points().filter(|outcome| matches!(outcome.cell.base, Base::Preset(_))) {
        let name = preset.cell.name();
        let reached = sweep.figures(preset).error;
        let error = percent(reached);
        let Some(found) = crossing(&rounds, reached) else {
            let _ = writeln!(lines, "| {name} | {error} | - | - | - | not known |");
            continue;
        };
        let (about, how) = match found.known {
            CrossingKnown::AtMost => ("at most ", "fewer rounds were not rendered".to_owned()),
            CrossingKnown::Between => ("", "between rounds that were rendered".to_owned()),
            CrossingKnown::Beyond(slope) => {
                ("about ", format!("beyond them, by the slope of the last two ({slope:.2})"))
            }
        };
        let _ = writeln!(
            lines,
            "| {name} | {error} | {about}{:.0} | {about}{} | {about}{} | {how} |",
            found.rounds,
            digits(found.cpu),
            digits(found.cpu / preset.cpu)
        );
    }
    (!rounds.is_empty() && !lines.is_empty()).then(|| {
        format!(
            "| preset | its error | rounds to there | processor s | over the preset's | how that is known |\n|---|---|---|---|---|---|\n{lines}"
        )
    })
}
