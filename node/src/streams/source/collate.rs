//! Collects the samples of one stamp before their displacement is passed on.
//!
//! An estimate is made when displacement arrives, so the drive, velocity and force with the same stamp should have
//! arrived by then. They travel on separate topics, and a publisher's middleware may send them in another order than
//! they were published (this project's does so under load, because each writer has its own queue). So a displacement is
//! held back for a limited time while a channel that *usually shares its stamps* has no reading with this stamp.
//!
//! At first, drive and force are assumed to share stamps, and velocity if the model needs it. A channel loses this
//! status when displacement has waited for it without result. It regains the status once its readings have had the
//! stamps of two consecutive displacements. So the first displacement waits for the first drive. A slower drive, one
//! with its own stamps, or one that stops, causes the wait only once.

use mr_damper_model::sample::{Channel, Sample, Stamp};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// The channels that displacement waits for.
const COMPANIONS: [Channel; 3] = [Channel::Drive, Channel::Velocity, Channel::Force];
/// Number of displacement stamps that a reading is compared with, to learn whether its channel shares them.
const REMEMBERED: usize = 64;
/// Number of samples that can be held back. Five channels at 1 kHz deliver fewer in the longest configurable wait, and
/// the ring behind can hold more.
const HELD: usize = 8192;

/// State of a companion channel.
#[derive(Debug, Clone, Copy)]
struct Companion {
    last: Option<Stamp>,
    shares: bool,
}

impl Companion {
    /// Notes a reading. `displacements` are the latest displacement stamps.
    fn note(&mut self, stamp: Stamp, displacements: &VecDeque<Stamp>) {
        let same = displacements.iter().position(|displacement| *displacement == stamp);
        let previous = same.and_then(|index| index.checked_sub(1)).map(|index| displacements[index]);
        self.shares |= previous.is_some() && previous == self.last;
        self.last = Some(stamp);
    }

    /// True if a reading with `stamp` is still expected.
    fn lacks(&self, stamp: Stamp) -> bool {
        self.shares && self.last.is_none_or(|last| last < stamp)
    }
}

/// Holds displacements back until their companions have arrived, and also the samples after them.
#[derive(Debug)]
pub struct Collator {
    wait: Duration,
    wants_velocity: bool,
    companions: [Companion; COMPANIONS.len()],
    /// Sorted by stamp, then by channel; each with the latest time to pass it on.
    held: VecDeque<(Sample, Instant)>,
    stamps: VecDeque<Stamp>,
    incomplete: u64,
}

impl Collator {
    /// A collator that holds a displacement back for at most `wait`.
    #[must_use]
    pub fn new(wait: Duration) -> Self {
        Self {
            wait,
            wants_velocity: false,
            companions: COMPANIONS
                .map(|channel| Companion { last: None, shares: channel != Channel::Velocity }),
            incomplete: 0,
            held: VecDeque::with_capacity(HELD),
            stamps: VecDeque::with_capacity(REMEMBERED),
        }
    }

    /// Sets whether the model needs measured velocity; its stamps are then assumed to be shared too.
    pub fn want_velocity(&mut self, needed: bool) {
        if needed != self.wants_velocity {
            self.wants_velocity = needed;
            for (channel, companion) in COMPANIONS.iter().zip(&mut self.companions) {
                companion.shares = if *channel == Channel::Velocity { needed } else { companion.shares };
            }
        }
    }

    /// Takes a batch of samples, in any order, that arrived by `now`. Passes the samples that are ready to `on`, in
    /// order of stamps.
    pub fn take(&mut self, batch: &mut Vec<Sample>, now: Instant, on: impl FnMut(Sample)) {
        batch.sort_by_key(order);
        for sample in batch.iter().filter(|s| s.reading.channel() == Channel::Displacement) {
            if self.stamps.len() == REMEMBERED {
                self.stamps.pop_front();
            }
            self.stamps.push_back(sample.stamp);
        }
        for sample in batch.drain(..) {
            let channel = sample.reading.channel();
            if let Some(index) = COMPANIONS.iter().position(|c| *c == channel) {
                self.companions[index].note(sample.stamp, &self.stamps);
            }
            let place = self.held.partition_point(|(held, _)| order(held) <= order(&sample));
            self.held.insert(place, (sample, now + self.wait));
        }
        self.release(now, on);
    }

    /// Passes on all samples before the first displacement that still has to wait.
    fn release(&mut self, now: Instant, mut on: impl FnMut(Sample)) {
        while let Some((sample, deadline)) = self.held.front() {
            if sample.reading.channel() == Channel::Displacement {
                let stamp = sample.stamp;
                if self.companions.iter().any(|companion| companion.lacks(stamp)) {
                    if now < *deadline && self.held.len() < HELD {
                        return;
                    }
                    self.incomplete += 1;
                    for companion in self.companions.iter_mut().filter(|companion| companion.lacks(stamp)) {
                        companion.shares = false;
                    }
                }
            }
            if let Some((sample, _)) = self.held.pop_front() {
                on(sample);
            }
        }
    }

    /// Number of displacements that were passed on without a companion that they had waited for.
    #[must_use]
    pub fn incomplete(&self) -> u64 {
        self.incomplete
    }

    /// True while samples are held back. [`Collator::take`] must then be called again, if necessary with an empty
    /// batch.
    #[must_use]
    pub fn is_holding(&self) -> bool {
        !self.held.is_empty()
    }
}

/// The sort key of samples: a displacement comes after all other samples with its stamp.
fn order(sample: &Sample) -> (Stamp, Channel) {
    (sample.stamp, sample.reading.channel())
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::sample::{Drive, DriveKind, Reading};
    use mr_damper_model::units::{Metre, MetrePerSecond, Newton};

    const WAIT: Duration = Duration::from_millis(10);

    fn sample(ms: i64, channel: char) -> Sample {
        let stamp = Stamp::from_nanos(ms * 1_000_000);
        let reading = match channel {
            'x' => Reading::Displacement(Metre(0.0)),
            'i' => Reading::Drive(Drive::new(DriveKind::CoilCurrent, 0.0)),
            'v' => Reading::Velocity(MetrePerSecond(0.0)),
            _ => Reading::Force(Newton(0.0)),
        };
        Sample { stamp, received: stamp, reading }
    }

    /// Feeds batches such as "i0 x0" at the given times (ms), and records what is passed on when.
    fn story(batches: &[(u64, &str)]) -> String {
        let start = Instant::now();
        let mut collator = Collator::new(WAIT);
        collator.want_velocity(true);
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
                    Channel::Velocity => 'v',
                    _ => 'f',
                };
                out.push(format!("{name}{}", s.stamp.nanos() / 1_000_000));
            });
            lines.push(format!("{at_ms:>3} ms: {}", out.join(" ")));
        }
        lines.push(format!("incomplete: {}", collator.incomplete()));
        lines.join("\n")
    }

    #[test]
    fn the_first_displacement_waits_for_all_channels_for_a_limited_time() {
        insta::assert_snapshot!(story(&[(0, "x0 i0"), (4, "f0"), (10, ""), (11, "x11 i11 f11")]), @"
            0 ms: i0
            4 ms: f0
           10 ms: x0
           11 ms: i11 f11 x11
          incomplete: 1
        ");
    }

    #[test]
    fn a_displacement_waits_for_the_drive_of_its_stamp() {
        let batches =
            [(0, "x0 i0 f0 v0"), (1, "x1 f1 v1"), (2, "i1"), (3, "f2 x2 v2"), (4, "x3 i2"), (5, "i3 f3 v3")];
        insta::assert_snapshot!(story(&batches), @"
            0 ms: i0 v0 f0 x0
            1 ms: v1 f1
            2 ms: i1 x1
            3 ms: v2 f2
            4 ms: i2 x2
            5 ms: i3 v3 f3 x3
          incomplete: 0
        ");
    }

    #[test]
    fn a_drive_that_stops_causes_the_wait_once() {
        let batches =
            [(0, "i0 x0 f0 v0"), (1, "x1 f1 v1"), (5, "x5 f5 v5"), (11, "x11 f11 v11"), (12, "x12 f12 v12")];
        insta::assert_snapshot!(story(&batches), @"
            0 ms: i0 v0 f0 x0
            1 ms: v1 f1
            5 ms: 
           11 ms: x1 v5 f5 x5 v11 f11 x11
           12 ms: v12 f12 x12
          incomplete: 1
        ");
    }

    #[test]
    fn a_drive_that_shares_stamps_again_is_waited_for_again() {
        let batches =
            [(0, "x0"), (10, "x10"), (20, "i20 x20"), (30, "x30"), (31, "i30"), (40, "x40"), (41, "i40")];
        insta::assert_snapshot!(story(&batches), @"
            0 ms: 
           10 ms: x0 x10
           20 ms: i20 x20
           30 ms: x30
           31 ms: i30
           40 ms: 
           41 ms: i40 x40
          incomplete: 1
        ");
    }

    #[test]
    fn a_slower_drive_is_not_waited_for() {
        let batches =
            [(0, "i0 x0"), (10, "x10"), (11, ""), (20, "x20"), (30, "i30 x30"), (40, "x40"), (50, "x50")];
        insta::assert_snapshot!(story(&batches), @"
            0 ms: i0
           10 ms: x0
           11 ms: 
           20 ms: x10 x20
           30 ms: i30 x30
           40 ms: x40
           50 ms: x50
          incomplete: 2
        ");
    }
}
