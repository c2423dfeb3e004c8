//! The least that a renderer can do with a large mesh: read the file once, piece by piece into Embree's buffers, build, trace one
//! ray. What `cardioid render` takes up to its first camera ray is measured against this, see `benches/large_mesh.sh`.
//!
//! Reads binary little-endian PLY with vertices of three floats and faces of a byte 3 and three integers, and nothing else.

use cardioid::embree::{Device, SceneBuilder, TriangleBuffers};
use cardioid::math::Ray;
use glam::Vec3;
use std::error::Error;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::sync::Arc;
use std::time::Instant;

/// Records that are read at once.
const BATCH: usize = 1 << 14;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: bare_build FILE.ply [THREADS]")?;
    let threads = std::env::args().nth(2).map_or(Ok(0), |text| text.parse())?;
    let start = Instant::now();
    let mut file = BufReader::new(File::open(path)?);
    let (mut vertices, mut faces, mut line) = (0, 0, String::new());
    while line.trim() != "end_header" {
        line.clear();
        if file.read_line(&mut line)? == 0 {
            return Err("no line `end_header`".into());
        }
        if let Some(count) = line.strip_prefix("element vertex ") {
            vertices = count.trim().parse()?;
        } else if let Some(count) = line.strip_prefix("element face ") {
            faces = count.trim().parse()?;
        }
    }
    let word = |bytes: &[u8], at: usize| [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
    // One more than there are, which the buffers need as padding.
    let mut positions: Vec<[f32; 3]> = Vec::with_capacity(vertices + 1);
    let mut buffer = vec![0; BATCH * 13];
    while positions.len() < vertices {
        let bytes = &mut buffer[..BATCH.min(vertices - positions.len()) * 12];
        file.read_exact(bytes)?;
        positions.extend(
            bytes.chunks_exact(12).map(|record| [0, 4, 8].map(|at| f32::from_le_bytes(word(record, at)))),
        );
    }
    let mut triangles: Vec<[u32; 3]> = Vec::with_capacity(faces);
    while triangles.len() < faces {
        let bytes = &mut buffer[..BATCH.min(faces - triangles.len()) * 13];
        file.read_exact(bytes)?;
        triangles.extend(
            bytes.chunks_exact(13).map(|record| [1, 5, 9].map(|at| u32::from_le_bytes(word(record, at)))),
        );
    }
    let read = start.elapsed();
    let mut builder = SceneBuilder::new(&Arc::new(Device::new(threads)?))?;
    builder.add_triangles(TriangleBuffers::new(positions, triangles)?)?;
    let scene = builder.commit()?;
    let hit = scene.intersect(&Ray::new(Vec3::new(0.1, 0.2, 10.0), Vec3::NEG_Z));
    println!(
        "{vertices} vertices, {faces} triangles: read {:.2} s, in all {:.2} s, {hit:?}",
        read.as_secs_f64(),
        start.elapsed().as_secs_f64()
    );
    Ok(())
}
