//! Requests that a client sends before this participant knows the client's writer are asked for again.
//!
//! A new client writes its first request as soon as it knows the server's reader. Where the server does not know the client's writer by
//! then, RustDDS 0.15 drops the request. It asks such a writer for a HEARTBEAT, with an ACKNACK of count 0, which Fast DDS takes for a
//! repetition. So the request came with the next periodic HEARTBEAT, after 3 s. Here, once a writer of requests is matched:
//!
//! ```text
//! to the writer, 10 ms later:   INFO_DST writer, ACKNACK base 1, missing 1, count 1     "send the first sample again"
//! ```
//!
//! Fast DDS sends it again where it has been written, and ignores the request where it has not: it will come by itself then. Numbers
//! beyond the written ones would make it ignore the request as well. Only Fast DDS is asked: other vendors
//! answer what RustDDS sends.

use crate::rtps::Datagram;
use rustdds::{DomainParticipant, DomainParticipantStatusEvent};
use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::Duration;
use tokio::time::Instant;

/// What the DDS names of topics of requests begin with.
const REQUESTS: &str = "rq/";
/// The first bytes of the participants of eProsima Fast DDS.
const FAST_DDS: [u8; 2] = [0x01, 0x0f];
/// Above the 0 of RustDDS' own first ACKNACK.
const COUNT: i32 = 1;

/// How long a writer is left alone: Fast DDS takes what it has just sent for under way, and does not send it again.
const AFTER: Duration = Duration::from_millis(10);

/// Asks writers of requests that have just been matched.
#[derive(Debug)]
pub(crate) struct FirstRequests {
    socket: UdpSocket,
    /// What is to be sent, with its time and destinations, in order.
    due: VecDeque<(Instant, Vec<SocketAddr>, Datagram)>,
}

impl FirstRequests {
    /// Opens the socket that asks.
    ///
    /// # Errors
    /// When the system gives no socket.
    pub(crate) fn new() -> io::Result<Self> {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, due: VecDeque::new() })
    }

    /// Notes the writer that `event` says is matched, if it is one of requests.
    pub(crate) fn hear(&mut self, participant: &DomainParticipant, event: &DomainParticipantStatusEvent) {
        let DomainParticipantStatusEvent::RemoteWriterMatched { local_reader, remote_writer } = event else {
            return;
        };
        if !remote_writer.prefix.as_ref().starts_with(&FAST_DDS) {
            return;
        }
        let discovered = participant.discovered_writers();
        let Some(writer) = discovered.iter().find(|of| of.writer_proxy.remote_writer_guid == *remote_writer)
        else {
            return;
        };
        if !writer.publication_topic_data.topic_name.starts_with(REQUESTS) {
            return;
        }
        let mut datagram = Datagram::from_participant_of(*local_reader);
        datagram.ask_for_first(*local_reader, *remote_writer, COUNT);
        let locators = writer.writer_proxy.unicast_locator_list.iter();
        // Locators of shared memory have an IPv6 address of zeros.
        let addresses = locators.map(|locator| SocketAddr::from(*locator)).filter(SocketAddr::is_ipv4);
        self.due.push_back((Instant::now() + AFTER, addresses.collect(), datagram));
    }

    /// Asks when it is time to; never ends.
    pub(crate) async fn ask(&mut self) {
        while let Some((at, ..)) = self.due.front() {
            tokio::time::sleep_until(*at).await;
            let Some((_, addresses, datagram)) = self.due.pop_front() else { break };
            for address in addresses {
                // Where it does not arrive, the periodic HEARTBEAT does what it did before.
                let _ = self.socket.send_to(datagram.bytes(), address);
            }
        }
        std::future::pending().await
    }
}
