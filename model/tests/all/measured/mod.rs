//! Measured runs of real dampers. They are not part of this repository; `MR_DAMPER_DATA` is their folder (default `../shared/data` from
//! the workspace).

use mr_damper_model::sample::{DriveKind, Run, Stamp, Trace};
use std::path::{Path, PathBuf};

/// The runs of one folder, sorted by name. Tests that use them are ignored, because they need the folder.
pub(crate) fn folder(name: &str) -> Vec<Run> {
    let root = std::env::var_os("MR_DAMPER_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let entries = std::fs::read_dir(root.join(name)).unwrap_or_else(|error| {
        panic!("no measured data in {}: {error}; set MR_DAMPER_DATA", root.join(name).display())
    });
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("a readable folder").path()).collect();
    paths.retain(|path| path.extension().is_some_and(|e| e == "csv"));
    paths.sort();
    paths.iter().map(|path| read(path)).collect()
}

/// A simple reader for these CSV files; the full reader is in the node crate.
fn read(path: &Path) -> Run {
    let text = std::fs::read_to_string(path).expect("a readable file");
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let mut columns = vec![Trace::default(); names.len()];
    let time = names.iter().position(|name| *name == "time_s").expect("time_s");
    for line in lines {
        let values: Vec<f64> = line.split(',').map(|cell| cell.parse().expect("a number")).collect();
        let stamp = Stamp::from_seconds(values[time]).expect("a time");
        for (column, value) in columns.iter_mut().zip(values) {
            column.stamps.push(stamp);
            column.values.push(value);
        }
    }
    let column = |name| names.iter().position(|n| *n == name).map(|j| columns[j].clone());
    let current = column("current_a").map(|trace| (DriveKind::CoilCurrent, trace));
    Run {
        name: path.file_stem().expect("a name").to_string_lossy().into_owned(),
        displacement_m: column("displacement_m").expect("displacement_m"),
        velocity_m_s: column("velocity_m_s"),
        force_n: column("force_n"),
        drive: current.or_else(|| column("command_v").map(|trace| (DriveKind::CommandVoltage, trace))),
        ..Run::default()
    }
}
