//! From what is asked for to current commands, once a displacement.
//!
//! ```text
//! force_request, body_velocity ─→ law ─→ demand ─→ commander ─→ Command
//!                                                     ↑
//!              free lane's inputs, measured force ────┘
//! ```
//!
//! Under the law `follow` nothing is commanded before a force was first asked for; from then on every displacement gets a command.
//! What is older than `request_timeout_s` is asked for no more, and the current goes to the safe one. So it does when
//! displacement stays away for longer than that: [`Commanding::silent`] says what has become of the current by now without changing
//! anything, so that ticks leave no trace, and [`Commanding::resume`] does the same when displacement is back.

use super::event::Commanded;
use super::settings::Settings;
use crate::condition::Hold;
use crate::force::Inputs;
use crate::inverse::{Commander, Demand, Law};
use crate::sample::Stamp;

/// What commands currents, and what it is told.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Commanding {
    commander: Commander,
    request: Hold,
    body: Hold,
    /// A force was asked for.
    asked: bool,
}

/// What a command is made from.
pub(super) struct Moving {
    pub(super) stamp: Stamp,
    pub(super) received: Stamp,
    /// Time since the displacement before, s; however long.
    pub(super) step_s: Option<f64>,
    /// Inputs of the free lane; the drive NaN where it is not known now.
    pub(super) inputs: Option<Inputs>,
    pub(super) measured_n: Option<f64>,
}

impl Commanding {
    pub(super) fn new(commander: Commander) -> Self {
        Self { commander, request: Hold::default(), body: Hold::default(), asked: false }
    }

    /// Goes on with another commander.
    pub(super) fn take(&mut self, mut commander: Commander) {
        commander.inherit(&self.commander);
        self.commander = commander;
    }

    /// Takes a force that is asked for.
    pub(super) fn ask(&mut self, stamp: Stamp, force_n: f64) {
        self.asked = true;
        self.request.push(stamp, force_n);
    }

    /// Takes the velocity of the body.
    pub(super) fn body_moves(&mut self, stamp: Stamp, velocity_m_s: f64) {
        self.body.push(stamp, velocity_m_s);
    }

    /// What was asked for counts no more.
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

    /// The command at a displacement, where there is one.
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

    /// What the current has gone to by `now`, after `silence_s` without displacement, where that is long enough.
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
        // A cast of a float saturates.
        Some(Commanded { stamp: last.shifted((silence_s * 1e9) as i64), known_at: now, command })
    }

    fn resume(&mut self, silence_s: f64, settings: &Settings) {
        if let Some((demand, idle_s)) = idle(silence_s, settings) {
            self.commander.idle(demand, idle_s);
        }
    }
}

/// What is asked for after `silence_s` without displacement, and for how long it has been, s; `None` while the last command holds.
fn idle(silence_s: f64, settings: &Settings) -> Option<(Demand, f64)> {
    let idle_s = silence_s - settings.request_timeout_s;
    (idle_s > 0.0).then(|| (settings.law.demand(None, None, f64::NAN), idle_s))
}

/// Inputs of which nothing is known.
const UNKNOWN: Inputs = Inputs {
    dt_s: None,
    displacement_m: f64::NAN,
    velocity_m_s: f64::NAN,
    acceleration_m_s2: f64::NAN,
    drive: f64::NAN,
    case_temp_c: f64::NAN,
};
