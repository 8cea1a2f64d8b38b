//! Inputs and outputs of a running node on a CAN bus: values of frames equal the values of a log, and sent frames are read back.
//! `tests/oracles/can_outputs.py` compares sent frames with cantools, autosar-e2e and crccheck.

use mr_damper_runs::bus::{
    BusError, CanId, FieldValue, FrameReport, InputCheck, InputValue, Inputs, OutputField, OutputMapping,
    OutputMessage, Refusal, Signals, candump_line, read_log,
};
use mr_damper_runs::{LoadOptions, Map, Mapping, load};
use proptest::prelude::*;
use std::fs;
use std::path::PathBuf;
use tempfile::TempDir;

const DBC: &str = r#"VERSION ""
BU_: ECU
BO_ 288 SUSP_FL: 8 ECU
 SG_ Position : 0|16@1- (0.01,0) [-250|250] "mm" ECU
 SG_ Coil : 16|16@1+ (1,0) [0|0] "mA" ECU
 SG_ Crc : 48|8@1+ (1,0) [0|0] "" ECU
 SG_ Alive : 56|4@1+ (1,0) [0|0] "" ECU
BO_ 2566848513 DAMPER_FL: 12 ECU
 SG_ Force : 7|16@0- (0.5,0) [0|0] "N" ECU
 SG_ High : 23|16@0- (1,0) [0|0] "lbf" ECU
 SG_ Validity : 32|3@1+ (1,0) [0|4] "" ECU
 SG_ Narrow : 40|2@1+ (1,0) [0|0] "" ECU
 SG_ Shared : 36|8@1+ (1,0) [0|0] "" ECU
 SG_ Angle : 64|16@1- (1,0) [0|0] "deg" ECU
 SG_ Crc : 48|8@1+ (1,0) [0|0] "" ECU
 SG_ Alive : 56|4@1+ (1,0) [0|0] "" ECU
BO_ 290 COIL_FL: 2 ECU
 SG_ Demand : 0|16@1+ (0.001,0) [0|2.5] "A" ECU
BO_ 291 ODD: 9 ECU
 SG_ Demand : 0|16@1+ (0.001,0) [0|2.5] "A" ECU
"#;
const KNOWN: [&str; 2] = ["displacement", "coil_current"];

fn dbc() -> (TempDir, PathBuf) {
    let dir = tempfile::tempdir().expect("a directory");
    let path = dir.path().join("car.dbc");
    fs::write(&path, DBC).expect("written");
    (dir, path)
}

fn signals() -> Signals {
    let (_dir, path) = dbc();
    Signals::read(&[path]).expect("a good file")
}

fn map(texts: &[&str]) -> Map {
    let mappings: Vec<Mapping> = texts.iter().map(|text| text.parse().expect("a mapping")).collect();
    Map::new(mappings).expect("distinct")
}

fn inputs(map_texts: &[&str], checks: &[&str]) -> Result<Inputs, BusError> {
    let mut inputs = signals().inputs(&map(map_texts), &KNOWN)?;
    for text in checks {
        inputs.check(&text.parse::<InputCheck>()?)?;
    }
    Ok(inputs)
}

fn output(text: &str) -> Result<OutputMessage, BusError> {
    let none = inputs(&[], &[])?;
    Ok(signals().outputs(&[text.parse::<OutputMapping>()?], &none)?.remove(0))
}

fn id(value: u32) -> CanId {
    CanId::new(value, false).expect("in range")
}

#[test]
fn values_of_frames_are_those_of_a_log() {
    let (dir, path) = dbc();
    let texts = ["displacement=SUSP_FL.Position,sign=-1,offset=0.001", "coil_current=Coil"];
    let mut inputs = inputs(&texts, &[]).expect("it fits");
    assert_eq!((inputs.ids(), inputs.message(id(288))), (vec![id(288)], Some("SUSP_FL")));
    let (mut log, mut found) = (String::new(), [Vec::new(), Vec::new()]);
    for k in 0..500_i64 {
        let mut data = [0; 8];
        data[..2].copy_from_slice(&((k * 37 % 20_000 - 10_000) as i16).to_le_bytes());
        data[2..4].copy_from_slice(&((k * 11 % 2500) as u16).to_le_bytes());
        log += &candump_line(k * 2_000_001, "can0", id(288), &data);
        let report = inputs.take(id(288), &data, |InputValue { channel, value }| {
            found[usize::from(channel == "coil_current")].push(value.to_bits());
        });
        assert_eq!(report, Ok(FrameReport { values: 2, ..FrameReport::default() }));
    }
    let file = dir.path().join("car.log");
    fs::write(&file, &log).expect("written");
    let options = LoadOptions { dbc: vec![path], map: map(&texts), ..LoadOptions::default() };
    let run = load(&file, &options).expect("a run").run;
    let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert_eq!(found[0], bits(&run.displacement_m.values));
    assert_eq!(found[1], bits(&run.drive.expect("a current").1.values));
    assert_eq!(candump_line(-500_000_000, "can0", id(288), &[1]), "(-0.500000000) can0 120#01\n");
    // The log is also played frame by frame.
    let mut again = String::new();
    read_log(&file, Some("can0"), |frame| again += &candump_line(frame.nanos, "can0", frame.id, frame.data))
        .expect("read");
    assert_eq!(again, log);
    let mut none = 0;
    read_log(&file, Some("can1"), |_| none += 1).expect("read");
    assert_eq!(none, 0);
}

#[test]
fn frames_that_do_not_pass_give_no_value() {
    let mut inputs =
        inputs(&["displacement=Position"], &["SUSP_FL,counter=Alive,checksum=Crc"]).expect("it fits");
    let take = |inputs: &mut Inputs, value: u32, data: &[u8]| {
        let mut values = Vec::new();
        let report = inputs.take(id(value), data, |it| values.push(it.value));
        (report.map(|report| (report.missing, report.out_of_range)), values)
    };
    assert_eq!(take(&mut inputs, 288, &[0x10, 0x27, 0, 0, 0, 0, CRC_1, 1]), (Ok((0, 0)), vec![0.1]));
    assert_eq!(take(&mut inputs, 288, &[0x10, 0x27, 0, 0, 0, 0, CRC_1, 1]), (Err(Refusal::Counter), vec![]));
    assert_eq!(
        take(&mut inputs, 288, &[0x10, 0x27, 0, 0, 0, 0, CRC_1 ^ 1, 1]),
        (Err(Refusal::Checksum), vec![])
    );
    assert_eq!(take(&mut inputs, 288, &[0x10, 0x27]), (Err(Refusal::Short), vec![]));
    assert_eq!(take(&mut inputs, 289, &[0; 8]), (Err(Refusal::Other), vec![]));
    assert_eq!(take(&mut inputs, 288, &[0x10, 0x27, 0, 0, 0, 0, CRC_3, 3]), (Ok((1, 0)), vec![0.1]));
    // 300 mm, beyond the 250 mm of the file.
    assert_eq!(take(&mut inputs, 288, &[0x30, 0x75, 0, 0, 0, 0, CRC_300, 4]), (Ok((0, 1)), vec![]));
}

#[test]
fn a_second_check_of_a_message_is_refused_and_the_first_one_stays() {
    let mut inputs = inputs(&["displacement=Position"], &["SUSP_FL,checksum=Crc"]).expect("it fits");
    let second: InputCheck = "SUSP_FL,counter=Alive".parse().expect("a form");
    let error = inputs.check(&second).expect_err("twice").to_string();
    assert!(error.contains("SUSP_FL is given twice"), "{error}");
    let wrong = [0x10, 0x27, 0, 0, 0, 0, CRC_1 ^ 1, 1];
    assert_eq!(inputs.take(id(288), &wrong, |_| {}), Err(Refusal::Checksum));
}

/// Checksums by crccheck 1.3.1, `Crc8SaeJ1850.calc`, of the other seven bytes.
const CRC_1: u8 = 0x49;
const CRC_3: u8 = 0x73;
const CRC_300: u8 = 0x87;

#[test]
fn an_output_is_read_back_and_what_does_not_fit_is_not_available() {
    let mut message = output(
        "force_estimate=DAMPER_FL,force=Force,band_high=High,validity=Validity,counter=Alive,checksum=Crc,data_id=0x123",
    )
    .expect("it fits");
    assert_eq!((message.name(), message.id().extended), ("DAMPER_FL", true));
    let mut encode = |force_n: f64| {
        let fits = message.can_carry(OutputField::Force, force_n);
        let data = message.encode(|field| match field {
            OutputField::Force | OutputField::BandHigh => FieldValue::Number(force_n),
            _ => FieldValue::Code(2),
        });
        (fits, data.to_vec())
    };
    let (fits, data) = encode(-1000.26);
    assert_eq!((fits, &data[..2]), (true, &(-2001_i16).to_be_bytes()[..]));
    // -1000.26 N are -224.87 lbf.
    assert_eq!((&data[2..4], data[4], data[7]), (&(-225_i16).to_be_bytes()[..], 2, 0));
    for force_n in [20_000.0, f64::NAN, -16_384.0] {
        let (fits, data) = encode(force_n);
        assert_eq!((fits, &data[..2]), (false, &[0x80, 0][..]), "{force_n}");
    }
    let command = output("current_command=COIL_FL,current=Demand").expect("it fits");
    for (current_a, fits) in [(0.0, true), (2.5, true), (2.5001, false), (-0.001, false), (f64::NAN, false)] {
        assert_eq!(command.can_carry(OutputField::Current, current_a), fits, "{current_a}");
    }
    assert!(command.can_carry(OutputField::ForceRequested, 1e9), "no signal carries it");
}

#[test]
fn faults_of_inputs_and_outputs_name_the_place_and_the_remedy() {
    for (text, why) in [
        (
            "force=DAMPER_FL,force=Force",
            "`force=DAMPER_FL,force=Force` is not an output; write TOPIC=MESSAGE,FIELD=SIGNAL",
        ),
        ("force_estimate=force=Force", "is not an output"),
        ("force_estimate=DAMPER_FL,validity=Validity", "no signal carries the force: add force=SIGNAL"),
        ("force_estimate=DAMPER_FL,forc=Force", "has no `forc`; it has force, std_dev, band_low"),
        ("force_estimate=DAMPER_FR,force=Force", "have no message `DAMPER_FR`; did you mean DAMPER_FL?"),
        (
            "force_estimate=DAMPER_FL,force=Forces",
            "message DAMPER_FL has no signal `Forces`; its signals are Force, High",
        ),
        ("force_estimate=DAMPER_FL,force=Angle", "its unit is `deg`, but must be one of N, kN, lbf, kgf"),
        ("force_estimate=DAMPER_FL,force=Force,validity=Narrow", "a code from 0 to 4 needs 3 unsigned bits"),
        ("force_estimate=DAMPER_FL,force=Force,mode=Shared,counter=Narrow", "Shared and Narrow share bits"),
        ("force_estimate=DAMPER_FL,force=Force,force=High", "force is given twice"),
        ("current_command=ODD,current=Demand", "message ODD has 9 bytes; frames have 1 to 8, 12"),
    ] {
        let error = output(text).expect_err(text).to_string();
        assert!(error.contains(why), "{text}: {error}");
    }
    let as_input = inputs(&["displacement=Position"], &[]).expect("it fits");
    let both: OutputMapping = "current_command=SUSP_FL,current=Coil".parse().expect("a form");
    let error = signals().outputs(&[both], &as_input).expect_err("two uses").to_string();
    assert!(error.contains("message SUSP_FL (0x120) is an input already"), "{error}");
    for (map, checks, why) in [
        (&["displacement=Positon"][..], &[][..], "did you mean SUSP_FL.Position?"),
        (&["displacement=/susp/pos"], &[], "is a topic"),
        (&["displacement=SUSP_FL.Alive"], &[], "has no unit; say which unit it is with ,unit=UNIT"),
        (
            &["setpoint=Position"],
            &[],
            "setpoint is not an input of the node; inputs are displacement, coil_current",
        ),
        (
            &["displacement=Position"],
            &["SUSP_FL"],
            "is not a check of a message; write MESSAGE,counter=SIGNAL",
        ),
        (&["displacement=Position"], &["COIL_FL,counter=Demand"], "a counter is unsigned, with factor 1"),
        (
            &["displacement=Position"],
            &["DAMPER_FL,counter=Alive"],
            "no input is mapped to a signal of DAMPER_FL",
        ),
    ] {
        let error = inputs(map, checks).map(drop).expect_err(why).to_string();
        assert!(error.contains(why), "{error}");
    }
}

proptest! {
    #[test]
    fn no_text_and_no_frame_panics(text in "(force_estimate|current_command)?=?[A-Z_]{0,9}(,[a-z_]{0,9}=.{0,6}){0,4}", data: Vec<u8>) {
        let _ = output(&text);
        let _ = text.parse::<InputCheck>();
        let mut inputs = inputs(&["displacement=Position"], &["SUSP_FL,counter=Alive,checksum=Crc"]).expect("it fits");
        let _ = inputs.take(id(288), &data, |_| {});
    }
}
