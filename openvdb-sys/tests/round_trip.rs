//! What the shim writes it reads back, through the OpenVDB that is loaded. Without OpenVDB there is nothing to test.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use openvdb_sys::{Dense, Error, GridClass, VdbFile, write};

#[test]
fn a_grid_comes_back_as_it_was() {
    if let Err(Error::Load(why)) = openvdb_sys::version() {
        println!("not tested: {why}");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for is_half in [false, true] {
        let path = folder.path().join("small.vdb");
        let value = |x: i32, y: i32, z: i32| (x * 64 + y * 8 + z) as f32 * 0.25;
        let values: Vec<f32> = (0..10 * 9 * 8).map(|i| value(i / 72, i / 8 % 9, i % 8)).collect();
        let to_world = [[0.0, 0.5, 0.0], [-0.25, 0.0, 0.0], [0.0, 0.0, 2.0], [1.0, 2.0, 3.0]];
        let dense = Dense {
            name: "smoke",
            origin: [-4, 3, 100],
            size: [10, 9, 8],
            values: &values,
            to_world,
            class: GridClass::FogVolume,
            is_half,
        };
        write(&path, &dense).unwrap();
        let file = VdbFile::open(&path).unwrap();
        let grids = file.grids();
        assert_eq!(grids.len(), 1);
        assert_eq!((grids[0].name.as_str(), grids[0].value_type.as_str()), ("smoke", "float"));
        assert!(grids[0].is_float && grids[0].class == GridClass::FogVolume);
        assert_eq!(grids[0].to_world, Some(to_world));
        let mut grid = file.grid(0).unwrap();
        drop(file);
        assert_eq!(grid.background(), 0.0);
        assert!(grid.next_tile().is_none());
        let (mut leaf, mut seen) = ([0.0; 512], 0);
        while let Some(origin) = grid.next_leaf(&mut leaf) {
            assert!(origin.iter().all(|c| c % 8 == 0), "{origin:?}");
            for (i, &found) in leaf.iter().enumerate() {
                let i = i as i32;
                let [x, y, z] =
                    [origin[0] + (i >> 6) + 4, origin[1] + (i >> 3 & 7) - 3, origin[2] + (i & 7) - 100];
                let is_inside = (0..10).contains(&x) && (0..9).contains(&y) && (0..8).contains(&z);
                assert_eq!(found, if is_inside { value(x, y, z) } else { 0.0 }, "{x} {y} {z}");
                seen += u32::from(is_inside);
            }
        }
        assert_eq!(seen, 720);
    }
}

#[test]
fn what_is_no_file_is_told() {
    if openvdb_sys::version().is_err() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(VdbFile::open(&folder.path().join("none.vdb")), Err(Error::OpenVdb(_))));
    let path = folder.path().join("text.vdb");
    std::fs::write(&path, "no volume").unwrap();
    let error = VdbFile::open(&path).unwrap_err();
    assert!(!error.to_string().is_empty(), "{error}");
    let wrong = Dense {
        name: "x",
        origin: [0; 3],
        size: [2, 2, 2],
        values: &[1.0; 7],
        to_world: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]],
        class: GridClass::Unknown,
        is_half: false,
    };
    assert!(write(&path, &wrong).is_err());
}
