//! Scenes of the suite: parsing, and measurement of their quantities.

use super::ValidateError;
use crate::embree::Device;
use crate::film::{Filter, LayerSet};
use crate::photons::{Photon, PhotonMap, TraceSettings, TracedPhotons, trace_photons};
use crate::render::{
    IntegratorKind, Overrides, ProbeEstimator, ProbePoint, ProbeRequest, RenderError, RenderRequest,
    Settings, Silent, build_maps, probe, render,
};
use crate::scene::{MapKind, Scene};
use crate::scene_file::{BuiltScene, SceneDescription, build_scene, parse_scene};
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// Width and height of pictures, in pixels.
const SIZE: u32 = 16;

/// Lift of probed points: search distance above and below a surface, in metres.
const LIFT: f64 = 1e-3;

/// Settings for photon maps with final gathering at each sample.
pub(super) fn photon_map() -> Overrides {
    Overrides {
        integrator: Some(IntegratorKind::PhotonMap),
        irradiance_cache: Some(false),
        ..Overrides::default()
    }
}

/// Settings for path tracing.
pub(super) fn path() -> Overrides {
    Overrides { integrator: Some(IntegratorKind::Path), ..Overrides::default() }
}

pub(super) fn place(x: f64, y: f64, z: f64, normal: DVec3) -> ProbePoint {
    ProbePoint { position: DVec3::new(x, y, z), normal }
}

/// A scene ready to be measured.
pub(super) struct Stage {
    description: SceneDescription,
    built: BuiltScene,
}

impl Stage {
    pub(super) fn new(device: &Arc<Device>, text: &str) -> Result<Self, ValidateError> {
        let description = parse_scene(text, Path::new("suite.toml"), &[])?;
        let built = build_scene(&description, device, (SIZE, SIZE))?;
        Ok(Self { description, built })
    }

    pub(super) fn scene(&self) -> &Scene {
        &self.built.scene
    }

    fn settings(&self, overrides: Overrides, seed: u64) -> Settings {
        let overrides = Overrides { seed: Some(seed), ..overrides };
        Settings::from(&overrides.over(self.description.render.clone()))
    }

    /// Irradiance in W/m^2 at points from one estimator: direct, caustic, indirect and total.
    pub(super) fn irradiance(
        &self,
        (estimator, samples): (ProbeEstimator, u32),
        points: &[ProbePoint],
        overrides: Overrides,
        seed: u64,
    ) -> Result<Vec<[DVec3; 4]>, ValidateError> {
        let request = ProbeRequest {
            points: points.to_vec(),
            estimators: vec![estimator],
            samples,
            batches: 1,
            lift: LIFT,
            settings: self.settings(overrides, seed),
        };
        let probed = probe(self.scene(), &request, &Silent)?.ok_or(ValidateError::Stopped)?;
        let found = probed.points.iter().map(|surface| {
            let reading = surface.as_ref().and_then(|surface| surface.readings.first());
            reading.map(|reading| reading.irradiance).ok_or(ValidateError::Missing("a place"))
        });
        found.collect()
    }

    /// Mean of one layer of a small picture.
    pub(super) fn layer(&self, name: &str, overrides: Overrides, seed: u64) -> Result<DVec3, ValidateError> {
        let request = RenderRequest {
            width: SIZE,
            height: SIZE,
            crop: None,
            filter: Filter::Box { radius: 0.5 },
            layers: LayerSet::default(),
            settings: self.settings(overrides, seed),
        };
        let developed = render(self.scene(), &self.built.camera, &request, &Silent)?.film.develop();
        let layer = developed.layer(name).ok_or(ValidateError::Missing("a layer"))?;
        let pixels = layer.values.chunks_exact(3).map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()));
        Ok(pixels.sum::<DVec3>() / f64::from(SIZE * SIZE))
    }

    /// Flux in watts of the photons of a map that `wanted` selects by their positions in metres, for each of `areas`.
    pub(super) fn flux(
        &self,
        (kind, stored): (MapKind, u64),
        areas: usize,
        wanted: impl Fn(usize, DVec3) -> bool,
        seed: u64,
    ) -> Result<Vec<DVec3>, ValidateError> {
        let settings = TraceSettings {
            kind,
            stored,
            seed,
            max_depth: 1000,
            aimed: true,
            wavelengths: Default::default(),
        };
        let traced = trace_photons(self.scene(), &settings, &|_, _| true);
        let TracedPhotons { photons, emitted, .. } = traced.ok_or(ValidateError::Missing("a photon"))?;
        Ok(self.sum(photons, emitted, areas, wanted))
    }

    /// Builds the caustic map.
    pub(super) fn caustic_map(&self, photons: u64, seed: u64) -> Result<PhotonMap, ValidateError> {
        let overrides = Overrides { global_photons: Some(0), caustic_photons: Some(photons), ..photon_map() };
        let settings = self.settings(overrides, seed);
        let pass = build_maps(self.scene(), &settings.plan(self.scene()), &settings, &Silent)
            .map_err(RenderError::from)?;
        pass.maps.caustic.ok_or(ValidateError::Missing("a caustic map"))
    }

    /// Sums up the flux in watts of photons, of `emitted`, in each of `areas`.
    pub(super) fn sum(
        &self,
        photons: impl IntoIterator<Item = Photon>,
        emitted: u64,
        areas: usize,
        wanted: impl Fn(usize, DVec3) -> bool,
    ) -> Vec<DVec3> {
        let space = self.scene().space();
        let watts = 1.0 / (space.power * space.scale * space.scale * emitted as f64);
        let mut sums = vec![DVec3::ZERO; areas];
        for photon in photons {
            let position = space.world_position(photon.position.as_dvec3());
            for (area, sum) in sums.iter_mut().enumerate() {
                if wanted(area, position) {
                    *sum += watts * photon.power().as_dvec3();
                }
            }
        }
        sums
    }
}
