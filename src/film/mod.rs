//! Pixels: reconstruction filters, the sums behind each layer of a picture, and its development for a screen.
//!
//! Buffers only; files are written by `image_io`.

mod filter;
mod rect;

pub use filter::{Filter, FilterError, FilterSample, FilterSampler};
pub use rect::PixelRect;
