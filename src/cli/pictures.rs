//! The picture as files: an EXR with all layers and metadata from which it can be rendered again, and a PNG with an exposure.

use super::meaning::{LAYERS, LayerMeaning};
use super::outputs::{Named, Outputs};
use super::picture::Loaded;
use anyhow::{Result, bail};
use cardioid::film::{Developed, Film, ToneCurve, ToneMap, auto_exposure};
use cardioid::image_io::{self, Image, Layer, MetadataValue, PngPixels, Window};
use cardioid::integrators::Counters;
use cardioid::render::{ErrorEstimate, RenderRequest, Settings, Statistics, Times};
use cardioid::scene::RenderPlan;
use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How the PNG looks.
#[derive(Args, Clone, Debug)]
pub(super) struct LooksArgs {
    /// Exposure of the PNG in stops, over that of the scene file.
    #[arg(long, value_name = "STOPS", value_parser = stops)]
    exposure: Option<f64>,

    /// Tone curve of the PNG.
    #[arg(long, value_enum, default_value_t = CurveArg::None)]
    tone: CurveArg,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum CurveArg {
    /// Exactly what was computed, clamped at white (the default).
    None,
    /// Bend bright colours towards white (Khronos PBR Neutral).
    Neutral,
}

impl LooksArgs {
    fn curve(&self) -> ToneCurve {
        match self.tone {
            CurveArg::None => ToneCurve::None,
            CurveArg::Neutral => ToneCurve::Neutral,
        }
    }
}

/// Metadata that is added up over windows: counts and times, as JSON.
pub(super) const TIMES_AND_COUNTS: [&str; 2] = ["cardioid/counters", "cardioid/times"];

/// Parses an exposure in stops.
pub(super) fn stops(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(stops) if (-100.0..=100.0).contains(&stops) => Ok(stops),
        _ => Err("write a number of stops from -100 to 100, for example -1.5: each doubles the brightness"
            .to_owned()),
    }
}

/// What a picture is of, and how it was rendered.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub(super) struct About {
    version: String,
    scene: String,
    scene_hash: String,
    /// Settings and plan, as JSON.
    settings: String,
    plan: String,
    embree: String,
    /// Architecture and instruction set.
    target: String,
    /// Meaning of the layers.
    layers: String,
    /// Exposure of the scene file, in stops over `white`.
    exposure: Option<f64>,
    /// Stops that are added to every given exposure.
    white: f64,
    pub(super) has_light: bool,
}

impl About {
    pub(super) fn of(loaded: &Loaded, settings: &Settings, plan: &RenderPlan) -> Result<Self> {
        let film = &loaded.built.film;
        Ok(Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene: loaded.built.scene.name().to_owned(),
            scene_hash: loaded.hash.clone(),
            settings: serde_json::to_string(settings)?,
            plan: serde_json::to_string(plan)?,
            embree: loaded.device.version().to_string(),
            target: loaded.instruction_set(),
            layers: LayerMeaning::of(settings).name().to_owned(),
            exposure: film.exposure,
            white: film.white,
            has_light: !loaded.built.scene.lights().is_empty(),
        })
    }
}

/// Figures of a render that its metadata holds.
pub(super) struct Figures {
    counters: String,
    times: String,
    samples: u64,
    radiosity: Option<String>,
    /// Number of rounds, and the estimated error as JSON.
    rounds: Option<(u64, String)>,
    /// Names of the objects and materials that the picture shows, where it has their numbers.
    names: [Option<BTreeMap<u32, String>>; 2],
}

impl Figures {
    pub(super) fn of(statistics: &Statistics, loaded: &Loaded, developed: &Developed) -> Result<Self> {
        let scene = &loaded.built.scene;
        let object: NameOf<'_> = &|id| scene.surfaces().get(id).map(|surface| surface.name.clone());
        let material: NameOf<'_> = &|id| scene.materials().get(id).map(|(name, _)| name.clone());
        let rounds = statistics.rounds.as_ref();
        let rounds = rounds.map(|rounds| Ok((rounds.done, serde_json::to_string(&rounds.error)?)));
        Ok(Self {
            counters: serde_json::to_string(&statistics.counters)?,
            times: serde_json::to_string(&statistics.times)?,
            samples: statistics.samples,
            radiosity: statistics.radiosity.as_ref().map(serde_json::to_string).transpose()?,
            rounds: rounds.transpose().map_err(|error: serde_json::Error| error)?,
            names: [("object", object), ("material", material)]
                .map(|(layer, name_of)| names_in(developed, layer, name_of)),
        })
    }

    /// Those of a picture that was merged of parts. `names` are of all that parts show.
    pub(super) fn of_parts(
        (counters, times): (&Counters, &Times),
        samples: u64,
        (rounds, error): (u64, Option<&ErrorEstimate>),
        names: &[BTreeMap<u32, String>; 2],
        developed: &Developed,
    ) -> Result<Self> {
        let [objects, materials] = names;
        Ok(Self {
            counters: serde_json::to_string(counters)?,
            times: serde_json::to_string(times)?,
            samples,
            radiosity: None,
            rounds: Some((rounds, serde_json::to_string(&error)?)),
            names: [("object", objects), ("material", materials)].map(|(layer, names)| {
                names_in(developed, layer, &|id| names.get(&u32::try_from(id).ok()?).cloned())
            }),
        })
    }
}

/// Exposure and tone curve of the PNG, and where the exposure comes from. The EXR holds radiance, whatever the exposure.
pub(super) struct Exposure {
    tone: ToneMap,
    /// Stops that are added to every given exposure.
    white: f64,
    from: &'static str,
}

impl Exposure {
    /// The exposure of the command line, or that of the scene, or one chosen from the picture itself.
    pub(super) fn choose(looks: &LooksArgs, about: &About, developed: &Developed) -> Self {
        let white = about.white;
        let given = looks.exposure.map(|stops| (stops, "command line"));
        let given = given.or(about.exposure.map(|stops| (stops, "scene")));
        let (exposure, from) = match given {
            Some((stops, from)) => (stops + white, from),
            None => (auto_exposure(developed.beauty()).unwrap_or(white), "picture"),
        };
        Self { tone: ToneMap { exposure, curve: looks.curve() }, white, from }
    }

    /// Reports an exposure that was chosen automatically, and suggests a remedy where the picture shows nothing.
    pub(super) fn tell(&self, is_quiet: bool, developed: &Developed, has_light: bool) {
        let stops = self.tone.exposure - self.white;
        let seen = self.tone.rendition(developed.beauty());
        if self.from == "picture" && !is_quiet && !seen.is_black() {
            say!(
                "exposure {stops:.2} stops, chosen by the picture, as the scene gives none: --exposure {stops:.2} keeps it"
            );
        }
        if developed.unsampled > 0 {
            return;
        }
        if seen.is_black() && has_light {
            say!(
                "warning: the picture is black: no light reaches what the camera sees; is the camera, or are all lights, shut \
                 in or turned away?"
            );
        }
        if seen.is_black() {
            return;
        }
        let better = auto_exposure(developed.beauty()).map_or(0.0, |better| better - self.white);
        if seen.is_too_bright() {
            say!(
                "warning: {:.0} % of the pixels are beyond white at an exposure of {stops:.2} stops; try --exposure {better:.1}",
                100.0 * seen.clipped as f64 / seen.pixels as f64
            );
        } else if seen.is_too_dark() {
            say!(
                "warning: all pixels are black at an exposure of {stops:.2} stops, though there is light; try --exposure \
                 {better:.1}"
            );
        }
    }

    /// That of a picture put together of windows, whose files hold stops with white, stops of white, and where they come from.
    pub(super) fn of_windows(
        looks: &LooksArgs,
        (stops, white, from): (f64, f64, String),
        beauty: &[f32],
    ) -> Self {
        let (exposure, from) = match (looks.exposure, from.as_str()) {
            (Some(stops), _) => (stops + white, "command line"),
            (None, "scene") => (stops, "scene"),
            (None, "command line") => (stops, "command line"),
            (None, _) => (auto_exposure(beauty).unwrap_or(white), "picture"),
        };
        Self { tone: ToneMap { exposure, curve: looks.curve() }, white, from }
    }

    fn metadata(&self) -> [(String, MetadataValue); 3] {
        [
            ("cardioid/exposure".into(), MetadataValue::Double(self.tone.exposure)),
            ("cardioid/exposureFrom".into(), self.from.into()),
            ("cardioid/white".into(), MetadataValue::Double(self.white)),
        ]
    }
}

/// Output files of the picture. They are checked before anything is rendered, because a wrong name should not cost an hour.
pub(super) struct Pictures {
    exr: Option<PathBuf>,
    png: PathBuf,
}

impl Pictures {
    /// The files for a name of the user's, or for the name of a scene in this folder.
    pub(super) fn new(output: Option<&Path>, scene: &Path) -> Result<Self> {
        let output = match output {
            Some(output) => output.to_owned(),
            None => PathBuf::from(scene.file_stem().unwrap_or_default()).with_extension("exr"),
        };
        let extension = output.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "exr" => Ok(Self { png: output.with_extension("png"), exr: Some(output) }),
            "png" => Ok(Self { exr: None, png: output }),
            _ => bail!("{}: the name of a picture ends in .exr or .png", output.display()),
        }
    }

    /// Checks that every file can be written and that none would overwrite another output or an input.
    pub(super) fn check(&self, outputs: &mut Outputs, named: Named) -> Result<()> {
        if let Some(exr) = &self.exr {
            outputs.add(exr, "the picture", named)?;
        }
        match self.exr {
            Some(_) => outputs.add(&self.png, "the PNG beside the picture", Named::ByUs),
            None => outputs.add(&self.png, "the picture", named),
        }
    }

    /// Estimated time of writing the picture. It is measured on a part of the picture filled with noise, the slowest content; the
    /// file is deleted again.
    pub(super) fn time_to_write(&self, request: &RenderRequest) -> Result<Duration> {
        /// Rows of that part.
        const ROWS: u32 = 64;
        let window =
            request.crop.map_or((request.width, request.height), |crop| (crop.width(), crop.height()));
        let (width, rows) = (window.0, window.1.min(ROWS));
        let empty = Film::new(width, rows, None, request.layers)?.develop();
        let mut image = Image::new(width, rows);
        let mut state = 1u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32
        };
        image.layers = layers_of(&empty);
        image.layers.iter_mut().flat_map(|layer| &mut layer.data).for_each(|value| *value = noise());
        let time = image_io::time_to_write_exr(self.exr.as_ref().unwrap_or(&self.png), &image)?;
        Ok(time.mul_f64(f64::from(window.1) / f64::from(rows)))
    }

    /// Reports the files that were written.
    pub(super) fn tell(&self) {
        for path in self.exr.iter().chain([&self.png]) {
            say!("wrote {}", path.display());
        }
    }

    /// Writes all files, even where one of them fails.
    pub(super) fn write(
        &self,
        about: &About,
        figures: &Figures,
        developed: &Developed,
        exposure: &Exposure,
    ) -> Vec<anyhow::Error> {
        let results =
            [self.write_exr(about, figures, developed, exposure), self.write_png(developed, exposure)];
        results.into_iter().filter_map(Result::err).collect()
    }

    /// Writes a picture that has all of its layers and metadata but the exposure.
    pub(super) fn write_image(&self, mut image: Image, exposure: &Exposure) -> Vec<anyhow::Error> {
        for (name, value) in exposure.metadata() {
            image.metadata.retain(|(known, _)| *known != name);
            image.metadata.push((name, value));
        }
        let png = image.layer("").map_or_else(Vec::new, |layer| exposure.tone.to_srgb8(&layer.data));
        let (width, height) = (image.width, image.height);
        let exr = self.exr.as_ref().map(|exr| image_io::write_exr(exr, &image));
        let png = image_io::write_png(&self.png, width, height, PngPixels::Rgb8(&png));
        exr.into_iter().chain([png]).filter_map(Result::err).map(anyhow::Error::from).collect()
    }

    fn write_exr(
        &self,
        about: &About,
        figures: &Figures,
        developed: &Developed,
        exposure: &Exposure,
    ) -> Result<()> {
        let (width, height) = (developed.rect.width(), developed.rect.height());
        if let Some(exr) = &self.exr {
            let mut image = Image::new(width, height);
            let is_whole = (width, height) == (developed.width, developed.height);
            image.window = (!is_whole).then_some(Window {
                x: developed.rect.x0.into(),
                y: developed.rect.y0.into(),
                full_width: developed.width,
                full_height: developed.height,
            });
            image.layers = layers_of(developed);
            image.metadata = metadata(about, figures, developed);
            image.metadata.extend(exposure.metadata());
            image_io::write_exr(exr, &image)?;
        }
        Ok(())
    }

    fn write_png(&self, developed: &Developed, exposure: &Exposure) -> Result<()> {
        let (width, height) = (developed.rect.width(), developed.rect.height());
        let bytes = exposure.tone.to_srgb8(developed.beauty());
        Ok(image_io::write_png(&self.png, width, height, PngPixels::Rgb8(&bytes))?)
    }
}

/// The layers as they are written to a file.
fn layers_of(developed: &Developed) -> Vec<Layer> {
    let layers = developed.layers.iter().map(|layer| {
        let name = if layer.name == "beauty" { "" } else { layer.name };
        Layer::new(name, layer.channels, layer.values.clone())
    });
    layers.collect()
}

/// Metadata from which the picture can be reproduced.
fn metadata(about: &About, figures: &Figures, developed: &Developed) -> Vec<(String, MetadataValue)> {
    let library = image_io::library_version()
        .map_or_else(String::new, |(major, minor, patch)| format!("{major}.{minor}.{patch}"));
    let rect = developed.rect;
    let mut metadata: Vec<(String, MetadataValue)> = vec![
        ("cardioid/version".into(), about.version.clone().into()),
        ("cardioid/scene".into(), about.scene.clone().into()),
        ("cardioid/sceneHash".into(), about.scene_hash.clone().into()),
        ("cardioid/settings".into(), about.settings.clone().into()),
        ("cardioid/plan".into(), about.plan.clone().into()),
        ("cardioid/counters".into(), figures.counters.clone().into()),
        ("cardioid/times".into(), figures.times.clone().into()),
        ("cardioid/samples".into(), MetadataValue::Double(figures.samples as f64)),
        ("cardioid/embree".into(), about.embree.clone().into()),
        ("cardioid/openimageio".into(), library.into()),
        ("cardioid/target".into(), about.target.clone().into()),
        (LAYERS.into(), about.layers.clone().into()),
        ("cardioid/window".into(), format!("{},{},{},{}", rect.x0, rect.y0, rect.x1, rect.y1).into()),
        ("cardioid/fullSize".into(), format!("{}x{}", developed.width, developed.height).into()),
    ];
    // Numbers and texts are always JSON.
    let json = |names: &BTreeMap<u32, String>| serde_json::to_string(names).unwrap_or_default();
    for (key, names) in ["cardioid/objects", "cardioid/materials"].into_iter().zip(&figures.names) {
        metadata.extend(names.as_ref().map(|names| (key.into(), json(names).into())));
    }
    metadata
        .extend(figures.radiosity.as_ref().map(|text| ("cardioid/radiosity".into(), text.clone().into())));
    if let Some((done, error)) = &figures.rounds {
        metadata.push(("cardioid/rounds".into(), MetadataValue::Double(*done as f64)));
        metadata.push(("cardioid/error".into(), error.clone().into()));
    }
    metadata
}

/// Maps an id to the name of the object or material.
type NameOf<'a> = &'a dyn Fn(usize) -> Option<String>;

/// Names of the ids that occur in an id layer, where there is one. The layer holds -1 where no surface is visible.
fn names_in(developed: &Developed, layer: &str, name_of: NameOf<'_>) -> Option<BTreeMap<u32, String>> {
    let ids = &developed.layers.iter().find(|found| found.name == layer)?.values;
    let seen: BTreeSet<u32> = ids.iter().filter(|id| **id >= 0.0).map(|id| *id as u32).collect();
    Some(seen.into_iter().filter_map(|id| Some((id, name_of(id as usize)?))).collect())
}
