//! Pass 1: photons, the maps they are stored in, and the estimates made from them.

mod differential;
mod domain;
mod emission;
mod estimate;
mod guide;
mod irradiance;
mod kd_tree;
mod kernel;
mod map;
mod photon;
mod shadow;
mod shadow_decision;
mod trace;

pub use domain::{FEELERS, KernelDomain};
pub use emission::{Aim, EmittedPhoton, emit};
pub use estimate::{Estimate, EstimateParams};
pub use guide::{DirectionGuide, GuideLobe, GuideParams};
pub use irradiance::IrradianceMap;
pub use kernel::{Estimator, Kernel, SearchRegion};
pub use map::{DISC_FLATNESS, MIN_NORMAL_COS, Neighbours, PhotonMap, Query, Scratch};
pub use photon::{NORMAL_ERROR, Photon, PhotonClass, PhotonClasses};
pub use shadow::{ShadowMaps, ShadowTally, TracedShadows, build_shadow_maps, trace_shadow_photons};
pub use shadow_decision::{CONFIDENCE, LARGEST_UNSEEN_SHARE, ShadowDecision};
pub use trace::{
    PhotonTally, TraceSettings, TracedPhotons, record_photon_rays, trace_photons, trace_photons_alone,
};
