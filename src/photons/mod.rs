//! Pass 1: photons, the photon maps that store them, and the estimates made from them.
// A new variant of a setting does not compile until every match handles it.
#![deny(clippy::wildcard_enum_match_arm, clippy::match_wildcard_for_single_variants)]

mod box_map;
mod clusters;
mod differential;
mod direction_bins;
mod discs;
mod domain;
mod emission;
mod estimate;
mod file;
mod global_projection;
mod group_file;
mod guide;
mod illumination;
mod irradiance;
mod kd_tree;
mod kernel;
mod map;
mod pass;
mod photon;
mod power;
mod projection_map;
mod projection_picture;
mod scattering;
mod shadow;
mod shadow_decision;
mod sources;
mod trace;
mod volume;

pub use crate::settings::{Estimator, Kernel, SearchRegion};
pub use domain::{FEELERS, KernelDomain, Seen, Sight};
pub use emission::{EmittedPhoton, Emitter};
pub(crate) use emission::{FEW_LIGHTS, FEW_TARGETS, LEAST_FOR_A_TABLE};
pub use estimate::{Estimate, EstimateParams, NARROWER};
pub use file::{
    PHOTON_FILE_VERSION, PhotonFile, PhotonFileError, PhotonFileProblem, SavedPhotons, read_photon_file,
    read_photon_maps, write_photon_file,
};
pub use group_file::{
    GROUP_FILE_VERSION, GroupFile, GroupFileError, GroupFileProblem, GroupWriter, PhotonOrder,
};
pub use guide::{DirectionGuide, GuideLobe, GuideParams, LocalGuide};
pub use illumination::{Deposit, IlluminationMaps, IlluminationSizes, split_deposits};
pub use irradiance::{DirectLight, IrradianceMap, PointIrradiance};
pub use map::{DISC_FLATNESS, MIN_NORMAL_COS, Neighbours, PhotonMap, Query, Scratch};
pub use pass::{
    CausticSurvey, PhotonsFor, StreamedPhotons, TakePhotons, TracedPhotons, record_photon_rays,
    stream_photons, survey_caustics, trace_media_photons, trace_photons, trace_photons_alone,
    trace_photons_for,
};
pub use photon::{NORMAL_ERROR, Photon, PhotonClass, PhotonClasses};
pub use projection_picture::{ProjectionPicture, projection_picture};
pub use shadow::{ShadowMaps, ShadowTally, TracedShadows, build_shadow_maps, trace_shadow_photons};
pub use shadow_decision::{CONFIDENCE, LARGEST_UNSEEN_SHARE, ShadowDecision};
pub use trace::{PhotonTally, TraceSettings};
pub use volume::{MediaLight, MediaMaps, MediaSizes, Reading};
