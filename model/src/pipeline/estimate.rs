//! From the two channels to the estimate: mode, bumpless transfer, validity.

use super::bump::{Forces, OutputChannel};
use super::command::Moving;
use super::estimate_uncertainty::EstimateUncertainty;
use super::event::{Cause, Estimate, Event, Reasons, Slot, Validity};
use super::mode::{Conditions, Mode};
use super::model_channel::{ChannelInputs, MeasuredForce, SeededChannel};
use super::plausible::CheckedDisplacement;
use super::settings::{Settings, UseForce};
use super::{Awaiting, Pipeline};
use crate::force::Inputs;
use crate::model::{Envelope, Model};
use crate::sample::{Sample, Stamp};
use crate::units::{Newton, Second};

impl Pipeline {
    /// Processes an accepted displacement: steps both channels, decides the mode, reports the estimate and the
    /// command.
    pub(super) fn on_displacement(
        &mut self,
        sample: &Sample,
        displacement_m: f64,
        emit: &mut impl FnMut(Event),
    ) {
        let stamp = sample.stamp;
        let mut reasons = std::mem::take(&mut self.pending);
        let step_s = self.pass_time(sample, &mut reasons, emit);
        if step_s.is_none_or(|step_s| step_s > self.settings.gap_s) {
            // A step over a gap says nothing about the period.
            self.displacement_timing.reset();
        }
        let taken = self.displacement_timing.place(stamp, displacement_m);
        let before = self.last_taken.replace(taken);
        let taken_step_s = step_s.and(before).map(|before| taken.since(before).get());
        let given = self.gather(stamp, taken_step_s, displacement_m, &mut reasons);
        let dt_s = given.dt_s;

        let mut free_reasons = Reasons::NONE;
        let simulated = self.free.step(&given, &mut free_reasons);
        let mut seeded_reasons = Reasons::NONE;
        let measured =
            MeasuredForce { readings: &self.force, now: taken, max_span_s: self.settings.force_timeout_s };
        let seeded_n =
            self.seeded.as_mut().and_then(|channel| channel.step(&given, &measured, &mut seeded_reasons));
        self.note_operating(stamp);
        // The estimate is the damper's force, and the residual compares readings. Corrections and smoothing apply to the estimate only.
        let observed_n =
            simulated.damper_n.map(|force_n| force_n + self.observer.bias_n(stamp, &self.settings));
        let forces = Forces { dt_s: dt_s.unwrap_or(0.0), free_n: observed_n, seeded_n };
        let force_n = self.output_force_n(stamp, &forces, emit);
        let mode = self.machine.mode();

        let is_learned = (reasons | free_reasons) == Reasons::NONE;
        reasons |= self.mode_reasons(mode, free_reasons, seeded_reasons);
        // Correction and smoothing can take the force outside the model's training range.
        if Envelope::leaves(self.output_model(mode).envelope.force_n, force_n) {
            reasons |= Reasons::OUTSIDE_ENVELOPE;
        }
        let uncertainty = self.uncertainty(stamp, force_n, mode, reasons);
        if !matches!(mode, Mode::Hold | Mode::Fault) {
            (self.last_uncertainty, self.last_estimated) = (uncertainty, Some(stamp));
        }
        let input_age_s = self.drive_age_s(stamp);
        let received = Some(sample.received);
        let estimate = self.estimate(stamp, force_n, uncertainty, reasons, input_age_s);
        emit(Event::Estimate(Estimate { received, ..estimate }));
        self.command(stamp, step_s, reasons, emit);

        // A displacement without a prediction gives no residual, but its measured force still seeds ARX.
        let predicted_n = simulated.reading_n.unwrap_or(f64::NAN);
        let load_cell_n = predicted_n - simulated.damper_n.unwrap_or(f64::NAN);
        let counts = !(free_reasons.has(Reasons::SETTLING)
            || free_reasons.has(Reasons::TEMPERATURE_MISSING)
            || reasons.has(Reasons::DRIVE_STALE));
        let velocity_m_s = self.free.velocity_m_s();
        let learned_at = match self.free.inputs() {
            Some(inputs) if is_learned => [inputs.displacement_m, inputs.drive],
            _ => [f64::NAN; 2],
        };
        let rest_n = self.damper.preload.at_n(displacement_m);
        self.force.wait(
            taken,
            Awaiting {
                stamp,
                predicted_n,
                load_cell_n,
                dt_s,
                index: self.index,
                counts,
                learned_at,
                velocity_m_s,
                rest_n,
            },
        );
        self.settle_residuals(emit);
    }

    /// Advances time to `sample`, and returns the time since the displacement before, s.
    fn pass_time(
        &mut self,
        sample: &Sample,
        reasons: &mut Reasons,
        emit: &mut impl FnMut(Event),
    ) -> Option<f64> {
        let stamp = sample.stamp;
        let step_s = self.last_displacement.map(|last| stamp.since(last).get());
        if let Some((last, silence_s)) = self.last_displacement.zip(step_s)
            && silence_s > self.settings.gap_s
        {
            *reasons |= Reasons::DISPLACEMENT_GAP;
            if silence_s > self.settings.input_timeout_s {
                self.displacement_lost(silence_s, last, emit);
            }
        }
        self.last_displacement = Some(stamp);
        self.last_received = Some(sample.received);
        self.last_stale_report = None;
        self.index = self.index.wrapping_add(1);
        if sample.received.since(stamp).get() > self.settings.input_timeout_s {
            *reasons |= Reasons::LATE;
        }
        if self.gate.is_ahead(self.settings.stamp_ahead_s) {
            *reasons |= Reasons::STAMP_AHEAD;
        }
        step_s
    }

    /// Collects the inputs of both channels and checks their plausibility.
    fn gather(
        &mut self,
        stamp: Stamp,
        step_s: Option<f64>,
        displacement_m: f64,
        reasons: &mut Reasons,
    ) -> ChannelInputs {
        let gap_s = self.settings.gap_s;
        let dt_s = step_s.filter(|dt_s| *dt_s <= gap_s);
        if self.drive_age_s(stamp) > self.settings.input_timeout_s {
            *reasons |= Reasons::DRIVE_STALE;
        }
        let value = |(_, value): (Stamp, f64)| value;
        let velocity = self.velocity.at(stamp).filter(|(at, _)| stamp.since(*at).get() <= gap_s);
        let velocity_m_s = velocity.map(value);
        self.checks.displacement(&CheckedDisplacement { stamp, dt_s, displacement_m, velocity_m_s });
        *reasons |= self.checks.reasons(stamp, &self.damper, &self.settings.plausible);
        ChannelInputs {
            dt_s,
            displacement_m,
            measured_velocity_m_s: velocity_m_s,
            drive: self.drive.at(stamp).map_or(f64::NAN, value),
            case_temp_c: self.temperature.at(stamp).map_or(f64::NAN, value),
        }
    }

    /// The model that the estimate comes from in `mode`.
    fn output_model(&self, mode: Mode) -> &Model {
        let seeded = self.seeded.as_ref().filter(|_| matches!(mode, Mode::Arx | Mode::ArxCoast));
        seeded.map_or(self.free.model(), SeededChannel::model)
    }

    /// Age of the drive at `stamp`, s; NaN without a drive.
    fn drive_age_s(&self, stamp: Stamp) -> f64 {
        self.drive.at(stamp).map_or(f64::NAN, |(at, _)| stamp.since(at).get())
    }

    /// Decides the mode, and returns the output force, N; NaN in `fault`.
    fn output_force_n(&mut self, stamp: Stamp, forces: &Forces, emit: &mut impl FnMut(Event)) -> f64 {
        let before = self.machine.mode();
        let conditions = Conditions {
            arx_ready: forces.seeded_n.is_some(),
            force_fresh: self.settings.use_measured_force == UseForce::Auto && self.force_is_fresh(stamp),
            force_odd: self.checks.force_is_odd(&self.damper),
            model_ready: forces.free_n.is_some(),
        };
        let Settings { only_mode, coast_s, hold_s, .. } = self.settings;
        let transition = self.machine.update(only_mode, stamp, conditions, coast_s, hold_s);
        let mode = self.machine.mode();
        if let Some(transition) = transition {
            if matches!(mode, Mode::Model | Mode::Fault)
                && let Some(channel) = &mut self.seeded
            {
                // The predictions that ARX made without measured force must not start its next history.
                channel.forget_forces();
            }
            emit(Event::Transition(transition));
        }
        let force_n = match output_channel(mode) {
            Some(now) => {
                let before = transition.map(|_| output_channel(before));
                self.bump.smooth(forces, now, before, self.settings.bumpless_tau_s)
            }
            None if mode == Mode::Hold => self.bump.hold(forces),
            None => {
                self.bump.forget();
                None
            }
        };
        force_n.unwrap_or(f64::NAN)
    }

    /// True while the age of the newest measured force that met its displacement is at most `force_timeout_s`.
    fn force_is_fresh(&self, stamp: Stamp) -> bool {
        self.last_force.is_some_and(|at| stamp.since(at).get() <= self.settings.force_timeout_s)
    }

    /// Commands the current that the control law demands.
    fn command(&mut self, stamp: Stamp, step_s: Option<f64>, reasons: Reasons, emit: &mut impl FnMut(Event)) {
        // If the measured drive is old or implausible, the last command is the better information on the coil.
        let drive_counts = !(reasons.has(Reasons::DRIVE_STALE) || reasons.has(Reasons::DRIVE_IMPLAUSIBLE));
        let inputs = self
            .free
            .inputs()
            .map(|inputs| Inputs { drive: if drive_counts { inputs.drive } else { f64::NAN }, ..inputs });
        let force_odd = self.checks.force_is_odd(&self.damper);
        // Feedback uses the force of this sample only: an older force belongs to another motion.
        let taken = self.last_taken.unwrap_or(stamp);
        let of_this = |at: Stamp| at == taken || step_s.is_some_and(|step_s| taken.since(at).get() < step_s);
        let newest = self.force.newest(taken).filter(|(at, _)| of_this(*at) && !force_odd);
        let moving = Moving {
            stamp,
            received: self.last_received.unwrap_or(stamp),
            step_s,
            inputs,
            measured_n: newest.map(|(_, force_n)| force_n),
        };
        if let Some(commanded) = self.command_path.step(&moving, &self.settings) {
            emit(Event::Command(commanded));
        }
    }

    /// The reasons of the mode and of the channel that the estimate comes from.
    fn mode_reasons(&self, mode: Mode, free: Reasons, seeded: Reasons) -> Reasons {
        let mut reasons = Reasons::NONE;
        match mode {
            Mode::Arx => reasons |= seeded,
            Mode::ArxCoast => {
                reasons |= seeded;
                reasons |= Reasons::FORCE_LOST;
                if self.seeded.as_ref().is_some_and(|channel| !channel.model().force.dc_is_meaningful()) {
                    reasons |= Reasons::NO_DC;
                }
            }
            Mode::Model | Mode::Hold | Mode::Fault => {
                reasons |= free;
                // A wrong rate for ARX is reported only if ARX would have given the estimate.
                let uses_force =
                    self.settings.use_measured_force == UseForce::Auto && self.last_force.is_some();
                if uses_force && seeded.has(Reasons::RATE_MISMATCH) {
                    reasons |= Reasons::RATE_MISMATCH;
                }
            }
        }
        reasons
    }

    fn estimate(
        &self,
        stamp: Stamp,
        force_n: f64,
        uncertainty: EstimateUncertainty,
        reasons: Reasons,
        input_age_s: f64,
    ) -> Estimate {
        let mode = self.machine.mode();
        let slot = if matches!(mode, Mode::Arx | Mode::ArxCoast) { Slot::Seeded } else { Slot::Free };
        let by_mode = match mode {
            Mode::Hold => Validity::Stale,
            Mode::Fault => Validity::Invalid,
            Mode::Arx | Mode::ArxCoast | Mode::Model => Validity::Valid,
        };
        let unexplained = by_mode > Validity::Valid && reasons.validity() < Validity::Stale;
        let reasons = if unexplained { reasons | Reasons::NO_MODEL_RUNS } else { reasons };
        Estimate {
            stamp,
            received: None,
            force: Newton(force_n),
            smoothing: Newton(self.bump.offset_n()),
            std_dev: Newton(uncertainty.std_dev_n),
            band: uncertainty.band_n.map(Newton),
            calibrated: uncertainty.calibrated,
            slot,
            mode,
            validity: reasons.validity().max(by_mode),
            reasons,
            input_age: Second(input_age_s),
        }
    }

    /// Displacement has been silent for `silence_s`: switch to hold, then to fault. The call is idempotent, so
    /// the state after a silence is the same whether ticks noticed it or the next displacement did.
    pub(super) fn displacement_lost(&mut self, silence_s: f64, last: Stamp, emit: &mut impl FnMut(Event)) {
        if self.machine.mode() != Mode::Fault {
            if let Some(t) = self.machine.force_to(Mode::Hold, Cause::DisplacementLost, last) {
                emit(Event::Transition(t));
            }
            if silence_s > self.settings.input_timeout_s + self.settings.hold_s
                && let Some(t) = self.machine.force_to(Mode::Fault, Cause::HoldEnded, last)
            {
                self.bump.forget();
                emit(Event::Transition(t));
            }
        }
    }

    /// Estimate while displacement is silent: the last one, flagged as stale, or NaN.
    pub(super) fn stale_estimate(&self, last: Stamp) -> Estimate {
        let mode = self.machine.mode();
        let force_n = match mode {
            Mode::Hold => self.bump.last_output_n().unwrap_or(f64::NAN),
            _ => f64::NAN,
        };
        let age_s = self.drive_age_s(last);
        let uncertainty = self.uncertainty(last, force_n, mode, Reasons::DISPLACEMENT_LOST);
        self.estimate(last, force_n, uncertainty, Reasons::DISPLACEMENT_LOST, age_s)
    }
}

/// The channel that the estimate comes from in `mode`.
const fn output_channel(mode: Mode) -> Option<OutputChannel> {
    match mode {
        Mode::Arx | Mode::ArxCoast => Some(OutputChannel::Seeded),
        Mode::Model => Some(OutputChannel::Free),
        Mode::Hold | Mode::Fault => None,
    }
}
