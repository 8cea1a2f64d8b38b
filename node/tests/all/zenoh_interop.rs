//! The Zenoh mirror read from Python, with the eclipse-zenoh wheel and none of our code.
//!
//! `python3 -m venv V && V/bin/pip install eclipse-zenoh cbor2`, then
//! `ZENOH_PYTHON=V/bin/python cargo test -p mr-damper-node --test all zenoh_interop -- --ignored`.

use crate::turn::turn;
use crate::wait::wait_until;
use crate::zenoh_support::*;
use mr_damper_node::streams::sink::zenoh::Encoding;
use std::path::Path;
use std::process::{Command, Stdio};

#[test]
#[ignore = "needs Python with eclipse-zenoh and cbor2: set ZENOH_PYTHON"]
fn python_reads_every_encoding() {
    let _turn = turn(module_path!());
    let python = std::env::var("ZENOH_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let reader = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/interop/zenoh_reader.py");
    for encoding in [Encoding::Cbor, Encoding::Json, Encoding::Cdr] {
        let mut rig = Rig::with(|config| config.encoding = encoding);
        let child = Command::new(&python)
            .arg(&reader)
            .args([rig.endpoint.as_str(), DAMPER, "3"])
            .stdout(Stdio::piped())
            .spawn()
            .expect("ZENOH_PYTHON names a Python");
        wait_until("Python connects", || rig.mirror.stats().connected == 1);
        rig.feeder.run(4000, 1000.0, |k| {
            let nanos = i64::from(k) * 1_000_000;
            vec![displacement(nanos), estimate(nanos, f64::from(k)), residual(nanos, 1.0)]
        });
        let output = child.wait_with_output().expect("Python was started");
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{encoding:?}: {text}");
        println!("{encoding:?}: {text}");
        let summary: serde_json::Value = serde_json::from_str(&text).expect("the summary is JSON");
        let estimates = &summary["routes"]["state/force_estimate"];
        assert_eq!(estimates["encodings"], serde_json::json!([encoding.media_type()]));
        assert_eq!(
            summary["routes"]["web/force_estimate"]["encodings"],
            serde_json::json!(["application/json"])
        );
        assert_eq!(summary["missing"], 0, "{summary}");
        assert!(estimates["count"].as_u64().is_some_and(|count| count > 1000), "{summary}");
        assert_eq!(summary["liveliness"], serde_json::json!(["PUT"]));
        assert_eq!(summary["answers"]["history"]["force_estimate"], 5);
    }
}
