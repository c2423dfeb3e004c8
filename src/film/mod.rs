//! Film: reconstruction filters, sums for each layer of a picture, and development for a screen.
//!
//! The module holds buffers only; `image_io` writes files.

mod buffer;
mod filter;
mod layers;
mod rect;
mod tone;

pub use buffer::{
    Developed, Film, FilmError, HalvedSum, Halves, Layer, PixelSample, Precision, Rejections, Tile,
};
pub use filter::{Filter, FilterError, FilterSample, FilterSampler};
pub use layers::{AOVS, Aov, LayerSet};
pub use rect::PixelRect;
pub use tone::{Rendition, ToneCurve, ToneMap, auto_exposure, srgb_decode, srgb_encode, srgb_encode_u8};
