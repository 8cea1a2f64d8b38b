//! Values of command-line flags that are positive numbers.

use thiserror::Error;

/// A value is not a positive number. clap says which flag it was given for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("must be a positive number of {unit}")]
pub(crate) struct NotPositive {
    /// The unit, in words.
    unit: &'static str,
}

/// Parses a positive number of newtons.
///
/// # Errors
/// [`NotPositive`].
pub(crate) fn newtons(text: &str) -> Result<f64, NotPositive> {
    positive(text, "newtons")
}

/// Parses a positive number of seconds.
///
/// # Errors
/// [`NotPositive`].
pub(crate) fn seconds(text: &str) -> Result<f64, NotPositive> {
    positive(text, "seconds")
}

/// Parses a positive number of hertz.
///
/// # Errors
/// [`NotPositive`].
pub(crate) fn hertz(text: &str) -> Result<f64, NotPositive> {
    positive(text, "hertz")
}

fn positive(text: &str, unit: &'static str) -> Result<f64, NotPositive> {
    text.parse().ok().filter(|value: &f64| value.is_finite() && *value > 0.0).ok_or(NotPositive { unit })
}
