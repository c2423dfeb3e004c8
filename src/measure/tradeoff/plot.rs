//! Plot of a sweep: error over processor time, both logarithmic.

use super::{Sweep, digits, percent};
use std::fmt::Write as _;

/// Size of the plot.
const SIZE: (f64, f64) = (760.0, 480.0);
/// Margins around the axes: left, right, top, bottom.
const MARGINS: (f64, f64, f64, f64) = (70.0, 20.0, 30.0, 50.0);

/// A logarithmic axis.
struct Axis {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Axis {
    /// An axis for all positive `values`, with a margin at both ends.
    fn of(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let (mut low, mut high) = (f64::INFINITY, 0f64);
        for value in values.filter(|v| *v > 0.0 && v.is_finite()) {
            low = low.min(value);
            high = high.max(value);
        }
        if !(low <= high) {
            (low, high) = (0.1, 10.0);
        }
        Self { low: low / 1.3, high: high * 1.3, from, to }
    }

    fn at(&self, value: f64) -> f64 {
        self.from + (self.to - self.from) * (value / self.low).ln() / (self.high / self.low).ln()
    }

    /// Ticks at 1, 2 and 5 of each decade on the axis.
    fn ticks(&self) -> Vec<f64> {
        let first = self.low.log10().floor() as i32;
        let last = self.high.log10().ceil() as i32;
        let all = (first..=last).flat_map(|decade| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(decade)));
        all.filter(|tick| (self.low..=self.high).contains(tick)).collect()
    }
}

/// Text escaped for XML.
pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// The plot as an SVG on a white background.
pub fn svg(sweep: &Sweep) -> String {
    let (left, right, top, bottom) = MARGINS;
    let (x0, x1) = (left, SIZE.0 - right);
    let (y0, y1) = (SIZE.1 - bottom, top);
    let x = Axis::of(sweep.outcomes.iter().map(|o| o.cpu), x0, x1);
    let y = Axis::of(sweep.outcomes.iter().map(|o| sweep.figures(o).error), y0, y1);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" width=\"{0}\" height=\"{1}\" font-family=\"sans-serif\" \
         font-size=\"11\">\n<rect width=\"{0}\" height=\"{1}\" fill=\"white\"/>\n",
        SIZE.0, SIZE.1
    );
    // Writing to a string cannot fail.
    for tick in x.ticks() {
        let at = x.at(tick);
        let _ = writeln!(
            svg,
            "<path d=\"M{at:.1} {y0}V{y1}\" stroke=\"#e4e4e4\"/><text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            y0 + 16.0,
            digits(tick).trim_end_matches(".00").trim_end_matches(".0")
        );
    }
    for tick in y.ticks() {
        let at = y.at(tick);
        let _ = writeln!(
            svg,
            "<path d=\"M{x0} {at:.1}H{x1}\" stroke=\"#e4e4e4\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{} %</text>",
            x0 - 6.0,
            at + 4.0,
            digits(100.0 * tick).trim_end_matches(".00").trim_end_matches(".0")
        );
    }
    let _ = writeln!(
        svg,
        "<path d=\"M{x0} {y1}V{y0}H{x1}\" fill=\"none\" stroke=\"black\"/>\n\
         <text x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"middle\">processor seconds for one picture</text>\n\
         <text transform=\"translate(16 {:.0}) rotate(-90)\" text-anchor=\"middle\">relative error</text>\n\
         <text x=\"{x0}\" y=\"18\" font-size=\"13\" font-weight=\"bold\">{}, {} x {} pixels</text>",
        0.5 * (x0 + x1),
        SIZE.1 - 10.0,
        0.5 * (y0 + y1),
        escaped(&sweep.scene),
        sweep.size.0,
        sweep.size.1
    );
    let front = sweep.front();
    let place = |i: usize| (x.at(sweep.outcomes[i].cpu), y.at(sweep.figures(&sweep.outcomes[i]).error));
    let line: Vec<String> = front.iter().map(|&i| place(i)).map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
    let _ = writeln!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"#c23b22\" stroke-width=\"1.5\"/>",
        line.join(" ")
    );
    for (i, outcome) in sweep.outcomes.iter().enumerate() {
        let (at, figures) = (place(i), sweep.figures(outcome));
        if !(figures.error > 0.0 && outcome.cpu > 0.0) {
            continue;
        }
        let is_point = outcome.cell.step.is_none();
        let radius = if is_point { 5.0 } else { 3.0 };
        let fill = match (is_point, front.contains(&i)) {
            (true, _) => "#1f4e9c",
            (false, true) => "#c23b22",
            (false, false) => "#9a9a9a",
        };
        let _ = writeln!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius}\" fill=\"{fill}\" data-cell=\"{i}\"><title>{}: {} s, error {}</title></circle>",
            at.0,
            at.1,
            escaped(&outcome.cell.name()),
            digits(outcome.cpu),
            percent(figures.error)
        );
        if is_point {
            // The label is on the left where there is no room on the right.
            let (dx, anchor) = if at.0 > x1 - 90.0 { (-8.0, "end") } else { (8.0, "start") };
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\" fill=\"#1f4e9c\">{}</text>",
                at.0 + dx,
                at.1 - 6.0,
                escaped(&outcome.cell.name())
            );
        }
    }
    svg.push_str("</svg>\n");
    svg
}
