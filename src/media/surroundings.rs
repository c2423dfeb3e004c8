//! Bodies that overlap: which of their media fills a place.
//!
//! After Schmidt & Budge, "Simple Nested Dielectrics in Ray Traced Images", Journal of Graphics Tools 7(2), 2002: a ray keeps a
//! list of the bodies that it is in, and the one of the highest priority decides. A surface of any other body is not there for it.

use super::{AIR, Medium, MediumId};

/// Bodies that a place can be in at a time.
pub const MOST_BODIES: usize = 4;

/// The bodies around a place, by their media, the one that fills it first. Two bodies of one medium count twice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Surroundings {
    /// By rank; air after the last.
    bodies: [MediumId; MOST_BODIES],
}

/// What it means for a ray to cross the border between two media.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crossing {
    /// Where the ray comes from, as the border says.
    pub before: Surroundings,
    /// Where it is when it has passed.
    pub after: Surroundings,
    /// Whether the ray was where the border says: within the body whose border it meets from inside, and within no more
    /// bodies than are kept.
    pub fits: bool,
}

impl Crossing {
    /// Whether the same medium is on both sides, because another body fills the place: then there is no surface here.
    #[inline]
    pub fn is_hidden(&self) -> bool {
        self.before.medium() == self.after.medium()
    }
}

impl Surroundings {
    /// Within no body.
    pub const AIR: Self = Self { bodies: [AIR; MOST_BODIES] };

    /// Within one body, or none where that is [`AIR`](super::AIR).
    pub fn of(medium: MediumId) -> Self {
        let mut bodies = [AIR; MOST_BODIES];
        bodies[0] = medium;
        Self { bodies }
    }

    /// The medium that fills the place.
    #[inline]
    pub fn medium(&self) -> MediumId {
        self.bodies[0]
    }

    /// What a ray from here passes at a border that has `near` on its side and `far` on the other.
    pub fn crossing(self, near: MediumId, far: MediumId, media: &[Medium]) -> Crossing {
        let (mut before, mut fits) = (self, true);
        if near != AIR && !self.bodies.contains(&near) {
            fits = false;
            before.add(near, media);
        }
        let mut after = before;
        if near != AIR {
            after.remove(near);
        }
        if far != AIR {
            fits &= after.add(far, media);
        }
        Crossing { before, after, fits }
    }

    /// Adds a body; `false` where that of the highest rank had to go for it, or it itself.
    fn add(&mut self, body: MediumId, media: &[Medium]) -> bool {
        let rank = |id: MediumId| media.get(id as usize).map_or(u32::MAX, |medium| medium.rank);
        let place = self.bodies.iter().position(|&other| other == AIR || rank(body) < rank(other));
        let is_full = self.bodies[MOST_BODIES - 1] != AIR;
        if let Some(place) = place {
            self.bodies.copy_within(place..MOST_BODIES - 1, place + 1);
            self.bodies[place] = body;
        }
        !is_full
    }

    fn remove(&mut self, body: MediumId) {
        if let Some(place) = self.bodies.iter().position(|&other| other == body) {
            self.bodies.copy_within(place + 1.., place);
            self.bodies[MOST_BODIES - 1] = AIR;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rgb;

    /// Air, then media of these ranks.
    fn media(ranks: &[u32]) -> Vec<Medium> {
        let medium = |rank| Medium { name: String::new(), ior: 1.0, absorption: Rgb::ZERO, rank };
        std::iter::once(u32::MAX).chain(ranks.iter().copied()).map(medium).collect()
    }

    #[test]
    fn the_body_of_the_least_rank_fills_the_place_whatever_the_order() {
        let media = media(&[2, 1, 3]);
        let orders = [[1, 2, 3], [1, 3, 2], [2, 1, 3], [2, 3, 1], [3, 1, 2], [3, 2, 1]];
        for into in orders {
            let mut at = Surroundings::AIR;
            for body in into {
                let crossing = at.crossing(AIR, body, &media);
                assert!(crossing.fits && crossing.before == at);
                assert_eq!(crossing.is_hidden(), at.medium() == crossing.after.medium());
                at = crossing.after;
            }
            assert_eq!(at.medium(), 2);
            for out in orders {
                let mut at = at;
                for (left, body) in out.into_iter().enumerate() {
                    let crossing = at.crossing(body, AIR, &media);
                    assert!(crossing.fits);
                    // The way back is the same surface.
                    assert_eq!(crossing.after.crossing(AIR, body, &media).after, at);
                    at = crossing.after;
                    let best = out[left + 1..].iter().copied().min_by_key(|&id| media[id as usize].rank);
                    assert_eq!(at.medium(), best.unwrap_or(AIR));
                }
                assert_eq!(at, Surroundings::AIR);
            }
        }
    }

    #[test]
    fn two_bodies_of_a_medium_are_one() {
        let media = media(&[1]);
        let first = Surroundings::AIR.crossing(AIR, 1, &media);
        let second = first.after.crossing(AIR, 1, &media);
        assert!(!first.is_hidden() && second.is_hidden());
        let (third, fourth) = (second.after.crossing(1, AIR, &media), first.after.crossing(1, AIR, &media));
        assert!(third.is_hidden() && third.after == first.after && fourth.after == Surroundings::AIR);
    }

    #[test]
    fn borders_that_name_both_media_exchange_them() {
        let media = media(&[1, 2]);
        let glass = Surroundings::of(1);
        let crossing = glass.crossing(1, 2, &media);
        assert_eq!(crossing, Crossing { before: glass, after: Surroundings::of(2), fits: true });
    }

    #[test]
    fn what_contradicts_itself_is_told() {
        let media = media(&[1, 2, 3, 4, 5]);
        // Out of a body that was never entered.
        let crossing = Surroundings::AIR.crossing(1, AIR, &media);
        assert_eq!(crossing, Crossing { before: Surroundings::of(1), after: Surroundings::AIR, fits: false });
        // Into more bodies than are kept: the best stay.
        let mut at = Surroundings::AIR;
        for body in [5, 4, 3, 2] {
            let crossing = at.crossing(AIR, body, &media);
            assert!(crossing.fits);
            at = crossing.after;
        }
        let crossing = at.crossing(AIR, 1, &media);
        assert!(!crossing.fits && crossing.after.medium() == 1);
        assert!(!crossing.after.bodies.contains(&5));
    }
}
