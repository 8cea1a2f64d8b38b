//! The Zenoh mirror as a consumer sees it: keys, encodings, sequence numbers, rates, liveliness,
//! queries.

use crate::turn::turn;
use crate::wait::{PATIENCE, wait_until};
use crate::zenoh_support::*;
use mr_damper_msgs::{ForceEstimate, cdr};
use mr_damper_node::streams::sink::zenoh::{Encoding, Topic};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use zenoh::Wait;
use zenoh::sample::SampleKind;

#[test]
fn every_topic_is_published_as_cbor_and_for_the_web_as_json() {
    let _turn = turn(module_path!());
    let mut rig = Rig::start();
    let session = session(&rig.endpoint, &[]);
    let inbox = subscribe(&session, "mr_damper/**");
    one_of_each().into_iter().for_each(|event| rig.feeder.push(event));
    wait_until("each topic in both trees", || inbox.len() == 2 * Topic::ALL.len());
    for topic in Topic::ALL {
        let name = topic.name();
        let state = inbox.of(&format!("state/{name}"));
        let web = inbox.of(&format!("web/{name}"));
        assert_eq!((state.len(), web.len()), (1, 1), "{name}");
        assert_eq!(state[0].key_expr().as_str(), format!("mr_damper/front_left/state/{name}"));
        assert_eq!(state[0].encoding().to_string(), "application/cbor");
        assert_eq!(web[0].encoding().to_string(), "application/json");
        // Content and sequence number are equal, because each sample is the first of its key.
        assert_eq!(cbor(&state[0]), json(&web[0]), "{name}");
        assert_eq!(json(&web[0])["seq"], 1);
        assert!(json(&web[0])["stamp_ns"].is_i64() && json(&web[0])["validity"].is_string(), "{name}");
    }
    let estimate = json(&inbox.of("web/force_estimate")[0]);
    let expected = serde_json::json!({
        "seq": 1, "stamp_ns": 7, "validity": "EXTRAPOLATING", "force_n": 119.0, "std_dev_n": null,
        "model": "thesis/fuzzy-tanh/rp3-cs", "mode": "model", "reasons": ["OUTSIDE_ENVELOPE"],
        "input_age_s": 0.002, "band_low_n": null, "band_high_n": null, "band_calibrated": false,
    });
    assert_eq!(estimate, expected);
    assert_eq!(json(&inbox.of("web/force_residual")[0])["validity"], "EXTRAPOLATING");
    assert!(json(&inbox.of("web/refused")[0])["value"].is_null());
    let alarm = serde_json::json!({
        "seq": 1, "stamp_ns": 11, "validity": "DEGRADED", "raised": true, "ratio": 1.75,
    });
    assert_eq!(json(&inbox.of("web/alarm")[0]), alarm);
    let command = serde_json::json!({
        "seq": 1, "stamp_ns": 14, "validity": "DEGRADED", "current_a": 2.5, "force_requested_n": 900.0,
        "force_expected_n": 700.0, "achievable": false, "dissipative": true, "limited_by": "CURRENT_MAX",
        "achievable_min_n": 80.0, "achievable_max_n": 700.0,
    });
    assert_eq!(json(&inbox.of("web/current_command")[0]), command);
}

#[test]
fn no_sample_is_missing_at_1000_hz_and_the_web_gets_its_rate() {
    let _turn = turn(module_path!());
    let mut rig = Rig::with(|config| config.web_rate_hz = 25.0);
    let session = session(&rig.endpoint, &[]);
    let inbox = subscribe(&session, "mr_damper/front_left/*/*");
    let feeding = std::time::Instant::now();
    rig.feeder.run(2000, 1000.0, |k| {
        let nanos = i64::from(k) * 1_000_000;
        vec![displacement(nanos), estimate(nanos, f64::from(k)), residual(nanos, 1.0)]
    });
    let fed_s = feeding.elapsed().as_secs_f64();
    // The last sample always reaches the web, at most one period late.
    let last = |inbox: &Inbox| inbox.of("web/force_estimate").last().map(|s| json(s)["force_n"].clone());
    wait_until("all samples", || {
        inbox.of("state/force_residual").len() >= 2000 && last(&inbox) == Some(1999.0.into())
    });
    for topic in ["displacement", "force_estimate", "force_residual"] {
        let seqs: Vec<u64> = inbox
            .of(&format!("state/{topic}"))
            .iter()
            .map(|sample| cbor(sample)["seq"].as_u64().expect("seq is a number"))
            .collect();
        assert_eq!(seqs, (1..=2000).collect::<Vec<u64>>(), "{topic}");
        let web: Vec<u64> = inbox
            .of(&format!("web/{topic}"))
            .iter()
            .map(|sample| json(sample)["seq"].as_u64().expect("seq is a number"))
            .collect();
        assert_eq!(web, (1..=web.len() as u64).collect::<Vec<u64>>(), "{topic}");
        let most = (25.0 * fed_s) as usize + 3;
        assert!(web.len() <= most, "{topic}: {} on the web in {fed_s} s, {most} at most", web.len());
        // A loaded machine delivers fewer samples, but always some.
        assert!(web.len() >= 20, "{topic}: {} on the web", web.len());
    }
    let stats = rig.mirror.stats();
    assert_eq!((stats.events, stats.ring_dropped), (6000, 0));
}

#[test]
fn cdr_is_the_ros_message_with_an_attachment() {
    let _turn = turn(module_path!());
    let mut rig = Rig::with(|config| config.encoding = Encoding::Cdr);
    let session = session(&rig.endpoint, &[]);
    let inbox = subscribe(&session, "mr_damper/front_left/state/*");
    one_of_each().into_iter().for_each(|event| rig.feeder.push(event));
    wait_until("all topics", || inbox.len() == Topic::ALL.len());
    let sample = &inbox.of("state/force_estimate")[0];
    assert_eq!(sample.encoding().to_string(), "application/cdr");
    let message: ForceEstimate = cdr::from_slice(&sample.payload().to_bytes()).expect("this is CDR");
    assert_eq!(message.force, 119.0);
    assert!(message.std_dev.is_nan());
    assert_eq!((message.header.frame_id.as_str(), message.header.stamp.as_nanos()), (DAMPER, 7));
    let attachment = sample.attachment().expect("CDR has one").to_bytes().into_owned();
    assert_eq!(attachment, [1, 0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0, 2]);
    // Refusals have no ROS message.
    assert_eq!(inbox.of("state/refused")[0].encoding().to_string(), "application/cbor");
}

#[test]
fn json_is_available_at_full_rate() {
    let _turn = turn(module_path!());
    let mut rig = Rig::with(|config| config.encoding = Encoding::Json);
    let session = session(&rig.endpoint, &[]);
    let inbox = subscribe(&session, "mr_damper/front_left/state/*");
    rig.feeder.push(estimate(1, f64::NAN));
    wait_until("the estimate", || inbox.len() == 1);
    assert_eq!(inbox.samples()[0].encoding().to_string(), "application/json");
    assert!(json(&inbox.samples()[0])["force_n"].is_null());
    assert_eq!(json(&inbox.samples()[0])["validity"], "INVALID");
}

#[test]
fn the_token_appears_and_disappears_with_the_mirror() {
    let _turn = turn(module_path!());
    let rig = Rig::start();
    let session = session(&rig.endpoint, &[]);
    let inbox = Inbox::default();
    let to = inbox.clone();
    session
        .liveliness()
        .declare_subscriber("mr_damper/*/alive")
        .history(true)
        .callback(move |sample| to.push(sample))
        .background()
        .wait()
        .expect("the key is valid");
    wait_until("the token", || inbox.len() == 1);
    assert_eq!(inbox.samples()[0].kind(), SampleKind::Put);
    assert_eq!(inbox.samples()[0].key_expr().as_str(), "mr_damper/front_left/alive");
    rig.mirror.stop();
    wait_until("the end of the token", || inbox.len() == 2);
    assert_eq!(inbox.samples()[1].kind(), SampleKind::Delete);
}

#[test]
fn dampers_share_a_session_but_not_their_keys() {
    let _turn = turn(module_path!());
    let mut rig = Rig::start();
    let (other, mut other_feeder) = mirror(&rig.link, "/axle/rear");
    let session = session(&rig.endpoint, &[]);
    let inbox = subscribe(&session, "mr_damper/**/state/*");
    wait_until("the other damper", || other.is_alive() && other.stats().connected == 1);
    rig.feeder.push(estimate(1, 1.0));
    wait_until("the first damper's sample", || inbox.len() == 1);
    other_feeder.push(estimate(1, 2.0));
    wait_until("both dampers' samples", || inbox.len() == 2);
    let keys: Vec<String> = inbox.samples().iter().map(|sample| sample.key_expr().to_string()).collect();
    assert_eq!(
        keys,
        ["mr_damper/front_left/state/force_estimate", "mr_damper/axle/rear/state/force_estimate"]
    );
    rig.mirror.stop();
    other_feeder.push(estimate(2, 2.0));
    wait_until("a sample of the other damper", || inbox.len() == 3);
}

#[test]
fn meta_describes_each_topic() {
    let _turn = turn(module_path!());
    let rig = Rig::start();
    let session = session(&rig.endpoint, &[]);
    let meta = ask(&session, "meta");
    assert_eq!(meta["schema"], "mr-damper/zenoh-meta/1");
    assert_eq!(meta["models"]["free"], "thesis/fuzzy-tanh/rp3-cs");
    assert_eq!(meta["models"]["hash"], "0123abcd");
    assert_eq!(meta["topics"]["force_estimate"]["fields"][3]["name"], "force_n");
    assert_eq!(meta["topics"]["force_estimate"]["fields"][3]["unit"], "N");
    assert_eq!(meta["topics"]["displacement"]["key"], "mr_damper/front_left/state/displacement");
    assert_eq!(meta["topics"]["displacement"]["direction"], "in");
    assert!(meta["sign_convention"].as_str().is_some_and(|text| text.contains("tension")));
    assert!(meta["not_finite"].as_str().is_some_and(|text| text.contains("null")));
    rig.mirror
        .renamer()
        .rename(mr_damper_node::streams::sink::zenoh::ModelNames { free: "mine.toml".into(), ..names() });
    assert_eq!(ask(&session, "meta")["models"]["free"], "mine.toml");
}

#[test]
fn history_answers_ranges_and_explains_wrong_ones() {
    let _turn = turn(module_path!());
    let mut rig = Rig::start();
    let session = session(&rig.endpoint, &[]);
    for k in 0..50 {
        rig.feeder.push(estimate(k, k as f64));
        rig.feeder.push(residual(k, 0.5));
    }
    wait_until("the mirror takes all events", || rig.mirror.stats().events == 100);
    let list = |question: &str, topic: &str| {
        ask(&session, question)[topic]
            .as_array()
            .expect("a list")
            .iter()
            .map(|e| e["seq"].clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(list("history?_time=[now(-10s)..]", "force_estimate").len(), 50);
    assert_eq!(list("history", "force_residual").len(), 50);
    assert_eq!(list("history?_time=[now(-10s)..];max=2", "force_estimate"), [49, 50]);
    // From here on, all estimates are older than the 20 ms of the next two questions.
    thread::sleep(Duration::from_millis(60));
    assert!(list("history?_time=[now(-20ms)..]", "force_estimate").is_empty());
    assert_eq!(list("history?_time=[..now(-20ms)]", "force_estimate").len(), 50);
    let answer = ask_raw(&session, "history?format=cbor").expect("CBOR is known");
    assert_eq!(answer.encoding().to_string(), "application/cbor");
    assert_eq!(cbor(&answer)["force_estimate"][49]["force_n"], 49.0);
    for (question, word) in [
        ("history?_time=yesterday", "brackets"),
        ("history?since=3", "since"),
        ("history?max=many", "max"),
        ("meta?format=xml", "xml"),
    ] {
        let error = ask_raw(&session, question).expect_err("the question is wrong");
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn status_counts_sent_and_lost_samples() {
    let _turn = turn(module_path!());
    let mut rig = Rig::start();
    let session = session(&rig.endpoint, &[]);
    one_of_each().into_iter().for_each(|event| rig.feeder.push(event));
    rig.feeder.dropped.fetch_add(3, std::sync::atomic::Ordering::Relaxed);
    wait_until("the mirror takes all events", || rig.mirror.stats().events == Topic::ALL.len() as u64);
    wait_until("the consumer is counted", || rig.mirror.stats().connected == 1);
    let status = ask(&session, "status");
    assert_eq!(status["schema"], "mr-damper/zenoh-status/1");
    assert_eq!((&status["ring_dropped"], &status["events"]), (&3.into(), &Topic::ALL.len().into()));
    let residual = serde_json::json!({
        "stamp_ns": 7, "windowed_rsse_n": 8.0, "windowed_esr": 0.001, "expected_rsse_n": null, "ratio": null,
        "alarm": false, "alarm_since_ns": 11,
    });
    assert_eq!(status["residual"], residual);
    assert_eq!((&status["state"], &status["mode"]), (&"running".into(), &"model".into()));
    assert_eq!(status["routes"].as_array().map(Vec::len), Some(2 * Topic::ALL.len()));
    let key = "mr_damper/front_left/state/force_estimate";
    let routes = status["routes"].as_array().expect("a list");
    let route = routes.iter().find(|route| route["key"] == key).expect("a route");
    assert_eq!((&route["sent"], &route["dropped"]), (&1.into(), &0.into()));
    assert!(route["age_s"].as_f64().is_some_and(|age_s| (0.0..20.0).contains(&age_s)), "{route}");
}

#[test]
fn the_rust_example_prints_what_it_receives() {
    let _turn = turn(module_path!());
    let mut rig = Rig::start();
    let tests = std::env::current_exe().expect("it runs");
    let example = tests.ancestors().nth(2).expect("target/PROFILE").join("examples/zenoh_estimates");
    let mut heard =
        Command::new(example).args([rig.endpoint.as_str(), "3"]).stdout(Stdio::piped()).spawn().expect(
            "cargo test builds the examples; with --test alone, cargo build --workspace --examples does",
        );
    let patience = Instant::now() + PATIENCE;
    let mut k = 0;
    while heard.try_wait().expect("it is ours").is_none() {
        assert!(Instant::now() < patience, "the example received nothing");
        k += 1;
        rig.feeder.push(estimate(k, 119.5));
        thread::sleep(Duration::from_millis(20));
    }
    let output = heard.wait_with_output().expect("it is ours");
    let text = String::from_utf8(output.stdout).expect("it prints text");
    assert!(output.status.success(), "{text}");
    let line = "mr_damper/front_left/web/force_estimate 119.5 N \"EXTRAPOLATING\"";
    assert_eq!(text.lines().collect::<Vec<_>>(), [line; 3]);
}
