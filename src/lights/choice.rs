//! Choice of the lights that get a shadow ray at a point.

use super::tree::{LightBounds, LightTree};
use super::{Light, LightId, Receiver};
use crate::sampling::Distribution1D;

/// Up to this number of lights at a position, and up to this number from outside, each light gets its own shadow rays.
pub const LIGHTS_SAMPLED_EACH: usize = 8;

/// How one of many lights is sampled.
#[derive(Clone, Debug)]
enum Drawing {
    /// By its possible contribution to the point.
    Tree(LightTree),
    /// By flux, for light from outside.
    Flux(Distribution1D),
}

/// A group of lights of which one is sampled.
#[derive(Clone, Debug)]
pub struct LightGroup {
    drawing: Drawing,
    members: Vec<LightId>,
}

/// Lights that are sampled one by one, and groups of lights that are too many for that.
#[derive(Clone, Debug, Default)]
pub struct LightChoice {
    each: Vec<LightId>,
    groups: Vec<LightGroup>,
    /// For each light, the index of its group and its index within the group; `None` where it is sampled by itself.
    places: Vec<Option<(u32, u32)>>,
}

impl LightGroup {
    /// Samples a light; returns it, its probability, and the remainder of `u`. `None` where no light of the group can reach the point.
    #[inline]
    pub fn sample(&self, at: &Receiver, u: f64) -> Option<(LightId, f32)> {
        let (member, probability, _) = match &self.drawing {
            Drawing::Tree(tree) => tree.sample(at, u)?,
            Drawing::Flux(choice) => choice.sample(u),
        };
        Some((self.members[member], probability))
    }

    /// Lights of the group.
    pub fn members(&self) -> &[LightId] {
        &self.members
    }
}

impl LightChoice {
    /// The choice for a scene whose bounding sphere has this radius.
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
        // `None` where all of them are dark; they are then left out.
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

    /// Groups of lights, of each of which one light is sampled.
    pub fn groups(&self) -> &[LightGroup] {
        &self.groups
    }

    /// Probability with which the light is sampled at a point: a factor on the density of its samples.
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
