//! The model for the inversion: without the effects of the load cell, which do not change the damper's force, without its coil lag, which
//! the lead compensates, and with the method that finds a current.

use super::limits::Limits;
use super::method::Method;
use super::shape::Shape;
use super::solve::{Moment, Solution, Solver};
use super::surrogate::Surrogate;
use crate::effect::{Augmented, EffectModel, Effects};
use crate::error::{Error, InverseError, NoInverse};
use crate::force::Inputs;
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
    /// The surrogate, if the method is not the search.
    pub(super) surrogate: Option<Surrogate>,
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
        let (model, preload) = (without_lag(model)?, model.preload());
        Ok(Self { model, reading, coil, preload, shape, solver, surrogate })
    }

    /// The current for `demand_n` at `moment`, the moment of `inputs`. `last` is the last current, and its force at this
    /// moment.
    #[inline]
    pub(super) fn solve(
        &self,
        moment: &Moment,
        inputs: &Inputs,
        demand_n: f64,
        last: (Ampere, Newton),
    ) -> Option<Solution> {
        match &self.surrogate {
            None => self.solver.solve(moment, demand_n, last),
            Some(surrogate) => surrogate.solve(moment, inputs, demand_n, last.0),
        }
    }
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
