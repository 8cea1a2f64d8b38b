//! Tests of the service with independent programs: rclpy of two ROS 2 distributions, CycloneDDS, Zenoh.
//!
//! Each test creates a network namespace with only loopback, starts the release build of `mr-damper` in it, and
//! checks what a peer of `tests/interop/` saw. Tests that measure short delays or load the machine run alone
//! (`interop_alone`), the others at the same time. All are ignored by default:
//!
//! ```text
//! tests/interop/setup.sh
//! cargo build --release --workspace --bins
//! cargo test --workspace --test interop -- --ignored
//! ```
//!
//! With `MR_DAMPER_LONG=1` the round trip is a benchmark: it takes a minute and must meet its limit, which needs an
//! idle machine. Measured runs are read from `MR_DAMPER_DATA`.

mod interop_deploy;
mod interop_faults;
mod interop_files;
mod interop_page;
mod interop_ros;
mod interop_support;
mod interop_zenoh;

use interop_files::{identify, utf8};
use interop_support::gate::{Outcome, interop, interop_alone, long, say};
use interop_support::json::{count, found, number, text, texts, truth};
use interop_support::{Distro, Lab, NODE, PRESET, ZENOH_ENDPOINT};
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_runs::{SaveOptions, save};
use serde_json::Value;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Longest time for a peer that sends for some seconds: imports, discovery, slow first calls, a loaded machine.
const PEER: Duration = Duration::from_secs(90);
/// Longest time from a signal until the node is gone from a peer's graph, and until the process ends.
const SHUTDOWN: Duration = Duration::from_secs(1);
/// Largest ratio of the median round trip to the bare echo's median.
const ROUND_TRIP_RATIO: f64 = 1.3;

const INPUTS: [(&str, &str); 5] = [
    ("/displacement", "mr_damper_msgs/msg/Displacement"),
    ("/coil_current", "mr_damper_msgs/msg/CoilCurrent"),
    ("/measured_force", "mr_damper_msgs/msg/Force"),
    ("/force_request", "mr_damper_msgs/msg/Force"),
    ("/body_velocity", "mr_damper_msgs/msg/Velocity"),
];
const OUTPUTS: [(&str, &str); 4] = [
    ("/force_estimate", "mr_damper_msgs/msg/ForceEstimate"),
    ("/force_residual", "mr_damper_msgs/msg/ForceResidual"),
    ("/mode", "mr_damper_msgs/msg/ModeChange"),
    ("/current_command", "mr_damper_msgs/msg/CurrentCommand"),
];

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn rclpy_jazzy_sends_receives_and_sets_parameters() {
    interop("rclpy jazzy", |lab| rclpy(lab, Distro::Jazzy));
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn rclpy_kilted_sends_receives_and_sets_parameters() {
    interop("rclpy kilted", |lab| rclpy(lab, Distro::Kilted));
}

fn rclpy(lab: &Lab, distro: Distro) -> Outcome {
    let _node = lab.node(PRESET, &[]);
    let saw = lab.ros(distro, "ros_peer.py", &["--node", NODE, "--force-seconds", "3"]).json(PEER);
    assert_eq!(text(&saw, "/distro"), distro.name());
    estimates_arrived(&saw);
    residuals_arrived(&saw);

    for (topic, kind) in OUTPUTS {
        assert_eq!(names_of(&saw, "published", topic), [kind], "type of {topic} in the graph");
    }
    for (topic, kind) in INPUTS {
        assert_eq!(names_of(&saw, "subscribed", topic), [kind], "type of {topic} in the graph");
    }
    assert!(texts(&saw, "/graph/nodes").contains(&NODE), "{NODE} in {:#}", found(&saw, "/graph/nodes"));

    for name in ["model", "coast_s", "force_timeout_s", "displacement.sign"] {
        assert!(texts(&saw, "/parameters/listed").contains(&name), "{name} is listed");
    }
    assert_eq!(count(&saw, "/parameters/described/coast_s"), 3, "coast_s is described as a double");
    assert_eq!(count(&saw, "/parameters/described/model"), 4, "model is described as a string");
    assert!(truth(&saw, "/parameters/set/successful"), "{:#}", found(&saw, "/parameters/set"));
    assert_eq!(number(&saw, "/parameters/after_set"), 0.75);
    for (what, names) in
        [("refused_range", "coast_s"), ("refused_type", "coast_s"), ("refused_name", "coats_s")]
    {
        let refusal = found(&saw, &format!("/parameters/{what}"));
        assert!(!truth(refusal, "/successful"), "{what} was accepted: {refusal:#}");
        assert!(text(refusal, "/reason").contains(names), "the reason names {names}: {refusal:#}");
    }
    assert_eq!(number(&saw, "/parameters/after_refusals"), 0.75, "a refused value changes nothing");
    models_were_loaded(&saw);
    diagnostics_arrived(&saw);
    Outcome::Passed(format!(
        "{} estimates, {} residuals, modes {}; refused coast_s = -1: {}",
        count(&saw, "/force_estimate/count"),
        count(&saw, "/force_residual/count"),
        found(&saw, "/force_estimate/modes"),
        text(&saw, "/parameters/refused_range/reason"),
    ))
}

/// `load_model` loads a valid model and explains why it refuses an invalid one; the parameter names the running
/// model.
fn models_were_loaded(saw: &Value) {
    let models = found(saw, "/models");
    assert!(truth(models, "/loaded/success"), "{models:#}");
    assert!(!truth(models, "/refused/success"), "{models:#}");
    assert!(text(models, "/refused/message").contains("/no/such/model.toml"), "{models:#}");
    assert_eq!(
        text(models, "/parameter"),
        "thesis/fuzzy-tanh/rp1-cs",
        "the parameter names the running model"
    );
}

/// Once per second there is a status of the node and one of the residual, with values once there are some.
fn diagnostics_arrived(saw: &Value) {
    let diagnostics = found(saw, "/diagnostics").as_array().expect("a list of statuses");
    assert!(diagnostics.len() >= 3, "{diagnostics:#?}");
    for (name, figure) in
        [("/mr_damper: residual", "windowed_rsse_n"), ("/mr_damper: node", "latency_p99_ms")]
    {
        let of_name = diagnostics.iter().filter(|status| text(status, "/name") == name);
        let with_figures = of_name.filter(|status| texts(status, "/keys").contains(&figure));
        assert!(with_figures.count() >= 1, "{name}: {diagnostics:#?}");
    }
}

fn names_of<'a>(saw: &'a Value, direction: &str, topic: &str) -> Vec<&'a str> {
    texts(saw, &format!("/graph/{direction}/{}", topic.replace('/', "~1")))
}

/// Every displacement sent has one estimate with its stamp, in order, with a force.
fn estimates_arrived(saw: &Value) {
    let sent = count(saw, "/sent/displacement");
    assert!(sent >= 1000, "the peer sent its samples: {saw:#}");
    let estimates = found(saw, "/force_estimate");
    assert_eq!(count(estimates, "/lost"), 0, "displacements without an estimate: {estimates:#}");
    assert_eq!(count(estimates, "/count"), sent, "one estimate per displacement: {estimates:#}");
    assert_eq!(
        count(estimates, "/unknown_stamps"),
        0,
        "every stamp is a displacement's stamp: {estimates:#}"
    );
    assert!(truth(estimates, "/in_order"), "estimates come in order: {estimates:#}");
    assert_eq!(count(estimates, "/finite"), sent, "every estimate has a force: {estimates:#}");
    let largest = number(estimates, "/largest_force");
    assert!(
        (10.0..20_000.0).contains(&largest),
        "the force is plausible for a damper, in newtons: {largest}"
    );
    assert!(texts(estimates, "/models").iter().all(|name| !name.is_empty()), "estimates name their model");
}

/// Every measured force sent has a residual, and residuals are measured minus predicted.
fn residuals_arrived(saw: &Value) {
    let residuals = found(saw, "/force_residual");
    assert!(count(residuals, "/count") > 0, "residuals arrive: {residuals:#}");
    assert_eq!(count(residuals, "/lost"), 0, "measured forces without a residual: {residuals:#}");
    assert!(truth(residuals, "/consistent"), "residual is measured minus predicted: {residuals:#}");
    let changes = found(saw, "/mode").as_array().expect("a list of mode changes");
    assert!(!changes.is_empty(), "measured force arrived, so the mode changed, and the change was published");
    assert!(
        changes.iter().all(|change| !text(change, "/reason").is_empty()),
        "each has a reason: {changes:#?}"
    );
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn rclpy_jazzy_requests_forces() {
    interop("supervisor with rclpy jazzy", |lab| supervisor(lab, Distro::Jazzy));
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn rclpy_kilted_requests_forces() {
    interop("supervisor with rclpy kilted", |lab| supervisor(lab, Distro::Kilted));
}

/// An rclpy supervisor requests valid and invalid forces and then stops sending; Zenoh mirrors the same commands.
fn supervisor(lab: &Lab, distro: Distro) -> Outcome {
    let listen = format!("zenoh.listen:=['{ZENOH_ENDPOINT}']");
    let limits =
        ["-p", "current.max_a:=2.0", "-p", "current.safe_a:=0.25", "-p", "current.safe_after_s:=0.3"];
    let _node = lab.node(PRESET, &[["-p", &listen].as_slice(), &limits].concat());
    let peer = lab.ros(distro, "supervisor_peer.py", &["--node", NODE]);
    let heard = lab.peer("zenoh_reader.py", &[ZENOH_ENDPOINT, NODE.trim_start_matches('/'), "8"]).json(PEER);
    let saw = peer.json(PEER);
    assert_eq!(text(&saw, "/distro"), distro.name());
    assert_eq!(count(&saw, "/before_anything_was_asked"), 0, "nothing is commanded without a request");

    let limited = |phase: &str, by: &str| {
        found(&saw, &format!("/{phase}/limited_by")).get(by).and_then(Value::as_u64).unwrap_or(0)
    };
    for phase in ["follow", "not_a_number", "too_large", "bad_load_cell", "unasked", "silence"] {
        let told = found(&saw, &format!("/{phase}"));
        assert!(count(told, "/commands") > 10, "{phase}: {told:#}");
        assert!(
            number(told, "/current/least") >= 0.0 && number(told, "/current/most") <= 2.0,
            "{phase}: {told:#}"
        );
        assert!(truth(told, "/interval_holds"), "{phase}: {told:#}");
    }
    let follow = found(&saw, "/follow");
    assert!(
        limited("follow", "NONE") * 3 > count(follow, "/commands"),
        "achievable requests are met: {follow:#}"
    );
    assert!(count(follow, "/with_interval") > 100, "the achievable interval arrives: {follow:#}");
    assert!(limited("too_large", "CURRENT_MAX") > 0 && limited("too_large", "PASSIVITY") > 0, "{saw:#}");
    assert_eq!(limited("too_large", "NONE"), 0, "{saw:#}");
    for phase in ["not_a_number", "unasked", "silence"] {
        let told = found(&saw, &format!("/{phase}"));
        assert_eq!(limited(phase, "SAFE"), count(told, "/commands"), "{phase}: {told:#}");
        assert_eq!(number(told, "/current/last"), 0.25, "{phase} ends in the safe current: {told:#}");
    }
    for phase in ["follow", "bad_load_cell"] {
        let told = found(&saw, &format!("/{phase}"));
        assert!(count(told, "/banded") * 10 > count(told, "/estimates") * 9, "bands arrive: {told:#}");
        assert!(truth(told, "/band_holds_force"), "{told:#}");
    }
    let flags = |phase: &str, reason: &str| {
        found(&saw, &format!("/{phase}/reasons")).get(reason).and_then(Value::as_u64).unwrap_or(0)
    };
    assert_eq!(flags("follow", "INPUT_RANGE"), 0, "{saw:#}");
    assert!(flags("bad_load_cell", "INPUT_RANGE") > 5, "flags arrive: {saw:#}");

    let command = found(&heard, "/routes/state~1current_command");
    assert!(count(command, "/count") > 200, "commands on Zenoh: {command:#}");
    assert!((0.0..=2.0).contains(&number(command, "/last/current_a")), "{command:#}");
    assert!(!text(command, "/last/limited_by").is_empty(), "{command:#}");
    let estimate = found(&heard, "/routes/state~1force_estimate/last");
    assert!(number(estimate, "/band_low_n") < number(estimate, "/band_high_n"), "{estimate:#}");
    let _ = found(estimate, "/reasons");
    assert!(count(&heard, "/routes/state~1force_request/count") > 200, "requests are mirrored: {heard:#}");
    Outcome::Passed(format!(
        "{} commands for a demanded force, {} of them met; Zenoh received {}",
        count(follow, "/commands"),
        limited("follow", "NONE"),
        count(command, "/count")
    ))
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn rclpy_jazzy_runs_a_diagnosis() {
    interop("close_loop with rclpy jazzy", |lab| close_loop(lab, Distro::Jazzy));
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn rclpy_kilted_runs_a_diagnosis() {
    interop("close_loop with rclpy kilted", |lab| close_loop(lab, Distro::Kilted));
}

/// A damper whose coil lags although its model has no lag: rclpy lets the node name the lag, and loads the new model.
fn close_loop(lab: &Lab, distro: Distro) -> Outcome {
    const HISTORY_S: &str = "60";
    const LAG_S: f64 = 0.012;
    let recorded = |name: &str, seconds: f64, lag_s: f64, seed: u64| {
        let experiment =
            Experiment::thesis("RP-APRBS").expect("a thesis experiment").with_duration_s(seconds);
        let channels = Channels::default().with_fine_displacement();
        let run = record(&experiment, &Plant::quasi_static().with_coil_lag_s(lag_s), &channels, seed);
        let path = lab.folder().join(name);
        save(&run, &path, &SaveOptions::default()).expect("room in the temporary directory");
        path
    };
    let (healthy, run) = (recorded("healthy.csv", 20.0, 0.0, 1), recorded("lag.csv", 60.0, LAG_S, 2));
    let more = ["--restarts", "3", "--velocity", "three-point"];
    let base = identify(lab, "fuzzy-tanh", std::slice::from_ref(&healthy), &more);
    let out = format!("close_loop.out:={}", utf8(lab.folder()));
    let _node = lab.node(&base, &["-r", "__ns:=/front_left", "-p", &out]);
    let replay = ["--quiet", "replay", utf8(&run), "--rate", "6", "--duration", HISTORY_S, "--wait", "20"];
    lab.mr_damper(&[&replay[..], &["--ros-args", "-r", "__ns:=/front_left"]].concat()).output(PEER);
    let saw =
        lab.ros(distro, "close_peer.py", &["--namespace", "/front_left", "--history", HISTORY_S]).json(PEER);

    assert!(!truth(&saw, "/refused"), "a negative history was accepted: {saw:#}");
    assert!(!truth(&saw, "/second"), "two goals were accepted at once: {saw:#}");
    let closed = found(&saw, "/closed");
    assert!(text(closed, "/status") == "succeeded" && truth(closed, "/success"), "{closed:#}");
    let effects = found(closed, "/report/effects").as_array().expect("a list of effects");
    let lag = effects.iter().find(|effect| text(effect, "/id") == "coil_lag");
    let lag = lag.unwrap_or_else(|| panic!("the coil has a lag: {closed:#}"));
    let tau_s = number(lag, "/parameters/tau_s");
    assert!((tau_s / LAG_S - 1.0).abs() < 0.1, "{tau_s} s");
    assert!(!truth(closed, "/report/loaded"), "the new model is not loaded by default: {closed:#}");
    let stages = found(&saw, "/feedback").as_array().expect("a list of stages");
    assert!(stages.len() >= 3 && stages.iter().all(|stage| !text(stage, "/0").is_empty()), "{stages:#?}");

    assert_eq!(count(&saw, "/cancelling"), 1, "{saw:#}");
    assert_eq!(text(&saw, "/cancelled/status"), "canceled");
    assert!(!truth(&saw, "/cancelled/success"), "{saw:#}");
    assert!(truth(&saw, "/loaded/success"), "{:#}", found(&saw, "/loaded"));
    assert!(text(&saw, "/loaded/message").contains("mr-damper-close-front_left"), "{saw:#}");
    Outcome::Passed(format!(
        "a lag of {:.1} ms named in {:.1} s, {} stages received, one goal cancelled, the model loaded",
        1e3 * tau_s,
        number(closed, "/report/seconds"),
        stages.len()
    ))
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn cyclonedds_sends_and_receives() {
    interop("cyclonedds", |lab| {
        let _node = lab.node(PRESET, &[]);
        let saw = lab.peer("cyclone_peer.py", &[]).json(PEER);
        estimates_arrived(&saw);
        residuals_arrived(&saw);
        for (topic, kind) in INPUTS.into_iter().chain(OUTPUTS) {
            let announced = text(&saw, &format!("/announced/{}", topic.replace('/', "~1")));
            let name = kind.rsplit('/').next().expect("a name");
            assert_eq!(announced, format!("mr_damper_msgs::msg::dds_::{name}_"), "DDS type of {topic}");
        }
        Outcome::Passed(format!(
            "{} estimates, {} residuals",
            count(&saw, "/force_estimate/count"),
            count(&saw, "/force_residual/count")
        ))
    });
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn zenoh_reads_the_mirror() {
    interop("zenoh mirror", |lab| {
        let listen = format!("zenoh.listen:=['{ZENOH_ENDPOINT}']");
        let _node = lab.node(PRESET, &["-p", &listen]);
        let sender = lab.ros(Distro::Jazzy, "ros_peer.py", &["--node", NODE, "--seconds", "12"]);
        let damper = NODE.trim_start_matches('/');
        let saw = lab.peer("zenoh_reader.py", &[ZENOH_ENDPOINT, damper, "10"]).json(PEER);
        estimates_arrived(&sender.json(PEER));

        let state = found(&saw, "/routes/state~1force_estimate");
        assert!(count(state, "/count") >= 500, "estimates at full rate: {state:#}");
        assert_eq!(count(&saw, "/missing"), 0, "sequence numbers without a gap: {saw:#}");
        assert_eq!(texts(state, "/encodings"), ["application/cbor"]);
        let web = found(&saw, "/routes/web~1force_estimate");
        assert_eq!(texts(web, "/encodings"), ["application/json"]);
        assert!(count(web, "/count") < count(state, "/count"), "web/ is thinned: {web:#}");
        for field in ["seq", "stamp_ns", "validity"] {
            let _ = found(state, &format!("/last/{field}"));
            let _ = found(web, &format!("/last/{field}"));
        }
        assert!(texts(&saw, "/liveliness").contains(&"PUT"), "the liveliness token exists: {saw:#}");
        assert!(!found(&saw, "/answers/meta").is_null(), "meta answers: {saw:#}");
        Outcome::Passed(format!(
            "{} state, {} web, none missing",
            count(state, "/count"),
            count(web, "/count")
        ))
    });
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn nothing_is_lost_at_1_khz_and_the_round_trip_is_close_to_the_bare_echo() {
    interop_alone("round trip at 1000 Hz", |lab| {
        // In turns, so that a machine that becomes busier affects both; the median of the turns counts.
        let turns: &[u64] = if long() { &[60, 20, 20] } else { &[10] };
        say("round trip rclpy jazzy at 1000 Hz, us:      p50      p90      p99      max   sent  lost");
        let (mut echoes, mut nodes) = (vec![echo_round_trip(lab, turns[0].min(20))], Vec::new());
        for seconds in turns {
            let node = {
                let _node = lab.node(PRESET, &[]);
                round_trip("node", lab, *seconds)
            };
            assert_eq!(count(&node, "/sent"), seconds * 1000);
            assert_eq!(count(&node, "/lost"), 0, "displacements without an estimate: {node:#}");
            assert_eq!(count(&node, "/repeated"), 0, "estimates sent twice: {node:#}");
            nodes.push(node);
            echoes.push(echo_round_trip(lab, (*seconds).min(20)));
        }
        let ratio = middle_p50_us(&nodes) / middle_p50_us(&echoes);
        // Speed is a verdict only in the long form, on an idle machine. Losses always are.
        assert!(
            !long() || ratio <= ROUND_TRIP_RATIO,
            "the median round trip is {ratio:.2} times the bare echo's; at most {ROUND_TRIP_RATIO} is allowed"
        );
        Outcome::Passed(format!("the median is {ratio:.2} times the bare echo's, nothing lost"))
    });
}

/// The median of the turns' medians, us.
fn middle_p50_us(trips: &[Value]) -> f64 {
    let mut medians: Vec<f64> = trips.iter().map(|trip| number(trip, "/p50_us")).collect();
    medians.sort_by(f64::total_cmp);
    f64::midpoint(medians[(medians.len() - 1) / 2], medians[medians.len() / 2])
}

fn echo_round_trip(lab: &Lab, seconds: u64) -> Value {
    let _echo = lab.echo();
    round_trip("bare echo", lab, seconds)
}

fn round_trip(name: &str, lab: &Lab, seconds: u64) -> Value {
    let trip = lab
        .ros(Distro::Jazzy, "roundtrip.py", &["--rate", "1000", "--seconds", &seconds.to_string()])
        .json(PEER + Duration::from_secs(seconds));
    let us = |path| number(&trip, path);
    say(&format!(
        "  {name:<38} {:8.0} {:8.0} {:8.0} {:8.0} {:6} {:5}",
        us("/p50_us"),
        us("/p90_us"),
        us("/p99_us"),
        us("/max_us"),
        count(&trip, "/sent"),
        count(&trip, "/lost"),
    ));
    trip
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn sigint_and_sigterm_end_the_node_and_peers_see_it_leave() {
    interop_alone("shutdown", |lab| {
        let mut figures = Vec::new();
        for (signal, distro) in [("INT", Distro::Jazzy), ("TERM", Distro::Kilted)] {
            let mut node = lab.node(PRESET, &[]);
            let mut watcher = lab.ros(distro, "graph_peer.py", &["--node", NODE]);
            assert_eq!(text(&watcher.json_line(PEER), "/event"), "ready");
            // The peer also discovers all topics of the node, which its graph of nodes does not show.
            std::thread::sleep(Duration::from_millis(500));
            let sent = SystemTime::now();
            node.signal(signal);
            let status = node.wait(SHUTDOWN);
            let ended = sent.elapsed().unwrap_or_default();
            assert_eq!(status.code(), Some(0), "exit code on SIG{signal}");
            let gone = watcher.json_line(PEER);
            assert_eq!(text(&gone, "/event"), "gone");
            let gone = Duration::from_nanos(count(&gone, "/unix_ns"))
                .saturating_sub(sent.duration_since(UNIX_EPOCH).expect("after 1970"));
            assert!(gone < SHUTDOWN, "after SIG{signal} the graph listed the node for {gone:?}");
            figures.push(format!(
                "SIG{signal}: process ended after {} ms, gone from the graph after {} ms",
                ended.as_millis(),
                gone.as_millis()
            ));
        }
        Outcome::Passed(figures.join("; "))
    });
}
