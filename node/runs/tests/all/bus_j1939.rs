//! Messages of J1939, which are known by their PGN: from logs and from a running bus. The values are the same, whatever priority and
//! addresses the frames have, and frames of several senders are not mixed.

use crate::run_support::*;
use mr_damper_runs::bus::{CanId, FrameReport, InputCheck, InputValue, Inputs, Refusal, Signals};
use mr_damper_runs::{LoadOptions, Loaded, Map, Mapping, load};
use std::fs;
use std::path::PathBuf;
use tempfile::TempDir;

/// EEC is of PDU2 and no sender has its address; TSC is of PDU1; OWN has the address of a sender. PLAIN is not of J1939, and has a PGN
/// of its own.
const DBC: &str = r#"VERSION ""
BU_: ECU
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "J1939PG";
BO_ 2364540158 EEC: 8 ECU
 SG_ Position : 0|16@1- (0.01,0) [0|0] "mm" ECU
 SG_ Alive : 56|4@1+ (1,0) [0|0] "" ECU
BO_ 2348810494 TSC: 8 ECU
 SG_ Demand : 0|16@1- (0.01,0) [0|0] "mm" ECU
BO_ 2566840320 OWN: 8 ECU
 SG_ Stroke : 0|16@1- (0.01,0) [0|0] "mm" ECU
BO_ 2566844160 PLAIN: 8 ECU
 SG_ Travel : 0|16@1- (0.01,0) [0|0] "mm" ECU
BA_ "VFrameFormat" BO_ 2566844160 1;
"#;
// cantools 45.1.0: the identifiers above without bit 31 are 0x0CF004FE, 0x0C0000FE (TSC), 0x18FEE000 and 0x18FEEF00.
const EEC: u32 = 0x0cf0_04fe;
const OWN: u32 = 0x18fe_e000;
const PLAIN: u32 = 0x18fe_ef00;
const OWN_OF_21: u32 = OWN | 0x21;

struct Files {
    dir: TempDir,
    dbc: PathBuf,
}

fn data(value: i16) -> [u8; 8] {
    let [low, high] = value.to_le_bytes();
    [low, high, 0, 0, 0, 0, 0, 0]
}

fn map(text: &str) -> Map {
    Map::new(vec![text.parse::<Mapping>().expect("a mapping")]).expect("one")
}

fn extended(value: u32) -> CanId {
    CanId::new(value, true).expect("29 bits")
}

impl Files {
    fn new(dbc_text: &str) -> Self {
        let dir = temporary();
        let dbc = dir.path().join("car.dbc");
        fs::write(&dbc, dbc_text).expect("written");
        Self { dir, dbc }
    }

    /// The log of frames with these buses, identifiers and values, at each millisecond.
    fn log(&self, frames: &[(&str, u32, i16)]) -> PathBuf {
        let line = |(k, (bus, id, value)): (usize, &(&str, u32, i16))| {
            let hex = data(*value).map(|byte| format!("{byte:02X}")).concat();
            format!("(0.{k:03}) {bus} {id:08X}#{hex}\n")
        };
        let path = self.dir.path().join("run.log");
        fs::write(&path, frames.iter().enumerate().map(line).collect::<String>()).expect("written");
        path
    }

    fn options(&self, source: &str) -> LoadOptions {
        LoadOptions { dbc: vec![self.dbc.clone()], map: map(&format!("displacement={source}")), ..plain() }
    }

    fn loaded(&self, frames: &[(&str, u32, i16)], source: &str) -> Loaded {
        load(&self.log(frames), &self.options(source)).unwrap_or_else(|error| panic!("{source}: {error}"))
    }

    fn refusal(&self, frames: &[(&str, u32, i16)], source: &str) -> String {
        refusal(&self.log(frames), &self.options(source))
    }

    /// Displacement from the first source, and velocity from the second.
    fn inputs(&self, sources: &[&str]) -> Inputs {
        let mapping = |(source, form): (&&str, &str)| form.replace('_', source).parse().expect("a mapping");
        let forms = ["displacement=_", "velocity=_,unit=m/s"];
        let map = Map::new(sources.iter().zip(forms).map(mapping).collect()).expect("distinct");
        let signals = Signals::read(std::slice::from_ref(&self.dbc)).expect("a good file");
        signals.inputs(&map, &["displacement", "velocity"]).unwrap_or_else(|error| panic!("{error}"))
    }
}

/// The values in 0.01 mm.
fn values(found: &Loaded) -> Vec<i64> {
    found.run.displacement_m.values.iter().map(|value| (value * 1e5).round() as i64).collect()
}

fn warnings(found: &Loaded) -> Vec<String> {
    found.notes.iter().map(ToString::to_string).collect()
}

/// The value of each frame on a running bus, or the refusal.
fn live(inputs: &mut Inputs, frames: &[(&str, u32, i16)]) -> Vec<Result<i64, Refusal>> {
    let take = |(_, id, value): &(&str, u32, i16)| {
        let mut found = Vec::new();
        let on = |it: InputValue| found.push((it.value * 1e5).round() as i64);
        inputs.take(extended(*id), &data(*value), on).map(|report| {
            assert_eq!(report, FrameReport { values: 1, ..FrameReport::default() });
            found[0]
        })
    };
    frames.iter().map(take).collect()
}

#[test]
fn frames_match_by_pgn_whatever_priority_and_addresses_they_have() {
    let files = Files::new(DBC);
    for (source, frames) in [
        ("EEC.Position", [("can0", 0x0cf0_0421, 1), ("can0", 0x18f0_0421, 2), ("can0", 0x18f0_0521, 9)]),
        // The PGN contains the data pages, but not the destination of PDU1.
        ("TSC.Demand", [("can0", 0x0c00_0f0b, 1), ("can0", 0x0000_0f0b, 2), ("can0", 0x0d00_0f0b, 9)]),
        ("OWN.Stroke", [("can0", OWN, 1), ("can0", OWN & 0x03ff_ffff, 2), ("can0", 0x18fe_e100, 9)]),
        ("OWN.Stroke", [("can0", OWN_OF_21, 1), ("can0", OWN_OF_21, 2), ("can0", 0x18fe_e100, 9)]),
        // The identifier of the DBC file itself.
        ("EEC.Position", [("can0", EEC, 1), ("can0", EEC, 2), ("can0", PLAIN, 9)]),
        // Not of J1939.
        ("PLAIN.Travel", [("can0", PLAIN, 1), ("can0", PLAIN, 2), ("can0", PLAIN | 0x21, 9)]),
    ] {
        let found = files.loaded(&frames, source);
        assert_eq!((values(&found), warnings(&found)), (vec![1, 2], vec![]), "{source}");
        let mut inputs = files.inputs(&[source]);
        assert_eq!(live(&mut inputs, &frames), [Ok(1), Ok(2), Err(Refusal::Other)], "{source}");
        assert!(frames[..2].iter().all(|frame| inputs.filters()[0].passes(extended(frame.1))));
    }
    // The same with the protocol of the file, and without a word on J1939.
    let frames = [("can0", 0x18f0_0421, 1)];
    let protocol =
        DBC.replace("BA_DEF_DEF_ \"VFrameFormat\" \"J1939PG\";", "BA_ \"ProtocolType\" \"J1939\";");
    assert_eq!(values(&Files::new(&protocol).loaded(&frames, "EEC.Position")), [1]);
    let none = DBC.replace("BA_DEF_DEF_ \"VFrameFormat\" \"J1939PG\";", "");
    let error = Files::new(&none).refusal(&frames, "EEC.Position");
    assert!(error.contains("no frame of EEC (0x0CF004FE extended) is in the log"), "{error}");
}

#[test]
fn several_senders_are_refused_until_the_map_names_one() {
    let files = Files::new(DBC);
    let frames = [("can0", 0x0cf0_0421, 1), ("can1", 0x0cf0_0422, 2), ("can0", 0x18f0_0421, 3)];
    let error = files.refusal(&frames, "EEC.Position");
    assert!(
        error.contains(
            "its J1939 message came from several addresses (0x21, 0x22; the DBC file has 0xFE): name one after @, as in EEC.Position@0x21"
        ),
        "{error}"
    );
    for (source, expected) in [
        ("EEC.Position@0x21", vec![1, 3]),
        ("EEC.Position@33", vec![1, 3]),
        ("Position@0x22", vec![2]),
        ("EEC.Position@0x21:can0", vec![1, 3]),
        ("EEC.Position:can1", vec![2]),
    ] {
        assert_eq!(values(&files.loaded(&frames, source)), expected, "{source}");
    }
    // An unmapped log lists each sender.
    let error =
        refusal(&files.log(&frames), &LoadOptions { map: Map::default(), ..files.options("EEC.Position") });
    assert!(
        error.contains("EEC.Position@0x21  mm, 2 samples")
            && error.contains("EEC.Position@0x22  mm, 1 sample"),
        "{error}"
    );
    for (source, why) in [
        (
            "EEC.Position@0x23",
            "no frame of EEC (0x0CF004FE extended, J1939 PGN 61444) came from address 0x23; frames came from 0x21, 0x22",
        ),
        ("EEC.Position@0x21:can1", "no frame of EEC was on bus `can1`; it was on can0"),
        ("EEC.Position@0x121", "`0x121` is not a source address of J1939, such as 0x21 or 33"),
        ("EEC.Position@0x21/0x00", "`0x21/0x00` is not a source address of J1939"),
        ("PLAIN.Travel@0x21", "PLAIN.Travel is in message PLAIN, which the DBC file does not mark as J1939"),
        ("EEC.Positon@0x21", "there is no signal `EEC.Positon@0x21`; did you mean EEC.Position@0x21?"),
    ] {
        let error = files.refusal(&frames, source);
        assert!(error.contains(why), "{source}: {error}");
    }
    let buses = [frames[0], ("can1", 0x0cf0_0421, 2), frames[1]];
    let error = files.refusal(&buses, "EEC.Position@0x21");
    assert!(
        error.contains("several buses (can0, can1): name one after a colon, as in EEC.Position@0x21:can0"),
        "{error}"
    );
    let error = files.refusal(&[frames[0], ("can0", 0x0cf0_0422, 2)], "EEC.Position:can0");
    assert!(error.contains("as in EEC.Position@0x21:can0"), "{error}");
    // Frames to several destinations carry different demands.
    let demands = [("can0", 0x0c00_000b, 1), ("can0", 0x0c00_0f0b, 2), ("can0", 0x0c00_0f0b, 3)];
    let error = files.refusal(&demands, "TSC.Demand");
    assert!(
        error.contains(
            "(0x0B/0x00, 0x0B/0x0F; the DBC file has 0xFE/0x00): name one after @, as in TSC.Demand@0x0B/0x00"
        ),
        "{error}"
    );
    let error = files.refusal(&demands, "TSC.Demand@0x0B:can0");
    assert!(
        error.contains("several addresses (0x0B/0x00, 0x0B/0x0F")
            && error.contains("as in TSC.Demand@0x0B/0x00:can0"),
        "{error}"
    );
    assert_eq!(values(&files.loaded(&demands[1..], "TSC.Demand@0x0B")), [2, 3]);
    assert_eq!(values(&files.loaded(&demands, "TSC.Demand@0x0B/0x0F")), [2, 3]);
}

#[test]
fn the_sender_of_the_dbc_file_has_priority() {
    let files = Files::new(DBC);
    let frames = [("can1", OWN_OF_21, 1), ("can0", OWN, 2), ("can1", OWN | 0x22, 3), ("can0", OWN, 4)];
    let found = files.loaded(&frames, "OWN.Stroke");
    assert_eq!(values(&found), [2, 4]);
    assert_eq!(
        warnings(&found),
        [
            "signal OWN.Stroke: frames of address 0x00 were read, because the DBC file has it; others came from 0x21, 0x22: name another one \
          after @"
        ]
    );
    let found = files.loaded(&frames, "OWN.Stroke@0x21");
    assert_eq!((values(&found), warnings(&found)), (vec![1], vec![]));
}

#[test]
fn messages_of_one_pgn_are_told_apart_by_their_addresses() {
    let second = DBC.replace(
        "BO_ 2566844160 PLAIN",
        "BO_ 2566840353 OTHER: 8 ECU\n SG_ Stroke : 0|16@1- (1,0) [0|0] \"mm\" ECU\nBO_ 2566844160 PLAIN",
    );
    let files = Files::new(&second);
    // 0x22 is the address of neither, and the last one has another priority.
    let frames = [
        ("can0", OWN, 1),
        ("can0", OWN_OF_21, 2),
        ("can0", OWN | 0x22, 3),
        ("can0", OWN_OF_21 & 0x03ff_ffff, 4),
    ];
    for (source, expected, taken) in [
        ("OWN.Stroke", vec![1], [Ok(1), Err(Refusal::Other), Err(Refusal::Other), Err(Refusal::Other)]),
        ("OTHER.Stroke", vec![200, 400], [Err(Refusal::Other), Ok(200), Err(Refusal::Other), Ok(400)]),
    ] {
        let found = files.loaded(&frames, source);
        assert_eq!((values(&found), warnings(&found)), (expected, vec![]), "{source}");
        assert_eq!(live(&mut files.inputs(&[source]), &frames), taken, "{source}");
    }
}

#[test]
fn a_running_bus_uses_the_sender_that_a_log_would_use() {
    let files = Files::new(DBC);
    let frames = [
        ("can0", 0x0cf0_0421, 1),
        ("can0", 0x18f0_0421, 2),
        ("can0", 0x0cf0_0422, 3),
        ("can0", 0x0cf0_0421, 4),
    ];
    let several = Err(Refusal::SeveralSenders);
    assert_eq!(live(&mut files.inputs(&["EEC.Position"]), &frames), [Ok(1), Ok(2), several, several]);
    let mut named = files.inputs(&["EEC.Position@0x21"]);
    let other = Err(Refusal::Other);
    assert_eq!(live(&mut named, &frames), [Ok(1), Ok(2), other, Ok(4)]);
    assert_eq!(named.ids(), [extended(0x0cf0_0421)]);
    assert_eq!(named.message_id(extended(0x18f0_0421)), Some(extended(0x0cf0_0421)));
    assert_eq!(
        (named.message(extended(0x18f0_0421)), named.message(extended(0x18f0_0422))),
        (Some("EEC"), None)
    );
    let own = [("can0", OWN, 1), ("can0", OWN_OF_21, 2), ("can0", OWN, 3)];
    assert_eq!(live(&mut files.inputs(&["OWN.Stroke"]), &own), [Ok(1), other, Ok(3)]);
    let demands = [("can0", 0x0c00_000b, 1), ("can0", 0x0c00_0f0b, 2)];
    assert_eq!(live(&mut files.inputs(&["TSC.Demand@0x0B/0x0F"]), &demands), [other, Ok(2)]);
    for source in ["TSC.Demand", "TSC.Demand@0x0B"] {
        assert_eq!(live(&mut files.inputs(&[source]), &demands), [Ok(1), several], "{source}");
    }
    // One signal with a sender and one without.
    let mut both = files.inputs(&["EEC.Position", "Position@0x22"]);
    let mut channels = Vec::new();
    let reports = frames.map(|(_, id, value)| {
        let report = both.take(extended(id), &data(value), |it| channels.push(it.channel));
        report.map(|report| (report.values, report.several_senders))
    });
    assert_eq!(reports, [Ok((1, 0)), Ok((1, 0)), Ok((1, 1)), Err(Refusal::SeveralSenders)]);
    assert_eq!(channels, ["displacement", "displacement", "velocity"]);
}

#[test]
fn each_sender_has_an_alive_counter_of_its_own() {
    let files = Files::new(DBC);
    let mut inputs = files.inputs(&["EEC.Position@0x21", "EEC.Alive@0x22"]);
    inputs.check(&"EEC,counter=Alive".parse::<InputCheck>().expect("a check")).expect("it fits");
    let mut take = |id: u32, counter: u8| {
        inputs.take(extended(id), &[0, 0, 0, 0, 0, 0, 0, counter], |_| {}).map(|report| report.missing)
    };
    assert_eq!(
        [take(0x0cf0_0421, 1), take(0x0cf0_0422, 1), take(0x0cf0_0421, 2), take(0x0cf0_0422, 3)],
        [Ok(0), Ok(0), Ok(0), Ok(1)]
    );
    assert_eq!(take(0x0cf0_0421, 2), Err(Refusal::Counter));
}
