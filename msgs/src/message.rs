//! Traits of message, service and action types, with their names, definitions and type hashes.

use std::fmt::Debug;

use serde::{Serialize, de::DeserializeOwned};

/// A ROS 2 message type: its names, its definition and its type hash.
///
/// The parts of services and actions (`LoadModel_Request`) are messages too.
pub trait Message:
    Serialize + DeserializeOwned + Clone + Debug + Default + PartialEq + Send + 'static
{
    /// The package: `mr_damper_msgs`.
    const PACKAGE: &'static str;
    /// The name inside the package: `ForceEstimate`.
    const NAME: &'static str;
    /// The ROS type: `mr_damper_msgs/msg/ForceEstimate`.
    const TYPE: &'static str;
    /// The DDS type: `mr_damper_msgs::msg::dds_::ForceEstimate_`.
    const DDS_TYPE: &'static str;
    /// The definition followed by the definitions of all nested types, in the form of rosbag2 and MCAP
    /// (`ros2msg`).
    const DEFINITION: &'static str;
    /// The type hash of REP-2016: `RIHS01_` and 64 hexadecimal digits. Tests compare it with [`crate::rihs01`].
    const TYPE_HASH: &'static str;
}

/// A ROS 2 service type.
pub trait Service {
    /// Message that the client sends.
    type Request: Message;
    /// Message that the server returns.
    type Response: Message;
    /// The package: `mr_damper_msgs`.
    const PACKAGE: &'static str;
    /// The name inside the package: `LoadModel`.
    const NAME: &'static str;
    /// The ROS type: `mr_damper_msgs/srv/LoadModel`.
    const TYPE: &'static str;
    /// The type hash of REP-2016, over request, response and service event.
    const TYPE_HASH: &'static str;
}

/// A ROS 2 action type.
pub trait Action {
    /// Message by which the client starts the action.
    type Goal: Message;
    /// Message that the server sends at the end.
    type Result: Message;
    /// Message that the server sends while the action runs.
    type Feedback: Message;
    /// The package: `mr_damper_msgs`.
    const PACKAGE: &'static str;
    /// The name inside the package: `CloseLoop`.
    const NAME: &'static str;
    /// The ROS type: `mr_damper_msgs/action/CloseLoop`.
    const TYPE: &'static str;
}

/// The constants of a [`Message`] as a value, for tables of types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Descriptor {
    /// [`Message::PACKAGE`].
    pub package: &'static str,
    /// [`Message::NAME`].
    pub name: &'static str,
    /// [`Message::TYPE`].
    pub type_name: &'static str,
    /// [`Message::DDS_TYPE`].
    pub dds_type_name: &'static str,
    /// [`Message::DEFINITION`].
    pub definition: &'static str,
    /// [`Message::TYPE_HASH`].
    pub type_hash: &'static str,
}

impl Descriptor {
    /// The descriptor of one message type.
    #[must_use]
    pub const fn of<M: Message>() -> Self {
        Self {
            package: M::PACKAGE,
            name: M::NAME,
            type_name: M::TYPE,
            dds_type_name: M::DDS_TYPE,
            definition: M::DEFINITION,
            type_hash: M::TYPE_HASH,
        }
    }
}

/// Implements [`Message`] for a type: `message!(Type, package / folder / Name, hash, definition)`.
macro_rules! message {
    ($type:ty, $package:literal / $folder:literal / $name:literal, $hash:literal, $definition:expr) => {
        impl $crate::Message for $type {
            const PACKAGE: &'static str = $package;
            const NAME: &'static str = $name;
            const TYPE: &'static str = concat!($package, "/", $folder, "/", $name);
            const DDS_TYPE: &'static str = concat!($package, "::", $folder, "::dds_::", $name, "_");
            const DEFINITION: &'static str = $definition;
            const TYPE_HASH: &'static str = concat!("RIHS01_", $hash);
        }
    };
}
pub(crate) use message;

/// A [`Service`] type: `service! { /// doc. \n Name("package", "hash"): Request => Response }`.
macro_rules! service {
    ($(#[$doc:meta])* $name:ident($package:literal, $hash:literal): $request:ty => $response:ty) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $name;

        impl $crate::Service for $name {
            type Request = $request;
            type Response = $response;
            const PACKAGE: &'static str = $package;
            const NAME: &'static str = stringify!($name);
            const TYPE: &'static str = concat!($package, "/srv/", stringify!($name));
            const TYPE_HASH: &'static str = concat!("RIHS01_", $hash);
        }
    };
}
pub(crate) use service;

/// One of the `---` separated parts of a service or action definition, counted from zero.
pub(crate) const fn section(text: &'static str, index: usize) -> &'static str {
    let bytes = text.as_bytes();
    let (mut start, mut at, mut part) = (0, 0, 0);
    while at + 4 <= bytes.len() {
        let separator =
            bytes[at] == b'-' && bytes[at + 1] == b'-' && bytes[at + 2] == b'-' && bytes[at + 3] == b'\n';
        if separator && (at == 0 || bytes[at - 1] == b'\n') {
            if part == index {
                return text.split_at(at).0.split_at(start).1;
            }
            part += 1;
            start = at + 4;
            at = start;
        } else {
            at += 1;
        }
    }
    // Evaluated when the crate is built: a definition with too few parts does not compile.
    assert!(part == index, "the definition has fewer parts than asked for");
    text.split_at(start).1
}

#[cfg(test)]
mod tests {
    use super::section;

    #[test]
    fn a_definition_is_cut_at_its_separators() {
        let text = "# a --- b\nbool x\n---\n---\nstring z\n";
        assert_eq!(section(text, 0), "# a --- b\nbool x\n");
        assert_eq!(section(text, 1), "");
        assert_eq!(section(text, 2), "string z\n");
    }

    #[test]
    #[should_panic(expected = "fewer parts")]
    fn a_missing_part_is_noticed() {
        section("bool x\n---\nbool y\n", 2);
    }
}
