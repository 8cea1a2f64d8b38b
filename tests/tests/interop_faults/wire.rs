//! A wire with loss, delay, reordering, duplication and cuts between the node and its peer (`bad_wire.py`).

use super::NO_ARX;
use super::peer_records::{FaultPeer, PeerRecords, done};
use crate::interop_support::gate::{Outcome, interop, long};
use crate::interop_support::process::Program;
use crate::interop_support::{Lab, PRESET};
use mr_damper_model::pipeline::{Estimate, Event, Pipeline};
use mr_damper_model::sample::{Drive, DriveKind, Reading, Sample, Stamp};
use mr_damper_model::units::{Metre, Newton};
use mr_damper_node::estimation::models;
use mr_damper_node::settings::config::{Config, Value as Setting};

/// Longest time from the end of a fault to the first VALID estimate, s.
const BACK_S: f64 = 1.0;

/// The node on one host, and a peer on the other.
fn wired(lab: &Lab, seed: u64) -> Result<(Lab, Program, Program), String> {
    let (far, wire) = lab.behind_a_bad_wire(seed)?;
    // The wait for a busy machine, as in node/tests/all/live.rs.
    let node =
        lab.node(PRESET, &[NO_ARX, &["-p", "discovery_range:=subnet", "-p", "align_wait_s:=0.3"]].concat());
    Ok((far, wire, node))
}

/// The estimates of the samples that were sent, computed offline.
fn offline(records: &PeerRecords) -> Vec<Estimate> {
    let mut config = Config::default();
    for (name, value) in [("model", PRESET), ("arx_model", "none")] {
        config.set(name, &Setting::Text(value.to_owned())).expect("a text");
    }
    let (models, _) = models::from_config(&config).expect("a preset");
    let settings = config.pipeline_settings(models.free.conditioning.cutoff_hz);
    let mut pipeline = Pipeline::new(models, settings).expect("it runs");
    let mut estimates = Vec::new();
    for sent in &records.sent {
        let stamp = Stamp::from_nanos(sent.stamp_ns);
        let [displacement, current, force] = sent.values;
        for reading in [
            Reading::Drive(Drive::new(DriveKind::CoilCurrent, current)),
            Reading::Force(Newton(force)),
            Reading::Displacement(Metre(displacement)),
        ] {
            pipeline.step(&Sample { stamp, received: stamp, reading }, &mut |event| {
                estimates.extend(if let Event::Estimate(estimate) = event { Some(estimate) } else { None });
            });
        }
    }
    estimates
}

#[test]
#[ignore = "needs root: network namespaces that are connected"]
fn delays_duplicates_and_reordering_between_topics_give_bit_identical_estimates() {
    interop("wire: delay, jitter, duplicates", |lab| {
        let (far, mut wire, _node) = match wired(lab, 11) {
            Ok(all) => all,
            Err(why) => return Outcome::Missing(why),
        };
        let mut peer = FaultPeer::start(&far, "fault_peer", &["--rate", "20"]);
        // Each topic keeps its order while topics overtake each other.
        wire.command(
            r#"{"name": "crooked", "delay_ms": 20, "jitter_ms": 8, "duplicate": 0.2, "keep_writers_in_order": true}"#,
        );
        peer.command("phase crooked");
        peer.command("send");
        std::thread::sleep(std::time::Duration::from_secs(if long() { 60 } else { 5 }));
        let records = peer.finish();
        let wire = wire.close();
        records.is_sound();
        assert_eq!(records.status("refused"), 0, "{:?}", records.diagnostics.last());
        assert_eq!(records.status("received"), 3 * records.sent.len() as u64, "each message once");
        let expected = offline(&records);
        let live: Vec<_> = records.estimates.iter().filter(|estimate| estimate.is_live()).collect();
        assert_eq!(live.len(), records.sent.len(), "one estimate per displacement: {}", records.summary());
        for (estimate, expected) in live.iter().zip(&expected) {
            assert_eq!(estimate.stamp_ns, expected.stamp.nanos());
            assert_eq!(
                estimate.force_n.to_bits(),
                expected.force.get().to_bits(),
                "{estimate:?} {expected:?}"
            );
            assert_eq!((estimate.mode, estimate.validity), (expected.mode as u8, expected.validity as u8));
        }
        let [lost, repeated, overtaken] = done(&wire, "crooked");
        assert!(lost == 0 && repeated > 50 && overtaken > 50, "{wire:#}");
        Outcome::Passed(format!(
            "{} bit-identical estimates, with {repeated} frames repeated and {overtaken} overtaken",
            live.len()
        ))
    });
}

#[test]
#[ignore = "needs root: network namespaces that are connected"]
fn loss_bursts_disorder_and_a_cut_are_flagged_and_estimates_recover() {
    interop("wire: loss, bursts, disorder, cut", |lab| {
        let (far, mut wire, node) = match wired(lab, 12) {
            Ok(all) => all,
            Err(why) => return Outcome::Missing(why),
        };
        let mut peer = FaultPeer::start(&far, "fault_peer", &[]);
        let seconds = if long() { 30.0 } else { 2.5 };
        peer.command("phase whole");
        peer.command("send");
        std::thread::sleep(std::time::Duration::from_secs(1));
        for (name, fault) in [
            ("loss", r#""loss": 0.2"#),
            ("bursts", r#""burst_every_s": 0.5, "burst_ms": 200"#),
            ("disorder", r#""jitter_ms": 60, "duplicate": 0.2"#),
            ("cut", r#""cut": true"#),
        ] {
            wire.command(&format!(r#"{{"name": "{name}", {fault}}}"#));
            peer.phase(name, seconds);
            wire.command(r#"{"name": "clean"}"#);
            peer.phase(&format!("after_{name}"), 1.5);
        }
        let records = peer.finish();
        let wire = wire.close();
        drop(node);
        records.is_sound();
        let mut figures = Vec::new();
        for (name, least) in [("loss", 0.7), ("bursts", 0.5), ("disorder", 0.1), ("cut", 0.0)] {
            let back_s = records.valid_after_s(&format!("after_{name}"));
            assert!(back_s < BACK_S, "VALID again {back_s:.2} s after {name}; {}", records.summary());
            let answered = records.answered(name);
            assert!(answered >= least, "{answered:.2} answered under {name}; {}", records.summary());
            figures.push(format!(
                "{name} {:.0} % answered, VALID again after {:.0} ms",
                1e2 * answered,
                1e3 * back_s
            ));
        }
        assert!(records.answered("after_cut") > 0.9, "{}", records.summary());
        let [lost, ..] = done(&wire, "loss");
        assert!(lost > 30 && done(&wire, "bursts")[0] > 20 && done(&wire, "cut")[0] > 100, "{wire:#}");
        assert!(done(&wire, "disorder")[2] > 100, "{wire:#}");
        // The longest silence ends in FAULT, and the first estimates after it are not VALID at once.
        assert!(
            records.estimates.iter().any(|estimate| !estimate.is_live()),
            "the cut was noticed: {}",
            records.summary()
        );
        Outcome::Passed(figures.join("; "))
    });
}
