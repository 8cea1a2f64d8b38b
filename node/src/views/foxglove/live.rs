//! Passes received messages to the Foxglove endpoint, with all their digits and at their full rate.

use mr_damper_base::clock::system_now;
use mr_damper_views::foxglove::{ChannelId, Channels};
use mr_damper_views::watch::{DamperMessage, TOPICS, type_of};
use std::collections::HashMap;
use std::sync::Arc;

/// Publishes what a watcher receives.
pub struct LiveFeed {
    channels: Arc<Channels>,
    by_topic: HashMap<String, ChannelId>,
    /// Reused for encoding.
    buffer: Vec<u8>,
}

impl LiveFeed {
    /// A feed without channels. With `has_parameters` viewers may ask for the parameters of nodes.
    #[must_use]
    pub fn new(has_parameters: bool) -> Self {
        // A viewer that reconnects recognises by it whether this is still the same process.
        let session = system_now().nanos().to_string();
        let channels = Arc::new(Channels::live(session, has_parameters));
        Self { channels, by_topic: HashMap::new(), buffer: Vec::new() }
    }

    /// The channels, for the server.
    #[must_use]
    pub fn channels(&self) -> &Arc<Channels> {
        &self.channels
    }

    /// Advertises a topic that is subscribed to: its full name, and its name in the node.
    pub fn announce(&mut self, topic: &str, in_node: &str) {
        if self.by_topic.contains_key(topic) {
            return;
        }
        if let Some(descriptor) = type_of(in_node) {
            let id = self.channels.add(topic, descriptor);
            self.by_topic.insert(topic.to_owned(), id);
        }
    }

    /// Publishes a message that was received on `topic`. Its log time is the stamp in its header.
    pub fn take(&mut self, topic: &str, message: &DamperMessage) {
        // A topic of the Zenoh mirror is known once a sample arrives.
        self.announce(topic, TOPICS[message.topic()]);
        let Some(id) = self.by_topic.get(topic).copied() else { return };
        // A change of mode is rare, and late joiners get the last one, as on ROS.
        let is_state = matches!(message, DamperMessage::Mode(_));
        if !is_state && !self.channels.is_wanted(id) {
            return;
        }
        if let Err(error) = message.write_cdr(&mut self.buffer) {
            tracing::error!(topic, %error, "a message cannot be written for viewers; please report this as a bug");
            return;
        }
        let stamp_ns = message.header().stamp.as_nanos();
        if is_state {
            self.channels.publish_kept(id, stamp_ns, &self.buffer);
        } else {
            self.channels.publish(id, stamp_ns, &self.buffer);
        }
    }
}
