//! The two lanes: one model each, with its own conditioning and state.

use super::event::Reasons;
use crate::condition::{ApplyTo, Conditioning, LowPass, LowPassState, MotionState};
use crate::effect::{AugmentedState, Need};
use crate::error::Error;
use crate::force::{ForceModel, History, Inputs};
use crate::model::{Envelope, Model};

/// What both lanes are given at a displacement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Given {
    /// Time since the displacement before; `None` after a reset or a gap.
    pub(super) dt_s: Option<f64>,
    pub(super) displacement_m: f64,
    pub(super) measured_velocity_m_s: Option<f64>,
    /// NaN when there is none.
    pub(super) drive: f64,
    /// NaN when it is not known.
    pub(super) case_temp_c: f64,
}

/// The largest force that is taken for one, N: a million times that of a damper.
const MOST_N: f64 = 1e9;

/// Displacement path of a lane: conditioning, its memory, and how long it has been settling.
#[derive(Debug, Clone, PartialEq)]
struct Front {
    conditioning: Conditioning,
    low_pass: LowPass,
    motion: MotionState,
    settled_s: f64,
    /// What the last displacement made; `None` when it made none.
    inputs: Option<Inputs>,
}

impl Front {
    fn new(conditioning: Conditioning) -> Self {
        Self {
            conditioning,
            low_pass: conditioning.low_pass(),
            motion: MotionState::default(),
            settled_s: 0.0,
            inputs: None,
        }
    }

    #[inline]
    fn step(&mut self, given: &Given, reasons: &mut Reasons) -> Option<Inputs> {
        self.settled_s = given.dt_s.map_or(0.0, |dt| self.settled_s + dt);
        if self.settled_s < self.conditioning.settling_time().get() || given.dt_s.is_none() {
            *reasons |= Reasons::SETTLING;
        }
        let motion = self.conditioning.step(
            &self.low_pass,
            &mut self.motion,
            given.dt_s,
            given.displacement_m,
            given.measured_velocity_m_s,
        );
        self.inputs = motion.map(|motion| Inputs {
            dt_s: given.dt_s,
            displacement_m: motion.displacement_m,
            velocity_m_s: motion.velocity_m_s,
            acceleration_m_s2: motion.acceleration_m_s2,
            drive: given.drive,
            case_temp_c: given.case_temp_c,
        });
        self.inputs
    }

    /// Conditioned velocity at the last displacement, m/s; NaN when there was none.
    fn velocity_m_s(&self) -> f64 {
        self.inputs.map_or(f64::NAN, |inputs| inputs.velocity_m_s)
    }
}

/// True when a model that wants a drive has one.
fn drive_is_there(model: &ForceModel, given: &Given) -> bool {
    model.drive().is_none() || given.drive.is_finite()
}

/// False for what a model says that has blown up. No damper has such a force, and its square would stay in the residual's figures.
fn is_a_force(force_n: f64) -> bool {
    force_n.abs() <= MOST_N
}

fn outside(model: &Model, inputs: &Inputs) -> bool {
    let envelope = &model.envelope;
    Envelope::leaves(envelope.displacement_m, inputs.displacement_m)
        || Envelope::leaves(envelope.velocity_m_s, inputs.velocity_m_s)
        || (model.force.drive().is_some() && Envelope::leaves(envelope.drive, inputs.drive))
        || (Envelope::leaves(envelope.case_temp_c, inputs.case_temp_c)
            && model.effects.need(Need::CaseTemperature))
}

/// The lane that never sees measured force.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FreeLane {
    model: Model,
    front: Front,
    state: AugmentedState,
    output_filter: LowPassState,
    /// The measured force's own copy of the output filter, so that like is compared with like.
    force_filter: LowPassState,
    fresh_output: bool,
    fresh_force: bool,
}

impl FreeLane {
    pub(super) fn new(model: Model) -> Result<Self, Error> {
        model.conditioning.validate()?;
        model.effects.check(&model.force)?;
        refuse_filtered_arx(&model)?;
        Ok(Self {
            front: Front::new(model.conditioning),
            state: AugmentedState::default(),
            output_filter: LowPassState::default(),
            force_filter: LowPassState::default(),
            fresh_output: true,
            fresh_force: true,
            model,
        })
    }

    /// Conditioned inputs of the last step; `None` while there are none.
    pub(super) const fn inputs(&self) -> Option<Inputs> {
        self.front.inputs
    }

    pub(super) const fn model(&self) -> &Model {
        &self.model
    }

    /// Conditioned velocity at the last displacement, m/s; NaN when there was none.
    pub(super) fn velocity_m_s(&self) -> f64 {
        self.front.velocity_m_s()
    }

    /// Root mean squared error to expect when running free, N.
    pub(super) fn expected_rsse_n(&self) -> Option<f64> {
        self.model.expected.free_run_rsse_n
    }

    /// Takes over what `old` remembers, as far as it means the same here.
    pub(super) fn inherit(&mut self, old: &Self) {
        if self.model.conditioning == old.model.conditioning {
            self.front = old.front.clone();
            // An effect's memory means the same for another strength of it, but not for another effect.
            self.state = if self.model.effects.same_kinds(&old.model.effects) {
                old.state
            } else {
                old.state.without_effects()
            };
            self.output_filter = old.output_filter;
            self.force_filter = old.force_filter;
            self.fresh_output = old.fresh_output;
            self.fresh_force = old.fresh_force;
        }
    }

    pub(super) fn reset(&mut self) {
        self.front = Front::new(self.model.conditioning);
        self.state = AugmentedState::default();
        self.fresh_output = true;
        self.fresh_force = true;
    }

    /// The free-run force in newtons, or `None` when the model cannot run.
    #[inline]
    pub(super) fn step(&mut self, given: &Given, reasons: &mut Reasons) -> Option<f64> {
        if given.dt_s.is_none() {
            self.reset();
        }
        let inputs = self.front.step(given, reasons);
        if !drive_is_there(&self.model.force, given) {
            *reasons |= Reasons::DRIVE_MISSING;
            return None;
        }
        if given.case_temp_c.is_nan() && self.model.effects.need(Need::CaseTemperature) {
            *reasons |= Reasons::TEMPERATURE_MISSING;
        }
        let inputs = inputs?;
        if outside(&self.model, &inputs) {
            *reasons |= Reasons::OUTSIDE_ENVELOPE;
        }
        let raw_n = self.model.free_run(&mut self.state, &inputs).filter(|f| is_a_force(*f))?;
        let mut force_n = raw_n;
        if self.model.conditioning.apply_to == ApplyTo::Output {
            let dt_s = given.dt_s.filter(|_| !self.fresh_output);
            self.fresh_output = false;
            force_n = self.front.low_pass.step(&mut self.output_filter, dt_s, raw_n);
        }
        // The low-pass remembers forces beyond the range when the model itself is back in it.
        if [raw_n, force_n].into_iter().any(|n| Envelope::leaves(self.model.envelope.force_n, n)) {
            *reasons |= Reasons::OUTSIDE_ENVELOPE;
        }
        Some(force_n)
    }

    /// The next measured force is the first of a stretch with predictions.
    pub(super) fn restart_comparison(&mut self) {
        self.fresh_force = true;
    }

    /// The measured force as it compares with this lane's: low-passed where the output is.
    #[inline]
    pub(super) fn comparable_force(&mut self, dt_s: Option<f64>, measured_n: f64) -> f64 {
        if self.model.conditioning.apply_to != ApplyTo::Output {
            return measured_n;
        }
        let dt_s = dt_s.filter(|_| !self.fresh_force);
        self.fresh_force = false;
        self.front.low_pass.step(&mut self.force_filter, dt_s, measured_n)
    }
}

/// The lane that is fed with measured force: an ARX model, or another that feeds on force.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SeededLane {
    model: Model,
    front: Front,
    history: History,
    /// The sample period that the model holds at, s.
    nominal_s: f64,
    /// Mean sample period of the last samples, s, and how many it is the mean of.
    period_s: f64,
    periods: u32,
}

impl SeededLane {
    /// Samples that the mean period is taken over.
    const PERIODS: u32 = 50;
    /// Departure of the mean period from the model's beyond which its coefficients mean nothing.
    const PERIOD_TOLERANCE: f64 = 0.05;
    /// Step over period beyond which a sample was lost and the lags no longer fit.
    const LOST_SAMPLE: f64 = 1.6;

    /// A lane for `model`, or `None` when it does not feed on force.
    pub(super) fn new(model: Model) -> Result<Option<Self>, Error> {
        model.conditioning.validate()?;
        if !model.feeds_on_force() {
            return Ok(None);
        }
        let Some(nominal) = model.force.force_fed_period() else { return Ok(None) };
        refuse_filtered_arx(&model)?;
        Ok(Some(Self {
            model,
            front: Front::new(model.conditioning),
            history: History::default(),
            nominal_s: nominal.get(),
            period_s: nominal.get(),
            periods: 0,
        }))
    }

    pub(super) const fn model(&self) -> &Model {
        &self.model
    }

    /// Conditioned velocity at the last displacement, m/s; NaN when there was none.
    pub(super) fn velocity_m_s(&self) -> f64 {
        self.front.velocity_m_s()
    }

    /// Root mean squared error to expect one step ahead, N.
    pub(super) fn expected_rsse_n(&self) -> Option<f64> {
        self.model.expected.one_step_rsse_n
    }

    /// Takes over what `old` remembers, as far as it means the same here.
    pub(super) fn inherit(&mut self, old: &Self) {
        if self.model.conditioning == old.model.conditioning && self.nominal_s == old.nominal_s {
            self.front = old.front.clone();
            self.history = old.history;
            self.period_s = old.period_s;
            self.periods = old.periods;
        }
    }

    pub(super) fn reset(&mut self) {
        self.front = Front::new(self.model.conditioning);
        self.history = History::default();
        self.period_s = self.nominal_s;
        self.periods = 0;
    }

    /// Makes only measured forces able to make the lane ready again.
    pub(super) fn forget_forces(&mut self) {
        self.history.forget_forces();
    }

    /// Puts the measured force of `age` samples before the newest into the history.
    #[inline]
    pub(super) fn seed(&mut self, age: usize, force_n: f64) {
        self.history.seed(age, force_n);
    }

    /// The predicted force in newtons, or `None` while the history does not carry one.
    #[inline]
    pub(super) fn step(&mut self, given: &Given, reasons: &mut Reasons) -> Option<f64> {
        match given.dt_s {
            None => self.reset(),
            Some(dt_s) => {
                self.periods = (self.periods + 1).min(Self::PERIODS);
                self.period_s += (dt_s - self.period_s) / f64::from(self.periods);
                if dt_s > Self::LOST_SAMPLE * self.nominal_s {
                    self.history = History::default();
                }
            }
        }
        match self.front.step(given, reasons) {
            Some(inputs) => {
                if outside(&self.model, &inputs) {
                    *reasons |= Reasons::OUTSIDE_ENVELOPE;
                }
                self.history.push_inputs(&inputs);
            }
            None => self.history.push_unknown_inputs(),
        }
        let at_rate = (self.period_s / self.nominal_s - 1.0).abs() <= Self::PERIOD_TOLERANCE;
        if !at_rate {
            *reasons |= Reasons::RATE_MISMATCH;
        }
        let predicted =
            self.model.force.predict_n(&self.history).filter(|force_n| at_rate && is_a_force(*force_n));
        if predicted.is_some_and(|force_n| Envelope::leaves(self.model.envelope.force_n, force_n)) {
            *reasons |= Reasons::OUTSIDE_ENVELOPE;
        }
        self.history.push_force(predicted.unwrap_or(f64::NAN));
        predicted
    }
}

/// A filter behind a model that feeds on force would be fed back into it with its delay: the coefficients would
/// no longer fit.
fn refuse_filtered_arx(model: &Model) -> Result<(), Error> {
    if model.force.force_fed_period().is_some() && model.conditioning.apply_to == ApplyTo::Output {
        return Err(Error::output_filter_on_force_fed(model.force.name()));
    }
    Ok(())
}
