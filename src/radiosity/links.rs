//! Exchanges between elements at several levels, and the solution of the radiosity equations over them.

use super::form_factor::factor_from;
use super::model::{Model, NONE, Optics};
use crate::math::Rgb;
use glam::DVec3;

/// An exchange between two elements that are far enough from each other, or small enough, for a single form factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Link {
    /// The elements.
    pub(super) ends: [u32; 2],
    /// See [`super::Exchange`].
    pub(super) exchange: f32,
    pub(super) error: f32,
    pub(super) seen: f32,
    pub(super) spread: [f32; 2],
}

/// What is known of every element.
#[derive(Clone, Debug, Default)]
pub(super) struct State {
    pub(super) optics: Vec<Optics>,
    /// Irradiance by light sources without a surface, and how much it varies over the element.
    pub(super) lights: Vec<(Rgb, Rgb)>,
    /// Radiosity (radiant exitance), W/m^2 times the power factor of render space.
    pub(super) radiosity: Vec<DVec3>,
    /// Irradiance from surfaces; of patches that are not divided, all of it.
    pub(super) received: Vec<DVec3>,
}

/// For each element, the elements from which it receives light, with form factors.
#[derive(Debug)]
pub(super) struct Rows {
    starts: Vec<usize>,
    entries: Vec<(u32, f32)>,
    /// By entry: the share of the light that nothing stops.
    seen: Vec<f32>,
    /// Elements of each first patch in the order of their creation, one first patch after the other.
    members: Vec<u32>,
    member_starts: Vec<usize>,
}

impl Rows {
    pub(super) fn new(model: &Model, links: &[Link]) -> Self {
        let count = model.elements.len();
        let mut starts = vec![0usize; count + 1];
        let directed = || {
            links.iter().filter(|link| link.exchange > 0.0).flat_map(|link| {
                let [a, b] = link.ends;
                let there = [(a, b, link), (b, a, link)];
                // A concave element sends light to itself once.
                there.into_iter().take(if a == b { 1 } else { 2 })
            })
        };
        directed().for_each(|(to, ..)| starts[to as usize + 1] += 1);
        for i in 0..count {
            starts[i + 1] += starts[i];
        }
        let mut entries = vec![(0, 0.0); starts[count]];
        let mut seen = vec![0.0; starts[count]];
        let mut next = starts.clone();
        for (to, from, link) in directed() {
            let area = model.elements[to as usize].area;
            entries[next[to as usize]] = (from, (f64::from(link.exchange) / area) as f32);
            seen[next[to as usize]] = link.seen;
            next[to as usize] += 1;
        }
        let roots = model.roots as usize;
        let mut member_starts = vec![0usize; roots + 1];
        model.elements.iter().for_each(|element| member_starts[element.root as usize + 1] += 1);
        for i in 0..roots {
            member_starts[i + 1] += member_starts[i];
        }
        let mut members = vec![0; count];
        let mut next = member_starts.clone();
        for (index, element) in model.elements.iter().enumerate() {
            members[next[element.root as usize]] = index as u32;
            next[element.root as usize] += 1;
        }
        Self { starts, entries, seen, members, member_starts }
    }

    fn members(&self, root: u32) -> &[u32] {
        &self.members[self.member_starts[root as usize]..self.member_starts[root as usize + 1]]
    }

    /// Irradiance of an element by its own links, where elements have the exitance `source`.
    fn gather(&self, element: u32, source: &[DVec3]) -> DVec3 {
        let entries = &self.entries[self.starts[element as usize]..self.starts[element as usize + 1]];
        entries.iter().map(|&(from, factor)| source[from as usize] * f64::from(factor)).sum()
    }

    /// Irradiance of all elements: by their own links and by those of the elements that they are part of.
    pub(super) fn irradiance(&self, model: &Model, source: &[DVec3]) -> Vec<DVec3> {
        let mut found = vec![DVec3::ZERO; model.elements.len()];
        for index in 0..model.elements.len() {
            let parent = model.elements[index].parent;
            let above = if parent == NONE { DVec3::ZERO } else { found[parent as usize] };
            found[index] = above + self.gather(index as u32, source);
        }
        found
    }

    /// Irradiance at a point of an element by its own links, for each of two exitances of all elements. Form factors are those of the
    /// point; what stands in the way is known from the links.
    pub(super) fn at_point(
        &self,
        model: &Model,
        element: u32,
        (position, normal): (DVec3, DVec3),
        sources: [&[DVec3]; 2],
    ) -> [DVec3; 2] {
        let mut sum = [DVec3::ZERO; 2];
        let range = self.starts[element as usize]..self.starts[element as usize + 1];
        for (&(from, _), &seen) in self.entries[range.clone()].iter().zip(&self.seen[range]) {
            let factor =
                factor_from(model, &model.elements[from as usize], position, normal) * f64::from(seen);
            sum[0] += sources[0][from as usize] * factor;
            sum[1] += sources[1][from as usize] * factor;
        }
        sum
    }

    /// Sums of the form factors from all elements: the share of the light that an element sends out which other elements receive.
    pub(super) fn sums(&self, model: &Model) -> Vec<f64> {
        let ones = vec![DVec3::ONE; model.elements.len()];
        self.irradiance(model, &ones).into_iter().map(|sum| sum.x).collect()
    }

    /// Gauss-Seidel gathering: each first patch gathers over the links of all its elements, pushes what arrives down to its patches, and
    /// pulls their radiosity up, before the next one gathers (Hanrahan, Salzman & Aupperle 1991). Returns the number of sweeps; `None`
    /// where the solution does not settle.
    pub(super) fn solve(&self, model: &Model, state: &mut State, tolerance: f64) -> Option<u32> {
        /// Enough for a mean reflectance of 0.997.
        const MOST_SWEEPS: u32 = 4000;
        for sweep in 1..=MOST_SWEEPS {
            let (mut change, mut largest) = (0.0f64, 0.0f64);
            for root in 0..model.roots {
                let before = state.radiosity[root as usize];
                for &index in self.members(root) {
                    let parent = model.elements[index as usize].parent;
                    let above = if parent == NONE { DVec3::ZERO } else { state.received[parent as usize] };
                    state.received[index as usize] = above + self.gather(index, &state.radiosity);
                }
                for &index in self.members(root).iter().rev() {
                    pull(model, state, index);
                }
                let after = state.radiosity[root as usize];
                change = change.max((after - before).abs().max_element());
                largest = largest.max(after.max_element());
            }
            if !largest.is_finite() {
                return None;
            }
            if change <= tolerance * largest {
                return Some(sweep);
            }
        }
        None
    }
}

/// Radiosity of an element: of a patch from what it receives, of a divided element the mean of its quarters.
pub(super) fn pull(model: &Model, state: &mut State, index: u32) {
    let i = index as usize;
    let first = model.elements[i].children;
    state.radiosity[i] = if first == NONE {
        let Optics { reflectance, emission } = state.optics[i];
        let arriving = state.received[i] + state.lights[i].0.as_dvec3();
        emission.as_dvec3() + reflectance.as_dvec3() * arriving
    } else {
        let quarters = &state.radiosity[first as usize..first as usize + 4];
        quarters.iter().sum::<DVec3>() * 0.25
    };
}

/// Makes reflectance and emission of divided elements the means of their quarters.
pub(super) fn pull_optics(model: &Model, optics: &mut [Optics]) {
    for index in (0..model.elements.len()).rev() {
        let first = model.elements[index].children;
        if first == NONE {
            continue;
        }
        let mut sum = Optics::default();
        for quarter in &optics[first as usize..first as usize + 4] {
            sum.reflectance += quarter.reflectance;
            sum.emission += quarter.emission;
        }
        optics[index] = Optics { reflectance: sum.reflectance * 0.25, emission: sum.emission * 0.25 };
    }
}
