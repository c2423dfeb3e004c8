//! A city block by block, for scenes with many objects and more photons than memory: the same for the same seed.

use crate::sampling::mix;
use crate::scene_file::mesh::{Positions, TriangleMesh};
use glam::DVec3;

/// Metres from one block to the next.
const PITCH: f64 = 128.0;

/// Width of a street in metres.
const STREET: f64 = 20.0;

/// Height of a pavement over the street in metres.
const KERB: f64 = 0.15;

/// Groups of streets, and of the rows of houses.
const STREETS: u32 = 5;
const ROWS: u32 = 8;

/// Parts of a city that are one mesh each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CityPart {
    /// Ground and pavements of a fifth of the city.
    Streets,
    /// A large building on a block of its own, or rows of houses on an eighth of the other blocks.
    Buildings,
    /// Parked and driving cars along one side of all streets.
    Cars,
    /// Trees along one side of all streets.
    Trees,
}

/// One part of a city of square blocks around the origin, in metres, with y up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct City {
    /// Which kind of part.
    pub part: CityPart,
    /// Which of the parts of this kind; a number beyond the last gives nothing.
    pub number: u32,
    /// Blocks along each side.
    pub blocks: u32,
    /// Pieces along each side of a rectangle: triangles grow with its square.
    pub detail: u32,
    /// Seed of sizes and places.
    pub seed: u64,
}

impl CityPart {
    /// Parts of this kind in a city.
    pub fn count(self, blocks: u32) -> u32 {
        match self {
            Self::Streets => STREETS.min(blocks),
            Self::Buildings => singles(blocks) + ROWS,
            Self::Cars | Self::Trees => 2,
        }
    }
}

/// Blocks with one large building: three of eight.
fn singles(blocks: u32) -> u32 {
    blocks * blocks * 3 / 8
}

impl City {
    /// A bound on the number of triangles.
    pub fn most_triangles(&self) -> u64 {
        let blocks = u64::from(self.blocks) * u64::from(self.blocks);
        let each = match self.part {
            CityPart::Streets => 2 * 300,
            CityPart::Buildings => 60_000,
            CityPart::Cars => 6 * 200,
            CityPart::Trees => 4 * 1400,
        };
        let blocks = match self.part {
            CityPart::Buildings if self.number < singles(self.blocks) => 1,
            CityPart::Streets | CityPart::Buildings | CityPart::Cars | CityPart::Trees => blocks,
        };
        blocks * each * u64::from(self.detail) * u64::from(self.detail)
    }

    /// The triangles, without shading normals.
    pub fn mesh(&self) -> TriangleMesh {
        let mut mesh = Mesh { detail: self.detail.max(1), positions: Vec::new(), triangles: Vec::new() };
        match self.part {
            CityPart::Streets => self.streets(&mut mesh),
            CityPart::Buildings => self.buildings(&mut mesh),
            CityPart::Cars => self.cars(&mut mesh),
            CityPart::Trees => self.trees(&mut mesh),
        }
        TriangleMesh {
            positions: Positions::Double(mesh.positions),
            triangles: mesh.triangles,
            normals: None,
            uvs: None,
        }
    }

    /// A number from 0 to 1 that these numbers select.
    fn random(&self, what: u64, which: u64) -> f64 {
        let bits = mix(mix(self.seed ^ what << 48) ^ which);
        (bits >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Centre of a block.
    fn centre(&self, block: u32) -> DVec3 {
        let place = |i: u32| (f64::from(i) + 0.5 - 0.5 * f64::from(self.blocks)) * PITCH;
        DVec3::new(place(block % self.blocks), 0.0, place(block / self.blocks))
    }

    fn all_blocks(&self) -> std::ops::Range<u32> {
        0..self.blocks * self.blocks
    }

    fn streets(&self, mesh: &mut Mesh) {
        for block in self
            .all_blocks()
            .filter(|block| block / self.blocks % self.part.count(self.blocks) == self.number)
        {
            let half = 0.5 * PITCH;
            let centre = self.centre(block);
            let across = 12;
            let step = PITCH / f64::from(across);
            for cell in 0..across * across {
                let corner = DVec3::new(
                    f64::from(cell % across) * step - half,
                    0.0,
                    f64::from(cell / across + 1) * step - half,
                );
                mesh.quad(centre + corner, DVec3::X * step, DVec3::NEG_Z * step);
            }
            let side = PITCH - STREET;
            mesh.block(centre, DVec3::new(side, KERB, side));
        }
    }

    fn buildings(&self, mesh: &mut Mesh) {
        let singles = singles(self.blocks);
        // A walk over all blocks by a step that has no factor in common with their number.
        let count = self.blocks * self.blocks;
        let step = (count / 2..=count).find(|step| gcd(*step, count) == 1).unwrap_or(1);
        let block = |i: u32| (u64::from(i) * u64::from(step) % u64::from(count)) as u32;
        if self.number < singles {
            let block = block(self.number);
            let random = |what| self.random(what, u64::from(block));
            let size = DVec3::new(46.0 + 40.0 * random(1), 0.0, 46.0 + 40.0 * random(2));
            let floors = 6 + (18.0 * random(3)) as u32;
            self.house(mesh, self.centre(block) + DVec3::Y * KERB, size, floors);
            return;
        }
        let row = self.number - singles;
        for i in (singles..count).filter(|i| (i - singles) % ROWS == row && row < ROWS) {
            let block = block(i);
            for house in 0..12u64 {
                let random = |what| self.random(what, u64::from(block) << 8 | house);
                // Four on each of two sides, two between them on the others.
                let (x, z) = match house {
                    0..8 => (-40.5 + 27.0 * (house % 4) as f64, if house < 4 { -42.0 } else { 42.0 }),
                    _ => (if house % 2 == 0 { -42.0 } else { 42.0 }, if house < 10 { -13.0 } else { 13.0 }),
                };
                let size = DVec3::new(18.0 + 7.0 * random(4), 0.0, 17.0 + 6.0 * random(5));
                let place = self.centre(block) + DVec3::new(x, KERB, z);
                self.house(mesh, place, size, 3 + (4.0 * random(6)) as u32);
            }
        }
    }

    /// A building around `base`, the middle of its floor: windows in their reveals, sills, a flat roof with a parapet and boxes.
    fn house(&self, mesh: &mut Mesh, base: DVec3, size: DVec3, floors: u32) {
        let height = 3.2 * f64::from(floors);
        let (x, z) = (0.5 * size.x, 0.5 * size.z);
        let sides = [
            (DVec3::new(-x, 0.0, z), DVec3::X, size.x),
            (DVec3::new(x, 0.0, z), DVec3::NEG_Z, size.z),
            (DVec3::new(x, 0.0, -z), DVec3::NEG_X, size.x),
            (DVec3::new(-x, 0.0, -z), DVec3::Z, size.z),
        ];
        for (corner, along, length) in sides {
            let columns = (length / 3.4).floor().max(1.0) as u32;
            let width = length / f64::from(columns);
            for floor in 0..floors {
                for column in 0..columns {
                    let place =
                        corner + along * (f64::from(column) * width) + DVec3::Y * (3.2 * f64::from(floor));
                    window(mesh, base + place, along, width);
                }
            }
        }
        let top = base + DVec3::Y * height;
        mesh.quad(top + DVec3::new(-x, 0.0, z), DVec3::X * size.x, DVec3::NEG_Z * size.z);
        for (side, across) in [(DVec3::X, x), (DVec3::NEG_X, x)] {
            mesh.block(top + side * (across - 0.15), DVec3::new(0.3, 0.9, size.z));
        }
        for (side, across) in [(DVec3::Z, z), (DVec3::NEG_Z, z)] {
            mesh.block(top + side * (across - 0.15), DVec3::new(size.x - 0.6, 0.9, 0.3));
        }
        for i in 0..4u64 {
            let key = mix(base.x.to_bits() ^ base.z.to_bits().rotate_left(17)) ^ i;
            let random = |what| self.random(what, key);
            let place = DVec3::new((random(7) - 0.5) * 1.4 * x, 0.0, (random(8) - 0.5) * 1.4 * z);
            mesh.block(
                top + place,
                DVec3::new(1.0 + 3.0 * random(9), 0.8 + 2.0 * random(10), 1.0 + 2.0 * random(11)),
            );
        }
    }

    /// Places along the streets on one side, with the direction of the street, about every `step` metres.
    fn along_streets(&self, step: f64, mut place: impl FnMut(DVec3, DVec3, u64)) {
        let count = (PITCH / step) as u64;
        for block in self.all_blocks() {
            for (direction, key) in [(DVec3::X, 0u64), (DVec3::Z, 1)] {
                let side = DVec3::new(direction.z, 0.0, direction.x);
                for i in 0..count {
                    let along = (i as f64 + 0.5) * step - 0.5 * PITCH;
                    let which = (u64::from(block) << 12 | i) << 1 | key;
                    place(self.centre(block) + direction * along - side * (0.5 * PITCH), direction, which);
                }
            }
        }
    }

    fn cars(&self, mesh: &mut Mesh) {
        if self.number >= CityPart::Cars.count(self.blocks) {
            return;
        }
        let sign = if self.number == 0 { 1.0 } else { -1.0 };
        self.along_streets(16.0, |place, direction, which| {
            let random = |what| self.random(what + 4 * u64::from(self.number), which);
            // None on crossings, and not everywhere.
            if random(20) < 0.45
                || (place + direction).abs().max_element() > 0.5 * PITCH * f64::from(self.blocks)
            {
                return;
            }
            let side = DVec3::new(direction.z, 0.0, direction.x) * sign;
            let place = place + side * (4.0 + 3.0 * random(21)) + direction * (6.0 * random(22) - 3.0);
            let sized = |length: f64, height: f64, width: f64| {
                direction.abs() * length + DVec3::Y * height + side.abs() * width
            };
            mesh.block(place + DVec3::Y * 0.35, sized(4.4, 0.6, 1.8));
            mesh.block(place + DVec3::Y * 0.95 - direction * 0.2, sized(2.2, 0.55, 1.6));
            for (along, across) in [(1.4, 0.85), (1.4, -0.85), (-1.4, 0.85), (-1.4, -0.85)] {
                mesh.block(place + direction * along + side * across, sized(0.66, 0.66, 0.2));
            }
        });
    }

    fn trees(&self, mesh: &mut Mesh) {
        if self.number >= CityPart::Trees.count(self.blocks) {
            return;
        }
        let sign = if self.number == 0 { 1.0 } else { -1.0 };
        self.along_streets(32.0, |place, direction, which| {
            let random = |what| self.random(what + 4 * u64::from(self.number), which);
            if random(30) < 0.4 {
                return;
            }
            let side = DVec3::new(direction.z, 0.0, direction.x) * sign;
            let foot = place + side * 12.0 + DVec3::Y * KERB;
            let height = 5.0 + 4.0 * random(31);
            mesh.block(foot, DVec3::new(0.3, 0.55 * height, 0.3));
            let middle = foot + DVec3::Y * 0.72 * height;
            let radius = DVec3::new(0.3, 0.32, 0.3) * height;
            let leaves = 500 * u64::from(self.detail) * u64::from(self.detail);
            for leaf in 0..leaves {
                let random = |what| self.random(what, which << 20 | leaf);
                let ball = |a: f64, b: f64| {
                    let (height, angle) = (2.0 * a - 1.0, std::f64::consts::TAU * b);
                    let ring = (1.0 - height * height).max(0.0).sqrt();
                    DVec3::new(ring * angle.cos(), height, ring * angle.sin())
                };
                let at = middle + radius * ball(random(40), random(41)) * random(42).cbrt();
                let normal = ball(random(43), random(44));
                let across = normal.any_orthonormal_vector();
                let size = 0.3 + 0.2 * random(45);
                let (u, v) = (across * size, normal.cross(across) * size);
                mesh.plain(at - 0.5 * (u + v), u, v);
            }
        });
    }
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// A window in a piece of wall 3.2 m high, from its lower corner.
fn window(mesh: &mut Mesh, corner: DVec3, along: DVec3, width: f64) {
    let (up, inward) = (DVec3::Y, -along.cross(DVec3::Y));
    let at = |x: f64, y: f64, depth: f64| corner + along * (x * width) + up * (3.2 * y) + inward * depth;
    let (left, right, low, high, depth) = (0.22, 0.78, 0.28, 0.84, 0.25);
    let (wide, tall) = (along * (right - left) * width, up * (high - low) * 3.2);
    mesh.quad(at(0.0, 0.0, 0.0), along * width, up * (low * 3.2));
    mesh.quad(at(0.0, high, 0.0), along * width, up * ((1.0 - high) * 3.2));
    mesh.quad(at(0.0, low, 0.0), along * (left * width), tall);
    mesh.quad(at(right, low, 0.0), along * ((1.0 - right) * width), tall);
    // The reveals: below, above, left, right; and the pane.
    mesh.quad(at(left, low, 0.0), wide, inward * depth);
    mesh.quad(at(left, high, depth), wide, -inward * depth);
    mesh.quad(at(left, low, 0.0), inward * depth, tall);
    mesh.quad(at(right, low, depth), -inward * depth, tall);
    mesh.quad(at(left, low, depth), wide, tall);
    let centre = at(0.5, low, -0.06) - up * 0.1;
    mesh.block(centre, along.abs() * (wide.length() + 0.2) + up * 0.08 + inward.abs() * 0.12);
}

struct Mesh {
    detail: u32,
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A parallelogram that faces along `u` times `v`.
    fn quad(&mut self, corner: DVec3, u: DVec3, v: DVec3) {
        let (first, n) = (self.positions.len() as u32, self.detail);
        let share = 1.0 / f64::from(n);
        for i in 0..=n {
            for j in 0..=n {
                let p = corner + u * (f64::from(j) * share) + v * (f64::from(i) * share);
                self.positions.push(p.to_array());
            }
        }
        for i in 0..n {
            for j in 0..n {
                let a = first + i * (n + 1) + j;
                let (b, c, d) = (a + 1, a + n + 2, a + n + 1);
                self.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }

    /// A parallelogram of two triangles.
    fn plain(&mut self, corner: DVec3, u: DVec3, v: DVec3) {
        let detail = std::mem::replace(&mut self.detail, 1);
        self.quad(corner, u, v);
        self.detail = detail;
    }

    /// A box without its underside, standing on `foot`, the middle of that.
    fn block(&mut self, foot: DVec3, size: DVec3) {
        let [x, y, z] = [DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z];
        let low = foot - 0.5 * (x + z);
        self.quad(low + z, x, y);
        self.quad(low + x + z, -z, y);
        self.quad(low + x, -x, y);
        self.quad(low, z, y);
        self.quad(low + y + z, x, -z);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn city(part: CityPart, number: u32) -> City {
        City { part, number, blocks: 4, detail: 1, seed: 1 }
    }

    #[test]
    fn a_city_is_the_same_each_time_and_within_its_bound() {
        for part in [CityPart::Streets, CityPart::Buildings, CityPart::Cars, CityPart::Trees] {
            for number in 0..part.count(4) {
                // Each part by itself.
                for detail in [1, 2] {
                    let city = City { detail, ..city(part, number) };
                    let mesh = city.mesh();
                    let count = mesh.triangles.len() as u64;
                    assert!(count <= city.most_triangles(), "{part:?} {number}: {count}");
                    assert!(count > 0, "{part:?} {number}");
                    assert!(
                        mesh.triangles == city.mesh().triangles && mesh.positions == city.mesh().positions
                    );
                }
            }
            let beyond = city(part, part.count(4));
            assert!(beyond.mesh().triangles.is_empty(), "{part:?}");
        }
    }

    #[test]
    fn facades_face_outwards() {
        let mesh = city(CityPart::Buildings, 0).mesh();
        let Positions::Double(positions) = &mesh.positions else { panic!("single precision") };
        let corner = |i: u32| DVec3::from_array(positions[i as usize]);
        let flux: f64 = mesh
            .triangles
            .iter()
            .map(|&[a, b, c]| {
                let normal = (corner(b) - corner(a)).cross(corner(c) - corner(a));
                0.5 * normal.dot(corner(a) - corner(0))
            })
            .sum();
        // The divergence theorem: three times the volume.
        assert!(flux > 0.0, "{flux}");
    }
}
