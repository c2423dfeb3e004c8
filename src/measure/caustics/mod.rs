//! Caustics whose irradiance has a closed form, as references for estimates.
//!
//! The floor is the plane y = 0 and light comes from above. [`MirrorSquare`] is the model of figure 7 of Jensen & Christensen 1995,
//! computed with the mirror image of its light. [`Nephroid`] and [`Cardioid`] are the caustics of a reflecting ring (figure 2 of Jensen
//! 1996) in parallel light and in the light of a point on the ring, computed from the area that a bundle of rays covers on the floor.
//! [`caustic_figure`] compares estimates with the first (figure 8 of 1995).

mod figure;

pub use figure::{CausticFigure, FigureError, FigureRow, caustic_figure};

use std::f64::consts::{FRAC_PI_2, PI};

/// A rectangle on the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Range along x.
    pub x: [f64; 2],
    /// Range along z.
    pub z: [f64; 2],
}

impl Cell {
    /// The square around a point.
    pub fn around(x: f64, z: f64, width: f64) -> Self {
        let half = 0.5 * width;
        Self { x: [x - half, x + half], z: [z - half, z + half] }
    }

    /// Area.
    pub fn area(&self) -> f64 {
        (self.x[1] - self.x[0]) * (self.z[1] - self.z[0])
    }

    /// Whether the point is inside.
    pub fn contains(&self, x: f64, z: f64) -> bool {
        (self.x[0]..self.x[1]).contains(&x) && (self.z[0]..self.z[1]).contains(&z)
    }

    /// The part of `start + s direction` with `s` in `[0, longest]` that lies inside.
    fn chord(&self, start: [f64; 2], direction: [f64; 2], longest: f64) -> Option<[f64; 2]> {
        let (mut low, mut high) = (0.0f64, longest);
        for (axis, range) in [self.x, self.z].into_iter().enumerate() {
            let (at, along) = (start[axis], direction[axis]);
            if along == 0.0 {
                if !(range[0]..range[1]).contains(&at) {
                    return None;
                }
                continue;
            }
            let ends = range.map(|end| (end - at) / along);
            low = low.max(ends[0].min(ends[1]));
            high = high.min(ends[0].max(ends[1]));
        }
        (low < high).then_some([low, high])
    }
}

/// A point light at (1, 1.5, 0) above the floor x > 0, and a mirror in the plane x = 0 that extends from the floor to y = 1 and from
/// z = -0.5 to 0.5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorSquare {
    /// Intensity of the light, W/sr.
    pub intensity: f64,
    /// Reflectance of the mirror.
    pub reflectance: f64,
}

impl MirrorSquare {
    /// Height of the light.
    const HEIGHT: f64 = 1.5;

    /// End of the caustic along x, where light from the upper edge of the mirror arrives.
    pub const EDGE: f64 = 2.0;

    /// Direct irradiance from the light, W/m^2.
    pub fn direct(&self, x: f64, z: f64) -> f64 {
        self.from(1.0, x, z)
    }

    /// Irradiance by the mirror, from the image of the light at (-1, 1.5, 0) where it is seen through the mirror, W/m^2.
    pub fn caustic(&self, x: f64, z: f64) -> f64 {
        let way = 1.0 / (x + 1.0);
        let is_seen = x > 0.0 && Self::HEIGHT * (1.0 - way) <= 1.0 && (z * way).abs() <= 0.5;
        if is_seen { self.reflectance * self.from(-1.0, x, z) } else { 0.0 }
    }

    fn from(&self, light: f64, x: f64, z: f64) -> f64 {
        let distance_squared = (x - light).powi(2) + Self::HEIGHT.powi(2) + z * z;
        Self::HEIGHT * self.intensity / (distance_squared * distance_squared.sqrt())
    }
}

/// Number of steps of the quadrature over the ring.
const STEPS: u32 = 400_000;

/// Midpoints of [`STEPS`] equal parts of `[-end, end]`.
fn middles(end: f64) -> impl Iterator<Item = f64> {
    (0..STEPS).map(move |i| end * (2.0 * (f64::from(i) + 0.5) / f64::from(STEPS) - 1.0))
}

/// Parallel light along +x and downwards, reflected once by the inside of the ring x > 0 of this radius around the origin.
///
/// Light that hits the ring at the angle `phi` travels the distance `s` along the floor. It covers the width `|R cos phi - 2 s|` there,
/// where it lit the width `R cos phi` of the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nephroid {
    /// Radius of the ring.
    pub radius: f64,
    /// Distance along the floor that light from the upper edge of the ring travels: the height of the ring over the tangent of the
    /// elevation.
    pub reach: f64,
}

impl Nephroid {
    fn start(&self, phi: f64) -> ([f64; 2], [f64; 2], f64) {
        let start = [self.radius * phi.cos(), self.radius * phi.sin()];
        let longest = self.reach.min(2.0 * self.radius * phi.cos());
        (start, [-(2.0 * phi).cos(), -(2.0 * phi).sin()], longest)
    }

    /// Irradiance on the axis of symmetry over that of unreflected light on the floor. It holds where every point of the wall that lights
    /// the position is within the reach.
    pub fn on_axis(&self, x: f64) -> f64 {
        let t = x / self.radius;
        let straight = 1.0 / (1.0 - 2.0 * t).abs();
        // Inside the cusp, two more branches come from the sides.
        if t < 0.5 { straight } else { straight + 2.0 / (4.0 * t * t - 1.0) }
    }

    /// Mean irradiance over a cell, over that of unreflected light on the floor.
    pub fn mean(&self, cell: &Cell) -> f64 {
        let step = 2.0 * FRAC_PI_2 / f64::from(STEPS);
        let flux: f64 = middles(FRAC_PI_2)
            .filter_map(|phi| {
                let (start, direction, longest) = self.start(phi);
                let [low, high] = cell.chord(start, direction, longest)?;
                Some(self.radius * phi.cos() * (high - low) * step)
            })
            .sum();
        flux / cell.area()
    }
}

/// A point light above the ring of this radius around the origin, at (-R, h, 0), reflected once by the inside of the ring, which is
/// no higher than h / 2 (light that hit it above that height would hit it twice).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cardioid {
    /// Radius of the ring.
    pub radius: f64,
    /// Height of the light.
    pub height: f64,
    /// Height of the ring over that of the light: up to one half.
    pub ring: f64,
    /// Intensity of the light, W/sr.
    pub intensity: f64,
}

impl Cardioid {
    /// The point where light hits the ring at the central angle `psi`, its direction from there, the distance it travels, and the
    /// distance it has come.
    fn start(&self, psi: f64) -> ([f64; 2], [f64; 2], f64, f64) {
        let start = [self.radius * psi.cos(), self.radius * psi.sin()];
        let come = 2.0 * self.radius * (0.5 * psi).cos();
        let longest = come * self.ring / (1.0 - self.ring);
        (start, [-(1.5 * psi).cos(), -(1.5 * psi).sin()], longest, come)
    }

    /// Irradiance on the axis of symmetry from the path straight across, W/m^2.
    pub fn on_axis_straight(&self, x: f64) -> f64 {
        let s = self.radius - x;
        let way = 2.0 * self.radius + s;
        let spread = 2.0 * (self.height.powi(2) + way * way).powf(1.5) * (self.radius - 1.5 * s).abs();
        self.intensity * self.height * way / spread
    }

    /// Mean irradiance over a cell, W/m^2.
    pub fn mean(&self, cell: &Cell) -> f64 {
        let step = 2.0 * PI / f64::from(STEPS);
        let flux: f64 = middles(PI)
            .filter_map(|psi| {
                let (start, direction, longest, come) = self.start(psi);
                let ends = cell.chord(start, direction, longest)?;
                // Sines of the elevation: their difference is the solid angle per change of the azimuth, psi / 2.
                let [near, far] = ends.map(|s| self.height / self.height.hypot(come + s));
                Some(0.5 * self.intensity * (near - far) * step)
            })
            .sum();
        flux / cell.area()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tabulated_values() {
        let square = MirrorSquare { intensity: 1.0, reflectance: 1.0 };
        assert!((square.direct(1.0, 0.0) - 1.5 / 1.5f64.powi(3)).abs() < 1e-15);
        assert!((square.caustic(1.0, 0.0) - 1.5 / 6.25f64.powf(1.5)).abs() < 1e-15);
        assert!(square.caustic(1.999, 0.0) > 0.0 && square.caustic(2.001, 0.0) == 0.0);
        assert!(square.caustic(1.0, 0.999) > 0.0 && square.caustic(1.0, 1.001) == 0.0);

        let nephroid = Nephroid { radius: 1.0, reach: 2.0 };
        for (x, value) in [
            (-0.5, 0.5),
            (0.0, 1.0),
            (0.25, 2.0),
            (0.4, 5.0),
            (0.49, 50.0),
            (0.51, 99.505),
            (0.55, 19.524),
            (0.6, 9.545),
            (0.75, 3.6),
            (0.9, 2.143),
        ] {
            assert!((nephroid.on_axis(x) / value - 1.0).abs() < 3e-4, "{x}: {}", nephroid.on_axis(x));
        }
        let cardioid = Cardioid { radius: 1.0, height: 1.0, ring: 0.5, intensity: 1.0 };
        for (x, value) in [
            (-0.5, 0.029027),
            (0.0, 0.094868),
            (0.2, 0.26633),
            (0.3, 1.131181),
            (0.4, 0.601382),
            (0.6, 0.170687),
            (0.9, 0.098169),
        ] {
            let found = cardioid.on_axis_straight(x);
            assert!((found / value - 1.0).abs() < 1e-4, "{x}: {found}");
        }
    }

    /// The mean over a small cell is the value in its middle. Inside the cusp there are two more branches.
    #[test]
    fn means_of_small_cells_are_point_values() {
        let nephroid = Nephroid { radius: 1.0, reach: 2.0 };
        for x in [-0.5, 0.0, 0.25, 0.75, 0.9] {
            let mean = nephroid.mean(&Cell::around(x, 0.0, 0.01));
            assert!((mean / nephroid.on_axis(x) - 1.0).abs() < 3e-3, "{x}: {mean}");
        }
        let cardioid = Cardioid { radius: 1.0, height: 1.0, ring: 0.5, intensity: 1.0 };
        for (x, value) in [(-0.5, 0.029027), (0.0, 0.094868), (0.2, 0.26633), (0.6, 0.35337)] {
            let mean = cardioid.mean(&Cell::around(x, 0.0, 0.01));
            assert!((mean / value - 1.0).abs() < 3e-3, "{x}: {mean}");
        }
    }
}
