//! Step 1: the model. Every side of every surface becomes patches, which divide into quarters where the solution needs them.

use super::domain::{Domain, Local};
use super::{RadiosityError, Specular};
use crate::math::{Ray, Rgb};
use crate::scene::{Geometry, Material, Node, Placement, Scene, Surface, SurfaceInteraction};
use crate::shapes::Chart;
use glam::{DAffine3, DVec2, DVec3, Vec3};
use std::f64::consts::PI;

/// No element.
pub(super) const NONE: u32 = u32::MAX;

/// Distance, render space, at which rays start and end off a patch. Render space has a radius below one, where positions are exact to
/// 6e-8.
pub(super) const OFF: f64 = 4e-6;

/// Most degrees, as a share of a turn, that the normals of a first patch of a round surface cover along one coordinate.
const FIRST_TURN: f64 = 0.125;

/// Most first patches along one coordinate of a long chart.
const MOST_CELLS: f64 = 64.0;

/// A patch, or the union of the patches that it was divided into.
#[derive(Clone, Copy, Debug)]
pub(super) struct Element {
    pub(super) domain: Domain,
    /// Factor on the domain's own normal.
    pub(super) sign: f64,
    /// Whether it is on the back of its surface.
    pub(super) back: bool,
    /// Index into [`Scene::surfaces`].
    pub(super) surface: u32,
    /// The first patch that it is part of.
    pub(super) root: u32,
    /// The element that it is a quarter of, or [`NONE`].
    pub(super) parent: u32,
    /// The first of its four quarters, or [`NONE`].
    pub(super) children: u32,
    pub(super) area: f64,
    pub(super) center: DVec3,
    /// Unit normal at the centre, on the side of the patch.
    pub(super) normal: DVec3,
    /// Largest distance of its points from the centre.
    pub(super) radius: f64,
    pub(super) is_flat: bool,
}

/// Reflectance and emission of an element, means over its area.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Optics {
    /// Hemispherical reflectance.
    pub(super) reflectance: Rgb,
    /// Radiant exitance that it emits by itself, W/m^2 times the power factor of render space.
    pub(super) emission: Rgb,
}

/// The first patches of one placement of a surface.
#[derive(Clone, Debug)]
enum Placed {
    /// By primitive: front and back.
    Triangles(Vec<[u32; 2]>),
    /// All charts of the placement.
    Charts(Vec<Cells>),
}

/// The first patches over a chart: a grid, row by row; each cell has a front and a back.
#[derive(Clone, Copy, Debug)]
struct Cells {
    chart: u32,
    across: u32,
    down: u32,
    first: u32,
}

/// Patches of a scene.
#[derive(Clone, Debug)]
pub(super) struct Model {
    pub(super) charts: Vec<Chart>,
    pub(super) elements: Vec<Element>,
    /// Number of first patches, which are the first elements.
    pub(super) roots: u32,
    /// By surface.
    placed: Vec<Vec<Placed>>,
    /// Triangles without area.
    pub(super) degenerate: u64,
}

impl Model {
    /// The first patches of a scene.
    ///
    /// # Errors
    /// Where the scene is not one for radiosity; the error names the surfaces.
    pub(super) fn new(scene: &Scene, specular: Specular) -> Result<Self, RadiosityError> {
        check(scene, specular)?;
        let mut model = Self {
            charts: Vec::new(),
            elements: Vec::new(),
            roots: 0,
            placed: vec![Vec::new(); scene.surfaces().len()],
            degenerate: 0,
        };
        for node in scene.nodes() {
            match node {
                Node::Surface(index) => model.add(scene, *index, None)?,
                Node::Instance { first, placement } => {
                    // The surfaces of a prototype follow each other up to those of the next node.
                    let next = scene.nodes().iter().map(|other| match other {
                        Node::Surface(index) => *index,
                        Node::Instance { first, .. } => *first,
                    });
                    let end = next.filter(|start| start > first).min();
                    let end = end.unwrap_or(scene.surfaces().len() as u32);
                    for index in *first..end {
                        model.add(scene, index, Some(placement))?;
                    }
                }
            }
        }
        model.roots = model.elements.len() as u32;
        if model.elements.is_empty() {
            return Err(RadiosityError::Empty);
        }
        Ok(model)
    }

    fn add(
        &mut self,
        scene: &Scene,
        index: u32,
        placement: Option<&Placement>,
    ) -> Result<(), RadiosityError> {
        let surface = &scene.surfaces()[index as usize];
        let placed = if surface.charts.is_empty() {
            let Geometry::Mesh(mesh) = &surface.geometry else {
                return Err(RadiosityError::NoChart { surface: surface.name.clone() });
            };
            let triangles = mesh.buffers.triangles().len() as u32;
            let corner = |p: [f32; 3]| {
                let p = Vec3::from_array(p).as_dvec3();
                placement.map_or(p, |placement| placement.to_world.transform_point3(p))
            };
            // A mirrored placement turns the order of corners around, but the surface keeps its side.
            let mirrored = placement.is_some_and(|placement| placement.to_world.matrix3.determinant() < 0.0);
            let sign = if mirrored != surface.flip_normal { -1.0 } else { 1.0 };
            let mut roots = Vec::with_capacity(triangles as usize);
            for triangle in 0..triangles {
                let domain = Domain::Triangle { corners: mesh.buffers.corners(triangle).map(corner) };
                roots.push(self.add_root(domain, sign, index).unwrap_or([NONE; 2]));
            }
            Placed::Triangles(roots)
        } else {
            let mut cells = Vec::new();
            for chart in &surface.charts {
                cells.extend(self.add_chart(surface, index, chart, placement)?);
            }
            Placed::Charts(cells)
        };
        self.placed[index as usize].push(placed);
        Ok(())
    }

    fn add_chart(
        &mut self,
        surface: &Surface,
        index: u32,
        chart: &Chart,
        placement: Option<&Placement>,
    ) -> Result<Option<Cells>, RadiosityError> {
        let stretched = || RadiosityError::NoChart { surface: surface.name.clone() };
        let chart = match placement {
            None => *chart,
            Some(placement) => {
                let scale = similarity(&placement.to_world).ok_or_else(stretched)?;
                chart.transformed(&placement.to_world, scale).map_err(|_| stretched())?
            }
        };
        // The edges of a mirrored quad have their order swapped in the mesh, and those of its chart do not.
        let own = match &surface.geometry {
            Geometry::Mesh(mesh) => {
                let [a, b, c] = mesh.buffers.corners(0).map(|p| Vec3::from_array(p).as_dvec3());
                let normal = (b - a).cross(c - a);
                let normal = placement.map_or(normal, |placement| {
                    let turned = placement.normal_to_world(normal.as_vec3()).as_dvec3();
                    if placement.to_world.matrix3.determinant() < 0.0 { -turned } else { turned }
                });
                normal.dot(chart.normal(DVec3::ZERO))
            }
            Geometry::Procedural(_) => 1.0,
        };
        let sign = if (own < 0.0) != surface.flip_normal { -1.0 } else { 1.0 };
        let number = self.charts.len() as u32;
        let lengths = chart.lengths();
        let (wide, high) = match chart {
            Chart::Sphere { .. } => (1.0 / FIRST_TURN, 0.5 / FIRST_TURN),
            Chart::Cylinder { .. } => (1.0 / FIRST_TURN, lengths.y / (FIRST_TURN * lengths.x)),
            Chart::Parallelogram { .. } | Chart::Disc { .. } => {
                let shorter = lengths.min_element();
                (lengths.x / shorter, lengths.y / shorter)
            }
        };
        let count = |n: f64| n.round().clamp(1.0, MOST_CELLS) as u32;
        let (across, down) = (count(wide), count(high));
        self.charts.push(chart);
        let first = self.elements.len() as u32;
        for j in 0..down {
            for i in 0..across {
                let at = |i: u32, j: u32| {
                    DVec2::new(f64::from(i) / f64::from(across), f64::from(j) / f64::from(down))
                };
                let domain = Domain::Rectangle { chart: number, low: at(i, j), high: at(i + 1, j + 1) };
                if self.add_root(domain, sign, index).is_none() {
                    // All cells have the same area.
                    return Ok(None);
                }
            }
        }
        Ok(Some(Cells { chart: number, across, down, first }))
    }

    /// Adds the first patches on both sides of a domain; `None` where it has no area.
    fn add_root(&mut self, domain: Domain, sign: f64, surface: u32) -> Option<[u32; 2]> {
        let area = domain.area(&self.charts);
        if !(area > 0.0 && area.is_finite()) {
            self.degenerate += 1;
            return None;
        }
        let first = self.elements.len() as u32;
        for (side, back) in [(sign, false), (-sign, true)] {
            let root = self.elements.len() as u32;
            let element = self.element(domain, (side, back), surface, (root, NONE));
            self.elements.push(element);
        }
        Some([first, first + 1])
    }

    fn element(
        &self,
        domain: Domain,
        (sign, back): (f64, bool),
        surface: u32,
        (root, parent): (u32, u32),
    ) -> Element {
        /// Room for what a round patch bulges beyond its outline.
        const BULGE: f64 = 1.25;
        let center = domain.point(&self.charts, DVec2::splat(0.5));
        let is_flat = domain.is_flat(&self.charts);
        let outline = domain.outline(&self.charts);
        let radius = outline.iter().map(|corner| corner.distance(center)).fold(0.0, f64::max);
        Element {
            domain,
            sign,
            back,
            surface,
            root,
            parent,
            children: NONE,
            area: domain.area(&self.charts),
            center,
            normal: domain.normal(&self.charts, center) * sign,
            radius: if is_flat { radius } else { BULGE * radius },
            is_flat,
        }
    }

    /// Divides an element into quarters, unless it is already, and returns the first of them.
    pub(super) fn divide(&mut self, index: u32) -> u32 {
        let element = self.elements[index as usize];
        if element.children != NONE {
            return element.children;
        }
        let first = self.elements.len() as u32;
        for quarter in element.domain.quarters() {
            let side = (element.sign, element.back);
            let child = self.element(quarter, side, element.surface, (element.root, index));
            self.elements.push(child);
        }
        self.elements[index as usize].children = first;
        first
    }

    /// Unit normal at a point of an element, on its side.
    pub(super) fn normal(&self, element: &Element, at: DVec3) -> DVec3 {
        if element.is_flat { element.normal } else { element.domain.normal(&self.charts, at) * element.sign }
    }

    /// Number of patches: elements that are not divided.
    pub(super) fn leaves(&self) -> usize {
        self.elements.iter().filter(|element| element.children == NONE).count()
    }

    /// The patch at a hit, and where in it the hit lies.
    pub(super) fn locate(
        &self,
        surface: u32,
        primitive: u32,
        position: Vec3,
        normal: Vec3,
    ) -> Option<(u32, Local)> {
        let (position, normal) = (position.as_dvec3(), normal.as_dvec3());
        let mut best: Option<(u32, DVec2, (bool, f64))> = None;
        for placed in self.placed.get(surface as usize)? {
            match placed {
                Placed::Triangles(roots) => {
                    let &[front, _] = roots.get(primitive as usize)?;
                    if front == NONE {
                        continue;
                    }
                    // The same triangle of another instance lies elsewhere.
                    let element = &self.elements[front as usize];
                    let distance = element.center.distance(position) - element.radius;
                    let key =
                        (false, distance.max(0.0) + element.normal.dot(position - element.center).abs());
                    if best.is_none_or(|(.., found)| key < found) {
                        best = Some((front, DVec2::ZERO, key));
                    }
                }
                Placed::Charts(all) => {
                    for cells in all {
                        let chart = &self.charts[cells.chart as usize];
                        let facing = chart.normal(position).dot(normal).abs();
                        let key = (facing < 0.7, chart.distance(position));
                        if best.is_none_or(|(.., found)| key < found) {
                            let place = chart.locate(position);
                            let cell = |x: f64, n: u32| ((x * f64::from(n)) as u32).min(n - 1);
                            let (i, j) = (cell(place.x, cells.across), cell(place.y, cells.down));
                            best = Some((cells.first + 2 * (j * cells.across + i), place, key));
                        }
                    }
                }
            }
        }
        let (front, place, _) = best?;
        let element = &self.elements[front as usize];
        let is_back = self.normal(element, position).dot(normal) < 0.0;
        let mut index = front + u32::from(is_back);
        let mut local = Local::of(&element.domain, position, place);
        while self.elements[index as usize].children != NONE {
            let (quarter, inside) = local.quarter();
            index = self.elements[index as usize].children + quarter;
            local = inside;
        }
        Some((index, local))
    }

    /// Reflectance and emission of an element: means over points of its area, with textures.
    pub(super) fn optics(&self, scene: &Scene, element: &Element) -> Optics {
        /// Points along each coordinate.
        const SIDE: u32 = 2;
        let surface = &scene.surfaces()[element.surface as usize];
        let (mut sum, mut found) = (Optics::default(), 0);
        for i in 0..SIDE * SIDE {
            let u = (DVec2::new(f64::from(i % SIDE), f64::from(i / SIDE)) + 0.5) / f64::from(SIDE);
            let position = element.domain.point(&self.charts, u);
            let normal = self.normal(element, position);
            let Some(hit) = meet(scene, element.surface, position, normal) else { continue };
            let shading = hit.shading(scene.material(&hit));
            sum.reflectance += shading.bsdf.lambertian().map_or(Rgb::ZERO, |lambert| lambert.reflectance);
            if let Some(light) = surface.light
                && let crate::lights::Light::Area(light) = &scene.lights()[light as usize]
            {
                sum.emission += light.emitted(hit.is_front()) * hit.glow * PI as f32;
            }
            found += 1;
        }
        let share = 1.0 / f32::max(found as f32, 1.0);
        Optics { reflectance: sum.reflectance * share, emission: sum.emission * share }
    }
}

/// The point of a surface at `position`, seen from the side of `normal`; `None` where a ray meets something else there.
fn meet(scene: &Scene, surface: u32, position: DVec3, normal: DVec3) -> Option<SurfaceInteraction> {
    let start = (position + normal * (4.0 * OFF)).as_vec3();
    let ray = Ray { t_max: (8.0 * OFF) as f32, ..Ray::new(start, -normal.as_vec3().normalize_or_zero()) };
    scene.intersect(&ray).filter(|hit| hit.surface == surface)
}

/// The factor on lengths of a transform that scales equally along all axes.
fn similarity(transform: &DAffine3) -> Option<f64> {
    const TOLERANCE: f64 = 1e-6;
    let [x, y, z] = [transform.matrix3.x_axis, transform.matrix3.y_axis, transform.matrix3.z_axis];
    let scale = x.length();
    let same = |other: DVec3| (other.length() / scale - 1.0).abs() < TOLERANCE;
    let square = |a: DVec3, b: DVec3| a.dot(b).abs() < TOLERANCE * scale * scale;
    (same(y) && same(z) && square(x, y) && square(y, z) && square(z, x)).then_some(scale)
}

/// Refuses scenes that radiosity cannot show.
fn check(scene: &Scene, specular: Specular) -> Result<(), RadiosityError> {
    if let Some(medium) = scene.media().iter().find(|medium| medium.volume.is_some()) {
        return Err(RadiosityError::Medium { medium: medium.name.clone() });
    }
    if scene.lights().is_empty() {
        return Err(RadiosityError::Dark);
    }
    let cut = scene.surfaces().iter().filter(|surface| scene.has_holes(surface));
    let cut: Vec<String> = cut.map(|surface| surface.name.clone()).collect();
    if !cut.is_empty() {
        return Err(RadiosityError::Holes { surfaces: cut });
    }
    let mut shiny: Vec<String> = scene
        .surfaces()
        .iter()
        .filter(|surface| surface.all_materials().any(|id| !is_diffuse(&scene.materials()[id as usize].1)))
        .map(|surface| surface.name.clone())
        .collect();
    shiny.dedup();
    if !shiny.is_empty() && specular == Specular::Refuse {
        return Err(RadiosityError::NotDiffuse { surfaces: shiny });
    }
    let diffuse =
        |surface: &Surface| surface.all_materials().any(|id| is_diffuse(&scene.materials()[id as usize].1));
    if scene.surfaces().iter().any(diffuse) { Ok(()) } else { Err(RadiosityError::Empty) }
}

/// Whether a material reflects diffusely or not at all.
fn is_diffuse(material: &Material) -> bool {
    match material {
        Material::Lambert { .. } => true,
        Material::Layered { media: None, .. } => !(material.has_glossy() || material.has_specular()),
        Material::Mirror { .. }
        | Material::Dielectric { .. }
        | Material::RoughDielectric { .. }
        | Material::Layered { media: Some(_), .. }
        | Material::Glossy { .. } => false,
    }
}

/// Whether light that one of two elements sends or reflects may count for the other. Of two black ones nothing is left to be known, but
/// a black one still receives, for the balance of the energy.
pub(super) fn may_exchange([a, b]: [&Optics; 2]) -> bool {
    let sends = |optics: &Optics| optics.reflectance != Rgb::ZERO || optics.emission != Rgb::ZERO;
    sends(a) || sends(b)
}
