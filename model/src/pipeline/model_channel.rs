//! The two channels of a pipeline, free-run and seeded: each has one model with its own conditioning and state.

use super::Awaiting;
use super::event::Reasons;
use super::resample::{POINTS, Row, Rows, SAME};
use super::rhythm::Rhythm;
use crate::condition::{ApplyTo, Conditioning, ForceAligner, LowPass, LowPassState, MotionState};
use crate::effect::{AugmentedState, Effects, Need};
use crate::error::{Error, PipelineError};
use crate::force::{DEPTH, ForceModel, History, Inputs, Learning};
use crate::model::{Envelope, Model};
use crate::sample::Stamp;

/// Inputs of both channels at a displacement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ChannelInputs {
    /// Time since the displacement before, s; `None` after a reset or a gap.
    pub(super) dt_s: Option<f64>,
    pub(super) displacement_m: f64,
    pub(super) measured_velocity_m_s: Option<f64>,
    /// Current, A, or voltage, V; NaN if there is none.
    pub(super) drive: f64,
    /// NaN if not known.
    pub(super) case_temp_c: f64,
}

/// Largest force that is accepted from a model, N: a million times the force of a damper.
const MOST_N: f64 = 1e9;

/// Displacement path of a channel: conditioning, its state, and how long it has been settling.
#[derive(Debug, Clone, PartialEq)]
struct DisplacementPath {
    conditioning: Conditioning,
    low_pass: LowPass,
    motion: MotionState,
    settled_s: f64,
    /// Model inputs at the last displacement; `None` if the conditioning gave none.
    inputs: Option<Inputs>,
}

impl DisplacementPath {
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
    fn step(&mut self, given: &ChannelInputs, reasons: &mut Reasons) -> Option<Inputs> {
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

/// True if the model has the drive that it needs.
fn drive_is_there(model: &ForceModel, given: &ChannelInputs) -> bool {
    model.drive().is_none() || given.drive.is_finite()
}

/// False for the output of a model that has diverged. No damper has such a force, and its square would stay in the residual's figures.
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

/// Low-pass of a force, if the conditioning filters the model's output.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct OutputFilter {
    state: LowPassState,
    /// False until the first force after a restart.
    is_running: bool,
}

impl OutputFilter {
    fn restart(&mut self) {
        self.is_running = false;
    }

    #[inline]
    fn step(&mut self, path: &DisplacementPath, dt_s: Option<f64>, force_n: f64) -> f64 {
        if path.conditioning.apply_to != ApplyTo::Output {
            return force_n;
        }
        let dt_s = dt_s.filter(|_| self.is_running);
        self.is_running = true;
        path.low_pass.step(&mut self.state, dt_s, force_n)
    }
}

/// A simulation of a force model with effects.
#[derive(Debug, Clone, PartialEq)]
struct Simulation {
    effects: Effects,
    state: AugmentedState,
    filter: OutputFilter,
}

impl Simulation {
    fn new(effects: Effects) -> Self {
        Self { effects, state: AugmentedState::default(), filter: OutputFilter::default() }
    }

    fn reset(&mut self) {
        self.state = AugmentedState::default();
        self.filter.restart();
    }

    /// The force, N, before and after the output filter; `None` if the model has no force.
    #[inline]
    fn step(&mut self, force: &ForceModel, path: &DisplacementPath, inputs: &Inputs) -> Option<[f64; 2]> {
        let raw_n =
            self.effects.free_run(force, &mut self.state, inputs).filter(|force_n| is_a_force(*force_n))?;
        Some([raw_n, self.filter.step(path, inputs.dt_s, raw_n)])
    }
}

/// The forces of the free-run channel at a sample, N; `None` where the model gives no force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SimulatedForces {
    /// Force of the damper: the model without the effects of the load cell.
    pub(super) damper_n: Option<f64>,
    /// Expected reading of the load cell: the model with all its effects.
    pub(super) reading_n: Option<f64>,
}

impl SimulatedForces {
    const NONE: Self = Self { damper_n: None, reading_n: None };
}

/// The free-run channel: a simulation that never uses measured force.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FreeRunChannel {
    model: Model,
    path: DisplacementPath,
    /// The model without the effects of the load cell.
    damper: Simulation,
    /// The whole model; `None` if it has no effect of the load cell, so that the reading is the damper's force. It repeats the
    /// damper's steps in a state of its own, so that models without effects of the load cell pay nothing.
    reading: Option<Simulation>,
    /// Output filter of the measured force, so that filtered forces are compared with filtered forces.
    measured_filter: OutputFilter,
    /// The model with what it has learned from measured force; `None` if it does not learn.
    learning: Option<Learning>,
}

impl FreeRunChannel {
    /// A channel at rest. A model that `learns` must be a [`ForceModel::Lazy`] without effects.
    pub(super) fn new(model: Model, learns: bool) -> Result<Self, Error> {
        model.conditioning.validate()?;
        model.effects.check(&model.force)?;
        if learns && !model.effects.is_empty() {
            return Err(PipelineError::LearningWithEffects.into());
        }
        let learning = match &model.force {
            ForceModel::Lazy(lazy) if learns => Some(Learning::new(lazy)),
            other if learns => return Err(PipelineError::CannotLearn { model: other.name() }.into()),
            _ => None,
        };
        refuse_filtered_arx(&model)?;
        Ok(Self {
            path: DisplacementPath::new(model.conditioning),
            damper: Simulation::new(model.effects.of_damper()),
            reading: model.effects.include_load_cell().then(|| Simulation::new(model.effects)),
            measured_filter: OutputFilter::default(),
            model,
            learning,
        })
    }

    /// Takes over whether `new`, a channel of the same model, learns. What was learned stays, unless it learns `anew`.
    pub(super) fn take_learning(&mut self, new: Option<Learning>, anew: bool) {
        if anew || self.learning.is_some() != new.is_some() {
            self.learning = new;
        }
    }

    /// The state of learning, to be taken over by a channel of the same model.
    pub(super) fn into_learning(self) -> Option<Learning> {
        self.learning
    }

    /// Puts the loaded memory in place of the learned one.
    pub(super) fn forget_learned(&mut self) {
        if let (Some(learning), ForceModel::Lazy(lazy)) = (&mut self.learning, &self.model.force) {
            *learning = Learning::new(lazy);
        }
    }

    /// Learns the measured force at the given conditioned inputs, if the model learns.
    #[inline]
    pub(super) fn learn(&mut self, [x_m, v_m_s, drive]: [f64; 3], measured_n: f64) {
        if let Some(learning) = &mut self.learning {
            learning.learn(x_m, v_m_s, drive, measured_n);
        }
    }

    /// Conditioned inputs of the last step; `None` if there are none.
    pub(super) const fn inputs(&self) -> Option<Inputs> {
        self.path.inputs
    }

    pub(super) const fn model(&self) -> &Model {
        &self.model
    }

    /// Conditioned velocity at the last displacement, m/s; NaN when there was none.
    pub(super) fn velocity_m_s(&self) -> f64 {
        self.path.velocity_m_s()
    }

    /// Expected RMSE of the simulation, N. The thesis calls it RSSE.
    pub(super) fn expected_rsse_n(&self) -> Option<f64> {
        self.model.expected.free_run_rsse_n
    }

    /// Takes over what `old` remembers, as far as it means the same here.
    pub(super) fn inherit(&mut self, old: &Self) {
        if self.model.conditioning != old.model.conditioning {
            return;
        }
        self.path = old.path.clone();
        self.measured_filter = old.measured_filter;
        // The state of an effect is valid for another strength of the same effect, but not for another effect.
        self.damper.state = if self.damper.effects.same_kinds(&old.damper.effects) {
            old.damper.state
        } else {
            old.damper.state.without_effects()
        };
        self.damper.filter = old.damper.filter;
        if let Some(reading) = &mut self.reading {
            // The effects of the damper come first in both, so the damper's state is valid for the reading.
            let same = old.reading.as_ref().filter(|old| reading.effects.same_kinds(&old.effects));
            let from = same.unwrap_or(&self.damper);
            (reading.state, reading.filter) = (from.state, from.filter);
        }
    }

    pub(super) fn reset(&mut self) {
        self.path = DisplacementPath::new(self.model.conditioning);
        self.damper.reset();
        if let Some(reading) = &mut self.reading {
            reading.reset();
        }
        self.measured_filter.restart();
    }

    /// The simulated forces. The reasons apply to the damper's force.
    #[inline]
    pub(super) fn step(&mut self, given: &ChannelInputs, reasons: &mut Reasons) -> SimulatedForces {
        if given.dt_s.is_none() {
            self.reset();
        }
        let inputs = self.path.step(given, reasons);
        if !drive_is_there(&self.model.force, given) {
            *reasons |= Reasons::DRIVE_MISSING;
            return SimulatedForces::NONE;
        }
        if given.case_temp_c.is_nan() && self.model.effects.need(Need::CaseTemperature) {
            *reasons |= Reasons::TEMPERATURE_MISSING;
        }
        let Some(inputs) = inputs else { return SimulatedForces::NONE };
        if outside(&self.model, &inputs) {
            *reasons |= Reasons::OUTSIDE_ENVELOPE;
        }
        let force = self.learning.as_ref().map_or(&self.model.force, Learning::force);
        let damper = self.damper.step(force, &self.path, &inputs);
        if self.damper.state.extrapolates() {
            *reasons |= Reasons::OUTSIDE_ENVELOPE;
        }
        // The low-pass may still hold forces outside the range when the model is back inside it.
        if damper.is_some_and(|forces_n| {
            forces_n.into_iter().any(|n| Envelope::leaves(self.model.envelope.force_n, n))
        }) {
            *reasons |= Reasons::OUTSIDE_ENVELOPE;
        }
        let reading = match &mut self.reading {
            None => damper,
            Some(reading) => reading.step(force, &self.path, &inputs),
        };
        let filtered_n = |[_, force_n]: [f64; 2]| force_n;
        SimulatedForces { damper_n: damper.map(filtered_n), reading_n: reading.map(filtered_n) }
    }

    /// Restarts the filter of the measured force: the next measured force is the first of a stretch with predictions.
    pub(super) fn restart_comparison(&mut self) {
        self.measured_filter.restart();
    }

    /// The measured force for comparison with the expected reading, N: low-passed if the output is.
    #[inline]
    pub(super) fn comparable_force(&mut self, dt_s: Option<f64>, measured_n: f64) -> f64 {
        self.measured_filter.step(&self.path, dt_s, measured_n)
    }
}

/// The seeded channel: it gets measured force. Its model is autoregressive in force (ARX or another such model).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SeededChannel {
    model: Model,
    path: DisplacementPath,
    /// The last samples. They are the model's lags while samples come at even times.
    history: History,
    /// The same samples with their times. The lags are interpolated from them while samples come at uneven times.
    rows: Rows,
    rhythm: Rhythm,
    /// The force at the last sample was measured.
    last_is_measured: bool,
    /// Time since the last reset, s.
    now_s: f64,
    /// Remaining time in which the lags reach over many lost samples, s.
    bridged_s: f64,
}

impl SeededChannel {
    /// Longest step in which rows are inserted, s, and its bounds in periods: it covers a publisher that pauses for a moment. A longer
    /// step clears the lags.
    const BRIDGED_S: f64 = 0.025;
    const BRIDGED: [f64; 2] = [10.5, 50.5];
    /// Periods between two samples beyond which the inserted rows are reported as worse than samples.
    const FEW_BRIDGED: f64 = 3.5;

    /// A channel for `model`; `None` if the model is not autoregressive in force.
    pub(super) fn new(model: Model) -> Result<Option<Self>, Error> {
        model.conditioning.validate()?;
        if !model.feeds_on_force() {
            return Ok(None);
        }
        let Some(nominal) = model.force.force_fed_period() else { return Ok(None) };
        refuse_filtered_arx(&model)?;
        Ok(Some(Self {
            model,
            path: DisplacementPath::new(model.conditioning),
            history: History::default(),
            rows: Rows::default(),
            rhythm: Rhythm::new(nominal.get()),
            last_is_measured: false,
            now_s: 0.0,
            bridged_s: 0.0,
        }))
    }

    pub(super) const fn model(&self) -> &Model {
        &self.model
    }

    /// Conditioned velocity at the last displacement, m/s; NaN when there was none.
    pub(super) fn velocity_m_s(&self) -> f64 {
        self.path.velocity_m_s()
    }

    /// Expected RMSE of the one-step-ahead prediction, N. The thesis calls it RSSE.
    pub(super) fn expected_rsse_n(&self) -> Option<f64> {
        self.model.expected.one_step_rsse_n
    }

    /// Takes over what `old` remembers, as far as it means the same here.
    pub(super) fn inherit(&mut self, old: &Self) {
        if self.model.conditioning == old.model.conditioning
            && self.rhythm.nominal_s() == old.rhythm.nominal_s()
        {
            *self = Self { model: self.model, ..old.clone() };
        }
    }

    pub(super) fn reset(&mut self) {
        self.path = DisplacementPath::new(self.model.conditioning);
        self.rhythm = Rhythm::new(self.rhythm.nominal_s());
        self.start_anew();
    }

    /// Forgets the lags.
    fn start_anew(&mut self) {
        self.history = History::default();
        self.rows.clear();
        (self.now_s, self.bridged_s) = (0.0, 0.0);
    }

    /// Clears all forces: only measured ones can make the channel ready again.
    pub(super) fn forget_forces(&mut self) {
        self.history.forget_forces();
        self.rows.forget_forces();
    }

    /// Puts the measured force of the sample `age` samples before the newest into the history.
    #[inline]
    pub(super) fn seed(&mut self, age: usize, force_n: f64) {
        self.history.seed(age, force_n);
        self.rows.seed(age, force_n);
        self.last_is_measured |= age == 0;
    }

    /// The predicted force, N; `None` while the history is not complete.
    #[inline]
    pub(super) fn step(
        &mut self,
        given: &ChannelInputs,
        measured: &MeasuredForce<'_>,
        reasons: &mut Reasons,
    ) -> Option<f64> {
        match given.dt_s {
            None => self.reset(),
            Some(dt_s) => self.pass_time(dt_s),
        }
        let row = self.take_inputs(given, reasons);
        let at_rate = self.rhythm.is_at_rate();
        if !at_rate {
            *reasons |= Reasons::RATE_MISMATCH;
        }
        if self.bridged_s > 0.0 {
            *reasons |= Reasons::SETTLING;
        }
        let is_even = self.rhythm.is_even();
        if at_rate && !is_even {
            self.bridge(&row, measured);
        }
        self.rows.push(row);
        let samples_are_lags = is_even && !self.is_measured_since_last(measured);
        let history = if samples_are_lags { self.history } else { self.lags(self.now_s, measured) };
        let predicted =
            self.model.force.predict_n(&history).filter(|force_n| at_rate && is_a_force(*force_n));
        if predicted.is_some_and(|force_n| Envelope::leaves(self.model.envelope.force_n, force_n)) {
            *reasons |= Reasons::OUTSIDE_ENVELOPE;
        }
        self.history.push_force(predicted.unwrap_or(f64::NAN));
        self.last_is_measured = false;
        self.rows.set_newest_force(predicted.unwrap_or(f64::NAN));
        predicted
    }

    /// Advances time by `dt_s`, the step from the sample before.
    #[inline]
    fn pass_time(&mut self, dt_s: f64) {
        self.rhythm.see(dt_s);
        let nominal_s = self.rhythm.nominal_s();
        let [least, most] = Self::BRIDGED.map(|periods| periods * nominal_s);
        if dt_s > Self::BRIDGED_S.clamp(least, most) {
            self.start_anew();
            return;
        }
        self.now_s += dt_s;
        self.bridged_s -= dt_s;
        if dt_s > Self::FEW_BRIDGED * nominal_s {
            self.bridged_s = DEPTH as f64 * nominal_s;
        }
    }

    /// Conditions the inputs and puts them into the history. The returned row has no force yet.
    #[inline]
    fn take_inputs(&mut self, given: &ChannelInputs, reasons: &mut Reasons) -> Row {
        let inputs = self.path.step(given, reasons);
        match &inputs {
            Some(inputs) => {
                if outside(&self.model, inputs) {
                    *reasons |= Reasons::OUTSIDE_ENVELOPE;
                }
                self.history.push_inputs(inputs);
            }
            None => self.history.push_unknown_inputs(),
        }
        Row {
            at_s: self.now_s,
            displacement_m: inputs.map_or(f64::NAN, |inputs| inputs.displacement_m),
            velocity_m_s: inputs.map_or(f64::NAN, |inputs| inputs.velocity_m_s),
            drive: given.drive,
            force_n: f64::NAN,
            is_between: false,
        }
    }

    /// Inserts rows between the last sample and `row` if they are more than a period apart.
    fn bridge(&mut self, row: &Row, measured: &MeasuredForce<'_>) {
        let period_s = self.rhythm.nominal_s();
        while let Some(last) = self.rows.newest()
            && row.at_s - last.at_s > (1.0 + SAME) * period_s
        {
            let at_s = last.at_s + period_s;
            let Some(between) = self.rows.towards(row, at_s, period_s) else { return };
            self.rows.push(between);
            let predicted =
                || self.model.force.predict_n(&self.lags(at_s, measured)).filter(|n| is_a_force(*n));
            let force_n = measured.at(row.at_s - at_s).or_else(predicted);
            self.rows.set_newest_force(force_n.unwrap_or(f64::NAN));
        }
    }

    /// The lags at `at_s`: inputs are interpolated from the rows, forces are measured ones. A force after the newest reading is predicted
    /// from the forces before it, plus the prediction's error at that reading. This error fades linearly to zero at a distance of one
    /// period.
    fn lags(&self, at_s: f64, measured: &MeasuredForce<'_>) -> History {
        let velocity = self.model.conditioning.velocity;
        let period_s = self.rhythm.nominal_s();
        let mut grid = self.rows.grid(at_s, period_s);
        let Some((newest_ago_s, newest_n)) = measured.newest() else { return grid.history(0, velocity) };
        let newest_s = self.now_s - newest_ago_s;
        let is_missing = newest_s < grid.points[1].at_s - SAME * period_s;
        let lacked_n = if is_missing { self.lacked_n(newest_s, newest_n, measured) } else { 0.0 };
        for lag in (1..POINTS).rev() {
            let point_s = grid.points[lag].at_s;
            let force_n = measured.at(self.now_s - point_s).or_else(|| {
                let is_next =
                    point_s > newest_s && lag + 1 < POINTS && newest_s >= grid.points[POINTS - 1].at_s;
                let predicted =
                    self.model.force.predict_n(&grid.history(lag, velocity)).filter(|_| is_next)?;
                let fade = (1.0 - (point_s - newest_s) / period_s).max(0.0);
                Some(predicted + fade * lacked_n)
            });
            if let Some(force_n) = force_n.filter(|force_n| is_a_force(*force_n)) {
                grid.points[lag].force_n = force_n;
            }
        }
        grid.history(0, velocity)
    }

    /// True if a reading is newer than all forces that are known at the samples' own times.
    fn is_measured_since_last(&self, measured: &MeasuredForce<'_>) -> bool {
        let is_late = |(ago_s, _)| ago_s < (2.0 - SAME) * self.rhythm.nominal_s();
        !self.last_is_measured && measured.newest().is_some_and(is_late)
    }

    /// Error of the prediction at the reading `force_n` at `at_s`: reading minus prediction, N; zero without a prediction.
    fn lacked_n(&self, at_s: f64, force_n: f64, measured: &MeasuredForce<'_>) -> f64 {
        let mut grid = self.rows.grid(at_s, self.rhythm.nominal_s());
        for point in &mut grid.points[1..] {
            point.force_n = measured.at(self.now_s - point.at_s).unwrap_or(point.force_n);
        }
        let predicted = self.model.force.predict_n(&grid.history(0, self.model.conditioning.velocity));
        predicted.filter(|predicted| is_a_force(*predicted)).map_or(0.0, |predicted| force_n - predicted)
    }
}

/// Access to measured force for a channel.
#[derive(Clone, Copy)]
pub(super) struct MeasuredForce<'a> {
    pub(super) readings: &'a ForceAligner<Awaiting>,
    pub(super) now: Stamp,
    /// Largest distance of two readings between which force is interpolated, s.
    pub(super) max_span_s: f64,
}

impl MeasuredForce<'_> {
    /// The force `ago_s` before now, N; `None` if the readings do not determine it.
    fn at(&self, ago_s: f64) -> Option<f64> {
        self.readings.measured_on_curve(self.now.shifted((-1e9 * ago_s).round() as i64), self.max_span_s)
    }

    /// The newest reading that is not newer than now: its age, s, and the force, N.
    fn newest(&self) -> Option<(f64, f64)> {
        self.readings.newest(self.now).map(|(at, force_n)| (self.now.since(at).get(), force_n))
    }
}

/// Refuses an output filter on a model that is autoregressive in force. The filter's delay would be fed back into the model, and the
/// coefficients would no longer fit.
fn refuse_filtered_arx(model: &Model) -> Result<(), Error> {
    if model.force.force_fed_period().is_some() && model.conditioning.apply_to == ApplyTo::Output {
        return Err(Error::OutputFilter { model: model.force.name() });
    }
    Ok(())
}
