//! The files that a command writes. It checks them before it begins: none may be a file that it reads, and none may be written twice.

use super::output::OutputArgs;
use crate::settings::error::NodeError;
use std::path::{Path, PathBuf};

/// Endings of runs. A model, a report or JSON under such a name would be taken for a run, and has most likely been typed by mistake.
const RUNS: [&str; 10] = ["csv", "mcap", "db3", "zstd", "mf4", "log", "asc", "blf", "parquet", "dbc"];

/// A file that a command writes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Target<'a> {
    /// Option that names it.
    option: &'static str,
    path: &'a Path,
    may_be_run: bool,
}

impl<'a> Target<'a> {
    /// A model, a report or JSON.
    #[must_use]
    pub(crate) const fn new(option: &'static str, path: &'a Path) -> Self {
        Self { option, path, may_be_run: false }
    }

    /// A run or a table.
    #[must_use]
    pub(crate) const fn run_or_table(option: &'static str, path: &'a Path) -> Self {
        Self { option, path, may_be_run: true }
    }

    fn has_name_of_run(&self) -> bool {
        let ending = self.path.extension().and_then(|ending| ending.to_str());
        !self.may_be_run
            && ending.is_some_and(|ending| RUNS.iter().any(|run| ending.eq_ignore_ascii_case(run)))
    }
}

impl OutputArgs {
    /// The files that will be written, the JSON file first.
    pub(crate) fn targets(&self) -> impl Iterator<Item = Target<'_>> {
        let report = self.report.as_deref().and_then(|path| named("--report", path));
        json(self.json.as_deref()).into_iter().chain(report)
    }

    /// Their paths.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.targets().map(|target| target.path)
    }
}

/// The target that `option` names, unless it is stdout.
fn named<'a>(option: &'static str, path: &'a Path) -> Option<Target<'a>> {
    (path != Path::new("-")).then_some(Target::new(option, path))
}

/// The target of `--json`, if it is a file.
#[must_use]
pub(crate) fn json(path: Option<&Path>) -> Option<Target<'_>> {
    named("--json", path?)
}

/// Checks `targets` against each other and against `inputs`, the files that the command reads.
///
/// # Errors
/// [`NodeError::Usage`] if a target is an input or another target, or has the name of a run and is none.
pub(crate) fn check<'a>(
    inputs: impl IntoIterator<Item = &'a Path>,
    targets: impl IntoIterator<Item = Target<'a>>,
) -> Result<(), NodeError> {
    let inputs: Vec<PathBuf> = inputs.into_iter().map(identity).collect();
    let mut before: Vec<(Target<'_>, PathBuf)> = Vec::new();
    for target in targets {
        let (Target { option, path, .. }, own) = (target, identity(target.path));
        let path = path.display();
        if inputs.contains(&own) {
            return Err(NodeError::Usage(format!(
                "{option} {path} is also an input, and would be overwritten: give another file"
            )));
        }
        if let Some((other, _)) = before.iter().find(|(_, other)| *other == own) {
            return Err(NodeError::Usage(format!(
                "{} and {option} are the same file, {path}, and one would overwrite the other: give two files",
                other.option
            )));
        }
        if target.has_name_of_run() {
            return Err(NodeError::Usage(format!(
                "{option} {path} has the name of a run, and this is none: give a name with another ending"
            )));
        }
        before.push((target, own));
    }
    Ok(())
}

/// The path without links and dots, as far as it exists.
fn identity(path: &Path) -> PathBuf {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let new = || Some(folder.canonicalize().ok()?.join(path.file_name()?));
    path.canonicalize().ok().or_else(new).unwrap_or_else(|| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(inputs: &[&Path], targets: &[Target<'_>]) -> String {
        check(inputs.iter().copied(), targets.iter().copied()).expect_err("it is refused").to_string()
    }

    #[test]
    fn a_file_that_is_read_or_written_twice_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let (run, other) = (folder.path().join("run.csv"), folder.path().join("./run.csv"));
        std::fs::write(&run, "time_s\n").expect("written");
        let link = folder.path().join("link.csv");
        std::os::unix::fs::symlink(&run, &link).expect("linked");
        for out in [&run, &other, &link] {
            let said = refusal(&[&run], &[Target::run_or_table("--out", out)]);
            assert!(said.contains("--out") && said.contains("is also an input"), "{said}");
        }
        let (model, same) = (folder.path().join("m.toml"), folder.path().join("./m.toml"));
        let said = refusal(&[&run], &[Target::new("--out", &model), Target::new("--json", &same)]);
        assert!(said.contains("--out and --json are the same file"), "{said}");
        let said = refusal(&[], &[Target::new("--report", Path::new("other.CSV"))]);
        assert!(said.contains("has the name of a run"), "{said}");
    }

    #[test]
    fn new_files_and_stdout_are_allowed() {
        let output = OutputArgs { report: Some("r.html".into()), json: Some("-".into()), kept: None };
        assert_eq!(output.targets().count(), 1);
        let out = Target::new("--out", Path::new("m.toml"));
        check([Path::new("a.csv")], output.targets().chain([out])).expect("three files");
        let table = Target::run_or_table("--coefficients", Path::new("c.csv"));
        check([Path::new("a.csv")], [out, table]).expect("a table is not a run that is read");
    }
}
