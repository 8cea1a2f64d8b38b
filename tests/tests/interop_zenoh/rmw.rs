//! The node on rmw_zenoh, with the ready configuration `rmw.toml`: the peer is pyzeros, an independent implementation, behind a
//! router.

use crate::PEER;
use crate::interop_support::gate::{Outcome, interop};
use crate::interop_support::json::{count, found, number, text, texts, truth};
use crate::interop_support::process::script;
use crate::interop_support::{PRESET, ZENOH_ENDPOINT};
use mr_damper_model::pipeline::{Estimate, Event, Pipeline};
use mr_damper_model::sample::{Drive, DriveKind, Reading, Sample, Stamp};
use mr_damper_model::units::{Metre, Newton};
use mr_damper_node::estimation::models;
use mr_damper_node::settings::config::Config;
use serde_json::Value;

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn pyzeros_sees_the_node_feeds_it_and_gets_bit_identical_estimates() {
    interop("rmw_zenoh with pyzeros", |lab| {
        let config = script("../../launch-configs/zenoh/rmw.toml");
        let config = config.to_str().expect("UTF-8");
        // A busy machine may stop a thread for longer than the default wait, and one sample out of order changes the result.
        let _node = lab.mr_damper(&["node", "--config", config, "--ros-args", "-p", "align_wait_s:=0.5"]);
        let saw = lab.peer("rmw_peer.py", &[ZENOH_ENDPOINT, "4"]).json(PEER);

        let (seen, expected) = (texts(&saw, "/tokens/seen"), texts(&saw, "/tokens/expected"));
        assert_eq!(seen, expected, "tokens equal the tokens that pyzeros would declare");
        for (kind, tokens) in [("/NN/", 1), ("/MP/", 4), ("/MS/", 8)] {
            assert_eq!(seen.iter().filter(|token| token.contains(kind)).count(), tokens, "{kind}: {seen:#?}");
        }
        for topic in ["force_estimate", "force_residual", "mode", "current_command"] {
            let told = found(&saw, &format!("/outputs/{topic}"));
            assert!(count(told, "/count") > 0 && texts(told, "/errors").is_empty(), "{topic}: {told:#}");
            assert!(truth(told, "/numbers_from_1_without_gap"), "{topic}: {told:#}");
            assert!(truth(told, "/gid_of_the_token"), "{topic}: {told:#}");
        }

        let samples = samples(found(&saw, "/sent"));
        let expected = estimates(&samples);
        let got = found(&saw, "/estimates").as_array().expect("a list");
        assert!(expected.len() > 2000, "{} estimates", expected.len());
        assert_eq!(got.len(), expected.len(), "one for each displacement");
        for (index, (got, expected)) in got.iter().zip(&expected).enumerate() {
            let got: Vec<_> = got.as_array().expect("a list").iter().filter_map(Value::as_u64).collect();
            assert_eq!(got, figures(expected), "estimate {index} must be bit-identical");
        }
        assert!(texts(&saw, "/models").contains(&PRESET), "{:#}", found(&saw, "/models"));

        let status = found(&saw, "/status");
        assert_eq!(count(status, "/taken"), samples.len() as u64 + 1, "and one force_request: {status:#}");
        for what in ["/lost", "/refused", "/dropped"] {
            assert_eq!(count(status, what), 0, "{status:#}");
        }
        assert_eq!(count(status, "/mismatched"), 1, "one type with another hash: {status:#}");
        let logs = lab.logs();
        assert_eq!(logs.matches("and is ignored").count(), 1, "the mismatch is logged once: {logs}");
        let age_ms = |share: &str| 1e3 * number(&saw, &format!("/outputs/force_estimate/age_s/{share}"));
        Outcome::Passed(format!(
            "{} tokens as pyzeros writes them, {} of {} estimates bit-identical, median age {:.2} ms, 99th percentile {:.2} ms; ignored: {}",
            seen.len(),
            got.len(),
            expected.len(),
            age_ms("median"),
            age_ms("p99"),
            text(&saw, "/other_hash"),
        ))
    });
}

/// The samples that the peer sent (stamp and the bits of displacement, current and force), in the order of a replay.
fn samples(sent: &Value) -> Vec<Sample> {
    let mut samples = Vec::new();
    for row in sent.as_array().expect("a list") {
        let row: Vec<_> = row.as_array().expect("a list").iter().filter_map(Value::as_u64).collect();
        let [stamp_ns, x, i, f] = row[..] else { panic!("a stamp and three numbers: {row:?}") };
        let stamp = Stamp::from_nanos(stamp_ns.try_into().expect("a time of this century"));
        for reading in [
            Reading::Drive(Drive::new(DriveKind::CoilCurrent, f64::from_bits(i))),
            Reading::Force(Newton(f64::from_bits(f))),
            Reading::Displacement(Metre(f64::from_bits(x))),
        ] {
            samples.push(Sample { stamp, received: stamp, reading });
        }
    }
    samples
}

/// The estimates of a replay.
fn estimates(samples: &[Sample]) -> Vec<Estimate> {
    let config = Config { model: PRESET.to_owned(), ..Config::default() };
    let (models, _) = models::from_config(&config).expect("it loads");
    let settings = config.pipeline_settings(models.free.conditioning.cutoff_hz);
    let mut pipeline = Pipeline::new(models, settings).expect("it runs");
    let mut estimates = Vec::new();
    for sample in samples {
        pipeline.step(sample, &mut |event| {
            if let Event::Estimate(estimate) = event {
                estimates.push(estimate);
            }
        });
    }
    estimates
}

/// The values that the peer reports of an estimate.
fn figures(of: &Estimate) -> Vec<u64> {
    let stamp = u64::try_from(of.stamp.nanos()).expect("a time of this century");
    let [low, high] = of.band;
    let bits = [of.force, of.std_dev, low, high].map(|force| force.get().to_bits());
    let rest = [of.mode as u64, of.validity as u64, u64::from(of.reasons.0)];
    [stamp].into_iter().chain(bits).chain(rest).collect()
}
