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
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, ToSocketAddrs, UdpSocket};
use std::time::Duration;

/// Where every participant announces itself (RTPS 2.5, 9.6.1.4.1).
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// Participants of a host and domain that are told.
const PARTICIPANTS: u16 = 10;
/// How often the thread looks whether it has to end.
const LOOK: Duration = Duration::from_millis(100);
/// Bytes of an RTPS header: `RTPS`, version, vendor, then the prefix of the sender's GUID.
const HEADER: usize = 20;

/// Port of announcements in `domain`: all participants share it.
pub(crate) const fn group_port(domain: u16) -> u16 {
    7400 + 250 * domain
}

/// Port on which participant `index` of a host hears of others.
const fn own_port(domain: u16, index: u16) -> u16 {
    7410 + 250 * domain + 2 * index
}

/// The thread that sends announcements on.
#[derive(Debug)]
pub struct ListedPeers {
    /// There is one until the drop.
    worker: Option<Worker>,
}

impl ListedPeers {
    /// Sends the announcements of the participant whose GUID begins with `prefix` on to `hosts` (names or IPv4 addresses).
    ///
    /// # Errors
    /// When a host is not known, or the port of announcements cannot be opened.
    pub fn start(hosts: &[String], domain: u16, prefix: &[u8]) -> Result<Self, NodeError> {
        let mut told = Vec::new();
        for host in hosts {
            let address = resolve(host)?;
            let ports = (0..PARTICIPANTS).map(|index| own_port(domain, index));
            told.extend(ports.map(|port| SocketAddr::V4(SocketAddrV4::new(address, port))));
        }
        let opening = || format!("listening to announcements on port {}", group_port(domain));
        let heard = open(domain, Ipv4Addr::LOCALHOST).map_err(NodeError::io(opening()))?;
        let sends =
            UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).map_err(NodeError::io("opening a UDP port"))?;
        tracing::info!(?hosts, "listed hosts are told of this node");
        let prefix = prefix.to_vec();
        let worker = Worker::start("ros-peers", move |stop| send_on(&heard, &sends, &told, &prefix, stop))
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

/// The first IPv4 address of `host`.
fn resolve(host: &str) -> Result<Ipv4Addr, NodeError> {
    let unknown = |why: String| NodeError::Parameter {
        name: "discovery_peers".to_owned(),
        value: format!("\"{host}\""),
        expected: format!("IPv4 addresses or names of hosts ({why})"),
    };
    let found = (host, 0).to_socket_addrs().map_err(|error| unknown(error.to_string()))?;
    let mut found = found.filter_map(|address| match address {
        SocketAddr::V4(address) => Some(*address.ip()),
        SocketAddr::V6(_) => None,
    });
    found.next().ok_or_else(|| unknown("it has no IPv4 address".to_owned()))
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

fn send_on(heard: &UdpSocket, sends: &UdpSocket, told: &[SocketAddr], prefix: &[u8], stop: &Stop) {
    let mut packet = vec![0; 65_536];
    while !stop.is_raised() {
        // An error is the time that is over.
        let Ok(length) = heard.recv(&mut packet) else { continue };
        if !is_of(&packet[..length], prefix) {
            continue;
        }
        for host in told {
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
    fn hosts_that_nobody_knows_are_said() {
        assert_eq!(resolve("127.0.0.1").expect("an address"), Ipv4Addr::LOCALHOST);
        let message = resolve("no-such-host.invalid").expect_err("unknown").to_string();
        assert!(message.contains("discovery_peers") && message.contains("no-such-host.invalid"), "{message}");
    }
}
