//! The photon: 20 bytes with position, power, direction, normal and class, and the tests by which searches accept it.

use super::power::PackedPower;
use crate::math::{Rgb, octahedral_decode, octahedral_encode, octahedral_encode_two};
use crate::spectra::Line;
use glam::Vec3;
use std::sync::LazyLock;

/// Path of a photon to the surface where it is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum PhotonClass {
    /// Straight from the light.
    Direct = 0,
    /// After at least one reflection by a diffuse lobe, which includes glossy lobes smooth enough for a density
    /// estimate.
    Indirect = 1,
    /// After specular or highly glossy reflections or refractions only.
    Caustic = 2,
    /// Where light from the source would have arrived without obstacles (Jensen & Christensen 1995).
    Shadow = 3,
}

/// A set of [`PhotonClass`]es, for searches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhotonClasses(u8);

impl PhotonClasses {
    /// Every class that carries light: all but shadow photons.
    pub const LIGHT: Self = Self(0b0111);
    /// Every class.
    pub const ALL: Self = Self(0b1111);

    /// The set of one class.
    pub const fn only(class: PhotonClass) -> Self {
        Self(1 << class as u8)
    }

    /// Both sets together.
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether `class` is in the set.
    pub const fn contains(self, class: PhotonClass) -> bool {
        self.0 >> (class as u8) & 1 == 1
    }
}

/// Bits of each coordinate of the stored direction of incidence.
const WI_BITS: u32 = 8;
/// Bits of each coordinate of the stored normal.
const NORMAL_BITS: u32 = 6;
const NORMAL_CODES: usize = 1 << (2 * NORMAL_BITS);

/// Largest angle, in radians, between a normal and its stored form in a [`Photon`] (3.97 degrees): half a step in both
/// coordinates at the centre of a face of the octahedron, `sqrt(18) / 62`.
pub const NORMAL_ERROR: f32 = 0.0693;

/// Light that arrived at a surface: 20 bytes, as in section 3 of Jensen 1996.
///
/// The power is *unnormalised* flux, as if the photon were the only one that its map's pass emitted: estimates divide
/// by the number of emitted photons, which a [`super::PhotonMap`] stores.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Photon {
    /// Position of arrival, render space.
    pub position: Vec3,
    power: PackedPower,
    wi: u16,
    /// Normal in bits 0 to 11, class in bits 12 and 13; two bits are free.
    flags: u16,
}

const _: () = assert!(size_of::<Photon>() == 20 && align_of::<Photon>() == 4);

impl Photon {
    /// A photon of flux `power` (watts, unnormalised) that arrived at `position` from the unit direction `wi`, which
    /// points away from the surface, back along its path.
    ///
    /// `normal` is the unit geometric normal on either side; it is flipped to the side of `wi`. `dither` in `[0, 1)`, a
    /// random number of this photon's own, rounds the power without bias ([`crate::math::Rgbe::encode_dithered`]).
    #[inline]
    pub fn new(position: Vec3, power: Rgb, wi: Vec3, normal: Vec3, class: PhotonClass, dither: f32) -> Self {
        Self::of_line(position, (power, None), wi, normal, class, dither)
    }

    /// The same of a photon that may have a wavelength; the channels of its power are then equal.
    #[inline]
    pub fn of_line(
        position: Vec3,
        (power, line): (Rgb, Option<Line>),
        wi: Vec3,
        normal: Vec3,
        class: PhotonClass,
        dither: f32,
    ) -> Self {
        let side = if normal.dot(wi) < 0.0 { -normal } else { normal };
        let [wi, normal] = octahedral_encode_two([wi, side], [WI_BITS, NORMAL_BITS]);
        Self {
            position,
            power: PackedPower::encode(power, line, dither),
            wi: wi as u16,
            flags: normal as u16 | (class as u16) << (2 * NORMAL_BITS),
        }
    }

    /// The same photon with `factor` times the power, rounded by `dither` as in [`Self::new`].
    #[must_use]
    pub fn scaled(self, factor: f32, dither: f32) -> Self {
        Self { power: self.power.scaled(factor, dither), ..self }
    }

    /// Unnormalised flux, in watts; a photon with a wavelength has the response of the sensor to it, whose channels may be negative.
    #[inline]
    pub fn power(&self) -> Rgb {
        self.power.decode()
    }

    /// Whether it has a wavelength.
    pub fn is_monochromatic(&self) -> bool {
        self.power.is_monochromatic()
    }

    /// Unit direction back along the path; accurate to one degree.
    #[inline]
    pub fn wi(&self) -> Vec3 {
        decode_wi(self.wi)
    }

    /// Unit geometric normal on the side of arrival; accurate to [`NORMAL_ERROR`], exact along the axes.
    #[inline]
    pub fn normal(&self) -> Vec3 {
        decode_normal(self.flags)
    }

    /// Class: the path of the photon to its position.
    #[inline]
    pub fn class(&self) -> PhotonClass {
        decode_class(self.flags)
    }

    /// The bytes that a map stores apart from the position and the flags.
    pub(super) fn payload(&self) -> Payload {
        Payload { power: self.power, wi: self.wi }
    }

    /// Normal and class.
    #[inline]
    pub(super) fn flags(&self) -> u16 {
        self.flags
    }

    pub(super) fn from_parts(position: Vec3, flags: u16, payload: Payload) -> Self {
        Self { position, power: payload.power, wi: payload.wi, flags }
    }

    /// Record in a file: position, power, direction, flags, little-endian.
    pub(super) fn to_bytes(self) -> [u8; 20] {
        let mut bytes = [0; 20];
        let coordinates = self.position.to_array();
        coordinates
            .iter()
            .enumerate()
            .for_each(|(i, x)| bytes[4 * i..4 * i + 4].copy_from_slice(&x.to_le_bytes()));
        bytes[12..16].copy_from_slice(&self.power.to_bytes());
        bytes[16..18].copy_from_slice(&self.wi.to_le_bytes());
        bytes[18..].copy_from_slice(&self.flags.to_le_bytes());
        bytes
    }

    /// The photon of these bytes; `None` where they are not valid.
    pub(super) fn from_bytes(bytes: [u8; 20]) -> Option<Self> {
        let word = |at: usize| [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        let position = Vec3::from_array([0, 4, 8].map(|at| f32::from_le_bytes(word(at))));
        let flags = u16::from_le_bytes([bytes[18], bytes[19]]);
        let is_sound = position.is_finite() && flags >> (2 * NORMAL_BITS + 2) == 0;
        let wi = u16::from_le_bytes([bytes[16], bytes[17]]);
        is_sound.then_some(Self { position, power: PackedPower::from_bytes(word(12)), wi, flags })
    }

    /// All bits except the position's, as a number that orders photons at the same position.
    #[inline]
    pub(super) fn payload_bits(&self) -> u64 {
        let power = u64::from(u32::from_be_bytes(self.power.to_bytes()));
        power << 32 | u64::from(self.wi) << 16 | u64::from(self.flags)
    }
}

/// The part of a [`Photon`] that the sums of an estimate need.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub(super) struct Payload {
    power: PackedPower,
    wi: u16,
}

impl Payload {
    /// Unnormalised flux.
    #[inline]
    pub(super) fn power(&self) -> Rgb {
        self.power.decode()
    }

    /// Unnormalised flux times a factor, which is taken at the wavelength of the photon, if it has one.
    #[inline]
    pub(super) fn times(&self, factor: Rgb) -> Rgb {
        self.power.times(factor)
    }

    /// [`PackedPower::brightness`].
    #[inline]
    pub(super) fn brightness(&self) -> f32 {
        self.power.brightness()
    }

    /// Unit direction back along the photon's path.
    #[inline]
    pub(super) fn wi(&self) -> Vec3 {
        decode_wi(self.wi)
    }
}

fn decode_wi(code: u16) -> Vec3 {
    octahedral_decode(u32::from(code), WI_BITS)
}

/// The 12-bit code of a unit normal.
pub(super) fn normal_code(normal: Vec3) -> u16 {
    octahedral_encode(normal, NORMAL_BITS) as u16
}

/// The normal of each code, because a search decodes one for every candidate. Neighbouring photons share few codes,
/// which stay in the nearest cache.
static NORMALS: LazyLock<Box<[Vec3; NORMAL_CODES]>> =
    LazyLock::new(|| Box::new(std::array::from_fn(|code| octahedral_decode(code as u32, NORMAL_BITS))));

/// The table of normals, indexed by the lowest 12 bits of the flags.
#[inline]
pub(super) fn normal_table() -> &'static [Vec3; NORMAL_CODES] {
    &NORMALS
}

#[inline]
pub(super) fn decode_normal(flags: u16) -> Vec3 {
    NORMALS[usize::from(flags) % NORMAL_CODES]
}

/// Number of classes of normals: one for each of the six axes and eight diagonals that a normal may be nearest to.
pub(super) const NORMAL_CLASSES: u32 = 14;

/// One class of normals.
#[derive(Clone, Copy, Debug)]
struct NormalClass {
    middle: Vec3,
    /// Cosine and sine of the largest angle between the middle and a normal of the class.
    reach: [f32; 2],
}

/// The class of each code, and the classes.
static CLASSES: LazyLock<(Box<[u8; NORMAL_CODES]>, [NormalClass; NORMAL_CLASSES as usize])> =
    LazyLock::new(|| {
        let middle = |class: usize| match class {
            0..6 => Vec3::AXES[class / 2] * [1.0, -1.0][class % 2],
            _ => Vec3::from_array([0, 1, 2].map(|bit| [1.0, -1.0][(class - 6) >> bit & 1])).normalize(),
        };
        let middles: [Vec3; NORMAL_CLASSES as usize] = std::array::from_fn(middle);
        let nearest = |normal: Vec3| {
            let cosines = middles.map(|middle| middle.dot(normal));
            (0..cosines.len()).max_by(|&a, &b| cosines[a].total_cmp(&cosines[b])).unwrap_or(0)
        };
        let table = Box::new(std::array::from_fn(|code| nearest(NORMALS[code]) as u8));
        let class = |class: usize| {
            let middle = middles[class];
            let of_class = (0..NORMAL_CODES).filter(|&code| usize::from(table[code]) == class);
            let cosine = of_class.map(|code| middle.dot(NORMALS[code])).fold(1.0, f32::min);
            NormalClass { middle, reach: [cosine, (1.0 - cosine * cosine).max(0.0).sqrt()] }
        };
        let classes = std::array::from_fn(class);
        (table, classes)
    });

/// Class of the normal whose code is in the lowest 12 bits of `flags`.
#[inline]
pub(super) fn class_of_normal(flags: u16) -> u32 {
    u32::from(CLASSES.0[usize::from(flags) % NORMAL_CODES])
}

/// One bit for each class that may contain a normal at this cosine or more to the unit `normal`.
fn classes_near(normal: Vec3, min_cos: f32) -> u32 {
    // Many times the rounding of cosines of unit vectors: one class more changes no result.
    const ROUNDING: f32 = 32.0 * f32::EPSILON;
    let min_cos = min_cos.clamp(-1.0, 1.0);
    let min_sin = (1.0 - min_cos * min_cos).max(0.0).sqrt();
    let mut near = 0;
    for (i, NormalClass { middle, reach: [cos, sin] }) in CLASSES.1.iter().enumerate() {
        // If both angles together exceed a half turn, every class is near.
        let is_wide = min_cos + cos <= 0.0;
        let is_near = middle.dot(normal) >= min_cos * cos - min_sin * sin - ROUNDING;
        near |= u32::from(is_wide || is_near) << i;
    }
    near
}

#[inline]
pub(super) fn decode_class(flags: u16) -> PhotonClass {
    match flags >> (2 * NORMAL_BITS) & 3 {
        0 => PhotonClass::Direct,
        1 => PhotonClass::Indirect,
        2 => PhotonClass::Caustic,
        _ => PhotonClass::Shadow,
    }
}

/// The photons that a search accepts, by side and class. A bit set over all codes would cost 2 KiB to prepare for each
/// query, so both tests are made for each candidate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Acceptance {
    normals: &'static [Vec3; NORMAL_CODES],
    normal: Vec3,
    min_cos: f32,
    classes: u8,
    /// Classes that may contain accepted normals, one bit each.
    near: u32,
}

impl Acceptance {
    /// Photons of `classes` with `dot(photon normal, normal) >= min_cos`.
    pub(super) fn new(normal: Vec3, min_cos: f32, classes: PhotonClasses) -> Self {
        let near = classes_near(normal, min_cos);
        Self { normals: normal_table(), normal, min_cos, classes: classes.0, near }
    }

    /// Whether a photon whose normal is of one of these classes may be accepted.
    #[inline]
    pub(super) fn may_accept(&self, classes: u32) -> bool {
        self.near & classes != 0
    }

    /// Whether a photon with these flags is accepted.
    #[inline]
    pub(super) fn accepts(&self, flags: u16) -> bool {
        self.judge(flags).0
    }

    /// Whether a photon with these flags is accepted, and the sum of its normal and the query's normal.
    #[inline]
    pub(super) fn judge(&self, flags: u16) -> (bool, Vec3) {
        let normal = self.normals[usize::from(flags) % NORMAL_CODES];
        let class = flags >> (2 * NORMAL_BITS) & 3;
        let accepted = (normal.dot(self.normal) >= self.min_cos) & (self.classes >> class & 1 == 1);
        (accepted, normal + self.normal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream, warp};

    #[test]
    fn round_trip() {
        let mut rng = Rng::new(11, Stream::Measure, 0);
        for i in 0..10_000 {
            let wi = warp::square_to_sphere(rng.next_2d());
            let normal = warp::square_to_sphere(rng.next_2d());
            let class =
                [PhotonClass::Direct, PhotonClass::Indirect, PhotonClass::Caustic, PhotonClass::Shadow]
                    [i % 4];
            let power = Rgb::new(1.0, 0.5, 0.25);
            let photon = Photon::new(Vec3::splat(0.5), power, wi, normal, class, rng.next_f32());
            assert_eq!(photon.class(), class);
            assert!((photon.power() - power).abs().max_element() < 0.01);
            assert!((photon.wi() - wi).length() < 4.3 / 254.0);
            let side = if wi.dot(normal) < 0.0 { -normal } else { normal };
            assert!((photon.normal() - side).length() < NORMAL_ERROR);
            assert_eq!(Photon::from_parts(photon.position, photon.flags(), photon.payload()), photon);
        }
    }

    #[test]
    fn normal_error_is_the_worst_case() {
        // A dense patch around the centre of a face, where the map stretches most.
        let mut worst = 0f32;
        for i in 0..1_000_000 {
            let (x, y) = ((i % 1000) as f32, (i / 1000) as f32);
            let v = Vec3::ONE + Vec3::new(x - 500.0, y - 500.0, 0.0) * 4e-4;
            let v = v / v.length();
            worst = worst.max((decode_normal(normal_code(v)) - v).length());
        }
        assert!(worst < NORMAL_ERROR && worst > 0.95 * NORMAL_ERROR, "{worst}");
        assert!(super::super::MIN_NORMAL_COS <= (std::f32::consts::FRAC_PI_4 + NORMAL_ERROR).cos());
    }

    #[test]
    fn classes_of_normals_leave_no_accepted_one_out() {
        let mut rng = Rng::new(12, Stream::Measure, 0);
        let mut left_out = 0;
        for i in 0..300 {
            let normal = if i < 3 { Vec3::AXES[i] } else { warp::square_to_sphere(rng.next_2d()) };
            for min_cos in [-1.0, -0.5, 0.0, super::super::MIN_NORMAL_COS, 0.99] {
                let accept = Acceptance::new(normal, min_cos, PhotonClasses::ALL);
                for flags in 0..NORMAL_CODES as u16 {
                    let may = accept.may_accept(1 << class_of_normal(flags));
                    assert!(may || !accept.accepts(flags), "{normal} {min_cos} {flags}");
                    left_out += usize::from(!may);
                }
            }
        }
        assert!(left_out > 300 * NORMAL_CODES, "{left_out}");
    }

    #[test]
    fn sets_of_classes() {
        assert!(!PhotonClasses::LIGHT.contains(PhotonClass::Shadow));
        assert!(PhotonClasses::ALL.contains(PhotonClass::Shadow));
        let pair = PhotonClasses::only(PhotonClass::Direct).and(PhotonClasses::only(PhotonClass::Shadow));
        assert!(pair.contains(PhotonClass::Direct) && !pair.contains(PhotonClass::Caustic));
    }
}
