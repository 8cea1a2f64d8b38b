//! The pipeline: it turns samples into force estimates and residuals. Live and replayed results are bit-identical.
//!
//! ```text
//!                    ┌─ gate ─┐   ┌ free-run:    condition → model → (filter) ───────┬─ bumpless ─→ Estimate
//!  Sample ──────────→│ refuse │──→│                                                  │     ↑
//!                    └────────┘   └ seeded:      condition → ARX ← measured force ───┘   mode
//!                        │                measured force ─ align ─ minus free run ───────────────→ Residual
//!                        ├─→ plausibility checks of the readings ──→ reasons, mode
//!                        └─→ control law: demanded force ──→ inverse of the free-run model ──────→ Command
//! ```
//!
//! Each displacement sample yields an estimate at once, with the newest drive (current or voltage) that is not newer than the
//! sample. The residual follows when the measured force at the same stamp is known. Two channels run side by side. The
//! **free-run channel** simulates its model (free run) and never uses measured force, so its residual shows what the model
//! lacks. It has two outputs: the damper's force, and the expected reading of the load cell, which also contains the effects of the
//! load cell (such as its drift). The estimate and the command use the force, and the residual uses the reading. The
//! **seeded channel** predicts one step ahead from measured force (ARX). That hides model errors, so the residual
//! is never taken from it. The [`Mode`] says which channel the estimate comes from.
//!
//! [`Pipeline::step`] reads no clock, does not allocate, takes no lock and makes no system call. It knows time from the
//! stamps alone, and only their differences count. [`Pipeline::tick`] is called by a live node and not by a replay: it
//! detects that displacement has stopped. It changes only what the next displacement would change anyway, so results stay the
//! same.

#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod alarm;
mod bump;
mod command;
mod estimate;
mod estimate_uncertainty;
mod event;
mod gate;
mod mode;
mod model_channel;
mod observer;
mod plausible;
mod resample;
mod rhythm;
mod settings;
mod setup;
mod window;

pub(crate) use estimate_uncertainty::BEYOND_CALIBRATION;
pub use event::{
    AlarmChange, Cause, Estimate, Event, Reasons, Refusal, Refused, Residual, Slot, StampedCommand,
    Transition, Validity,
};
pub use mode::Mode;
pub use plausible::Plausible;
pub use settings::{Settings, UseForce};
pub use setup::PipelineSetup;

use crate::condition::{ForceAligner, Hold, Timing};
use crate::error::{Error, PipelineError};
use crate::model::Model;
use crate::sample::{Reading, Sample, Stamp};
use crate::uncertainty::Operating;
use crate::units::{Newton, Second};
use alarm::{Alarm, Edge};
use bump::Bump;
use command::CommandPath;
use estimate_uncertainty::{EstimateUncertainty, Seeds};
use gate::Gate;
use mode::ModeMachine;
use model_channel::{FreeRunChannel, SeededChannel};
use observer::Observer;
use plausible::{DamperProperties, PlausibilityChecks};
use window::Window;

/// The models that a pipeline runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Models {
    /// The free-run model: always simulated without measured force. The residual is its error.
    pub free: Model,
    /// The model that predicts from measured force while that is fresh. It must be autoregressive in force (ARX). `None`:
    /// there is none.
    pub seeded: Option<Model>,
}

impl Models {
    /// The models for `free` alone. It is also the seeded model if it is autoregressive in force (ARX) and has no effects.
    #[must_use]
    pub fn alone(free: Model) -> Self {
        let seeded = free.feeds_on_force().then_some(free);
        Self { free, seeded }
    }

    /// The same models with another seeded one.
    ///
    /// # Errors
    /// When `seeded` is not autoregressive in force, has effects, or needs another kind of drive than the free-run model.
    pub fn with_seeded(self, seeded: Model) -> Result<Self, Error> {
        if seeded.force.force_fed_period().is_none() {
            return Err(PipelineError::NotSeedable { model: seeded.force.name() }.into());
        }
        if !seeded.effects.is_empty() {
            return Err(PipelineError::SeededWithEffects.into());
        }
        if let (Some(free), Some(arx)) = (self.free.force.drive(), seeded.force.drive())
            && free != arx
        {
            return Err(PipelineError::DifferentDrives { free, seeded: arx }.into());
        }
        Ok(Self { seeded: Some(seeded), ..self })
    }
}

impl From<PipelineSetup> for Pipeline {
    /// A pipeline at rest.
    fn from(setup: PipelineSetup) -> Self {
        let PipelineSetup { settings, free, seeded, controller, learns_anew: _ } = setup;
        Self {
            damper: DamperProperties::of(free.model(), &settings.limits),
            settings,
            gate: Gate::default(),
            free,
            seeded,
            drive: Hold::default(),
            velocity: Hold::default(),
            temperature: Hold::default(),
            force: ForceAligner::default(),
            displacement_timing: Timing::default(),
            force_timing: Timing::default(),
            machine: ModeMachine::default(),
            bump: Bump::default(),
            observer: Observer::default(),
            checks: PlausibilityChecks::default(),
            command_path: CommandPath::new(controller),
            free_at: None,
            seeded_at: None,
            last_uncertainty: EstimateUncertainty::NONE,
            last_estimated: None,
            window: Window::default(),
            alarm: Alarm::default(),
            index: 0,
            last_displacement: None,
            last_taken: None,
            last_received: None,
            last_force: None,
            seeds: Seeds::default(),
            last_stale_report: None,
            pending: Reasons::NONE,
        }
    }
}

/// A prediction whose measured force is not known yet.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Awaiting {
    /// Stamp of the displacement.
    stamp: Stamp,
    /// Expected reading of the load cell; NaN if there is none.
    predicted_n: f64,
    /// That reading minus the damper's force, N.
    load_cell_n: f64,
    dt_s: Option<f64>,
    index: u64,
    /// The model had all its inputs, so the residual counts for the alarm.
    counts: bool,
    /// Displacement, m, and drive that the model was given, if the sample can be learned; NaN otherwise.
    learned_at: [f64; 2],
    /// Velocity that the model was given, m/s; NaN if it had none.
    velocity_m_s: f64,
    /// Force of the damper at rest at that displacement, N.
    rest_n: f64,
}

/// The pipeline of one damper.
///
/// ```
/// use mr_damper_model::pipeline::{Event, Mode, Models, Pipeline, Settings};
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let mut pipeline = Pipeline::new(Models::alone(preset::load(preset::BEST_FUZZY_TANH)?), Settings::default())?;
/// let run = record(&Experiment::sine(0.01, 1.0, 1.2, 2.0), &Plant::default(), &Channels::default(), 1);
/// let (mut estimates, mut residuals) = (0, 0);
/// for sample in run.samples() {
///     pipeline.step(&sample, &mut |event| match event {
///         Event::Estimate(_) => estimates += 1,
///         Event::Residual(_) => residuals += 1,
///         _ => {}
///     });
/// }
/// // Each displacement yields an estimate. Residuals begin when the filters of the model have settled.
/// assert_eq!((estimates, pipeline.mode()), (run.displacement_m.len(), Mode::Model));
/// assert!(residuals > 900);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Pipeline {
    settings: Settings,
    gate: Gate,
    free: FreeRunChannel,
    seeded: Option<SeededChannel>,
    drive: Hold,
    velocity: Hold,
    temperature: Hold,
    force: ForceAligner<Awaiting>,
    displacement_timing: Timing,
    force_timing: Timing,
    machine: ModeMachine,
    bump: Bump,
    observer: Observer,
    damper: DamperProperties,
    checks: PlausibilityChecks,
    command_path: CommandPath,
    /// Operating points of the two channels at the last displacement.
    free_at: Option<Operating>,
    seeded_at: Option<Operating>,
    /// Uncertainty and stamp of the last estimate that came from a model.
    last_uncertainty: EstimateUncertainty,
    last_estimated: Option<Stamp>,
    window: Window,
    alarm: Alarm,
    /// Displacements accepted so far.
    index: u64,
    last_displacement: Option<Stamp>,
    /// When it was taken: its stamp, or the corrected time of [`Timing`].
    last_taken: Option<Stamp>,
    last_received: Option<Stamp>,
    /// Stamp of the newest measured force that met its displacement.
    last_force: Option<Stamp>,
    /// The measured part of the seeded channel's history.
    seeds: Seeds,
    last_stale_report: Option<Stamp>,
    /// Reasons that arose since the last estimate.
    pending: Reasons,
}

impl Pipeline {
    /// A pipeline at rest.
    ///
    /// # Errors
    /// When a model or a setting is out of range. The message names it.
    pub fn new(models: Models, settings: Settings) -> Result<Self, Error> {
        Ok(Self::from(PipelineSetup::new(models, settings)?))
    }

    /// The settings in force.
    #[must_use]
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The current mode.
    #[must_use]
    pub const fn mode(&self) -> Mode {
        self.machine.mode()
    }

    /// Switches to `setup` from the next sample on, without delay. If the conditioning of a model is unchanged, its filter
    /// states are kept and estimates continue without a gap. If a model changes, the step in the estimate decays as it does
    /// after a change of mode, and the residual figures restart. What a model has learned ([`Settings::lazy_learning`]) stays
    /// while the model is the same, unless the setup is [`PipelineSetup::learning_anew`].
    pub fn take(&mut self, setup: PipelineSetup, emit: &mut impl FnMut(Event)) {
        let PipelineSetup { settings, mut free, mut seeded, controller, learns_anew } = setup;
        let others = free.model() != self.free.model()
            || seeded.as_ref().map(SeededChannel::model) != self.seeded.as_ref().map(SeededChannel::model);
        self.settings = settings;
        self.damper = DamperProperties::of(free.model(), &settings.limits);
        self.command_path.take(controller);
        if !others {
            self.free.take_learning(free.into_learning(), learns_anew);
            return;
        }
        if let (Some(new), Some(old)) = (free.model().force.drive(), self.free.model().force.drive())
            && new != old
        {
            // A current is not a voltage: wait for the first drive of the new kind.
            self.drive.clear();
        }
        free.inherit(&self.free);
        if let (Some(new), Some(old)) = (&mut seeded, &self.seeded) {
            new.inherit(old);
        }
        self.free = free;
        self.seeded = seeded;
        self.observer = Observer::default();
        self.forget_residuals(self.last_displacement.unwrap_or_default(), emit);
        self.bump.expect_step();
    }

    /// Forgets all history: the next sample is the first.
    pub fn reset(&mut self, emit: &mut impl FnMut(Event)) {
        self.restart(Cause::Reset, self.last_displacement.unwrap_or_default(), emit);
        self.gate = Gate::default();
    }

    /// Notes that samples were lost before they reached the pipeline. The next estimate reports it.
    pub fn note_overload(&mut self) {
        self.pending |= Reasons::OVERLOAD;
    }

    /// Notes that two publishers interleave samples on one input. The next estimate reports it.
    pub fn note_interleaved(&mut self) {
        self.pending |= Reasons::INPUT_INTERLEAVED;
    }

    /// Processes one sample and reports the resulting events, in order, through `emit`.
    pub fn step(&mut self, sample: &Sample, emit: &mut impl FnMut(Event)) {
        let model_drive = self.free.model().force.drive();
        match self.gate.check(sample, model_drive, &self.settings.plausible) {
            gate::GateDecision::Accept => {}
            gate::GateDecision::Refuse(refused) => {
                match sample.reading {
                    // A refused force request also cancels the one before it.
                    Reading::ForceRequest(_) => self.command_path.forget_request(),
                    // The estimate does not depend on it.
                    Reading::BodyVelocity(_) => {}
                    _ => self.pending |= refused.reasons(),
                }
                emit(Event::Refusal(Refusal { sample: *sample, why: refused }));
                return;
            }
            gate::GateDecision::TimeJumped => match sample.reading {
                Reading::Displacement(_) => self.restart(Cause::TimeJumped, sample.stamp, emit),
                Reading::Drive(_) => self.drive.clear(),
                Reading::Velocity(_) => self.velocity.clear(),
                Reading::CaseTemperature(_) => self.temperature.clear(),
                Reading::Force(_) => {
                    self.force.clear();
                    self.force_timing.reset();
                }
                Reading::BodyVelocity(_) => self.command_path.forget_body(),
                Reading::ForceRequest(_) => self.command_path.forget_request(),
            },
            // The displacements before the jump do not count: treat it as a gap.
            gate::GateDecision::PlaceJumped => {
                self.last_displacement = None;
                self.pending |= Reasons::DISPLACEMENT_GAP;
            }
        }
        emit(Event::Input(*sample));
        let stamp = sample.stamp;
        match sample.reading {
            Reading::Drive(drive) => {
                self.checks.drive(stamp, drive.get(), self.drive.at(stamp), &self.damper);
                self.drive.push(stamp, drive.get());
            }
            Reading::BodyVelocity(v) => self.command_path.set_body_velocity(stamp, v.get()),
            Reading::ForceRequest(force) => self.command_path.set_request(stamp, force.get()),
            Reading::Velocity(v) => self.velocity.push(stamp, v.get()),
            Reading::CaseTemperature(t) => self.temperature.push(stamp, t.get()),
            Reading::Force(force) => {
                self.checks.force(stamp, force.get());
                let taken = self.force_timing.place(stamp, force.get());
                self.force.push_force(taken, force.get());
                self.settle_residuals(emit);
            }
            Reading::Displacement(x) => self.on_displacement(sample, x.get(), emit),
        }
    }

    /// Lets the pipeline detect that displacement has stopped. `now` is on the clock of [`Sample::received`]. Call it a few
    /// times per `input_timeout_s`.
    pub fn tick(&mut self, now: Stamp, emit: &mut impl FnMut(Event)) {
        let (Some(received), Some(stamp)) = (self.last_received, self.last_displacement) else { return };
        let silence_s = now.since(received).get();
        if let Some(commanded) = self.command_path.silent(now, stamp, silence_s, &self.settings) {
            emit(Event::Command(commanded));
        }
        if silence_s <= self.settings.input_timeout_s {
            return;
        }
        self.displacement_lost(silence_s, stamp, emit);
        let due = self.last_stale_report.is_none_or(|at| now.since(at).get() >= Settings::STALE_REPORT_S);
        if due {
            self.last_stale_report = Some(now);
            emit(Event::Estimate(self.stale_estimate(stamp)));
        }
    }

    /// Drops all history, because time has jumped or the caller asked for it.
    fn restart(&mut self, cause: Cause, stamp: Stamp, emit: &mut impl FnMut(Event)) {
        self.free.reset();
        self.free.forget_learned();
        if let Some(channel) = &mut self.seeded {
            channel.reset();
        }
        self.drive.clear();
        self.velocity.clear();
        self.temperature.clear();
        self.force.clear();
        self.forget_residuals(stamp, emit);
        self.bump.forget();
        self.observer = Observer::default();
        self.checks = PlausibilityChecks::default();
        self.command_path.forget_request();
        self.command_path.forget_body();
        self.last_displacement = None;
        self.displacement_timing.reset();
        self.force_timing.reset();
        self.last_force = None;
        self.seeds = Seeds::default();
        if let Some(transition) = self.machine.force_to(Mode::Fault, cause, stamp) {
            emit(Event::Transition(transition));
        }
    }

    /// Restarts the residual figures and the alarm, because the residuals from now on come from another model or another
    /// time.
    fn forget_residuals(&mut self, stamp: Stamp, emit: &mut impl FnMut(Event)) {
        self.window = Window::default();
        self.restart_alarm(stamp, emit);
    }

    /// Resets the alarm's evidence, and reports it if the alarm was raised.
    fn restart_alarm(&mut self, stamp: Stamp, emit: &mut impl FnMut(Event)) {
        if self.alarm.restart() {
            emit(Event::Alarm(AlarmChange { stamp, raised: false, ratio: f64::NAN }));
        }
    }

    /// Pairs waiting predictions with the measured force that is known by now.
    fn settle_residuals(&mut self, emit: &mut impl FnMut(Event)) {
        while let Some((_, measured_n, waiting)) = self.force.next_known(self.settings.force_timeout_s) {
            let stamp = waiting.stamp;
            self.last_force = Some(stamp);
            self.seeds.add(waiting.index, stamp);
            if let Some(channel) = &mut self.seeded {
                // The newest sample has age 0: the force of sample k seeds the prediction of k + 1.
                let age = self.index.wrapping_sub(waiting.index) as usize;
                channel.seed(age, measured_n);
            }
            if waiting.dt_s.is_none() {
                self.restart_alarm(stamp, emit);
            }
            if let Some(dt_s) = waiting.dt_s
                && waiting.velocity_m_s.is_finite()
            {
                let over_n = measured_n - waiting.rest_n;
                self.checks.work(dt_s, over_n, waiting.velocity_m_s, &self.settings.plausible);
            }
            // The sample's estimate was reported when its prediction began to wait.
            if !self.checks.force_is_odd(&self.damper) {
                let [displacement_m, drive] = waiting.learned_at;
                self.free.learn([displacement_m, waiting.velocity_m_s, drive], measured_n);
            }
            if !waiting.predicted_n.is_finite() {
                // The filters of the measured force and of the prediction must start at the same sample to be comparable.
                self.free.restart_comparison();
                continue;
            }
            let comparable_n = self.free.comparable_force(waiting.dt_s, measured_n);
            let residual_n = comparable_n - waiting.predicted_n;
            self.observer.see(stamp, waiting.dt_s, residual_n, &self.settings);
            let window = self.window.add(stamp, comparable_n, residual_n, &self.settings);
            let expected_n = self.free.expected_rsse_n().unwrap_or(f64::NAN);
            if waiting.counts
                && let Some(edge) = self.alarm.add(stamp, residual_n / expected_n, &self.settings)
            {
                let raised = edge == Edge::Rising;
                emit(Event::Alarm(AlarmChange { stamp, raised, ratio: window.rsse_n / expected_n }));
            }
            emit(Event::Residual(Residual {
                stamp,
                measured: Newton(comparable_n),
                predicted: Newton(waiting.predicted_n),
                load_cell: Newton(waiting.load_cell_n),
                residual: Newton(residual_n),
                expected_rsse: Newton(expected_n),
                normalised: residual_n / expected_n,
                windowed_rsse: Newton(window.rsse_n),
                windowed_esr: window.esr,
                window: Second(self.settings.residual_window_s),
                counts: waiting.counts,
                alarm: self.alarm.is_raised(),
            }));
        }
    }
}
