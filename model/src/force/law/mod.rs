//! Force laws, and the dependence of their parameters on the drive.
//!
//! ```text
//! without drive   F = f(p; x, v, a) + F0
//! polynomial      F = f(p(i); x, v, a) + F0,          p_j(i) = c_j0 + c_j1 i + ... + c_jd i^d
//! fuzzy           F = sum_s w_s(i) f(p_s; x, v, a) + F0,  w_s: Gaussian sets, see [`FuzzySets`]
//! ```
//!
//! A **force law** f gives the force of an MR damper at one current. Each law has its own file, with its
//! equation and the meaning of its parameters p. A law does not depend on current. Current enters through the
//! **dependence**, one mechanism for every law: polynomials in the parameters (thesis 4.5) or fuzzy sets over
//! the outputs (thesis 4.8).
//!
//! Every law has explicit derivatives with respect to its parameters, which take less time than dual numbers
//! (node/docs/decisions/0013-explicit-derivatives.md). Tests compare them with dual numbers through the same equation.
//!
//! # One entry for each law
//! The list in `laws!` below is the only place that names all laws. A line there is a file of this directory with its type. The type
//! has the trait `MemorylessLaw`, or `Law` for a law whose force depends on earlier samples. Neither has defaults, so a law without one of
//! its properties does not compile. To add a law, add its file and its line; model files, identification, comparison and the tests of every
//! law then include it.
//!
//! Source: `[thesis]` in the bibliography (node/docs/guide/bibliography.md), equations 4.5 (polynomials) and 4.8 (sets) of the thesis.

use super::Inputs;
use super::dependence::Dependence;
use super::jet::{Jet, Real};
use super::sets::MAX_FUNCTIONS;
use crate::elementary::{atan, tanh};
use crate::error::Error;

/// Largest number of parameters of a law.
pub const MAX_PARAMETERS: usize = 14;
/// Largest number of coefficients of a model: parameters times sets, or times powers of the drive.
pub const MAX_COEFFICIENTS: usize = 160;
/// Largest number of hidden variables of a law.
pub const MAX_HIDDEN: usize = 3;

/// A force law at one current.
trait Law {
    /// The name, as in the contract.
    const NAME: &'static str;
    /// The parameters, in the order that every list of them uses.
    const PARAMETERS: &'static [Parameter];
    /// True if the force depends on earlier samples.
    const HAS_MEMORY: bool;

    /// See [`ForceLaw::force_n`].
    fn force_n<D: Real>(p: &[D], inputs: &Inputs<D>, hidden: &mut Hidden<D>) -> D;

    /// See [`ForceLaw::gradient`].
    fn gradient(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64;

    /// See [`ForceLaw::sensitivity`].
    fn sensitivity(p: &[f64], inputs: &Inputs, hidden: &mut Hidden) -> Sensitivity;
}

/// A force law whose force depends on the present sample only.
trait MemorylessLaw {
    /// The name, as in the contract.
    const NAME: &'static str;
    /// The parameters, in the order that every list of them uses.
    const PARAMETERS: &'static [Parameter];

    /// Force, N. Not finite if a needed input is not finite.
    fn force_n<D: Real>(p: &[D], inputs: &Inputs<D>) -> D;

    /// See [`ForceLaw::gradient`].
    fn gradient(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64;
}

impl<L: MemorylessLaw> Law for L {
    const NAME: &'static str = L::NAME;
    const PARAMETERS: &'static [Parameter] = L::PARAMETERS;
    const HAS_MEMORY: bool = false;

    #[inline]
    fn force_n<D: Real>(p: &[D], inputs: &Inputs<D>, _: &mut Hidden<D>) -> D {
        L::force_n(p, inputs)
    }

    #[inline]
    fn gradient(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64 {
        L::gradient(p, inputs, gradient)
    }

    #[inline]
    fn sensitivity(p: &[f64], inputs: &Inputs, _: &mut Hidden) -> Sensitivity {
        let mut found = Sensitivity::default();
        found.force_n = L::gradient(p, inputs, &mut found.force_by_parameter);
        found
    }
}

/// The gradient of a law with memory at the first sample after a start.
#[inline]
fn first_gradient<L: Law>(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64 {
    let first = Inputs { dt_s: None, ..*inputs };
    let found = L::sensitivity(p, &first, &mut Hidden::default());
    gradient[..p.len()].copy_from_slice(&found.force_by_parameter[..p.len()]);
    found.force_n
}

/// The sensitivities of a law with memory, from its `step` on `N` parameters. `DIRECTIONS` is `N` + [`MAX_HIDDEN`]: the parameters, then
/// the hidden variables.
#[inline]
fn by_jets<const N: usize, const DIRECTIONS: usize>(
    p: &[f64],
    hidden: &mut Hidden,
    step: impl FnOnce(&[Jet<DIRECTIONS>], &mut Hidden<Jet<DIRECTIONS>>) -> Jet<DIRECTIONS>,
) -> Sensitivity {
    let mut found = Sensitivity::default();
    let n = p.len();
    let mut q = [Jet::<DIRECTIONS>::from(0.0); N];
    for (j, (jet, value)) in q.iter_mut().zip(p).enumerate() {
        *jet = Jet::variable(*value, j);
    }
    let mut next: Hidden<Jet<DIRECTIONS>> = std::array::from_fn(|h| Jet::variable(hidden[h], n + h));
    let force = step(&q, &mut next);
    found.force_n = force.re;
    found.force_by_parameter[..n].copy_from_slice(&force.by[..n]);
    found.force_by_hidden.copy_from_slice(&force.by[n..]);
    for (h, jet) in next.iter().enumerate() {
        hidden[h] = jet.re;
        found.hidden_by_parameter[h][..n].copy_from_slice(&jet.by[..n]);
        found.hidden_by_hidden[h].copy_from_slice(&jet.by[n..]);
    }
    found
}

/// Declares the files of force laws and [`ForceLaw`] with all of them. A line is `file: Law;`.
///
/// Each function is a `match`, so that it is dispatched statically and can be inlined.
macro_rules! laws {
    ($($file:ident: $law:ident;)+) => {
        $(mod $file;)+

        /// A force law at one current.
        ///
        /// ```
        /// use mr_damper_model::force::{ForceLaw, Inputs};
        ///
        /// let law = ForceLaw::named("kwok").expect("a law of the library");
        /// let names: Vec<&str> = law.parameters().iter().map(|parameter| parameter.name).collect();
        /// assert_eq!(names[..3], ["viscous_damping_n_s_m", "stiffness_n_m", "hysteresis_force_n"]);
        ///
        /// // f = c v + k x + alpha tanh(beta v + delta sign(x)), at x = 0
        /// # let extending = Inputs {
        /// #     dt_s: None, displacement_m: 0.0, velocity_m_s: 0.1, acceleration_m_s2: 0.0, drive: f64::NAN, case_temp_c: f64::NAN,
        /// # };
        /// let [c, k, alpha, beta, delta] = [500.0, 1e4, 300.0, 20.0, 0.4];
        /// let force_n = law.force_n(&[c, k, alpha, beta, delta], &extending, &mut [0.0; 3]);
        /// assert!((force_n - (c * 0.1 + alpha * (beta * 0.1_f64).tanh())).abs() < 1e-6);
        /// assert!(!law.has_memory() && ForceLaw::BoucWen.has_memory());
        /// ```
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum ForceLaw {
            $(
                #[doc = concat!("See `model/src/force/law/", stringify!($file), ".rs`.")]
                $law,
            )+
        }

        impl ForceLaw {
            /// All laws.
            pub const ALL: [Self; [$(stringify!($law)),+].len()] = [$(Self::$law),+];

            /// The name, as in the contract.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$law => <$file::$law as Law>::NAME,)+
                }
            }

            /// The parameters, in the order that every list of them uses.
            #[must_use]
            pub const fn parameters(self) -> &'static [Parameter] {
                match self {
                    $(Self::$law => <$file::$law as Law>::PARAMETERS,)+
                }
            }

            /// True if the force depends on earlier samples.
            #[must_use]
            pub const fn has_memory(self) -> bool {
                match self {
                    $(Self::$law => <$file::$law as Law>::HAS_MEMORY,)+
                }
            }

            /// Force, N, with parameters `p` (as many as [`ForceLaw::parameters`]), advancing `hidden` by one sample. Not
            /// finite if a needed input is not finite; `hidden` is then unchanged.
            #[inline]
            #[must_use]
            pub fn force_n(self, p: &[f64], inputs: &Inputs, hidden: &mut Hidden) -> f64 {
                self.force_on(p, inputs, hidden)
            }

            /// [`ForceLaw::force_n`] on numbers of any type.
            #[inline]
            pub(crate) fn force_on<D: Real>(self, p: &[D], inputs: &Inputs<D>, hidden: &mut Hidden<D>) -> D {
                match self {
                    $(Self::$law => <$file::$law as Law>::force_n(p, inputs, hidden),)+
                }
            }

            /// Force, N; its derivatives with respect to the parameters are written to `gradient` (at least as long
            /// as [`ForceLaw::parameters`]). A law with memory is evaluated at the first sample after a start; for later
            /// samples use [`ForceLaw::sensitivity`].
            #[inline]
            pub fn gradient(self, p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64 {
                match self {
                    $(Self::$law => <$file::$law as Law>::gradient(p, inputs, gradient),)+
                }
            }

            /// Force, N, advancing `hidden` by one sample as [`ForceLaw::force_n`] does, with the derivatives of both.
            ///
            /// Along a run, let S be the derivatives of the hidden variables with respect to the parameters (zero
            /// before the first sample). Then `dF = force_by_parameter + force_by_hidden S`, and afterwards
            /// `S = hidden_by_parameter + hidden_by_hidden S`.
            #[inline]
            #[must_use]
            pub fn sensitivity(self, p: &[f64], inputs: &Inputs, hidden: &mut Hidden) -> Sensitivity {
                match self {
                    $(Self::$law => <$file::$law as Law>::sensitivity(p, inputs, hidden),)+
                }
            }
        }
    };
}

laws! {
    sp: Sp;
    bouc_wen: BoucWen;
    kwok: Kwok;
    li: Li;
    cesmeci_engin: CesmeciEngin;
    choi: Choi;
    arctan: Arctan;
    linear: Linear;
}

/// One parameter of a law: its name with the unit, and its bounds and start values for the identification.
///
/// Bounds and starts are given in multiples of the data's own scales, because dampers differ by orders of
/// magnitude. A yield force of 0.5 to 2 means 0.5 to 2 times the largest force in the runs.
///
/// ```
/// use mr_damper_model::force::ForceLaw;
/// use mr_damper_model::force::law::{Kind, Scale};
///
/// let damping = ForceLaw::Kwok.parameters()[0];
/// assert_eq!((damping.name, damping.kind), ("viscous_damping_n_s_m", Kind::Linear));
/// assert_eq!(damping.scale, Scale::new(1, 0, -1, 0)); // N·s/m: largest force over largest velocity
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name as in the model file, with its unit.
    pub name: &'static str,
    /// Natural scale: the unit of bounds and starts.
    pub scale: Scale,
    /// Valid range of the parameter; ends may be infinite.
    pub bounds: [f64; 2],
    /// Range of random starts; they are drawn by ratio if both ends are positive.
    pub start: [f64; 2],
    /// Kind of dependence of the force on the parameter.
    pub kind: Kind,
    /// False if polynomials do not apply to it: it is a property of the damper, not of the fluid in the
    /// field.
    pub follows_drive: bool,
}

impl Parameter {
    const fn new(name: &'static str, scale: Scale, start: [f64; 2], kind: Kind) -> Self {
        Self { name, scale, bounds: [f64::NEG_INFINITY, f64::INFINITY], start, kind, follows_drive: true }
    }

    /// A parameter in which force is linear, without bounds.
    const fn linear(name: &'static str, scale: Scale, start: [f64; 2]) -> Self {
        Self::new(name, scale, start, Kind::Linear)
    }

    /// A parameter in which force is not linear, without bounds.
    const fn nonlinear(name: &'static str, scale: Scale, start: [f64; 2]) -> Self {
        Self::new(name, scale, start, Kind::Nonlinear)
    }

    /// A gauge parameter, without bounds.
    const fn gauge(name: &'static str, scale: Scale, start: [f64; 2]) -> Self {
        Self::new(name, scale, start, Kind::Gauge)
    }

    /// The same parameter, independent of the drive.
    const fn at_any_drive(mut self) -> Self {
        self.follows_drive = false;
        self
    }

    /// The same parameter with bounds.
    const fn within(mut self, lower: f64, upper: f64) -> Self {
        self.bounds = [lower, upper];
        self
    }
}

/// Kind of dependence of the force on a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Force is linear in it: its start is computed, not drawn.
    Linear,
    /// Force is not linear in it: its start is drawn at random.
    Nonlinear,
    /// Only its change with the drive matters, because another parameter compensates its size (the two enter
    /// as a ratio). Its constant part keeps its start, the middle of the range.
    Gauge,
}

/// Natural scale of a parameter: powers of the data's largest force (N), displacement (m), velocity (m/s) and
/// acceleration (m/s²).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scale {
    /// Power of the force.
    pub force: i32,
    /// Power of the displacement.
    pub displacement: i32,
    /// Power of the velocity.
    pub velocity: i32,
    /// Power of the acceleration.
    pub acceleration: i32,
}

impl Scale {
    /// Dimensionless: bounds are used as they are.
    pub const ONE: Self = Self { force: 0, displacement: 0, velocity: 0, acceleration: 0 };

    /// A scale from powers of force, displacement, velocity and acceleration.
    #[must_use]
    pub const fn new(force: i32, displacement: i32, velocity: i32, acceleration: i32) -> Self {
        Self { force, displacement, velocity, acceleration }
    }
}

/// Hidden variables of a law with memory, from sample to sample; zeros for a law without memory.
pub type Hidden<R = f64> = [R; MAX_HIDDEN];

impl ForceLaw {
    /// The law called `name`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|law| law.name() == name)
    }
}

/// One sample of a law with its derivatives; see [`ForceLaw::sensitivity`]. Entries beyond the law's parameters
/// are zero, and so are all entries for hidden variables of a law without memory.
///
/// ```
/// # use mr_damper_model::force::Inputs;
/// use mr_damper_model::force::ForceLaw;
///
/// # let extending = Inputs {
/// #     dt_s: None, displacement_m: 0.0, velocity_m_s: 0.1, acceleration_m_s2: 0.0, drive: f64::NAN, case_temp_c: f64::NAN,
/// # };
/// // f = c v + k x + alpha tanh(...): the derivative with respect to c is v = 0.1 m/s, and with respect to k it is x = 0.
/// let found = ForceLaw::Kwok.sensitivity(&[500.0, 1e4, 300.0, 20.0, 0.4], &extending, &mut [0.0; 3]);
/// assert_eq!(found.force_by_parameter[..2], [0.1, 0.0]);
/// assert_eq!(found.force_by_hidden, [0.0; 3], "this law has no memory");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sensitivity {
    /// Force, N.
    pub force_n: f64,
    /// Derivatives of the force with respect to the parameters, with the hidden variables before the sample
    /// held constant.
    pub force_by_parameter: [f64; MAX_PARAMETERS],
    /// Derivatives of the force with respect to the hidden variables before the sample.
    pub force_by_hidden: [f64; MAX_HIDDEN],
    /// Derivatives of each hidden variable after the sample with respect to the parameters.
    pub hidden_by_parameter: [[f64; MAX_PARAMETERS]; MAX_HIDDEN],
    /// Derivatives of each hidden variable after the sample with respect to the hidden variables before it.
    pub hidden_by_hidden: [[f64; MAX_HIDDEN]; MAX_HIDDEN],
}

/// Branch of the hysteresis loop, for laws with two branches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Branch {
    /// Acceleration positive, or exactly zero.
    Rising,
    /// Acceleration negative.
    Falling,
}

impl Branch {
    /// `None` if the acceleration is not known.
    #[inline]
    fn of<D: Real>(inputs: &Inputs<D>) -> Option<Self> {
        let a = inputs.acceleration_m_s2.re();
        (!a.is_nan()).then_some(if a < 0.0 { Self::Falling } else { Self::Rising })
    }
}

/// -1, 0 or 1; NaN for NaN.
#[inline]
fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

/// A force law with its coefficients and its dependence on the drive: a complete model.
///
/// ```
/// use mr_damper_model::force::{Dependence, ForceLaw, Inputs, LawModel, LawState};
/// use mr_damper_model::sample::DriveKind;
///
/// // Kwok's law, with a step of alpha = 100 N + 400 N/A * i
/// let linear = Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 1 };
/// let coefficients = [500.0, 0.0, 100.0, 40.0, 0.0, /* per ampere: */ 0.0, 0.0, 400.0, 0.0, 0.0];
/// let model = LawModel::new(ForceLaw::Kwok, linear, &coefficients, 0.0)?;
/// # let extending = Inputs {
/// #     dt_s: None, displacement_m: 0.0, velocity_m_s: 0.1, acceleration_m_s2: 0.0, drive: 2.0, case_temp_c: f64::NAN,
/// # };
/// let force_n = model.force_n(&extending, &mut LawState::default()); // at 0.1 m/s and 2 A
/// assert!((force_n - (50.0 + 900.0 * 4.0_f64.tanh())).abs() < 1e-6);
///
/// let error = LawModel::new(ForceLaw::Kwok, linear, &coefficients[..5], 0.0).unwrap_err();
/// assert!(error.to_string().contains("has 5 values, but 10 (5 parameters times 2)"), "{error}");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawModel {
    law: ForceLaw,
    dependence: Dependence,
    force_offset_n: f64,
    /// Copy by copy: all constants, then all first powers, ...; or set by set.
    coefficients: [f64; MAX_COEFFICIENTS],
}

/// State of a [`LawModel`]: the hidden variables of each set.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LawState<R = f64> {
    hidden: [Hidden<R>; MAX_FUNCTIONS],
}

impl<R> LawState<R> {
    /// The hidden variables of a model with one set of parameters.
    #[inline]
    pub(super) const fn first(&mut self) -> &mut Hidden<R> {
        &mut self.hidden[0]
    }
}

impl LawModel {
    /// A model of `law`. `coefficients` are in order copy by copy. For a polynomial, these are all constants
    /// in the order of [`ForceLaw::parameters`], then all coefficients of i, and so on. For fuzzy sets, these are
    /// the parameters of the first set, then of the second, and so on.
    ///
    /// # Errors
    /// When the number of coefficients is not parameters times copies or exceeds [`MAX_COEFFICIENTS`], the
    /// degree is not 1 to [`super::MAX_DEGREE`], or a number is not finite.
    pub fn new(
        law: ForceLaw,
        dependence: Dependence,
        coefficients: &[f64],
        force_offset_n: f64,
    ) -> Result<Self, Error> {
        dependence.check()?;
        let parameters = law.parameters();
        let needed = parameters.len() * dependence.copies();
        if coefficients.len() != needed || needed > MAX_COEFFICIENTS {
            return Err(Error::Length {
                name: format!("coefficients of {}", law.name()),
                found: coefficients.len(),
                expected: format!(
                    "{needed} ({} parameters times {}), at most {MAX_COEFFICIENTS},",
                    parameters.len(),
                    dependence.copies()
                ),
            });
        }
        for (index, value) in coefficients.iter().enumerate() {
            let (copy, name) = (index / parameters.len(), parameters[index % parameters.len()].name);
            Error::check(&format!("{name}[{copy}]"), *value, "finite", |_| true)?;
        }
        Error::check("force_offset_n", force_offset_n, "finite", |_| true)?;
        let mut model = Self { law, dependence, force_offset_n, coefficients: [0.0; MAX_COEFFICIENTS] };
        model.coefficients[..needed].copy_from_slice(coefficients);
        Ok(model)
    }

    /// The force law.
    #[must_use]
    pub const fn law(&self) -> ForceLaw {
        self.law
    }

    /// How the parameters depend on the drive.
    #[must_use]
    pub const fn dependence(&self) -> &Dependence {
        &self.dependence
    }

    /// All coefficients, copy by copy; see [`LawModel::new`].
    #[must_use]
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients[..self.parameter_count()]
    }

    /// Number of coefficients.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        self.law.parameters().len() * self.dependence.copies()
    }

    /// True if one set of hidden variables is its whole state, as it is without fuzzy sets.
    pub(super) const fn has_one_state(&self) -> bool {
        !matches!(self.dependence, Dependence::Fuzzy(_))
    }

    /// Force offset of the session, N.
    #[must_use]
    pub const fn force_offset_n(&self) -> f64 {
        self.force_offset_n
    }

    /// The same model with another session's force offset, N.
    #[must_use]
    pub const fn with_force_offset_n(mut self, force_offset_n: f64) -> Self {
        self.force_offset_n = force_offset_n;
        self
    }

    /// Parameters at drive `i`, for a model with polynomials or a passive one.
    #[inline]
    fn parameters_at<R: Real>(&self, coefficients: &[R], i: R) -> [R; MAX_PARAMETERS] {
        let n = self.law.parameters().len();
        let mut p = [R::from(0.0); MAX_PARAMETERS];
        // Horner's rule, from the highest power down.
        for copy in coefficients.chunks_exact(n).rev() {
            for (value, coefficient) in p.iter_mut().zip(copy) {
                *value = *value * i + *coefficient;
            }
        }
        p
    }

    /// Force, N, at `inputs`, advancing `state` by one sample. Not finite if a needed input is not finite.
    #[inline]
    #[must_use]
    pub fn force_n(&self, inputs: &Inputs, state: &mut LawState) -> f64 {
        self.force_on(self.coefficients(), inputs, state)
    }

    /// [`LawModel::force_n`] with `coefficients` in place of its own, on numbers of any type.
    #[inline]
    pub(crate) fn force_on<R: Real>(
        &self,
        coefficients: &[R],
        inputs: &Inputs<R>,
        state: &mut LawState<R>,
    ) -> R {
        let n = self.law.parameters().len();
        let force = match &self.dependence {
            Dependence::None => self.law.force_on(&coefficients[..n], inputs, &mut state.hidden[0]),
            Dependence::Polynomial { .. } => {
                let p = self.parameters_at(coefficients, inputs.drive);
                self.law.force_on(&p[..n], inputs, &mut state.hidden[0])
            }
            Dependence::Fuzzy(sets) if self.law.has_memory() => {
                let weights = sets.strengths(inputs.drive).shares();
                let functions = coefficients.chunks_exact(n).zip(&mut state.hidden);
                // A set with zero weight does not contribute, even if its force is not finite; but its hidden
                // variables advance.
                functions.zip(weights).fold(R::from(0.0), |sum, ((p, hidden), weight)| {
                    let own_n = self.law.force_on(p, inputs, hidden);
                    if weight.is_zero() { sum } else { sum + weight * own_n }
                })
            }
            Dependence::Fuzzy(sets) => sets.strengths(inputs.drive).mean(|set| {
                let p = &coefficients[set * n..][..n];
                self.law.force_on(p, inputs, &mut [R::from(0.0); MAX_HIDDEN])
            }),
        };
        force + self.force_offset_n
    }
}

#[cfg(test)]
mod tests;
