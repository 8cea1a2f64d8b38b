//! Discovery of listed hosts, for networks without multicast.
//!
//! The DDS library announces a participant only by multicast, which ends at the first router. Its announcements also
//! arrive on loopback; this thread forwards them unchanged to each listed host. A peer there that receives one answers
//! to the addresses in it, and from then on both communicate without multicast.
//!
//! ```text
//! participant ─→ 239.255.0.1 on loopback ─→ [ros-peers] ─→ each host, the ports of its first participants
//! ```

use crate::settings::error::NodeError;
use mr_damper_base::worker::{Stop, Worker};
use socket2::{Domain, Protocol, Socket, Type};
use std::collections::BTreeSet;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4, ToSocketAddrs, UdpSocket};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tracing::Span;

/// Multicast group of announcements (RTPS 2.5, 9.6.1.4.1).
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// Number of participants per host and domain that are contacted.
const PARTICIPANTS: u16 = 10;
/// Time between attempts to resolve a name.
const AGAIN: Duration = Duration::from_secs(5);
/// Longest time until the thread notices that it has to end.
const LOOK: Duration = Duration::from_millis(100);
/// Length of an RTPS header: `RTPS`, version, vendor, then the prefix of the sender's GUID.
const HEADER: usize = 20;

/// Port of announcements in `domain`; all participants share it.
pub(crate) const fn group_port(domain: u16) -> u16 {
    7400 + 250 * domain
}

/// Port on which participant `index` of a host receives discovery data.
pub(crate) const fn own_port(domain: u16, index: u16) -> u16 {
    7410 + 250 * domain + 2 * index
}

/// The thread that forwards announcements.
#[derive(Debug)]
pub struct ListedPeers {
    /// `Some` until the drop.
    worker: Option<Worker>,
}

impl ListedPeers {
    /// Forwards the announcements of the participant whose GUID begins with `prefix` to `hosts` (names or IPv4
    /// addresses). A name that does not resolve is retried in the background.
    ///
    /// # Errors
    /// When a host is given by an IPv6 address, or the port of announcements cannot be opened.
    pub fn start(hosts: &[String], domain: u16, prefix: &[u8]) -> Result<Self, NodeError> {
        let mut names = Vec::new();
        let mut known = Vec::new();
        for host in hosts {
            match Host::of(host)? {
                Host::Address(address) => known.push(address),
                Host::Name(name) => names.push(name),
            }
        }
        let opening = || format!("listening to announcements on port {}", group_port(domain));
        let socket = open(domain, Ipv4Addr::LOCALHOST).map_err(NodeError::io(opening()))?;
        let sends =
            UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).map_err(NodeError::io("opening a UDP port"))?;
        tracing::info!(?hosts, "announcing this node to the listed hosts");
        let known = Arc::new(Mutex::new(known));
        if !names.is_empty() {
            resolve_all(Names::new(names), &known)?;
        }
        let prefix = prefix.to_vec();
        let worker =
            Worker::start("ros-peers", move |stop| send_on(&socket, &sends, domain, &known, &prefix, stop))
                .map_err(NodeError::io("starting the thread that contacts listed hosts"))?;
        Ok(Self { worker: Some(worker) })
    }
}

impl Drop for ListedPeers {
    fn drop(&mut self) {
        if self.worker.take().is_some_and(|worker| worker.stop().is_err()) {
            tracing::error!("the thread that contacts listed hosts had panicked");
        }
    }
}

/// A host as it is listed.
#[derive(Debug, PartialEq, Eq)]
enum Host {
    Address(Ipv4Addr),
    Name(String),
}

impl Host {
    /// # Errors
    /// When it is an IPv6 address, which the DDS library does not support.
    fn of(host: &str) -> Result<Self, NodeError> {
        match host.parse::<IpAddr>() {
            Ok(IpAddr::V4(address)) => Ok(Self::Address(address)),
            Ok(IpAddr::V6(_)) => Err(NodeError::Parameter {
                name: "discovery_peers (or ROS_STATIC_PEERS)".to_owned(),
                value: format!("{host:?}"),
                expected: "IPv4 addresses or names of hosts, because the DDS library supports IPv4 only"
                    .to_owned(),
            }),
            Err(_) => Ok(Self::Name(host.to_owned())),
        }
    }
}

/// Names of hosts that have not resolved yet.
#[derive(Debug)]
struct Names {
    missing: Vec<String>,
    /// Names whose first failure was logged.
    logged: BTreeSet<String>,
}

impl Names {
    fn new(missing: Vec<String>) -> Self {
        Self { missing, logged: BTreeSet::new() }
    }

    /// Tries each name once and returns the new addresses. Logs the first failure of a name, and its later success.
    fn look_up(&mut self, resolve: impl Fn(&str) -> Result<Ipv4Addr, ResolveError>) -> Vec<Ipv4Addr> {
        let mut found = Vec::new();
        let logged = &mut self.logged;
        self.missing.retain(|host| match resolve(host) {
            Ok(address) => {
                if logged.contains(host) {
                    tracing::info!(host, %address, "the name of a listed host now resolves; this node announces itself there");
                }
                found.push(address);
                false
            }
            Err(why) => {
                if logged.insert(host.clone()) {
                    tracing::warn!(
                        "the listed host {host} does not resolve ({why}), so this node does not announce itself there; the name is tried again every {} s. \
                         Check the name in discovery_peers or ROS_STATIC_PEERS",
                        AGAIN.as_secs()
                    );
                }
                true
            }
        });
        found
    }
}

/// Resolves the names on a separate thread, until all are known or the receiver is dropped. The system's resolver can
/// take half a minute and cannot be interrupted, so nothing waits for that thread.
fn resolve_all(mut names: Names, known: &Arc<Mutex<Vec<Ipv4Addr>>>) -> Result<(), NodeError> {
    let known = Arc::downgrade(known);
    let span = Span::current();
    let looking = move || {
        let _inside = span.entered();
        loop {
            let found = names.look_up(resolve);
            let Some(known) = known.upgrade() else { return };
            known.lock().unwrap_or_else(PoisonError::into_inner).extend(found);
            drop(known);
            if names.missing.is_empty() {
                return;
            }
            std::thread::sleep(AGAIN);
        }
    };
    let thread = std::thread::Builder::new().name("ros-peer-names".to_owned()).spawn(looking);
    thread.map(drop).map_err(NodeError::io("starting the thread that resolves the names of listed hosts"))
}

/// Reasons why the name of a host gives no address.
#[derive(Debug, thiserror::Error)]
enum ResolveError {
    #[error(transparent)]
    System(#[from] io::Error),
    #[error("it has no IPv4 address")]
    NoIpv4,
}

/// The first IPv4 address of `host`.
fn resolve(host: &str) -> Result<Ipv4Addr, ResolveError> {
    let mut found = (host, 0).to_socket_addrs()?;
    let found = found.find_map(|address| match address {
        SocketAddr::V4(address) => Some(*address.ip()),
        SocketAddr::V6(_) => None,
    });
    found.ok_or(ResolveError::NoIpv4)
}

/// Opens the port of announcements on `interface`, shared with all other processes that have it open.
///
/// # Errors
/// When the port cannot be opened, or the interface does not support multicast.
pub(crate) fn open(domain: u16, interface: Ipv4Addr) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_reuse_address(true)?;
    socket.bind(&SocketAddrV4::new(GROUP, group_port(domain)).into())?;
    socket.join_multicast_v4(&GROUP, &interface)?;
    socket.set_read_timeout(Some(LOOK))?;
    Ok(socket.into())
}

fn send_on(
    socket: &UdpSocket,
    sends: &UdpSocket,
    domain: u16,
    known: &Mutex<Vec<Ipv4Addr>>,
    prefix: &[u8],
    stop: &Stop,
) {
    let mut packet = vec![0; 65_536];
    while !stop.is_raised() {
        // An error means that the read timed out.
        let Ok(length) = socket.recv(&mut packet) else { continue };
        if !is_of(&packet[..length], prefix) {
            continue;
        }
        let hosts = known.lock().unwrap_or_else(PoisonError::into_inner).clone();
        for (address, index) in hosts.iter().flat_map(|address| (0..PARTICIPANTS).map(move |i| (address, i)))
        {
            let host = SocketAddrV4::new(*address, own_port(domain, index));
            // A host that is down gets the next announcement.
            if let Err(error) = sends.send_to(&packet[..length], host) {
                tracing::debug!(%host, %error, "cannot send to a listed host");
            }
        }
    }
}

/// True when an RTPS packet comes from the participant with `prefix`.
fn is_of(packet: &[u8], prefix: &[u8]) -> bool {
    prefix_of(packet) == Some(prefix)
}

/// GUID prefix of the participant that sent an RTPS packet.
pub(crate) fn prefix_of(packet: &[u8]) -> Option<&[u8]> {
    packet.get(..HEADER).filter(|header| header.starts_with(b"RTPS")).map(|header| &header[8..])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_are_those_of_the_standard() {
        assert_eq!((group_port(0), own_port(0, 0), own_port(0, 3)), (7400, 7410, 7416));
        assert_eq!((group_port(42), own_port(42, 1)), (17_900, 17_912));
    }

    #[test]
    fn only_the_participants_own_packets_are_forwarded() {
        let prefix = [7; 12];
        let mut packet = b"RTPS\x02\x04\x01\x12".to_vec();
        packet.extend(prefix);
        assert!(is_of(&packet, &prefix));
        assert!(!is_of(&packet, &[8; 12]) && !is_of(&packet[..19], &prefix) && !is_of(&[], &prefix));
        packet[0] = b'X';
        assert!(!is_of(&packet, &prefix));
    }

    #[test]
    fn a_name_that_does_not_resolve_is_tried_again() {
        let mut names = Names::new(vec!["here".to_owned(), "later".to_owned()]);
        let (here, later) = (Ipv4Addr::new(10, 0, 0, 1), Ipv4Addr::new(10, 0, 0, 2));
        let not_yet = |host: &str| if host == "here" { Ok(here) } else { Err(ResolveError::NoIpv4) };
        assert_eq!(names.look_up(not_yet), [here]);
        assert_eq!((names.look_up(not_yet), names.logged.len()), (vec![], 1));
        assert_eq!(names.look_up(|_| Ok(later)), [later]);
        assert!(names.missing.is_empty());
    }

    #[test]
    fn an_unknown_name_does_not_end_the_node() {
        let hosts = ["no-such-host.invalid", "127.0.0.1"].map(str::to_owned);
        // A domain that no other test uses.
        ListedPeers::start(&hosts, 117, &[7; 12]).expect("it starts");
        assert!(resolve("no-such-host.invalid").is_err());
        assert_eq!(resolve("localhost").ok(), Some(Ipv4Addr::LOCALHOST));
        let message = ListedPeers::start(&["::1".to_owned()], 117, &[7; 12]).expect_err("IPv6").to_string();
        assert!(message.contains("discovery_peers") && message.contains("\"::1\""), "{message}");
    }
}
