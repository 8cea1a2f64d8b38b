//! Runs as rosbag2 bags: lossless conversion both ways, bags of other recorders, and broken bags.

use crate::run_support::*;
use mr_damper_model::sample::DriveKind;
use mr_damper_msgs::standard::{Float64, JointState};
use mr_damper_msgs::{Displacement, Force, Message, cdr};
use mr_damper_runs::{
    BagOptions, BagWriter, LoadOptions, Note, RunError, RunSection, SaveOptions, Sync, Topic, convert, load,
    save,
};

#[test]
fn csv_to_bag_and_back_is_byte_identical() {
    let dir = temporary();
    let (csv, back) = (dir.path().join("in.csv"), dir.path().join("back.csv"));
    std::fs::write(&csv, canonical(500)).expect("written");
    for (name, compress) in [("zstd", true), ("plain", false)] {
        let bag = dir.path().join(name);
        let options = SaveOptions {
            namespace: "front_left".into(),
            bag: small_chunks(compress),
            ..SaveOptions::default()
        };
        convert(&csv, &bag, &plain(), &options).expect("to a bag");
        for source in [bag.clone(), mcap_of(&bag)] {
            let converted = convert(&source, &back, &plain(), &SaveOptions::default()).expect("back");
            assert_eq!(converted.read.notes, []);
            assert_eq!(std::fs::read(&csv).expect("read"), std::fs::read(&back).expect("read"), "{name}");
            std::fs::remove_file(&back).expect("removed");
        }
        // As with CSV, a load must say which of two drives to use.
        assert_eq!(
            refusal(&bag, &plain()),
            format!(
                "{name}: both a coil current (/front_left/coil_current) and a command voltage \
                 (/front_left/command_voltage) are recorded, and a model takes one of them; choose with \
                 --drive current_a or --drive command_v"
            )
        );
        let options = LoadOptions { drive: Some(DriveKind::CommandVoltage), ..plain() };
        assert_eq!(load(&bag, &options).expect("loads").run.drive_kind(), Some(DriveKind::CommandVoltage));
    }
}

#[test]
fn parts_of_a_run_add_up_to_the_run() {
    let dir = temporary();
    let path = |name: &str| dir.path().join(name);
    std::fs::write(path("in.csv"), canonical(500)).expect("written");
    // Rows are 1.234567 ms apart: row 200 comes at 0.2469134 s.
    let part = |name: &str, start_s, duration_s| {
        let options = SaveOptions {
            part: RunSection { start_s, duration_s, ..RunSection::default() },
            ..SaveOptions::default()
        };
        convert(&path("in.csv"), &path(name), &plain(), &options)
            .map(|_| std::fs::read_to_string(path(name)).expect("read"))
    };
    let (first, second) = (part("a.csv", 0.0, Some(0.246_913_4)), part("b.csv", 0.246_913_4, None));
    let (first, second) = (first.expect("the first part"), second.expect("the second part"));
    assert_eq!(
        (first.lines().count(), second.lines().count()),
        (201, 301),
        "rows and one header in each part"
    );
    let rows: Vec<&str> = first.lines().chain(second.lines().skip(1)).collect();
    assert_eq!(rows, canonical(500).lines().collect::<Vec<_>>());
    for (start_s, name, why) in [
        (0.7, "beyond.csv", "0.616 s of displacement, none of it in this part: give an earlier start"),
        (-1.0, "before.csv", "the start must be 0 s or more"),
        (f64::NAN, "nowhere.csv", "the start must be 0 s or more"),
    ] {
        let error = part(name, start_s, Some(1.0)).expect_err("nothing there").to_string();
        assert!(error.ends_with(why), "{error}");
    }
}

#[test]
fn existing_targets_are_kept_and_failures_leave_no_files() {
    let dir = temporary();
    let run = |text: &str| {
        let path = dir.path().join("in.csv");
        std::fs::write(&path, text).expect("written");
        read(&path).run
    };
    let bag = dir.path().join("bag");
    for (time, why) in [
        ("-0.5", "time -0.5 s is negative, and bags count from 1970 on: shift the run's times"),
        ("3e9", "does not fit in a ROS stamp, which ends in 2038"),
    ] {
        let run = run(&format!("time_s,displacement_m\n{time},0\n"));
        let error = save(&run, &bag, &SaveOptions::default()).expect_err("refused").to_string();
        assert!(error.contains("cannot write topic /displacement: ") && error.contains(why), "{error}");
        assert!(!bag.exists());
    }
    std::fs::create_dir(&bag).expect("created");
    let error =
        save(&run("time_s,displacement_m\n0,0\n"), &bag, &SaveOptions::default()).expect_err("refused");
    assert!(matches!(error, RunError::Exists { .. }), "{error}");
}

#[test]
fn with_several_dampers_one_must_be_chosen() {
    let dir = temporary();
    let path = dir.path().join("two");
    bag(&path, BagOptions::default(), |writer| {
        for (namespace, value) in [("/front_left", 1.0), ("/front_right", 2.0)] {
            writer.write_message(&format!("{namespace}/displacement"), &displacement(5, value), 5, 5)?;
        }
        writer.write_message("/rosout", &Float64 { data: 0.0 }, 6, 6)
    });
    assert_eq!(
        refusal(&path, &plain()),
        "two: displacement of several dampers is recorded: /front_left, /front_right; choose one with \
         --bag-namespace"
    );
    for namespace in ["/front_right", "front_right", "front_right/"] {
        let options = LoadOptions { namespace: Some(namespace.into()), ..plain() };
        let loaded = load(&path, &options).expect("loads");
        assert_eq!(loaded.run.displacement_m.values, [2.0]);
        assert_eq!(
            loaded.notes[0].to_string(),
            "not part of the run: /front_left/displacement (mr_damper_msgs/msg/Displacement, 1 message), \
             /rosout (std_msgs/msg/Float64, 1 message)"
        );
    }
    assert_eq!(
        refusal(&path, &LoadOptions { namespace: Some("rear".into()), ..plain() }),
        "two: no sample of displacement; namespace /rear has none, but these have: /front_left, /front_right"
    );
}

#[test]
fn a_channel_may_have_other_types() {
    let dir = temporary();
    let path = dir.path().join("floats");
    bag(&path, BagOptions::default(), |writer| {
        for step in 1..4_i64 {
            let data = step as f64;
            writer.write_message("/d/displacement", &Float64 { data }, step * 10, step * 10 - 1)?;
            let joints = JointState {
                header: at(step),
                name: vec!["hip".into(), "damper".into()],
                position: vec![0.0, 9.0],
                velocity: vec![],
                effort: vec![0.0, data * 100.0],
            };
            writer.write_message("/d/measured_force", &joints, 1, 1)?;
            writer.write_message("/r/joint_states", &joints, 1, 1)?;
        }
        Ok(())
    });
    // A plain number gets its log time as stamp; joint states are ignored until a joint is named.
    let run = read(&path).run;
    assert_eq!(run.displacement_m.values, [1.0, 2.0, 3.0]);
    assert_eq!(run.displacement_m.stamps[2].nanos(), 30);
    assert_eq!(run.force_n, None);
    let joint = |joint: &str, namespace: &str| LoadOptions {
        joint: Some(joint.into()),
        namespace: Some(namespace.into()),
        ..plain()
    };
    let run = load(&path, &joint("damper", "d")).expect("loads").run;
    assert_eq!(run.force_n.expect("force").values, [100.0, 200.0, 300.0]);
    let run = load(&path, &joint("damper", "r")).expect("loads").run;
    assert_eq!(run.displacement_m.values, [9.0; 3]);
    assert_eq!((run.velocity_m_s, run.force_n.map(|f| f.values.len())), (None, Some(3)));
    let loaded = load(&path, &joint("knee", "d")).expect("loads");
    let text = loaded.notes.iter().map(ToString::to_string).collect::<String>();
    let fault = "topic /d/measured_force: 3 messages could not be decoded; the first: joint `knee` is not \
                 among: hip, damper";
    assert!(text.contains(fault), "{text}");
}

#[test]
fn a_column_named_like_a_topic_survives_a_bag() {
    let dir = temporary();
    let (csv, bag, back) =
        (dir.path().join("in.csv"), dir.path().join("b.mcap"), dir.path().join("back.csv"));
    let text =
        "time_s,displacement_m,displacement,velocity,joint_states,velocity_2\n0,1,2,3,4,5\n1,6,7,8,9,10\n";
    std::fs::write(&csv, text).expect("written");
    convert(&csv, &bag, &plain(), &SaveOptions::default()).expect("to a bag");
    convert(&bag, &back, &plain(), &SaveOptions::default()).expect("back");
    assert_eq!(std::fs::read_to_string(&back).expect("read"), text);
}

#[test]
fn foreign_topics_do_not_become_known_quantities_by_their_names() {
    let dir = temporary();
    let path = dir.path().join("bag");
    bag(&path, BagOptions::default(), |writer| {
        writer.write_message("/displacement", &displacement(10, 1.0), 10, 10)?;
        for name in
            ["/other/force_n", "/other/Current_mA", "/other/time_s", "/other/setpoint_mm", "/other/oil_c"]
        {
            writer.write_message(name, &Float64 { data: 5.0 }, 10, 10)?;
        }
        for (name, column) in [("/other/a", "force_n"), ("/other/b", " oil_c "), ("/other/c", "oil_c")] {
            let topic = Topic { column: Some(column), ..Topic::of::<Float64>(name) };
            let topic = writer.topic(&topic)?;
            writer.write(topic, 10, 10, &cdr::to_vec(&Float64 { data: 6.0 }).expect("encoded"))?;
        }
        Ok(())
    });
    let loaded = read(&path);
    let names: Vec<_> =
        loaded.run.other.iter().map(|(name, trace)| (name.as_str(), trace.values[0])).collect();
    assert_eq!((loaded.run.force_n, names), (None, vec![("oil_c", 5.0)]));
    let [Note::TopicsLeft { topics }, Note::CouldServe { .. }] = loaded.notes.as_slice() else {
        panic!("{:?}", loaded.notes)
    };
    assert_eq!(topics.len(), 7, "{topics:?}");
    assert!(topics.contains(&"/other/c (a second oil_c)".to_owned()), "{topics:?}");
}

#[test]
fn missing_displacement_is_explained() {
    let dir = temporary();
    let make = |name: &str, fill: &dyn Fn(&mut BagWriter) -> Result<(), RunError>| {
        let path = dir.path().join(name);
        bag(&path, BagOptions::default(), fill);
        refusal(&path, &plain())
    };
    assert_eq!(
        make("empty", &|_| Ok(())),
        "empty: no sample of displacement; the bag names no topic, so it is empty or was cut off before its \
         first chunk"
    );
    assert_eq!(
        make("other", &|writer| writer.write_message("/x", &Float64 { data: 0.0 }, 1, 1)),
        "other: no sample of displacement; no topic is called displacement. Say which one holds it, for example \
         --map displacement=/x; topics (* can hold displacement):\n  * /x  std_msgs/msg/Float64, 1 message"
    );
    assert_eq!(
        make("force", &|writer| {
            writer.write_message("/displacement", &Force { header: at(1), force: 0.0, variance: 0.0 }, 1, 1)
        }),
        "force: topic /displacement holds mr_damper_msgs/msg/Force in cdr; accepted are \
         mr_damper_msgs/msg/Displacement, sensor_msgs/msg/Range, sensor_msgs/msg/JointState, std_msgs/msg/Float64, \
         std_msgs/msg/Float32, in CDR"
    );
    let joints =
        JointState { header: at(1), name: vec!["hip".into()], position: vec![0.5], ..JointState::default() };
    let joint = make("joint", &|writer| writer.write_message("/displacement", &joints, 1, 1));
    assert!(
        joint
            .ends_with("in CDR; say where displacement is, for example --map displacement=/displacement:hip"),
        "{joint}"
    );
    assert_eq!(
        make("broken", &|writer| {
            let topic = writer.topic(&Topic::of::<Displacement>("/displacement"))?;
            writer.write(topic, 1, 1, &[0, 1, 0, 0, 1])
        }),
        "broken: no sample of displacement; no message of /displacement could be decoded: \
         mr_damper_msgs/msg/Displacement: at byte 4 of 5: unexpected end of input"
    );
}

#[test]
fn unusable_messages_are_dropped_and_counted() {
    let dir = temporary();
    let path = dir.path().join("bag");
    bag(&path, BagOptions::default(), |writer| {
        for (nanos, value) in [(10, 1.0), (20, 2.0), (20, 3.0), (15, 4.0), (30, f64::NAN), (40, 5.0)] {
            writer.write_message("/displacement", &displacement(nanos, value), nanos, nanos)?;
        }
        // A message without a stamp gets its log time.
        writer.write_message("/displacement", &displacement(0, 6.0), 50, 50)?;
        let topic = writer.topic(&Topic::of::<Displacement>("/displacement"))?;
        let mut cdr = cdr::to_vec(&displacement(60, 7.0)).expect("encoded");
        cdr.truncate(20);
        writer.write(topic, 60, 60, &cdr)
    });
    let loaded = read(&path);
    assert_eq!(loaded.run.displacement_m.values, [1.0, 2.0, 5.0, 6.0]);
    assert_eq!(loaded.run.displacement_m.stamps[3].nanos(), 50);
    let topic = || "/displacement".to_owned();
    let [Note::Undecodable { count: 1, .. }, rest @ ..] = loaded.notes.as_slice() else {
        panic!("{:?}", loaded.notes)
    };
    assert_eq!(
        rest,
        [
            Note::NotFinite { topic: topic(), count: 1 },
            Note::NotIncreasing { topic: topic(), count: 2 },
            Note::Unstamped { topic: topic(), count: 1 },
        ]
    );
}

#[test]
fn metadata_determines_the_files() {
    let dir = temporary();
    let path = dir.path().join("bag");
    bag(&path, BagOptions::default(), |writer| {
        writer.write_message("/displacement", &displacement(10, 1.0), 10, 10)
    });
    let second = dir.path().join("second");
    bag(&second, BagOptions::default(), |writer| {
        writer.write_message("/displacement", &displacement(20, 2.0), 20, 20)
    });
    let (first, moved) = (mcap_of(&path), path.join("a_second_1.mcap"));
    std::fs::rename(mcap_of(&second), &moved).expect("moved");
    let metadata = path.join("metadata.yaml");
    let yaml = std::fs::read_to_string(&metadata).expect("read");
    let name = first.file_name().expect("name").to_string_lossy().into_owned();

    // Split files follow the order in the metadata; old bags prefix the names with their directory.
    let split = yaml.replace(
        &format!("relative_file_paths:\n    - {name}"),
        &format!("relative_file_paths:\n    - {name}\n    - bag/a_second_1.mcap"),
    );
    std::fs::write(&metadata, &split).expect("written");
    let loaded = read(&path);
    assert_eq!((loaded.run.displacement_m.values, loaded.notes), (vec![1.0, 2.0], vec![]));

    let refused = |text: &str| {
        std::fs::write(&metadata, text).expect("written");
        refusal(&path, &plain())
    };
    let advice = "`ros2 bag reindex` rewrites it, or name the .mcap or .db3 file itself";
    assert_eq!(
        refused(&split.replace("bag/a_second_1.mcap", "../../etc/gone.mcap")),
        format!("bag/metadata.yaml: it names `../../etc/gone.mcap`, which is not there; {advice}")
    );
    assert!(refused("no: bag\n").starts_with("bag/metadata.yaml: not the metadata of a bag: "));
    assert!(
        refused(&yaml.replace("identifier: mcap", "identifier: rosbag1"))
            .contains("storage `rosbag1` is not read, only mcap and sqlite3")
    );
    for (mode, format, name) in [("FILE", "lz4", "lz4, FILE mode"), ("BLOCK", "zstd", "zstd, BLOCK mode")] {
        let compressed = yaml
            .replace("_mode: \"\"", &format!("_mode: {mode}"))
            .replace("_format: \"\"", &format!("_format: {format}"));
        let text = refused(&compressed);
        assert!(text.starts_with(&format!("bag: compressed with `{name}`, which is not read")), "{text}");
    }

    // Without metadata the file names determine the order, and a note says so.
    std::fs::remove_file(&metadata).expect("removed");
    let loaded = read(&path);
    assert_eq!(loaded.run.displacement_m.values, [2.0]);
    assert!(loaded.notes.contains(&Note::NoMetadata { path: path.clone() }), "{:?}", loaded.notes);
}

#[test]
fn every_chunk_can_be_synced_to_disk() {
    let dir = temporary();
    let path = dir.path().join("bag");
    bag(&path, BagOptions { sync: Sync::EveryChunk, ..small_chunks(true) }, |writer| {
        (1..100).try_for_each(|n| writer.write_message("/displacement", &displacement(n, 0.0), n, n))
    });
    assert_eq!(read(&path).run.displacement_m.len(), 99);
}

#[test]
fn the_summary_counts_messages_and_bytes() {
    let dir = temporary();
    let mut writer = BagWriter::create(&dir.path().join("bag"), BagOptions::default()).expect("created");
    writer.write_message("/b", &Float64 { data: 0.0 }, 1, 1).expect("written");
    writer.write_message("/a", &Float64 { data: 0.0 }, 2, 1).expect("written");
    writer.write_message("/b", &Float64 { data: 0.0 }, 3, 1).expect("written");
    let summary = writer.finish().expect("finished");
    assert_eq!(summary.topics, [("/b".to_owned(), 2), ("/a".to_owned(), 1)]);
    assert_eq!(summary.bytes, std::fs::metadata(mcap_of(&summary.path)).expect("size").len());
    assert_eq!(Float64::TYPE, "std_msgs/msg/Float64");
}

#[test]
fn outputs_of_the_node_are_no_warning() {
    use mr_damper_msgs::ForceEstimate;
    let dir = temporary();
    let path = dir.path().join("recorded");
    bag(&path, BagOptions::default(), |writer| {
        writer.write_message("/displacement", &displacement(5, 1.0), 5, 5)?;
        writer.write_message("/force_estimate", &ForceEstimate::default(), 6, 6)?;
        writer.write_message("/temperature_of_the_lab", &Float64 { data: 20.0 }, 7, 7)
    });
    let notes = read(&path).notes;
    let warnings: Vec<String> =
        notes.iter().filter(|note| note.is_warning()).map(ToString::to_string).collect();
    assert!(warnings.iter().all(|note| !note.contains("force_estimate")), "{warnings:?}");
    assert!(warnings.iter().any(|note| note.contains("/temperature_of_the_lab")), "{warnings:?}");
    let others: Vec<String> =
        notes.iter().filter(|note| !note.is_warning()).map(ToString::to_string).collect();
    assert_eq!(others, ["outputs of the node do not belong to the run: /force_estimate"]);
}
