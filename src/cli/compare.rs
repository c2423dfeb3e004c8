//! `cardioid compare`: error figures of pictures against a reference.

use super::meaning::LayerMeaning;
use super::outputs::{Named, Outputs};
use anyhow::{Context, Result, bail};
use cardioid::film::{srgb_decode, srgb_encode_u8};
use cardioid::image_io::{self, Image, Layer, PngPixels, Window};
use cardioid::measure::{ErrorFigures, Picture, Reference};
use clap::Args;
use serde::Serialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Compare pictures with a reference
///
/// Prints for each picture t, against the reference r:
///
///   rmse      sqrt(mean((t - r)^2))
///   relmse    mean((t - r)^2 / (r^2 + 0.01))
///   relmse_u  the same without the noise of the reference, given both halves of it; the one to quote
///   relrmse_u the root of relmse_u with a hundredth of the square of the mean of r in place of 0.01
///   relmse_t  relmse without the worst 0.1 % of the pixels
///   bias      mean luminance of t above that of r, percent
///   firefly   share of pixels twice as bright as anything in r nearby
///   nan       pixels that are not finite; all figures but flip leave them out
///   flip      mean LDR-FLIP, the difference that an eye sees, from 0 to 1
///
/// Values are linear; pictures of 8 bits (PNG, JPEG) are decoded from sRGB first.
#[derive(Args, Clone, Debug)]
#[command(verbatim_doc_comment)]
pub(crate) struct CompareArgs {
    /// Reference picture.
    #[arg(value_name = "REFERENCE")]
    pub(crate) reference: PathBuf,

    /// Pictures to compare with it.
    #[arg(value_name = "TEST", required = true)]
    pub(crate) tests: Vec<PathBuf>,

    /// Second half of the reference: the same picture rendered with other random numbers.
    ///
    /// The reference is then the mean of both, and relmse_u is free of its noise.
    #[arg(long, value_name = "FILE")]
    pub(crate) second_half: Option<PathBuf>,

    /// Compare this layer instead of the picture: direct, caustics, albedo, ...
    #[arg(long, value_name = "NAME", default_value = "beauty")]
    pub(crate) aov: String,

    /// Print JSON instead of a table.
    #[arg(long)]
    pub(crate) json: bool,

    /// Write a map of the error of a single TEST as PNG: red where it is too bright, blue where too dark, from
    /// black at 0.1 % to full colour at 100 % on a logarithmic scale; green where it is not finite.
    #[arg(long, value_name = "FILE.png")]
    pub(crate) difference: Option<PathBuf>,
}

/// The figures that are printed for one picture.
#[derive(Serialize)]
struct Row<'a> {
    test: &'a Path,
    reference: Vec<&'a Path>,
    aov: &'a str,
    #[serde(flatten)]
    figures: ErrorFigures,
}

/// One layer of a file as linear RGB.
struct Loaded {
    width: u32,
    height: u32,
    values: Vec<f32>,
    /// Its window, where the file is a part of a larger picture.
    window: Option<Window>,
    /// Meaning of its layers, where the file states it.
    meaning: Option<LayerMeaning>,
}

impl Loaded {
    /// Its place in the whole picture, and the size of the whole picture.
    fn place(&self) -> Window {
        let whole = Window { x: 0, y: 0, full_width: self.width, full_height: self.height };
        self.window.unwrap_or(whole)
    }

    /// The part of this picture that covers `other`; `None` where it does not cover all of it.
    fn part(&self, other: &Self) -> Option<Self> {
        let (here, there) = (self.place(), other.place());
        let size = |place: Window| (place.full_width, place.full_height);
        let (x, y) = (usize::try_from(there.x - here.x).ok()?, usize::try_from(there.y - here.y).ok()?);
        let (width, height) = (other.width as usize, other.height as usize);
        let is_inside = x + width <= self.width as usize && y + height <= self.height as usize;
        if size(here) != size(there) || !is_inside {
            return None;
        }
        let row = |y: usize| &self.values[3 * (y * self.width as usize + x)..][..3 * width];
        let values = (y..y + height).flat_map(row).copied().collect();
        Some(Self {
            width: other.width,
            height: other.height,
            values,
            window: other.window,
            meaning: self.meaning,
        })
    }

    fn view(&self) -> Result<Picture<'_>> {
        Ok(Picture::new(self.width, self.height, &self.values)?)
    }
}

/// Runs the subcommand.
///
/// # Errors
/// A file cannot be read, has another size than the reference or lacks the layer; the reference is not finite; the
/// map of the error cannot be written.
pub(crate) fn run(args: &CompareArgs) -> Result<ExitCode> {
    if args.difference.is_some() && args.tests.len() != 1 {
        bail!("--difference shows the error of a single picture; name one TEST, not {}", args.tests.len());
    }
    if let Some(map) = &args.difference {
        let read = args.tests.iter().chain([&args.reference]).chain(&args.second_half);
        Outputs::new(read.map(PathBuf::as_path)).add(map, "--difference", Named::ByUser)?;
    }
    let halves = load_halves(args)?;
    let whole = reference_of(args, &halves)?;
    let mut rows = Vec::with_capacity(args.tests.len());
    for path in &args.tests {
        let loaded = load(path, &args.aov)?;
        let named = || path.display().to_string();
        let [first, ..] = &halves[..] else { bail!("no reference") };
        if let (Some(a), Some(b)) = (loaded.meaning, first.meaning)
            && let Some(reason) = LayerMeaning::difference(a, b, &args.aov)
        {
            bail!(
                "{} and {} do not mean the same by their layer \"{}\": {reason}",
                path.display(),
                args.reference.display(),
                args.aov
            );
        }
        // A window is compared with the same part of a larger reference.
        let is_part = loaded.window.is_some() && loaded.place() != first.place();
        let part =
            match is_part.then(|| halves.iter().map(|half| half.part(&loaded)).collect::<Option<Vec<_>>>()) {
                Some(Some(halves)) => {
                    say!(
                        "note: {} is a window of a larger picture: compared with that part of the reference",
                        named()
                    );
                    Some(reference_of(args, &halves)?)
                }
                _ => None,
            };
        let reference = part.as_ref().unwrap_or(&whole);
        if reference.is_half(loaded.view()?) {
            say!("warning: {} is a half of the reference, so its relmse_u is 0 by construction", named());
        }
        let figures = reference.compare(loaded.view()?).with_context(named)?;
        if let Some(map) = &args.difference {
            write_difference(map, &loaded, &reference.differences(loaded.view()?).with_context(named)?)?;
        }
        let halves = std::iter::once(&args.reference).chain(&args.second_half);
        rows.push(Row {
            test: path,
            reference: halves.map(PathBuf::as_path).collect(),
            aov: &args.aov,
            figures,
        });
    }
    let text = if args.json { format!("{}\n", serde_json::to_string_pretty(&rows)?) } else { table(&rows) };
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// The reference, or its halves.
fn load_halves(args: &CompareArgs) -> Result<Vec<Loaded>> {
    let first = load(&args.reference, &args.aov)?;
    let Some(path) = &args.second_half else { return Ok(vec![first]) };
    let second = load(path, &args.aov)?;
    if first.values == second.values {
        bail!(
            "{} and {} hold the same picture; --second-half takes one rendered with another seed",
            args.reference.display(),
            path.display()
        );
    }
    Ok(vec![first, second])
}

fn reference_of(args: &CompareArgs, halves: &[Loaded]) -> Result<Reference> {
    match (halves, &args.second_half) {
        ([first, second], Some(path)) => {
            Reference::halves(first.view()?, second.view()?).with_context(|| path.display().to_string())
        }
        ([first, ..], _) => {
            Reference::single(first.view()?).with_context(|| args.reference.display().to_string())
        }
        ([], _) => bail!("no reference"),
    }
}

fn load(path: &Path, aov: &str) -> Result<Loaded> {
    let image = image_io::read(path)?;
    // The main layer has no name in a file.
    let name = if aov == "beauty" { "" } else { aov };
    let Some(layer) = image.layer(name).or_else(|| image.layer(aov)) else {
        bail!("{} has no layer \"{aov}\"; {}", path.display(), layers_of(&image));
    };
    let mut values = to_rgb(layer).with_context(|| format!("{}, layer \"{aov}\"", path.display()))?;
    if is_display_encoded(path) {
        values.iter_mut().for_each(|v| *v = srgb_decode(*v));
    }
    let (window, meaning) = (image.window, LayerMeaning::of_image(&image));
    Ok(Loaded { width: image.width, height: image.height, values, window, meaning })
}

/// The size of a layer of a picture, and its values as linear RGB.
///
/// # Errors
/// Where the file cannot be read or has no such layer.
pub(crate) fn read_picture(path: &Path, aov: &str) -> Result<((u32, u32), Vec<f32>)> {
    let Loaded { width, height, values, .. } = load(path, aov)?;
    Ok(((width, height), values))
}

/// True for file formats that hold sRGB values rather than linear ones.
fn is_display_encoded(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    ["png", "jpg", "jpeg", "bmp", "tga", "webp"].contains(&extension.as_str())
}

fn layers_of(image: &Image) -> String {
    let names = image.layers.iter().map(|layer| match layer.name.as_str() {
        "" => "beauty",
        name => name,
    });
    match names.collect::<Vec<_>>().as_slice() {
        [] => "it has none at all".to_owned(),
        names => format!("it has {}", names.join(", ")),
    }
}

/// Three channels for each pixel: R, G, B where the layer has them, else its only three channels, or its only channel as grey.
fn to_rgb(layer: &Layer) -> Result<Vec<f32>> {
    let count = layer.channels.len();
    let named = ["R", "G", "B"].map(|name| layer.channel_index(name));
    let picked = match (named, count) {
        ([Some(r), Some(g), Some(b)], _) => [r, g, b],
        (_, 1) => [0, 0, 0],
        (_, 3) => [0, 1, 2],
        _ => bail!("its channels are {}, neither R, G, B nor one or three", layer.channels.join(", ")),
    };
    Ok(layer.data.chunks_exact(count).flat_map(|pixel| picked.map(|channel| pixel[channel])).collect())
}

fn write_difference(path: &Path, size: &Loaded, differences: &[f32]) -> Result<()> {
    let bytes: Vec<u8> = differences.iter().flat_map(|&d| false_colour(d)).collect();
    image_io::write_png(path, size.width, size.height, PngPixels::Rgb8(&bytes))?;
    Ok(())
}

/// False colour of a signed relative difference.
fn false_colour(difference: f32) -> [u8; 3] {
    let strength = (1.0 + difference.abs().log10() / 3.0).clamp(0.0, 1.0);
    let (full, tail) = (srgb_encode_u8(strength), srgb_encode_u8(0.5 * strength * strength));
    match difference {
        d if d.is_nan() => [0, 255, 0],
        d if d > 0.0 => [full, tail, 0],
        _ => [0, tail, full],
    }
}

fn table(rows: &[Row<'_>]) -> String {
    let header =
        ["file", "rmse", "relmse", "relmse_u", "relrmse_u", "relmse_t", "bias", "firefly", "nan", "flip"];
    let mut lines = vec![header.map(str::to_owned)];
    lines.extend(rows.iter().map(|Row { test, figures: f, .. }| {
        [
            test.display().to_string(),
            short(f.rmse),
            short(f.relmse),
            f.relmse_u.map_or("-".to_owned(), short),
            f.relrmse_u.map_or("-".to_owned(), short),
            short(f.relmse_t),
            // There is no relative bias for a black reference.
            if f.bias.is_finite() { format!("{:+.3} %", f.bias) } else { "-".to_owned() },
            short(f.firefly),
            f.nan.to_string(),
            short(f.flip),
        ]
    }));
    let widths: Vec<usize> = (0..header.len())
        .map(|i| lines.iter().map(|line| line[i].chars().count()).max().unwrap_or(0))
        .collect();
    let mut text = String::new();
    for line in &lines {
        // Writing to a string cannot fail.
        let _ = write!(text, "{:<1$}", line[0], widths[0]);
        for (cell, width) in line.iter().zip(&widths).skip(1) {
            let _ = write!(text, "  {cell:>width$}");
        }
        text.push('\n');
    }
    text
}

/// A number with five significant digits.
fn short(x: f64) -> String {
    match x.abs() {
        0.0 => "0".to_owned(),
        a if (1e-3..1e5).contains(&a) => {
            let decimals = (4 - a.log10().floor() as i32).clamp(0, 7) as usize;
            format!("{x:.decimals$}")
        }
        _ => format!("{x:.4e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layer(channels: &[&str], data: Vec<f32>) -> Layer {
        Layer::new("", channels, data)
    }

    #[test]
    fn channels_become_rgb() {
        let data = vec![1.0, 2.0, 3.0, 4.0];
        assert_eq!(to_rgb(&layer(&["A", "B", "G", "R"], data.clone())).unwrap(), [4.0, 3.0, 2.0]);
        assert_eq!(to_rgb(&layer(&["Z"], vec![5.0, 6.0])).unwrap(), [5.0, 5.0, 5.0, 6.0, 6.0, 6.0]);
        assert_eq!(to_rgb(&layer(&["X", "Y", "Z"], vec![1.0, 2.0, 3.0])).unwrap(), [1.0, 2.0, 3.0]);
        assert!(to_rgb(&layer(&["u", "v"], data)).is_err());
    }

    #[test]
    fn numbers_in_the_table() {
        let shown = [0.0, 5e-5, 0.009_809_842, 0.5, 2.272_275, 99_999.4, 1e30, f64::NAN].map(short);
        assert_eq!(shown, ["0", "5.0000e-5", "0.0098098", "0.50000", "2.2723", "99999", "1.0000e30", "NaN"]);
    }

    #[test]
    fn colours_of_differences() {
        assert_eq!(false_colour(1.0), [255, 188, 0]);
        assert_eq!(false_colour(-7.0), [0, 188, 255]);
        assert_eq!(false_colour(0.0), [0, 0, 0]);
        assert_eq!(false_colour(f32::NAN), [0, 255, 0]);
    }

    #[test]
    fn the_table_is_aligned() {
        let figures = ErrorFigures {
            rmse: 1.0,
            relmse: 2.0,
            relmse_u: None,
            relrmse_u: None,
            relmse_t: 3.0,
            bias: -0.25,
            firefly: 0.0,
            nan: 12,
            flip: 0.1,
        };
        let row =
            |test: &'static str| Row { test: Path::new(test), reference: vec![], aov: "beauty", figures };
        let text = table(&[row("a.exr"), row("longer-name.exr")]);
        let lengths: Vec<usize> = text.lines().map(str::len).collect();
        assert_eq!(lengths.len(), 3);
        assert!(lengths.iter().all(|n| *n == lengths[0]), "{text}");
        assert!(text.contains("-0.250 %"));
    }
}
