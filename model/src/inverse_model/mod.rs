//! Learned inverse models: the current for a force, identified from recorded runs.
//!
//! ```text
//! chen        i_k = N(x_k, x_{k-1}, v_k, v_{k-1}, F_k, F_{k-1}, i_{k-1})                    25 hidden neurons
//! wang-liao   i_k = N(x_k .. x_{k-4}, v_k .. v_{k-4}, F_k .. F_{k-4}, i_{k-1} .. i_{k-5})   15 hidden neurons
//! wang-hu     i_k = sum_r W_r(v_k, a_k, F_k) f_r(v_k, a_k, F_k) / sum_r W_r                 27 rules
//! ```
//!
//! | symbol | unit | meaning |
//! |---|---|---|
//! | x, v, a | m, m/s, m/s² | conditioned displacement, velocity and acceleration |
//! | F | N | in training the measured force, in use the demanded force; both without the session's offset |
//! | i | A | in training the recorded current, in use the commanded current after limits |
//!
//! An inverse model is the direct structure of the same publication with force and current exchanged. It is identified by
//! [`identify_inverse`](crate::identify::identify_inverse) and stored in the model file. A [surrogate](crate::inverse::SurrogateFit) is different:
//! it is fitted to the force model, when that is loaded.
//!
//! Sources: `[chen2009]`, `[wangliao2001]` and `[wanghu2009]` in the bibliography (node/docs/guide/bibliography.md).

#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod fuzzy;
mod network;
#[cfg(test)]
mod tests;

pub use fuzzy::{FuzzyAxis, InverseFuzzy};
pub use network::{InverseNetwork, InverseScaling};

use crate::force::{History, Inputs, NetworkStructure};
use crate::units::Second;

/// Structure of a learned inverse model.
///
/// ```
/// use mr_damper_model::inverse::InverseKind;
///
/// assert_eq!(InverseKind::named("wang-hu"), Some(InverseKind::WangHu));
/// assert_eq!(InverseKind::ALL.map(InverseKind::name), ["chen", "wang-liao", "wang-hu"]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum InverseKind {
    /// Network with two samples of each input and one past current.
    Chen,
    /// Recurrent network with five samples of each input and five past currents.
    WangLiao,
    /// First-order TSK rules over velocity, acceleration and force.
    WangHu,
}

impl InverseKind {
    /// All structures.
    pub const ALL: [Self; 3] = [Self::Chen, Self::WangLiao, Self::WangHu];

    /// The name, as in model files, flags and parameters.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Chen => "chen",
            Self::WangLiao => "wang-liao",
            Self::WangHu => "wang-hu",
        }
    }

    /// The structure called `name`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// The structure of its network; `None` for fuzzy rules.
    #[must_use]
    pub const fn network(self) -> Option<NetworkStructure> {
        match self {
            Self::Chen => Some(NetworkStructure::Chen),
            // The publication's input layer belongs to the direct model.
            Self::WangLiao => Some(NetworkStructure::Narx),
            Self::WangHu => None,
        }
    }
}

/// A learned inverse model. It is `Copy` and uses no heap, like the force models.
#[allow(clippy::large_enum_variant, reason = "a box would put it on the heap, out of `Copy`")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InverseModel {
    /// `chen` or `wang-liao`.
    Network(InverseNetwork),
    /// `wang-hu`.
    Fuzzy(InverseFuzzy),
}

/// The past samples of a learned inverse model.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct InverseState {
    /// The lags, with the force in the place of the drive and the current in the place of the force.
    exchanged: History,
}

impl InverseState {
    /// Adds the current of the newest sample, A. Call it once after each [`InverseModel::step`].
    #[inline]
    pub fn feed(&mut self, current_a: f64) {
        self.exchanged.push_force(current_a);
    }
}

/// Largest relative difference between a time step and the sample period of the training; beyond it the history starts again.
pub(crate) const STEP_TOLERANCE: f64 = 0.25;

impl InverseModel {
    /// The structure.
    #[must_use]
    pub const fn kind(&self) -> InverseKind {
        match self {
            Self::Network(network) => match network.structure() {
                NetworkStructure::Chen => InverseKind::Chen,
                NetworkStructure::Narx | NetworkStructure::WangLiao => InverseKind::WangLiao,
            },
            Self::Fuzzy(_) => InverseKind::WangHu,
        }
    }

    /// The sample period at which it holds; `None` for rules, which have no memory.
    #[must_use]
    pub const fn sample_period(&self) -> Option<Second> {
        match self {
            Self::Network(network) => Some(network.sample_period()),
            Self::Fuzzy(_) => None,
        }
    }

    /// Number of parameters, as the literature counts.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        match self {
            Self::Network(network) => network.parameter_count(),
            Self::Fuzzy(rules) => rules.parameter_count(),
        }
    }

    /// The current, A, for the force `force_n` (without the session's offset) at the motion of `inputs`. Call it at every sample, and then
    /// [`InverseState::feed`] with the current of that sample.
    ///
    /// `None` while a needed past sample is not known: at the first samples, after a gap, and after a step that differs from the sample
    /// period by more than a quarter. `None` also if the current is not finite.
    #[inline]
    pub fn step(&self, state: &mut InverseState, inputs: &Inputs, force_n: f64) -> Option<f64> {
        let current_a = match self {
            Self::Network(network) => {
                let period_s = network.sample_period().get();
                let follows = |dt_s: f64| (dt_s / period_s - 1.0).abs() <= STEP_TOLERANCE;
                if !inputs.dt_s.is_some_and(follows) {
                    *state = InverseState::default();
                }
                state.exchanged.push_inputs(&Inputs { drive: force_n, ..*inputs });
                network.current_a(&state.exchanged)?
            }
            Self::Fuzzy(rules) => rules.current_a(inputs.velocity_m_s, inputs.acceleration_m_s2, force_n),
        };
        current_a.is_finite().then_some(current_a)
    }
}
