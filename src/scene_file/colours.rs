//! Converts colours of vertices and faces in mesh files to reflectances.
//!
//! Programs show these colours on screens without conversion, so they are read as sRGB, whatever their number type. MeshLab,
//! CloudCompare and Blender write sRGB by default.

use super::mesh::MeshReport;
use crate::textures::srgb_to_linear;
use glam::Vec3;
use rayon::prelude::*;

/// Linear reflectances of sRGB colours with a maximum of `most`. Where some values exceed it, the file meant 255 or 65535.
/// Colours that are not numbers become white; the report counts them where other vertices have colours.
pub(super) fn reflectances(colours: Vec<[f32; 3]>, most: f32, report: &mut MeshReport) -> Vec<Vec3> {
    let largest = colours.par_iter().flat_map_iter(|colour| *colour).filter(|x| x.is_finite());
    let largest = largest.reduce(|| 0.0, f32::max);
    let scale = [most, 255.0, 65535.0].into_iter().find(|&scale| largest <= scale).unwrap_or(largest);
    report.scaled_colours |= scale != most;
    let is_colour = |colour: &[f32; 3]| colour.iter().all(|channel| channel.is_finite());
    report.colourless_vertices += colours.par_iter().filter(|colour| !is_colour(colour)).count() as u64;
    let reflectance = |colour: [f32; 3]| match is_colour(&colour) {
        true => Vec3::from_array(colour.map(|channel| srgb_to_linear((channel / scale).clamp(0.0, 1.0)))),
        false => Vec3::ONE,
    };
    colours.into_par_iter().map(reflectance).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_srgb_up_to_what_they_go_to() {
        let mut report = MeshReport::default();
        let grey = reflectances(vec![[0.5, 1.0, 0.0]], 1.0, &mut report)[0];
        assert!((grey - Vec3::new(0.214_041, 1.0, 0.0)).abs().max_element() < 1e-5, "{grey}");
        assert_eq!(report, MeshReport::default());
        let bytes = reflectances(vec![[127.5, 255.0, 0.0], [f32::NAN; 3]], 1.0, &mut report);
        assert_eq!(bytes, [grey, Vec3::ONE]);
        assert!(report.scaled_colours && report.colourless_vertices == 1);
        assert_eq!(reflectances(vec![[127.5, 255.0, 0.0]], 255.0, &mut report), [grey]);
    }
}
