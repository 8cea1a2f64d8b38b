//! Forms: the curve g(q) of a term. a and b are its parameters, in the unit of the argument q if the table does not say another one.
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
//! | `resonance` | y, with y'' = w² (q - y) - 2 b w y', w = 2 pi a; a in Hz, b without unit | of q |
//!
//! A resonance is the only form with a memory: [`super::resonator`].

use super::{Argument, MAX_FORM_PARAMETERS, Term};
use crate::effect::Unit;
use crate::elementary::hypot;
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
    /// q behind a mass on a spring.
    Resonance,
}

/// A parameter of a form.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FormParameter {
    /// Name.
    pub name: &'static str,
    kind: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// A place in the range of the argument.
    Place,
    /// A width or a scale of the argument, above zero.
    Size,
    /// Anything else, above zero, with the range in which it is searched for.
    Own(Unit, [f64; 2]),
}

impl FormParameter {
    const fn new(name: &'static str, kind: Kind) -> Self {
        Self { name, kind }
    }

    /// Its unit, if `argument` is the argument of the term.
    #[must_use]
    pub const fn unit(&self, argument: Argument) -> Unit {
        match self.kind {
            Kind::Place | Kind::Size => argument.unit(),
            Kind::Own(unit, _) => unit,
        }
    }

    /// True if it must be above zero.
    #[must_use]
    pub const fn is_positive(&self) -> bool {
        !matches!(self.kind, Kind::Place)
    }

    /// The range in which it is searched for, if the argument has the range `low` to `high` in the data: places within it, widths and scales
    /// within a thousandth and ten times of it.
    pub(crate) fn bounds(&self, [low, high]: [f64; 2]) -> [f64; 2] {
        let range = (high - low).max(f64::MIN_POSITIVE);
        match self.kind {
            Kind::Place => [low, high],
            Kind::Size => [1e-3 * range, 10.0 * range],
            Kind::Own(_, bounds) => bounds,
        }
    }
}

impl Form {
    /// All forms, from simple to complex.
    pub const ALL: [Self; 16] = [
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
        Self::Resonance,
    ];

    /// True if its curve may change and change back between two places at which it is known.
    pub(crate) const fn repeats_or_returns(self) -> bool {
        matches!(self, Self::Bump | Self::Staircase | Self::Sine)
    }

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
            Self::Resonance => "resonance",
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
        const AT: FormParameter = FormParameter::new("at", Kind::Place);
        const WIDTH: FormParameter = FormParameter::new("width", Kind::Size);
        match self {
            Self::Constant | Self::Linear | Self::Quadratic => &[],
            Self::HingeAbove | Self::HingeBelow => const { &[AT] },
            Self::Decay | Self::Growth | Self::Tanh => const { &[FormParameter::new("scale", Kind::Size)] },
            Self::Window | Self::Deadband | Self::Staircase => const { &[WIDTH] },
            Self::Step | Self::Bump | Self::Ramp => const { &[AT, WIDTH] },
            Self::Sine => {
                const { &[FormParameter::new("phase", Kind::Place), FormParameter::new("wavelength", Kind::Size)] }
            }
            Self::Resonance => {
                const {
                    &[
                        FormParameter::new("frequency", Kind::Own(Unit::HERTZ, [0.5, 60.0])),
                        FormParameter::new("damping", Kind::Own(Unit::NONE, [3e-3, 0.3])),
                    ]
                }
            }
        }
    }

    /// Powers of the argument's unit in the curve.
    #[must_use]
    pub const fn powers_of_argument(self) -> i32 {
        match self {
            Self::Linear | Self::HingeAbove | Self::HingeBelow | Self::Deadband | Self::Resonance => 1,
            Self::Quadratic => 2,
            _ => 0,
        }
    }

    /// The curve at `q`; of a resonance, what it is after a long time at `q`.
    #[inline]
    pub(crate) fn value<R: Real>(self, [a, b]: [R; MAX_FORM_PARAMETERS], q: R) -> R {
        let step = |z: R| (z.tanh() + 1.0) * 0.5;
        let zero = R::from(0.0);
        match self {
            Self::Constant => R::from(1.0),
            Self::Linear | Self::Resonance => q,
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
    /// The curve c g(q) at `q`, in the unit of [`super::Modulator::unit_of_curve`]; of a resonance, what it is after a long time at `q`.
    #[must_use]
    pub fn curve(&self, q: f64) -> f64 {
        let [amount, parameters @ ..] = self.values;
        amount * self.form.value(parameters, q)
    }

    /// Gain of the curve for a sine of the argument at `hz`, without the sign of the amount, if it is a resonance.
    ///
    /// ```
    /// use mr_damper_model::effect::term::{Argument, Form, Modulator, Term};
    ///
    /// let mount = Term::new((Modulator::One, Argument::Force, Form::Resonance), 0.3, &[30.0, 0.05], [-900.0, 900.0])?;
    /// assert_eq!(mount.gain(30.0), Some(0.3 / (2.0 * 0.05)));
    /// # Ok::<(), mr_damper_model::Error>(())
    /// ```
    #[must_use]
    pub fn gain(&self, hz: f64) -> Option<f64> {
        let (&[frequency_hz, damping], Form::Resonance) = (self.parameters(), self.kind().2) else {
            return None;
        };
        let ratio = hz / frequency_hz;
        Some((self.amount() / hypot(1.0 - ratio * ratio, 2.0 * damping * ratio)).abs())
    }
}
