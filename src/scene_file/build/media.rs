//! Media of a scene, and the order that decides which of them fills a place where bodies overlap.

use super::super::description::{
    MaterialDescription, MediumDescription, Named, SceneDescription, VolumeDescription,
};
use super::densities::{WorldDensity, of};
use super::{BuildError, BuildProblem};
use crate::math::Bounds3;
use crate::media::{Medium, Volume};
use crate::scene::RenderSpace;
use crate::spectra::LineIndices;
use std::cmp::Reverse;
use std::sync::Arc;

/// The media of a scene with shapes `placed` there (number and bounds of each), and their densities in the world.
pub(super) fn media(
    description: &SceneDescription,
    space: &RenderSpace,
    placed: &[(usize, Bounds3)],
    densities: Vec<Option<WorldDensity>>,
) -> Result<Vec<Medium>, BuildError> {
    let ranks = ranks(description, placed);
    type Parts<'a> = ((&'a Named<MediumDescription>, Option<WorldDensity>), u32);
    let medium = |((medium, density), rank): Parts<'_>| {
        let volume = medium.value.volume.as_ref().zip(density);
        let volume = volume.map(|(volume, density)| in_render_space(volume, density, space)).transpose();
        let volume = volume.map_err(|problem| of(medium, problem))?;
        Ok(Medium {
            name: medium.name.clone(),
            ior: medium.value.ior as f32,
            dispersion: medium.value.dispersion.as_ref().map(LineIndices::new),
            absorption: (medium.value.absorption / space.scale).as_vec3(),
            volume: volume.map(Arc::new),
            rank,
        })
    };
    description.media.iter().zip(densities).zip(ranks).map(medium).collect()
}

/// A volume with its density in render space, coefficients per unit of that, and with its emission in render units of radiance.
fn in_render_space(
    volume: &VolumeDescription,
    density: WorldDensity,
    space: &RenderSpace,
) -> Result<Volume, BuildProblem> {
    let (coefficients, to_render) = (volume.coefficients, space.to_affine());
    let (density, fire) = density.placed(to_render)?;
    let fire = fire.map(|fire| fire.placed(to_render)).transpose()?;
    let emission = match &fire {
        // What absorbs glows (Kirchhoff).
        Some((_, hottest)) => coefficients.absorption().as_dvec3() * *hottest,
        None => coefficients.emission().as_dvec3(),
    };
    let scaled = coefficients
        .with_emission((emission * space.power).as_vec3())?
        .per_length((1.0 / space.scale) as f32)?;
    let volume = Volume::new(scaled, volume.phase, density);
    Ok(match fire {
        Some((glow, _)) => volume.glowing(glow),
        None => volume,
    })
}

/// Rank of each medium where bodies overlap: by the priority in the scene, then the smaller body before the larger one (ice
/// before the drink, the drink before its glass), then by the order of the file.
fn ranks(description: &SceneDescription, placed: &[(usize, Bounds3)]) -> Vec<u32> {
    let media = &description.media;
    let mut largest = vec![0.0f64; media.len()];
    for (shape, bounds) in placed {
        let inside = match description.materials[description.shapes[*shape].value.material].value {
            MaterialDescription::Dielectric { inside, .. } => inside,
            MaterialDescription::Layered { media: Some([inside, _]), .. } => inside,
            _ => continue,
        };
        if !bounds.is_empty() {
            largest[inside] = largest[inside].max(bounds.radius());
        }
    }
    let mut order: Vec<usize> = (0..media.len()).collect();
    order.sort_by(|&a, &b| {
        let priority = |id: usize| Reverse(media[id].value.priority);
        priority(a).cmp(&priority(b)).then(largest[a].total_cmp(&largest[b])).then(a.cmp(&b))
    });
    let mut ranks = vec![0; media.len()];
    for (rank, id) in order.into_iter().enumerate() {
        ranks[id] = rank as u32;
    }
    ranks
}
