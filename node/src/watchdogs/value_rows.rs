//! Rows of the values of effects on disk, in the layout of the Python module `mr_damper.fleet` (guide 17): one CSV file an hour.
//!
//! ```text
//! DIR/values/damper=front_left/day=2026-11-27/1795766400000000000.csv        named after the first stamp in it
//! ```
//!
//! A file appears whole. Rows that cannot be written are kept, and written with the rows of the next hour.

use crate::settings::error::NodeError;
use chrono::{DateTime, SecondsFormat};
use mr_damper_model::effect::Effect;
use mr_damper_model::tracking::EffectValue;
use mr_damper_runs::write_text;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

/// Length of a file, ns.
const HOUR_NS: i64 = 3_600_000_000_000;
/// Rows that are kept while they cannot be written: ten values, each minute for a week.
const MOST_ROWS: usize = 100_000;
/// The columns, with their units. `value_rows.rs` and `_store.py` name the same.
const COLUMNS: &str = "time,effect,form,parameter,running,value,low,high,\
                       displacement_std_m,velocity_rms_m_s,drive_share,window_s";

/// The rows of the current hour.
pub(crate) struct ValueRows {
    dir: PathBuf,
    damper: String,
    /// Each value, with the length of its window in seconds.
    rows: Vec<(EffectValue, f64)>,
    /// The last attempt to write failed, and the log says so.
    failed: bool,
}

impl ValueRows {
    /// Rows of `damper` for the folder `dir`.
    pub(crate) fn new(dir: &Path, damper: &str) -> Self {
        // A node without a namespace has the name of the program.
        let damper = if damper.is_empty() { "mr_damper" } else { damper }.to_owned();
        Self { dir: dir.to_owned(), damper, rows: Vec::new(), failed: false }
    }

    pub(crate) fn dir(&self) -> &Path {
        &self.dir
    }

    /// Takes a value. The first one of another hour writes those before it.
    pub(crate) fn add(&mut self, value: &EffectValue, window_s: f64) {
        let hour = |value: &EffectValue| value.stamp.nanos().div_euclid(HOUR_NS);
        // After a failure the rows are of several hours; the last one says when to try again.
        if self.rows.last().is_some_and(|(last, _)| hour(last) != hour(value)) {
            self.flush();
        }
        if self.rows.len() < MOST_ROWS {
            self.rows.push((*value, window_s));
        }
    }

    /// Writes the rows so far.
    fn flush(&mut self) {
        let by_day = self.rows.chunk_by(|(a, _), (b, _)| day(a) == day(b));
        match by_day.map(|rows| self.write(rows)).collect::<Result<Vec<()>, NodeError>>() {
            Ok(_) => {
                self.rows.clear();
                self.failed = false;
            }
            Err(error) => {
                if !self.failed {
                    tracing::warn!(
                        "the values of effects stay in memory and are written later (parameter effects.out): {error}"
                    );
                }
                self.failed = true;
            }
        }
    }

    /// Writes the rows of a day.
    fn write(&self, rows: &[(EffectValue, f64)]) -> Result<(), NodeError> {
        let Some((first, _)) = rows.first() else { return Ok(()) };
        let dir = self
            .dir
            .join("values")
            .join(format!("damper={}", encoded(&self.damper)))
            .join(format!("day={}", day(first)));
        fs::create_dir_all(&dir).map_err(NodeError::io(format!("creating {}", dir.display())))?;
        Ok(write_text(&dir.join(format!("{}.csv", first.stamp.nanos())), &text(rows))?)
    }
}

impl Drop for ValueRows {
    fn drop(&mut self) {
        self.flush();
    }
}

/// The day of a stamp in UTC.
fn day(value: &EffectValue) -> String {
    DateTime::from_timestamp_nanos(value.stamp.nanos()).format("%Y-%m-%d").to_string()
}

/// The name of a damper in the name of a folder: other characters than letters, digits, `-`, `.` and `_` as in URLs.
fn encoded(damper: &str) -> String {
    damper.bytes().fold(String::new(), |mut text, byte| {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' => text.push(char::from(byte)),
            _ => {
                let _ = write!(text, "%{byte:02X}");
            }
        }
        text
    })
}

/// The file. A value that does not exist is an empty cell.
fn text(rows: &[(EffectValue, f64)]) -> String {
    let mut text = format!("{COLUMNS}\n");
    for (value, window_s) in rows {
        let time = DateTime::from_timestamp_nanos(value.stamp.nanos());
        let effect = value.quantity.effect();
        let _ = write!(
            text,
            "{},{},{},{}",
            time.to_rfc3339_opts(SecondsFormat::Nanos, true),
            effect.map_or("", Effect::id),
            effect.and_then(Effect::form).unwrap_or_default(),
            value.quantity.name()
        );
        let [stroke, speed, drive] = value.excitation;
        let [low, high] = value.ci95;
        for number in [value.running, value.value, low, high, stroke.exp(), speed.exp(), drive, *window_s] {
            let _ = if number.is_finite() { write!(text, ",{number}") } else { write!(text, ",") };
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::sample::Stamp;
    use mr_damper_model::tracking::Quantity;

    fn value(hour: i64, quantity: Quantity, value: f64) -> EffectValue {
        EffectValue {
            stamp: Stamp::from_nanos(1_795_766_400_000_000_001 + hour * HOUR_NS),
            quantity,
            running: 1.0,
            value,
            ci95: [value - 0.5, value + 0.5],
            windows: 3,
            excitation: [0.0, 0.0, 0.25],
            changed: false,
        }
    }

    #[test]
    fn each_hour_is_a_file_and_the_last_one_is_written_at_the_end() {
        let dir = tempfile::tempdir().expect("a directory");
        let lag = Quantity::Effect { effect: Effect::CoilLag, parameter: 0 };
        let mut rows = ValueRows::new(dir.path(), "car 1/front_left");
        for value in [
            value(0, Quantity::ForceRatio, 1.5),
            value(0, lag, f64::NAN),
            value(30, Quantity::ForceRatio, 2.0),
        ] {
            rows.add(&value, 60.0);
        }
        drop(rows);
        let read = |name: &str| {
            let damper = dir.path().join("values/damper=car%201%2Ffront_left");
            fs::read_to_string(damper.join(name)).expect("a file")
        };
        // `model/python/tests/test_fleet.py` reads this text.
        assert_eq!(
            read("day=2026-11-27/1795766400000000001.csv"),
            "time,effect,form,parameter,running,value,low,high,displacement_std_m,velocity_rms_m_s,drive_share,window_s\n\
             2026-11-27T08:00:00.000000001Z,,,force_ratio,1,1.5,1,2,1,1,0.25,60\n\
             2026-11-27T08:00:00.000000001Z,coil_lag,one_tau,tau_s,1,,,,1,1,0.25,60\n"
        );
        assert!(
            read("day=2026-11-28/1795874400000000001.csv").ends_with("force_ratio,1,2,1.5,2.5,1,1,0.25,60\n")
        );
    }

    #[test]
    fn rows_that_cannot_be_written_are_kept() {
        let dir = tempfile::tempdir().expect("a directory");
        let out = dir.path().join("out");
        fs::write(&out, "in the way").expect("a file");
        let mut rows = ValueRows::new(&out, "");
        for hour in 0..2 {
            rows.add(&value(hour, Quantity::ForceRatio, 1.0), 60.0);
        }
        fs::remove_file(&out).expect("removed");
        rows.add(&value(2, Quantity::ForceRatio, 1.0), 60.0);
        drop(rows);
        let day = out.join("values/damper=mr_damper/day=2026-11-27");
        let files =
            fs::read_dir(day).expect("a folder").map(|file| fs::read_to_string(file.expect("a file").path()));
        let lines: usize = files.map(|text| text.expect("a text").lines().count() - 1).sum();
        assert_eq!(lines, 3);
    }
}
