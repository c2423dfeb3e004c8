//! Footprint of a pixel on each surface, from one camera ray per pixel (the pretrace of Jensen & Christensen 1995, section 3.2).

use crate::camera::Camera;
use crate::scene::Scene;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Finest pixel footprint by surface: the smallest distance between the points that rays through the centres of adjacent pixels hit on
/// it, in render space. It is infinite for surfaces that no two adjacent rays hit. The result covers the whole picture, even where only a
/// window is rendered.
pub fn finest_distances(scene: &Scene, camera: &Camera, (width, height): (u32, u32)) -> Vec<f32> {
    let size = Vec2::new(width as f32, height as f32);
    let row = |y: u32| -> Vec<Option<(u32, Vec3)>> {
        let look = |x: u32| {
            let ray = camera.ray(Vec2::new(x as f32 + 0.5, y as f32 + 0.5) / size);
            scene.intersect(&ray).map(|hit| (hit.surface, hit.point.position))
        };
        (0..width).map(look).collect()
    };
    let rows: Vec<_> = (0..height).into_par_iter().map(row).collect();
    let mut finest = vec![f32::INFINITY; scene.surfaces().len()];
    let mut pair = |a: &Option<(u32, Vec3)>, b: &Option<(u32, Vec3)>| {
        if let (Some((surface, p)), Some((other, q))) = (a, b)
            && surface == other
            && p != q
        {
            let least = &mut finest[*surface as usize];
            *least = least.min(p.distance(*q));
        }
    };
    for (y, row) in rows.iter().enumerate() {
        row.windows(2).for_each(|neighbours| pair(&neighbours[0], &neighbours[1]));
        if let Some(below) = rows.get(y + 1) {
            row.iter().zip(below).for_each(|(a, b)| pair(a, b));
        }
    }
    finest
}
