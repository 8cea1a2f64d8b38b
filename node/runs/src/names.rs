//! Topic names: the column of a run that a topic holds, and the topic that a column is written to.

use super::column::Quantity;

/// Last part of the topics of known quantities. The set point has no topic of its own; it is written as `other/setpoint_m`.
pub(super) const TOPICS: [(Quantity, &str); 9] = [
    (Quantity::Displacement, "displacement"),
    (Quantity::Velocity, "velocity"),
    (Quantity::Force, "measured_force"),
    (Quantity::Current, "coil_current"),
    (Quantity::Command, "command_voltage"),
    (Quantity::CaseTemperature, "case_temperature"),
    (Quantity::BodyVelocity, "body_velocity"),
    (Quantity::ForceRequest, "force_request"),
    (Quantity::AmbientTemperature, "ambient_temperature"),
];

/// The level below the namespace that holds unknown columns.
const OTHER: &str = "other";

/// Last part of the topics with states of joints.
const JOINTS: &str = "joint_states";

/// Name of a channel in a map: the name of the node's topic.
pub(super) fn topic_of(quantity: Quantity) -> &'static str {
    TOPICS.iter().find(|(known, _)| *known == quantity).map_or("setpoint", |(_, topic)| topic)
}

/// The content of a topic, according to its name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Role {
    Known(Quantity),
    /// A column that is carried through.
    Other(String),
    /// Positions, velocities and efforts of joints.
    Joints,
}

/// The namespace (empty for the root) and the role of a topic; `None` if it does not belong to a run.
pub(super) fn role_of(topic: &str) -> Option<(&str, Role)> {
    let (namespace, name) = topic.rsplit_once('/')?;
    if let Some((quantity, _)) = TOPICS.iter().find(|(_, topic)| *topic == name) {
        return Some((namespace, Role::Known(*quantity)));
    }
    if name == JOINTS {
        return Some((namespace, Role::Joints));
    }
    let (above, level) = namespace.rsplit_once('/')?;
    (level == OTHER && !name.is_empty()).then(|| (above, Role::Other(name.to_owned())))
}

/// Gives each column a topic name of its own.
pub(super) struct Namer {
    namespace: String,
    taken: Vec<String>,
}

impl Namer {
    /// A namer for topics below `namespace`, which may have slashes around it.
    pub(super) fn new(namespace: &str) -> Self {
        // A column that has the name of a known topic must not be read as that topic.
        let known = TOPICS.iter().map(|(_, topic)| *topic).chain([JOINTS]);
        Self { namespace: normal_namespace(namespace), taken: known.map(str::to_owned).collect() }
    }

    /// The topic of a column, and whether its name differs from the column's. If it does, the column's name must be stored.
    pub(super) fn topic_of(&mut self, column: &str) -> (String, bool) {
        let quantity = Quantity::of_si_name(column);
        if let Some((_, name)) = TOPICS.iter().find(|(known, _)| Some(*known) == quantity) {
            return (format!("{}/{name}", self.namespace), false);
        }
        let allowed = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        let mut name: String = column.chars().map(allowed).collect();
        // ROS 2 allows neither a leading digit nor an empty name.
        if !name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
            name.insert(0, '_');
        }
        let plain = name.clone();
        for number in 2.. {
            if !self.taken.contains(&name) {
                break;
            }
            name = format!("{plain}_{number}");
        }
        self.taken.push(name.clone());
        let differs = name != column;
        (format!("{}/{OTHER}/{name}", self.namespace), differs)
    }
}

/// A namespace as it begins topic names: with a leading slash and without a trailing one; empty for the root.
pub(super) fn normal_namespace(namespace: &str) -> String {
    let inner = namespace.trim_matches('/');
    if inner.is_empty() { String::new() } else { format!("/{inner}") }
}

/// True for an absolute topic name that ROS 2 accepts.
pub(super) fn is_topic_name(name: &str) -> bool {
    name.strip_prefix('/').is_some_and(|rest| rest.split('/').all(is_token))
}

/// True for `package/msg/Type`.
pub(super) fn is_type_name(name: &str) -> bool {
    let mut parts = name.split('/');
    parts.by_ref().take(3).filter(|part| is_token(part)).count() == 3 && parts.next().is_none()
}

fn is_token(token: &str) -> bool {
    token.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && token.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_map_to_topics_and_back() {
        let mut namer = Namer::new("front_left/");
        for (column, topic) in [
            ("force_n", "/front_left/measured_force"),
            ("setpoint_m", "/front_left/other/setpoint_m"),
            ("Pump [bar]", "/front_left/other/Pump__bar_"),
            ("Pump (bar)", "/front_left/other/Pump__bar__2"),
            ("2nd", "/front_left/other/_2nd"),
            ("velocity", "/front_left/other/velocity_2"),
            ("joint_states", "/front_left/other/joint_states_2"),
        ] {
            let (name, _) = namer.topic_of(column);
            assert_eq!(name, topic);
            assert!(is_topic_name(&name));
            assert_eq!(role_of(&name).map(|(namespace, _)| namespace), Some("/front_left"));
        }
        assert_eq!(role_of("/measured_force"), Some(("", Role::Known(Quantity::Force))));
        assert_eq!(role_of("/a/other/x"), Some(("/a", Role::Other("x".into()))));
        assert_eq!(role_of("/rosout"), None);
    }

    #[test]
    fn only_ros_names_are_accepted() {
        for (name, good) in
            [("/a", true), ("/a/b_1", true), ("a", false), ("/", false), ("/a/", false), ("/1a", false)]
        {
            assert_eq!(is_topic_name(name), good, "{name}");
        }
        for (name, good) in [("a/msg/B", true), ("a/B", false), ("a/msg/B/c", false), ("a/msg/B: 1", false)] {
            assert_eq!(is_type_name(name), good, "{name}");
        }
    }
}
