//! Adds the materials of shapes, each once.

use super::Importer;
use super::import::Building;
use super::import::material::{Filling, Finished, Look};
use super::surface::Surface;
use super::value::Object;
use crate::textures::TextureSlot;
use std::rc::Rc;

impl Importer<'_> {
    /// The scene that is built, for what all importers share.
    pub(super) fn building(&mut self) -> Building<'_> {
        Building { scene: &mut self.description, report: &mut self.report }
    }

    /// Adds the material of a shape, once for each kind of interior. `glow` scales the emission of its surface.
    pub(super) fn material(
        &mut self,
        bsdf: &Rc<Object>,
        surface: &Surface,
        within: Filling,
        glow: Option<TextureSlot>,
    ) -> Finished {
        let is_shared = glow.is_none();
        let key = (Rc::as_ptr(bsdf), within.key());
        if let (Some(known), true) = (self.materials.get(&key), is_shared) {
            return *known;
        }
        let look = Look { bsdf: &**bsdf, surface, fillings: [within, Filling::default()], glow };
        let finished = self.building().material(&look, None);
        if is_shared {
            self.materials.insert(key, finished);
        }
        finished
    }
}
