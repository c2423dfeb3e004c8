//! Pass 1: photons, the maps they are stored in, and the estimates made from them.

mod kernel;

pub use kernel::{Estimator, Kernel, MapKind, SearchRegion};
