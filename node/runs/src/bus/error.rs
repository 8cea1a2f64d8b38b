//! Errors of the signals that a running node reads from a bus and sends to it.

use crate::error::MapFault;
use crate::{MapError, RunError};

/// Why messages of a bus cannot be read or sent as requested.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
    /// A DBC file cannot be used.
    #[error(transparent)]
    Dbc(#[from] RunError),
    /// A mapping is not written correctly.
    #[error(transparent)]
    Mapping(#[from] MapError),
    /// A mapping does not fit the DBC file.
    #[error("{text}: {why}")]
    Map {
        /// The text as given.
        text: String,
        /// The reason.
        why: Box<MapFault>,
    },
    /// The mapped channel is none of the node's inputs.
    #[error("{text}: {channel} is not an input of the node; inputs are {inputs}")]
    NoInput {
        /// The text as given.
        text: String,
        /// The channel.
        channel: &'static str,
        /// The inputs.
        inputs: String,
    },
    /// No message has the signal.
    #[error("{text}: no message of the DBC files has it{}", did_you_mean(nearest))]
    Unknown {
        /// The text as given.
        text: String,
        /// The signal with the most similar name.
        nearest: Option<String>,
    },
    /// The message is not in the DBC files.
    #[error("{text}: the DBC files have no message `{message}`{}", did_you_mean(nearest))]
    NoMessage {
        /// The text as given.
        text: String,
        /// The message.
        message: String,
        /// The message with the most similar name.
        nearest: Option<String>,
    },
    /// The message does not have the signal.
    #[error("{text}: message {message} has no signal `{signal}`; its signals are {signals}")]
    NoSignal {
        /// The text as given.
        text: String,
        /// The message.
        message: String,
        /// The signal.
        signal: String,
        /// The signals of the message.
        signals: String,
    },
    /// A text is neither a protected input nor an output.
    #[error("`{text}` is not {what}; write {form}")]
    Form {
        /// The text as given.
        text: String,
        /// The expected kind of text.
        what: &'static str,
        /// Its form.
        form: &'static str,
    },
    /// The output has no such field.
    #[error("{text}: {topic} has no `{field}`; it has {fields}, counter, checksum and data_id")]
    Field {
        /// The text as given.
        text: String,
        /// The output.
        topic: &'static str,
        /// The field as given.
        field: String,
        /// The fields of the output.
        fields: String,
    },
    /// The output lacks its main number.
    #[error("{text}: no signal carries the {field}: add {field}=SIGNAL")]
    Needs {
        /// The text as given.
        text: String,
        /// The field.
        field: &'static str,
    },
    /// Something is given twice.
    #[error("{text}: {name} is given twice; leave one out")]
    Twice {
        /// The text as given.
        text: String,
        /// The name.
        name: String,
    },
    /// The data ID is not a number of 16 bits.
    #[error("{text}: data_id is `{value}`, but must be a whole number from 0 to 65535, as in 291 or 0x123")]
    DataId {
        /// The text as given.
        text: String,
        /// The value as given.
        value: String,
    },
    /// A data ID without counter or checksum.
    #[error(
        "{text}: data_id selects AUTOSAR E2E profile 1, which needs both a counter and a checksum: name both, or leave data_id out"
    )]
    Profile {
        /// The text as given.
        text: String,
    },
    /// A signal is not suitable for its use.
    #[error("{text}: {signal} is not suitable: {needs}")]
    Unfit {
        /// The text as given.
        text: String,
        /// The signal.
        signal: String,
        /// The properties that the signal needs.
        needs: String,
    },
    /// Two signals of an output share bits.
    #[error("{text}: {first} and {second} share bits: correct the DBC file, or leave one out")]
    Overlap {
        /// The text as given.
        text: String,
        /// A signal.
        first: String,
        /// Another signal.
        second: String,
    },
    /// The message has a length that no frame has.
    #[error("{text}: message {message} has {bytes} bytes; frames have 1 to 8, 12, 16, 20, 24, 32, 48 or 64")]
    Length {
        /// The text as given.
        text: String,
        /// The message.
        message: String,
        /// Its length.
        bytes: u64,
    },
    /// A message is used twice, or as input and output.
    #[error("{text}: message {message} ({id}) is {used} already: give the output a message of its own")]
    Taken {
        /// The text as given.
        text: String,
        /// The message.
        message: String,
        /// Its identifier.
        id: String,
        /// Its other use.
        used: &'static str,
    },
    /// A protected message carries no input.
    #[error("{text}: no input is mapped to a signal of {message}: map one, or leave the check out")]
    Unused {
        /// The text as given.
        text: String,
        /// The message.
        message: String,
    },
}

fn did_you_mean(nearest: &Option<String>) -> String {
    nearest.as_ref().map(|nearest| format!("; did you mean {nearest}?")).unwrap_or_default()
}
