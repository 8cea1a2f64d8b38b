//! Why a mapping (`--map`) cannot be used.

use crate::extract::{Dimension, UnsuitableSource};

/// Why a channel cannot be read from the source that it is mapped to.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MapFault {
    /// The topic is not in the bag.
    #[error("topic {topic} is not in the bag{}; {topics}", did_you_mean(nearest))]
    NoTopic {
        /// The topic.
        topic: String,
        /// The topic with the most similar name.
        nearest: Option<String>,
        /// List of the topics in the bag.
        topics: String,
    },
    /// The source is a column, but the run is a bag.
    #[error(
        "`{column}` is a column, and this run is a bag: name a topic, which begins with a slash; {topics}"
    )]
    ColumnOfBag {
        /// The source as given.
        column: String,
        /// List of the topics in the bag.
        topics: String,
    },
    /// Time is mapped, but the run is a bag.
    #[error("messages of a bag have their stamps: leave out the map of time, which is for CSV files")]
    TimeOfBag,
    /// The topic's type does not fit the channel.
    #[error("{unfit}{}", instead.as_ref().map(|line| format!("; this bag has {line}")).unwrap_or_default())]
    Unfit {
        /// The reason.
        unfit: UnsuitableSource,
        /// The flag for a topic of this bag that fits.
        instead: Option<String>,
    },
    /// The joint is not in the messages.
    #[error("joint `{joint}` is not in the messages{}; joints are {}", did_you_mean(nearest), joints.join(", "))]
    NoJoint {
        /// The joint.
        joint: String,
        /// The joint with the most similar name.
        nearest: Option<String>,
        /// The joints in the messages.
        joints: Vec<String>,
    },
    /// The topic is in the bag, but has no message.
    #[error(
        "topic {topic} is in the bag, but no message was recorded: map another topic, or record it again"
    )]
    NoMessage {
        /// The topic.
        topic: String,
    },
    /// No message can be decoded.
    #[error("no message of {topic} could be decoded: {fault}")]
    Undecodable {
        /// The topic.
        topic: String,
        /// The fault of the first message.
        fault: String,
    },
    /// No message has a finite value.
    #[error(
        "none of the {messages} messages of {topic} has a finite value for this channel: map another topic"
    )]
    NoValue {
        /// The topic.
        topic: String,
        /// Number of messages.
        messages: u64,
    },
    /// The messages are not in CDR.
    #[error("its messages are in `{encoding}`, and only CDR is read")]
    Encoding {
        /// The encoding.
        encoding: String,
    },
    /// The column is not in the file.
    #[error("there is no column `{column}`{}; columns are {columns}", did_you_mean(nearest))]
    NoColumn {
        /// The column.
        column: String,
        /// The column with the most similar name.
        nearest: Option<String>,
        /// List of the columns in the file.
        columns: String,
    },
    /// The column holds another quantity.
    #[error("column `{column}` holds a {found}, and {channel} is a {needed}: map another column")]
    Quantity {
        /// The column.
        column: String,
        /// Its quantity, according to its name.
        found: Dimension,
        /// The channel.
        channel: &'static str,
        /// The channel's quantity.
        needed: Dimension,
    },
    /// The column holds the time.
    #[error("column `{column}` is the time: map another column")]
    IsTime {
        /// The column.
        column: String,
    },
}

fn did_you_mean(nearest: &Option<String>) -> String {
    nearest.as_ref().map(|nearest| format!("; did you mean {nearest}?")).unwrap_or_default()
}
