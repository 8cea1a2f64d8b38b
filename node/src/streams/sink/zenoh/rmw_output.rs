//! Makes the damper visible to nodes on rmw_zenoh, as a node with its outputs, in addition to the mirror's keys. Off unless
//! `zenoh.rmw` enables it.
//!
//! The messages are bit-identical to those over DDS and are published by the mirror's thread from its ring. Shared memory,
//! transient local durability and services are not supported: parameters, `load_model` and other services use DDS only.

use super::encode::{EncodeError, ros_bytes};
use super::stats::RmwCounters;
use super::topic::Topic;
use crate::estimation::frame::Frame;
use crate::estimation::wire::ModelNames;
use crate::settings::config::RosArgs;
use crate::zenoh::rmw::{Attachment, Gid, Node, Role, gid};
use crate::zenoh::session::Inner;
use mr_damper_model::pipeline::Event;
use mr_damper_msgs::{Descriptor, MESSAGES};
use std::sync::Arc;
use zenoh::bytes::Encoding;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait};

/// The published topics. Inputs are published by other nodes.
const OUTPUTS: [Topic; 4] = [Topic::ForceEstimate, Topic::ForceResidual, Topic::Mode, Topic::CurrentCommand];

/// A damper's entry in the graph of rmw_zenoh.
#[derive(Debug, Clone)]
pub struct RmwPresence {
    /// The node that others see.
    pub node: Node,
    frame: Frame,
    topics: [String; OUTPUTS.len()],
    counters: Arc<RmwCounters>,
}

impl RmwPresence {
    /// The entry of the node with these arguments in `domain`. `id` is unique in the process and comes from
    /// [`super::Link::next_entity`].
    #[must_use]
    pub fn of(args: &RosArgs, domain: u16, id: u64, frame: &Frame) -> Self {
        let namespace = args.namespace();
        Self {
            frame: frame.clone(),
            node: Node {
                domain,
                enclave: args.enclave.clone().unwrap_or_else(|| "/".to_owned()),
                namespace,
                name: args.node_name().to_owned(),
                id,
            },
            topics: OUTPUTS.map(|topic| args.topic(topic.name())),
            counters: Arc::default(),
        }
    }

    /// Counters of the messages to and from nodes on rmw_zenoh.
    #[must_use]
    pub fn counters(&self) -> Arc<RmwCounters> {
        Arc::clone(&self.counters)
    }
}

/// Declarations of a [`RmwPresence`] in a session. They end when this is dropped.
#[derive(Debug)]
pub(super) struct RmwDeclarations {
    outputs: Vec<Output>,
    frame: Frame,
    counters: Arc<RmwCounters>,
    node: LivelinessToken,
}

#[derive(Debug)]
struct Output {
    of: Topic,
    publisher: Publisher<'static>,
    token: LivelinessToken,
    gid: Gid,
    /// Number of the last sample.
    seq: i64,
}

impl RmwDeclarations {
    /// Declares the node and its outputs.
    pub(super) fn declare(session: &Session, link: &Inner, presence: &RmwPresence) -> zenoh::Result<Self> {
        let RmwPresence { node, frame, topics, counters } = presence;
        let zid = session.zid().to_string();
        let token = session.liveliness().declare_token(node.token(&zid)).wait()?;
        let mut outputs = Vec::with_capacity(OUTPUTS.len());
        for (of, topic) in OUTPUTS.into_iter().zip(topics) {
            // Every output has one, as a test below checks.
            let Some(descriptor) = descriptor(of) else { continue };
            let publisher = session
                .declare_publisher(node.key(topic, descriptor))
                .encoding(Encoding::APPLICATION_CDR)
                // The same settings as in `declarations.rs`, for the same reasons.
                .congestion_control(CongestionControl::Drop)
                .priority(Priority::DataHigh)
                .express(false)
                .wait()?;
            let token = node.endpoint(&zid, link.next_entity(), Role::Publisher, topic, descriptor);
            let gid = gid(&token);
            let token = session.liveliness().declare_token(token).wait()?;
            outputs.push(Output { of, publisher, token, gid, seq: 0 });
        }
        Ok(Self { outputs, frame: frame.clone(), counters: Arc::clone(counters), node: token })
    }

    /// Publishes `event` if it is an output, without waiting for consumers. `now_ns` is in nanoseconds since 1970.
    ///
    /// # Errors
    /// When the message was not published. The message uses a sequence number all the same, so that consumers can
    /// detect the loss.
    pub(super) fn put(&mut self, event: &Event, names: &ModelNames, now_ns: i64) -> Result<(), PutError> {
        let topic = Topic::of_event(event);
        let Some(output) = self.outputs.iter_mut().find(|output| output.of == topic) else { return Ok(()) };
        output.seq += 1;
        let attachment = Attachment { seq: output.seq, stamp_ns: now_ns, gid: output.gid };
        let put = match ros_bytes(event, names, &self.frame.get()) {
            None => return Ok(()),
            Some(Err(error)) => Err(error.into()),
            Some(Ok(bytes)) => {
                let put = output.publisher.put(bytes).attachment(attachment.to_bytes()).wait();
                put.map_err(PutError::Publish)
            }
        };
        self.counters.put(put.is_ok());
        put
    }

    /// Undeclares everything. Tokens come first, so that no client relies on the rest any more.
    pub(super) fn close(self) {
        let mut results = vec![self.node.undeclare().wait()];
        for Output { publisher, token, .. } in self.outputs {
            results.push(token.undeclare().wait());
            results.push(publisher.undeclare().wait());
        }
        for error in results.into_iter().filter_map(Result::err) {
            tracing::debug!("undeclaring from rmw_zenoh: {error}");
        }
    }
}

/// Reasons why a message was not published.
#[derive(Debug, thiserror::Error)]
pub(super) enum PutError {
    #[error(transparent)]
    Encode(#[from] EncodeError),
    #[error("{0}")]
    Publish(zenoh::Error),
}

/// Descriptor of the message of a topic.
fn descriptor(of: Topic) -> Option<&'static Descriptor> {
    let name = of.ros_type()?;
    MESSAGES.iter().find(|descriptor| descriptor.type_name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_output_has_a_message_and_every_topic_published_on_ros_is_an_output() {
        assert!(OUTPUTS.into_iter().all(|topic| descriptor(topic).is_some()));
        let published = |topic: &Topic| !topic.is_input() && topic.ros_type().is_some();
        assert_eq!(Topic::ALL.iter().filter(|topic| published(topic)).count(), OUTPUTS.len());
        assert!(OUTPUTS.iter().all(published));
    }
}
