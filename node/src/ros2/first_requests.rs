//! Asks clients again for a first request that arrived too early.
//!
//! A new client writes its first request as soon as it knows the server's reader. If the server does not know the
//! client's writer yet, RustDDS 0.15 drops the request. RustDDS asks such a writer for a HEARTBEAT, with an ACKNACK of
//! count 0, but Fast DDS takes count 0 for a repetition and ignores it. So the request arrived only with the next
//! periodic HEARTBEAT, after 3 s. To avoid this delay, once a writer of requests is matched, this module sends:
//!
//! ```text
//! to the writer, 10 ms later:   INFO_DST writer, ACKNACK base 1, missing 1, count 1     "send the first sample again"
//! ```
//!
//! Fast DDS resends the first sample if it has been written, and otherwise ignores the message: the sample then arrives
//! normally. The message must not name numbers beyond the written ones, or Fast DDS ignores it as a whole. Only Fast
//! DDS needs this: other vendors answer RustDDS' own message.

use crate::ros2::rtps::Datagram;
use rustdds::{DomainParticipant, DomainParticipantStatusEvent};
use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::Duration;
use tokio::time::Instant;

/// Start of the DDS names of request topics.
const REQUESTS: &str = "rq/";
/// First bytes of the GUIDs of participants of eProsima Fast DDS.
const FAST_DDS: [u8; 2] = [0x01, 0x0f];
/// Above the count 0 of RustDDS' own first ACKNACK.
const COUNT: i32 = 1;

/// Delay before the message. Fast DDS does not resend a sample that it has just sent, because it regards it as under
/// way.
const AFTER: Duration = Duration::from_millis(10);

/// Asks newly matched writers of requests for their first sample.
#[derive(Debug)]
pub(crate) struct FirstRequests {
    socket: UdpSocket,
    /// Datagrams to be sent, with time and destinations, in order.
    due: VecDeque<(Instant, Vec<SocketAddr>, Datagram)>,
}

impl FirstRequests {
    /// Opens the socket for sending.
    ///
    /// # Errors
    /// When the system provides no socket.
    pub(crate) fn new() -> io::Result<Self> {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, due: VecDeque::new() })
    }

    /// Notes the writer that `event` reports as matched, if it writes requests.
    pub(crate) fn on_event(&mut self, participant: &DomainParticipant, event: &DomainParticipantStatusEvent) {
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
        // Shared-memory locators appear as IPv6 addresses of zeros.
        let addresses = locators.map(|locator| SocketAddr::from(*locator)).filter(SocketAddr::is_ipv4);
        self.due.push_back((Instant::now() + AFTER, addresses.collect(), datagram));
    }

    /// Sends the due datagrams at their times; never returns.
    pub(crate) async fn ask(&mut self) {
        while let Some((at, ..)) = self.due.front() {
            tokio::time::sleep_until(*at).await;
            let Some((_, addresses, datagram)) = self.due.pop_front() else { break };
            for address in addresses {
                // If it is lost, the request arrives with the periodic HEARTBEAT.
                let _ = self.socket.send_to(datagram.bytes(), address);
            }
        }
        std::future::pending().await
    }
}
