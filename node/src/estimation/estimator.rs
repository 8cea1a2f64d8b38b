//! The estimating thread: the only caller of `Pipeline::step`.
//!
//! ```text
//! source ─→ samples ring ─→ [estimating thread] ─→ one ring per sink ─→ sinks
//! control ─→ command ring ──┘
//! ```
//!
//! The thread never allocates, locks, blocks or logs. When it has nothing to do it parks; a thread that puts something
//! into a ring unparks it. A full ring drops and counts: a slow sink loses its own events and does not affect others.
//! Old models need no freeing: setups do not use the heap.

use mr_damper_base::clock::Clock;
use mr_damper_base::latency::Latency;
use mr_damper_base::worker::{Stop, Worker};
use mr_damper_model::pipeline::{Event, Pipeline, PipelineSetup};
use mr_damper_model::sample::{Channel, Sample};
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::Thread;
use std::time::{Duration, Instant};

/// Samples that can wait for the estimating thread: one second of five channels at 3 kHz.
const SAMPLES: usize = 16_384;
/// Commands that can wait.
pub(crate) const COMMANDS: usize = 16;
/// Events that can wait for a sink: about two seconds at 1 kHz with all inputs echoed.
pub const EVENTS: usize = 8_192;
/// Longest sleep of the thread without input; it then checks the clock.
const TICK: Duration = Duration::from_millis(20);

/// Commands to the running pipeline.
#[derive(Debug, Clone)]
pub enum PipelineCommand {
    /// Starts to estimate, without history. The setup is not boxed, because a box would be freed on the estimating
    /// thread.
    Begin(PipelineSetup),
    /// Stops estimating; samples are discarded from now on.
    End,
    /// Switches to other models or settings between two samples.
    Take(PipelineSetup),
    /// Clears all history.
    Reset,
}

/// The kinds of events that a sink gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EventFilter {
    /// Only current commands, so that nothing else delays them.
    Commands,
    /// All published events except commands.
    Reports,
    /// Only estimates.
    Estimates,
    /// All events, including accepted samples.
    All,
}

impl EventFilter {
    #[inline]
    const fn has(self, event: &Event) -> bool {
        match (self, event) {
            (Self::All, _) | (Self::Commands, Event::Command(_)) | (Self::Estimates, Event::Estimate(_)) => {
                true
            }
            (Self::Commands | Self::Estimates, _) | (Self::Reports, Event::Command(_) | Event::Input(_)) => {
                false
            }
            (Self::Reports, _) => true,
        }
    }
}

/// The estimating thread's end of a sink's ring.
pub struct EventSender {
    ring: Producer<Event>,
    waker: Option<Thread>,
    dropped: Arc<AtomicU64>,
    filter: EventFilter,
}

/// The sink's end of its ring.
pub struct EventReceiver {
    /// Events, in order.
    pub events: Consumer<Event>,
    /// Number of events lost because the ring was full.
    pub dropped: Arc<AtomicU64>,
}

/// A ring of [`EVENTS`] between the estimating thread and a sink.
#[must_use]
pub fn channel(filter: EventFilter) -> (EventSender, EventReceiver) {
    let (ring, events) = RingBuffer::new(EVENTS);
    let dropped = Arc::new(AtomicU64::new(0));
    (
        EventSender { ring, waker: None, dropped: Arc::clone(&dropped), filter },
        EventReceiver { events, dropped },
    )
}

impl EventSender {
    /// The same sender; it wakes `sink` whenever events were put in.
    #[must_use]
    pub fn waking(mut self, sink: Thread) -> Self {
        self.waker = Some(sink);
        self
    }

    #[inline]
    fn put(&mut self, event: Event) -> bool {
        if !self.filter.has(&event) {
            return false;
        }
        let fits = self.ring.push(event).is_ok();
        if !fits {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
        fits
    }

    #[inline]
    fn wake(&self) {
        if let Some(waker) = &self.waker {
            waker.unpark();
        }
    }
}

/// Counters of the estimating thread.
#[derive(Debug, Default)]
pub struct EstimatorCounters {
    /// Received samples.
    pub samples: AtomicU64,
    /// Samples received while the node was not estimating.
    pub idle: AtomicU64,
    /// Samples used, that is neither idle nor refused.
    pub used: AtomicU64,
    /// Samples refused by the pipeline.
    pub refused: AtomicU64,
    /// Samples lost because the ring was full.
    pub overflow: AtomicU64,
    /// True while samples of two publishers of one input arrive mixed.
    pub mixed: AtomicBool,
    /// Executed commands.
    pub executed: AtomicU64,
    /// Time that displacements waited in the ring. Not measured under simulated time.
    pub waiting: Latency,
    /// Time of the step for a displacement, including putting its events into the rings.
    pub stepping: Latency,
}

/// The source's end of the samples ring.
pub struct SampleSink {
    ring: Producer<Sample>,
    counters: Arc<EstimatorCounters>,
    thread: Thread,
}

impl SampleSink {
    /// Hands over a sample. If the ring is full, the sample is dropped and counted, and the next estimate reports it.
    #[inline]
    pub fn push(&mut self, sample: Sample) {
        if self.ring.push(sample).is_err() {
            self.counters.overflow.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Sets whether samples of two publishers of one input arrive mixed; call it before the samples. Every estimate
    /// reports this while it lasts.
    #[inline]
    pub fn note_mixed(&self, mixed: bool) {
        self.counters.mixed.store(mixed, Ordering::Relaxed);
    }

    /// Wakes the estimating thread; call after the last sample of a batch.
    #[inline]
    pub fn flush(&self) {
        self.thread.unpark();
    }
}

/// Handle of the estimating thread.
pub struct Estimator {
    commands: Producer<PipelineCommand>,
    /// Commands sent.
    sent: u64,
    counters: Arc<EstimatorCounters>,
    worker: Worker,
}

impl Estimator {
    /// Starts the thread, which feeds `senders`. It is idle until it gets [`PipelineCommand::Begin`].
    ///
    /// # Errors
    /// When the system cannot start the thread.
    pub fn start(clock: Arc<Clock>, senders: Vec<EventSender>) -> std::io::Result<(Self, SampleSink)> {
        let (sample_ring, samples) = RingBuffer::new(SAMPLES);
        let (commands, command_ring) = RingBuffer::new(COMMANDS);
        let counters = Arc::new(EstimatorCounters::default());
        let worker = Worker::start("estimating", {
            let counters = Arc::clone(&counters);
            move |stop| run(&clock, senders, samples, command_ring, stop, &counters)
        })?;
        let sink = SampleSink { ring: sample_ring, counters: Arc::clone(&counters), thread: worker.thread() };
        Ok((Self { commands, sent: 0, counters, worker }, sink))
    }

    /// Sends all commands, or none and returns `None` when too many are waiting. They are executed once
    /// [`EstimatorCounters::executed`] has reached the returned number.
    pub fn command(&mut self, commands: &[PipelineCommand]) -> Option<u64> {
        if self.commands.slots() < commands.len() {
            return None;
        }
        for command in commands {
            self.sent += u64::from(self.commands.push(command.clone()).is_ok());
        }
        self.worker.thread().unpark();
        Some(self.sent)
    }

    /// The thread's counters.
    #[must_use]
    pub fn counters(&self) -> Arc<EstimatorCounters> {
        Arc::clone(&self.counters)
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.worker.is_alive()
    }

    /// Lets the thread process the samples in its ring, and ends it. `Err` when it had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        self.worker.stop()
    }
}

fn run(
    clock: &Clock,
    mut senders: Vec<EventSender>,
    mut samples: Consumer<Sample>,
    mut commands: Consumer<PipelineCommand>,
    stop: &Stop,
    counters: &EstimatorCounters,
) {
    let mut pipeline: Option<Pipeline> = None;
    let mut overflow_seen = 0;
    loop {
        // Asked before the rings are emptied: a sample that comes between the two is processed in the next round.
        let is_last = stop.is_raised();
        while let Ok(command) = commands.pop() {
            execute(&mut pipeline, command, &mut senders);
            counters.executed.fetch_add(1, Ordering::Release);
        }
        let mut worked = false;
        while let Ok(sample) = samples.pop() {
            worked = true;
            counters.samples.fetch_add(1, Ordering::Relaxed);
            let Some(pipeline) = &mut pipeline else {
                counters.idle.fetch_add(1, Ordering::Relaxed);
                continue;
            };
            let overflow = counters.overflow.load(Ordering::Relaxed);
            if overflow != overflow_seen {
                overflow_seen = overflow;
                pipeline.note_overload();
            }
            if counters.mixed.load(Ordering::Relaxed) {
                pipeline.note_interleaved();
            }
            // Reading the clock needs no system call on Linux.
            let began = (sample.reading.channel() == Channel::Displacement).then(Instant::now);
            if began.is_some() {
                clock.took_since(sample.received).into_iter().for_each(|took| counters.waiting.add(took));
            }
            let mut fanout = Fanout::new(&mut senders);
            pipeline.step(&sample, &mut |event| {
                match event {
                    Event::Input(_) => counters.used.fetch_add(1, Ordering::Relaxed),
                    Event::Refusal(_) => counters.refused.fetch_add(1, Ordering::Relaxed),
                    _ => 0,
                };
                fanout.put(event);
            });
            if let Some(began) = began {
                counters.stepping.add(began.elapsed());
            }
            fanout.wake();
        }
        if worked {
            continue;
        }
        if is_last {
            return;
        }
        if let (Some(pipeline), Some(now)) = (&mut pipeline, clock.now()) {
            let mut fanout = Fanout::new(&mut senders);
            pipeline.tick(now, &mut |event| fanout.put(event));
            fanout.wake();
        }
        std::thread::park_timeout(TICK);
    }
}

fn execute(pipeline: &mut Option<Pipeline>, command: PipelineCommand, senders: &mut [EventSender]) {
    let mut fanout = Fanout::new(senders);
    match (command, pipeline) {
        (PipelineCommand::Begin(setup), pipeline) => *pipeline = Some(Pipeline::from(setup)),
        (PipelineCommand::End, pipeline) => *pipeline = None,
        (PipelineCommand::Take(setup), Some(pipeline)) => {
            pipeline.take(setup, &mut |event| fanout.put(event))
        }
        (PipelineCommand::Reset, Some(pipeline)) => pipeline.reset(&mut |event| fanout.put(event)),
        // Without a pipeline nothing changes; `Begin` brings the setup that is valid then.
        (PipelineCommand::Take(_) | PipelineCommand::Reset, None) => {}
    }
    fanout.wake();
}

/// Puts events into every sender, and wakes the sinks that got any.
struct Fanout<'a> {
    senders: &'a mut [EventSender],
    /// One bit per sender that got an event.
    fed: u32,
}

impl<'a> Fanout<'a> {
    fn new(senders: &'a mut [EventSender]) -> Self {
        Self { senders, fed: 0 }
    }

    #[inline]
    fn put(&mut self, event: Event) {
        for (index, sender) in self.senders.iter_mut().enumerate() {
            self.fed |= u32::from(sender.put(event)) << index;
        }
    }

    #[inline]
    fn wake(self) {
        for (index, sender) in self.senders.iter().enumerate() {
            if self.fed & (1 << index) != 0 {
                sender.wake();
            }
        }
    }
}

#[cfg(test)]
impl Estimator {
    /// An estimator that takes commands and executes none, as if its thread hung.
    pub(crate) fn hung() -> Self {
        let (commands, command_ring) = RingBuffer::<PipelineCommand>::new(COMMANDS);
        let worker = Worker::start("hung", move |stop| {
            while !stop.is_raised() {
                std::thread::park_timeout(TICK);
            }
            drop(command_ring);
        });
        Self { commands, sent: 0, counters: Arc::default(), worker: worker.expect("a thread") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::sample::{Reading, Stamp};
    use mr_damper_model::units::Metre;

    fn start() -> (Estimator, SampleSink) {
        Estimator::start(Arc::new(Clock::new(false)), Vec::new()).expect("a thread")
    }

    #[test]
    fn commands_are_sent_together_or_not_at_all() {
        let test = || {
            let (mut estimator, _sink) = start();
            let counters = estimator.counters();
            let many = std::array::from_fn::<_, { COMMANDS + 1 }, _>(|_| PipelineCommand::Reset);
            assert_eq!(estimator.command(&many), None);
            assert_eq!(estimator.command(&[PipelineCommand::End, PipelineCommand::Reset]), Some(2));
            estimator.stop().expect("no panic");
            assert_eq!(counters.executed.load(Ordering::Acquire), 2);
        };
        // A command is large, because a setup is not boxed.
        let thread = std::thread::Builder::new().stack_size(256 << 20).spawn(test).expect("a thread");
        thread.join().expect("no panic");
    }

    #[test]
    fn a_sample_that_comes_just_before_the_end_is_processed() {
        for spins in 0..3000 {
            let (estimator, mut sink) = start();
            let counters = estimator.counters();
            // The thread reaches each of its steps at some number of spins.
            for _ in 0..spins {
                std::hint::spin_loop();
            }
            let stamp = Stamp::from_nanos(0);
            sink.push(Sample { stamp, received: stamp, reading: Reading::Displacement(Metre(0.0)) });
            estimator.stop().expect("no panic");
            assert_eq!(counters.samples.load(Ordering::Relaxed), 1, "{spins} spins");
        }
    }
}
