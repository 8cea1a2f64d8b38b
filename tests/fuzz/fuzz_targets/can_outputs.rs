//! Outputs of a running node on a CAN bus (`can.out`), one per line, and after an empty line the DBC file that describes their messages.
//! Errors quote the output, a number that a signal cannot carry is sent as *not available*, and the frames pass the check of an input with
//! the same alive counter and checksum, unless a bit is changed.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::file;
use mr_damper_runs::bus::{
    FieldValue, InputCheck, Inputs, OutputField, OutputMapping, OutputMessage, OutputTopic, Refusal, Signals,
};
use mr_damper_runs::{Map, Mapping};

/// Numbers in SI units.
const NUMBERS: [f64; 10] = [0.0, 1.0, -1.0, 0.37, 2.5, -32_768.0, 1e6, f64::MAX, f64::INFINITY, f64::NAN];
/// Lengths of the frames of CAN and CAN FD, bytes.
const LENGTHS: [usize; 15] = [1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

fuzz_target!(|text: &str| {
    let (lines, dbc) = text.split_once("\n\n").unwrap_or((text, ""));
    let mappings: Vec<OutputMapping> = lines.lines().take(4).filter_map(parsed).collect();
    let Ok(signals) = Signals::read(&[file("outputs.dbc", dbc.as_bytes())]) else { return };
    let none = signals.inputs(&Map::default(), &[]).expect("no input is mapped");
    for mapping in &mappings {
        match signals.outputs(std::slice::from_ref(mapping), &none) {
            Ok(messages) => messages.iter().for_each(|message| check(&signals, mapping, message)),
            Err(error) => assert_quotes(&error.to_string(), &mapping.to_string()),
        }
    }
    if let Ok(messages) = signals.outputs(&mappings, &none) {
        let is_twice = |(index, message): (usize, &OutputMessage)| {
            messages[..index].iter().any(|it| it.id() == message.id())
        };
        assert!(!messages.iter().enumerate().any(is_twice), "two outputs have one message");
    }
});

/// The output in a text; it is written as it was read.
fn parsed(text: &str) -> Option<OutputMapping> {
    match text.parse::<OutputMapping>() {
        Ok(mapping) => {
            assert_eq!(mapping.to_string(), text);
            Some(mapping)
        }
        Err(error) => {
            assert_quotes(&error.to_string(), text);
            None
        }
    }
}

fn assert_quotes(error: &str, text: &str) {
    assert!(error.contains(text), "the error does not quote {text:?}: {error}");
}

fn check(signals: &Signals, mapping: &OutputMapping, message: &OutputMessage) {
    let main = match message.topic() {
        OutputTopic::ForceEstimate => OutputField::Force,
        OutputTopic::CurrentCommand => OutputField::Current,
    };
    assert!(message.has(main), "{mapping} does not send its main number");
    let first = |number: f64| encoded(&mut message.clone(), main, number);
    let not_available = first(f64::NAN);
    for number in NUMBERS {
        let frame = first(number);
        assert!(LENGTHS.contains(&frame.len()), "{mapping}: {} bytes", frame.len());
        let is_sent = frame != not_available;
        assert_eq!(message.can_carry(main, number), is_sent, "{mapping}: {number}");
    }
    let text = mapping.to_string();
    let parts = text.split(',').skip(1).filter_map(|part| part.split_once('='));
    let options: Vec<(&str, &str)> = parts.map(|(name, value)| (name.trim(), value.trim())).collect();
    if let Some(mut inputs) = checked_input(signals, &options, message) {
        let has_checksum = options.iter().any(|(name, _)| *name == "checksum");
        check_frames(message, main, &mut inputs, has_checksum);
    }
}

/// The frame with this number in the main field and codes in the others.
fn encoded(message: &mut OutputMessage, main: OutputField, number: f64) -> Vec<u8> {
    let value = |field| if field == main { FieldValue::Number(number) } else { FieldValue::Code(u64::MAX) };
    message.encode(value).to_vec()
}

/// An input from the message, with the counter and the checksum of the output; `None` if the output has neither.
fn checked_input(signals: &Signals, options: &[(&str, &str)], message: &OutputMessage) -> Option<Inputs> {
    let (field, channel) = match message.topic() {
        OutputTopic::ForceEstimate => ("force", "measured_force"),
        OutputTopic::CurrentCommand => ("current", "coil_current"),
    };
    let (_, signal) = options.iter().find(|(name, _)| *name == field)?;
    let source: Mapping = format!("{channel}={}.{signal}", message.name()).parse().ok()?;
    let mut inputs = signals.inputs(&Map::new(vec![source]).ok()?, &[channel]).ok()?;
    // A name with a point may mean a signal of another message.
    inputs.message(message.id())?;
    let protects = |(name, _): &&(&str, &str)| ["counter", "checksum", "data_id"].contains(name);
    let names = options.iter().filter(protects).map(|(name, value)| format!(",{name}={value}"));
    let check: InputCheck = format!("{}{}", message.name(), names.collect::<String>()).parse().ok()?;
    inputs.check(&check).expect("the output has the same options");
    Some(inputs)
}

fn check_frames(message: &OutputMessage, main: OutputField, inputs: &mut Inputs, has_checksum: bool) {
    let mut sender = message.clone();
    for number in NUMBERS.into_iter().cycle().take(40) {
        let frame = encoded(&mut sender, main, number);
        let report = inputs.take(message.id(), &frame, |_| {});
        assert_eq!(report.map(|report| report.missing), Ok(0), "{frame:02x?}");
    }
    let frame = encoded(&mut sender, main, 0.0);
    for bit in 0..8 * frame.len() {
        let mut changed = frame.clone();
        changed[bit / 8] ^= 1 << (bit % 8);
        let report = inputs.take(message.id(), &changed, |_| {});
        assert!(!has_checksum || report == Err(Refusal::Checksum), "bit {bit} of {frame:02x?}: {report:?}");
    }
}
