//! Conversion of a run on disk.

use super::{LoadOptions, Loaded, RunError, RunSection, SaveOptions};
use mr_damper_base::shown::count;
use mr_damper_model::sample::{DriveKind, Run};
use std::fmt;
use std::path::Path;

/// A conversion of a run. `Display` says what was written, and how much of the run that is.
#[derive(Debug, Clone)]
pub struct Converted {
    /// The run that was read.
    pub read: Loaded,
    /// Displacement that was written.
    pub written: Written,
    /// The duration that was asked for, s.
    requested_s: Option<f64>,
    /// True if the whole run was written with its own samples.
    is_whole: bool,
}

/// Displacement that was written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Written {
    /// Number of samples.
    pub samples: usize,
    /// Time from the first sample to the last, s.
    pub length_s: f64,
}

impl Written {
    pub(super) fn of(run: &Run) -> Self {
        Self { samples: run.displacement_m.len(), length_s: run.duration().get() }
    }

    /// True if a part of `requested_s` would have more samples. It ends up to one period after its last sample.
    fn is_shorter_than(&self, requested_s: f64) -> bool {
        let period_s = self.length_s / self.samples.saturating_sub(1).max(1) as f64;
        let differs = || seconds(self.length_s) != seconds(requested_s);
        self.length_s + 1.5 * period_s < requested_s && differs()
    }
}

/// A length of time for a message, s.
fn seconds(length_s: f64) -> String {
    if length_s < 1.0 { format!("{length_s:.3}") } else { format!("{length_s:.1}") }
}

impl fmt::Display for Converted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Written { samples, length_s } = self.written;
        write!(f, "{}, {} s", count(samples, "displacement"), seconds(length_s))?;
        if let Some(requested_s) = self.requested_s.filter(|it| self.written.is_shorter_than(*it)) {
            write!(f, " of the {requested_s} s requested")?;
        }
        if !self.is_whole {
            let run = Written::of(&self.read.run);
            write!(f, " (the run has {}, {} s)", run.samples, seconds(run.length_s))?;
        }
        Ok(())
    }
}

/// Reads `from` and writes it to `to`. Unlike [`load`](super::load), it accepts a run with both drives, and writes both.
///
/// # Errors
/// The errors of [`load`](super::load) and [`save`](super::save).
pub fn convert(
    from: &Path,
    to: &Path,
    load: &LoadOptions,
    save: &SaveOptions,
) -> Result<Converted, RunError> {
    // With either choice the other drive is carried through, and both are written under their own names.
    let keep_both = LoadOptions { drive: load.drive.or(Some(DriveKind::CoilCurrent)), ..load.clone() };
    let read = super::load(from, &keep_both)?;
    let written = super::write_part(&read.run, to, save)?;
    let is_whole = save.part == RunSection::default() && save.resample_hz.is_none();
    Ok(Converted { read, written, requested_s: save.part.duration_s, is_whole })
}
