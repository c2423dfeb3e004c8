//! Photon maps in a file, and the check that a render would trace the same photons.

use super::maps::{IRRADIANCE_STRIDE, PassOne, build_maps};
use super::memory::PhotonCounts;
use super::stats::{MapStatistics, PhotonMapFile};
use crate::memory::MemoryError;
use crate::observer::Observer;
use crate::photons::{PhotonFile, PhotonFileError, PhotonMap, read_photon_file, write_photon_file};
use crate::scene::{RenderPlan, Scene};
use crate::settings::{GuideKind, IntegratorKind, MapKind, Maps, SETTINGS, Setting, Settings, ShadowMode};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The settings that photons depend on. All other settings, the camera and the picture do not affect photons.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct PhotonSettings {
    /// The settings of [`Maps::Photons`], with underscores in their names.
    #[serde(flatten)]
    traced: Map<String, Value>,
    /// Photons to store, after the memory limit is applied; zero for a map that is not built.
    global_photons: u64,
    caustic_photons: u64,
}

impl PhotonSettings {
    fn of(settings: &Settings, plan: &RenderPlan) -> Self {
        let counts = PhotonCounts::of(settings, plan);
        let traced = traced_settings(settings);
        Self { traced, global_photons: counts.global, caustic_photons: counts.caustic }
    }

    /// A value in the form of the command line; `(unknown)` for a setting that an older file lacks.
    fn text(&self, setting: &Setting) -> String {
        match self.traced.get(&field(setting)) {
            Some(Value::String(text)) => text.clone(),
            Some(value) => value.to_string(),
            None => "(unknown)".to_owned(),
        }
    }
}

/// The settings of [`Maps::Photons`] with their values.
pub(super) fn traced_settings(settings: &Settings) -> Map<String, Value> {
    let all = serde_json::to_value(settings).unwrap_or_default();
    settings_of(Maps::Photons).map(|setting| (field(setting), all[setting.name].clone())).collect()
}

fn settings_of(maps: Maps) -> impl Iterator<Item = &'static Setting> {
    SETTINGS.iter().filter(move |setting| setting.maps == maps)
}

/// The name of a setting in the description.
fn field(setting: &Setting) -> String {
    setting.name.replace('-', "_")
}

/// The settings that precomputed irradiance depends on, as text. Equal text means equal irradiance.
fn irradiance_key(settings: &Settings, plan: &RenderPlan) -> String {
    let keys: Vec<String> = settings_of(Maps::Irradiance).map(|setting| setting.key(settings)).collect();
    let direct = plan.direct_at_points.build;
    format!("{} {IRRADIANCE_STRIDE} {direct}", keys.join(" "))
}

/// The description at the head of a file.
#[derive(Debug, Serialize, Deserialize)]
struct Description {
    /// Version of the program that wrote it.
    program: String,
    /// Name of the scene.
    scene: String,
    /// Hash of everything in the scene that photons depend on.
    scene_hash: String,
    settings: PhotonSettings,
    /// The settings of precomputed irradiance ([`irradiance_key`]); `None` where there is none.
    irradiance: Option<String>,
    /// Statistics of tracing the maps.
    maps: Vec<MapStatistics>,
    /// Warnings of tracing the maps.
    warnings: Vec<String>,
}

/// Photon maps as read from a file.
#[derive(Debug)]
pub struct SavedMaps {
    path: PathBuf,
    description: Description,
    file: PhotonFile,
    seconds: f64,
}

/// An error that prevents the use of the maps of a file.
#[derive(Debug, thiserror::Error)]
pub enum SavedMapsError {
    /// The file cannot be read or is damaged.
    #[error(transparent)]
    File(#[from] PhotonFileError),
    /// The description cannot be parsed.
    #[error("{}: its description is not understood ({reason}); make it again with `cardioid photons`", file.display())]
    Description {
        /// The file.
        file: PathBuf,
        /// The message of the JSON parser.
        reason: String,
    },
    /// The photons belong to another scene or to other settings.
    #[error("{}: holds other photons than this render asks for: {}", file.display(), differences.join("; "))]
    Different {
        /// The file.
        file: PathBuf,
        /// Each difference, with a remedy.
        differences: Vec<String>,
    },
    /// The render reads no photon map.
    #[error("{}: this render reads no photon map; leave out --photon-map", file.display())]
    Unused {
        /// The file.
        file: PathBuf,
    },
}

impl SavedMaps {
    /// Reads a file that [`write_photon_maps`] wrote.
    ///
    /// # Errors
    /// If the file cannot be read, is not a file of photon maps, or is damaged.
    pub fn read(path: &Path) -> Result<Self, SavedMapsError> {
        let start = Instant::now();
        let file = read_photon_file(path)?;
        let description = serde_json::from_str(&file.text).map_err(|error| SavedMapsError::Description {
            file: path.to_owned(),
            reason: error.to_string(),
        })?;
        Ok(Self { path: path.to_owned(), description, file, seconds: start.elapsed().as_secs_f64() })
    }

    /// Checks that the maps equal those that `settings` would trace in the scene with this hash
    /// ([`crate::scene_file::photon_content_hash`]).
    ///
    /// # Errors
    /// If they do not. The error lists all differences, each with a remedy.
    pub fn check(
        &self,
        scene_hash: &str,
        settings: &Settings,
        plan: &RenderPlan,
    ) -> Result<(), SavedMapsError> {
        if !(plan.global_map.build || plan.caustic_map.build) {
            return Err(SavedMapsError::Unused { file: self.path.clone() });
        }
        let Description { program, scene, scene_hash: saved_hash, settings: saved, .. } = &self.description;
        let mut differences = Vec::new();
        if saved_hash != scene_hash {
            let by = match program == env!("CARGO_PKG_VERSION") {
                true => String::new(),
                false => format!(", or cardioid {program}, which made it, describes scenes otherwise"),
            };
            differences.push(format!(
                "the scene (it was made for `{scene}`): geometry, materials or lights are not the same{by}; make it again \
                 with `cardioid photons`"
            ));
        }
        let asked = PhotonSettings::of(settings, plan);
        let traced = settings_of(Maps::Photons);
        let mut settings: Vec<(&str, String, String)> =
            traced.map(|setting| (setting.name, saved.text(setting), asked.text(setting))).collect();
        for (kind, option, saved, asked) in [
            (MapKind::Global, "global-photons", saved.global_photons, asked.global_photons),
            (MapKind::Caustic, "caustic-photons", saved.caustic_photons, asked.caustic_photons),
        ] {
            let is_there = self.file.maps.iter().any(|map| map.kind == kind);
            let is_wanted = match kind {
                MapKind::Global => plan.global_map.build,
                MapKind::Caustic => plan.caustic_map.build,
            };
            if is_wanted && is_there {
                settings.push((option, saved.to_string(), asked.to_string()));
            } else if is_wanted {
                let name = if kind == MapKind::Global { "global" } else { "caustic" };
                differences.push(format!("it has no {name} map, which this render reads; make it again"));
            }
        }
        settings.retain(|(_, saved, asked)| saved != asked);
        if !settings.is_empty() {
            let list = |of: fn(&(&str, String, String)) -> String| {
                settings.iter().map(of).collect::<Vec<_>>().join(" ")
            };
            let there = list(|(option, saved, _)| format!("--{option} {saved}"));
            let here = list(|(option, _, asked)| format!("--{option} {asked}"));
            differences.push(format!(
                "its photons are those of {there}, and this render asks for {here}; add {there}"
            ));
        }
        match differences.is_empty() {
            true => Ok(()),
            false => Err(SavedMapsError::Different { file: self.path.clone(), differences }),
        }
    }

    /// Statistics of the file.
    pub(super) fn statistics(&self) -> PhotonMapFile {
        PhotonMapFile {
            file: self.path.display().to_string(),
            bytes: self.file.bytes,
            seconds_reading: self.seconds,
            // Set later, where the irradiance is used.
            irradiance: false,
        }
    }

    /// Warnings of the original tracing.
    pub(super) fn warnings(&self) -> &[String] {
        &self.description.warnings
    }

    /// Takes the map of one kind, with its tracing statistics. Returns `None` where the file has no such map, where it was taken before, or
    /// where `stop` returns true.
    pub(super) fn take(
        &mut self,
        kind: MapKind,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<(PhotonMap, Option<MapStatistics>)> {
        let at = self.file.maps.iter().position(|map| map.kind == kind)?;
        let saved = self.file.maps.swap_remove(at);
        let start = Instant::now();
        let map = PhotonMap::build_until(saved.photons, saved.emitted, stop)?;
        let statistics = self.description.maps.iter().find(|map| map.map == kind).cloned();
        let statistics = statistics.map(|statistics| MapStatistics {
            from_file: true,
            bytes: map.memory_bytes() as u64,
            seconds_tracing: 0.0,
            seconds_building: start.elapsed().as_secs_f64(),
            ..statistics
        });
        Some((map, statistics))
    }

    /// Takes the precomputed irradiance, where it equals what would be precomputed for these settings and this plan.
    pub(super) fn take_irradiance(
        &mut self,
        settings: &Settings,
        plan: &RenderPlan,
    ) -> Option<crate::photons::IrradianceMap> {
        let is_same = self.description.irradiance.as_deref() == Some(&*irradiance_key(settings, plan));
        self.file.irradiance.take().filter(|_| is_same)
    }
}

/// Traces the photons of a render with these settings, and precomputes irradiance from them, for a file. The integrator is always photon
/// mapping, whichever the settings name.
///
/// # Errors
/// If the maps would not fit into memory.
pub fn trace_photon_maps(
    scene: &Scene,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<(PassOne, RenderPlan), MemoryError> {
    let settings = Settings {
        integrator: IntegratorKind::PhotonMap,
        // The guide is built from the map, and shadow photons come from other rays: both are built for each picture.
        guide: GuideKind::None,
        shadow_photons: ShadowMode::Off,
        // The file holds individual photons, also those that illumination maps would sum up.
        illumination_maps: false,
        ..settings.clone()
    };
    let plan = settings.plan(scene);
    Ok((build_maps(scene, &plan, &settings, observer)?, plan))
}

/// Writes the maps of `pass`, with a description of the render that they are for.
///
/// # Errors
/// If writing to `out` fails.
pub fn write_photon_maps(
    out: &mut impl Write,
    scene: &Scene,
    scene_hash: &str,
    settings: &Settings,
    (pass, plan): (&PassOne, &RenderPlan),
) -> io::Result<()> {
    let description = Description {
        program: env!("CARGO_PKG_VERSION").to_owned(),
        scene: scene.name().to_owned(),
        scene_hash: scene_hash.to_owned(),
        settings: PhotonSettings::of(settings, plan),
        irradiance: pass.maps.irradiance.as_ref().map(|_| irradiance_key(settings, plan)),
        maps: pass.statistics.clone(),
        warnings: pass.warnings.clone(),
    };
    let text = serde_json::to_string_pretty(&description)?;
    let maps: Vec<(MapKind, &PhotonMap)> =
        [(MapKind::Global, &pass.maps.global), (MapKind::Caustic, &pass.maps.caustic)]
            .into_iter()
            .filter_map(|(kind, map)| Some((kind, map.as_ref()?)))
            .collect();
    write_photon_file(out, &text, &maps, pass.maps.irradiance.as_ref())
}
