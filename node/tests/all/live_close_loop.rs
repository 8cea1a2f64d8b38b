//! The action `close_loop` on the real service, over real DDS, called by a test client and by `mr-damper close --live`. It names
//! the effect that the running model lacks, can be cancelled, and loads the new model only if that is allowed.

use crate::domain::Domain;
use crate::live_support::lagging::{LAG_S, base, run, write};
use crate::live_support::within;
use crate::turn::turn;
use crate::wait::{PATIENCE, until, wait_until};
use futures::StreamExt;
use mr_damper_model::model::Model;
use mr_damper_model::sample::Run;
use mr_damper_msgs::action::{CloseLoop, CloseLoopGoal};
use mr_damper_node::estimation::models;
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::participant::{ActionClientOf, Ros, RosMessage};
use mr_damper_node::settings::config::{Config, RosArgs};
use ros2_client::NodeOptions;
use ros2_client::action::{GoalId, GoalStatusEnum};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Longer than the stored history, so that all of it is used.
const ALL_S: f64 = 120.0;

/// The service with one minute of history of a damper with coil lag, and a client of its action.
struct Setup {
    service: DamperNode,
    peer: Ros,
    client: ActionClientOf<CloseLoop>,
}

impl Setup {
    fn set(domain_id: i64, dir: &Path, auto_load: bool) -> Self {
        Self::within("/", domain_id, dir, auto_load)
    }

    /// Like [`Self::set`], in a namespace.
    fn within(namespace: &str, domain_id: i64, dir: &Path, auto_load: bool) -> Self {
        Self::with_history(&run(60.0, LAG_S, 2), namespace, domain_id, dir, auto_load)
    }

    /// The service with `recorded` as its history.
    fn with_history(recorded: &Run, namespace: &str, domain_id: i64, dir: &Path, auto_load: bool) -> Self {
        let path = dir.join("base.toml");
        write(&path, base());
        let config = Config {
            model: path.display().to_string(),
            domain_id,
            close_loop_out: dir.display().to_string(),
            close_loop_auto_load: auto_load,
            ..Config::default()
        };
        let args = RosArgs::in_namespace(namespace);
        let (service, _) = DamperNode::start(&config, &args, false).expect("the service starts");
        let history = service.history();
        for sample in recorded.samples() {
            history.lock().expect("no panic").push(&sample);
        }
        let mut peer = Ros::start(&config, &args, NodeOptions::new(), "peer").expect("a peer starts");
        let client = peer.action_client::<CloseLoop>(&args.topic("close_loop")).expect("a client");
        wait_until("the action", || peer.reaches(&client));
        Self { service, peer, client }
    }

    /// Sends a goal; `None` if it is rejected.
    fn send(&self, history: f64) -> Option<GoalId> {
        let goal = RosMessage(CloseLoopGoal { history });
        let (id, answer) =
            within(Duration::from_secs(20), self.client.async_send_goal(goal)).expect("an answer");
        answer.accepted.then_some(id)
    }

    fn result(&self, id: GoalId) -> (GoalStatusEnum, bool, Value) {
        let (status, RosMessage(result)) =
            within(Duration::from_secs(60), self.client.async_request_result(id))
                .expect("a result that can be read");
        let report = serde_json::from_str(&result.report).expect("the report is JSON");
        (status, result.success, report)
    }

    /// Waits until the node works on `id`: then its feedback names a stage.
    fn wait_for_work(&self, id: GoalId) {
        let first = self.client.feedback_stream(id).take(1).collect::<Vec<_>>();
        assert!(within(PATIENCE, first).iter().all(Result::is_ok), "feedback is readable");
    }

    /// Loads a model by its path, as `load_model` does.
    fn load(&self, path: &Path) {
        self.service.control().load_model(&path.display().to_string()).expect("a model that fits");
    }

    /// The loaded model.
    fn model(&self) -> String {
        self.service.control().config().model
    }

    /// Asks to cancel `id`, and returns the number of goals that are being cancelled.
    fn cancel(&self, id: GoalId) -> usize {
        let zero = ros2_client::builtin_interfaces::Time::ZERO;
        let answer =
            within(Duration::from_secs(10), self.client.async_cancel_goal(id, zero)).expect("an answer");
        answer.goals_canceling.len()
    }

    fn end(self) {
        let Self { service, peer, client } = self;
        drop(client);
        peer.stop();
        service.stop().expect("no thread panicked");
    }
}

#[test]
fn close_loop_names_the_lag_and_loads_nothing_by_default() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = tempfile::tempdir().expect("a directory");
    let setup = Setup::set(domain.id(), dir.path(), false);
    let before = setup.model();
    let started = Instant::now();
    let id = setup.send(ALL_S).expect("a good goal is accepted");
    assert_eq!(setup.send(ALL_S), None, "one goal at a time");
    let (status, success, report) = setup.result(id);
    println!("{:.1?}", started.elapsed());
    assert_eq!((status, success), (GoalStatusEnum::Succeeded, true), "{report}");

    assert_eq!(report["schema"], "mr-damper/close/1");
    assert_eq!(report["effects"][0]["id"], "coil_lag", "{report}");
    let tau_s = report["effects"][0]["parameters"]["tau_s"].as_f64().expect("a number");
    assert!((tau_s / LAG_S - 1.0).abs() < 0.1, "{tau_s} s");
    assert!(report["test"]["ratio"].as_f64().expect("a number") < 0.25, "{report}");
    assert!(report["note"].as_str().expect("a text").contains("one recording"));
    assert!(report["text"].as_str().expect("a text").contains("\nNamed\n"), "{report}");
    let roles: Vec<_> = report["runs"].as_array().expect("runs").iter().map(|r| &r["role"]).collect();
    assert_eq!(roles, ["estimate", "confirm", "test"]);

    let stages: Vec<_> =
        within(Duration::from_secs(5), setup.client.feedback_stream(id).take(3).collect::<Vec<_>>());
    let stages: Vec<_> = stages.into_iter().map(|f| f.expect("readable").0).collect();
    assert!(stages.iter().all(|f| !f.stage.is_empty() && (0.0..=1.0).contains(&f.progress)), "{stages:?}");
    assert!(stages.is_sorted_by(|a, b| a.progress <= b.progress), "{stages:?}");

    let path = report["model_file"].as_str().expect("a path");
    assert_eq!(models::load(path).expect("a model file").effects.as_slice().len(), 1);
    assert_eq!(report["loaded"], false, "{report}");
    assert_eq!(setup.model(), before);
    setup.end();
}

#[test]
fn auto_load_loads_the_model_unless_another_one_was_loaded_meanwhile() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = tempfile::tempdir().expect("a directory");
    let setup = Setup::set(domain.id(), dir.path(), true);
    let (base, other) = (dir.path().join("base.toml"), dir.path().join("other.toml"));
    let model = models::load(&base.display().to_string()).expect("written above");
    let force = model.force.with_force_offset_n(1.0);
    write(&other, Model { force, ..model });

    let id = setup.send(ALL_S).expect("a good goal is accepted");
    setup.load(&other);
    let (status, _, report) = setup.result(id);
    assert_eq!(status, GoalStatusEnum::Succeeded, "{report}");
    assert_eq!(report["loaded"], false, "{report}");
    assert!(report["load_error"].as_str().expect("a text").contains("another model was loaded"), "{report}");
    assert_eq!(setup.model(), other.display().to_string());
    let first = report["model_file"].clone();

    setup.load(&base);
    let id = setup.send(ALL_S).expect("a good goal is accepted");
    let (_, _, report) = setup.result(id);
    assert_eq!((&report["loaded"], &report["load_error"]), (&true.into(), &Value::Null), "{report}");
    assert_eq!(report["model_file"], setup.model().as_str());
    assert_ne!(report["model_file"], first, "no file is overwritten");
    setup.end();
}

#[test]
fn a_model_with_a_drift_of_the_load_cell_is_not_loaded_by_itself() {
    const DRIFT_N_S: f64 = 0.25;
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = tempfile::tempdir().expect("a directory");
    let mut recorded = run(60.0, 0.0, 2);
    let force = recorded.force_n.as_mut().expect("a force");
    let first = force.stamps[0];
    for (stamp, force_n) in force.stamps.iter().zip(&mut force.values) {
        *force_n += DRIFT_N_S * stamp.since(first).get();
    }
    let setup = Setup::with_history(&recorded, "/", domain.id(), dir.path(), true);
    let before = setup.model();
    let id = setup.send(ALL_S).expect("a good goal is accepted");
    let (status, _, report) = setup.result(id);
    assert_eq!(status, GoalStatusEnum::Succeeded, "{report}");
    let found = report["effects"].as_array().expect("a list");
    assert!(found.iter().any(|effect| effect["id"] == "load_cell_drift"), "{report}");
    assert_eq!((&report["loaded"], setup.model()), (&false.into(), before), "{report}");
    let path = report["model_file"].as_str().expect("a path");
    let why = report["load_error"].as_str().expect("a text");
    assert!(why.contains("includes load_cell_drift") && why.contains(path), "{why}");
    setup.end();
}

#[test]
fn a_goal_can_be_cancelled_and_a_failed_goal_says_why() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = tempfile::tempdir().expect("a directory");
    let setup = Setup::set(domain.id(), dir.path(), true);
    let before = setup.service.control().models();
    for history in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(setup.send(history), None, "{history} s of history must be rejected");
    }

    let id = setup.send(ALL_S).expect("a good goal is accepted");
    setup.wait_for_work(id);
    assert_eq!(setup.cancel(GoalId::new_random()), 0, "an unknown goal cancels nothing");
    let started = Instant::now();
    assert_eq!(setup.cancel(id), 1);
    let (status, success, report) = setup.result(id);
    assert_eq!((status, success), (GoalStatusEnum::Canceled, false), "{report}");
    assert!(started.elapsed() < Duration::from_secs(5), "{:?}", started.elapsed());
    assert_eq!(report["error"], "interrupted");
    assert_eq!(setup.cancel(id), 0, "the goal has ended");

    // The node works on the next goals whether or not a client asks for their results. Three seconds of history are too few.
    let unasked = setup.send(3.0).expect("a good goal is accepted");
    let failed = |history: f64| {
        let id = until("the end of the previous goal", || setup.send(history));
        let (status, success, report) = setup.result(id);
        assert_eq!((status, success), (GoalStatusEnum::Aborted, false), "{report}");
        let code = report["reason"]["code"].as_str().expect("a code").to_owned();
        (report["error"].as_str().expect("a text").to_owned(), code)
    };
    let (error, code) = failed(3.0);
    assert_eq!(code, "too_short", "{error}");
    assert!(error.contains("on 3.0 s of history") && error.contains("18 s of motion"), "{error}");
    assert_eq!(setup.cancel(unasked), 0, "the goal whose result nobody asked for has ended");
    assert_eq!(setup.service.control().models(), before, "no model was loaded");

    // An ARX model cannot be the base.
    setup.load(Path::new(mr_damper_model::preset::BEST_ARX));
    let (error, code) = failed(ALL_S);
    assert_eq!(code, "base_not_physical", "{error}");
    assert!(error.contains("cannot start from the arx model") && error.contains("load_model"), "{error}");
    assert_eq!(std::fs::read_dir(dir.path()).expect("readable").count(), 1, "only the base file exists");
    setup.load(&dir.path().join("base.toml"));

    // A client that waits for a result while the node stops gets an answer.
    let id = setup.send(ALL_S).expect("a good goal is accepted");
    let request = setup.client.request_result(id).expect("sent");
    setup.wait_for_work(id);
    // Once the node has answered a later request, it has the request for the result as well.
    assert_eq!(setup.cancel(GoalId::new_random()), 0, "an unknown goal cancels nothing");
    let Setup { service, peer, client } = setup;
    std::thread::scope(|scope| {
        let waiting =
            scope.spawn(|| until("the result", || client.receive_result(request).expect("readable")));
        let started = Instant::now();
        service.stop().expect("no thread panicked");
        println!("stopped in the middle of a diagnosis after {:.2?}", started.elapsed());
        assert!(started.elapsed() < Duration::from_secs(5), "{:?}", started.elapsed());
        let (status, RosMessage(result)) = waiting.join().expect("a result");
        assert_eq!((status, result.success), (GoalStatusEnum::Aborted, false));
        assert!(result.report.contains("the node was stopped"), "{}", result.report);
    });
    drop(client);
    peer.stop();
}

/// `mr-damper close --live` in a domain, with further arguments.
fn close_live(domain_id: i64, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.args(["close", "--live", "--domain-id", &domain_id.to_string()]).args(arguments);
    command.env_remove("RUST_LOG").env_remove("ROS_AUTOMATIC_DISCOVERY_RANGE").stdin(Stdio::null());
    command
}

const FRONT_LEFT: [&str; 3] = ["--ros-args", "-r", "__ns:=/front_left"];

#[test]
fn close_live_diagnoses_on_the_node_and_prints_the_load_command() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = tempfile::tempdir().expect("a directory");
    let setup = Setup::within("/front_left", domain.id(), dir.path(), false);
    let started = Instant::now();
    let output = close_live(domain.id(), &FRONT_LEFT).output().expect("it runs");
    println!("{:.1?}", started.elapsed());
    let [out, log] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).expect("UTF-8"));
    assert!(output.status.success(), "{log}");
    assert!(log.contains("effect 1: scores of the library"), "stages on stderr: {log}");
    assert!(out.contains("\nNamed\n") && out.contains("parts of one recording"), "{out}");
    // The printed command names the written model file, and `load_model` accepts that file.
    let line = out.lines().find(|line| line.contains("ros2 service call")).expect("a line to paste");
    let (before, path) = line.split_once(" mr_damper_msgs/srv/LoadModel ").expect("the type");
    assert_eq!(
        before.trim(),
        format!("ROS_DOMAIN_ID={} ros2 service call /front_left/load_model", domain.id())
    );
    let path = path.trim_start_matches("\"{model: '").trim_end_matches("'}\"");
    assert!(path.contains("mr-damper-close-front_left-"), "{path}");
    setup.load(Path::new(path));

    // The loaded model now has the missing effect. Its small misfit stays above the noise floor, which is a lower bound.
    let arguments = [&["--json", "-", "-q", "--history", "1000"], &FRONT_LEFT[..]].concat();
    let output = close_live(domain.id(), &arguments).output().expect("it runs");
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !log.contains("scores"), "{log}");
    let report: Value = serde_json::from_slice(&output.stdout).expect("JSON alone on stdout");
    assert_eq!(
        (&report["effects"], &report["model_file"]),
        (&Value::Array(Vec::new()), &Value::Null),
        "{report:#}"
    );
    assert_eq!(report["before"], report["after"], "nothing was added: {report:#}");

    // Only one goal runs at a time, and a failed goal says why. The base lacks the lag, so the first goal runs for long enough.
    setup.load(&dir.path().join("base.toml"));
    let id = setup.send(ALL_S).expect("a good goal is accepted");
    let output = close_live(domain.id(), &FRONT_LEFT).output().expect("it runs");
    let log = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{log}");
    assert!(log.contains("/front_left/close_loop rejects the goal"), "{log}");
    assert_eq!(setup.cancel(id), 1, "the first goal was still running");
    let _ = setup.result(id);
    let arguments = [&["--history", "3"], &FRONT_LEFT[..]].concat();
    let output = close_live(domain.id(), &arguments).output().expect("it runs");
    let log = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{log}");
    assert!(log.contains("18 s of motion"), "{log}");
    setup.end();
}

#[test]
fn without_a_node_the_command_says_where_it_looked() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let started = Instant::now();
    let output = close_live(domain.id(), &FRONT_LEFT).output().expect("it runs");
    assert!(started.elapsed() < Duration::from_secs(15), "{:?}", started.elapsed());
    let log = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{log}");
    let domain = format!("domain {}", domain.id());
    for word in ["/front_left/close_loop", &domain, "now /front_left", "mr-damper node", "--domain-id"] {
        assert!(log.contains(word), "\"{word}\" is missing in: {log}");
    }
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_the_command_and_cancels_its_goal() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = tempfile::tempdir().expect("a directory");
    let setup = Setup::set(domain.id(), dir.path(), false);
    let mut child = close_live(domain.id(), &["--json", "-"])
        .stderr(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("it runs");
    let mut log = BufReader::new(child.stderr.take().expect("a pipe"));
    let mut said = String::new();
    while !said.contains("refitting the base") {
        assert!(log.read_line(&mut said).expect("a pipe") > 0, "{said}");
    }
    let killed = Instant::now();
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().expect("kill").success());
    while log.read_line(&mut said).expect("a pipe") > 0 {}
    let output = child.wait_with_output().expect("it ends");
    println!("ended {:.2?} after Ctrl-C", killed.elapsed());
    // Takes a second on an idle machine; the limit allows for a busy one.
    assert!(killed.elapsed() < Duration::from_secs(5), "{:?}", killed.elapsed());
    assert_eq!(output.status.code(), Some(1));
    assert!(output.stdout.is_empty() && said.contains("the goal is cancelled"), "{said}");
    // The node accepts the next goal long before the cancelled one would have finished.
    let deadline = Instant::now() + Duration::from_secs(2);
    while setup.send(3.0).is_none() {
        assert!(Instant::now() < deadline, "the cancelled goal ends within 2 s");
        std::thread::sleep(Duration::from_millis(50));
    }
    assert_eq!(std::fs::read_dir(dir.path()).expect("readable").count(), 1, "only the base file exists");
    setup.end();
}
