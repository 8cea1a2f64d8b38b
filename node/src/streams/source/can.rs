//! Samples from a CAN bus, in addition to samples from ROS. Off unless `can.interface` is set.
//!
//! ```text
//! interface ─→ [can-source]: check, decode ─→ bounded queue ─→ source thread, as for inputs over DDS
//! ```
//!
//! All signals of a frame get its stamp: the time at which the kernel received it. Under simulated time they have no stamp, and the
//! source thread gives them one, as for any sample without a stamp. A frame that is not used is as if it had not arrived: its inputs
//! become old, and estimates are flagged as with ROS.

use super::TOPICS;
use super::input::Number;
use super::queued::QueuedInput;
use super::ros_source::RosSource;
use super::stamp::SampleOrigin;
use crate::ros2::graph::Writer;
use crate::settings::error::NodeError;
use crate::streams::can::{Arrival, CanCounters, Frame, FrameReceiver};
use mr_damper_base::clock::Clock;
use mr_damper_base::worker::{Stop, Worker};
use mr_damper_runs::bus::{CanId, InputValue, Inputs, Refusal};
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::thread::Thread;
use std::time::Duration;

/// Longest wait for a frame: the thread then checks whether it has to end.
const WAIT: Duration = Duration::from_millis(20);

/// The running source.
pub struct CanSource(Worker);

/// The means of the source, beside the bus.
pub struct CanSourceParts<'a> {
    /// The messages that hold inputs.
    pub inputs: Inputs,
    /// The interface, by its name.
    pub interface: &'a str,
    /// The node's clock.
    pub clock: Arc<Clock>,
    /// The queue to the source thread.
    pub queue: SyncSender<QueuedInput>,
    /// Counters of the bus.
    pub counters: Arc<CanCounters>,
}

impl CanSource {
    /// Starts the thread, which takes frames from `receiver` and passes their values to `source`.
    ///
    /// # Errors
    /// When the system cannot start the thread.
    pub fn start(
        receiver: Box<dyn FrameReceiver>,
        parts: CanSourceParts<'_>,
        source: &RosSource,
    ) -> Result<Self, NodeError> {
        let CanSourceParts { inputs, interface, clock, queue, counters } = parts;
        for id in inputs.ids() {
            let message = inputs.message(id).unwrap_or_default();
            source.counters().name(writer(id), format!("{message} on {interface}"));
        }
        let thread = SourceThread { inputs, clock, queue, counters, waker: source.thread() };
        let worker = Worker::start("can-source", move |stop| thread.run(receiver, stop))
            .map_err(NodeError::io("starting the thread that receives CAN frames"))?;
        Ok(Self(worker))
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.0.is_alive()
    }

    /// Ends the thread. `Err` when it had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        self.0.stop()
    }
}

/// The publisher of a sample: the message on the bus.
fn writer(id: CanId) -> Writer {
    let mut writer = *b"CAN message\0\0\0\0\0";
    writer[11] = u8::from(id.extended);
    writer[12..].copy_from_slice(&id.value.to_be_bytes());
    writer
}

struct SourceThread {
    inputs: Inputs,
    clock: Arc<Clock>,
    queue: SyncSender<QueuedInput>,
    counters: Arc<CanCounters>,
    waker: Thread,
}

impl SourceThread {
    fn run(mut self, mut receiver: Box<dyn FrameReceiver>, stop: &Stop) {
        while !stop.is_raised() {
            match receiver.receive(WAIT) {
                Some(Arrival::Frame(frame)) => self.take(&frame),
                Some(Arrival::Fault(fault)) => self.counters.note(fault),
                None => {}
            }
        }
    }

    fn take(&mut self, frame: &Frame) {
        let counters = &*self.counters;
        // A stamp of zero means that there is none.
        let stamp_ns = if self.clock.is_simulated() { 0 } else { frame.stamp.nanos() };
        let sent_ns = frame.stamp.nanos();
        // Frames of one J1939 message may differ in their priority.
        let id = self.inputs.message_id(frame.id).unwrap_or(frame.id);
        let origin = SampleOrigin { writer: writer(id), sent_ns: Some(sent_ns), arrived_ns: sent_ns };
        let (mut wakes, queue) = (false, &self.queue);
        let taken = self.inputs.take(frame.id, frame.data(), |InputValue { channel, value }| {
            let Some(input) = TOPICS.iter().position(|topic| *topic == channel) else { return };
            let number = Number { stamp_ns, value, ..Number::default() };
            match queue.try_send(QueuedInput { input, number, origin }) {
                Ok(()) => wakes |= channel == TOPICS[0] || stamp_ns == 0,
                Err(_) => CanCounters::add(&counters.overflow, 1),
            }
        });
        if wakes {
            self.waker.unpark();
        }
        match taken {
            Ok(report) => {
                CanCounters::add(&counters.frames, 1);
                CanCounters::add(&counters.values, report.values);
                CanCounters::add(&counters.short, report.short);
                CanCounters::add(&counters.out_of_range, report.out_of_range);
                CanCounters::add(&counters.missing, report.missing);
                CanCounters::add(&counters.several_senders, report.several_senders);
            }
            Err(why) => {
                let (is_known, count) = match why {
                    Refusal::Other => (0, &counters.other),
                    Refusal::Short => (1, &counters.short),
                    Refusal::Checksum => (1, &counters.bad_checksum),
                    Refusal::Counter => (1, &counters.bad_counter),
                    Refusal::SeveralSenders => (1, &counters.several_senders),
                };
                CanCounters::add(&counters.frames, is_known);
                CanCounters::add(count, 1);
            }
        }
    }
}
