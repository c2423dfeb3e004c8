//! Derives the render plan from settings and a scene. The settings themselves are in [`crate::settings`].

use crate::scene::{RenderPlan, Scene};
pub use crate::settings::{
    GuideKind, IntegratorKind, MapKind, Overrides, Quality, Settings, ShadowMode, Show,
};

impl Settings {
    /// The plan of what to build for `scene` with these settings.
    pub fn plan(&self, scene: &Scene) -> RenderPlan {
        let shows_classes = self.integrator == IntegratorKind::Photons && self.show == Show::Classes;
        RenderPlan::new(scene, self.integrator, self.map)
            .with_cache(self.irradiance_cache)
            .with_precomputed(scene, self.integrator, self.precomputed_irradiance)
            .guided(scene, self.integrator, self.guide)
            .with_shadow_photons(scene, self.shadow_photons, shows_classes)
            .with_wavelengths(self.wavelengths)
            .with_glints(scene, self.integrator, self.glints)
    }
}
