//! Photon atlases and irradiance atlases in folders (Christensen & Batali 2004): photons of each group of objects in a file of their own, and
//! a brick map of their irradiance.

use super::saved::traced_settings;
use super::settings::{IntegratorKind, Settings};
use crate::bricks::{
    BrickFileError, BrickFileProblem, BrickMap, BrickOwner, BrickParams, IrradianceAtlas, build_bricks,
    write_brick_file, write_discs_as_ply,
};
use crate::files::read_regular;
use crate::image_io::{ImageError, write_bytes, write_text};
use crate::integrators::{DirectAt, Place};
use crate::observer::Observer;
use crate::photons::{
    DirectLight, GroupFile, GroupFileError, GroupFileProblem, GroupWriter, Photon, PhotonMap, PhotonOrder,
    Query, TraceSettings, stream_photons,
};
use crate::scene::{MapKind, Scene};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Photons whose irradiance is estimated at a time, with those around them in memory. It is fixed, so that no bit depends on memory.
const UNIT: usize = 1 << 20;

/// Largest radius of an estimate, in radii of the scene, over the root of the share of photons in an estimate: spread evenly over a sphere
/// around the scene, photons would be sixteen times that many within half of it. It is reached only where there is hardly any light.
const LARGEST_REACH: f32 = 16.0;

/// Largest size of a description of an atlas.
const LONGEST_TEXT: u64 = 256 << 20;

/// Version of the descriptions.
const VERSION: u32 = 1;

/// Settings of tracing a photon atlas.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AtlasParams {
    /// Groups at most. Where a scene has more objects, neighbours share a group.
    pub groups: usize,
    /// Photons in memory at a time while they are sorted. No result depends on it.
    pub in_memory: usize,
}

/// Settings of building brick maps.
#[derive(Clone, Debug, PartialEq)]
pub struct BrickRequest {
    /// Photons in an estimate: 50 in Christensen & Batali 2004, section 5.3.
    pub nearest: u32,
    /// Largest variation in a brick that is left out.
    pub max_error: f32,
    /// Folder for the discs as PLY, one file for each group; `None` for none.
    pub discs: Option<PathBuf>,
}

/// Objects that share a file of photons and a brick map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AtlasGroup {
    /// Name of its object, or of one of them and their number.
    pub name: String,
    /// Photons on its objects.
    pub photons: u64,
    /// Discs of its brick map.
    #[serde(default)]
    pub discs: u64,
    /// Bricks of its brick map.
    #[serde(default)]
    pub bricks: u64,
    /// Surfaces, by their numbers in the scene.
    surfaces: Vec<u32>,
}

/// Description of a photon atlas or an irradiance atlas.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AtlasDescription {
    version: u32,
    /// Version of the program that wrote it.
    program: String,
    /// Name of the scene.
    pub scene: String,
    scene_hash: String,
    /// The settings that photons depend on.
    settings: Map<String, Value>,
    /// Photons that left the lights.
    pub emitted: u64,
    /// Photons stored.
    pub photons: u64,
    /// Photons in an estimate of irradiance.
    #[serde(default)]
    nearest: u32,
    /// Largest variation in a brick that was left out.
    #[serde(default)]
    max_error: f32,
    /// The groups.
    pub groups: Vec<AtlasGroup>,
    /// Length of one in render space, in metres.
    pub unit: f64,
}

/// What building brick maps took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BrickReport {
    /// Seconds to read photons and estimate irradiance.
    pub seconds_irradiance: f64,
    /// Seconds to build and write bricks.
    pub seconds_bricks: f64,
    /// The most bricks in memory at once while they were built.
    pub most_open: usize,
    /// Bricks that were left out because the level above shows the same.
    pub eliminated: u64,
    /// Bytes of all brick maps.
    pub bytes: u64,
}

/// An error of an atlas.
#[derive(Debug, thiserror::Error)]
pub enum AtlasError {
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] ImageError),
    /// A file of photons is refused.
    #[error(transparent)]
    Photons(#[from] GroupFileError),
    /// A brick map is refused.
    #[error(transparent)]
    Bricks(#[from] BrickFileError),
    /// The folder cannot be used.
    #[error("{}: {cause}; name a folder in which files can be written", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// The error of the system.
        cause: io::Error,
    },
    /// There is no description, or it cannot be parsed.
    #[error("{}: {reason}; {remedy}", file.display())]
    Description {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        reason: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The atlas belongs to another scene.
    #[error(
        "{}: was made for `{scene}`, whose geometry, materials or lights are not those of this scene; make it again with `cardioid photons` \
         and `cardioid bricks`",
        folder.display()
    )]
    OtherScene {
        /// The folder.
        folder: PathBuf,
        /// Name of its scene.
        scene: String,
    },
    /// The scene stores no photon.
    #[error("this scene needs no photons: nothing shines in it, or nothing diffuse is there to be lit ({0})")]
    Dark(String),
    /// The scene has media that scatter.
    #[error(
        "the medium `{0}` scatters light, and an atlas holds light on surfaces alone; render it without --atlas"
    )]
    Scatters(String),
}

fn photon_file(folder: &Path, group: usize) -> PathBuf {
    folder.join(format!("group-{group:04}.photons"))
}

fn brick_file(folder: &Path, group: usize) -> PathBuf {
    folder.join(format!("group-{group:04}.bricks"))
}

const PHOTON_DESCRIPTION: &str = "photons.json";
const BRICK_DESCRIPTION: &str = "bricks.json";

impl AtlasDescription {
    /// What identifies the photons of a group: scene, settings, groups.
    fn owner(&self, group: usize) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        let settings = Value::Object(self.settings.clone()).to_string();
        for text in [&self.scene_hash, &settings] {
            hasher.update(&(text.len() as u64).to_le_bytes()).update(text.as_bytes());
        }
        hasher.update(&self.emitted.to_le_bytes()).update(&(group as u64).to_le_bytes());
        for group in &self.groups {
            hasher.update(&(group.surfaces.len() as u64).to_le_bytes());
            group.surfaces.iter().for_each(|surface| {
                hasher.update(&surface.to_le_bytes());
            });
        }
        *hasher.finalize().as_bytes()
    }

    /// What identifies the brick map of a group.
    fn brick_owner(&self, group: usize) -> BrickOwner {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.owner(group)).update(&self.nearest.to_le_bytes());
        hasher.update(&self.max_error.to_le_bytes());
        BrickOwner(*hasher.finalize().as_bytes())
    }

    fn read(folder: &Path, name: &str, remedy: &'static str) -> Result<Self, AtlasError> {
        let file = folder.join(name);
        let wrong = |reason: String| AtlasError::Description { file: file.clone(), reason, remedy };
        let text =
            read_regular(&file, LONGEST_TEXT).map_err(|error| wrong(format!("cannot be read: {error}")))?;
        let found: Self =
            serde_json::from_slice(&text).map_err(|error| wrong(format!("is not understood ({error})")))?;
        match found.version == VERSION {
            true => Ok(found),
            false => Err(wrong(format!(
                "is of version {}, and this program reads version {VERSION}",
                found.version
            ))),
        }
    }

    /// The description of the photon atlas in a folder.
    ///
    /// # Errors
    /// If there is none, or it is not understood.
    pub fn of_photons(folder: &Path) -> Result<Self, AtlasError> {
        Self::read(folder, PHOTON_DESCRIPTION, "make the atlas with `cardioid photons SCENE --atlas FOLDER`")
    }

    /// The description of the irradiance atlas in a folder.
    ///
    /// # Errors
    /// If there is none, or it is not understood.
    pub fn of_bricks(folder: &Path) -> Result<Self, AtlasError> {
        Self::read(
            folder,
            BRICK_DESCRIPTION,
            "make the atlas with `cardioid photons SCENE --atlas FOLDER` and `cardioid bricks SCENE --atlas FOLDER`",
        )
    }

    /// Whether it was made for the scene of this hash.
    pub fn is_of(&self, scene_hash: &str) -> bool {
        self.scene_hash == scene_hash
    }

    fn check(&self, folder: &Path, scene: &Scene, scene_hash: &str) -> Result<(), AtlasError> {
        let surfaces = scene.surfaces().len() as u32;
        let is_ours = self.groups.iter().flat_map(|group| &group.surfaces).all(|&surface| surface < surfaces);
        match self.scene_hash == scene_hash && is_ours {
            true => Ok(()),
            false => Err(AtlasError::OtherScene { folder: folder.to_owned(), scene: self.scene.clone() }),
        }
    }

    fn write(&self, folder: &Path, name: &str) -> Result<(), AtlasError> {
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default();
        text.push('\n');
        Ok(write_text(folder.join(name), &text)?)
    }

    /// Opens all brick maps of a folder, `None` for groups without one.
    ///
    /// # Errors
    /// If one is missing, damaged, or does not belong here.
    pub fn open_bricks(&self, folder: &Path) -> Result<Vec<Option<BrickMap>>, AtlasError> {
        let open = |(number, group): (usize, &AtlasGroup)| {
            if group.bricks == 0 {
                return Ok(None);
            }
            let path = brick_file(folder, number);
            let map = BrickMap::open(&path)?;
            if map.owner() != self.brick_owner(number) || map.bricks() as u64 != group.bricks {
                return Err(BrickFileError { file: path, problem: BrickFileProblem::Owner }.into());
            }
            Ok(Some(map))
        };
        self.groups.iter().enumerate().map(open).collect()
    }
}

fn check_scene(scene: &Scene) -> Result<(), AtlasError> {
    match scene.media().iter().find(|medium| medium.volume.is_some()) {
        Some(medium) => Err(AtlasError::Scatters(medium.name.clone())),
        None => Ok(()),
    }
}

/// Surfaces in groups: each by itself while they are few; otherwise neighbours together, such that boxes around surfaces have about the same
/// area in each group.
fn groups_of(scene: &Scene, most: usize) -> Vec<AtlasGroup> {
    let surfaces = scene.surfaces();
    let mut boxes = vec![(Vec3::INFINITY, Vec3::NEG_INFINITY); surfaces.len()];
    for target in scene.targets() {
        let (low, high) = &mut boxes[target.surface as usize];
        (*low, *high) = (low.min(target.bounds[0]), high.max(target.bounds[1]));
    }
    let mut order: Vec<u32> = (0..surfaces.len() as u32).collect();
    let most = most.max(1);
    if order.len() > most {
        let (centre, radius) = scene.bounds();
        let curve = PhotonOrder::within(centre, radius);
        order.sort_by_key(|&surface| {
            let (low, high) = boxes[surface as usize];
            (curve.code(0.5 * (low + high)), surface)
        });
    }
    let area = |surface: u32| {
        let (low, high) = boxes[surface as usize];
        let sides = (high - low).max(Vec3::ZERO).as_dvec3();
        sides.x * sides.y + sides.y * sides.z + sides.z * sides.x
    };
    let total: f64 = order.iter().map(|&surface| area(surface)).sum();
    let (mut groups, mut before, mut last) = (Vec::<Vec<u32>>::new(), 0.0, None);
    let is_few = order.len() <= most;
    for surface in order {
        // The group in which the middle of this surface's share lies.
        let middle = before + 0.5 * area(surface);
        let number = if total > 0.0 { (middle / total * most as f64) as usize } else { 0 };
        match groups.last_mut() {
            Some(group) if !is_few && last == Some(number) => group.push(surface),
            _ => groups.push(vec![surface]),
        }
        last = Some(number);
        before += area(surface);
    }
    let named = |mut surfaces: Vec<u32>| {
        surfaces.sort_unstable();
        let first = &scene.surfaces()[surfaces[0] as usize].name;
        let name = match surfaces.len() {
            1 => first.clone(),
            more => format!("{first} and {} more", more - 1),
        };
        AtlasGroup { name, photons: 0, discs: 0, bricks: 0, surfaces }
    };
    groups.into_iter().map(named).collect()
}

/// The group of each surface.
fn group_of_surface(groups: &[AtlasGroup], surfaces: usize) -> Vec<Option<usize>> {
    let mut of_surface = vec![None; surfaces];
    for (number, group) in groups.iter().enumerate() {
        for &surface in &group.surfaces {
            if let Some(group) = of_surface.get_mut(surface as usize) {
                *group = Some(number);
            }
        }
    }
    of_surface
}

/// Traces the photons of the global map into files of `folder`, one for each group of objects: memory does not grow with their number. The
/// description is written last, so that without it nothing counts. `None` where the observer asked to stop; files of an atlas that was in the
/// folder before may then be those of the new one, which the old description refuses.
///
/// # Errors
/// If the scene stores no photons, or a file cannot be written.
pub fn trace_photon_atlas(
    scene: &Scene,
    (scene_hash, settings): (&str, &Settings),
    folder: &Path,
    params: AtlasParams,
    observer: &dyn Observer,
) -> Result<Option<AtlasDescription>, AtlasError> {
    check_scene(scene)?;
    let settings = Settings { integrator: IntegratorKind::PhotonMap, ..settings.clone() };
    let plan = settings.plan(scene);
    if !plan.global_map.build {
        return Err(AtlasError::Dark(plan.global_map.reason));
    }
    let in_folder = |cause| AtlasError::Folder { folder: folder.to_owned(), cause };
    std::fs::create_dir_all(folder).map_err(in_folder)?;
    let mut groups = groups_of(scene, params.groups);
    let of_surface = group_of_surface(&groups, scene.surfaces().len());
    let mut writers: Vec<GroupWriter> =
        groups.iter().map(|_| GroupWriter::new(folder)).collect::<io::Result<_>>().map_err(in_folder)?;
    let wanted = settings.global_photons;
    observer.begin("tracing photons to disk", wanted);
    let trace = TraceSettings {
        kind: MapKind::Global,
        stored: wanted,
        seed: settings.seed,
        max_depth: settings.max_depth,
        aimed: settings.aim_photons,
        wavelengths: settings.wavelengths,
    };
    let mut take = |photons: &[Photon], surfaces: &[u32]| -> io::Result<()> {
        photons.iter().zip(surfaces).try_for_each(|(photon, &surface)| {
            let group = of_surface[surface as usize].and_then(|group| writers.get_mut(group));
            group.map_or(Ok(()), |writer| writer.push(photon))
        })
    };
    let advance = |done: u64, total: u64| {
        observer.advance((done as f64 / total as f64 * wanted as f64) as u64);
        !observer.is_cancelled()
    };
    let Some(streamed) = stream_photons(scene, &trace, &mut take, &advance).map_err(in_folder)? else {
        return Ok(None);
    };
    for (group, writer) in groups.iter_mut().zip(&writers) {
        group.photons = writer.len();
    }
    let description = AtlasDescription {
        version: VERSION,
        program: env!("CARGO_PKG_VERSION").to_owned(),
        scene: scene.name().to_owned(),
        scene_hash: scene_hash.to_owned(),
        settings: traced_settings(&settings),
        emitted: streamed.emitted,
        photons: groups.iter().map(|group| group.photons).sum(),
        nearest: 0,
        max_error: 0.0,
        groups,
        unit: scene.space().metres(1.0),
    };
    observer.begin("sorting photons", description.photons);
    let (centre, radius) = scene.bounds();
    let order = PhotonOrder::within(centre, radius);
    let mut done = 0;
    for (number, writer) in writers.into_iter().enumerate() {
        if observer.is_cancelled() {
            return Ok(None);
        }
        done += writer.len();
        if !writer.is_empty() {
            let owner = (description.owner(number), description.emitted);
            writer.finish(&photon_file(folder, number), owner, order, params.in_memory)?;
        }
        observer.advance(done);
    }
    description.write(folder, PHOTON_DESCRIPTION)?;
    Ok(Some(description))
}

/// Builds the brick maps of a photon atlas in the same folder. Each group is done by itself, with the photons of its neighbours around it, so
/// that no seam shows where groups meet. The description is written last. `None` where the observer asked to stop.
///
/// # Errors
/// If there is no photon atlas of this scene in the folder, a file of it is damaged, or a file cannot be written.
pub fn build_irradiance_atlas(
    scene: &Scene,
    (scene_hash, settings): (&str, &Settings),
    folder: &Path,
    request: &BrickRequest,
    observer: &dyn Observer,
) -> Result<Option<(AtlasDescription, BrickReport)>, AtlasError> {
    check_scene(scene)?;
    let photons = AtlasDescription::of_photons(folder)?;
    photons.check(folder, scene, scene_hash)?;
    let mut description =
        AtlasDescription { nearest: request.nearest, max_error: request.max_error, ..photons.clone() };
    let files: Vec<Option<GroupFile>> = photons
        .groups
        .iter()
        .enumerate()
        .map(|(number, group)| {
            if group.photons == 0 {
                return Ok(None);
            }
            let path = photon_file(folder, number);
            let file = GroupFile::open(&path)?;
            let is_ours = file.owner() == photons.owner(number) && file.len() == group.photons;
            match is_ours && file.emitted() == photons.emitted {
                true => Ok(Some(file)),
                false => Err(GroupFileError { file: path, problem: GroupFileProblem::Owner }),
            }
        })
        .collect::<Result<_, _>>()?;
    let settings = Settings { integrator: IntegratorKind::PhotonMap, ..settings.clone() };
    let estimates = Estimates::new(scene, &settings, &photons, request.nearest, observer);
    let mut report = BrickReport::default();
    let mut before = 0;
    observer.begin("irradiance and brick maps", photons.photons);
    for (number, file) in files.iter().enumerate() {
        let Some(file) = file else { continue };
        let begun = Instant::now();
        let mut discs = Vec::new();
        for run in 0..file.runs(UNIT) {
            let own = file.run(run, UNIT)?;
            if observer.is_cancelled() {
                return Ok(None);
            }
            discs.extend(estimates.discs(&own, before, &files)?);
            before += own.len() as u64;
            observer.advance(before);
        }
        report.seconds_irradiance += begun.elapsed().as_secs_f64();
        if observer.is_cancelled() {
            return Ok(None);
        }
        if let Some(folder) = &request.discs {
            let space = *scene.space();
            let scales = (space.metres(1.0), 1.0 / space.power);
            write_bytes(folder.join(format!("group-{number:04}.ply")), |out| {
                write_discs_as_ply(out, &discs, |p| space.world_position(p.as_dvec3()), scales)
            })?;
        }
        let begun = Instant::now();
        let in_folder = |cause| AtlasError::Folder { folder: folder.to_owned(), cause };
        let params = BrickParams { max_error: request.max_error, ..BrickParams::default() };
        let built = build_bricks(&discs, &params, folder).map_err(in_folder)?;
        report.most_open = report.most_open.max(built.most_open);
        report.eliminated += built.eliminated;
        let group = &mut description.groups[number];
        (group.discs, group.bricks) = (built.discs, built.len() as u64);
        if !built.is_empty() {
            let path = brick_file(folder, number);
            write_bytes(&path, |out| write_brick_file(out, &built, description.brick_owner(number)))?;
            report.bytes += std::fs::metadata(&path).map_or(0, |found| found.len());
        }
        report.seconds_bricks += begun.elapsed().as_secs_f64();
    }
    description.write(folder, BRICK_DESCRIPTION)?;
    Ok(Some((description, report)))
}

/// How irradiance is estimated at photons.
struct Estimates<'a> {
    scene: &'a Scene,
    settings: &'a Settings,
    template: Query,
    direct: Option<DirectAt<'a>>,
    emitted: u64,
    observer: &'a dyn Observer,
}

impl<'a> Estimates<'a> {
    fn new(
        scene: &'a Scene,
        settings: &'a Settings,
        photons: &AtlasDescription,
        nearest: u32,
        observer: &'a dyn Observer,
    ) -> Self {
        let reading = settings.photon_map_settings(scene);
        let plan = settings.plan(scene);
        let template = reading.global_query(Vec3::ZERO, Vec3::Z);
        let share = nearest as f32 / photons.photons.max(1) as f32;
        let reach = LARGEST_REACH * reading.scene_radius * share.sqrt();
        let template =
            Query { k: nearest.max(2) as usize, max_radius: reading.max_radius.min(reach), ..template };
        let direct = plan.direct_at_points.build.then(|| DirectAt::new(scene, settings.seed));
        Self { scene, settings, template, direct, emitted: photons.emitted, observer }
    }

    /// Discs at the photons `own`, of which the first has number `first`, from all photons around them.
    fn discs(
        &self,
        own: &[Photon],
        first: u64,
        files: &[Option<GroupFile>],
    ) -> Result<Vec<crate::bricks::Disc>, AtlasError> {
        let bounds = own.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), photon| {
            (low.min(photon.position), high.max(photon.position))
        });
        let reach = self.template.max_radius;
        let mut around = Vec::new();
        for file in files.iter().flatten() {
            file.within(bounds.0 - reach, bounds.1 + reach, &mut around)?;
        }
        let map = PhotonMap::build(around, self.emitted);
        let reading = self.settings.photon_map_settings(self.scene);
        let direct = self
            .direct
            .as_ref()
            .map(|direct| move |number, at, normal| direct.irradiance(number, at, normal));
        let by_lights = direct.as_ref().map(|direct| (direct as &DirectLight<'_>, first));
        Ok(map.discs(
            own,
            (&self.template, &reading.global),
            |at, normal| Place::new(self.scene, at, normal, reading.visible_kernel),
            by_lights,
            &|| self.observer.is_cancelled(),
        ))
    }
}

/// Opens the irradiance atlas of a scene, to be read through a cache of `budget` bytes.
///
/// # Errors
/// If there is none, it belongs to another scene, or a file of it is damaged.
pub fn open_irradiance_atlas(
    scene: &Scene,
    scene_hash: &str,
    folder: &Path,
    budget: u64,
) -> Result<IrradianceAtlas, AtlasError> {
    check_scene(scene)?;
    let description = AtlasDescription::of_bricks(folder)?;
    description.check(folder, scene, scene_hash)?;
    let maps = description.open_bricks(folder)?;
    // Groups without a map do not count.
    let mut count = 0;
    let number_of: Vec<Option<usize>> = maps
        .iter()
        .map(|map| {
            map.as_ref().map(|_| {
                count += 1;
                count - 1
            })
        })
        .collect();
    let of_group = group_of_surface(&description.groups, scene.surfaces().len());
    let of_surface = of_group.into_iter().map(|group| group.and_then(|group| number_of[group]));
    let threads = rayon::current_num_threads();
    Ok(IrradianceAtlas::new(maps.into_iter().flatten().collect(), of_surface, (budget, threads)))
}
