//! Values of command-line flags that are numbers.

use thiserror::Error;

/// A value is not a positive number. clap says which flag it was given for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("must be a positive number of {unit}")]
pub(crate) struct NotPositive {
    /// The unit, in words.
    unit: &'static str,
}

/// A value is not an id with a range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("must be an id and two numbers, like inertia=0:200")]
pub(crate) struct NotRange;

/// Parses an id with a range of numbers, `ID=LOW:HIGH`.
///
/// # Errors
/// [`NotRange`].
pub(crate) fn range(text: &str) -> Result<(String, [f64; 2]), NotRange> {
    let (id, ends) = text.split_once('=').ok_or(NotRange)?;
    let (low, high) = ends.split_once(':').ok_or(NotRange)?;
    let number = |text: &str| text.trim().parse().map_err(|_| NotRange);
    Ok((id.trim().to_owned(), [number(low)?, number(high)?]))
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
