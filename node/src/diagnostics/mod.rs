//! What `/diagnostics` says of a running damper: a status for the node's work, one for the free run's residual.

mod residual;
mod work;

pub use residual::{ALARM_ADVICE, Health};
pub use work::Work;

use mr_damper_msgs::standard::KeyValue;

/// What a status says besides what it watches.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings<'a> {
    /// Name of the node, with its namespace.
    pub node: &'a str,
    /// The damper: the node's namespace, or empty.
    pub damper: &'a str,
    /// Name of the free-running model.
    pub model: &'a str,
    /// `residual.false_alarm_interval_s`.
    pub false_alarm_interval_s: f64,
    /// Seconds of raw input that are kept.
    pub history_s: f64,
}

fn value(key: &str, value: impl std::fmt::Display) -> KeyValue {
    KeyValue { key: key.to_owned(), value: value.to_string() }
}
