//! The force models, one file each, and the enum that the pipeline steps.
//!
//! A model is immutable. Its state from sample to sample is a separate small `Copy` type. Models are `Copy` too (fixed capacity,
//! no heap), so that a model can be handed to the estimating thread and swapped between two samples without an allocation.

#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod arx;
mod dependence;
mod form;
mod fuzzy_tanh;
mod history;
pub(crate) mod jet;
pub mod law;
mod lazy;
mod lpv;
mod maxwell_slip;
mod network;
mod on_jets;
mod phase;
mod sets;
pub(crate) mod tsk;

pub(crate) use arx::ArxShape;
pub use arx::{Arx, LAGS, SAVARESI_LAGS};
pub use dependence::{Dependence, MAX_DEGREE};
pub use form::Form;
pub(crate) use fuzzy_tanh::FuzzyTanhAlong;
pub use fuzzy_tanh::{FuzzyTanh, FuzzyTanhAt, TanhFunction};
pub use history::{DEPTH, History};
pub use law::{ForceLaw, LawModel, LawState, Sensitivity};
pub(crate) use lazy::Learning;
pub use lazy::{Lazy, LazyMetric, LazyPoint, MAX_NEIGHBOURS, MAX_POINTS, MIN_NEIGHBOURS};
pub use lpv::{LPV_REGRESSORS, Lpv};
pub use maxwell_slip::{
    MaxwellSlip, SLIP_BRISTLES, SLIP_COEFFICIENTS, SLIP_KNOTS, SLIP_SEGMENTS, SlipFunction, SlipGrid,
    SlipState,
};
pub use network::{
    MAX_NETWORK_HIDDEN, MAX_NETWORK_INPUTS, Network, NetworkScaling, NetworkStructure, Normalisation,
};
pub(crate) use on_jets::{ForceOnJets, Kept, Number};
pub use phase::{ForceMotion, PHASE_NAMES, PHASE_PARAMETERS, Phase};
pub(crate) use sets::blend;
pub use sets::{FuzzySets, MAX_FUNCTIONS, Membership};
pub use tsk::{
    MAX_CONCLUSIONS, MAX_INPUTS, MAX_SETS, Order, OutputScale, Shape, Signal, Tsk, TskInput, TskKind, TskSet,
};

use crate::sample::DriveKind;
use crate::units::Second;
use jet::Real;

/// Any force model of this crate.
///
/// Any model is simulated with the same three types:
///
/// ```
/// use mr_damper_model::force::{Arx, ForceModel, FreeRun, Inputs};
/// use mr_damper_model::units::Second;
///
/// // F_k = 0.5 F_{k-1} + 500 v_k, with an offset of 20 N: a damper of 500 / (1 - 0.5) = 1000 N s/m behind a lag.
/// let arx = Arx::new([0.5, 0.0, 0.0], [0.0; 3], [500.0, 0.0, 0.0], None, Second(1.0 / 512.0), 20.0)?;
/// let (model, mut state) = (ForceModel::Arx(arx), FreeRun::default());
/// let extending = Inputs {
///     dt_s: Some(1.0 / 512.0),
///     displacement_m: 0.0,
///     velocity_m_s: 0.1,
///     acceleration_m_s2: 0.0,
///     drive: f64::NAN, // a passive model ignores it
///     case_temp_c: f64::NAN,
/// };
/// let force_n = (0..100).filter_map(|_| model.free_run(&mut state, &extending)).last();
/// assert!((force_n.expect("its history is full") - 120.0).abs() < 1e-9);
/// assert!(model.drive().is_none() && model.remembers());
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[allow(
    clippy::large_enum_variant,
    reason = "boxing the larger ones would put them on the heap, out of `Copy`"
)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ForceModel {
    /// Autoregression with exogenous inputs (ARX). It can be seeded with measured force.
    Arx(Arx),
    /// Fuzzy sets over the drive, with one tanh function per set.
    FuzzyTanh(FuzzyTanh),
    /// ARX with coefficients that depend on the drive (LPV). It can be seeded with measured force.
    Lpv(Lpv),
    /// An autoregressive network. It can be seeded with measured force.
    Network(Network),
    /// Recursive lazy learning.
    Lazy(Lazy),
    /// A force law with parameters that depend on the drive.
    Law(LawModel),
    /// Fuzzy sets over the drive, with a damping curve and slipping bristles per set.
    MaxwellSlip(MaxwellSlip),
    /// Fuzzy rules on a grid: ANFIS and its relatives.
    Tsk(Tsk),
}

/// Inputs of a model at one sample. `R` is `f64`, except inside of this crate, where it may carry derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inputs<R = f64> {
    /// Time since the sample before, s; `None` at the first sample and after a gap.
    pub dt_s: Option<f64>,
    /// Conditioned displacement, m.
    pub displacement_m: R,
    /// Conditioned velocity, m/s.
    pub velocity_m_s: R,
    /// Conditioned acceleration, m/s²; NaN if not known.
    pub acceleration_m_s2: R,
    /// Drive in the unit of the model's [`DriveKind`]; ignored by models without one.
    pub drive: R,
    /// Case temperature of the damper, °C; NaN if not known. Only effects use it, not force models.
    pub case_temp_c: f64,
}

impl Inputs {
    /// The same inputs as constants of another number type.
    #[inline]
    pub(crate) fn lifted<R: Real>(&self) -> Inputs<R> {
        Inputs {
            dt_s: self.dt_s,
            displacement_m: R::from(self.displacement_m),
            velocity_m_s: R::from(self.velocity_m_s),
            acceleration_m_s2: R::from(self.acceleration_m_s2),
            drive: R::from(self.drive),
            case_temp_c: self.case_temp_c,
        }
    }
}

/// A direction in the space of a model's inputs, for a directional derivative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Way {
    pub(crate) displacement_m: f64,
    pub(crate) velocity_m_s: f64,
}

/// State of a simulation (free run): a model that never uses measured force.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FreeRun {
    history: History,
    law: LawState,
    slip: SlipState,
}

impl ForceModel {
    /// The model's name, as in the contract: `arx`, `fuzzy-tanh`, `sp`, `anfis`.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Arx(arx) => arx.name(),
            Self::Lpv(_) => "lpv",
            Self::Network(network) => network.structure().name(),
            Self::FuzzyTanh(_) => "fuzzy-tanh",
            Self::Lazy(_) => "boada",
            Self::Law(model) => model.law().name(),
            Self::MaxwellSlip(_) => "maxwell-slip",
            Self::Tsk(model) => model.kind().name(),
        }
    }

    /// The drive that the model needs; `None` for a passive model.
    #[must_use]
    pub const fn drive(&self) -> Option<DriveKind> {
        match self {
            Self::Arx(arx) => arx.drive(),
            Self::Lpv(lpv) => lpv.dependence().drive(),
            Self::Network(network) => network.drive(),
            Self::Lazy(lazy) => lazy.drive(),
            Self::FuzzyTanh(fuzzy) => Some(fuzzy.drive()),
            Self::Law(model) => model.dependence().drive(),
            Self::MaxwellSlip(model) => model.drive(),
            Self::Tsk(model) => model.drive(),
        }
    }

    /// Number of identified coefficients, without memberships and offset.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        match self {
            Self::Arx(arx) => arx.parameter_count(),
            Self::Lpv(lpv) => lpv.parameter_count(),
            Self::Network(network) => network.parameter_count(),
            Self::Lazy(lazy) => lazy.parameter_count(),
            Self::FuzzyTanh(fuzzy) => fuzzy.parameter_count(),
            Self::Law(model) => model.parameter_count(),
            Self::MaxwellSlip(model) => model.parameter_count(),
            Self::Tsk(model) => model.parameter_count(),
        }
    }

    /// The coefficients of a model whose simulation has derivatives by them: a law's own, or four for each function of fuzzy-tanh.
    /// `None` for every other model.
    pub(crate) fn coefficients(&self) -> Option<Vec<f64>> {
        match self {
            Self::FuzzyTanh(fuzzy) => {
                Some(fuzzy.functions().iter().flat_map(TanhFunction::numbers).collect())
            }
            Self::Law(model) => Some(model.coefficients().to_vec()),
            _ => None,
        }
    }

    /// The same model with other `values` of [`ForceModel::coefficients`]; `None` if they are not valid.
    pub(crate) fn with_coefficients(&self, values: &[f64]) -> Option<Self> {
        match self {
            Self::FuzzyTanh(fuzzy) => {
                let functions: Vec<TanhFunction> =
                    values.as_chunks().0.iter().copied().map(TanhFunction::new).collect();
                FuzzyTanh::new(*fuzzy.sets(), &functions, fuzzy.force_offset_n()).ok().map(Self::FuzzyTanh)
            }
            Self::Law(law) => {
                LawModel::new(law.law(), *law.dependence(), values, law.force_offset_n()).ok().map(Self::Law)
            }
            _ => None,
        }
    }

    /// Force offset of the session, N.
    #[must_use]
    pub const fn force_offset_n(&self) -> f64 {
        match self {
            Self::Arx(arx) => arx.force_offset_n(),
            Self::Lpv(lpv) => lpv.force_offset_n(),
            Self::Network(network) => network.force_offset_n(),
            Self::Lazy(lazy) => lazy.force_offset_n(),
            Self::FuzzyTanh(fuzzy) => fuzzy.force_offset_n(),
            Self::Law(model) => model.force_offset_n(),
            Self::MaxwellSlip(model) => model.force_offset_n(),
            Self::Tsk(model) => model.force_offset_n(),
        }
    }

    /// The same model with another session's force offset, N.
    #[must_use]
    pub const fn with_force_offset_n(self, force_offset_n: f64) -> Self {
        match self {
            Self::Arx(arx) => Self::Arx(arx.with_force_offset_n(force_offset_n)),
            Self::Lpv(lpv) => Self::Lpv(lpv.with_force_offset_n(force_offset_n)),
            Self::Network(network) => Self::Network(network.with_force_offset_n(force_offset_n)),
            Self::Lazy(lazy) => Self::Lazy(lazy.with_force_offset_n(force_offset_n)),
            Self::FuzzyTanh(fuzzy) => Self::FuzzyTanh(fuzzy.with_force_offset_n(force_offset_n)),
            Self::Law(model) => Self::Law(model.with_force_offset_n(force_offset_n)),
            Self::MaxwellSlip(model) => Self::MaxwellSlip(model.with_force_offset_n(force_offset_n)),
            Self::Tsk(model) => Self::Tsk(model.with_force_offset_n(force_offset_n)),
        }
    }

    /// The sample period, s, at which an autoregressive model holds; `None` for a model that is not autoregressive in force. Such
    /// a model cannot be seeded with measured force.
    #[must_use]
    pub const fn force_fed_period(&self) -> Option<Second> {
        match self {
            Self::Arx(arx) => Some(arx.sample_period()),
            Self::Lpv(lpv) => Some(lpv.sample_period()),
            Self::Network(network) => Some(network.sample_period()),
            Self::FuzzyTanh(_) | Self::Law(_) | Self::MaxwellSlip(_) | Self::Lazy(_) | Self::Tsk(_) => None,
        }
    }

    /// True if the simulated force depends on earlier samples, that is, on the state in [`FreeRun`].
    #[must_use]
    pub const fn remembers(&self) -> bool {
        match self {
            Self::Arx(_) | Self::Lpv(_) | Self::Network(_) | Self::MaxwellSlip(_) => true,
            Self::Law(model) => model.law().has_memory(),
            Self::FuzzyTanh(_) | Self::Lazy(_) | Self::Tsk(_) => false,
        }
    }

    /// False if the model's static force is not determined (an ARX model with rounded coefficients). Such a model can predict one
    /// step ahead but must not be simulated at low frequency.
    #[must_use]
    pub fn dc_is_meaningful(&self) -> bool {
        match self {
            Self::Arx(arx) => arx.dc_is_meaningful(),
            Self::Lpv(_)
            | Self::FuzzyTanh(_)
            | Self::Law(_)
            | Self::MaxwellSlip(_)
            | Self::Network(_)
            | Self::Lazy(_)
            | Self::Tsk(_) => true,
        }
    }

    /// The force, N, that an autoregressive model predicts from `history`; `None` while the history is incomplete, and for every
    /// other model.
    #[inline]
    #[must_use]
    pub fn predict_n(&self, history: &History) -> Option<f64> {
        match self {
            Self::Arx(arx) => arx.predict_n(history),
            Self::Lpv(lpv) => lpv.predict_n(history),
            Self::Network(network) => network.predict_n(history),
            Self::FuzzyTanh(_) | Self::Law(_) | Self::MaxwellSlip(_) | Self::Lazy(_) | Self::Tsk(_) => None,
        }
    }

    /// The model at a constant drive, for a static model that returns force and slope in one pass, at little more cost than the
    /// force alone. `None` for every other model.
    #[inline]
    pub(crate) fn along(&self, drive: f64) -> Option<FuzzyTanhAlong<'_>> {
        match self {
            Self::FuzzyTanh(fuzzy) => Some(fuzzy.along(drive)),
            _ => None,
        }
    }

    /// Advances a simulation (free run) by one sample and returns the force, N; `None` while the model's history is still filling.
    #[inline]
    pub fn free_run(&self, state: &mut FreeRun, inputs: &Inputs) -> Option<f64> {
        match self {
            Self::FuzzyTanh(fuzzy) => {
                Some(fuzzy.force_n(inputs.displacement_m, inputs.velocity_m_s, inputs.drive))
            }
            Self::Lazy(lazy) => Some(lazy.force_n(inputs.displacement_m, inputs.velocity_m_s, inputs.drive)),
            Self::Law(model) => Some(model.force_n(inputs, &mut state.law)),
            Self::MaxwellSlip(model) => Some(model.force_n(inputs, &mut state.slip)),
            Self::Tsk(model) => Some(model.force_n(inputs)),
            Self::Arx(_) | Self::Lpv(_) | Self::Network(_) => {
                state.history.push_inputs(inputs);
                let predicted = self.predict_n(&state.history);
                // At rest the damper's force is its offset: the neutral start of a simulation.
                state.history.push_force(predicted.unwrap_or(self.force_offset_n()));
                predicted
            }
        }
    }
}
