//! Drops old samples for lagging readers, so that no reader blocks a writer.
//!
//! A reliable writer of RustDDS 0.15 keeps the samples that a reader has not acknowledged, and refuses to write once
//! they fill its window, although its history is KEEP_LAST. So a reader that has died, is stopped, or never
//! acknowledges would block the topic for all others, and each new reader would do so until its first acknowledgement.
//! Here the window is unlimited ([`WINDOW`]), and this thread limits the number of kept samples.
//!
//! KEEP_LAST means that the oldest samples are dropped. The thread does this with submessages of the protocol itself:
//!
//! ```text
//! every 0.25 s, for each writer, base = samples written - LAG:
//!     to our own participant:   INFO_SRC reader, ACKNACK base     "the reader has all samples below base"
//!     to the reader:            INFO_DST reader, GAP .. base      "no sample below base will follow"
//! ```
//!
//! This does not affect a reader that has acknowledged more: RustDDS never takes an acknowledgement back. A reader that
//! returns gets the last [`LAG`] samples and continues with them. With DDS-Security, no process can send messages in
//! the name of another participant. There, memory grows as long as a reader that does not acknowledge keeps its lease.

use crate::ros2::listed_peers::own_port;
use crate::ros2::rtps::Datagram;
use mr_damper_base::worker::{Stop, Worker};
use rustdds::{DomainParticipant, GUID};
use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;

/// Samples that a writer keeps for a reader that has not acknowledged them: 8 s at 1 kHz.
pub(crate) const LAG: u64 = 8192;

/// Unacknowledged samples before a reliable writer refuses to write (DDS: RESOURCE_LIMITS max_samples): unlimited.
/// RustDDS counts all samples of the writer's life as unacknowledged by a reader that has just joined.
pub(crate) const WINDOW: i32 = i32::MAX;

const PERIOD: Duration = Duration::from_millis(250);
/// Number of rounds back to the first sample that a GAP names: 10 s. RustDDS announces the loss of older samples
/// itself, because it cleans its history every 6 s.
const REACH: usize = 40;
/// Readers per datagram; each takes 52 bytes.
const READERS_A_DATAGRAM: usize = 20;

/// A writer of this participant.
#[derive(Debug)]
pub(crate) struct LocalWriter {
    writer: GUID,
    /// DDS name of its topic.
    topic: String,
    /// Samples written. RustDDS numbers them from 1 without gaps.
    samples: AtomicU64,
}

impl LocalWriter {
    /// Counts a written sample.
    pub(crate) fn note(&self) {
        self.samples.fetch_add(1, Ordering::Relaxed);
    }
}

/// The writers that still exist.
#[derive(Debug, Clone, Default)]
pub(crate) struct Writers(Arc<Mutex<Vec<Weak<LocalWriter>>>>);

impl Writers {
    /// Adds a writer of the topic with this DDS name.
    pub(crate) fn add(&self, writer: GUID, topic: String) -> Arc<LocalWriter> {
        let written = Arc::new(LocalWriter { writer, topic, samples: AtomicU64::new(0) });
        // After a panic elsewhere, the list of pointers is still valid.
        let mut writers = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        writers.retain(|writer| writer.strong_count() > 0);
        writers.push(Arc::downgrade(&written));
        written
    }

    fn present(&self) -> Vec<Arc<LocalWriter>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).iter().filter_map(Weak::upgrade).collect()
    }
}

/// The running thread.
#[derive(Debug)]
pub(crate) struct LaggingReaders {
    /// `Some` until the drop.
    worker: Option<Worker>,
}

impl LaggingReaders {
    /// Starts the thread for the `writers` of `participant`.
    ///
    /// # Errors
    /// When the system provides no socket or cannot start the thread.
    pub(crate) fn start(participant: DomainParticipant, writers: Writers) -> io::Result<Self> {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        // The thread must not wait for an unreachable reader.
        socket.set_nonblocking(true)?;
        let worker = Worker::start("ros-laggards", move |stop| {
            Rounds { participant, writers, socket, bases: Vec::new(), count: 0 }.run(stop);
        })?;
        Ok(Self { worker: Some(worker) })
    }
}

impl Drop for LaggingReaders {
    fn drop(&mut self) {
        if self.worker.take().is_some_and(|worker| worker.stop().is_err()) {
            tracing::error!("the thread that drops samples of lagging readers had panicked");
        }
    }
}

/// A reader found by discovery.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Reader {
    guid: GUID,
    addresses: Vec<SocketAddr>,
}

/// A datagram and its destinations.
type Addressed = (Vec<SocketAddr>, Datagram);

struct Rounds {
    participant: DomainParticipant,
    writers: Writers,
    socket: UdpSocket,
    bases: Vec<(GUID, Bases)>,
    /// Count of the last ACKNACK.
    count: i32,
}

impl Rounds {
    fn run(mut self, stop: &Stop) {
        while !stop.is_raised() {
            self.round();
            std::thread::park_timeout(PERIOD);
        }
    }

    fn round(&mut self) {
        let writers = self.writers.present();
        self.bases.retain(|(guid, _)| writers.iter().any(|written| written.writer == *guid));
        let due: Vec<_> = writers
            .iter()
            .filter_map(|written| {
                let evicted = self.bases_of(written.writer).advance(written.samples.load(Ordering::Relaxed));
                evicted.map(|evicted| (written, evicted))
            })
            .collect();
        if due.is_empty() {
            return;
        }
        let discovered = self.participant.discovered_readers();
        let own =
            (Ipv4Addr::LOCALHOST, own_port(self.participant.domain_id(), self.participant.participant_id()));
        for (written, evicted) in due {
            let readers: Vec<_> = discovered
                .iter()
                .filter(|reader| *reader.subscription_topic_data.topic_name() == written.topic)
                .map(|reader| {
                    let locators = reader.reader_proxy.unicast_locator_list.iter();
                    let addresses = locators.map(|locator| SocketAddr::from(*locator));
                    Reader {
                        guid: reader.reader_proxy.remote_reader_guid,
                        // Locators of shared memory and the like appear as IPv6 addresses of zeros.
                        addresses: addresses.filter(SocketAddr::is_ipv4).collect(),
                    }
                })
                .collect();
            self.count = self.count.wrapping_sub(1);
            for (addresses, datagram) in datagrams(written.writer, &readers, evicted, own.into(), self.count)
            {
                for address in addresses {
                    // The socket may be full or the host away: the next round repeats it.
                    let _ = self.socket.send_to(datagram.bytes(), address);
                }
            }
        }
    }

    fn bases_of(&mut self, writer: GUID) -> &mut Bases {
        let index = self.bases.iter().position(|(guid, _)| *guid == writer).unwrap_or_else(|| {
            self.bases.push((writer, Bases::default()));
            self.bases.len() - 1
        });
        &mut self.bases[index].1
    }
}

/// The dropped samples: from `first` to below `base`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Evicted {
    first: u64,
    base: u64,
}

/// The bases of the last rounds.
#[derive(Debug, Default)]
struct Bases(VecDeque<u64>);

impl Bases {
    /// Advances one round, with `samples` written so far. Returns the dropped samples, if any.
    fn advance(&mut self, samples: u64) -> Option<Evicted> {
        let base = (samples + 1).checked_sub(LAG).filter(|base| *base > 1)?;
        if self.0.len() == REACH {
            self.0.pop_front();
        }
        self.0.push_back(base);
        let first = if self.0.len() < REACH { 1 } else { self.0[0] };
        // After ten seconds without samples, all readers have been informed.
        (first < base).then_some(Evicted { first, base })
    }
}

/// The datagrams of one round for one writer.
fn datagrams(
    writer: GUID,
    readers: &[Reader],
    evicted: Evicted,
    own: SocketAddr,
    count: i32,
) -> Vec<Addressed> {
    let acknowledgements = readers.chunks(READERS_A_DATAGRAM).map(|readers| {
        let mut datagram = Datagram::from_participant_of(writer);
        for reader in readers {
            datagram.acknowledge(reader.guid, writer, evicted.base, count);
        }
        (vec![own], datagram)
    });
    let gaps = readers.iter().filter(|reader| !reader.addresses.is_empty()).map(|reader| {
        let mut datagram = Datagram::from_participant_of(writer);
        datagram.declare_gone(reader.guid, writer, evicted.first, evicted.base);
        (reader.addresses.clone(), datagram)
    });
    acknowledgements.chain(gaps).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guid(prefix: u8) -> GUID {
        GUID::from_bytes([prefix; 16])
    }

    #[test]
    fn no_sample_is_dropped_before_the_lag_is_reached() {
        let mut bases = Bases::default();
        assert_eq!(bases.advance(0), None);
        assert_eq!(bases.advance(LAG), None, "no sample lies below base 1");
        assert_eq!(bases.advance(LAG + 1), Some(Evicted { first: 1, base: 2 }));
    }

    #[test]
    fn a_gap_names_the_samples_dropped_in_the_last_rounds_and_ends_with_the_samples() {
        let mut bases = Bases::default();
        let at_250_hz = |round: u64| LAG + 250 * round;
        let last = (1..=100).filter_map(|round| bases.advance(at_250_hz(round))).last();
        let base = at_250_hz(100) + 1 - LAG;
        assert_eq!(last, Some(Evicted { first: base - 250 * (REACH as u64 - 1), base }));
        let silent = (0..REACH).filter(|_| bases.advance(at_250_hz(100)).is_some()).count();
        assert_eq!(silent, REACH - 2);
    }

    #[test]
    fn samples_are_acknowledged_for_every_reader_and_gaps_go_to_those_with_an_address() {
        let address: SocketAddr = ([10, 0, 0, 1], 7411).into();
        let own: SocketAddr = ([127, 0, 0, 1], 7410).into();
        let readers: Vec<_> = (0..45)
            .map(|k| Reader { guid: guid(k), addresses: if k < 3 { vec![address] } else { vec![] } })
            .collect();
        let sent = datagrams(guid(99), &readers, Evicted { first: 1, base: 9 }, own, -5);
        let to = |address| sent.iter().filter(|(addresses, _)| addresses == &[address]).count();
        assert_eq!((to(own), to(address), sent.len()), (3, 3, 6));
        // The smallest IPv4 network carries 576 bytes, Ethernet 1500.
        assert!(sent.iter().all(|(_, datagram)| datagram.bytes().len() <= 1400));
    }

    #[test]
    fn dropped_writers_are_removed() {
        let writers = Writers::default();
        let first = writers.add(guid(1), "rt/a".to_owned());
        let second = writers.add(guid(2), "rt/b".to_owned());
        drop(first);
        second.note();
        let present = writers.present();
        assert_eq!(present.len(), 1);
        assert_eq!((present[0].writer, present[0].samples.load(Ordering::Relaxed)), (guid(2), 1));
    }
}
