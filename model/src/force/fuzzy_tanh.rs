//! Current-fuzzy tanh model (thesis 4.8-4.10, "non-linear fuzzy").
//!
//! ```text
//! F     = sum_j w_j(i) f_j / sum_j w_j(i) + F0
//! f_j   = A1_j tanh(A3_j u_j) + A2_j u_j,      u_j = v + kappa_j x
//! w_j   = exp(-(i - c_j)^2 / (2 sigma_j^2))
//! ```
//!
//! | symbol | field | unit | meaning |
//! |---|---|---|---|
//! | x, v | arguments | m, m/s | displacement from the rest position, velocity; positive in extension |
//! | i | argument | A or V | drive: coil current, or command voltage |
//! | A1 | `yield_force_n` | N | height of the tanh step |
//! | A2 | `post_yield_damping_n_s_m` | N·s/m | slope beyond the yield |
//! | A3 | `pre_yield_slope_s_m` | s/m | steepness of the step |
//! | kappa | `coupling_per_s` | 1/s | weight of displacement relative to velocity: the width of the loop |
//! | c, sigma | `FuzzySets` | A or V | centre and width of the Gaussian sets |
//! | F0 | `force_offset_n` | N | mean force of the session (gas preload, load cell zero) |
//!
//! The thesis prints the coupling as two columns, X0 and V0. Only their ratio matters, and its formula is V0/X0. The printed
//! numbers need the inverse (X0 column over V0 column): only then does the model agree with the ANFIS that was identified on
//! the same data. The ratio is negative: the recorded force leads the recorded velocity, as it does if displacement is
//! low-passed and force is not. Sigma is printed as "variance 0.2"; it is taken as a standard deviation of 0.2 A and is a
//! setting here.
//!
//! Source: `[thesis]` and `[thesis-paper2]` in the bibliography (node/docs/guide/bibliography.md), equations 4.8 to 4.10 of the thesis.

use super::Way;
use super::jet::Real;
use super::sets::{FuzzySets, MAX_FUNCTIONS, Strengths};
use crate::elementary::tanh;
use crate::error::Error;
use crate::sample::DriveKind;

/// One tanh function: the damper at one drive level.
///
/// ```
/// use mr_damper_model::force::TanhFunction;
///
/// // A yield force of 100 N, 500 N s/m beyond it, and kappa = -4 1/s: u = 1 m/s - 4 1/s * 0.01 m = 0.96 m/s
/// let function = TanhFunction::new([100.0, 500.0, 40.0, -4.0]);
/// assert!((function.force_n(0.01, 1.0) - (100.0 + 500.0 * 0.96)).abs() < 1e-9);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TanhFunction {
    /// A1, the height of the tanh step, N.
    pub yield_force_n: f64,
    /// A2, the damping beyond the yield, N·s/m. It may be negative if the tail of the step compensates it.
    pub post_yield_damping_n_s_m: f64,
    /// A3, the steepness of the step, s/m.
    pub pre_yield_slope_s_m: f64,
    /// Kappa, the weight of displacement relative to velocity, 1/s.
    pub coupling_per_s: f64,
}

impl TanhFunction {
    /// The function with A1, N; A2, N·s/m; A3, s/m; and kappa, 1/s, in the order of the thesis' tables.
    #[must_use]
    pub const fn new([a1, a2, a3, kappa]: [f64; 4]) -> Self {
        Self {
            yield_force_n: a1,
            post_yield_damping_n_s_m: a2,
            pre_yield_slope_s_m: a3,
            coupling_per_s: kappa,
        }
    }

    /// Force of this function alone, in newtons, at displacement `x_m` and velocity `v_m_s`.
    #[inline]
    #[must_use]
    pub fn force_n(&self, x_m: f64, v_m_s: f64) -> f64 {
        Self::force_on(&self.numbers(), x_m, v_m_s)
    }

    /// A1, A2, A3 and kappa, as in [`TanhFunction::new`].
    #[inline]
    pub(crate) const fn numbers(&self) -> [f64; 4] {
        [self.yield_force_n, self.post_yield_damping_n_s_m, self.pre_yield_slope_s_m, self.coupling_per_s]
    }

    /// [`TanhFunction::force_n`] of the function with these numbers, of any type.
    #[inline(always)]
    fn force_on<R: Real>(&[a1, a2, a3, kappa]: &[R; 4], x_m: R, v_m_s: R) -> R {
        let u = v_m_s + kappa * x_m;
        a1 * (a3 * u).tanh() + a2 * u
    }

    /// The same force, and its derivative along `way`.
    #[inline]
    fn force_and_slope(&self, x_m: f64, v_m_s: f64, way: &Way) -> [f64; 2] {
        let u = v_m_s + self.coupling_per_s * x_m;
        let step = tanh(self.pre_yield_slope_s_m * u);
        let by_u = self.yield_force_n * self.pre_yield_slope_s_m * (1.0 - step * step)
            + self.post_yield_damping_n_s_m;
        [
            self.yield_force_n * step + self.post_yield_damping_n_s_m * u,
            by_u * (way.velocity_m_s + self.coupling_per_s * way.displacement_m),
        ]
    }
}

/// The current-fuzzy tanh model. It has no state: the force depends on this sample's inputs alone.
///
/// ```
/// use mr_damper_model::force::{FuzzySets, FuzzyTanh, Membership, TanhFunction};
/// use mr_damper_model::sample::DriveKind;
///
/// let sets = FuzzySets::new(Membership { drive: DriveKind::CoilCurrent, sigma: 0.5 }, &[0.0, 2.0])?;
/// let soft = TanhFunction::new([100.0, 500.0, 40.0, 0.0]); // at 0 A
/// let hard = TanhFunction::new([900.0, 500.0, 40.0, 0.0]); // at 2 A
/// let model = FuzzyTanh::new(sets, &[soft, hard], 20.0)?;
/// // At 1 A both functions have the weight 1/2. The force offset of the session is added.
/// let mean_n = 0.5 * (soft.force_n(0.0, 0.1) + hard.force_n(0.0, 0.1));
/// assert!((model.force_n(0.0, 0.1, 1.0) - (mean_n + 20.0)).abs() < 1e-9);
/// assert!(FuzzyTanh::new(sets, &[soft], 0.0).is_err(), "each set needs a function");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FuzzyTanh {
    sets: FuzzySets,
    force_offset_n: f64,
    functions: [TanhFunction; MAX_FUNCTIONS],
}

impl FuzzyTanh {
    /// A model with one tanh function per set of `sets`.
    ///
    /// # Errors
    /// When there are more or fewer functions than sets, or a number is not finite.
    pub fn new(sets: FuzzySets, functions: &[TanhFunction], force_offset_n: f64) -> Result<Self, Error> {
        if functions.len() != sets.len() {
            return Err(Error::Length {
                name: "yield_force_n".to_owned(),
                found: functions.len(),
                expected: format!("{} (one tanh function for each centre)", sets.len()),
            });
        }
        Error::check("force_offset_n", force_offset_n, "finite", |_| true)?;
        for (j, f) in functions.iter().enumerate() {
            for (name, value) in [
                ("yield_force_n", f.yield_force_n),
                ("post_yield_damping_n_s_m", f.post_yield_damping_n_s_m),
                ("pre_yield_slope_s_m", f.pre_yield_slope_s_m),
                ("coupling_per_s", f.coupling_per_s),
            ] {
                Error::check(&format!("{name}[{j}]"), value, "finite", |_| true)?;
            }
        }
        let mut model = Self { sets, force_offset_n, functions: [TanhFunction::default(); MAX_FUNCTIONS] };
        model.functions[..functions.len()].copy_from_slice(functions);
        Ok(model)
    }

    /// The drive that the model needs.
    #[must_use]
    pub const fn drive(&self) -> DriveKind {
        self.sets.drive()
    }

    /// The memberships.
    #[must_use]
    pub const fn sets(&self) -> &FuzzySets {
        &self.sets
    }

    /// The tanh functions, one per centre.
    #[must_use]
    pub fn functions(&self) -> &[TanhFunction] {
        &self.functions[..self.sets.len()]
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

    /// Four per function: yield force, damping, slope, coupling.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        4 * self.sets.len()
    }

    /// Force, N, at displacement `x_m`, velocity `v_m_s` and drive `i` (in the unit of [`FuzzyTanh::drive`]). Not finite if
    /// an argument is not finite.
    #[inline]
    #[must_use]
    pub fn force_n(&self, x_m: f64, v_m_s: f64, i: f64) -> f64 {
        let functions = self.functions();
        self.sets.strengths(i).mean(|set| functions[set].force_n(x_m, v_m_s)) + self.force_offset_n
    }

    /// [`FuzzyTanh::force_n`] with the functions of `numbers` in place of its own, of any type.
    #[inline(always)]
    pub(crate) fn force_on<R: Real>(&self, numbers: &[[R; 4]], x_m: R, v_m_s: R, i: R) -> R {
        let force_n = self.sets.strengths(i).mean(|set| TanhFunction::force_on(&numbers[set], x_m, v_m_s));
        force_n + self.force_offset_n
    }

    /// The model at a constant drive, for several motions: the memberships are computed once.
    #[inline]
    pub(super) fn along(&self, drive: f64) -> FuzzyTanhAlong<'_> {
        FuzzyTanhAlong { model: self, strengths: self.sets.strengths(drive) }
    }

    /// The model at one motion, for several drives: the tanh functions are computed once. Its forces are bit-identical to
    /// those from [`Self::force_n`].
    #[inline]
    #[must_use]
    pub fn at(&self, x_m: f64, v_m_s: f64) -> FuzzyTanhAt<'_> {
        let mut forces_n = [0.0; MAX_FUNCTIONS];
        for (force_n, function) in forces_n.iter_mut().zip(self.functions()) {
            *force_n = function.force_n(x_m, v_m_s);
        }
        FuzzyTanhAt { model: self, forces_n }
    }
}

/// A [`FuzzyTanh`] at one motion; see [`FuzzyTanh::at`].
#[derive(Debug, Clone, Copy)]
pub struct FuzzyTanhAt<'a> {
    model: &'a FuzzyTanh,
    /// Force of the function of each centre, N.
    forces_n: [f64; MAX_FUNCTIONS],
}

impl FuzzyTanhAt<'_> {
    /// Force, N, at drive `i`. Not finite if an argument is not finite.
    #[inline]
    #[must_use]
    pub fn force_n(&self, i: f64) -> f64 {
        self.model.sets.strengths(i).mean(|set| self.forces_n[set]) + self.model.force_offset_n
    }
}

/// A [`FuzzyTanh`] at one drive; see [`FuzzyTanh::along`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct FuzzyTanhAlong<'a> {
    model: &'a FuzzyTanh,
    strengths: Strengths,
}

impl FuzzyTanhAlong<'_> {
    /// The force as [`FuzzyTanh::force_n`] gives it, to 1e-15, and its derivative along `way`, N.
    #[inline]
    pub(crate) fn force_and_slope(&self, x_m: f64, v_m_s: f64, way: &Way) -> [f64; 2] {
        let functions = self.model.functions();
        let [force_n, slope_n] =
            self.strengths.mean_and_slope(|set| functions[set].force_and_slope(x_m, v_m_s, way));
        [force_n + self.model.force_offset_n, slope_n]
    }
}
