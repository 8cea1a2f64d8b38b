//! `load_model` on the real service, over real DDS: the model is replaced between two samples and no sample is lost.

use crate::domain::Domain;
use crate::live_support::{Ended, answer};
use crate::turn::turn;
use crate::wait::{until, wait_until};
use mr_damper_model::model::Model;
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::pipeline::{AlarmChange, Estimate, Event, Residual};
use mr_damper_model::preset;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::Run;
use mr_damper_msgs::ForceResidual;
use mr_damper_msgs::srv::{LoadModel, LoadModelRequest, LoadModelResponse};
use mr_damper_msgs::standard::{DiagnosticArray, DiagnosticStatus};
use mr_damper_node::estimation::estimator::EventReceiver;
use mr_damper_node::estimation::models;
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::participant::{ClientOf, Ros};
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use mr_damper_node::settings::interrupt::Interrupt;
use mr_damper_node::streams::player::{PlaybackOptions, Played, Player};
use ros2_client::{NodeOptions, Subscription};
use std::io::Write;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const BEFORE: &str = "thesis/fuzzy-tanh/rp3-cs";
const AFTER: &str = "thesis/fuzzy-tanh/rp1-cs";

fn run(seconds: f64) -> Run {
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(seconds);
    record(&experiment, &Plant::default(), &Channels::default(), 7)
}

fn config(domain: &Domain) -> Config {
    let mut config = Config { domain_id: domain.id(), align_wait_s: 0.5, ..Config::default() };
    config.set("model", &Value::Text(BEFORE.to_owned())).expect("a text");
    config
}

/// Another node on the domain, which requests models and receives diagnostics.
struct Peer {
    ros: Ros,
    client: ClientOf<LoadModel>,
    diagnostics: Subscription<DiagnosticArray>,
}

impl Peer {
    fn new(config: &Config) -> Self {
        let mut ros =
            Ros::start(config, &RosArgs::default(), NodeOptions::new(), "peer").expect("a peer starts");
        let client = ros.client::<LoadModel>("/load_model").expect("a client");
        let diagnostics = ros.subscribe("/diagnostics").expect("a topic");
        Self { ros, client, diagnostics }
    }

    fn wait_for_service(&self) {
        wait_until("the service", || self.ros.reaches(&self.client));
    }

    /// The answer to a request for `model`. A first call may take three seconds.
    fn load(&self, model: &str) -> LoadModelResponse {
        let request = LoadModelRequest { model: model.to_owned() };
        answer::<LoadModel>(&self.client, request)
    }

    /// The residual's status in the next diagnostics message.
    fn next_status(&self) -> DiagnosticStatus {
        while self.diagnostics.take().expect("readable").is_some() {}
        let (array, _) = until("diagnostics", || self.diagnostics.take().expect("readable"));
        let mut status = array.status;
        assert_eq!(status.len(), 2, "one status of the node and one of the residual");
        status.remove(1)
    }

    fn stop(self) {
        let Self { ros, client, diagnostics } = self;
        drop((client, diagnostics));
        ros.stop();
    }
}

/// Events from the pipeline.
#[derive(Default)]
struct Events {
    estimates: Vec<Estimate>,
    residuals: Vec<Residual>,
    alarms: Vec<AlarmChange>,
}

/// Takes events until `count` residuals have come, or for at most 30 s.
fn collect(receiver: &mut EventReceiver, count: usize) -> Events {
    let deadline = Instant::now() + Duration::from_secs(30);
    let mut events = Events::default();
    while events.residuals.len() < count && Instant::now() < deadline {
        while let Ok(event) = receiver.events.pop() {
            match event {
                Event::Estimate(estimate) => events.estimates.push(estimate),
                Event::Residual(residual) => events.residuals.push(residual),
                Event::Alarm(change) => events.alarms.push(change),
                _ => {}
            }
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    events
}

fn expected_n(name: &str) -> f64 {
    preset::load(name).expect("a preset").expected.free_run_rsse_n.expect("the thesis states one")
}

#[test]
fn a_model_is_loaded_without_losing_an_estimate() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let (config, args, run) = (config(&domain), RosArgs::default(), run(8.0));
    let (service, receiver) = DamperNode::start(&config, &args, true).expect("the service starts");
    let mut receiver = receiver.expect("a receiver was requested");
    let peer = Peer::new(&config);
    peer.wait_for_service();
    let interrupt = Interrupt::manual();
    let player = Player::start(&config, &args, false).expect("the player starts");
    assert!(player.wait_for_listener(Duration::from_secs(20), &interrupt), "the node listens");
    let samples = run.displacement_m.len();
    // The first displacement has no velocity yet, so no prediction.
    let residuals_wanted = samples - 1;
    let counters = service.counters().ros_sink;

    let (answer, status, Events { estimates, residuals, .. }) = std::thread::scope(|scope| {
        let events = scope.spawn(|| collect(&mut receiver, residuals_wanted));
        let asked = scope.spawn(|| {
            wait_until("residuals of the old model", || counters.residuals.load(Ordering::Relaxed) > 1000);
            (peer.load(AFTER), peer.next_status())
        });
        player.play(&run, &PlaybackOptions::default(), &mut Played::default(), &interrupt, None, &|_| {});
        let (answer, status) = asked.join().expect("no panic");
        (answer, status, events.join().expect("no panic"))
    });
    assert!(answer.success, "{answer:?}");
    assert!(answer.message.contains(AFTER) && answer.message.contains(BEFORE), "{answer:?}");

    assert_eq!(estimates.len(), samples, "one estimate per displacement");
    assert!(estimates.windows(2).all(|pair| pair[0].stamp < pair[1].stamp), "in order");
    assert!(
        estimates.iter().skip(2).all(|e| e.force.get().is_finite()),
        "every estimate but the first two has a force"
    );

    // The stream holds first the residuals of the old model, then the residuals of the new one, and over 500 of each.
    let (before_n, after_n) = (expected_n(BEFORE), expected_n(AFTER));
    assert_ne!(before_n, after_n);
    let swapped = residuals
        .iter()
        .position(|r| r.expected_rsse.get() == after_n)
        .expect("the new model gives residuals");
    println!("{} residuals, the new model's from {swapped} on; {}", residuals.len(), answer.message);
    assert!(swapped > 500 && swapped < residuals.len() - 500, "far from both ends: {swapped}");
    assert!(residuals[..swapped].iter().all(|r| r.expected_rsse.get() == before_n));
    assert!(residuals[swapped..].iter().all(|r| r.expected_rsse.get() == after_n));

    // Names, parameter, diagnostics and history all report the new model.
    assert_eq!(service.names().read().expect("no panic").free, AFTER);
    assert_eq!(service.control().config().model, AFTER);
    let of = |key: &str| status.values.iter().find(|v| v.key == key).map(|v| v.value.clone());
    assert_eq!(of("model").as_deref(), Some(AFTER), "{status:?}");
    assert_eq!(of("expected_rsse_n"), Some(format!("{after_n:.4}")), "{status:?}");
    assert_eq!(status.level, DiagnosticStatus::OK, "{status:?}");
    // The overseer reads its ring buffer a few times a second.
    let history = service.history();
    let held = || history.lock().expect("no panic").runs(120.0, 0.1);
    wait_until("the run in the history", || {
        held().first().is_some_and(|run| run.displacement_m.len() >= samples)
    });
    let runs = held();
    assert_eq!(runs.len(), 1, "no gap");
    assert!(runs[0].displacement_m.values == run.displacement_m.values, "the history equals the played run");
    assert_eq!(runs[0].force_n.as_ref().map(|f| f.len()), run.force_n.as_ref().map(|f| f.len()));

    player.stop();
    peer.stop();
    service.stop().expect("no thread panicked");
}

/// The measured force is three times the predicted force: the alarm is raised on all outputs, and another model clears it.
#[test]
fn an_alarm_reports_a_wrong_model_until_another_is_loaded() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let config = config(&domain);
    let (args, mut run) = (RosArgs::default(), run(8.0));
    run.force_n.as_mut().expect("a force").values.iter_mut().for_each(|force_n| *force_n *= 3.0);
    let (service, receiver) = DamperNode::start(&config, &args, true).expect("the service starts");
    let mut receiver = receiver.expect("a receiver was requested");
    let mut peer = Peer::new(&config);
    let residuals: Subscription<ForceResidual> = peer.ros.subscribe("/force_residual").expect("a topic");
    peer.wait_for_service();
    let interrupt = Interrupt::manual();
    let player = Player::start(&config, &args, false).expect("the player starts");
    assert!(player.wait_for_listener(Duration::from_secs(20), &interrupt), "the node listens");
    let (status, answer, events) = std::thread::scope(|scope| {
        let events = scope.spawn(|| collect(&mut receiver, run.displacement_m.len() - 1));
        let asked = scope.spawn(|| {
            let mut said = 0;
            wait_until("500 residuals with alarm on force_residual", || {
                let residuals = std::iter::from_fn(|| residuals.take().expect("readable"));
                said += residuals.filter(|(residual, _)| residual.alarm).count();
                said >= 500
            });
            (peer.next_status(), peer.load(AFTER))
        });
        player.play(&run, &PlaybackOptions::default(), &mut Played::default(), &interrupt, None, &|_| {});
        let (status, answer) = asked.join().expect("no panic");
        (status, answer, events.join().expect("no panic"))
    });
    assert!(answer.success, "{answer:?}");
    println!("{}", status.message);
    assert_eq!(status.level, DiagnosticStatus::WARN, "{status:?}");
    assert!(status.message.contains("load_model"), "it says what to do: {status:?}");

    let changes: Vec<_> = events.alarms.iter().map(|change| (change.raised, change.ratio.is_nan())).collect();
    // Raised, then cleared by the new model, without a ratio. If there was time, the new model, which is also wrong, raises it again.
    assert!(changes.starts_with(&[(true, false), (false, true)]), "{changes:?}");
    player.stop();
    drop(residuals);
    peer.stop();
    service.stop().expect("no thread panicked");
}

#[test]
fn a_model_that_cannot_run_is_refused_with_the_reason_and_changes_nothing() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let config = config(&domain);
    let (service, _) = DamperNode::start(&config, &RosArgs::default(), false).expect("the service starts");
    let peer = Peer::new(&config);
    peer.wait_for_service();
    let dir = tempfile::tempdir().expect("a directory");
    let file = |name: &str, text: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, text).expect("written");
        path.to_str().expect("UTF-8").to_owned()
    };
    let voltage = file("voltage.toml", &driven_by_voltage(preset::load(BEFORE).expect("a preset")));
    let broken = file("broken.toml", "schema = \"mr-damper/model/1\"\nmodel = \"fuzzy-tahn\"\n");
    for (model, says) in [
        ("", "model"),
        ("/no/such/file.toml", "/no/such/file.toml"),
        ("thesis/fuzzy-tanh/rp9-cs", "rp9-cs"),
        (broken.as_str(), "broken.toml"),
        (voltage.as_str(), "command_v"),
    ] {
        let answer = peer.load(model);
        println!("{model}: {}", answer.message);
        assert!(!answer.success, "{model}: {answer:?}");
        assert!(answer.message.contains(says), "{model}: {answer:?}");
    }
    assert_eq!(service.names().read().expect("no panic").free, BEFORE);
    assert_eq!(service.control().models(), Some(models::from_config(&config).expect("it loads").0));
    let status = peer.next_status();
    assert_eq!(status.level, DiagnosticStatus::STALE, "no input arrives: {status:?}");
    peer.stop();
    service.stop().expect("no thread panicked");
}

/// The model file of `model`, rewritten as if it had been identified with a command voltage.
fn driven_by_voltage(model: Model) -> String {
    let file = ModelFile { model, provenance: Provenance::default() };
    let text = file.to_toml().expect("writable").replace("current_a", "command_v");
    text.replace("membership_centres_a", "membership_centres_v")
        .replace("membership_sigma_a", "membership_sigma_v")
}

/// Writes both texts in turn to `path` until `done` is set: by renaming, and in place in two halves with a pause in between.
fn replace(path: &Path, texts: &[String; 2], done: &AtomicBool) -> [u32; 2] {
    let mut times = [0; 2];
    for turn in 0.. {
        let text = &texts[turn % 2];
        // Eight times by renaming, then four times in place.
        if turn % 12 < 8 {
            let part = path.with_extension("part");
            std::fs::write(&part, text).expect("written");
            std::fs::rename(&part, path).expect("renamed");
            times[0] += 1;
        } else {
            let mut file = std::fs::File::create(path).expect("truncated");
            let half = text.len() * (turn % 7 + 1) / 9;
            file.write_all(&text.as_bytes()[..half]).expect("written");
            std::thread::sleep(Duration::from_millis(30));
            file.write_all(&text.as_bytes()[half..]).expect("written");
            times[1] += 1;
        }
        // A load waits until its file has not changed for 0.1 s, and then reads it. Renaming does not change the open file.
        std::thread::sleep(Duration::from_millis(if turn % 12 < 8 { 15 } else { 150 }));
        if done.load(Ordering::Acquire) {
            break;
        }
    }
    times
}

#[test]
fn a_model_file_replaced_while_it_is_loaded_gives_one_of_both_models_or_a_refusal() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let config = config(&domain);
    let (service, _) = DamperNode::start(&config, &RosArgs::default(), false).expect("the service starts");
    let peer = Peer::new(&config);
    peer.wait_for_service();
    let dir = tempfile::tempdir().expect("a directory");
    let path = dir.path().join("model.toml");
    let models = [BEFORE, AFTER].map(|name| preset::load(name).expect("a preset"));
    let texts = models
        .map(|model| ModelFile { model, provenance: Provenance::default() }.to_toml().expect("writable"));
    std::fs::write(&path, &texts[0]).expect("written");
    let done = AtomicBool::new(false);
    let ([first, second, refused], times) = std::thread::scope(|scope| {
        let _ended = Ended(&done);
        let replacing = scope.spawn(|| replace(&path, &texts, &done));
        let mut answers = [0; 3];
        let begin = Instant::now();
        while begin.elapsed() < Duration::from_secs(6) {
            let before = service.control().models().expect("it is active").free;
            let answer = peer.load(path.to_str().expect("UTF-8"));
            let now = service.control().models().expect("it is active").free;
            match models.iter().position(|model| *model == now) {
                Some(which) if answer.success => answers[which] += 1,
                None => panic!("neither of the two models is loaded: {answer:?} {now:?}"),
                Some(_) => {
                    assert_eq!(now, before, "a refusal changes nothing: {answer:?}");
                    assert!(answer.message.contains("model.toml"), "{answer:?}");
                    answers[2] += 1;
                }
            }
        }
        done.store(true, Ordering::Release);
        (answers, replacing.join().expect("no panic"))
    });
    println!(
        "renamed {} times, written in place {} times: {first} and {second} loaded, {refused} refused",
        times[0], times[1]
    );
    assert!(times[0] > 20 && times[1] > 5, "{times:?}");
    assert!(first > 0 && second > 0, "both were loaded: {first}, {second}, refused {refused}");
    peer.stop();
    service.stop().expect("no thread panicked");
}
