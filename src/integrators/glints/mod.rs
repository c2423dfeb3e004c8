//! Glints: emitters seen through glass and mirrors whose image is smaller than a pixel.
//!
//! A camera ray finds an emitter behind specular surfaces by chance alone, because shadow rays cannot pass those surfaces. Where the
//! image is a small part of a pixel, the probability is small and the contribution is large: a white dot in one rendering, none in the
//! next.
//!
//! The finder searches for them before the image is rendered ([`GlintFinder`]). It starts from rays that leave a specular chain close to
//! an emitter, and applies Newton's method on the image plane. (Newton's method on specular chains: Jakob & Marschner, "Manifold
//! Exploration", SIGGRAPH 2012. Here the camera's end of the chain moves. The derivative of the ray is found by following two
//! neighbouring rays, as derived by Igehy, "Tracing Ray Differentials", SIGGRAPH 1999.) The result is a chain of surfaces and an ellipse
//! on the image. Pixels then take additional camera samples from the ellipses; these and the pixel's own samples are weighted by the
//! balance heuristic (Veach & Guibas 1995). Nothing is blurred, and the mean does not change, whether all glints were found or none.

mod chain;
mod cone_light;
mod finder;
mod map;

pub(super) use chain::Chain;
pub(super) use cone_light::spread_of;
pub use finder::{FARTHEST_GLINT, Glint, GlintFinder};
pub use map::{ChanceMeetings, GlintMap, GlintView, PixelGlints};
