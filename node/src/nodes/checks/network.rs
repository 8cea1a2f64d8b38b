//! Checks of domain, ports, multicast, other participants, and Zenoh.

use super::{Finding, leaves_this_machine};
use crate::ros2::listed_peers;
use crate::ros2::participant::{self, Domain};
use crate::ros2::ros_environment::{self, Remark};
use crate::settings::config::{Config, zenoh_config};
use crate::settings::interrupt::Interrupt;
use crate::zenoh::session::Link;
use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// How long to wait for announcements of other participants. Fast DDS sends one every three seconds.
const LISTEN: Duration = Duration::from_millis(3500);
/// Longest time that a datagram may take on this machine.
const SOON: Duration = Duration::from_millis(500);
/// An unused multicast group next to the one of DDS.
const PROBE: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 77);

/// Checks the domain, and that the system does not assign its ports to other programs.
pub(super) fn domain(config: &Config) -> Vec<Finding> {
    let domain = match participant::domain_id(config) {
        Ok(domain) => domain,
        Err(error) => return vec![Finding::failure("domain", error.to_string())],
    };
    let reach =
        if leaves_this_machine(config) { "all hosts that the network reaches" } else { "this machine only" };
    let first = listed_peers::group_port(domain);
    let found = Finding::ok("domain", format!("{domain}, for {reach}; UDP ports from {first}"));
    let range = std::fs::read_to_string("/proc/sys/net/ipv4/ip_local_port_range").unwrap_or_default();
    let mut bounds = range.split_whitespace().filter_map(|text| text.parse::<u16>().ok());
    let (low, high) = (bounds.next().unwrap_or(u16::MAX), bounds.next().unwrap_or(u16::MAX));
    if (low..=high).contains(&first) {
        let advice = "such a port may be in use when the node starts: use a domain from 0 to 101";
        let lent =
            format!("{first} is in the range that the system assigns to any program ({low} to {high})");
        return vec![found, Finding::warning("ports", lent, advice)];
    }
    vec![found]
}

/// Settings in the environment that are handled in another way than in ROS, or not supported.
pub(super) fn environment(config: &Config) -> Vec<Finding> {
    const WHAT: &str = "environment";
    match ros_environment::requested(config, &ros_environment::of_process) {
        Ok(requested) if requested.remarks.is_empty() => Vec::new(),
        Ok(requested) => {
            let warning = |Remark { found, advice }| Finding::warning(WHAT, found, advice);
            requested.remarks.into_iter().map(warning).collect()
        }
        Err(error) => vec![Finding::failure(WHAT, error.to_string())],
    }
}

/// Checks multicast on the interface that the node uses. Participants discover each other by multicast.
pub(super) fn multicast(config: &Config) -> Finding {
    let local = !leaves_this_machine(config);
    let (interface, name) = if local {
        (Ipv4Addr::LOCALHOST, "loopback")
    } else {
        (Ipv4Addr::UNSPECIFIED, "the default interface")
    };
    match echo(interface) {
        Ok(took) => {
            Finding::ok("multicast", format!("works on {name}, in {:.2} ms", took.as_secs_f64() * 1e3))
        }
        Err(error) if local => Finding {
            advice: Some(
                "ip link set lo up; ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo".to_owned(),
            ),
            ..Finding::failure(
                "multicast",
                format!("does not work on {name} ({error}): no other participant can discover the node"),
            )
        },
        Err(error) => Finding::warning(
            "multicast",
            format!("does not work on {name} ({error}): other hosts cannot discover the node"),
            "check that the interface is up and that no firewall drops 239.255.0.0/16, or list the other hosts in discovery_peers",
        ),
    }
}

/// Sends a datagram to a multicast group and waits until it arrives; returns the time taken.
fn echo(interface: Ipv4Addr) -> io::Result<Duration> {
    let receiver = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    receiver.join_multicast_v4(&PROBE, &interface)?;
    receiver.set_read_timeout(Some(SOON))?;
    let sender = socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::DGRAM, None)?;
    sender.set_multicast_if_v4(&interface)?;
    sender.set_multicast_loop_v4(true)?;
    let began = Instant::now();
    let mark = std::process::id().to_le_bytes();
    sender.send_to(&mark, &SocketAddr::from((PROBE, receiver.local_addr()?.port())).into())?;
    let mut received = [0; 16];
    loop {
        let (length, _) = receiver.recv_from(&mut received)?;
        if received[..length] == mark {
            return Ok(began.elapsed());
        }
    }
}

/// Lists the participants that announce themselves in the domain.
pub(super) fn others(config: &Config, interrupt: &Interrupt) -> Finding {
    const WHAT: &str = "others in the domain";
    let Ok(domain) = participant::domain_id(config) else {
        return Finding::ok(WHAT, "not checked without a domain");
    };
    let interface = if leaves_this_machine(config) { Ipv4Addr::UNSPECIFIED } else { Ipv4Addr::LOCALHOST };
    let received = match listed_peers::open(domain, interface) {
        Ok(received) => received,
        Err(error) => {
            return Finding::failure(WHAT, format!("the port of announcements cannot be opened: {error}"));
        }
    };
    let mut participants: BTreeMap<Vec<u8>, IpAddr> = BTreeMap::new();
    let mut packet = vec![0; 65_536];
    let end = Instant::now() + LISTEN;
    while Instant::now() < end && !interrupt.is_raised() {
        // An error means that the read timed out.
        let Ok((length, from)) = received.recv_from(&mut packet) else { continue };
        if let Some(prefix) = listed_peers::prefix_of(&packet[..length]) {
            participants.insert(prefix.to_vec(), from.ip());
        }
    }
    let hosts: std::collections::BTreeSet<&IpAddr> = participants.values().collect();
    let hosts: Vec<String> = hosts.iter().map(ToString::to_string).collect();
    match participants.len() {
        0 => Finding {
            advice: Some(
                "if another node should be running, compare ROS_DOMAIN_ID and the discovery range of both"
                    .to_owned(),
            ),
            ..Finding::ok(WHAT, format!("no participant was heard within {:.1} s", LISTEN.as_secs_f64()))
        },
        count => Finding::ok(WHAT, format!("{count} participants, from {}", hosts.join(", "))),
    }
}

/// Joins the domain and leaves it again, with DDS-Security if that is requested.
pub(super) fn join(config: &Config, enclave: Option<&str>) -> Finding {
    let began = Instant::now();
    match Domain::join(config, enclave) {
        Ok(_) => Finding::ok("joining it", format!("took {:.0} ms", began.elapsed().as_secs_f64() * 1e3)),
        Err(error) => Finding::failure("joining it", error.to_string()),
    }
}

/// Opens the Zenoh session that the node would open, and closes it.
pub(super) fn zenoh(config: &Config) -> Finding {
    let Some(settings) = zenoh_config(config) else {
        return Finding::ok("Zenoh", "not configured");
    };
    match Link::open(&settings) {
        Ok(_) => {
            let to = |what: &str, endpoints: &[String]| match endpoints {
                [] => String::new(),
                some => format!(", {what} {}", some.join(", ")),
            };
            let ends = to("listens on", &settings.listen) + &to("would connect to", &settings.connect);
            Finding::ok("Zenoh", format!("a session can be opened{ends}"))
        }
        Err(error) => Finding::failure("Zenoh", error.to_string()),
    }
}
