//! Log lines for the events of the pipeline.
//!
//! The overseer writes them, because standard error may be a pipe that nobody reads and a publishing thread must not
//! block. Lines about refused samples and changes of mode are limited: the first appears at once, then one line per
//! second for each kind, with a count.

use crate::estimation::wire::ModelNames;
use crate::watchdogs::mode_log::{ModeLine, ModeLog};
use mr_damper_base::alarm::ADVICE;
use mr_damper_model::pipeline::{AlarmChange, Event, Refusal, Refused};
use mr_damper_model::sample::Channel;
use std::time::{Duration, Instant};

/// Minimum time between log lines about refused samples of one kind.
const LOG_EVERY: Duration = Duration::from_secs(1);

/// The log of one damper.
#[derive(Default)]
pub struct EventLog {
    modes: ModeLog,
    refusals: Vec<RefusalKind>,
}

struct RefusalKind {
    channel: Channel,
    why: Refused,
    since_last: u64,
    last_line: Instant,
    example: Refusal,
}

impl EventLog {
    /// Logs an event; `names` are the names of the running models.
    pub fn take(&mut self, event: &Event, names: &ModelNames) {
        match event {
            Event::Transition(transition) => {
                self.modes.note(transition, Instant::now()).iter().for_each(ModeLine::log);
            }
            Event::Refusal(refusal) => self.note(refusal),
            Event::Alarm(alarm) => say_alarm(alarm, &names.free),
            Event::Input(_) | Event::Estimate(_) | Event::Residual(_) | Event::Command(_) => {}
        }
    }

    fn note(&mut self, refusal: &Refusal) {
        let channel = refusal.sample.reading.channel();
        match self.refusals.iter_mut().find(|kind| kind.channel == channel && kind.why == refusal.why) {
            Some(kind) => {
                kind.since_last += 1;
                kind.example = *refusal;
            }
            None => {
                warn(refusal, 1);
                self.refusals.push(RefusalKind {
                    channel,
                    why: refusal.why,
                    since_last: 0,
                    last_line: Instant::now(),
                    example: *refusal,
                });
            }
        }
    }

    /// Logs the held-back lines that are due. Call it a few times per second.
    pub fn flush(&mut self) {
        self.modes.flush(Instant::now()).iter().for_each(ModeLine::log);
        for kind in &mut self.refusals {
            if kind.since_last > 0 && kind.last_line.elapsed() >= LOG_EVERY {
                warn(&kind.example, kind.since_last);
                kind.since_last = 0;
                kind.last_line = Instant::now();
            }
        }
    }
}

impl Drop for EventLog {
    /// Logs the changes of mode that are still held back.
    fn drop(&mut self) {
        self.modes.finish().iter().for_each(ModeLine::log);
    }
}

fn say_alarm(alarm: &AlarmChange, model: &str) {
    let stamp_ns = alarm.stamp.nanos();
    if alarm.raised {
        tracing::warn!(
            model,
            stamp_ns,
            ratio = format!("{:.2}", alarm.ratio),
            "residual alarm: the model's error is larger than its noise explains; {ADVICE}"
        );
    } else {
        tracing::info!(model, stamp_ns, "the residual alarm is cleared");
    }
}

fn warn(refusal: &Refusal, count: u64) {
    let advice = match refusal.why {
        Refused::NotFinite => "check its publisher",
        Refused::Repeated | Refused::TimeBack => "check the publisher's stamps, and that only one publishes",
        Refused::Ahead => "synchronise the clocks of the hosts (PTP, NTP), or check the publisher's stamps",
        Refused::OutOfRange => {
            "check the sensor's unit and offset, or raise the parameter plausible.* that bounds it"
        }
        Refused::TooFast => {
            "check the sensor for spikes and its unit, or raise the parameter plausible.speed_max_m_s"
        }
        Refused::WrongDrive => "load a model that was identified on this kind of drive",
    };
    tracing::warn!(
        channel = refusal.sample.reading.channel().name(),
        value = refusal.sample.reading.get(),
        stamp_ns = refusal.sample.stamp.nanos(),
        count,
        "sample refused: {}; {advice}",
        refusal.why.text(),
    );
}
