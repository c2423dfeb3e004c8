//! Pictures of a radiosity solution.

use super::maps::PassOne;
use super::pixels::{CameraSamples, PassTwo, statistics};
use super::settings::Settings;
use super::stats::RadiosityStatistics;
use super::{Observer, RenderError, RenderRequest, Rendered, Stop};
use crate::camera::Camera;
use crate::film::Film;
use crate::integrators::{PhotonMaps, RadiosityView, ShownRadiosity};
use crate::memory::resident_memory;
use crate::radiosity::Radiosity;
use crate::scene::{IntegratorKind, Scene};
use std::sync::Arc;
use std::time::Duration;

/// Renders a picture of `solution`, which must belong to `scene`. The settings of direct light, gather rays and specular surfaces are those
/// of photon mapping; no photon is traced.
///
/// # Errors
/// If the request is not valid ([`RenderError`]).
pub fn render_radiosity(
    scene: &Scene,
    camera: &Camera,
    request: &RenderRequest,
    (solution, view): (Arc<Radiosity>, RadiosityView),
    observer: &dyn Observer,
) -> Result<Rendered, RenderError> {
    if request.settings.spp == 0 {
        return Err(RenderError::NoSamples);
    }
    let settings = Settings {
        integrator: IntegratorKind::PhotonMap,
        // Only gather rays are worth a cache.
        irradiance_cache: request.settings.irradiance_cache && view == RadiosityView::Final,
        ..request.settings.clone()
    };
    let request = RenderRequest { settings, ..request.clone() };
    let settings = &request.settings;
    let plan = settings.plan(scene);
    let mut film = Film::new(request.width, request.height, request.crop, request.layers)?;
    let shown = RadiosityStatistics { view, solution: solution.report().clone() };
    let maps = PhotonMaps { radiosity: Some(ShownRadiosity { solution, view }), ..PhotonMaps::default() };
    let pass_one = PassOne { maps, ..PassOne::default() };
    let pass_two = PassTwo {
        scene,
        camera,
        request: &request,
        settings,
        plan: &plan,
        maps: &pass_one.maps,
        reading: settings.photon_map_settings(scene),
        glints: None,
        samples: CameraSamples { seed: settings.seed, first: 0 },
        seconds_sample: Duration::ZERO,
        observer,
    };
    let taken = pass_two.run(&mut film)?;
    let mut found = statistics(scene, settings, plan.clone(), pass_one);
    let stopped = match taken {
        Some(taken) => {
            let finished = taken.finished;
            found.take(taken);
            (!finished).then_some(Stop::DuringPixels)
        }
        None => Some(Stop::BeforePixels),
    };
    found.radiosity = Some(shown);
    found.memory.pixels = resident_memory();
    found.complete(&film, scene);
    Ok(Rendered { film, statistics: found, stopped, checkpoint_failure: None })
}
