//! DDS domains for tests. No two tests share one, not even tests of different processes: `cargo nextest` runs each test in its own
//! process, and a machine may run several builds.

use crate::wait::wait_until;
use std::net::{Ipv4Addr, UdpSocket};
use std::sync::atomic::{AtomicU32, Ordering};

/// Domains whose ports are below those that Linux gives to outgoing connections. Domain 0 is left to the user.
const DOMAINS: std::ops::RangeInclusive<u16> = 1..=100;
/// Domain of `mr-damper demo`.
const DEMO: u16 = 77;

/// A domain that only one test uses. It is free again when the value is dropped.
pub(crate) struct Domain {
    id: u16,
    _reserved: UdpSocket,
}

impl Domain {
    /// Leases a free domain.
    pub(crate) fn lease() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let count = u32::from(*DOMAINS.end());
        // Processes begin at different domains, and a domain is used again only after all others.
        let first = std::process::id().wrapping_mul(37).wrapping_add(NEXT.fetch_add(1, Ordering::Relaxed));
        let ids = (0..count).map(|k| 1 + (first.wrapping_add(k) % count) as u16);
        ids.filter(|id| *id != DEMO)
            .find_map(Self::reserve)
            .expect("each DDS domain from 1 to 100 is in use on this machine")
    }

    /// The domain `id`, if no other test and no participant uses it.
    fn reserve(id: u16) -> Option<Self> {
        // The port of the 120th participant, which is never there. Only one process can bind it.
        let reserved = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, port(id, 249))).ok()?;
        is_without_participant(id).then_some(Self { id, _reserved: reserved })
    }

    pub(crate) fn id(&self) -> i64 {
        i64::from(self.id)
    }

    /// The UDP port at this offset from the domain's first port (RTPS 2.5, 9.6.2.3).
    pub(crate) fn port(&self, offset: u16) -> u16 {
        port(self.id, offset)
    }
}

/// True if no participant on this machine is in the domain: participants share the discovery port among themselves only.
fn is_without_participant(domain: u16) -> bool {
    UdpSocket::bind((Ipv4Addr::UNSPECIFIED, port(domain, 0))).is_ok()
}

fn port(domain: u16, offset: u16) -> u16 {
    7400 + 250 * domain + offset
}

#[test]
fn domains_that_are_leased_or_in_use_are_not_leased_again() {
    let leased: Vec<Domain> = (0..3).map(|_| Domain::lease()).collect();
    for domain in &leased {
        assert!(Domain::reserve(domain.id).is_none(), "{}", domain.id);
        assert!(leased.iter().filter(|other| other.id == domain.id).count() == 1);
    }
    let id = leased[0].id;
    // A process that another test starts holds this test's closed sockets, too, until its program runs.
    wait_until("nobody is in the domain", || is_without_participant(id));
    let mut participant = None;
    wait_until("the port of discovery is free", || {
        participant = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, port(id, 0))).ok();
        participant.is_some()
    });
    assert!(!is_without_participant(id));
}
