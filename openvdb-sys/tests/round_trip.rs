//! What the reader writes it reads back, by the OpenVDB that is installed. Without OpenVDB there is nothing to test.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use openvdb_sys::{Dense, Error, GridClass, Limits, Piece, VdbFile, is_compiled, write};

const LIMITS: Limits = Limits { megabytes: 1500, seconds: 20 };

#[test]
fn a_grid_comes_back_as_it_was() {
    if !is_compiled() {
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
        let file = VdbFile::open(&path, LIMITS).unwrap();
        let grids = file.grids();
        assert_eq!(grids.len(), 1);
        assert_eq!((grids[0].name.as_str(), grids[0].value_type.as_str()), ("smoke", "float"));
        assert!(grids[0].is_float && grids[0].class == GridClass::FogVolume);
        assert_eq!(grids[0].to_world, Some(to_world));
        let mut grid = file.grid(0).unwrap();
        assert_eq!(grid.background(), 0.0);
        let mut seen = 0;
        while let Some(piece) = grid.next_piece().unwrap() {
            let Piece::Leaf { origin, values: leaf } = piece else { panic!("{piece:?}") };
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
    if !is_compiled() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(VdbFile::open(&folder.path().join("none.vdb"), LIMITS), Err(Error::OpenVdb(_))));
    let path = folder.path().join("text.vdb");
    std::fs::write(&path, "no volume").unwrap();
    let error = VdbFile::open(&path, LIMITS).unwrap_err();
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

/// A byte here and there changed, or the end missing: a grid or an error, whatever OpenVDB makes of it, and an end in any case.
#[test]
fn broken_files_end() {
    if !is_compiled() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broken.vdb");
    let values: Vec<f32> = (0..512).map(|i| (i % 97) as f32).collect();
    let dense = Dense {
        name: "density",
        origin: [-3, 5, 6],
        size: [8, 8, 8],
        values: &values,
        to_world: [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1], [0.0; 3]],
        class: GridClass::FogVolume,
        is_half: false,
    };
    write(&path, &dense).unwrap();
    let sound = std::fs::read(&path).unwrap();
    let (mut state, mut read, mut refused) = (12345u64, 0, 0);
    let mut next = |most: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % most
    };
    for i in 0..40 {
        let mut bytes = sound.clone();
        match i % 4 {
            0 => bytes.truncate(next(sound.len())),
            1 => bytes[next(sound.len())] ^= 1 << next(8),
            2 => bytes[next(1000)] = 255,
            _ => {
                bytes.remove(next(1500));
            }
        }
        std::fs::write(&path, &bytes).unwrap();
        let grid = VdbFile::open(&path, LIMITS).and_then(|file| file.grid(0));
        let all = grid.and_then(|mut grid| {
            while grid.next_piece()?.is_some() {}
            Ok(())
        });
        match all {
            Ok(()) => read += 1,
            Err(error) => {
                assert!(!matches!(error, Error::Start(_)), "{error}");
                refused += 1;
            }
        }
    }
    assert!(read > 0 && refused > 5, "{read} {refused}");
}

/// The other tests pass where OpenVDB is not installed; where it must be, this one does not.
#[test]
fn the_reader_is_there_where_it_is_required() {
    let is_required = std::env::var_os("CARDIOID_OPENVDB").is_some_and(|value| value == "required");
    assert!(!is_required || is_compiled(), "the reader was not compiled: run ./setup.sh");
}
