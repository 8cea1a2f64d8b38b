//! From the demanded force to a current command, once per displacement.
//!
//! ```text
//! force_request, body_velocity ─→ control law ─→ demand ─→ inverse controller ─→ Command
//!                                                                 ↑
//!              inputs of the free-run channel, measured force ────┘
//! ```
//!
//! Under the control law `follow`, commands start with the first force request. From then on every displacement yields a command. A
//! request expires after `request_timeout_s`; the current then goes to the safe current. The same happens when displacement stops
//! for longer than that. [`CommandPath::silent`] then computes the current at this time without changing any state, so that ticks
//! leave no trace. [`CommandPath::resume`] applies the same change when displacement returns.

use super::event::StampedCommand;
use super::settings::Settings;
use crate::condition::Hold;
use crate::force::Inputs;
use crate::inverse::{ControlLaw, Demand, InverseController};
use crate::sample::Stamp;

/// The inverse controller and its inputs.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CommandPath {
    controller: InverseController,
    request: Hold,
    body: Hold,
    /// A force has been requested at least once.
    is_requested: bool,
}

/// The inputs of a command.
pub(super) struct Moving {
    pub(super) stamp: Stamp,
    pub(super) received: Stamp,
    /// Time since the displacement before, s; not limited by a gap.
    pub(super) step_s: Option<f64>,
    /// Inputs of the free-run channel. The drive is NaN if it is not known now.
    pub(super) inputs: Option<Inputs>,
    pub(super) measured_n: Option<f64>,
}

impl CommandPath {
    pub(super) fn new(controller: InverseController) -> Self {
        Self { controller, request: Hold::default(), body: Hold::default(), is_requested: false }
    }

    /// Continues with another inverse controller.
    pub(super) fn take(&mut self, mut controller: InverseController) {
        controller.inherit(&self.controller);
        self.controller = controller;
    }

    /// Takes a force request.
    pub(super) fn set_request(&mut self, stamp: Stamp, force_n: f64) {
        self.is_requested = true;
        self.request.push(stamp, force_n);
    }

    /// Takes the body's velocity.
    pub(super) fn set_body_velocity(&mut self, stamp: Stamp, velocity_m_s: f64) {
        self.body.push(stamp, velocity_m_s);
    }

    /// Cancels the force request.
    pub(super) fn forget_request(&mut self) {
        self.request.clear();
    }

    pub(super) fn forget_body(&mut self) {
        self.body.clear();
    }

    fn is_active(&self, settings: &Settings) -> bool {
        match settings.law {
            ControlLaw::Off => false,
            ControlLaw::Follow => self.is_requested,
            ControlLaw::Skyhook(_)
            | ControlLaw::SkyhookGains(_)
            | ControlLaw::Groundhook(_)
            | ControlLaw::Fixed(_) => true,
        }
    }

    /// The command at a displacement; `None` while nothing is commanded.
    #[inline]
    pub(super) fn step(&mut self, moving: &Moving, settings: &Settings) -> Option<StampedCommand> {
        if !self.is_active(settings) {
            return None;
        }
        if let Some(step_s) = moving.step_s {
            self.resume(step_s, settings);
        }
        let fresh = |hold: &Hold| {
            let (at, value) = hold.at(moving.stamp)?;
            (moving.stamp.since(at).get() <= settings.request_timeout_s).then_some(value)
        };
        let inputs = moving.inputs.unwrap_or(UNKNOWN);
        let last_a = self.controller.last_current().get();
        let current_a = if inputs.drive.is_finite() { inputs.drive } else { last_a };
        let (request, body) = (fresh(&self.request), fresh(&self.body));
        // A motion that arrives late is over. Its request may have the same stamp, so only the arrival shows it.
        let demand = match moving.received.since(moving.stamp).get() > settings.request_timeout_s {
            true => without_inputs(settings),
            false => settings.law.demand(request, body, inputs.velocity_m_s, current_a),
        };
        let command = self.controller.step(&inputs, demand, moving.measured_n);
        Some(StampedCommand { stamp: moving.stamp, known_at: moving.received, command })
    }

    /// The current at `now`, after `silence_s` without displacement; `None` while the last command still holds.
    pub(super) fn silent(
        &self,
        now: Stamp,
        last: Stamp,
        silence_s: f64,
        settings: &Settings,
    ) -> Option<StampedCommand> {
        let (demand, idle_s) = idle(silence_s, settings).filter(|_| self.is_active(settings))?;
        let mut controller = self.controller;
        let command = controller.idle(demand, idle_s);
        // Casts from float to integer saturate.
        Some(StampedCommand { stamp: last.shifted((silence_s * 1e9) as i64), known_at: now, command })
    }

    fn resume(&mut self, silence_s: f64, settings: &Settings) {
        if let Some((demand, idle_s)) = idle(silence_s, settings) {
            self.controller.idle(demand, idle_s);
        }
    }
}

/// The demand after `silence_s` without displacement, and for how long it has applied, s; `None` while the last command holds.
fn idle(silence_s: f64, settings: &Settings) -> Option<(Demand, f64)> {
    let idle_s = silence_s - settings.request_timeout_s;
    (idle_s > 0.0).then(|| (without_inputs(settings), idle_s))
}

/// The demand if nothing is known of requests and motion.
fn without_inputs(settings: &Settings) -> Demand {
    settings.law.demand(None, None, f64::NAN, f64::NAN)
}

/// Inputs with every value unknown.
const UNKNOWN: Inputs = Inputs {
    dt_s: None,
    displacement_m: f64::NAN,
    velocity_m_s: f64::NAN,
    acceleration_m_s2: f64::NAN,
    drive: f64::NAN,
    case_temp_c: f64::NAN,
};
