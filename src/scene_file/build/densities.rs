//! Densities of media: read, made and placed, and the boxes of media that have no body of their own.

use super::{BuildError, BuildProblem, begin_reading};
use crate::math::Bounds3;
use crate::media::density::{BoundedField, Density, DensityError, Envelope, Grid, HeightFog, NoiseField};
use crate::media::{Glow, read_vdb};
use crate::observer::Observer;
use crate::scene_file::description::{
    DensityDescription, FillDescription, FireDescription, GeometryDescription, LightDescription,
    MaterialDescription, MediumDescription, Named, NoiseDescription, SceneDescription, SceneWarning,
    ShapeDescription,
};
use crate::shapes::{Csg, Solid};
use glam::{DAffine3, DVec3, UVec3};
use std::path::Path;
use std::sync::Arc;

/// Cells in which the density of noise is bounded, at most about.
const MOST_CELLS: f64 = (1 << 17) as f64;

/// Bytes of the bounds of these cells.
pub(in crate::scene_file) const NOISE_BYTES: u64 = 2 * (8 << 17);

/// Change of the density of noise over a cell: with cells that are finer, lines are slower to walk.
const CHANGE: f64 = 0.3;

/// A density in the world, with lengths in metres.
#[derive(Debug)]
pub(super) enum WorldDensity {
    Even,
    Height(HeightFog),
    Field(Box<BoundedField>),
    Grid(Box<Grid>, Option<Box<WorldFire>>),
}

/// Temperatures in the world.
#[derive(Debug)]
pub(super) struct WorldFire {
    temperature: Grid,
    kelvin: f64,
    glow: f64,
}

impl WorldFire {
    /// How the medium glows in another space, to which `by` leads, and the radiance of its hottest place, W/(m^2 sr).
    pub(super) fn placed(self, by: DAffine3) -> Result<(Glow, DVec3), DensityError> {
        let (glow, most) = Glow::new(self.temperature.placed(by)?, self.kelvin);
        Ok((glow, most * self.glow))
    }
}

/// A grid under a transform, and what is to be said of its values.
fn read_grid(
    file: &Path,
    name: Option<&str>,
    transform: &DAffine3,
) -> Result<(Grid, Option<String>), BuildProblem> {
    let read = read_vdb(file, name).map_err(Box::new)?;
    let refused = read.refused;
    let warning = (refused.count() > 0).then(|| {
        format!(
            "grid `{}` of {}: voxels without a usable value count as zero ({} not a number, {} infinite, {} below zero)",
            read.name,
            file.display(),
            refused.nan,
            refused.infinite,
            refused.negative
        )
    });
    Ok((read.grid.placed(*transform).map_err(DensityError::from)?, warning))
}

impl WorldDensity {
    /// The density that is described, and warnings about its file.
    fn read(described: &DensityDescription) -> Result<(Self, Vec<String>), BuildProblem> {
        match described {
            DensityDescription::Even => Ok((Self::Even, Vec::new())),
            &DensityDescription::Height { up, base, scale } => {
                let fog = HeightFog::new(up, base, scale).map_err(DensityError::from)?;
                Ok((Self::Height(fog), Vec::new()))
            }
            DensityDescription::Noise(noise) => Ok((Self::Field(Box::new(field_of(noise)?)), Vec::new())),
            DensityDescription::Vdb { file, grid, transform, fire } => {
                let (density, first) = read_grid(file, grid.as_deref(), transform)?;
                let mut said: Vec<String> = first.into_iter().collect();
                let fire = match fire {
                    None => None,
                    Some(FireDescription { grid, kelvin, glow }) => {
                        let (temperature, second) = read_grid(file, Some(grid), transform)?;
                        said.extend(second);
                        Some(WorldFire { temperature, kelvin: *kelvin, glow: *glow })
                    }
                };
                Ok((Self::Grid(Box::new(density), fire.map(Box::new)), said))
            }
        }
    }

    /// The box outside of which it is zero, and the transform from its space to the world.
    fn placed_box(&self) -> Option<(Bounds3, DAffine3)> {
        match self {
            Self::Even | Self::Height(_) => None,
            Self::Field(field) => Some(field.placed_box()),
            Self::Grid(grid, _) => Some(grid.placed_box()),
        }
    }

    /// The same in another space, to which `by` leads.
    pub(super) fn placed(self, by: DAffine3) -> Result<(Density, Option<Box<WorldFire>>), DensityError> {
        Ok(match self {
            Self::Even => (Density::Homogeneous, None),
            Self::Height(fog) => (Density::Height(fog.placed(&by)?), None),
            Self::Field(field) => (Density::Field(Arc::new(field.placed(by)?)), None),
            Self::Grid(grid, fire) => (Density::Grid(Arc::new(grid.placed(by)?)), fire),
        })
    }
}

/// Noise with bounds on it.
fn field_of(noise: &NoiseDescription) -> Result<BoundedField, DensityError> {
    let &NoiseDescription { octaves, is_turbulent, levels, bounds, is_round, fade, transform } = noise;
    let envelope = Envelope::new(&bounds, is_round, fade);
    let field = NoiseField::new(octaves, is_turbulent, levels, DAffine3::IDENTITY)?.within(envelope);
    let size = bounds.max - bounds.min;
    let mut side = (CHANGE / field.steepness()).max((size.element_product() / MOST_CELLS).cbrt());
    let cells_of = |side: f64| (size / side).ceil().max(DVec3::ONE);
    // Of a box that is thin there are more than its volume says.
    while cells_of(side).element_product() > 2.0 * MOST_CELLS {
        side *= 1.25;
    }
    let cells = cells_of(side);
    let cells = UVec3::new(cells.x as u32, cells.y as u32, cells.z as u32);
    Ok(BoundedField::new(field, bounds, cells)?.placed(transform)?)
}

/// The densities of all media, in their order; `None` for those that are no volumes. Also returns warnings about their files.
pub(super) fn read_densities(
    description: &SceneDescription,
    observer: &dyn Observer,
) -> Result<(Vec<Option<WorldDensity>>, Vec<SceneWarning>), BuildError> {
    let (mut densities, mut warnings) = (Vec::new(), Vec::new());
    for medium in &description.media {
        let Some(volume) = &medium.value.volume else {
            densities.push(None);
            continue;
        };
        if let DensityDescription::Vdb { file, .. } = &volume.density {
            begin_reading(observer, file);
        }
        let (density, said) = WorldDensity::read(&volume.density).map_err(|problem| of(medium, problem))?;
        let warned = |message| SceneWarning { location: medium.location.clone(), message };
        warnings.extend(said.into_iter().map(warned));
        densities.push(Some(density));
    }
    Ok((densities, warnings))
}

/// An error about a medium.
pub(super) fn of(medium: &Named<MediumDescription>, problem: BuildProblem) -> BuildError {
    BuildError { location: medium.location.clone(), object: format!("medium `{}`", medium.name), problem }
}

/// The description with boxes for media that are to fill those around their densities, or (where `around` is given) the whole scene;
/// `None` where there is no such medium. `around` is a box around all shapes.
pub(super) fn with_boxes(
    description: &SceneDescription,
    densities: &[Option<WorldDensity>],
    around: Option<&Bounds3>,
) -> Result<Option<SceneDescription>, BuildError> {
    let mut extended: Option<SceneDescription> = None;
    let media = description.media.iter().zip(densities).enumerate();
    for (number, (medium, density)) in media {
        let (Some(volume), Some(density)) = (&medium.value.volume, density) else { continue };
        let (bounds, transform) = match (volume.fills, around) {
            (FillDescription::Bounds, None) => {
                let Some(placed) = density.placed_box() else { continue };
                placed
            }
            (FillDescription::Scene { grow }, Some(around)) => {
                (grown(description, around, grow), DAffine3::IDENTITY)
            }
            _ => continue,
        };
        let solid = Solid::cuboid(bounds.min, bounds.max).map_err(|error| of(medium, error.into()))?;
        let extended = extended.get_or_insert_with(|| description.clone());
        let material = extended.materials.len();
        let named = |what: &str| format!("{what} of medium `{}`", medium.name);
        extended.materials.push(Named {
            name: named("border"),
            location: medium.location.clone(),
            value: MaterialDescription::Dielectric { inside: number, outside: 0, roughness: 0.0 },
        });
        extended.shapes.push(Named {
            name: named("box"),
            location: medium.location.clone(),
            value: ShapeDescription {
                geometry: GeometryDescription::Csg { object: Csg::of(solid), materials: vec![None] },
                transform,
                flip_normal: false,
                material,
                caustic_photons: 1.0,
                illumination: None,
                emission: None,
                displacement: None,
                group: None,
            },
        });
    }
    Ok(extended)
}

/// The box around everything that has a place, grown by a factor: its sides move out alike, so that a flat scene has a box too.
fn grown(description: &SceneDescription, around: &Bounds3, grow: f64) -> Bounds3 {
    let eye = description.camera.iter().map(|camera| camera.eye);
    let lights = description.lights.iter().filter_map(|light| match light.value {
        LightDescription::Point { position, .. }
        | LightDescription::Spot { position, .. }
        | LightDescription::Profile { position, .. } => Some(position),
        LightDescription::Directional { .. }
        | LightDescription::Sun { .. }
        | LightDescription::Environment { .. }
        | LightDescription::EnvironmentMap { .. }
        | LightDescription::Sky { .. }
        | LightDescription::CieSky { .. } => None,
    });
    let all = eye.chain(lights).fold(*around, Bounds3::with_point);
    let out = (grow - 1.0) * all.radius();
    Bounds3 { min: all.min - out, max: all.max + out }
}
