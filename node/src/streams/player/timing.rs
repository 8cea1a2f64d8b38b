//! When the next sample or message is played: its time, pauses, steps, jumps, keys and signals.

use super::pace::Pace;
use super::{Control, Keys, LOOK_EVERY, Rate};
use crate::settings::interrupt::Interrupt;
use mr_damper_model::sample::Stamp;
use std::time::{Duration, Instant};

/// The next action of a player.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Next {
    /// Play what was waited for.
    Play,
    /// Continue at this time of the run, s.
    Jump(f64),
    /// End.
    End,
}

/// Waits for what is played next.
pub struct Timing<'a> {
    control: &'a Control,
    pace: Pace,
    interrupt: &'a Interrupt,
    keys: Option<&'a Keys>,
}

impl<'a> Timing<'a> {
    /// Begins at `from_s` of a run, with the speed `rate` unless `control` has another one.
    #[must_use]
    pub fn new(
        control: &'a Control,
        rate: Rate,
        from_s: f64,
        interrupt: &'a Interrupt,
        keys: Option<&'a Keys>,
    ) -> Self {
        Self { control, pace: Pace::new(rate, from_s), interrupt, keys }
    }

    /// Waits until what is at `next_s` of the run is due, or until a jump or the end is requested. `first` is the first stamp of the run.
    /// Meanwhile `tick` is called with the time now and the position in the run, s; it returns the time until its next call.
    pub fn next(
        &mut self,
        first: Stamp,
        next_s: f64,
        mut tick: impl FnMut(Instant, f64) -> Duration,
    ) -> Next {
        loop {
            if let Some(keys) = self.keys {
                keys.look(self.control, self.interrupt);
            }
            if self.interrupt.is_raised() {
                return Next::End;
            }
            let now = Instant::now();
            let until_tick = tick(now, self.pace.position(now, next_s));
            let mut state = self.control.lock();
            if let Some(to) = state.seek.take() {
                let to_s = to.since(first).get();
                self.pace.jump(to_s);
                return Next::Jump(to_s);
            }
            let is_waiting = state.paused && state.steps == 0;
            if state.paused {
                self.pace.stand(now, next_s);
            } else {
                self.pace.run(state.rate(), now, next_s);
            }
            let left = if is_waiting { LOOK_EVERY } else { self.pace.left(now, next_s) };
            if left.is_zero() {
                return Next::Play;
            }
            drop(self.control.wait(state, left.min(LOOK_EVERY).min(until_tick)));
        }
    }

    /// Notes that what is at `at_s` of the run was played.
    pub fn played(&mut self, at_s: f64) {
        self.pace.sent(Instant::now(), at_s);
        self.control.played();
    }
}
