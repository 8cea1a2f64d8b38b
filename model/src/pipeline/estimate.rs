//! From the lanes to the estimate: mode, bumpless change, validity.

use super::doubt::Doubt;
use super::event::{Cause, Estimate, Event, Reasons, Slot, Validity};
use super::lane::Given;
use super::mode::{Conditions, Mode};
use super::settings::UseForce;
use super::{Awaiting, Pipeline};
use crate::sample::{Sample, Stamp};
use crate::units::{Newton, Second};

/// The step that a change of mode would make, decaying from there.
///
/// ```text
/// F_out = F_mode + d exp(-(t - t0)/tau),   d = F_out(t0) by the mode before - F_mode(t0)
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Bump {
    offset_n: f64,
    last_output_n: Option<f64>,
    /// The model behind the mode has just been swapped: the next output starts from the last one.
    swapped: bool,
}

impl Bump {
    /// The output for `force_n`, the force by the mode at present. `before_n` is what the mode before would have
    /// put out now, when the mode has just changed and there was an output.
    #[inline]
    fn smooth(&mut self, force_n: f64, before_n: Option<f64>, dt_s: f64, tau_s: f64) -> f64 {
        match before_n {
            Some(before_n) if tau_s > 0.0 => self.offset_n = before_n - force_n,
            Some(_) => self.offset_n = 0.0,
            None if tau_s > 0.0 => self.offset_n *= (-dt_s / tau_s).exp(),
            None => self.offset_n = 0.0,
        }
        // A millinewton is beyond every load cell; from there on the mode's own bits come through.
        if self.offset_n.abs() < 1e-3 {
            self.offset_n = 0.0;
        }
        let output_n = force_n + self.offset_n;
        self.last_output_n = Some(output_n);
        output_n
    }

    /// The next output is another model's: let it start from the last output.
    pub(super) const fn expect_step(&mut self) {
        self.swapped = true;
    }

    pub(super) const fn last_output_n(&self) -> Option<f64> {
        self.last_output_n
    }

    /// What is left of the step, N: the output minus the mode's own force.
    pub(super) const fn offset_n(&self) -> f64 {
        self.offset_n
    }

    fn forget(&mut self) {
        *self = Self::default();
    }
}

impl Pipeline {
    /// Takes an accepted displacement: steps both lanes, decides the mode, reports the estimate.
    pub(super) fn on_displacement(
        &mut self,
        sample: &Sample,
        displacement_m: f64,
        emit: &mut impl FnMut(Event),
    ) {
        let stamp = sample.stamp;
        let mut reasons = std::mem::take(&mut self.pending);
        let step_s = self.last_displacement.map(|last| stamp.since(last).get());
        let dt_s = step_s.filter(|dt| *dt <= self.settings.gap_s);
        if let Some(silence_s) = step_s.filter(|_| dt_s.is_none()) {
            reasons |= Reasons::DISPLACEMENT_GAP;
            if silence_s > self.settings.input_timeout_s
                && let Some(last) = self.last_displacement
            {
                self.displacement_lost(silence_s, last, emit);
            }
        }
        self.last_displacement = Some(stamp);
        self.last_received = Some(sample.received);
        self.last_stale_report = None;
        self.index = self.index.wrapping_add(1);
        if sample.received.since(stamp).get() > self.settings.input_timeout_s {
            reasons |= Reasons::LATE;
        }

        let drive = self.drive.at(stamp);
        let input_age_s = drive.map_or(f64::NAN, |(at, _)| stamp.since(at).get());
        if input_age_s > self.settings.input_timeout_s {
            reasons |= Reasons::DRIVE_STALE;
        }
        let velocity = self.velocity.at(stamp);
        let given = Given {
            dt_s,
            displacement_m,
            measured_velocity_m_s: velocity
                .filter(|(at, _)| stamp.since(*at).get() <= self.settings.gap_s)
                .map(|(_, v)| v),
            drive: drive.map_or(f64::NAN, |(_, value)| value),
            case_temp_c: self.temperature.at(stamp).map_or(f64::NAN, |(_, value)| value),
        };

        let mut free_reasons = Reasons::NONE;
        let free_n = self.free.step(&given, &mut free_reasons);
        let mut seeded_reasons = Reasons::NONE;
        let seeded_n = self.seeded.as_mut().and_then(|lane| lane.step(&given, &mut seeded_reasons));

        self.note_operating(stamp);

        let before = self.machine.mode();
        let force_fresh = self.settings.use_measured_force == UseForce::Auto
            && self.last_force.is_some_and(|at| stamp.since(at).get() <= self.settings.force_timeout_s);
        let conditions =
            Conditions { arx_ready: seeded_n.is_some(), force_fresh, model_ready: free_n.is_some() };
        let transition = self.machine.update(stamp, conditions, self.settings.coast_s, self.settings.hold_s);
        let mode = self.machine.mode();

        let by_mode = |mode: Mode| match mode {
            Mode::Arx | Mode::ArxCoast => seeded_n,
            Mode::Model => free_n,
            Mode::Hold | Mode::Fault => None,
        };
        let force_n = match (by_mode(mode), self.bump.last_output_n()) {
            (Some(force_n), last) => {
                // After a change the mode before speaks for this very sample if it still can; else its last word.
                let before_n =
                    transition.and(last).map(|last| by_mode(before).map_or(last, |n| n + self.bump.offset_n));
                self.bump.smooth(force_n, before_n, dt_s.unwrap_or(0.0), self.settings.bumpless_tau_s)
            }
            (None, Some(last)) if mode == Mode::Hold => last,
            (None, _) => {
                self.bump.forget();
                f64::NAN
            }
        };

        reasons |= self.mode_reasons(mode, free_reasons, seeded_reasons);
        if let Some(transition) = transition {
            if matches!(mode, Mode::Model | Mode::Fault)
                && let Some(lane) = &mut self.seeded
            {
                // What ARX said on its own is no history to come back to.
                lane.forget_forces();
            }
            emit(Event::Transition(transition));
        }
        let doubt = self.doubt(stamp, force_n, mode, reasons);
        if !matches!(mode, Mode::Hold | Mode::Fault) {
            self.last_doubt = doubt;
        }
        emit(Event::Estimate(self.estimate(stamp, force_n, doubt, reasons, input_age_s)));

        // Without a prediction there is no residual, but the force still seeds ARX.
        let predicted_n = free_n.unwrap_or(f64::NAN);
        let counts = !(free_reasons.has(Reasons::SETTLING)
            || free_reasons.has(Reasons::TEMPERATURE_MISSING)
            || reasons.has(Reasons::DRIVE_STALE));
        self.force.wait(stamp, Awaiting { predicted_n, dt_s, index: self.index, counts });
        self.settle_residuals(emit);
    }

    /// The reasons of the lane that speaks, and what the mode itself says.
    fn mode_reasons(&self, mode: Mode, free: Reasons, seeded: Reasons) -> Reasons {
        let mut reasons = Reasons::NONE;
        match mode {
            Mode::Arx => reasons |= seeded,
            Mode::ArxCoast => {
                reasons |= seeded;
                reasons |= Reasons::FORCE_LOST;
                if self.seeded.as_ref().is_some_and(|lane| !lane.model().force.dc_is_meaningful()) {
                    reasons |= Reasons::NO_DC;
                }
            }
            Mode::Model | Mode::Hold | Mode::Fault => {
                reasons |= free;
                // ARX resting for its rate is worth saying only where ARX would have spoken.
                let wanted = self.settings.use_measured_force == UseForce::Auto && self.last_force.is_some();
                if wanted && seeded.has(Reasons::RATE_MISMATCH) {
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
        doubt: Doubt,
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
        Estimate {
            stamp,
            force: Newton(force_n),
            std_dev: Newton(doubt.std_dev_n),
            band: doubt.band_n.map(Newton),
            calibrated: doubt.calibrated,
            slot,
            mode,
            validity: reasons.validity().max(by_mode),
            reasons,
            input_age: Second(input_age_s),
        }
    }

    /// Displacement has been silent for `silence_s`: hold, then fault. Idempotent, so that silence leaves the
    /// same state whether ticks noticed it or the next displacement did.
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

    /// What is reported while displacement is silent: the last estimate, flagged, or none.
    pub(super) fn stale_estimate(&self, last: Stamp) -> Estimate {
        let mode = self.machine.mode();
        let force_n = match mode {
            Mode::Hold => self.bump.last_output_n().unwrap_or(f64::NAN),
            _ => f64::NAN,
        };
        let age_s = self.drive.at(last).map_or(f64::NAN, |(at, _)| last.since(at).get());
        let doubt = self.doubt(last, force_n, mode, Reasons::DISPLACEMENT_LOST);
        self.estimate(last, force_n, doubt, Reasons::DISPLACEMENT_LOST, age_s)
    }
}
