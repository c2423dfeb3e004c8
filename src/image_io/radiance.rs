//! Header of a Radiance picture (HDR): the factor and the order of its pixels. OpenImageIO reads the pixels as they are stored and ignores
//! both.

use std::io::{self, Read};

/// Longest header that is read, in bytes.
const LONGEST: u64 = 1 << 16;

/// Value of `FORMAT` for pixels in CIE XYZ.
const XYZ: &str = "32-bit_rle_xyze";

/// Chromaticities of red, green, blue and white: those of sRGB, and the defaults of Radiance.
const USUAL_PRIMARIES: [[f64; 8]; 2] =
    [[0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329], [0.64, 0.33, 0.29, 0.6, 0.15, 0.06, 0.3333, 0.3333]];

/// Content of the header.
#[derive(Debug, PartialEq)]
pub(super) struct RadianceHeader {
    /// Factors that red, green and blue were multiplied by.
    pub(super) factor: [f64; 3],
    pub(super) order: Order,
    pub(super) is_xyz: bool,
    /// Messages for the user.
    pub(super) findings: Vec<String>,
}

/// Order of the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Order {
    /// Pixels are stored column by column instead of row by row.
    by_column: bool,
    /// Pixels run from right to left.
    from_right: bool,
    /// Pixels run from bottom to top.
    from_bottom: bool,
}

impl Order {
    /// Rows from the top, each from the left, as in nearly all files.
    const USUAL: Self = Self { by_column: false, from_right: false, from_bottom: false };

    /// Parses a resolution line such as `-Y 600 +X 800`.
    fn parse(line: &str) -> Option<Self> {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        let &[first, count, second, length] = words.as_slice() else { return None };
        count.parse::<u32>().ok()?;
        length.parse::<u32>().ok()?;
        let by_column = first.ends_with('X');
        let (x, y) = if by_column { (first, second) } else { (second, first) };
        let is_reversed = |word: &str, usual: &str, reversed: &str| match word {
            _ if word == usual => Some(false),
            _ if word == reversed => Some(true),
            _ => None,
        };
        Some(Self {
            by_column,
            from_right: is_reversed(x, "+X", "-X")?,
            from_bottom: is_reversed(y, "-Y", "+Y")?,
        })
    }

    /// Reorders stored pixels of `size` (length of a line, number of lines) into rows from the top. Also returns their width and height.
    pub(super) fn upright(self, pixels: Vec<f32>, size: [u32; 2], channels: usize) -> (Vec<f32>, [u32; 2]) {
        if self == Self::USUAL {
            return (pixels, size);
        }
        let [length, lines] = size.map(|side| side as usize);
        let [width, height] = if self.by_column { [lines, length] } else { [length, lines] };
        let mut upright = Vec::with_capacity(pixels.len());
        for y in 0..height {
            for x in 0..width {
                let x = if self.from_right { width - 1 - x } else { x };
                let y = if self.from_bottom { height - 1 - y } else { y };
                let index = if self.by_column { x * length + y } else { y * length + x };
                upright.extend_from_slice(&pixels[index * channels..(index + 1) * channels]);
            }
        }
        (upright, [width as u32, height as u32])
    }
}

impl RadianceHeader {
    /// Reads the header at the start of a file.
    pub(super) fn read(file: impl Read) -> io::Result<Self> {
        let mut bytes = Vec::new();
        file.take(LONGEST).read_to_end(&mut bytes)?;
        Ok(Self::parse(&bytes))
    }

    fn parse(bytes: &[u8]) -> Self {
        let mut header = Self { factor: [1.0; 3], order: Order::USUAL, is_xyz: false, findings: Vec::new() };
        let mut lines =
            bytes.split(|&byte| byte == b'\n').map(|line| String::from_utf8_lossy(line.trim_ascii()));
        // Variables precede a blank line.
        for line in lines.by_ref() {
            if line.is_empty() {
                break;
            }
            if let Some((name, value)) = line.split_once('=') {
                header.variable(name.trim(), value.trim());
            }
        }
        header.order = lines.next().and_then(|line| Order::parse(&line)).unwrap_or(Order::USUAL);
        header
    }

    fn variable(&mut self, name: &str, value: &str) {
        let numbers: Vec<f64> = value.split_ascii_whitespace().map_while(|word| word.parse().ok()).collect();
        let are_positive = |numbers: &[f64]| numbers.iter().all(|number| *number > 0.0 && number.is_finite());
        match (name, numbers.as_slice()) {
            ("FORMAT", _) => self.is_xyz = value == XYZ,
            // Each program that changes the exposure adds a line, so the factors multiply.
            ("EXPOSURE", &[exposure]) if are_positive(&[exposure]) => {
                self.factor = self.factor.map(|factor| factor * exposure);
            }
            ("COLORCORR", &[red, green, blue]) if are_positive(&[red, green, blue]) => {
                let by = [red, green, blue];
                self.factor = std::array::from_fn(|channel| self.factor[channel] * by[channel]);
                self.findings
                    .push(format!("its colours were corrected by {value} (COLORCORR), which is taken back"));
            }
            ("EXPOSURE" | "COLORCORR", _) => {
                self.findings.push(format!("`{name}={value}` is not used: expected numbers above 0"));
            }
            ("PRIMARIES", numbers) => {
                let is_usual = USUAL_PRIMARIES.iter().any(|usual| {
                    numbers.len() == usual.len()
                        && numbers.iter().zip(usual).all(|(a, b)| (a - b).abs() < 2e-3)
                });
                if !is_usual {
                    self.findings.push(format!(
                        "its colours have the primaries {value}, and are shown as if they were those of sRGB; convert it (`ra_xyze` \
                         of Radiance does)"
                    ));
                }
            }
            _ => {}
        }
    }

    /// Divides the pixels by the factors of the header.
    pub(super) fn restore(&self, pixels: &mut [f32], channels: usize) {
        if self.factor == [1.0; 3] || channels < 3 {
            return;
        }
        for pixel in pixels.chunks_exact_mut(channels) {
            for (value, factor) in pixel.iter_mut().zip(self.factor) {
                *value = (f64::from(*value) / factor) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposures_multiply_and_colours_are_told() {
        let header = RadianceHeader::parse(
            b"#?RADIANCE\n# made\nEXPOSURE=4\nEXPOSURE= 0.5\nCOLORCORR=1 2 0.5\nFORMAT=32-bit_rle_rgbe\n\
              PRIMARIES=0.64 0.33 0.30 0.60 0.15 0.06 0.3127 0.3290\n\n-Y 2 +X 3\n",
        );
        assert_eq!((header.factor, header.order), ([2.0, 4.0, 1.0], Order::USUAL));
        assert_eq!(header.findings.len(), 1, "{:?}", header.findings);
        let mut pixels = [2.0, 2.0, 2.0];
        header.restore(&mut pixels, 3);
        assert_eq!(pixels, [1.0, 0.5, 2.0]);
        let odd = RadianceHeader::parse(
            b"#?RGBE\nEXPOSURE=0\nPRIMARIES=0.7 0.3 0.2 0.7 0.1 0.1 0.3 0.3\n\n-Y 1 +X 1\n",
        );
        assert_eq!((odd.factor, odd.findings.len()), ([1.0; 3], 2));
        assert!(RadianceHeader::parse(b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n").is_xyz);
    }

    #[test]
    fn pixels_of_all_orders_come_upright() {
        // 1 2 3 above 4 5 6.
        for (line, stored, size) in [
            ("-Y 2 +X 3", [1., 2., 3., 4., 5., 6.], [3, 2]),
            ("-Y 2 -X 3", [3., 2., 1., 6., 5., 4.], [3, 2]),
            ("+Y 2 +X 3", [4., 5., 6., 1., 2., 3.], [3, 2]),
            ("+Y 2 -X 3", [6., 5., 4., 3., 2., 1.], [3, 2]),
            ("+X 3 -Y 2", [1., 4., 2., 5., 3., 6.], [2, 3]),
            ("-X 3 -Y 2", [3., 6., 2., 5., 1., 4.], [2, 3]),
            ("+X 3 +Y 2", [4., 1., 5., 2., 6., 3.], [2, 3]),
            ("-X 3 +Y 2", [6., 3., 5., 2., 4., 1.], [2, 3]),
        ] {
            let order = Order::parse(line).unwrap();
            let (pixels, upright) = order.upright(stored.to_vec(), size, 1);
            assert_eq!((pixels, upright), (vec![1., 2., 3., 4., 5., 6.], [3, 2]), "{line}");
        }
        for odd in ["", "-Y 2", "-Z 2 +X 3", "-Y 2 +Y 3", "-Y a +X 3"] {
            assert_eq!(Order::parse(odd), None, "{odd}");
        }
    }
}
