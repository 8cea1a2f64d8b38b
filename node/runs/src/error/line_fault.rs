//! Why a line of a log cannot be read.

/// A fault in a line of a candump or ASC log. The message of [`crate::RunError::LogLine`] names file and line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LineFault {
    /// The line is longer than any frame.
    #[error("longer than {most} bytes, so this is not a log in text: check the extension of the file")]
    Long {
        /// Greatest length that is read, bytes.
        most: u64,
    },
    /// The last line has no line end, so it may have been cut off.
    #[error("the line has no end, so its frame may not be whole")]
    NoEnd,
    /// A line of candump does not begin with a time in seconds.
    #[error(
        "`{line}` has no time in seconds in parentheses: record with `candump -L`, or print with `candump -t a`"
    )]
    CandumpTime {
        /// The line.
        line: String,
    },
    /// A line of candump is not a frame.
    #[error(
        "`{line}` is not a frame, such as `(1.250000) can0 120#D20403E8`; correct it, or drop such lines with --skip-bad-rows"
    )]
    Candump {
        /// The line.
        line: String,
    },
    /// An identifier is not one.
    #[error(
        "`{found}` is not an identifier of 11 or 29 bits; save the log with numbers in place of names, or drop such lines with \
         --skip-bad-rows"
    )]
    Id {
        /// The text.
        found: String,
    },
    /// Data are not bytes.
    #[error("`{found}` is not a row of bytes; correct it, or drop such lines with --skip-bad-rows")]
    Bytes {
        /// The text.
        found: String,
    },
    /// Data end before their stated length.
    #[error("{found} of {wanted} data bytes; correct the line, or drop such lines with --skip-bad-rows")]
    FewBytes {
        /// Number of bytes in the line.
        found: usize,
        /// Number of bytes that it states.
        wanted: usize,
    },
    /// The file does not begin like an ASC file.
    #[error(
        "`{line}` is not a line of an ASC file, which begins with `date`, `base hex timestamps absolute` or a comment (//)"
    )]
    Asc {
        /// The line.
        line: String,
    },
    /// The base of the numbers is not known.
    #[error("`{line}` names neither hex nor dec as the base of numbers")]
    AscBase {
        /// The line.
        line: String,
    },
    /// A time is out of range.
    #[error(
        "`{time}` is not a time in decimal seconds within 292 years; correct it, or drop such lines with --skip-bad-rows"
    )]
    AscTime {
        /// The text.
        time: String,
    },
    /// A line of ASC is not a frame.
    #[error(
        "`{line}` is not a frame, such as `0.250000 1 120 Rx d 2 D2 04`; correct it, or drop such lines with --skip-bad-rows"
    )]
    AscFrame {
        /// The line.
        line: String,
    },
}
