//! Runs whose topics and columns have their own names: read through a map, they are bit-identical to runs
//! under our names.

use crate::run_support::foreign::{STEPS, raw};
use crate::run_support::*;
use mr_damper_model::sample::{Run, Trace};
use mr_damper_msgs::standard::{Float32, Float64, Range};
use mr_damper_msgs::{CoilCurrent, Force};
use mr_damper_runs::{
    BagOptions, BagWriter, LoadOptions, Map, MapFault, Note, RunError, SaveOptions, Topic, convert, load,
};
use std::path::Path;

fn mapped(mappings: &[&str]) -> LoadOptions {
    let parsed = mappings.iter().map(|text| text.parse().unwrap_or_else(|error| panic!("{text}: {error}")));
    LoadOptions { map: Map::new(parsed.collect()).expect("distinct"), ..plain() }
}

fn fault(path: &Path, mapping: &str) -> MapFault {
    match load(path, &mapped(&[mapping])).expect_err("refused") {
        RunError::Map { why, map, .. } => {
            assert_eq!(map, mapping);
            *why
        }
        other => panic!("{other}"),
    }
}

fn bits(trace: &Trace) -> Vec<(i64, u64)> {
    let values = trace.values.iter().map(|value| value.to_bits());
    trace.stamps.iter().map(|stamp| stamp.nanos()).zip(values).collect()
}

/// The channels of a run that the bags below have, as bit patterns.
fn channels(run: &Run) -> Vec<(String, Vec<(i64, u64)>)> {
    let drive = run.drive.as_ref().map(|(_, trace)| trace);
    let known = [
        ("displacement", Some(&run.displacement_m)),
        ("velocity", run.velocity_m_s.as_ref()),
        ("force", run.force_n.as_ref()),
        ("drive", drive),
        ("case", run.case_temp_c.as_ref()),
        ("body", run.body_velocity_m_s.as_ref()),
        ("request", run.force_request_n.as_ref()),
    ];
    let known = known.into_iter().map(|(name, trace)| (name.to_owned(), trace.map(bits).unwrap_or_default()));
    known.chain(run.other.iter().map(|(name, trace)| (name.clone(), bits(trace)))).collect()
}

/// The same readings as a CSV file with its own column names, in milliseconds.
fn foreign_csv(path: &Path) {
    let mut text = "clock,Stroke [mm],v,\"Load, left_kN\",amps,oil_degF,ray\n".to_owned();
    for step in 1..=STEPS {
        let nanos = step * 2_000_001;
        let [pos, velocity, force, current, temperature, range] = raw(step);
        text += &format!(
            "{}.{:06},{pos},{velocity},{force},{current},{temperature},{range}\n",
            nanos / 1_000_000,
            nanos % 1_000_000
        );
    }
    std::fs::write(path, text).expect("written");
}

const OF_CSV: [&str; 7] = [
    "time=clock,unit=ms",
    "displacement=Stroke [mm]",
    "velocity=v,unit=m/s",
    "measured_force=Load, left_kN",
    "coil_current=amps,unit=mA",
    "case_temperature=oil_degF",
    "setpoint=ray,unit=m",
];

#[test]
fn foreign_bags_and_columns_give_runs_bit_identical_to_our_names() {
    let dir = temporary();
    let path = |name: &str| dir.path().join(name);
    ours_csv(&path("ours.csv"));
    foreign_csv(&path("foreign.csv"));
    let ours = channels(&read(&path("ours.csv")).run);
    let csv = load(&path("foreign.csv"), &mapped(&OF_CSV)).expect("loads");
    assert_eq!(channels(&csv.run), ours);
    let by_name: Vec<_> = csv.notes.iter().map(ToString::to_string).collect();
    assert_eq!(by_name.len(), 3, "notes mention units that come from names: {by_name:?}");
    assert!(by_name[0].starts_with("column `Stroke [mm]` is read in mm, by its name"), "{by_name:?}");
    for (name, options) in [("mcap", small_chunks(true)), ("db3", sqlite())] {
        foreign(&path(name), options);
        let bag = load(&path(name), &mapped(&OF_BAG)).expect("loads");
        assert_eq!(channels(&bag.run), ours, "{name}");
        let notes: Vec<_> = bag.notes.iter().map(ToString::to_string).collect();
        assert_eq!(
            notes,
            [format!(
                "not part of the run: /imu (sensor_msgs/msg/Imu, 1 message), /fl/silent (std_msgs/msg/Float64, 0 \
                 messages), /joint_states (sensor_msgs/msg/JointState, {STEPS} messages)"
            )]
        );
        // After conversion the bag has our names and needs no map.
        let canonical = path(&format!("{name}-canonical"));
        convert(&path(name), &canonical, &mapped(&OF_BAG), &SaveOptions::default()).expect("converted");
        assert_eq!(channels(&read(&canonical).run), ours, "{name}");
    }
}

#[test]
fn sign_and_offset_are_applied_as_the_node_applies_them() {
    let dir = temporary();
    let path = |name: &str| dir.path().join(name);
    foreign(&path("bag"), BagOptions::default());
    foreign_csv(&path("csv.csv"));
    let of_bag = [
        "displacement=/joint_states:fl_damper,sign=-1,offset=0.01,unit=mm",
        "force_n=/joint_states:fl_damper,offset=-3",
    ];
    let of_csv = [
        "time=clock,unit=ms",
        "displacement=stroke [MM],sign=-1,offset=0.01",
        "force_n=Load, left_kN,offset=-3,unit=N",
    ];
    let bag = load(&path("bag"), &mapped(&of_bag)).expect("loads").run;
    let csv = load(&path("csv.csv"), &mapped(&of_csv)).expect("loads").run;
    for step in 1..=STEPS {
        let [pos, _, force, ..] = raw(step);
        let at = step as usize - 1;
        // sign * (raw in SI - offset), with the offset in SI units.
        let displacement = -(pos / 1000.0 - 0.01);
        for run in [&bag, &csv] {
            assert_eq!(run.displacement_m.values[at].to_bits(), displacement.to_bits());
            assert_eq!(run.force_n.as_ref().expect("force").values[at].to_bits(), (force + 3.0).to_bits());
        }
    }
    assert_eq!(bits(&bag.displacement_m), bits(&csv.displacement_m));
    // A map can also apply to channels under our names; other channels are still read.
    std::fs::write(path("own.csv"), "time_s,displacement_mm,force_n,x\n0,10,5,1\n1,20,6,2\n")
        .expect("written");
    let run = load(&path("own.csv"), &mapped(&["displacement=displacement_mm,sign=-1"])).expect("loads").run;
    assert_eq!(run.displacement_m.values, [-0.01, -0.02]);
    assert_eq!((run.force_n.expect("force").values, run.other.len()), (vec![5.0, 6.0], 1));
}

#[test]
fn unmapped_channels_are_read_by_name_and_noted() {
    let dir = temporary();
    let path = dir.path().join("bag");
    bag(&path, BagOptions::default(), |writer| {
        for nanos in 1..4 {
            writer.write_message("/susp/pos", &displacement(nanos, 1.0), nanos, nanos)?;
            writer.write_message("/fl/displacement", &displacement(nanos, 9.0), nanos, nanos)?;
            let force = Force { header: at(nanos), force: 2.0, variance: 0.0 };
            writer.write_message("/fl/measured_force", &force, nanos, nanos)?;
        }
        Ok(())
    });
    let loaded =
        load(&path, &mapped(&["displacement=/susp/pos", "force_request=/fl/measured_force"])).expect("loads");
    assert_eq!(loaded.run.displacement_m.values, [1.0; 3]);
    assert_eq!(loaded.run.force_n.as_ref().expect("by its name").values, [2.0; 3]);
    assert_eq!(loaded.run.force_request_n.as_ref().expect("mapped").values, [2.0; 3]);
    let notes: Vec<_> = loaded.notes.iter().map(ToString::to_string).collect();
    assert_eq!(
        notes,
        [
            "read by name, without a map: /fl/measured_force as measured_force",
            "not part of the run: /fl/displacement (mr_damper_msgs/msg/Displacement, 3 messages)"
        ]
    );
    // If several namespaces could complete the map, the user must choose one.
    let two = dir.path().join("two");
    bag(&two, BagOptions::default(), |writer| {
        writer.write_message("/susp/pos", &displacement(1, 1.0), 1, 1)?;
        for name in ["/fl/coil_current", "/fr/coil_current"] {
            writer.write_message(name, &CoilCurrent { header: at(1), current: 0.5, variance: 0.0 }, 1, 1)?;
        }
        Ok(())
    });
    assert_eq!(
        refusal(&two, &mapped(&["displacement=/susp/pos"])),
        "two: several namespaces have channels that are not mapped: /fl, /fr; choose one with --bag-namespace"
    );
    let one = LoadOptions { namespace: Some("/fr".into()), ..mapped(&["displacement=/susp/pos"]) };
    assert!(load(&two, &one).expect("loads").run.drive.is_some());
    assert!(load(&two, &mapped(&["displacement=/susp/pos", "coil_current=/fr/coil_current"])).is_ok());
}

#[test]
fn without_a_map_the_message_lists_topics_and_joints_and_a_map_to_use() {
    let dir = temporary();
    let path = dir.path().join("bag");
    foreign(&path, BagOptions::default());
    assert_eq!(
        refusal(&path, &plain()),
        "bag: no sample of displacement; no topic is called displacement. Say which one holds it, for example --map \
         displacement=/joint_states:fl_damper; topics (* can hold displacement):\n  \
         * /fl/susp/pos  std_msgs/msg/Float64, 50 messages\n  \
         * /fl/amps  std_msgs/msg/Float64, 50 messages\n  \
         * /fl/ray  sensor_msgs/msg/Range, 50 messages\n  \
         * /joint_states  sensor_msgs/msg/JointState, 50 messages, joints: wheel, fl_damper\n    \
         /fl/twist  geometry_msgs/msg/TwistStamped, 50 messages\n    \
         /fl/load_cell  geometry_msgs/msg/WrenchStamped, 50 messages\n    \
         /fl/oil  sensor_msgs/msg/Temperature, 50 messages\n    \
         /imu  sensor_msgs/msg/Imu, 1 message\n    \
         /fl/silent  std_msgs/msg/Float64, 0 messages"
    );
    // The suggested map works, and a note says what else is missing.
    let loaded = load(&path, &mapped(&["displacement=/joint_states:fl_damper"])).expect("loads");
    let could =
        "missing channels may be read with --map measured_force=/fl/load_cell:z --map coil_current=/fl/amps";
    assert!(loaded.notes.iter().any(|note| note.to_string() == could), "{:?}", loaded.notes);
}

#[test]
fn a_map_that_cannot_be_read_is_refused_with_alternatives() {
    let dir = temporary();
    let path = dir.path().join("bag");
    foreign(&path, BagOptions::default());
    let said = |mapping: &str| fault(&path, mapping).to_string();
    let no_topic = fault(&path, "displacement=/fl/susp/pso");
    assert!(
        matches!(&no_topic, MapFault::NoTopic { nearest: Some(nearest), .. } if nearest == "/fl/susp/pos")
    );
    let text = no_topic.to_string();
    assert!(
        text.starts_with("topic /fl/susp/pso is not in the bag; did you mean /fl/susp/pos?; topics (*"),
        "{text}"
    );
    assert!(matches!(fault(&path, "displacement=Stroke"), MapFault::ColumnOfBag { .. }));
    assert!(matches!(fault(&path, "time=/fl/susp/pos"), MapFault::TimeOfBag));
    assert!(matches!(fault(&path, "displacement=/fl/silent"), MapFault::NoMessage { .. }));
    let no_joint = fault(&path, "displacement=/joint_states:fl_dampr");
    assert!(matches!(no_joint, MapFault::NoJoint { .. }));
    assert_eq!(
        no_joint.to_string(),
        "joint `fl_dampr` is not in the messages; did you mean fl_damper?; joints are wheel, fl_damper"
    );
    assert!(matches!(fault(&path, "velocity=/joint_states:fl_damper"), MapFault::NoValue { .. }));
    assert!(said("displacement=/joint_states").contains("name one after a colon, as in /joint_states:JOINT"));
    let imu = said("body_velocity=/imu");
    assert!(imu.contains("drifts, so this is not supported: record the velocity"), "{imu}");
    assert!(imu.ends_with("; this bag has --map body_velocity=/fl/twist:z"), "{imu}");
    let wrong = said("measured_force=/fl/oil");
    assert!(wrong.starts_with(
        "sensor_msgs/msg/Temperature has no force; accepted types are mr_damper_msgs/msg/Force,"
    ));
    assert!(said("measured_force=/fl/load_cell:w").contains("not `w`"));
    assert!(said("displacement=/fl/ray:z").contains("leave out `:z`"));
    let loaded =
        load(&path, &mapped(&["displacement=/fl/ray", "measured_force=/fl/load_cell"])).expect("loads");
    let axis = Note::AxisTaken { topic: "/fl/load_cell".into(), axis: "z".into() };
    assert!(loaded.notes.contains(&axis), "{:?}", loaded.notes);
    // An infinite range is not a value.
    let none = dir.path().join("none");
    bag(&none, BagOptions::default(), |writer| {
        writer.write_message("/x", &Float32 { data: f32::INFINITY }, 1, 1)?;
        let broken = writer.topic(&Topic::of::<Range>("/broken"))?;
        writer.write(broken, 1, 1, &[0, 1, 0, 0, 1])
    });
    assert!(matches!(fault(&none, "displacement=/x"), MapFault::NoValue { messages: 1, .. }));
    assert!(matches!(fault(&none, "displacement=/broken"), MapFault::Undecodable { .. }));
}

#[test]
fn a_column_that_cannot_be_read_is_refused_with_the_known_columns() {
    let dir = temporary();
    let path = dir.path().join("run.csv");
    std::fs::write(&path, "Time,Stroke,force_n,displacement_m\n0,1,2,3\n1,2,3,4\n").expect("written");
    assert!(refusal(&path, &plain()).starts_with(
        "run.csv, line 1: no column `time_s` among: Time, Stroke, force_n, displacement_m; the unit belongs to the \
         name, as in displacement_mm, or say which column it is, as in --map time=Time, or name the columns with --column"
    ));
    let time = "time=Time";
    let with = |mapping: &str| load(&path, &mapped(&[time, mapping]));
    let fault = |mapping: &str| match with(mapping).expect_err("refused") {
        RunError::Map { why, .. } => *why,
        other => panic!("{other}"),
    };
    let none = fault("displacement=Strok");
    assert_eq!(
        none.to_string(),
        "there is no column `Strok`; did you mean Stroke?; columns are Time, Stroke, force_n, displacement_m"
    );
    assert!(matches!(fault("displacement=/fl/susp/pos"), MapFault::NoColumn { .. }));
    assert_eq!(
        fault("displacement=force_n").to_string(),
        "column `force_n` holds a force, and displacement is a length: map another column"
    );
    let loaded = with("displacement=Stroke").expect("loads");
    assert_eq!(loaded.run.displacement_m.values, [1.0, 2.0]);
    let notes: Vec<_> = loaded.notes.iter().map(ToString::to_string).collect();
    assert_eq!(
        notes,
        [
            "column `Time` is read in s, as its name has no unit; give unit=... if that is wrong",
            "column `Stroke` is read in m, as its name has no unit; give unit=... if that is wrong",
            "column `displacement_m` is left out, because displacement is mapped to another one",
        ]
    );
    std::fs::write(&path, "t_ms,x\n5,1\n4,2\n").expect("written");
    let disorder = refusal(&path, &mapped(&["time=t_ms", "displacement=x"]));
    assert!(disorder.contains("column `t_ms`: 0.004 s does not come after 0.005 s"), "{disorder}");
    std::fs::write(&path, "time_s,A,B\n0,1,2\n").expect("written");
    assert!(refusal(&path, &mapped(&["displacement=time_s"])).contains("column `time_s` is the time"));
    let hint = refusal(&path, &plain());
    assert!(hint.contains("as in --map displacement=COLUMN, or name the columns"), "{hint}");
}

#[test]
fn a_renamed_topic_is_recognised_by_the_recorders_note() {
    let dir = temporary();
    for (name, options) in [
        ("mcap", BagOptions { max_file_bytes: Some(400), ..small_chunks(true) }),
        ("db3", BagOptions { max_file_bytes: Some(30_000), chunk_max_bytes: 1000, ..sqlite() }),
    ] {
        let path = dir.path().join(name);
        let mut writer = BagWriter::create(&path, options).expect("created");
        writer.note_renamed("/susp/pos", "/fl/displacement");
        // Notes count only for our own channels: a foreign bag cannot turn other topics into known
        // quantities.
        writer.note_renamed("/fl/other/a", "/fl/other/force_n");
        writer.note_renamed("/fl/velocity", "/nowhere/at/all");
        for nanos in 1..500 {
            writer.write_message("/susp/pos", &displacement(nanos, 1.0), nanos, nanos).expect("written");
            let force = Force { header: at(nanos), force: 2.0, variance: 0.0 };
            writer.write_message("/fl/measured_force", &force, nanos, nanos).expect("written");
            writer.write_message("/fl/other/a", &Float64 { data: 3.0 }, nanos, nanos).expect("written");
            writer.write_message("/fl/velocity", &Float64 { data: 4.0 }, nanos, nanos).expect("written");
        }
        let summary = writer.finish().expect("finished");
        assert!(summary.files > 1, "{name}: several files, each with the note");
        let run = read(&path).run;
        assert_eq!((run.displacement_m.len(), run.force_n.expect("force").len()), (499, 499), "{name}");
        assert_eq!(run.velocity_m_s.expect("velocity").len(), 499, "{name}");
        assert_eq!(run.other.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["a"], "{name}");
        // A map finds the topic by its recorded name.
        assert!(load(&path, &mapped(&["displacement=/susp/pos,sign=-1"])).is_ok());
    }
}
