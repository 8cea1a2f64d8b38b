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
//! for longer than that. [`Commanding::silent`] then computes the current at this time without changing any state, so that ticks
//! leave no trace. [`Commanding::resume`] applies the same change when displacement returns.

use super::event::Commanded;
use super::settings::Settings;
use crate::condition::Hold;
use crate::force::Inputs;
use crate::inverse::{Commander, Demand, Law};
use crate::sample::Stamp;

/// The inverse controller and its inputs.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Commanding {
    commander: Commander,
    request: Hold,
    body: Hold,
    /// A force has been requested at least once.
    asked: bool,
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

impl Commanding {
    pub(super) fn new(commander: Commander) -> Self {
        Self { commander, request: Hold::default(), body: Hold::default(), asked: false }
    }

    /// Continues with another inverse controller.
    pub(super) fn take(&mut self, mut commander: Commander) {
        commander.inherit(&self.commander);
        self.commander = commander;
    }

    /// Takes a force request.
    pub(super) fn ask(&mut self, stamp: Stamp, force_n: f64) {
        self.asked = true;
        self.request.push(stamp, force_n);
    }

    /// Takes the body's velocity.
    pub(super) fn body_moves(&mut self, stamp: Stamp, velocity_m_s: f64) {
        self.body.push(stamp, velocity_m_s);
    }

    /// Cancels the force request.
    pub(super) fn forget_request(&mut self) {
        self.request.clear();
    }

    pub(super) fn forget_body(&mut self) {
        self.body.clear();
    }

    fn speaks(&self, settings: &Settings) -> bool {
        match settings.law {
            Law::Off => false,
            Law::Follow => self.asked,
            Law::Skyhook(_) | Law::Groundhook(_) | Law::Fixed(_) => true,
        }
    }

    /// The command at a displacement; `None` while nothing is commanded.
    #[inline]
    pub(super) fn step(&mut self, moving: &Moving, settings: &Settings) -> Option<Commanded> {
        if !self.speaks(settings) {
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
        let demand = settings.law.demand(fresh(&self.request), fresh(&self.body), inputs.velocity_m_s);
        let command = self.commander.step(&inputs, demand, moving.measured_n);
        Some(Commanded { stamp: moving.stamp, known_at: moving.received, command })
    }

    /// The current at `now`, after `silence_s` without displacement; `None` while the last command still holds.
    pub(super) fn silent(
        &self,
        now: Stamp,
        last: Stamp,
        silence_s: f64,
        settings: &Settings,
    ) -> Option<Commanded> {
        let (demand, idle_s) = idle(silence_s, settings).filter(|_| self.speaks(settings))?;
        let mut commander = self.commander;
        let command = commander.idle(demand, idle_s);
        // Casts from float to integer saturate.
        Some(Commanded { stamp: last.shifted((silence_s * 1e9) as i64), known_at: now, command })
    }

    fn resume(&mut self, silence_s: f64, settings: &Settings) {
        if let Some((demand, idle_s)) = idle(silence_s, settings) {
            self.commander.idle(demand, idle_s);
        }
    }
}

/// The demand after `silence_s` without displacement, and for how long it has applied, s; `None` while the last command holds.
fn idle(silence_s: f64, settings: &Settings) -> Option<(Demand, f64)> {
    let idle_s = silence_s - settings.request_timeout_s;
    (idle_s > 0.0).then(|| (settings.law.demand(None, None, f64::NAN), idle_s))
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
