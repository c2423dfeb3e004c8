//! Tracking: where light meets a medium, and how much of it passes.
//!
//! One tracker serves every density. It walks over the segments of a line ([`Density::segments`]) and meets tentative collisions at
//! the rate of the majorant (Woodcock et al. 1965; Coleman 1968), of which those that the density does not account for are null. One
//! exponential variate, an optical depth, is spent over the segments and drawn anew only at a collision, so that borders of segments
//! change nothing. Where majorant and minorant agree there is no null collision, and a homogeneous medium is sampled by its closed form;
//! a fog by height has its own.
//!
//! **Channels.** A distance is drawn for one channel, picked with probabilities in proportion to the throughput, and weighted by the
//! balance heuristic over all three: the density with which the picked channel made the path, over the mean of those of all (spectral MIS:
//! Wilkie et al. 2014; with null collisions Miller, Georgiev & Jarosz, "A null-scattering path integral formulation of light transport",
//! 2019). Densities are compared by their logarithms, in `f64`.
//!
//! **Random numbers.** A call takes one number of the caller's generator, whatever it meets, and draws its own from a generator that
//! this number seeds. So the number of null collisions shifts nothing else.

use super::Volume;
use super::density::{Density, Line, Segments};
use super::volume::left;
use crate::math::Rgb;
use crate::sampling::Rng;
use glam::DVec3;

/// What becomes of the light at collisions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Losses {
    /// Absorption ends paths, with its own probability.
    #[default]
    Sampled,
    /// Every collision is told as [`End::Scattered`], with the weight of the light that collides: what is scattered of it is that times
    /// the albedo. For photons, which are stored before they are scattered, and for roulette by the caller.
    Weighted,
}

/// What a tracker met on a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flight {
    /// Estimate of the radiance that the medium itself adds to the whole line, attenuated on its way to the origin, W/(m^2 sr). It belongs
    /// to the line and not to what ends the flight. Exact where the density has an integral in closed form.
    pub emitted: Rgb,
    /// How the flight ended.
    pub end: End,
}

/// How a flight ended. Weights are what the throughput of the path is to be multiplied with; their expectation over all ends is one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum End {
    /// Reached the end of the line.
    Escaped {
        /// Transmittance over the probability of getting there.
        weight: Rgb,
    },
    /// Scattered, at this distance: the path goes on in a direction of the phase function.
    Scattered {
        /// Distance from the origin of the line.
        t: f64,
        /// Scattering times transmittance over the density of the distance; with [`Losses::Weighted`] extinction in place of scattering.
        weight: Rgb,
    },
    /// Absorbed, at this distance: the path ends.
    Absorbed {
        /// Distance from the origin of the line.
        t: f64,
        /// Absorption times transmittance over the density of the distance.
        weight: Rgb,
    },
}

/// Kinds of tentative collisions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Absorb,
    Scatter,
    /// Passes unchanged; a place at which emission is sampled.
    Emit,
    /// Passes unchanged.
    Null,
}

impl Kind {
    /// One of the kinds, in proportion to their rates. One whose rate is not positive is never taken, whatever rounding says.
    fn pick(rates: [(Self, f64); 4], u: f64) -> Self {
        let total: f64 = rates.iter().map(|(_, rate)| rate.max(0.0)).sum();
        let mut rest = u * total;
        let mut last = Self::Null;
        for (kind, rate) in rates {
            if rate > 0.0 {
                if rest < rate {
                    return kind;
                }
                rest -= rate;
                last = kind;
            }
        }
        last
    }
}

/// Rates of collisions per unit of length and density, by channel.
#[derive(Clone, Copy, Debug)]
struct Rates {
    absorb: DVec3,
    scatter: DVec3,
    emit: DVec3,
    /// All of them.
    total: DVec3,
}

/// With what probability each channel is picked.
#[derive(Clone, Copy, Debug)]
struct Channels {
    share: DVec3,
    picked: usize,
}

impl Channels {
    /// One of the channels, by throughput; alike where it is of no use.
    fn pick(throughput: Rgb, u: f64) -> Self {
        let useful = throughput.as_dvec3().to_array().map(|t| if t.is_finite() { t.max(0.0) } else { 0.0 });
        let useful = DVec3::from_array(useful);
        let sum = useful.element_sum();
        let share = if sum > 0.0 { useful / sum } else { DVec3::splat(1.0 / 3.0) };
        let mut rest = u;
        let mut picked = share.max_position();
        for channel in 0..3 {
            if share[channel] > 0.0 {
                if rest < share[channel] {
                    picked = channel;
                    break;
                }
                rest -= share[channel];
            }
        }
        Self { share, picked }
    }

    /// Weight of each channel where the logarithm of the density with which it makes the path is `logs`: its density over the mean of
    /// all. Zero in channels that are never picked, whose throughput is zero.
    fn balance(&self, logs: DVec3) -> Rgb {
        if logs.x == logs.y && logs.y == logs.z {
            return Rgb::ONE;
        }
        let is_open = |channel: usize| self.share[channel] > 0.0;
        let most = (0..3).filter(|&c| is_open(c)).fold(f64::NEG_INFINITY, |most, c| most.max(logs[c]));
        let density =
            DVec3::from_array([0, 1, 2].map(|c| if is_open(c) { (logs[c] - most).exp() } else { 0.0 }));
        let mean = density.dot(self.share);
        if mean > 0.0 { (density / mean).as_vec3() } else { Rgb::ZERO }
    }
}

/// An optical depth until the next collision: exponential with mean one, and finite.
fn free_depth(rng: &mut Rng) -> f64 {
    // 1 - u is in (0, 1].
    -(-rng.next_f64()).ln_1p()
}

/// Tentative collisions along a line, at a rate that is a factor times a part of the majorant.
struct Walk<'a> {
    segments: Segments<'a>,
    present: Option<super::density::Segment>,
    /// Optical depth that is left until the next collision.
    budget: f64,
    /// Majorant times length walked so far.
    depth: f64,
}

impl<'a> Walk<'a> {
    /// Along `line`, for at most about so many collisions per unit of majorant and length.
    fn new(density: &'a Density, line: &Line, t_max: f64, rate: f64, rng: &mut Rng) -> Self {
        let segments = density.segments(line, t_max, MOST_NULL / rate);
        Self { segments, present: None, budget: free_depth(rng), depth: 0.0 }
    }

    /// Distance of the next tentative collision and the segment that it is in, with `rate` collisions per unit of majorant and length.
    fn next(&mut self, rate: f64, rng: &mut Rng) -> Option<(f64, super::density::Segment)> {
        loop {
            let segment = match self.present {
                Some(segment) => segment,
                None => *self.present.insert(self.segments.next()?),
            };
            let whole = (segment.t1 - segment.t0) * segment.majorant;
            let cost = whole * rate;
            if self.budget < cost {
                let spent = self.budget / rate;
                let t = (segment.t0 + spent / segment.majorant).min(segment.t1);
                self.depth += spent;
                self.budget = free_depth(rng);
                self.present = Some(super::density::Segment { t0: t, ..segment });
                return Some((t, segment));
            }
            // Not where the rate is zero and the segment endless.
            if cost > 0.0 {
                self.budget -= cost;
            }
            self.depth += whole;
            self.present = None;
        }
    }
}

impl Volume {
    /// Rates of collisions, and of places at which emission is sampled where it has no closed form.
    fn rates(&self, losses: Losses, emit: DVec3) -> Rates {
        let (absorb, scatter) = match losses {
            Losses::Sampled => {
                (self.coefficients().absorption().as_dvec3(), self.coefficients().scattering().as_dvec3())
            }
            Losses::Weighted => (DVec3::ZERO, self.extinction()),
        };
        Rates { absorb, scatter, emit, total: absorb + scatter + emit }
    }

    /// Follows light over `line` from 0 to `t_max`, which may be infinite, until it collides for real or reaches the end.
    ///
    /// `throughput` is that of the path so far, by which a channel is picked; weights of channels in which it is zero are of no use. Takes
    /// one number of `rng`.
    pub fn fly(&self, line: &Line, t_max: f64, throughput: Rgb, losses: Losses, rng: &mut Rng) -> Flight {
        let mut own = rng.split();
        let channels = Channels::pick(throughput, own.next_f64());
        let exact = self.exact_emission(line, t_max);
        let rates = self.rates(losses, if exact.is_some() { DVec3::ZERO } else { self.glow_rate() });
        match self.density() {
            Density::Height(fog) => {
                let rate = rates.total[channels.picked];
                let depth = free_depth(&mut own) / rate;
                let end = match fog.distance(line, t_max, depth) {
                    Some(t) => collide(&rates, &channels, (t, depth), &mut own),
                    None => Passed::over(fog.depth(line, t_max)).escape(&rates, &channels),
                };
                Flight { emitted: exact.unwrap_or_default(), end }
            }
            Density::Homogeneous | Density::Field(_) | Density::Grid(_) => {
                let mut flight = self.track(line, t_max, &rates, &channels, &mut own);
                if let Some(exact) = exact {
                    flight.emitted = exact;
                }
                flight
            }
        }
    }

    fn track(&self, line: &Line, t_max: f64, rates: &Rates, channels: &Channels, rng: &mut Rng) -> Flight {
        let rate = rates.total[channels.picked];
        // Not the rate of the picked channel: the weights take every channel to walk over the same segments.
        let mut walk = Walk::new(self.density(), line, t_max, rates.total.max_element(), rng);
        let mut emitted = DVec3::ZERO;
        let mut passed = Passed::default();
        while let Some((t, segment)) = walk.next(rate, rng) {
            let density = if segment.minorant == segment.majorant {
                segment.majorant
            } else {
                // Within the bounds also where rounding put the place beyond its segment.
                self.density().at(line.at(t)).clamp(segment.minorant, segment.majorant)
            };
            let picked = channels.picked;
            let kinds = [
                (Kind::Absorb, rates.absorb[picked] * density),
                (Kind::Scatter, rates.scatter[picked] * density),
                (Kind::Emit, rates.emit[picked] * density),
                (Kind::Null, rate * (segment.majorant - density)),
            ];
            passed.depth = walk.depth;
            let weight = |kind: DVec3| channels.balance(passed.logs(rates) + kind.map(f64::ln));
            match Kind::pick(kinds, rng.next_f64()) {
                Kind::Absorb => {
                    let end = End::Absorbed { t, weight: weight(rates.absorb) };
                    return Flight { emitted: emitted.as_vec3(), end };
                }
                Kind::Scatter => {
                    let end = End::Scattered { t, weight: weight(rates.scatter) };
                    return Flight { emitted: emitted.as_vec3(), end };
                }
                Kind::Emit => {
                    let emission = self.coefficients().emission().as_dvec3();
                    let share = self.glow().map_or(DVec3::ONE, |glow| glow.at(line.at(t)));
                    emitted += weight(rates.emit).as_dvec3() * emission * share / rates.emit;
                    passed.glows += 1;
                }
                Kind::Null => passed.nulls += 1,
            }
        }
        passed.depth = walk.depth;
        Flight { emitted: emitted.as_vec3(), end: passed.escape(rates, channels) }
    }

    /// Share of the light that passes over `line` from 0 to `t_max`, by channel: an unbiased estimate in [0, 1], and exact where the density
    /// has an integral in closed form. Takes one number of `rng`.
    ///
    /// Residual ratio tracking (Novak, Selle & Jarosz, "Residual Ratio Tracking for Estimating Attenuation in Participating Media", 2014):
    /// the minorant passes in closed form, the rest by collisions that each take away their share. Their rate is that of what the majorant
    /// leaves above the minorant, times a factor: the relative variance is at most `exp(depth / factor) - 1` for a residual optical depth,
    /// so the factor is that depth by the majorants, between 1 and 16. Where a grid has fewer voxels on the line than that makes collisions,
    /// its density is summed voxel by voxel, which is exact.
    pub fn transmittance(&self, line: &Line, t_max: f64, rng: &mut Rng) -> Rgb {
        let own = rng.split();
        let extinction = self.extinction();
        if let Some(exact) = self.exact_transmittance(line, t_max) {
            return exact;
        }
        let most = extinction.max_element();
        if most == 0.0 {
            return Rgb::ONE;
        }
        let (mut sure, mut open, mut length) = (0.0, 0.0, 0.0);
        for segment in self.density().segments(line, t_max, f64::INFINITY) {
            let part = segment.t1 - segment.t0;
            length += part;
            sure += segment.minorant * part;
            open += (segment.majorant - segment.minorant) * part;
        }
        let rate = most * (most * open).clamp(1.0, MOST_FACTOR);
        if let Density::Grid(grid) = self.density() {
            // Each takes about as long as a collision.
            if rate * open > length * grid.voxels_per_length(line) {
                return left(extinction, grid.integral(line, t_max)).as_vec3();
            }
        }
        (self.residual(line, t_max, rate, own) * left(extinction, sure)).as_vec3()
    }

    /// What ratio tracking at a `rate` of collisions per unit of length and of majorant above the minorant leaves of the light.
    fn residual(&self, line: &Line, t_max: f64, rate: f64, mut rng: Rng) -> DVec3 {
        let extinction = self.extinction();
        let clear = extinction.cmple(DVec3::ZERO);
        let mut kept = DVec3::ONE;
        let mut budget = free_depth(&mut rng);
        for segment in self.density().segments(line, t_max, f64::INFINITY) {
            let residual = segment.majorant - segment.minorant;
            let (mut t, per_length) = (segment.t0, rate * residual);
            if residual <= 0.0 {
                // Nothing is left to chance.
                continue;
            }
            loop {
                let cost = (segment.t1 - t) * per_length;
                if budget >= cost {
                    budget -= cost;
                    break;
                }
                t = (t + budget / per_length).min(segment.t1);
                budget = free_depth(&mut rng);
                let above = (self.density().at(line.at(t)) - segment.minorant).clamp(0.0, residual);
                kept *= DVec3::ONE - extinction * (above / residual / rate);
                // Of channels that lose anything nothing is left.
                if DVec3::select(clear, DVec3::ZERO, kept).max_element() < LEAST_KEPT {
                    return DVec3::select(clear, DVec3::ONE, DVec3::ZERO);
                }
            }
        }
        kept.max(DVec3::ZERO)
    }
}

/// Null collisions that a segment may cause, about, before it is divided: a walk over the voxels of a leaf takes as long as so many.
const MOST_NULL: f64 = 16.0;

/// Transmittances below this are zero in `f32`.
const LEAST_KEPT: f64 = 1e-46;

/// Largest factor on the rate of residual ratio tracking. It is reached at an optical depth of 16, where 1e-7 of the light is left.
const MOST_FACTOR: f64 = 16.0;

/// What light passed on its way.
#[derive(Clone, Copy, Debug, Default)]
struct Passed {
    /// Null collisions.
    nulls: u64,
    /// Places at which emission was sampled.
    glows: u64,
    /// Majorant times length.
    depth: f64,
}

impl Passed {
    /// Nothing but a `depth`.
    fn over(depth: f64) -> Self {
        Self { depth, ..Self::default() }
    }

    /// Logarithms of the densities with which each channel passes all that, but for what is the same in all of them.
    fn logs(&self, rates: &Rates) -> DVec3 {
        let times = |count: u64, rate: f64| if count == 0 { 0.0 } else { count as f64 * rate.ln() };
        let channel = |total: f64, emit: f64| {
            // Nothing is lost at a rate of zero, however deep.
            let lost = if total > 0.0 { total * self.depth } else { 0.0 };
            times(self.nulls, total) + times(self.glows, emit) - lost
        };
        let Rates { emit, total, .. } = rates;
        DVec3::new(channel(total.x, emit.x), channel(total.y, emit.y), channel(total.z, emit.z))
    }

    /// The end of a flight that reaches the end of its line.
    fn escape(&self, rates: &Rates, channels: &Channels) -> End {
        End::Escaped { weight: channels.balance(self.logs(rates)) }
    }
}

/// The end of a flight at a distance that was drawn without null collisions, at a `depth` of the density.
fn collide(rates: &Rates, channels: &Channels, (t, depth): (f64, f64), rng: &mut Rng) -> End {
    let picked = channels.picked;
    let kinds = [
        (Kind::Absorb, rates.absorb[picked]),
        (Kind::Scatter, rates.scatter[picked]),
        (Kind::Emit, 0.0),
        (Kind::Null, 0.0),
    ];
    let passed = Passed::over(depth).logs(rates);
    match Kind::pick(kinds, rng.next_f64()) {
        Kind::Absorb => End::Absorbed { t, weight: channels.balance(passed + rates.absorb.map(f64::ln)) },
        Kind::Scatter | Kind::Emit | Kind::Null => {
            End::Scattered { t, weight: channels.balance(passed + rates.scatter.map(f64::ln)) }
        }
    }
}

#[cfg(test)]
mod tests;
