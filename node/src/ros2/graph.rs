//! The ROS graph as this process sees it: which endpoints of other processes match its own, and which node a publisher
//! belongs to.
//!
//! It replaces the `Spinner` of ros2-client 0.12.1 for two reasons. The spinner always creates a reader of `/clock`
//! with type `builtin_interfaces/msg/Time` (`node.rs`, `Spinner::spin`). That puts a second type on the topic in every
//! process, with or without simulated time. Also, a process with several nodes has one stream of participant events,
//! and each spinner would take events that the others need. So a process has one graph; nodes and topics still come
//! from ros2-client.

use crate::ros2::first_requests::FirstRequests;
use crate::settings::error::NodeError;
use crate::settings::task::Task;
use futures::{FutureExt, StreamExt};
use mr_damper_base::shown;
use rustdds::no_key::SimpleDataReaderCdr;
use rustdds::policy::{Durability, History};
use rustdds::{
    CDRDeserializerAdapter, DomainParticipant, DomainParticipantStatusEvent, GUID, QosPolicies,
    QosPolicyBuilder, StatusEvented, TopicKind,
};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::pin::pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Identity of a publisher: its GUID in DDS, or its gid on rmw_zenoh.
pub type Writer = [u8; 16];

/// The topic on which each participant publishes its nodes.
const TOPIC: &str = "ros_discovery_info";
const TYPE: &str = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";
/// Messages about nodes that can wait to be read.
const DEPTH: i32 = 64;
/// Nodes that are remembered per participant.
const NODES: usize = 256;

/// `rmw_dds_common/msg/ParticipantEntitiesInfo`: the nodes of a participant.
#[derive(Debug, Deserialize)]
struct Participant {
    _gid: Writer,
    nodes: Vec<Entities>,
}

/// `rmw_dds_common/msg/NodeEntitiesInfo`: a node and its endpoints.
#[derive(Debug, Deserialize)]
struct Entities {
    node_namespace: String,
    node_name: String,
    _readers: Vec<Writer>,
    writers: Vec<Writer>,
}

/// The endpoints of this process that make up a client of a service or an action.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Endpoints {
    pub(crate) writers: BTreeSet<Writer>,
    pub(crate) readers: BTreeSet<Writer>,
}

/// The known part of the graph. Dropping it ends its thread.
pub struct Graph {
    known: Arc<Mutex<GraphState>>,
    task: Option<Task>,
}

#[derive(Default)]
struct GraphState {
    /// Matched remote readers, by the writer of this process.
    readers: BTreeMap<Writer, BTreeSet<Writer>>,
    /// Matched remote writers, by the reader of this process.
    writers: BTreeMap<Writer, BTreeSet<Writer>>,
    /// Nodes of other processes: by participant, with full name and writers.
    nodes: BTreeMap<[u8; 12], Vec<(String, Vec<Writer>)>>,
}

impl Graph {
    /// Follows the graph as `participant` sees it, and asks new clients for their `first` requests.
    ///
    /// # Errors
    /// When the topic of nodes cannot be read, or the system cannot start the thread.
    pub(crate) fn start(
        participant: &DomainParticipant,
        first: Option<FirstRequests>,
    ) -> Result<Self, NodeError> {
        let failed = |error: &dyn std::fmt::Display| NodeError::Ros {
            what: format!("reading {TOPIC}"),
            why: error.to_string(),
        };
        // Created here, not on the thread: with DDS-Security, only one thread may create entities at a time.
        let qos = qos();
        let topic = participant
            .create_topic(TOPIC.to_owned(), TYPE.to_owned(), &qos, TopicKind::NoKey)
            .map_err(|e| failed(&e))?;
        let reader = participant
            .create_subscriber(&qos)
            .and_then(|subscriber| {
                subscriber
                    .create_simple_datareader_no_key::<Participant, CDRDeserializerAdapter<_>>(&topic, None)
            })
            .map_err(|e| failed(&e))?;
        let known = Arc::<Mutex<GraphState>>::default();
        let (followed, participant) = (Arc::clone(&known), participant.clone());
        let task = Task::start("ros-graph", |stop| async move {
            let following = pin!(follow(&participant, &reader, &followed, first));
            futures::future::select(following, stop).await;
        })?;
        Ok(Self { known, task: Some(task) })
    }

    /// True while its thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.task.as_ref().is_some_and(Task::is_alive)
    }

    /// Number of remote readers that are matched with a writer of this process.
    #[must_use]
    pub fn readers_of(&self, writer: GUID) -> usize {
        self.known().readers.get(&writer.to_bytes()).map_or(0, BTreeSet::len)
    }

    /// Number of remote writers that are matched with a reader of this process.
    #[must_use]
    pub fn writers_of(&self, reader: GUID) -> usize {
        self.known().writers.get(&reader.to_bytes()).map_or(0, BTreeSet::len)
    }

    /// True when each of these endpoints is matched with a remote one.
    #[must_use]
    pub fn are_matched(&self, endpoints: &Endpoints) -> bool {
        let known = self.known();
        let is_in = |matched: &BTreeMap<Writer, BTreeSet<Writer>>, of: &Writer| {
            matched.get(of).is_some_and(|others| !others.is_empty())
        };
        endpoints.writers.iter().all(|writer| is_in(&known.readers, writer))
            && endpoints.readers.iter().all(|reader| is_in(&known.writers, reader))
    }

    /// The full name of the node that a publisher belongs to; `None` if its participant has not published it.
    #[must_use]
    pub fn node_of(&self, writer: &Writer) -> Option<String> {
        let known = self.known();
        let nodes = known.nodes.get(&prefix_of(writer))?;
        nodes.iter().find(|(_, writers)| writers.contains(writer)).map(|(node, _)| node.clone())
    }

    fn known(&self) -> MutexGuard<'_, GraphState> {
        lock(&self.known)
    }
}

impl Drop for Graph {
    fn drop(&mut self) {
        if self.task.take().is_some_and(|task| task.stop().is_err()) {
            tracing::error!("the thread that follows the ROS graph had panicked");
        }
    }
}

/// QoS of the topic of nodes. Transient local, so that participants that started earlier are received as well.
fn qos() -> QosPolicies {
    QosPolicyBuilder::new()
        .durability(Durability::TransientLocal)
        .reliable(rustdds::Duration::ZERO)
        .history(History::KeepLast { depth: DEPTH })
        .build()
}

async fn follow(
    participant: &DomainParticipant,
    reader: &SimpleDataReaderCdr<Participant>,
    known: &Mutex<GraphState>,
    mut first: Option<FirstRequests>,
) {
    let listener = participant.status_listener();
    let mut events = pin!(listener.as_async_status_stream());
    let mut info = pin!(reader.as_async_stream());
    loop {
        let received = {
            let mut asking = pin!(ask(&mut first).fuse());
            futures::select! {
                event = events.select_next_some() => Some(event),
                of_nodes = info.select_next_some() => {
                    match of_nodes {
                        Ok(change) => {
                            let of = prefix_of(&change.writer_guid().to_bytes());
                            lock(known).name(of, change.into_value());
                        }
                        Err(error) => tracing::debug!("cannot read {TOPIC}: {error}"),
                    }
                    None
                }
                () = asking => None,
            }
        };
        let Some(event) = received else { continue };
        if let Some(first) = &mut first {
            first.on_event(participant, &event);
        }
        lock(known).apply(&event);
    }
}

/// Asks for first requests if enabled; never returns.
async fn ask(first: &mut Option<FirstRequests>) {
    match first {
        Some(first) => first.ask().await,
        None => std::future::pending().await,
    }
}

impl GraphState {
    fn apply(&mut self, event: &DomainParticipantStatusEvent) {
        use DomainParticipantStatusEvent as Event;
        match event {
            Event::RemoteReaderMatched { local_writer, remote_reader } => {
                self.readers.entry(local_writer.to_bytes()).or_default().insert(remote_reader.to_bytes());
            }
            Event::RemoteWriterMatched { local_reader, remote_writer } => {
                self.writers.entry(local_reader.to_bytes()).or_default().insert(remote_writer.to_bytes());
            }
            Event::ReaderLost { guid, .. } => self.forget(|other| *other == guid.to_bytes()),
            Event::WriterLost { guid, .. } => self.forget(|other| *other == guid.to_bytes()),
            Event::ParticipantLost { id, .. } => {
                let lost: &[u8] = id.as_ref();
                self.nodes.retain(|prefix, _| prefix != lost);
                self.forget(|other| other.starts_with(lost));
            }
            _ => {}
        }
    }

    fn forget(&mut self, is_lost: impl Fn(&Writer) -> bool) {
        let matched = self.readers.values_mut().chain(self.writers.values_mut());
        matched.for_each(|others| others.retain(|other| !is_lost(other)));
    }

    /// Notes the nodes of a participant. The key is the sender's GUID, because the name in the message can be anything.
    fn name(&mut self, participant: [u8; 12], info: Participant) {
        let full_name = |of: &Entities| {
            shown::name(&format!("{}/{}", of.node_namespace.trim_end_matches('/'), of.node_name))
        };
        let nodes = info.nodes.into_iter().take(NODES);
        let nodes = nodes.map(|of| (full_name(&of), of.writers)).collect();
        self.nodes.insert(participant, nodes);
    }
}

/// The participant that an endpoint belongs to.
fn prefix_of(endpoint: &Writer) -> [u8; 12] {
    std::array::from_fn(|index| endpoint[index])
}

/// Locks `known`. A panic of the last holder does no harm: entries are added as a whole.
fn lock(known: &Mutex<GraphState>) -> MutexGuard<'_, GraphState> {
    known.lock().unwrap_or_else(PoisonError::into_inner)
}
