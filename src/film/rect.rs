//! Rectangles of pixels: crop windows and tiles.

/// A rectangle of whole pixels, `x0 <= x < x1` and `y0 <= y < y1`, with row 0 at the top.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelRect {
    /// First column.
    pub x0: u32,
    /// First row.
    pub y0: u32,
    /// Column after the last.
    pub x1: u32,
    /// Row after the last.
    pub y1: u32,
}

impl PixelRect {
    /// The whole picture.
    pub fn whole(width: u32, height: u32) -> Self {
        Self { x0: 0, y0: 0, x1: width, y1: height }
    }

    /// Pixels across; zero where empty.
    pub fn width(&self) -> u32 {
        self.x1.saturating_sub(self.x0)
    }

    /// Pixels down; zero where empty.
    pub fn height(&self) -> u32 {
        self.y1.saturating_sub(self.y0)
    }

    /// Number of pixels.
    pub fn area(&self) -> usize {
        self.width() as usize * self.height() as usize
    }

    /// Whether the rectangle has no pixel.
    pub fn is_empty(&self) -> bool {
        self.area() == 0
    }

    /// Whether the pixel `(x, y)` is inside.
    pub fn contains(&self, x: u32, y: u32) -> bool {
        (self.x0..self.x1).contains(&x) && (self.y0..self.y1).contains(&y)
    }

    /// Whether all of `other` is inside.
    pub fn contains_rect(&self, other: &Self) -> bool {
        other.is_empty()
            || (self.x0 <= other.x0 && other.x1 <= self.x1 && self.y0 <= other.y0 && other.y1 <= self.y1)
    }

    /// The pixels in both rectangles; empty where they do not overlap.
    pub fn intersection(&self, other: &Self) -> Self {
        let (x0, y0) = (self.x0.max(other.x0), self.y0.max(other.y0));
        Self { x0, y0, x1: self.x1.min(other.x1).max(x0), y1: self.y1.min(other.y1).max(y0) }
    }

    /// Index of the pixel `(x, y)` in a buffer of this rectangle, row by row; `None` outside.
    pub fn index(&self, x: u32, y: u32) -> Option<usize> {
        self.contains(x, y).then(|| (y - self.y0) as usize * self.width() as usize + (x - self.x0) as usize)
    }

    /// All pixels `(x, y)`, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = (u32, u32)> + use<> {
        let Self { x0, y0, x1, y1 } = *self;
        (y0..y1).flat_map(move |y| (x0..x1).map(move |x| (x, y)))
    }

    /// Squares of `size` pixels (at least 1), cut to the rectangle, that cover it, row by row. Their grid always starts at pixel (0, 0) of
    /// the picture, so that a crop window has the same tiles as the whole picture.
    pub fn tiles(&self, size: u32) -> Vec<Self> {
        if self.is_empty() {
            return Vec::new();
        }
        let size = size.max(1);
        let starts = |low: u32, high: u32| (low / size..=(high - 1) / size).map(move |i| i * size);
        starts(self.y0, self.y1)
            .flat_map(|y| starts(self.x0, self.x1).map(move |x| (x, y)))
            .map(|(x, y)| Self { x0: x, y0: y, x1: x.saturating_add(size), y1: y.saturating_add(size) })
            .map(|tile| tile.intersection(self))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_each_pixel_once_on_one_grid() {
        let crop = PixelRect { x0: 5, y0: 30, x1: 71, y1: 65 };
        let mut seen = vec![0; crop.area()];
        for tile in crop.tiles(32) {
            assert!(!tile.is_empty() && crop.contains_rect(&tile));
            assert!(tile.x0 == 5 || tile.x0 % 32 == 0);
            tile.pixels().for_each(|(x, y)| seen[crop.index(x, y).unwrap()] += 1);
        }
        assert!(seen.iter().all(|&n| n == 1));
        assert_eq!(PixelRect::whole(0, 7).tiles(32), []);
    }

    #[test]
    fn intersections_never_turn_inside_out() {
        let a = PixelRect { x0: 0, y0: 0, x1: 4, y1: 4 };
        let b = PixelRect { x0: 8, y0: 8, x1: 9, y1: 9 };
        assert!(a.intersection(&b).is_empty());
        assert_eq!(a.index(4, 0), None);
    }
}
