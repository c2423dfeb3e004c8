//! Pixels: reconstruction filters, the sums behind each layer of a picture, and its development for a screen.
//!
//! Buffers only; files are written by `image_io`.

mod buffer;
mod filter;
mod layers;
mod rect;
mod tone;

pub use buffer::{Developed, Film, FilmError, Layer, PixelSample, Rejections, Tile};
pub use filter::{Filter, FilterError, FilterSample, FilterSampler};
pub use layers::{AOVS, Aov, LayerSet};
pub use rect::PixelRect;
pub use tone::{Rendition, ToneCurve, ToneMap, auto_exposure, srgb_decode, srgb_encode, srgb_encode_u8};
