//! What fills a body: coefficients, a phase function and a density.

use super::density::{Density, Line};
use super::{Coefficients, Glow, Phase};
use crate::math::Rgb;
use glam::DVec3;
use std::sync::Arc;

/// A medium that scatters, absorbs and emits, with the density that its coefficients are multiplied with.
///
/// Coefficients are per unit of the space in which lines are given ([`Coefficients::per_length`]).
#[derive(Clone, Debug)]
pub struct Volume {
    coefficients: Coefficients,
    phase: Phase,
    density: Density,
    glow_rate: DVec3,
    glow: Option<Arc<Glow>>,
}

/// Places at which emission is sampled on the longest line through a density.
const ACROSS: f64 = 4.0;

impl Volume {
    /// Of its parts.
    pub fn new(coefficients: Coefficients, phase: Phase, density: Density) -> Self {
        let extinction = coefficients.extinction().as_dvec3();
        let depth = density.widest_depth().filter(|&depth| depth > 0.0);
        let glow_rate = match depth {
            // A few on any line through the whole, and no fewer than there are collisions.
            Some(depth) if coefficients.emission() != Rgb::ZERO => {
                extinction.max(DVec3::splat(ACROSS / depth))
            }
            _ => DVec3::ZERO,
        };
        Self { coefficients, phase, density, glow_rate, glow: None }
    }

    /// The same, with the emission multiplied by what `glow` says of each place. For densities that end somewhere.
    #[must_use]
    pub fn glowing(self, glow: Glow) -> Self {
        Self { glow: Some(Arc::new(glow)), ..self }
    }

    /// How the emission varies besides the density; `None` where it does not.
    pub fn glow(&self) -> Option<&Glow> {
        self.glow.as_deref()
    }

    /// A homogeneous one.
    pub fn homogeneous(coefficients: Coefficients, phase: Phase) -> Self {
        Self::new(coefficients, phase, Density::Homogeneous)
    }

    /// Coefficients where the density is one.
    pub fn coefficients(&self) -> &Coefficients {
        &self.coefficients
    }

    /// Phase function.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Density.
    pub fn density(&self) -> &Density {
        &self.density
    }

    /// Rate, per unit of length and density, of the places at which trackers sample the emission, for each channel.
    pub(super) fn glow_rate(&self) -> DVec3 {
        self.glow_rate
    }

    /// Extinction coefficient where the density is one, for each channel.
    pub(super) fn extinction(&self) -> DVec3 {
        self.coefficients.absorption().as_dvec3() + self.coefficients.scattering().as_dvec3()
    }

    /// Share of the light that is left over `line` from 0 to `t_max`, where the density has an integral in closed form:
    /// `exp(-extinction * depth)` (Beer-Lambert).
    pub fn exact_transmittance(&self, line: &Line, t_max: f64) -> Option<Rgb> {
        let depth = self.density.depth(line, t_max)?;
        Some(left(self.extinction(), depth).as_vec3())
    }

    /// Radiance that the medium itself adds to `line` from 0 to `t_max`, as seen from its origin, W/(m^2 sr); where the density has an
    /// integral in closed form: `emission / extinction * (1 - exp(-extinction * depth))`, and `emission * depth` where nothing is lost.
    pub fn exact_emission(&self, line: &Line, t_max: f64) -> Option<Rgb> {
        if self.coefficients.emission() == Rgb::ZERO {
            return Some(Rgb::ZERO);
        }
        let depth = self.density.depth(line, t_max)?;
        let (emission, extinction) = (self.coefficients.emission().as_dvec3(), self.extinction());
        let channel = |c: usize| {
            if emission[c] == 0.0 {
                0.0
            } else if extinction[c] > 0.0 {
                emission[c] / extinction[c] * -(-extinction[c] * depth).exp_m1()
            } else {
                emission[c] * depth
            }
        };
        Some(DVec3::new(channel(0), channel(1), channel(2)).as_vec3())
    }
}

/// `exp(-extinction * depth)`; one in channels that lose nothing, however deep.
pub(super) fn left(extinction: DVec3, depth: f64) -> DVec3 {
    let channel = |sigma: f64| if sigma > 0.0 { (-sigma * depth).exp() } else { 1.0 };
    DVec3::new(channel(extinction.x), channel(extinction.y), channel(extinction.z))
}
