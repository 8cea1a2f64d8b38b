//! Writes files completely or not at all: to a temporary file in the same directory, which is synced to the disk and then
//! renamed. If the disk is full or the program is ended, the old file remains.

use super::RunError;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Writes `text` to `path`. A pipe or device, such as `/dev/null`, is written directly. A link stays a link, and an existing
/// file keeps its permissions.
///
/// # Errors
/// [`RunError::Io`], with advice.
pub fn write_text(path: &Path, text: &str) -> Result<(), RunError> {
    write_bytes(path, text.as_bytes())
}

/// Writes `bytes` to `path`, as [`write_text`] does.
///
/// # Errors
/// [`RunError::Io`], with advice.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), RunError> {
    // Links are followed to their target.
    let place = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let there = fs::metadata(&place).ok();
    if there.as_ref().is_some_and(|there| !there.is_file() && !there.is_dir()) {
        return fs::write(path, bytes).map_err(RunError::io(path, "write"));
    }
    write_beside(&place, |part| {
        fill(part, |sink| sink.write_all(bytes).map_err(RunError::io(path, "write")))?;
        let Some(there) = there else { return Ok(()) };
        fs::set_permissions(part, there.permissions()).map_err(RunError::io(path, "write"))
    })
}

/// Writes a file with the data that `content` writes to the sink.
pub(super) fn write_file(
    path: &Path,
    content: impl FnOnce(&mut BufWriter<File>) -> Result<(), RunError>,
) -> Result<(), RunError> {
    write_beside(path, |part| fill(part, content))
}

fn fill(
    part: &Path,
    content: impl FnOnce(&mut BufWriter<File>) -> Result<(), RunError>,
) -> Result<(), RunError> {
    let file = File::create(part).map_err(RunError::io(part, "create"))?;
    let mut sink = BufWriter::new(file);
    content(&mut sink)?;
    sink.flush().map_err(RunError::io(part, "write"))?;
    sink.get_ref().sync_all().map_err(RunError::io(part, "write to disk"))
}

/// The same for a writer that opens the file itself: `content` gets the temporary name.
pub(super) fn write_beside(
    path: &Path,
    content: impl FnOnce(&Path) -> Result<(), RunError>,
) -> Result<(), RunError> {
    let part = part_name(path);
    let written = (|| {
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(RunError::io(parent, "create"))?;
        }
        content(&part)?;
        fs::rename(&part, path).map_err(RunError::io(path, "create"))
    })();
    written.inspect_err(|_| {
        // The temporary file may not exist. The first error is the one that is returned.
        let _ = fs::remove_file(&part);
    })
}

fn part_name(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{}.part", std::process::id()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{PermissionsExt, symlink};

    #[test]
    fn a_text_replaces_the_old_one_and_leaves_no_other_file() {
        let dir = tempfile::tempdir().expect("a directory");
        let (path, link) = (dir.path().join("new/model.toml"), dir.path().join("link"));
        write_text(&path, "old").expect("written, with its directory");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).expect("ours");
        symlink(&path, &link).expect("a link");
        write_text(&link, "new").expect("written");
        assert_eq!(fs::read_to_string(&path).expect("there"), "new");
        assert!(fs::symlink_metadata(&link).expect("there").is_symlink());
        assert_eq!(fs::metadata(&path).expect("there").permissions().mode() & 0o777, 0o640);
        assert_eq!(fs::read_dir(dir.path().join("new")).expect("there").count(), 1);
    }

    #[test]
    fn a_device_is_written_directly_and_stays_a_device() {
        write_text(Path::new("/dev/null"), "gone").expect("written");
        assert!(!fs::metadata("/dev/null").expect("there").is_file());
        let full = write_text(Path::new("/dev/full"), "too much").expect_err("refused");
        assert!(full.to_string().starts_with("/dev/full: cannot write"), "{full}");
    }

    #[test]
    fn a_failed_write_keeps_the_old_file() {
        let dir = tempfile::tempdir().expect("a directory");
        let path = dir.path().join("run.csv");
        fs::write(&path, "old").expect("written");
        let broken = |sink: &mut BufWriter<File>| {
            sink.write_all(b"half").map_err(RunError::io(&path, "write"))?;
            Err(RunError::io(&path, "write")(std::io::ErrorKind::StorageFull.into()))
        };
        assert!(write_file(&path, broken).is_err());
        assert_eq!(fs::read_to_string(&path).expect("there"), "old");
        assert_eq!(fs::read_dir(dir.path()).expect("there").count(), 1);
        let taken = write_text(dir.path(), "a text cannot replace a directory").expect_err("refused");
        assert!(taken.to_string().contains("cannot create"), "{taken}");
    }
}
