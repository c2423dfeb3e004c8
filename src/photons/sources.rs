//! All lights of a scene as the sources of one photon pass.

use super::emission::{Emitter, Goals};
use crate::lights::LightId;
use crate::media::MediumStack;
use crate::sampling::Distribution1D;
use crate::scene::{MapKind, Scene};
use rayon::prelude::*;

/// All lights of a scene, ready to emit the photons of one map.
#[derive(Clone, Debug)]
pub(super) struct Sources<'a> {
    /// By light; `None` where none of its photons would be of use.
    emitters: Vec<Option<Emitter<'a>>>,
    /// By light: the medium stack in front and behind.
    media: Vec<[MediumStack; 2]>,
    /// Distribution of lights by importance; `None` where no light emits anything.
    choice: Option<Distribution1D>,
    /// Lights with more than one medium on one side.
    pub divided: Vec<LightId>,
}

impl<'a> Sources<'a> {
    /// Prepares a pass that stores about `stored` photons. `budget` holds factors on the importance of the lights, if
    /// any.
    pub(super) fn new(
        scene: &'a Scene,
        (kind, stored): (MapKind, u64),
        aimed: bool,
        budget: Option<&[f64]>,
    ) -> Self {
        Self::with_goals(scene, &Goals::new(scene, kind), stored, aimed, budget)
    }

    /// [`Self::new`] for photons that are aimed at `goals`.
    pub(super) fn with_goals(
        scene: &'a Scene,
        goals: &Goals<'a>,
        stored: u64,
        aimed: bool,
        budget: Option<&[f64]>,
    ) -> Self {
        let lights = scene.lights();
        let factor = |light: usize| budget.and_then(|budget| budget.get(light)).copied().unwrap_or(1.0);
        let unaimed: Vec<Emitter<'a>> =
            (0..lights.len()).map(|index| Emitter::unaimed(scene, index)).collect();
        let wanted = |index: usize| unaimed[index].importance() * factor(index);
        let total: f64 = (0..lights.len()).map(wanted).sum();
        let emitters: Vec<Option<Emitter<'a>>> = (0..lights.len())
            .into_par_iter()
            .map(|index| match aimed {
                true => Emitter::new(goals, index, stored as f64 * wanted(index) / total),
                false => Some(unaimed[index].clone()).filter(|emitter| emitter.importance() > 0.0),
            })
            .collect();
        let (media, divided): (Vec<_>, Vec<_>) =
            scene.light_media().iter().map(|media| (media.sides, media.divided)).unzip();
        let divided = (0..).zip(divided).filter_map(|(light, divided)| divided.then_some(light)).collect();
        let importance = |(light, emitter): (usize, &Option<Emitter<'_>>)| {
            emitter.as_ref().map_or(0.0, Emitter::importance) * factor(light)
        };
        let choice = Distribution1D::new(emitters.iter().enumerate().map(importance));
        Self { emitters, media, choice, divided }
    }

    /// Flux of all lights towards the aim of their photons, in a relative measure that is the same for all passes.
    pub(super) fn importance(&self) -> f64 {
        self.emitters.iter().flatten().map(Emitter::importance).sum()
    }

    pub(super) fn emitter(&self, light: usize) -> Option<&Emitter<'a>> {
        self.emitters[light].as_ref()
    }

    pub(super) fn media(&self, light: usize) -> [MediumStack; 2] {
        self.media[light]
    }

    /// True where no light emits anything.
    pub(super) fn is_dark(&self) -> bool {
        self.choice.is_none()
    }

    /// Number of photons that each light emits, of `emitted` in total.
    pub(super) fn shares(&self, emitted: u64) -> Vec<u64> {
        let Some(choice) = &self.choice else { return vec![0; self.emitters.len()] };
        // At least one photon for each light that emits, so that none is left out however small its share is.
        let share = |light| {
            let probability = f64::from(choice.probability(light));
            if self.emitters[light].is_some() {
                ((probability * emitted as f64).round() as u64).max(1)
            } else {
                0
            }
        };
        (0..self.emitters.len()).map(share).collect()
    }
}
