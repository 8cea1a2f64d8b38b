//! A value with its derivatives in several directions at once, for the derivatives of a simulation.
//!
//! Laws, models and effects are written for any number type that is [`Real`]: `f64` in a simulation, [`Jet`] where derivatives are needed.
//! All directions share one pass, including its powers and logarithms. The vector dual numbers of `num-dual` do the same, in three times
//! the time (node/docs/decisions/0013-explicit-derivatives.md).
//!
//! All operations are inlined always: a law that runs in [`crate::lanes::widest`] then uses the vectors of the processor for them.
//!
//! A comparison uses the values alone. The derivative then belongs to the branch that was taken, which is exact except where two branches
//! meet.

use crate::elementary;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Number type of a step: `f64` in a simulation, [`Jet`] for derivatives.
pub(crate) trait Real:
    Copy
    + PartialEq
    + From<f64>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
{
    /// The value alone.
    fn re(self) -> f64;
    fn exp(self) -> Self;
    /// e^x - 1, exact for small x.
    fn exp_m1(self) -> Self;
    fn ln(self) -> Self;
    /// tanh, with an absolute error of 4e-16: see [`elementary::tanh`].
    fn tanh(self) -> Self;
    fn atan(self) -> Self;
    fn sin(self) -> Self;

    /// True for the constant zero: the value is zero, and so are its derivatives.
    #[inline(always)]
    fn is_zero(self) -> bool {
        self == Self::from(0.0)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        if self.re() < 0.0 { -self } else { self }
    }

    /// The larger of two values; the other one if one of them is NaN.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self.re() >= other.re() || other.re().is_nan() { self } else { other }
    }

    /// The smaller of two values; the other one if one of them is NaN.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self.re() <= other.re() || other.re().is_nan() { self } else { other }
    }

    /// The value, or the bound that it lies beyond. NaN stays NaN.
    #[inline(always)]
    fn clamp(self, low: f64, high: f64) -> Self {
        if self.re() < low {
            Self::from(low)
        } else if self.re() > high {
            Self::from(high)
        } else {
            self
        }
    }
}

impl Real for f64 {
    #[inline(always)]
    fn re(self) -> f64 {
        self
    }

    #[inline(always)]
    fn exp(self) -> Self {
        elementary::exp(self)
    }

    #[inline(always)]
    fn exp_m1(self) -> Self {
        elementary::exp_m1(self)
    }

    #[inline(always)]
    fn ln(self) -> Self {
        elementary::ln(self)
    }

    #[inline(always)]
    fn tanh(self) -> Self {
        elementary::tanh(self)
    }

    #[inline(always)]
    fn atan(self) -> Self {
        elementary::atan(self)
    }

    #[inline(always)]
    fn sin(self) -> Self {
        elementary::sin(self)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self >= other || other.is_nan() { self } else { other }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self <= other || other.is_nan() { self } else { other }
    }

    #[inline(always)]
    fn clamp(self, low: f64, high: f64) -> Self {
        self.clamp(low, high)
    }
}

/// A value and its derivatives in `N` directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Jet<const N: usize> {
    pub(crate) re: f64,
    pub(crate) by: [f64; N],
}

impl<const N: usize> Jet<N> {
    /// `re` as the variable of `direction`.
    #[inline(always)]
    pub(crate) fn variable(re: f64, direction: usize) -> Self {
        let mut jet = Self::from(re);
        jet.by[direction] = 1.0;
        jet
    }

    /// A value `re` whose derivatives are `a` times the derivatives of `self`.
    #[inline(always)]
    fn chain(mut self, re: f64, a: f64) -> Self {
        self.by.iter_mut().for_each(|d| *d *= a);
        Self { re, by: self.by }
    }

    /// A value `re` whose derivatives are `a` times the derivatives of `self` plus `b` times the derivatives
    /// of `other`.
    #[inline(always)]
    fn blend(mut self, other: &Self, re: f64, a: f64, b: f64) -> Self {
        for (d, e) in self.by.iter_mut().zip(&other.by) {
            *d = *d * a + *e * b;
        }
        Self { re, by: self.by }
    }
}

impl<const N: usize> Default for Jet<N> {
    #[inline(always)]
    fn default() -> Self {
        Self::from(0.0)
    }
}

impl<const N: usize> From<f64> for Jet<N> {
    #[inline(always)]
    fn from(re: f64) -> Self {
        Self { re, by: [0.0; N] }
    }
}

impl<const N: usize> Real for Jet<N> {
    #[inline(always)]
    fn re(self) -> f64 {
        self.re
    }

    #[inline(always)]
    fn exp(self) -> Self {
        let e = elementary::exp(self.re);
        self.chain(e, e)
    }

    #[inline(always)]
    fn exp_m1(self) -> Self {
        let less = elementary::exp_m1(self.re);
        self.chain(less, less + 1.0)
    }

    #[inline(always)]
    fn ln(self) -> Self {
        self.chain(elementary::ln(self.re), self.re.recip())
    }

    #[inline(always)]
    fn tanh(self) -> Self {
        let t = elementary::tanh(self.re);
        self.chain(t, 1.0 - t * t)
    }

    #[inline(always)]
    fn atan(self) -> Self {
        self.chain(elementary::atan(self.re), (1.0 + self.re * self.re).recip())
    }

    #[inline(always)]
    fn sin(self) -> Self {
        let (sin, cos) = (elementary::sin(self.re), elementary::cos(self.re));
        self.chain(sin, cos)
    }
}

impl<const N: usize> Add for Jet<N> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.blend(&other, self.re + other.re, 1.0, 1.0)
    }
}

impl<const N: usize> Sub for Jet<N> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.blend(&other, self.re - other.re, 1.0, -1.0)
    }
}

impl<const N: usize> Mul for Jet<N> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.blend(&other, self.re * other.re, other.re, self.re)
    }
}

impl<const N: usize> Div for Jet<N> {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let inverse = other.re.recip();
        let re = self.re / other.re;
        self.blend(&other, re, inverse, -re * inverse)
    }
}

impl<const N: usize> Neg for Jet<N> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.re, -1.0)
    }
}

impl<const N: usize> Add<f64> for Jet<N> {
    type Output = Self;

    #[inline(always)]
    fn add(self, constant: f64) -> Self {
        Self { re: self.re + constant, by: self.by }
    }
}

impl<const N: usize> Sub<f64> for Jet<N> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, constant: f64) -> Self {
        Self { re: self.re - constant, by: self.by }
    }
}

impl<const N: usize> Mul<f64> for Jet<N> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        self.chain(self.re * factor, factor)
    }
}

impl<const N: usize> Div<f64> for Jet<N> {
    type Output = Self;

    #[inline(always)]
    fn div(self, divisor: f64) -> Self {
        self.chain(self.re / divisor, divisor.recip())
    }
}
