//! Parameters that override the QoS of a topic, as rclcpp names and types them.
//!
//! ```yaml
//! qos_overrides:
//!   /force_estimate:            # the full name, after remapping
//!     publisher:                # or subscription
//!       reliability: best_effort
//! ```
//!
//! | policy | values |
//! |---|---|
//! | `reliability` | `reliable`, `best_effort` |
//! | `durability` | `volatile`, `transient_local` |
//! | `history` | `keep_last` |
//! | `depth` | 1 to 65536 |
//! | `deadline`, `liveliness_lease_duration`; for publishers also `lifespan` | nanoseconds; 9223372036854775807: no limit |
//! | `liveliness` | `automatic` |
//! | `avoid_ros_namespace_conventions` | false |
//!
//! `system_default` keeps the node's own value. The node refuses values that it or the DDS library cannot provide:
//! `keep_all` (the node's memory is bounded), `manual_by_topic` (the node does not assert liveliness manually) and
//! `best_available` (it depends on the peers that are present). Overrides are set at the start; peers can read them as
//! parameters.

use super::{RosArgs, Value};
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use ros2_client::qos::{Durability, History, QosProfile, Reliability, WhenFull};
use std::collections::BTreeMap;
use std::time::Duration;

/// The prefix of these parameters' names.
pub const PREFIX: &str = "qos_overrides.";
/// The largest depth of history.
const DEEPEST: i64 = 65_536;

/// Topics of a damper's node, by their names in the node.
const PUBLISHED: [&str; 8] = [
    "force_estimate",
    "force_residual",
    "current_command",
    "mode",
    "/diagnostics",
    "/rosout",
    "/parameter_events",
    "~/transition_event",
];
const SUBSCRIBED: [&str; 9] = [
    "displacement",
    "velocity",
    "coil_current",
    "command_voltage",
    "measured_force",
    "force_request",
    "body_velocity",
    "case_temperature",
    "/clock",
];

/// A side of a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum End {
    /// The node publishes.
    Publisher,
    /// The node subscribes.
    Subscription,
}

impl End {
    /// The word in a parameter's name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Publisher => "publisher",
            Self::Subscription => "subscription",
        }
    }
}

/// A QoS policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Policy {
    /// Whether lost messages are sent again.
    Reliability,
    /// Whether late joiners get the last messages.
    Durability,
    /// The rule for the messages that are kept.
    History,
    /// How many messages are kept.
    Depth,
    /// The longest time between two messages.
    Deadline,
    /// How long a message stays valid.
    Lifespan,
    /// How the node shows that it is alive.
    Liveliness,
    /// How long the node may fail to show it.
    LeaseDuration,
    /// Whether the topic's name in DDS differs from its ROS name.
    AvoidRosNames,
}

impl Policy {
    const ALL: [Self; 9] = [
        Self::Reliability,
        Self::Durability,
        Self::History,
        Self::Depth,
        Self::Deadline,
        Self::Lifespan,
        Self::Liveliness,
        Self::LeaseDuration,
        Self::AvoidRosNames,
    ];

    const fn name(self) -> &'static str {
        match self {
            Self::Reliability => "reliability",
            Self::Durability => "durability",
            Self::History => "history",
            Self::Depth => "depth",
            Self::Deadline => "deadline",
            Self::Lifespan => "lifespan",
            Self::Liveliness => "liveliness",
            Self::LeaseDuration => "liveliness_lease_duration",
            Self::AvoidRosNames => "avoid_ros_namespace_conventions",
        }
    }

    /// Lifespan applies to publishers only, as in rclcpp.
    const fn is_of(self, end: End) -> bool {
        !matches!((self, end), (Self::Lifespan, End::Subscription))
    }

    /// The allowed values, as text, with the reason for refused ones.
    #[must_use]
    pub const fn expected(self) -> &'static str {
        match self {
            Self::Reliability => {
                "reliable, best_effort or system_default; best_available would depend on the peers that are present at the start, so name one"
            }
            Self::Durability => {
                "volatile, transient_local or system_default; best_available would depend on the peers that are present at the start, so name one"
            }
            Self::History => {
                "keep_last or system_default; with keep_all, one slow reader could fill the memory, so give a depth"
            }
            Self::Depth => "a whole number from 1 to 65536",
            Self::Deadline | Self::Lifespan | Self::LeaseDuration => {
                "a whole number of nanoseconds above 0; 9223372036854775807 means no limit"
            }
            Self::Liveliness => {
                "automatic or system_default; this node does not assert liveliness manually, so it would look dead with manual_by_topic"
            }
            Self::AvoidRosNames => "false: this node's topics use the ROS naming convention",
        }
    }

    fn takes(self, value: &Value) -> bool {
        let one_of = |texts: &[&str]| matches!(value, Value::Text(text) if texts.contains(&text.as_str()));
        match self {
            Self::Reliability => one_of(&["reliable", "best_effort", "system_default"]),
            Self::Durability => one_of(&["volatile", "transient_local", "system_default"]),
            Self::History => one_of(&["keep_last", "system_default"]),
            Self::Depth => matches!(value, Value::Integer(1..=DEEPEST)),
            Self::Deadline | Self::Lifespan | Self::LeaseDuration => matches!(value, Value::Integer(1..)),
            Self::Liveliness => one_of(&["automatic", "system_default"]),
            Self::AvoidRosNames => *value == Value::Bool(false),
        }
    }

    fn apply(self, value: &Value, qos: &mut QosProfile) {
        match (self, value) {
            (Self::Reliability, Value::Text(text)) if text == "best_effort" => {
                qos.reliability = Reliability::BestEffort;
            }
            // If the node is reliable by default, nothing changes.
            (Self::Reliability, Value::Text(text))
                if text == "reliable" && qos.reliability == Reliability::BestEffort =>
            {
                qos.reliability = Reliability::Reliable { when_full: WhenFull::DEFAULT };
            }
            (Self::Durability, Value::Text(text)) if text == "volatile" => {
                qos.durability = Durability::Volatile;
            }
            (Self::Durability, Value::Text(text)) if text == "transient_local" => {
                qos.durability = Durability::TransientLocal;
            }
            (Self::Depth, Value::Integer(depth)) => {
                // The range was checked before.
                let depth = usize::try_from(*depth).unwrap_or(1);
                qos.history = History::KeepLast { depth };
            }
            (Self::Deadline, Value::Integer(nanos)) => qos.deadline = duration(*nanos),
            (Self::Lifespan, Value::Integer(nanos)) => qos.lifespan = duration(*nanos),
            (Self::LeaseDuration, Value::Integer(nanos)) => qos.liveliness_lease = duration(*nanos),
            // For the other policies, the only accepted value is the node's own.
            _ => {}
        }
    }
}

/// A duration of `nanos` nanoseconds; `None` (no limit) for the maximum.
fn duration(nanos: i64) -> Option<Duration> {
    u64::try_from(nanos).ok().filter(|_| nanos < i64::MAX).map(Duration::from_nanos)
}

/// A topic, one of its sides and a policy, as a parameter names them.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    topic: String,
    end: End,
    policy: Policy,
}

impl Key {
    /// # Errors
    /// When `name` does not name such a parameter.
    fn parse(name: &str) -> Result<Self, NodeError> {
        let refused = |expected: String| NodeError::Parameter {
            name: name.to_owned(),
            value: "set".to_owned(),
            expected,
        };
        let form = || "named qos_overrides.<full topic name>.<publisher or subscription>.<policy>".to_owned();
        let mut parts = name.strip_prefix(PREFIX).ok_or_else(|| refused(form()))?.rsplitn(3, '.');
        let (policy, end, topic) = match (parts.next(), parts.next(), parts.next()) {
            (Some(policy), Some(end), Some(topic)) if topic.starts_with('/') => (policy, end, topic),
            _ => return Err(refused(form())),
        };
        let end = match end {
            "publisher" => End::Publisher,
            "subscription" => End::Subscription,
            _ => return Err(refused(form())),
        };
        let policies = || Policy::ALL.into_iter().filter(|policy| policy.is_of(end));
        let known = policies().find(|known| known.name() == policy).ok_or_else(|| {
            let names: Vec<_> = policies().map(Policy::name).collect();
            refused(format!("of a {}'s policies: {}", end.name(), names.join(", ")))
        })?;
        Ok(Self { topic: topic.to_owned(), end, policy: known })
    }

    fn name(&self) -> String {
        format!("{PREFIX}{}.{}.{}", self.topic, self.end.name(), self.policy.name())
    }
}

/// The overrides that are set.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Overrides {
    values: BTreeMap<Key, Value>,
    /// The existing topics, used while parameters are read; if empty, any topic is accepted.
    topics: Vec<(End, String)>,
}

impl Overrides {
    /// No overrides yet. Only overrides for topics of the nodes with these arguments are accepted.
    #[must_use]
    pub fn of_nodes<'a>(nodes: impl IntoIterator<Item = &'a RosArgs>) -> Self {
        let ends = |args: &RosArgs| {
            let published = PUBLISHED.map(|name| (End::Publisher, args.topic(name)));
            let subscribed = SUBSCRIBED.map(|name| (End::Subscription, args.topic(name)));
            published.into_iter().chain(subscribed).collect::<Vec<_>>()
        };
        Self { values: BTreeMap::new(), topics: nodes.into_iter().flat_map(ends).collect() }
    }

    /// True if `name` names such a parameter.
    #[must_use]
    pub fn are_meant(name: &str) -> bool {
        name.starts_with(PREFIX)
    }

    /// Sets the parameter called `name`.
    ///
    /// # Errors
    /// When it names no policy, or its value is not supported; [`NodeError::UnknownParameter`] for a topic that these
    /// nodes do not have.
    pub fn set(&mut self, name: &str, value: &Value) -> Result<(), NodeError> {
        let key = Key::parse(name).map_err(|error| self.of_another(name).unwrap_or(error))?;
        if let Some(error) = self.of_another(name) {
            return Err(error);
        }
        if !key.policy.takes(value) {
            return Err(NodeError::Parameter {
                name: name.to_owned(),
                value: value.to_string(),
                expected: key.policy.expected().to_owned(),
            });
        }
        self.values.insert(key, value.clone());
        Ok(())
    }

    /// The error for a topic that none of the nodes has on that side; it contains the nearest name.
    fn of_another(&self, name: &str) -> Option<NodeError> {
        let mut parts = name.strip_prefix(PREFIX)?.rsplitn(3, '.');
        let (policy, end, topic) = (parts.next()?, parts.next()?, parts.next()?);
        let there = |(known, full): &(End, String)| known.name() == end && full == topic;
        if self.topics.is_empty() || self.topics.iter().any(there) {
            return None;
        }
        let said = format!("{topic}.{end}");
        let likeness =
            |(end, full): &(End, String)| strsim::jaro_winkler(&format!("{full}.{}", end.name()), &said);
        let nearest = self.topics.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b)))?;
        let is_near = likeness(nearest) >= shown::ALIKE;
        Some(NodeError::UnknownParameter {
            name: name.to_owned(),
            nearest: is_near.then(|| format!("{PREFIX}{}.{}.{policy}", nearest.1, nearest.0.name())),
        })
    }

    /// Drops the list of topics: any topic is accepted from now on.
    pub fn forget_topics(&mut self) {
        self.topics.clear();
    }

    /// The value of the parameter called `name`, if it is set.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Value> {
        self.values.get(&Key::parse(name).ok()?)
    }

    /// Names of the parameters that are set.
    pub fn names(&self) -> impl Iterator<Item = String> {
        self.values.keys().map(Key::name)
    }

    /// The allowed values of the parameter called `name`, as text, if it is set.
    #[must_use]
    pub fn expected(&self, name: &str) -> Option<&'static str> {
        let key = Key::parse(name).ok()?;
        self.values.contains_key(&key).then(|| key.policy.expected())
    }

    /// `qos` of the side `end` of `topic` (full name), with its overrides applied.
    #[must_use]
    pub fn applied(&self, qos: &QosProfile, topic: &str, end: End) -> QosProfile {
        let mut changed = qos.clone();
        let mut set = Vec::new();
        for (key, value) in self.values.iter().filter(|(key, _)| key.topic == topic && key.end == end) {
            key.policy.apply(value, &mut changed);
            set.push(format!("{} = {value}", key.policy.name()));
        }
        if changed != *qos {
            tracing::info!(topic, end = end.name(), "qos_overrides sets {}", set.join(", "));
        }
        changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(overrides: &mut Overrides, name: &str, value: &str) -> Result<(), String> {
        overrides.set(name, &Value::parse(value)).map_err(|error| error.to_string())
    }

    #[test]
    fn an_override_applies_to_its_topic_and_end() {
        let mut overrides = Overrides::of_nodes([&RosArgs::in_namespace("/front")]);
        for (name, value) in [
            ("/front/force_estimate.publisher.reliability", "best_effort"),
            ("/front/force_estimate.publisher.depth", "5"),
            ("/front/force_estimate.publisher.deadline", "1000000"),
            ("/front/force_estimate.publisher.lifespan", "9223372036854775807"),
            ("/front/displacement.subscription.reliability", "reliable"),
            ("/front/displacement.subscription.durability", "transient_local"),
            ("/front/displacement.subscription.history", "system_default"),
        ] {
            set(&mut overrides, &format!("{PREFIX}{name}"), value).expect("allowed");
        }
        let own = QosProfile::publisher_default().history(History::KeepLast { depth: 1024 });
        let changed = overrides.applied(&own, "/front/force_estimate", End::Publisher);
        assert_eq!(changed.reliability, Reliability::BestEffort);
        assert_eq!(changed.history, History::KeepLast { depth: 5 });
        assert_eq!((changed.deadline, changed.lifespan), (Some(Duration::from_millis(1)), None));
        assert_eq!(overrides.applied(&own, "/front/force_estimate", End::Subscription), own);
        assert_eq!(overrides.applied(&own, "/front/force_residual", End::Publisher), own);
        let read = QosProfile::subscription_default();
        let changed = overrides.applied(&read, "/front/displacement", End::Subscription);
        assert_eq!(changed.durability, Durability::TransientLocal);
        assert_ne!(changed.reliability, Reliability::BestEffort);
        assert_eq!(changed.history, read.history);
        assert_eq!(
            overrides.get("qos_overrides./front/force_estimate.publisher.depth"),
            Some(&Value::Integer(5))
        );
    }

    #[test]
    fn an_unsupported_value_is_refused_with_the_allowed_ones() {
        let mut overrides = Overrides::of_nodes([&RosArgs::default()]);
        for (name, value, says) in [
            ("/mode.publisher.reliability", "fast", "must be reliable, best_effort"),
            ("/mode.publisher.reliability", "best_available", "so name one"),
            ("/mode.publisher.history", "keep_all", "give a depth"),
            ("/mode.publisher.depth", "0", "from 1 to 65536"),
            ("/mode.publisher.depth", "many", "is \"many\""),
            ("/mode.publisher.deadline", "0.5", "nanoseconds"),
            ("/mode.publisher.liveliness", "manual_by_topic", "automatic"),
            ("/mode.publisher.avoid_ros_namespace_conventions", "true", "must be false"),
            ("/mode.publisher.speed", "1", "policies: reliability, durability, history, depth"),
            ("/displacement.subscription.lifespan", "1", "liveliness_lease_duration"),
            ("/mode.writer.depth", "1", "/mode.publisher.depth"),
            ("mode.publisher.depth", "1", "/mode.publisher.depth"),
            ("/mode.subscription.depth", "1", "did you mean qos_overrides./"),
            (
                "/force_estimates.publisher.depth",
                "1",
                "did you mean qos_overrides./force_estimate.publisher.depth",
            ),
        ] {
            let message = set(&mut overrides, &format!("{PREFIX}{name}"), value).expect_err(name);
            assert!(message.contains(name) && message.contains(says), "{message}");
        }
        assert_eq!(overrides.names().count(), 0);
    }
}
