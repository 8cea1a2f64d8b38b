//! Why a DBC file cannot be used.

/// A fault in a DBC file. The message of [`crate::RunError::Dbc`] names file and line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DbcFault {
    /// The file is larger than any DBC file.
    #[error("{bytes} bytes, and a DBC file has at most {most}: give the DBC file, not the log")]
    TooLarge {
        /// Size of the file.
        bytes: u64,
        /// Greatest size that is read.
        most: u64,
    },
    /// The file begins with something else.
    #[error(
        "begins with `{begins}`, which is not a statement of a DBC file: give the DBC file of the bus with --dbc"
    )]
    NotDbc {
        /// The first word.
        begins: String,
    },
    /// No message is described.
    #[error("no message (BO_) in it: give a DBC file that describes the messages of the bus")]
    NoMessages,
    /// A signal belongs to no message.
    #[error("signal `{signal}` stands before any message (BO_): export the DBC file again, or correct it")]
    NoMessage {
        /// The signal.
        signal: String,
    },
    /// The identifier of a message is out of range.
    #[error(
        "message `{message}` has the identifier {id}; greatest is 2047 for 11 bits, and 2147483648 is added to identifiers of 29 bits: \
         correct the DBC file"
    )]
    Id {
        /// The message.
        message: String,
        /// The identifier as written.
        id: u64,
    },
    /// Another word was expected.
    #[error("`{found}` where {expected} should be: correct the DBC file, or export it again")]
    Unexpected {
        /// The text in the file.
        found: String,
        /// Description of the expected text.
        expected: String,
    },
    /// Quotes are not closed.
    #[error("quotes that are not closed: close them, or export the DBC file again")]
    OpenText,
    /// The multiplexer mark of a signal is not known.
    #[error(
        "signal `{signal}` has the mark `{mark}`; marks are M for a multiplexer, m and a number, or both as in m1M"
    )]
    Mark {
        /// The signal.
        signal: String,
        /// The mark.
        mark: String,
    },
    /// The byte order of a signal is not known.
    #[error("signal `{signal}` has the byte order `{found}`; 1 is Intel's and 0 is Motorola's")]
    Order {
        /// The signal.
        signal: String,
        /// The text in the file.
        found: String,
    },
    /// The sign of a signal is not known.
    #[error("signal `{signal}` has the sign `{found}`; + is unsigned and - is signed")]
    SignMark {
        /// The signal.
        signal: String,
        /// The text in the file.
        found: String,
    },
    /// The kind of number of a signal is not known.
    #[error("signal `{signal}` has the kind of number {kind}; 0 is a whole number, and 1 and 2 are floats")]
    NumberKind {
        /// The signal.
        signal: String,
        /// The kind as written.
        kind: u64,
    },
    /// The multiplexer of a signal is not in its message.
    #[error(
        "message `{message}` has no signal `{multiplexer}`, which should select `{signal}`: correct the DBC file"
    )]
    NoMultiplexer {
        /// The message.
        message: String,
        /// The selected signal.
        signal: String,
        /// The missing signal.
        multiplexer: String,
    },
}
