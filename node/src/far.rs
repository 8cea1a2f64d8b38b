//! Long answers over a network address, which RustDDS sends and no peer can read
//! (`docs/decisions/0006-answers-between-hosts.md`).
//!
//! An answer of a service or an action that is longer than a datagram goes as fragments with inline QoS, whose bytes are wrong. To a
//! client that has loopback addresses only, a datagram carries 64 kB. To one with a network address it carries about 1.4 kB, also when
//! that client is on this machine: RustDDS takes the least that any of its addresses carries. So a longer answer to such a client is
//! shortened, where its type has room to say so; what stays too long is logged once for each client. The hardened build mends the
//! fragments and does neither.

use mr_damper_msgs::action::CloseLoopResult;
use mr_damper_msgs::type_description::{GetTypeDescriptionResponse, KeyValue};
use mr_damper_msgs::{Message, cdr};
use ros2_client::Context;
use rustdds::RTPSEntity;
use serde_json::{Map, Value};
use std::collections::VecDeque;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Mutex, PoisonError};

/// True in the hardened build, which sends such answers as they should be.
pub const IS_HARDENED: bool = option_env!("MR_DAMPER_HARDENED").is_some();
/// Bytes of the longest answer in one datagram of an Ethernet: RustDDS 0.15 sends 1452, of which 32 and 48 go before it
/// (`src/rtps/constant.rs`, `src/rtps/writer.rs`).
pub const LONGEST: usize = 1452 - 32 - 48;

/// Makes an answer of so many bytes shorter, and says so in it.
pub type Shorten<M> = fn(M, usize) -> M;

/// How the GUIDs of all that belongs to one participant begin.
type Prefix = [u8; 12];

/// Clients that are remembered to have been logged.
const TOLD: usize = 64;

/// Sends answers of one participant's services in a form that their clients can read.
pub struct Far {
    context: Context,
    /// Clients that were logged, each with whether its answer was shortened.
    told: Mutex<VecDeque<(Prefix, bool)>>,
}

/// A client of a service: a reader of its answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Client {
    prefix: Prefix,
    /// The first of its addresses that is of a network.
    network: Option<IpAddr>,
}

/// The fate of an answer that is too long for a network address.
#[derive(Debug, PartialEq, Eq)]
enum Way {
    /// All its readers have loopback addresses only.
    Whole,
    /// This client does not get it whole; there is one that does, or none.
    Lost { client: Prefix, address: IpAddr, some_get_it: bool },
}

impl Far {
    /// For the services of the participant of `context`.
    #[must_use]
    pub fn new(context: Context) -> Self {
        Self { context, told: Mutex::default() }
    }

    /// The answer to the client whose GUID begins with `prefix`, as it can reach that: `answer` itself, or what `shorten` makes of it.
    /// Logs an answer that is lost or shortened, once for each client.
    pub fn fit<M: Message>(&self, service: &str, prefix: &[u8], answer: M, shorten: Option<Shorten<M>>) -> M {
        self.fit_for(service, answer, shorten, |client| client.prefix == prefix)
    }

    /// The same where the client is unknown: the answer is shortened if no client would get the whole.
    pub fn fit_all<M: Message>(&self, service: &str, answer: M, shorten: Option<Shorten<M>>) -> M {
        self.fit_for(service, answer, shorten, |_| true)
    }

    fn fit_for<M: Message>(
        &self,
        service: &str,
        answer: M,
        shorten: Option<Shorten<M>>,
        is_meant: impl Fn(&Client) -> bool,
    ) -> M {
        let Some(bytes) = too_long(&answer, IS_HARDENED) else { return answer };
        let clients: Vec<Client> = self.clients(service).into_iter().filter(is_meant).collect();
        let Way::Lost { client, address, some_get_it } = way(&clients) else { return answer };
        let short = shorten.filter(|_| !some_get_it).map(|shorten| shorten(answer.clone(), bytes));
        let short = short.filter(|short| too_long(short, false).is_none());
        self.tell(service, client, address, bytes, short.is_some());
        short.unwrap_or(answer)
    }

    /// The clients of `service` in other processes, as far as discovery has seen them.
    fn clients(&self, service: &str) -> Vec<Client> {
        let participant = self.context.domain_participant();
        let (own, topic) = (participant.guid().prefix, format!("rr{service}Reply"));
        let readers = participant.discovered_readers().into_iter();
        let of_it = readers.filter(|reader| *reader.subscription_topic_data.topic_name() == topic);
        let proxies = of_it.map(|reader| reader.reader_proxy);
        let others = proxies.filter(|proxy| proxy.remote_reader_guid.prefix != own);
        let client = others.map(|proxy| {
            let mut prefix = Prefix::default();
            prefix.copy_from_slice(proxy.remote_reader_guid.prefix.as_ref());
            let addresses = proxy.unicast_locator_list.into_iter().map(SocketAddr::from);
            Client { prefix, network: network(addresses.map(|address| address.ip())) }
        });
        client.collect()
    }

    fn tell(&self, service: &str, client: Prefix, address: IpAddr, bytes: usize, is_short: bool) {
        let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        if told.contains(&(client, is_short)) {
            return;
        }
        told.truncate(TOLD - 1);
        told.push_front((client, is_short));
        drop(told);
        if is_short {
            tracing::info!("{service}: the answer to the client at {address} is {}", shortened(bytes));
        } else {
            tracing::warn!(
                "{service}: the answer to the client at {address} has {bytes} bytes and does not reach it, so the client waits in vain: \
                 this build cannot send more than {LONGEST} bytes in an answer over a network address. Ask for less (a prefix, a few \
                 names), or use the hardened build. Said once for each client"
            );
        }
    }
}

/// The fate of a long answer to these clients.
fn way(clients: &[Client]) -> Way {
    let some_get_it = clients.iter().any(|client| client.network.is_none());
    let lost = clients.iter().find_map(|client| Some((client.prefix, client.network?)));
    lost.map_or(Way::Whole, |(client, address)| Way::Lost { client, address, some_get_it })
}

/// The note in a shortened answer, also for the log.
fn shortened(bytes: usize) -> String {
    format!(
        "shortened: the whole answer has {bytes} bytes, and this build cannot send more than {LONGEST} over a network address; the hardened \
         build sends the whole"
    )
}

/// The bytes of a message that cannot be sent over a network address.
fn too_long<M: Message>(message: &M, is_hardened: bool) -> Option<usize> {
    if is_hardened {
        return None;
    }
    // The writer logs an answer that cannot be serialised.
    let bytes = cdr::to_vec(message).ok()?.len();
    (bytes > LONGEST).then_some(bytes)
}

/// The first of these addresses that is of a network. One is enough for the least that they all carry.
fn network(addresses: impl IntoIterator<Item = IpAddr>) -> Option<IpAddr> {
    let is_of_one = |ip: &IpAddr| !ip.is_loopback() && !ip.is_multicast() && !ip.is_unspecified();
    addresses.into_iter().find(is_of_one)
}

/// A type without its texts.
#[must_use]
pub fn short_type(answer: GetTypeDescriptionResponse, bytes: usize) -> GetTypeDescriptionResponse {
    let note = KeyValue { key: "shortened".to_owned(), value: shortened(bytes) };
    let short =
        GetTypeDescriptionResponse { type_sources: Vec::new(), extra_information: vec![note], ..answer };
    if too_long(&short, false).is_none() {
        return short;
    }
    // A type that does not fit by itself is answered with the reason.
    GetTypeDescriptionResponse { successful: false, failure_reason: shortened(bytes), ..Default::default() }
}

/// A report without its tables and words: what came of it, and where the model file is.
#[must_use]
pub fn short_report(answer: CloseLoopResult, bytes: usize) -> CloseLoopResult {
    let Ok(Value::Object(report)) = serde_json::from_str(&answer.report) else { return answer };
    let is_plain = |value: &Value| !value.is_object() && !value.is_array();
    let mut short: Map<String, Value> = report.into_iter().filter(|(_, value)| is_plain(value)).collect();
    short.insert("text".to_owned(), shortened(bytes).into());
    short.insert("shortened".to_owned(), true.into());
    CloseLoopResult { report: Value::Object(short).to_string(), ..answer }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ip: [u8; 4]) -> IpAddr {
        IpAddr::from(ip)
    }

    #[test]
    fn one_network_address_is_enough_to_be_sent_short_datagrams() {
        assert_eq!(network([at([127, 0, 0, 1])]), None);
        assert_eq!(network([]), None);
        assert_eq!(network([at([0, 0, 0, 0]), at([239, 255, 0, 1])]), None);
        assert_eq!(network([at([127, 0, 0, 1]), at([10, 0, 0, 2])]), Some(at([10, 0, 0, 2])));
    }

    #[test]
    fn an_answer_is_lost_to_clients_with_a_network_address_only() {
        let client = |first: u8, network| Client { prefix: [first; 12], network };
        let far = Some(at([10, 0, 0, 2]));
        assert_eq!(way(&[]), Way::Whole);
        assert_eq!(way(&[client(1, None)]), Way::Whole);
        let lost = |some_get_it| Way::Lost { client: [2; 12], address: at([10, 0, 0, 2]), some_get_it };
        assert_eq!(way(&[client(2, far)]), lost(false));
        assert_eq!(way(&[client(1, None), client(2, far)]), lost(true));
    }

    #[test]
    fn only_what_is_longer_than_a_datagram_is_too_long_and_nothing_is_in_the_hardened_build() {
        let of = |length: usize| CloseLoopResult { success: true, report: "x".repeat(length) };
        assert_eq!(too_long(&of(1000), false), None);
        let bytes = too_long(&of(LONGEST), false).expect("too long");
        assert!((LONGEST..LONGEST + 20).contains(&bytes), "{bytes}");
        assert_eq!(too_long(&of(100_000), true), None);
    }

    #[test]
    fn what_is_shortened_says_so_and_fits() {
        let report = serde_json::json!({
            "schema": "s/1", "model_file": "/tmp/m.toml", "loaded": true, "seconds": 3.0,
            "text": "long ".repeat(900), "findings": vec![1.0; 900],
        });
        let answer = CloseLoopResult { success: true, report: report.to_string() };
        let short = short_report(answer, 9000);
        assert!(short.success && too_long(&short, false).is_none());
        let report: Value = serde_json::from_str(&short.report).expect("JSON");
        assert_eq!(
            (report["model_file"].as_str(), report["loaded"].as_bool()),
            (Some("/tmp/m.toml"), Some(true))
        );
        assert!(
            report["text"].as_str().is_some_and(|text| text.contains("shortened: the whole answer has 9000"))
        );
        assert!(report["findings"].is_null());

        for descriptor in mr_damper_msgs::MESSAGES {
            let request = mr_damper_msgs::type_description::GetTypeDescriptionRequest {
                type_name: descriptor.type_name.to_owned(),
                type_hash: String::new(),
                include_type_sources: true,
            };
            let whole = crate::types::describe(&request);
            let Some(bytes) = too_long(&whole, false) else { continue };
            let short = short_type(whole.clone(), bytes);
            assert!(too_long(&short, false).is_none(), "{}", descriptor.type_name);
            let told = format!("{short:?}");
            assert!(told.contains("shortened: the whole answer has"), "{told}");
            assert!(!short.successful || short.type_description == whole.type_description);
        }
    }
}
