//! Which lights get a shadow ray at a place.

use super::tree::{LightBounds, LightTree};
use super::{Light, LightId, Receiver};
use crate::sampling::Distribution1D;

/// Up to so many lights with a place, and so many from outside, each gets its own shadow rays.
pub const LIGHTS_SAMPLED_EACH: usize = 8;

/// How one light out of many is drawn.
#[derive(Clone, Debug)]
enum Drawing {
    /// By what it may contribute to the place.
    Tree(LightTree),
    /// By flux, for light from outside.
    Flux(Distribution1D),
}

/// Lights of which one is drawn.
#[derive(Clone, Debug)]
pub struct LightGroup {
    drawing: Drawing,
    members: Vec<LightId>,
}

/// Lights that are sampled one by one, and those that are too many for that.
#[derive(Clone, Debug, Default)]
pub struct LightChoice {
    each: Vec<LightId>,
    groups: Vec<LightGroup>,
    /// By light: number of its group and number in there; `None` where it is sampled by itself.
    places: Vec<Option<(u32, u32)>>,
}

impl LightGroup {
    /// A light, its probability, and what is left of `u`; `None` where none of them can reach the place.
    #[inline]
    pub fn sample(&self, at: &Receiver, u: f64) -> Option<(LightId, f32)> {
        let (member, probability, _) = match &self.drawing {
            Drawing::Tree(tree) => tree.sample(at, u)?,
            Drawing::Flux(choice) => choice.sample(u),
        };
        Some((self.members[member], probability))
    }

    /// Lights in the group.
    pub fn members(&self) -> &[LightId] {
        &self.members
    }
}

impl LightChoice {
    /// For a scene whose bounding sphere has this radius.
    pub fn new(lights: &[Light], scene_radius: f32) -> Self {
        let all = 0..lights.len() as LightId;
        let mut choice = Self { places: vec![None; lights.len()], ..Self::default() };
        if lights.len() <= LIGHTS_SAMPLED_EACH {
            choice.each = all.collect();
            return choice;
        }
        let (outside, near): (Vec<LightId>, Vec<LightId>) =
            all.partition(|&id| lights[id as usize].is_at_infinity());
        for members in [outside, near] {
            if members.len() <= LIGHTS_SAMPLED_EACH {
                choice.each.extend(members);
            } else {
                choice.add(lights, members, scene_radius);
            }
        }
        choice
    }

    fn add(&mut self, lights: &[Light], members: Vec<LightId>, scene_radius: f32) {
        let members_of = || members.iter().map(|&id| &lights[id as usize]);
        let drawing = if lights[members[0] as usize].is_at_infinity() {
            Distribution1D::new(members_of().map(|light| light.flux(scene_radius).max_element()))
                .map(Drawing::Flux)
        } else {
            let bounds: Option<Vec<LightBounds>> = members_of().map(Light::bounds).collect();
            bounds.and_then(|bounds| LightTree::new(&bounds)).map(Drawing::Tree)
        };
        // None where all of them are dark: they are then left out.
        let Some(drawing) = drawing else { return };
        let group = self.groups.len() as u32;
        for (number, &id) in members.iter().enumerate() {
            self.places[id as usize] = Some((group, number as u32));
        }
        self.groups.push(LightGroup { drawing, members });
    }

    /// Lights that are sampled one by one.
    pub fn each(&self) -> &[LightId] {
        &self.each
    }

    /// Lights of which one is drawn from each group.
    pub fn groups(&self) -> &[LightGroup] {
        &self.groups
    }

    /// Probability with which the light is sampled at a place: what the density of its samples is multiplied by.
    #[inline]
    pub fn probability(&self, at: &Receiver, light: LightId) -> f32 {
        match self.places.get(light as usize) {
            Some(&Some((group, number))) => match &self.groups[group as usize].drawing {
                Drawing::Tree(tree) => tree.probability(at, number as usize),
                Drawing::Flux(choice) => choice.probability(number as usize),
            },
            _ => 1.0,
        }
    }
}
