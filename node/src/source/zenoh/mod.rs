//! What comes in by Zenoh: inputs from nodes on rmw_zenoh (`rmw.rs`), and commands, for those that speak no ROS. Both are off by
//! default; commands are allowed each by name.
//!
//! ```text
//! put, get ─→ Zenoh's threads ─→ queue ─→ zenoh-commands ─┬→ ring ─→ source thread     forces, as from the ROS topic
//!                                                         └→ changes of model and mode, as by the ROS services
//! ```
//!
//! A command is put to `mr_damper/<damper>/cmd/<name>`, or asked for there with [`Query`]: then the answer says what became of
//! it. `order.rs` says what it holds. Who may command is for Zenoh's access control to say, before a command gets here.

mod order;
pub mod rmw;

pub use order::{Judge, Kind, Order, Refusal};

use crate::clock::Clock;
use crate::error::NodeError;
use crate::services::Changes;
use crate::sink::zenoh::{CommandCounters, Link, ZenohError};
use crate::worker::{Stop, Worker};
use mr_damper_model::sample::Stamp;
use mr_damper_model::units::Newton;
use rtrb::{Consumer, Producer, RingBuffer};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::key_expr::KeyExpr;
use zenoh::pubsub::Subscriber;
use zenoh::query::{Query, Queryable};
use zenoh::{Session, Wait};

/// Commands that may wait. More are refused and counted.
const WAITING: usize = 64;
/// Forces on their way to the source thread.
const FORCES: usize = 64;
/// How often the thread looks whether it shall stop, and whether there is a session by now.
const LOOK: Duration = Duration::from_millis(50);

/// A force that is asked for, and when; `None`: now.
pub type AskedForce = (Option<Stamp>, Newton);

/// What the source thread gets from Zenoh.
pub struct ByZenoh {
    /// Forces that are asked for. They wake nobody: they count with the next displacement.
    pub forces: Consumer<AskedForce>,
    /// Samples of nodes on rmw_zenoh.
    pub samples: Receiver<rmw::Arrived>,
}

/// What a service hands to those commands.
pub struct Obeying {
    /// Changes models and the mode.
    pub changes: Changes,
    /// Takes forces; see [`forces`].
    pub forces: Producer<AskedForce>,
    /// The clock that deadlines are read on.
    pub clock: Arc<Clock>,
    /// Directory of the model files that may be loaded; empty: presets only.
    pub model_dir: PathBuf,
    /// Counters.
    pub counters: Arc<CommandCounters>,
}

/// A ring for forces that are asked for: from here to the source thread.
#[must_use]
pub fn forces() -> (Producer<AskedForce>, Consumer<AskedForce>) {
    RingBuffer::new(FORCES)
}

/// The running source of commands.
pub struct ZenohSource(Worker);

/// A command as it came.
struct Incoming {
    kind: Kind,
    payload: ZBytes,
    is_cbor: bool,
    /// Where the answer goes; none for a put.
    query: Option<Query>,
}

impl ZenohSource {
    /// Takes the commands called `names` for `damper`, as soon as there is a session.
    ///
    /// # Errors
    /// When a name is none, or the system starts no thread.
    pub fn start(
        link: &Arc<Link>,
        damper: &str,
        names: &[String],
        obeying: Obeying,
    ) -> Result<Self, NodeError> {
        let kinds = names
            .iter()
            .map(|name| {
                Kind::named(name)
                    .ok_or_else(|| ZenohError::UnknownCommand { name: name.clone(), known: Kind::names() })
            })
            .collect::<Result<Vec<_>, _>>()?;
        let open = if link.has_access_control() {
            ""
        } else {
            "; there is no access control, so anybody who reaches the endpoint may"
        };
        tracing::info!("commands are taken from Zenoh: {}{open}", names.join(", "));
        let (link, damper) = (Arc::clone(link), damper.trim_matches('/').to_owned());
        let worker = Worker::start("zenoh-commands", move |stop| run(stop, &link, &damper, &kinds, obeying))
            .map_err(NodeError::io("starting the thread that takes commands from Zenoh"))?;
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

fn run(stop: &Stop, link: &Link, damper: &str, kinds: &[Kind], mut obeying: Obeying) {
    let (queue, commands) = sync_channel(WAITING);
    let mut declared = None;
    let mut judge = Judge::default();
    while !stop.is_raised() {
        if declared.is_none()
            && let Some(session) = link.session()
        {
            match declare(&session, damper, kinds, &queue, &obeying.counters) {
                Ok(done) => declared = Some(done),
                Err(error) => {
                    tracing::error!("Zenoh refused to take commands for {damper}: {error}");
                    return;
                }
            }
        }
        obey_waiting(&commands, &mut judge, &mut obeying);
    }
}

/// The declarations of one damper; dropping them takes them back.
type Declared = Vec<(Subscriber<()>, Queryable<()>)>;

fn declare(
    session: &Session,
    damper: &str,
    kinds: &[Kind],
    queue: &SyncSender<Incoming>,
    counters: &Arc<CommandCounters>,
) -> zenoh::Result<Declared> {
    let one = |kind: Kind| {
        let key = format!("mr_damper/{damper}/cmd/{}", kind.name());
        // Zenoh's own threads call these: they must not wait.
        let door = Door { key: key.clone(), kind, queue: queue.clone(), counters: Arc::clone(counters) };
        let asked = door.clone();
        let subscriber = session
            .declare_subscriber(key.clone())
            .callback(move |sample| {
                let is_cbor = *sample.encoding() == Encoding::APPLICATION_CBOR;
                door.let_in(
                    sample.key_expr(),
                    Incoming { kind, payload: sample.payload().clone(), is_cbor, query: None },
                );
            })
            .wait()?;
        let queryable = session
            .declare_queryable(key)
            .callback(move |query| {
                let payload = query.payload().cloned().unwrap_or_default();
                let is_cbor = query.encoding() == Some(&Encoding::APPLICATION_CBOR);
                let key = query.key_expr().clone();
                asked.let_in(&key, Incoming { kind, payload, is_cbor, query: Some(query) });
            })
            .wait()?;
        Ok((subscriber, queryable))
    };
    kinds.iter().map(|kind| one(*kind)).collect()
}

/// Where commands of one key come in.
#[derive(Clone)]
struct Door {
    key: String,
    kind: Kind,
    queue: SyncSender<Incoming>,
    counters: Arc<CommandCounters>,
}

impl Door {
    /// Hands a command on that was sent to this very key. Access control lets what is sent to a wildcard pass wherever the
    /// wildcard itself is allowed, so that would be a way around it.
    fn let_in(&self, sent_to: &KeyExpr<'_>, incoming: Incoming) {
        if sent_to.as_str() != self.key {
            self.counters.refuse(&format!(
                "{}: it was sent to {sent_to}, not to {}",
                self.kind.name(),
                self.key
            ));
        } else if self.queue.try_send(incoming).is_err() {
            self.counters.refuse("too many commands wait");
        }
    }
}

fn obey_waiting(commands: &Receiver<Incoming>, judge: &mut Judge, obeying: &mut Obeying) {
    let Incoming { kind, payload, is_cbor, query } = match commands.recv_timeout(LOOK) {
        Ok(incoming) => incoming,
        // The queue's other end is held by this thread too.
        Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return,
    };
    let now_ns = obeying.clock.now_or_system().nanos();
    let done = judge.judge(kind, &payload.to_bytes(), is_cbor, now_ns).and_then(|order| obey(order, obeying));
    match &done {
        Ok(_) => obeying.counters.obey(),
        Err(refusal) => {
            obeying.counters.refuse(&format!("{}: {refusal}", kind.name()));
            tracing::warn!(command = kind.name(), "a command from Zenoh is not obeyed: {refusal}");
        }
    }
    let Some(query) = query else { return };
    let key = query.key_expr().clone();
    let replied = match done {
        Ok(message) => {
            let text = serde_json::json!({ "obeyed": true, "message": message }).to_string();
            query.reply(key, text).encoding(Encoding::APPLICATION_JSON).wait()
        }
        Err(refusal) => {
            let text = serde_json::json!({ "error": refusal.to_string() }).to_string();
            query.reply_err(text).encoding(Encoding::APPLICATION_JSON).wait()
        }
    };
    if let Err(error) = replied {
        tracing::debug!("a command from Zenoh got no answer: {error}");
    }
}

/// Does what is ordered, and says what it did.
fn obey(order: Order, obeying: &mut Obeying) -> Result<String, Refusal> {
    match order {
        Order::Force(stamp, force) => obeying
            .forces
            .push((stamp, force))
            .map(|()| "asked for; current_command says what became of it".to_owned())
            .map_err(|_| Refusal::Impossible("the node does not keep up with what is asked for".to_owned())),
        Order::Model(name) => {
            let model = model_of(&name, obeying)?;
            obeying.changes.load_model(&model).map_err(Refusal::Impossible)
        }
        Order::Mode(mode) => {
            obeying.changes.set_mode(&mode).map_err(Refusal::Impossible)?;
            Ok(format!("the mode is {mode}"))
        }
    }
}

/// The preset or file that may be loaded under `name`. Whoever commands by Zenoh may be on another machine, and shall not have
/// this one's files read out in error messages.
fn model_of(name: &str, obeying: &Obeying) -> Result<String, Refusal> {
    if name.starts_with("thesis/") && mr_damper_model::preset::load(name).is_ok() {
        return Ok(name.to_owned());
    }
    let refuse = |why: &str| Refusal::Impossible(format!("model \"{name}\" {why}"));
    if obeying.model_dir.as_os_str().is_empty() {
        return Err(refuse(
            "is no preset, and files need zenoh.model_dir, the directory that they may come from",
        ));
    }
    let is_bare = !name.is_empty() && !name.starts_with('.') && !name.contains(['/', '\\']);
    if !is_bare {
        return Err(refuse("is neither a preset nor the bare name of a file in zenoh.model_dir"));
    }
    match obeying.model_dir.join(name).to_str() {
        Some(path) => Ok(path.to_owned()),
        None => Err(refuse("is in a directory whose name is no text")),
    }
}
