//! The threads of a damper's CAN bus, started and ended together.

use crate::estimation::estimator::{self, EventFilter, EventReceiver, EventSender};
use crate::settings::config::Config;
use crate::settings::error::NodeError;
use crate::streams::can::{CanBus, CanCounters, CanSetup, FrameReceiver, FrameSender};
use crate::streams::sink::can::{CanOutput, CanSink, CanSinkSettings};
use crate::streams::source::TOPICS;
use crate::streams::source::can::{CanSource, CanSourceParts};
use crate::streams::source::queued::QueuedInput;
use crate::streams::source::ros_source::RosSource;
use mr_damper_base::clock::Clock;
use mr_damper_base::realtime::{self, Request};
use mr_damper_runs::bus::{Inputs, OutputMessage};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::mpsc::SyncSender;
use std::time::Duration;

/// A bus that is open, before its threads run.
pub(super) struct OpenCan {
    interface: String,
    inputs: Inputs,
    receiver: Box<dyn FrameReceiver>,
    command: Option<(OutputMessage, Box<dyn FrameSender>)>,
    estimate: Option<(OutputMessage, Box<dyn FrameSender>)>,
    period: Duration,
    counters: Arc<CanCounters>,
}

/// The means of the node that the threads use.
pub(super) struct CanContext {
    /// The node's clock.
    pub(super) clock: Arc<Clock>,
    /// `deadline_s`, if set.
    pub(super) deadline: Option<Duration>,
    /// The requested real-time priority.
    pub(super) priority: Request,
}

/// The threads that send, and the ring of each.
pub(super) struct CanSinks {
    commands: Option<CanSink>,
    estimates: Option<CanSink>,
}

/// The inputs of an open bus, before their thread runs.
pub(super) struct CanInput {
    interface: String,
    inputs: Inputs,
    receiver: Box<dyn FrameReceiver>,
    counters: Arc<CanCounters>,
}

/// The ring of a sink: the estimating thread's end, and the count of lost events.
pub(super) type Ring = (EventSender, (&'static str, Arc<AtomicU64>));

impl OpenCan {
    /// Opens the bus that `config` names, or uses `instead`; `None` if it names none.
    ///
    /// # Errors
    /// When parameters are wrong, or the interface cannot be opened.
    pub(super) fn of(config: &Config, instead: Option<Arc<dyn CanBus>>) -> Result<Option<Self>, NodeError> {
        let Some(setup) = CanSetup::of(config, &TOPICS, instead)? else { return Ok(None) };
        let CanSetup { bus, interface, inputs, estimate, command, period } = setup;
        let receiver = bus.receiver(&inputs.filters())?;
        let open = |message: OutputMessage| Ok::<_, NodeError>((message, bus.sender()?));
        let command = command.map(open).transpose()?;
        let estimate = estimate.map(open).transpose()?;
        let name = |output: &Option<(OutputMessage, _)>| {
            output.as_ref().map_or_else(
                || "none".to_owned(),
                |(message, _)| format!("{} ({})", message.name(), message.id()),
            )
        };
        tracing::info!(
            interface,
            inputs = inputs.ids().len(),
            estimates = name(&estimate),
            commands = name(&command),
            "CAN bus: messages of inputs, and messages that are sent"
        );
        let counters = Arc::default();
        Ok(Some(Self { interface, inputs, receiver, command, estimate, period, counters }))
    }

    /// Counters of the bus.
    pub(super) fn counters(&self) -> Arc<CanCounters> {
        Arc::clone(&self.counters)
    }

    /// Starts the threads that send, the one of commands first, and returns their rings.
    ///
    /// # Errors
    /// When the system cannot start a thread.
    pub(super) fn start_sinks(
        self,
        context: &CanContext,
    ) -> Result<(CanInput, CanSinks, Vec<Ring>), NodeError> {
        let Self { interface, inputs, receiver, command, estimate, period, counters } = self;
        let settings = CanSinkSettings {
            clock: Arc::clone(&context.clock),
            deadline: context.deadline,
            period,
            counters: Arc::clone(&counters),
        };
        let mut rings = Vec::new();
        let mut start =
            |output: Option<(OutputMessage, Box<dyn FrameSender>)>, filter, name, run: fn(_, _) -> _| {
                let Some((message, sender)) = output else { return Ok(None) };
                let (events, receiver): (EventSender, EventReceiver) = estimator::channel(filter);
                let dropped = Arc::clone(&receiver.dropped);
                let output = CanOutput { message, sender, receiver };
                let settings = settings.clone();
                let sink: CanSink = realtime::raised(context.priority, || run(output, settings)).0?;
                rings.push((events.waking(sink.thread()), (name, dropped)));
                Ok::<_, NodeError>(Some(sink))
            };
        let commands = start(command, EventFilter::Commands, "can_commands", CanSink::commands)?;
        let estimates = start(estimate, EventFilter::Estimates, "can", CanSink::estimates)?;
        Ok((CanInput { interface, inputs, receiver, counters }, CanSinks { commands, estimates }, rings))
    }
}

impl CanInput {
    /// Starts the thread that receives.
    ///
    /// # Errors
    /// When the system cannot start the thread.
    pub(super) fn start(
        self,
        context: &CanContext,
        queue: SyncSender<QueuedInput>,
        source: &RosSource,
    ) -> Result<CanSource, NodeError> {
        let Self { interface, inputs, receiver, counters } = self;
        let clock = Arc::clone(&context.clock);
        let parts = CanSourceParts { inputs, interface: &interface, clock, queue, counters };
        realtime::raised(context.priority, || CanSource::start(receiver, parts, source)).0
    }
}

impl CanSinks {
    /// True while the threads run; false after a panic.
    pub(super) fn is_alive(&self) -> bool {
        [&self.commands, &self.estimates].into_iter().flatten().all(CanSink::is_alive)
    }

    /// Sends what is left in the rings, and ends the threads. `Err` when one had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub(super) fn stop(self) -> std::thread::Result<()> {
        let commands = self.commands.map_or(Ok(()), CanSink::stop);
        self.estimates.map_or(Ok(()), CanSink::stop).and(commands)
    }
}
