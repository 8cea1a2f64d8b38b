//! The ROS 2 side of the process: participant, node, spinner, and their orderly end.
//!
//! The client library ignores `ROS_DOMAIN_ID` and the localhost settings, so the participant is built here.
//! When the process ends, everything is dropped in the one order that tells peers at once (publishers and
//! subscriptions, node, spinner awaited, context); otherwise they list the node for half a minute.

use crate::config::{Config, RosArgs};
use crate::dds_threads::DdsThreads;
use crate::error::NodeError;
use crate::listed_peers::ListedPeers;
use crate::security::Enclave;
use futures::FutureExt;
use futures::channel::oneshot;
use mr_damper_msgs::rcl::Log;
use mr_damper_msgs::{Action, Message, Service};
use ros2_client::action::{
    ActionClient, ActionClientQosPolicies, ActionServerQosPolicies, AsyncActionServer, ExecutingGoalHandle,
    NewGoalHandle,
};
use ros2_client::qos::{Durability, History, QosProfile};
use ros2_client::service::{Client, Server};
use ros2_client::{
    ActionTypeName, Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, ServiceMapping,
    ServiceTypeName, Subscription,
};
use rustdds::{DomainParticipantBuilder, RTPSEntity};
use serde::{Deserialize, Serialize};
use std::net::{IpAddr, Ipv4Addr};
use std::pin::pin;
use std::sync::{Arc, mpsc};
use std::task::Poll;
use std::thread::JoinHandle;
use tracing::Span;

/// Depth of every topic's history, one second at 1 kHz. It never shows to a peer. A writer drops what its middleware's
/// thread has not sent when the history is full, and a usual depth of 10 lost samples on a busy machine; a reader
/// keeps in it what the source thread has not taken.
const DEPTH: usize = 1024;

/// Depth of the topics on which something is said once a second or less: what is kept of these stays in memory, and long texts
/// kept by the thousand make the node grow for a quarter of an hour.
const SELDOM_DEPTH: usize = 64;

/// Requests and answers that a service keeps, as everywhere in ROS 2.
const SERVICE_DEPTH: usize = 10;

/// Lines of the log that late readers get, fewer than the 1000 of other nodes: they stay in memory.
const LOG_DEPTH: usize = 100;

/// What is said when the DDS library's threads have ended.
pub const DEAF: &str = "a thread of the DDS library has ended, and nothing comes or goes any more; that happens when a process is \
     stopped and goes on (Ctrl-Z and fg, SIGSTOP, a debugger)";

/// A part of a service, as the client library wants it.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Part<M>(pub M);

impl<M: Message> ros2_client::Message for Part<M> {}

/// The server of a service.
pub type ServerOf<S> = Server<Part<<S as Service>::Request>, Part<<S as Service>::Response>>;

/// A client of a service.
pub type ClientOf<S> = Client<Part<<S as Service>::Request>, Part<<S as Service>::Response>>;

/// The server of an action.
pub type ActionServerOf<A> =
    AsyncActionServer<Part<<A as Action>::Goal>, Part<<A as Action>::Result>, Part<<A as Action>::Feedback>>;

/// A client of an action.
pub type ActionClientOf<A> =
    ActionClient<Part<<A as Action>::Goal>, Part<<A as Action>::Result>, Part<<A as Action>::Feedback>>;

/// A goal of an action that was neither accepted nor rejected.
pub type NewGoalOf<A> = NewGoalHandle<Part<<A as Action>::Goal>>;

/// A goal of an action that is worked on.
pub type ExecutingOf<A> = ExecutingGoalHandle<Part<<A as Action>::Goal>>;

/// The domain as this process has joined it: one participant, whatever the number of its nodes.
#[derive(Clone)]
pub struct Domain {
    context: Context,
    threads: Arc<DdsThreads>,
    /// Tells listed hosts of this process, as long as it is in the domain.
    _listed: Option<Arc<ListedPeers>>,
}

impl Domain {
    /// Joins the domain that `config` asks for; with DDS-Security where the environment or `enclave` ask for it.
    ///
    /// # Errors
    /// When the participant cannot be created (no network interface, no free ports), or security that is asked for cannot
    /// be had.
    pub fn join(config: &Config, enclave: Option<&str>) -> Result<Self, NodeError> {
        let enclave = Enclave::asked_for(enclave)?;
        let domain = domain_id(config)?;
        if config.discovery_range == "localhost" && !config.discovery_peers.is_empty() {
            return Err(NodeError::Usage(
                "discovery_peers are on other hosts, and discovery_range is localhost: leave one of them out"
                    .to_owned(),
            ));
        }
        let mut builder = DomainParticipantBuilder::new(domain);
        if is_loopback_only(config) {
            require_loopback()?;
            builder = builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        let mut advice = "see that a network interface is up and UDP ports from 7400 are free".to_owned();
        if let Some(enclave) = &enclave {
            builder = enclave.secure(builder)?;
            let directory = enclave.directory().display();
            advice +=
                &format!(", and that the files in {directory} are signed, valid and for domain {domain}");
            tracing::info!(enclave = %directory, "DDS-Security is on");
        }
        let (built, threads) = DdsThreads::of(|| builder.build());
        let participant = built.map_err(|e| failed(format!("joining domain {domain}"), &e, &advice))?;
        let peers = listed_peers(config);
        let listed = match peers.is_empty() {
            true => None,
            false => Some(ListedPeers::start(&peers, domain, participant.guid().prefix.as_ref())?),
        };
        let context = Context::from_domain_participant(participant)
            .map_err(|e| failed("creating the ROS context", &e, ""))?;
        Ok(Self { context, threads: Arc::new(threads), _listed: listed.map(Arc::new) })
    }

    /// False once a thread of the DDS library has ended: then nothing comes or goes any more.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.threads.are_alive()
    }

    /// How many publishers of a topic (its full name) there are in other processes, as far as discovery has seen them.
    #[must_use]
    pub fn other_publishers(&self, topic: &str) -> usize {
        let participant = self.context.domain_participant();
        let (own, dds_name) = (participant.guid().prefix, format!("rt{topic}"));
        let writers = participant.discovered_writers();
        let others = writers.iter().filter(|writer| writer.writer_proxy.remote_writer_guid.prefix != own);
        others.filter(|writer| writer.publication_topic_data.topic_name == dds_name).count()
    }
}

/// A ROS 2 node of this process.
pub struct Ros {
    node: Arc<Node>,
    domain: Domain,
    spinner: JoinHandle<()>,
}

/// The domain that `config` and the environment ask for.
///
/// # Errors
/// When `ROS_DOMAIN_ID` is no number from 0 to 232.
pub fn domain_id(config: &Config) -> Result<u16, NodeError> {
    if let Ok(id) = u16::try_from(config.domain_id) {
        return Ok(id);
    }
    match std::env::var("ROS_DOMAIN_ID") {
        Ok(text) if !text.is_empty() => {
            text.parse().ok().filter(|id| *id <= 232).ok_or_else(|| NodeError::Parameter {
                name: "ROS_DOMAIN_ID (environment)".to_owned(),
                value: format!("\"{text}\""),
                expected: "a whole number from 0 to 232".to_owned(),
            })
        }
        _ => Ok(0),
    }
}

/// The hosts that are told of this process though no multicast reaches them: by parameter, or by ROS' environment.
#[must_use]
pub fn listed_peers(config: &Config) -> Vec<String> {
    if config.discovery_range == "localhost" {
        return Vec::new();
    }
    if !config.discovery_peers.is_empty() {
        return config.discovery_peers.clone();
    }
    let text = std::env::var("ROS_STATIC_PEERS").unwrap_or_default();
    text.split(';').map(str::trim).filter(|host| !host.is_empty()).map(str::to_owned).collect()
}

/// True when only this machine may find the node: by parameter, by ROS' environment, and by default. Hosts that are listed may.
#[must_use]
pub fn is_loopback_only(config: &Config) -> bool {
    match config.discovery_range.as_str() {
        "localhost" => true,
        "subnet" => false,
        _ if !listed_peers(config).is_empty() => false,
        _ => {
            let range = std::env::var("ROS_AUTOMATIC_DISCOVERY_RANGE").unwrap_or_default();
            let localhost_only = std::env::var("ROS_LOCALHOST_ONLY").unwrap_or_default();
            if localhost_only == "1" { true } else { !range.eq_ignore_ascii_case("SUBNET") }
        }
    }
}

impl Ros {
    /// Joins the domain and creates the node called `name`.
    ///
    /// # Errors
    /// Those of [`Domain::join`] and [`Ros::start_in`].
    pub fn start(
        config: &Config,
        args: &RosArgs,
        options: NodeOptions,
        name: &str,
    ) -> Result<Self, NodeError> {
        Self::start_in(&Domain::join(config, args.enclave.as_deref())?, args, options, name)
    }

    /// Creates the node called `name` in a domain that was joined.
    ///
    /// # Errors
    /// When the name is bad, or the system gives no thread.
    pub fn start_in(
        domain: &Domain,
        args: &RosArgs,
        options: NodeOptions,
        name: &str,
    ) -> Result<Self, NodeError> {
        let node_name = NodeName::new(&args.namespace(), name).map_err(|e| {
            failed(format!("node name {}/{name}", args.namespace()), &e, "use letters, digits and _")
        })?;
        let mut node =
            domain.context.new_node(node_name, options).map_err(|e| failed("creating the node", &e, ""))?;
        let spinner = node.spinner().map_err(|e| failed("creating the node's spinner", &e, ""))?;
        let (begun, begins) = mpsc::channel();
        let spinner = run_async("ros-spinner", async move {
            let mut spinning = pin!(spinner.spin());
            let ended = match futures::poll!(spinning.as_mut()) {
                Poll::Ready(ended) => ended,
                Poll::Pending => {
                    let _ = begun.send(());
                    spinning.await
                }
            };
            if let Err(error) = ended {
                tracing::error!(
                    ?error,
                    "the ROS node's background work ended: parameters are out of service"
                );
            }
        })?;
        // The spinner subscribes when it is first polled. With DDS-Security, RustDDS 0.15 locks up for good when two threads
        // create something at a time: one holds the participant and waits for the plugins, the other the reverse.
        // An error here is a spinner that ended, which it has said.
        let _ = begins.recv();
        Ok(Self { node: Arc::new(node), domain: domain.clone(), spinner })
    }

    /// Subscribes to a topic by its full name: best effort, so that any publisher matches.
    ///
    /// # Errors
    /// When the name is bad or DDS refuses.
    pub fn subscribe<M: Message>(&mut self, topic: &str) -> Result<Subscription<M>, NodeError> {
        let qos = QosProfile::subscription_default().history(History::KeepLast { depth: DEPTH });
        let topic_handle = self.topic::<M>(topic, &qos)?;
        self.own()?
            .create_subscription(&topic_handle, None)
            .map_err(|e| failed(format!("subscribing to {topic}"), &e, ""))
    }

    /// Publishes on a topic by its full name: reliable, so that either kind of reader matches.
    ///
    /// # Errors
    /// When the name is bad or DDS refuses.
    pub fn publish<M: Message>(&mut self, topic: &str) -> Result<Publisher<M>, NodeError> {
        self.publish_with(topic, &QosProfile::publisher_default().history(History::KeepLast { depth: DEPTH }))
    }

    /// Publishes what is said once a second or less, by the topic's full name.
    ///
    /// # Errors
    /// When the name is bad or DDS refuses.
    pub fn publish_seldom<M: Message>(&mut self, topic: &str) -> Result<Publisher<M>, NodeError> {
        let history = History::KeepLast { depth: SELDOM_DEPTH };
        self.publish_with(topic, &QosProfile::publisher_default().history(history))
    }

    /// Publishes a log by its full name, as `/rosout` is everywhere: who comes late hears the last lines.
    ///
    /// # Errors
    /// When the name is bad or DDS refuses.
    pub fn publish_log(&mut self, topic: &str) -> Result<Publisher<Log>, NodeError> {
        let qos = QosProfile::publisher_default()
            .history(History::KeepLast { depth: LOG_DEPTH })
            .durability(Durability::TransientLocal);
        self.publish_with(topic, &qos)
    }

    fn publish_with<M: Message>(&mut self, topic: &str, qos: &QosProfile) -> Result<Publisher<M>, NodeError> {
        let topic_handle = self.topic::<M>(topic, qos)?;
        self.own()?
            .create_publisher(&topic_handle, None)
            .map_err(|e| failed(format!("publishing {topic}"), &e, ""))
    }

    /// Offers a service by its full name.
    ///
    /// # Errors
    /// When the name is bad or DDS refuses.
    pub fn serve<S: Service>(&mut self, service: &str) -> Result<ServerOf<S>, NodeError> {
        let qos = service_qos();
        let name = name_of("service", service)?;
        // What ROS 2 has used with all its middleware since Foxy.
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
    /// When the name is bad or DDS refuses.
    pub fn client<S: Service>(&mut self, service: &str) -> Result<ClientOf<S>, NodeError> {
        let qos = service_qos();
        let name = name_of("service", service)?;
        self.own()?
            .create_client(
                ServiceMapping::Enhanced,
                &name,
                &ServiceTypeName::new(S::PACKAGE, S::NAME),
                qos.clone(),
                qos,
            )
            .map_err(|e| failed(format!("calling {service}"), &e, ""))
    }

    /// Offers an action by its full name.
    ///
    /// # Errors
    /// When the name is bad or DDS refuses.
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
    /// When the name is bad or DDS refuses.
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
        self.own()?
            .create_action_client(ServiceMapping::Enhanced, &name, &of_type, qos)
            .map_err(|e| failed(format!("calling the action {action}"), &e, ""))
    }

    /// The node, for what creates something on it.
    fn own(&mut self) -> Result<&mut Node, NodeError> {
        Arc::get_mut(&mut self.node).ok_or_else(|| NodeError::Ros {
            what: "creating something on the node".to_owned(),
            why: "it is shared with a thread already; create it before that".to_owned(),
        })
    }

    fn topic<M: Message>(&self, topic: &str, qos: &QosProfile) -> Result<rustdds::Topic, NodeError> {
        let name = name_of("topic", topic)?;
        self.node
            .create_topic(&name, MessageTypeName::new(M::PACKAGE, M::NAME), qos)
            .map_err(|e| failed(format!("creating topic {topic}"), &e, ""))
    }

    /// The topics that others publish, as far as discovery has seen them: full names with their DDS types.
    #[must_use]
    pub fn published(&self) -> Vec<(String, String)> {
        let writers = self.domain.context.domain_participant().discovered_writers();
        let of_ros = |topic: &str| topic.strip_prefix("rt/").map(|name| format!("/{name}"));
        let topics = writers.into_iter().map(|writer| writer.publication_topic_data);
        topics.filter_map(|topic| Some((of_ros(&topic.topic_name)?, topic.type_name))).collect()
    }

    /// Whether a server of `client` is there now, so that a request is not lost.
    ///
    /// To be asked again and again: ros2-client 0.12's future for the same is woken through a channel of eight events, and
    /// where discovery brings more at a time it may wait for ever. Polled once, it looks at what is matched.
    #[must_use]
    pub fn reaches<Q, R>(&self, client: &Client<Q, R>) -> bool
    where
        Q: ros2_client::Message + 'static,
        R: ros2_client::Message + 'static,
    {
        client.wait_for_service(&self.node).now_or_never().is_some()
    }

    /// The domain, for a thread that has to end before [`Ros::stop`].
    #[must_use]
    pub fn domain(&self) -> Domain {
        self.domain.clone()
    }

    /// The node.
    #[must_use]
    pub fn node(&self) -> &Node {
        &self.node
    }

    /// The node, for a thread that has to end before [`Ros::stop`]. Nothing can be created on it from then on.
    #[must_use]
    pub fn share(&self) -> Arc<Node> {
        Arc::clone(&self.node)
    }

    /// True while the node's background thread and those of the DDS library run.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        !self.spinner.is_finished() && self.domain.is_alive()
    }

    /// An error once [`Ros::is_alive`] is not.
    ///
    /// # Errors
    /// [`NodeError::Failed`], with what may have been the cause.
    pub fn check(&self) -> Result<(), NodeError> {
        if self.is_alive() { Ok(()) } else { Err(NodeError::Failed(format!("{DEAF}. Start again"))) }
    }

    /// Leaves the domain. Publishers and subscriptions must be dropped by now.
    pub fn stop(self) {
        let Self { node, domain, spinner } = self;
        // Dropping the node is what stops its spinner.
        drop(node);
        if spinner.join().is_err() {
            tracing::error!("the ROS node's background thread had panicked");
        }
        drop(domain);
    }
}

/// The name of a topic, service or action.
fn name_of(kind: &str, text: &str) -> Result<Name, NodeError> {
    Name::parse(text).map_err(|e| failed(format!("{kind} name {text}"), &e, "use letters, digits, _ and /"))
}

/// QoS of services, as everywhere in ROS 2.
fn service_qos() -> QosProfile {
    QosProfile::publisher_default().history(History::KeepLast { depth: SERVICE_DEPTH })
}

/// QoS of an action's services, feedback and status, likewise.
fn action_qos() -> [QosProfile; 3] {
    let status = QosProfile::publisher_default()
        .history(History::KeepLast { depth: 1 })
        .durability(Durability::TransientLocal);
    [service_qos(), service_qos(), status]
}

/// A task on a thread of its own, which ends when it is told to.
pub struct Task {
    stop: oneshot::Sender<()>,
    thread: JoinHandle<()>,
}

impl Task {
    /// Starts the task that `task` makes of the word to stop, on a thread called `name`.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start<F>(
        name: &'static str,
        task: impl FnOnce(oneshot::Receiver<()>) -> F,
    ) -> Result<Self, NodeError>
    where
        F: Future<Output = ()> + Send + 'static,
    {
        let (stop, stopped) = oneshot::channel();
        Ok(Self { stop, thread: run_async(name, task(stopped))? })
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        !self.thread.is_finished()
    }

    /// Tells the task to end, and waits until it has. `Err` when it had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        // A thread that has panicked does not listen any more.
        let _ = self.stop.send(());
        self.thread.join()
    }
}

/// Runs `task` to its end on a thread of its own called `name`.
///
/// # Errors
/// When the system gives no thread.
fn run_async(
    name: &'static str,
    task: impl Future<Output = ()> + Send + 'static,
) -> Result<JoinHandle<()>, NodeError> {
    let starting = format!("starting the thread {name}");
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_time()
        .build()
        .map_err(NodeError::io(starting.as_str()))?;
    std::thread::Builder::new()
        .name(name.to_owned())
        .spawn({
            let span = Span::current();
            move || {
                // What it logs is its damper's.
                let _inside = span.entered();
                runtime.block_on(task);
            }
        })
        .map_err(NodeError::io(starting.as_str()))
}

/// Loopback must be up before DDS is asked to use it alone, or it would wait in silence for an interface.
fn require_loopback() -> Result<(), NodeError> {
    std::net::UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))
        .and_then(|socket| socket.connect((Ipv4Addr::LOCALHOST, 7400)).and_then(|()| socket.send(&[])))
        .map(drop)
        .or_else(|error| match error.kind() {
            // An ICMP answer that nobody listens there: the interface works.
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
