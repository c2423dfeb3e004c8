//! Textures. [`ImageTexture`] is a texture from a picture; [`TextureBudget`] decides whether it lies in memory as a whole or is read by
//! tiles. Solid textures are colours and bumps as functions of the position in the scene, as if surfaces were cut out of a block.
//!
//! Solid textures follow Perlin, "An Image Synthesizer" (1985): noise, turbulence, and wood and marble based on them. Positions are in
//! metres of the world. All solid textures are band-limited: octaves below a given wavelength are left out, and the last octaves fade.

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
