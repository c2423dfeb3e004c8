//! Warnings about a finished picture.

use super::maps::{contradiction, is_worth_a_warning};
use super::stats::Statistics;
use crate::image_io::take_tile_failures;
use crate::media::MOST_MEDIA;
use crate::scene::{IntegratorKind, MapKind, Scene};

/// Adds the warnings that follow from the counters and the scene.
pub(super) fn warn(statistics: &mut Statistics, scene: &Scene) {
    let counters = &statistics.counters;
    let mut warnings = Vec::new();
    if statistics.rejected_samples > 0 {
        warnings.push(format!("{} samples were not finite and were left out", statistics.rejected_samples));
    }
    if is_worth_a_warning(counters.truncated, counters.camera_rays) {
        warnings.push(format!(
            "{} paths were cut off at {} surfaces; their light is missing (raise --max-depth)",
            counters.truncated, statistics.settings.max_depth
        ));
    }
    if is_worth_a_warning(counters.medium_mismatches, counters.interfaces) {
        warnings.push(format!(
            "{} times a ray {}",
            counters.medium_mismatches,
            contradiction(&scene.mismatched())
        ));
    }
    if is_worth_a_warning(counters.rare_glints, counters.camera_rays) {
        warnings.push(format!(
            "images of light sources in glass or mirrors were met {} time(s) where the samples are too few to show how bright they are, and were \
             dimmed by how rare that is (raise --spp, or --rounds; --glints false shows white dots)",
            counters.rare_glints
        ));
    }
    if statistics.settings.integrator == IntegratorKind::Path && scene.has_hidden_caustics() {
        warnings.push(
            "paths from the camera never hit a point or parallel light, so their light is missing where it comes by way \
             of mirrors or glass; the photon map has it, or give the lights a size"
                .to_owned(),
        );
    }
    let shown = match statistics.settings.map {
        MapKind::Global => ("global", &statistics.plan.global_map),
        MapKind::Caustic => ("caustic", &statistics.plan.caustic_map),
    };
    let shows_map = statistics.settings.integrator == IntegratorKind::Photons && statistics.atlas.is_none();
    if shows_map && !shown.1.build {
        warnings.push(format!(
            "the picture is that of the {} map, which is not built ({}): it shows nothing but lamps; choose another --map",
            shown.0, shown.1.reason
        ));
    }
    let overfull = scene.overfull();
    if !overfull.is_empty() {
        warnings.push(format!(
            "bodies of more than {MOST_MEDIA} media overlap at one place, of which only {MOST_MEDIA} are followed, so that light \
             behind them is wrong: give some of them the same medium, or take them apart ({})",
            overfull.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
        ));
    }
    let panics = scene.embree().panics();
    if panics > 0 {
        warnings.push(format!("a procedural object failed {panics} times; those rays missed it"));
    }
    warnings.extend(take_tile_failures());
    statistics.warnings.extend(warnings);
}
