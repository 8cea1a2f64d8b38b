//! Takagi-Sugeno-Kang (TSK) fuzzy model on a full grid of rules: ANFIS and related models (thesis 2.9-2.11, 4.5).
//!
//! ```text
//! rule r = (j, k, l):  if u_1 is in set j, u_2 in set k, u_3 in set l, then
//! f_r    = p_r u_1 + q_r u_2 + r_r u_3 + s_r         (first order)     or     f_r = s_r     (constant)
//! F      = mean + std_dev sum_r W_r f_r / sum_r W_r + F0,      W_r = g_1j(u_1) g_2k(u_2) g_3l(u_3)
//! ```
//!
//! | symbol | field | unit | meaning |
//! |---|---|---|---|
//! | u | `TskInput` | - | normalised input: displacement, velocity, acceleration or drive |
//! | g | [`TskSet`] | - | memberships of an input; [`TskInput::weights`] defines the weights outside them |
//! | p, q, r, s | conclusions | - | of each rule; the first input's set varies slowest, the last input's set fastest |
//! | mean, std_dev | `OutputScale` | N | undo the normalisation of the force |
//! | F0 | `force_offset_n` | N | mean force of the session (gas preload, load cell zero) |
//!
//! On a full grid the sum of all W is the product of the sums of the inputs. Each input is therefore weighted by its own
//! normalised strengths: their product equals the quotient exactly and cannot be 0/0.
//!
//! Sources: Takagi and Sugeno 1985; Jang 1993 (ANFIS).
//! See `[takagi1985]` and `[jang1993]` in the bibliography (node/docs/guide/bibliography.md), equations 2.9 to 2.11 of the thesis.

mod kind;
mod set;
mod sets;
#[cfg(test)]
mod tests;

pub use kind::TskKind;
pub use set::{Shape, TskSet};
pub use sets::{MAX_SETS, TskInput};

pub(crate) use set::NUMBERS;
pub(crate) use sets::Firing;

use super::Inputs;
use crate::error::{Error, ForceError};
use crate::sample::DriveKind;

/// Largest number of inputs.
pub const MAX_INPUTS: usize = 3;
/// Largest number of values in the conclusions of all rules: 5x5x5 constants, or 27 rules of four.
pub const MAX_CONCLUSIONS: usize = 125;

/// Signal of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// Displacement, m.
    Displacement,
    /// Velocity, m/s.
    Velocity,
    /// Acceleration, m/s².
    Acceleration,
    /// Drive, A or V.
    Drive(DriveKind),
    /// Force, N: for an inverse model that computes the current, see [`crate::inverse`]. A model's [`Inputs`] do not
    /// contain it.
    Force,
}

impl Signal {
    /// Name in fields and messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Displacement => "displacement",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
            Self::Drive(_) => "drive",
            Self::Force => "force",
        }
    }

    /// Suffix of the unit in field names.
    #[must_use]
    pub const fn unit_suffix(self) -> &'static str {
        match self {
            Self::Displacement => "m",
            Self::Velocity => "m_s",
            Self::Acceleration => "m_s2",
            Self::Drive(DriveKind::CoilCurrent) => "a",
            Self::Drive(DriveKind::CommandVoltage) => "v",
            Self::Force => "n",
        }
    }

    /// Value at a sample; NaN for a force.
    #[inline]
    #[must_use]
    pub const fn of(self, inputs: &Inputs) -> f64 {
        match self {
            Self::Displacement => inputs.displacement_m,
            Self::Velocity => inputs.velocity_m_s,
            Self::Acceleration => inputs.acceleration_m_s2,
            Self::Drive(_) => inputs.drive,
            Self::Force => f64::NAN,
        }
    }
}

/// Form of a rule's conclusion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// One constant per rule.
    Constant,
    /// A slope per input, and a constant.
    First,
}

impl Order {
    /// Number of values in a rule's conclusion with `inputs` inputs.
    #[must_use]
    pub const fn width(self, inputs: usize) -> usize {
        match self {
            Self::Constant => 1,
            Self::First => inputs + 1,
        }
    }
}

/// Scale that undoes the normalisation of the force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutputScale {
    /// Mean, added last, N.
    pub mean_n: f64,
    /// Standard deviation, factor of the normalised output, N.
    pub std_dev_n: f64,
}

/// A TSK model. It has no state: the force depends on this sample's inputs alone.
///
/// ```
/// use mr_damper_model::force::{Inputs, Order, OutputScale, Signal, Tsk, TskInput, TskKind, TskSet};
///
/// // Two rules: if the velocity is negative, then -300 N; if it is positive, then 300 N.
/// let sets = [-1.0, 1.0].map(|centre| TskSet::Gaussian { centre, sigma: 1.0 });
/// let velocity = TskInput::new(Signal::Velocity, 0.0, 0.1, &sets)?;
/// let output = OutputScale { mean_n: 0.0, std_dev_n: 300.0 };
/// let model = Tsk::new(TskKind::Anfis, &[velocity], Order::Constant, &[-1.0, 1.0], output, 0.0)?;
/// # let extending = Inputs {
/// #     dt_s: None, displacement_m: 0.0, velocity_m_s: 0.1, acceleration_m_s2: 0.0, drive: f64::NAN, case_temp_c: f64::NAN,
/// # };
/// // The difference of the two weights is tanh(u), with u = 0.1 m/s / 0.1 m/s.
/// assert!((model.force_n(&extending) - 300.0 * 1.0_f64.tanh()).abs() < 1e-9);
/// assert_eq!((model.rules(), model.parameter_count()), (2, 6)); // two constants, two centres, two widths
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tsk {
    kind: TskKind,
    drive: Option<DriveKind>,
    input_count: usize,
    /// Unused inputs repeat the first one and are ignored.
    inputs: [TskInput; MAX_INPUTS],
    order: Order,
    len: usize,
    conclusions: [f64; MAX_CONCLUSIONS],
    output: OutputScale,
    force_offset_n: f64,
}

/// Derivatives of the force with respect to all parameters of a model, at one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TskGradient {
    /// With respect to the numbers of set j of input i, N, in the order of the fields of [`TskSet`], then zeros.
    pub(crate) sets: [[[f64; NUMBERS]; MAX_SETS]; MAX_INPUTS],
    /// With respect to the conclusions, N, in the order of [`Tsk::conclusions`].
    pub(crate) conclusions: [f64; MAX_CONCLUSIONS],
}

impl Tsk {
    /// A model on a full grid. `conclusions` holds the numbers of one rule after the other, the slopes in the order of
    /// the inputs and then the constant. The set of the first input varies slowest.
    ///
    /// # Errors
    /// When the number of inputs is 0 or above [`MAX_INPUTS`], a signal is repeated, or a number is out of range. When
    /// the structure does not match `kind` (any grid may be [`TskKind::Anfis`]). When the conclusions do not match the
    /// structure or exceed [`MAX_CONCLUSIONS`].
    pub fn new(
        kind: TskKind,
        inputs: &[TskInput],
        order: Order,
        conclusions: &[f64],
        output: OutputScale,
        force_offset_n: f64,
    ) -> Result<Self, Error> {
        let Some(first) = inputs.first().filter(|_| inputs.len() <= MAX_INPUTS) else {
            return Err(Error::Length {
                name: "inputs".to_owned(),
                found: inputs.len(),
                expected: format!("1 to {MAX_INPUTS}"),
            });
        };
        check_structure(kind, inputs, order)?;
        let rules: usize = inputs.iter().map(TskInput::len).product();
        let needed = rules * order.width(inputs.len());
        if conclusions.len() != needed || needed > MAX_CONCLUSIONS {
            return Err(Error::Length {
                name: "conclusions".to_owned(),
                found: conclusions.len(),
                expected: format!(
                    "{needed} ({rules} rules of {}, at most {MAX_CONCLUSIONS} values)",
                    order.width(inputs.len())
                ),
            });
        }
        for (j, value) in conclusions.iter().enumerate() {
            Error::check(&format!("conclusions[{j}]"), *value, "finite", |_| true)?;
        }
        Error::check("force_mean_n", output.mean_n, "finite", |_| true)?;
        Error::check("force_std_dev_n", output.std_dev_n, "positive and finite", |s| s > 0.0)?;
        Error::check("force_offset_n", force_offset_n, "finite", |_| true)?;
        let mut model = Self {
            kind,
            drive: drive_of(inputs),
            input_count: inputs.len(),
            inputs: [*first; MAX_INPUTS],
            order,
            len: needed,
            conclusions: [0.0; MAX_CONCLUSIONS],
            output,
            force_offset_n,
        };
        model.inputs[..inputs.len()].copy_from_slice(inputs);
        model.conclusions[..needed].copy_from_slice(conclusions);
        Ok(model)
    }

    /// The named model.
    #[must_use]
    pub const fn kind(&self) -> TskKind {
        self.kind
    }

    /// The inputs.
    #[must_use]
    pub fn inputs(&self) -> &[TskInput] {
        &self.inputs[..self.input_count]
    }

    /// Form of the conclusions.
    #[must_use]
    pub const fn order(&self) -> Order {
        self.order
    }

    /// The conclusions, rule after rule.
    #[must_use]
    pub fn conclusions(&self) -> &[f64] {
        &self.conclusions[..self.len]
    }

    /// Scale that undoes the normalisation of the force.
    #[must_use]
    pub const fn output(&self) -> OutputScale {
        self.output
    }

    /// Force offset of the session, N.
    #[must_use]
    pub const fn force_offset_n(&self) -> f64 {
        self.force_offset_n
    }

    /// The same model with another force offset, N, which must be finite.
    #[must_use]
    pub const fn with_force_offset_n(self, force_offset_n: f64) -> Self {
        Self { force_offset_n, ..self }
    }

    /// The drive that the model needs; `None` for the passive form.
    #[must_use]
    pub const fn drive(&self) -> Option<DriveKind> {
        self.drive
    }

    /// Number of rules.
    #[must_use]
    pub fn rules(&self) -> usize {
        self.inputs().iter().map(TskInput::len).product()
    }

    /// Number of conclusions plus the numbers of all memberships (two per Gaussian, three per triangle or bell, four
    /// otherwise), as the literature counts.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        let (mut count, mut j) = (self.len, 0);
        while j < self.input_count {
            count += self.inputs[j].shape().width() * self.inputs[j].len();
            j += 1;
        }
        count
    }

    /// Force, N, at a sample. Not finite if a needed input is not finite.
    #[inline]
    #[must_use]
    pub fn force_n(&self, inputs: &Inputs) -> f64 {
        self.output_at(&self.raw(inputs))
    }

    /// The inputs at a sample, in their signals' units.
    #[inline]
    fn raw(&self, inputs: &Inputs) -> [f64; MAX_INPUTS] {
        let mut raw = [0.0; MAX_INPUTS];
        for (raw, input) in raw.iter_mut().zip(self.inputs()) {
            *raw = input.signal().of(inputs);
        }
        raw
    }

    /// The output for the inputs `raw`, in their signals' units.
    #[inline]
    pub(crate) fn output_at(&self, raw: &[f64; MAX_INPUTS]) -> f64 {
        let mut u = [0.0; MAX_INPUTS];
        // An unused input has one set, which always fires.
        let mut weights = [[1.0; MAX_SETS]; MAX_INPUTS];
        for (j, (input, raw)) in self.inputs().iter().zip(raw).enumerate() {
            u[j] = input.normalise(*raw);
            weights[j] = input.weights(u[j]);
        }
        self.output.mean_n + self.output.std_dev_n * self.blend(&u, &weights) + self.force_offset_n
    }

    /// Weighted average of the rules, normalised.
    #[inline]
    fn blend(&self, u: &[f64; MAX_INPUTS], weights: &[[f64; MAX_SETS]; MAX_INPUTS]) -> f64 {
        match self.order.width(self.input_count) {
            1 => self.blend_of::<1>(u, weights),
            2 => self.blend_of::<2>(u, weights),
            3 => self.blend_of::<3>(u, weights),
            _ => self.blend_of::<4>(u, weights),
        }
    }

    /// The same for conclusions of `W` numbers. The conclusions are averaged first and multiplied by the inputs last.
    #[inline]
    fn blend_of<const W: usize>(
        &self,
        u: &[f64; MAX_INPUTS],
        weights: &[[f64; MAX_SETS]; MAX_INPUTS],
    ) -> f64 {
        let [n0, n1, n2] = self.counts();
        let mut conclusions = self.conclusions.as_chunks::<W>().0.iter();
        let mut mean = [0.0; W];
        for w0 in &weights[0][..n0] {
            for w1 in &weights[1][..n1] {
                let w01 = w0 * w1;
                for (w2, conclusion) in weights[2][..n2].iter().zip(&mut conclusions) {
                    let w = w01 * w2;
                    for (m, c) in mean.iter_mut().zip(conclusion) {
                        *m += w * c;
                    }
                }
            }
        }
        let slopes: f64 = mean[..W - 1].iter().zip(u).map(|(m, u)| m * u).sum();
        slopes + mean[W - 1]
    }

    /// Number of sets of each input; one for an unused input.
    #[inline]
    fn counts(&self) -> [usize; MAX_INPUTS] {
        let mut counts = [1; MAX_INPUTS];
        for (count, input) in counts.iter_mut().zip(self.inputs()) {
            *count = input.len();
        }
        counts
    }

    /// The output for the inputs `raw`, in their signals' units, and its derivatives with respect to all parameters.
    pub(crate) fn output_and_gradient_at(&self, raw: &[f64; MAX_INPUTS]) -> (f64, TskGradient) {
        let mut u = [0.0; MAX_INPUTS];
        let mut firing = [Firing { weights: [1.0; MAX_SETS], ..Firing::default() }; MAX_INPUTS];
        for (j, (input, raw)) in self.inputs().iter().zip(raw).enumerate() {
            u[j] = input.normalise(*raw);
            firing[j] = input.fire(u[j]);
        }
        let scale = self.output.std_dev_n;
        let mut gradient = TskGradient {
            sets: [[[0.0; NUMBERS]; MAX_SETS]; MAX_INPUTS],
            conclusions: [0.0; MAX_CONCLUSIONS],
        };
        let width = self.order.width(self.input_count);
        let mut under = [[0.0; MAX_SETS]; MAX_INPUTS];
        let mut output = 0.0;
        let [_, n1, n2] = self.counts();
        for (rule, conclusion) in self.conclusions().chunks_exact(width).enumerate() {
            let at = [rule / (n1 * n2), rule / n2 % n1, rule % n2];
            let w = [0, 1, 2].map(|i| firing[i].weights[at[i]]);
            let f = conclusion[width - 1]
                + conclusion[..width - 1].iter().zip(&u).map(|(c, u)| c * u).sum::<f64>();
            output += w[0] * w[1] * w[2] * f;
            for (i, under) in under.iter_mut().enumerate() {
                under[at[i]] += w[(i + 1) % MAX_INPUTS] * w[(i + 2) % MAX_INPUTS] * f;
            }
            let own = &mut gradient.conclusions[rule * width..(rule + 1) * width];
            for (slot, u) in own.iter_mut().zip(u[..width - 1].iter().chain([&1.0])) {
                *slot = scale * w[0] * w[1] * w[2] * u;
            }
        }
        for ((own, firing), under) in gradient.sets.iter_mut().zip(&firing).zip(&under) {
            for ((own, slopes), under) in own.iter_mut().zip(&firing.slopes).zip(under) {
                *own = slopes.map(|slope| scale * (under - output) * slope);
            }
        }
        (self.output.mean_n + scale * output + self.force_offset_n, gradient)
    }
}

/// The drive among `inputs`.
fn drive_of(inputs: &[TskInput]) -> Option<DriveKind> {
    inputs.iter().find_map(|input| match input.signal() {
        Signal::Drive(kind) => Some(kind),
        _ => None,
    })
}

/// Checks that no signal is repeated, and that a named structure matches its name.
fn check_structure(kind: TskKind, inputs: &[TskInput], order: Order) -> Result<(), Error> {
    for (j, input) in inputs.iter().enumerate() {
        let again = |other: &TskInput| other.signal().name() == input.signal().name();
        if inputs[..j].iter().any(again) {
            return Err(ForceError::RepeatedInput { index: j, signal: input.signal().name() }.into());
        }
    }
    if kind == TskKind::Anfis {
        return Ok(());
    }
    let found: Vec<(Signal, usize)> = inputs.iter().map(|input| (input.signal(), input.len())).collect();
    let shaped = inputs.iter().all(|input| kind.allows(input.shape()));
    if found == kind.structure(drive_of(inputs)) && shaped && order == kind.order() {
        return Ok(());
    }
    Err(ForceError::OtherStructure { name: kind.name() }.into())
}
