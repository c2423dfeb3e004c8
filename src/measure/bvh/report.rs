//! Benchmark results as a table and a plot.

use super::BvhReport;
use std::fmt::Write;

/// Colours that are distinguishable with any kind of colour vision (Okabe & Ito 2008), and paler ones for Embree without its robust flag.
const COLOURS: [&str; 10] = [
    "#0072B2", "#56B4E9", "#009E73", "#6AA5CC", "#A4D6F2", "#7FCDB5", "#CC79A7", "#E69F00", "#D55E00",
    "#999999",
];

impl BvhReport {
    /// Two Markdown tables: builds, and rays.
    pub fn to_markdown(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = self.write_markdown(&mut text);
        text
    }

    fn write_markdown(&self, text: &mut String) -> std::fmt::Result {
        let rays: Vec<String> = self.rays.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
        writeln!(
            text,
            "{}: {} triangles; rays: {}; medians of {} runs in turns; Embree {}\n",
            self.name,
            self.triangles,
            rays.join(", "),
            self.runs,
            self.embree
        )?;
        let threads = if self.threads == 1 { "thread" } else { "threads" };
        writeln!(text, "| built by | 1 thread, s | {} {threads}, s | bytes a triangle |", self.threads)?;
        writeln!(text, "|---|--:|--:|--:|")?;
        for build in &self.builds {
            writeln!(
                text,
                "| {} | {:.3} | {:.3} | {:.1} |",
                build.name,
                build.seconds_one,
                build.seconds_all,
                build.bytes as f64 / self.triangles as f64
            )?;
        }
        write!(text, "\n| million rays a second |")?;
        for (kind, _) in &self.rays {
            write!(text, " {kind}, 1 thread | {} {threads} |", self.threads)?;
        }
        writeln!(text, " lost | false | at edges |")?;
        writeln!(text, "|---|{}--:|--:|--:|", "--:|--:|".repeat(self.rays.len()))?;
        for way in &self.ways {
            write!(text, "| {} |", way.name)?;
            for kind in &way.kinds {
                write!(
                    text,
                    " {:.2} | {:.2} |",
                    kind.rays_per_second_one / 1e6,
                    kind.rays_per_second_all / 1e6
                )?;
            }
            let sum = |count: fn(&super::Disagreements) -> u64| -> u64 {
                way.kinds.iter().map(|kind| count(&kind.check)).sum()
            };
            writeln!(
                text,
                " {} | {} | {} |",
                sum(|check| check.lost),
                sum(|check| check.false_hits),
                sum(|check| check.at_edges)
            )?;
        }
        let checks = self.ways.first().map(|way| way.kinds.iter().map(|kind| &kind.check));
        let (checked, brute_force) = checks.map_or((0, 0), |checks| {
            checks.fold((0, 0), |sum, check| (sum.0 + check.checked, sum.1 + check.brute_force))
        });
        writeln!(
            text,
            "\nHits of {checked} rays were checked in f64, {brute_force} of them against every triangle, the others against \
             all triangles that any of these found. Lost: the nearest triangle was passed. False: a hit where there is none. \
             At edges: either of these where rounding of single precision decides."
        )?;
        for example in self.ways.iter().flat_map(|way| &way.kinds).flat_map(|kind| &kind.check.examples) {
            writeln!(text, "  {example}")?;
        }
        Ok(())
    }

    /// An SVG with bars of rays per second, in one group for each kind of rays: one thread in full colour, all threads behind it.
    pub fn to_svg(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = self.write_svg(&mut text);
        text
    }

    fn write_svg(&self, text: &mut String) -> std::fmt::Result {
        const BAR: usize = 16;
        const GAP: usize = 34;
        const LEFT: usize = 200;
        const WIDTH: usize = 560;
        let group = BAR * self.ways.len() + GAP;
        let height = 70 + group * self.rays.len();
        let kinds = self.ways.iter().flat_map(|way| &way.kinds);
        let rates = kinds.flat_map(|kind| [kind.rays_per_second_one, kind.rays_per_second_all]);
        let most = rates.filter(|rate| rate.is_finite()).fold(1.0, f64::max);
        let step = tick(most);
        let total = LEFT + WIDTH + 60;
        writeln!(
            text,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{total}\" height=\"{height}\" viewBox=\"0 0 {total} {height}\" \
             font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>"
        )?;
        writeln!(
            text,
            "<text x=\"10\" y=\"20\" font-size=\"14\">{}: {} triangles; million rays a second on 1 thread, pale: on {}</text>",
            escaped(&self.name),
            self.triangles,
            self.threads
        )?;
        let place = |rate: f64| rate / most * WIDTH as f64;
        let mut at = 0.0;
        while at <= most {
            let x = LEFT as f64 + place(at);
            let bottom = height - 30;
            writeln!(
                text,
                "<line x1=\"{x:.1}\" y1=\"32\" x2=\"{x:.1}\" y2=\"{bottom}\" stroke=\"#ddd\"/>\
                 <text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                bottom + 16,
                at / 1e6
            )?;
            at += step;
        }
        for (number, (kind, count)) in self.rays.iter().enumerate() {
            let top = 50 + group * number;
            writeln!(
                text,
                "<text x=\"10\" y=\"{}\" font-weight=\"bold\">{} ({count} rays)</text>",
                top - 4,
                escaped(kind)
            )?;
            for (index, way) in self.ways.iter().enumerate() {
                let Some(figures) = way.kinds.get(number) else { continue };
                let colour = COLOURS[index % COLOURS.len()];
                let y = top + BAR * index;
                let bar = |text: &mut String, rate: f64, opacity: f64| {
                    writeln!(
                        text,
                        "<rect x=\"{LEFT}\" y=\"{y}\" width=\"{:.1}\" height=\"{}\" fill=\"{colour}\" opacity=\"{opacity}\"/>",
                        if rate.is_finite() { place(rate) } else { 0.0 },
                        BAR - 3
                    )
                };
                bar(text, figures.rays_per_second_all, 0.35)?;
                bar(text, figures.rays_per_second_one, 1.0)?;
                let end = LEFT as f64 + place(figures.rays_per_second_all.max(figures.rays_per_second_one));
                writeln!(
                    text,
                    "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>\
                     <text x=\"{:.1}\" y=\"{}\" font-size=\"10\">{:.2}</text>",
                    LEFT - 6,
                    y + BAR - 5,
                    escaped(&way.name),
                    end + 4.0,
                    y + BAR - 5,
                    figures.rays_per_second_one / 1e6
                )?;
            }
        }
        writeln!(text, "</svg>")
    }
}

/// A round step of a scale up to `most`; the scale has five to ten steps.
fn tick(most: f64) -> f64 {
    let power = 10f64.powf((most / 5.0).log10().floor());
    let factor = [5.0, 2.0, 1.0].into_iter().find(|factor| factor * power * 5.0 <= most);
    factor.unwrap_or(1.0) * power
}

/// Text escaped for use inside an XML element.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
