//! Textures. Those from pictures are in [`ImageTexture`]; the others are solid: colours and bumps that are functions of the place in the scene, as if surfaces were cut out of a block.
//!
//! After Perlin, "An Image Synthesizer" (1985): noise, turbulence, and wood and marble made of them. Places are in metres of the
//! world. All are band-limited: octaves finer than a stated length are left out, the last ones fading.

mod image;
mod noise;
mod slot;
mod solid;

pub use image::{Encoding, ImageTexture, Sampler, TEXTURE_LIMIT, Wrap};
pub use noise::{Octaves, noise};
pub use slot::{Glow, TextureSlot, VertexData};
pub use solid::{Pattern, SolidTexture};
