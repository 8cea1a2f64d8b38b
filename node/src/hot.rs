//! The estimating thread: the only caller of `Pipeline::step`.
//!
//! ```text
//! source ─→ samples ring ─→ [estimating thread] ─→ one ring a sink ─→ sinks
//! control ─→ command ring ──┘
//! ```
//!
//! It never allocates, locks, waits for anybody or logs. When there is nothing to do it parks; whoever has
//! put something into a ring unparks it. A ring that is full drops and counts: a slow sink loses its own
//! events and nobody else's. Old models need no freeing: plans hold no heap.

use crate::clock::Clock;
use crate::latency::Latency;
use crate::worker::{Stop, Worker};
use mr_damper_model::pipeline::{Event, Pipeline, Plan};
use mr_damper_model::sample::{Channel, Sample};
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::Thread;
use std::time::{Duration, Instant};

/// Samples that may wait for the estimating thread: one second of five channels at 3 kHz.
const SAMPLES: usize = 16_384;
/// Commands that may wait.
const COMMANDS: usize = 16;
/// Events that may wait for a sink: about two seconds at 1 kHz with all inputs echoed.
pub const EVENTS: usize = 8_192;
/// How long the thread sleeps without input before it looks at the clock.
const TICK: Duration = Duration::from_millis(20);

/// What can be asked of the running pipeline.
#[derive(Debug, Clone)]
pub enum Command {
    /// Begin to estimate, without a past. Not boxed: a box would be freed on the estimating thread.
    Begin(Plan),
    /// Fall silent: what comes from now on is nobody's.
    End,
    /// Other models or settings, taken over between two samples.
    Take(Plan),
    /// Forget all history.
    Reset,
}

/// Which events a sink gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
    /// Current commands alone: nothing else delays them.
    Commands,
    /// What the node publishes besides commands.
    Reports,
    /// Everything, accepted samples as well.
    All,
}

impl Wanted {
    #[inline]
    const fn has(self, event: &Event) -> bool {
        match (self, event) {
            (Self::All, _) | (Self::Commands, Event::Command(_)) => true,
            (Self::Commands, _) | (Self::Reports, Event::Command(_) | Event::Input(_)) => false,
            (Self::Reports, _) => true,
        }
    }
}

/// One sink's end of its ring, as the estimating thread holds it.
pub struct Outlet {
    ring: Producer<Event>,
    waker: Option<Thread>,
    dropped: Arc<AtomicU64>,
    wanted: Wanted,
}

/// One sink's end of its ring, as the sink holds it.
pub struct Inlet {
    /// Events, in order.
    pub events: Consumer<Event>,
    /// Events that the ring had no room for.
    pub dropped: Arc<AtomicU64>,
}

/// A ring of [`EVENTS`] between the estimating thread and a sink.
#[must_use]
pub fn channel(wanted: Wanted) -> (Outlet, Inlet) {
    let (ring, events) = RingBuffer::new(EVENTS);
    let dropped = Arc::new(AtomicU64::new(0));
    (Outlet { ring, waker: None, dropped: Arc::clone(&dropped), wanted }, Inlet { events, dropped })
}

impl Outlet {
    /// The same outlet, waking `sink` whenever it has put something in.
    #[must_use]
    pub fn waking(mut self, sink: Thread) -> Self {
        self.waker = Some(sink);
        self
    }

    #[inline]
    fn put(&mut self, event: Event) -> bool {
        if !self.wanted.has(&event) {
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
pub struct HotCounters {
    /// Samples taken.
    pub samples: AtomicU64,
    /// Those of them that came while nothing was estimated.
    pub idle: AtomicU64,
    /// Those of them that were used: neither idle nor refused.
    pub used: AtomicU64,
    /// Those of them that the pipeline refused.
    pub refused: AtomicU64,
    /// Samples lost because the ring was full.
    pub overflow: AtomicU64,
    /// Samples of two publishers of one input come mixed.
    pub mixed: AtomicBool,
    /// Commands obeyed.
    pub obeyed: AtomicU64,
    /// How long displacements waited in the ring. Under simulated time nothing says so.
    pub waiting: Latency,
    /// How long the step for a displacement took, with its events put into the rings.
    pub stepping: Latency,
}

/// Where a source puts its samples.
pub struct SampleSink {
    ring: Producer<Sample>,
    counters: Arc<HotCounters>,
    thread: Thread,
}

impl SampleSink {
    /// Hands over a sample; one that finds no room is dropped and counted, and the next estimate says so.
    #[inline]
    pub fn push(&mut self, sample: Sample) {
        if self.ring.push(sample).is_err() {
            self.counters.overflow.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Says whether samples of two publishers of one input come mixed; call before the samples. Every estimate says so while they do.
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

/// The estimating thread, from outside.
pub struct Hot {
    commands: Producer<Command>,
    /// Commands sent.
    sent: u64,
    counters: Arc<HotCounters>,
    worker: Worker,
}

impl Hot {
    /// Starts the thread, feeding `outlets`. It is idle until it is told to begin.
    ///
    /// # Errors
    /// When the system starts no thread.
    pub fn start(clock: Arc<Clock>, outlets: Vec<Outlet>) -> std::io::Result<(Self, SampleSink)> {
        let (sample_ring, samples) = RingBuffer::new(SAMPLES);
        let (commands, command_ring) = RingBuffer::new(COMMANDS);
        let counters = Arc::new(HotCounters::default());
        let worker = Worker::start("estimating", {
            let counters = Arc::clone(&counters);
            move |stop| run(&clock, outlets, samples, command_ring, stop, &counters)
        })?;
        let sink = SampleSink { ring: sample_ring, counters: Arc::clone(&counters), thread: worker.thread() };
        Ok((Self { commands, sent: 0, counters, worker }, sink))
    }

    /// Asks for a change; `None` when too many are waiting already. It is in force once
    /// [`HotCounters::obeyed`] has reached the number that is returned.
    pub fn command(&mut self, command: Command) -> Option<u64> {
        let sent = self.commands.push(command).is_ok();
        self.worker.thread().unpark();
        self.sent += u64::from(sent);
        sent.then_some(self.sent)
    }

    /// The thread's counters.
    #[must_use]
    pub fn counters(&self) -> Arc<HotCounters> {
        Arc::clone(&self.counters)
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.worker.is_alive()
    }

    /// Lets the thread finish what is in its ring, and ends it. `Err` when it had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        self.worker.stop()
    }
}

fn run(
    clock: &Clock,
    mut outlets: Vec<Outlet>,
    mut samples: Consumer<Sample>,
    mut commands: Consumer<Command>,
    stop: &Stop,
    counters: &HotCounters,
) {
    let mut pipeline: Option<Pipeline> = None;
    let mut overflow_seen = 0;
    loop {
        while let Ok(command) = commands.pop() {
            obey(&mut pipeline, command, &mut outlets);
            counters.obeyed.fetch_add(1, Ordering::Release);
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
            // Reading the clock is no system call on Linux.
            let began = (sample.reading.channel() == Channel::Displacement).then(Instant::now);
            if began.is_some() {
                clock.took_since(sample.received).into_iter().for_each(|took| counters.waiting.add(took));
            }
            let mut fanout = Fanout::new(&mut outlets);
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
        if stop.is_raised() {
            return;
        }
        if let (Some(pipeline), Some(now)) = (&mut pipeline, clock.now()) {
            let mut fanout = Fanout::new(&mut outlets);
            pipeline.tick(now, &mut |event| fanout.put(event));
            fanout.wake();
        }
        std::thread::park_timeout(TICK);
    }
}

fn obey(pipeline: &mut Option<Pipeline>, command: Command, outlets: &mut [Outlet]) {
    let mut fanout = Fanout::new(outlets);
    match (command, pipeline) {
        (Command::Begin(plan), pipeline) => *pipeline = Some(Pipeline::from(plan)),
        (Command::End, pipeline) => *pipeline = None,
        (Command::Take(plan), Some(pipeline)) => pipeline.take(plan, &mut |event| fanout.put(event)),
        (Command::Reset, Some(pipeline)) => pipeline.reset(&mut |event| fanout.put(event)),
        // What has not begun has nothing to change: it begins with what holds by then.
        (Command::Take(_) | Command::Reset, None) => {}
    }
    fanout.wake();
}

/// Puts events into every outlet, and wakes the sinks that got some.
struct Fanout<'a> {
    outlets: &'a mut [Outlet],
    /// One bit an outlet that was fed.
    fed: u32,
}

impl<'a> Fanout<'a> {
    fn new(outlets: &'a mut [Outlet]) -> Self {
        Self { outlets, fed: 0 }
    }

    #[inline]
    fn put(&mut self, event: Event) {
        for (index, outlet) in self.outlets.iter_mut().enumerate() {
            self.fed |= u32::from(outlet.put(event)) << index;
        }
    }

    #[inline]
    fn wake(self) {
        for (index, outlet) in self.outlets.iter().enumerate() {
            if self.fed & (1 << index) != 0 {
                outlet.wake();
            }
        }
    }
}
