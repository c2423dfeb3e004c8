//! Wavelengths: the observer, the wavelength of a path, and indices of refraction that depend on it.
//!
//! Paths carry RGB until light is refracted into a medium whose index depends on the wavelength. There a path takes one wavelength, its
//! [`Line`], and keeps it. `docs/dispersion.md` has the formulae.

pub(crate) mod cie;
mod glasses;
mod index;
mod line;
mod primaries;

pub use glasses::{NAMED_GLASSES, NamedGlass, named_glass};
pub use index::{Dispersion, DispersionError, LineIndices};
pub use line::{Line, at_line};

/// The wavelengths at which paths are sampled, nm: the observer sees less than a ten-thousandth of daylight outside.
pub const VISIBLE: [f64; 2] = [380.0, 780.0];

/// Fraunhofer's lines, nm: C (hydrogen, red), d (helium, yellow) and F (hydrogen, blue), at which glass makers state indices.
pub const FRAUNHOFER: [f64; 3] = [656.2725, 587.5618, 486.1327];
