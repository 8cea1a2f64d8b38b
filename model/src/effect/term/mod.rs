//! Terms: effects that a diagnosis discovered, and that no entry of the library describes.
//!
//! ```text
//! F' = F + sum over terms of c m g(q)                 m: modulator,  q: argument,  g: form,  c: amount
//! F  = model with its effects of the damper, at (x, v + c g(q), i + c g(q)) for terms that act on velocity or drive
//! ```
//!
//! | part | examples | file |
//! |---|---|---|
//! | modulator m | 1, force, sign of velocity, drive | `modulator.rs` |
//! | argument q | displacement, time, path, dissipated energy, travel since the last reversal | `argument.rs` |
//! | form g | linear, step, hinge, exponential, sine, bump, resonance | `form.rs` |
//!
//! A force that falls by 12.6 % at 11.5 s is the term (force, time, step) with c = -0.126. The damper's force F leaves out the session's offset
//! where it is a modulator or argument. Terms act around all effects of the damper, and inside of the effects of the load cell; all terms
//! see the same F. They restart at a gap, as effects do.
//!
//! ```toml
//! [[effects]]
//! id = "term"
//! modulator = "force"
//! argument = "time"
//! form = "step"
//! confirmed_in = [0.0, 30.0]      # range of the argument in the data
//! equation = "F' = F (1 - 0.126 H(t - 11.5 s)),  t: time since the start"     # for people, not read
//!
//! [effects.parameters]            # the amount c, and the parameters of the form
//! amount = -0.126
//! at = 11.5
//! width = 0.05
//!
//! [effects.units]                 # checked if they are there
//! amount = ""
//! at = "s"
//! width = "s"
//! ```

mod argument;
mod form;
mod modulator;
mod resonator;
mod text;

pub use argument::Argument;
pub use form::{Form, FormParameter};
pub use modulator::Modulator;
pub use text::TermNumber;

pub(crate) use argument::{Origin, Past, Signals};
pub(crate) use resonator::{Resonator, warped};

use super::Need;
use super::run::Inside;
use crate::error::{Error, ForceError};
use crate::force::jet::Real;
use crate::force::{Inputs, Number};

/// Id of a term in model files and reports.
pub const ID: &str = "term";
/// Largest number of terms around one model.
pub const MAX_TERMS: usize = 3;
/// Largest number of parameters of a form.
pub const MAX_FORM_PARAMETERS: usize = 2;
/// Width of a step below which it is a jump, as a share of the argument's range in the data.
pub(crate) const SHARP: f64 = 0.02;
/// Numbers of a term: its amount, and the parameters of its form.
pub(crate) const MAX_TERM_VALUES: usize = 1 + MAX_FORM_PARAMETERS;

/// A term with its numbers, ready to run. `R` is `f64`, except inside of this crate, where it may carry derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term<R = f64> {
    modulator: Modulator,
    argument: Argument,
    form: Form,
    /// The amount, then the parameters of the form; zeros beyond.
    values: [R; MAX_TERM_VALUES],
    confirmed_in: [f64; 2],
}

impl Term {
    /// A term. `amount` is in N per unit of the modulator and of the form, `parameters` in the units of [`FormParameter::unit`], and `confirmed_in` is
    /// the range of the argument in the data that the term was found on.
    ///
    /// # Errors
    /// [`Error::Length`] if the form has another number of parameters. [`ForceError::Term`] if a number is not finite, or if a parameter is out of
    /// its range. A term that acts on an input must not have the force as its argument, because the force is not known yet.
    pub fn new(
        (modulator, argument, form): (Modulator, Argument, Form),
        amount: f64,
        parameters: &[f64],
        confirmed_in: [f64; 2],
    ) -> Result<Self, Error> {
        if parameters.len() != form.parameters().len() {
            return Err(Error::Length {
                name: format!("parameters of the form {}", form.name()),
                found: parameters.len(),
                expected: form.parameters().len().to_string(),
            });
        }
        let refuse = |why| -> Error { ForceError::Term { why }.into() };
        if modulator.acts_on_input() && argument == Argument::Force {
            return Err(refuse("a term that acts on drive or velocity cannot depend on the force"));
        }
        let [low, high] = confirmed_in;
        if !(amount.is_finite() && low.is_finite() && high.is_finite() && low <= high) {
            return Err(refuse("amount and confirmed_in must be finite, and the range in order"));
        }
        let positive = |(parameter, value): (&form::FormParameter, &f64)| {
            value.is_finite() && (!parameter.is_positive() || *value > 0.0)
        };
        if !form.parameters().iter().zip(parameters).all(positive) {
            return Err(refuse("parameters must be finite, and widths and scales above zero"));
        }
        let mut values = [0.0; MAX_TERM_VALUES];
        values[0] = amount;
        values[1..=parameters.len()].copy_from_slice(parameters);
        Ok(Self { modulator, argument, form, values, confirmed_in })
    }

    /// The id of the library's effect that has this form; `None` if no entry has it. A term of this form is found where the library did not
    /// name the effect.
    ///
    /// ```
    /// use mr_damper_model::effect::term::{Argument, Form, Modulator, Term};
    ///
    /// let mass = Term::new((Modulator::Acceleration, Argument::Time, Form::Constant), 9.7, &[], [0.0, 30.0])?;
    /// assert_eq!(mass.in_library(), Some("inertia"));
    /// # Ok::<(), mr_damper_model::Error>(())
    /// ```
    #[must_use]
    pub const fn in_library(&self) -> Option<&'static str> {
        match (self.modulator, self.argument, self.form) {
            (Modulator::Acceleration, _, Form::Constant) => Some("inertia"),
            (Modulator::SignVelocity, _, Form::Constant) => Some("friction"),
            (Modulator::Displacement, _, Form::Constant)
            | (Modulator::One, Argument::Displacement, Form::Linear) => Some("gas_spring"),
            (Modulator::One, Argument::Time, Form::Linear) => Some("load_cell_drift"),
            (Modulator::Force, Argument::Displacement, Form::Linear) => Some("position_dependence"),
            _ => None,
        }
    }

    /// The amount, in N per unit of the modulator and of the form.
    #[must_use]
    pub const fn amount(&self) -> f64 {
        self.values[0]
    }

    /// The parameters of the form, in the units of [`FormParameter::unit`].
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        &self.values[1..=self.form.parameters().len()]
    }

    /// Amount and parameters.
    pub(crate) fn values(&self) -> &[f64] {
        &self.values[..=self.form.parameters().len()]
    }

    /// The same term with other numbers; `None` if they are not valid.
    pub(crate) fn with_values(&self, values: &[f64]) -> Option<Self> {
        let (amount, parameters) = values.split_first()?;
        Self::new(self.kind(), *amount, parameters, self.confirmed_in).ok()
    }

    /// The same term with each number as `jet` makes it.
    pub(crate) fn map<R: Real>(&self, mut jet: impl FnMut(f64) -> R) -> Term<R> {
        let mut values = [R::from(0.0); MAX_TERM_VALUES];
        values.iter_mut().zip(self.values()).for_each(|(value, own)| *value = jet(*own));
        let Self { modulator, argument, form, confirmed_in, .. } = *self;
        Term { modulator, argument, form, values, confirmed_in }
    }
}

impl<R> Term<R> {
    /// Modulator, argument and form.
    #[must_use]
    pub const fn kind(&self) -> (Modulator, Argument, Form) {
        (self.modulator, self.argument, self.form)
    }

    /// Range of the argument in the data that the term was found on. Beyond it the term extrapolates.
    #[must_use]
    pub const fn confirmed_in(&self) -> [f64; 2] {
        self.confirmed_in
    }

    /// True if it needs the channel `need`.
    #[must_use]
    pub fn need(&self, need: Need) -> bool {
        self.modulator.needs() == Some(need) || self.argument.needs() == Some(need)
    }
}

/// Up to [`MAX_TERMS`] terms.
///
/// ```
/// use mr_damper_model::effect::term::{Argument, Form, Modulator, Term, Terms};
/// use mr_damper_model::effect::{Augmented, AugmentedState, Effects};
/// use mr_damper_model::force::Inputs;
/// use mr_damper_model::preset;
///
/// // The force is a tenth less where the rod is further out than 5 mm.
/// let kind = (Modulator::Force, Argument::Displacement, Form::Step);
/// let term = Term::new(kind, -0.1, &[5e-3, 1e-4], [-0.02, 0.02])?;
/// assert_eq!(term.equation("A"), "F' = F (1 - 0.1 H(x - 0.005 m)),  x: displacement");
/// let effects = Effects::NONE.with_terms(Terms::new(&[term])?);
/// let model = Augmented::new(preset::load(preset::BEST_FUZZY_TANH)?.force, effects)?;
/// let out = Inputs {
///     dt_s: None, displacement_m: 0.01, velocity_m_s: 0.2, acceleration_m_s2: 0.0, drive: 1.2, case_temp_c: f64::NAN,
/// };
/// let force_n = |model: &Augmented| model.free_run(&mut AugmentedState::default(), &out).expect("it is finite");
/// let offset_n = model.force().force_offset_n();
/// let plain_n = force_n(&Augmented::from(*model.force()));
/// assert!((force_n(&model) - offset_n - 0.9 * (plain_n - offset_n)).abs() < 1e-9);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terms<R = f64> {
    list: [Option<Term<R>>; MAX_TERMS],
}

impl<R: Copy> Terms<R> {
    /// No terms.
    pub const NONE: Self = Self { list: [None; MAX_TERMS] };

    /// The terms, in order.
    pub fn iter(&self) -> impl Iterator<Item = &Term<R>> {
        self.list.iter().flatten()
    }

    /// True if there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.list[0].is_none()
    }
}

impl Terms {
    /// These terms.
    ///
    /// # Errors
    /// [`Error::Length`] if there are more than [`MAX_TERMS`].
    pub fn new(terms: &[Term]) -> Result<Self, Error> {
        if terms.len() > MAX_TERMS {
            return Err(Error::Length {
                name: "terms".to_owned(),
                found: terms.len(),
                expected: format!("at most {MAX_TERMS}"),
            });
        }
        let mut all = Self::NONE;
        all.list.iter_mut().zip(terms).for_each(|(place, term)| *place = Some(*term));
        Ok(all)
    }

    /// The terms with each number as `jet` makes it.
    pub(crate) fn map<R: Real>(&self, mut jet: impl FnMut(f64) -> R) -> Terms<R> {
        Terms { list: self.list.map(|term| term.map(|term| term.map(&mut jet))) }
    }

    /// True if the terms are the same, with any numbers; a state of `other` is then valid here.
    pub(crate) fn same_kinds(&self, other: &Self) -> bool {
        self.iter().map(Term::kind).eq(other.iter().map(Term::kind))
    }
}

/// State of terms: the signals that arguments come from, and the filter of each term.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct TermsState<R = f64> {
    signals: Signals<R>,
    /// Used by resonances only.
    filters: [Resonator<R>; MAX_TERMS],
    /// The last sample had an argument outside of its confirmed range.
    extrapolates: bool,
}

impl<R: Real + Default> TermsState<R> {
    /// Before the first sample of a simulation that begins within a run.
    pub(crate) fn after(past: &Past) -> Self {
        Self { signals: Signals::after(past), ..Self::default() }
    }
}

impl<R> TermsState<R> {
    pub(super) const fn extrapolates(&self) -> bool {
        self.extrapolates
    }
}

/// One sample: the force of the model inside, with the terms.
#[inline]
pub(super) fn step<R: Number>(
    terms: &Terms<R>,
    state: &mut TermsState<R>,
    inputs: &Inputs<R>,
    inside: &mut Inside<R>,
) -> Option<R> {
    let TermsState { signals, filters, extrapolates } = state;
    signals.before_force(inputs);
    *extrapolates = false;
    let mut changed = *inputs;
    for (term, filter) in terms.iter().zip(&mut *filters).filter(|(term, _)| term.modulator.acts_on_input()) {
        let by = change(term, filter, signals, inputs, extrapolates);
        match term.modulator {
            Modulator::ForcePerVelocity => changed.velocity_m_s = changed.velocity_m_s + by,
            _ => changed.drive = changed.drive + by,
        }
    }
    let force_n = inside.run(&changed)?;
    Some(add(terms, state, inputs, force_n, inside.offset_n()))
}

/// One sample of terms around a damper whose force is known: `force_n`, which has the terms that act on an input already, plus the others.
#[inline]
pub(crate) fn around<R: Real>(
    terms: &Terms<R>,
    state: &mut TermsState<R>,
    inputs: &Inputs<R>,
    force_n: f64,
    offset_n: f64,
) -> R {
    state.signals.before_force(inputs);
    add(terms, state, inputs, R::from(force_n), offset_n)
}

/// `force_n` with the terms that do not act on an input; a force that is not finite stays as it is. The inputs of the sample are in the
/// signals already.
#[inline]
fn add<R: Real>(
    terms: &Terms<R>,
    state: &mut TermsState<R>,
    inputs: &Inputs<R>,
    force_n: R,
    offset_n: f64,
) -> R {
    if !force_n.re().is_finite() {
        return force_n;
    }
    let TermsState { signals, filters, extrapolates } = state;
    signals.after_force(inputs, force_n - offset_n);
    let mut sum_n = force_n;
    for (term, filter) in terms.iter().zip(filters).filter(|(term, _)| !term.modulator.acts_on_input()) {
        let by = change(term, filter, signals, inputs, extrapolates);
        sum_n = sum_n + by * term.modulator.value(signals, inputs);
    }
    sum_n
}

/// c g(q).
#[inline]
fn change<R: Real>(
    term: &Term<R>,
    filter: &mut Resonator<R>,
    signals: &Signals<R>,
    inputs: &Inputs<R>,
    extrapolates: &mut bool,
) -> R {
    let argument = term.argument.value(signals, inputs);
    let [low, high] = term.confirmed_in;
    *extrapolates |= argument.re() < low || argument.re() > high;
    let [amount, parameters @ ..] = term.values;
    amount
        * match term.form {
            Form::Resonance => {
                let [frequency_hz, damping] = parameters;
                filter.step(resonator::warped(frequency_hz, signals.step_s()), damping, argument)
            }
            form => form.value(parameters, argument),
        }
}
