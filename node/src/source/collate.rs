//! Brings samples of one stamp together before their displacement goes on.
//!
//! An estimate is made when displacement arrives, so the drive, velocity and force of its stamp should be there by then.
//! They travel on topics of their own, and a publisher's middleware may send them in another order than they were
//! published (ours does, under load: one queue a writer). So a displacement is held back while a channel that
//! *usually shares its stamps* lacks the reading of this one, for at most a set time.
//!
//! A channel counts as sharing once a reading has borne the very stamp of a displacement, and no longer when one
//! was waited for in vain: a slower drive, or one with stamps of its own, is never waited for, and a drive that stops
//! costs the wait once.

use mr_damper_model::sample::{Channel, Sample, Stamp};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Channels that displacement waits for.
const COMPANIONS: [Channel; 3] = [Channel::Drive, Channel::Velocity, Channel::Force];
/// Displacement stamps that a reading is compared with to learn whether its channel shares them.
const REMEMBERED: usize = 64;

/// What is known of a companion channel.
#[derive(Debug, Clone, Copy, Default)]
struct Companion {
    last: Option<Stamp>,
    shares: bool,
}

/// Holds displacements back until their companions are there.
#[derive(Debug)]
pub struct Collator {
    wait: Duration,
    companions: [Companion; COMPANIONS.len()],
    held: VecDeque<(Sample, Instant)>,
    stamps: VecDeque<Stamp>,
}

impl Collator {
    /// A collator that holds a displacement back for at most `wait`.
    #[must_use]
    pub fn new(wait: Duration) -> Self {
        Self {
            wait,
            companions: [Companion::default(); COMPANIONS.len()],
            held: VecDeque::with_capacity(REMEMBERED),
            stamps: VecDeque::with_capacity(REMEMBERED),
        }
    }

    /// Takes a batch of samples that arrived by `now`, in any order, and hands on what is ready, in order of stamps.
    pub fn take(&mut self, batch: &mut Vec<Sample>, now: Instant, mut on: impl FnMut(Sample)) {
        batch.sort_by_key(|sample| (sample.stamp, sample.reading.channel()));
        for sample in batch.iter().filter(|s| s.reading.channel() == Channel::Displacement) {
            if self.stamps.len() == REMEMBERED {
                self.stamps.pop_front();
            }
            self.stamps.push_back(sample.stamp);
        }
        for sample in batch.drain(..) {
            let channel = sample.reading.channel();
            if channel == Channel::Displacement {
                self.held.push_back((sample, now + self.wait));
            } else {
                if let Some(index) = COMPANIONS.iter().position(|c| *c == channel) {
                    let companion = &mut self.companions[index];
                    companion.last = Some(sample.stamp);
                    companion.shares |= self.stamps.contains(&sample.stamp);
                }
                // What came early is remembered by the pipeline, by stamp.
                on(sample);
            }
        }
        self.release(now, on);
    }

    /// Hands on the displacements that are complete by now, or have waited long enough.
    pub fn release(&mut self, now: Instant, mut on: impl FnMut(Sample)) {
        while let Some((sample, deadline)) = self.held.front() {
            let lacking = |companion: &Companion| {
                companion.shares && companion.last.is_some_and(|last| last < sample.stamp)
            };
            if self.companions.iter().any(lacking) {
                if now < *deadline {
                    return;
                }
                let stamp = sample.stamp;
                for companion in &mut self.companions {
                    companion.shares &= companion.last.is_none_or(|last| last >= stamp);
                }
            }
            if let Some((sample, _)) = self.held.pop_front() {
                on(sample);
            }
        }
    }

    /// True while a displacement is held back: then [`Collator::release`] wants calling.
    #[must_use]
    pub fn is_holding(&self) -> bool {
        !self.held.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::sample::{Drive, DriveKind, Reading};
    use mr_damper_model::units::{Metre, Newton};

    const WAIT: Duration = Duration::from_millis(10);

    fn sample(ms: i64, channel: char) -> Sample {
        let stamp = Stamp::from_nanos(ms * 1_000_000);
        let reading = match channel {
            'x' => Reading::Displacement(Metre(0.0)),
            'i' => Reading::Drive(Drive::new(DriveKind::CoilCurrent, 0.0)),
            _ => Reading::Force(Newton(0.0)),
        };
        Sample { stamp, received: stamp, reading }
    }

    /// Feeds batches such as "i0 x0" at the given times (ms) and writes down what comes out when.
    fn story(batches: &[(u64, &str)]) -> String {
        let start = Instant::now();
        let mut collator = Collator::new(WAIT);
        let mut lines = Vec::new();
        for (at_ms, batch) in batches {
            let mut batch: Vec<Sample> = batch
                .split_whitespace()
                .map(|word| {
                    sample(word[1..].parse().expect("a number"), word.chars().next().expect("a letter"))
                })
                .collect();
            let mut out = Vec::new();
            collator.take(&mut batch, start + Duration::from_millis(*at_ms), |s| {
                let name = match s.reading.channel() {
                    Channel::Displacement => 'x',
                    Channel::Drive => 'i',
                    _ => 'f',
                };
                out.push(format!("{name}{}", s.stamp.nanos() / 1_000_000));
            });
            lines.push(format!("{at_ms:>3} ms: {}", out.join(" ")));
        }
        lines.join("\n")
    }

    #[test]
    fn a_displacement_waits_for_the_drive_of_its_stamp() {
        insta::assert_snapshot!(story(&[(0, "x0 i0 f0"), (1, "x1 f1"), (2, "i1"), (3, "f2 x2"), (4, "x3 i2"), (5, "i3 f3")]), @"
          0 ms: i0 f0 x0
          1 ms: f1
          2 ms: i1 x1
          3 ms: f2
          4 ms: i2 x2
          5 ms: i3 f3 x3
        ");
    }

    #[test]
    fn a_drive_that_stops_costs_the_wait_once() {
        insta::assert_snapshot!(story(&[(0, "i0 x0"), (1, "x1"), (5, "x5"), (11, "x11"), (12, "x12"), (13, "i12 x13"), (14, "i13")]), @"
          0 ms: i0 x0
          1 ms: 
          5 ms: 
         11 ms: x1 x5 x11
         12 ms: x12
         13 ms: i12
         14 ms: i13 x13
        ");
    }

    #[test]
    fn a_slower_drive_is_not_waited_for() {
        insta::assert_snapshot!(story(&[(0, "i0"), (1, "x1"), (2, "x2"), (10, "x10"), (11, "i9")]), @"
          0 ms: i0
          1 ms: x1
          2 ms: x2
         10 ms: x10
         11 ms: i9
        ");
    }
}
