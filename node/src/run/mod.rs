//! Recorded runs on disk: CSV files and rosbag2 bags, in and out.
//!
//! [`load`] reads either into a [`Run`], [`save`] writes one, [`convert`] does both without loss: values keep
//! every bit, stamps every nanosecond, unknown columns their names. [`BagWriter`] is the writing half alone,
//! for live recording.
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
//! Each of these topics may also be of another type that holds such a quantity (`extract.rs`): `std_msgs/msg/Float64`, one joint of
//! a `sensor_msgs/msg/JointState`, and others. Channels in topics or columns of other names are mapped ([`Map`]). A [`Run`] has no place for variances and frame names, so these are the
//! parts of a recorded bag that a conversion drops; topics that are no part of a run are named in a note.
//!
//! A bag is a rosbag2 directory or one of its files alone, stored as MCAP or sqlite3, split or not, packed as
//! rosbag2 does it (`FILE`, `MESSAGE`, chunks of MCAP) or not. `storage.rs` makes one of all these.

mod bag;
mod bag_file;
mod bag_save;
mod bag_write;
mod column;
mod csv;
mod csv_write;
mod decimal;
mod error;
mod hash;
mod map;
mod mcap;
mod mcap_write;
mod metadata;
mod names;
mod pack;
mod sqlite;
mod sqlite_write;
mod storage;
mod suggest;
mod unit;
mod whole;
mod wire;

pub use bag_write::{BagOptions, BagSummary, BagWriter, Storage, Sync, Topic, TopicId};
pub use error::{MapFault, Note, RunError};
pub use map::{Map, MapError, Mapping};
pub(crate) use whole::write_text;

use hash::{Hash, HashingReader};
use mr_damper_model::sample::{DriveKind, Run, Stamp, Trace};
use std::borrow::Cow;
use std::fs::{self, File};
use std::path::Path;
use whole::write_file;

/// How a run is read.
#[derive(Debug, Clone, Default)]
pub struct LoadOptions {
    /// CSV: drop bad rows and count them, instead of refusing the file (`--skip-bad-rows`).
    pub skip_bad_rows: bool,
    /// CSV: the thesis' acquisition order without header (`--thesis-txt`).
    pub thesis_txt: bool,
    /// Which drive to use when both were recorded (`--drive`); the other is carried through.
    pub drive: Option<DriveKind>,
    /// Bags: the damper's namespace, such as `/front_left`; needed when a bag holds several.
    pub namespace: Option<String>,
    /// Bags: the joint to take from `sensor_msgs/msg/JointState` topics that are called as ours (`--bag-joint`).
    pub joint: Option<String>,
    /// Where channels come from whose topics or columns are called otherwise (`--map`).
    pub map: Map,
}

/// How a run is written.
#[derive(Debug, Clone, Default)]
pub struct SaveOptions {
    /// Bags: the namespace of the topics; empty for the root.
    pub namespace: String,
    /// Bags: chunks, compression and sync.
    pub bag: BagOptions,
    /// What of the run is written.
    pub part: Part,
}

/// A part of a run, by the time since its first displacement; by default all of it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Part {
    /// Where it begins, s.
    pub start_s: f64,
    /// How long it is, s; `None`: to the end.
    pub duration_s: Option<f64>,
}

impl Part {
    /// The part of `run`, or what is wrong with it.
    fn of<'a>(&self, run: &'a Run, path: &Path) -> Result<Cow<'a, Run>, RunError> {
        if *self == Self::default() {
            return Ok(Cow::Borrowed(run));
        }
        let first = run.displacement_m.stamps.first().copied().unwrap_or_default();
        let at = |seconds: f64| first.shifted((seconds * 1e9).round() as i64);
        let to = self.duration_s.map_or(Stamp::from_nanos(i64::MAX), |length| at(self.start_s + length));
        let cut = run.between(at(self.start_s), to);
        if self.start_s >= 0.0 && !cut.displacement_m.is_empty() {
            return Ok(Cow::Owned(cut));
        }
        Err(RunError::Unwritable {
            path: path.to_owned(),
            what: format!("the part from {} s on", self.start_s),
            why: format!(
                "the run has {:.3} s of displacement, and none of it is there",
                run.duration().get()
            ),
        })
    }
}

/// A run with what was noted while reading it.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// The run; its name is the path as given.
    pub run: Run,
    /// What the user should hear of.
    pub notes: Vec<Note>,
    /// SHA-256 of the file as it lies on the disk; of several files of a bag, of one after the other
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

/// True when a file at `path` is called as a run may be: `.csv` or text, `.mcap` or `.db3`, the latter two packed or not.
#[must_use]
pub fn is_named_as_a_run(path: &Path) -> bool {
    Storage::of_file(path).is_some() || matches!(extension(path).as_str(), "csv" | "txt" | "dat" | "tsv")
}

/// The channels that `run` has, by the names of their columns.
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

/// Reads a run from a CSV file, a rosbag2 directory, or a bare `.mcap` or `.db3` file, which may be packed
/// (`.mcap.zstd`, `.db3.zstd`).
///
/// # Errors
/// When the path is none of these, cannot be read, has faults that were not allowed by
/// `options`, or leaves a choice open (two drives, several namespaces). A bag that ends or breaks early is no
/// error: what could be read is in the run, the rest in the notes.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, RunError> {
    let mut notes = Vec::new();
    let mut hash = Hash::default();
    let is_dir = fs::metadata(path).map_err(RunError::io(path, "open"))?.is_dir();
    let extension = extension(path);
    let run = match extension.as_str() {
        _ if is_dir => {
            let files = metadata::files(path, &mut notes)?;
            bag::load(path, &files, options, &mut notes, &mut hash)?
        }
        _ if Storage::of_file(path).is_some() => {
            bag::load(path, &[path.to_owned()], options, &mut notes, &mut hash)?
        }
        "csv" | "txt" | "dat" | "tsv" | "" => load_csv(path, options, &mut notes, &mut hash)?,
        _ if options.thesis_txt => load_csv(path, options, &mut notes, &mut hash)?,
        "yaml" => {
            let why = "the metadata of a bag; name its directory".to_owned();
            return Err(RunError::NotARun { path: path.to_owned(), why });
        }
        other => return Err(RunError::NotARun { path: path.to_owned(), why: format!("a .{other} file") }),
    };
    Ok(Loaded { run, notes, sha256: hash.finish() })
}

fn load_csv(
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<Note>,
    hash: &mut Hash,
) -> Result<Run, RunError> {
    // Both CSV readers buffer by themselves.
    let file = File::open(path).map_err(RunError::io(path, "open"))?;
    csv::read(path, HashingReader::new(file, hash), options, notes)
}

/// Writes a run: to a `.csv` file in canonical form, to a bare `.mcap` or `.db3` file, or to a new bag directory when
/// the path has no extension.
///
/// # Errors
/// When the target exists or cannot be written, or the format cannot hold the run (a bag: times before 1970
/// or after 2038). Nothing is left behind then.
pub fn save(run: &Run, path: &Path, options: &SaveOptions) -> Result<(), RunError> {
    if path.symlink_metadata().is_ok() {
        return Err(RunError::Exists { path: path.to_owned() });
    }
    let run = &*options.part.of(run, path)?;
    match extension(path).as_str() {
        "csv" => write_file(path, |sink| csv_write::write(run, path, sink)),
        "mcap" => {
            bag_save::save_file(run, path, &options.namespace, options.bag.clone().stored(Storage::Mcap))
        }
        "db3" => {
            bag_save::save_file(run, path, &options.namespace, options.bag.clone().stored(Storage::Sqlite3))
        }
        "" => bag_save::save(run, path, &options.namespace, options.bag.clone()),
        _ => Err(RunError::Target { path: path.to_owned() }),
    }
}

/// Reads `from` and writes it to `to`; returns what was read. Unlike [`load`], it takes a run with both
/// drives as it is, and writes both.
///
/// # Errors
/// Those of [`load`] and [`save`].
pub fn convert(from: &Path, to: &Path, load: &LoadOptions, save: &SaveOptions) -> Result<Loaded, RunError> {
    // Either choice carries the other drive through, and both are written under their own names.
    let keep_both = LoadOptions { drive: load.drive.or(Some(DriveKind::CoilCurrent)), ..load.clone() };
    let loaded = self::load(from, &keep_both)?;
    self::save(&loaded.run, to, save)?;
    Ok(loaded)
}

fn extension(path: &Path) -> String {
    path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// The columns of a run as they are written, `displacement_m` first.
///
/// # Errors
/// When displacement is missing or two columns have one name, so that the result could not be read again.
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
