//! The model for the inversion: without the effects of the load cell, which do not change the damper's force, without its coil lag, which
//! the lead compensates, and with the method that finds a current.

use super::limits::Limits;
use super::method::Method;
use super::parts::{InverseMap, InverseParts};
use super::shape::Shape;
use super::solve::{Ends, Moment, Solution, Solver};
use super::surrogate::{Surrogate, check_unique};
use crate::effect::{Augmented, EffectModel, Effects};
use crate::error::{Error, InverseError, NoInverse};
use crate::force::Inputs;
use crate::inverse_model::{InverseModel, InverseState, STEP_TOLERANCE};
use crate::model::{Model, Preload};
use crate::sample::DriveKind;
use crate::units::{Ampere, Newton};

/// Time constants of a coil, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Coil {
    pub(super) rise_s: f64,
    pub(super) fall_s: f64,
}

impl Coil {
    /// The time constant for a change from `from_a` to `to_a`, s.
    pub(super) fn tau_s(&self, from_a: f64, to_a: f64) -> f64 {
        if to_a >= from_a { self.rise_s } else { self.fall_s }
    }
}

/// The prepared inverse of a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Inverse {
    /// The model of the damper's force, without the lag of its coil.
    pub(super) model: Augmented,
    /// Its effects and the effects of the load cell: with them it gives the expected reading. `None` if the load cell has no effects.
    pub(super) reading: Option<Effects>,
    pub(super) coil: Option<Coil>,
    pub(super) preload: Preload,
    pub(super) shape: Shape,
    solver: Solver,
    /// The surrogate, if the method is one.
    pub(super) surrogate: Option<Surrogate>,
    /// The learned inverse, if the method is one.
    pub(super) learned: Option<InverseModel>,
}

impl Inverse {
    pub(super) fn new(model: &Model, limits: &Limits, method: Method) -> Result<Self, Error> {
        limits.validate()?;
        let reading = match model.effects.include_load_cell() {
            true => Some(*without_lag(model)?.effects()),
            false => None,
        };
        let model = &model.of_damper();
        match model.force.drive() {
            Some(DriveKind::CoilCurrent) => {}
            Some(DriveKind::CommandVoltage) => {
                return Err(refused(model, NoInverse::DrivenByVoltage));
            }
            None => {
                return Err(refused(model, NoInverse::NoCurrentInput));
            }
        }
        let shape = Shape::of(model, limits.current_max_a);
        if !shape.has_force() {
            let [finite, points] = shape.points;
            return Err(refused(model, NoInverse::FewFiniteForces { finite, points }));
        }
        let lag = model.effects.as_slice().iter().rev().find_map(EffectModel::drive_lag_s);
        let coil = lag.map(|[rise_s, fall_s]| Coil { rise_s, fall_s });
        let current_max_a = limits.current_max_a;
        let solver = Solver { current_max_a, folded: shape.real_fold().is_some(), linear: shape.is_linear() };
        let surrogate = Surrogate::of(model, method, &shape, limits)?;
        let learned = learned(model, method, &shape)?;
        let (model, preload) = (without_lag(model)?, model.preload());
        Ok(Self { model, reading, coil, preload, shape, solver, surrogate, learned })
    }

    /// The numbers of the inverse.
    pub(super) fn parts(&self, limits: &Limits) -> InverseParts {
        let map = match (&self.surrogate, &self.learned) {
            (Some(surrogate), _) => surrogate.map(),
            (None, Some(learned)) => InverseMap::Learned(*learned),
            (None, None) => InverseMap::Search,
        };
        let Solver { folded, linear, .. } = self.solver;
        InverseParts { limits: *limits, most_n: self.shape.most_n, folded, linear, map }
    }

    /// The current for `demand_n` at `moment`, the moment of `inputs`. `last` is the last current, and its force at this
    /// moment. `bias_n` is the bias of the model that the demand excludes, and `state` holds the past samples of a learned inverse.
    #[inline]
    pub(super) fn solve(
        &self,
        moment: &Moment,
        inputs: &Inputs,
        demand_n: f64,
        bias_n: f64,
        last: (Ampere, Newton),
        state: &mut InverseState,
    ) -> Option<Found> {
        let by_method = |solution| Found { solution, substituted: false };
        match (&self.surrogate, &self.learned) {
            (None, None) => self.solver.solve(moment, demand_n, last).map(by_method),
            (Some(surrogate), _) => surrogate.solve(moment, inputs, demand_n, last.0).map(by_method),
            (None, Some(learned)) => {
                self.solve_learned(learned, moment, inputs, [demand_n, bias_n], last, state)
            }
        }
    }

    /// The least and the largest force of the damper at `moment`, N, whose model has the force `modelled_n`. `last` is the last current,
    /// and its force.
    pub(super) fn achievable_n(
        &self,
        moment: &Moment,
        modelled_n: f64,
        last: (Ampere, Newton),
    ) -> Option<[f64; 2]> {
        if self.surrogate.is_none() && self.learned.is_none() {
            return Some(self.solver.solve(moment, modelled_n, last)?.achievable_n);
        }
        Some(Ends::of(moment, self.solver.current_max_a)?.achievable_n())
    }

    /// The same by a learned inverse. Its past forces are the demands, clipped to the achievable range. If it gives no current, the search
    /// does. The demand on the model excludes its bias.
    #[inline]
    fn solve_learned(
        &self,
        learned: &InverseModel,
        moment: &Moment,
        inputs: &Inputs,
        [demand_n, bias_n]: [f64; 2],
        last: (Ampere, Newton),
        state: &mut InverseState,
    ) -> Option<Found> {
        let max_a = self.solver.current_max_a;
        let ends = Ends::of(moment, max_a)?;
        let end = ends.clipped(demand_n);
        // The inverse was learned from the damper, so the model's bias does not apply to it.
        let asked_n = end.map_or(demand_n, |end| end.force_n) + bias_n - self.model.force().force_offset_n();
        let learned_a = learned.step(state, inputs, asked_n);
        if let Some(solution) = end {
            return Some(Found { solution, substituted: false });
        }
        match learned_a {
            Some(current_a) => {
                let current_a = current_a.clamp(0.0, max_a);
                let force_n = moment.force_n(current_a)?;
                let solution = Solution { current_a, force_n, achievable_n: ends.achievable_n() };
                Some(Found { solution, substituted: false })
            }
            None => {
                let solution = self.solver.solve(moment, demand_n, last)?;
                Some(Found { solution, substituted: true })
            }
        }
    }
}

/// A current, and whether the search found it in the place of a learned inverse that gave none.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    pub(super) solution: Solution,
    pub(super) substituted: bool,
}

/// The learned inverse of `model` that `method` needs; `None` for another method.
fn learned(model: &Model, method: Method, shape: &Shape) -> Result<Option<InverseModel>, Error> {
    let Some(kind) = method.learned() else { return Ok(None) };
    let method_name = method.name();
    let Some(learned) = model.inverse.filter(|inverse| inverse.kind() == kind) else {
        let held = model.inverse.map(|inverse| inverse.kind().name());
        return Err(refused(model, NoInverse::NotLearned { method: method_name, held }));
    };
    check_unique(model, method, shape)?;
    if let Some(period) = learned.sample_period() {
        let (learned_hz, rate_hz) = (1.0 / period.get(), model.rate_hz);
        if (learned_hz / rate_hz - 1.0).abs() > STEP_TOLERANCE {
            return Err(refused(model, NoInverse::OtherRate { method: method_name, learned_hz, rate_hz }));
        }
    }
    Ok(Some(learned))
}

/// `model` without the lag of its coil: its drive is the current in the fluid.
pub(super) fn without_lag(model: &Model) -> Result<Augmented, Error> {
    let others = |effect: &&EffectModel| !effect.effect().lags_drive();
    let kept: Vec<EffectModel> = model.effects.as_slice().iter().filter(others).copied().collect();
    Augmented::new(model.force, Effects::new(&kept)?.with_terms(*model.effects.terms()))
}

pub(super) fn refused(model: &Model, why: NoInverse) -> Error {
    InverseError { model: model.force.name(), why }.into()
}
