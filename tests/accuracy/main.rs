//! Pictures and photon maps against closed forms, against references made by others, and against each other.
//!
//! Everything goes the way of a user: scene text, description, scene, plan, maps, film. All random numbers have fixed
//! seeds, so a test that passes once passes always on the same machine; tolerances are nevertheless chosen so that
//! other seeds pass as well, and each says where it comes from.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod adaptive;
mod cache;
mod closed_forms;
mod contact;
mod crossings;
mod densities;
mod determinism;
mod direct;
mod dispersion;
mod emitters;
mod enclosures;
mod estimators;
mod extremes;
mod glints;
mod glossy;
mod guide;
mod illumination;
mod jensen96;
mod leaks;
mod lights;
mod many_lights;
mod matrix;
mod media;
mod photon_pass;
mod pictures;
mod probe;
mod progressive;
mod projection;
mod refraction;
mod robust_rays;
mod rooms;
mod shading_normals;
mod shadow_photons;
mod support;
mod validate;
