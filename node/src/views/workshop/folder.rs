//! The directory given with `--workshop`: runs, models and reports, and how files are added and removed.
//!
//! ```text
//! DIR/runs/NAME          a run, and NAME.about.json: how it is read and what it contains
//! DIR/incoming/          uploads in progress; emptied at the start
//! DIR/models/*.toml      models to replay with; diagnoses of the replayed damper write here
//! DIR/reports/           reports of diagnoses: NAME-DATE.json and .html
//! DIR/.lock              held while a server uses the directory
//! ```

use super::error::{UnknownDrive, WorkshopError};
use crate::settings::error::NodeError;
use mr_damper_model::sample::DriveKind;
use mr_damper_runs::{LoadOptions, Loaded, write_text};
use mr_damper_views::workshop::{About, ReadOptions, Refusal, RefusalKind};
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use tempfile::{NamedTempFile, TempPath};

/// Maximum number of characters of a name. It leaves room for prefixes and suffixes within the limit for file names.
const LONGEST: usize = 120;
/// Suffix of the file that describes a run.
const ABOUT: &str = ".about.json";

/// The loader's options.
///
/// # Errors
/// When the drive is neither `current_a` nor `command_v`.
pub(super) fn loader_options(reading: &ReadOptions) -> Result<LoadOptions, UnknownDrive> {
    let drive = match reading.drive.as_deref() {
        None => None,
        Some("current_a") => Some(DriveKind::CoilCurrent),
        Some("command_v") => Some(DriveKind::CommandVoltage),
        Some(other) => return Err(UnknownDrive { drive: other.to_owned() }),
    };
    Ok(LoadOptions {
        skip_bad_rows: reading.skip_bad_rows,
        thesis_txt: reading.thesis_txt,
        drive,
        namespace: reading.namespace.clone(),
        joint: reading.joint.clone(),
        ..LoadOptions::default()
    })
}

/// The description of a run that was loaded.
fn about(name: &str, bytes: u64, loaded: &Loaded, reading: &ReadOptions) -> About {
    let run = &loaded.run;
    About {
        name: name.to_owned(),
        bytes,
        length_s: run.duration().get(),
        rate_hz: run.displacement_m.mean_rate_hz(),
        samples: run.displacement_m.len(),
        channels: mr_damper_runs::channels(run).into_iter().map(str::to_owned).collect(),
        notes: loaded.notes.iter().filter(|note| note.is_warning()).map(ToString::to_string).collect(),
        sha256: loaded.sha256_hex(),
        reading: reading.clone(),
    }
}

/// The directory, locked by this process.
#[derive(Debug)]
pub(super) struct Folder {
    root: PathBuf,
    /// Kept open, because closing it releases the lock.
    _lock: File,
}

impl Folder {
    /// Opens the directory at `root`, and creates it if it is missing.
    ///
    /// # Errors
    /// When it cannot be created or written, or another server uses it.
    pub(super) fn open(root: &Path) -> Result<Self, NodeError> {
        let failed =
            |what: &str, path: &Path| NodeError::io(format!("--workshop: {what} {}", path.display()));
        let root = std::path::absolute(root).map_err(failed("finding", root))?;
        for part in ["runs", "incoming", "models", "reports"] {
            let part = root.join(part);
            fs::create_dir_all(&part).map_err(failed("creating the directory", &part))?;
        }
        let lock_path = root.join(".lock");
        let lock = File::create(&lock_path).map_err(failed("making", &lock_path))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(WorkshopError::FolderInUse { folder: root }.into()),
            Err(TryLockError::Error(error)) => return Err(failed("locking", &lock_path)(error)),
        }
        let folder = Self { root, _lock: lock };
        // A server that was killed may have left incomplete uploads.
        folder.sweep();
        Ok(folder)
    }

    /// Removes incomplete uploads.
    pub(super) fn sweep(&self) {
        let left = self.entries("incoming").unwrap_or_else(|error| {
            tracing::warn!("{error}");
            Vec::new()
        });
        for (path, _) in left {
            match fs::remove_file(&path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    tracing::warn!(path = %path.display(), %error, "cannot remove an incomplete upload");
                }
                _ => {}
            }
        }
    }

    /// Path of the directory.
    #[must_use]
    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// Path of the directory of models.
    #[must_use]
    pub(super) fn models_dir(&self) -> PathBuf {
        self.root.join("models")
    }

    /// Names of the model files, sorted.
    ///
    /// # Errors
    /// When the directory cannot be read.
    pub(super) fn models(&self) -> Result<Vec<String>, NodeError> {
        let names = self.entries("models")?.into_iter().map(|(_, name)| name);
        Ok(names.filter(|name| name.ends_with(".toml")).collect())
    }

    /// Names of the pages of reports, newest first.
    ///
    /// # Errors
    /// When the directory cannot be read.
    pub(super) fn reports(&self) -> Result<Vec<String>, NodeError> {
        let written = |path: &Path| fs::metadata(path).and_then(|about| about.modified()).ok();
        let mut all = self.entries("reports")?;
        all.retain(|(_, name)| name.ends_with(".html"));
        all.sort_by_cached_key(|(path, name)| std::cmp::Reverse((written(path), name.clone())));
        Ok(all.into_iter().map(|(_, name)| name).collect())
    }

    /// Names of the runs, sorted.
    ///
    /// # Errors
    /// When the directory cannot be read.
    pub(super) fn runs(&self) -> Result<Vec<String>, NodeError> {
        let names = self.entries("runs")?.into_iter().map(|(_, name)| name);
        Ok(names.filter(|name| !name.ends_with(ABOUT)).collect())
    }

    /// The entries of a subdirectory, sorted by name. Entries with names that [`safe_name`] would change or refuse are ignored.
    fn entries(&self, part: &str) -> Result<Vec<(PathBuf, String)>, NodeError> {
        let path = self.root.join(part);
        let reading = || NodeError::io(format!("reading {}", path.display()));
        let mut all = Vec::new();
        for entry in fs::read_dir(&path).map_err(reading())? {
            let entry = entry.map_err(reading())?;
            if let Ok(name) = entry.file_name().into_string()
                && safe_name(&name).is_ok_and(|safe| safe == name)
            {
                all.push((entry.path(), name));
            }
        }
        all.sort();
        Ok(all)
    }

    /// Path of the run named `name`.
    #[must_use]
    pub(super) fn run(&self, name: &str) -> PathBuf {
        self.root.join("runs").join(name)
    }

    /// Creates a temporary file for an upload that will be named `name`. Dropping the result deletes the file unless it was
    /// kept.
    ///
    /// # Errors
    /// When the file cannot be created.
    pub(super) fn incoming(&self, name: &str) -> Result<NamedTempFile, NodeError> {
        let part = self.root.join("incoming");
        // The loader needs the extension at the end of the name.
        let file = tempfile::Builder::new().prefix("upload-").suffix(&format!("-{name}")).tempfile_in(&part);
        file.map_err(NodeError::io(format!("creating a file in {}", part.display())))
    }

    /// Loads a complete upload and keeps it as the run named `name`; a number is added to the name if it exists already.
    ///
    /// # Errors
    /// The loader's error when the run cannot be used; then nothing is kept.
    pub(super) fn keep(&self, upload: TempPath, name: &str, reading: &ReadOptions) -> Result<About, Refusal> {
        let options = loader_options(reading)?;
        let loaded = mr_damper_runs::load(&upload, &options).map_err(|error| {
            // Replace the temporary name, which the user does not know.
            let says = error.to_string().replace(&upload.display().to_string(), name);
            Refusal::new(RefusalKind::Wrong, format!("{says}. The upload is not kept"))
        })?;
        let bytes =
            fs::metadata(&upload).map_err(NodeError::io(format!("reading {}", upload.display())))?.len();
        let mut upload = upload;
        for number in 1_u32.. {
            let name = numbered(name, number);
            let about_path = self.root.join("runs").join(format!("{name}{ABOUT}"));
            match upload.persist_noclobber(self.run(&name)) {
                Ok(()) => {
                    let found = about(&name, bytes, &loaded, reading);
                    write_text(&about_path, &mr_damper_views::watch::json(&found))
                        .map_err(NodeError::from)?;
                    return Ok(found);
                }
                Err(taken) if taken.error.kind() == std::io::ErrorKind::AlreadyExists => upload = taken.path,
                Err(failed) => return Err(NodeError::io(format!("saving {name}"))(failed.error).into()),
            }
        }
        Err(Refusal::new(RefusalKind::Failed, format!("there are too many runs named {name}; delete some")))
    }

    /// Description of the run named `name`: from the file written at its upload, or by loading the run.
    ///
    /// # Errors
    /// When the description or the run cannot be read.
    pub(super) fn about(&self, name: &str) -> Result<About, NodeError> {
        let path = self.root.join("runs").join(format!("{name}{ABOUT}"));
        if let Ok(text) = fs::read_to_string(&path) {
            let about: About = serde_json::from_str(&text).map_err(|error| NodeError::File {
                path: path.clone(),
                message: format!("{error}; delete this file, and the run is loaded to describe it again"),
            })?;
            return Ok(about);
        }
        let path = self.run(name);
        let bytes = fs::metadata(&path).map_err(NodeError::io(format!("reading {}", path.display())))?.len();
        let reading = ReadOptions::default();
        Ok(about(name, bytes, &mr_damper_runs::load(&path, &LoadOptions::default())?, &reading))
    }

    /// Deletes the run named `name`.
    ///
    /// # Errors
    /// When it cannot be deleted.
    pub(super) fn delete(&self, name: &str) -> Result<(), NodeError> {
        let path = self.run(name);
        let gone = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        gone.map_err(NodeError::io(format!("deleting {}", path.display())))?;
        // A run that was copied here by hand has no description.
        let _ = fs::remove_file(self.root.join("runs").join(format!("{name}{ABOUT}")));
        Ok(())
    }

    /// Writes a report on the damper named `damper`, as JSON and as a page, and returns the page's name.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub(super) fn write_report(
        &self,
        damper: &str,
        stamp: &str,
        json: &str,
        page: &str,
    ) -> Result<String, NodeError> {
        let damper = safe_name(&damper.replace([':', '/', ' '], "-")).unwrap_or_else(|_| "damper".to_owned());
        let name = format!("{damper}-{stamp}");
        let reports = self.root.join("reports");
        write_text(&reports.join(format!("{name}.json")), json)?;
        write_text(&reports.join(format!("{name}.html")), page)?;
        Ok(format!("{name}.html"))
    }

    /// The report named `name`.
    ///
    /// # Errors
    /// When it does not exist.
    pub(super) fn report(&self, name: &str) -> Result<Vec<u8>, Refusal> {
        let missing = || Refusal::new(RefusalKind::Missing, format!("a report named {name} does not exist"));
        if safe_name(name).as_deref() != Ok(name) {
            return Err(missing());
        }
        fs::read(self.root.join("reports").join(name)).map_err(|_| missing())
    }
}

/// `name` with `number` before its extension, unless `number` is one.
fn numbered(name: &str, number: u32) -> String {
    if number == 1 {
        return name.to_owned();
    }
    let (stem, extension) = name.split_at(name.find('.').unwrap_or(name.len()));
    format!("{stem}-{number}{extension}")
}

/// Reasons why a name is not the name of a file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum NameError {
    /// The name is empty.
    #[error("a run needs a name: POST /runs?name=run.csv")]
    Empty,
    /// The name contains a directory.
    #[error("\"{name}\" names a path: give a file name without directories")]
    Path {
        /// The name.
        name: String,
    },
    /// The name begins with a dot.
    #[error("\"{name}\" begins with a dot: give it another name")]
    Hidden {
        /// The name.
        name: String,
    },
    /// The name is too long.
    #[error("the name has more than {LONGEST} characters: give a shorter one")]
    TooLong,
}

/// `name` as a safe file name: ASCII letters, digits, `.`, `_` and `-`; other characters become `_`.
///
/// # Errors
/// When the name is empty, begins with a dot, contains a path, or is too long.
pub(super) fn safe_name(name: &str) -> Result<String, NameError> {
    if name.is_empty() {
        return Err(NameError::Empty);
    }
    if name.contains(['/', '\\', '\0']) {
        return Err(NameError::Path { name: name.to_owned() });
    }
    if name.starts_with('.') {
        return Err(NameError::Hidden { name: name.to_owned() });
    }
    if name.chars().count() > LONGEST {
        return Err(NameError::TooLong);
    }
    let safe = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' };
    Ok(name.chars().map(safe).collect())
}

/// Like [`safe_name`], for the name of a run, which must have the extension of a run file.
///
/// # Errors
/// Errors of [`safe_name`]; when the extension is not known.
pub(super) fn run_name(name: &str) -> Result<String, Refusal> {
    let name = safe_name(name).map_err(|why| Refusal::new(RefusalKind::Wrong, why.to_string()))?;
    if mr_damper_runs::is_named_as_a_run(Path::new(&name)) && !name.ends_with(ABOUT) {
        return Ok(name);
    }
    Err(Refusal::new(
        RefusalKind::Wrong,
        format!(
            "{name} does not have the extension of a run: give a CSV file (.csv, .txt, .dat, .tsv) or a bag file (.mcap, .db3, or either \
             with .zstd); from a bag directory, upload the file in it"
        ),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_made_safe_or_refused() {
        for (given, safe) in [
            ("run.csv", "run.csv"),
            ("a b (2).csv", "a_b__2_.csv"),
            ("übung.mcap", "_bung.mcap"),
            ("a\nb.csv", "a_b.csv"),
            ("C:run.csv", "C_run.csv"),
            ("a..b.csv", "a..b.csv"),
        ] {
            assert_eq!(run_name(given).as_deref(), Ok(safe), "{given}");
        }
        let long = format!("{}.csv", "a".repeat(LONGEST));
        for bad in [
            "",
            ".csv",
            "..",
            "../../name",
            "../x.csv",
            "/etc/x.csv",
            "a\\b.csv",
            "a\0.csv",
            ".hidden.csv",
            "run.exe",
            "run",
            "metadata.yaml",
            "x.csv.about.json",
            long.as_str(),
        ] {
            let refused = run_name(bad).expect_err(bad);
            assert_eq!(refused.kind, RefusalKind::Wrong, "{bad}");
        }
    }

    #[test]
    fn runs_are_never_overwritten_and_refused_uploads_leave_no_file() {
        let dir = tempfile::tempdir().expect("a directory");
        let folder = Folder::open(&dir.path().join("new/shop")).expect("it is created");
        let upload = |text: &str, reading: &ReadOptions| {
            let file = folder.incoming("run.csv").expect("room");
            fs::write(file.path(), text).expect("room");
            folder.keep(file.into_temp_path(), "run.csv", reading)
        };
        let good = "time_s,displacement_m,force_n\n0,0,1\n0.5,0.001,2\n1,0.002,3\n";
        let first = upload(good, &ReadOptions::default()).expect("a run");
        assert_eq!((first.name.as_str(), first.samples, first.length_s), ("run.csv", 3, 1.0));
        assert_eq!(first.channels, ["displacement_m", "force_n"]);
        let second = upload(&good.replace("0.002", "0.003"), &ReadOptions::default()).expect("a run");
        assert_eq!(second.name, "run-2.csv");
        assert_eq!(fs::read_to_string(folder.run("run.csv")).expect("kept"), good);
        assert_eq!(folder.about("run-2.csv").expect("written down"), second);

        let refused = upload("time_s,displacement_m\n0,0\n0,1\n", &ReadOptions::default())
            .expect_err("time does not increase");
        assert!(
            refused.says.starts_with("run.csv, line 3") && refused.says.ends_with("The upload is not kept"),
            "{}",
            refused.says
        );
        let odd = ReadOptions { drive: Some("steam".to_owned()), ..ReadOptions::default() };
        assert!(upload(good, &odd).expect_err("not a drive").says.contains("\"steam\""));
        assert_eq!(folder.runs().expect("readable"), ["run-2.csv", "run.csv"]);
        assert_eq!(folder.entries("incoming").expect("readable").len(), 0);

        folder.delete("run.csv").expect("it is there");
        assert_eq!(
            fs::read_dir(dir.path().join("new/shop/runs")).expect("readable").count(),
            2,
            "a run and its description"
        );
    }

    #[test]
    fn one_server_uses_the_directory_and_incomplete_uploads_are_removed_at_the_start() {
        let dir = tempfile::tempdir().expect("a directory");
        let folder = Folder::open(dir.path()).expect("made");
        let refused = Folder::open(dir.path()).expect_err("it is open").to_string();
        assert!(refused.contains("another mr-damper serve has"), "{refused}");
        fs::write(dir.path().join("incoming/upload-x-run.csv"), "half").expect("room");
        drop(folder);
        let folder = Folder::open(dir.path()).expect("it is free");
        assert_eq!(folder.entries("incoming").expect("readable").len(), 0);
    }

    #[test]
    fn only_names_without_paths_read_reports() {
        let dir = tempfile::tempdir().expect("a directory");
        let folder = Folder::open(dir.path()).expect("made");
        let name = folder.write_report("workshop: a/b.csv", "20260101T000000Z", "{}", "<p>").expect("room");
        assert_eq!(name, "workshop--a-b.csv-20260101T000000Z.html");
        assert_eq!(folder.report(&name).as_deref(), Ok(&b"<p>"[..]));
        assert_eq!(folder.reports().expect("readable"), [name]);
        for bad in ["../.lock", "..", ".lock", "nothing.html", "../reports/x"] {
            assert_eq!(folder.report(bad).expect_err(bad).kind, RefusalKind::Missing);
        }
    }
}
