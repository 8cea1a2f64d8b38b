//! Bags of several files, compressed or not: written bags can be read, and `metadata.yaml` matches the
//! files.

use crate::run_support::*;
use mr_damper_runs::{BagOptions, Note, SaveOptions, Storage, convert};
use serde_json::Value;
use std::path::Path;
use std::time::Duration;

const BOTH: [Storage; 2] = [Storage::Mcap, Storage::Sqlite3];

fn metadata(bag: &Path) -> Value {
    let text = std::fs::read_to_string(bag.join("metadata.yaml")).expect("read");
    let all: Value = serde_saphyr::from_str(&text).expect("YAML");
    all["rosbag2_bagfile_information"].clone()
}

/// Compares the metadata of a bag of [`thousand`] with its files, and returns the number of files.
fn checked(bag: &Path, storage: Storage, packed: bool) -> usize {
    let told = metadata(bag);
    let names: Vec<&str> =
        told["relative_file_paths"].as_array().expect("names").iter().filter_map(Value::as_str).collect();
    let on_disk: Vec<String> = files_of(bag)
        .iter()
        .map(|path| path.file_name().expect("name").to_string_lossy().into_owned())
        .filter(|name| name != "metadata.yaml")
        .collect();
    let mut sorted: Vec<&str> = names.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, on_disk, "the metadata names exactly the existing files");
    assert_eq!(told["storage_identifier"], storage.identifier());
    let (format, mode) = if packed { ("zstd", "FILE") } else { ("", "") };
    assert_eq!((&told["compression_format"], &told["compression_mode"]), (&format.into(), &mode.into()));
    assert_eq!(told["message_count"], 2000);
    assert_eq!(told["starting_time"]["nanoseconds_since_epoch"], 1_000_000);
    assert_eq!(told["duration"]["nanoseconds"], 999_000_000);
    for topic in told["topics_with_message_count"].as_array().expect("topics") {
        assert_eq!(topic["message_count"], 1000);
    }
    // Each file by itself matches its metadata entry and defines its own topics.
    let (mut messages, mut stamps) = (0, Vec::new());
    for (name, file) in names.iter().zip(told["files"].as_array().expect("files")) {
        assert_eq!(file["path"], *name);
        let run = read(&bag.join(name)).run;
        let force = run.force_n.expect("force");
        let count = run.displacement_m.len() + force.len();
        assert_eq!(file["message_count"], count);
        messages += count;
        let first = force.stamps[0].min(run.displacement_m.stamps[0]).nanos();
        let last = run
            .displacement_m
            .stamps
            .last()
            .expect("samples")
            .max(force.stamps.last().expect("samples"))
            .nanos();
        assert_eq!(file["starting_time"]["nanoseconds_since_epoch"], first);
        assert_eq!(file["duration"]["nanoseconds"], last - first);
        stamps.extend(run.displacement_m.stamps);
    }
    assert_eq!(messages, 2000);
    let whole = read(bag);
    assert_eq!(whole.notes, []);
    assert_eq!(whole.run.displacement_m.stamps, stamps);
    assert_eq!(stamps.len(), 1000);
    names.len()
}

#[test]
fn bags_are_split_by_duration() {
    let dir = temporary();
    for storage in BOTH {
        for compress in [false, true] {
            let path = dir.path().join(format!("{}-{compress}", storage.identifier()));
            let options = BagOptions {
                max_file_duration: Some(Duration::from_millis(300)),
                compress,
                ..BagOptions::default().stored(storage)
            };
            thousand(&path, BagOptions { compress, ..options });
            assert_eq!(checked(&path, storage, compress && storage == Storage::Sqlite3), 4);
        }
    }
}

#[test]
fn bags_are_split_by_size() {
    let dir = temporary();
    const MOST: u64 = 100_000;
    for storage in BOTH {
        let path = dir.path().join(storage.identifier());
        let options = BagOptions {
            max_file_bytes: Some(MOST),
            compress: false,
            chunk_max_bytes: 10_000,
            ..BagOptions::default()
        };
        thousand(&path, BagOptions { storage, ..options });
        let files = checked(&path, storage, false);
        assert!(files > 1, "{files}");
        for file in files_of(&path) {
            let length = std::fs::metadata(&file).expect("size").len();
            assert!(length < MOST * 6 / 5, "{}: {length} bytes", file.display());
        }
    }
}

#[test]
fn every_form_of_a_bag_is_lossless() {
    let dir = temporary();
    let csv = dir.path().join("in.csv");
    std::fs::write(&csv, canonical(500)).expect("written");
    let to = |from: &Path, name: &str, bag: BagOptions| {
        let to = dir.path().join(name);
        let converted = convert(from, &to, &plain(), &SaveOptions { bag, ..SaveOptions::default() });
        let notes = converted.unwrap_or_else(|error| panic!("{error}")).read.notes;
        assert!(notes.iter().all(|note| matches!(note, Note::EmptyCells { .. })), "{name}: {notes:?}");
        to
    };
    let split = |storage, compress| BagOptions {
        storage,
        compress,
        max_file_duration: Some(Duration::from_millis(100)),
        ..BagOptions::default()
    };
    let forms = [
        ("sqlite", sqlite()),
        ("sqlite-packed", BagOptions { compress: true, ..sqlite() }),
        ("sqlite-split", split(Storage::Sqlite3, false)),
        ("sqlite-split-packed", split(Storage::Sqlite3, true)),
        ("mcap-split", split(Storage::Mcap, true)),
        ("bare.db3", BagOptions::default()),
        ("bare.mcap", sqlite()),
    ];
    let mut last = csv.clone();
    for (name, options) in forms {
        // From CSV and from the previous form, so that both storages are converted to each other.
        let bag = to(&csv, name, options.clone());
        let again = to(&last, &format!("again-{name}"), options);
        for (source, back) in [(&bag, "a.csv"), (&again, "b.csv")] {
            let back = to(source, back, BagOptions::default());
            assert_eq!(std::fs::read(&csv).expect("read"), std::fs::read(&back).expect("read"), "{name}");
            std::fs::remove_file(&back).expect("removed");
        }
        last = again;
    }
    for bare in ["bare.db3", "bare.mcap"] {
        let save = SaveOptions { bag: split(Storage::Mcap, true), ..SaveOptions::default() };
        let error =
            convert(&csv, &dir.path().join(format!("split-{bare}")), &plain(), &save).expect_err("refused");
        assert!(error.to_string().contains("only a bag's directory can be split"), "{error}");
    }
    let left: Vec<_> =
        files_of(dir.path()).into_iter().filter(|path| path.to_string_lossy().contains(".part")).collect();
    assert!(left.is_empty(), "{left:?}");
    let save = SaveOptions::default();
    let error =
        convert(&csv, &dir.path().join("x.db3.zstd"), &plain(), &save).expect_err("refused").to_string();
    assert!(error.contains("name a .csv, .mcap or .db3 file, or a directory"), "{error}");
}

#[test]
fn truncated_compressed_files_are_read_up_to_the_cut() {
    let dir = temporary();
    for storage in BOTH {
        let path = dir.path().join(storage.identifier());
        // Enough data for many zstd blocks, because only complete blocks can be decompressed.
        samples(&path, BagOptions { compress: false, ..BagOptions::default().stored(storage) }, 10_000);
        let extension = if storage == Storage::Mcap { "mcap" } else { "db3" };
        let plain_file = file_of(&path, extension);
        let bytes = zstd::encode_all(&*std::fs::read(&plain_file).expect("read"), 3).expect("packed");
        let packed = plain_file.with_extension(format!("{extension}.zstd"));
        let name = packed.file_name().expect("name").to_string_lossy().into_owned();
        std::fs::remove_file(&plain_file).expect("removed");
        std::fs::write(&packed, &bytes).expect("written");
        let metadata = path.join("metadata.yaml");
        let yaml = std::fs::read_to_string(&metadata).expect("read");
        let old = plain_file.file_name().expect("name").to_string_lossy().into_owned();
        // As rosbag2 (capitals) and rosbags (lower case) write it.
        for mode in ["FILE", "file"] {
            let yaml = yaml
                .replace(&old, &name)
                .replace("_mode: \"\"", &format!("_mode: {mode}"))
                .replace("_format: \"\"", "_format: zstd");
            std::fs::write(&metadata, yaml).expect("written");
            assert_eq!(read(&path).notes, []);
        }
        std::fs::remove_file(&metadata).expect("removed");
        assert_eq!(read(&path).notes, [Note::NoMetadata { path: path.clone() }]);
        let all = read(&packed).run;
        assert_eq!(all.displacement_m.len(), 10_000);
        for part in [3, 5, 7] {
            std::fs::write(&packed, &bytes[..bytes.len() * part / 10]).expect("written");
            let loaded = read(&packed);
            let count = loaded.run.displacement_m.len();
            assert!(
                is_prefix(&loaded.run, &all) && (1000 * (part - 2)..10_000).contains(&count),
                "{count} samples from {part} tenths of the file"
            );
            assert!(matches!(loaded.notes.last(), Some(Note::PackedCutShort { .. })), "{:?}", loaded.notes);
        }
        std::fs::write(&packed, &bytes[..20]).expect("written");
        let text = refusal(&packed, &plain());
        assert!(
            text.ends_with("zstd: not a packed bag: nothing can be unpacked: incomplete frame"),
            "{text}"
        );
        // A complete uncompressed file next to a truncated compressed one: the recorder was killed while
        // compressing.
        let whole = zstd::decode_all(&*bytes).expect("unpacked");
        std::fs::write(&plain_file, whole).expect("written");
        assert_eq!(read(&path).run, mr_damper_model::sample::Run { name: path.display().to_string(), ..all });
    }
}

#[test]
fn messages_compressed_one_by_one_are_read_with_and_without_metadata() {
    let dir = temporary();
    for storage in BOTH {
        let path = dir.path().join(storage.identifier());
        let options = BagOptions { compress: false, ..BagOptions::default().stored(storage) };
        bag(&path, options, |writer| {
            let topic =
                writer.topic(&mr_damper_runs::Topic::of::<mr_damper_msgs::Displacement>("/displacement"))?;
            for step in 1..=50_i64 {
                let cdr = mr_damper_msgs::cdr::to_vec(&displacement(step, step as f64)).expect("encoded");
                let mut packed = zstd::bulk::compress(&cdr, 3).expect("packed");
                if step == 20 {
                    packed.truncate(packed.len() - 2);
                }
                writer.write(topic, step, step, &packed)?;
            }
            Ok(())
        });
        let metadata = path.join("metadata.yaml");
        let yaml = std::fs::read_to_string(&metadata).expect("read");
        let yaml = yaml.replace("_mode: \"\"", "_mode: MESSAGE").replace("_format: \"\"", "_format: zstd");
        std::fs::write(&metadata, yaml).expect("written");
        for without in [false, true] {
            if without {
                std::fs::remove_file(&metadata).expect("removed");
            }
            let loaded = read(&path);
            assert_eq!(loaded.run.displacement_m.len(), 49);
            let told = loaded.notes.iter().map(ToString::to_string).collect::<String>();
            assert!(
                told.contains("topic /displacement: 1 message could not be decoded; the first: zstd: "),
                "{told}"
            );
        }
    }
}

#[test]
fn an_empty_file_does_not_affect_the_other_files() {
    let dir = temporary();
    for (storage, extension) in [(Storage::Mcap, "mcap"), (Storage::Sqlite3, "db3")] {
        let path = dir.path().join(storage.identifier());
        let options = BagOptions {
            max_file_duration: Some(Duration::from_millis(300)),
            ..BagOptions::default().stored(storage)
        };
        thousand(&path, options);
        std::fs::remove_file(path.join("metadata.yaml")).expect("removed");
        // A recorder that is killed while it splits leaves such a file.
        let begun = path.join(format!("bag_{}_4.{extension}", storage.identifier()));
        std::fs::write(&begun, "").expect("written");
        let loaded = read(&path);
        assert_eq!(loaded.run.displacement_m.len(), 1000);
        let notes: Vec<String> = loaded.notes.iter().map(ToString::to_string).collect();
        let left = |note: &String| note.starts_with("left out: ") && note.ends_with("it is empty");
        assert!(notes.len() == 2 && notes.iter().any(left), "{notes:?}");
        // A bag that has only empty files is refused.
        for file in files_of(&path) {
            std::fs::write(&file, "").expect("written");
        }
        let text = refusal(&path, &plain());
        assert!(text.ends_with("it is empty"), "{text}");
    }
}
