//! Receives data over Zenoh: inputs from nodes on rmw_zenoh (`rmw_input.rs`), and commands from clients without ROS. Both are
//! off by default; each command must be allowed by name.
//!
//! ```text
//! put, get ─→ Zenoh's threads ─→ queue ─→ zenoh-commands ─┬→ ring ─→ source thread     forces, as from the ROS topic
//!                                                         └→ changes of model and mode, as by the ROS services
//! ```
//!
//! A command is put to `mr_damper/<damper>/cmd/<name>`, or sent there with [`Query`], which returns the result.
//! `command_check.rs` describes the content. Zenoh's access control decides who may send commands.

mod command_check;
pub mod rmw_input;

pub use command_check::{CommandCheck, CommandKind, CommandRefusal, ZenohCommand};

use crate::settings::error::NodeError;
use crate::streams::changes::Changes;
use crate::streams::sink::zenoh::CommandCounters;
use crate::zenoh::session::{Link, ZenohError};
use mr_damper_base::clock::Clock;
use mr_damper_base::worker::{Stop, Worker};
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

/// Commands that can wait. Further commands are refused and counted.
const WAITING: usize = 64;
/// Demanded forces that can wait for the source thread.
const FORCES: usize = 64;
/// How often the thread checks for the stop signal and for an open session.
const LOOK: Duration = Duration::from_millis(50);

/// A demanded force with its stamp; `None`: now.
pub type DemandedForce = (Option<Stamp>, Newton);

/// The means to execute commands.
pub struct CommandContext {
    /// Changes the models and the mode.
    pub changes: Changes,
    /// Receives demanded forces; see [`forces`].
    pub forces: Producer<DemandedForce>,
    /// The clock to which deadlines refer.
    pub clock: Arc<Clock>,
    /// Directory of the model files that may be loaded; if empty, presets only.
    pub model_dir: PathBuf,
    /// Counters.
    pub counters: Arc<CommandCounters>,
}

/// A ring for demanded forces, from this module to the source thread.
#[must_use]
pub fn forces() -> (Producer<DemandedForce>, Consumer<DemandedForce>) {
    RingBuffer::new(FORCES)
}

/// The running source of commands.
pub struct ZenohSource(Worker);

/// A received command.
struct Incoming {
    kind: CommandKind,
    payload: ZBytes,
    is_cbor: bool,
    /// Receives the answer; `None` for a put.
    query: Option<Query>,
}

impl ZenohSource {
    /// Starts to accept the commands `names` for `damper`, once the session is open.
    ///
    /// # Errors
    /// When a name is unknown, or the system cannot start the thread.
    pub fn start(
        link: &Arc<Link>,
        damper: &str,
        names: &[String],
        context: CommandContext,
    ) -> Result<Self, NodeError> {
        let kinds = names
            .iter()
            .map(|name| {
                CommandKind::named(name).ok_or_else(|| ZenohError::UnknownCommand {
                    name: name.clone(),
                    known: CommandKind::names(),
                })
            })
            .collect::<Result<Vec<_>, _>>()?;
        let open = if link.has_access_control() {
            ""
        } else {
            "; without access control, anyone who can reach the endpoint may send them"
        };
        tracing::info!("commands from Zenoh are accepted: {}{open}", names.join(", "));
        let (link, damper) = (Arc::clone(link), damper.trim_matches('/').to_owned());
        let worker = Worker::start("zenoh-commands", move |stop| run(stop, &link, &damper, &kinds, context))
            .map_err(NodeError::io("starting the thread that receives commands from Zenoh"))?;
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

fn run(stop: &Stop, link: &Link, damper: &str, kinds: &[CommandKind], mut context: CommandContext) {
    let (queue, commands) = sync_channel(WAITING);
    let mut declared = None;
    let mut check = CommandCheck::default();
    while !stop.is_raised() {
        if declared.is_none()
            && let Some(session) = link.session()
        {
            match declare(&session, damper, kinds, &queue, &context.counters) {
                Ok(done) => declared = Some(done),
                Err(error) => {
                    tracing::error!("Zenoh cannot accept commands for {damper}: {error}");
                    return;
                }
            }
        }
        execute_next(&commands, &mut check, &mut context);
    }
}

/// The declarations of one damper; dropping them undeclares them.
type Declared = Vec<(Subscriber<()>, Queryable<()>)>;

fn declare(
    session: &Session,
    damper: &str,
    kinds: &[CommandKind],
    queue: &SyncSender<Incoming>,
    counters: &Arc<CommandCounters>,
) -> zenoh::Result<Declared> {
    let one = |kind: CommandKind| {
        let key = format!("mr_damper/{damper}/cmd/{}", kind.name());
        // Zenoh's own threads run the callbacks, so these must not block.
        let endpoint =
            CommandEndpoint { key: key.clone(), kind, queue: queue.clone(), counters: Arc::clone(counters) };
        let for_queries = endpoint.clone();
        let subscriber = session
            .declare_subscriber(key.clone())
            .callback(move |sample| {
                let is_cbor = *sample.encoding() == Encoding::APPLICATION_CBOR;
                endpoint.receive(
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
                for_queries.receive(&key, Incoming { kind, payload, is_cbor, query: Some(query) });
            })
            .wait()?;
        Ok((subscriber, queryable))
    };
    kinds.iter().map(|kind| one(*kind)).collect()
}

/// The entry point for commands on one key.
#[derive(Clone)]
struct CommandEndpoint {
    key: String,
    kind: CommandKind,
    queue: SyncSender<Incoming>,
    counters: Arc<CommandCounters>,
}

impl CommandEndpoint {
    /// Queues a command that was sent to exactly this key. Access control lets a command to a wildcard key pass
    /// wherever the wildcard itself is allowed, so accepting it would bypass the rules.
    fn receive(&self, sent_to: &KeyExpr<'_>, incoming: Incoming) {
        if sent_to.as_str() != self.key {
            self.counters.refuse(&format!(
                "{}: it was sent to {sent_to}, not to {}",
                self.kind.name(),
                self.key
            ));
        } else if self.queue.try_send(incoming).is_err() {
            self.counters.refuse("too many commands are waiting");
        }
    }
}

fn execute_next(commands: &Receiver<Incoming>, check: &mut CommandCheck, context: &mut CommandContext) {
    let Incoming { kind, payload, is_cbor, query } = match commands.recv_timeout(LOOK) {
        Ok(incoming) => incoming,
        // This thread also holds the other end of the queue.
        Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return,
    };
    let now_ns = context.clock.now_or_system().nanos();
    let done = check
        .accept(kind, &payload.to_bytes(), is_cbor, now_ns)
        .and_then(|command| execute(command, context));
    match &done {
        Ok(_) => context.counters.execute(),
        Err(refusal) => {
            context.counters.refuse(&format!("{}: {refusal}", kind.name()));
            tracing::warn!(command = kind.name(), "a command from Zenoh was refused: {refusal}");
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
        tracing::debug!("cannot answer a command from Zenoh: {error}");
    }
}

/// Executes a command, and returns a message about the result.
fn execute(command: ZenohCommand, context: &mut CommandContext) -> Result<String, CommandRefusal> {
    match command {
        ZenohCommand::Force(stamp, force) => context
            .forces
            .push((stamp, force))
            .map(|()| "force requested; current_command shows the result".to_owned())
            .map_err(|_| {
                CommandRefusal::Impossible("the node cannot keep up with the force requests".to_owned())
            }),
        ZenohCommand::Model(name) => {
            let model = loadable_model(&name, context)?;
            context.changes.load_model(&model).map_err(impossible)
        }
        ZenohCommand::Mode(mode) => {
            context.changes.set_mode(&mode).map_err(impossible)?;
            Ok(format!("the mode is {mode}"))
        }
    }
}

fn impossible(error: NodeError) -> CommandRefusal {
    CommandRefusal::Impossible(error.to_string())
}

/// The preset or file that may be loaded under `name`. The sender may be on another machine, and error messages must
/// not reveal the content of this machine's files.
fn loadable_model(name: &str, context: &CommandContext) -> Result<String, CommandRefusal> {
    if name.starts_with("thesis/") && mr_damper_model::preset::load(name).is_ok() {
        return Ok(name.to_owned());
    }
    let refuse = |why: &str| CommandRefusal::Impossible(format!("model \"{name}\" {why}"));
    if context.model_dir.as_os_str().is_empty() {
        return Err(refuse("is not a preset; to load files, set zenoh.model_dir to their directory"));
    }
    let is_bare = !name.is_empty() && !name.starts_with('.') && !name.contains(['/', '\\']);
    if !is_bare {
        return Err(refuse("is neither a preset nor the bare name of a file in zenoh.model_dir"));
    }
    match context.model_dir.join(name).to_str() {
        Some(path) => Ok(path.to_owned()),
        None => Err(refuse("is in a directory whose name is not valid UTF-8")),
    }
}
