//! Patches and links: first patches, uniform division, and division where one form factor is not enough.

use super::form_factor::FormFactors;
use super::lights::irradiance_by_lights;
use super::links::{Link, Rows, State, pull_optics};
use super::model::{Model, NONE, Optics, may_exchange};
use super::{Exchange, RadiosityError, RadiosityOptions};
use crate::observer::Observer;
use rayon::prelude::*;
use std::collections::BinaryHeap;

/// Most links for each patch.
pub(super) const LINKS_PER_PATCH: usize = 24;

/// Smallest patch, as a share of the mean area that the bound on their number allows: in corners form factors vary without end.
const SMALLEST: f64 = 1.0 / 256.0;

/// The first threshold on the error of a link, as a share of all light; it is halved until there are as many patches as allowed, or until
/// it is below the last one.
const FIRST_THRESHOLD: f64 = 0.01;
const LAST_THRESHOLD: f64 = 1e-9;

/// A hierarchy of patches with the links between them.
pub(super) struct Hierarchy<'a> {
    pub(super) factors: FormFactors<'a>,
    pub(super) options: &'a RadiosityOptions,
    pub(super) model: Model,
    pub(super) state: State,
    pub(super) links: Vec<Link>,
    /// Number of patches.
    pub(super) leaves: usize,
    /// Form factors that were computed.
    pub(super) computed: u64,
    pub(super) sweeps: u32,
    smallest: f64,
}

impl<'a> Hierarchy<'a> {
    pub(super) fn new(factors: FormFactors<'a>, options: &'a RadiosityOptions, model: Model) -> Self {
        let total: f64 = model.elements.iter().take(model.roots as usize).map(|root| root.area).sum();
        let leaves = model.leaves();
        let mut all = Self {
            factors,
            options,
            model,
            state: State::default(),
            links: Vec::new(),
            leaves,
            computed: 0,
            sweeps: 0,
            smallest: SMALLEST * total / options.patches.max(1) as f64,
        };
        all.complete();
        all
    }

    /// Evaluates the elements that were added.
    fn complete(&mut self) {
        let Self { model, state, factors, .. } = self;
        let known = state.optics.len();
        let added = &model.elements[known..];
        let optics: Vec<Optics> =
            added.par_iter().map(|element| model.optics(factors.scene, element)).collect();
        state.optics.extend(optics);
        let lights: Vec<_> = (known..model.elements.len())
            .into_par_iter()
            .map(|index| irradiance_by_lights(factors.scene, model, index as u32, factors.seed))
            .collect();
        state.lights.extend(lights);
        for index in known..model.elements.len() {
            let Optics { reflectance, emission } = state.optics[index];
            let parent = model.elements[index].parent;
            // The radiosity of the whole is the best that is known of a part.
            let radiosity = match parent {
                NONE => (emission + reflectance * state.lights[index].0).as_dvec3(),
                parent => state.radiosity[parent as usize],
            };
            state.radiosity.push(radiosity);
            state.received.push(glam::DVec3::ZERO);
        }
    }

    /// Computes reflectances, emission and the light of sources without a surface again.
    pub(super) fn evaluate(&mut self) {
        self.state = State::default();
        self.complete();
    }

    /// Divides the largest patches until there are as many as allowed.
    pub(super) fn divide_uniformly(&mut self) {
        let key = |model: &Model, index: u32| {
            (model.elements[index as usize].area.to_bits(), std::cmp::Reverse(index))
        };
        let mut heap: BinaryHeap<_> = (0..self.model.roots).map(|root| key(&self.model, root)).collect();
        while self.leaves + 3 <= self.options.patches {
            let Some((_, std::cmp::Reverse(index))) = heap.pop() else { break };
            let first = self.model.divide(index);
            self.leaves += 3;
            heap.extend((first..first + 4).map(|child| key(&self.model, child)));
        }
        self.complete();
    }

    /// Links between all pairs of patches: the matrix of form factors, of which the lower half is the upper one.
    pub(super) fn link_all(&mut self, observer: &dyn Observer) -> Result<(), RadiosityError> {
        let leaves: Vec<u32> = (0..self.model.elements.len() as u32)
            .filter(|&index| self.model.elements[index as usize].children == NONE)
            .collect();
        self.link(&leaves, observer)
    }

    /// Links between all pairs of `elements`.
    fn link(&mut self, elements: &[u32], observer: &dyn Observer) -> Result<(), RadiosityError> {
        /// Rows that are computed before the progress is shown.
        const ROWS: usize = 64;
        observer.begin("computing form factors", elements.len() as u64);
        let indices: Vec<usize> = (0..elements.len()).collect();
        for rows in indices.chunks(ROWS) {
            if observer.is_cancelled() {
                return Err(RadiosityError::Stopped);
            }
            let found: Vec<Vec<Link>> = rows
                .par_iter()
                .with_max_len(1)
                .map(|&row| {
                    let others = elements[row..].iter();
                    others.filter_map(|&other| self.found(elements[row], other)).collect()
                })
                .collect();
            self.computed += found.iter().map(|row| row.len() as u64).sum::<u64>();
            self.links.extend(found.into_iter().flatten());
            observer.advance(rows.last().map_or(0, |&row| row as u64 + 1));
        }
        Ok(())
    }

    /// The link between two elements; `None` where they cannot exchange light.
    fn found(&self, a: u32, b: u32) -> Option<Link> {
        let optics = [a, b].map(|end| &self.state.optics[end as usize]);
        if !may_exchange(optics) {
            return None;
        }
        let Exchange { exchange, error, seen, spread } = self.factors.between(&self.model, a, b);
        (spread[0] > 0.0 || spread[1] > 0.0 || exchange > 0.0).then_some(Link {
            ends: [a, b],
            exchange: exchange as f32,
            error: error as f32,
            seen: seen as f32,
            spread: spread.map(|spread| spread as f32),
        })
    }

    /// Links first patches, and divides links and patches where an error in the radiosity of a patch is largest, until there are as many
    /// patches as allowed.
    pub(super) fn refine(&mut self, observer: &dyn Observer) -> Result<(), RadiosityError> {
        let roots: Vec<u32> = (0..self.model.roots).collect();
        self.link(&roots, observer)?;
        let all = self.all_light();
        let mut threshold = FIRST_THRESHOLD;
        observer.begin("refining patches", self.options.patches as u64);
        while threshold > LAST_THRESHOLD && all > 0.0 {
            while self.refine_once(threshold * all)? {
                if observer.is_cancelled() {
                    return Err(RadiosityError::Stopped);
                }
                observer.advance(self.leaves as u64);
            }
            self.solve()?;
            // Where no patch may be added, links to smaller patches still make the solution better.
            if self.links.len() > self.most_links() {
                break;
            }
            threshold *= 0.5;
        }
        Ok(())
    }

    /// Light that leaves surfaces for the first time, brightest channel: emission, and what they reflect of other light sources.
    fn all_light(&self) -> f64 {
        let roots = &self.model.elements[..self.model.roots as usize];
        let of = |(index, element): (usize, &super::model::Element)| {
            let Optics { reflectance, emission } = self.state.optics[index];
            (emission + reflectance * self.state.lights[index].0).as_dvec3() * element.area
        };
        roots.iter().enumerate().map(of).sum::<glam::DVec3>().max_element()
    }

    fn most_links(&self) -> usize {
        LINKS_PER_PATCH * self.options.patches.max(self.model.roots as usize)
    }

    /// Solves over the present links.
    pub(super) fn solve(&mut self) -> Result<(), RadiosityError> {
        let rows = Rows::new(&self.model, &self.links);
        let sweeps = rows.solve(&self.model, &mut self.state, self.options.tolerance);
        self.sweeps = self.sweeps.saturating_add(sweeps.ok_or(RadiosityError::Diverges)?);
        Ok(())
    }

    /// Error that a link may leave in the light of its two ends, brightest channel: what each receives, and how much that varies over it.
    fn errors(&self, link: &Link) -> [f64; 2] {
        let one = |to: usize| {
            let (end, from) = (link.ends[to] as usize, link.ends[1 - to] as usize);
            let reflected = self.state.optics[end].reflectance.as_dvec3() * self.state.radiosity[from];
            reflected.max_element() * self.model.elements[end].area * f64::from(link.spread[to])
        };
        [one(0), one(1)]
    }

    /// Divides all links with an error above `threshold`, and patches on which the light of sources without a surface varies as much;
    /// the worst come first. Returns whether anything was divided.
    fn refine_once(&mut self, threshold: f64) -> Result<bool, RadiosityError> {
        /// A patch, or a link by its number.
        enum Wanted {
            Patch(u32),
            Link(usize, [f64; 2]),
        }
        let mut wanted: Vec<(f64, Wanted)> = self
            .links
            .par_iter()
            .enumerate()
            .filter_map(|(number, link)| {
                let errors = self.errors(link);
                let worst = errors[0].max(errors[1]);
                (worst > threshold).then_some((worst, Wanted::Link(number, errors)))
            })
            .collect();
        for (index, element) in self.model.elements.iter().enumerate() {
            if element.children == NONE {
                let varies = self.state.optics[index].reflectance * self.state.lights[index].1;
                let error = f64::from(varies.max_element()) * element.area;
                if error > threshold {
                    wanted.push((error, Wanted::Patch(index as u32)));
                }
            }
        }
        // Stable, so that the order of equal errors is that of the links.
        wanted.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut pairs = Vec::new();
        let mut gone = vec![false; self.links.len()];
        let most_links = self.most_links();
        for (_, wanted) in wanted {
            if self.links.len() + pairs.len() > most_links {
                break;
            }
            match wanted {
                Wanted::Patch(index) => {
                    self.quarters(index);
                }
                Wanted::Link(number, errors) => {
                    let ends = self.links[number].ends;
                    let first = if errors[0] >= errors[1] { 0 } else { 1 };
                    // The other end may be divided where this one cannot.
                    let order = [first, 1 - first].into_iter().filter(|&end| errors[end] > threshold);
                    let divided = order
                        .chain([1 - first])
                        .find_map(|end| self.quarters(ends[end]).map(|children| (end, children)));
                    let Some((end, children)) = divided else { continue };
                    gone[number] = true;
                    let quarters = children..children + 4;
                    if ends[0] == ends[1] {
                        let both = quarters.clone().flat_map(|a| (a..children + 4).map(move |b| (a, b)));
                        pairs.extend(both);
                    } else {
                        pairs.extend(quarters.map(|quarter| (quarter, ends[1 - end])));
                    }
                }
            }
        }
        let grown = self.state.optics.len() < self.model.elements.len();
        if pairs.is_empty() && !grown {
            return Ok(false);
        }
        self.complete();
        pull_optics(&self.model, &mut self.state.optics);
        let found: Vec<Option<Link>> = pairs.par_iter().map(|&(a, b)| self.found(a, b)).collect();
        self.computed += pairs.len() as u64;
        let mut numbers = gone.iter();
        self.links.retain(|_| !numbers.next().copied().unwrap_or(false));
        self.links.extend(found.into_iter().flatten());
        Ok(true)
    }

    /// The first quarter of an element, which is divided now where there is room for more patches; `None` where there is none.
    fn quarters(&mut self, index: u32) -> Option<u32> {
        let element = &self.model.elements[index as usize];
        if element.children != NONE {
            return Some(element.children);
        }
        if element.area < 4.0 * self.smallest || self.leaves + 3 > self.options.patches {
            return None;
        }
        self.leaves += 3;
        Some(self.model.divide(index))
    }
}
