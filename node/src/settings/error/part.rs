//! Errors of the parts above this module.

/// An error of a part of the service or of a command.
///
/// Each part defines its error beside the code that raises it, with the values that the sentence contains. The part may belong to a
/// higher group than this module, which therefore cannot name the type: [`NodeError`](super::NodeError) holds every such error
/// (`?` converts it), and [`NodeError::part`](super::NodeError::part) gives it back.
pub trait PartError: std::error::Error + Send + Sync + 'static {
    /// The stable code and the fields of the error of the model crate that this error reports, for JSON; `None` if it reports none.
    fn reason(&self) -> Option<serde_json::Value> {
        None
    }

    /// True if the arguments or parameters are wrong.
    fn is_wrong_usage(&self) -> bool {
        false
    }
}

/// Makes a variant transparent: it has the sentence and the cause of the part's error.
impl std::error::Error for Box<dyn PartError> {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.as_ref().source()
    }
}
