//! Progressive refinement (Cohen, Chen, Wallace & Greenberg 1988): no matrix, one row of form factors at a time.

use super::model::{NONE, Optics};
use super::refine::Hierarchy;
use super::{PatchIrradiance, RadiosityError};
use crate::observer::Observer;
use glam::DVec3;
use rayon::prelude::*;

/// Shoots until the share of light that is left is below the tolerance. Patches must not be divided further.
pub(super) fn shoot(
    hierarchy: &mut Hierarchy<'_>,
    observer: &dyn Observer,
) -> Result<Vec<PatchIrradiance>, RadiosityError> {
    /// Most patches that shoot, in passes over all of them.
    const MOST_PASSES: usize = 1000;
    /// Smaller shares of all light take more shots than they are worth.
    const LEAST: f64 = 1e-4;
    let elements = hierarchy.model.elements.len();
    let leaves: Vec<u32> =
        (0..elements as u32).filter(|&i| hierarchy.model.elements[i as usize].children == NONE).collect();
    let area = |leaf: u32| hierarchy.model.elements[leaf as usize].area;
    let optics = |leaf: u32| hierarchy.state.optics[leaf as usize];
    let lights = |leaf: u32| hierarchy.state.lights[leaf as usize].0.as_dvec3();
    // Reflected light that is left to be shot; emission goes with the first shot of a patch.
    let mut left: Vec<DVec3> =
        leaves.iter().map(|&leaf| optics(leaf).reflectance.as_dvec3() * lights(leaf)).collect();
    let mut emission: Vec<DVec3> = leaves.iter().map(|&leaf| optics(leaf).emission.as_dvec3()).collect();
    let mut direct = vec![DVec3::ZERO; leaves.len()];
    let mut indirect = vec![DVec3::ZERO; leaves.len()];
    let power = |i: usize, left: &[DVec3], emission: &[DVec3]| {
        (left[i] + emission[i]).max_element() * area(leaves[i])
    };
    let all: f64 = (0..leaves.len()).map(|i| power(i, &left, &emission)).sum();
    let target = all * hierarchy.options.tolerance.max(LEAST);
    observer.begin("shooting light", 1000);
    let (mut shots, mut computed) = (0usize, 0u64);
    loop {
        let powers = (0..leaves.len()).map(|i| power(i, &left, &emission));
        let (mut sum, mut most) = (0.0, (0, 0.0));
        for (i, power) in powers.enumerate() {
            sum += power;
            if power > most.1 {
                most = (i, power);
            }
        }
        if sum <= target {
            break;
        }
        if observer.is_cancelled() {
            return Err(RadiosityError::Stopped);
        }
        if shots >= MOST_PASSES * leaves.len() || !sum.is_finite() || sum > 1e6 * all {
            return Err(RadiosityError::Diverges);
        }
        let from = most.0;
        let row: Vec<f64> = leaves
            .par_iter()
            .map(|&to| hierarchy.factors.between(&hierarchy.model, leaves[from], to).exchange)
            .collect();
        computed += row.len() as u64;
        let (emitted, reflected) = (std::mem::take(&mut emission[from]), std::mem::take(&mut left[from]));
        for (to, exchange) in row.into_iter().enumerate().filter(|(_, exchange)| *exchange > 0.0) {
            let share = exchange / area(leaves[to]);
            direct[to] += emitted * share;
            indirect[to] += reflected * share;
            left[to] += optics(leaves[to]).reflectance.as_dvec3() * (emitted + reflected) * share;
        }
        shots += 1;
        observer.advance((1000.0 * (1.0 - (sum - target) / all).clamp(0.0, 1.0)) as u64);
    }
    hierarchy.computed += computed;
    hierarchy.sweeps = u32::try_from(shots).unwrap_or(u32::MAX);
    let mut irradiance = vec![PatchIrradiance::default(); elements];
    for (i, &leaf) in leaves.iter().enumerate() {
        let Optics { reflectance, emission } = hierarchy.state.optics[leaf as usize];
        let others = hierarchy.state.lights[leaf as usize].0;
        hierarchy.state.received[leaf as usize] = direct[i] + indirect[i];
        let arriving = direct[i] + indirect[i] + others.as_dvec3();
        hierarchy.state.radiosity[leaf as usize] = emission.as_dvec3() + reflectance.as_dvec3() * arriving;
        irradiance[leaf as usize] =
            PatchIrradiance { direct: direct[i].as_vec3() + others, indirect: indirect[i].as_vec3() };
    }
    for index in (0..elements as u32).rev() {
        super::links::pull(&hierarchy.model, &mut hierarchy.state, index);
    }
    Ok(irradiance)
}
