//! Windows of a picture, rendered as tasks on any machines with `render --crop`, put together to the whole.

use super::part::TRY_AGAIN;
use super::pictures::{Exposure, LooksArgs, Pictures, TIMES_AND_COUNTS};
use anyhow::{Context, Result, bail};
use cardioid::film::PixelRect;
use cardioid::image_io::{self, Image, Layer, MetadataValue, Window};
use cardioid::integrators::Counters;
use cardioid::render::Times;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Whether this is the name of a window, and not that of a part.
pub(super) fn is_window(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"))
}

/// Puts windows together and writes the picture.
pub(super) fn merge(
    paths: &[PathBuf],
    pictures: &Pictures,
    looks: &LooksArgs,
    is_quiet: bool,
) -> Result<ExitCode> {
    let mut whole: Option<Whole> = None;
    for path in paths {
        let image = image_io::read(path)?;
        match &mut whole {
            None => whole = Some(Whole::new(path, &image)?),
            Some(whole) => whole.add(path, &image)?,
        }
    }
    let Some(whole) = whole else { bail!("there is no window to merge") };
    if let Some((x, y)) = whole.first_missing() {
        say!("error: windows are missing: none of the files has pixel {x},{y} of {}", whole.size_in_words());
        return Ok(ExitCode::from(TRY_AGAIN));
    }
    let Whole { image, exposure, .. } = whole;
    let exposure = Exposure::of_windows(looks, exposure, image.layer("").map_or(&[], |layer| &layer.data));
    let failures = pictures.write_image(image, &exposure);
    for failure in &failures {
        say!("error: {failure:#}");
    }
    if !is_quiet && failures.is_empty() {
        pictures.tell();
    }
    Ok(if failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(TRY_AGAIN) })
}

/// The picture so far.
struct Whole {
    first: PathBuf,
    image: Image,
    /// For each pixel, one more than the number of the file that has it; 0 for none.
    from: Vec<u32>,
    files: Vec<PathBuf>,
    /// Metadata of exposure: stops with white, stops of white, and where they come from.
    exposure: (f64, f64, String),
    counters: Counters,
    times: Times,
    names: [BTreeMap<u32, String>; 2],
}

const NAMES: [&str; 2] = ["cardioid/objects", "cardioid/materials"];

fn text<'a>(image: &'a Image, name: &str) -> Option<&'a str> {
    if let Some(MetadataValue::Text(text)) = image.metadata(name) { Some(text) } else { None }
}

fn number(image: &Image, name: &str) -> Option<f64> {
    if let Some(&MetadataValue::Double(number)) = image.metadata(name) { Some(number) } else { None }
}

/// Parses JSON of the metadata of a window.
fn json<T: serde::de::DeserializeOwned + Default>(path: &Path, image: &Image, name: &str) -> Result<T> {
    match text(image, name) {
        None => Ok(T::default()),
        Some(text) => {
            serde_json::from_str(text).with_context(|| format!("{}: {name} is damaged", path.display()))
        }
    }
}

impl Whole {
    fn new(path: &Path, image: &Image) -> Result<Self> {
        let (width, height) =
            image.window.map_or((image.width, image.height), |it| (it.full_width, it.full_height));
        if text(image, "cardioid/settings").is_none() {
            bail!("{} was not written by `cardioid render`", path.display());
        }
        let pixels = PixelRect::whole(width, height).area();
        let mut all = Image::new(width, height);
        let mut from = Vec::new();
        from.try_reserve_exact(pixels).context("there is no memory for the picture")?;
        from.resize(pixels, 0);
        for layer in &image.layers {
            let mut data = Vec::new();
            let values = pixels * layer.channels.len();
            data.try_reserve_exact(values).context("there is no memory for the picture")?;
            data.resize(values, 0.0);
            all.layers.push(Layer { name: layer.name.clone(), channels: layer.channels.clone(), data });
        }
        let is_kept = |name: &String| name.starts_with("cardioid/") && name != "cardioid/error";
        all.metadata = image.metadata.iter().filter(|(name, _)| is_kept(name)).cloned().collect();
        let stops = |name: &str| number(image, name).unwrap_or_default();
        let exposure_from = text(image, "cardioid/exposureFrom").unwrap_or("picture").to_owned();
        let exposure = (stops("cardioid/exposure"), stops("cardioid/white"), exposure_from);
        let mut whole = Self {
            first: path.to_owned(),
            image: all,
            from,
            files: Vec::new(),
            exposure,
            counters: Counters::default(),
            times: Times::default(),
            names: Default::default(),
        };
        whole.add(path, image)?;
        Ok(whole)
    }

    fn size_in_words(&self) -> String {
        format!("{} x {}", self.image.width, self.image.height)
    }

    fn add(&mut self, path: &Path, image: &Image) -> Result<()> {
        self.check(path, image)?;
        let Window { x, y, .. } =
            image.window.unwrap_or(Window { x: 0, y: 0, full_width: image.width, full_height: image.height });
        let (x, y) = (u32::try_from(x)?, u32::try_from(y)?);
        let rect =
            PixelRect { x0: x, y0: y, x1: x.saturating_add(image.width), y1: y.saturating_add(image.height) };
        let whole = PixelRect::whole(self.image.width, self.image.height);
        if !whole.contains_rect(&rect) {
            bail!("{}: its window is not in the picture", path.display());
        }
        self.files.push(path.to_owned());
        for (pixel, (x, y)) in rect.pixels().enumerate() {
            let Some(to) = whole.index(x, y) else { continue };
            if let Some(other) = (self.from[to] as usize).checked_sub(1) {
                let other = self.files[other].display();
                bail!("{other} and {} both have pixel {x},{y}; leave one of them out", path.display());
            }
            self.from[to] = self.files.len() as u32;
            for (layer, added) in self.image.layers.iter_mut().zip(&image.layers) {
                let channels = layer.channels.len();
                let values = &added.data[pixel * channels..(pixel + 1) * channels];
                layer.data[to * channels..(to + 1) * channels].copy_from_slice(values);
            }
        }
        self.counters += json::<Counters>(path, image, TIMES_AND_COUNTS[0])?;
        let times = json::<Times>(path, image, TIMES_AND_COUNTS[1])?;
        self.times.scene += times.scene;
        self.times.photons += times.photons;
        self.times.cache += times.cache;
        self.times.pixels += times.pixels;
        for (names, key) in self.names.iter_mut().zip(NAMES) {
            names.extend(json::<BTreeMap<u32, String>>(path, image, key)?);
        }
        self.describe()
    }

    /// Windows of one picture have the same scene, settings, program, layers and size, and all of their samples.
    fn check(&self, path: &Path, image: &Image) -> Result<()> {
        let (one, other) = (self.first.display(), path.display());
        for (key, is) in [
            ("cardioid/sceneHash", "the scenes differ"),
            ("cardioid/settings", "the settings differ"),
            ("cardioid/plan", "the plans differ"),
            ("cardioid/version", "the versions of cardioid differ"),
            ("cardioid/embree", "the versions of Embree differ"),
            ("cardioid/target", "the instruction sets differ (--isa pins one)"),
            ("cardioid/fullSize", "the sizes differ"),
            (
                "cardioid/samples",
                "the numbers of samples differ, as where a render was stopped (--whole writes no such picture)",
            ),
            ("cardioid/rounds", "the numbers of rounds differ"),
        ] {
            if self.image.metadata(key) != image.metadata(key) {
                bail!("{one} and {other} are windows of different pictures: {is}");
            }
        }
        let names = |image: &Image| -> Vec<_> {
            image.layers.iter().map(|layer| (layer.name.clone(), layer.channels.clone())).collect()
        };
        if names(&self.image) != names(image) {
            bail!("{one} and {other} have other layers");
        }
        Ok(())
    }

    /// Updates the metadata that differ from window to window.
    fn describe(&mut self) -> Result<()> {
        let [width, height] = [self.image.width, self.image.height];
        let mut values = vec![
            (TIMES_AND_COUNTS[0], serde_json::to_string(&self.counters)?),
            (TIMES_AND_COUNTS[1], serde_json::to_string(&self.times)?),
            ("cardioid/window", format!("0,0,{width},{height}")),
        ];
        for (key, names) in NAMES.into_iter().zip(&self.names) {
            values.push((key, serde_json::to_string(names)?));
        }
        for (key, value) in values {
            if let Some((_, found)) = self.image.metadata.iter_mut().find(|(name, _)| name == key) {
                *found = value.into();
            }
        }
        Ok(())
    }

    fn first_missing(&self) -> Option<(u32, u32)> {
        let pixel = self.from.iter().position(|&file| file == 0)? as u32;
        Some((pixel % self.image.width, pixel / self.image.width))
    }
}
