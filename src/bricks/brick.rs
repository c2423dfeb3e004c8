//! Bricks of 8^3 voxels: sums while they are built, and the packed form in files and in memory.

use crate::math::{Rgb, Rgbe};
use crate::sampling::mix;
use glam::Vec3;

/// Voxels along each side of a brick.
pub(super) const SIDE: usize = 8;

/// Voxels of a brick.
pub const VOXELS: usize = SIDE * SIDE * SIDE;

/// Faces of a voxel: +x, -x, +y, -y, +z, -z.
pub(super) const FACES: usize = 6;

/// Bytes of a face: irradiance (RGBE) and coverage.
const FACE_BYTES: usize = 5;

/// Most bytes of a packed brick: rows that exist, their voxels, all faces.
pub(super) const MOST_BYTES: usize = 8 + VOXELS + VOXELS * FACES * FACE_BYTES;

/// Steps of coverage in an octave.
const STEPS: f32 = 12.0;

/// The largest coverage, as a power of two: six surfaces through one voxel, and room.
const LARGEST_COVERAGE: f32 = 4.0;

/// Shares of an area with this unit normal in the face of each axis that it looks to: squares of cosines, which sum to one (the ambient cube of
/// Valve's Source engine). Opposite normals share no face, so that the two sides of a wall never mix, however thin it is.
#[inline]
pub(super) fn face_shares(normal: Vec3) -> [(usize, f32); 3] {
    std::array::from_fn(|axis| (2 * axis + usize::from(normal[axis] < 0.0), normal[axis] * normal[axis]))
}

/// Coverage in eight bits, by its logarithm: never zero for what is there. Accurate to 3 %.
fn encode_coverage(coverage: f32) -> u8 {
    let code = (coverage.max(f32::MIN_POSITIVE).log2() - LARGEST_COVERAGE) * STEPS + 255.0;
    code.round().clamp(1.0, 255.0) as u8
}

/// Coverage of each code.
pub(super) fn decode_coverage(code: u8) -> f32 {
    ((f32::from(code) - 255.0) / STEPS + LARGEST_COVERAGE).exp2()
}

/// Coverage of all codes.
pub(super) fn coverage_table() -> [f32; 256] {
    std::array::from_fn(|code| decode_coverage(code as u8))
}

/// Sums of area, and of area times irradiance, by voxel and face.
#[derive(Clone, Debug)]
pub(super) struct Sums {
    /// By voxel and face: area, and area times irradiance.
    cells: Box<[[f32; 4]]>,
}

impl Sums {
    pub(super) fn new() -> Self {
        Self { cells: vec![[0.0; 4]; VOXELS * FACES].into_boxed_slice() }
    }

    /// Adds an area with a unit normal.
    #[inline]
    pub(super) fn add(&mut self, voxel: usize, normal: Vec3, area: f32, irradiance: Rgb) {
        for (face, share) in face_shares(normal) {
            let area = area * share;
            if area > 0.0 {
                let cell = &mut self.cells[voxel * FACES + face];
                cell[0] += area;
                (0..3).for_each(|channel| cell[1 + channel] += area * irradiance[channel]);
            }
        }
    }

    /// The sums of each group of 2^3 voxels, as an octant of the parent brick.
    pub(super) fn halved(&self) -> Octant {
        let mut cells = vec![[0f32; 4]; VOXELS / 8 * FACES].into_boxed_slice();
        for voxel in 0..VOXELS {
            let [x, y, z] = [voxel % SIDE, voxel / SIDE % SIDE, voxel / (SIDE * SIDE)];
            let coarse = x / 2 + y / 2 * 4 + z / 2 * 16;
            for face in 0..FACES {
                let (from, to) = (self.cells[voxel * FACES + face], &mut cells[coarse * FACES + face]);
                (0..4).for_each(|i| to[i] += from[i]);
            }
        }
        Octant { cells }
    }

    /// Adds octant number `child`, of which bit 0 is the half along x, 1 along y, 2 along z.
    pub(super) fn add_octant(&mut self, child: usize, octant: &Octant) {
        let corner = [child & 1, child >> 1 & 1, child >> 2 & 1].map(|bit| bit * SIDE / 2);
        for coarse in 0..VOXELS / 8 {
            let [x, y, z] = [coarse % 4 + corner[0], coarse / 4 % 4 + corner[1], coarse / 16 + corner[2]];
            let voxel = x + SIDE * y + SIDE * SIDE * z;
            for face in 0..FACES {
                let (from, to) = (octant.cells[coarse * FACES + face], &mut self.cells[voxel * FACES + face]);
                (0..4).for_each(|i| to[i] += from[i]);
            }
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.cells.iter().all(|cell| cell[0] <= 0.0)
    }

    /// The largest difference of a voxel from the mean of its group of 2^3 voxels, over that mean plus `floor`, in any face and channel. One
    /// voxel of the level above shows that mean.
    pub(super) fn largest_variation(&self, floor: f32) -> f32 {
        let mut largest = 0f32;
        for group in 0..VOXELS / 8 {
            let corner = [group % 4 * 2, group / 4 % 4 * 2, group / 16 * 2];
            let voxels: [usize; 8] = std::array::from_fn(|i| {
                let [x, y, z] = [i & 1, i >> 1 & 1, i >> 2 & 1];
                corner[0] + x + SIDE * (corner[1] + y) + SIDE * SIDE * (corner[2] + z)
            });
            for face in 0..FACES {
                let cells = voxels.map(|voxel| self.cells[voxel * FACES + face]);
                let mut sum = [0f32; 4];
                cells.iter().for_each(|cell| (0..4).for_each(|i| sum[i] += cell[i]));
                if sum[0] <= 0.0 {
                    continue;
                }
                let mean: [f32; 3] = std::array::from_fn(|i| sum[1 + i] / sum[0]);
                let brightest = mean.iter().fold(floor, |most, &channel| most.max(channel + floor));
                for cell in cells.iter().filter(|cell| cell[0] > 0.0) {
                    for channel in 0..3 {
                        let difference = (cell[1 + channel] / cell[0] - mean[channel]).abs();
                        // A mean and floor of zero leave no difference.
                        let variation = if difference > 0.0 { difference / brightest } else { 0.0 };
                        largest = largest.max(variation);
                    }
                }
            }
        }
        largest
    }

    /// The packed form for a file. `width` is the side of a voxel, `key` selects the random numbers by which values are rounded without bias.
    pub(super) fn pack(&self, width: f32, key: u64) -> Vec<u8> {
        let per_area = 1.0 / (width * width);
        let mut rows = 0u64;
        let mut masks = Vec::new();
        let mut faces = Vec::new();
        for row in 0..VOXELS / SIDE {
            let mut bits = [0u8; SIDE];
            for (x, bits) in bits.iter_mut().enumerate() {
                for face in 0..FACES {
                    let number = (row * SIDE + x) * FACES + face;
                    let [area, sums @ ..] = self.cells[number];
                    if area > 0.0 {
                        *bits |= 1 << face;
                        let irradiance = Rgb::from_array(sums) / area;
                        let dither = (mix(key ^ number as u64) >> 40) as f32 / 16_777_216.0;
                        faces.extend(Rgbe::encode_dithered(irradiance, dither).0);
                        faces.push(encode_coverage(area * per_area));
                    }
                }
            }
            if bits != [0; SIDE] {
                rows |= 1 << row;
                masks.extend(bits);
            }
        }
        let mut bytes = Vec::with_capacity(8 + masks.len() + faces.len());
        bytes.extend(rows.to_le_bytes());
        bytes.extend(masks);
        bytes.extend(faces);
        bytes
    }
}

/// A brick at half its resolution: an octant of its parent.
#[derive(Clone, Debug)]
pub(super) struct Octant {
    cells: Box<[[f32; 4]]>,
}

/// A brick in memory: which faces of which voxels exist, and their values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Brick {
    /// By row of eight voxels along x: a byte for each voxel, with a bit for each face.
    rows: [u64; VOXELS / SIDE],
    /// By row: number of faces before it.
    starts: [u16; VOXELS / SIDE],
    faces: Box<[[u8; FACE_BYTES]]>,
}

impl Brick {
    /// The brick of these bytes; `None` where they are not valid.
    pub(super) fn unpack(bytes: &[u8]) -> Option<Self> {
        let (head, mut rest) = bytes.split_first_chunk::<8>()?;
        let present = u64::from_le_bytes(*head);
        let (mut rows, mut starts, mut count) = ([0u64; VOXELS / SIDE], [0u16; VOXELS / SIDE], 0u32);
        for row in 0..VOXELS / SIDE {
            starts[row] = count as u16;
            if present >> row & 1 == 1 {
                let (bits, after) = rest.split_first_chunk::<8>()?;
                rest = after;
                rows[row] = u64::from_le_bytes(*bits);
                // Two bits of each byte stand for no face.
                if rows[row] & 0xc0c0_c0c0_c0c0_c0c0 != 0 || rows[row] == 0 {
                    return None;
                }
                count += rows[row].count_ones();
            }
        }
        let (faces, left) = rest.as_chunks::<FACE_BYTES>();
        // A coverage of zero is not written.
        let is_sound =
            left.is_empty() && faces.len() == count as usize && faces.iter().all(|face| face[4] > 0);
        is_sound.then(|| Self { rows, starts, faces: faces.into() })
    }

    /// Voxels that hold something.
    pub fn voxels(&self) -> u32 {
        let voxels = |row: &u64| row.to_le_bytes().iter().filter(|&&bits| bits != 0).count() as u32;
        self.rows.iter().map(voxels).sum()
    }

    /// Faces of voxels that hold something.
    pub fn faces(&self) -> usize {
        self.faces.len()
    }

    /// Bytes in memory.
    pub fn memory_bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(&*self.faces)
    }

    /// Irradiance and code of the coverage of one face of a voxel, if it is there.
    #[inline]
    pub(super) fn face(&self, voxel: usize, face: usize) -> Option<(Rgb, u8)> {
        let (row, shift) = (voxel / SIDE, voxel % SIDE * 8 + face);
        let bits = self.rows[row];
        if bits >> shift & 1 == 0 {
            return None;
        }
        let before = (bits & ((1u64 << shift) - 1)).count_ones() as usize;
        let [r, g, b, e, coverage] = self.faces[usize::from(self.starts[row]) + before];
        Some((Rgbe([r, g, b, e]).decode(), coverage))
    }

    /// Whether a voxel holds something.
    #[inline]
    pub(super) fn has(&self, voxel: usize) -> bool {
        self.rows[voxel / SIDE] >> (voxel % SIDE * 8) & 0x3f != 0
    }
}
