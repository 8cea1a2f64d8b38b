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

/// A value is not a number or an interval.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("must be a positive number, the largest value, or two numbers, LOW:HIGH")]
pub(crate) struct NotInterval;

/// Parses an interval: `HIGH`, which begins at zero, or `LOW:HIGH`.
///
/// # Errors
/// [`NotInterval`].
pub(crate) fn interval(text: &str) -> Result<[f64; 2], NotInterval> {
    let number =
        |text: &str| text.trim().parse().ok().filter(|value: &f64| value.is_finite()).ok_or(NotInterval);
    let (low, high) = match text.split_once(':') {
        Some((low, high)) => (number(low)?, number(high)?),
        None => (0.0, number(text)?),
    };
    if low < high { Ok([low, high]) } else { Err(NotInterval) }
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
