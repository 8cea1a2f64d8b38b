//! Discovery of hosts by a list, where the network carries no multicast.
//!
//! The DDS library announces a participant by multicast alone, which ends at the first router. Its announcements also come back to
//! this machine; here they are sent on, as they are, to each host of the list. A peer there that hears one answers to the addresses in
//! it, and from then on both talk to each other without any multicast.
//!
//! ```text
//! participant ─→ 239.255.0.1 on loopback ─→ [ros-peers] ─→ each host, the ports of its first participants
//! ```

use crate::error::NodeError;
use crate::worker::{Stop, Worker};
use socket2::{Domain, Protocol, Socket, Type};
use std::collections::BTreeSet;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4, ToSocketAddrs, UdpSocket};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tracing::Span;

/// Where every participant announces itself (RTPS 2.5, 9.6.1.4.1).
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// Participants of a host and domain that are told.
const PARTICIPANTS: u16 = 10;
/// How often a name that does not resolve is tried again.
const AGAIN: Duration = Duration::from_secs(5);
/// How often the thread looks whether it has to end.
const LOOK: Duration = Duration::from_millis(100);
/// Bytes of an RTPS header: `RTPS`, version, vendor, then the prefix of the sender's GUID.
const HEADER: usize = 20;

/// Port of announcements in `domain`: all participants share it.
pub(crate) const fn group_port(domain: u16) -> u16 {
    7400 + 250 * domain
}

/// Port on which participant `index` of a host hears of others.
pub(crate) const fn own_port(domain: u16, index: u16) -> u16 {
    7410 + 250 * domain + 2 * index
}

/// The thread that sends announcements on.
#[derive(Debug)]
pub struct ListedPeers {
    /// There is one until the drop.
    worker: Option<Worker>,
}

impl ListedPeers {
    /// Sends the announcements of the participant whose GUID begins with `prefix` on to `hosts` (names or IPv4 addresses). A name that
    /// does not resolve yet is tried again in the background.
    ///
    /// # Errors
    /// When a host can have no IPv4 address, or the port of announcements cannot be opened.
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
        let heard = open(domain, Ipv4Addr::LOCALHOST).map_err(NodeError::io(opening()))?;
        let sends =
            UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).map_err(NodeError::io("opening a UDP port"))?;
        tracing::info!(?hosts, "listed hosts are told of this node");
        let known = Arc::new(Mutex::new(known));
        if !names.is_empty() {
            resolve_all(Names::new(names), &known)?;
        }
        let prefix = prefix.to_vec();
        let worker =
            Worker::start("ros-peers", move |stop| send_on(&heard, &sends, domain, &known, &prefix, stop))
                .map_err(NodeError::io("starting the thread that tells listed hosts"))?;
        Ok(Self { worker: Some(worker) })
    }
}

impl Drop for ListedPeers {
    fn drop(&mut self) {
        if self.worker.take().is_some_and(|worker| worker.stop().is_err()) {
            tracing::error!("the thread that tells listed hosts had panicked");
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
    /// When it is an address, and none of IPv4: the DDS library speaks no other.
    fn of(host: &str) -> Result<Self, NodeError> {
        match host.parse::<IpAddr>() {
            Ok(IpAddr::V4(address)) => Ok(Self::Address(address)),
            Ok(IpAddr::V6(_)) => Err(NodeError::Parameter {
                name: "discovery_peers (or ROS_STATIC_PEERS)".to_owned(),
                value: format!("{host:?}"),
                expected: "IPv4 addresses or names of hosts, for the DDS library speaks IPv4 only".to_owned(),
            }),
            Err(_) => Ok(Self::Name(host.to_owned())),
        }
    }
}

/// Names of hosts that have not resolved yet.
#[derive(Debug)]
struct Names {
    missing: Vec<String>,
    /// Those of which the first failure was logged.
    told: BTreeSet<String>,
}

impl Names {
    fn new(missing: Vec<String>) -> Self {
        Self { missing, told: BTreeSet::new() }
    }

    /// Tries each name once, logs a name's first failure and its success after one, and returns the new addresses.
    fn look_up(&mut self, resolve: impl Fn(&str) -> Result<Ipv4Addr, String>) -> Vec<Ipv4Addr> {
        let mut found = Vec::new();
        let told = &mut self.told;
        self.missing.retain(|host| match resolve(host) {
            Ok(address) => {
                if told.contains(host) {
                    tracing::info!(host, %address, "the name of a listed host resolves now; this node announces itself there");
                }
                found.push(address);
                false
            }
            Err(why) => {
                if told.insert(host.clone()) {
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

/// Looks the names up on a thread of its own until all are known or nobody wants them any more. The system's resolver may take half a
/// minute and cannot be interrupted, so nothing waits for that thread.
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

/// The first IPv4 address of `host`.
fn resolve(host: &str) -> Result<Ipv4Addr, String> {
    let mut found = (host, 0).to_socket_addrs().map_err(|error| error.to_string())?;
    let found = found.find_map(|address| match address {
        SocketAddr::V4(address) => Some(*address.ip()),
        SocketAddr::V6(_) => None,
    });
    found.ok_or_else(|| "it has no IPv4 address".to_owned())
}

/// The port of announcements, as they come on `interface`, beside all others who have it open.
///
/// # Errors
/// When the port does not open, or the interface carries no multicast.
pub(crate) fn open(domain: u16, interface: Ipv4Addr) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_reuse_address(true)?;
    socket.bind(&SocketAddrV4::new(GROUP, group_port(domain)).into())?;
    socket.join_multicast_v4(&GROUP, &interface)?;
    socket.set_read_timeout(Some(LOOK))?;
    Ok(socket.into())
}

fn send_on(
    heard: &UdpSocket,
    sends: &UdpSocket,
    domain: u16,
    known: &Mutex<Vec<Ipv4Addr>>,
    prefix: &[u8],
    stop: &Stop,
) {
    let mut packet = vec![0; 65_536];
    while !stop.is_raised() {
        // An error is the time that is over.
        let Ok(length) = heard.recv(&mut packet) else { continue };
        if !is_of(&packet[..length], prefix) {
            continue;
        }
        let hosts = known.lock().unwrap_or_else(PoisonError::into_inner).clone();
        for (address, index) in hosts.iter().flat_map(|address| (0..PARTICIPANTS).map(move |i| (address, i)))
        {
            let host = SocketAddrV4::new(*address, own_port(domain, index));
            // A host that is down is told the next time.
            if let Err(error) = sends.send_to(&packet[..length], host) {
                tracing::debug!(%host, %error, "a listed host was not told");
            }
        }
    }
}

/// True when an RTPS packet comes from the participant with `prefix`.
fn is_of(packet: &[u8], prefix: &[u8]) -> bool {
    prefix_of(packet) == Some(prefix)
}

/// Prefix of the GUID of the participant that an RTPS packet comes from.
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
    fn only_what_the_participant_says_itself_is_sent_on() {
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
        let not_yet = |host: &str| if host == "here" { Ok(here) } else { Err("unknown".to_owned()) };
        assert_eq!(names.look_up(not_yet), [here]);
        assert_eq!((names.look_up(not_yet), names.told.len()), (vec![], 1));
        assert_eq!(names.look_up(|_| Ok(later)), [later]);
        assert!(names.missing.is_empty());
    }

    #[test]
    fn a_name_that_nobody_knows_does_not_end_the_node() {
        let hosts = ["no-such-host.invalid", "127.0.0.1"].map(str::to_owned);
        // A domain that no other test is in.
        ListedPeers::start(&hosts, 117, &[7; 12]).expect("it starts");
        assert!(resolve("no-such-host.invalid").is_err());
        assert_eq!(resolve("localhost"), Ok(Ipv4Addr::LOCALHOST));
        let message = ListedPeers::start(&["::1".to_owned()], 117, &[7; 12]).expect_err("IPv6").to_string();
        assert!(message.contains("discovery_peers") && message.contains("\"::1\""), "{message}");
    }
}
