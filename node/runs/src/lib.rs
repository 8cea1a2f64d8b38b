//! Reads and writes recorded runs: CSV files and rosbag2 bags; reads logs of a CAN bus, and its frames for a running node ([`bus`]).
//!
//! [`load`] reads any format into a [`Run`], [`save`] writes a run, and [`convert`] does both without loss: values stay
//! bit-identical, stamps keep every nanosecond, unknown columns keep their names. [`BagWriter`] only writes, for live
//! recording.
//!
//! | column | topic below the namespace | type |
//! |---|---|---|
//! | `displacement_m` | `displacement` | `mr_damper_msgs/msg/Displacement` |
//! | `velocity_m_s` | `velocity` | `mr_damper_msgs/msg/Velocity` |
//! | `force_n` | `measured_force` | `mr_damper_msgs/msg/Force` |
//! | `current_a` | `coil_current` | `mr_damper_msgs/msg/CoilCurrent` |
//! | `command_v` | `command_voltage` | `mr_damper_msgs/msg/CommandVoltage` |
//! | `case_temp_c` | `case_temperature` | `sensor_msgs/msg/Temperature` |
//! | `body_velocity_m_s` | `body_velocity` | `mr_damper_msgs/msg/Velocity` |
//! | `force_request_n` | `force_request` | `mr_damper_msgs/msg/Force` |
//! | `ambient_temp_c` | `ambient_temperature` | `sensor_msgs/msg/Temperature` |
//! | any other | `other/<column>` | `std_msgs/msg/Float64`, stamped by its log time |
//!
//! Each of these topics may also have another type that holds such a quantity (`extract.rs`): `std_msgs/msg/Float64`, one
//! joint of a `sensor_msgs/msg/JointState`, and others. Channels in topics or columns with other names need a [`Map`]. A
//! [`Run`] cannot hold variances and frame names, so a conversion drops them. A note names the topics that do not belong to
//! the run.
//!
//! A bag is a rosbag2 directory or a single file of one, stored as MCAP or sqlite3, split or not, compressed in one of
//! rosbag2's ways (`FILE`, `MESSAGE`, chunks of MCAP) or not. `storage.rs` hides these differences.

mod bag;
mod bag_file;
mod bag_save;
mod bag_sink;
mod bag_types;
mod bag_write;
pub mod bus;
mod column;
mod convert;
mod csv;
mod csv_write;
mod cycles;
mod decimal;
mod error;
pub mod extract;
mod frame;
mod hash;
mod map;
mod mcap;
mod mcap_write;
mod metadata;
mod names;
mod note;
mod pack;
mod recording;
mod resample;
mod sign;
mod sqlite;
mod sqlite_write;
mod storage;
mod suggest;
mod unit;
mod whole;
mod wire;

pub use bag_save::BagMessages;
pub use bag_types::{BagOptions, Storage, Sync, Topic};
pub use bag_write::{BagSummary, BagWriter, TopicId};
pub use convert::{Converted, Written, convert};
pub use error::{DbcFault, LineFault, MapFault, RunError};
pub use frame::{Column, Values, from_columns, of_run};
pub use map::{ColumnMapping, Map, MapError, MapFileError, Mapping};
pub use note::Note;
pub use recording::{RecordedMessage, Recording, is_bag};
pub use sign::{Sign, SignError};
pub use whole::{write_bytes, write_text};

use hash::{Hash, HashingReader};
use mr_damper_base::shown;
use mr_damper_model::sample::{DriveKind, Run, Stamp, Trace};
use std::borrow::Cow;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use whole::write_file;

/// The time of `stamp` in seconds as in the CSV files of runs: decimal text, exact to the nanosecond.
#[must_use]
pub fn seconds_text(stamp: Stamp) -> String {
    let mut text = String::new();
    decimal::push_nanos(&mut text, stamp.nanos());
    text
}

/// How a run is read.
#[derive(Debug, Clone, Default)]
pub struct LoadOptions {
    /// CSV: drop bad rows and count them, instead of refusing the file (`--skip-bad-rows`).
    pub skip_bad_rows: bool,
    /// CSV: the thesis' acquisition order without header (`--thesis-txt`).
    pub thesis_txt: bool,
    /// Drive to use if both were recorded (`--drive`); the other one is carried through.
    pub drive: Option<DriveKind>,
    /// Bags: the damper's namespace, such as `/front_left`; required if a bag holds several dampers.
    pub namespace: Option<String>,
    /// Bags: the joint to read from `sensor_msgs/msg/JointState` topics that have the node's topic names (`--bag-joint`).
    pub joint: Option<String>,
    /// Logs of a bus: the DBC files that describe its messages (`--dbc`).
    pub dbc: Vec<PathBuf>,
    /// Sources of channels whose topics, columns or signals have other names (`--map`).
    pub map: Map,
    /// Signs of channels (`--sign`), applied to the values in SI units after the map.
    pub signs: Vec<Sign>,
}

/// How a run is written.
#[derive(Debug, Clone, Default)]
pub struct SaveOptions {
    /// Bags: the namespace of the topics; empty for the root.
    pub namespace: String,
    /// Bags: chunks, compression and sync.
    pub bag: BagOptions,
    /// The part of the run that is written.
    pub part: RunSection,
    /// The rate that the run is resampled to before it is cut, Hz; `None` keeps its samples.
    pub resample_hz: Option<f64>,
}

/// A part of a run, in time since its first displacement; by default the whole run.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RunSection {
    /// Start, s.
    pub start_s: f64,
    /// Duration, s; `None` means to the end of the run.
    pub duration_s: Option<f64>,
    /// First and last cycle, both included, counted from 1; `None` means all. Start and duration then count within them.
    pub cycles: Option<(u32, u32)>,
    /// Move start and end to starts of cycles: the start to the next one, the end to the one before.
    pub whole_cycles: bool,
}

impl RunSection {
    /// Cuts the part out of `run`. It is an error if the part contains no displacement.
    fn of<'a>(&self, run: &'a Run, path: &Path) -> Result<Cow<'a, Run>, RunError> {
        if *self == Self::default() {
            return Ok(Cow::Borrowed(run));
        }
        let unwritable =
            |what: String, why: String| RunError::Unwritable { path: path.to_owned(), what, why };
        let starts = match self.cycles.is_some() || self.whole_cycles {
            true => cycles::starts(&run.displacement_m),
            false => Vec::new(),
        };
        let first = run.displacement_m.stamps.first().copied().unwrap_or_default();
        let (mut from, mut to, mut length_s) = (first, Stamp::from_nanos(i64::MAX), run.duration().get());
        let no_cycle = "displacement never rises twice through the middle of its range, so the run has no whole cycle: cut it with \
                        --start and --duration alone";
        if let Some((begin, end)) = self.cycles {
            // The end of a cycle is the start of the next one.
            let start = |cycle: u32| starts.get(cycle as usize).copied();
            match (begin.checked_sub(1).and_then(start), start(end)) {
                (Some(begins), Some(ends)) if begin <= end => {
                    (from, to, length_s) = (begins, ends, ends.since(begins).get());
                }
                _ => {
                    let (what, whole) = (format!("cycles {begin}:{end}"), starts.len().saturating_sub(1));
                    let why = match whole {
                        0 => no_cycle.to_owned(),
                        _ => format!(
                            "the run has {}, in which displacement rises through the middle of its range; give the first and the \
                             last, from 1:1 to 1:{whole}",
                            shown::count(whole, "whole cycle")
                        ),
                    };
                    return Err(unwritable(what, why));
                }
            }
        }
        let at = |seconds: f64| from.shifted((seconds * 1e9).round() as i64);
        let end = self.duration_s.map_or(to, |length| at(self.start_s + length).min(to));
        let (mut from, mut to) = (at(self.start_s), end);
        if self.whole_cycles {
            let has_cycle = starts.len() > 1;
            let within: Vec<Stamp> =
                starts.into_iter().filter(|start| *start >= from && *start <= to).collect();
            match within.as_slice() {
                [begin, .., end] => (from, to) = (*begin, *end),
                _ => {
                    let what = format!("whole cycles from {} s on", self.start_s);
                    let why = match has_cycle {
                        true => {
                            "this part of the run holds no whole cycle: make it longer, or leave --whole-cycles out"
                        }
                        false => no_cycle,
                    };
                    return Err(unwritable(what, why.to_owned()));
                }
            }
        }
        let cut = run.between(from, to);
        if self.start_s >= 0.0 && !cut.displacement_m.is_empty() {
            return Ok(Cow::Owned(cut));
        }
        let in_cycles =
            self.cycles.map(|(begin, end)| format!(" in cycles {begin}:{end}")).unwrap_or_default();
        let what = format!("the part from {} s on{in_cycles}", self.start_s);
        let why = match self.duration_s {
            _ if self.start_s.is_nan() || self.start_s < 0.0 => "the start must be 0 s or more".to_owned(),
            Some(duration_s) if duration_s.is_nan() || duration_s <= 0.0 => {
                format!("its duration is {duration_s} s, but must be above 0 s")
            }
            _ if self.start_s < length_s => {
                "no sample of displacement is in this part: give a longer duration".to_owned()
            }
            _ if self.cycles.is_some() => format!(
                "these cycles end {length_s:.3} s after they begin, and the start counts from there: give an earlier start"
            ),
            _ => format!(
                "the run has {length_s:.3} s of displacement, none of it in this part: give an earlier start"
            ),
        };
        Err(unwritable(what, why))
    }
}

/// A run, and the notes on reading it.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// The run; its name is the path as given.
    pub run: Run,
    /// Notes for the user.
    pub notes: Vec<Note>,
    /// SHA-256 of the file on disk. For a bag with several files, the hash of all files in order
    /// (`cat *.mcap | sha256sum`).
    pub sha256: [u8; 32],
}

impl Loaded {
    /// The SHA-256 as 64 hexadecimal digits.
    #[must_use]
    pub fn sha256_hex(&self) -> String {
        self.sha256.iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// True if the name of the file at `path` may be the name of a run: `.csv`, a text file, `.mcap` or `.db3`, compressed or
/// not. Logs of a bus are not among them: they need a DBC file and a map.
#[must_use]
pub fn is_named_as_a_run(path: &Path) -> bool {
    Storage::of_file(path).is_some() || matches!(extension(path).as_str(), "csv" | "txt" | "dat" | "tsv")
}

/// The column names of the channels in `run`.
#[must_use]
pub fn channels(run: &Run) -> Vec<&str> {
    let known = [
        ("displacement_m", Some(&run.displacement_m)),
        ("velocity_m_s", run.velocity_m_s.as_ref()),
        ("force_n", run.force_n.as_ref()),
        (run.drive_kind().map_or("", DriveKind::name), run.drive.as_ref().map(|(_, trace)| trace)),
        ("case_temp_c", run.case_temp_c.as_ref()),
        ("body_velocity_m_s", run.body_velocity_m_s.as_ref()),
        ("force_request_n", run.force_request_n.as_ref()),
    ];
    let known = known.into_iter().filter(|(_, trace)| trace.is_some_and(|trace| !trace.is_empty()));
    known.map(|(name, _)| name).chain(run.other.iter().map(|(name, _)| name.as_str())).collect()
}

/// Reads a run from a CSV file, a rosbag2 directory, a bare `.mcap` or `.db3` file, which may be compressed
/// (`.mcap.zstd`, `.db3.zstd`), or a log of a CAN bus: MDF4 (`.mf4`, `.mdf`), Vector's ASC and BLF, candump (`.log`).
///
/// # Errors
/// When the path is none of these, cannot be read, has faults that `options` do not allow, or leaves a choice open (two
/// drives, several namespaces). A bag that ends early or is damaged is not an error: the run holds all data that could be
/// read, and the notes describe the rest.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, RunError> {
    let mut notes = Vec::new();
    let mut hash = Hash::default();
    let is_dir = fs::metadata(path).map_err(RunError::io(path, "open"))?.is_dir();
    let extension = extension(path);
    let log = bus::Format::of(&extension).filter(|_| !options.thesis_txt);
    let mut run = match extension.as_str() {
        _ if is_dir => {
            let files = metadata::files(path, &mut notes)?;
            bag::load(path, &files, options, &mut notes, &mut hash)?
        }
        _ if Storage::of_file(path).is_some() => {
            bag::load(path, &[path.to_owned()], options, &mut notes, &mut hash)?
        }
        "csv" | "txt" | "dat" | "tsv" | "" => load_csv(path, options, &mut notes, &mut hash)?,
        named => match log {
            Some(format) => bus::load(path, format, options, &mut notes, &mut hash)?,
            None if options.thesis_txt => load_csv(path, options, &mut notes, &mut hash)?,
            None => return Err(not_a_run(path, named)),
        },
    };
    sign::apply(&options.signs, &mut run, path)?;
    Ok(Loaded { run, notes, sha256: hash.finish() })
}

/// The error for a file that no reader takes.
fn not_a_run(path: &Path, extension: &str) -> RunError {
    let why = match extension {
        "yaml" => "the metadata of a bag; name its directory".to_owned(),
        other => format!("a .{other} file"),
    };
    RunError::NotARun { path: path.to_owned(), why }
}

fn load_csv(
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<Note>,
    hash: &mut Hash,
) -> Result<Run, RunError> {
    // Both CSV readers have their own buffer.
    let file = File::open(path).map_err(RunError::io(path, "open"))?;
    csv::read(path, HashingReader::new(file, hash), options, notes)
}

/// Writes a run: to a `.csv` file in canonical form, to a bare `.mcap` or `.db3` file, or to a new bag directory if the
/// path has no extension.
///
/// # Errors
/// When the target exists or cannot be written, or the format cannot hold the run (a bag: times before 1970 or after 2038).
/// After an error no partial output remains.
pub fn save(run: &Run, path: &Path, options: &SaveOptions) -> Result<(), RunError> {
    write_part(run, path, options).map(|_| ())
}

/// [`save`], with the displacement that was written.
fn write_part(run: &Run, path: &Path, options: &SaveOptions) -> Result<Written, RunError> {
    refuse_existing(path)?;
    let even = options.resample_hz.map(|rate_hz| resample::resampled(run, rate_hz, path)).transpose()?;
    let run = &*options.part.of(even.as_ref().unwrap_or(run), path)?;
    match extension(path).as_str() {
        "csv" => write_file(path, |sink| csv_write::write(run, path, sink))?,
        _ => write_bag(run, path, &options.namespace, &options.bag, &mut bag_save::RunAlone)?,
    }
    Ok(Written::of(run))
}

/// Writes a run, with topics below `namespace`, and `messages` as a bag: to a bare `.mcap` or `.db3` file, or to a new bag directory if
/// the path has no extension.
///
/// # Errors
/// As [`save`].
pub fn save_with(
    run: &Run,
    path: &Path,
    namespace: &str,
    options: &BagOptions,
    messages: &mut dyn BagMessages,
) -> Result<(), RunError> {
    refuse_existing(path)?;
    write_bag(run, path, namespace, options, messages)
}

fn refuse_existing(path: &Path) -> Result<(), RunError> {
    match path.symlink_metadata() {
        Ok(_) => Err(RunError::Exists { path: path.to_owned() }),
        Err(_) => Ok(()),
    }
}

fn write_bag(
    run: &Run,
    path: &Path,
    namespace: &str,
    options: &BagOptions,
    messages: &mut dyn BagMessages,
) -> Result<(), RunError> {
    let stored = |storage| options.clone().stored(storage);
    match extension(path).as_str() {
        "mcap" => bag_save::save_file(run, path, namespace, stored(Storage::Mcap), messages),
        "db3" => bag_save::save_file(run, path, namespace, stored(Storage::Sqlite3), messages),
        "" => bag_save::save(run, path, namespace, options.clone(), messages),
        _ => Err(RunError::Target { path: path.to_owned() }),
    }
}

fn extension(path: &Path) -> String {
    path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// The columns of a run in the order in which they are written, `displacement_m` first.
///
/// # Errors
/// When displacement is missing or two columns have the same name, because the result could not be read again.
fn columns_of<'a>(run: &'a Run, path: &Path) -> Result<Vec<(&'a str, &'a Trace)>, RunError> {
    if run.displacement_m.is_empty() {
        let hint = "a run without it cannot be written".to_owned();
        return Err(RunError::NoDisplacement { path: path.to_owned(), hint });
    }
    let mut columns = vec![("displacement_m", &run.displacement_m)];
    columns.extend(run.velocity_m_s.as_ref().map(|trace| ("velocity_m_s", trace)));
    columns.extend(run.force_n.as_ref().map(|trace| ("force_n", trace)));
    columns.extend(run.drive.as_ref().map(|(kind, trace)| (kind.name(), trace)));
    columns.extend(run.case_temp_c.as_ref().map(|trace| ("case_temp_c", trace)));
    columns.extend(run.body_velocity_m_s.as_ref().map(|trace| ("body_velocity_m_s", trace)));
    columns.extend(run.force_request_n.as_ref().map(|trace| ("force_request_n", trace)));
    columns.extend(run.other.iter().map(|(name, trace)| (name.as_str(), trace)));
    columns.sort_by_key(|(name, _)| csv_write::rank(name));
    for (index, (name, trace)) in columns.iter().enumerate() {
        let fail = |why: &str| RunError::Unwritable {
            path: path.to_owned(),
            what: format!("column `{name}`"),
            why: why.to_owned(),
        };
        if name.trim().is_empty()
            || *name == "time_s"
            || columns[..index].iter().any(|(other, _)| other == name)
        {
            return Err(fail("its name is empty, reserved or used twice: rename it"));
        }
        if trace.stamps.len() != trace.values.len() || !trace.stamps.is_sorted_by(|a, b| a < b) {
            return Err(fail("it needs one value for each stamp and stamps that increase"));
        }
    }
    Ok(columns)
}
