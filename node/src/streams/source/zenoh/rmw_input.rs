//! Inputs from nodes on rmw_zenoh, in addition to inputs over DDS. Off unless `zenoh.rmw` is `both`.
//!
//! ```text
//! rmw_zenoh node ─→ Zenoh's threads: check, decode ─→ bounded queue ─→ source thread, as for inputs over DDS
//! ```
//!
//! Each input topic has a subscription, with the token that makes it visible. Malformed messages are refused, counted
//! and logged as over DDS. If a sample arrives both ways, the pipeline refuses the second, and the log asks for a
//! single publisher.
//!
//! A node that publishes an input topic with another type or type hash uses another key and is not received. The log
//! reports it, because rmw_zenoh does not.

use crate::settings::config::{Config, RosArgs};
use crate::settings::error::NodeError;
use crate::streams::sink::zenoh::{RmwCounters, RmwPresence};
use crate::streams::source::input::{JointError, ReadNumber, Reader, TOPICS};
use crate::streams::source::queued::QueuedInput;
use crate::streams::source::ros_source::{RosSource, SourceCounters};
use crate::streams::source::stamp::SampleOrigin;
use crate::zenoh::rmw::{Attachment, AttachmentError, Gid, Publisher, Role, gid};
use crate::zenoh::session::Link;
use mr_damper_base::clock::system_now;
use mr_damper_base::shown;
use mr_damper_base::worker::{Stop, Worker};
use mr_damper_msgs::{CdrError, Descriptor};
use std::sync::atomic::Ordering;
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Thread;
use std::time::Duration;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

/// Longest message, bytes: a `JointState` with a hundred joints needs a tenth of it.
const LONGEST: usize = 65_536;
/// How often the thread checks whether the session is open.
const LOOK: Duration = Duration::from_millis(50);
/// Sleep of the thread once everything is declared; it then only waits for its end.
const REST: Duration = Duration::from_secs(60);

/// The running inputs.
pub struct RmwSource(Worker);

/// An input that is not declared yet.
struct PlannedInput {
    topic: String,
    of: Descriptor,
    endpoint: InputEndpoint,
}

impl RmwSource {
    /// Starts the inputs of the node `presence`; they are declared once the session is open. `queue` leads to `source`.
    ///
    /// # Errors
    /// When an input is of type `JointState` and no joint is named, or the system cannot start the thread.
    pub fn start(
        link: &Arc<Link>,
        presence: &RmwPresence,
        args: &RosArgs,
        config: &Config,
        source: &RosSource,
        queue: &SyncSender<QueuedInput>,
    ) -> Result<Self, NodeError> {
        let plan = |(input, name): (usize, &'static str)| {
            let reader = Reader::of(name, &config.input(name).cloned().unwrap_or_default())?;
            let (topic, of) = (args.topic(name), reader.of);
            let wakes = name == TOPICS[0] || reader.is_unstamped();
            let endpoint = InputEndpoint {
                key: presence.node.key(&topic, &of),
                topic: topic.clone(),
                name,
                input,
                reader,
                queue: queue.clone(),
                last: Mutex::default(),
                waker: wakes.then(|| source.thread()),
                counters: presence.counters(),
                of_source: source.counters(),
            };
            Ok(PlannedInput { topic, of, endpoint })
        };
        let inputs = TOPICS.into_iter().enumerate().map(plan).collect::<Result<Vec<_>, NodeError>>()?;
        let open = if link.has_access_control() {
            ""
        } else {
            "; without access control, anyone who can reach the endpoint may send them"
        };
        tracing::info!(
            "inputs from nodes on rmw_zenoh are accepted in domain {}{open}",
            presence.node.domain
        );
        let (link, presence) = (Arc::clone(link), presence.clone());
        let worker = Worker::start("zenoh-inputs", move |stop| run(stop, &link, &presence, inputs))
            .map_err(NodeError::io("starting the thread that receives inputs from rmw_zenoh"))?;
        Ok(Self(worker))
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.0.is_alive()
    }

    /// Undeclares the subscriptions and ends the thread. `Err` when it had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        self.0.stop()
    }
}

/// The declarations of one input; dropping them undeclares it.
type Declared = (LivelinessToken, Subscriber<()>, Subscriber<()>);

fn run(stop: &Stop, link: &Link, presence: &RmwPresence, mut inputs: Vec<PlannedInput>) {
    let mut declared = Vec::with_capacity(inputs.len());
    while !stop.is_raised() {
        if !inputs.is_empty()
            && let Some(session) = link.session()
        {
            for input in inputs.drain(..) {
                let topic = input.topic.clone();
                match declare(&session, link.next_entity(), presence, input) {
                    Ok(done) => declared.push(done),
                    Err(error) => tracing::error!("Zenoh refused the input {topic} of rmw_zenoh: {error}"),
                }
            }
        }
        std::thread::park_timeout(if inputs.is_empty() { REST } else { LOOK });
    }
}

fn declare(
    session: &Session,
    id: u64,
    presence: &RmwPresence,
    input: PlannedInput,
) -> zenoh::Result<Declared> {
    let PlannedInput { topic, of, endpoint } = input;
    let (counters, of_source) = (Arc::clone(&endpoint.counters), Arc::clone(&endpoint.of_source));
    let watch = PublisherWatch { name: endpoint.name, of, counters, of_source };
    let node = &presence.node;
    // Zenoh's own threads run the callbacks, so these must not block.
    let subscriber = session
        .declare_subscriber(endpoint.key.clone())
        .callback(move |sample| endpoint.take(&sample))
        .wait()?;
    let publishers = session
        .liveliness()
        .declare_subscriber(node.publishers(&topic))
        .history(true)
        .callback(move |sample| watch.look(&sample))
        .wait()?;
    // Last, so that the input is ready for a node that sees the token.
    let token = node.endpoint(&session.zid().to_string(), id, Role::Subscription, &topic, &of);
    Ok((session.liveliness().declare_token(token).wait()?, subscriber, publishers))
}

/// The entry point for samples of one input.
struct InputEndpoint {
    key: String,
    /// Full name of the topic, after remapping.
    topic: String,
    name: &'static str,
    input: usize,
    reader: Reader,
    queue: SyncSender<QueuedInput>,
    /// Publisher and number of the last sample. Zenoh calls from several threads.
    last: Mutex<Option<(Gid, i64)>>,
    waker: Option<Thread>,
    counters: Arc<RmwCounters>,
    of_source: Arc<SourceCounters>,
}

/// Reasons why a sample is not used.
#[derive(Debug, thiserror::Error)]
enum InputError {
    #[error("it was sent to {sent_to}, not to {key}")]
    OtherKey { sent_to: String, key: String },
    #[error("it deletes, which topics do not support")]
    Delete,
    #[error(transparent)]
    Attachment(#[from] AttachmentError),
    #[error("it has {bytes} bytes; at most {LONGEST} are allowed")]
    TooLong { bytes: usize },
    #[error(transparent)]
    Message(#[from] CdrError),
    #[error(transparent)]
    Joint(#[from] JointError),
    #[error("the queue is full; the node does not keep up")]
    QueueFull,
}

impl InputEndpoint {
    fn take(&self, sample: &Sample) {
        let (input, name) = (self.input, self.name);
        let handed_on = self.read(sample).and_then(|(taken, origin)| {
            let number = taken?;
            let arrived = QueuedInput { input, number, origin };
            self.queue.try_send(arrived).map_err(|_| InputError::QueueFull)
        });
        match handed_on {
            Ok(()) => {
                self.counters.take();
                if let Some(thread) = &self.waker {
                    thread.unpark();
                }
            }
            Err(why) => {
                self.counters.refuse(&format!("{name}: {why}"));
                self.of_source.messages.fetch_add(1, Ordering::Relaxed);
                self.of_source.note_unreadable(&self.topic, &why);
            }
        }
    }

    /// Decodes a sample; the error says what is wrong with it.
    fn read(&self, sample: &Sample) -> Result<(ReadNumber, SampleOrigin), InputError> {
        let sent_to = sample.key_expr();
        // Access control lets a sample for a wildcard key pass wherever the wildcard itself is allowed.
        if sent_to.as_str() != self.key {
            let sent_to = shown::name(sent_to);
            return Err(InputError::OtherKey { sent_to, key: self.key.clone() });
        }
        if sample.kind() != SampleKind::Put {
            return Err(InputError::Delete);
        }
        let attachment = sample.attachment().map(|bytes| bytes.to_bytes()).unwrap_or_default();
        let attachment = Attachment::from_bytes(&attachment)?;
        let Attachment { seq, stamp_ns, gid } = attachment;
        self.note(gid, seq);
        let length = sample.payload().len();
        if length > LONGEST {
            return Err(InputError::TooLong { bytes: length });
        }
        let taken = self.reader.read(&sample.payload().to_bytes())?;
        let origin = SampleOrigin { writer: gid, sent_ns: Some(stamp_ns), arrived_ns: system_now().nanos() };
        Ok((taken, origin))
    }

    /// Counts samples lost on the way from one publisher: Zenoh drops samples silently when a link is too slow.
    fn note(&self, gid: Gid, seq: i64) {
        // A poisoned lock is harmless: at most one number was not stored.
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner).replace((gid, seq));
        let missing =
            last.filter(|(of, _)| *of == gid).map(|(_, last)| i128::from(seq) - i128::from(last) - 1);
        if let Some(missing) = missing.and_then(|missing| u64::try_from(missing).ok()) {
            self.counters.lose(missing);
        }
    }
}

/// Watches the publishers of an input.
struct PublisherWatch {
    name: &'static str,
    of: Descriptor,
    counters: Arc<RmwCounters>,
    of_source: Arc<SourceCounters>,
}

impl PublisherWatch {
    fn look(&self, token: &Sample) {
        let publisher = Publisher::read(token.key_expr().as_str());
        let Some(other) = publisher.filter(|_| token.kind() == SampleKind::Put) else { return };
        if (other.dds_type_name, other.type_hash) == (self.of.dds_type_name, self.of.type_hash) {
            self.of_source.name(gid(token.key_expr().as_str()), shown::name(&other.node));
            return;
        }
        let count = self.counters.mismatch();
        if count.is_power_of_two() {
            tracing::warn!(
                topic = self.name,
                count,
                "{} publishes it on rmw_zenoh as {} {}, and is ignored: this node expects {} {}; build both with the same interface \
                 package, or set {}.type",
                shown::name(&other.node),
                shown::name(other.dds_type_name),
                shown::name(other.type_hash),
                self.of.dds_type_name,
                self.of.type_hash,
                self.name,
            );
        }
    }
}
