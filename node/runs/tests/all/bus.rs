//! Logs of a CAN bus: every format gives the run of the same values in a CSV file, damaged logs give what they still hold, and errors
//! say what to do. `tests/oracles/bus_logs.py` compares with python-can, asammdf and cantools.

mod groups;
mod logs;
mod packed;

use crate::run_support::*;
use logs::{Cn, Frame, Mdf, asc, blf, candump, started};
use mr_damper_model::sample::{Run, Trace};
use mr_damper_runs::{LoadOptions, Loaded, Map, Note, load};
use std::path::{Path, PathBuf};

const DBC: &str = r#"VERSION ""

BU_: ECU
BO_ 288 SUSP_FL: 8 ECU
 SG_ Position : 0|16@1- (0.01,0.5) [0|0] "mm" ECU
 SG_ Page M : 16|8@1+ (1,0) [0|0] "" ECU
 SG_ Oil m1 : 24|16@1- (0.1,-40) [0|0] "degC" ECU
 SG_ Angle m2 : 24|16@1- (0.1,0) [0|0] "deg" ECU
BO_ 2566848513 RIG: 12 ECU
 SG_ Load : 7|32@0- (1,0) [0|0] "kN" ECU
 SG_ Coil : 32|64@1- (1,0) [0|0] "A" ECU
SIG_VALTYPE_ 2566848513 Load : 1;
SIG_VALTYPE_ 2566848513 Coil : 2;
"#;
const SUSP: u32 = 288;
const RIG: u32 = 2_566_848_513;
const STEPS: i64 = 200;
const MAP: [&str; 4] = [
    "displacement=SUSP_FL.Position,sign=-1,offset=0.001",
    "case_temperature=SUSP_FL.Oil",
    "measured_force=RIG.Load",
    "coil_current=RIG.Coil",
];

/// The raw values of step `k`.
fn raw(k: i64) -> (i16, i16, f32, f64) {
    let t = k as f64 * 0.004;
    (
        ((9.0 * t).sin() * 4000.0) as i16,
        (600 + k) as i16,
        (5.0 * (9.0 * t).cos()).tanh() as f32,
        1.0 + t.sin(),
    )
}

/// The frames: SUSP_FL each 4 ms with another page each time, RIG 0.317 ms later.
fn frames() -> Vec<Frame> {
    let of_step = |k: i64| {
        let (position, oil, load, coil) = raw(k);
        let page = 1 + (k % 2) as u8;
        let mut susp = position.to_le_bytes().to_vec();
        susp.push(page);
        susp.extend(if page == 1 { oil } else { 77 }.to_le_bytes());
        susp.resize(8, 0);
        let rig = [load.to_be_bytes().to_vec(), coil.to_le_bytes().to_vec()].concat();
        [(k * 4_000_000, SUSP, susp), (k * 4_000_000 + 317_001, RIG, rig)]
    };
    (0..STEPS).flat_map(of_step).collect()
}

/// The same values as a CSV file in the signals' units, as cantools computes them.
fn csv() -> String {
    let mut text = "time_s,stroke,temp,load,amps\n".to_owned();
    for k in 0..STEPS {
        let (position, oil, load, coil) = raw(k);
        let temperature = if k % 2 == 0 { (f64::from(oil) * 0.1 - 40.0).to_string() } else { String::new() };
        text += &format!(
            "{}.{:09},{},{temperature},,\n",
            k / 250,
            k % 250 * 4_000_000,
            f64::from(position) * 0.01 + 0.5
        );
        text += &format!("{}.{:09},,,{},{coil}\n", k / 250, k % 250 * 4_000_000 + 317_001, f64::from(load));
    }
    text
}

fn write(dir: &Path, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = dir.join(name);
    std::fs::write(&path, content).expect("written");
    path
}

fn mapped(dbc: &Path, mappings: &[&str]) -> LoadOptions {
    let parsed = mappings.iter().map(|text| text.parse().unwrap_or_else(|error| panic!("{text}: {error}")));
    LoadOptions { dbc: vec![dbc.to_owned()], map: Map::new(parsed.collect()).expect("distinct"), ..plain() }
}

fn channels(run: &Run) -> Vec<(&'static str, Vec<(i64, u64)>)> {
    let bits = |trace: &Trace| {
        let values = trace.values.iter().map(|value| value.to_bits());
        trace.stamps.iter().map(|stamp| stamp.nanos()).zip(values).collect()
    };
    let known = [
        ("displacement", Some(&run.displacement_m)),
        ("force", run.force_n.as_ref()),
        ("drive", run.drive.as_ref().map(|(_, trace)| trace)),
        ("case", run.case_temp_c.as_ref()),
    ];
    known.into_iter().map(|(name, trace)| (name, trace.map(bits).unwrap_or_default())).collect()
}

/// The run of the CSV file.
fn reference(dir: &Path) -> Run {
    let path = write(dir, "reference.csv", csv());
    let map = [
        "time=time_s",
        "displacement=stroke,sign=-1,offset=0.001,unit=mm",
        "case_temperature=temp,unit=C",
        "measured_force=load,unit=kN",
        "coil_current=amps,unit=A",
    ];
    load(&path, &mapped(Path::new("unused.dbc"), &map)).unwrap_or_else(|error| panic!("{error}")).run
}

fn loaded(path: &Path, options: &LoadOptions) -> Loaded {
    load(path, options).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn each_format_of_frames_gives_the_run_of_the_csv_file() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let expected = reference(dir.path());
    for (name, content) in [
        ("run.log", candump(&frames())),
        ("run.asc", asc(&frames())),
        ("run.blf", blf(&frames(), 1000)),
        ("tiny.BLF", blf(&frames(), 61)),
        ("bus.mf4", bus_mdf(true)),
        ("unfinished.mdf", bus_mdf(false)),
    ] {
        let found = loaded(&write(dir.path(), name, content), &mapped(&dbc, &MAP));
        assert_eq!(channels(&found.run), channels(&expected), "{name}");
        let is_expected =
            |note: &Note| matches!(note, Note::LogUnfinished { .. }) && name == "unfinished.mdf";
        assert!(found.notes.iter().all(is_expected), "{name}: {:?}", found.notes);
    }
}

/// A channel without a unit.
const fn channel_without_unit(
    name: &str,
    kind: u8,
    data_type: u8,
    byte: u32,
    bits: u32,
    data: u64,
    conversion: u64,
) -> Cn<'_> {
    Cn { name, unit: "", kind, data_type, byte, bits, data, conversion }
}

/// An MDF4 file with frames whose bytes have variable length, in another group of the same records, in no order.
fn bus_mdf(is_finished: bool) -> Vec<u8> {
    let frames = frames();
    let count = if is_finished { frames.len() as u64 } else { 0 };
    let mut mdf = Mdf::new(is_finished);
    let store = mdf.group(0, 0, 2, count, 1, 0);
    let nanoseconds = mdf.linear(1e-9, 0.0);
    let cn = channel_without_unit;
    let first = mdf.channels(&[
        cn("t", 2, 0, 0, 64, 0, nanoseconds),
        cn("CAN_DataFrame.ID", 0, 0, 8, 32, 0, 0),
        cn("CAN_DataFrame.IDE", 0, 0, 12, 8, 0, 0),
        cn("CAN_DataFrame.BusChannel", 0, 0, 13, 8, 0, 0),
        cn("CAN_DataFrame.DLC", 0, 0, 14, 8, 0, 0),
        cn("CAN_DataFrame.DataBytes", 1, 10, 15, 64, store, 0),
    ]);
    let group = mdf.group(store, first, 1, count, 0, 23);
    let data_group = mdf.data_group(0, group, 1);
    let (mut records, mut stored) = (Vec::new(), 0_u64);
    for (nanos, id, bytes) in &frames {
        records.push(1);
        records.extend((*nanos as u64).to_le_bytes());
        records.extend((id & 0x1fff_ffff).to_le_bytes());
        records.extend([(id >> 31) as u8, 1, if bytes.len() == 12 { 9 } else { 8 }]);
        records.extend(stored.to_le_bytes());
        records.push(2);
        records.extend((bytes.len() as u32).to_le_bytes());
        records.extend(bytes);
        stored += 4 + bytes.len() as u64;
    }
    let data = mdf.block(b"##DT", &[], &records);
    mdf.link(data_group, 2, data);
    let mut bytes = mdf.finish();
    if !is_finished {
        // The recorder writes the length of the data when it ends.
        bytes[data as usize + 8..data as usize + 16].copy_from_slice(&24_u64.to_le_bytes());
    }
    bytes
}

/// An MDF4 file with plain channels, whose data are in a list of parts: packed by each method, with and without a transposition, and one as
/// it is.
fn plain_mdf(rows: u64, conversion: u8) -> Vec<u8> {
    plain_mdf_in("s", "", rows, conversion)
}

/// The same with these units of the time and of the force.
fn plain_mdf_in(time_unit: &str, force_unit: &str, rows: u64, conversion: u8) -> Vec<u8> {
    let mut mdf = Mdf::new(true);
    let linear = mdf.linear(0.01, 0.5);
    let other = mdf.block(b"##CC", &[0; 4], &[[conversion].to_vec(), vec![0; 23]].concat());
    let cn = |name, unit, kind, data_type, byte, bits, conversion| Cn {
        name,
        unit,
        kind,
        data_type,
        byte,
        bits,
        data: 0,
        conversion,
    };
    let first = mdf.channels(&[
        cn("time", time_unit, 2, 4, 0, 64, 0),
        cn("Stroke", "mm", 0, 3, 8, 16, linear),
        cn("force_kn", force_unit, 0, 4, 10, 32, 0),
        cn("Text", "", 0, 0, 14, 16, other),
    ]);
    let group = mdf.group(0, first, 0, rows, 0, 16);
    let data_group = mdf.data_group(0, group, 0);
    let record = |k: u64| {
        let (position, _, load, _) = raw(k as i64);
        let mut record = (k as f64 * 0.004).to_le_bytes().to_vec();
        record.extend(position.to_be_bytes());
        record.extend(load.to_le_bytes());
        record.extend([0; 2]);
        record
    };
    let all: Vec<u8> = (0..rows).flat_map(record).collect();
    let mut parts = vec![0];
    // 6 is a part as it is.
    for (part, kind) in all.chunks(500).zip([1, 0, 6, 3, 2, 5, 4].into_iter().cycle()) {
        parts.push(if kind == 6 { mdf.block(b"##DT", &[], part) } else { mdf.packed(kind, 16, part) });
    }
    let list = mdf.block(b"##DL", &parts, &[0; 16]);
    let header = mdf.block(b"##HL", &[list], &[0; 8]);
    mdf.link(data_group, 2, header);
    mdf.finish()
}

#[test]
fn plain_channels_of_mdf_are_read_by_map_and_by_name() {
    let dir = temporary();
    let path = write(dir.path(), "plain.mf4", plain_mdf(200, 0));
    let none = LoadOptions { dbc: vec![], ..mapped(Path::new(""), &["displacement=Stroke"]) };
    let run = loaded(&path, &none).run;
    assert_eq!(run.displacement_m.len(), 200);
    let force_n = run.force_n.expect("by its name");
    for k in 0..200 {
        let (position, _, load, _) = raw(k);
        let at = k as usize;
        assert_eq!(run.displacement_m.stamps[at].nanos(), k * 4_000_000);
        assert_eq!(
            run.displacement_m.values[at].to_bits(),
            ((f64::from(position) * 0.01 + 0.5) / 1000.0).to_bits()
        );
        assert_eq!(force_n.values[at].to_bits(), (f64::from(load) * 1000.0).to_bits());
    }
    let of_group = LoadOptions { map: mapped(Path::new(""), &["displacement=Stroke:0"]).map, ..plain() };
    assert_eq!(loaded(&path, &of_group).run.displacement_m.len(), 200);
    let refused =
        |map: &str| refusal(&path, &LoadOptions { map: mapped(Path::new(""), &[map]).map, ..plain() });
    assert!(
        refused("displacement=Strok").contains("there is no signal `Strok`; did you mean Stroke?"),
        "{}",
        refused("displacement=Strok")
    );
    assert!(refused("displacement=Stroke:1").contains("there is no signal `Stroke:1`"));
    assert!(
        refused("measured_force=Stroke")
            .contains("Stroke has the unit `mm`, which is not one of measured_force; say which unit")
    );
    let text = refusal(
        &write(dir.path(), "text.mf4", plain_mdf(20, 7)),
        &LoadOptions { map: mapped(Path::new(""), &["displacement=Text,unit=mm"]).map, ..plain() },
    );
    assert!(text.contains("channel `Text` has a conversion of kind 7, and only linear"), "{text}");
    let unmapped = refusal(&path, &plain());
    assert!(
        unmapped
            .contains("say which signal it is, for example --map displacement=Stroke; signals of the log"),
        "{unmapped}"
    );
}

#[test]
fn units_in_an_mdf_file_count() {
    let dir = temporary();
    let options = LoadOptions { map: mapped(Path::new(""), &["displacement=Stroke"]).map, ..plain() };
    let file =
        |name: &str, time: &str, force: &str| write(dir.path(), name, plain_mdf_in(time, force, 200, 0));
    let last_ns = |name: &str, time: &str| {
        loaded(&file(name, time, "kN"), &options).run.displacement_m.stamps[199].nanos()
    };
    assert_eq!(last_ns("ms.mf4", "ms"), 796_000);
    assert_eq!(last_ns("sec.mf4", "sec"), 796_000_000);
    let text = refusal(&file("deg.mf4", "deg", ""), &options);
    assert!(text.contains("the time of channel `Stroke` has the unit `deg`"), "{text}");
    // A channel whose name and unit contradict each other.
    let text = refusal(&file("n.mf4", "s", "N"), &options);
    assert!(
        text.contains("`force_kn` has the unit `N`") && text.contains("--map measured_force=force_kn,unit=N"),
        "{text}"
    );
}

#[test]
fn values_outside_of_their_range_are_dropped_as_from_a_bus() {
    let dir = temporary();
    // 300 of the positions are not allowed.
    let ranged = DBC.replace("(0.01,0.5) [0|0]", "(0.01,0.5) [-1|1]");
    let dbc = write(dir.path(), "ranged.dbc", &ranged);
    let all = loaded(
        &write(dir.path(), "run.log", candump(&frames())),
        &mapped(&write(dir.path(), "car.dbc", DBC), &["displacement=SUSP_FL.Position"]),
    );
    let found = loaded(&dir.path().join("run.log"), &mapped(&dbc, &["displacement=SUSP_FL.Position"]));
    let allowed = all.run.displacement_m.values.iter().filter(|value| value.abs() <= 1e-3).count();
    assert!((1..all.run.displacement_m.len()).contains(&allowed), "{allowed}");
    assert_eq!(found.run.displacement_m.len(), allowed);
    let dropped = all.run.displacement_m.len() - allowed;
    let expected = format!(
        "signal SUSP_FL.Position: {dropped} frames with a value outside of its range in the DBC file dropped"
    );
    assert!(found.notes.iter().any(|note| note.to_string() == expected), "{:?}", found.notes);
    let none = write(dir.path(), "none.dbc", DBC.replace("(0.01,0.5) [0|0]", "(0.01,0.5) [900|901]"));
    let text = refusal(&dir.path().join("run.log"), &mapped(&none, &["displacement=SUSP_FL.Position"]));
    assert!(
        text.contains("SUSP_FL.Position; 200 have a value outside of its range in the DBC file"),
        "{text}"
    );
}

#[test]
fn a_time_that_jumps_ahead_does_not_take_the_rest_of_the_run() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let options = mapped(&dbc, &["displacement=SUSP_FL.Position"]);
    let with_jump_at = |place: usize| {
        let mut frames = frames();
        let of_signal = frames.iter_mut().filter(|frame| frame.1 == SUSP).nth(place);
        of_signal.expect("a frame").0 = 500_000_000_000_000;
        write(dir.path(), "jump.log", candump(&frames))
    };
    let text = refusal(&with_jump_at(10), &options);
    assert!(text.contains("not after 500000 s") && text.contains("Remove that frame"), "{text}");
    let late = loaded(&with_jump_at(STEPS as usize - 3), &options);
    assert!(
        late.notes.iter().any(|note| matches!(note, Note::SignalNotIncreasing { .. })),
        "{:?}",
        late.notes
    );
}

#[test]
fn a_blf_file_that_ends_between_containers_is_noted() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let options = mapped(&dbc, &["displacement=SUSP_FL.Position"]);
    let mut content = blf(&frames(), 500);
    let size = content.len() as u64;
    content[16..24].copy_from_slice(&size.to_le_bytes());
    let whole = loaded(&write(dir.path(), "whole.blf", &content), &options);
    assert!(!whole.notes.iter().any(|note| matches!(note, Note::LogCutShort { .. })), "{:?}", whole.notes);
    // Objects in containers that are not packed are of other kinds.
    let is_container = |at: &usize| content[*at..].starts_with(b"LOBJ") && content[*at + 12] == 10;
    let begins: Vec<usize> = (0..content.len() - 16).filter(is_container).collect();
    let cut = begins[begins.len() / 2];
    let found = loaded(&write(dir.path(), "cut.blf", &content[..cut]), &options);
    let text = found.notes.iter().map(Note::to_string).collect::<Vec<_>>().join("; ");
    assert!(text.contains(&format!("read up to byte {cut}")), "{text}");
    assert!(text.contains(&format!("its header says {size} bytes")), "{text}");
}

#[test]
fn frames_with_an_identifier_that_cannot_be_are_counted() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let options = mapped(&dbc, &["displacement=SUSP_FL.Position"]);
    let mut wrong = frames();
    wrong.iter_mut().filter(|frame| frame.1 == SUSP).take(3).for_each(|frame| frame.1 = 0x2120);
    let content = blf(&wrong, 1 << 20);
    let found = loaded(&write(dir.path(), "ids.blf", content), &options);
    let text = found.notes.iter().map(Note::to_string).collect::<Vec<_>>().join("; ");
    assert!(text.contains("3 frames with an identifier above 0x7FF that is not marked"), "{text}");
    assert_eq!(found.run.displacement_m.len(), STEPS as usize - 3);
}

#[test]
fn times_of_blf_count_from_the_start_of_the_measurement() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let path = write(dir.path(), "run.blf", started(blf(&frames(), 4000)));
    let run = loaded(&path, &mapped(&dbc, &MAP)).run;
    assert_eq!(run.displacement_m.stamps[1].nanos(), 1_700_000_000_254_000_000);
}

#[test]
fn frames_of_asc_before_the_start_of_the_measurement_are_read() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let options = mapped(&dbc, &["displacement=SUSP_FL.Position"]);
    let text = String::from_utf8(asc(&frames())).expect("text");
    let whole = loaded(&write(dir.path(), "whole.asc", &text), &options).run.displacement_m;
    let header = text.lines().take(3).map(|line| format!("{line}\n")).collect::<String>();
    let early =
        "-0.500000 1 120 Rx d 8 01 00 00 00 00 00 00 00\n-0.000100 1 120 Rx d 8 02 00 00 00 00 00 00 00\n";
    let path = write(dir.path(), "early.asc", text.replace(&header, &format!("{header}{early}")));
    let found = loaded(&path, &options);
    let is_hint = |note: &Note| matches!(note, Note::CouldServe { .. });
    assert!(found.notes.iter().all(is_hint), "{:?}", found.notes);
    let trace = found.run.displacement_m;
    let stamps: Vec<i64> = trace.stamps.iter().take(3).map(|stamp| stamp.nanos()).collect();
    assert_eq!(stamps, [-500_000_000, -100_000, 0]);
    assert_eq!(trace.values[2..], whole.values);
}

#[test]
fn what_a_cut_log_still_holds_is_read() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let options = mapped(&dbc, &["displacement=SUSP_FL.Position"]);
    for (name, content) in [
        ("cut.log", candump(&frames())),
        ("cut.asc", asc(&frames())),
        ("cut.blf", blf(&frames(), 500)),
        ("cut.mf4", bus_mdf(true)),
    ] {
        let whole =
            loaded(&write(dir.path(), &format!("whole-{name}"), &content), &options).run.displacement_m;
        for part in [content.len() / 2 + 1, content.len() * 3 / 4 + 2, content.len() - 5] {
            let found = loaded(&write(dir.path(), name, &content[..part]), &options);
            let rows = found.run.displacement_m.len();
            assert!(rows > 60 && rows <= whole.len(), "{name}: {rows} of {}", whole.len());
            assert_eq!(found.run.displacement_m.values, whole.values[..rows], "{name}");
            let note = found.notes.iter().find(|note| matches!(note, Note::LogCutShort { .. }));
            let text = note.unwrap_or_else(|| panic!("{name} at {part}: {:?}", found.notes)).to_string();
            assert!(text.contains(name) && text.contains("read up to "), "{text}");
        }
    }
    // The description of an MDF4 file is at its beginning here, and nothing can be read without it.
    let text = refusal(&write(dir.path(), "head.mf4", &bus_mdf(true)[..300]), &options);
    assert!(text.starts_with("head.mf4: not a whole MDF4 file: byte "), "{text}");
}

#[test]
fn a_frame_that_a_cut_container_ends_in_is_not_completed_with_zeros() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let options = mapped(&dbc, &["displacement=SUSP_FL.Position", "measured_force=RIG.Load"]);
    // One container.
    let content = blf(&frames(), 1 << 20);
    let whole = loaded(&write(dir.path(), "whole.blf", &content), &options).run;
    let mut most = 0;
    for end in (2000..content.len()).step_by(7) {
        let run = loaded(&write(dir.path(), "cut.blf", &content[..end]), &options).run;
        for ((name, found), (_, all)) in channels(&run).iter().zip(channels(&whole)) {
            assert!(
                all.starts_with(found),
                "{name}, cut at {end}: the last of {} is {:?}",
                found.len(),
                found.last()
            );
            most = most.max(found.len());
        }
    }
    assert!(most > 150, "{most}");
}

#[test]
fn a_damaged_container_is_left_out() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let options = mapped(&dbc, &["displacement=SUSP_FL.Position"]);
    let content = blf(&frames(), 500);
    let whole = loaded(&write(dir.path(), "whole.blf", &content), &options).run.displacement_m;
    let second =
        content.windows(4).enumerate().filter(|(_, four)| four == b"LOBJ").nth(1).expect("a second").0;
    let mut damaged = content;
    damaged[second + 40] ^= 0xff;
    let found = loaded(&write(dir.path(), "damaged.blf", damaged), &options);
    let rows = found.run.displacement_m.len();
    assert!(rows < whole.len() && rows > whole.len() - 12, "{rows} of {}", whole.len());
    let is_part = |stamp: &_| whole.stamps.contains(stamp);
    assert!(found.run.displacement_m.stamps.iter().all(is_part));
    assert!(matches!(found.notes.first(), Some(Note::ChunkDamaged { .. })), "{:?}", found.notes);
}

#[test]
fn errors_say_what_to_do() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let log = write(dir.path(), "run.log", candump(&frames()));
    let refused = |map: &[&str]| refusal(&log, &mapped(&dbc, map));
    assert_eq!(
        refusal(&log, &plain()),
        "run.log: holds frames of a bus, and nothing says which signals are in them: give the DBC file of the bus with --dbc FILE.dbc"
    );
    assert_eq!(
        refused(&[]),
        "run.log: no sample of displacement; say which signal it is, for example --map displacement=SUSP_FL.Position; signals of the \
         log (* can hold displacement):\n  * SUSP_FL.Position  mm, 200 samples\n  * SUSP_FL.Page  no unit, 200 samples\n    SUSP_FL.Oil  \
         degC, 200 samples\n    SUSP_FL.Angle  deg, 200 samples\n    RIG.Load  kN, 200 samples\n    RIG.Coil  A, 200 samples"
    );
    for (map, why) in [
        (
            "displacement=SUSP_FL.Positon",
            "there is no signal `SUSP_FL.Positon`; did you mean SUSP_FL.Position?; signals of the log",
        ),
        (
            "displacement=/topic",
            "/topic is a topic, and this run is a log of a bus: name a signal, as in MESSAGE.SIGNAL",
        ),
        ("time=SUSP_FL.Page", "frames of a log have their times: leave out the map of time"),
        (
            "displacement=SUSP_FL.Angle",
            "SUSP_FL.Angle has the unit `deg`, which is not one of displacement; say which unit it is with ,unit=UNIT: units that fit \
             displacement are m, cm, mm, um, in",
        ),
        ("displacement=SUSP_FL.Page", "SUSP_FL.Page has no unit; say which unit it is"),
        ("displacement=SUSP_FL.Position:can7", "no frame of SUSP_FL was on bus `can7`; it was on can0"),
    ] {
        let message = refused(&[map]);
        assert!(message.contains(why), "{map}: {message}");
    }
    // The name of the signal alone, and a bus that is right.
    for map in ["displacement=Position", "displacement=SUSP_FL.Position:can0"] {
        assert_eq!(loaded(&log, &mapped(&dbc, &[map])).run.displacement_m.len(), 200);
    }
    let bad = write(dir.path(), "bad.dbc", DBC.replace("0|16@1-", "0|16@7-"));
    let error = load(&log, &mapped(&bad, &MAP)).expect_err("bad").to_string();
    assert!(error.contains("bad.dbc, line 5: signal `Position` has the byte order `7`"), "{error}");
    let other = write(dir.path(), "other.dbc", DBC.replace("288", "1").replace("2566848513", "2"));
    let error = refusal(&log, &mapped(&other, &["displacement=SUSP_FL.Position"]));
    let why = "no frame of SUSP_FL (0x001) is in the log; the DBC file describes none of the 2 identifiers in the log (0x120, 0x18FF0001 \
               extended): give the DBC file of this bus";
    assert!(error.contains(why), "{error}");
    let twice = write(
        dir.path(),
        "twice.dbc",
        format!("{DBC}\nBO_ 288 AGAIN: 8 ECU\n SG_ Load : 0|8@1+ (1,0) [0|0] \"N\" ECU\n"),
    );
    let error = refusal(&log, &mapped(&twice, &["displacement=SUSP_FL.Position"]));
    assert!(error.contains("several messages have the identifier 0x120: SUSP_FL ("), "{error}");
    let error = refusal(&log, &mapped(&twice, &["measured_force=Load"]));
    assert!(
        error.contains("`Load` names several signals: RIG.Load (") && error.contains("line 10)"),
        "{error}"
    );
    let long = write(dir.path(), "long.dbc", DBC.replace("0|16@1-", "60|16@1-"));
    let error = refusal(&log, &mapped(&long, &["displacement=SUSP_FL.Position"]));
    assert!(
        error.contains("SUSP_FL.Position (line 5 of the DBC file) ends in byte 10 of a message with 8"),
        "{error}"
    );
    let two = write(
        dir.path(),
        "two.log",
        [candump(&frames()), b"(9.0) can1 120#0000010000000000\n".to_vec()].concat(),
    );
    let error = refusal(&two, &mapped(&dbc, &["displacement=SUSP_FL.Position"]));
    assert!(error.contains("its message was on several buses (can0, can1): name one after a colon, as in SUSP_FL.Position:can0"), "{error}");
    let pages = write(dir.path(), "pages.dbc", DBC.replace("m2", "m9"));
    let error = refusal(&log, &mapped(&pages, &["displacement=SUSP_FL.Angle,unit=mm"]));
    assert!(
        error.contains(
            "none of the 200 frames or records has a finite value of SUSP_FL.Angle; 200 hold other signals by their"
        ),
        "{error}"
    );
}

#[test]
fn a_bad_line_is_an_error_or_is_dropped() {
    let dir = temporary();
    let dbc = write(dir.path(), "car.dbc", DBC);
    let options = mapped(&dbc, &["displacement=SUSP_FL.Position"]);
    let text =
        String::from_utf8(candump(&frames())).expect("text").replace("(0.040000000) can0", "0.04 can0");
    let path = write(dir.path(), "bad.log", &text);
    assert!(
        refusal(&path, &options).starts_with("bad.log, line 21: `0.04 can0 120#"),
        "{}",
        refusal(&path, &options)
    );
    let found = loaded(&path, &LoadOptions { skip_bad_rows: true, ..options.clone() });
    assert_eq!(found.run.displacement_m.len(), 199);
    assert!(matches!(found.notes.first(), Some(Note::RowsSkipped { count: 1, .. })), "{:?}", found.notes);
    // Times that go back are dropped with a note, as in bags.
    let back = write(dir.path(), "back.log", text.replace("0.04 can0", "(0.000000000) can0"));
    let found = loaded(&back, &options);
    assert_eq!(found.run.displacement_m.len(), 199);
    assert!(
        found.notes.iter().any(|note| matches!(note, Note::SignalNotIncreasing { count: 1, .. })),
        "{:?}",
        found.notes
    );
    for (name, says) in [
        ("x.blf", "x.blf: not a BLF file: it begins with `time_s,d`"),
        ("x.mf4", "not a whole MDF4 file"),
        ("x.asc", "line 1: `time_s,d"),
    ] {
        let path = write(dir.path(), name, format!("time_s,displacement_m\n{}", "0,1\n".repeat(50)));
        assert!(refusal(&path, &options).contains(says), "{}", refusal(&path, &options));
    }
}
