//! Photon maps that are kept in a file, and when they are those that a render would trace.

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

/// The settings that photons depend on. Whatever else is set, the camera and the picture change none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct PhotonSettings {
    /// Those of [`Maps::Photons`], with underscores.
    #[serde(flatten)]
    traced: Map<String, Value>,
    /// Photons to store, once memory has been looked at; zero for a map that is not built.
    global_photons: u64,
    caustic_photons: u64,
}

impl PhotonSettings {
    fn of(settings: &Settings, plan: &RenderPlan) -> Self {
        let counts = PhotonCounts::of(settings, plan);
        let all = serde_json::to_value(settings).unwrap_or_default();
        let traced = settings_of(Maps::Photons).map(|setting| (field(setting), all[setting.name].clone()));
        Self { traced: traced.collect(), global_photons: counts.global, caustic_photons: counts.caustic }
    }

    /// A value as the command line takes it; what an older file does not know is named so.
    fn text(&self, setting: &Setting) -> String {
        match self.traced.get(&field(setting)) {
            Some(Value::String(text)) => text.clone(),
            Some(value) => value.to_string(),
            None => "(unknown)".to_owned(),
        }
    }
}

fn settings_of(maps: Maps) -> impl Iterator<Item = &'static Setting> {
    SETTINGS.iter().filter(move |setting| setting.maps == maps)
}

/// A setting's name in the description.
fn field(setting: &Setting) -> String {
    setting.name.replace('-', "_")
}

/// The settings that precomputed irradiance depends on, as text: equal text, equal irradiance.
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
    /// How irradiance was precomputed.
    irradiance: Option<String>,
    /// What tracing them counted.
    maps: Vec<MapStatistics>,
    /// What tracing them warned of.
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

/// Why the maps of a file are not taken.
#[derive(Debug, thiserror::Error)]
pub enum SavedMapsError {
    /// The file itself.
    #[error(transparent)]
    File(#[from] PhotonFileError),
    /// A description that is not understood.
    #[error("{}: its description is not understood ({reason}); make it again with `cardioid photons`", file.display())]
    Description {
        /// The file.
        file: PathBuf,
        /// What the reader of JSON says.
        reason: String,
    },
    /// Photons of another scene or of other settings.
    #[error("{}: holds other photons than this render asks for: {}", file.display(), differences.join("; "))]
    Different {
        /// The file.
        file: PathBuf,
        /// What differs, and what to do about it.
        differences: Vec<String>,
    },
    /// A render that would not look at them.
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
    /// Where it cannot be read, or is not such a file, or is damaged.
    pub fn read(path: &Path) -> Result<Self, SavedMapsError> {
        let start = Instant::now();
        let file = read_photon_file(path)?;
        let description = serde_json::from_str(&file.text).map_err(|error| SavedMapsError::Description {
            file: path.to_owned(),
            reason: error.to_string(),
        })?;
        Ok(Self { path: path.to_owned(), description, file, seconds: start.elapsed().as_secs_f64() })
    }

    /// Refuses maps that are not those that `settings` would trace in the scene with this hash
    /// ([`crate::scene_file::photon_content_hash`]).
    ///
    /// # Errors
    /// All that differs, each with a remedy.
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

    /// What statistics tell of the file.
    pub(super) fn statistics(&self) -> PhotonMapFile {
        PhotonMapFile {
            file: self.path.display().to_string(),
            bytes: self.file.bytes,
            seconds_reading: self.seconds,
            // Until it is taken.
            irradiance: false,
        }
    }

    /// Warnings of when photons were traced.
    pub(super) fn warnings(&self) -> &[String] {
        &self.description.warnings
    }

    /// Takes the map of one kind: the map, and what tracing it counted. `None` where it is not there (any more) or `stop`
    /// says so.
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

    /// Takes the precomputed irradiance, where it is what would be precomputed for this plan.
    pub(super) fn take_irradiance(
        &mut self,
        settings: &Settings,
        plan: &RenderPlan,
    ) -> Option<crate::photons::IrradianceMap> {
        let is_same = self.description.irradiance.as_deref() == Some(&*irradiance_key(settings, plan));
        self.file.irradiance.take().filter(|_| is_same)
    }
}

/// Traces the photons that rendering with these settings would trace, and what is precomputed from them, for a file: by photon
/// mapping, whatever integrator the settings name.
///
/// # Errors
/// Where the maps would not fit into memory.
pub fn trace_photon_maps(
    scene: &Scene,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<(PassOne, RenderPlan), MemoryError> {
    let settings = Settings {
        integrator: IntegratorKind::PhotonMap,
        // Of the map, or of rays that are not photons: made anew for each picture.
        guide: GuideKind::None,
        shadow_photons: ShadowMode::Off,
        // Photons themselves, whatever sums them up.
        illumination_maps: false,
        ..settings.clone()
    };
    let plan = settings.plan(scene);
    Ok((build_maps(scene, &plan, &settings, observer)?, plan))
}

/// Writes the maps of `pass` with all that tells which render they are for.
///
/// # Errors
/// Where `out` fails.
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
