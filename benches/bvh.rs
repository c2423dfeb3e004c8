//! Embree against hierarchies written in Rust, on the knot and on the mesh that `CARDIOID_BENCH_MESH` names: the same as
//! `cardioid bench bvh`.

use cardioid::embree::Device;
use cardioid::measure::bvh::{BvhBenchSettings, bench_bvh};
use cardioid::scene_file::{build_scene, mesh_scene};
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let knot = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes/knot.ply");
    let own = std::env::var_os("CARDIOID_BENCH_MESH").map(PathBuf::from);
    for mesh in [Some(knot), own].into_iter().flatten() {
        let description = mesh_scene(&mesh, &[])?;
        let built = build_scene(&description, &Arc::new(Device::new(0)?), (512, 512))?;
        let report = bench_bvh(&built.scene, &built.camera, &BvhBenchSettings::default(), &|_, _, _| ())?;
        println!("{}", report.to_markdown());
    }
    Ok(())
}
