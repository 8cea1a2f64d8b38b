//! A value with its derivatives in several directions at once, for the sensitivities of a law with memory.
//!
//! All directions share one pass, including its powers and logarithms. The vector dual numbers of `num-dual` do the same, in three times
//! the time (node/docs/decisions/0013-explicit-derivatives.md).

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Number type of a step: `f64` in a simulation, [`Jet`] in an identification.
pub(super) trait Real:
    Copy
    + From<f64>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Mul<f64, Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The value alone.
    fn re(self) -> f64;
    fn exp(self) -> Self;
    fn ln(self) -> Self;
}

impl Real for f64 {
    #[inline]
    fn re(self) -> f64 {
        self
    }

    #[inline]
    fn exp(self) -> Self {
        self.exp()
    }

    #[inline]
    fn ln(self) -> Self {
        self.ln()
    }
}

/// A value and its derivatives in `N` directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Jet<const N: usize> {
    pub(super) re: f64,
    pub(super) by: [f64; N],
}

impl<const N: usize> Jet<N> {
    /// `re` as the variable of `direction`.
    #[inline]
    pub(super) fn variable(re: f64, direction: usize) -> Self {
        let mut jet = Self::from(re);
        jet.by[direction] = 1.0;
        jet
    }

    /// A value `re` whose derivatives are `a` times the derivatives of `self`.
    #[inline]
    fn chain(mut self, re: f64, a: f64) -> Self {
        self.by.iter_mut().for_each(|d| *d *= a);
        Self { re, by: self.by }
    }

    /// A value `re` whose derivatives are `a` times the derivatives of `self` plus `b` times the derivatives
    /// of `other`.
    #[inline]
    fn blend(mut self, other: &Self, re: f64, a: f64, b: f64) -> Self {
        for (d, e) in self.by.iter_mut().zip(&other.by) {
            *d = *d * a + *e * b;
        }
        Self { re, by: self.by }
    }
}

impl<const N: usize> From<f64> for Jet<N> {
    #[inline]
    fn from(re: f64) -> Self {
        Self { re, by: [0.0; N] }
    }
}

impl<const N: usize> Real for Jet<N> {
    #[inline]
    fn re(self) -> f64 {
        self.re
    }

    #[inline]
    fn exp(self) -> Self {
        let e = self.re.exp();
        self.chain(e, e)
    }

    #[inline]
    fn ln(self) -> Self {
        self.chain(self.re.ln(), self.re.recip())
    }
}

impl<const N: usize> Add for Jet<N> {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        self.blend(&other, self.re + other.re, 1.0, 1.0)
    }
}

impl<const N: usize> Sub for Jet<N> {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        self.blend(&other, self.re - other.re, 1.0, -1.0)
    }
}

impl<const N: usize> Mul for Jet<N> {
    type Output = Self;

    #[inline]
    fn mul(self, other: Self) -> Self {
        self.blend(&other, self.re * other.re, other.re, self.re)
    }
}

impl<const N: usize> Mul<f64> for Jet<N> {
    type Output = Self;

    #[inline]
    fn mul(self, factor: f64) -> Self {
        self.chain(self.re * factor, factor)
    }
}

impl<const N: usize> Div for Jet<N> {
    type Output = Self;

    #[inline]
    fn div(self, other: Self) -> Self {
        let inverse = other.re.recip();
        let re = self.re / other.re;
        self.blend(&other, re, inverse, -re * inverse)
    }
}

impl<const N: usize> Neg for Jet<N> {
    type Output = Self;

    #[inline]
    fn neg(self) -> Self {
        self.chain(-self.re, -1.0)
    }
}
