//! What the tests of runs on disk share.

use mr_damper_msgs::Displacement;
use mr_damper_msgs::standard::{Header, Time};
use mr_damper_node::run::{BagOptions, BagWriter, LoadOptions, Loaded, RunError, load};
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
    let files = std::fs::read_dir(bag).expect("listed").map(|entry| entry.expect("entry").path());
    files.into_iter().find(|path| path.extension().is_some_and(|e| e == "mcap")).expect("an MCAP file")
}

pub(crate) fn at(nanos: i64) -> Header {
    Header { stamp: Time::from_nanos(nanos).expect("in range"), frame_id: String::new() }
}

pub(crate) fn displacement(nanos: i64, displacement: f64) -> Displacement {
    Displacement { header: at(nanos), displacement, variance: 0.0 }
}

/// Writes a bag by hand.
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
