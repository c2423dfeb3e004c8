//! A sweep as a self-contained HTML file.

use super::plot::escaped;
use super::{Sweep, crossing_table, front_table, knob_table, points_table, svg};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write as _;

/// A picture of the report.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Its name.
    pub name: String,
    /// Content of a PNG file.
    pub png: Vec<u8>,
}

const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");

/// The report: figure, tables, and a comparison of two pictures with a slider or as their difference. The first of `pictures` is the
/// reference.
pub fn html(sweep: &Sweep, pictures: &[Shown]) -> String {
    let scene = escaped(&sweep.scene);
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{scene}: speed against accuracy</title>\n\
         <style>\n{STYLE}</style></head><body>\n<h1>{scene}: speed against accuracy</h1>\n\
         <p>{} x {} pixels, {} threads, cardioid {}. Reference: {}. Seconds are those of one picture, medians over seeds; on a \
         machine that does other things at the same time only processor seconds mean something. Error, noise and bias are \
         relative: roots of means of squares over r<sup>2</sup> + f, f a hundredth of the square of the reference's mean, free of the \
         reference's noise.</p>\n",
        sweep.size.0,
        sweep.size.1,
        sweep.threads,
        env!("CARGO_PKG_VERSION"),
        escaped(&sweep.reference)
    );
    if sweep.has_glints() {
        let _ = writeln!(page, "<p>{}</p>", escaped(&sweep.note()));
    }
    page.push_str("<h2>All renders</h2>\n<p>Blue: the points that knobs are turned around. Red: what nothing beats. Click on one to see it.</p>\n");
    page.push_str(&svg(sweep));
    page.push_str(VIEWER);
    let _ = write!(page, "<h2>What nothing beats</h2>\n{}", table(&front_table(sweep)));
    let _ = write!(
        page,
        "<h2>Presets and rounds</h2>\n<p>The last column is the error over that of the front at the same processor time.</p>\n{}",
        table(&points_table(sweep))
    );
    if let Some(crossings) = crossing_table(sweep) {
        let _ = write!(
            page,
            "<h2>Where rounds overtake presets</h2>\n<p>Rounds of progressive rendering go on getting better. From these on, they \
             are better than the preset.</p>\n{}",
            table(&crossings)
        );
    }
    let _ = write!(
        page,
        "<h2>The price of each knob</h2>\n<p>Factors of the point where the step starts. Last column: the work for the same error \
         were all of it noise; below one the step pays.</p>\n{}",
        table(&knob_table(sweep))
    );
    if !sweep.missing.is_empty() {
        page.push_str("<h2>Not rendered</h2>\n<ul>\n");
        for (name, reason) in &sweep.missing {
            let _ = writeln!(page, "<li>{}: {}</li>", escaped(name), escaped(reason));
        }
        page.push_str("</ul>\n");
    }
    page.push_str("<script>\nconst pictures = [\n");
    for Shown { name, png } in pictures {
        // A JSON string is a valid JavaScript string; `<` is escaped so that it cannot end the script.
        let name = serde_json::to_string(name).unwrap_or_default().replace('<', "\\u003c");
        let _ = writeln!(page, "{{name: {name}, data: \"data:image/png;base64,{}\"}},", STANDARD.encode(png));
    }
    let _ = write!(page, "];\n{SCRIPT}</script>\n</body></html>\n");
    page
}

const VIEWER: &str = "<h2>Pictures</h2>\n<p id=\"choice\"><label>Left <select id=\"a\"></select></label> <label>right \
                      <select id=\"b\"></select></label> <label><input type=\"radio\" name=\"view\" value=\"slider\" checked> slider</label> \
                      <label><input type=\"radio\" name=\"view\" value=\"difference\"> difference</label> <label>times \
                      <input type=\"number\" id=\"gain\" min=\"1\" max=\"64\" value=\"8\"></label></p>\n<div id=\"stage\"><img id=\"right\" alt=\"\">\
                      <img id=\"left\" alt=\"\"><div id=\"line\"></div><canvas id=\"canvas\"></canvas></div>\n\
                      <input type=\"range\" id=\"slider\" min=\"0\" max=\"100\" step=\"0.1\" value=\"50\" aria-label=\"border between the pictures\">\n";

/// Converts a Markdown table to HTML: the first line is the head, and the second is skipped.
fn table(markdown: &str) -> String {
    let cells = |line: &str, tag: &str| -> String {
        let inside = line.trim().trim_start_matches('|').trim_end_matches('|');
        let text = |cell: &str| match cell.trim().strip_prefix("x ") {
            Some(factor) => format!("× {}", escaped(factor)),
            None => escaped(cell.trim()).replace("+-", "±"),
        };
        inside.split('|').map(|cell| format!("<{tag}>{}</{tag}>", text(cell))).collect()
    };
    let mut html = "<table>\n".to_owned();
    for (i, line) in markdown.lines().enumerate().filter(|&(i, line)| i != 1 && !line.is_empty()) {
        let _ = writeln!(html, "<tr>{}</tr>", cells(line, if i == 0 { "th" } else { "td" }));
    }
    html.push_str("</table>\n");
    html.replace("error^2 x time", "error² × time")
}
