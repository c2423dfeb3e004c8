//! Memory that a scene is estimated to need, before its meshes are read.

use super::description::SceneDescription;
use super::mesh_size::{kept_textures, mesh_sizes};
use crate::memory::{FILM, INSTANCE, LIGHT, MemoryEstimate};

impl MemoryEstimate {
    /// Estimate for the meshes and the picture. Shapes listed in the scene file itself are small.
    pub fn of_scene(scene: &SceneDescription, (width, height): (u32, u32)) -> Self {
        let sizes = mesh_sizes(scene);
        let triangles = sizes.iter().map(|size| size.triangles).fold(0, u64::saturating_add);
        Self {
            meshes: sizes.iter().map(|size| size.bytes()).fold(0, u64::saturating_add),
            reading: sizes.iter().map(|size| size.reading).max().unwrap_or(0),
            lights: lights_of(scene).saturating_mul(LIGHT)
                + (scene.instances.len() as u64).saturating_mul(INSTANCE),
            textures: kept_textures(scene),
            film: FILM * u64::from(width) * u64::from(height),
            ..Self::of_triangles(triangles)
        }
    }
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
