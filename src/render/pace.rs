//! Fits a render into a time limit. A small photon pass and a few pixels measure the speed of this machine with this scene under its
//! present load. The number of photons is then chosen so that the maps and one sample of every pixel fit into the remaining time.

use super::maps::{ForPicture, PassOne, build_maps_from};
use super::memory::PhotonCounts;
use super::pixels::{CameraSamples, PassTwo, RenderError, RenderRequest};
use super::settings::{IntegratorKind, Settings};
use crate::camera::Camera;
use crate::integrators::PhotonBudget;
use crate::observer::Observer;
use crate::scene::{RenderPlan, Scene};
use std::time::{Duration, Instant};

/// Photons of the first trial. A map has at least this many, however short the time.
const LEAST_PHOTONS: f64 = 2000.0;

/// Least ratio of photons of the second trial to those of the first. A smaller second trial would add no information.
const LEAST_GROWTH: f64 = 2.0;

/// Photon maps take at most this share of the time after the trials.
const MAPS: f64 = 0.5;

/// The second trial takes about this share of the time for maps.
const SECOND_TRIAL: f64 = 0.1;

/// Time limit of a trial. It is longer than any trial takes, so trials are never stopped.
const FOREVER: Duration = Duration::from_secs(1 << 30);

/// The measurement of pixels takes at most this share of the remaining time.
const PIXELS: f64 = 0.03;

/// Safety factor on estimated times, as some steps grow faster than in proportion.
const CAUTION: f64 = 1.2;

/// Rounds keep their requested size where this many of them fit.
const ROUNDS_KEPT: f64 = 2.0;
/// Otherwise rounds are reduced until this many fit.
const ROUNDS_WANTED: f64 = 4.0;

/// A render to be fitted into its time limit.
pub(super) struct Pace<'a> {
    pub(super) scene: &'a Scene,
    pub(super) camera: &'a Camera,
    pub(super) request: &'a RenderRequest,
    pub(super) plan: &'a RenderPlan,
    /// As in [`ForPicture`].
    pub(super) finest: &'a [f32],
    /// As in [`ForPicture`].
    pub(super) budget: Option<&'a PhotonBudget>,
    pub(super) deadline: Instant,
    pub(super) observer: &'a dyn Observer,
}

/// Settings that fit into the time limit.
#[derive(Debug)]
pub(super) struct Paced {
    /// The requested settings, possibly with fewer photons and, in rounds, fewer samples.
    pub(super) settings: Settings,
    /// Maps for these settings, where a trial has built them already.
    pub(super) maps: Option<PassOne>,
    /// Time for tracing photons.
    pub(super) tracing: Option<Duration>,
    /// Time that one sample of every pixel takes; zero where there is no limit.
    pub(super) seconds_sample: Duration,
    /// Warnings for the user.
    pub(super) warnings: Vec<String>,
}

impl Paced {
    /// The requested settings, for a render without a time limit.
    pub(super) fn unlimited(settings: &Settings) -> Self {
        Self {
            settings: settings.clone(),
            maps: None,
            tracing: None,
            seconds_sample: Duration::ZERO,
            warnings: Vec::new(),
        }
    }
}

/// A trial photon pass with a share of the requested photons.
struct Trial {
    scale: f64,
    settings: Settings,
    maps: PassOne,
    seconds: f64,
}

impl Pace<'_> {
    fn left(&self) -> f64 {
        self.deadline.saturating_duration_since(Instant::now()).as_secs_f64()
    }

    /// `settings` with a share of their photons. Counts are cut to two digits, so that a user can give the same counts again.
    fn scaled(&self, settings: &Settings, scale: f64) -> Settings {
        let counts = PhotonCounts::of(settings, self.plan);
        if scale >= 1.0 {
            return settings.clone();
        }
        let scaled = |photons: u64| match photons {
            0 => 0,
            photons => two_digits(photons as f64 * scale).clamp(1, photons),
        };
        Settings {
            global_photons: scaled(counts.global),
            caustic_photons: scaled(counts.caustic),
            photons_memory: None,
            ..settings.clone()
        }
    }

    fn trial(&self, settings: &Settings, scale: f64) -> Result<Trial, RenderError> {
        let start = Instant::now();
        let settings = self.scaled(settings, scale);
        let picture = ForPicture {
            budget: self.budget,
            finest: self.finest,
            time: Some(FOREVER),
            ..ForPicture::default()
        };
        let maps = build_maps_from(self.scene, self.plan, &settings, picture, self.observer)?;
        Ok(Trial { scale: scale.min(1.0), settings, maps, seconds: start.elapsed().as_secs_f64() })
    }

    /// Fits the settings of a picture, or of a round, into the time limit.
    pub(super) fn fit(&self, settings: &Settings) -> Result<Paced, RenderError> {
        let counts = PhotonCounts::of(settings, self.plan);
        let photons = counts.global.saturating_add(counts.caustic);
        let mut trial = self.trial(settings, LEAST_PHOTONS / photons.max(1) as f64)?;
        let unchanged = |trial: Trial, seconds_sample, tracing, warnings| {
            let maps = (trial.scale >= 1.0 || trial.maps.cancelled).then_some(trial.maps);
            Paced { settings: settings.clone(), maps, tracing, seconds_sample, warnings }
        };
        if trial.maps.cancelled {
            return Ok(unchanged(trial, Duration::ZERO, None, Vec::new()));
        }
        let sample = self.measure(&trial)?;
        let mut warnings = Vec::new();
        let seconds_sample = CAUTION * sample.as_secs_f64();
        if seconds_sample > self.left() {
            warnings.push(format!(
                "one sample of every pixel takes about {:.1} s, and {:.1} s of the time limit are left: it is exceeded; ask for a \
                 smaller picture, a lower --quality, or give it more time",
                sample.as_secs_f64(),
                self.left()
            ));
        }
        let is_in_rounds = settings.integrator == IntegratorKind::Progressive;
        let spp = if is_in_rounds { settings.spp } else { 1 };
        // The estimate from the first trial is too high, as part of its time does not depend on the number of photons.
        let mut per_scale = trial.seconds / trial.scale;
        let (mut time, mut samples) = self.time_for_maps(sample, spp, per_scale, is_in_rounds);
        let growth = SECOND_TRIAL * time / trial.seconds.max(f64::MIN_POSITIVE);
        if CAUTION * per_scale > time && trial.scale < 1.0 && growth > LEAST_GROWTH {
            let second = self.trial(settings, growth * trial.scale)?;
            if second.maps.cancelled {
                return Ok(unchanged(second, Duration::ZERO, None, Vec::new()));
            }
            let more = (second.seconds - trial.seconds) / (second.scale - trial.scale);
            // The difference of two nearly equal times is uncertain, so the estimate has a lower bound.
            per_scale = more.max(0.25 * second.seconds / second.scale);
            trial = second;
            (time, samples) = self.time_for_maps(sample, spp, per_scale, is_in_rounds);
        }
        let tracing: f64 = trial.maps.statistics.iter().map(|map| map.seconds_tracing).sum();
        let share = (tracing / trial.seconds.max(f64::MIN_POSITIVE)).clamp(0.25, 1.0);
        let tracing = Some(Duration::from_secs_f64(share * time.max(0.0)));
        let sample = Duration::from_secs_f64(seconds_sample);
        let scale = (time / (CAUTION * per_scale)).min(1.0);
        let spp = if is_in_rounds { samples } else { settings.spp };
        if scale >= 1.0 && spp == settings.spp {
            return Ok(unchanged(trial, sample, tracing, warnings));
        }
        // Maps with hardly more photons than those of the trial are not worth building.
        let (fitted, maps) = match scale > 1.25 * trial.scale {
            true => (self.scaled(settings, scale), None),
            false => (trial.settings, Some(trial.maps)),
        };
        let fitted = Settings { spp, ..fitted };
        warnings.extend(self.told(counts, &fitted, is_in_rounds, settings.spp));
        // The maps of a trial are valid for these settings, which differ in their samples only.
        Ok(Paced { settings: fitted, maps, tracing, seconds_sample: sample, warnings })
    }

    fn measure(&self, trial: &Trial) -> Result<Duration, RenderError> {
        let pass = PassTwo {
            scene: self.scene,
            camera: self.camera,
            request: self.request,
            settings: &trial.settings,
            plan: self.plan,
            maps: &trial.maps.maps,
            reading: trial.settings.photon_map_settings(self.scene),
            glints: None,
            samples: CameraSamples { seed: trial.settings.seed, first: 0 },
            seconds_sample: Duration::ZERO,
            observer: self.observer,
        };
        pass.measure(Duration::from_secs_f64(PIXELS * self.left()))
    }

    /// Seconds for photon maps, and samples per pixel of a round, given that all photons would take `maps` seconds.
    fn time_for_maps(&self, sample: Duration, spp: u32, maps: f64, is_in_rounds: bool) -> (f64, u32) {
        let left = self.left();
        let sample = CAUTION * sample.as_secs_f64();
        if !is_in_rounds {
            return ((MAPS * left).min(left - sample), spp);
        }
        let pixels = f64::from(spp) * sample;
        if CAUTION * maps + pixels <= left / ROUNDS_KEPT {
            return (CAUTION * maps, spp);
        }
        let round = left / ROUNDS_WANTED;
        // Samples get at least half of a round.
        let affordable = (0.5 * round).max(round - CAUTION * maps) / sample.max(f64::MIN_POSITIVE);
        let spp = (affordable as u32).clamp(1, spp);
        (round - f64::from(spp) * sample, spp)
    }

    /// Warning about reduced photons or samples, where there are any.
    fn told(&self, asked: PhotonCounts, fitted: &Settings, is_in_rounds: bool, spp: u32) -> Option<String> {
        let Settings { global_photons, caustic_photons, .. } = *fitted;
        let parts = [
            (asked.global, global_photons, "global photons"),
            (asked.caustic, caustic_photons, "caustic photons"),
            (u64::from(spp), u64::from(fitted.spp), "samples per pixel"),
        ];
        let fewer: Vec<String> = parts
            .iter()
            .filter(|(asked, done, _)| done < asked)
            .map(|(asked, done, what)| format!("{done} {what} of the {asked} asked for"))
            .collect();
        let place = if is_in_rounds { "each round has " } else { "" };
        (!fewer.is_empty()).then(|| {
            format!(
                "{place}{}: more do not fit the time limit; give it more time, or ask for fewer",
                fewer.join(", ")
            )
        })
    }
}

/// A number cut to its first two digits.
fn two_digits(number: f64) -> u64 {
    let number = number.max(0.0) as u64;
    let power = 10u64.pow(number.checked_ilog10().unwrap_or(0).saturating_sub(1));
    number / power * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_digits_are_kept() {
        for (number, cut) in
            [(0.0, 0), (0.9, 0), (7.0, 7), (99.9, 99), (123.0, 120), (9_876_543.2, 9_800_000)]
        {
            assert_eq!(two_digits(number), cut, "{number}");
        }
    }
}
