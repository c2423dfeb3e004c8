//! Glints: lamps seen in glass and mirrors where their image is smaller than a pixel.
//!
//! A ray of the camera that meets a lamp behind specular surfaces finds it by chance alone, as no shadow ray passes those. Where the
//! image is a small part of a pixel the chance is small and what it brings is large: a white dot in one picture, none in the next.
//!
//! Here they are looked for before the picture is rendered ([`GlintFinder`]): from rays that leave a chain of specular surfaces not far
//! off a lamp, by Newton's method on the picture plane. (Newton's method on chains of specular surfaces: Jakob & Marschner,
//! "Manifold Exploration", SIGGRAPH 2012; here the camera's end of the chain is what moves, and how the ray moves with it is found by
//! following two rays beside it, as Igehy, "Tracing Ray Differentials", SIGGRAPH 1999, derives.) What is found is a chain of surfaces
//! and an ellipse on the picture. Pixels then draw further camera samples from the ellipses, and these and the pixel's own samples are
//! weighted by the balance heuristic (Veach & Guibas 1995). Nothing is blurred and the mean does not change, whether
//! all glints were found or none.

mod chain;
mod cone_light;
mod finder;
mod map;

pub(super) use chain::Chain;
pub(super) use cone_light::spread_of;
pub use finder::{FARTHEST_GLINT, Glint, GlintFinder};
pub use map::{ChanceMeetings, GlintMap, GlintView, PixelGlints};
