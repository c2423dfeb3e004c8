//! Irradiance at places of the scene, by several estimators side by side.

use super::RenderError;
use super::maps::build_maps;
use super::observer::Observer;
use super::settings::{IntegratorKind, Settings};
use crate::integrators::{Irradiance, PathTracer, PhotonMapIntegrator, PhotonMaps, Receiver, Scratch};
use crate::math::{Ray, Rgb};
use crate::media::Surroundings;
use crate::sampling::SampleStream;
use crate::scene::{RenderPlan, Scene, SurfaceInteraction};
use glam::DVec3;
use rayon::prelude::*;
use std::fmt::Write;

/// How irradiance is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProbeEstimator {
    /// From the photons around the place, with the kernel, count and checking of the settings.
    PhotonMap,
    /// As pictures are made: shadow rays, caustic map, final gathering.
    Gather,
    /// Unbiased paths that read no map.
    Path,
    /// From the illumination map of the surface, where it has one; direct light counts as indirect there.
    IlluminationMap,
}

impl ProbeEstimator {
    /// Name in tables and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::PhotonMap => "photon-map",
            Self::Gather => "gather",
            Self::Path => "path",
            Self::IlluminationMap => "illumination-map",
        }
    }

    /// Whether it draws samples, which have a standard error.
    fn is_sampled(self) -> bool {
        matches!(self, Self::Gather | Self::Path)
    }
}

/// Where to look. Metres, world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbePoint {
    /// On the surface, or above it.
    pub position: DVec3,
    /// On the side that is asked about; need not have unit length, and only says from where to look.
    pub normal: DVec3,
}

/// What to probe.
#[derive(Clone, Debug)]
pub struct ProbeRequest {
    /// Where.
    pub points: Vec<ProbePoint>,
    /// By what.
    pub estimators: Vec<ProbeEstimator>,
    /// Samples of each estimator that draws some.
    pub samples: u32,
    /// From how far above a point, along its normal, its surface is looked for; metres.
    pub lift: f64,
    /// Of maps and estimates.
    pub settings: Settings,
}

/// Irradiance by one estimator. W/m^2, cosine included: direct, caustic, indirect, and all together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// By what.
    pub estimator: ProbeEstimator,
    /// Means over the samples.
    pub irradiance: [DVec3; 4],
    /// Standard errors of these as if samples were independent, which is an upper bound since they are stratified. They say
    /// nothing of the photons' own noise. `None` where there are no samples.
    pub standard_error: Option<[DVec3; 4]>,
}

/// What was found at a point.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbedSurface {
    /// Name of the shape.
    pub object: String,
    /// The place of the surface; metres.
    pub position: DVec3,
    /// Its geometric normal, on the side that was asked about.
    pub normal: DVec3,
    /// Radiant exitance over irradiance, where the surface is Lambertian.
    pub reflectance: Option<Rgb>,
    /// By estimator, in the order of the request; without those that do not apply to this surface.
    pub readings: Vec<Reading>,
}

/// All points.
#[derive(Clone, Debug)]
pub struct Probed {
    /// By point; `None` where no surface was below it.
    pub points: Vec<Option<ProbedSurface>>,
    /// Things a user should know.
    pub warnings: Vec<String>,
}

/// Samples of one task.
const CHUNK: u32 = 256;

/// Sums over samples, for mean and standard error.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    values: [DVec3; 4],
    squares: [DVec3; 4],
}

impl Sums {
    fn add(&mut self, irradiance: &Irradiance) {
        let Irradiance { direct, caustic, indirect } = *irradiance;
        let parts = [direct, caustic, indirect].map(Rgb::as_dvec3);
        let all = [parts[0], parts[1], parts[2], parts[0] + parts[1] + parts[2]];
        for (i, value) in all.into_iter().enumerate() {
            self.values[i] += value;
            self.squares[i] += value * value;
        }
    }

    fn merge(&mut self, later: &Self) {
        self.values.iter_mut().zip(later.values).for_each(|(sum, value)| *sum += value);
        self.squares.iter_mut().zip(later.squares).for_each(|(sum, square)| *sum += square);
    }

    fn reading(&self, estimator: ProbeEstimator, count: u32, scale: f64) -> Reading {
        let n = f64::from(count);
        let irradiance = self.values.map(|sum| sum * (scale / n));
        let error = |i: usize| {
            let mean = self.values[i] / n;
            let variance = (self.squares[i] / n - mean * mean).max(DVec3::ZERO) / (n - 1.0).max(1.0);
            scale * DVec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt())
        };
        let standard_error = estimator.is_sampled().then(|| std::array::from_fn(error));
        Reading { estimator, irradiance, standard_error }
    }
}

/// A point on its surface.
struct Landing {
    hit: SurfaceInteraction,
    receiver: Receiver,
    medium: Surroundings,
}

/// Probes the scene. `None` where the observer stopped it. The result does not depend on the number of threads.
///
/// # Errors
/// Where photon maps would not fit into memory.
pub fn probe(
    scene: &Scene,
    request: &ProbeRequest,
    observer: &dyn Observer,
) -> Result<Option<Probed>, RenderError> {
    let settings = Settings {
        integrator: IntegratorKind::PhotonMap,
        irradiance_cache: false,
        ..request.settings.clone()
    };
    let plan = settings.plan(scene);
    let needs_maps = request.estimators.iter().any(|&estimator| estimator != ProbeEstimator::Path);
    let (mut maps, mut warnings) = (PhotonMaps::default(), Vec::new());
    if needs_maps {
        let pass = build_maps(scene, &plan, &settings, observer)?;
        if pass.cancelled {
            return Ok(None);
        }
        (maps, warnings) = (pass.maps, pass.warnings);
    }
    let landings: Vec<Option<Landing>> =
        request.points.iter().map(|point| land(scene, point, request.lift)).collect();
    let lost = landings.iter().filter(|landing| landing.is_none()).count();
    if lost > 0 {
        warnings.push(format!(
            "{lost} of {} points have no surface below them: check their normals, or look from higher above with --lift",
            landings.len()
        ));
    }
    let probing = Probing { scene, plan: &plan, settings: &settings, maps: &maps, request };
    Ok(probing.run(&landings, observer).map(|points| Probed { points, warnings }))
}

/// The first surface below a point, on the side of its normal.
fn land(scene: &Scene, point: &ProbePoint, lift: f64) -> Option<Landing> {
    let normal = point.normal.try_normalize()?;
    let start = scene.space().position(point.position + lift * normal).as_vec3();
    let hit = scene.intersect(&Ray::new(start, -normal.as_vec3()))?;
    let receiver = Receiver::new(&hit);
    let medium = scene.medium_at(hit.point.moved_towards(hit.wo));
    Some(Landing { hit, receiver, medium })
}

struct Probing<'a> {
    scene: &'a Scene,
    plan: &'a RenderPlan,
    settings: &'a Settings,
    maps: &'a PhotonMaps,
    request: &'a ProbeRequest,
}

impl Probing<'_> {
    fn run(
        &self,
        landings: &[Option<Landing>],
        observer: &dyn Observer,
    ) -> Option<Vec<Option<ProbedSurface>>> {
        let Self { scene, request, settings, .. } = *self;
        let reading = settings.photon_map_settings(scene);
        let samples = request.samples.max(1);
        observer.begin("probing", landings.len() as u64);
        let mut found = Vec::with_capacity(landings.len());
        for (number, landing) in landings.iter().enumerate() {
            if observer.should_stop() {
                return None;
            }
            observer.advance(number as u64);
            let Some(landing) = landing else {
                found.push(None);
                continue;
            };
            let mapped = PhotonMapIntegrator::new(scene, self.maps, self.plan, reading, landing.medium);
            let paths = PathTracer::new(scene, settings.max_depth, landing.medium);
            let one = |estimator: ProbeEstimator, index: u32, scratch: &mut Scratch| {
                let mut stream = SampleStream::new(settings.seed, number as u64, index);
                let Landing { receiver, medium, .. } = landing;
                match estimator {
                    ProbeEstimator::PhotonMap => mapped.photon_irradiance(receiver, scratch),
                    ProbeEstimator::Gather => {
                        mapped.gathered_irradiance(receiver, *medium, &mut stream, scratch)
                    }
                    ProbeEstimator::Path => paths.irradiance(receiver, *medium, &mut stream, scratch),
                    ProbeEstimator::IlluminationMap => mapped.summed_irradiance(receiver).unwrap_or_default(),
                }
            };
            // Nothing rather than zero where a surface has no such map.
            let has_sums = mapped.summed_irradiance(&landing.receiver).is_some();
            let applies =
                |estimator: &&ProbeEstimator| **estimator != ProbeEstimator::IlluminationMap || has_sums;
            let readings = request.estimators.iter().filter(applies).map(|&estimator| {
                let count = if estimator.is_sampled() { samples } else { 1 };
                let chunks: Vec<Sums> = (0..count.div_ceil(CHUNK))
                    .into_par_iter()
                    .map_init(Scratch::default, |scratch, chunk| {
                        let mut sums = Sums::default();
                        let first = chunk * CHUNK;
                        for index in first..count.min(first + CHUNK) {
                            sums.add(&one(estimator, index, scratch));
                        }
                        sums
                    })
                    .collect();
                let mut sums = Sums::default();
                chunks.iter().for_each(|chunk| sums.merge(chunk));
                // Back from render space.
                sums.reading(estimator, count, 1.0 / scene.space().power)
            });
            found.push(Some(self.describe(landing, readings.collect())));
        }
        observer.advance(landings.len() as u64);
        Some(found)
    }

    fn describe(&self, landing: &Landing, readings: Vec<Reading>) -> ProbedSurface {
        let Landing { hit, .. } = landing;
        ProbedSurface {
            object: self.scene.surface(hit).name.clone(),
            position: self.scene.space().world_position(hit.point.position.as_dvec3()),
            normal: hit.facing_normal().as_dvec3(),
            reflectance: Receiver::reflectance(hit, self.scene),
            readings,
        }
    }
}

impl Probed {
    /// A table with one line for each point and estimator; the first line names columns and their units. Standard errors are
    /// of the total; what is not known is left empty.
    pub fn to_csv(&self) -> String {
        let mut text = String::from("point,object,x [m],y [m],z [m],nx,ny,nz,estimator");
        for part in ["direct", "caustic", "indirect", "irradiance", "standard error", "exitance"] {
            for channel in ["R", "G", "B"] {
                // Writing to a string does not fail.
                let _ = write!(text, ",{part} {channel} [W/m^2]");
            }
        }
        text.push('\n');
        for (number, surface) in self.points.iter().enumerate() {
            let Some(surface) = surface else {
                let _ = writeln!(text, "{number}{}", ",".repeat(26));
                continue;
            };
            let name = surface.object.replace('"', "\"\"");
            let (p, n) = (surface.position, surface.normal);
            for reading in &surface.readings {
                let _ = write!(
                    text,
                    "{number},\"{name}\",{},{},{},{},{},{},{}",
                    p.x,
                    p.y,
                    p.z,
                    n.x,
                    n.y,
                    n.z,
                    reading.estimator.name()
                );
                let error = reading.standard_error.map(|errors| errors[3]);
                let exitance = surface.reflectance.map(|share| share.as_dvec3() * reading.irradiance[3]);
                for value in reading.irradiance.into_iter().map(Some).chain([error, exitance]) {
                    match value {
                        Some(value) => {
                            let _ = write!(text, ",{:.6e},{:.6e},{:.6e}", value.x, value.y, value.z);
                        }
                        None => text.push_str(",,,"),
                    }
                }
                text.push('\n');
            }
        }
        text
    }
}
