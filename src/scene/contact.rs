//! Contacts: places where an interface between media, or a flat emitter, coincides with another surface to within rounding.
//!
//! A ray that meets one of these surfaces meets all of them, in a defined order (`docs/conventions.md`), and continues beyond them. The
//! regions of possible contacts are found when a scene is built, so that rays elsewhere need no second query.

use super::crossings::Crossings;
use super::parts::SceneParts;
use super::scene::Scene;
use super::surface::{HitPoint, SurfaceInteraction};
use super::touching::{Touching, find_touching};
use crate::embree::RawHit;
use crate::lights::Light;
use crate::math::{Bounds3, Ray, Rgb};
use crate::media::{AIR, Crossing, Medium, MediumId, MediumStack};
use arrayvec::ArrayVec;
use glam::Vec3;
use std::cell::RefCell;

/// Largest number of interfaces that a ray passes at one place; interfaces between the same pair of media count once.
const MOST_BORDERS: usize = 4;

/// The interfaces between media at the place of a hit where another surface coincides. Empty for all other hits, which are described by
/// their own material.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Borders {
    /// Medium on the near side, medium on the far side, and the number of such interfaces; in the order in which the ray passes them.
    pairs: [(MediumId, MediumId, u16); MOST_BORDERS],
    count: u8,
    /// Whether there were more interfaces than fit.
    is_full: bool,
}

impl Borders {
    /// Whether the hit surface coincides with no other one.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    fn push(&mut self, near: MediumId, far: MediumId) {
        let count = usize::from(self.count);
        if let Some(pair) = self.pairs[..count].iter_mut().find(|pair| (pair.0, pair.1) == (near, far)) {
            pair.2 = pair.2.saturating_add(1);
        } else if let Some(pair) = self.pairs.get_mut(count) {
            *pair = (near, far, 1);
            self.count += 1;
        } else {
            self.is_full = true;
        }
    }

    /// Media on the near side and on the far side of each interface.
    pub(super) fn each(&self) -> impl Iterator<Item = (MediumId, MediumId)> + '_ {
        let passed = self.pairs.iter().take(usize::from(self.count));
        passed.flat_map(|&(near, far, count)| (0..count).map(move |_| (near, far)))
    }

    /// Result of crossing all of them from within `current`; `None` where there are none.
    pub(super) fn crossing(&self, current: MediumStack, media: &[Medium]) -> Option<Crossing> {
        let mut all: Option<Crossing> = None;
        for (near, far) in self.each() {
            all = Some(match all {
                None => current.crossing(near, far, media),
                Some(before) => before.and(near, far, media),
            });
        }
        all.map(|crossing| Crossing { fits: crossing.fits && !self.is_full, ..crossing })
    }
}

/// The contacts of a scene.
#[derive(Debug)]
pub(super) struct Contacts {
    /// For each surface, the regions of its contacts; empty where it has none.
    regions: Vec<Regions>,
    /// Half the length of the segment across a surface that meets all surfaces in contact with it.
    reach: f32,
    /// Largest distance between surfaces in contact.
    distance: f32,
    /// Pairs of surfaces in contact, each pair once.
    pairs: Vec<[u32; 2]>,
}

impl Contacts {
    /// Finds the contacts of a scene; `None` where there are no relevant ones.
    pub(super) fn find(parts: &SceneParts) -> Option<Self> {
        let Touching { mut boxes, reach, distance, pairs } = find_touching(parts)?;
        let regions = boxes.iter_mut().map(|boxes| Regions::new(boxes)).collect();
        Some(Self { regions, reach, distance, pairs })
    }

    /// Whether the surface may touch another one at `position`.
    #[inline]
    pub(super) fn may_touch(&self, surface: u32, position: Vec3) -> bool {
        self.regions.get(surface as usize).is_some_and(|regions| regions.contain(position))
    }

    /// Whether the surface touches another one anywhere.
    pub(super) fn touches(&self, surface: usize) -> bool {
        self.regions.get(surface).is_some_and(|regions| !regions.nodes.is_empty())
    }

    pub(super) fn reach(&self) -> f32 {
        self.reach
    }

    /// Distance beyond which surfaces do not touch.
    pub(super) fn distance(&self) -> f32 {
        self.distance
    }

    pub(super) fn pairs(&self) -> &[[u32; 2]] {
        &self.pairs
    }
}

/// A tree of boxes, which tests whether a point is in one of them.
#[derive(Debug, Default)]
struct Regions {
    nodes: Vec<RegionNode>,
}

#[derive(Clone, Copy, Debug)]
struct RegionNode {
    min: Vec3,
    max: Vec3,
    /// The next node if the point is outside: the first one after the subtree of this node.
    next: u32,
    is_leaf: bool,
}

/// Number of boxes in a leaf.
const LEAF: usize = 2;

impl Regions {
    fn new(boxes: &mut [Bounds3]) -> Self {
        let mut tree = Self::default();
        if !boxes.is_empty() {
            tree.add(boxes);
        }
        tree
    }

    fn add(&mut self, boxes: &mut [Bounds3]) {
        let around = boxes.iter().fold(Bounds3::EMPTY, |all, one| all.union(*one));
        let (min, max) = around.to_f32_outward();
        let place = self.nodes.len();
        let is_leaf = boxes.len() <= LEAF;
        self.nodes.push(RegionNode { min: min.into(), max: max.into(), next: 0, is_leaf });
        if !is_leaf {
            let extent = (around.max - around.min).to_array();
            let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
            let (low, high) = {
                let middle = boxes.len() / 2;
                boxes.select_nth_unstable_by(middle, |a, b| a.center()[axis].total_cmp(&b.center()[axis]));
                boxes.split_at_mut(middle)
            };
            self.add(low);
            self.add(high);
        }
        self.nodes[place].next = self.nodes.len() as u32;
    }

    #[inline]
    fn contain(&self, point: Vec3) -> bool {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            let is_inside = point.cmpge(node.min).all() && point.cmple(node.max).all();
            if is_inside && node.is_leaf {
                return true;
            }
            at = if is_inside { at + 1 } else { node.next as usize };
        }
        false
    }
}

/// Largest number of distinct surfaces at one place. More than that count as a contradiction.
const MOST_TOGETHER: usize = 16;

/// A surface at the place of a hit.
struct Member {
    found: SurfaceInteraction,
    raw: RawHit,
    /// Height above the hit, along its normal.
    height: f32,
}

thread_local! {
    /// Buffer for the crossings at one place, so that no ray allocates.
    static CROSSINGS: RefCell<Crossings> = RefCell::default();
}

impl Scene {
    /// Replaces a hit `found` by what the ray meets there, without textures: that surface, or, of several surfaces at the same place,
    /// the one that comes first.
    #[inline(never)]
    pub(super) fn first_of_contact(
        &self,
        contacts: &Contacts,
        found: &mut SurfaceInteraction,
        raw: &mut RawHit,
    ) {
        (*found, *raw) = CROSSINGS.with(|crossings| match crossings.try_borrow_mut() {
            Ok(mut crossings) => self.first_at(contacts, *found, raw, &mut crossings),
            Err(_) => self.first_at(contacts, *found, raw, &mut Crossings::default()),
        });
    }

    fn first_at(
        &self,
        contacts: &Contacts,
        found: SurfaceInteraction,
        raw: &RawHit,
        crossings: &mut Crossings,
    ) -> (SurfaceInteraction, RawHit) {
        let HitPoint { position, normal, offset, .. } = found.point;
        let across =
            Ray { t_max: 2.0 * contacts.reach, ..Ray::new(position - normal * contacts.reach, normal) };
        self.intersect_all(&across, crossings);
        let mut members: ArrayVec<Member, MOST_TOGETHER> = ArrayVec::new();
        let mut has_room = true;
        for other in crossings.hits() {
            let mut there = self.plain_interaction(&across, other);
            let along = there.point.normal.dot(normal);
            let height = (there.point.position - position).dot(normal);
            if along.abs() < SAME_PLANE || height.abs() > offset + there.point.offset {
                continue;
            }
            // Set as for the original ray, because these hits come from a segment across the surface.
            there.wo = found.wo;
            there.distance = found.distance;
            there.retreat = found.retreat;
            if there.is_front() != (found.is_front() == (along > 0.0)) {
                // For grazing rays, rounding decides on which side of each normal the ray is; all surfaces get the side of the original
                // hit.
                there.point.normal = normal * along.signum();
                there.shading_normal = there.point.normal;
            }
            has_room &= members.try_push(Member { found: there, raw: *other, height }).is_ok();
        }
        // The ray's own hit, which the segment across may place outside of its triangle by rounding.
        let is_own = |member: &Member| {
            (member.raw.geometry, member.raw.instance) == (raw.geometry, raw.instance)
                && member.found.is_front() == found.is_front()
        };
        match members.iter_mut().filter(|member| is_own(member)).min_by(|a, b| {
            let is_other = |member: &Member| member.raw.primitive != raw.primitive;
            is_other(a).cmp(&is_other(b)).then(a.height.abs().total_cmp(&b.height.abs()))
        }) {
            Some(own) => *own = Member { found, raw: *raw, height: 0.0 },
            None => has_room &= members.try_push(Member { found, raw: *raw, height: 0.0 }).is_ok(),
        }
        if members.len() < 2 {
            return (found, *raw);
        }
        let first = members.iter().min_by_key(|member| self.order_of(member));
        let Some(first) = first else { return (found, *raw) };
        let (mut chosen, chosen_raw, at) = (first.found, first.raw, first.height);
        chosen.borders = self.borders_of(&members, has_room);
        // Far enough to be beyond all of them, on either side.
        let clear = members.iter().map(|member| (member.height - at).abs() + member.found.point.offset);
        chosen.point.offset = clear.fold(chosen.point.offset, f32::max);
        (chosen, chosen_raw)
    }

    /// Order of surfaces at one place. First come the surfaces that bound no media; among these, emitters that shine to this side come
    /// first and those that shine only to the other side last, otherwise in the order of the file. Then follow the interfaces; first the
    /// one whose medium displaces the others.
    fn order_of(&self, member: &Member) -> (u32, u32, u32, u32) {
        let hit = &member.found;
        let rank = match self.material(hit).media() {
            None => {
                let by_light = match self.surface(hit).light.map(|id| &self.lights()[id as usize]) {
                    Some(Light::Area(light)) if light.emitted(hit.is_front()) == Rgb::ZERO => 2,
                    Some(_) => 0,
                    None => 1,
                };
                return (0, by_light, hit.surface, hit.primitive);
            }
            Some(bounded) => bounded.into_iter().filter(|&id| id != AIR).map(|id| self.medium(id).rank),
        };
        (1, rank.min().unwrap_or(u32::MAX), hit.surface, hit.primitive)
    }

    /// All interfaces among the members; interfaces of bodies that the ray leaves come before those of bodies that it enters.
    fn borders_of(&self, members: &[Member], has_room: bool) -> Borders {
        let mut borders = Borders { is_full: !has_room, ..Borders::default() };
        for leaving in [true, false] {
            for member in members {
                let hit = &member.found;
                let Some([inside, outside]) = self.material(hit).media() else { continue };
                let (near, far) = if hit.is_front() { (outside, inside) } else { (inside, outside) };
                // An interface between a body and air is either left or entered; an interface that names two media counts as left.
                if (near != AIR) == leaving {
                    borders.push(near, far);
                }
            }
        }
        borders
    }
}

/// Smallest cosine between the normals of coinciding surfaces; surfaces at larger angles have an order along the ray.
const SAME_PLANE: f32 = 0.5;
