//! A force model with everything that is needed to run it: input conditioning, training envelope and expected
//! error.

use crate::condition::Conditioning;
use crate::effect::{Augmented, AugmentedState, EffectModel, Effects};
use crate::force::{ForceModel, Inputs};
use crate::inverse_model::InverseModel;
use crate::uncertainty::Uncertainty;
use serde::{Deserialize, Serialize};

/// A model as the pipeline runs it. It is `Copy` and uses no heap, so it can be replaced between two samples.
///
/// A model with an additional effect, simulated for two samples:
///
/// ```
/// use mr_damper_model::effect::{AugmentedState, Effect, EffectModel, Effects};
/// use mr_damper_model::force::Inputs;
/// use mr_damper_model::model::Model;
/// use mr_damper_model::preset;
///
/// let published = preset::load(preset::BEST_FUZZY_TANH)?;
/// let spring = EffectModel::new(Effect::GasSpring, &[5_000.0])?; // N/m
/// let model = Model { effects: Effects::new(&[spring])?, ..published };
///
/// let at = |dt_s, displacement_m| Inputs {
///     dt_s, displacement_m, velocity_m_s: 0.1, acceleration_m_s2: 0.0, drive: 1.0, case_temp_c: 25.0,
/// };
/// let (mut state, mut without) = (AugmentedState::default(), AugmentedState::default());
/// for inputs in [at(None, 0.0), at(Some(0.01), 0.001)] {
///     let added_n = model.free_run(&mut state, &inputs).unwrap() - published.free_run(&mut without, &inputs).unwrap();
///     assert!((added_n - 5_000.0 * inputs.displacement_m).abs() < 1e-9);
/// }
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model {
    /// The force model.
    pub force: ForceModel,
    /// Effects that are applied to its input or output.
    pub effects: Effects,
    /// How its inputs are derived from the samples.
    pub conditioning: Conditioning,
    /// Sample rate of its training data, Hz; the lowest one if the runs differ.
    pub rate_hz: f64,
    /// Ranges of its training data.
    pub envelope: Envelope,
    /// Its expected error.
    pub expected: Expected,
    /// A learned inverse model of the same runs, for the inverse controller.
    pub inverse: Option<InverseModel>,
}

impl Model {
    /// The force model with its effects.
    #[must_use]
    pub const fn augmented(&self) -> Augmented {
        Augmented::unchecked(self.force, self.effects)
    }

    /// The model of the damper's force: without the effects of the load cell. With them the model gives the expected reading of the load
    /// cell.
    #[must_use]
    pub fn of_damper(&self) -> Self {
        Self { effects: self.effects.of_damper(), ..*self }
    }

    /// Advances a simulation (free run) by one sample; see [`Augmented::free_run`].
    #[inline]
    pub fn free_run(&self, state: &mut AugmentedState, inputs: &Inputs) -> Option<f64> {
        self.effects.free_run(&self.force, state, inputs)
    }

    /// True when the model can be seeded with measured force; see [`Augmented::feeds_on_force`].
    #[must_use]
    pub const fn feeds_on_force(&self) -> bool {
        self.effects.is_empty() && self.force.force_fed_period().is_some()
    }

    /// The static force, which does no work over a full stroke.
    pub(crate) fn preload(&self) -> Preload {
        Preload {
            offset_n: self.force.force_offset_n(),
            gas_n_m: self.effects.as_slice().iter().map(EffectModel::static_stiffness_n_m).sum(),
        }
    }
}

/// Static force of a damper: the force offset plus the force of the gas springs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Preload {
    offset_n: f64,
    gas_n_m: f64,
}

impl Preload {
    /// The force at a displacement, N.
    #[inline]
    pub(crate) fn at_n(&self, displacement_m: f64) -> f64 {
        self.offset_n + self.gas_n_m * displacement_m
    }
}

/// Ranges of a model's training data. The model extrapolates outside them. `None` means unknown.
///
/// ```
/// use mr_damper_model::model::Envelope;
///
/// let mut envelope = Envelope::default();
/// for current_a in [0.0, 2.5, 1.2] {
///     Envelope::widen(&mut envelope.drive, current_a);
/// }
/// assert_eq!(envelope.drive, Some([0.0, 2.5]));
/// // 5 % of the width, 0.125 A, does not count as extrapolation. An unknown range is never left.
/// assert!(!Envelope::leaves(envelope.drive, 2.6) && Envelope::leaves(envelope.drive, 2.7));
/// assert!(!Envelope::leaves(envelope.force_n, 1e6));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Envelope {
    /// Conditioned displacement, m.
    pub displacement_m: Option<[f64; 2]>,
    /// Conditioned velocity, m/s.
    pub velocity_m_s: Option<[f64; 2]>,
    /// Drive, in the unit of the model's drive kind (A or V).
    pub drive: Option<[f64; 2]>,
    /// Case temperature, °C.
    pub case_temp_c: Option<[f64; 2]>,
    /// Measured force, N.
    pub force_n: Option<[f64; 2]>,
}

impl Envelope {
    /// True when `value` lies outside `range` by more than 5 % of the range's width; false when the range is
    /// unknown.
    #[inline]
    #[must_use]
    pub fn leaves(range: Option<[f64; 2]>, value: f64) -> bool {
        range.is_some_and(|[low, high]| {
            let slack = 0.05 * (high - low);
            value < low - slack || value > high + slack
        })
    }

    /// Widens `range` to include `value`.
    pub fn widen(range: &mut Option<[f64; 2]>, value: f64) {
        if value.is_finite() {
            let [low, high] = range.unwrap_or([value, value]);
            *range = Some([low.min(value), high.max(value)]);
        }
    }
}

/// Root mean squared error of a model at identification, on held-out runs if there were any. `None` means
/// unknown.
///
/// ```
/// use mr_damper_model::model::{Expected, Model};
/// use mr_damper_model::model_file::{ModelFile, Provenance};
/// use mr_damper_model::preset;
///
/// // A validation found an RMSE of 42 N. The model file keeps it, and the residual alarm compares with it.
/// let expected = Expected { free_run_rsse_n: Some(42.0), ..Expected::default() };
/// let model = Model { expected, ..preset::load(preset::BEST_FUZZY_TANH)? };
/// let text = ModelFile { model, provenance: Provenance::default() }.to_toml()?;
/// assert_eq!(ModelFile::from_toml(&text)?.model.expected, expected);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expected {
    /// RMSE of the simulation, N.
    pub free_run_rsse_n: Option<f64>,
    /// RMSE of the one-step-ahead prediction, N.
    pub one_step_rsse_n: Option<f64>,
    /// Simulation and prediction error by region, with 90 % bands, calibrated on held-out runs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<Uncertainty>,
}
