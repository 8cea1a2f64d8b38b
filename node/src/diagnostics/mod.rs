//! What `/diagnostics` says of a running damper: a status for the node's work, one for the free run's residual.

mod publishers;
mod residual;
mod work;

pub use publishers::{Publishers, publishers_advice};
pub use residual::{ALARM_ADVICE, Health};
pub use work::{CLOCK_ADVICE, Work, twin_advice};

use crate::wire::ModelNames;
use mr_damper_msgs::standard::KeyValue;

/// What a status says besides what it watches.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings<'a> {
    /// Name of the node, with its namespace.
    pub node: &'a str,
    /// The damper: the node's namespace, or empty.
    pub damper: &'a str,
    /// Names of the models.
    pub names: &'a ModelNames,
    /// `residual.false_alarm_interval_s`.
    pub false_alarm_interval_s: f64,
    /// Seconds of raw input that are kept.
    pub history_s: f64,
    /// Full name of the topic of estimates, and how many publishers of it there are in other processes.
    pub estimates: (&'a str, usize),
    /// Inputs that have more than one publisher.
    pub publishers: &'a [Publishers],
    /// Simulated time is asked for and does not come.
    pub clock_missing: bool,
}

fn value(key: &str, value: impl std::fmt::Display) -> KeyValue {
    KeyValue { key: key.to_owned(), value: value.to_string() }
}

/// What the tests of both statuses share.
#[cfg(test)]
fn around(names: &ModelNames) -> Surroundings<'_> {
    Surroundings {
        node: "/front_left/mr_damper",
        damper: "front_left",
        names,
        false_alarm_interval_s: 86_400.0,
        history_s: 120.0,
        estimates: ("/front_left/force_estimate", 0),
        publishers: &[],
        clock_missing: false,
    }
}
