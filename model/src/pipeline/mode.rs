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
//! The best mode that its conditions allow is taken; `arx_coast` only follows `arx`, and `hold` only follows a mode that had an
//! estimate. `TABLE` says it all.

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

/// What the machine is told at a displacement. Where one mode alone is allowed, the others lack what they need.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conditions {
    /// The ARX model has all that it needs for a prediction.
    pub arx_ready: bool,
    /// Measured force is not older than `force_timeout_s`, and its use is allowed.
    pub force_fresh: bool,
    /// It stands still, or gives energy.
    pub force_odd: bool,
    /// The free model has an estimate.
    pub model_ready: bool,
}

/// A row of the machine's table.
struct Row {
    from: &'static [Mode],
    /// The conditions, and whether the mode has lasted for as long as it may.
    when: fn(&Conditions, bool) -> bool,
    to: Mode,
    cause: Cause,
}

const fn row(from: &'static [Mode], when: fn(&Conditions, bool) -> bool, to: Mode, cause: Cause) -> Row {
    Row { from, when, to, cause }
}

const ANY: &[Mode] = &[Mode::Arx, Mode::ArxCoast, Mode::Model, Mode::Hold, Mode::Fault];
const FED: &[Mode] = &[Mode::Arx, Mode::ArxCoast];
const HOLD: &[Mode] = &[Mode::Hold];
const ESTIMATING: &[Mode] = &[Mode::Arx, Mode::ArxCoast, Mode::Model];

/// The machine: the first row that fits is taken. The last one always does.
#[rustfmt::skip]
const TABLE: [Row; 11] = [
    row(ANY, |c, _| c.arx_ready && c.force_fresh && !c.force_odd, Mode::Arx, Cause::ForceFresh),
    row(FED, |c, over| c.arx_ready && !c.force_odd && !over, Mode::ArxCoast, Cause::ForceLost),
    row(FED, |c, _| c.model_ready && c.force_odd, Mode::Model, Cause::ForceImplausible),
    row(&[Mode::ArxCoast], |c, over| c.model_ready && over, Mode::Model, Cause::CoastEnded),
    row(FED, |c, _| c.model_ready && c.arx_ready, Mode::Model, Cause::ForceLost),
    row(FED, |c, _| c.model_ready, Mode::Model, Cause::ArxUnready),
    row(ANY, |c, _| c.model_ready, Mode::Model, Cause::ModelReady),
    row(ESTIMATING, |_, _| true, Mode::Hold, Cause::InputsMissing),
    row(HOLD, |_, over| !over, Mode::Hold, Cause::InputsMissing),
    row(HOLD, |_, _| true, Mode::Fault, Cause::HoldEnded),
    row(ANY, |_, _| true, Mode::Fault, Cause::InputsMissing),
];

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

    /// Goes by the table.
    #[inline]
    fn update_to_best(&mut self, now: Stamp, c: Conditions, coast_s: f64, hold_s: f64) -> Option<Transition> {
        let elapsed_s = self.seconds_in_mode(now);
        let over = match self.mode {
            Mode::ArxCoast => elapsed_s > coast_s,
            Mode::Hold => elapsed_s > hold_s,
            // What is not entered takes no time.
            _ => coast_s <= 0.0,
        };
        let row = TABLE.iter().find(|row| row.from.contains(&self.mode) && (row.when)(&c, over))?;
        self.force_to(row.to, row.cause, now)
    }

    /// Takes the conditions at stamp `now` and returns the change of mode, if there is one. Where `only` one mode is allowed, it is that
    /// one as long as its own conditions last, or else hold and fault.
    #[inline]
    pub fn update(
        &mut self,
        only: Option<Mode>,
        now: Stamp,
        c: Conditions,
        coast_s: f64,
        hold_s: f64,
    ) -> Option<Transition> {
        let allowed = match only {
            None => return self.update_to_best(now, c, coast_s, hold_s),
            Some(Mode::Fault) => return self.force_to(Mode::Fault, Cause::Asked, now),
            Some(Mode::Model) => Conditions { arx_ready: false, force_odd: false, ..c },
            Some(_) => Conditions { model_ready: false, ..c },
        };
        let asked = only.filter(|only| *only != self.mode);
        let changed = self.update_to_best(now, allowed, coast_s, hold_s)?;
        let cause = if Some(changed.to) == asked { Cause::Asked } else { changed.cause };
        Some(Transition { cause, ..changed })
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write;

    /// Every mode under every combination of conditions.
    #[test]
    fn the_table_written_out() {
        let mut text = String::new();
        for from in ANY {
            writeln!(text, "from {}", from.name()).expect("a text");
            for bits in 0..16_u32 {
                let is = |bit: u32| bits & (8 >> bit) != 0;
                let c =
                    Conditions { arx_ready: is(0), force_fresh: is(1), force_odd: is(2), model_ready: is(3) };
                let told = [false, true].map(|over| {
                    let row = TABLE.iter().find(|row| row.from.contains(from) && (row.when)(&c, over));
                    let row = row.expect("the last row always fits");
                    if row.to == *from {
                        "stays".to_owned()
                    } else {
                        format!("{} ({:?})", row.to.name(), row.cause)
                    }
                });
                let word = |there: bool, word: &'static str| if there { word } else { "-" };
                let when =
                    [word(is(0), "arx"), word(is(1), "fresh"), word(is(2), "odd"), word(is(3), "model")];
                let later =
                    if told[0] == told[1] { String::new() } else { format!("; when over {}", told[1]) };
                writeln!(
                    text,
                    "  {:<5} {:<5} {:<3} {:<5}  {}{later}",
                    when[0], when[1], when[2], when[3], told[0]
                )
                .expect("a text");
            }
        }
        insta::assert_snapshot!(text);
    }

    /// What a machine goes through that is allowed `only` one mode: three displacements with all there is, then without
    /// force, then without anything, a second apart.
    #[test]
    fn one_mode_alone_is_held_as_long_as_its_conditions_last() {
        let all = Conditions { arx_ready: true, force_fresh: true, force_odd: false, model_ready: true };
        let script = [
            all,
            Conditions { force_odd: true, ..all },
            Conditions { force_fresh: false, ..all },
            Conditions { arx_ready: false, force_fresh: false, ..all },
            Conditions { arx_ready: false, force_fresh: false, model_ready: false, ..all },
            Conditions { arx_ready: false, force_fresh: false, model_ready: false, ..all },
        ];
        let mut text = String::new();
        for only in [None, Some(Mode::Arx), Some(Mode::Model), Some(Mode::Fault)] {
            writeln!(text, "only {}", only.map_or("the best", Mode::name)).expect("a text");
            let mut machine = ModeMachine::default();
            for (second, conditions) in (0..).zip(script) {
                let now = Stamp::from_nanos(second * 1_000_000_000);
                let change = machine.update(only, now, conditions, 0.5, 0.5);
                let why = change.map_or(String::new(), |change| format!(" ({})", change.cause.text()));
                writeln!(text, "  {}{why}", machine.mode().name()).expect("a text");
            }
        }
        insta::assert_snapshot!(text);
    }
}
