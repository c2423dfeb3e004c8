//! Arithmetic in twice the precision of `f64`, for tests.

use glam::DVec3;
use std::ops::{Add, Mul, Sub};

/// An unevaluated sum of two `f64`: about 106 bits, to check results of `f64` (Dekker 1971).
#[derive(Clone, Copy, Debug)]
pub(super) struct DoubleDouble(f64, f64);

impl DoubleDouble {
    fn renormalised(high: f64, low: f64) -> Self {
        let sum = high + low;
        Self(sum, low - (sum - high))
    }

    pub(super) fn to_f64(self) -> f64 {
        self.0 + self.1
    }
}

impl From<f64> for DoubleDouble {
    fn from(x: f64) -> Self {
        Self(x, 0.0)
    }
}

impl Add for DoubleDouble {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let sum = self.0 + other.0;
        let part = sum - self.0;
        let error = (self.0 - (sum - part)) + (other.0 - part);
        Self::renormalised(sum, error + self.1 + other.1)
    }
}

impl Sub for DoubleDouble {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + Self(-other.0, -other.1)
    }
}

impl Mul for DoubleDouble {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let product = self.0 * other.0;
        let error = self.0.mul_add(other.0, -product);
        Self::renormalised(product, error + self.0 * other.1 + self.1 * other.0)
    }
}

/// A vector of double-double numbers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vector(pub(super) [DoubleDouble; 3]);

impl Vector {
    fn zip(self, other: Self, f: impl Fn(DoubleDouble, DoubleDouble) -> DoubleDouble) -> Self {
        Self([f(self.0[0], other.0[0]), f(self.0[1], other.0[1]), f(self.0[2], other.0[2])])
    }

    pub(super) fn dot(self, other: Self) -> DoubleDouble {
        let Self([x, y, z]) = self.zip(other, Mul::mul);
        x + y + z
    }

    pub(super) fn cross(self, other: Self) -> Self {
        let ([a, b, c], [d, e, f]) = (self.0, other.0);
        Self([b * f - c * e, c * d - a * f, a * e - b * d])
    }

    pub(super) fn along(self, t: f64, direction: Self) -> Self {
        self.zip(direction, |p, d| p + DoubleDouble::from(t) * d)
    }
}

impl From<DVec3> for Vector {
    fn from(v: DVec3) -> Self {
        Self(v.to_array().map(DoubleDouble::from))
    }
}

impl Sub for Vector {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.zip(other, Sub::sub)
    }
}

#[test]
fn keeps_what_f64_loses() {
    let third = DoubleDouble::from(1.0 + 1e-10);
    // (1 + d)^2 - 1 - 2 d = d^2, which is below the resolution of f64 at one.
    let d = (1.0 + 1e-10) - 1.0;
    let rest = third * third - DoubleDouble::from(1.0) - DoubleDouble::from(2.0 * d);
    assert!((rest.to_f64() / (d * d) - 1.0).abs() < 1e-9);
}
