//! A mirror with a ring to push events into, and its clients: sessions, certificates, a consumer that stalls.

pub(crate) mod keys;
pub(crate) mod proxy;
pub(crate) mod sessions;

pub(crate) use sessions::{endpoint, session};

use crate::wait::until;
use mr_damper_model::inverse::{CurrentCommand, LimitedBy};
use mr_damper_model::pipeline::{
    AlarmChange, Cause, Estimate, Event, Mode, Reasons, Refusal, Refused, Residual, Slot, StampedCommand,
    Transition, Validity,
};
use mr_damper_model::sample::{Drive, Reading, Sample, Stamp};
use mr_damper_model::units::{Ampere, Celsius, Metre, MetrePerSecond, Newton, Second, Volt};
use mr_damper_node::streams::sink::zenoh::{Damper, Link, Mirror, ModelNames, SessionMode, ZenohConfig};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, Thread};
use std::time::{Duration, Instant};
use zenoh::sample::Sample as ZenohSample;
use zenoh::{Session, Wait};

pub(crate) const RING: usize = 8192;
pub(crate) const DAMPER: &str = "front_left";

pub(crate) fn listening(endpoint: &str) -> ZenohConfig {
    ZenohConfig { listen: vec![endpoint.to_owned()], ..ZenohConfig::default() }
}

pub(crate) fn names() -> ModelNames {
    ModelNames { free: "thesis/fuzzy-tanh/rp3-cs".into(), seeded: None, hash: "0123abcd".into() }
}

/// The producing side of the ring, as in the estimating thread.
pub(crate) struct Feeder {
    ring: rtrb::Producer<Event>,
    pub(crate) dropped: Arc<AtomicU64>,
    waker: Thread,
}

impl Feeder {
    pub(crate) fn push(&mut self, event: Event) {
        if self.ring.push(event).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
        self.waker.unpark();
    }

    /// Pushes the events of `make` at `rate_hz`; catches up after a delay, as a source does.
    pub(crate) fn run(&mut self, count: u32, rate_hz: f64, make: impl Fn(u32) -> Vec<Event>) {
        let start = Instant::now();
        for k in 0..count {
            let due = start + Duration::from_secs_f64(f64::from(k) / rate_hz);
            thread::sleep(due.saturating_duration_since(Instant::now()));
            make(k).into_iter().for_each(|event| self.push(event));
        }
    }
}

pub(crate) struct Rig {
    pub(crate) mirror: Mirror,
    pub(crate) link: Link,
    pub(crate) feeder: Feeder,
    pub(crate) endpoint: String,
}

impl Rig {
    pub(crate) fn start() -> Self {
        Self::with(|_| {})
    }

    pub(crate) fn with(change: impl FnOnce(&mut ZenohConfig)) -> Self {
        let endpoint = endpoint();
        let mut config = listening(&endpoint);
        change(&mut config);
        let link = Link::open(&config).expect("the port is free");
        let (mirror, feeder) = mirror(&link, DAMPER);
        Self { mirror, link, feeder, endpoint }
    }
}

pub(crate) fn mirror(link: &Link, damper: &str) -> (Mirror, Feeder) {
    let (ring, events) = rtrb::RingBuffer::new(RING);
    let dropped = Arc::new(AtomicU64::new(0));
    let mirror = Mirror::start(link, Damper::named(damper), names(), events, Arc::clone(&dropped))
        .expect("the name is allowed");
    let waker = mirror.waker();
    (mirror, Feeder { ring, dropped, waker })
}
/// Received samples, in order.
#[derive(Clone, Default)]
pub(crate) struct Inbox(Arc<Mutex<Vec<ZenohSample>>>);

impl Inbox {
    pub(crate) fn samples(&self) -> Vec<ZenohSample> {
        self.0.lock().expect("no test panics while it holds this").clone()
    }

    pub(crate) fn len(&self) -> usize {
        self.0.lock().expect("no test panics while it holds this").len()
    }

    pub(crate) fn push(&self, sample: ZenohSample) {
        self.0.lock().expect("no test panics while it holds this").push(sample);
    }

    /// Samples of one topic, by the last part of their key.
    pub(crate) fn of(&self, tail: &str) -> Vec<ZenohSample> {
        let tail = format!("/{tail}");
        self.samples().into_iter().filter(|sample| sample.key_expr().as_str().ends_with(&tail)).collect()
    }
}

/// Subscribes, and returns once the mirror knows of it: a query sent after the declaration was answered.
pub(crate) fn subscribe(session: &Session, key: &str) -> Inbox {
    let inbox = Inbox::default();
    let to = inbox.clone();
    session
        .declare_subscriber(key.to_owned())
        .callback(move |sample| to.push(sample))
        .background()
        .wait()
        .expect("the key is valid");
    ask(session, "status");
    inbox
}

/// Queries until there is an answer, and returns it as JSON.
pub(crate) fn ask(session: &Session, question: &str) -> serde_json::Value {
    let sample = ask_raw(session, question).expect("the query is valid");
    serde_json::from_slice(&sample.payload().to_bytes()).expect("answers are JSON by default")
}

/// The reply, or the text of the error reply.
pub(crate) fn ask_raw(session: &Session, question: &str) -> Result<ZenohSample, String> {
    let selector = format!("mr_damper/{DAMPER}/{question}");
    let reply = until(&format!("an answer to {selector}"), || {
        session.get(&selector).wait().expect("the selector is valid").recv().ok()
    });
    reply
        .into_result()
        .map_err(|error| error.payload().try_to_string().expect("errors are text").into_owned())
}

pub(crate) fn json(sample: &ZenohSample) -> serde_json::Value {
    serde_json::from_slice(&sample.payload().to_bytes()).expect("the payload is JSON")
}

pub(crate) fn cbor(sample: &ZenohSample) -> serde_json::Value {
    ciborium::from_reader(&*sample.payload().to_bytes()).expect("the payload is CBOR")
}

pub(crate) fn sample(nanos: i64, reading: Reading) -> Sample {
    let stamp = Stamp::from_nanos(nanos);
    Sample { stamp, received: stamp, reading }
}

pub(crate) fn displacement(nanos: i64) -> Event {
    Event::Input(sample(nanos, Reading::Displacement(Metre(0.0125))))
}

pub(crate) fn estimate(nanos: i64, force_n: f64) -> Event {
    Event::Estimate(Estimate {
        stamp: Stamp::from_nanos(nanos),
        received: None,
        force: Newton(force_n),
        smoothing: Newton(0.0),
        std_dev: Newton(f64::NAN),
        slot: Slot::Free,
        mode: Mode::Model,
        validity: if force_n.is_finite() { Validity::Extrapolating } else { Validity::Invalid },
        reasons: Reasons::OUTSIDE_ENVELOPE,
        input_age: Second(0.002),
        band: [Newton(f64::NAN); 2],
        calibrated: false,
    })
}

pub(crate) fn residual(nanos: i64, residual_n: f64) -> Event {
    Event::Residual(Residual {
        stamp: Stamp::from_nanos(nanos),
        measured: Newton(100.0),
        predicted: Newton(100.0 - residual_n),
        load_cell: Newton(0.0),
        residual: Newton(residual_n),
        expected_rsse: Newton(f64::NAN),
        normalised: f64::NAN,
        windowed_rsse: Newton(8.0),
        windowed_esr: 0.001,
        window: Second(5.0),
        counts: true,
        alarm: false,
    })
}

/// One event for each topic; the residual belongs to the estimate.
pub(crate) fn one_of_each() -> Vec<Event> {
    vec![
        displacement(1),
        Event::Input(sample(2, Reading::Velocity(MetrePerSecond(0.1)))),
        Event::Input(sample(3, Reading::Drive(Drive::CoilCurrent(Ampere(0.8))))),
        Event::Input(sample(4, Reading::Drive(Drive::CommandVoltage(Volt(2.0))))),
        Event::Input(sample(5, Reading::Force(Newton(120.0)))),
        Event::Input(sample(6, Reading::CaseTemperature(Celsius(31.0)))),
        estimate(7, 119.0),
        residual(7, 1.0),
        Event::Transition(Transition {
            stamp: Stamp::from_nanos(9),
            from: Mode::Fault,
            to: Mode::Model,
            cause: Cause::ModelReady,
        }),
        Event::Refusal(Refusal {
            sample: sample(10, Reading::Displacement(Metre(f64::NAN))),
            why: Refused::NotFinite,
        }),
        Event::Alarm(AlarmChange { stamp: Stamp::from_nanos(11), raised: true, ratio: 1.75 }),
        Event::Input(sample(12, Reading::BodyVelocity(MetrePerSecond(0.2)))),
        Event::Input(sample(13, Reading::ForceRequest(Newton(900.0)))),
        Event::Command(StampedCommand {
            stamp: Stamp::from_nanos(14),
            known_at: Stamp::from_nanos(14),
            command: CurrentCommand {
                current: Ampere(2.5),
                requested: Newton(900.0),
                expected: Newton(700.0),
                achievable: [Newton(80.0), Newton(700.0)],
                is_achievable: false,
                dissipative: true,
                limited_by: LimitedBy::CurrentMax,
                substituted: false,
            },
        }),
    ]
}

pub(crate) fn client(endpoint: &str) -> ZenohConfig {
    ZenohConfig {
        connect: vec![endpoint.to_owned()],
        mode: Some(SessionMode::Client),
        ..ZenohConfig::default()
    }
}
