//! Keeps the ports of a participant together: the port of discovery and the port of user data of one participant id.
//!
//! RustDDS takes the first id whose port of discovery is free. If another program has the id's port of user data,
//! RustDDS listens on a random port, but its writers announce the port of the id. Then no ACKNACK arrives, and a reader
//! that joins late receives nothing (`docs/decisions/0004-dds-security.md`). Fast DDS looks for its two ports
//! separately, so it takes such a port if it starts in the same moment.
//!
//! ```text
//! id   port of discovery   port of user data
//! 0    free → held         taken               RustDDS finds the first port taken and goes on
//! 1    free                free                RustDDS takes both
//! ```
//!
//! Another program can still take a port between this search and RustDDS' own. So the sockets of the process are
//! checked afterwards, and the participant is built again if the port of user data is not among them.

use crate::ros2::listed_peers::own_port;
use crate::settings::error::NodeError;
use rustdds::DomainParticipant;
use std::net::{Ipv4Addr, UdpSocket};

/// Number of participant ids in a domain (RTPS 2.5, 9.6.2.3).
const PARTICIPANTS: u16 = 120;
/// How often a participant is built if another program takes its port each time.
const ATTEMPTS: usize = 5;

/// Builds a participant in `domain` with `build` so that it has both ports of its id. Also returns what `build`
/// returns beside it.
///
/// If another program takes the port in each attempt, the last participant is returned, and a warning is logged.
///
/// # Errors
/// Those of `build`.
pub(crate) fn with_both_ports<T>(
    domain: u16,
    build: impl Fn() -> Result<(DomainParticipant, T), NodeError>,
) -> Result<(DomainParticipant, T), NodeError> {
    let mut attempt = 1;
    loop {
        let held = hold_incomplete_ids(domain);
        let (participant, more) = build()?;
        drop(held);
        let port = user_port(domain, participant.participant_id());
        if has_socket_on(port).unwrap_or(true) {
            return Ok((participant, more));
        }
        if attempt == ATTEMPTS {
            tracing::warn!(
                port,
                attempts = ATTEMPTS,
                "another program has the UDP port on which readers acknowledge, so readers that join late may \
                 receive nothing; end that program (`ss -ulpn` shows it) or use another domain, and start again"
            );
            return Ok((participant, more));
        }
        tracing::debug!(
            port,
            attempt,
            "another program took the UDP port meanwhile; joining the domain again"
        );
        attempt += 1;
    }
}

/// The port on which participant `id` of this machine receives user data.
const fn user_port(domain: u16, id: u16) -> u16 {
    own_port(domain, id) + 1
}

/// Binds the port of discovery of each id whose port of user data is taken, up to the first id of which both are free.
fn hold_incomplete_ids(domain: u16) -> Vec<UdpSocket> {
    // In the last domains, the ports of higher ids would exceed the port range.
    let ids = (u16::MAX - own_port(domain, 0)).div_ceil(2).min(PARTICIPANTS);
    let mut held = Vec::new();
    for id in 0..ids {
        // An id whose port of discovery is taken belongs to another participant. Its port of user data is left alone:
        // that participant may be about to bind it.
        let Ok(discovery) = bound(own_port(domain, id)) else { continue };
        if bound(user_port(domain, id)).is_ok() {
            break;
        }
        held.push(discovery);
    }
    held
}

fn bound(port: u16) -> std::io::Result<UdpSocket> {
    UdpSocket::bind((Ipv4Addr::UNSPECIFIED, port))
}

/// True if a socket of this process is bound to UDP `port`; `None` where the system does not list sockets (Linux does).
fn has_socket_on(port: u16) -> Option<bool> {
    let of_host = std::fs::read_to_string("/proc/self/net/udp").ok()?;
    let own: Vec<_> = std::fs::read_dir("/proc/self/fd")
        .ok()?
        .flatten()
        .flat_map(|fd| std::fs::read_link(fd.path()))
        .collect();
    Some(
        inodes_on(&of_host, port)
            .any(|inode| own.iter().any(|fd| fd.as_os_str() == &*format!("socket:[{inode}]"))),
    )
}

/// The inodes of the sockets on `port`, in the text of `/proc/net/udp`.
fn inodes_on(listed: &str, port: u16) -> impl Iterator<Item = &str> {
    let end = format!(":{port:04X}");
    // The header is skipped. Columns: number, local address, remote address, state, queues, timer, retransmissions,
    // user, timeout, inode.
    listed.lines().skip(1).filter_map(move |line| {
        let mut columns = line.split_whitespace();
        columns.nth(1).filter(|local| local.ends_with(&end))?;
        columns.nth(7)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const LISTED: &str = "\
   sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode ref pointer drops
 8187: 00000000:1CF3 00000000:0000 07 00000000:00000000 00:00000000 00000000     0        0 11817 2 0000000000000000 0
 8186: 0100007F:1CF2 00000000:0000 07 00000000:00000000 00:00000000 00000000     0        0 11816 2 0000000000000000 0
";

    #[test]
    fn the_inode_of_a_port_is_read_from_the_list_of_sockets() {
        assert_eq!(inodes_on(LISTED, 7411).collect::<Vec<_>>(), ["11817"]);
        assert_eq!(inodes_on(LISTED, 7410).collect::<Vec<_>>(), ["11816"]);
        assert_eq!(inodes_on(LISTED, 7412).next(), None);
    }

    #[test]
    fn the_last_domain_has_ports_for_63_participants() {
        let ports: Vec<UdpSocket> = (0..63).filter_map(|id| bound(user_port(232, id)).ok()).collect();
        assert_eq!(ports.len(), 63, "nobody uses this domain");
        assert_eq!(hold_incomplete_ids(232).len(), 63);
    }

    #[test]
    fn a_socket_of_this_process_is_found_until_it_is_closed() {
        let socket = bound(0).expect("a free port");
        let port = socket.local_addr().expect("a bound socket").port();
        assert_eq!(has_socket_on(port), Some(true));
        drop(socket);
        assert_eq!(has_socket_on(port), Some(false));
    }
}
