//! The messages that wait for one viewer. The queue is bounded: when it is full, the oldest message is dropped and counted.

use super::protocol::Subscription;
use std::collections::{HashMap, VecDeque};
use std::sync::Arc;

/// Bytes of messages that wait for a viewer. One damper at 1 kHz makes about 1 MB a second.
pub(super) const MOST_BYTES: usize = 4 << 20;
/// Replies that wait for a viewer. They are not dropped, so a viewer that does not read them is disconnected.
pub(super) const MOST_REPLIES: usize = 1024;
/// Bytes that a message takes in addition to its payload.
const OVERHEAD: usize = size_of::<Waiting>();

/// A message that waits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Waiting {
    /// Of a channel: subscription, log time in ns, payload.
    Message(u32, u64, Arc<[u8]>),
    /// The time of a recording, ns.
    Time(u64),
}

impl Waiting {
    fn bytes(&self) -> usize {
        match self {
            Self::Message(_, _, payload) => OVERHEAD + payload.len(),
            Self::Time(_) => OVERHEAD,
        }
    }
}

/// Why a subscription is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum SubscribeError {
    #[error(
        "subscription {id}: channel {channel} does not exist; subscribe to a channel that was advertised"
    )]
    NoChannel { id: u32, channel: u32 },
    #[error("subscription {id} exists already; unsubscribe first or choose another number")]
    Taken { id: u32 },
    #[error("subscription {id}: channel {channel} has a subscription already; a channel can have one")]
    Twice { id: u32, channel: u32 },
}

/// Messages and replies that wait for a viewer, and its subscriptions.
#[derive(Debug, Default)]
pub(super) struct Queue {
    /// Subscriptions by channel.
    subscriptions: HashMap<u32, u32>,
    messages: VecDeque<Waiting>,
    bytes: usize,
    dropped: u64,
    replies: VecDeque<String>,
    overflowed: bool,
}

/// The part of a queue that is sent next.
#[derive(Debug, Default)]
pub(super) struct Due {
    /// Replies, which go first.
    pub(super) replies: Vec<String>,
    /// Messages, oldest first.
    pub(super) messages: Vec<Waiting>,
}

impl Queue {
    /// Adds a subscription; `channels` is the number of channels.
    pub(super) fn subscribe(&mut self, asked: Subscription, channels: usize) -> Result<(), SubscribeError> {
        let Subscription { id, channel_id: channel } = asked;
        if channel as usize >= channels {
            return Err(SubscribeError::NoChannel { id, channel });
        }
        if self.subscriptions.values().any(|taken| *taken == id) {
            return Err(SubscribeError::Taken { id });
        }
        if self.subscriptions.contains_key(&channel) {
            return Err(SubscribeError::Twice { id, channel });
        }
        self.subscriptions.insert(channel, id);
        Ok(())
    }

    /// Ends a subscription; false if there is none with this number. Its messages that wait are removed.
    pub(super) fn unsubscribe(&mut self, id: u32) -> bool {
        let before = self.subscriptions.len();
        self.subscriptions.retain(|_, subscription| *subscription != id);
        self.messages
            .retain(|waiting| !matches!(waiting, Waiting::Message(subscription, ..) if *subscription == id));
        self.bytes = self.messages.iter().map(Waiting::bytes).sum();
        self.subscriptions.len() < before
    }

    /// True if the viewer subscribed to this channel.
    pub(super) fn wants(&self, channel: u32) -> bool {
        self.subscriptions.contains_key(&channel)
    }

    /// True if the viewer subscribed to any channel.
    pub(super) fn wants_any(&self) -> bool {
        !self.subscriptions.is_empty()
    }

    /// Adds a message of a channel, if the viewer subscribed to it.
    pub(super) fn message(&mut self, channel: u32, log_time_ns: u64, payload: &Arc<[u8]>) {
        if let Some(subscription) = self.subscriptions.get(&channel) {
            self.add(Waiting::Message(*subscription, log_time_ns, Arc::clone(payload)));
        }
    }

    /// Adds the time of a recording.
    pub(super) fn time(&mut self, now_ns: u64) {
        self.add(Waiting::Time(now_ns));
    }

    fn add(&mut self, waiting: Waiting) {
        self.bytes += waiting.bytes();
        self.messages.push_back(waiting);
        while self.bytes > MOST_BYTES
            && let Some(oldest) = self.messages.pop_front()
        {
            self.bytes -= oldest.bytes();
            self.dropped += u64::from(matches!(oldest, Waiting::Message(..)));
        }
    }

    /// Adds a reply.
    pub(super) fn reply(&mut self, text: String) {
        if self.replies.len() >= MOST_REPLIES {
            self.overflowed = true;
        } else {
            self.replies.push_back(text);
        }
    }

    /// True once a reply could not be added.
    pub(super) fn has_overflowed(&self) -> bool {
        self.overflowed
    }

    /// Removes all replies and up to `most` messages.
    pub(super) fn due(&mut self, most: usize) -> Due {
        let count = most.min(self.messages.len());
        let messages: Vec<Waiting> = self.messages.drain(..count).collect();
        self.bytes -= messages.iter().map(Waiting::bytes).sum::<usize>();
        Due { replies: self.replies.drain(..).collect(), messages }
    }

    /// Number of messages that were dropped since the last call.
    pub(super) fn take_dropped(&mut self) -> u64 {
        std::mem::take(&mut self.dropped)
    }
}
