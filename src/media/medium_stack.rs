//! The medium stack: bodies that overlap, and which of their media fills a place.
//!
//! After Schmidt & Budge, "Simple Nested Dielectrics in Ray Traced Images", Journal of Graphics Tools 7(2), 2002: a ray
//! keeps a list of the bodies that contain it, and the body of the highest priority fills the place. The surface of any
//! other body does not affect the ray.

use super::{AIR, Medium, MediumId};

/// Largest number of different media whose bodies overlap at one place. Bodies of one medium are counted, and take no
/// more memory however many they are.
pub const MOST_MEDIA: usize = 16;

/// Largest number of bodies of one medium that overlap at one place.
const MOST_OF_ONE: u16 = u16::MAX;

/// The medium stack of a place: the media of the bodies around it, in the order of their ranks; the first one fills the
/// place. Two bodies of one medium count twice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MediumStack {
    /// By rank, each medium once; air after the last.
    media: [MediumId; MOST_MEDIA],
    /// Number of bodies of each medium.
    counts: [u16; MOST_MEDIA],
}

/// The result of crossing an interface between two media.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crossing {
    /// Medium stack before the interface, consistent with what the interface states.
    pub before: MediumStack,
    /// Medium stack after the interface.
    pub after: MediumStack,
    /// Whether the medium stack of the ray fits the interface: it contains the body that the ray leaves, and there is
    /// room for the body that the ray enters.
    pub fits: bool,
    /// Whether bodies of more than [`MOST_MEDIA`] media overlap behind the interface, so that one of them had to be
    /// left out.
    pub is_full: bool,
}

impl Crossing {
    /// Whether this is a null interface: the same medium is on both sides, because another body fills the place. There
    /// is then no surface.
    #[inline]
    pub fn is_hidden(&self) -> bool {
        self.before.medium() == self.after.medium()
    }

    /// This crossing followed by the crossing of another interface at the same place.
    pub fn and(self, near: MediumId, far: MediumId, media: &[Medium]) -> Self {
        let mut next = self.after.crossing(near, far, media);
        let mut before = self.before;
        if near != AIR && next.before != self.after {
            // The ray was inside this body from the start.
            before.add(near, media);
        }
        next.before = before;
        next.fits &= self.fits;
        next.is_full |= self.is_full;
        next
    }
}

impl MediumStack {
    /// The stack inside no body.
    pub const AIR: Self = Self { media: [AIR; MOST_MEDIA], counts: [0; MOST_MEDIA] };

    /// The stack inside one body, or none for [`AIR`](super::AIR).
    pub fn of(medium: MediumId) -> Self {
        let mut one = Self::AIR;
        if medium != AIR {
            (one.media[0], one.counts[0]) = (medium, 1);
        }
        one
    }

    /// The medium that fills the place.
    #[inline]
    pub fn medium(&self) -> MediumId {
        self.media[0]
    }

    /// Media of all bodies around the place, each once, in the order of their ranks.
    pub fn media(&self) -> impl Iterator<Item = MediumId> + '_ {
        self.media.iter().copied().take_while(|&id| id != AIR)
    }

    /// Whether the place is inside a body of this medium, or the medium is air.
    #[inline]
    pub fn is_within(&self, medium: MediumId) -> bool {
        medium == AIR || self.place_of(medium).is_some()
    }

    /// Whether there is no room for a body of another medium, or for another body of some medium.
    #[inline]
    pub fn is_full(&self) -> bool {
        self.media[MOST_MEDIA - 1] != AIR || self.counts.contains(&MOST_OF_ONE)
    }

    /// The crossing of an interface that has `near` on the side of the ray and `far` on the other.
    pub fn crossing(self, near: MediumId, far: MediumId, media: &[Medium]) -> Crossing {
        let (mut before, mut fits) = (self, true);
        if !self.is_within(near) {
            fits = false;
            before.add(near, media);
        }
        let mut after = before;
        if near != AIR {
            after.remove(near);
        }
        let has_room = far == AIR || after.add(far, media);
        Crossing { before, after, fits: fits && has_room, is_full: !has_room }
    }

    /// The media on both sides of such an interface, as [`Self::crossing`] computes them, without the medium stacks.
    /// This takes much less work, for rays that only need to know whether there is a surface.
    #[inline]
    pub fn sides(&self, near: MediumId, far: MediumId, media: &[Medium]) -> [MediumId; 2] {
        let filling = |a: MediumId, b: MediumId| match (a, b) {
            (AIR, other) | (other, AIR) => other,
            _ if rank_of(b, media) < rank_of(a, media) => b,
            _ => a,
        };
        let left = if near == self.media[0] && near != AIR && self.counts[0] == 1 {
            self.media[1]
        } else if self.is_within(near) {
            self.media[0]
        } else {
            // The ray was inside the body without having entered it, and leaves it here.
            return [filling(self.media[0], near), filling(self.media[0], far)];
        };
        [self.media[0], filling(left, far)]
    }

    fn place_of(&self, medium: MediumId) -> Option<usize> {
        self.media().position(|other| other == medium)
    }

    /// Adds a body; `false` where the body of the highest rank, which may be the new one, had to be left out.
    fn add(&mut self, body: MediumId, media: &[Medium]) -> bool {
        if let Some(place) = self.place_of(body) {
            let count = &mut self.counts[place];
            let has_room = *count < MOST_OF_ONE;
            *count = count.saturating_add(1);
            return has_room;
        }
        let rank = rank_of(body, media);
        let place = self.media.iter().position(|&other| other == AIR || rank < rank_of(other, media));
        let is_full = self.media[MOST_MEDIA - 1] != AIR;
        if let Some(place) = place {
            self.media.copy_within(place..MOST_MEDIA - 1, place + 1);
            self.counts.copy_within(place..MOST_MEDIA - 1, place + 1);
            (self.media[place], self.counts[place]) = (body, 1);
        }
        !is_full
    }

    fn remove(&mut self, body: MediumId) {
        let Some(place) = self.place_of(body) else { return };
        self.counts[place] -= 1;
        if self.counts[place] == 0 {
            self.media.copy_within(place + 1.., place);
            self.counts.copy_within(place + 1.., place);
            (self.media[MOST_MEDIA - 1], self.counts[MOST_MEDIA - 1]) = (AIR, 0);
        }
    }
}

fn rank_of(id: MediumId, media: &[Medium]) -> u32 {
    media.get(usize::from(id)).map_or(u32::MAX, |medium| medium.rank)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rgb;
    use crate::sampling::{Rng, Stream};

    /// Air and media of these ranks.
    fn media(ranks: &[u32]) -> Vec<Medium> {
        let medium = |rank| Medium {
            name: String::new(),
            ior: 1.0,
            dispersion: None,
            absorption: Rgb::ZERO,
            volume: None,
            rank,
        };
        std::iter::once(u32::MAX).chain(ranks.iter().copied()).map(medium).collect()
    }

    #[test]
    fn the_body_of_the_least_rank_fills_the_place_whatever_the_order() {
        let media = media(&[2, 1, 3]);
        let orders = [[1, 2, 3], [1, 3, 2], [2, 1, 3], [2, 3, 1], [3, 1, 2], [3, 2, 1]];
        for into in orders {
            let mut at = MediumStack::AIR;
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
                    // The way back crosses the same surface.
                    assert_eq!(crossing.after.crossing(AIR, body, &media).after, at);
                    at = crossing.after;
                    let best = out[left + 1..].iter().copied().min_by_key(|&id| media[id as usize].rank);
                    assert_eq!(at.medium(), best.unwrap_or(AIR));
                }
                assert_eq!(at, MediumStack::AIR);
            }
        }
    }

    #[test]
    fn sides_are_those_of_the_crossing() {
        let ranks: Vec<u32> = (1..=MOST_MEDIA as u32 + 2).rev().collect();
        let media = media(&ranks);
        let mut rng = Rng::new(1, Stream::Measure, 0);
        for walk in 0..2000 {
            // With few media, bodies of one medium overlap; with many, the stack is full.
            let count = if walk % 2 == 0 { 4 } else { media.len() };
            let mut at = MediumStack::AIR;
            for _ in 0..60 {
                let mut one = || ((rng.next_f32() * count as f32) as usize).min(count - 1) as MediumId;
                let (near, far) = (one(), one());
                // Most interfaces have air on one side.
                let (near, far) = match rng.next_f32() {
                    x if x < 0.4 => (AIR, far),
                    x if x < 0.7 => (near, AIR),
                    _ => (near, far),
                };
                let crossing = at.crossing(near, far, &media);
                let sides = [crossing.before.medium(), crossing.after.medium()];
                assert_eq!(at.sides(near, far, &media), sides, "{at:?} at {near} | {far}");
                at = crossing.after;
            }
        }
    }

    #[test]
    fn two_bodies_of_a_medium_are_one() {
        let media = media(&[1]);
        let first = MediumStack::AIR.crossing(AIR, 1, &media);
        let second = first.after.crossing(AIR, 1, &media);
        assert!(!first.is_hidden() && second.is_hidden());
        let (third, fourth) = (second.after.crossing(1, AIR, &media), first.after.crossing(1, AIR, &media));
        assert!(third.is_hidden() && third.after == first.after && fourth.after == MediumStack::AIR);
    }

    #[test]
    fn borders_that_name_both_media_exchange_them() {
        let media = media(&[1, 2]);
        let glass = MediumStack::of(1);
        let crossing = glass.crossing(1, 2, &media);
        assert_eq!((crossing.before, crossing.after), (glass, MediumStack::of(2)));
        assert!(crossing.fits && !crossing.is_full);
    }

    #[test]
    fn what_contradicts_itself_is_told() {
        let ranks: Vec<u32> = (1..=MOST_MEDIA as u32 + 1).collect();
        let media = media(&ranks);
        // Out of a body that was never entered.
        let crossing = MediumStack::AIR.crossing(1, AIR, &media);
        let of_first = MediumStack::of(1);
        assert_eq!((crossing.before, crossing.after), (of_first, MediumStack::AIR));
        assert!(!crossing.fits && !crossing.is_full);
        // Into bodies of more media than the stack holds: those of the least ranks stay.
        let mut at = MediumStack::AIR;
        let last = MOST_MEDIA as MediumId + 1;
        for body in (2..=last).rev() {
            let crossing = at.crossing(AIR, body, &media);
            assert!(crossing.fits);
            at = crossing.after;
        }
        let crossing = at.crossing(AIR, 1, &media);
        assert!(!crossing.fits && crossing.is_full && crossing.after.medium() == 1);
        assert!(crossing.after.place_of(last).is_none());
    }

    #[test]
    fn bodies_of_one_medium_nest_as_deep_as_they_like() {
        let media = media(&[1, 2]);
        let mut at = MediumStack::of(2);
        for depth in 0..1000 {
            let crossing = at.crossing(AIR, 1, &media);
            assert!(crossing.fits && crossing.is_hidden() == (depth > 0));
            at = crossing.after;
        }
        for depth in (0..1000).rev() {
            let crossing = at.crossing(1, AIR, &media);
            assert!(crossing.fits && crossing.is_hidden() == (depth > 0));
            at = crossing.after;
        }
        assert_eq!(at, MediumStack::of(2));
    }

    #[test]
    fn borders_at_one_place_are_one_crossing() {
        let media = media(&[1, 2]);
        // Out of one body and into another: from glass to water, without air between them.
        let glass = MediumStack::of(1);
        let crossing = glass.crossing(1, AIR, &media).and(AIR, 2, &media);
        assert_eq!((crossing.before, crossing.after), (glass, MediumStack::of(2)));
        assert!(crossing.fits && !crossing.is_hidden());
        // Between two bodies of one medium there is nothing.
        let crossing = glass.crossing(1, AIR, &media).and(AIR, 1, &media);
        assert!(crossing.fits && crossing.is_hidden() && crossing.after == glass);
        // A body that was never entered contained the ray before either interface.
        let crossing = MediumStack::AIR.crossing(1, AIR, &media).and(2, AIR, &media);
        assert!(!crossing.fits && crossing.before.medium() == 1 && crossing.before.media().count() == 2);
        assert_eq!(crossing.after, MediumStack::AIR);
    }
}
