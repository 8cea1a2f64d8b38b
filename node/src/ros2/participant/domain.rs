//! The domain that this process has joined, and which one that is.

use super::{TOPIC_PREFIX, failed};
use crate::process::hardened;
use crate::ros2::answer_limit::AnswerLimit;
use crate::ros2::dds_threads::DdsThreads;
use crate::ros2::first_requests::FirstRequests;
use crate::ros2::graph::{Graph, Writer};
use crate::ros2::lagging_readers::{LaggingReaders, Writers};
use crate::ros2::listed_peers::ListedPeers;
use crate::ros2::participant_ports::with_both_ports;
use crate::ros2::ros_environment::{self, NetworkRequest, Reach, Remark};
use crate::ros2::security::Enclave;
use crate::settings::config::Config;
use crate::settings::error::NodeError;
use mr_damper_base::realtime::{self, Request, Scheduling};
use ros2_client::Context;
use rustdds::{DomainParticipantBuilder, RTPSEntity};
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;

/// Size of the socket's send buffer, bytes; the system limits it to `net.core.wmem_max`. One socket serves all readers.
/// While Linux resolves the address of a host, it holds up to 208 KiB for that host (`unres_qlen_bytes`). This equals a
/// socket's default buffer, so one absent host would block all others for seconds.
const SEND_BUFFER: usize = 1 << 20;

/// The largest domain: ports of a larger one would exceed the port range.
const LAST_DOMAIN: u16 = 232;

/// The ROS domain that this process has joined, with one participant for all its nodes.
#[derive(Clone)]
pub struct Domain {
    /// First field, so that its thread releases the participant before the context is dropped.
    _lagging: Option<Arc<LaggingReaders>>,
    pub(super) writers: Writers,
    /// Before the context, so that its reader is dropped before the participant.
    pub(super) graph: Arc<Graph>,
    pub(super) context: Context,
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
        Self::join_raised(config, enclave, Request::Ordinary).map(|(domain, _)| domain)
    }

    /// Like [`Domain::join`], with the threads of the DDS library at a real-time `priority`. Also returns the
    /// resulting scheduling.
    ///
    /// # Errors
    /// The same as for [`Domain::join`].
    pub fn join_raised(
        config: &Config,
        enclave: Option<&str>,
        priority: Request,
    ) -> Result<(Self, Scheduling), NodeError> {
        let announced = crate::ros2::security::name_of_enclave(enclave);
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

/// A text is not a ROS domain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a ROS domain is a whole number from 0 to {}", LAST_DOMAIN)]
pub struct NotADomain;

/// Parses the domain of a flag; -1 selects the environment's domain.
///
/// # Errors
/// [`NotADomain`].
pub fn domain_flag(text: &str) -> Result<i64, NotADomain> {
    text.parse().ok().filter(|id| (-1..=i64::from(LAST_DOMAIN)).contains(id)).ok_or(NotADomain)
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
