//! `cardioid probe`: irradiance at points of a scene as a table.

use super::outputs::{Named, Outputs};
use super::picture::{SceneArgs, load};
use super::progress::{Console, catch_interrupts, interrupted};
use super::settings::{SettingsArgs, count_from_one};
use super::write_or_print;
use anyhow::{Context, Result, anyhow, bail};
use cardioid::files;
use cardioid::render::{PROBE_BATCHES, ProbeEstimator, ProbePoint, ProbeRequest, Settings, Silent, probe};
use clap::{Args, ValueEnum};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Irradiance and radiant exitance at points of surfaces by several estimators, as a table (CSV, W/m^2)
#[derive(Args, Clone, Debug)]
pub(crate) struct ProbeArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// First point of a line; metres, as all lengths here.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true, required_unless_present = "points")]
    from: Option<DVec3>,

    /// Last point of the line. Default: the first alone.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true, requires = "from")]
    to: Option<DVec3>,

    /// Points on the line, both ends included.
    #[arg(long, value_name = "N", default_value = "1", value_parser = count_from_one, requires = "to")]
    count: u32,

    /// Points from a file: a line for each, x,y,z or x,y,z,nx,ny,nz; the first line may name columns.
    #[arg(long, value_name = "FILE.csv", conflicts_with = "from")]
    points: Option<PathBuf>,

    /// Normal of points that have none of their own: the surface is looked for from this side.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true, default_value = "0,1,0")]
    normal: DVec3,

    /// How far above and below a point, along its normal, the surface nearest to it is looked for; where there is none, the first
    /// one below is taken. Default: a ten-thousandth of the scene's radius.
    #[arg(long, value_name = "METRES", value_parser = lift)]
    lift: Option<f64>,

    /// What estimates.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "photon-map,gather,path")]
    estimators: Vec<EstimatorChoice>,

    /// Samples of `gather` and of `path` at each point, over all batches.
    #[arg(long, value_name = "N", default_value = "1024", value_parser = count_from_one)]
    samples: u32,

    /// Batches with photon maps and samples of their own: readings are their mean, standard errors what they differ by. One is the
    /// fastest, and leaves the errors of estimators that read maps unknown.
    #[arg(long, value_name = "N", default_value_t = PROBE_BATCHES, value_parser = count_from_one)]
    batches: u32,

    /// File to write; standard output where there is none, or `-`.
    #[arg(short, long, value_name = "FILE.csv")]
    output: Option<PathBuf>,

    /// No progress bars and no notes.
    #[arg(short, long)]
    quiet: bool,

    #[command(flatten)]
    settings: SettingsArgs,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum EstimatorChoice {
    /// The photons around the point, with kernel, count and checking of the settings.
    PhotonMap,
    /// Shadow rays, caustic map and final gathering, as pictures are made.
    Gather,
    /// Path tracing, free of bias.
    Path,
    /// The illumination map of the surface, where it has one; all light but caustics counts as indirect.
    IlluminationMap,
}

fn vector(text: &str) -> Result<DVec3, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) if x.is_finite() && y.is_finite() && z.is_finite() => Ok(DVec3::new(x, y, z)),
        _ => Err("write three numbers, for example 0.5,0,-1.25".to_owned()),
    }
}

fn lift(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(metres) if metres > 0.0 && metres.is_finite() => Ok(metres),
        _ => Err("write a positive number of metres".to_owned()),
    }
}

pub(crate) fn run(args: &ProbeArgs) -> Result<ExitCode> {
    catch_interrupts();
    let mut outputs = Outputs::new([args.scene.scene.as_path()].into_iter().chain(args.points.as_deref()));
    if let Some(output) = &args.output {
        outputs.add_text(output, "the table", Named::ByUser)?;
    }
    let points = points(args)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.scene.threads)
        .build()
        .context("cannot start the threads")?;
    pool.install(|| {
        let loaded = load(&args.scene, &outputs, &Silent, &|| ())?;
        if !args.quiet {
            loaded.print_notes();
        }
        let scene = &loaded.built.scene;
        let radius = scene.space().metres(f64::from(scene.bounds().1));
        let request = ProbeRequest {
            points,
            estimators: args.estimators.iter().map(|&choice| choice.estimator()).collect(),
            samples: args.samples,
            batches: args.batches,
            lift: args.lift.unwrap_or(1e-4 * radius),
            settings: Settings::from(&args.settings.over(&loaded.description.render)),
        };
        let console = Console::new(args.quiet, None);
        let probed = probe(scene, &request, &console);
        console.finish();
        let Some(probed) = probed? else {
            say!("stopped; nothing was written");
            return Ok(interrupted().map_or(ExitCode::FAILURE, ExitCode::from));
        };
        for warning in &probed.warnings {
            say!("warning: {warning}");
        }
        write_or_print(args.output.as_deref(), &probed.to_csv())?;
        Ok(ExitCode::SUCCESS)
    })
}

impl EstimatorChoice {
    fn estimator(self) -> ProbeEstimator {
        match self {
            Self::PhotonMap => ProbeEstimator::PhotonMap,
            Self::Gather => ProbeEstimator::Gather,
            Self::Path => ProbeEstimator::Path,
            Self::IlluminationMap => ProbeEstimator::IlluminationMap,
        }
    }
}

fn points(args: &ProbeArgs) -> Result<Vec<ProbePoint>> {
    if args.normal == DVec3::ZERO {
        bail!(
            "--normal 0,0,0 is no direction; give the side of the surface that is asked about, for example 0,1,0"
        );
    }
    if let Some(file) = &args.points {
        /// Some hundred thousand points, each of which takes many rays.
        const MOST_BYTES: u64 = 64 << 20;
        let bytes = files::read_regular(file, MOST_BYTES)
            .with_context(|| format!("cannot read {}", file.display()))?;
        let text = files::text_of(&bytes).map_err(|what| anyhow!("{}: {what}", file.display()))?;
        return read_points(&String::from_utf8_lossy(&text), file, args.normal);
    }
    let from = args.from.unwrap_or_default();
    let to = args.to.unwrap_or(from);
    let steps = f64::from(args.count.max(2) - 1);
    let at = |i: u32| ProbePoint { position: from.lerp(to, f64::from(i) / steps), normal: args.normal };
    Ok((0..args.count).map(at).collect())
}

/// Reads the points of a file, one for each line. Skips blank lines, text after `#`, and a first line of column names.
fn read_points(text: &str, file: &Path, normal: DVec3) -> Result<Vec<ProbePoint>> {
    let mut points = Vec::new();
    let mut is_first = true;
    for (index, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let numbers: Result<Vec<f64>, _> = line.split(',').map(|part| part.trim().parse::<f64>()).collect();
        let is_head =
            std::mem::take(&mut is_first) && line.split(',').all(|part| part.trim().parse::<f64>().is_err());
        match numbers.as_deref() {
            Ok(&[x, y, z]) if (x + y + z).is_finite() => {
                points.push(ProbePoint { position: DVec3::new(x, y, z), normal });
            }
            Ok(&[x, y, z, nx, ny, nz]) if (x + y + z).is_finite() && (nx + ny + nz).is_finite() => {
                let normal = DVec3::new(nx, ny, nz);
                if normal == DVec3::ZERO {
                    bail!(
                        "{}:{}: the normal is zero; leave it out, or give the side to look at",
                        file.display(),
                        index + 1
                    );
                }
                points.push(ProbePoint { position: DVec3::new(x, y, z), normal });
            }
            _ if is_head => {}
            _ => bail!(
                "{}:{}: not a point; write x,y,z or x,y,z,nx,ny,nz in metres, as numbers with commas between",
                file.display(),
                index + 1
            ),
        }
    }
    if points.is_empty() {
        bail!("{}: no points; write one a line: x,y,z or x,y,z,nx,ny,nz in metres", file.display());
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_file() {
        let read = |text| read_points(text, Path::new("p.csv"), DVec3::Y);
        let found = read("x,y,z\n1, 2,3 # a corner\n\n-1,0,1e-3,0,0,1\n").unwrap();
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].position, found[0].normal), (DVec3::new(1.0, 2.0, 3.0), DVec3::Y));
        assert_eq!((found[1].position, found[1].normal), (DVec3::new(-1.0, 0.0, 1e-3), DVec3::Z));
        for (text, place) in [
            ("1,2\n", "p.csv:1: not a point"),
            ("1,2,3\nx,y,z", "p.csv:2: not a point"),
            ("1,2,inf", "p.csv:1"),
            ("1,2,3,0,0,0", "p.csv:1: the normal is zero"),
            ("# nothing\n", "p.csv: no points"),
        ] {
            let message = read(text).unwrap_err().to_string();
            assert!(message.contains(place), "{text:?}: {message}");
        }
    }
}
