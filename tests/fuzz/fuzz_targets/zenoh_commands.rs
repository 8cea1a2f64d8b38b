//! Commands from Zenoh. The first byte selects the command and its encoding; the rest is the payload.
#![no_main]

use ciborium::Value;
use libfuzzer_sys::fuzz_target;
use mr_damper_node::source::zenoh::{Judge, Kind, Order, Refusal};

/// The node's time, ns since 1970.
const NOW: i64 = 1_800_000_000_000_000_000;

fuzz_target!(|bytes: &[u8]| {
    let Some((&which, payload)) = bytes.split_first() else { return };
    let (kind, is_cbor) = (Kind::ALL[usize::from(which >> 1) % Kind::ALL.len()], which & 1 == 1);
    let mut judge = Judge::default();
    let told = judge.judge(kind, payload, is_cbor, NOW);
    match &told {
        Ok(order) => {
            obeyed_is_what_was_meant(kind, order);
            let again = judge.judge(kind, payload, is_cbor, NOW);
            assert!(matches!(again, Err(Refusal::Old { .. })), "{again:?} though it was obeyed before");
        }
        Err(refusal) => {
            assert!(!refusal.to_string().is_empty());
            // Its sequence number, whatever it was, is still free.
            let (json, _) = written(kind, &Order::Mode("auto".to_owned()));
            assert!(judge.judge(kind, &json, false, NOW).is_ok(), "a refused command took the number 1");
        }
    }
});

/// The same command has the same effect in either encoding.
fn obeyed_is_what_was_meant(kind: Kind, order: &Order) {
    if let Order::Force(_, force) = order {
        assert!(force.get().is_finite(), "{force:?}");
    }
    let (json, cbor) = written(kind, order);
    for (payload, is_cbor) in [(json, false), (cbor, true)] {
        match Judge::default().judge(kind, &payload, is_cbor, NOW) {
            Ok(again) => assert_eq!(again, *order),
            Err(refusal) => assert!(payload.len() > 4096, "{refusal}"),
        }
    }
}

/// A command of that kind with `order`, or with a value that the kind accepts, and sequence number 1, as JSON and as CBOR.
fn written(kind: Kind, order: &Order) -> (Vec<u8>, Vec<u8>) {
    let (name, value) = match (kind, order) {
        (Kind::ForceRequest, Order::Force(_, force)) => ("force_n", Value::from(force.get())),
        (Kind::ForceRequest, _) => ("force_n", Value::from(0.0)),
        (Kind::LoadModel, Order::Model(text)) => ("model", Value::from(text.as_str())),
        (Kind::LoadModel, _) => ("model", Value::from("")),
        (Kind::SetMode, Order::Mode(text)) => ("mode", Value::from(text.as_str())),
        (Kind::SetMode, _) => ("mode", Value::from("auto")),
    };
    let mut fields = vec![("seq", Value::from(1)), ("deadline_ns", Value::from(NOW + 1)), (name, value)];
    if let Order::Force(Some(stamp), _) = order {
        fields.push(("stamp_ns", Value::from(stamp.nanos())));
    }
    let map = Value::Map(fields.into_iter().map(|(name, value)| (Value::from(name), value)).collect());
    let mut cbor = Vec::new();
    ciborium::into_writer(&map, &mut cbor).expect("written to memory");
    let json: serde_json::Value = map.deserialized().expect("texts and finite numbers");
    (serde_json::to_vec(&json).expect("written to memory"), cbor)
}
