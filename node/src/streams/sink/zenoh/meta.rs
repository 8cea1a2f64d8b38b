//! The answer to `meta`: describes the published keys and payloads for clients without prior knowledge.

use super::encode::{ATTACHMENT_LEN, encoding_of};
use super::shared::{Shared, Tree};
use super::topic::Topic;
use mr_damper_model::pipeline::{Mode, Reasons, Validity};
use serde_json::{Map, Value, json};

const MODES: [Mode; 5] = [Mode::Arx, Mode::ArxCoast, Mode::Model, Mode::Hold, Mode::Fault];
const VALIDITIES: [Validity; 5] =
    [Validity::Valid, Validity::Degraded, Validity::Extrapolating, Validity::Stale, Validity::Invalid];

/// Describes the mirror of one damper.
pub(super) fn describe(shared: &Shared) -> Value {
    let names = shared.names();
    let topics: Map<String, Value> = Topic::ALL
        .into_iter()
        .map(|topic| (topic.name().to_owned(), describe_topic(shared, topic)))
        .collect();
    json!({
        "damper": shared.damper,
        "version": env!("CARGO_PKG_VERSION"),
        "models": { "free": names.free, "seeded": names.seeded, "hash": names.hash },
        "sign_convention": "SI units (REP-103); positive displacement and velocity extend the damper, \
                            positive force is tension on the rod",
        "not_finite": "NaN and infinite numbers are null in JSON and CBOR; in CDR they are unchanged",
        "seq": "counts the samples of one key from 1; a gap means that Zenoh dropped a sample because the \
                consumer did not keep up. Events lost before the mirror leave no gap: see ring_dropped in \
                status",
        "stamp_ns": "stamp that the source gave the sample, in ns, nearly always since 1970. Beyond 2^53 ns a \
                     JavaScript number is exact to 256 ns only",
        "attachment_of_cdr": format!(
            "{ATTACHMENT_LEN} bytes, little endian: seq (i64), stamp_ns (i64), validity (u8, an index into \
             validities)"
        ),
        "validities": VALIDITIES.map(Validity::name),
        "validity_of": {
            "inputs": "VALID, as accepted",
            "refused": "INVALID",
            "force_residual": "validity of the estimate with the same stamp; DEGRADED when it is no longer known",
            "mode": "VALID in arx and model, DEGRADED in arx_coast, STALE in hold, INVALID in fault",
            "answers": "validity of the last estimate",
        },
        "modes": MODES.map(Mode::name),
        "reasons": Reasons::ALL.iter().map(|(_, name)| *name).collect::<Vec<_>>(),
        "web": {
            "rate_hz": shared.config.web_rate_hz,
            "encoding": "application/json",
            "what": "the newest sample of each topic, at most at this rate, and always the last one of a \
                     burst; seq counts the samples of this key",
        },
        "history": {
            "length_s": shared.config.history_s,
            "topics": ["force_estimate", "force_residual"],
            "parameters": "_time=[now(-10s)..] selects by the time at which the mirror took the sample, max=N limits \
                           to the newest entries of each topic, format=json|cbor; one reply with all entries, oldest first",
        },
        "late_joiners": "a get of a key under state/ or web/, wildcards included, returns the key's last sample",
        "status": "counters of each key: sent, dropped, age_s of the last sample, rate_hz",
        "qos": "congestion control drop, priority data_high; answers use the QoS of the query",
        "topics": topics,
    })
}

fn describe_topic(shared: &Shared, topic: Topic) -> Value {
    let field = |(name, unit, what): &(&str, &str, &str)| json!({ "name": name, "unit": unit, "what": what });
    let head = [
        ("seq", "1", "number of the sample on this key, from 1"),
        ("stamp_ns", "ns", "stamp of the sample"),
        ("validity", "", "one of validities"),
    ];
    let fields: Vec<Value> = head.iter().chain(topic.fields()).map(field).collect();
    json!({
        "direction": if topic.is_input() { "in" } else { "out" },
        "key": shared.route_key(Tree::State, topic),
        "encoding": encoding_of(shared.config.encoding, topic).media_type(),
        "web_key": shared.route_key(Tree::Web, topic),
        "ros_type": topic.ros_type(),
        "fields": fields,
    })
}
