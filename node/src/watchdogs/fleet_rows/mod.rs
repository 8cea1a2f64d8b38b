//! Rows about a running damper on disk, in the layout of the Python module `mr_damper.fleet` (guide 17): a CSV file an hour for each table.
//!
//! ```text
//! DIR/TABLE/damper=front_left/day=2026-11-27/1795766400000000000.csv        named after the first stamp of the hour
//! ```
//!
//! | table | a row is |
//! |---|---|
//! | `hours` | the hour: number of estimates and valid estimates, RMSE of the simulation, refused samples, changes of mode, alarms |
//! | `residuals` | a region of velocity and drive: number, mean and RMSE of the residuals |
//! | `values` | a value of an effect in a window, if effects are tracked |
//!
//! Time is the time of the stamps. A file appears whole. Files that cannot be written are kept in memory for a week, and written later.

mod regions;

use crate::settings::config::Config;
use crate::settings::error::NodeError;
use crate::watchdogs::effect_watch::WindowValues;
use chrono::{DateTime, SecondsFormat};
use mr_damper_model::pipeline::{Estimate, Event, Validity};
use mr_damper_model::sample::Stamp;
use mr_damper_model::tracking::EffectValue;
use mr_damper_runs::write_text;
use regions::Regions;
use std::collections::VecDeque;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

/// Length of an hour, ns.
const HOUR_NS: i64 = 3_600_000_000_000;
/// Files that are kept while they cannot be written: three tables for a week.
const MOST_FILES: usize = 3 * 24 * 7;

// The columns of the tables, with their units. `model/python/python/mr_damper/fleet/_store.py` names the same.
const HOURS: &str = "time,duration_s,estimates,valid,residuals,rmse_n,refused,mode_changes,alarms";
const RESIDUALS: &str =
    "run,time,velocity_from_m_s,velocity_to_m_s,drive_from,drive_to,samples,mean_n,rmse_n";
const VALUES: &str = "time,effect,form,parameter,running,value,low,high,\
                      displacement_std_m,velocity_rms_m_s,drive_share,window_s,model_hash";

/// The rows of a damper.
pub(crate) struct FleetRows {
    dir: PathBuf,
    damper: String,
    /// The hour so far; `None` before the first estimate.
    hour: Option<Hour>,
    regions: Regions,
    /// Files that are to be written: path below the folder, and text.
    files: VecDeque<(PathBuf, String)>,
    /// The last attempt to write failed, and the log says so.
    failed: bool,
}

/// Counts and sums of an hour.
struct Hour {
    first: Stamp,
    last: Stamp,
    estimates: u64,
    valid: u64,
    residuals: u64,
    squares_n2: f64,
    refused: u64,
    mode_changes: u64,
    alarms: u64,
    /// Rows of the values of effects.
    values: Vec<String>,
}

impl Hour {
    const fn beginning(first: Stamp) -> Self {
        Self {
            first,
            last: first,
            estimates: 0,
            valid: 0,
            residuals: 0,
            squares_n2: 0.0,
            refused: 0,
            mode_changes: 0,
            alarms: 0,
            values: Vec::new(),
        }
    }

    const fn number(&self) -> i64 {
        self.first.nanos().div_euclid(HOUR_NS)
    }

    fn row(&self) -> String {
        let rmse_n = (self.squares_n2 / self.residuals as f64).sqrt();
        format!(
            "{},{},{},{},{},{},{},{},{}",
            time(self.first),
            (self.last.nanos() - self.first.nanos()) as f64 / 1e9,
            self.estimates,
            self.valid,
            self.residuals,
            cell(rmse_n),
            self.refused,
            self.mode_changes,
            self.alarms
        )
    }
}

impl FleetRows {
    /// Rows of the damper in `namespace` for the folder `dir`.
    pub(crate) fn new(dir: &Path, namespace: &str) -> Self {
        // A node without a namespace has the name of the program.
        let damper = if namespace.is_empty() { "mr_damper" } else { namespace }.to_owned();
        let (files, regions) = (VecDeque::new(), Regions::default());
        Self { dir: dir.to_owned(), damper, hour: None, regions, files, failed: false }
    }

    /// Begins, ends or moves `rows` as the parameter `fleet.out` asks.
    pub(crate) fn follow(rows: &mut Option<Self>, config: &Config, namespace: &str) {
        let out = Path::new(&config.fleet_out);
        if rows.as_ref().map_or(Path::new(""), |rows| rows.dir.as_path()) != out {
            *rows = (!config.fleet_out.is_empty()).then(|| Self::new(out, namespace));
        }
    }

    /// Takes an event of the running pipeline, and the values of effects from the window that it completed.
    pub(crate) fn take(&mut self, event: &Event, window: Option<&WindowValues<'_>>) {
        // An estimate in silence has no sample.
        let sampled = |estimate: &Estimate| estimate.received.is_some();
        if let Event::Estimate(estimate) = event
            && sampled(estimate)
        {
            let number = estimate.stamp.nanos().div_euclid(HOUR_NS);
            if self.hour.as_ref().is_some_and(|hour| hour.number() != number) {
                self.end_hour();
            }
        }
        let hour = match (&mut self.hour, event) {
            (Some(hour), _) => hour,
            (none, Event::Estimate(estimate)) if sampled(estimate) => {
                none.insert(Hour::beginning(estimate.stamp))
            }
            _ => return,
        };
        match event {
            Event::Input(sample) => self.regions.input(sample),
            Event::Estimate(estimate) if sampled(estimate) => {
                hour.last = estimate.stamp;
                hour.estimates += 1;
                hour.valid += u64::from(estimate.validity == Validity::Valid);
            }
            Event::Residual(residual) => {
                hour.residuals += 1;
                hour.squares_n2 += residual.residual.get().powi(2);
                self.regions.residual(residual);
            }
            Event::Refusal(_) => hour.refused += 1,
            Event::Transition(_) => hour.mode_changes += 1,
            Event::Alarm(alarm) => hour.alarms += u64::from(alarm.raised),
            Event::Estimate(_) | Event::Command(_) => {}
        }
        hour.values.extend(window.into_iter().flat_map(WindowValues::rows));
    }

    /// Writes the hour so far.
    fn end_hour(&mut self) {
        let Some(hour) = self.hour.take() else { return };
        let (begin, first_ns) = (time(hour.first), hour.first.nanos());
        let regions = self.regions.take();
        let tables = [
            ("hours", HOURS, vec![hour.row()]),
            ("residuals", RESIDUALS, regions.iter().map(|region| format!(",{begin},{region}")).collect()),
            ("values", VALUES, hour.values),
        ];
        let day = DateTime::from_timestamp_nanos(first_ns).format("%Y-%m-%d");
        for (table, columns, rows) in tables.into_iter().filter(|(.., rows)| !rows.is_empty()) {
            let folder = format!("{table}/damper={}/day={day}", encoded(&self.damper));
            let path = Path::new(&folder).join(format!("{first_ns}.csv"));
            self.files.push_back((path, format!("{columns}\n{}\n", rows.join("\n"))));
        }
        while self.files.len() > MOST_FILES {
            self.files.pop_front();
        }
        self.write();
    }

    /// Writes the files that wait.
    fn write(&mut self) {
        while let Some((path, text)) = self.files.front() {
            if let Err(error) = write(&self.dir.join(path), text) {
                if !self.failed {
                    tracing::warn!(
                        "the rows of an hour stay in memory and are written later (parameter fleet.out): {error}"
                    );
                }
                self.failed = true;
                return;
            }
            self.files.pop_front();
        }
        self.failed = false;
    }
}

impl Drop for FleetRows {
    fn drop(&mut self) {
        self.end_hour();
        if !self.files.is_empty() {
            tracing::warn!(
                files = self.files.len(),
                folder = %self.dir.display(),
                "rows are lost: they could not be written before the end (parameter fleet.out)"
            );
        }
    }
}

fn write(path: &Path, text: &str) -> Result<(), NodeError> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(NodeError::io(format!("creating {}", folder.display())))?;
    }
    Ok(write_text(path, text)?)
}

/// A stamp in UTC.
fn time(stamp: Stamp) -> String {
    DateTime::from_timestamp_nanos(stamp.nanos()).to_rfc3339_opts(SecondsFormat::Nanos, true)
}

/// A number; one that does not exist is an empty cell.
fn cell(number: f64) -> String {
    if number.is_finite() { number.to_string() } else { String::new() }
}

impl WindowValues<'_> {
    fn rows(&self) -> impl Iterator<Item = String> {
        self.values.iter().map(|value| row_of(value, self.window_s, self.model_hash))
    }
}

/// The row of a value.
fn row_of(value: &EffectValue, window_s: f64, model_hash: &str) -> String {
    let quantity = value.quantity;
    let (id, form, name) = (quantity.effect_id(), quantity.form(), quantity.name());
    let mut row = format!("{},{id},{form},{name}", time(value.stamp));
    let [stroke, speed, drive] = value.excitation;
    let [low, high] = value.ci95;
    for number in [value.running, value.value, low, high, stroke.exp(), speed.exp(), drive, window_s] {
        let _ = write!(row, ",{}", cell(number));
    }
    let _ = write!(row, ",{model_hash}");
    row
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

#[cfg(test)]
mod tests;
