//! `metadata.yaml` of a rosbag2 directory: writes version 9, as ROS 2 Jazzy does, and reads any version.

use super::bag_types::Storage;
use super::{Note, RunError};
use serde::Deserialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Name of the file in the bag.
pub(super) const FILE_NAME: &str = "metadata.yaml";

/// Version of the format that is written.
pub(super) const VERSION: u32 = 9;

/// The ROS distribution of that format.
pub(super) const ROS_DISTRO: &str = "jazzy";

/// The offered quality of service that is recorded for every topic. It is the one that the node publishes with, and
/// `ros2 bag play` can offer it to any subscriber. Infinite durations are written as in rmw.
const QOS: &str = "\
- history: keep_last
  depth: 10
  reliability: reliable
  durability: volatile
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false
";

/// The quality of service as YAML text for the files.
pub(super) fn offered_qos() -> &'static str {
    QOS.trim_end()
}

/// A topic of a written bag.
pub(super) struct TopicEntry<'a> {
    pub(super) name: &'a str,
    pub(super) type_name: &'a str,
    pub(super) type_hash: &'a str,
    pub(super) messages: u64,
}

/// A file of a written bag.
#[derive(Debug, Clone)]
pub(super) struct FileEntry {
    /// Its name in the bag's directory.
    pub(super) name: String,
    /// First and last log time in nanoseconds; `None` without messages.
    pub(super) bounds: Option<(u64, u64)>,
    pub(super) messages: u64,
}

/// The content of a written bag.
pub(super) struct Written<'a> {
    pub(super) storage: Storage,
    /// True if its files are compressed with zstd.
    pub(super) packed: bool,
    pub(super) files: &'a [FileEntry],
    pub(super) topics: Vec<TopicEntry<'a>>,
}

/// Start and duration in nanoseconds; without messages the start is rosbag2's value for "no time yet".
fn start_and_duration(bounds: Option<(u64, u64)>) -> (u64, u64) {
    bounds.map_or((i64::MAX as u64, 0), |(first, last)| (first, last - first))
}

impl Written<'_> {
    /// The inner mapping, which is also stored in the files of the bag. Every line begins with `indent`.
    ///
    /// The text is built without a YAML library: the structure is fixed, and the only free texts, topic and type names, have
    /// been checked and contain no special characters of YAML.
    pub(super) fn yaml(&self, indent: &str) -> String {
        let messages: u64 = self.topics.iter().map(|topic| topic.messages).sum();
        let bounds = self.files.iter().filter_map(|file| file.bounds);
        let bounds = bounds.reduce(|all, file| (all.0.min(file.0), all.1.max(file.1)));
        let (start, duration) = start_and_duration(bounds);
        let mut text = format!(
            "version: {VERSION}\nstorage_identifier: {}\nduration:\n  nanoseconds: {duration}\nstarting_time:\n  \
             nanoseconds_since_epoch: {start}\nmessage_count: {messages}\n",
            self.storage.identifier()
        );
        // Writing to a `String` cannot fail.
        if self.topics.is_empty() {
            text.push_str("topics_with_message_count: []\n");
        } else {
            text.push_str("topics_with_message_count:\n");
        }
        for TopicEntry { name, type_name, type_hash, messages } in &self.topics {
            let _ = write!(
                text,
                "  - topic_metadata:\n      name: {name}\n      type: {type_name}\n      \
                 serialization_format: cdr\n      offered_qos_profiles:\n"
            );
            for line in QOS.lines() {
                let _ = writeln!(text, "        {line}");
            }
            let _ =
                write!(text, "      type_description_hash: \"{type_hash}\"\n    message_count: {messages}\n");
        }
        let (format, mode) = if self.packed { ("zstd", "FILE") } else { ("\"\"", "\"\"") };
        let _ =
            write!(text, "compression_format: {format}\ncompression_mode: {mode}\nrelative_file_paths:\n");
        for FileEntry { name, .. } in self.files {
            let _ = writeln!(text, "  - {name}");
        }
        text.push_str("files:\n");
        for FileEntry { name, bounds, messages } in self.files {
            let (start, duration) = start_and_duration(*bounds);
            let _ = write!(
                text,
                "  - path: {name}\n    starting_time:\n      nanoseconds_since_epoch: {start}\n    \
                 duration:\n      nanoseconds: {duration}\n    message_count: {messages}\n"
            );
        }
        let _ = writeln!(text, "custom_data: ~\nros_distro: {ROS_DISTRO}");
        text.lines().fold(String::with_capacity(text.len() * 2), |mut all, line| {
            let _ = writeln!(all, "{indent}{line}");
            all
        })
    }

    /// The whole file.
    pub(super) fn file_text(&self) -> String {
        format!("rosbag2_bagfile_information:\n{}", self.yaml("  "))
    }
}

/// The part of the file that is needed for reading. The rest differs between versions and is ignored.
#[derive(Deserialize)]
struct Document {
    rosbag2_bagfile_information: Information,
}

#[derive(Deserialize)]
struct Information {
    storage_identifier: String,
    relative_file_paths: Vec<String>,
    #[serde(default)]
    compression_format: Option<String>,
    #[serde(default)]
    compression_mode: Option<String>,
}

/// The files of a bag directory, in order. The format of each file is found later, from its first bytes.
///
/// A killed recorder writes no `metadata.yaml`. Then these are the files of one storage sorted by name (numbers by value, so
/// that `bag_10` follows `bag_9`), and a note says so.
pub(super) fn files(dir: &Path, notes: &mut Vec<Note>) -> Result<Vec<PathBuf>, RunError> {
    let path = dir.join(FILE_NAME);
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return files_by_name(dir, notes),
        Err(error) => return Err(RunError::io(&path, "read")(error)),
    };
    let fail = |why: String| RunError::Metadata { path: path.clone(), why };
    let document: Document = serde_saphyr::from_str(&text)
        .map_err(|error| fail(format!("not the metadata of a bag: {}", first_line(&error.to_string()))))?;
    let information = document.rosbag2_bagfile_information;
    if Storage::of_identifier(&information.storage_identifier).is_none() {
        let other = &information.storage_identifier;
        return Err(fail(format!("storage `{other}` is not read, only mcap and sqlite3")));
    }
    let mode = information.compression_mode.unwrap_or_default().to_ascii_lowercase();
    let format = information.compression_format.unwrap_or_default();
    match mode.as_str() {
        // Compression by the storage is stated in the file itself.
        "" | "none" | "storage" => {}
        "file" | "message" if format == "zstd" => {}
        _ => {
            let name = format!("{format}, {} mode", mode.to_ascii_uppercase());
            return Err(RunError::Compression { path: dir.to_owned(), offset: None, name });
        }
    }
    if information.relative_file_paths.is_empty() {
        return Err(fail("it names no file".into()));
    }
    information
        .relative_file_paths
        .iter()
        .map(|relative| {
            // Bags of old versions include their directory in the path. Only the last component is used, which also keeps a
            // bag from naming files in other directories.
            let file = Path::new(relative).file_name().map(|name| dir.join(name));
            file.filter(|file| file.is_file())
                .ok_or_else(|| fail(format!("it names `{relative}`, which is not there")))
        })
        .collect()
}

fn files_by_name(dir: &Path, notes: &mut Vec<Note>) -> Result<Vec<PathBuf>, RunError> {
    let mut found: [Vec<PathBuf>; 2] = Default::default();
    for entry in std::fs::read_dir(dir).map_err(RunError::io(dir, "list"))? {
        let path = entry.map_err(RunError::io(dir, "list"))?.path();
        match Storage::of_file(&path) {
            Some(Storage::Mcap) => found[0].push(path),
            Some(Storage::Sqlite3) => found[1].push(path),
            None => {}
        }
    }
    let fail = |why: &str| Err(RunError::NotARun { path: dir.to_owned(), why: why.to_owned() });
    let mut found = match found {
        [mcap, sqlite] if mcap.is_empty() && sqlite.is_empty() => {
            return fail("a directory without metadata.yaml and without .mcap or .db3 files");
        }
        [found, none] | [none, found] if none.is_empty() => found,
        _ => {
            return fail(
                "a directory without metadata.yaml that holds both .mcap and .db3 files; name the one to \
                 read",
            );
        }
    };
    // A recorder that is killed while it compresses a file leaves two files; the uncompressed one is complete.
    let whole: Vec<PathBuf> = found.iter().filter(|path| !is_packed_name(path)).cloned().collect();
    found.retain(|path| !is_packed_name(path) || !whole.contains(&path.with_extension("")));
    found.sort_by_key(|path| name_key(path));
    notes.push(Note::NoMetadata { path: dir.to_owned() });
    Ok(found)
}

fn is_packed_name(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "zstd")
}

/// A sorting key that compares runs of digits by length first, and so by value.
fn name_key(path: &Path) -> Vec<(usize, String)> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mut key: Vec<(usize, String)> = Vec::new();
    let mut in_digits = false;
    for c in name.chars() {
        match key.last_mut() {
            Some((length, part)) if in_digits == c.is_ascii_digit() => {
                *length += usize::from(in_digits);
                part.push(c);
            }
            _ => {
                in_digits = c.is_ascii_digit();
                key.push((usize::from(in_digits), c.to_string()));
            }
        }
    }
    key
}

fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbered_files_sort_by_number() {
        let mut names: Vec<_> = ["b_10.mcap", "b_9.mcap", "a_11.mcap", "b_1.mcap"].map(PathBuf::from).into();
        names.sort_by_key(|path| name_key(path));
        let names: Vec<_> = names.iter().map(|name| name.to_string_lossy()).collect();
        assert_eq!(names, ["a_11.mcap", "b_1.mcap", "b_9.mcap", "b_10.mcap"]);
    }

    #[test]
    fn written_metadata_is_read_back() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let topic = TopicEntry { name: "/d/force", type_name: "a/msg/B", type_hash: "RIHS01_0", messages: 2 };
        let file = FileEntry { name: "x_0.mcap".into(), bounds: Some((5, 9)), messages: 2 };
        let (storage, packed) = (Storage::Mcap, false);
        let written = Written { storage, packed, files: &[file], topics: vec![topic] };
        std::fs::write(dir.path().join(FILE_NAME), written.file_text()).expect("written");
        std::fs::write(dir.path().join("x_0.mcap"), "").expect("written");
        let files = files(dir.path(), &mut Vec::new()).expect("read back");
        assert_eq!(files, [dir.path().join("x_0.mcap")]);
    }
}
