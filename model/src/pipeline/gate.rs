//! The gate: it decides which samples are used. It refuses values that are not finite or outside a sensor's range, stamps that do not
//! increase within their channel, displacements that jump, and drives of the wrong kind. Each is refused on its own; the history of the
//! accepted samples is kept.
//!
//! One sample with a wrong stamp must not discard history, yet a clock that was set back (or a simulation that was restarted) must not
//! block the node for good. A sample whose stamp steps back is refused. If [`JUMP_AFTER`] of them in a row increase among themselves,
//! time has jumped, and the new time is accepted. A network that reorders samples produces such sequences as well, from samples that are
//! slightly old; for these the limit is [`SMALL_JUMP_AFTER`]. A displacement that the rod cannot have reached since the last one is also
//! refused, and accepted if [`JUMP_AFTER`] in a row agree.
//!
//! A sample whose stamp is later than its arrival by more than [`FAR_AHEAD_S`] is refused too, because the samples after it would then
//! count as old. [`JUMP_AFTER`] in a row show that the clock of the publisher is ahead, and are accepted. Smaller leads are reported
//! with the estimates: [`Gate::is_ahead`].

use super::event::Refused;
use super::plausible::Plausible;
use crate::sample::{Channel, DriveKind, Reading, Sample, Stamp};

/// Number of samples in a row from another time or another place that count as a jump.
const JUMP_AFTER: u32 = 3;
/// The same for samples that are older than the newest by at most [`DISORDER_S`]: no network delivers so many of them in order.
const SMALL_JUMP_AFTER: u32 = 20;
/// Largest delay of a reordered sample, s.
const DISORDER_S: f64 = 0.5;
/// Lead of a stamp over its arrival that no synchronised clocks produce, s.
const FAR_AHEAD_S: f64 = 1.0;
/// Channels that an estimate is computed from.
const OF_ESTIMATES: [Channel; 5] =
    [Channel::Displacement, Channel::Drive, Channel::Velocity, Channel::Force, Channel::CaseTemperature];
/// Largest current, A, or command voltage, V: no damper driver produces more, and a model's memory would take long to forget it.
const DRIVE_MAX: f64 = 1e3;
/// Possible case temperatures of a damper, °C.
const TEMPERATURES_C: std::ops::RangeInclusive<f64> = -100.0..=400.0;
/// Least time between displacements that the speed check assumes, s: stamps of arrival come in bunches.
const LEAST_S: f64 = 2e-3;

/// The gate's decision on a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GateDecision {
    Accept,
    Refuse(Refused),
    /// The sample is the first of a new time on its channel: drop the channel's history (all history, if
    /// it is displacement), then use it.
    TimeJumped,
    /// The displacement is the first at another place: displacements before it do not count.
    PlaceJumped,
}

/// State of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct ChannelState {
    last: Option<Stamp>,
    /// Lead of the last stamp over its arrival, s; negative if the stamp was earlier.
    ahead_s: f64,
    /// Newest of the refused samples from another time, and how many came in a row.
    other: Option<Stamp>,
    other_count: u32,
}

/// The gate.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Gate {
    channels: [ChannelState; Channel::ALL.len()],
    place: Place,
}

/// Position of the rod.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Place {
    last: Option<(Stamp, f64)>,
    /// Newest of the refused displacements at another place, and how many came in a row.
    other: Option<(Stamp, f64)>,
    other_count: u32,
}

impl Place {
    #[inline]
    fn check(&mut self, stamp: Stamp, displacement_m: f64, speed_max_m_s: f64) -> GateDecision {
        let comes_from = |from: Option<(Stamp, f64)>| {
            from.is_none_or(|(at, from_m)| {
                let way_m = (displacement_m - from_m).abs();
                way_m <= speed_max_m_s * stamp.since(at).get().max(LEAST_S)
            })
        };
        let here = Some((stamp, displacement_m));
        if comes_from(self.last) {
            *self = Self { last: here, ..Self::default() };
            return GateDecision::Accept;
        }
        let follows = self.other.is_some() && comes_from(self.other);
        self.other_count = if follows { self.other_count + 1 } else { 1 };
        self.other = here;
        if self.other_count < JUMP_AFTER {
            return GateDecision::Refuse(Refused::TooFast);
        }
        *self = Self { last: here, ..Self::default() };
        GateDecision::PlaceJumped
    }
}

impl Gate {
    #[inline]
    pub(super) fn check(
        &mut self,
        sample: &Sample,
        model_drive: Option<DriveKind>,
        plausible: &Plausible,
    ) -> GateDecision {
        if !sample.reading.get().is_finite() {
            return GateDecision::Refuse(Refused::NotFinite);
        }
        if beyond(sample.reading, plausible) {
            return GateDecision::Refuse(Refused::OutOfRange);
        }
        if let (Reading::Drive(drive), Some(model_drive)) = (sample.reading, model_drive)
            && drive.kind() != model_drive
        {
            return GateDecision::Refuse(Refused::WrongDrive);
        }
        let channel = sample.reading.channel();
        let decision = self.channels[channel as usize].check(sample.stamp, sample.received);
        if decision == GateDecision::TimeJumped && channel == Channel::Displacement {
            // The other channels restart as well, each with its next sample.
            let displacement = self.channels[channel as usize];
            *self = Self::default();
            self.channels[channel as usize] = displacement;
        }
        match (decision, sample.reading) {
            (GateDecision::Accept | GateDecision::TimeJumped, Reading::Displacement(x)) => {
                match self.place.check(sample.stamp, x.get(), plausible.speed_max_m_s) {
                    GateDecision::Accept => decision,
                    jumped => jumped,
                }
            }
            _ => decision,
        }
    }
}

impl Gate {
    /// True if the last sample of any channel in [`OF_ESTIMATES`] had a stamp more than `limit_s` later than its arrival.
    #[inline]
    pub(super) fn is_ahead(&self, limit_s: f64) -> bool {
        OF_ESTIMATES.iter().any(|channel| self.channels[*channel as usize].ahead_s > limit_s)
    }
}

/// True if no sensor of the channel can have this reading.
fn beyond(reading: Reading, plausible: &Plausible) -> bool {
    match reading {
        Reading::Displacement(x) => x.get().abs() > plausible.displacement_max_m,
        Reading::Force(f) | Reading::ForceRequest(f) => f.get().abs() > plausible.force_max_n,
        Reading::Velocity(v) | Reading::BodyVelocity(v) => v.get().abs() > plausible.speed_max_m_s,
        Reading::Drive(drive) => drive.get().abs() > DRIVE_MAX,
        Reading::CaseTemperature(t) => !TEMPERATURES_C.contains(&t.get()),
    }
}

impl ChannelState {
    #[inline]
    fn check(&mut self, stamp: Stamp, received: Stamp) -> GateDecision {
        let ahead_s = stamp.since(received).get();
        if ahead_s > FAR_AHEAD_S && self.ahead_s <= FAR_AHEAD_S {
            let known = self.last.is_some();
            return match self.comes_from_another_time(stamp, ahead_s, JUMP_AFTER) {
                false => GateDecision::Refuse(Refused::Ahead),
                true if known => GateDecision::TimeJumped,
                true => GateDecision::Accept,
            };
        }
        match self.last {
            Some(last) if stamp == last => GateDecision::Refuse(Refused::Repeated),
            Some(last) if stamp < last => {
                let is_small = last.since(stamp).get() <= DISORDER_S;
                let after = if is_small { SMALL_JUMP_AFTER } else { JUMP_AFTER };
                if self.comes_from_another_time(stamp, ahead_s, after) {
                    GateDecision::TimeJumped
                } else {
                    GateDecision::Refuse(Refused::TimeBack)
                }
            }
            _ => {
                *self = Self { last: Some(stamp), ahead_s, ..Self::default() };
                GateDecision::Accept
            }
        }
    }

    /// Counts a sample from another time. True if it is the `after`-th in a row: the new time is then accepted.
    fn comes_from_another_time(&mut self, stamp: Stamp, ahead_s: f64, after: u32) -> bool {
        let follows = self.other.is_some_and(|other| stamp > other);
        self.other_count = if follows { self.other_count + 1 } else { 1 };
        self.other = Some(stamp);
        let is_truth = self.other_count >= after;
        if is_truth {
            *self = Self { last: Some(stamp), ahead_s, ..Self::default() };
        }
        is_truth
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::Drive;
    use crate::units::{Ampere, Celsius, Metre, MetrePerSecond, Newton};

    const PLAUSIBLE: Plausible = Plausible {
        displacement_max_m: 1.0,
        speed_max_m_s: 5.0,
        force_max_n: 1e5,
        stuck_s: 0.1,
        passive_window_s: 2.0,
    };

    fn at(ms: i64, reading: Reading) -> Sample {
        let stamp = Stamp::from_nanos(ms * 1_000_000);
        Sample { stamp, received: stamp, reading }
    }

    fn verdicts(stamps_ms: &[i64]) -> String {
        let mut gate = Gate::default();
        stamps_ms
            .iter()
            .map(|ms| match gate.check(&at(*ms, Reading::Displacement(Metre(0.0))), None, &PLAUSIBLE) {
                GateDecision::Accept => 'a',
                GateDecision::Refuse(Refused::Repeated) => 'r',
                GateDecision::Refuse(Refused::TimeBack) => 'b',
                GateDecision::Refuse(_) => '?',
                GateDecision::TimeJumped => 'J',
                GateDecision::PlaceJumped => 'P',
            })
            .collect()
    }

    #[test]
    fn stamps_that_do_not_increase_are_refused_one_by_one() {
        assert_eq!(verdicts(&[0, 1, 2, 2, 3]), "aaara");
        assert_eq!(
            verdicts(&[0, 1, 2, -10_000, 3, 4]),
            "aaabaa",
            "one late sample does not affect the others"
        );
        assert_eq!(verdicts(&[10, 11, 5, 4, 3, 2, 12]), "aabbbba", "decreasing stamps are not a jump");
    }

    #[test]
    fn a_clock_that_was_set_back_is_accepted_after_three_samples() {
        assert_eq!(verdicts(&[10_000, 10_001, 0, 1, 2, 3]), "aabbJa");
        assert_eq!(
            verdicts(&[0, 1, 10_000, 2, 3, 4, 5]),
            "aaabbJa",
            "after one stamp from the future, three samples are lost"
        );
    }

    /// Samples that arrive at a spacing of 1 ms, with stamps ahead of their arrival by the given times.
    fn verdicts_ahead(ahead_ms: &[i64]) -> String {
        let mut gate = Gate::default();
        let mut decision = |(k, ahead): (usize, &i64)| {
            let received = Stamp::from_nanos(k as i64 * 1_000_000);
            let sample = Sample {
                stamp: received.shifted(ahead * 1_000_000),
                received,
                reading: Reading::Displacement(Metre(0.0)),
            };
            let decision = gate.check(&sample, None, &PLAUSIBLE);
            match (decision, gate.is_ahead(0.03)) {
                (GateDecision::Accept, false) => 'a',
                (GateDecision::Accept, true) => 'A',
                (GateDecision::Refuse(Refused::Ahead), _) => 'f',
                (GateDecision::Refuse(Refused::TimeBack), _) => 'b',
                (GateDecision::TimeJumped, false) => 'j',
                (GateDecision::TimeJumped, true) => 'J',
                _ => '?',
            }
        };
        ahead_ms.iter().enumerate().map(&mut decision).collect()
    }

    #[test]
    fn stamps_ahead_of_their_arrival_are_reported_or_refused() {
        const HOUR: i64 = 3_600_000;
        assert_eq!(verdicts_ahead(&[0, 20, 20, 20]), "aaaa", "within the difference of synchronised clocks");
        assert_eq!(verdicts_ahead(&[50, 50, 50, 0, 0]), "AAAbb", "a clock that is 50 ms ahead");
        assert_eq!(
            verdicts_ahead(&[0, 0, HOUR, 0, 0]),
            "aafaa",
            "one stamp far ahead does not affect the others"
        );
        assert_eq!(verdicts_ahead(&[HOUR, 0, HOUR, 0, 0]), "fafaa", "not even if it is the first");
        assert_eq!(verdicts_ahead(&[0, HOUR, HOUR, HOUR, HOUR]), "affJA", "a clock that is an hour ahead");
        assert_eq!(
            verdicts_ahead(&[HOUR, HOUR, HOUR, HOUR, 0, 0, 0, 0]),
            "ffAAbbja",
            "a clock that was an hour ahead and was corrected"
        );
    }

    #[test]
    fn samples_that_a_network_reorders_are_not_a_jump() {
        assert_eq!(verdicts(&[0, 10, 60, 20, 30, 40, 50, 70]), "aaabbbba", "one sample overtook four");
        // A clock that was set back by as little is accepted after twenty samples, or when it has caught up.
        let set_back: Vec<i64> = (300..310).chain(0..30).collect();
        assert_eq!(verdicts(&set_back), "aaaaaaaaaa".to_owned() + &"b".repeat(19) + "J" + &"a".repeat(10));
        assert_eq!(verdicts(&[100, 110, 91, 101, 111, 121]), "aabbaa");
    }

    #[test]
    fn values_and_drives_are_checked() {
        let mut gate = Gate::default();
        let drive = at(0, Reading::Drive(crate::sample::Drive::CoilCurrent(Ampere(1.0))));
        assert_eq!(
            gate.check(&drive, Some(DriveKind::CommandVoltage), &PLAUSIBLE),
            GateDecision::Refuse(Refused::WrongDrive)
        );
        assert_eq!(gate.check(&drive, Some(DriveKind::CoilCurrent), &PLAUSIBLE), GateDecision::Accept);
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let sample = at(1, Reading::Displacement(Metre(value)));
            assert_eq!(gate.check(&sample, None, &PLAUSIBLE), GateDecision::Refuse(Refused::NotFinite));
        }
    }

    /// Displacements in mm at a spacing of 1 ms.
    fn places(displacements_mm: &[f64]) -> String {
        let mut gate = Gate::default();
        let decision = |(ms, mm): (usize, &f64)| {
            let sample = at(ms as i64, Reading::Displacement(Metre(mm * 1e-3)));
            match gate.check(&sample, None, &PLAUSIBLE) {
                GateDecision::Accept => 'a',
                GateDecision::Refuse(Refused::TooFast) => 'f',
                GateDecision::Refuse(Refused::OutOfRange) => 'o',
                GateDecision::PlaceJumped => 'J',
                _ => '?',
            }
        };
        displacements_mm.iter().enumerate().map(decision).collect()
    }

    #[test]
    fn a_displacement_that_needs_too_much_speed_is_refused() {
        assert_eq!(places(&[0.0, 3.0, 6.0, 9.0, 6.0]), "aaaaa", "3 m/s");
        assert_eq!(places(&[0.0, 1.0, 25.0, 2.0, 3.0]), "aafaa", "a spike does not affect the others");
        assert_eq!(places(&[0.0, 1.0, 25.0, -25.0, 25.0, 3.0]), "aafffa", "nor do several that disagree");
        assert_eq!(places(&[0.0, 1.0, 40.0, 41.0, 42.0, 43.0]), "aaffJa", "three that agree are accepted");
        assert_eq!(places(&[0.0, 2000.0, 1.0]), "aoa");
    }

    #[test]
    fn readings_outside_a_sensors_range_are_refused() {
        let mut gate = Gate::default();
        for reading in [
            Reading::Force(Newton(1e6)),
            Reading::ForceRequest(Newton(-1e6)),
            Reading::Velocity(MetrePerSecond(-6.0)),
            Reading::BodyVelocity(MetrePerSecond(1e300)),
            Reading::Drive(Drive::CoilCurrent(Ampere(-2e3))),
            Reading::CaseTemperature(Celsius(500.0)),
        ] {
            let sample = at(1, reading);
            assert_eq!(gate.check(&sample, None, &PLAUSIBLE), GateDecision::Refuse(Refused::OutOfRange));
        }
    }
}
