//! Figure 8 of Jensen & Christensen 1995: estimates along a line through the caustic of the mirror square, the exact solution, and the
//! errors of the estimates.

use super::MirrorSquare;
use crate::embree::Device;
use crate::photons::Kernel;
use crate::render::{
    Observer, Overrides, ProbeEstimator, ProbePoint, ProbeRequest, Quality, RenderError, Settings, probe,
};
use crate::scene::IlluminationKernel;
use crate::scene_file::{BuildError, IlluminationDescription, SceneDescription, build_scene};
use glam::DVec3;
use std::fmt::Write;
use std::sync::Arc;

/// An error of the measurement.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// The scene cannot be built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The photon maps cannot be built.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The scene is not the expected one.
    #[error(
        "the scene has no shape named `square`, whose caustic the figure is of; give scenes/mirror-square.toml"
    )]
    NoSquare,
    /// The observer stopped the measurement.
    #[error("stopped")]
    Stopped,
}

/// Results of one estimator.
#[derive(Clone, Debug, PartialEq)]
pub struct FigureRow {
    /// Name of the estimator.
    pub name: String,
    /// Mean ratio to the exact irradiance, over positions inside the caustic and over seeds.
    pub mean: f64,
    /// Root of the mean squared deviation of that ratio from 1.
    pub rms: f64,
    /// Distance at the edge over which the mean falls from three quarters to a quarter, in metres; `None` where it does not fall so far.
    pub edge: Option<f64>,
    /// Irradiance along the line from the first seed, W/m^2.
    pub line: Vec<f64>,
}

/// Data of the whole figure.
#[derive(Clone, Debug, PartialEq)]
pub struct CausticFigure {
    /// Caustic photons of each map.
    pub photons: u64,
    /// Positions along the line, in metres from the mirror.
    pub places: Vec<f64>,
    /// Exact irradiance at these positions.
    pub exact: Vec<f64>,
    /// Results by estimator.
    pub rows: Vec<FigureRow>,
}

/// Intensity and reflectance in `scenes/mirror-square.toml`.
const SQUARE: MirrorSquare = MirrorSquare { intensity: 1.0, reflectance: 0.9 };

const SEEDS: u64 = 4;

/// Across the edge, and how often.
const EDGE_STEPS: i32 = 20;
const EDGE_STEP: f64 = 0.01;
const EDGE_LINES: i32 = 4;

/// Estimator of the caustic.
#[derive(Clone, Copy)]
enum Way {
    Photons { kernel: Kernel, nearest: u32, check: bool },
    Map { kernel: IlluminationKernel, times: u64 },
}

fn ways() -> [(&'static str, Way); 8] {
    let cone = Kernel::Cone { k: 1.0 };
    let photons = |kernel, nearest, check| Way::Photons { kernel, nearest, check };
    let map = |kernel, times| Way::Map { kernel, times };
    [
        ("illumination map, box", map(IlluminationKernel::Box, 1)),
        ("illumination map, box, 3 times the photons", map(IlluminationKernel::Box, 3)),
        ("illumination map, tent", map(IlluminationKernel::Tent, 1)),
        ("photon map, N = 200", photons(Kernel::Constant, 200, false)),
        ("photon map, N = 200, differential checking", photons(Kernel::Constant, 200, true)),
        ("photon map, N = 200, cone", photons(cone, 200, false)),
        ("photon map, N = 50", photons(Kernel::Constant, 50, false)),
        ("photon map, N = 1500", photons(Kernel::Constant, 1500, false)),
    ]
}

/// Positions inside the caustic, farther from its edges than the radius of any estimate.
fn inside() -> Vec<(f64, f64)> {
    (0..21).flat_map(|i| (-2..=2).map(move |j| (0.3 + 0.07 * f64::from(i), 0.1 * f64::from(j)))).collect()
}

/// Positions across the edge, line by line.
fn across_edge() -> Vec<(f64, f64)> {
    let across =
        |z: f64| (-EDGE_STEPS..=EDGE_STEPS).map(move |i| (MirrorSquare::EDGE + EDGE_STEP * f64::from(i), z));
    (-EDGE_LINES..=EDGE_LINES).flat_map(|j| across(0.1 * f64::from(j))).collect()
}

/// Measures the figure. `description` must be that of `scenes/mirror-square.toml`.
///
/// # Errors
/// If it is another scene, cannot be built, or the observer stopped the measurement.
pub fn caustic_figure(
    description: &SceneDescription,
    device: &Arc<Device>,
    photons: u64,
    observer: &dyn Observer,
) -> Result<CausticFigure, FigureError> {
    let places: Vec<f64> = (0..=254).map(|i| 0.06 + 0.01 * f64::from(i)).collect();
    let exact = places.iter().map(|&x| SQUARE.caustic(x, 0.0)).collect();
    let mut rows = Vec::new();
    for (name, way) in ways() {
        let mut description = description.clone();
        let square = description.shapes.iter_mut().find(|shape| shape.name == "square");
        let square = square.ok_or(FigureError::NoSquare)?;
        let (mut overrides, mut estimator, mut count) =
            (Overrides::default(), ProbeEstimator::PhotonMap, photons);
        match way {
            Way::Photons { kernel, nearest, check } => {
                overrides.kernel = Some(kernel);
                overrides.caustic_nearest = Some(nearest);
                overrides.differential_check = Some(check);
            }
            Way::Map { kernel, times } => {
                estimator = ProbeEstimator::IlluminationMap;
                // Bins of 0.05 m, which is the radius of an estimate with 200 photons.
                square.value.illumination =
                    Some(IlluminationDescription { kernel, elements: Some(144), refinement: Some(5) });
                count *= times;
            }
        }
        overrides.quality = Some(Quality::Preview);
        overrides.global_photons = Some(photons / 10);
        overrides.caustic_photons = Some(count);
        let built = build_scene(&description, device, (4, 4))?;
        let on_line = places.iter().map(|&x| (x, 0.0));
        let all: Vec<(f64, f64)> = inside().into_iter().chain(across_edge()).chain(on_line).collect();
        let mut readings = Vec::new();
        for seed in 0..SEEDS {
            let points =
                all.iter().map(|&(x, z)| ProbePoint { position: DVec3::new(x, 0.0, z), normal: DVec3::Y });
            let request = ProbeRequest {
                points: points.collect(),
                estimators: vec![estimator],
                samples: 1,
                batches: 1,
                lift: 1e-3,
                settings: Settings { seed, ..Settings::from(&overrides) },
            };
            let probed = probe(&built.scene, &request, observer)?.ok_or(FigureError::Stopped)?;
            let caustic = |found: &Option<crate::render::ProbedSurface>| {
                found
                    .as_ref()
                    .and_then(|found| found.readings.first())
                    .map_or(f64::NAN, |r| r.irradiance[1].y)
            };
            readings.push(probed.points.iter().map(caustic).collect::<Vec<f64>>());
        }
        rows.push(row(name, &readings));
    }
    Ok(CausticFigure { photons, places, exact, rows })
}

/// Results of one estimator from its readings by seed.
fn row(name: &str, readings: &[Vec<f64>]) -> FigureRow {
    let places = inside();
    let edge_places = across_edge();
    let ratios = readings
        .iter()
        .flat_map(|seed| seed.iter().zip(&places).map(|(value, &(x, z))| value / SQUARE.caustic(x, z)));
    let ratios: Vec<f64> = ratios.collect();
    let n = ratios.len() as f64;
    let mean = ratios.iter().sum::<f64>() / n;
    let rms = (ratios.iter().map(|ratio| (ratio - 1.0).powi(2)).sum::<f64>() / n).sqrt();
    let steps = (2 * EDGE_STEPS + 1) as usize;
    let mut profile = vec![0.0; steps];
    for seed in readings {
        let values = &seed[places.len()..places.len() + edge_places.len()];
        values.iter().enumerate().for_each(|(i, value)| profile[i % steps] += value);
    }
    let lines = (readings.len() * (2 * EDGE_LINES + 1) as usize) as f64;
    let full = lines * SQUARE.caustic(MirrorSquare::EDGE - 1e-9, 0.0);
    let crossing = |level: f64| {
        let i = profile.windows(2).position(|w| w[0] >= level * full && w[1] < level * full)?;
        let share = (profile[i] - level * full) / (profile[i] - profile[i + 1]);
        Some(EDGE_STEP * (i as f64 + share))
    };
    let edge = crossing(0.75).zip(crossing(0.25)).map(|(high, low)| low - high);
    let line = readings.first().map_or(Vec::new(), |seed| seed[places.len() + edge_places.len()..].to_vec());
    FigureRow { name: name.to_owned(), mean, rms, edge, line }
}

/// One panel: its title, and its rows with their colours.
type Panel<'a> = (&'a str, &'a [(usize, &'a str)]);

impl CausticFigure {
    /// A Markdown table with one line for each estimator.
    pub fn to_markdown(&self) -> String {
        let mut text =
            String::from("| estimate | mean / exact | RMS | edge, 75 % to 25 % |\n|---|---|---|---|\n");
        for row in &self.rows {
            let edge = row.edge.map_or("none".to_owned(), |edge| format!("{:.1} cm", 100.0 * edge));
            // Writing to a string cannot fail.
            let _ = writeln!(text, "| {} | {:.4} | {:.2} % | {edge} |", row.name, row.mean, 100.0 * row.rms);
        }
        text
    }

    /// The figure as an SVG with two panels: exact and estimated irradiance along the line.
    pub fn to_svg(&self) -> String {
        const PANELS: [Panel<'_>; 2] = [
            ("illumination maps: box (grey), tent (blue), exact (black)", &[(0, "#999"), (2, "#1f77b4")]),
            (
                "photon map, N = 200: without (grey) and with differential checking (blue), exact (black)",
                &[(3, "#999"), (4, "#1f77b4")],
            ),
        ];
        const SIZE: [f64; 2] = [640.0, 240.0];
        const LEFT: f64 = 60.0;
        const STEP: f64 = 300.0;
        let (last, top) = (self.places.last().copied().unwrap_or(1.0), 0.3);
        let mut text = String::from(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"720\" height=\"630\" viewBox=\"0 0 720 630\" \
             font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        );
        for (number, (title, rows)) in PANELS.into_iter().enumerate() {
            let low = 280.0 + STEP * number as f64;
            let at = |x: f64, value: f64| (LEFT + SIZE[0] * x / last, low - SIZE[1] * value / top);
            // Writing to a string cannot fail.
            let _ = writeln!(text, "<text x=\"{LEFT}\" y=\"{}\">{title}</text>", low - SIZE[1] - 8.0);
            for tick in 0..=5 {
                let x = 0.5 * f64::from(tick);
                let (px, _) = at(x, 0.0);
                let _ = writeln!(
                    text,
                    "<line x1=\"{px:.1}\" y1=\"{}\" x2=\"{px:.1}\" y2=\"{low}\" stroke=\"#ddd\"/>\
                     <text x=\"{px:.1}\" y=\"{}\" text-anchor=\"middle\">{x} m</text>",
                    low - SIZE[1],
                    low + 15.0
                );
            }
            for tick in 0..=3 {
                let value = 0.1 * f64::from(tick);
                let (_, py) = at(0.0, value);
                let _ = writeln!(
                    text,
                    "<line x1=\"{LEFT}\" y1=\"{py:.1}\" x2=\"{}\" y2=\"{py:.1}\" stroke=\"#ddd\"/>\
                     <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{value:.1}</text>",
                    LEFT + SIZE[0],
                    LEFT - 6.0,
                    py + 4.0
                );
            }
            let curves =
                rows.iter().filter_map(|&(row, colour)| Some((&self.rows.get(row)?.line, colour, 1.0)));
            for (values, colour, width) in curves.chain([(&self.exact, "black", 1.5)]) {
                let points: Vec<String> = self
                    .places
                    .iter()
                    .zip(values)
                    .map(|(&x, &value)| at(x, value.clamp(0.0, top)))
                    .map(|(x, y)| format!("{x:.1},{y:.1}"))
                    .collect();
                let _ = writeln!(
                    text,
                    "<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" points=\"{}\"/>",
                    points.join(" ")
                );
            }
            let _ = writeln!(text, "<text x=\"10\" y=\"{}\">W/m&#178;</text>", low - SIZE[1] - 8.0);
        }
        text.push_str("</svg>\n");
        text
    }
}
