//! Densities out of OpenVDB files.
//!
//! Read are grids of floats, or of halves in the file, with an affine transform. Everything else is refused with what to do instead.
//! The value of a voxel is that at its centre, which the transform of the file places in the world.

use super::density::{Grid, GridBuilder, GridError, Refused};
use crate::files::open_regular;
use glam::{DAffine3, DVec3, IVec3};
use openvdb_sys::{GridClass, GridInfo, Limits, Piece, VdbFile};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Name that grids of densities usually have.
pub const DENSITY: &str = "density";

/// Name that grids of temperatures usually have; in kelvin, or in a unit that the program that wrote them chose.
pub const TEMPERATURE: &str = "temperature";

/// Name that grids of flames usually have: where, and how strongly, fuel burns.
pub const FLAMES: &str = "flames";

/// First bytes of every OpenVDB file.
const MAGIC: [u8; 4] = [0x20, 0x42, 0x44, 0x56];

/// A grid out of a file.
#[derive(Clone, Debug)]
pub struct VdbGrid {
    /// Its name in the file.
    pub name: String,
    /// Its voxels, with lines in the space of the file.
    pub grid: Grid,
    /// Voxels that had no usable value, and became zero.
    pub refused: Refused,
    /// Value that the file has where there are no voxels. The grid is zero there whatever this is.
    pub background: f32,
}

/// Memory that a grid of a file takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VdbSize {
    /// Bytes of the grid, about.
    pub bytes: u64,
    /// Bytes more while the file is read: OpenVDB holds all grids of the file.
    pub reading: u64,
}

/// Why no grid came out of a file.
#[derive(Debug, thiserror::Error)]
pub enum VdbError {
    /// The file cannot be opened.
    #[error("cannot read {path}: {error}")]
    Open {
        /// Which file.
        path: PathBuf,
        /// What the system says.
        error: io::Error,
    },
    /// The file is something else.
    #[error("{0} is not an OpenVDB file: it begins with other bytes than these do")]
    NotVdb(PathBuf),
    /// OpenVDB is not there, or cannot read the file.
    #[error("cannot read {path}: {error}")]
    OpenVdb {
        /// Which file.
        path: PathBuf,
        /// What OpenVDB says.
        error: openvdb_sys::Error,
    },
    /// There is no grid of this name.
    #[error("{path} has no grid called `{name}`: it has {}", listed(.grids))]
    NoSuchGrid {
        /// Which file.
        path: PathBuf,
        /// What was asked for.
        name: String,
        /// Names and types of all grids.
        grids: Vec<String>,
    },
    /// There is no grid that could be a density.
    #[error("{path} has no grid of densities: it has {}. Name one that is to be taken", listed(.grids))]
    NoDensity {
        /// Which file.
        path: PathBuf,
        /// Names and types of all grids.
        grids: Vec<String>,
    },
    /// A grid cannot be a density.
    #[error("grid `{name}` of {path} {why}")]
    Unusable {
        /// Which file.
        path: PathBuf,
        /// Which grid.
        name: String,
        /// Why not, and what to do.
        why: String,
    },
    /// Voxels cannot be a grid of this program.
    #[error("grid `{name}` of {path}: {error}")]
    Grid {
        /// Which file.
        path: PathBuf,
        /// Which grid.
        name: String,
        /// Why not.
        error: GridError,
    },
}

/// Grids with their types, in words.
fn listed(grids: &[String]) -> String {
    if grids.is_empty() { "no grid at all".to_owned() } else { grids.join(", ") }
}

/// Reads the grid called `name` of the file at `path`; without a name the one called [`DENSITY`], or else the first grid of floats that is
/// not said to be something other than a fog volume. OpenVDB runs in a process of its own, with limits, as it trusts its files.
///
/// # Errors
/// Where the file cannot be read, has no such grid, or the grid cannot be a density.
pub fn read_vdb(path: &Path, name: Option<&str>) -> Result<VdbGrid, VdbError> {
    let told = |error| VdbError::OpenVdb { path: path.to_owned(), error };
    let (file, number) = open(path, name)?;
    let info = &file.grids()[number].clone();
    let unusable = |why: &str| VdbError::Unusable {
        path: path.to_owned(),
        name: info.name.clone(),
        why: why.to_owned(),
    };
    if info.class == GridClass::LevelSet {
        return Err(unusable(
            "is a level set: its voxels are distances from a surface and not densities. Convert it to a fog volume in the program that \
             wrote it",
        ));
    }
    if !info.is_float {
        return Err(unusable(&format!(
            "has voxels of type {}: only grids of float or half can be read. Write it as one of these",
            info.value_type
        )));
    }
    let Some([x, y, z, origin]) = info.to_world else {
        return Err(unusable(
            "has a transform that is not affine (a frustum, say). Resample it to one with even voxels in the program that wrote it",
        ));
    };
    let to_world = DAffine3::from_cols(x.into(), y.into(), z.into(), DVec3::from_array(origin));
    let mut read = file.grid(number).map_err(told)?;
    let background = read.background();
    let wrong = |error| VdbError::Grid { path: path.to_owned(), name: info.name.clone(), error };
    let mut builder = GridBuilder::default();
    while let Some(piece) = read.next_piece().map_err(told)? {
        match piece {
            Piece::Tile { origin, side, value } => builder.tile(IVec3::from_array(origin), side, value),
            Piece::Leaf { origin, values } => builder.leaf(IVec3::from_array(origin), values),
        }
        .map_err(wrong)?;
    }
    drop(read);
    let (grid, refused) = builder.finish(to_world).map_err(wrong)?;
    if grid.is_empty() {
        return Err(unusable("has no voxel above zero. Name another grid, or another file"));
    }
    Ok(VdbGrid { name: info.name.clone(), grid, refused, background })
}

/// Memory that the grid of [`read_vdb`] will take. Takes about as long as reading it.
///
/// # Errors
/// Where the file cannot be read, or has no such grid.
pub fn vdb_size(path: &Path, name: Option<&str>) -> Result<VdbSize, VdbError> {
    /// Bytes of a leaf with values of its own, with its share of the tables and of leaves beside it; and of one without.
    const LEAF: [u64; 2] = [2300, 100];
    let (file, number) = open(path, name)?;
    let GridInfo { leaves, tile_leaves, .. } = file.grids()[number];
    let bytes = leaves.saturating_mul(LEAF[0]).saturating_add(tile_leaves.saturating_mul(LEAF[1]));
    let reading = file.grids().iter().map(|grid| grid.bytes).fold(0, u64::saturating_add);
    Ok(VdbSize { bytes, reading })
}

/// The file, read by OpenVDB, and the number of the grid that is asked for.
fn open(path: &Path, name: Option<&str>) -> Result<(VdbFile, usize), VdbError> {
    let limits = limits_of(check_first_bytes(path)?);
    let told = |error| VdbError::OpenVdb { path: path.to_owned(), error };
    let file = VdbFile::open(path, limits).map_err(told)?;
    let number = choose(path, file.grids(), name)?;
    Ok((file, number))
}

/// What a file of so many bytes may take: sound ones take no more than this, and broken ones end.
fn limits_of(bytes: u64) -> Limits {
    let megabytes = bytes >> 20;
    // Libraries and stacks take some hundred. Compressed values unfold by a factor of ten or so; a broken file that asks for gigabytes spends
    // seconds on filling them before it ends.
    Limits { megabytes: 1024 + megabytes.saturating_mul(64), seconds: 60 + megabytes }
}

/// Length of the file, if it begins as OpenVDB files do.
fn check_first_bytes(path: &Path) -> Result<u64, VdbError> {
    let read = || {
        let (file, length) = open_regular(path)?;
        let mut head = Vec::new();
        file.take(MAGIC.len() as u64).read_to_end(&mut head)?;
        Ok((head, length))
    };
    match read() {
        Ok((head, length)) if head == MAGIC => Ok(length),
        Ok(_) => Err(VdbError::NotVdb(path.to_owned())),
        Err(error) => Err(VdbError::Open { path: path.to_owned(), error }),
    }
}

/// Number of the grid that is asked for.
fn choose(path: &Path, grids: &[GridInfo], name: Option<&str>) -> Result<usize, VdbError> {
    let all = || grids.iter().map(|grid| format!("`{}` ({})", grid.name, grid.value_type)).collect();
    let called = |name: &str| grids.iter().position(|grid| grid.name == name);
    if let Some(name) = name {
        return called(name).ok_or_else(|| VdbError::NoSuchGrid {
            path: path.to_owned(),
            name: name.to_owned(),
            grids: all(),
        });
    }
    let may_be =
        |grid: &GridInfo| grid.is_float && matches!(grid.class, GridClass::FogVolume | GridClass::Unknown);
    let first = || {
        let not_density = [TEMPERATURE, FLAMES];
        let fits = |grid: &GridInfo| may_be(grid) && !not_density.contains(&grid.name.as_str());
        // One alone is meant, whatever it is: the reason why it cannot be read says more.
        grids.iter().position(fits).or_else(|| (grids.len() == 1).then_some(0))
    };
    called(DENSITY).or_else(first).ok_or_else(|| VdbError::NoDensity { path: path.to_owned(), grids: all() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::density::{Density, Line};
    use openvdb_sys::{Dense, write};
    use std::sync::Arc;

    /// True where there is no OpenVDB, so that nothing can be tested.
    fn is_missing() -> bool {
        !openvdb_sys::is_compiled()
    }

    fn dense(values: &[f32]) -> Dense<'_> {
        Dense {
            name: DENSITY,
            origin: [-4; 3],
            size: [16; 3],
            values,
            to_world: [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1], [0.0; 3]],
            class: GridClass::FogVolume,
            is_half: false,
        }
    }

    fn values(value: impl Fn(usize, usize, usize) -> f32) -> Vec<f32> {
        (0..4096).map(|i| value(i >> 8, i >> 4 & 15, i & 15)).collect()
    }

    #[test]
    fn a_grid_is_where_its_file_says() {
        if is_missing() {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("turned.vdb");
        // Values that halves have exactly.
        let values = values(|x, y, z| 1.0 + x as f32 + 0.25 * y as f32 + 0.5 * z as f32);
        let (sin, cos) = 0.5f64.sin_cos();
        let to_world =
            [[0.1 * cos, 0.1 * sin, 0.0], [-0.05 * sin, 0.05 * cos, 0.0], [0.0, 0.0, 0.2], [1.0, 2.0, 3.0]];
        for is_half in [false, true] {
            write(&path, &Dense { to_world, is_half, ..dense(&values) }).unwrap();
            let read = read_vdb(&path, None).unwrap();
            assert_eq!((read.name.as_str(), read.refused.count(), read.background), (DENSITY, 0, 0.0));
            let size = vdb_size(&path, None).unwrap();
            assert!(
                size.bytes >= 27 * 2048 && size.bytes < 4 * 27 * 2048 && size.reading >= 27 * 2048,
                "{size:?}"
            );
            for (x, y, z) in [(0, 0, 0), (15, 15, 15), (3, 12, 7)] {
                let index = DVec3::new(x as f64, y as f64, z as f64) - 4.0;
                let place = DVec3::new(
                    1.0 + 0.1 * cos * index.x - 0.05 * sin * index.y,
                    2.0 + 0.1 * sin * index.x + 0.05 * cos * index.y,
                    3.0 + 0.2 * index.z,
                );
                let expected = 1.0 + x as f64 + 0.25 * y as f64 + 0.5 * z as f64;
                assert!(
                    (read.grid.at(place) - expected).abs() < 1e-6,
                    "{x} {y} {z}: {}",
                    read.grid.at(place)
                );
            }
        }
    }

    #[test]
    fn light_passes_as_in_closed_form() {
        if is_missing() {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ramp.vdb");
        let values = values(|x, _, _| 1.0 + x as f32 / 15.0);
        write(&path, &Dense { origin: [0; 3], name: "smoke", ..dense(&values) }).unwrap();
        let read = read_vdb(&path, None).unwrap();
        assert_eq!(read.name, "smoke");
        let line = Line::new(DVec3::new(0.0, 0.75, 0.75), DVec3::X).unwrap();
        // The mean of 1 and 2, over 15 voxels of 0.1.
        assert!((read.grid.integral(&line, 1.5) - 2.25).abs() < 1e-6);
        let density = Density::Grid(Arc::new(read.grid));
        assert_eq!(density.segments(&line, 1.5, f64::INFINITY).count(), 2);
    }

    #[test]
    fn what_cannot_be_a_density_is_refused_in_words() {
        if is_missing() {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("grid.vdb");
        let ones = values(|_, _, _| 1.0);
        write(&path, &Dense { class: GridClass::LevelSet, name: "surface", ..dense(&ones) }).unwrap();
        let told = read_vdb(&path, None).unwrap_err().to_string();
        assert!(
            told.contains("`surface`") && told.contains("level set") && told.contains("fog volume"),
            "{told}"
        );
        write(&path, &Dense { name: "smoke", ..dense(&ones) }).unwrap();
        let told = read_vdb(&path, Some(TEMPERATURE)).unwrap_err().to_string();
        assert!(told.contains("no grid called `temperature`: it has `smoke` (float)"), "{told}");
        write(&path, &dense(&values(|_, _, _| 0.0))).unwrap();
        let told = read_vdb(&path, None).unwrap_err().to_string();
        assert!(told.contains("no voxel above zero"), "{told}");
        let odd = values(|x, y, z| match (x, y, z) {
            (1, 2, 3) => f32::NAN,
            (4, 5, 6) => -1.0,
            (7, 8, 9) => f32::INFINITY,
            _ => 1.0,
        });
        write(&path, &dense(&odd)).unwrap();
        let read = read_vdb(&path, None).unwrap();
        // What writes the file leaves NaN out.
        assert_eq!((read.refused.infinite, read.refused.negative), (1, 1));
        assert_eq!(read.grid.value(IVec3::new(1, 2, 3) - 4), 0.0);
        assert_eq!(read.grid.majorant(), 1.0);
    }

    #[test]
    fn other_files_are_told_before_openvdb_is_started() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(read_vdb(&folder.path().join("none.vdb"), None), Err(VdbError::Open { .. })));
        assert!(matches!(read_vdb(folder.path(), None), Err(VdbError::Open { .. })));
        let path = folder.path().join("text.vdb");
        for content in ["", " BD", "no volume"] {
            std::fs::write(&path, content).unwrap();
            assert!(matches!(read_vdb(&path, None), Err(VdbError::NotVdb(_))));
        }
        if !is_missing() {
            std::fs::write(&path, " BDV and nothing of what follows in such files").unwrap();
            assert!(matches!(read_vdb(&path, None), Err(VdbError::OpenVdb { .. })));
        }
    }
}
