//! Commands from Zenoh. The first byte selects the command and its encoding; the rest is the payload.
#![no_main]

use ciborium::Value;
use libfuzzer_sys::fuzz_target;
use mr_damper_node::streams::source::zenoh::{CommandCheck, CommandKind, CommandRefusal, ZenohCommand};

/// The node's time, ns since 1970.
const NOW: i64 = 1_800_000_000_000_000_000;

fuzz_target!(|bytes: &[u8]| {
    let Some((&which, payload)) = bytes.split_first() else { return };
    let (kind, is_cbor) =
        (CommandKind::ALL[usize::from(which >> 1) % CommandKind::ALL.len()], which & 1 == 1);
    let mut check = CommandCheck::default();
    let result = check.accept(kind, payload, is_cbor, NOW);
    match &result {
        Ok(command) => {
            executed_is_what_was_sent(kind, command);
            let again = check.accept(kind, payload, is_cbor, NOW);
            assert!(
                matches!(again, Err(CommandRefusal::Old { .. })),
                "{again:?} though it was executed before"
            );
        }
        Err(refusal) => {
            assert!(!refusal.to_string().is_empty());
            // Its sequence number, whatever it was, is still free.
            let (json, _) = written(kind, &ZenohCommand::Mode("auto".to_owned()));
            assert!(check.accept(kind, &json, false, NOW).is_ok(), "a refused command took the number 1");
        }
    }
});

/// The same command has the same effect in either encoding.
fn executed_is_what_was_sent(kind: CommandKind, command: &ZenohCommand) {
    if let ZenohCommand::Force(_, force) = command {
        assert!(force.get().is_finite(), "{force:?}");
    }
    let (json, cbor) = written(kind, command);
    for (payload, is_cbor) in [(json, false), (cbor, true)] {
        match CommandCheck::default().accept(kind, &payload, is_cbor, NOW) {
            Ok(again) => assert_eq!(again, *command),
            Err(refusal) => assert!(payload.len() > 4096, "{refusal}"),
        }
    }
}

/// A command of that kind with `command`, or with a value that the kind accepts, and sequence number 1, as JSON and as CBOR.
fn written(kind: CommandKind, command: &ZenohCommand) -> (Vec<u8>, Vec<u8>) {
    let (name, value) = match (kind, command) {
        (CommandKind::ForceRequest, ZenohCommand::Force(_, force)) => ("force_n", Value::from(force.get())),
        (CommandKind::ForceRequest, _) => ("force_n", Value::from(0.0)),
        (CommandKind::LoadModel, ZenohCommand::Model(text)) => ("model", Value::from(text.as_str())),
        (CommandKind::LoadModel, _) => ("model", Value::from("")),
        (CommandKind::SetMode, ZenohCommand::Mode(text)) => ("mode", Value::from(text.as_str())),
        (CommandKind::SetMode, _) => ("mode", Value::from("auto")),
    };
    let mut fields = vec![("seq", Value::from(1)), ("deadline_ns", Value::from(NOW + 1)), (name, value)];
    if let ZenohCommand::Force(Some(stamp), _) = command {
        fields.push(("stamp_ns", Value::from(stamp.nanos())));
    }
    let map = Value::Map(fields.into_iter().map(|(name, value)| (Value::from(name), value)).collect());
    let mut cbor = Vec::new();
    ciborium::into_writer(&map, &mut cbor).expect("written to memory");
    let json: serde_json::Value = map.deserialized().expect("texts and finite numbers");
    (serde_json::to_vec(&json).expect("written to memory"), cbor)
}
