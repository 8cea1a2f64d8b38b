//! The real service over real DDS on loopback: live results are bit-identical to an offline evaluation of the run.

use crate::domain::Domain;
use crate::turn::turn;
use mr_damper_model::evaluate::{Evaluator, evaluate};
use mr_damper_model::pipeline::{Event, Models, Settings};
use mr_damper_model::preset;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::Run;
use mr_damper_node::estimation::estimator::EventReceiver;
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use mr_damper_node::settings::interrupt::Interrupt;
use mr_damper_node::streams::player::{PlaybackOptions, Played, Player};
use mr_damper_runs::{LoadOptions, Map, Mapping, SaveOptions, load, save};
use std::time::{Duration, Instant};

fn run() -> Run {
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(4.0);
    record(&experiment, &Plant::default(), &Channels::default(), 7)
}

fn config(domain: &Domain, model: &str) -> Config {
    // A busy machine may stop a thread for longer than the default wait, and one sample out of order changes the
    // result.
    let mut config = Config { domain_id: domain.id(), align_wait_s: 0.5, ..Config::default() };
    config.set("model", &Value::Text(model.to_owned())).expect("a text");
    config
}

/// Takes events until `count` residuals have come, or for at most 20 s.
fn collect(receiver: &mut EventReceiver, count: u64) -> Vec<Event> {
    let deadline = Instant::now() + Duration::from_secs(20);
    let (mut events, mut residuals) = (Vec::new(), 0);
    while residuals < count && Instant::now() < deadline {
        while let Ok(event) = receiver.events.pop() {
            residuals += u64::from(matches!(event, Event::Residual(_)));
            events.push(event);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    events
}

fn live_events(args: &RosArgs, config: &Config, run: &Run, residuals: u64) -> Vec<Event> {
    let (service, receiver) = DamperNode::start(config, args, true).expect("the service starts");
    let mut receiver = receiver.expect("a receiver was requested");
    let interrupt = Interrupt::manual();
    let player = Player::start(config, args, false).expect("the player starts");
    assert!(player.wait_for_listener(Duration::from_secs(20), &interrupt), "the node listens");
    let events = std::thread::scope(|scope| {
        let events = scope.spawn(|| collect(&mut receiver, residuals));
        player.play(run, &PlaybackOptions::default(), &mut Played::default(), &interrupt, None, &|_| {});
        events.join().expect("no panic")
    });
    player.stop();
    service.stop().expect("no thread panicked");
    events
}

#[test]
fn live_over_dds_equals_evaluate() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let run = run();
    for (name, args) in [
        ("thesis/fuzzy-tanh/rp3-cs", RosArgs::default()),
        // A namespace, and a model that uses measured force.
        ("thesis/arx-semi-active/rp-icps", RosArgs::in_namespace("/corner")),
    ] {
        let mut config = config(&domain, name);
        if name.contains("fuzzy") {
            config.set("arx_model", &Value::Text("none".into())).expect("a text");
        }
        let model = preset::load(name).expect("a preset");
        let offline = evaluate(model, &run, Settings::default(), |_| true).expect("the run has all channels");
        let expected = offline.free_run.expect("a free run").samples;
        let mut evaluator = Evaluator::default();
        for event in live_events(&args, &config, &run, expected) {
            evaluator.take(&event, |_| true);
        }
        let live = evaluator.finish();
        assert_eq!(live.free_run, offline.free_run, "{name}: bit-identical, and no sample lost");
        assert_eq!(live.one_step, offline.one_step, "{name}");
        assert_eq!(Models::alone(model).seeded.is_some(), live.one_step.is_some());
    }
}

#[test]
fn sign_and_offset_of_a_map_act_like_those_of_the_nodes_inputs() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let run = run();
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("raw.csv");
    save(&run, &path, &SaveOptions::default()).expect("written");
    let name = "thesis/fuzzy-tanh/rp3-cs";
    let mut config = config(&domain, name);
    let mut mappings = Vec::new();
    for (input, column, offset) in
        [("displacement", "displacement_m", 0.0031), ("measured_force", "force_n", -12.7)]
    {
        config.set(&format!("{input}.sign"), &Value::Double(-1.0)).expect("a sign");
        config.set(&format!("{input}.offset"), &Value::Double(offset)).expect("an offset");
        let mapping: Mapping =
            format!("{input}={column},sign=-1,offset={offset}").parse().expect("a mapping");
        mappings.push(mapping);
    }
    config.set("arx_model", &Value::Text("none".into())).expect("a text");
    let options = LoadOptions { map: Map::new(mappings).expect("distinct"), ..LoadOptions::default() };
    let mapped = load(&path, &options).expect("a run").run;
    assert_ne!(mapped.displacement_m.values, run.displacement_m.values);

    let model = preset::load(name).expect("a preset");
    let offline = evaluate(model, &mapped, Settings::default(), |_| true).expect("the run has all channels");
    let expected = offline.free_run.expect("a free run").samples;
    let mut evaluator = Evaluator::default();
    for event in live_events(&RosArgs::in_namespace("/mapped"), &config, &run, expected) {
        evaluator.take(&event, |_| true);
    }
    assert_eq!(evaluator.finish().free_run, offline.free_run, "bit-identical");
}
