//! The action `close_loop` on the real service, over real DDS: it names what the running model lacks, can be cancelled, and
//! swaps nothing in unasked.

use futures::StreamExt;
use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::identify::{ModelSpec, Options, Watch, identify};
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::Run;
use mr_damper_msgs::action::{CloseLoop, CloseLoopGoal};
use mr_damper_node::config::{Config, RosArgs};
use mr_damper_node::models;
use mr_damper_node::ros::{ActionClientOf, Part, Ros};
use mr_damper_node::service::Service;
use ros2_client::NodeOptions;
use ros2_client::action::GoalStatusEnum;
use serde_json::Value;
use std::path::Path;
use std::time::{Duration, Instant};

const DOMAIN: i64 = 87;
const LAG_S: f64 = 0.012;

fn run(seconds: f64, lag_s: f64, seed: u64) -> Run {
    let experiment = Experiment::thesis("RP-APRBS").expect("a thesis experiment").with_duration_s(seconds);
    let channels = Channels { displacement_noise_m: 3e-7, displacement_step_m: 1e-7, ..Channels::default() };
    record(&experiment, &Plant::quasi_static().with_coil_lag_s(lag_s), &channels, seed)
}

/// A model of the damper without the lag, as a file.
fn write_base(path: &Path) {
    let options = Options {
        conditioning: Conditioning { velocity: VelocitySource::ThreePoint, ..Conditioning::default() },
        choose_velocity: false,
        restarts: 3,
        ..Options::default()
    };
    let model = identify(ModelSpec::FUZZY_TANH, &[run(20.0, 0.0, 1)], &options, &Watch::none())
        .expect("the rig's damper can be identified")
        .model;
    let file = ModelFile { model, provenance: Provenance::default() };
    std::fs::write(path, file.to_toml().expect("writable")).expect("written");
}

/// The service with `seconds` of the lagging damper behind it, and a client of its action.
struct Stage {
    service: Service,
    peer: Ros,
    client: ActionClientOf<CloseLoop>,
}

impl Stage {
    fn set(domain_id: i64, dir: &Path, auto_load: bool, seconds: f64) -> Self {
        let base = dir.join("base.toml");
        write_base(&base);
        let config = Config {
            model: base.display().to_string(),
            domain_id,
            close_loop_out: dir.display().to_string(),
            close_loop_auto_load: auto_load,
            ..Config::default()
        };
        let args = RosArgs::default();
        let (service, _) = Service::start(&config, &args, false).expect("the service starts");
        let history = service.history();
        for sample in run(seconds, LAG_S, 2).samples() {
            history.lock().expect("no panic").push(&sample);
        }
        let mut peer = Ros::start(&config, &args, NodeOptions::new(), "peer").expect("a peer starts");
        let client = peer.action_client::<CloseLoop>("/close_loop").expect("a client");
        within(20, async {
            client.goal_client().wait_for_service(peer.node()).await;
            client.result_client().wait_for_service(peer.node()).await;
            client.cancel_client().wait_for_service(peer.node()).await;
        });
        Self { service, peer, client }
    }

    /// Sends a goal; `None` when it is rejected.
    fn send(&self, history: f64) -> Option<ros2_client::action::GoalId> {
        let goal = Part(CloseLoopGoal { history });
        let (id, answer) = within(20, self.client.async_send_goal(goal)).expect("an answer");
        answer.accepted.then_some(id)
    }

    fn result(&self, id: ros2_client::action::GoalId) -> (GoalStatusEnum, bool, Value) {
        let (status, Part(result)) =
            within(60, self.client.async_request_result(id)).expect("a result that can be read");
        let report = serde_json::from_str(&result.report).expect("the report is JSON");
        (status, result.success, report)
    }

    fn end(self) {
        let Self { service, peer, client } = self;
        drop(client);
        peer.stop();
        service.stop().expect("no thread panicked");
    }
}

/// What `task` comes to, which it must within so many seconds.
fn within<T>(seconds: u64, task: impl Future<Output = T>) -> T {
    futures::executor::block_on(async {
        let (sender, late) = futures::channel::oneshot::channel::<()>();
        std::thread::spawn(move || {
            std::thread::sleep(Duration::from_secs(seconds));
            // Nobody waits any more when it came in time.
            let _ = sender.send(());
        });
        match futures::future::select(std::pin::pin!(task), late).await {
            futures::future::Either::Left((done, _)) => done,
            futures::future::Either::Right(_) => panic!("not done within {seconds} s"),
        }
    })
}

#[test]
fn it_names_the_lag_and_swaps_the_model_in_only_when_it_may() {
    let dir = tempfile::tempdir().expect("a directory");
    for auto_load in [false, true] {
        let stage = Stage::set(DOMAIN + i64::from(auto_load), dir.path(), auto_load, 60.0);
        let before = stage.service.control().config().model;
        let started = Instant::now();
        let id = stage.send(120.0).expect("a good goal is accepted");
        assert_eq!(stage.send(120.0), None, "one goal at a time");
        let (status, success, report) = stage.result(id);
        println!("{:.1?}: {report}", started.elapsed());
        assert_eq!((status, success), (GoalStatusEnum::Succeeded, true), "{report}");

        assert_eq!(report["schema"], "mr-damper/close/1");
        assert_eq!(report["effects"][0]["id"], "coil_lag", "{report}");
        let tau_s = report["effects"][0]["parameters"]["tau_s"].as_f64().expect("a number");
        assert!((tau_s / LAG_S - 1.0).abs() < 0.1, "{tau_s} s");
        assert!(report["test"]["ratio"].as_f64().expect("a number") < 0.25, "{report}");
        assert!(report["note"].as_str().expect("a text").contains("one recording"));
        let roles: Vec<_> = report["runs"].as_array().expect("runs").iter().map(|r| &r["role"]).collect();
        assert_eq!(roles, ["estimate", "confirm", "test"]);

        let stages: Vec<_> = within(5, stage.client.feedback_stream(id).take(3).collect::<Vec<_>>());
        let stages: Vec<_> = stages.into_iter().map(|f| f.expect("readable").0).collect();
        assert!(
            stages.iter().all(|f| !f.stage.is_empty() && (0.0..=1.0).contains(&f.progress)),
            "{stages:?}"
        );
        assert!(stages.is_sorted_by(|a, b| a.progress <= b.progress), "{stages:?}");

        let path = report["model_file"].as_str().expect("a path").to_owned();
        assert_eq!(models::load(&path).expect("a model file").effects.as_slice().len(), 1);
        assert_eq!(report["loaded"], auto_load, "{report}");
        let now = stage.service.control().config().model;
        assert_eq!(now, if auto_load { path } else { before });
        stage.end();
    }
}

#[test]
fn it_can_be_cancelled_and_says_what_it_lacks() {
    let dir = tempfile::tempdir().expect("a directory");
    let stage = Stage::set(DOMAIN + 2, dir.path(), true, 60.0);
    let before = stage.service.control().models();
    for history in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(stage.send(history), None, "{history} s of history is nothing to work on");
    }

    let id = stage.send(120.0).expect("a good goal is accepted");
    std::thread::sleep(Duration::from_millis(300));
    let started = Instant::now();
    let zero = ros2_client::builtin_interfaces::Time::ZERO;
    let answer = within(10, stage.client.async_cancel_goal(id, zero)).expect("an answer");
    assert_eq!(answer.goals_canceling.len(), 1, "{answer:?}");
    let (status, success, report) = stage.result(id);
    assert_eq!((status, success), (GoalStatusEnum::Canceled, false), "{report}");
    assert!(started.elapsed() < Duration::from_secs(5), "{:?}", started.elapsed());
    assert_eq!(report["error"], "interrupted");

    // The next goal is worked on, but three seconds are too few for anything.
    let id = stage.send(3.0).expect("a good goal is accepted");
    let (status, success, report) = stage.result(id);
    println!("{report}");
    assert_eq!((status, success), (GoalStatusEnum::Aborted, false), "{report}");
    assert!(report["error"].as_str().expect("a text").len() > 20, "{report}");
    assert_eq!(stage.service.control().models(), before, "nothing is swapped in");
    assert_eq!(std::fs::read_dir(dir.path()).expect("readable").count(), 1, "the base alone");
    stage.end();
}
