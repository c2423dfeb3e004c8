//! Memory that a scene is estimated to need, before its meshes are read.

use super::description::{DensityDescription, SceneDescription};
use super::mesh_size::{kept_textures, mesh_sizes};
use crate::media::{VdbSize, vdb_size};
use crate::memory::{FILM, INSTANCE, LIGHT, MemoryEstimate};

impl MemoryEstimate {
    /// Estimate for the meshes, the voxels and the picture. Shapes listed in the scene file itself are small. Files of voxels are read for
    /// that, by the process that reads them later too.
    pub fn of_scene(scene: &SceneDescription, (width, height): (u32, u32)) -> Self {
        let sizes = mesh_sizes(scene);
        let voxels = vdb_sizes(scene);
        let triangles = sizes.iter().map(|size| size.triangles).fold(0, u64::saturating_add);
        Self {
            meshes: sizes.iter().map(|size| size.bytes()).fold(0, u64::saturating_add),
            reading: sizes
                .iter()
                .map(|size| size.reading)
                .chain(voxels.iter().map(|size| size.reading))
                .max()
                .unwrap_or(0),
            voxels: voxels.iter().map(|size| size.bytes).fold(0, u64::saturating_add),
            lights: lights_of(scene).saturating_mul(LIGHT)
                + (scene.instances.len() as u64).saturating_mul(INSTANCE),
            textures: kept_textures(scene),
            film: FILM * u64::from(width) * u64::from(height),
            ..Self::of_triangles(triangles)
        }
    }
}

/// Sizes of all grids of voxels. A file that cannot be read is left out here; the error follows when it is loaded.
fn vdb_sizes(scene: &SceneDescription) -> Vec<VdbSize> {
    let density =
        |medium: &super::Named<super::MediumDescription>| match &medium.value.volume.as_ref()?.density {
            DensityDescription::Vdb { file, grid, fire, .. } => {
                let fire = fire.as_ref().and_then(|fire| vdb_size(file, Some(&fire.grid)).ok());
                let size = vdb_size(file, grid.as_deref()).ok()?;
                Some(VdbSize { bytes: size.bytes + fire.map_or(0, |fire| fire.bytes), ..size })
            }
            DensityDescription::Noise(_) => {
                Some(VdbSize { bytes: super::build::NOISE_BYTES, ..VdbSize::default() })
            }
            DensityDescription::Even | DensityDescription::Height { .. } => None,
        };
    scene.media.iter().filter_map(density).collect()
}

/// Number of lights of a description, including each placement of an emitting shape.
fn lights_of(scene: &SceneDescription) -> u64 {
    let mut instances = vec![0u64; scene.groups.len()];
    scene.instances.iter().for_each(|instance| instances[instance.value.group] += 1);
    let emitters = scene.shapes.iter().filter(|shape| shape.value.emission.is_some());
    let placed = emitters.map(|shape| shape.value.group.map_or(1, |group| instances[group]));
    placed.fold(scene.lights.len() as u64, u64::saturating_add)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_count_before_they_are_read() {
        use openvdb_sys::{Dense, GridClass, is_compiled, write};
        if !is_compiled() {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cloud.vdb");
        let values: Vec<f32> = (0..64 * 64 * 64).map(|i| 0.5 + i as f32).collect();
        let to_world = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]];
        let (name, origin, size, class) = ("density", [0; 3], [64; 3], GridClass::FogVolume);
        write(&file, &Dense { name, origin, size, values: &values, to_world, class, is_half: false })
            .unwrap();
        let text = format!(
            "[media.m]\nscattering = 1\nfills = \"bounds\"\ndensity = {{ type = \"vdb\", file = {file:?} }}"
        );
        let scene = super::super::parse_scene(&text, std::path::Path::new("a.toml"), &[]).unwrap();
        let estimate = MemoryEstimate::of_scene(&scene, (1, 1));
        assert!((1 << 20..2 << 20).contains(&estimate.voxels) && estimate.reading >= 1 << 20, "{estimate:?}");
        let told = estimate.check(Some(1 << 20)).unwrap_err().to_string();
        assert!(told.contains("voxels of media 1 MB"), "{told}");
        // Photons depend on what the file holds, and not on its name.
        let hash = super::super::photon_content_hash(&scene).unwrap();
        let moved = folder.path().join("other.vdb");
        std::fs::rename(&file, &moved).unwrap();
        let text = text.replace("cloud", "other");
        let scene = super::super::parse_scene(&text, std::path::Path::new("a.toml"), &[]).unwrap();
        assert_eq!(super::super::photon_content_hash(&scene).unwrap(), hash);
        write(
            &moved,
            &Dense { name, origin: [8; 3], size, values: &values, to_world, class, is_half: false },
        )
        .unwrap();
        assert_ne!(super::super::photon_content_hash(&scene).unwrap(), hash);
    }

    #[test]
    fn emitters_count_where_they_stand() {
        let text = "
            [materials.white]
            type = \"lambert\"
            reflectance = 0.5
            [[shapes]]
            type = \"sphere\"
            radius = 1
            material = \"white\"
            emission = { radiance = 1 }
            group = \"lamp\"
            [[shapes]]
            type = \"sphere\"
            radius = 1
            material = \"white\"
            emission = { radiance = 1 }
            [[instances]]
            group = \"lamp\"
            repeat = { count = [5, 2, 1], step = [3, 3, 3] }
            [[lights]]
            type = \"point\"
            position = [0, 9, 0]
            power = 1
        ";
        let scene = super::super::parse_scene(text, std::path::Path::new("a.toml"), &[]).unwrap();
        assert_eq!(lights_of(&scene), 10 + 1 + 1);
        assert!(MemoryEstimate::of_scene(&scene, (1, 1)).lights >= 12 * LIGHT);
    }
}
