//! The ROS 2 side of the process: participant, node, graph, and their shutdown.
//!
//! The client library ignores `ROS_DOMAIN_ID` and the localhost settings, so the participant is built here.
//!
//! At the end of the process, the order of dropping matters: publishers and subscriptions, the node, the graph's thread
//! (which is joined), then the context. Only in this order are peers informed at once; otherwise they list the node for
//! another half minute.

mod domain;

pub use domain::{Domain, NotADomain, domain_flag, domain_id, is_loopback_only, listed_peers, reach};

use crate::process::hardened;
use crate::ros2::client::{Reaching, endpoints_of};
use crate::ros2::graph::Endpoints;
use crate::ros2::lagging_readers::{LocalWriter, WINDOW};
use crate::settings::config::qos::{End, Overrides};
use crate::settings::config::{Config, RosArgs};
use crate::settings::error::{NodeError, PartError};
use mr_damper_msgs::rcl::Log;
use mr_damper_msgs::{Action, Message, Service};
use ros2_client::action::{
    ActionClientQosPolicies, ActionServerQosPolicies, AsyncActionServer, ExecutingGoalHandle, NewGoalHandle,
};
use ros2_client::qos::{Durability, History, QosProfile, Reliability, WhenFull};
use ros2_client::service::Server;
use ros2_client::{
    ActionTypeName, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, ServiceMapping,
    ServiceTypeName, Subscription,
};
use rustdds::{GUID, QosPolicies, TopicKind, policy};
use std::sync::Arc;
use std::time::Duration;

/// Depth of every topic's history: one second at 1 kHz. Peers do not see it. A writer drops the samples that the
/// middleware's thread has not sent when the history is full; the usual depth of 10 lost samples on a busy machine. A
/// reader keeps the samples that the source thread has not taken.
const DEPTH: usize = 1024;

/// How long a program that plays a run waits for readers that are slower.
const PLAYER_PATIENCE: Duration = Duration::from_millis(100);

/// Depth of topics with at most about one message per second. Kept messages stay in memory: thousands of long texts
/// would make the node grow for a quarter of an hour.
const SELDOM_DEPTH: usize = 64;

/// Requests and responses that a service keeps, as usual in ROS 2.
const SERVICE_DEPTH: usize = 10;

/// Log lines that late joiners get. Other nodes have 1000; fewer are kept here because they stay in memory.
const LOG_DEPTH: usize = 100;

/// A thread of the DDS library has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "a thread of the DDS library has ended, so nothing is received or sent any more; this happens when a process is stopped and \
     continued (Ctrl-Z and fg, SIGSTOP, a debugger). Restart the program"
)]
pub struct DdsThreadEnded;

impl PartError for DdsThreadEnded {}

/// The server of a service.
pub type ServerOf<S> = Server<RosMessage<<S as Service>::Request>, RosMessage<<S as Service>::Response>>;

pub use crate::ros2::client::{ActionClientOf, ClientOf, RosMessage};

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
    /// [`DdsThreadEnded`].
    pub fn check(&self) -> Result<(), DdsThreadEnded> {
        if self.is_alive() { Ok(()) } else { Err(DdsThreadEnded) }
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

fn failed(what: impl Into<String>, error: &dyn std::fmt::Display, advice: &str) -> NodeError {
    let separator = if advice.is_empty() { "" } else { "; " };
    NodeError::Ros { what: what.into(), why: format!("{error}{separator}{advice}") }
}
