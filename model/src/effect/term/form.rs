//! Forms: the curve g(q) of a term. a and b are its parameters, in the unit of the argument q.
//!
//! | form | g(q) | unit |
//! |---|---|---|
//! | `constant` | 1 | - |
//! | `linear` | q | of q |
//! | `quadratic` | q² | of q, squared |
//! | `step` | (1 + tanh((q - a) / b)) / 2 | - |
//! | `hinge_above`, `hinge_below` | max(0, q - a), max(0, a - q) | of q |
//! | `ramp` | (q - a) / b, within 0 to 1 | - |
//! | `decay` | exp(-abs(q) / a) | - |
//! | `growth` | exp(q / a) - 1 | - |
//! | `tanh` | tanh(q / a) | - |
//! | `bump` | exp(-((q - a) / b)²) | - |
//! | `window` | 1 for abs(q) < a, otherwise 0, smooth over a / 10 | - |
//! | `deadband` | q beyond -a to a, less a | of q |
//! | `sine` | sin(2 pi (q - a) / b) | - |
//! | `staircase` | the whole steps of width a in q | - |

use super::{MAX_FORM_PARAMETERS, Term};
use crate::force::jet::Real;
use std::f64::consts::TAU;

/// A form; see `model/src/effect/term/form.rs`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Form {
    /// 1.
    Constant,
    /// q.
    Linear,
    /// q squared.
    Quadratic,
    /// From 0 to 1 at a, over a width b.
    Step,
    /// q - a above a.
    HingeAbove,
    /// a - q below a.
    HingeBelow,
    /// From 0 at a to 1, over a width b.
    Ramp,
    /// Decays with the scale a.
    Decay,
    /// Grows with the scale a.
    Growth,
    /// Saturates with the scale a.
    Tanh,
    /// A bump at a with the width b.
    Bump,
    /// 1 within a of zero.
    Window,
    /// q beyond a of zero.
    Deadband,
    /// A sine with the phase a and the wavelength b.
    Sine,
    /// Steps of width a.
    Staircase,
}

/// A parameter of a form.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FormParameter {
    /// Name. Its unit is the argument's.
    pub name: &'static str,
    positive: bool,
}

impl FormParameter {
    const fn place(name: &'static str) -> Self {
        Self { name, positive: false }
    }

    const fn size(name: &'static str) -> Self {
        Self { name, positive: true }
    }

    /// True if it must be above zero.
    #[must_use]
    pub const fn is_positive(&self) -> bool {
        self.positive
    }
}

impl Form {
    /// All forms, from simple to complex.
    pub const ALL: [Self; 15] = [
        Self::Constant,
        Self::Linear,
        Self::Quadratic,
        Self::Step,
        Self::HingeAbove,
        Self::HingeBelow,
        Self::Tanh,
        Self::Decay,
        Self::Growth,
        Self::Window,
        Self::Deadband,
        Self::Staircase,
        Self::Ramp,
        Self::Bump,
        Self::Sine,
    ];

    /// Name, as in model files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Linear => "linear",
            Self::Quadratic => "quadratic",
            Self::Step => "step",
            Self::HingeAbove => "hinge_above",
            Self::HingeBelow => "hinge_below",
            Self::Ramp => "ramp",
            Self::Decay => "decay",
            Self::Growth => "growth",
            Self::Tanh => "tanh",
            Self::Bump => "bump",
            Self::Window => "window",
            Self::Deadband => "deadband",
            Self::Sine => "sine",
            Self::Staircase => "staircase",
        }
    }

    /// The form with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|form| form.name() == name)
    }

    /// Its parameters.
    #[must_use]
    pub const fn parameters(self) -> &'static [FormParameter] {
        match self {
            Self::Constant | Self::Linear | Self::Quadratic => &[],
            Self::HingeAbove | Self::HingeBelow => const { &[FormParameter::place("at")] },
            Self::Decay | Self::Growth | Self::Tanh => const { &[FormParameter::size("scale")] },
            Self::Window | Self::Deadband | Self::Staircase => const { &[FormParameter::size("width")] },
            Self::Step | Self::Bump | Self::Ramp => {
                const { &[FormParameter::place("at"), FormParameter::size("width")] }
            }
            Self::Sine => const { &[FormParameter::place("phase"), FormParameter::size("wavelength")] },
        }
    }

    /// Powers of the argument's unit in the curve.
    #[must_use]
    pub const fn powers_of_argument(self) -> i32 {
        match self {
            Self::Linear | Self::HingeAbove | Self::HingeBelow | Self::Deadband => 1,
            Self::Quadratic => 2,
            _ => 0,
        }
    }

    /// The curve at `q`.
    #[inline]
    pub(crate) fn value<R: Real>(self, [a, b]: [R; MAX_FORM_PARAMETERS], q: R) -> R {
        let step = |z: R| (z.tanh() + 1.0) * 0.5;
        let zero = R::from(0.0);
        match self {
            Self::Constant => R::from(1.0),
            Self::Linear => q,
            Self::Quadratic => q * q,
            Self::Step => step((q - a) / b),
            Self::HingeAbove => (q - a).max(zero),
            Self::HingeBelow => (a - q).max(zero),
            Self::Ramp => ((q - a) / b).clamp(0.0, 1.0),
            Self::Decay => (-q.abs() / a).exp(),
            Self::Growth => (q / a).exp_m1(),
            Self::Tanh => (q / a).tanh(),
            Self::Bump => {
                let z = (q - a) / b;
                (-(z * z)).exp()
            }
            Self::Window => step((a - q.abs()) / (a * 0.1)),
            Self::Deadband => q - q.min(a).max(-a),
            Self::Sine => ((q - a) / b * TAU).sin(),
            Self::Staircase => R::from((q / a).re().floor()),
        }
    }
}

impl Term {
    /// The curve c g(q) at `q`, in the unit of [`super::Modulator::unit_of_curve`].
    #[must_use]
    pub fn curve(&self, q: f64) -> f64 {
        let [amount, parameters @ ..] = self.values;
        amount * self.form.value(parameters, q)
    }
}
