//! Illumination maps: irradiance accumulated over the surface of an object with coordinates (Arvo 1986; Jensen &
//! Christensen 1995, section 3.2), instead of stored photons.
//!
//! There are two levels. The map of *diffuse illumination* has few elements, since only gather rays read it. Each of
//! its elements that a caustic reaches gets a small map of the *caustic*, fine enough to be visible. Each side of a
//! surface has its own maps.

use super::{Photon, PhotonClass};
use crate::math::Rgb;
use crate::scene::{IlluminatedShape, IlluminationKernel, Scene};
use crate::shapes::Chart;
use glam::{DVec2, DVec3, Vec3};
use std::collections::HashMap;
use std::sync::Arc;

/// A photon and the surface where it arrived.
#[derive(Clone, Copy, Debug)]
pub struct Deposit {
    /// Index in [`Scene::surfaces`].
    pub surface: u32,
    /// The photon.
    pub photon: Photon,
}

/// Separates the photons that arrived at surfaces with illumination maps from the others. `surfaces` holds the surface
/// of each photon, or is empty where no surface has a map.
pub fn split_deposits(photons: Vec<Photon>, surfaces: &[u32], scene: &Scene) -> (Vec<Photon>, Vec<Deposit>) {
    if surfaces.is_empty() {
        return (photons, Vec::new());
    }
    let (mut kept, mut deposits) = (Vec::new(), Vec::new());
    for (photon, &surface) in photons.into_iter().zip(surfaces) {
        match scene.surfaces()[surface as usize].illumination {
            Some(_) => deposits.push(Deposit { surface, photon }),
            None => kept.push(photon),
        }
    }
    kept.shrink_to_fit();
    (kept, deposits)
}

/// Photons for each element of diffuse illumination, mean over the surface: the irradiance that a gather ray reads has
/// 18 % noise.
const PHOTONS_PER_ELEMENT: f64 = 32.0;

/// Least and largest number of elements on a surface.
const FEWEST: f64 = 16.0;
const MOST: f64 = 4_194_304.0;

/// Elements of a caustic map along one side of an element of diffuse illumination: the number where no pixel shows the
/// surface ("25 to 100 times" as many in all, section 3.2), and the largest number.
const UNSEEN_REFINEMENT: u32 = 5;
const FINEST_REFINEMENT: u32 = 64;

/// Sizes of the illumination maps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct IlluminationSizes {
    /// Surfaces that have a map.
    pub surfaces: u64,
    /// Photons accumulated.
    pub photons: u64,
    /// Elements of diffuse illumination, of lit sides only.
    pub elements: u64,
    /// Elements of the caustic maps if every element had one.
    pub caustic_elements_everywhere: u64,
    /// Elements of the caustic maps.
    pub caustic_elements: u64,
    /// Memory in bytes.
    pub bytes: u64,
}

/// The illumination maps of a scene. Immutable; irradiance in render units.
#[derive(Debug)]
pub struct IlluminationMaps {
    /// By surface.
    maps: Vec<Option<SurfaceMap>>,
    sizes: IlluminationSizes,
}

#[derive(Debug)]
struct SurfaceMap {
    shape: Arc<IlluminatedShape>,
    /// By chart, front and back; `None` where no photon arrived.
    grids: Vec<[Option<Grid>; 2]>,
}

/// Elements over one chart, on one side of it.
#[derive(Debug)]
struct Grid {
    across: u32,
    down: u32,
    goes_round: bool,
    kernel: IlluminationKernel,
    /// Elements of a caustic map along one side.
    refinement: u32,
    /// By element: all light except caustics.
    diffuse: Vec<Rgb>,
    /// By element: all light, with the mean of the caustics.
    all: Vec<Rgb>,
    /// By element: number of its caustic map, or [`NO_MAP`].
    small: Vec<u32>,
    /// Elements of caustic maps, one map after the other.
    caustic: Vec<Rgb>,
}

const NO_MAP: u32 = u32::MAX;

/// The elements that a place belongs to with their weights, and their number: one for the box.
type Weights = ([(u32, u32, f64); 4], usize);

/// Weights of `place` in `[0, 1]^2` over a grid of `across` by `down` elements. Where the kernel extends over the edge
/// of the surface, the element at the edge gets that share: no flux is lost, and uniform light stays uniform.
fn weights(place: DVec2, across: u32, down: u32, goes_round: bool, kernel: IlluminationKernel) -> Weights {
    let at = place * DVec2::new(f64::from(across), f64::from(down));
    if kernel == IlluminationKernel::Box {
        let cell = ((at.x as u32).min(across - 1), (at.y as u32).min(down - 1), 1.0);
        return ([cell; 4], 1);
    }
    let low = (at - 0.5).floor();
    let share = at - 0.5 - low;
    let column = |i: f64| {
        let last = f64::from(across);
        if goes_round { i.rem_euclid(last) as u32 } else { i.clamp(0.0, last - 1.0) as u32 }
    };
    let row = |j: f64| j.clamp(0.0, f64::from(down) - 1.0) as u32;
    let (x0, x1, y0, y1) = (column(low.x), column(low.x + 1.0), row(low.y), row(low.y + 1.0));
    let all = [
        (x0, y0, (1.0 - share.x) * (1.0 - share.y)),
        (x1, y0, share.x * (1.0 - share.y)),
        (x0, y1, (1.0 - share.x) * share.y),
        (x1, y1, share.x * share.y),
    ];
    (all, 4)
}

/// Accumulators for photons, in `f64` and in the order of the photons.
struct Filling {
    across: u32,
    down: u32,
    refinement: u32,
    diffuse: Vec<DVec3>,
    small: Vec<u32>,
    caustic: Vec<DVec3>,
}

impl Filling {
    fn new(across: u32, down: u32, refinement: u32) -> Self {
        let count = across as usize * down as usize;
        Self {
            across,
            down,
            refinement,
            diffuse: vec![DVec3::ZERO; count],
            small: vec![NO_MAP; count],
            caustic: Vec::new(),
        }
    }

    fn add_diffuse(&mut self, (x, y): (u32, u32), power: DVec3) {
        self.diffuse[(y * self.across + x) as usize] += power;
    }

    /// Adds to element `(x, y)` of all caustic maps side by side; creates the map it belongs to.
    fn add_caustic(&mut self, (x, y): (u32, u32), power: DVec3) {
        let k = self.refinement;
        let element = (y / k * self.across + x / k) as usize;
        let each = (k * k) as usize;
        if self.small[element] == NO_MAP {
            self.small[element] = (self.caustic.len() / each) as u32;
            self.caustic.resize(self.caustic.len() + each, DVec3::ZERO);
        }
        let inside = (y % k * k + x % k) as usize;
        self.caustic[self.small[element] as usize * each + inside] += power;
    }
}

impl Grid {
    /// Converts flux to irradiance by the area of the chart and the number of emitted photons.
    fn finish(filling: Filling, chart: &Chart, kernel: IlluminationKernel, emitted: [u64; 2]) -> Self {
        let Filling { across, down, refinement, diffuse, small, caustic } = filling;
        let each = (refinement * refinement) as usize;
        let elements = f64::from(across) * f64::from(down);
        let per = |emitted: u64, count: f64| {
            if emitted > 0 { count / (chart.area() * emitted as f64) } else { 0.0 }
        };
        let (by_element, by_small) = (per(emitted[0], elements), per(emitted[1], elements * each as f64));
        let mean_caustic = |map: u32| match map {
            NO_MAP => DVec3::ZERO,
            map => {
                let sum: DVec3 = caustic[map as usize * each..][..each].iter().sum();
                sum * (by_small / each as f64)
            }
        };
        let all = diffuse.iter().zip(&small);
        let all = all.map(|(&flux, &map)| (flux * by_element + mean_caustic(map)).as_vec3()).collect();
        Self {
            across,
            down,
            goes_round: chart.goes_round(),
            kernel,
            refinement,
            all,
            diffuse: diffuse.iter().map(|&flux| (flux * by_element).as_vec3()).collect(),
            small,
            caustic: caustic.iter().map(|&flux| (flux * by_small).as_vec3()).collect(),
        }
    }

    fn read(&self, place: DVec2, values: &[Rgb]) -> Rgb {
        let (at, count) = weights(place, self.across, self.down, self.goes_round, self.kernel);
        let value =
            |&(x, y, weight): &(u32, u32, f64)| values[(y * self.across + x) as usize] * weight as f32;
        at[..count].iter().map(value).sum()
    }

    fn read_caustic(&self, place: DVec2) -> Rgb {
        if self.caustic.is_empty() {
            return Rgb::ZERO;
        }
        let k = self.refinement;
        let (at, count) = weights(place, self.across * k, self.down * k, self.goes_round, self.kernel);
        let value = |&(x, y, weight): &(u32, u32, f64)| {
            let map = self.small[(y / k * self.across + x / k) as usize];
            if map == NO_MAP {
                return Rgb::ZERO;
            }
            let inside = map as usize * (k * k) as usize + (y % k * k + x % k) as usize;
            self.caustic[inside] * weight as f32
        };
        at[..count].iter().map(value).sum()
    }

    fn bytes(&self) -> usize {
        (self.diffuse.capacity() + self.all.capacity() + self.caustic.capacity()) * size_of::<Rgb>()
            + self.small.capacity() * size_of::<u32>()
    }
}

/// Number of elements along both coordinates of a chart for about `count` in total, as square as possible.
fn divide(chart: &Chart, count: f64) -> (u32, u32) {
    let lengths = chart.lengths();
    let across = (count * lengths.x / lengths.y).sqrt().round().clamp(1.0, MOST);
    let down = (count / across).round().clamp(1.0, MOST);
    (across as u32, down as u32)
}

/// Elements of a caustic map along one side of an element of diffuse illumination, so that none is larger than
/// `finest`, the smallest distance between the places on the surface that adjacent pixels show.
fn refine(chart: &Chart, (across, down): (u32, u32), finest: f32) -> u32 {
    if !(finest > 0.0 && finest.is_finite()) {
        return UNSEEN_REFINEMENT;
    }
    let lengths = chart.lengths();
    let side = (lengths.x / f64::from(across)).max(lengths.y / f64::from(down));
    (side / f64::from(finest)).ceil().clamp(1.0, f64::from(FINEST_REFINEMENT)) as u32
}

/// The chart of a place with this normal: the nearest of those that face along the normal.
fn chart_at(charts: &[Chart], position: DVec3, normal: DVec3) -> usize {
    if charts.len() == 1 {
        return 0;
    }
    let key = |chart: &Chart| {
        let facing = chart.normal(position).dot(normal).abs();
        (facing < 0.7, chart.distance(position))
    };
    let by_key =
        |a: &(usize, (bool, f64)), b: &(usize, (bool, f64))| a.1.0.cmp(&b.1.0).then(a.1.1.total_cmp(&b.1.1));
    charts.iter().map(key).enumerate().min_by(by_key).map_or(0, |(index, _)| index)
}

/// Chart, side and coordinates of a photon or a look-up on a surface.
fn place_on(shape: &IlluminatedShape, position: Vec3, normal: Vec3) -> (usize, usize, DVec2) {
    let (position, normal) = (position.as_dvec3(), normal.as_dvec3());
    let index = chart_at(&shape.charts, position, normal);
    let chart = &shape.charts[index];
    let is_back = chart.normal(position).dot(normal) < 0.0;
    (index, usize::from(is_back), chart.locate(position))
}

impl IlluminationMaps {
    /// Builds the maps from the photons `global` and `caustic` of the two passes, each with the number emitted. If
    /// there is a caustic pass, caustic photons of the global pass are left out, because they represent the same light.
    ///
    /// `finest` is, by surface, the smallest distance between the places that adjacent pixels show of it, in render
    /// space. It is infinite for surfaces that are not visible, and the slice may be empty. The sums follow the order
    /// of the photons, so the maps are a function of the passes alone.
    pub fn build(
        scene: &Scene,
        global: (&[Deposit], u64),
        caustic: Option<(&[Deposit], u64)>,
        finest: &[f32],
    ) -> Self {
        let surfaces = scene.surfaces();
        let mut received = vec![0u64; surfaces.len()];
        let counted =
            if global.0.is_empty() { caustic.map_or(&[][..], |(deposits, _)| deposits) } else { global.0 };
        for deposit in counted {
            received[deposit.surface as usize] += 1;
        }
        let mut fillings: HashMap<(u32, usize, usize), Filling> = HashMap::new();
        let mut add = |deposit: &Deposit, is_fine: bool| {
            let Some(shape) = &surfaces[deposit.surface as usize].illumination else { return };
            let photon = &deposit.photon;
            let (index, side, place) = place_on(shape, photon.position, photon.normal());
            let chart = &shape.charts[index];
            let filling = fillings.entry((deposit.surface, index, side)).or_insert_with(|| {
                let whole: f64 = shape.charts.iter().map(Chart::area).sum();
                let by_light = received[deposit.surface as usize] as f64 / PHOTONS_PER_ELEMENT;
                let count = shape.elements.map_or(by_light, f64::from).clamp(FEWEST, MOST);
                let (across, down) = divide(chart, count * chart.area() / whole);
                let seen = finest.get(deposit.surface as usize).copied().unwrap_or(f32::INFINITY);
                let refinement = shape.refinement.unwrap_or_else(|| refine(chart, (across, down), seen));
                Filling::new(across, down, refinement)
            });
            let k = if is_fine { filling.refinement } else { 1 };
            let (at, count) =
                weights(place, filling.across * k, filling.down * k, chart.goes_round(), shape.kernel);
            let power = photon.power().as_dvec3();
            for &(x, y, weight) in at[..count].iter().filter(|(_, _, weight)| *weight > 0.0) {
                match is_fine {
                    true => filling.add_caustic((x, y), power * weight),
                    false => filling.add_diffuse((x, y), power * weight),
                }
            }
        };
        for deposit in global.0 {
            if caustic.is_none() || deposit.photon.class() != PhotonClass::Caustic {
                add(deposit, false);
            }
        }
        for deposit in caustic.map_or(&[][..], |(deposits, _)| deposits) {
            add(deposit, true);
        }
        let emitted = [global.1, caustic.map_or(0, |(_, emitted)| emitted)];
        let mut maps: Vec<Option<SurfaceMap>> = surfaces
            .iter()
            .map(|surface| {
                let shape = surface.illumination.clone()?;
                let grids = shape.charts.iter().map(|_| [None, None]).collect();
                Some(SurfaceMap { shape, grids })
            })
            .collect();
        let mut sizes = IlluminationSizes {
            surfaces: maps.iter().flatten().count() as u64,
            photons: (global.0.len() + caustic.map_or(0, |(deposits, _)| deposits.len())) as u64,
            ..IlluminationSizes::default()
        };
        let mut keys: Vec<(u32, usize, usize)> = fillings.keys().copied().collect();
        keys.sort_unstable();
        for key @ (surface, index, side) in keys {
            let (Some(map), Some(filling)) = (&mut maps[surface as usize], fillings.remove(&key)) else {
                continue;
            };
            let grid = Grid::finish(filling, &map.shape.charts[index], map.shape.kernel, emitted);
            let each = u64::from(grid.refinement).pow(2);
            sizes.elements += grid.diffuse.len() as u64;
            sizes.caustic_elements_everywhere += grid.diffuse.len() as u64 * each;
            sizes.caustic_elements += grid.caustic.len() as u64;
            sizes.bytes += grid.bytes() as u64;
            map.grids[index][side] = Some(grid);
        }
        Self { maps, sizes }
    }

    /// Sizes of the maps.
    pub fn sizes(&self) -> IlluminationSizes {
        self.sizes
    }

    fn at(
        &self,
        surface: u32,
        position: Vec3,
        normal: Vec3,
        read: impl Fn(&Grid, DVec2) -> Rgb,
    ) -> Option<Rgb> {
        let map = self.maps.get(surface as usize)?.as_ref()?;
        let (index, side, place) = place_on(&map.shape, position, normal);
        Some(map.grids[index][side].as_ref().map_or(Rgb::ZERO, |grid| read(grid, place)))
    }

    /// Irradiance from caustics at a place of `surface`, on the side of the unit `normal`: W/m^2 times the power factor
    /// of render space, cosine included. `None` where the surface has no illumination map.
    pub fn caustic(&self, surface: u32, position: Vec3, normal: Vec3) -> Option<Rgb> {
        self.at(surface, position, normal, Grid::read_caustic)
    }

    /// Irradiance from all light, at the resolution of diffuse illumination; otherwise as [`Self::caustic`].
    pub fn all(&self, surface: u32, position: Vec3, normal: Vec3) -> Option<Rgb> {
        self.at(surface, position, normal, |grid, place| grid.read(place, &grid.all))
    }

    /// Irradiance from all light except caustics; otherwise as [`Self::caustic`].
    pub fn diffuse(&self, surface: u32, position: Vec3, normal: Vec3) -> Option<Rgb> {
        self.at(surface, position, normal, |grid, place| grid.read(place, &grid.diffuse))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    fn fill(kernel: IlluminationKernel, chart: &Chart, photons: u32, k: u32) -> Grid {
        let (across, down) = divide(chart, 200.0);
        let mut filling = Filling::new(across, down, k);
        let mut rng = Rng::new(5, Stream::Measure, 0);
        for _ in 0..photons {
            let u = rng.next_2d().as_dvec2();
            for is_fine in [false, true] {
                let k = if is_fine { k } else { 1 };
                let (at, count) = weights(u, across * k, down * k, chart.goes_round(), kernel);
                for &(x, y, weight) in &at[..count] {
                    match is_fine {
                        true => filling.add_caustic((x, y), DVec3::splat(weight)),
                        false => filling.add_diffuse((x, y), DVec3::splat(weight)),
                    }
                }
            }
        }
        Grid::finish(filling, chart, kernel, [u64::from(photons); 2])
    }

    /// Uniform flux of one watt gives one over the area everywhere, including the edges; the tent has a third of the
    /// box's variance or less, and both keep the flux.
    #[test]
    fn even_light_stays_even() {
        let charts = [
            Chart::parallelogram(DVec3::ZERO, DVec3::new(3.0, 0.0, 0.0), DVec3::new(0.0, 0.0, -1.0)).unwrap(),
            Chart::cylinder(DVec3::ZERO, DVec3::Y, 0.5).unwrap(),
        ];
        for chart in &charts {
            let mut deviations = Vec::new();
            for kernel in [IlluminationKernel::Box, IlluminationKernel::Tent] {
                let grid = fill(kernel, chart, 400_000, 2);
                let flux: f64 = grid.diffuse.iter().map(|e| f64::from(e.x)).sum::<f64>() * chart.area()
                    / grid.diffuse.len() as f64;
                assert!((flux - 1.0).abs() < 1e-5, "{kernel:?}: {flux}");
                let mut rng = Rng::new(6, Stream::Measure, 0);
                let (mut squares, mut edge) = (0.0, 0.0);
                const READINGS: u32 = 4000;
                for _ in 0..READINGS {
                    let u = rng.next_2d().as_dvec2();
                    let value = f64::from(grid.read_caustic(u).x) * chart.area();
                    squares += (value - 1.0).powi(2);
                    edge += f64::from(grid.read(DVec2::new(0.01 * u.x, u.y), &grid.diffuse).x) * chart.area();
                }
                // About 10 elements of 2000 photons each.
                let edge = edge / f64::from(READINGS);
                assert!((edge - 1.0).abs() < 0.03, "{kernel:?}: {edge} at the edge");
                deviations.push((squares / f64::from(READINGS)).sqrt());
                let both = f64::from(grid.read(DVec2::splat(0.4), &grid.all).x) * chart.area();
                assert!((both - 2.0).abs() < 0.2, "{both}");
            }
            // 500 photons in an element of the box.
            assert!((deviations[0] / 500f64.sqrt().recip() - 1.0).abs() < 0.15, "{deviations:?}");
            assert!(deviations[1] < 0.58 * deviations[0], "{deviations:?}");
        }
    }

    #[test]
    fn caustic_maps_are_made_where_caustics_are() {
        let mut filling = Filling::new(10, 4, 5);
        filling.add_caustic((0, 0), DVec3::ONE);
        filling.add_caustic((4, 4), DVec3::ONE);
        filling.add_caustic((49, 19), DVec3::splat(3.0));
        assert_eq!(filling.caustic.len(), 2 * 25);
        assert_eq!((filling.small[0], filling.small[39]), (0, 1));
        let chart = Chart::parallelogram(DVec3::ZERO, DVec3::X, DVec3::Y).unwrap();
        let grid = Grid::finish(filling, &chart, IlluminationKernel::Box, [1, 1]);
        let corner = grid.read_caustic(DVec2::splat(0.999)).x;
        assert!((corner - 3.0 * 1000.0).abs() < 1e-2, "{corner}");
        assert_eq!(grid.read_caustic(DVec2::splat(0.5)), Rgb::ZERO);
        // The mean of an element has the flux of its caustic map.
        assert!((grid.all[39].x - 3.0 * 40.0).abs() < 1e-3 && (grid.all[0].x - 2.0 * 40.0).abs() < 1e-3);
    }

    #[test]
    fn resolutions() {
        let chart = Chart::parallelogram(DVec3::ZERO, DVec3::X * 4.0, DVec3::Y).unwrap();
        assert_eq!(divide(&chart, 100.0), (20, 5));
        assert_eq!(divide(&chart, 0.1), (1, 1));
        // 0.2 m an element, 4.88 times the distance.
        assert_eq!(refine(&chart, (20, 5), 0.041), 5);
        assert_eq!(refine(&chart, (20, 5), f32::INFINITY), UNSEEN_REFINEMENT);
        assert_eq!(refine(&chart, (20, 5), 1e-9), FINEST_REFINEMENT);
    }

    #[test]
    fn faces_of_a_box_are_told_apart() {
        let object = crate::shapes::Csg::of(
            crate::shapes::Solid::cuboid(DVec3::splat(-1.0), DVec3::new(1.0, 2.0, 3.0)).unwrap(),
        );
        let charts = object.charts().unwrap();
        assert_eq!(charts.len(), 6);
        let mut seen = Vec::new();
        for (p, n) in [
            (DVec3::new(1.0, 0.3, 0.2), DVec3::X),
            (DVec3::new(-1.0, 0.3, 0.2), DVec3::NEG_X),
            (DVec3::new(0.1, 2.0, 0.2), DVec3::Y),
            (DVec3::new(0.1, -1.0, 0.2), DVec3::NEG_Y),
            (DVec3::new(0.1, 0.3, 3.0), DVec3::Z),
            // On an edge the normal decides.
            (DVec3::new(0.1, 2.0, -1.0), DVec3::NEG_Z),
        ] {
            let index = chart_at(&charts, p, n);
            assert!(charts[index].normal(p).dot(n) > 0.999 && charts[index].distance(p) < 1e-12);
            seen.push(index);
        }
        seen.sort_unstable();
        assert_eq!(seen, [0, 1, 2, 3, 4, 5]);
        assert!((charts.iter().map(Chart::area).sum::<f64>() - 2.0 * (6.0 + 8.0 + 12.0)).abs() < 1e-12);
    }
}
