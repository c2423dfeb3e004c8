//! Numbers of many pixels as few bytes: each is predicted from its neighbours, and the differences are deflated byte by byte.

use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;
use std::io::{self, ErrorKind, Read, Write};

/// The nearest `f32` with so many explicit bits of mantissa (23 for a full one), at most the largest of those.
pub(super) fn short(x: f64, bits: u32) -> f64 {
    let dropped = 23 - bits;
    let full = super::to_f32(x).to_bits();
    let (half, odd) = if dropped == 0 { (0, 0) } else { ((1 << (dropped - 1)) - 1, full >> dropped & 1) };
    let rounded = full.wrapping_add(half + odd) >> dropped << dropped;
    let rounded = f32::from_bits(rounded);
    let largest = f32::from_bits(f32::MAX.to_bits() >> dropped << dropped);
    f64::from(if rounded.is_finite() { rounded } else { largest.copysign(rounded) })
}

/// How a number becomes an unsigned one whose order is that of the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Code {
    /// All bits of an `f64`.
    Double,
    /// An `f32` with so many explicit bits of mantissa.
    Short(u32),
}

impl Code {
    /// Bytes that a code takes.
    pub(super) fn width(self) -> usize {
        match self {
            Self::Double => 8,
            Self::Short(bits) => (9 + bits as usize).div_ceil(8),
        }
    }

    /// The code of a number, which must have this precision already.
    pub(super) fn of(self, x: f64) -> u64 {
        match self {
            Self::Double => {
                let bits = x.to_bits();
                if bits >> 63 == 1 { !bits } else { bits | 1 << 63 }
            }
            Self::Short(kept) => {
                let bits = (x as f32).to_bits();
                let code = if bits >> 31 == 1 { !bits } else { bits | 1 << 31 };
                u64::from(code >> (23 - kept))
            }
        }
    }

    /// The number of a code.
    pub(super) fn number(self, code: u64) -> f64 {
        match self {
            Self::Double => f64::from_bits(if code >> 63 == 1 { code & !(1 << 63) } else { !code }),
            Self::Short(kept) => {
                let dropped = 23 - kept;
                let code = (code as u32) << dropped;
                let is_positive = code >> 31 == 1;
                let bits = if is_positive { code & !(1 << 31) } else { !(code | ((1 << dropped) - 1)) };
                f64::from(f32::from_bits(bits))
            }
        }
    }
}

/// The difference of two codes of this width as an unsigned number that is small where the difference is.
fn difference(code: u64, foreseen: u64, width: usize) -> u64 {
    let unused = 64 - 8 * width as u32;
    let signed = (code.wrapping_sub(foreseen) << unused).cast_signed() >> unused;
    ((signed << 1) ^ (signed >> 63)).cast_unsigned() << unused >> unused
}

/// The code with this [`difference`].
fn undo(difference: u64, foreseen: u64, width: usize) -> u64 {
    let unused = 64 - 8 * width as u32;
    let signed = (difference >> 1).cast_signed() ^ -((difference & 1).cast_signed());
    foreseen.wrapping_add(signed.cast_unsigned()) << unused >> unused
}

/// Collects planes: one number for each pixel.
#[derive(Debug, Default)]
pub(super) struct Planes {
    bytes: Vec<u8>,
}

impl Planes {
    /// Adds a plane of codes of `width` bytes, each given with the code that is foreseen for it.
    pub(super) fn push(&mut self, width: usize, codes: &[u64], foreseen: impl Fn(usize) -> u64) {
        let start = self.bytes.len();
        let count = codes.len();
        self.bytes.resize(start + width * count, 0);
        for (i, &code) in codes.iter().enumerate() {
            let difference = difference(code, foreseen(i), width);
            for byte in 0..width {
                self.bytes[start + byte * count + i] = (difference >> (8 * byte)) as u8;
            }
        }
    }

    /// The deflated planes.
    pub(super) fn deflated(self) -> io::Result<Vec<u8>> {
        let mut encoder = DeflateEncoder::new(Vec::new(), Compression::new(1));
        encoder.write_all(&self.bytes)?;
        encoder.finish()
    }
}

/// Takes planes apart again, in the order in which they were added.
#[derive(Debug)]
pub(super) struct Inflated {
    bytes: Vec<u8>,
    at: usize,
    pixels: usize,
}

impl Inflated {
    /// Planes of `pixels` numbers each, of `width` bytes a pixel together.
    ///
    /// # Errors
    /// If the bytes are damaged or hold more or fewer planes.
    pub(super) fn new(deflated: &[u8], pixels: usize, width: usize) -> io::Result<Self> {
        let wanted = pixels.checked_mul(width).ok_or(ErrorKind::InvalidData)?;
        let mut bytes = Vec::new();
        bytes.try_reserve_exact(wanted + 1).map_err(|_| ErrorKind::OutOfMemory)?;
        DeflateDecoder::new(deflated).take(wanted as u64 + 1).read_to_end(&mut bytes)?;
        if bytes.len() == wanted {
            Ok(Self { bytes, at: 0, pixels })
        } else {
            Err(io::Error::new(ErrorKind::InvalidData, "planes of another length"))
        }
    }

    /// The next plane. `foreseen` gives the code foreseen for a pixel from the codes before it.
    pub(super) fn take(&mut self, width: usize, foreseen: impl Fn(usize, &[u64]) -> u64) -> Vec<u64> {
        let count = self.pixels;
        let plane = &self.bytes[self.at..self.at + width * count];
        self.at += width * count;
        let mut codes: Vec<u64> = Vec::with_capacity(count);
        for i in 0..count {
            let difference =
                (0..width).fold(0, |sum, byte| sum | u64::from(plane[byte * count + i]) << (8 * byte));
            let code = undo(difference, foreseen(i, &codes), width);
            codes.push(code);
        }
        codes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    /// Of all numbers with so few bits the nearest: found by going to both sides.
    #[test]
    fn short_numbers_are_the_nearest() {
        let mut rng = Rng::new(3, Stream::Measure, 0);
        for bits in [4, 9, 23] {
            for _ in 0..1000 {
                let x = f64::from((rng.next_f32() - 0.5) * 10f32.powi((rng.next_f32() * 60.0) as i32 - 30));
                let found = short(x, bits);
                let step = f64::from(1u32 << (23 - bits));
                let of = |k: f64| {
                    let shifted = f64::from((found as f32).to_bits()) + k * step;
                    f64::from(f32::from_bits(shifted as u32))
                };
                let here = (found - x).abs();
                assert!(here <= (of(1.0) - x).abs() && here <= (of(-1.0) - x).abs(), "{x} {found}");
                assert_eq!(short(found, bits), found);
            }
            assert!(short(f64::MAX, bits).is_finite() && short(-1e39, bits) < -3e38);
            assert_eq!(short(0.0, bits), 0.0);
        }
    }

    #[test]
    fn codes_keep_order_and_come_back() {
        let numbers = [-3e38, -1.5, -1e-40, -0.0, 0.0, 1e-40, 0.25, 1.0, 1.5, 3e38];
        for code in [Code::Double, Code::Short(4), Code::Short(9), Code::Short(23)] {
            let rounded = numbers.map(|x| if let Code::Short(bits) = code { short(x, bits) } else { x });
            let codes = rounded.map(|x| code.of(x));
            assert!(codes.is_sorted(), "{code:?}: {codes:?}");
            for (x, c) in rounded.into_iter().zip(codes) {
                assert_eq!(code.number(c).to_bits(), x.to_bits(), "{code:?} {x}");
                assert!(code.width() == 8 || c < 1 << (8 * code.width()));
            }
        }
    }

    #[test]
    fn planes_come_back_and_damage_is_seen() {
        let mut rng = Rng::new(4, Stream::Measure, 0);
        let plane = |width: u32, rng: &mut Rng| -> Vec<u64> {
            (0..500)
                .map(|_| {
                    (rng.next_f64() * 1.8e19) as u64 >> (64 - 8 * width) & (u64::MAX >> (64 - 8 * width))
                })
                .collect()
        };
        let (wide, narrow) = (plane(8, &mut rng), plane(2, &mut rng));
        let mut planes = Planes::default();
        planes.push(8, &wide, |i| if i == 0 { 0 } else { wide[i - 1] });
        planes.push(2, &narrow, |i| wide[i] & 0xffff);
        let bytes = planes.deflated().unwrap();
        let mut back = Inflated::new(&bytes, 500, 10).unwrap();
        assert_eq!(back.take(8, |i, before| if i == 0 { 0 } else { before[i - 1] }), wide);
        assert_eq!(back.take(2, |i, _| wide[i] & 0xffff), narrow);
        assert!(Inflated::new(&bytes, 500, 9).is_err() && Inflated::new(&bytes, 500, 11).is_err());
        assert!(Inflated::new(&bytes[..bytes.len() - 1], 500, 10).is_err());
    }
}
