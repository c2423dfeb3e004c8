//! Probes irradiance at points of the scene with several estimators side by side.

use super::RenderError;
use super::batches::mean_of_batches;
use super::maps::{ForPicture, build_maps_from, listed};
use super::pixels::check_media;
use super::settings::{IntegratorKind, Settings};
use crate::integrators::{Irradiance, PathTracer, PhotonMapIntegrator, PhotonMaps, Receiver, Scratch};
use crate::lights::Light;
use crate::math::{Ray, Rgb};
use crate::media::MediumStack;
use crate::observer::Observer;
use crate::sampling::{SampleStream, mix};
use crate::scene::{RenderPlan, Scene, SurfaceInteraction};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::fmt::Write;
use std::time::Instant;

/// Estimator of irradiance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProbeEstimator {
    /// Density estimate from the photons around the point, with the kernel, photon count and checks of the settings.
    PhotonMap,
    /// The method of rendering: shadow rays, caustic map, final gathering.
    Gather,
    /// Unbiased path tracing without photon maps.
    Path,
    /// Lookup in the illumination map of the surface, where it has one. Direct light counts as indirect there.
    IlluminationMap,
}

impl ProbeEstimator {
    /// The name in tables and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::PhotonMap => "photon-map",
            Self::Gather => "gather",
            Self::Path => "path",
            Self::IlluminationMap => "illumination-map",
        }
    }

    /// Whether it takes random samples, which have a standard error.
    fn is_sampled(self) -> bool {
        matches!(self, Self::Gather | Self::Path)
    }
}

/// A point to probe. Metres, world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbePoint {
    /// A position on the surface or above it.
    pub position: DVec3,
    /// The direction from the surface to the side to be probed. It selects the side only and need not have unit length.
    pub normal: DVec3,
}

/// A request to probe points.
#[derive(Clone, Debug)]
pub struct ProbeRequest {
    /// The points.
    pub points: Vec<ProbePoint>,
    /// The estimators.
    pub estimators: Vec<ProbeEstimator>,
    /// Samples of each estimator that takes random samples, over all batches.
    pub samples: u32,
    /// Number of independent batches. Each has photon maps of its own, with as many photons as the settings specify, and its share of
    /// the samples. A reading is the mean over batches; its standard error follows from their differences. The first batch equals a
    /// single batch.
    pub batches: u32,
    /// The nearest surface is searched within this distance above and below a point, along its normal. Where there is none, the first
    /// surface below the point is used. Metres.
    pub lift: f64,
    /// Settings of maps and estimates.
    pub settings: Settings,
}

/// Default number of batches: intervals are then a fifth wider than for many batches.
pub const PROBE_BATCHES: u32 = 8;

/// Irradiance from one estimator: direct, caustic, indirect and total. W/m^2, cosine included.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// The estimator.
    pub estimator: ProbeEstimator,
    /// Means over samples and batches.
    pub irradiance: [DVec3; 4],
    /// Standard errors of the means, which include the noise of the photon maps: the interval mean +- 1.96 errors contains the
    /// expectation of the estimator 95 times in 100. They do not include bias, such as the blur of density estimates. `None` where the
    /// noise is unknown: with one batch (except for paths, whose samples give it), and where light is missing.
    pub standard_error: Option<[DVec3; 4]>,
    /// A description of light that this estimator never or hardly ever finds. The irradiance is then a lower bound.
    pub missing: Option<String>,
}

/// The surface at a probed point, and its readings.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbedSurface {
    /// Name of the shape.
    pub object: String,
    /// The position on the surface; metres.
    pub position: DVec3,
    /// Its geometric normal, on the probed side.
    pub normal: DVec3,
    /// Radiant exitance over irradiance, where the surface is Lambertian.
    pub reflectance: Option<Rgb>,
    /// Readings by estimator, in the order of the request. Estimators that do not apply to this surface are left out.
    pub readings: Vec<Reading>,
}

/// Result of probing.
#[derive(Clone, Debug)]
pub struct Probed {
    /// Surfaces by point; `None` where no surface is below the point.
    pub points: Vec<Option<ProbedSurface>>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Samples in one parallel task.
const CHUNK: u32 = 256;

/// Sums over the samples of a batch.
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

    fn mean(&self, count: u32) -> [DVec3; 4] {
        self.values.map(|sum| sum / f64::from(count))
    }

    /// Standard errors of the mean for independent samples: an upper bound, since the samples are stratified.
    fn error(&self, count: u32) -> [DVec3; 4] {
        let n = f64::from(count);
        std::array::from_fn(|i| {
            let mean = self.values[i] / n;
            let variance = (self.squares[i] / n - mean * mean).max(DVec3::ZERO) / (n - 1.0).max(1.0);
            DVec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt())
        })
    }
}

/// Results of one estimator at one point.
#[derive(Clone, Debug, Default)]
struct Tally {
    /// Means by batch.
    means: Vec<[DVec3; 4]>,
    /// Standard errors from the samples of the last batch, where it has several.
    error: Option<[DVec3; 4]>,
}

impl Tally {
    /// The reading of this tally. `power` is the factor of power in render space; for `missing` see [`Reading::missing`].
    fn reading(&self, estimator: ProbeEstimator, power: f64, missing: Option<String>) -> Reading {
        let (irradiance, between) = mean_of_batches(&self.means);
        // Gather samples all read the same map, so their spread does not include its noise.
        let within = self.error.filter(|_| estimator == ProbeEstimator::Path);
        let error = between.or(within).filter(|_| missing.is_none());
        let to_world = |values: [DVec3; 4]| values.map(|value| value / power);
        Reading { estimator, irradiance: to_world(irradiance), standard_error: error.map(to_world), missing }
    }
}

/// A probed point, projected onto its surface.
struct Landing {
    hit: SurfaceInteraction,
    receiver: Receiver,
    medium: MediumStack,
    /// Whether the surface is within the lift of the point.
    is_near: bool,
}

/// Probes the scene. Returns `None` where the observer stopped it. The result does not depend on the number of threads.
///
/// # Errors
/// If the photon maps would not fit into memory, or if a medium scatters and an estimator reads photon maps.
pub fn probe(
    scene: &Scene,
    request: &ProbeRequest,
    observer: &dyn Observer,
) -> Result<Option<Probed>, RenderError> {
    let asks = |wanted: ProbeEstimator| request.estimators.contains(&wanted);
    let settings = Settings {
        integrator: IntegratorKind::PhotonMap,
        irradiance_cache: false,
        // Gather rays alone read precomputed irradiance.
        precomputed_irradiance: request.settings.precomputed_irradiance && asks(ProbeEstimator::Gather),
        ..request.settings.clone()
    };
    if request.estimators.iter().any(|&estimator| estimator != ProbeEstimator::Path) {
        check_media(scene, &settings)?;
    }
    let landings: Vec<Option<Landing>> =
        request.points.iter().map(|point| land(scene, point, request.lift)).collect();
    let mut receivers: Vec<u32> = landings.iter().flatten().map(|landing| landing.hit.surface).collect();
    receivers.sort_unstable();
    receivers.dedup();
    let plan = settings.plan(scene).with_receivers(scene, settings.integrator, receivers.len());
    let begun = Instant::now();
    let needs_maps = request.estimators.iter().any(|&estimator| estimator != ProbeEstimator::Path);
    let batches = request.batches.max(1);
    let mut warnings = Vec::new();
    let mut tallies = vec![vec![Tally::default(); request.estimators.len()]; landings.len()];
    for batch in 0..batches {
        let settings = Settings { seed: batch_seed(settings.seed, batch), ..settings.clone() };
        let mut maps = PhotonMaps::default();
        if needs_maps {
            let wanted = ForPicture { receivers: &receivers, ..ForPicture::default() };
            let pass = build_maps_from(scene, &plan, &settings, wanted, observer)?;
            if pass.cancelled {
                return Ok(None);
            }
            maps = pass.maps;
            // Later maps differ from the first in their random numbers only, so one set of warnings is enough.
            if batch == 0 {
                warnings = pass.warnings;
            }
        }
        let samples = (request.samples / batches).max(1);
        let probing = Probing {
            scene,
            plan: &plan,
            settings: &settings,
            maps: &maps,
            request,
            samples,
            batch,
            batches,
        };
        if probing.run(&landings, &mut tallies, observer).is_none() {
            return Ok(None);
        }
        if batch == 0 && batches > 1 {
            let remedy = format!(
                "each of the {batches} batches has photon maps and samples of its own: fewer photons (--quality draft) or --samples are \
                 faster, and fewer --batches, which tell the errors less well"
            );
            observer.foresee(begun.elapsed() * (batches - 1), &remedy);
        }
    }
    let lost = landings.iter().filter(|landing| landing.is_none()).count();
    if lost > 0 {
        warnings.push(format!(
            "{lost} of {} points have no surface below them: coordinates are metres, whatever the unit of the scene file; \
             check them and the normals, or look from higher above with --lift",
            landings.len()
        ));
    }
    warnings.extend(warn_of_distance(scene, &landings, request.lift));
    let points = landings
        .iter()
        .zip(&tallies)
        .map(|(landing, tallies)| landing.as_ref().map(|landing| describe(scene, request, landing, tallies)));
    let points: Vec<Option<ProbedSurface>> = points.collect();
    warnings.extend(warn_of_missing(&points));
    Ok(Some(Probed { points, warnings }))
}

/// Seed of a batch; the first batch has the seed of the settings.
fn batch_seed(seed: u64, batch: u32) -> u64 {
    if batch == 0 { seed } else { mix(mix(seed) ^ u64::from(batch)) }
}

/// Warns of points that are not on the surface found below them: the user may have meant another surface.
fn warn_of_distance(scene: &Scene, landings: &[Option<Landing>], lift: f64) -> Option<String> {
    let far = || landings.iter().flatten().filter(|landing| !landing.is_near);
    let mut names: Vec<&str> = far().map(|landing| scene.surface(&landing.hit).name.as_str()).collect();
    let count = names.len();
    names.sort_unstable();
    names.dedup();
    (count > 0).then(|| {
        format!(
            "{count} of {} points lie more than {lift:.2e} m off every surface, and stand for the first one below them, of {}: the              table has its place (x, y, z); for another surface give points on it",
            landings.len(),
            listed(names.iter().copied())
        )
    })
}

/// One warning for each kind of light that paths miss.
fn warn_of_missing(points: &[Option<ProbedSurface>]) -> Vec<String> {
    let mut warnings: Vec<String> = Vec::new();
    for reading in points.iter().flatten().flat_map(|surface| &surface.readings) {
        let Some(missing) = &reading.missing else { continue };
        let warning = format!(
            "`{}` {missing}: its readings are lower bounds without a standard error; `photon-map` and `gather` have that light",
            reading.estimator.name()
        );
        if !warnings.contains(&warning) {
            warnings.push(warning);
        }
    }
    warnings
}

/// The surface nearest to a point within the lift above and below it, or else the first surface below the point. It is seen from the
/// side of the point's normal.
fn land(scene: &Scene, point: &ProbePoint, lift: f64) -> Option<Landing> {
    /// Most surfaces above a point that are passed.
    const PASSED: usize = 256;
    let normal = point.normal.try_normalize()?;
    let (start, down) = (point.position + lift * normal, -normal.as_vec3());
    let (start, lift) = (scene.space().position(start).as_vec3(), scene.space().length(lift) as f32);
    let mut ray = Ray::new(start, down);
    let mut nearest: Option<(f32, SurfaceInteraction)> = None;
    for _ in 0..PASSED {
        let Some(hit) = scene.intersect(&ray) else { break };
        let below = (hit.point.position - start).dot(down) - lift;
        ray = hit.spawn(down);
        if nearest.as_ref().is_none_or(|(distance, _)| below.abs() < *distance) {
            nearest = Some((below.abs(), hit));
        }
        // All later surfaces are farther below the point.
        if below >= 0.0 {
            break;
        }
    }
    let (distance, hit) = nearest?;
    let receiver = Receiver::new(&hit);
    let medium = scene.medium_at(hit.point.moved_towards(hit.wo));
    Some(Landing { hit, receiver, medium, is_near: distance <= lift })
}

struct Probing<'a> {
    scene: &'a Scene,
    plan: &'a RenderPlan,
    settings: &'a Settings,
    maps: &'a PhotonMaps,
    request: &'a ProbeRequest,
    /// Samples of each estimator that takes random samples, in this batch.
    samples: u32,
    batch: u32,
    batches: u32,
}

impl Probing<'_> {
    /// Adds this batch to the tallies, which are indexed by point and estimator. Returns `None` where the observer stopped it.
    fn run(
        &self,
        landings: &[Option<Landing>],
        tallies: &mut [Vec<Tally>],
        observer: &dyn Observer,
    ) -> Option<()> {
        let Self { scene, request, settings, .. } = *self;
        let reading = settings.photon_map_settings(scene);
        let total = landings.len() as u64;
        match self.batches {
            1 => observer.begin("probing", total),
            batches => observer.begin(&format!("probing, batch {} of {batches}", self.batch + 1), total),
        }
        for (number, (landing, tallies)) in landings.iter().zip(tallies).enumerate() {
            if observer.should_stop() {
                return None;
            }
            observer.advance(number as u64);
            let Some(landing) = landing else { continue };
            let mapped = PhotonMapIntegrator::new(scene, self.maps, self.plan, reading, landing.medium);
            let paths = PathTracer::new(scene, settings.max_depth, landing.medium)
                .with_wavelengths(settings.wavelengths);
            let one = |estimator: ProbeEstimator, index: u32, scratch: &mut Scratch| {
                let mut stream = SampleStream::new(settings.seed, number as u64, index);
                let Landing { receiver, medium, .. } = landing;
                match estimator {
                    ProbeEstimator::PhotonMap => Some(mapped.photon_irradiance(receiver, scratch)),
                    ProbeEstimator::Gather => {
                        Some(mapped.gathered_irradiance(receiver, *medium, &mut stream, scratch))
                    }
                    ProbeEstimator::Path => Some(paths.irradiance(receiver, *medium, &mut stream, scratch)),
                    // `None` rather than zero where a surface has no illumination map.
                    ProbeEstimator::IlluminationMap => mapped.summed_irradiance(receiver),
                }
            };
            for (&estimator, tally) in request.estimators.iter().zip(tallies) {
                let count = if estimator.is_sampled() { self.samples } else { 1 };
                let chunks: Vec<Option<Sums>> = (0..count.div_ceil(CHUNK))
                    .into_par_iter()
                    .map_init(Scratch::default, |scratch, chunk| {
                        let mut sums = Sums::default();
                        let first = chunk * CHUNK;
                        for index in first..count.min(first + CHUNK) {
                            sums.add(&one(estimator, index, scratch)?);
                        }
                        Some(sums)
                    })
                    .collect();
                let mut sums = Sums::default();
                if chunks.iter().all(|chunk| chunk.as_ref().map(|chunk| sums.merge(chunk)).is_some()) {
                    tally.means.push(sums.mean(count));
                    tally.error = (count > 1).then(|| sums.error(count));
                }
            }
        }
        observer.advance(total);
        Some(())
    }
}

fn describe(scene: &Scene, request: &ProbeRequest, landing: &Landing, tallies: &[Tally]) -> ProbedSurface {
    let Landing { hit, .. } = landing;
    let found = request.estimators.iter().zip(tallies).filter(|(_, tally)| !tally.means.is_empty());
    let readings = found.map(|(&estimator, tally)| {
        let missing = match estimator {
            ProbeEstimator::Path => missed_by_paths(scene, hit.point.position, request),
            ProbeEstimator::PhotonMap | ProbeEstimator::Gather | ProbeEstimator::IlluminationMap => None,
        };
        tally.reading(estimator, scene.space().power, missing)
    });
    ProbedSurface {
        object: scene.surface(hit).name.clone(),
        position: scene.space().world_position(hit.point.position.as_dvec3()),
        normal: hit.facing_normal().as_dvec3(),
        reflectance: Receiver::reflectance(hit, scene),
        readings: readings.collect(),
    }
}

/// A description of the lights that paths from this position hit through glass or mirrors in fewer than one sample per batch. A shadow
/// ray does not pass an ideal specular surface, so only paths that happen to hit the light find it there. A point or parallel light is
/// never hit.
fn missed_by_paths(scene: &Scene, position: Vec3, request: &ProbeRequest) -> Option<String> {
    let is_ideal = |material: u32| scene.materials()[material as usize].1.has_specular();
    if !scene.surfaces().iter().any(|surface| surface.all_materials().any(is_ideal)) {
        return None;
    }
    let samples = f64::from((request.samples / request.batches.max(1)).max(1));
    let is_missed = |light: &Light| light.chance_from(position) * samples < 1.0;
    let missed = scene.lights().iter().enumerate().filter(|(_, light)| is_missed(light));
    let names: Vec<String> = missed.map(|(id, _)| format!("`{}`", scene.light_note(id).name)).collect();
    let shown = match names.len() {
        0 => return None,
        1..=5 => names.join(", "),
        more => format!("{} and {} more", names[..5].join(", "), more - 5),
    };
    Some(format!("cannot or hardly find the light of {shown} that comes by way of glass or mirrors"))
}

impl Probed {
    /// A CSV table with one line for each point and estimator. The first line names the columns and their units. Standard errors belong
    /// to the total; unknown values are left empty. The last column describes the light that an estimator misses.
    pub fn to_csv(&self) -> String {
        let mut text = String::from("point,object,x [m],y [m],z [m],nx,ny,nz,estimator");
        for part in ["direct", "caustic", "indirect", "irradiance", "standard error", "exitance"] {
            for channel in ["R", "G", "B"] {
                // Writing to a string cannot fail.
                let _ = write!(text, ",{part} {channel} [W/m^2]");
            }
        }
        text.push_str(",note\n");
        for (number, surface) in self.points.iter().enumerate() {
            let Some(surface) = surface else {
                let _ = writeln!(text, "{number}{}", ",".repeat(27));
                continue;
            };
            let name = surface.object.replace('"', "\"\"");
            // Adding zero turns minus zero into zero.
            let (p, n) = (surface.position + DVec3::ZERO, surface.normal + DVec3::ZERO);
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
                let note = reading.missing.as_deref().unwrap_or_default();
                let _ = if note.is_empty() {
                    writeln!(text, ",")
                } else {
                    writeln!(text, ",\"{}\"", note.replace('"', "\"\""))
                };
            }
        }
        text
    }
}
