//! The channels of the endpoint and its viewers: the part that the receiving thread and the server's thread share.
//!
//! Locks are held only while messages are moved in memory, never while a socket is written or read.

use super::parameters::parameter_value;
use super::protocol::{Advertised, Level, ParameterValue, Reply, Subscription};
use super::queue::{Due, Queue};
use mr_damper_msgs::{Descriptor, rcl};
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;

/// Number of messages that are taken out of a queue at once.
const BATCH: usize = 512;
/// Encoding of messages and of their definitions, as in bags.
const ENCODING: &str = "cdr";
const SCHEMA_ENCODING: &str = "ros2msg";

/// A channel of a [`Channels`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChannelId(u32);

/// The channels, and the viewers that are connected.
///
/// One thread publishes; the server's thread connects viewers and sends to them.
#[derive(Debug)]
pub struct Channels {
    /// True if messages have the times of a recording, which viewers then follow.
    has_time: bool,
    /// True if parameters of nodes can be read.
    has_parameters: bool,
    session: String,
    state: Mutex<State>,
    /// True once a viewer has asked for parameters since [`Channels::take_parameter_request`].
    parameters_asked: AtomicBool,
}

#[derive(Debug, Default)]
struct State {
    channels: Vec<Channel>,
    by_topic: HashMap<String, u32>,
    viewers: Vec<Arc<Viewer>>,
    /// Number of viewers that have connected so far.
    connected: u64,
    /// Parameters by their full names.
    parameters: HashMap<String, rcl::ParameterValue>,
}

#[derive(Debug)]
struct Channel {
    topic: String,
    descriptor: Descriptor,
    /// The last message that also viewers get that subscribe later: its time and payload.
    kept: Option<(u64, Arc<[u8]>)>,
}

impl Channel {
    fn advertised(&self, id: u32) -> Advertised<'_> {
        Advertised {
            id,
            topic: &self.topic,
            encoding: ENCODING,
            schema_name: self.descriptor.type_name,
            schema: self.descriptor.definition,
            schema_encoding: SCHEMA_ENCODING,
        }
    }
}

/// A connected viewer, as other threads see it.
#[derive(Debug, Default)]
pub(super) struct Viewer {
    /// Counts the viewers, for the log.
    number: u64,
    queue: Mutex<Queue>,
    wake: Notify,
}

/// Locks a value that is consistent even after a panic elsewhere, because it is only changed by single calls.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Viewer {
    /// Its number in the log.
    pub(super) fn number(&self) -> u64 {
        self.number
    }

    /// Adds a reply to its queue.
    pub(super) fn reply(&self, reply: &Reply<'_>) {
        locked(&self.queue).reply(reply.text());
        self.wake.notify_one();
    }

    /// Adds a sentence for its user.
    pub(super) fn status(&self, level: Level, message: &str) {
        self.reply(&Reply::Status { level, message });
    }

    /// Waits until there is something to send, and returns it; `None` once the viewer has to be disconnected, because it does not read.
    pub(super) async fn due(&self) -> Option<Due> {
        loop {
            {
                let mut queue = locked(&self.queue);
                if queue.has_overflowed() {
                    return None;
                }
                let due = queue.due(BATCH);
                if !due.replies.is_empty() || !due.messages.is_empty() {
                    return Some(due);
                }
            }
            // A wake-up between the check and this line is not lost: it is stored.
            self.wake.notified().await;
        }
    }

    /// Number of messages that were dropped since the last call.
    pub(super) fn take_dropped(&self) -> u64 {
        locked(&self.queue).take_dropped()
    }

    fn change(&self, how: impl FnOnce(&mut Queue)) {
        how(&mut locked(&self.queue));
        self.wake.notify_one();
    }
}

impl Channels {
    /// Channels for live messages, whose times are the stamps in their headers. `has_parameters` says that the caller reads parameters when a
    /// viewer asks for them ([`Channels::take_parameter_request`]).
    #[must_use]
    pub fn live(session: String, has_parameters: bool) -> Self {
        Self::new(session, false, has_parameters)
    }

    /// Channels for a recording that is played: viewers follow its time ([`Channels::publish_time`]).
    #[must_use]
    pub fn recorded(session: String) -> Self {
        Self::new(session, true, false)
    }

    fn new(session: String, has_time: bool, has_parameters: bool) -> Self {
        let parameters_asked = AtomicBool::new(false);
        Self { has_time, has_parameters, session, state: Mutex::default(), parameters_asked }
    }

    /// Adds the channel of `topic`, whose messages have the type `descriptor`, and tells all viewers. If the topic has a channel already,
    /// that is returned.
    pub fn add(&self, topic: &str, descriptor: Descriptor) -> ChannelId {
        let mut state = locked(&self.state);
        if let Some(id) = state.by_topic.get(topic) {
            return ChannelId(*id);
        }
        // There are far fewer topics than numbers.
        let id = u32::try_from(state.channels.len()).unwrap_or(u32::MAX);
        state.channels.push(Channel { topic: topic.to_owned(), descriptor, kept: None });
        state.by_topic.insert(topic.to_owned(), id);
        let channel = &state.channels[id as usize];
        let news = Reply::Advertise { channels: vec![channel.advertised(id)] };
        state.viewers.iter().for_each(|viewer| viewer.reply(&news));
        ChannelId(id)
    }

    /// True if a viewer subscribed to the channel. A message of another channel need not be encoded.
    #[must_use]
    pub fn is_wanted(&self, channel: ChannelId) -> bool {
        locked(&self.state).viewers.iter().any(|viewer| locked(&viewer.queue).wants(channel.0))
    }

    /// Number of viewers that subscribed to any channel.
    #[must_use]
    pub fn subscribers(&self) -> usize {
        locked(&self.state).viewers.iter().filter(|viewer| locked(&viewer.queue).wants_any()).count()
    }

    /// Number of connected viewers.
    #[must_use]
    pub fn viewers(&self) -> usize {
        locked(&self.state).viewers.len()
    }

    /// Sends a message to the viewers that subscribed to its channel: its time in nanoseconds since 1970, and its CDR with the 4-byte
    /// header. The protocol has no times before 1970, so these are sent as 0.
    pub fn publish(&self, channel: ChannelId, log_time_ns: i64, cdr: &[u8]) {
        let log_time_ns = u64::try_from(log_time_ns).unwrap_or(0);
        let payload: Arc<[u8]> = cdr.into();
        for viewer in &locked(&self.state).viewers {
            viewer.change(|queue| queue.message(channel.0, log_time_ns, &payload));
        }
    }

    /// Like [`Channels::publish`], and viewers that subscribe later get this message, too, unless a newer one was published this way.
    pub fn publish_kept(&self, channel: ChannelId, log_time_ns: i64, cdr: &[u8]) {
        self.publish(channel, log_time_ns, cdr);
        let kept = (u64::try_from(log_time_ns).unwrap_or(0), cdr.into());
        if let Some(channel) = locked(&self.state).channels.get_mut(channel.0 as usize) {
            channel.kept = Some(kept);
        }
    }

    /// Sends the time of a recording, in nanoseconds since 1970, to all viewers.
    pub fn publish_time(&self, now_ns: i64) {
        let now_ns = u64::try_from(now_ns).unwrap_or(0);
        locked(&self.state).viewers.iter().for_each(|viewer| viewer.change(|queue| queue.time(now_ns)));
    }

    /// True if a viewer asked for parameters since the last call.
    #[must_use]
    pub fn take_parameter_request(&self) -> bool {
        self.parameters_asked.swap(false, Ordering::Relaxed)
    }

    /// Sets all parameters of the node named `node`, such as `/front_left/mr_damper`. Viewers get them under the names `NODE.PARAMETER`,
    /// also those that are connected.
    pub fn set_parameters(&self, node: &str, parameters: &[rcl::Parameter]) {
        let prefix = format!("{node}.");
        let named = parameters.iter().map(|of| (format!("{prefix}{}", of.name), of.value.clone()));
        let named: HashMap<String, rcl::ParameterValue> = named.collect();
        let mut state = locked(&self.state);
        let changed: Vec<ParameterValue> = named
            .iter()
            .filter(|(name, value)| state.parameters.get(*name) != Some(*value))
            .map(|(name, value)| parameter_value(name.clone(), value))
            .collect();
        state.parameters.retain(|name, _| !name.starts_with(&prefix));
        state.parameters.extend(named);
        if !changed.is_empty() {
            let news = Reply::ParameterValues { parameters: changed, id: None };
            state.viewers.iter().for_each(|viewer| viewer.reply(&news));
        }
    }

    /// Connects a viewer: it gets the description of the server and all channels.
    pub(super) fn connect(&self, name: &str) -> Arc<Viewer> {
        let mut state = locked(&self.state);
        state.connected += 1;
        let viewer = Arc::new(Viewer { number: state.connected, ..Viewer::default() });
        let mut capabilities = Vec::new();
        if self.has_time {
            capabilities.push("time");
        }
        if self.has_parameters {
            capabilities.push("parameters");
        }
        viewer.reply(&Reply::ServerInfo { name, capabilities: &capabilities, session_id: &self.session });
        let channels = (0..).zip(&state.channels).map(|(id, channel)| channel.advertised(id)).collect();
        viewer.reply(&Reply::Advertise { channels });
        state.viewers.push(Arc::clone(&viewer));
        viewer
    }

    /// Forgets a viewer.
    pub(super) fn disconnect(&self, viewer: &Arc<Viewer>) {
        locked(&self.state).viewers.retain(|other| !Arc::ptr_eq(other, viewer));
    }

    /// Adds subscriptions of a viewer; a wrong one gets a status and does not affect the others.
    pub(super) fn subscribe(&self, viewer: &Viewer, subscriptions: &[Subscription]) {
        let state = locked(&self.state);
        for asked in subscriptions {
            let subscribed = locked(&viewer.queue).subscribe(*asked, state.channels.len());
            let kept = state.channels.get(asked.channel_id as usize).and_then(|of| of.kept.as_ref());
            match (subscribed, kept) {
                (Ok(()), Some((time, payload))) => {
                    viewer.change(|queue| queue.message(asked.channel_id, *time, payload));
                }
                (Ok(()), None) => {}
                (Err(error), _) => viewer.status(Level::Error, &error.to_string()),
            }
        }
    }

    /// Ends subscriptions of a viewer.
    pub(super) fn unsubscribe(&self, viewer: &Viewer, subscriptions: &[u32]) {
        for id in subscriptions {
            let ended = locked(&viewer.queue).unsubscribe(*id);
            if !ended {
                viewer.status(
                    Level::Warning,
                    &format!("subscription {id} does not exist, so it was not ended"),
                );
            }
        }
    }

    /// True if viewers may read parameters.
    pub(super) fn has_parameters(&self) -> bool {
        self.has_parameters
    }

    /// Replies with the known values of the parameters `names`, or of all if `names` is empty, and requests the present ones.
    pub(super) fn send_parameters(&self, viewer: &Viewer, names: &[String], id: Option<&str>) {
        let state = locked(&self.state);
        let is_asked = |name: &String| names.is_empty() || names.contains(name);
        let mut parameters: Vec<ParameterValue> = state
            .parameters
            .iter()
            .filter(|(name, _)| is_asked(name))
            .map(|(name, value)| parameter_value(name.clone(), value))
            .collect();
        drop(state);
        parameters.sort_by(|a, b| a.name.cmp(&b.name));
        viewer.reply(&Reply::ParameterValues { parameters, id });
        self.parameters_asked.store(true, Ordering::Relaxed);
    }
}
