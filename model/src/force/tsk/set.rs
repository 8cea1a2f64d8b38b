//! Membership functions over a normalised input, as MATLAB's Fuzzy Logic Toolbox defines them.
//!
//! ```text
//! gaussmf    g(u) = exp(-(u - c)^2 / (2 s^2))
//! gauss2mf   g(u) = exp(-(min(0, u - c1))^2 / (2 s1^2)) exp(-(max(0, u - c2))^2 / (2 s2^2))
//! gbellmf    g(u) = 1 / (1 + |(u - c)/a|^(2 b))
//! trimf      g(u) = max(0, min((u - a)/(b - a), (d - u)/(d - b)))            feet a, d, peak b
//! trapmf     g(u) = max(0, min((u - a)/(b - a), 1, (d - u)/(d - c)))         feet a, d, shoulders b, c
//! ```
//!
//! A trapezoid's side is vertical if its foot equals its shoulder; the shoulder itself has the value 1. A two-sided
//! Gaussian has the value 1 from c1 to c2; if c1 > c2, both sides multiply there and the maximum is below 1.
//!
//! Source: `[jang1993]` in the bibliography (node/docs/guide/bibliography.md); MATLAB's pages of gaussmf, gauss2mf,
//! gbellmf, trimf and trapmf.

use crate::elementary::{exp, ln, ln_1p};
use crate::error::Error;

/// Largest number of numbers of one membership.
pub(crate) const NUMBERS: usize = 4;
/// Smallest sigma of a Gaussian and half width of a bell, in standard deviations of its input. A narrower set is a
/// spike between samples.
const LEAST_WIDTH: f64 = 1e-6;
/// Largest exponent of a bell, which is then a rectangle to all digits.
const MOST_EXPONENT: f64 = 1e6;

/// One membership function, over the normalised input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TskSet {
    /// exp(-(u - centre)^2 / (2 sigma^2)).
    Gaussian {
        /// Position of the maximum.
        centre: f64,
        /// Standard deviation.
        sigma: f64,
    },
    /// One at the peak, zero at the feet, linear between.
    Triangle {
        /// Left foot; unused for the first set, which is a shoulder.
        left: f64,
        /// Position of the maximum.
        peak: f64,
        /// Right foot; unused for the last set.
        right: f64,
    },
    /// Generalised bell: 1 / (1 + |(u - centre) / half_width|^(2 exponent)).
    Bell {
        /// Distance from the centre to the value 1/2 (MATLAB's a).
        half_width: f64,
        /// Half the power with which the sides fall (MATLAB's b).
        exponent: f64,
        /// Position of the maximum (MATLAB's c).
        centre: f64,
    },
    /// One between the shoulders, zero outside the feet, linear between foot and shoulder. Trapezoids have no
    /// shoulders at the ends of an input: each falls to zero on both sides.
    Trapezoid {
        /// Left foot.
        left_foot: f64,
        /// Left end of the plateau; at least the left foot.
        left_shoulder: f64,
        /// Right end of the plateau. Below the left shoulder, the two sides cross below one.
        right_shoulder: f64,
        /// Right foot; at least the right shoulder.
        right_foot: f64,
    },
    /// A Gaussian side below the left centre times a Gaussian side above the right centre.
    TwoSidedGaussian {
        /// Standard deviation of the left side.
        left_sigma: f64,
        /// Position where the left side reaches one.
        left_centre: f64,
        /// Standard deviation of the right side.
        right_sigma: f64,
        /// Position where the right side leaves one.
        right_centre: f64,
    },
}

/// Shape of an input's memberships.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Gaussians.
    Gaussian,
    /// Triangles, with shoulders at the ends.
    Triangle,
    /// Generalised bells.
    Bell,
    /// Trapezoids, without shoulders at the ends.
    Trapezoid,
    /// Gaussians with two sides.
    TwoSidedGaussian,
}

impl Shape {
    /// All shapes.
    pub const ALL: [Self; 5] =
        [Self::Gaussian, Self::Triangle, Self::Bell, Self::Trapezoid, Self::TwoSidedGaussian];

    /// Name in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Gaussian => "gaussian",
            Self::Triangle => "triangle",
            Self::Bell => "bell",
            Self::Trapezoid => "trapezoid",
            Self::TwoSidedGaussian => "two-sided gaussian",
        }
    }

    /// Number of numbers of one membership.
    #[must_use]
    pub const fn width(self) -> usize {
        match self {
            Self::Gaussian => 2,
            Self::Triangle | Self::Bell => 3,
            Self::Trapezoid | Self::TwoSidedGaussian => 4,
        }
    }
}

impl TskSet {
    /// The shape.
    #[must_use]
    pub const fn shape(&self) -> Shape {
        match self {
            Self::Gaussian { .. } => Shape::Gaussian,
            Self::Triangle { .. } => Shape::Triangle,
            Self::Bell { .. } => Shape::Bell,
            Self::Trapezoid { .. } => Shape::Trapezoid,
            Self::TwoSidedGaussian { .. } => Shape::TwoSidedGaussian,
        }
    }

    /// Position of the maximum: the centre, the peak, or the middle of the plateau.
    #[must_use]
    pub const fn top(&self) -> f64 {
        match *self {
            Self::Gaussian { centre, .. } | Self::Bell { centre, .. } => centre,
            Self::Triangle { peak, .. } => peak,
            Self::Trapezoid { left_shoulder, right_shoulder, .. } => {
                f64::midpoint(left_shoulder, right_shoulder)
            }
            Self::TwoSidedGaussian { left_centre, right_centre, .. } => {
                f64::midpoint(left_centre, right_centre)
            }
        }
    }

    /// The numbers in the order of the fields, followed by zeros.
    pub(crate) const fn numbers(&self) -> [f64; NUMBERS] {
        match *self {
            Self::Gaussian { centre, sigma } => [centre, sigma, 0.0, 0.0],
            Self::Triangle { left, peak, right } => [left, peak, right, 0.0],
            Self::Bell { half_width, exponent, centre } => [half_width, exponent, centre, 0.0],
            Self::Trapezoid { left_foot, left_shoulder, right_shoulder, right_foot } => {
                [left_foot, left_shoulder, right_shoulder, right_foot]
            }
            Self::TwoSidedGaussian { left_sigma, left_centre, right_sigma, right_centre } => {
                [left_sigma, left_centre, right_sigma, right_centre]
            }
        }
    }

    /// The membership with the numbers of [`Self::numbers`].
    pub(crate) const fn of(shape: Shape, [a, b, c, d]: [f64; NUMBERS]) -> Self {
        match shape {
            Shape::Gaussian => Self::Gaussian { centre: a, sigma: b },
            Shape::Triangle => Self::Triangle { left: a, peak: b, right: c },
            Shape::Bell => Self::Bell { half_width: a, exponent: b, centre: c },
            Shape::Trapezoid => {
                Self::Trapezoid { left_foot: a, left_shoulder: b, right_shoulder: c, right_foot: d }
            }
            Shape::TwoSidedGaussian => {
                Self::TwoSidedGaussian { left_sigma: a, left_centre: b, right_sigma: c, right_centre: d }
            }
        }
    }

    /// Checks the numbers. The outer foot of a shoulder triangle may equal its peak: it counts only if
    /// `left_counts` or `right_counts`.
    pub(crate) fn check(&self, name: &str, left_counts: bool, right_counts: bool) -> Result<(), Error> {
        let finite = |field: &str, value: f64| {
            Error::check(&format!("{name}.{field}"), value, "finite", |_| true).map(|_| ())
        };
        let wide = |field: &str, value: f64| {
            let least = "finite and at least 1e-6";
            Error::check(&format!("{name}.{field}"), value, least, |w| w >= LEAST_WIDTH).map(|_| ())
        };
        match *self {
            Self::Gaussian { centre, sigma } => {
                finite("centre", centre)?;
                wide("sigma", sigma)
            }
            Self::Triangle { left, peak, right } => {
                finite("peak", peak)?;
                Error::check(&format!("{name}.left"), left, "below the peak", |l| {
                    l < peak || (l == peak && !left_counts)
                })?;
                Error::check(&format!("{name}.right"), right, "above the peak", |r| {
                    r > peak || (r == peak && !right_counts)
                })?;
                Ok(())
            }
            Self::Bell { half_width, exponent, centre } => {
                wide("half_width", half_width)?;
                Error::check(&format!("{name}.exponent"), exponent, "above 0 and at most 1e6", |b| {
                    b > 0.0 && b <= MOST_EXPONENT
                })?;
                finite("centre", centre)
            }
            Self::Trapezoid { left_foot, left_shoulder, right_shoulder, right_foot } => {
                finite("left_foot", left_foot)?;
                Error::check(
                    &format!("{name}.left_shoulder"),
                    left_shoulder,
                    "at least the left foot",
                    |b| b >= left_foot,
                )?;
                Error::check(&format!("{name}.right_foot"), right_foot, "above the left foot", |d| {
                    d > left_foot
                })?;
                Error::check(
                    &format!("{name}.right_shoulder"),
                    right_shoulder,
                    "at most the right foot",
                    |c| c <= right_foot,
                )?;
                Ok(())
            }
            Self::TwoSidedGaussian { left_sigma, left_centre, right_sigma, right_centre } => {
                wide("left_sigma", left_sigma)?;
                finite("left_centre", left_centre)?;
                wide("right_sigma", right_sigma)?;
                finite("right_centre", right_centre)
            }
        }
    }
}

/// Squared distance of a two-sided Gaussian with `numbers` from `u`, in its sigmas, halved: -ln g.
#[inline]
pub(super) fn two_sided_energy([s1, c1, s2, c2]: &[f64; NUMBERS], u: f64) -> f64 {
    let (left, right) = (((c1 - u) / s1).max(0.0), ((u - c2) / s2).max(0.0));
    0.5 * (left * left + right * right)
}

/// Value of a trapezoid with `numbers` at `u`.
#[inline]
pub(super) fn trapezoid([a, b, c, d]: &[f64; NUMBERS], u: f64) -> f64 {
    let rise = if u >= *b { 1.0 } else { ((u - a) / (b - a)).max(0.0) };
    let fall = if u <= *c { 1.0 } else { ((d - u) / (d - c)).max(0.0) };
    rise.min(fall)
}

/// Derivatives of a trapezoid with respect to its numbers: of the side that determines its value.
pub(super) fn trapezoid_slopes([a, b, c, d]: &[f64; NUMBERS], u: f64) -> [f64; NUMBERS] {
    let rise = if u >= *b { 1.0 } else { (u - a) / (b - a) };
    let fall = if u <= *c { 1.0 } else { (d - u) / (d - c) };
    if rise <= fall && rise > 0.0 && u < *b {
        [(u - b) / (b - a).powi(2), (a - u) / (b - a).powi(2), 0.0, 0.0]
    } else if fall < rise && fall > 0.0 {
        [0.0, 0.0, (d - u) / (d - c).powi(2), (u - c) / (d - c).powi(2)]
    } else {
        [0.0; NUMBERS]
    }
}

/// |(u - c)/a|^(2 b) of a bell; infinite if it overflows.
#[inline]
pub(super) fn bell_power([a, b, c, _]: &[f64; NUMBERS], u: f64) -> f64 {
    exp(2.0 * b * ln(((u - c) / a).abs()))
}

/// -ln g of a bell, also where its power overflows.
pub(super) fn bell_energy([a, b, c, _]: &[f64; NUMBERS], u: f64) -> f64 {
    // ln(1 + e^t)
    let t = 2.0 * b * ln(((u - c) / a).abs());
    t.max(0.0) + ln_1p(exp(-t.abs()))
}
