//! Radiosity: the diffuse exchange of light between patches, the other method of global illumination beside photon mapping.
//!
//! Four steps: the model (patches), form factors, the solution of `B_i = E_i + rho_i (sum_j F_ij B_j + H_i)`, and the picture, which is
//! drawn by `integrators` and `render`. `H_i` is the irradiance by light sources without a surface. All quantities are in render space:
//! exitance and irradiance in W/m^2 times the power factor, with cosines and without a factor of pi.
//!
//! - C. M. Goral, K. E. Torrance, D. P. Greenberg & B. Battaile, "Modeling the Interaction of Light Between Diffuse Surfaces", SIGGRAPH 1984.
//! - M. F. Cohen, S. E. Chen, J. R. Wallace & D. P. Greenberg, "A Progressive Refinement Approach to Fast Radiosity Image Generation",
//!   SIGGRAPH 1988.
//! - P. Hanrahan, D. Salzman & L. Aupperle, "A Rapid Hierarchical Radiosity Algorithm", SIGGRAPH 1991.

mod bake;
mod domain;
mod file;
mod form_factor;
mod key;
mod lights;
mod links;
mod model;
mod polygon;
mod refine;
mod shooting;
mod vertices;

#[cfg(test)]
mod tests;

pub use bake::{BakedMesh, write_glb};
pub use file::{RADIOSITY_FILE_VERSION, RadiosityFileError, SavedRadiosity, read_radiosity, write_radiosity};
pub use form_factor::{Exchange, MOST_STRATA};
pub use polygon::point_to_polygon;

use crate::math::Rgb;
use crate::observer::Observer;
use crate::scene::{Scene, SurfaceInteraction};
use form_factor::FormFactors;
use glam::DVec3;
use links::{Link, Rows, State};
use model::{Model, NONE};
use rayon::prelude::*;
use refine::{Hierarchy, LINKS_PER_PATCH};
use serde::{Deserialize, Serialize};
use std::time::Instant;
use vertices::Vertices;

/// How form factors are kept and the equations are solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Links between patches of several sizes, divided where one form factor is not enough; Gauss-Seidel gathering (Hanrahan, Salzman &
    /// Aupperle 1991).
    Hierarchy,
    /// The form factors of all pairs of patches of about the same size, and Gauss-Seidel iteration: the reference for small scenes.
    Matrix,
    /// The same patches without a matrix: the patch with the most light left to send out shoots it, over form factors computed for that
    /// (Cohen, Chen, Wallace & Greenberg 1988).
    Shooting,
}

/// What becomes of surfaces that are not diffuse.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Specular {
    /// The scene is refused.
    Refuse,
    /// They absorb all light that patches send to them. A second pass may show them by rays.
    Absorb,
}

/// Options of the solution.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RadiosityOptions {
    /// Largest number of patches, on both sides of all surfaces, unless the scene has more triangles and faces.
    pub patches: usize,
    /// How the equations are solved.
    pub method: Method,
    /// Strata along each coordinate of each of two patches: `strata^4` rays tell what stands between them. At most [`MOST_STRATA`].
    pub strata: u32,
    /// Largest relative change of the last sweep. For shooting, the share of light that is left unshot.
    pub tolerance: f64,
    /// What becomes of surfaces that are not diffuse.
    pub specular: Specular,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for RadiosityOptions {
    fn default() -> Self {
        Self {
            patches: 20_000,
            method: Method::Hierarchy,
            strata: 2,
            tolerance: 1e-6,
            specular: Specular::Refuse,
            seed: 0,
        }
    }
}

/// Names for a message: the first few, and how many more there are.
fn listed(names: &[String]) -> String {
    const SHOWN: usize = 5;
    let shown: Vec<String> = names.iter().take(SHOWN).map(|name| format!("`{name}`")).collect();
    match names.len().saturating_sub(SHOWN) {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}

/// Why there is no radiosity solution.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RadiosityError {
    /// Surfaces with specular or glossy reflection.
    #[error(
        "radiosity knows diffuse surfaces alone, and these are not: {}; `cardioid render` shows them by photon mapping, and \
         --specular absorb makes them black in the solution, over which --view gather and --view final show them by rays",
        listed(surfaces)
    )]
    NotDiffuse {
        /// Their names.
        surfaces: Vec<String>,
    },
    /// Surfaces with holes.
    #[error(
        "the material of these surfaces has an opacity, and patches have no holes: {}; `cardioid render` shows them",
        listed(surfaces)
    )]
    Holes {
        /// Their names.
        surfaces: Vec<String>,
    },
    /// A shape without coordinates.
    #[error(
        "`{surface}` cannot be divided into patches: it has no coordinates (a combination of bodies, a flake, a terrain, or a shape \
         scaled differently along different axes); make it a mesh, or use `cardioid render`"
    )]
    NoChart {
        /// Its name.
        surface: String,
    },
    /// A medium scatters.
    #[error("the medium `{medium}` scatters light, and radiosity has surfaces alone; use `cardioid render`")]
    Medium {
        /// Its name.
        medium: String,
    },
    /// No light source.
    #[error("nothing shines in this scene, so that every patch is black; add a light source")]
    Dark,
    /// No patch.
    #[error(
        "no surface of this scene is diffuse and has an area, so that there is no patch; use `cardioid render`"
    )]
    Empty,
    /// Too many first patches or links.
    #[error(
        "{patches} patches need about {:.1} GB for their form factors, and {:.1} GB may be taken; {}",
        *needed as f64 / 1e9, *allowed as f64 / 1e9, remedy(*roots, *patches)
    )]
    TooMany {
        /// Patches that are asked for, or first patches where those are more.
        patches: usize,
        /// First patches: both sides of all triangles and faces.
        roots: usize,
        /// Bytes.
        needed: u64,
        /// Bytes that may be taken.
        allowed: u64,
    },
    /// The iteration does not settle.
    #[error(
        "the solution does not settle: surfaces that reflect all light keep it in a closed room for ever; lower their reflectance below 1"
    )]
    Diverges,
    /// The observer stopped the computation.
    #[error("stopped before the solution was found")]
    Stopped,
}

fn remedy(roots: usize, patches: usize) -> &'static str {
    if roots >= patches {
        "each of the triangles of the scene is a patch: use a coarser mesh, or `cardioid render`, whose photon map does not depend on it"
    } else {
        "lower --patches, or raise --memory-limit"
    }
}

/// Steps that were computed; the others were taken from a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct StepsDone {
    /// Step 1: whether patches were made.
    pub model: bool,
    /// Step 2: form factors that were computed.
    pub form_factors: u64,
    /// Step 3: whether the equations were solved.
    pub solved: bool,
}

/// Light in the solution, watts, by channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Balance {
    /// Emitted by surfaces, and received by surfaces from light sources without a surface.
    pub emitted: [f64; 3],
    /// Absorbed by surfaces.
    pub absorbed: [f64; 3],
    /// Sent out and not received: it left an open scene. In a closed one this is the error of the form factors.
    pub escaped: [f64; 3],
}

/// Figures of a solution.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RadiosityReport {
    /// Patches.
    pub patches: usize,
    /// Patches and the elements that they are parts of.
    pub elements: usize,
    /// Links between elements.
    pub links: usize,
    /// Triangles without area, which are no patches.
    pub degenerate: u64,
    /// Sweeps of the last iteration, or patches that shot.
    pub sweeps: u32,
    /// Mean over the area of lit patches of the sum of form factors, one in a closed room.
    pub row_sum: f64,
    /// Mean over the same area of its stated standard error.
    pub row_error: f64,
    /// Balance of the light.
    pub balance: Balance,
    /// Bytes of patches, links and solution.
    pub bytes: u64,
    /// Seconds for form factors and their refinement, with the solutions that guide it.
    pub seconds_factors: f64,
    /// Seconds for the last solution.
    pub seconds_solution: f64,
    /// Seconds for the light at the corners of patches, which views interpolate.
    pub seconds_corners: f64,
    /// What was computed.
    pub steps: StepsDone,
}

/// Irradiance at a place, W/m^2 times the power factor of render space.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PatchIrradiance {
    /// Straight from light sources.
    pub direct: Rgb,
    /// Reflected at least once.
    pub indirect: Rgb,
}

impl PatchIrradiance {
    /// All of it.
    pub fn total(&self) -> Rgb {
        self.direct + self.indirect
    }
}

/// A solution: irradiance of all patches, for any camera.
#[derive(Debug)]
pub struct Radiosity {
    model: Model,
    links: Vec<Link>,
    state: State,
    /// By element; valid for patches.
    irradiance: Vec<PatchIrradiance>,
    vertices: Vertices,
    report: RadiosityReport,
    /// Hashes of what steps 1 and 2, and step 3, depend on.
    keys: [key::Key; 2],
}

/// Bytes that a solution is foreseen to take: `(patches, bytes)` for a scene with this many first patches.
fn foreseen(options: &RadiosityOptions, roots: usize) -> (usize, u64) {
    /// Of an element in all lists; a patch is the last of a third more elements.
    const ELEMENT: u64 = 4 * (size_of::<model::Element>() as u64 + 200) / 3;
    /// Of a link, and of its two entries in rows.
    const LINK: u64 = size_of::<Link>() as u64 + 16;
    let patches = options.patches.max(roots) as u64;
    // Of all pairs of faces about half face each other.
    let pairs = |n: u64| n.saturating_mul(n) / 4;
    let links = match options.method {
        Method::Hierarchy => patches.saturating_mul(LINKS_PER_PATCH as u64).max(pairs(roots as u64)),
        Method::Matrix => pairs(patches),
        Method::Shooting => 0,
    };
    let bytes = patches.saturating_mul(ELEMENT).saturating_add(links.saturating_mul(LINK));
    (patches as usize, bytes)
}

impl Radiosity {
    /// Bytes that the solution of a scene is foreseen to take at most.
    ///
    /// # Errors
    /// Where the scene is not one for radiosity.
    pub fn foreseen_bytes(scene: &Scene, options: &RadiosityOptions) -> Result<u64, RadiosityError> {
        Ok(foreseen(options, Model::new(scene, options.specular)?.roots as usize).1)
    }

    /// Computes the solution. Steps whose input is that of `saved` are taken from there: geometry and options decide about steps 1 and 2,
    /// reflectances and light sources about step 3. `allowed` bounds the memory. The result does not depend on the number of threads.
    ///
    /// # Errors
    /// Where the scene is not one for radiosity, or needs too much memory.
    pub fn compute(
        scene: &Scene,
        options: &RadiosityOptions,
        saved: Option<SavedRadiosity>,
        allowed: Option<u64>,
        observer: &dyn Observer,
    ) -> Result<Self, RadiosityError> {
        let begun = Instant::now();
        let model = Model::new(scene, options.specular)?;
        let roots = model.roots as usize;
        let (patches, needed) = foreseen(options, roots);
        if let Some(allowed) = allowed.filter(|&allowed| needed > allowed) {
            return Err(RadiosityError::TooMany { patches, roots, needed, allowed });
        }
        let geometry = key::geometry_key(scene, options);
        let saved = saved.filter(|saved| saved.keys[0] == geometry);
        let factors = FormFactors { scene, strata: options.strata.clamp(1, MOST_STRATA), seed: options.seed };
        let mut hierarchy = Hierarchy::new(factors, options, model);
        let mut steps = StepsDone { model: saved.is_none(), ..StepsDone::default() };
        let saved = saved.filter(|saved| saved.restore(&mut hierarchy));
        steps.model |= saved.is_none();
        if saved.is_none() {
            match options.method {
                Method::Hierarchy => hierarchy.refine(observer)?,
                Method::Matrix => {
                    hierarchy.divide_uniformly();
                    hierarchy.link_all(observer)?;
                }
                Method::Shooting => hierarchy.divide_uniformly(),
            }
        }
        // The light on the patches as they are now; interior elements follow from them.
        links::pull_optics(&hierarchy.model, &mut hierarchy.state.optics);
        let seconds_factors = begun.elapsed().as_secs_f64();
        let begun = Instant::now();
        let light = key::light_key(&hierarchy.state, options);
        let known = saved.filter(|saved| saved.keys[1] == light && saved.fits(&hierarchy.model));
        steps.solved = known.is_none();
        let mut corners = None;
        let irradiance = match (known, options.method) {
            (Some(known), _) => {
                hierarchy.state.radiosity = known.radiosity;
                hierarchy.sweeps = known.sweeps;
                corners = Some(known.corners);
                known.irradiance
            }
            (None, Method::Shooting) => shooting::shoot(&mut hierarchy, observer)?,
            (None, Method::Hierarchy | Method::Matrix) => gathered(&mut hierarchy)?,
        };
        steps.form_factors = hierarchy.computed;
        let seconds_solution = begun.elapsed().as_secs_f64();
        let begun = Instant::now();
        let Hierarchy { model, state, links, sweeps, .. } = hierarchy;
        let of_patches = || irradiance.iter().map(|&value| [value; 4]).collect::<Vec<_>>();
        // A number of corners that is not that of the patches is from another program.
        let known = corners.and_then(|corners| {
            let mut vertices = Vertices::new(scene, &model, &of_patches());
            vertices.set_values(corners).then_some(vertices)
        });
        let vertices = known.unwrap_or_else(|| {
            let corners = match links.is_empty() {
                true => of_patches(),
                false => at_corners(&model, &links, &state),
            };
            Vertices::new(scene, &model, &corners)
        });
        let report = RadiosityReport {
            degenerate: model.degenerate,
            sweeps,
            seconds_factors,
            seconds_solution,
            seconds_corners: begun.elapsed().as_secs_f64(),
            steps,
            ..RadiosityReport::default()
        };
        let mut all = Self { model, links, state, irradiance, vertices, report, keys: [geometry, light] };
        all.complete_report(scene);
        Ok(all)
    }

    fn complete_report(&mut self, scene: &Scene) {
        let Self { model, links, state, irradiance, .. } = self;
        let rows = Rows::new(model, links);
        let sums = rows.sums(model);
        let mut variances = vec![0.0f64; model.elements.len()];
        for link in links.iter() {
            for end in link.ends {
                let error = f64::from(link.error) / model.elements[end as usize].area;
                variances[end as usize] += error * error;
            }
        }
        let (mut area, mut row_sum, mut row_error) = (0.0, 0.0, 0.0);
        let mut light = [DVec3::ZERO; 3];
        for (index, element) in model.elements.iter().enumerate() {
            if element.parent != NONE {
                variances[index] += variances[element.parent as usize];
            }
            if element.children != NONE {
                continue;
            }
            let model::Optics { reflectance, emission } = state.optics[index];
            let arriving = irradiance[index].total().as_dvec3();
            let others = state.lights[index].0.as_dvec3();
            let absorbed = (DVec3::ONE - reflectance.as_dvec3()) * arriving;
            light[0] += (emission.as_dvec3() + others) * element.area;
            light[1] += absorbed * element.area;
            if arriving != DVec3::ZERO {
                area += element.area;
                row_sum += sums[index] * element.area;
                row_error += variances[index].sqrt() * element.area;
            }
        }
        light[2] = light[0] - light[1];
        // Radiance has the power factor of render space, and areas its scale.
        let space = scene.space();
        let watts = |sum: DVec3| (sum / (space.power * space.scale * space.scale)).to_array();
        let report = &mut self.report;
        report.balance =
            Balance { emitted: watts(light[0]), absorbed: watts(light[1]), escaped: watts(light[2]) };
        if area > 0.0 && !links.is_empty() {
            report.row_sum = row_sum / area;
            report.row_error = row_error / area;
        }
        report.patches = model.leaves();
        report.elements = model.elements.len();
        report.links = links.len();
        report.bytes = (model.elements.len() * (size_of::<model::Element>() + 200)
            + links.len() * size_of::<Link>()) as u64;
    }

    /// Figures of the solution.
    pub fn report(&self) -> &RadiosityReport {
        &self.report
    }

    /// Irradiance of the patch at a hit, the same over the whole patch. Zero where there is no patch.
    pub fn of_patch(&self, hit: &SurfaceInteraction) -> PatchIrradiance {
        let found = self.model.locate(hit.surface, hit.primitive, hit.point.position, hit.facing_normal());
        found.map_or_else(PatchIrradiance::default, |(patch, _)| self.irradiance[patch as usize])
    }

    /// Irradiance at a hit, interpolated between the corners of its patch (Gouraud 1971).
    pub fn interpolated(&self, hit: &SurfaceInteraction) -> PatchIrradiance {
        let found = self.model.locate(hit.surface, hit.primitive, hit.point.position, hit.facing_normal());
        found.map_or_else(PatchIrradiance::default, |(patch, local)| self.vertices.interpolate(patch, local))
    }
}

/// Irradiance at the corners of all patches. Each element gathers over its own links by the form factors of its corners; between them, what
/// it gathers is interpolated at the corners of its quarters.
fn at_corners(model: &Model, links: &[Link], state: &State) -> Vec<[PatchIrradiance; 4]> {
    let rows = Rows::new(model, links);
    let [emission, reflected] = sources(state);
    let mut found: Vec<[[DVec3; 2]; 4]> = (0..model.elements.len())
        .into_par_iter()
        .map(|index| {
            let element = &model.elements[index];
            std::array::from_fn(|corner| {
                let position = element.domain.near_corner(&model.charts, corner);
                let normal = model.normal(element, position);
                rows.at_point(model, index as u32, (position, normal), [&emission, &reflected])
            })
        })
        .collect();
    for (index, element) in model.elements.iter().enumerate() {
        let Some(above) = found.get(element.parent as usize).copied() else { continue };
        let quarter = index as u32 - model.elements[element.parent as usize].children;
        let weights = element.domain.corners_of_quarter(quarter);
        for (corner, weights) in found[index].iter_mut().zip(weights) {
            for (value, weight) in above.iter().zip(weights) {
                corner[0] += value[0] * weight;
                corner[1] += value[1] * weight;
            }
        }
    }
    let with_lights = |(corners, (lights, _)): ([[DVec3; 2]; 4], &(Rgb, Rgb))| {
        corners.map(|[direct, indirect]| PatchIrradiance {
            direct: direct.as_vec3() + *lights,
            indirect: indirect.as_vec3(),
        })
    };
    found.into_iter().zip(&state.lights).map(with_lights).collect()
}

/// Exitance of all elements: emitted, and reflected.
fn sources(state: &State) -> [Vec<DVec3>; 2] {
    let emission: Vec<DVec3> = state.optics.iter().map(|optics| optics.emission.as_dvec3()).collect();
    let reflected = state.radiosity.iter().zip(&emission);
    let reflected = reflected.map(|(radiosity, emission)| (radiosity - emission).max(DVec3::ZERO)).collect();
    [emission, reflected]
}

/// Solves over the links, and separates light that was reflected from light straight from its sources.
fn gathered(hierarchy: &mut Hierarchy<'_>) -> Result<Vec<PatchIrradiance>, RadiosityError> {
    hierarchy.solve()?;
    let Hierarchy { model, state, links, .. } = hierarchy;
    let rows = Rows::new(model, links);
    let [emission, reflected] = sources(state);
    let direct = rows.irradiance(model, &emission);
    let indirect = rows.irradiance(model, &reflected);
    let lights = state.lights.iter();
    let all = direct.iter().zip(&indirect).zip(lights).map(|((direct, indirect), (lights, _))| {
        PatchIrradiance { direct: direct.as_vec3() + *lights, indirect: indirect.as_vec3() }
    });
    Ok(all.collect())
}
