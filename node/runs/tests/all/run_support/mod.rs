//! Helpers that the tests of runs on disk share, those of `mr-damper-node` too; each test uses a part of them.

pub(crate) mod foreign;

pub(crate) use foreign::{OF_BAG, foreign, ours_csv};

use mr_damper_model::sample::Run;
use mr_damper_msgs::standard::{Header, Time};
use mr_damper_msgs::{Displacement, Force};
use mr_damper_runs::{BagOptions, BagWriter, LoadOptions, Loaded, Note, RunError, Storage, load};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

pub(crate) fn temporary() -> TempDir {
    tempfile::tempdir().expect("temporary directory")
}

pub(crate) fn plain() -> LoadOptions {
    LoadOptions::default()
}

pub(crate) fn read(path: &Path) -> Loaded {
    load(path, &plain()).unwrap_or_else(|error| panic!("{error}"))
}

pub(crate) fn refusal(path: &Path, options: &LoadOptions) -> String {
    let error = load(path, options).expect_err("must be refused").to_string();
    let parent = path.parent().map(|parent| format!("{}/", parent.display())).unwrap_or_default();
    error.replace(&parent, "")
}

/// The one MCAP file of a bag.
pub(crate) fn mcap_of(bag: &Path) -> PathBuf {
    file_of(bag, "mcap")
}

/// The one file of a bag with this extension.
pub(crate) fn file_of(bag: &Path, extension: &str) -> PathBuf {
    let found: Vec<_> =
        files_of(bag).into_iter().filter(|path| path.extension().is_some_and(|e| e == extension)).collect();
    assert_eq!(found.len(), 1, "{found:?}");
    found.into_iter().next().expect("one")
}

/// All files of a bag, by name.
pub(crate) fn files_of(bag: &Path) -> Vec<PathBuf> {
    let files = std::fs::read_dir(bag).expect("listed").map(|entry| entry.expect("entry").path());
    let mut files: Vec<_> = files.collect();
    files.sort();
    files
}

/// Every file in a directory with its bytes, to check that nothing was changed.
pub(crate) fn contents(dir: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    files_of(dir).into_iter().map(|path| (path.clone(), std::fs::read(path).expect("read"))).collect()
}

/// A CSV text in canonical form with all known columns, both drives, other columns, and empty cells.
pub(crate) fn canonical(rows: usize) -> String {
    let mut text =
        "time_s,displacement_m,velocity_m_s,force_n,current_a,command_v,case_temp_c,ambient_temp_c,\
                    setpoint_m,Pump [bar],pump_bar,2nd\n"
            .to_owned();
    for row in 0..rows {
        let (x, t) = (row as f64 * 0.1, 1_700_000_000_000_000_001 + row as i64 * 1_234_567);
        let time = format!("{}.{:09}", t / 1_000_000_000, t % 1_000_000_000);
        let time = time.trim_end_matches('0');
        let force = if row % 3 == 0 { String::new() } else { format!("{}", x.cos() * 1000.0) };
        writeln!(text, "{time},{},{x},{force},0.1,-0,20.5,21,{},1e-300,,{row}", x.sin(), x / 3.0)
            .expect("text");
    }
    text
}

/// True if every channel of `part` is a prefix of the same channel of `whole`.
pub(crate) fn is_prefix(part: &Run, whole: &Run) -> bool {
    let force = |run: &Run| run.force_n.clone().unwrap_or_default();
    whole.displacement_m.stamps.starts_with(&part.displacement_m.stamps)
        && whole.displacement_m.values.starts_with(&part.displacement_m.values)
        && force(whole).stamps.starts_with(&force(part).stamps)
        && force(whole).values.starts_with(&force(part).values)
}

/// Writes 1000 samples of displacement and force, 1 ms apart, each with the value `sin(step)`.
pub(crate) fn thousand(dir: &Path, options: BagOptions) {
    samples(dir, options, 1000);
}

/// Like [`thousand`], with another number of samples.
pub(crate) fn samples(dir: &Path, options: BagOptions, count: i64) {
    bag(dir, options, |writer| {
        for step in 1..=count {
            let (nanos, value) = (step * 1_000_000, (step as f64).sin());
            let force = Force { header: at(nanos), force: value, variance: 0.0 };
            writer.write_message("/measured_force", &force, nanos, nanos)?;
            writer.write_message("/displacement", &displacement(nanos, value), nanos, nanos)?;
        }
        Ok(())
    });
}

/// Options for an uncompressed database.
pub(crate) fn sqlite() -> BagOptions {
    BagOptions::default().stored(Storage::Sqlite3)
}

pub(crate) fn at(nanos: i64) -> Header {
    Header { stamp: Time::from_nanos(nanos).expect("in range"), frame_id: String::new() }
}

pub(crate) fn displacement(nanos: i64, displacement: f64) -> Displacement {
    Displacement { header: at(nanos), displacement, variance: 0.0 }
}

/// Writes a bag message by message.
pub(crate) fn bag(
    dir: &Path,
    options: BagOptions,
    fill: impl FnOnce(&mut BagWriter) -> Result<(), RunError>,
) {
    let mut writer = BagWriter::create(dir, options).expect("created");
    fill(&mut writer).expect("filled");
    let _summary = writer.finish().expect("finished");
}

/// Small chunks, so that a short bag has many.
pub(crate) fn small_chunks(compress: bool) -> BagOptions {
    BagOptions { chunk_max_bytes: 2000, compress, ..BagOptions::default() }
}

/// Cuts a file whose run is `all` every `step` bytes. Checks that the part before the cut is read, and that later cuts never give
/// fewer samples. `noted` gets the notes, the length and the number of samples, and must find a note on the cut. Returns the largest
/// number of samples of a cut file.
pub(crate) fn read_cut_short(
    whole: &[u8],
    all: &Run,
    cut: &Path,
    step: usize,
    noted: impl Fn(&[Note], u64, usize) -> bool,
) -> usize {
    let mut last = 0;
    for length in (0..whole.len()).step_by(step) {
        std::fs::write(cut, &whole[..length]).expect("written");
        match load(cut, &plain()) {
            Ok(loaded) => {
                assert!(is_prefix(&loaded.run, all), "at {length}");
                let samples = loaded.run.displacement_m.len();
                assert!(samples >= last, "{samples} samples at {length} after {last}");
                assert!(noted(&loaded.notes, length as u64, samples), "at {length}: {:?}", loaded.notes);
                last = samples;
            }
            // Before the first displacement there is no run.
            Err(error) => assert_eq!(last, 0, "at {length}: {error}"),
        }
    }
    last
}
