//! The gate: what may enter. Values that are not finite, stamps that do not increase within their channel, and
//! a drive of the wrong kind are refused, one by one, without harm to what is there.
//!
//! One sample with a wrong stamp must not throw away history, yet a clock that was set back (or a simulation
//! that was restarted) must not block the node for good. So a sample whose stamp steps back is refused, but
//! when [`JUMP_AFTER`] in a row increase among themselves, time has jumped: they are the new truth.

use super::event::Refused;
use crate::sample::{Channel, DriveKind, Reading, Sample, Stamp};

/// Samples in a row from another time that make it a jump.
const JUMP_AFTER: u32 = 3;

/// What the gate says of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    Accept,
    Refuse(Refused),
    /// The sample is the first of a new time on its channel: drop the channel's history (all history, if
    /// it is displacement), then use it.
    TimeJumped,
}

/// What the gate remembers of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Seen {
    last: Option<Stamp>,
    /// Newest of the samples from another time, and how many in a row there were.
    other: Option<Stamp>,
    other_count: u32,
}

/// The gate.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Gate {
    seen: [Seen; Channel::ALL.len()],
}

impl Gate {
    #[inline]
    pub(super) fn judge(&mut self, sample: &Sample, wanted: Option<DriveKind>) -> Verdict {
        if !sample.reading.get().is_finite() {
            return Verdict::Refuse(Refused::NotFinite);
        }
        if let (Reading::Drive(drive), Some(wanted)) = (sample.reading, wanted)
            && drive.kind() != wanted
        {
            return Verdict::Refuse(Refused::WrongDrive);
        }
        let channel = sample.reading.channel();
        let verdict = self.seen[channel as usize].judge(sample.stamp);
        if verdict == Verdict::TimeJumped && channel == Channel::Displacement {
            // The other channels start anew as well, each with whatever comes next.
            let displacement = self.seen[channel as usize];
            *self = Self::default();
            self.seen[channel as usize] = displacement;
        }
        verdict
    }
}

impl Seen {
    #[inline]
    fn judge(&mut self, stamp: Stamp) -> Verdict {
        match self.last {
            Some(last) if stamp == last => Verdict::Refuse(Refused::Repeated),
            Some(last) if stamp < last => {
                let follows = self.other.is_some_and(|other| stamp > other);
                self.other_count = if follows { self.other_count + 1 } else { 1 };
                self.other = Some(stamp);
                if self.other_count < JUMP_AFTER {
                    return Verdict::Refuse(Refused::TimeBack);
                }
                *self = Self { last: Some(stamp), ..Self::default() };
                Verdict::TimeJumped
            }
            _ => {
                *self = Self { last: Some(stamp), ..Self::default() };
                Verdict::Accept
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::{Ampere, Metre};

    fn at(ms: i64, reading: Reading) -> Sample {
        let stamp = Stamp::from_nanos(ms * 1_000_000);
        Sample { stamp, received: stamp, reading }
    }

    fn verdicts(stamps_ms: &[i64]) -> String {
        let mut gate = Gate::default();
        stamps_ms
            .iter()
            .map(|ms| match gate.judge(&at(*ms, Reading::Displacement(Metre(0.0))), None) {
                Verdict::Accept => 'a',
                Verdict::Refuse(Refused::Repeated) => 'r',
                Verdict::Refuse(Refused::TimeBack) => 'b',
                Verdict::Refuse(_) => '?',
                Verdict::TimeJumped => 'J',
            })
            .collect()
    }

    #[test]
    fn stamps_that_do_not_increase_are_refused_one_by_one() {
        assert_eq!(verdicts(&[0, 1, 2, 2, 3]), "aaara");
        assert_eq!(verdicts(&[0, 1, 2, -10_000, 3, 4]), "aaabaa", "one late sample harms nobody");
        assert_eq!(verdicts(&[10, 11, 5, 4, 3, 2, 12]), "aabbbba", "falling stamps are no new time");
    }

    #[test]
    fn a_clock_that_was_set_back_is_believed_after_three() {
        assert_eq!(verdicts(&[100, 101, 0, 1, 2, 3]), "aabbJa");
        assert_eq!(verdicts(&[0, 1, 10_000, 2, 3, 4, 5]), "aaabbJa", "one stamp from the future costs three");
    }

    #[test]
    fn values_and_drives_are_checked() {
        let mut gate = Gate::default();
        let drive = at(0, Reading::Drive(crate::sample::Drive::CoilCurrent(Ampere(1.0))));
        assert_eq!(gate.judge(&drive, Some(DriveKind::CommandVoltage)), Verdict::Refuse(Refused::WrongDrive));
        assert_eq!(gate.judge(&drive, Some(DriveKind::CoilCurrent)), Verdict::Accept);
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let sample = at(1, Reading::Displacement(Metre(value)));
            assert_eq!(gate.judge(&sample, None), Verdict::Refuse(Refused::NotFinite));
        }
    }
}
