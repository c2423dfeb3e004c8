//! The program as a user meets it, and what its files and messages promise: one file for each subject.
//!
//! All of them are one binary, so that the library is linked once and tests run side by side. What must run alone has a binary of its
//! own beside this folder.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod atlas;
mod broken_files;
mod cameras;
mod cli;
mod common;
mod error_figures;
mod first_pictures;
mod image_io;
mod libraries;
mod materials;
mod mesh_looks;
mod messages;
mod mitsuba;
mod obj_materials;
mod outputs;
mod parts;
mod pbrt;
mod radiosity;
mod saved_maps;
mod statistics;
mod structure;
