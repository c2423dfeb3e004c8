use super::emission::Emitter;
use crate::lights::{Light, LightId};
use crate::media::Surroundings;
use crate::sampling::Distribution1D;
use crate::scene::{MapKind, Scene};
use rayon::prelude::*;

/// All lights of a scene, ready to emit the photons of one map.
#[derive(Clone, Debug)]
pub(super) struct Sources<'a> {
    /// By light; `None` where it sends nothing that could be of use.
    emitters: Vec<Option<Emitter<'a>>>,
    /// By light: the medium in front and behind.
    media: Vec<[Surroundings; 2]>,
    /// By importance; `None` where nothing is emitted.
    choice: Option<Distribution1D>,
    /// Lights that are in more than one medium on one side.
    pub divided: Vec<LightId>,
}

impl<'a> Sources<'a> {
    /// `budget` holds factors on the importance of lights, if there are any.
    pub(super) fn new(scene: &'a Scene, kind: MapKind, aimed: bool, budget: Option<&[f64]>) -> Self {
        let lights = scene.lights();
        let emitters: Vec<Option<Emitter<'a>>> = (0..lights.len())
            .into_par_iter()
            .map(|index| match aimed {
                true => Emitter::new(scene, index, kind),
                false => Some(Emitter::unaimed(scene, index)).filter(|emitter| emitter.importance() > 0.0),
            })
            .collect();
        let mut divided = Vec::new();
        let mut media = Vec::with_capacity(lights.len());
        for (index, light) in lights.iter().enumerate() {
            let (front, front_divided) = scene.medium_around(&light.points(false));
            let two_sided = matches!(light, Light::Area(area) if area.is_two_sided());
            let (back, back_divided) =
                if two_sided { scene.medium_around(&light.points(true)) } else { (front, false) };
            if front_divided || back_divided {
                divided.push(index as LightId);
            }
            media.push([front, back]);
        }
        let importance = |(light, emitter): (usize, &Option<Emitter<'_>>)| {
            let factor = budget.and_then(|budget| budget.get(light)).copied().unwrap_or(1.0);
            emitter.as_ref().map_or(0.0, Emitter::importance) * factor
        };
        let choice = Distribution1D::new(emitters.iter().enumerate().map(importance));
        Self { emitters, media, choice, divided }
    }

    pub(super) fn emitter(&self, light: usize) -> Option<&Emitter<'a>> {
        self.emitters[light].as_ref()
    }

    pub(super) fn media(&self, light: usize) -> [Surroundings; 2] {
        self.media[light]
    }

    /// True where no light emits anything.
    pub(super) fn is_dark(&self) -> bool {
        self.choice.is_none()
    }

    /// Photons of each light where `emitted` leave them all.
    pub(super) fn shares(&self, emitted: u64) -> Vec<u64> {
        let Some(choice) = &self.choice else { return vec![0; self.emitters.len()] };
        // At least one photon for a light that shines, so that none is left out whatever the others are.
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
