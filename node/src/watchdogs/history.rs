//! The last minutes of raw input, in memory, for a diagnosis of the running model.
//!
//! Samples are kept per channel as the pipeline accepted them, for `history.duration_s` of stamps and at most
//! [`CAPACITY`] per channel. They are returned as runs, which replay to the same estimates. A gap in displacement
//! longer than `gap_s` splits runs, because the pipeline restarts there. When stamps jump back, older samples are
//! dropped, because they belong to another time.

use mr_damper_model::sample::{Channel, DriveKind, Reading, Run, Sample, Stamp, Trace};
use std::collections::VecDeque;

/// Maximum number of samples per channel: an hour at 580 Hz, 32 MB.
pub const CAPACITY: usize = 1 << 21;

/// One channel.
#[derive(Debug, Clone, Default)]
struct Ring {
    samples: VecDeque<(Stamp, f64)>,
}

impl Ring {
    /// Drops samples older than `oldest`, except the newest of them: the value of a slow channel holds until its next
    /// sample.
    fn prune(&mut self, oldest: Stamp) {
        while self.samples.get(1).is_some_and(|(stamp, _)| *stamp <= oldest) {
            self.samples.pop_front();
        }
    }

    /// The samples from `from` to `to`. With `held`, also the last one before `from`.
    fn between(&self, from: Stamp, to: Stamp, held: bool) -> Trace {
        let begin = self.samples.partition_point(|(stamp, _)| *stamp < from);
        let begins_late = self.samples.get(begin).is_none_or(|(stamp, _)| *stamp > from);
        let begin = if held && begins_late { begin.saturating_sub(1) } else { begin };
        let end = self.samples.partition_point(|(stamp, _)| *stamp <= to).max(begin);
        let (stamps, values) = self.samples.range(begin..end).copied().unzip();
        Trace { stamps, values }
    }
}

/// The history of one damper's inputs.
#[derive(Debug, Clone)]
pub struct History {
    duration_ns: i64,
    capacity: usize,
    rings: [Ring; Channel::ALL.len()],
    drive: Option<DriveKind>,
    /// Samples that were dropped early because a channel was full.
    dropped: u64,
}

impl History {
    /// An empty history of `duration_s` seconds.
    #[must_use]
    pub fn new(duration_s: f64) -> Self {
        Self::with_capacity(duration_s, CAPACITY)
    }

    fn with_capacity(duration_s: f64, capacity: usize) -> Self {
        Self {
            // A cast from float saturates.
            duration_ns: (duration_s * 1e9) as i64,
            capacity,
            rings: Default::default(),
            drive: None,
            dropped: 0,
        }
    }

    /// Changes the length of the history to `duration_s` seconds.
    pub fn set_duration_s(&mut self, duration_s: f64) {
        self.duration_ns = (duration_s * 1e9) as i64;
    }

    /// Number of samples that were dropped early; the history is then shorter than configured.
    #[must_use]
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Length of the stored displacement, s.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        let displacement = &self.ring(Channel::Displacement).samples;
        match (displacement.front(), displacement.back()) {
            (Some((first, _)), Some((last, _))) => last.since(*first).get(),
            _ => 0.0,
        }
    }

    /// Stores a sample that the pipeline accepted.
    pub fn push(&mut self, sample: &Sample) {
        let (stamp, channel) = (sample.stamp, sample.reading.channel());
        if self.ring(channel).samples.back().is_some_and(|(last, _)| stamp <= *last) {
            // The pipeline accepts a stamp that does not increase only after a jump in time.
            if channel == Channel::Displacement {
                self.rings = Default::default();
            } else {
                self.rings[channel as usize] = Ring::default();
            }
        }
        if let Reading::Drive(drive) = sample.reading
            && self.drive.replace(drive.kind()).is_some_and(|before| before != drive.kind())
        {
            self.rings[channel as usize] = Ring::default();
        }
        let ring = &mut self.rings[channel as usize].samples;
        ring.push_back((stamp, sample.reading.get()));
        if ring.len() > self.capacity {
            ring.pop_front();
            self.dropped += 1;
        }
        if channel == Channel::Displacement {
            let oldest = stamp.shifted(-self.duration_ns);
            for ring in &mut self.rings {
                ring.prune(oldest);
            }
        }
    }

    /// The last `seconds` as runs, oldest first. Runs are split where displacement has a gap of more than `gap_s`.
    #[must_use]
    pub fn runs(&self, seconds: f64, gap_s: f64) -> Vec<Run> {
        let displacement = &self.ring(Channel::Displacement).samples;
        let Some((newest, _)) = displacement.back() else { return Vec::new() };
        let oldest = newest.shifted(-((seconds * 1e9) as i64));
        let mut spans: Vec<(Stamp, Stamp)> = Vec::new();
        for (stamp, _) in displacement.iter().filter(|(stamp, _)| *stamp >= oldest) {
            match spans.last_mut() {
                Some((_, end)) if stamp.since(*end).get() <= gap_s => *end = *stamp,
                _ => spans.push((*stamp, *stamp)),
            }
        }
        spans.into_iter().enumerate().map(|(index, span)| self.run(index, span)).collect()
    }

    fn run(&self, index: usize, (from, to): (Stamp, Stamp)) -> Run {
        let trace = |channel: Channel, held: bool| {
            Some(self.ring(channel).between(from, to, held)).filter(|trace| !trace.is_empty())
        };
        Run {
            name: format!("history/{}", index + 1),
            displacement_m: self.ring(Channel::Displacement).between(from, to, false),
            velocity_m_s: trace(Channel::Velocity, false),
            drive: self.drive.zip(trace(Channel::Drive, true)),
            force_n: trace(Channel::Force, false),
            case_temp_c: trace(Channel::CaseTemperature, true),
            body_velocity_m_s: trace(Channel::BodyVelocity, true),
            force_request_n: trace(Channel::ForceRequest, true),
            other: Vec::new(),
        }
    }

    fn ring(&self, channel: Channel) -> &Ring {
        &self.rings[channel as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::sample::Drive;
    use mr_damper_model::units::{Ampere, Celsius, Metre, Newton, Volt};

    fn at(ms: i64, reading: Reading) -> Sample {
        let stamp = Stamp::from_nanos(ms * 1_000_000);
        Sample { stamp, received: stamp, reading }
    }

    fn current(a: f64) -> Reading {
        Reading::Drive(Drive::CoilCurrent(Ampere(a)))
    }

    /// Displacement and force every 10 ms, a current every 100 ms, a temperature every 2 s.
    fn fill(history: &mut History, ms: std::ops::Range<i64>) {
        for ms in ms.step_by(10) {
            if ms % 2000 == 0 {
                history.push(&at(ms, Reading::CaseTemperature(Celsius(20.0 + ms as f64 / 1000.0))));
            }
            if ms % 100 == 0 {
                history.push(&at(ms, current(ms as f64 / 1000.0)));
            }
            history.push(&at(ms, Reading::Force(Newton(ms as f64))));
            history.push(&at(ms, Reading::Displacement(Metre(ms as f64 * 1e-6))));
        }
    }

    fn span_ms(trace: &Trace) -> (usize, i64, i64) {
        let ms = |stamp: Option<&Stamp>| stamp.expect("samples").nanos() / 1_000_000;
        (trace.len(), ms(trace.stamps.first()), ms(trace.stamps.last()))
    }

    #[test]
    fn the_last_seconds_are_kept_with_the_values_that_hold_at_their_start() {
        let mut history = History::new(3.0);
        fill(&mut history, 0..10_001);
        let runs = history.runs(2.55, 0.1);
        let [run] = &runs[..] else { panic!("no gap, one run: {}", runs.len()) };
        assert_eq!(span_ms(&run.displacement_m), (256, 7450, 10_000));
        assert_eq!(span_ms(run.force_n.as_ref().expect("force")), (256, 7450, 10_000));
        let (kind, drive) = run.drive.as_ref().expect("a drive");
        assert_eq!((*kind, span_ms(drive)), (DriveKind::CoilCurrent, (27, 7400, 10_000)));
        assert_eq!(span_ms(run.case_temp_c.as_ref().expect("a temperature")), (3, 6000, 10_000));
        assert_eq!(run.velocity_m_s, None);
        assert!((history.seconds() - 3.0).abs() < 1e-9);
        // A request for more than is stored returns everything.
        assert_eq!(span_ms(&history.runs(1e9, 0.1)[0].displacement_m), (301, 7000, 10_000));
    }

    #[test]
    fn gaps_split_runs() {
        let mut history = History::new(60.0);
        fill(&mut history, 0..1000);
        fill(&mut history, 1080..2000);
        fill(&mut history, 2500..3000);
        let runs = history.runs(60.0, 0.1);
        let spans: Vec<_> = runs.iter().map(|run| span_ms(&run.displacement_m)).collect();
        assert_eq!(spans, [(192, 0, 1990), (50, 2500, 2990)]);
        assert_eq!(runs[1].name, "history/2");
        assert_eq!(history.runs(0.2, 0.1).len(), 1);
        assert!(History::new(60.0).runs(60.0, 0.1).is_empty());
    }

    #[test]
    fn a_jump_back_and_a_new_kind_of_drive_clear_older_samples() {
        let mut history = History::new(60.0);
        fill(&mut history, 5000..6000);
        fill(&mut history, 0..500);
        assert_eq!(span_ms(&history.runs(60.0, 0.1)[0].displacement_m), (50, 0, 490));
        history.push(&at(490, Reading::Drive(Drive::CommandVoltage(Volt(2.0)))));
        let drive = history.runs(60.0, 0.1)[0].drive.clone();
        assert_eq!(drive.map(|(kind, trace)| (kind, trace.len())), Some((DriveKind::CommandVoltage, 1)));
    }

    #[test]
    fn memory_is_bounded() {
        let mut history = History::with_capacity(3600.0, 100);
        fill(&mut history, 0..5000);
        assert!(history.rings.iter().all(|ring| ring.samples.len() <= 100));
        assert_eq!(history.dropped(), 2 * 400, "displacement and force");
        assert_eq!(span_ms(&history.runs(60.0, 0.1)[0].displacement_m), (100, 4000, 4990));
    }

    /// A returned run that is pushed again is returned unchanged.
    #[test]
    fn a_returned_run_can_be_pushed_again_unchanged() {
        let mut history = History::new(60.0);
        fill(&mut history, 0..3000);
        let run = history.runs(60.0, 0.1).remove(0);
        let mut again = History::new(60.0);
        for sample in run.samples() {
            again.push(&sample);
        }
        assert_eq!(again.runs(60.0, 0.1), [run]);
    }
}
