//! Long answers over a network address: RustDDS sends them in a form that no peer can read
//! (`docs/decisions/0006-answers-between-hosts.md`).
//!
//! An answer of a service or an action that is longer than a datagram is sent as fragments with inline QoS, and these
//! fragments are malformed. A datagram to a client with loopback addresses only can hold 64 kB. A datagram to a client
//! with a network address can hold about 1.4 kB, even if the client is on this machine: RustDDS uses the smallest limit
//! of all its addresses.
//!
//! So this module shortens a longer answer to such a client, if the answer's type can say that it was shortened. An
//! answer that stays too long is logged once per client. The hardened build sends correct fragments and needs neither.

use mr_damper_msgs::action::{CloseLoopResult, DesignResult};
use mr_damper_msgs::type_description::{GetTypeDescriptionResponse, KeyValue};
use mr_damper_msgs::{Message, cdr};
use ros2_client::Context;
use rustdds::RTPSEntity;
use serde_json::{Map, Value};
use std::collections::VecDeque;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Mutex, PoisonError};

/// True in the hardened build, which sends long answers correctly.
pub const IS_HARDENED: bool = option_env!("MR_DAMPER_HARDENED").is_some();
/// Longest answer that fits one Ethernet datagram, bytes: RustDDS 0.15 sends 1452, of which 32 and 48 are headers
/// (`src/rtps/constant.rs`, `src/rtps/writer.rs`).
pub const LONGEST: usize = 1452 - 32 - 48;

/// Shortens an answer of the given length in bytes, and notes that in the answer.
pub type Shorten<M> = fn(M, usize) -> M;

/// The first bytes of all GUIDs of one participant.
type Prefix = [u8; 12];

/// Number of clients that are remembered as logged.
const LOGGED: usize = 64;

/// Fits the answers of one participant's services to what their clients can read.
pub struct AnswerLimit {
    context: Context,
    /// Clients that were logged, each with whether its answer was shortened.
    logged: Mutex<VecDeque<(Prefix, bool)>>,
}

/// A client of a service, seen as a reader of its answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Client {
    prefix: Prefix,
    /// Its first network address.
    network: Option<IpAddr>,
}

/// The fate of an answer that is too long for a network address.
#[derive(Debug, PartialEq, Eq)]
enum Delivery {
    /// All its readers have only loopback addresses and get the whole answer.
    Whole,
    /// This client does not get the whole answer. `some_get_it`: another client does.
    Lost { client: Prefix, address: IpAddr, some_get_it: bool },
}

impl AnswerLimit {
    /// For the services of the participant of `context`.
    #[must_use]
    pub fn new(context: Context) -> Self {
        Self { context, logged: Mutex::default() }
    }

    /// The answer for the client whose GUID begins with `prefix`: `answer` itself, or the shortened answer if `answer`
    /// would not arrive. Logs a lost or shortened answer once per client.
    pub fn fit<M: Message>(&self, service: &str, prefix: &[u8], answer: M, shorten: Option<Shorten<M>>) -> M {
        self.fit_for(service, answer, shorten, |client| client.prefix == prefix)
    }

    /// Like [`AnswerLimit::fit`] for an unknown client: the answer is shortened if no client would get the whole answer.
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
        let Delivery::Lost { client, address, some_get_it } = delivery(&clients) else { return answer };
        let short = shorten.filter(|_| !some_get_it).map(|shorten| shorten(answer.clone(), bytes));
        let short = short.filter(|short| too_long(short, false).is_none());
        self.log_once(service, client, address, bytes, short.is_some());
        short.unwrap_or(answer)
    }

    /// The clients of `service` in other processes that discovery has found so far.
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

    fn log_once(&self, service: &str, client: Prefix, address: IpAddr, bytes: usize, is_short: bool) {
        let mut logged = self.logged.lock().unwrap_or_else(PoisonError::into_inner);
        if logged.contains(&(client, is_short)) {
            return;
        }
        logged.truncate(LOGGED - 1);
        logged.push_front((client, is_short));
        drop(logged);
        if is_short {
            tracing::info!("{service}: the answer to the client at {address} is {}", shortened(bytes));
        } else {
            tracing::warn!(
                "{service}: the answer to the client at {address} has {bytes} bytes and does not arrive, so the client keeps waiting: \
                 this build cannot send more than {LONGEST} bytes in an answer over a network address. Ask for less (a prefix, a few \
                 names), or use the hardened build. Logged once per client"
            );
        }
    }
}

/// The fate of a long answer to these clients.
fn delivery(clients: &[Client]) -> Delivery {
    let some_get_it = clients.iter().any(|client| client.network.is_none());
    let lost = clients.iter().find_map(|client| Some((client.prefix, client.network?)));
    lost.map_or(Delivery::Whole, |(client, address)| Delivery::Lost { client, address, some_get_it })
}

/// The note in a shortened answer; also used in the log.
fn shortened(bytes: usize) -> String {
    format!(
        "shortened: the whole answer has {bytes} bytes, and this build cannot send more than {LONGEST} over a network address; the hardened \
         build sends the whole"
    )
}

/// The length of a message that cannot be sent over a network address; `None` if it can.
fn too_long<M: Message>(message: &M, is_hardened: bool) -> Option<usize> {
    if is_hardened {
        return None;
    }
    // The writer logs an answer that cannot be serialised.
    let bytes = cdr::to_vec(message).ok()?.len();
    (bytes > LONGEST).then_some(bytes)
}

/// The first network address among `addresses`. One is enough: the smallest limit applies to all.
fn network(addresses: impl IntoIterator<Item = IpAddr>) -> Option<IpAddr> {
    let is_of_one = |ip: &IpAddr| !ip.is_loopback() && !ip.is_multicast() && !ip.is_unspecified();
    addresses.into_iter().find(is_of_one)
}

/// A type description without its source texts.
#[must_use]
pub fn short_type(answer: GetTypeDescriptionResponse, bytes: usize) -> GetTypeDescriptionResponse {
    let note = KeyValue { key: "shortened".to_owned(), value: shortened(bytes) };
    let short =
        GetTypeDescriptionResponse { type_sources: Vec::new(), extra_information: vec![note], ..answer };
    if too_long(&short, false).is_none() {
        return short;
    }
    // If the type itself does not fit, the answer is the reason.
    GetTypeDescriptionResponse { successful: false, failure_reason: shortened(bytes), ..Default::default() }
}

/// A report without tables and text: the outcome and the place of the model file.
#[must_use]
pub fn short_report(answer: CloseLoopResult, bytes: usize) -> CloseLoopResult {
    let Ok(Value::Object(report)) = serde_json::from_str(&answer.report) else { return answer };
    let is_plain = |value: &Value| !value.is_object() && !value.is_array();
    let mut short: Map<String, Value> = report.into_iter().filter(|(_, value)| is_plain(value)).collect();
    short.insert("text".to_owned(), shortened(bytes).into());
    short.insert("shortened".to_owned(), true.into());
    CloseLoopResult { report: Value::Object(short).to_string(), ..answer }
}

/// A design without its figures: the place of the run.
#[must_use]
pub fn short_design(answer: DesignResult, bytes: usize) -> DesignResult {
    // A failure needs no figures, and its reason is worth more than the note.
    let message = if answer.success { shortened(bytes) } else { answer.message };
    DesignResult { message, report: String::new(), ..answer }
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
        assert_eq!(delivery(&[]), Delivery::Whole);
        assert_eq!(delivery(&[client(1, None)]), Delivery::Whole);
        let lost = |some_get_it| Delivery::Lost { client: [2; 12], address: at([10, 0, 0, 2]), some_get_it };
        assert_eq!(delivery(&[client(2, far)]), lost(false));
        assert_eq!(delivery(&[client(1, None), client(2, far)]), lost(true));
    }

    #[test]
    fn an_answer_longer_than_a_datagram_is_too_long_except_in_the_hardened_build() {
        let of = |length: usize| CloseLoopResult { success: true, report: "x".repeat(length) };
        assert_eq!(too_long(&of(1000), false), None);
        let bytes = too_long(&of(LONGEST), false).expect("too long");
        assert!((LONGEST..LONGEST + 20).contains(&bytes), "{bytes}");
        assert_eq!(too_long(&of(100_000), true), None);
    }

    #[test]
    fn a_shortened_answer_fits_and_notes_it() {
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

        let run_file = "/tmp/next.csv".to_owned();
        let answer = DesignResult {
            success: true,
            message: "long ".repeat(900),
            run_file: run_file.clone(),
            report: "{}".to_owned(),
        };
        let short = short_design(answer, 9000);
        assert!(short.success && too_long(&short, false).is_none() && short.run_file == run_file);
        assert!(short.message.contains("shortened: the whole answer has 9000"), "{}", short.message);

        for descriptor in mr_damper_msgs::MESSAGES {
            let request = mr_damper_msgs::type_description::GetTypeDescriptionRequest {
                type_name: descriptor.type_name.to_owned(),
                type_hash: String::new(),
                include_type_sources: true,
            };
            let whole = crate::ros2::types::describe(&request);
            let Some(bytes) = too_long(&whole, false) else { continue };
            let short = short_type(whole.clone(), bytes);
            assert!(too_long(&short, false).is_none(), "{}", descriptor.type_name);
            let logged = format!("{short:?}");
            assert!(logged.contains("shortened: the whole answer has"), "{logged}");
            assert!(!short.successful || short.type_description == whole.type_description);
        }
    }
}
