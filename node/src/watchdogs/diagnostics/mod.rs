//! Statuses of a running damper on `/diagnostics`: one for the work of the node, one for the residual of the simulation
//! (free run), and one for the values of effects if they are tracked.

mod counters;
mod effects;
mod node_status;
mod publishers;
mod residual;

pub use counters::Counters;
pub use effects::effect_status;
pub use node_status::{CLOCK_ADVICE, NodeStatus, twin_advice};
pub use publishers::{Publishers, publishers_advice};
pub use residual::Health;

use crate::estimation::wire::ModelNames;
use mr_damper_msgs::standard::KeyValue;

/// Context of a status: names, settings, and findings of other parts of the node.
#[derive(Debug, Clone, Copy)]
pub struct StatusContext<'a> {
    /// Name of the node, with its namespace.
    pub node: &'a str,
    /// The damper: the node's namespace, or empty.
    pub damper: &'a str,
    /// Names of the models.
    pub names: &'a ModelNames,
    /// `residual.false_alarm_interval_s`.
    pub false_alarm_interval_s: f64,
    /// Length of the raw input that is kept, s.
    pub history_s: f64,
    /// Full name of the topic of estimates, and the number of its publishers in other processes.
    pub estimates: (&'a str, usize),
    /// Inputs that have more than one publisher.
    pub publishers: &'a [Publishers],
    /// True if simulated time is requested, but no message arrives on `/clock`.
    pub clock_missing: bool,
}

fn value(key: &str, value: impl std::fmt::Display) -> KeyValue {
    KeyValue { key: key.to_owned(), value: value.to_string() }
}

/// Context for the tests of both statuses.
#[cfg(test)]
fn context(names: &ModelNames) -> StatusContext<'_> {
    StatusContext {
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
