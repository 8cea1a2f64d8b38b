//! Watches dampers over ROS: subscribes to all inputs and outputs of dampers.
//!
//! Dampers are given by name, or found: every publisher of `force_estimate` in the domain is one, also if it appears later. The
//! subscriptions are best effort, so that no publisher waits for them.

use super::source::Seen;
use crate::process::files;
use crate::ros2::participant::{DdsThreadEnded, Ros};
use crate::settings::config::{Config, RosArgs};
use crate::settings::error::NodeError;
use mr_damper_msgs::Message;
use mr_damper_views::watch::discovery::{self, MARKER_TOPIC};
use mr_damper_views::watch::{DamperMessage, DamperRegistry, MOST_DAMPERS};
use ros2_client::{NodeOptions, Subscription};

/// Interval at which the domain is searched for dampers, s.
const SEARCH_EVERY_S: f64 = 1.0;

/// Subscriptions to all topics of the watched dampers.
pub struct RosWatcher {
    ros: Ros,
    args: RosArgs,
    /// True when dampers are searched for, false when they were given by name.
    finds: bool,
    searched_s: f64,
    dampers: Vec<WatchedDamper>,
    /// Namespaces that are ignored, because their dampers are watched elsewhere.
    ignored: Vec<String>,
    /// True after a warning that there are more dampers than can be watched.
    is_full: bool,
}

/// The subscriptions of one damper.
struct WatchedDamper {
    name: String,
    namespace: String,
    readers: Vec<Box<dyn MessageReader + Send>>,
}

impl RosWatcher {
    /// Joins the domain as the node named `name` and subscribes to the topics of the dampers in the namespaces `names`. If `names` is
    /// empty, it subscribes to all dampers that are found in the node's namespace or below it.
    ///
    /// # Errors
    /// When ROS does not start, or a name is invalid.
    pub fn start(config: &Config, args: &RosArgs, name: &str, names: &[String]) -> Result<Self, NodeError> {
        let namespaces = names.iter().map(|name| namespace_of(args, name)).collect::<Result<Vec<_>, _>>()?;
        files::allow(names.len().max(4));
        let ros = Ros::start(config, args, NodeOptions::new().enable_rosout(false), name)?;
        let mut source = Self::over(ros, args, names.is_empty());
        for namespace in namespaces {
            let name = name_of(&namespace);
            source.add(name, namespace)?;
        }
        Ok(source)
    }

    /// Joins the domain as the node named `name` and subscribes only to the topics of the damper in the namespace of `args`. Its
    /// view gets the name `label`.
    ///
    /// # Errors
    /// When ROS does not start.
    pub fn start_one(config: &Config, args: &RosArgs, name: &str, label: &str) -> Result<Self, NodeError> {
        let ros = Ros::start(config, args, NodeOptions::new().enable_rosout(false), name)?;
        let mut source = Self::over(ros, args, false);
        source.add(label.to_owned(), args.namespace())?;
        Ok(source)
    }

    fn over(ros: Ros, args: &RosArgs, finds: bool) -> Self {
        Self {
            ros,
            args: args.clone(),
            finds,
            searched_s: f64::NEG_INFINITY,
            dampers: Vec::new(),
            ignored: Vec::new(),
            is_full: false,
        }
    }

    /// Ignores the damper in `namespace`.
    pub fn ignore(&mut self, namespace: &str) {
        self.ignored.push(namespace.to_owned());
    }

    /// Names and namespaces of the watched dampers.
    pub fn watched(&self) -> impl ExactSizeIterator<Item = (&str, &str)> {
        self.dampers.iter().map(|damper| (damper.name.as_str(), damper.namespace.as_str()))
    }

    /// Subscribes to the topics of new dampers, once a second, and adds them to `registry`.
    ///
    /// # Errors
    /// When a subscription fails.
    pub fn discover(&mut self, registry: &mut DamperRegistry, now_s: f64) -> Result<(), NodeError> {
        if now_s - self.searched_s < SEARCH_EVERY_S {
            return Ok(());
        }
        self.searched_s = now_s;
        if self.finds {
            for namespace in self.found() {
                self.add(name_of(&namespace), namespace)?;
            }
        }
        self.dampers.iter().for_each(|damper| registry.add(&damper.name));
        Ok(())
    }

    /// Namespaces of new dampers, which are not watched yet.
    fn found(&self) -> Vec<String> {
        let mut found = discovery::namespaces(self.ros.published(), &self.args.namespace());
        found.retain(|namespace| {
            self.dampers.iter().all(|damper| damper.namespace != *namespace)
                && !self.ignored.contains(namespace)
        });
        found
    }

    fn add(&mut self, name: String, namespace: String) -> Result<(), NodeError> {
        if self.dampers.len() >= MOST_DAMPERS {
            if !self.is_full {
                tracing::warn!(
                    namespace,
                    "there are more than {MOST_DAMPERS} dampers, so not all are watched; select dampers with --dampers"
                );
                self.is_full = true;
            }
            return Ok(());
        }
        let args = self.args.below(&namespace);
        let readers = subscribe_all(&mut self.ros, &|topic| args.topic(topic))?;
        tracing::info!(damper = name, topic = args.topic(MARKER_TOPIC), "watching");
        self.dampers.push(WatchedDamper { name, namespace, readers });
        Ok(())
    }

    /// The node that subscribes.
    pub fn ros_mut(&mut self) -> &mut Ros {
        &mut self.ros
    }

    /// Full names of all topics that are subscribed to, with the names that they have in the node.
    pub fn topics(&self) -> impl Iterator<Item = (&str, &'static str)> {
        self.dampers.iter().flat_map(|damper| damper.readers.iter().map(|reader| reader.topic()))
    }

    /// Records all received messages in `registry`, and shows each to `seen`, with the full name of its topic.
    pub fn drain(&self, registry: &mut DamperRegistry, now_s: f64, seen: Seen<'_>) {
        for damper in &self.dampers {
            if let Some(view) = registry.view(&damper.name) {
                damper.readers.iter().for_each(|reader| {
                    while let Some(received) = reader.take() {
                        match received {
                            Some(message) => {
                                seen(reader.topic().0, &message);
                                view.take(message, now_s);
                            }
                            None => view.note_unreadable(),
                        }
                    }
                });
            }
        }
    }

    /// Checks that the ROS node is still running.
    ///
    /// # Errors
    /// Errors of [`Ros::check`].
    pub fn check(&self) -> Result<(), DdsThreadEnded> {
        self.ros.check()
    }

    /// Leaves the domain.
    pub fn stop(self) {
        let Self { ros, dampers, .. } = self;
        drop(dampers);
        ros.stop();
    }
}

/// The namespace of the damper named `name`, below the namespace of the process.
fn namespace_of(args: &RosArgs, name: &str) -> Result<String, NodeError> {
    let is_word = |word: &str| {
        word.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    let path = name.trim_matches('/');
    if path.split('/').all(is_word) {
        Ok(format!("{}/{path}", args.namespace().trim_end_matches('/')))
    } else {
        Err(NodeError::Usage(format!(
            "--dampers: \"{name}\" is not a namespace; use letters, digits and _, for example --dampers front_left,front_right"
        )))
    }
}

/// The name of the damper in `namespace`, equal to its name on Zenoh.
fn name_of(namespace: &str) -> String {
    match namespace.trim_matches('/') {
        "" => RosArgs::default().node_name().to_owned(),
        path => path.to_owned(),
    }
}

/// A subscription to a topic of any type.
trait MessageReader {
    /// The next received message; `Some(None)` for a message that could not be read.
    fn take(&self) -> Option<Option<DamperMessage>>;
    /// The full name of the topic, and its name in the node.
    fn topic(&self) -> (&str, &'static str);
}

struct TypedReader<M: Message> {
    topic: String,
    /// Name of the topic in the node.
    in_node: &'static str,
    subscription: Subscription<M>,
    convert: fn(M) -> DamperMessage,
}

impl<M: Message> MessageReader for TypedReader<M> {
    fn take(&self) -> Option<Option<DamperMessage>> {
        match self.subscription.take() {
            Ok(taken) => taken.map(|(message, _)| Some((self.convert)(message))),
            Err(error) => {
                tracing::debug!(topic = self.topic, %error, "cannot read a message");
                Some(None)
            }
        }
    }

    fn topic(&self) -> (&str, &'static str) {
        (&self.topic, self.in_node)
    }
}

/// Subscriptions to all inputs and outputs of a node. Inputs come first, because an estimate is newer than its inputs.
fn subscribe_all(
    ros: &mut Ros,
    topic: &dyn Fn(&str) -> String,
) -> Result<Vec<Box<dyn MessageReader + Send>>, NodeError> {
    fn subscribe<M: Message>(
        ros: &mut Ros,
        topic: &dyn Fn(&str) -> String,
        in_node: &'static str,
        convert: fn(M) -> DamperMessage,
    ) -> Result<Box<dyn MessageReader + Send>, NodeError> {
        let topic = topic(in_node);
        let subscription = ros.subscribe::<M>(&topic)?;
        Ok(Box::new(TypedReader { topic, in_node, subscription, convert }))
    }
    Ok(vec![
        subscribe(ros, topic, "displacement", DamperMessage::Displacement)?,
        subscribe(ros, topic, "coil_current", DamperMessage::CoilCurrent)?,
        subscribe(ros, topic, "command_voltage", DamperMessage::CommandVoltage)?,
        subscribe(ros, topic, "velocity", DamperMessage::Velocity)?,
        subscribe(ros, topic, "measured_force", DamperMessage::MeasuredForce)?,
        subscribe(ros, topic, "case_temperature", DamperMessage::CaseTemperature)?,
        subscribe(ros, topic, "force_request", DamperMessage::ForceRequest)?,
        subscribe(ros, topic, "body_velocity", DamperMessage::BodyVelocity)?,
        subscribe(ros, topic, MARKER_TOPIC, DamperMessage::Estimate)?,
        subscribe(ros, topic, "force_residual", DamperMessage::Residual)?,
        subscribe(ros, topic, "current_command", DamperMessage::Command)?,
        subscribe(ros, topic, "mode", DamperMessage::Mode)?,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_damper_is_named_by_its_namespace() {
        let vehicle = RosArgs::in_namespace("/car");
        let of = |args: &RosArgs, name: &str| namespace_of(args, name).map_err(|error| error.to_string());
        assert_eq!(of(&RosArgs::default(), "front_left").as_deref(), Ok("/front_left"));
        assert_eq!(of(&vehicle, "/front/left/").as_deref(), Ok("/car/front/left"));
        for bad in ["", "/", "front-left", "a b", "9a", "a//b"] {
            let refused = of(&vehicle, bad).expect_err(bad);
            assert!(refused.contains(&format!("\"{bad}\" is not a namespace")), "{refused}");
        }
        assert_eq!([name_of("/car/left"), name_of("")], ["car/left", "mr_damper"]);
    }
}
