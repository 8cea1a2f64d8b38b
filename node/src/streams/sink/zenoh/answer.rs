//! Answers queries: `meta`, `history` and `status`, and the last sample of each key under `state/` and `web/`.
//!
//! Late joiners can `get` any key under `state/` or `web/` that they subscribe to, wildcards included. The answer is the
//! last published sample, encoded as it was published. Its `seq` tells which sample comes next.
//!
//! Zenoh calls back on its receiving threads, which only queue the query. A separate thread answers, because an answer
//! blocks while a consumer does not read, and neither reception nor samples may block.

use super::encode::{EncodeError, Encoded, encode, encoding_of};
use super::history::{CAPACITY, Extent, Selection};
use super::meta;
use super::payload::{Payload, finite};
use super::shared::{MirrorData, Shared, Tree, route};
use super::stats::Stats;
use super::time_range::{TimeRange, TimeRangeError};
use super::topic::Topic;
use crate::zenoh::session::Encoding;
use serde::Serialize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::time::{Duration, Instant};
use zenoh::Wait;
use zenoh::bytes::ZBytes;
use zenoh::key_expr::KeyExpr;
use zenoh::query::Query;

/// Maximum number of waiting queries. Further queries are refused and counted; their consumer gets no reply and may retry.
pub(super) const WAITING: usize = 32;
/// Interval at which the thread checks whether it must stop.
const CHECK_EVERY: Duration = Duration::from_millis(50);

/// The answers that the mirror composes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ComposedAnswer {
    Meta,
    History,
    Status,
}

impl ComposedAnswer {
    pub(super) const ALL: [Self; 3] = [Self::Meta, Self::History, Self::Status];

    /// The last part of the key.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Meta => "meta",
            Self::History => "history",
            Self::Status => "status",
        }
    }

    /// The query parameters that are allowed, besides Zenoh's own.
    const fn parameters(self) -> &'static [&'static str] {
        match self {
            Self::Meta | Self::Status => &["format"],
            Self::History => &["format", "max"],
        }
    }
}

/// The kind of a query, by its answer.
#[derive(Debug, Clone, Copy)]
pub(super) enum QueryKind {
    /// An answer that the mirror composes.
    Composed(ComposedAnswer),
    /// The last sample of each key of a tree, as it was published.
    Last(Tree),
}

impl QueryKind {
    pub(super) const ALL: [Self; 5] = [
        Self::Composed(ComposedAnswer::Meta),
        Self::Composed(ComposedAnswer::History),
        Self::Composed(ComposedAnswer::Status),
        Self::Last(Tree::State),
        Self::Last(Tree::Web),
    ];

    /// The part of the key after the damper's name.
    pub(super) const fn tail(self) -> &'static str {
        match self {
            Self::Composed(answer) => answer.name(),
            Self::Last(Tree::State) => "state/*",
            Self::Last(Tree::Web) => "web/*",
        }
    }
}

/// A query and its kind.
pub(super) type QueuedQuery = (QueryKind, Query);

/// Queues a query for [`run`]. Called by Zenoh, so it must not block.
pub(super) fn enqueue(kind: QueryKind, query: Query, queue: &SyncSender<QueuedQuery>, shared: &Shared) {
    if queue.try_send((kind, query)).is_err() {
        shared.data().queries_refused += 1;
    }
}

/// Answers queries until the mirror stops.
pub(super) fn run(queue: &Receiver<QueuedQuery>, shared: &Arc<Shared>) {
    let mut counts = [0_u64; ComposedAnswer::ALL.len()];
    while !shared.stopping() {
        let (kind, query) = match queue.recv_timeout(CHECK_EVERY) {
            Ok(queued) => queued,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => return,
        };
        // A panic on one query must not prevent the answers to others.
        if catch_unwind(AssertUnwindSafe(|| reply(kind, &query, &mut counts, shared))).is_err() {
            tracing::error!("the answering thread panicked on a Zenoh query: {}", query.selector());
        }
        shared.data().queries_answered += 1;
    }
}

fn reply(kind: QueryKind, query: &Query, counts: &mut [u64; ComposedAnswer::ALL.len()], shared: &Shared) {
    let answer = match kind {
        QueryKind::Composed(answer) => answer,
        QueryKind::Last(tree) => return reply_last(tree, query, shared),
    };
    let seq = &mut counts[answer as usize];
    *seq += 1;
    let seq = *seq;
    let key = shared.key(answer.name());
    let replied = match compose(answer, query, seq, shared) {
        Ok((bytes, encoding)) => query.reply(key, bytes).encoding(encoding.zenoh()).wait(),
        Err(error) => {
            let text = serde_json::json!({ "error": error.to_string() }).to_string();
            query.reply_err(text).encoding(Encoding::Json.zenoh()).wait()
        }
    };
    if let Err(error) = replied {
        tracing::debug!("cannot answer a Zenoh query: {error}");
    }
}

/// Answers with the last sample of each key that the query selects. A key without a sample gives no reply.
fn reply_last(tree: Tree, query: &Query, shared: &Shared) {
    let encoding = match tree {
        Tree::State => shared.config.encoding,
        Tree::Web => Encoding::Json,
    };
    // A copy, because an answer may block.
    let last = shared.data().last;
    let names = shared.names();
    for topic in Topic::ALL {
        let key = shared.route_key(tree, topic);
        let is_selected = KeyExpr::new(&key).is_ok_and(|key| query.key_expr().intersects(&key));
        let Some((item, seq)) = last[route(tree, topic)].filter(|_| is_selected) else { continue };
        let replied = match encode(&item, seq, encoding, &names, &shared.frame.get()) {
            Ok(Encoded { bytes, attachment }) => query
                .reply(key, bytes)
                .encoding(encoding_of(encoding, topic).zenoh())
                .attachment(attachment.map(ZBytes::from))
                .wait(),
            Err(error) => Err(error.into()),
        };
        if let Err(error) = replied {
            tracing::debug!("cannot answer a Zenoh query: {error}");
        }
    }
}

/// Reasons why a query gets no answer.
#[derive(Debug, thiserror::Error)]
enum QueryError {
    #[error("unknown parameter `{name}`; allowed here: {}", allowed.join(", "))]
    UnknownParameter { name: String, allowed: &'static [&'static str] },
    #[error("unknown format={format}; use json or cbor")]
    UnknownFormat { format: String },
    #[error(transparent)]
    Time(#[from] TimeRangeError),
    #[error("max={text} is not a number of entries")]
    Max { text: String },
    #[error("the answer cannot be encoded: {0}")]
    Encode(#[from] EncodeError),
}

/// The bytes of an answer and their encoding.
///
/// # Errors
/// When a parameter of the query is not valid, or the answer cannot be encoded.
fn compose(
    answer: ComposedAnswer,
    query: &Query,
    seq: u64,
    shared: &Shared,
) -> Result<(Vec<u8>, Encoding), QueryError> {
    let parameters = query.parameters();
    let allowed = answer.parameters();
    // Names that begin with an underscore are Zenoh's own.
    if let Some((name, _)) =
        parameters.iter().find(|(name, _)| !name.starts_with('_') && !allowed.contains(name))
    {
        return Err(QueryError::UnknownParameter { name: name.to_owned(), allowed });
    }
    let encoding = match parameters.get("format") {
        None | Some("json") => Encoding::Json,
        Some("cbor") => Encoding::Cbor,
        Some(other) => return Err(QueryError::UnknownFormat { format: other.to_owned() }),
    };
    let bytes = match answer {
        ComposedAnswer::Meta => {
            to_bytes(&with_head(ComposedAnswer::Meta, seq, shared, &meta::describe(shared)), encoding)?
        }
        ComposedAnswer::Status => {
            let names = shared.names();
            let (mode, residual) = {
                let data = shared.data();
                (data.mode.map(|mode| mode.name()), ResidualStatus::of(&data))
            };
            let stats = shared.stats();
            let status = Status { damper: &shared.damper, mode, model: &names.free, residual, stats };
            to_bytes(&with_head(ComposedAnswer::Status, seq, shared, &status), encoding)?
        }
        ComposedAnswer::History => history(query, seq, encoding, shared)?,
    };
    Ok((bytes, encoding))
}

fn history(query: &Query, seq: u64, encoding: Encoding, shared: &Shared) -> Result<Vec<u8>, QueryError> {
    let parameters = query.parameters();
    let now_ns = shared.clock.nanos_at(Instant::now());
    let range = match parameters.get("_time") {
        Some(text) => TimeRange::parse(text, now_ns)?,
        None => TimeRange::ALL,
    };
    let max = match parameters.get("max") {
        None => CAPACITY,
        Some(text) => text.parse().map_err(|_| QueryError::Max { text: text.to_owned() })?,
    };
    let excerpt = shared.data().history.excerpt(&Selection { range, max }, now_ns);
    let names = shared.names();
    let body = HistoryBody {
        history_s: shared.config.history_s,
        held: excerpt.held,
        force_estimate: excerpt.estimates.iter().map(|entry| entry.payload(&names)).collect(),
        force_residual: excerpt.residuals.iter().map(|entry| entry.payload(&names)).collect(),
    };
    Ok(to_bytes(&with_head(ComposedAnswer::History, seq, shared, &body), encoding)?)
}

/// The common first fields of an answer, followed by its body.
#[derive(Serialize)]
struct AnswerBody<'a, T> {
    schema: String,
    seq: u64,
    stamp_ns: i64,
    validity: &'static str,
    #[serde(flatten)]
    body: &'a T,
}

#[derive(Serialize)]
struct Status<'a> {
    damper: &'a str,
    mode: Option<&'static str>,
    model: &'a str,
    /// `None` before the first residual.
    residual: Option<ResidualStatus>,
    #[serde(flatten)]
    stats: Stats,
}

/// Error of the simulation (free run), from the last residual.
#[derive(Serialize)]
struct ResidualStatus {
    stamp_ns: i64,
    windowed_rsse_n: Option<f64>,
    windowed_esr: Option<f64>,
    expected_rsse_n: Option<f64>,
    /// Windowed RMSE over the expected RMSE.
    ratio: Option<f64>,
    alarm: bool,
    /// Stamp of the sample that raised the alarm, while the alarm is active.
    alarm_since_ns: Option<i64>,
}

impl ResidualStatus {
    fn of(data: &MirrorData) -> Option<Self> {
        let residual = data.residual?;
        Some(Self {
            stamp_ns: residual.stamp.nanos(),
            windowed_rsse_n: finite(residual.windowed_rsse.get()),
            windowed_esr: finite(residual.windowed_esr),
            expected_rsse_n: finite(residual.expected_rsse.get()),
            ratio: finite(residual.windowed_rsse.get() / residual.expected_rsse.get()),
            alarm: residual.alarm,
            alarm_since_ns: data.alarm.map(|alarm| alarm.stamp.nanos()),
        })
    }
}

#[derive(Serialize)]
struct HistoryBody<'a> {
    history_s: f64,
    held: Extent,
    force_estimate: Vec<Payload<'a>>,
    force_residual: Vec<Payload<'a>>,
}

fn with_head<'a, T>(answer: ComposedAnswer, seq: u64, shared: &Shared, body: &'a T) -> AnswerBody<'a, T> {
    AnswerBody {
        schema: format!("mr-damper/zenoh-{}/1", answer.name()),
        seq,
        stamp_ns: shared.clock.nanos_at(Instant::now()),
        validity: shared.data().validity.name(),
        body,
    }
}

fn to_bytes(answer: &impl Serialize, encoding: Encoding) -> Result<Vec<u8>, EncodeError> {
    if encoding == Encoding::Json {
        return Ok(serde_json::to_vec(answer)?);
    }
    let mut bytes = Vec::new();
    ciborium::into_writer(answer, &mut bytes)?;
    Ok(bytes)
}
