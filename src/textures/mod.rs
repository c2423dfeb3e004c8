//! Textures. Those from pictures are in [`ImageTexture`], whole or by tiles as [`TextureBudget`] has room; the others are solid: colours
//! and bumps that are functions of the place in the scene, as if surfaces were cut out of a block.
//!
//! After Perlin, "An Image Synthesizer" (1985): noise, turbulence, and wood and marble made of them. Places are in metres of the
//! world. All are band-limited: octaves finer than a stated length are left out, the last ones fading.

mod budget;
mod image;
mod noise;
mod slot;
mod solid;
mod tiles;

pub use budget::{
    DEFAULT_TEXTURE_MEMORY, TextureBudget, read_picture, read_picture_bytes, set_picture_memory,
    set_texture_memory,
};
pub use image::{Encoding, ImageTexture, Sampler, TEXTURE_LIMIT, Wrap, srgb_to_linear};
pub use noise::{Octaves, noise};
pub use slot::{Glow, TextureSlot, VertexData};
pub use solid::{Pattern, SolidTexture};
