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
    /// A topic was given for a log of a bus.
    #[error("{topic} is a topic, and this run is a log of a bus: name a signal, as in MESSAGE.SIGNAL")]
    TopicOfLog {
        /// The source as given.
        topic: String,
    },
    /// Time is mapped, but the run is a log of a bus.
    #[error("frames of a log have their times: leave out the map of time, which is for CSV files")]
    TimeOfLog,
    /// The signal is neither in the DBC file nor in the log.
    #[error("there is no signal `{signal}`{}; {signals}", did_you_mean(nearest))]
    NoSignal {
        /// The source as given.
        signal: String,
        /// The signal with the most similar name.
        nearest: Option<String>,
        /// List of the signals in the log.
        signals: String,
    },
    /// Several signals have the name.
    #[error(
        "`{signal}` names several signals: {places}; name one of them, as MESSAGE.SIGNAL or, in an MDF4 file, NAME:GROUP"
    )]
    SignalTwice {
        /// The source as given.
        signal: String,
        /// The signals and their places.
        places: String,
    },
    /// Several messages have the identifier.
    #[error(
        "several messages have the identifier {id}: {places}; remove all but the right one from the DBC files"
    )]
    MessageTwice {
        /// The identifier.
        id: String,
        /// The messages and their places.
        places: String,
    },
    /// The number of bits does not fit the kind of number.
    #[error(
        "{signal} (line {line} of the DBC file) has {bits} bits; 1 to 64 are read, and 16, 32 or 64 for floats"
    )]
    SignalLength {
        /// The signal.
        signal: String,
        /// Line in the DBC file.
        line: usize,
        /// Number of bits.
        bits: u32,
    },
    /// The signal does not fit into its message.
    #[error(
        "{signal} (line {line} of the DBC file) ends in byte {needed} of a message with {has}: correct the DBC file"
    )]
    SignalBeyond {
        /// The signal.
        signal: String,
        /// Line in the DBC file.
        line: usize,
        /// Number of bytes that hold the signal.
        needed: u64,
        /// Number of bytes of the message.
        has: u64,
    },
    /// The multiplexer of a signal is not known.
    #[error(
        "{signal} (line {line} of the DBC file) is multiplexed, and the file does not say by which signal: mark one signal of the \
         message with M, or add SG_MUL_VAL_"
    )]
    NoMultiplexer {
        /// The signal.
        signal: String,
        /// Line in the DBC file.
        line: usize,
    },
    /// The unit of a signal is not known.
    #[error(
        "{signal} {}; say which unit it is with ,unit=UNIT: units that fit {channel} are {fitting}",
        if unit.is_empty() { "has no unit".to_owned() } else { format!("has the unit `{unit}`, which is not one of {channel}") }
    )]
    SignalUnit {
        /// The signal.
        signal: String,
        /// Its unit; empty if it has none.
        unit: String,
        /// The channel.
        channel: &'static str,
        /// The units that fit.
        fitting: String,
    },
    /// The log has no frame of the message.
    #[error("no frame of {message} ({id}) is in the log; {signals}")]
    NoFrame {
        /// The message.
        message: String,
        /// Its identifier.
        id: String,
        /// List of the signals in the log.
        signals: String,
    },
    /// The log has no frame of the message on the named bus.
    #[error("no frame of {message} was on bus `{bus}`; it was on {}", buses.join(", "))]
    NoBus {
        /// The message.
        message: String,
        /// The bus as given.
        bus: String,
        /// The buses that it was on.
        buses: Vec<String>,
    },
    /// The message was on several buses.
    #[error(
        "its message was on several buses ({}): name one after a colon, as in {signal}:{}",
        buses.join(", "), buses.first().map_or("", String::as_str)
    )]
    SeveralBuses {
        /// The signal.
        signal: String,
        /// The buses.
        buses: Vec<String>,
    },
    /// An address is given for a message that is not of J1939.
    #[error(
        "{signal} is in message {message}, which the DBC file does not mark as J1939 (VFrameFormat \"J1939PG\", or ProtocolType \"J1939\"): \
         leave out @{address}, or mark the message"
    )]
    NotJ1939 {
        /// The signal.
        signal: String,
        /// The message.
        message: String,
        /// The address as given.
        address: String,
    },
    /// The address of a J1939 message's sender is not one.
    #[error(
        "`{address}` is not a source address of J1939, such as 0x21 or 33; only for messages to one destination (PDU1), its address may \
         follow, as in 0x21/0x05"
    )]
    Address {
        /// The address as given.
        address: String,
    },
    /// The log has no frame of the J1939 message from the named sender.
    #[error("no frame of {message} ({id}) came from address {address}; frames came from {}", found.join(", "))]
    NoSender {
        /// The message.
        message: String,
        /// Its identifier.
        id: String,
        /// The address as in the map.
        address: String,
        /// The addresses that frames came from.
        found: Vec<String>,
    },
    /// Several senders send a J1939 message, and the DBC file names none of them.
    #[error(
        "its J1939 message came from several addresses ({}; the DBC file has {own}): name one after @, as in {example}",
        found.join(", ")
    )]
    SeveralSenders {
        /// The addresses: of the source, and for PDU1 of the destination.
        found: Vec<String>,
        /// The address in the DBC file.
        own: String,
        /// The signal with the first address, as the map can name it.
        example: String,
    },
    /// No frame has a value of the signal.
    #[error(
        "none of the {frames} frames or records has a finite value of {signal}{parts}: map another signal"
    )]
    NoSignalValue {
        /// The signal.
        signal: String,
        /// Number of frames of its message, or of records.
        frames: u64,
        /// How many have which fault; empty, or it begins with "; ".
        parts: String,
    },
    /// Most frames of a signal have times that go back.
    #[error(
        "{dropped} frames of {signal} have times that are not after {last_s} s, the time of a frame before them, and only {kept} have: \
         the time jumps ahead there. Remove that frame, or print the log with absolute times (`candump -L`)"
    )]
    TimesJump {
        /// The signal.
        signal: String,
        /// Number of frames whose time is not after the one before.
        dropped: u64,
        /// Number of frames that are left.
        kept: u64,
        /// The latest time, s.
        last_s: f64,
    },
    /// The unit of a channel in an MDF4 file is not that of its name.
    #[error(
        "channel `{channel}` has the unit `{unit}` in the file and another one in its name: say which it has, for example with \
         --map {map},unit={unit}"
    )]
    UnitOfName {
        /// The channel.
        channel: String,
        /// Its unit in the file.
        unit: String,
        /// The beginning of the map.
        map: String,
    },
    /// The time of a channel of an MDF4 file has an unknown unit.
    #[error(
        "the time of channel `{channel}` has the unit `{unit}`, and only s, ms, us and ns are known: save the file with times in seconds, \
         for example with asammdf"
    )]
    TimeUnit {
        /// The channel.
        channel: String,
        /// The unit.
        unit: String,
    },
    /// The conversion of a channel of an MDF4 file is not read.
    #[error(
        "channel `{channel}` has a conversion of kind {kind}, and only linear and rational ones are read (1 and 2): save the file with \
         physical values, for example with asammdf"
    )]
    Conversion {
        /// The channel.
        channel: String,
        /// The kind, by its number in the standard.
        kind: u8,
    },
    /// A channel of an MDF4 file has no time.
    #[error("channel `{channel}` has no time channel in its group: map another channel")]
    NoTime {
        /// The channel.
        channel: String,
    },
    /// The time of a channel of an MDF4 file is stored by columns.
    #[error(
        "channel `{channel}` has its time in another group (storage by columns), which is not read: save the file as MDF 4.10"
    )]
    RemoteTime {
        /// The channel.
        channel: String,
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
