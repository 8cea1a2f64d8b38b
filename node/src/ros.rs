//! The ROS 2 side of the process: participant, node, graph, and their shutdown.
//!
//! The client library ignores `ROS_DOMAIN_ID` and the localhost settings, so the participant is built here.
//!
//! At the end of the process, the order of dropping matters: publishers and subscriptions, the node, the graph's thread
//! (which is joined), then the context. Only in this order are peers informed at once; otherwise they list the node for
//! another half minute.

use crate::answer_limit::AnswerLimit;
use crate::client::{Reaching, endpoints_of};
use crate::config::qos::{End, Overrides};
use crate::config::{Config, RosArgs};
use crate::dds_threads::DdsThreads;
use crate::error::NodeError;
use crate::first_requests::FirstRequests;
use crate::graph::{Endpoints, Graph, Writer};
use crate::hardened;
use crate::lagging_readers::{LaggingReaders, LocalWriter, WINDOW, Writers};
use crate::listed_peers::ListedPeers;
use crate::participant_ports::with_both_ports;
use crate::ros_environment::{self, NetworkRequest, Reach, Remark};
use crate::security::Enclave;
use mr_damper_base::realtime::{self, Scheduling};
use mr_damper_msgs::rcl::Log;
use mr_damper_msgs::{Action, Message, Service};
use ros2_client::action::{
    ActionClientQosPolicies, ActionServerQosPolicies, AsyncActionServer, ExecutingGoalHandle, NewGoalHandle,
};
use ros2_client::qos::{Durability, History, QosProfile, Reliability, WhenFull};
use ros2_client::service::Server;
use ros2_client::{
    ActionTypeName, Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, ServiceMapping,
    ServiceTypeName, Subscription,
};
use rustdds::{DomainParticipantBuilder, GUID, QosPolicies, RTPSEntity, TopicKind, policy};
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::time::Duration;

/// Depth of every topic's history: one second at 1 kHz. Peers do not see it. A writer drops the samples that the
/// middleware's thread has not sent when the history is full; the usual depth of 10 lost samples on a busy machine. A
/// reader keeps the samples that the source thread has not taken.
const DEPTH: usize = 1024;

/// Size of the socket's send buffer, bytes; the system limits it to `net.core.wmem_max`. One socket serves all readers.
/// While Linux resolves the address of a host, it holds up to 208 KiB for that host (`unres_qlen_bytes`). This equals a
/// socket's default buffer, so one absent host would block all others for seconds.
const SEND_BUFFER: usize = 1 << 20;

/// How long a program that plays a run waits for readers that are slower.
const PLAYER_PATIENCE: Duration = Duration::from_millis(100);

/// Depth of topics with at most about one message per second. Kept messages stay in memory: thousands of long texts
/// would make the node grow for a quarter of an hour.
const SELDOM_DEPTH: usize = 64;

/// Requests and responses that a service keeps, as usual in ROS 2.
const SERVICE_DEPTH: usize = 10;

/// The largest domain: ports of a larger one would exceed the port range.
const LAST_DOMAIN: u16 = 232;

/// Log lines that late joiners get. Other nodes have 1000; fewer are kept here because they stay in memory.
const LOG_DEPTH: usize = 100;

/// The message for the case that a thread of the DDS library has ended.
pub const DEAF: &str = "a thread of the DDS library has ended, so nothing is received or sent any more; this happens when a process is \
     stopped and continued (Ctrl-Z and fg, SIGSTOP, a debugger)";

/// The server of a service.
pub type ServerOf<S> = Server<RosMessage<<S as Service>::Request>, RosMessage<<S as Service>::Response>>;

pub use crate::client::{ActionClientOf, ClientOf, RosMessage};

/// The server of an action.
pub type ActionServerOf<A> = AsyncActionServer<
    RosMessage<<A as Action>::Goal>,
    RosMessage<<A as Action>::Result>,
    RosMessage<<A as Action>::Feedback>,
>;

/// A new goal of an action, neither accepted nor rejected.
pub type NewGoalOf<A> = NewGoalHandle<RosMessage<<A as Action>::Goal>>;

/// A goal of an action that is being executed.
pub type ExecutingOf<A> = ExecutingGoalHandle<RosMessage<<A as Action>::Goal>>;

/// The ROS domain that this process has joined, with one participant for all its nodes.
#[derive(Clone)]
pub struct Domain {
    /// First field, so that its thread releases the participant before the context is dropped.
    _lagging: Option<Arc<LaggingReaders>>,
    writers: Writers,
    /// Before the context, so that its reader is dropped before the participant.
    graph: Arc<Graph>,
    context: Context,
    threads: Arc<DdsThreads>,
    /// Announces this process to listed hosts as long as it is in the domain.
    _listed: Option<Arc<ListedPeers>>,
}

impl Domain {
    /// Joins the domain given by `config`, with DDS-Security if the environment or `enclave` request it.
    ///
    /// # Errors
    /// When the participant cannot be created (no network interface, no free ports), or when security is requested but
    /// not available.
    pub fn join(config: &Config, enclave: Option<&str>) -> Result<Self, NodeError> {
        Self::join_raised(config, enclave, 0).map(|(domain, _)| domain)
    }

    /// Like [`Domain::join`], with the threads of the DDS library at a real-time `priority` (0: none). Also returns the
    /// resulting scheduling.
    ///
    /// # Errors
    /// The same as for [`Domain::join`].
    pub fn join_raised(
        config: &Config,
        enclave: Option<&str>,
        priority: u8,
    ) -> Result<(Self, Scheduling), NodeError> {
        let announced = crate::security::name_of_enclave(enclave);
        let enclave = Enclave::asked_for(enclave)?;
        let domain = domain_id(config)?;
        if config.discovery_range == "localhost" && !config.discovery_peers.is_empty() {
            return Err(NodeError::Usage(
                "discovery_peers names other hosts, but discovery_range is localhost: leave one of them out"
                    .to_owned(),
            ));
        }
        let requested = ros_environment::requested(config, &ros_environment::of_process)?;
        for Remark { found, advice } in &requested.remarks {
            tracing::warn!("{found}; {advice}");
        }
        if requested.reach == Reach::Loopback {
            require_loopback()?;
        }
        let mut advice = "check that a network interface is up and UDP ports from 7400 are free".to_owned();
        if let Some(enclave) = &enclave {
            let directory = enclave.directory().display();
            advice +=
                &format!(", and that the files in {directory} are signed, valid and for domain {domain}");
            tracing::info!(enclave = %directory, "DDS-Security is on");
        }
        hardened::announce(&announced);
        let build = || {
            let builder = builder(domain, requested.reach, enclave.as_ref())?;
            let (built, threads) = DdsThreads::of(|| builder.build());
            let participant = built.map_err(|e| failed(format!("joining domain {domain}"), &e, &advice))?;
            Ok((participant, threads))
        };
        let (joined, scheduling) = realtime::raised(priority, || with_both_ports(domain, build));
        let (participant, threads) = joined?;
        let listed = match requested.peers.is_empty() {
            true => None,
            false => Some(ListedPeers::start(&requested.peers, domain, participant.guid().prefix.as_ref())?),
        };
        let writers = Writers::default();
        // With DDS-Security, messages in the name of another participant are rejected. The writers of the hardened
        // build need no help.
        let (lagging, first) = match (&enclave, hardened::EDITS) {
            (Some(_), _) | (_, Some(_)) => (None, None),
            (None, None) => (
                Some(
                    LaggingReaders::start(participant.clone(), writers.clone())
                        .map_err(NodeError::io("starting the thread for lagging readers"))?,
                ),
                Some(FirstRequests::new().map_err(NodeError::io("opening a socket for first requests"))?),
            ),
        };
        let graph = Arc::new(Graph::start(&participant, first)?);
        let context = Context::from_domain_participant(participant)
            .map_err(|e| failed("creating the ROS context", &e, ""))?;
        let domain = Self {
            _lagging: lagging.map(Arc::new),
            writers,
            graph,
            context,
            threads: Arc::new(threads),
            _listed: listed.map(Arc::new),
        };
        Ok((domain, scheduling))
    }

    /// False once a thread of the DDS library has ended; then nothing is received or sent any more.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.threads.are_alive()
    }

    /// Fits long answers to clients with network addresses.
    #[must_use]
    pub fn answer_limit(&self) -> AnswerLimit {
        AnswerLimit::new(self.context.clone())
    }

    /// Number of publishers of `topic` (full name) in other processes that discovery has found so far.
    #[must_use]
    pub fn other_publishers(&self, topic: &str) -> usize {
        let participant = self.context.domain_participant();
        let (own, dds_name) = (participant.guid().prefix, format!("{TOPIC_PREFIX}{topic}"));
        let writers = participant.discovered_writers();
        let others = writers.iter().filter(|writer| writer.writer_proxy.remote_writer_guid.prefix != own);
        others.filter(|writer| writer.publication_topic_data.topic_name == dds_name).count()
    }

    /// The publishers on `topic` (full name) with the DDS type `dds_type_name` in other processes that discovery has
    /// found so far.
    #[must_use]
    pub fn publishers(&self, topic: &str, dds_type_name: &str) -> Vec<Writer> {
        let dds_name = format!("{TOPIC_PREFIX}{topic}");
        let writers = self.context.domain_participant().discovered_writers().into_iter();
        let of_topic = writers.filter(|writer| {
            let data = &writer.publication_topic_data;
            data.topic_name == dds_name && data.type_name == dds_type_name
        });
        of_topic.map(|writer| writer.writer_proxy.remote_writer_guid.to_bytes()).collect()
    }

    /// The full name of the node that a publisher belongs to; `None` if its participant has not published it.
    #[must_use]
    pub fn node_of(&self, writer: &Writer) -> Option<String> {
        self.graph.node_of(writer)
    }
}

/// The settings of a participant.
///
/// # Errors
/// When DDS-Security is requested of a program without it.
fn builder(
    domain: u16,
    reach: Reach,
    enclave: Option<&Enclave>,
) -> Result<DomainParticipantBuilder, NodeError> {
    let mut builder = DomainParticipantBuilder::new(domain).socket_send_buffer_size(SEND_BUFFER);
    if reach == Reach::Loopback {
        builder = builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
    }
    match enclave {
        Some(enclave) => enclave.secure(builder),
        None => Ok(builder),
    }
}

/// The prefix of ROS 2 topics' names in DDS.
const TOPIC_PREFIX: &str = "rt";

/// QoS of the node's outputs. It never blocks on a reader: a writer whose window is full refuses at once.
fn output_qos(depth: usize) -> QosProfile {
    QosProfile::publisher_default()
        .reliability(Reliability::Reliable { when_full: WhenFull::Fail })
        .history(History::KeepLast { depth })
}

/// The DDS library did not accept a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the DDS library took no more messages of this topic; check whether the network or a reader is overloaded"
)]
pub struct NotTaken;

/// An output topic.
pub struct Output<M: Message> {
    publisher: Publisher<M>,
    written: Arc<LocalWriter>,
}

impl<M: Message> Output<M> {
    /// Passes a message to the DDS library.
    ///
    /// # Errors
    /// When the library does not accept it.
    pub fn publish(&self, message: M) -> Result<(), NotTaken> {
        self.publisher.publish(message).map_err(|_| NotTaken)?;
        self.written.note();
        Ok(())
    }

    /// The publisher's GUID.
    #[must_use]
    pub fn guid(&self) -> GUID {
        self.publisher.guid()
    }
}

/// A ROS 2 node of this process.
pub struct Ros {
    node: Arc<Node>,
    domain: Domain,
    /// QoS of topics that differs from the node's own.
    overrides: Overrides,
}

/// The domain given by `config` or the environment.
///
/// # Errors
/// When the domain is not a number from 0 to 232.
pub fn domain_id(config: &Config) -> Result<u16, NodeError> {
    let refused = |name: &str, value: String| NodeError::Parameter {
        name: name.to_owned(),
        value,
        expected: format!("a whole number from 0 to {LAST_DOMAIN}"),
    };
    let is_domain = |id: &u16| *id <= LAST_DOMAIN;
    if config.domain_id >= 0 {
        let id = u16::try_from(config.domain_id).ok().filter(is_domain);
        return id.ok_or_else(|| refused("domain_id", config.domain_id.to_string()));
    }
    match ros_environment::of_process("ROS_DOMAIN_ID") {
        Some(text) => {
            let id = text.parse().ok().filter(is_domain);
            id.ok_or_else(|| refused("ROS_DOMAIN_ID (environment)", format!("{text:?}")))
        }
        None => Ok(0),
    }
}

/// Parses the domain of a flag; -1 selects the environment's domain.
///
/// # Errors
/// The expected values, as text.
pub fn domain_flag(text: &str) -> Result<i64, String> {
    let id = text.parse().ok().filter(|id| (-1..=i64::from(LAST_DOMAIN)).contains(id));
    id.ok_or_else(|| format!("a ROS domain is a whole number from 0 to {LAST_DOMAIN}"))
}

/// The request of `config` and this process's environment. If the environment is invalid, the result is loopback only;
/// [`Domain::join`] reports the error.
fn requested(config: &Config) -> NetworkRequest {
    let nothing = NetworkRequest { reach: Reach::Loopback, peers: Vec::new(), remarks: Vec::new() };
    ros_environment::requested(config, &ros_environment::of_process).unwrap_or(nothing)
}

/// The hosts to which this process is announced by unicast, from the parameter or the environment.
#[must_use]
pub fn listed_peers(config: &Config) -> Vec<String> {
    requested(config).peers
}

/// True when only this machine can find the node, by parameter, by ROS' environment, or by default. False if hosts are
/// listed.
#[must_use]
pub fn is_loopback_only(config: &Config) -> bool {
    requested(config).reach == Reach::Loopback
}

/// The domain and the reach of a service with `config`, as text.
///
/// # Errors
/// When `ROS_DOMAIN_ID` is not a valid domain.
pub fn reach(config: &Config) -> Result<String, NodeError> {
    let requested = ros_environment::requested(config, &ros_environment::of_process)?;
    let mut range = match requested.reach {
        Reach::Loopback => "this machine only".to_owned(),
        Reach::Network => "all networks".to_owned(),
    };
    if !requested.peers.is_empty() {
        range += &format!(" and {}", requested.peers.join(", "));
    }
    Ok(format!("domain {}, {range}", domain_id(config)?))
}

impl Ros {
    /// Joins the domain and creates the node called `name`.
    ///
    /// # Errors
    /// The same as for [`Domain::join`] and [`Ros::start_in`].
    pub fn start(
        config: &Config,
        args: &RosArgs,
        options: NodeOptions,
        name: &str,
    ) -> Result<Self, NodeError> {
        let overrides = if config.qos == Overrides::default() { args.qos()? } else { config.qos.clone() };
        let mut ros = Self::start_in(&Domain::join(config, args.enclave.as_deref())?, args, options, name)?;
        ros.override_qos(overrides);
        Ok(ros)
    }

    /// Sets the QoS overrides for all topics that are published and subscribed to from now on.
    pub fn override_qos(&mut self, overrides: Overrides) {
        self.overrides = overrides;
    }

    /// Creates the node called `name` in `domain`.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn start_in(
        domain: &Domain,
        args: &RosArgs,
        options: NodeOptions,
        name: &str,
    ) -> Result<Self, NodeError> {
        let node_name = NodeName::new(&args.namespace(), name).map_err(|e| {
            failed(format!("node name {}/{name}", args.namespace()), &e, "use letters, digits and _")
        })?;
        // Without the spinner of ros2-client: see `graph.rs`.
        let node =
            domain.context.new_node(node_name, options).map_err(|e| failed("creating the node", &e, ""))?;
        Ok(Self { node: Arc::new(node), domain: domain.clone(), overrides: Overrides::default() })
    }

    /// Subscribes to a topic by its full name. Best effort, so that any publisher matches.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn subscribe<M: Message>(&mut self, topic: &str) -> Result<Subscription<M>, NodeError> {
        let qos = QosProfile::subscription_default().history(History::KeepLast { depth: DEPTH });
        let qos = self.overrides.applied(&qos, topic, End::Subscription);
        let topic_handle = self.topic::<M>(topic, &qos)?;
        self.own()?
            .create_subscription(&topic_handle, None)
            .map_err(|e| failed(format!("subscribing to {topic}"), &e, ""))
    }

    /// Publishes a topic by its full name. Reliable, so that both kinds of readers match.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn publish<M: Message>(&mut self, topic: &str) -> Result<Output<M>, NodeError> {
        self.publish_with(topic, &output_qos(DEPTH))
    }

    /// Publishes a topic (full name) that has at most about one message per second.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn publish_seldom<M: Message>(&mut self, topic: &str) -> Result<Output<M>, NodeError> {
        self.publish_with(topic, &output_qos(SELDOM_DEPTH))
    }

    /// Publishes a topic (full name) whose messages describe a state: late joiners get the last one.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn publish_state<M: Message>(&mut self, topic: &str) -> Result<Output<M>, NodeError> {
        self.publish_with(topic, &output_qos(1).durability(Durability::TransientLocal))
    }

    /// Publishes a log topic (full name) with the usual QoS of `/rosout`: late joiners get the last lines.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn publish_log(&mut self, topic: &str) -> Result<Output<Log>, NodeError> {
        self.publish_with(topic, &output_qos(LOG_DEPTH).durability(Durability::TransientLocal))
    }

    /// Publishes a recorded run on a topic (full name). Waits for slower readers before it drops a message.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn publish_run<M: Message>(&mut self, topic: &str) -> Result<Output<M>, NodeError> {
        let waits = Reliability::Reliable { when_full: WhenFull::Wait(PLAYER_PATIENCE) };
        self.publish_with(topic, &output_qos(DEPTH).reliability(waits))
    }

    fn publish_with<M: Message>(&mut self, topic: &str, qos: &QosProfile) -> Result<Output<M>, NodeError> {
        let qos = &self.overrides.applied(qos, topic, End::Publisher);
        let dds_topic = self.output_topic::<M>(topic, qos)?;
        let publisher = self
            .own()?
            .create_publisher(&dds_topic, None)
            .map_err(|e| failed(format!("publishing {topic}"), &e, ""))?;
        let written = self.domain.writers.add(publisher.guid(), format!("{TOPIC_PREFIX}{topic}"));
        Ok(Output { publisher, written })
    }

    /// Offers a service by its full name.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn serve<S: Service>(&mut self, service: &str) -> Result<ServerOf<S>, NodeError> {
        let qos = service_qos();
        let name = name_of("service", service)?;
        hardened::announce_service::<S>();
        // The mapping that ROS 2 uses with all middlewares since Foxy.
        self.own()?
            .create_server(
                ServiceMapping::Enhanced,
                &name,
                &ServiceTypeName::new(S::PACKAGE, S::NAME),
                qos.clone(),
                qos,
            )
            .map_err(|e| failed(format!("offering {service}"), &e, ""))
    }

    /// A client of a service by its full name.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn client<S: Service>(&mut self, service: &str) -> Result<ClientOf<S>, NodeError> {
        let qos = service_qos();
        let name = name_of("service", service)?;
        hardened::announce_service::<S>();
        let before = self.endpoints();
        let client = self
            .own()?
            .create_client(
                ServiceMapping::Enhanced,
                &name,
                &ServiceTypeName::new(S::PACKAGE, S::NAME),
                qos.clone(),
                qos,
            )
            .map_err(|e| failed(format!("calling {service}"), &e, ""))?;
        Ok(ClientOf::new(client, self.endpoints_since(&before)))
    }

    /// Offers an action by its full name.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn serve_action<A: Action>(&mut self, action: &str) -> Result<ActionServerOf<A>, NodeError> {
        let [services, feedback, status] = action_qos();
        let qos = ActionServerQosPolicies {
            goal_service: services.clone(),
            result_service: services.clone(),
            cancel_service: services,
            feedback_publisher: feedback,
            status_publisher: status,
        };
        let (name, of_type) = (name_of("action", action)?, ActionTypeName::new(A::PACKAGE, A::NAME));
        self.own()?
            .create_action_server(ServiceMapping::Enhanced, &name, &of_type, qos)
            .map(AsyncActionServer::new)
            .map_err(|e| failed(format!("offering the action {action}"), &e, ""))
    }

    /// A client of an action by its full name.
    ///
    /// # Errors
    /// When the name is invalid or DDS returns an error.
    pub fn action_client<A: Action>(&mut self, action: &str) -> Result<ActionClientOf<A>, NodeError> {
        let [services, feedback, status] = action_qos();
        let qos = ActionClientQosPolicies {
            goal_service: services.clone(),
            result_service: services.clone(),
            cancel_service: services,
            feedback_subscription: feedback,
            status_subscription: status,
        };
        let (name, of_type) = (name_of("action", action)?, ActionTypeName::new(A::PACKAGE, A::NAME));
        let before = self.endpoints();
        let client = self
            .own()?
            .create_action_client(ServiceMapping::Enhanced, &name, &of_type, qos)
            .map_err(|e| failed(format!("calling the action {action}"), &e, ""))?;
        Ok(ActionClientOf::new(client, self.endpoints_since(&before)))
    }

    /// The node's endpoints at present.
    fn endpoints(&self) -> Endpoints {
        endpoints_of(&self.domain.context, &self.node.fully_qualified_name())
    }

    fn endpoints_since(&self, before: &Endpoints) -> Endpoints {
        let Endpoints { writers, readers } = self.endpoints();
        Endpoints {
            writers: writers.difference(&before.writers).copied().collect(),
            readers: readers.difference(&before.readers).copied().collect(),
        }
    }

    /// The node, to create entities on it.
    fn own(&mut self) -> Result<&mut Node, NodeError> {
        Arc::get_mut(&mut self.node).ok_or_else(|| NodeError::Ros {
            what: "creating something on the node".to_owned(),
            why: "the node is already shared with a thread; create it before that".to_owned(),
        })
    }

    fn topic<M: Message>(&self, topic: &str, qos: &QosProfile) -> Result<rustdds::Topic, NodeError> {
        let name = name_of("topic", topic)?;
        self.node
            .create_topic(&name, MessageTypeName::new(M::PACKAGE, M::NAME), qos)
            .map_err(|e| failed(format!("creating topic {topic}"), &e, ""))
    }

    /// The topic of an output. It is created directly, because the client library has no resource limits and a writer
    /// inherits its topic's.
    fn output_topic<M: Message>(&self, topic: &str, qos: &QosProfile) -> Result<rustdds::Topic, NodeError> {
        name_of("topic", topic)?;
        let limits = policy::ResourceLimits {
            max_samples: WINDOW,
            max_instances: 1,
            max_samples_per_instance: WINDOW,
        };
        let limited = QosPolicies::qos_none()
            .modify_by(&QosPolicies::from(qos))
            .modify_by(&rustdds::QosPolicyBuilder::new().resource_limits(limits).build());
        let type_name = MessageTypeName::new(M::PACKAGE, M::NAME).dds_msg_type();
        self.domain
            .context
            .domain_participant()
            .create_topic(format!("{TOPIC_PREFIX}{topic}"), type_name, &limited, TopicKind::NoKey)
            .map_err(|e| failed(format!("creating topic {topic}"), &e, ""))
    }

    /// The topics published by other processes that discovery has found so far: full names with DDS types.
    #[must_use]
    pub fn published(&self) -> Vec<(String, String)> {
        let writers = self.domain.context.domain_participant().discovered_writers();
        let of_ros = |topic: &str| topic.strip_prefix("rt/").map(|name| format!("/{name}"));
        let topics = writers.into_iter().map(|writer| writer.publication_topic_data);
        topics.filter_map(|topic| Some((of_ros(&topic.topic_name)?, topic.type_name))).collect()
    }

    /// True if a server of `client` is present, so that a request is not lost. Poll it.
    #[must_use]
    pub fn reaches(&self, client: &impl Reaching) -> bool {
        self.domain.graph.are_matched(client.endpoints())
    }

    /// Number of remote readers that are matched with a publisher of this process.
    #[must_use]
    pub fn readers_of(&self, publisher: GUID) -> usize {
        self.domain.graph.readers_of(publisher)
    }

    /// Number of remote publishers that are matched with a subscription of this process.
    #[must_use]
    pub fn writers_of(&self, subscription: GUID) -> usize {
        self.domain.graph.writers_of(subscription)
    }

    /// The domain, for a thread that must end before [`Ros::stop`].
    #[must_use]
    pub fn domain(&self) -> Domain {
        self.domain.clone()
    }

    /// The node.
    #[must_use]
    pub fn node(&self) -> &Node {
        &self.node
    }

    /// The node, for a thread that must end before [`Ros::stop`]. Nothing can be created on it from then on.
    #[must_use]
    pub fn share(&self) -> Arc<Node> {
        Arc::clone(&self.node)
    }

    /// True while the graph's thread and the threads of the DDS library run.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.domain.graph.is_alive() && self.domain.is_alive()
    }

    /// Returns an error once [`Ros::is_alive`] is false.
    ///
    /// # Errors
    /// [`NodeError::Failed`] with the likely cause.
    pub fn check(&self) -> Result<(), NodeError> {
        if self.is_alive() { Ok(()) } else { Err(NodeError::Failed(format!("{DEAF}. Restart the program"))) }
    }

    /// Leaves the domain. Publishers and subscriptions must have been dropped before.
    pub fn stop(self) {
        let Self { node, domain, .. } = self;
        drop(node);
        drop(domain);
    }
}

/// The name of a topic, service or action.
fn name_of(kind: &str, text: &str) -> Result<Name, NodeError> {
    Name::parse(text).map_err(|e| failed(format!("{kind} name {text}"), &e, "use letters, digits, _ and /"))
}

/// QoS of services, as usual in ROS 2.
fn service_qos() -> QosProfile {
    QosProfile::publisher_default().history(History::KeepLast { depth: SERVICE_DEPTH })
}

/// QoS of an action's services, feedback and status, as usual in ROS 2.
fn action_qos() -> [QosProfile; 3] {
    let status = QosProfile::publisher_default()
        .history(History::KeepLast { depth: 1 })
        .durability(Durability::TransientLocal);
    [service_qos(), service_qos(), status]
}

/// Checks that loopback is up. DDS would otherwise wait for the interface without a message.
fn require_loopback() -> Result<(), NodeError> {
    std::net::UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))
        .and_then(|socket| socket.connect((Ipv4Addr::LOCALHOST, 7400)).and_then(|()| socket.send(&[])))
        .map(drop)
        .or_else(|error| match error.kind() {
            // An ICMP reply "port unreachable": the interface works.
            std::io::ErrorKind::ConnectionRefused => Ok(()),
            _ => Err(error),
        })
        .map_err(|error| NodeError::Ros {
            what: "using the loopback interface".to_owned(),
            why: format!(
                "{error}; bring it up (`ip link set lo up`), or use another with -p discovery_range:=subnet"
            ),
        })
}

fn failed(what: impl Into<String>, error: &dyn std::fmt::Debug, advice: &str) -> NodeError {
    let separator = if advice.is_empty() { "" } else { "; " };
    NodeError::Ros { what: what.into(), why: format!("{error:?}{separator}{advice}") }
}
