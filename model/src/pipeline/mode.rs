//! The mode: a state machine that selects the source of the estimate, once per displacement.
//!
//! | mode | the estimate is |
//! |---|---|
//! | `arx` | ARX, seeded with measured force |
//! | `arx_coast` | ARX from its own predictions, for at most `coast_s` after measured force was lost |
//! | `model` | the simulation (free run) of the model |
//! | `hold` | the last estimate, for at most `hold_s`, when no model can run |
//! | `fault` | none |
//!
//! The machine takes the best mode whose conditions hold. `arx_coast` only follows `arx`, and `hold` only follows a mode that had an
//! estimate. `TABLE` holds all transitions.
//!
//! The machine has hysteresis. The first return to `arx` is immediate. If `arx` is lost again within [`RELAPSE_S`], the machine returns
//! only after the conditions of `arx` have held without a break for [`DWELL_S`] (from `model`) or [`COAST_DWELL_S`] (from `arx_coast`,
//! where the seeded model still gives the estimate). So an intermittent load cell causes at most two changes of model per second, and
//! the step of a change has decayed before the next.

use super::event::{Cause, Transition};
use crate::sample::Stamp;

/// If `arx` is lost again within this time of its last loss, that is a relapse, s.
pub(super) const RELAPSE_S: f64 = 2.0;
/// How long the conditions of `arx` must hold after a relapse before `model` switches to it, s.
const DWELL_S: f64 = 1.0;
/// The same for `arx_coast`, s. It is less than `coast_s`, so that force which is late now and then does not end in `model`.
const COAST_DWELL_S: f64 = 0.1;

/// Mode of a pipeline, with the values of `ForceEstimate.msg`.
///
/// ```
/// use mr_damper_model::pipeline::{Event, Mode, Models, Pipeline, Settings};
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
/// use mr_damper_model::sample::Channel;
///
/// let run = record(&Experiment::sine(0.01, 2.0, 1.2, 3.0), &Plant::default(), &Channels::default(), 1);
/// let arx = Models::alone(preset::load(preset::BEST_ARX)?);
/// let mut pipeline = Pipeline::new(arx, Settings::default())?;
/// let mut modes = Vec::new();
/// for (k, sample) in run.samples().enumerate() {
///     // Measured force is lost in the last third of the run.
///     if sample.reading.channel() == Channel::Force && k > 3 * 1024 {
///         continue;
///     }
///     pipeline.step(&sample, &mut |event| {
///         if let Event::Transition(change) = event {
///             modes.push(change.to);
///         }
///     });
/// }
/// // ARX runs while it has force, continues from its own predictions for 0.2 s, and then the simulation takes over.
/// assert_eq!(modes[modes.len() - 3..], [Mode::Arx, Mode::ArxCoast, Mode::Model]);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Mode {
    /// ARX, seeded with measured force.
    Arx = 0,
    /// ARX from its own predictions.
    ArxCoast = 1,
    /// The simulation (free run) of the model.
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

/// The conditions at a displacement. If only one mode is allowed, the conditions of the others are cleared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Conditions {
    /// The ARX model has the history that a prediction needs.
    pub(super) arx_ready: bool,
    /// Measured force is not older than `force_timeout_s`, and its use is allowed.
    pub(super) force_fresh: bool,
    /// Measured force is stuck, or implies that the damper delivers energy.
    pub(super) force_odd: bool,
    /// The free-run model has an estimate.
    pub(super) model_ready: bool,
}

impl Conditions {
    /// ARX can predict from fresh, plausible measured force.
    const fn is_fed(&self) -> bool {
        self.arx_ready && self.force_fresh && !self.force_odd
    }
}

/// The machine's timers, as the table reads them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Lasted {
    /// The mode has lasted for its whole allowed time.
    over: bool,
    /// After a relapse, the conditions of `arx` have not yet held for long enough.
    waits: bool,
}

/// A row of the machine's table.
struct Row {
    from: &'static [Mode],
    when: fn(&Conditions, Lasted) -> bool,
    to: Mode,
    cause: Cause,
}

const fn row(from: &'static [Mode], when: fn(&Conditions, Lasted) -> bool, to: Mode, cause: Cause) -> Row {
    Row { from, when, to, cause }
}

const ANY: &[Mode] = &[Mode::Arx, Mode::ArxCoast, Mode::Model, Mode::Hold, Mode::Fault];
const FED: &[Mode] = &[Mode::Arx, Mode::ArxCoast];
const HOLD: &[Mode] = &[Mode::Hold];
const ESTIMATING: &[Mode] = &[Mode::Arx, Mode::ArxCoast, Mode::Model];

/// The transitions. The first row that fits is taken; the last row always fits.
#[rustfmt::skip]
const TABLE: [Row; 11] = [
    row(ANY, |c, t| c.is_fed() && !t.waits, Mode::Arx, Cause::ForceFresh),
    row(FED, |c, t| c.arx_ready && !c.force_odd && !t.over, Mode::ArxCoast, Cause::ForceLost),
    row(FED, |c, _| c.model_ready && c.force_odd, Mode::Model, Cause::ForceImplausible),
    row(&[Mode::ArxCoast], |c, t| c.model_ready && t.over, Mode::Model, Cause::CoastEnded),
    row(FED, |c, _| c.model_ready && c.arx_ready, Mode::Model, Cause::ForceLost),
    row(FED, |c, _| c.model_ready, Mode::Model, Cause::ArxUnready),
    row(ANY, |c, _| c.model_ready, Mode::Model, Cause::ModelReady),
    row(ESTIMATING, |_, _| true, Mode::Hold, Cause::InputsMissing),
    row(HOLD, |_, t| !t.over, Mode::Hold, Cause::InputsMissing),
    row(HOLD, |_, _| true, Mode::Fault, Cause::HoldEnded),
    row(ANY, |_, _| true, Mode::Fault, Cause::InputsMissing),
];

/// The machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ModeMachine {
    mode: Mode,
    since: Option<Stamp>,
    /// When the present unbroken stretch began in which the conditions of `arx` hold.
    fed_since: Option<Stamp>,
    /// When `arx` was last lost, and whether that was a relapse.
    lost: Option<Stamp>,
    has_relapsed: bool,
}

impl Default for ModeMachine {
    /// Starts in `fault`, because no estimate exists yet.
    fn default() -> Self {
        Self { mode: Mode::Fault, since: None, fed_since: None, lost: None, has_relapsed: false }
    }
}

impl ModeMachine {
    /// The current mode.
    #[must_use]
    pub(super) const fn mode(&self) -> Mode {
        self.mode
    }

    /// Seconds since the mode was entered; zero before the first change.
    #[must_use]
    pub(super) fn seconds_in_mode(&self, now: Stamp) -> f64 {
        self.since.map_or(0.0, |since| now.since(since).get())
    }

    /// Applies the table.
    #[inline]
    fn update_to_best(&mut self, now: Stamp, c: Conditions, coast_s: f64, hold_s: f64) -> Option<Transition> {
        let elapsed_s = self.seconds_in_mode(now);
        let over = match self.mode {
            Mode::ArxCoast => elapsed_s > coast_s,
            Mode::Hold => elapsed_s > hold_s,
            // With `coast_s` = 0, coasting is over before it starts.
            _ => coast_s <= 0.0,
        };
        let lasted = Lasted { over, waits: self.waits(now, &c) };
        let row = TABLE.iter().find(|row| row.from.contains(&self.mode) && (row.when)(&c, lasted))?;
        self.force_to(row.to, row.cause, now)
    }

    /// Notes whether the conditions of `arx` hold. True while a relapse delays the return to `arx` and another mode has an estimate.
    #[inline]
    fn waits(&mut self, now: Stamp, c: &Conditions) -> bool {
        self.fed_since = if c.is_fed() { self.fed_since.or(Some(now)) } else { None };
        let dwell_s = match self.mode {
            Mode::ArxCoast => COAST_DWELL_S,
            Mode::Model if c.model_ready => DWELL_S,
            _ => return false,
        };
        self.has_relapsed && self.fed_since.is_none_or(|since| now.since(since).get() < dwell_s)
    }

    /// Notes that `arx` is lost at `now`, or that the machine restarts (`to` is `fault`).
    fn note_loss(&mut self, to: Mode, now: Stamp) {
        if to == Mode::Fault {
            (self.fed_since, self.lost, self.has_relapsed) = (None, None, false);
        } else if self.mode == Mode::Arx {
            self.has_relapsed = self.lost.is_some_and(|lost| now.since(lost).get() <= RELAPSE_S);
            self.lost = Some(now);
        }
    }

    /// Takes the conditions at stamp `now` and returns the change of mode, if there is one. If `only` names a mode, the machine uses
    /// that mode while its conditions hold, and otherwise hold and fault.
    #[inline]
    pub(super) fn update(
        &mut self,
        only: Option<Mode>,
        now: Stamp,
        c: Conditions,
        coast_s: f64,
        hold_s: f64,
    ) -> Option<Transition> {
        let allowed = match only {
            None => return self.update_to_best(now, c, coast_s, hold_s),
            Some(Mode::Fault) => return self.force_to(Mode::Fault, Cause::Requested, now),
            Some(Mode::Model) => Conditions { arx_ready: false, force_odd: false, ..c },
            Some(_) => Conditions { model_ready: false, ..c },
        };
        let requested = only.filter(|only| *only != self.mode);
        let changed = self.update_to_best(now, allowed, coast_s, hold_s)?;
        let cause = if Some(changed.to) == requested { Cause::Requested } else { changed.cause };
        Some(Transition { cause, ..changed })
    }

    /// Switches to `to` whatever the conditions; `None` if the machine is in that mode already.
    pub(super) fn force_to(&mut self, to: Mode, cause: Cause, now: Stamp) -> Option<Transition> {
        if to == self.mode {
            return None;
        }
        self.note_loss(to, now);
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
                let entries = [(false, false), (true, false), (false, true)].map(|(over, waits)| {
                    let lasted = Lasted { over, waits };
                    let row = TABLE.iter().find(|row| row.from.contains(from) && (row.when)(&c, lasted));
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
                let mut later = String::new();
                let may_wait = *from == Mode::ArxCoast || (*from == Mode::Model && is(3));
                for (when, other, may_be) in
                    [("over", &entries[1], true), ("it waits", &entries[2], may_wait)]
                {
                    if may_be && *other != entries[0] {
                        write!(later, "; when {when} {other}").expect("a text");
                    }
                }
                writeln!(
                    text,
                    "  {:<5} {:<5} {:<3} {:<5}  {}{later}",
                    when[0], when[1], when[2], when[3], entries[0]
                )
                .expect("a text");
            }
        }
        insta::assert_snapshot!(text);
    }

    /// The modes of a machine with `only` one allowed mode, one second apart: with all inputs, with implausible force, with lost force,
    /// with ARX not ready as well, then twice with nothing.
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

    /// The transitions of a machine under a sequence of conditions, each of which lasts a number of milliseconds; one update per
    /// millisecond.
    fn transition_list(steps: &[(Conditions, i64)]) -> String {
        let (mut machine, mut ms, mut text) = (ModeMachine::default(), 0, String::new());
        for (conditions, lasts_ms) in steps {
            for _ in 0..*lasts_ms {
                let now = Stamp::from_nanos(ms * 1_000_000);
                if let Some(t) = machine.update(None, now, *conditions, 0.2, 1.0) {
                    let change = format!("{} -> {}", t.from.name(), t.to.name());
                    writeln!(text, "{ms:5} ms  {change:<18} {}", t.cause.text()).expect("a text");
                }
                ms += 1;
            }
        }
        text
    }

    const FED_WELL: Conditions =
        Conditions { arx_ready: true, force_fresh: true, force_odd: false, model_ready: true };

    #[test]
    fn an_arx_that_is_lost_again_and_again_has_to_be_good_for_a_second() {
        let unready = Conditions { arx_ready: false, ..FED_WELL };
        let mut steps = vec![(FED_WELL, 100)];
        // Lost every 20 ms for half a second, good for 900 ms, lost once more, and good for long.
        steps.extend([(unready, 1), (FED_WELL, 19)].repeat(25));
        steps.extend([(FED_WELL, 881), (unready, 1), (FED_WELL, 4000)]);
        // Lost once more, long after.
        steps.extend([(unready, 5), (FED_WELL, 100)]);
        insta::assert_snapshot!(transition_list(&steps));
    }

    #[test]
    fn force_that_is_late_again_and_again_coasts() {
        let late = Conditions { force_fresh: false, ..FED_WELL };
        let mut steps = vec![(FED_WELL, 100)];
        // Three short losses, half a second apart.
        steps.extend([(late, 10), (FED_WELL, 490)].repeat(3));
        // A load cell that is slower than force_timeout_s.
        steps.extend([(late, 10), (FED_WELL, 50)].repeat(20));
        steps.push((FED_WELL, 1500));
        insta::assert_snapshot!(transition_list(&steps));
    }

    #[test]
    fn random_conditions_do_not_make_the_mode_flap() {
        let mut random = 1_u64;
        let mut next = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            random >> 33
        };
        let (mut machine, mut changes) = (ModeMachine::default(), 0);
        for ms in 0..10_000 {
            let conditions = Conditions { arx_ready: !next().is_multiple_of(3), ..FED_WELL };
            let now = Stamp::from_nanos(ms * 1_000_000);
            changes += usize::from(machine.update(None, now, conditions, 0.2, 1.0).is_some());
        }
        assert!(changes <= 6, "{changes} changes of mode in 10 s");
    }
}
