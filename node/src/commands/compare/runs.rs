//! Assignment of run files to experiments, and the runs as rows.

use super::error::CompareError;
use super::work::in_parallel;
use crate::commands::run_args::RunArgs;
use crate::settings::error::NodeError;
use mr_damper_model::compare::{Experiment, Replicate};
use mr_damper_model::condition::Conditioning;
use mr_damper_model::identify::{Dataset, DatasetOptions};
use mr_damper_model::rig;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Extensions of run files.
const EXTENSIONS: [&str; 5] = ["csv", "tsv", "txt", "mcap", "db3"];

/// The runs of one experiment, first replicate first.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::commands) struct PlannedExperiment {
    /// Its name.
    pub(in crate::commands) name: String,
    /// Number and path of each replicate.
    pub(in crate::commands) replicates: Vec<(u32, PathBuf)>,
    /// Number of training runs: the first so many replicates.
    pub(in crate::commands) training: usize,
}

/// The origin of a run.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::commands) struct Source {
    /// Name of the experiment.
    pub(in crate::commands) experiment: String,
    /// Number of the replicate.
    pub(in crate::commands) replicate: u32,
    /// SHA-256 of the file.
    pub(in crate::commands) sha256: String,
}

/// Experiments in `dir`: run files that differ only in a trailing `-NN`, and sub-folders with run files. The experiments of
/// the thesis come first, in its order; the others follow by name.
///
/// # Errors
/// When the folder cannot be read or holds no run, or two runs have the same number.
pub(in crate::commands) fn discover(dir: &Path) -> Result<Vec<PlannedExperiment>, NodeError> {
    let mut groups: BTreeMap<String, Vec<(Option<u32>, PathBuf)>> = BTreeMap::new();
    for path in entries(dir)? {
        if is_run(&path) {
            let (name, number) = name_and_number(&path);
            groups.entry(name).or_default().push((number, path));
        } else if path.is_dir() {
            let runs: Vec<PathBuf> = entries(&path)?.into_iter().filter(|entry| is_run(entry)).collect();
            if !runs.is_empty() {
                let numbered = runs.into_iter().map(|run| (name_and_number(&run).1, run));
                groups.entry(stem(&path)).or_default().extend(numbered);
            }
        }
    }
    if groups.is_empty() {
        return Err(NodeError::File {
            path: dir.to_owned(),
            message: "holds no runs: put the replicates of an experiment there as NAME-01.csv, NAME-02.csv, ..., or \
                      as a sub-folder of run files (`mr-damper simulate --experiment all --out DIR` writes examples)"
                .to_owned(),
        });
    }
    let mut planned =
        groups.into_iter().map(|(name, runs)| plan(dir, &name, runs)).collect::<Result<Vec<_>, _>>()?;
    let place = |p: &PlannedExperiment| {
        rig::Experiment::names().position(|name| name == p.name).unwrap_or(usize::MAX)
    };
    planned.sort_by_key(place);
    Ok(planned)
}

/// One experiment with all runs of `train`, and one for each run of `test`.
///
/// # Errors
/// When a run is given twice, in one list or in both.
pub(in crate::commands) fn given(
    train: &[PathBuf],
    test: &[PathBuf],
    read: &RunArgs,
) -> Result<Vec<PlannedExperiment>, NodeError> {
    let mut seen = BTreeSet::new();
    for path in train.iter().chain(test) {
        if read.holds(path) {
            if !seen.insert(path.clone()) {
                return Err(CompareError::RepeatedRun { run: path.clone() }.into());
            }
            continue;
        }
        let whole = path.canonicalize().map_err(NodeError::io(format!("opening {}", path.display())))?;
        if !seen.insert(whole) {
            return Err(CompareError::RepeatedRun { run: path.clone() }.into());
        }
    }
    let training = PlannedExperiment {
        name: "training".to_owned(),
        replicates: (1..).zip(train.iter().cloned()).collect(),
        training: train.len(),
    };
    let alone = |path: &PathBuf| PlannedExperiment {
        name: stem(path),
        replicates: vec![(1, path.clone())],
        training: 0,
    };
    Ok(std::iter::once(training).chain(test.iter().map(alone)).collect())
}

fn plan(dir: &Path, name: &str, runs: Vec<(Option<u32>, PathBuf)>) -> Result<PlannedExperiment, NodeError> {
    // Unless every name has a number, the replicates are numbered in the order of their names.
    let numbered = runs.iter().all(|(number, _)| number.is_some());
    let mut replicates: Vec<(u32, PathBuf)> = (1..)
        .zip(runs)
        .map(|(place, (number, path))| (number.filter(|_| numbered).unwrap_or(place), path))
        .collect();
    replicates.sort();
    if let Some(pair) = replicates.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        return Err(NodeError::File {
            path: dir.to_owned(),
            message: format!(
                "{} and {} are both replicate {} of {name}: rename one",
                pair[0].1.display(),
                pair[1].1.display(),
                pair[0].0
            ),
        });
    }
    let known = rig::Experiment::names().find(|known| known.eq_ignore_ascii_case(name));
    Ok(PlannedExperiment { name: known.unwrap_or(name).to_owned(), replicates, training: 1 })
}

/// The entries of a folder, sorted by name, without hidden ones.
fn entries(dir: &Path) -> Result<Vec<PathBuf>, NodeError> {
    let failed = |source| NodeError::Io { what: format!("reading {}", dir.display()), source };
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.file_name().is_some_and(|name| !name.to_string_lossy().starts_with('.')) {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

/// True for a run file or the directory of a bag.
fn is_run(path: &Path) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if path.is_dir() { path.join("metadata.yaml").exists() } else { EXTENSIONS.contains(&extension.as_str()) }
}

/// The name of a file without its extension, or the full name of a folder.
fn stem(path: &Path) -> String {
    let stem = if path.is_dir() { path.file_name() } else { path.file_stem() };
    stem.unwrap_or_default().to_string_lossy().into_owned()
}

/// Name of the experiment, and number of the replicate if the name ends in `-NN`.
fn name_and_number(path: &Path) -> (String, Option<u32>) {
    let stem = stem(path);
    let digits = |text: &str| (2..=4).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit());
    match stem.rsplit_once('-') {
        Some((name, number)) if !name.is_empty() && digits(number) => (name.to_owned(), number.parse().ok()),
        _ => (stem, None),
    }
}

/// Reads and conditions all runs, `threads` at a time, and calls `done` after each. A run is dropped when its rows are made,
/// so that only the rows stay in memory.
///
/// # Errors
/// The error of the first run that does not load or cannot be conditioned; [`NodeError::Interrupted`].
pub(in crate::commands) fn load(
    planned: &[PlannedExperiment],
    read: &RunArgs,
    (conditioning, options): (&Conditioning, &DatasetOptions),
    threads: usize,
    (cancel, done): (&AtomicBool, &(dyn Fn() + Sync)),
) -> Result<(Vec<Experiment>, Vec<Source>), NodeError> {
    let of = |(place, p): (usize, &'_ PlannedExperiment)| {
        let runs = p.replicates.iter();
        runs.map(|(number, path)| (place, p.name.clone(), *number, path.clone())).collect::<Vec<_>>()
    };
    let files: Vec<(usize, String, u32, PathBuf)> = planned.iter().enumerate().flat_map(of).collect();
    let rows = in_parallel(files.len(), threads, |index| -> Result<(Dataset, String), NodeError> {
        if cancel.load(Ordering::Relaxed) {
            return Err(NodeError::Interrupted);
        }
        let path = &files[index].3;
        let loaded = read.load(path)?;
        let mut data = Dataset::from_run(&loaded.run, conditioning, options)?;
        data.rows.shrink_to_fit();
        done();
        Ok((data, loaded.sha256_hex()))
    });
    let empty = |p: &PlannedExperiment| Experiment {
        name: p.name.clone(),
        replicates: Vec::new(),
        training: p.training,
        held_out: Vec::new(),
    };
    let mut experiments: Vec<Experiment> = planned.iter().map(empty).collect();
    let mut sources = Vec::new();
    for ((place, name, number, _), found) in files.iter().zip(rows) {
        let (data, sha256) = found?;
        experiments[*place].replicates.push(Replicate { number: *number, data });
        sources.push(Source { experiment: name.clone(), replicate: *number, sha256 });
    }
    Ok((experiments, sources))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(dir: &Path, names: &[&str]) {
        for name in names {
            let path = dir.join(name);
            std::fs::create_dir_all(path.parent().expect("a parent")).expect("room");
            std::fs::write(path, "").expect("room");
        }
    }

    #[test]
    fn files_group_by_stem_and_number() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let names =
            ["rp1-cs-02.csv", "rp1-cs-01.csv", "rp-icps-10.csv", "rp-icps-9.csv", "notes.md", "a-01.mcap"];
        touch(dir.path(), &names);
        touch(
            dir.path(),
            &["b-set/x.csv", "b-set/y.csv", "bag-03/metadata.yaml", "nothing/z.toml", ".h-01.csv"],
        );
        let found = discover(dir.path()).expect("runs");
        let short: Vec<(&str, Vec<u32>)> =
            found.iter().map(|p| (p.name.as_str(), p.replicates.iter().map(|r| r.0).collect())).collect();
        // A single digit is part of the name: a replicate's number has at least two digits.
        let expected = [
            ("RP-ICPS", vec![10]),
            ("RP1-CS", vec![1, 2]),
            ("a", vec![1]),
            ("b-set", vec![1, 2]),
            ("bag", vec![3]),
            ("rp-icps-9", vec![1]),
        ];
        assert_eq!(short, expected);
    }

    #[test]
    fn a_folder_without_runs_and_a_repeated_number_are_errors() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let error = discover(dir.path()).expect_err("nothing there").to_string();
        assert!(error.contains("NAME-01.csv"), "{error}");
        touch(dir.path(), &["a-01.csv", "a-01.mcap"]);
        let error = discover(dir.path()).expect_err("two runs of one number").to_string();
        assert!(error.contains("both replicate 1 of a"), "{error}");
        assert!(discover(&dir.path().join("absent")).is_err());
    }
}
