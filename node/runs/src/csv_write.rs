//! Writes a run as CSV in canonical form: a fixed order of columns, exact times, and the shortest decimals that round-trip.
//! Reading such a file and writing it again gives the same bytes.

use super::column::Quantity;
use super::decimal::{push_nanos, push_value};
use super::{RunError, columns_of};
use mr_damper_model::sample::{Run, Stamp, Trace};
use std::io::Write;
use std::path::Path;

/// A trace and the position of the next sample to write.
struct Cursor<'a> {
    trace: &'a Trace,
    next: usize,
}

impl Cursor<'_> {
    fn stamp(&self) -> Option<Stamp> {
        self.trace.stamps.get(self.next).copied()
    }

    /// The value at `stamp`, if there is one; then advances to the next sample.
    fn take_at(&mut self, stamp: Stamp) -> Option<f64> {
        (self.stamp()? == stamp).then(|| {
            self.next += 1;
            self.trace.values[self.next - 1]
        })
    }
}

/// Writes `run` as CSV text. If channels have different stamps, a row has values only for the channels with its stamp; the
/// other cells are empty. `path` is used in messages.
///
/// # Errors
/// When the run has no displacement, two columns have the same name, or the sink fails.
pub(super) fn write(run: &Run, path: &Path, sink: impl Write) -> Result<(), RunError> {
    let columns = columns_of(run, path)?;
    let failed = |error: csv::Error| RunError::io(path, "write")(error.into());
    let mut writer = csv::Writer::from_writer(sink);
    writer.write_field("time_s").map_err(failed)?;
    for (name, _) in &columns {
        writer.write_field(name).map_err(failed)?;
    }
    writer.write_record(None::<&[u8]>).map_err(failed)?;

    let mut cursors: Vec<_> = columns.iter().map(|(_, trace)| Cursor { trace, next: 0 }).collect();
    let mut text = String::new();
    while let Some(stamp) = cursors.iter().filter_map(Cursor::stamp).min() {
        text.clear();
        push_nanos(&mut text, stamp.nanos());
        writer.write_field(&text).map_err(failed)?;
        for cursor in &mut cursors {
            text.clear();
            if let Some(value) = cursor.take_at(stamp) {
                push_value(&mut text, value);
            }
            writer.write_field(&text).map_err(failed)?;
        }
        writer.write_record(None::<&[u8]>).map_err(failed)?;
    }
    writer.flush().map_err(RunError::io(path, "write"))
}

/// Position of a column in a written file: known quantities in their fixed order, then all others in their given order.
pub(super) fn rank(name: &str) -> usize {
    match Quantity::of_si_name(name) {
        Some(quantity) => Quantity::ALL.iter().position(|&q| q == quantity).unwrap_or(Quantity::ALL.len()),
        None => Quantity::ALL.len(),
    }
}
