//! Which model the estimate comes from: a small machine, driven once a displacement.
//!
//! | mode | the estimate is |
//! |---|---|
//! | `arx` | ARX, seeded with measured force |
//! | `arx_coast` | ARX on its own predictions, for at most `coast_s` after measured force was lost |
//! | `model` | the free-running model |
//! | `hold` | the last estimate, for at most `hold_s`, when no model can run |
//! | `fault` | none |
//!
//! The best mode that its conditions allow is taken, in the order of the table; `arx_coast` only follows
//! `arx`, and `hold` only follows a mode that had an estimate.

use super::event::{Cause, Transition};
use crate::sample::Stamp;

/// Mode of a pipeline. The values are those of `ForceEstimate.msg`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Mode {
    /// ARX, seeded with measured force.
    Arx = 0,
    /// ARX on its own predictions.
    ArxCoast = 1,
    /// The free-running model.
    Model = 2,
    /// The last estimate.
    Hold = 3,
    /// No estimate.
    Fault = 4,
}

impl Mode {
    /// The name, as in the contract.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Arx => "arx",
            Self::ArxCoast => "arx_coast",
            Self::Model => "model",
            Self::Hold => "hold",
            Self::Fault => "fault",
        }
    }
}

/// What the machine is told at a displacement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conditions {
    /// The ARX model has all that it needs for a prediction.
    pub arx_ready: bool,
    /// Measured force is not older than `force_timeout_s`, and its use is allowed.
    pub force_fresh: bool,
    /// The free model has an estimate.
    pub model_ready: bool,
}

/// The machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModeMachine {
    mode: Mode,
    since: Option<Stamp>,
}

impl Default for ModeMachine {
    /// Starts in `fault`: there is no estimate yet.
    fn default() -> Self {
        Self { mode: Mode::Fault, since: None }
    }
}

impl ModeMachine {
    /// The mode at present.
    #[must_use]
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// Seconds since the mode was entered; zero before the first change.
    #[must_use]
    pub fn seconds_in_mode(&self, now: Stamp) -> f64 {
        self.since.map_or(0.0, |since| now.since(since).get())
    }

    /// Takes the conditions at stamp `now` and returns the change of mode, if there is one.
    #[inline]
    pub fn update(&mut self, now: Stamp, c: Conditions, coast_s: f64, hold_s: f64) -> Option<Transition> {
        let elapsed_s = self.seconds_in_mode(now);
        let arx = c.arx_ready && c.force_fresh;
        let coast_over = self.mode == Mode::ArxCoast && elapsed_s > coast_s;
        let coast =
            c.arx_ready && matches!(self.mode, Mode::Arx | Mode::ArxCoast) && !coast_over && coast_s > 0.0;
        let hold = self.mode != Mode::Fault && (self.mode != Mode::Hold || elapsed_s <= hold_s);
        let (to, cause) = if arx {
            (Mode::Arx, Cause::ForceFresh)
        } else if coast {
            (Mode::ArxCoast, Cause::ForceLost)
        } else if c.model_ready {
            let cause = match self.mode {
                Mode::ArxCoast if coast_over => Cause::CoastEnded,
                Mode::Arx | Mode::ArxCoast if c.arx_ready => Cause::ForceLost,
                Mode::Arx | Mode::ArxCoast => Cause::ArxUnready,
                _ => Cause::ModelReady,
            };
            (Mode::Model, cause)
        } else if hold {
            (Mode::Hold, Cause::InputsMissing)
        } else if self.mode == Mode::Hold {
            (Mode::Fault, Cause::HoldEnded)
        } else {
            (Mode::Fault, Cause::InputsMissing)
        };
        self.force_to(to, cause, now)
    }

    /// Goes to `to` whatever the conditions; `None` when the machine is there already.
    pub fn force_to(&mut self, to: Mode, cause: Cause, now: Stamp) -> Option<Transition> {
        if to == self.mode {
            return None;
        }
        let from = std::mem::replace(&mut self.mode, to);
        self.since = Some(now);
        Some(Transition { stamp: now, from, to, cause })
    }
}
