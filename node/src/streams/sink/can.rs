//! Sends estimates and current commands to a CAN bus. Off unless `can.out` names them.
//!
//! ```text
//! estimating thread ─→ ring of commands ──→ [can-commands] ─→ message of current_command
//!                   └→ ring of estimates ─→ [can-sink] ─────→ message of force_estimate
//! ```
//!
//! A frame has no stamp, so nothing old is sent: an estimate or a command that is older than its deadline is dropped and counted. At most
//! one frame is sent in each period, with the newest value. When events stop, frames stop; their receiver notices that by its own time
//! limit, or by the alive counter. Deactivation and the end of the node stop the frames in the same way, as they stop the topics of ROS.

use crate::estimation::estimator::EventReceiver;
use crate::settings::error::NodeError;
use crate::streams::can::{CanCounters, FrameSender};
use crate::streams::sink::ros_sink::COMMAND_AGE;
use mr_damper_base::clock::Clock;
use mr_damper_base::worker::{Stop, Worker};
use mr_damper_model::pipeline::{Estimate, Event, StampedCommand, Validity};
use mr_damper_model::sample::Stamp;
use mr_damper_runs::bus::{FieldValue, OutputField, OutputMessage};
use std::sync::Arc;
use std::thread::Thread;
use std::time::{Duration, Instant};

/// Longest sleep of a thread that is not woken.
const IDLE: Duration = Duration::from_millis(100);

/// Settings of both outputs.
#[derive(Clone)]
pub struct CanSinkSettings {
    /// The node's clock.
    pub clock: Arc<Clock>,
    /// Greatest age of what is sent: `deadline_s`; [`COMMAND_AGE`] if it is `None`.
    pub deadline: Option<Duration>,
    /// Shortest time between two frames of one output.
    pub period: Duration,
    /// Counters of the bus.
    pub counters: Arc<CanCounters>,
}

impl CanSinkSettings {
    /// True for what is too old to be sent. With simulated time, ages are not known.
    fn is_late(&self, since: Stamp) -> bool {
        self.clock.took_since(since).is_some_and(|age| age > self.deadline.unwrap_or(COMMAND_AGE))
    }
}

/// An output: its message, and where frames go.
pub struct CanOutput {
    /// The message.
    pub message: OutputMessage,
    /// The bus.
    pub sender: Box<dyn FrameSender>,
    /// The events that it is made from.
    pub receiver: EventReceiver,
}

/// The thread of one output.
pub struct CanSink(Worker);

impl CanSink {
    /// Starts the thread that sends current commands.
    ///
    /// # Errors
    /// When the system cannot start the thread.
    pub fn commands(output: CanOutput, settings: CanSinkSettings) -> Result<Self, NodeError> {
        Self::start(
            "can-commands",
            output,
            settings,
            Content::<StampedCommand> {
                of: |event| if let Event::Command(commanded) = event { Some(*commanded) } else { None },
                send: Outlet::send_command,
            },
        )
    }

    /// Starts the thread that sends estimates.
    ///
    /// # Errors
    /// When the system cannot start the thread.
    pub fn estimates(output: CanOutput, settings: CanSinkSettings) -> Result<Self, NodeError> {
        Self::start(
            "can-sink",
            output,
            settings,
            Content::<Estimate> {
                of: |event| if let Event::Estimate(estimate) = event { Some(*estimate) } else { None },
                send: Outlet::send_estimate,
            },
        )
    }

    fn start<T: Copy + 'static>(
        name: &str,
        output: CanOutput,
        settings: CanSinkSettings,
        content: Content<T>,
    ) -> Result<Self, NodeError> {
        let CanOutput { message, sender, receiver } = output;
        let outlet = Outlet { message, sender, settings };
        let worker = Worker::start(name, move |stop| outlet.run(receiver, stop, &content))
            .map_err(NodeError::io("starting a thread that sends CAN frames"))?;
        Ok(Self(worker))
    }

    /// The thread, to unpark after a push.
    #[must_use]
    pub fn thread(&self) -> Thread {
        self.0.thread()
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.0.is_alive()
    }

    /// Sends what is left in the ring, and ends the thread. `Err` when it had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        self.0.stop()
    }
}

/// The content of an output.
struct Content<T> {
    /// The content of an event, if the output sends it.
    of: fn(&Event) -> Option<T>,
    send: fn(&mut Outlet, &T),
}

/// The way of one output to its bus.
struct Outlet {
    message: OutputMessage,
    sender: Box<dyn FrameSender>,
    settings: CanSinkSettings,
}

impl Outlet {
    fn run<T>(mut self, mut receiver: EventReceiver, stop: &Stop, content: &Content<T>) {
        let (mut newest, mut due) = (None, Instant::now());
        loop {
            // Read before draining, so that events that are in the ring when stop is raised are still sent.
            let last_round = stop.is_raised();
            while let Ok(event) = receiver.events.pop() {
                newest = (content.of)(&event).or(newest);
            }
            let now = Instant::now();
            if now >= due
                && let Some(value) = newest.take()
            {
                (content.send)(&mut self, &value);
                due = next_due(due, now, self.settings.period);
            }
            if last_round {
                // A value that still waits for its period is sent now, because nothing comes after it.
                if let Some(value) = newest {
                    (content.send)(&mut self, &value);
                }
                return;
            }
            let wait = if newest.is_some() { due.saturating_duration_since(Instant::now()) } else { IDLE };
            std::thread::park_timeout(wait.min(IDLE));
        }
    }

    fn send_estimate(&mut self, estimate: &Estimate) {
        let counters = Arc::clone(&self.settings.counters);
        if estimate.received.is_some_and(|received| self.settings.is_late(received)) {
            CanCounters::add(&counters.late_estimates, 1);
            return;
        }
        let force_n = estimate.force.get();
        let fits = self.message.can_carry(OutputField::Force, force_n);
        CanCounters::add(&counters.not_representable, u64::from(!fits && force_n.is_finite()));
        let is_usable = matches!(estimate.validity, Validity::Valid | Validity::Degraded);
        // Without its flag, only a number that needs none is sent.
        let sent_n =
            if fits && (is_usable || self.message.has(OutputField::Validity)) { force_n } else { f64::NAN };
        let validity = if fits { estimate.validity } else { Validity::Invalid };
        self.send(&counters.estimates, |field| match field {
            OutputField::Force => FieldValue::Number(sent_n),
            OutputField::StdDev => FieldValue::Number(estimate.std_dev.get()),
            OutputField::BandLow => FieldValue::Number(estimate.band[0].get()),
            OutputField::BandHigh => FieldValue::Number(estimate.band[1].get()),
            OutputField::Validity => FieldValue::Code(validity as u64),
            OutputField::Mode => FieldValue::Code(estimate.mode as u64),
            OutputField::Reasons => FieldValue::Code(u64::from(estimate.reasons.0)),
            _ => FieldValue::Number(f64::NAN),
        });
    }

    fn send_command(&mut self, commanded: &StampedCommand) {
        let counters = Arc::clone(&self.settings.counters);
        if self.settings.is_late(commanded.known_at) {
            CanCounters::add(&counters.late_commands, 1);
            return;
        }
        let command = &commanded.command;
        let current_a = command.current.get();
        if !self.message.can_carry(OutputField::Current, current_a) {
            CanCounters::add(&counters.not_representable, 1);
            return;
        }
        // The kernel would keep the frame until the controller is back, and send it then.
        if counters.is_off() {
            CanCounters::add(&counters.not_sent, 1);
            return;
        }
        self.send(&counters.commands, |field| match field {
            OutputField::Current => FieldValue::Number(current_a),
            OutputField::ForceRequested => FieldValue::Number(command.requested.get()),
            OutputField::ForceExpected => FieldValue::Number(command.expected.get()),
            OutputField::LimitedBy => FieldValue::Code(command.limited_by as u64),
            OutputField::Achievable => FieldValue::Code(u64::from(command.is_achievable)),
            _ => FieldValue::Number(f64::NAN),
        });
    }

    fn send(&mut self, sent: &std::sync::atomic::AtomicU64, value: impl Fn(OutputField) -> FieldValue) {
        let id = self.message.id();
        match self.sender.send(id, self.message.encode(value)) {
            Ok(()) => CanCounters::add(sent, 1),
            Err(why) => self.settings.counters.not_sent(why),
        }
    }
}

/// When the next frame may be sent: a period after the last one was due, so that the mean period is kept; a period from now if that is
/// past.
fn next_due(due: Instant, now: Instant, period: Duration) -> Instant {
    let next = due + period;
    if next > now { next } else { now + period }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::can::MemoryBus;
    use crate::streams::sink::zenoh::samples;
    use mr_damper_base::clock::system_now;
    use mr_damper_model::units::Newton;
    use mr_damper_runs::Map;
    use mr_damper_runs::bus::{OutputMapping, Signals};
    use std::io::Write as _;
    use std::sync::atomic::Ordering;

    const DBC: &str = "BO_ 1 A: 3 X\n SG_ Force : 0|16@1- (1,0) [-500|500] \"N\" X\n SG_ Validity : 16|3@1+ (1,0) [0|0] \"\" X\n";

    fn outlet(bus: &MemoryBus, text: &str) -> Outlet {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        file.write_all(DBC.as_bytes()).expect("written");
        let signals = Signals::read(&[file.path().to_owned()]).expect("a good file");
        let none = signals.inputs(&Map::default(), &[]).expect("no inputs");
        let mapping: OutputMapping = text.parse().expect("an output");
        let message = signals.outputs(&[mapping], &none).expect("it fits").remove(0);
        let (clock, counters) = (Arc::new(Clock::new(false)), Arc::default());
        let settings = CanSinkSettings { clock, deadline: None, period: Duration::ZERO, counters };
        Outlet { message, sender: Box::new(bus.clone()), settings }
    }

    fn estimate(force_n: f64, validity: Validity, age_ms: i64) -> Estimate {
        match samples::estimate(1_500_000_000, force_n) {
            Event::Estimate(it) => {
                let received = Some(system_now().shifted(-age_ms * 1_000_000));
                Estimate { validity, received, force: Newton(force_n), ..it }
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn late_estimates_are_not_sent_and_numbers_that_need_a_flag_have_it() {
        let bus = MemoryBus::default();
        let data = |outlet: &mut Outlet, estimate: &Estimate| {
            outlet.send_estimate(estimate);
            bus.sent().first().map(|frame| frame.data().to_vec())
        };
        let mut flagged = outlet(&bus, "force_estimate=A,force=Force,validity=Validity");
        let mut plain = outlet(&bus, "force_estimate=A,force=Force");
        for (force_n, validity, age_ms, with_flag, without) in [
            (-2.0, Validity::Valid, 0, Some(vec![0xfe, 0xff, 0]), Some(vec![0xfe, 0xff, 0])),
            (-2.0, Validity::Stale, 0, Some(vec![0xfe, 0xff, 3]), Some(vec![0, 0x80, 0])),
            (501.0, Validity::Valid, 0, Some(vec![0, 0x80, 4]), Some(vec![0, 0x80, 0])),
            (-2.0, Validity::Valid, 150, None, None),
        ] {
            let estimate = estimate(force_n, validity, age_ms);
            assert_eq!(data(&mut flagged, &estimate), with_flag, "{force_n} {validity:?}");
            assert_eq!(data(&mut plain, &estimate), without, "{force_n} {validity:?}");
        }
        let counters = &flagged.settings.counters;
        let counted = [&counters.estimates, &counters.late_estimates, &counters.not_representable];
        assert_eq!(counted.map(|count| count.load(Ordering::Relaxed)), [3, 1, 1]);
    }

    #[test]
    fn the_mean_period_is_kept_and_a_late_frame_causes_no_burst() {
        let (begin, period) = (Instant::now(), Duration::from_millis(10));
        let at = |ms: u64| begin + Duration::from_millis(ms);
        assert_eq!(next_due(at(10), at(12), period), at(20));
        assert_eq!(next_due(at(10), at(35), period), at(45));
    }
}
