//! sqlite3 bags of other recorders: every schema of rosbag2, files left by killed recorders, and damaged or
//! hostile files.

use crate::run_support::*;
use mr_damper_msgs::cdr;
use mr_damper_runs::{Note, load};
use proptest::prelude::*;
use rusqlite::{Connection, params};
use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// Topics as in Foxy, as in Humble, and as a future release might define them.
const FOXY: &str = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, \
     serialization_format TEXT NOT NULL);";
const HUMBLE: &str = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, \
     serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL DEFAULT ''); \
     CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL); \
     INSERT INTO schema VALUES (3, 'humble'); \
     CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);";
const TO_COME: &str = "CREATE TABLE topics(mood TEXT DEFAULT 'new', type TEXT NOT NULL, name TEXT NOT NULL, \
     serialization_format TEXT NOT NULL, id INTEGER PRIMARY KEY);";
const MESSAGES: &str = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, \
     timestamp INTEGER NOT NULL, data BLOB NOT NULL); CREATE INDEX timestamp_idx ON messages (timestamp ASC);";
const MESSAGES_TO_COME: &str = "CREATE TABLE messages(id INTEGER PRIMARY KEY, sequence INTEGER, data BLOB, \
     timestamp INTEGER, topic_id INTEGER);";

fn open(path: &Path) -> Connection {
    Connection::open(path).expect("opened")
}

/// A database with a topic `/d/displacement`, of `rows` messages 1 ms apart.
fn database(path: &Path, schema: &str, rows: i64) -> Connection {
    let connection = open(path);
    // No power failure is tested here, and waiting for the disk would take most of the time.
    connection.execute_batch(&format!("PRAGMA synchronous=OFF; {schema}")).expect("made");
    let topic = "INSERT INTO topics (id, name, type, serialization_format) VALUES (7, '/d/displacement', \
                 'mr_damper_msgs/msg/Displacement', 'cdr')";
    connection.execute(topic, []).expect("made");
    insert(&connection, 1..=rows);
    connection
}

fn insert(connection: &Connection, steps: std::ops::RangeInclusive<i64>) {
    for step in steps {
        let data = cdr::to_vec(&displacement(step * 1_000_000, step as f64)).expect("encoded");
        let query = "INSERT INTO messages (topic_id, timestamp, data) VALUES (7, ?1, ?2)";
        connection.execute(query, params![step * 1_000_000, data]).expect("inserted");
    }
}

fn count(path: &Path) -> usize {
    read(path).run.displacement_m.len()
}

#[test]
fn every_schema_is_read() {
    let dir = temporary();
    for (name, topics, messages) in
        [("foxy", FOXY, MESSAGES), ("humble", HUMBLE, MESSAGES), ("to come", TO_COME, MESSAGES_TO_COME)]
    {
        // Names with characters that have a meaning in URIs.
        let path = dir.path().join(format!("{name} 100%#?.db3"));
        drop(database(&path, &format!("{topics}{messages}"), 20));
        let loaded = read(&path);
        assert_eq!(loaded.notes, []);
        let expected: Vec<f64> = (1..=20).map(f64::from).collect();
        assert_eq!(loaded.run.displacement_m.values, expected, "{name}");
        assert_eq!(loaded.run.displacement_m.stamps[19].nanos(), 20_000_000);
    }
    // Iron and Jazzy use the schema that we write.
    thousand(&dir.path().join("jazzy"), sqlite());
    assert_eq!(count(&file_of(&dir.path().join("jazzy"), "db3")), 1000);
}

#[test]
fn nothing_is_written_next_to_the_file() {
    let dir = temporary();
    let path = dir.path().join("x.db3");
    let connection = database(&path, &format!("PRAGMA journal_mode=WAL; {HUMBLE}{MESSAGES}"), 20);
    // A database marked as having a write-ahead log but without one, for example copied from a robot.
    connection.execute_batch("PRAGMA wal_checkpoint(TRUNCATE)").expect("merged");
    drop(connection);
    assert_eq!(std::fs::read(&path).expect("read")[18], 2, "the database is marked as having a log");
    let before = contents(dir.path());
    assert_eq!(before.len(), 1, "there is no log file");
    std::fs::set_permissions(dir.path(), Permissions::from_mode(0o500)).expect("set");
    assert_eq!(count(&path), 20);
    std::fs::set_permissions(dir.path(), Permissions::from_mode(0o700)).expect("set");
    assert_eq!(contents(dir.path()), before);
}

/// Copies the files as they are on disk at this moment, as after a kill.
fn as_killed(database: &Path, dir: &Path) -> PathBuf {
    for path in files_of(database.parent().expect("a directory")) {
        std::fs::copy(&path, dir.join(path.file_name().expect("name"))).expect("copied");
    }
    dir.join(database.file_name().expect("name"))
}

#[test]
fn an_unmerged_log_is_read() {
    let (dir, killed) = (temporary(), temporary());
    let path = dir.path().join("x.db3");
    let schema = format!("PRAGMA journal_mode=WAL; PRAGMA wal_autocheckpoint=0; {HUMBLE}{MESSAGES}");
    let connection = database(&path, &schema, 300);
    let found = as_killed(&path, killed.path());
    drop(connection);
    let before = contents(killed.path());
    assert!(before.len() > 1, "a database and its log");
    let loaded = read(&found);
    assert_eq!(loaded.run.displacement_m.len(), 300);
    assert_eq!(loaded.notes, [Note::Journal { path: found.clone(), journal: "-wal" }]);
    assert!(loaded.notes[0].to_string().contains("x.db3-wal (recording cut off"), "{}", loaded.notes[0]);
    assert_eq!(contents(killed.path()), before, "the user's files are unchanged");
    // With the log cut in the middle of a transaction, the complete transactions are read.
    let log = killed.path().join("x.db3-wal");
    let bytes = std::fs::read(&log).expect("read");
    std::fs::write(&log, &bytes[..bytes.len() / 2]).expect("written");
    let cut = count(&found);
    assert!((50..300).contains(&cut), "{cut}");
}

#[test]
fn an_unfinished_transaction_is_rolled_back() {
    let (dir, killed) = (temporary(), temporary());
    let path = dir.path().join("x.db3");
    let connection = database(&path, &format!("{HUMBLE}{MESSAGES}"), 300);
    // With so little cache the transaction reaches the file before it is committed.
    connection.execute_batch("PRAGMA cache_size=2; BEGIN;").expect("begun");
    insert(&connection, 301..=2000);
    let found = as_killed(&path, killed.path());
    let before = contents(killed.path());
    assert!(
        before.iter().any(|(path, bytes)| path.ends_with("x.db3-journal") && !bytes.is_empty()),
        "a journal"
    );
    let loaded = read(&found);
    assert_eq!(loaded.run.displacement_m.len(), 300);
    assert_eq!(loaded.notes, [Note::Journal { path: found, journal: "-journal" }]);
    assert_eq!(contents(killed.path()), before, "the user's files are unchanged");
}

#[test]
fn a_truncated_database_yields_the_part_before_the_cut() {
    let dir = temporary();
    thousand(&dir.path().join("bag"), sqlite());
    let file = file_of(&dir.path().join("bag"), "db3");
    let whole = std::fs::read(&file).expect("read");
    let all = read(&file).run;
    let cut = dir.path().join("cut.db3");
    let most = read_cut_short(&whole, &all, &cut, 1999, |notes, length, _| {
        notes.iter().any(|note| matches!(note, Note::CutShort { offset, .. } if *offset == length))
    });
    assert!(most > 900, "{most}");
}

#[test]
fn a_damaged_page_loses_only_itself() {
    let dir = temporary();
    thousand(&dir.path().join("bag"), sqlite());
    let file = file_of(&dir.path().join("bag"), "db3");
    let mut bytes = std::fs::read(&file).expect("read");
    // The first leaf page of a table in the second half of the file; leaf pages of an index begin with 10.
    let leaves: Vec<usize> =
        (bytes.len() / 2 / 4096..bytes.len() / 4096).filter(|n| bytes[n * 4096] == 13).collect();
    let page = leaves[0] * 4096;
    bytes[page..page + 4096].fill(0x55);
    std::fs::write(&file, &bytes).expect("written");
    let loaded = read(&file);
    let [Note::RowsDamaged { first: Some(first), last: Some(last), .. }] = loaded.notes.as_slice() else {
        panic!("{:?}", loaded.notes)
    };
    let lost = usize::try_from(last - first + 1).expect("a few");
    assert!((10..100).contains(&lost), "{first} to {last}");
    let run = loaded.run;
    assert_eq!(run.displacement_m.len() + run.force_n.expect("force").len(), 2000 - lost);
    assert_eq!(run.displacement_m.stamps.last().map(|stamp| stamp.nanos()), Some(1_000_000_000));
}

#[test]
fn files_that_are_not_bags_are_refused() {
    let dir = temporary();
    let file = dir.path().join("x.db3");
    for (bytes, text) in [
        (&b""[..], "x.db3: not a sqlite3 database: it is empty"),
        (b"SQLite format 3\0", "x.db3: not a sqlite3 database: it has 16 bytes"),
        (&[b'x'; 200], "x.db3: not a sqlite3 database: it begins with `xxxxxxxx`"),
    ] {
        std::fs::write(&file, bytes).expect("written");
        assert_eq!(refusal(&file, &plain()), text);
    }
    std::fs::remove_file(&file).expect("removed");
    let refused = |schema: &str| {
        open(&file).execute_batch(schema).expect("made");
        let text = refusal(&file, &plain());
        std::fs::remove_file(&file).expect("removed");
        text
    };
    assert_eq!(refused("CREATE TABLE x(y)"), "x.db3: not a rosbag2 database: it has no table `topics`");
    assert_eq!(refused(FOXY), "x.db3: not a rosbag2 database: it has no table `messages`");
    // An endless query instead of a table.
    let endless = "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n) \
                   SELECT id, 7 AS topic_id, id AS timestamp, x'00' AS data FROM n;";
    assert_eq!(
        refused(&format!("{FOXY}{endless}")),
        "x.db3: not a rosbag2 database: it has no table `messages`"
    );
    assert_eq!(
        refused(&format!("{FOXY}CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, data);")),
        "x.db3: not a rosbag2 database: table `messages` has no column `timestamp`, only id, topic_id, data"
    );
}

#[test]
fn rows_of_wrong_kinds_are_counted() {
    let dir = temporary();
    let path = dir.path().join("x.db3");
    let connection = database(&path, &format!("{TO_COME}{MESSAGES_TO_COME}"), 10);
    for (topic, time, data) in
        [("7", "'soon'", "x'00'"), ("7", "1", "NULL"), ("7", "2", "3.5"), ("8", "1", "x'00'")]
    {
        let query =
            format!("INSERT INTO messages (topic_id, timestamp, data) VALUES ({topic}, {time}, {data})");
        connection.execute(&query, []).expect("inserted");
    }
    drop(connection);
    let loaded = read(&path);
    assert_eq!(loaded.run.displacement_m.len(), 10);
    let counts: Vec<(&str, u64)> = loaded
        .notes
        .iter()
        .filter_map(|note| match note {
            Note::Undecodable { topic, count, .. } => Some((topic.as_str(), *count)),
            _ => None,
        })
        .collect();
    assert_eq!(counts, [("/d/displacement", 3), ("(unknown)", 1)]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn damaged_databases_do_not_panic(
        faults in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        cut in proptest::option::of(any::<prop::sample::Index>()),
    ) {
        let dir = temporary();
        let path = dir.path().join("x.db3");
        drop(database(&path, &format!("PRAGMA page_size=512; {HUMBLE}{MESSAGES}"), 60));
        let mut bytes = std::fs::read(&path).expect("read");
        for (index, value) in faults {
            let at = index.index(bytes.len());
            bytes[at] = value;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        std::fs::write(&path, &bytes).expect("written");
        if let Ok(loaded) = load(&path, &plain()) {
            prop_assert!(loaded.run.displacement_m.stamps.is_sorted_by(|a, b| a < b));
        }
    }

    #[test]
    fn hostile_databases_do_not_panic(bytes in proptest::collection::vec(any::<u8>(), 0..4000)) {
        let dir = temporary();
        let path = dir.path().join("x.db3");
        std::fs::write(&path, [&b"SQLite format 3\0\x10\0\x01\x01\0\x40\x20\x20"[..], &bytes].concat()).expect("written");
        let _ = load(&path, &plain());
    }
}
