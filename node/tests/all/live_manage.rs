//! A managed node over real DDS: its states, parameters and mode, as other nodes see and set them.

use crate::domain::Domain;
use crate::live_support::{Caller, config};
use crate::turn::turn;
use crate::wait::wait_until;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::Run;
use mr_damper_msgs::lifecycle::{
    ChangeState, ChangeStateRequest, GetAvailableTransitions, GetState, State, Transition, TransitionEvent,
};
use mr_damper_msgs::rcl::{
    DescribeParameters, DescribeParametersRequest, GetParameters, GetParametersRequest, Log, Parameter,
    ParameterEvent, ParameterValue, SetParameters, SetParametersAtomically, SetParametersAtomicallyRequest,
    SetParametersRequest,
};
use mr_damper_msgs::srv::{Reset, SetMode, SetModeRequest};
use mr_damper_msgs::type_description::{GetTypeDescription, GetTypeDescriptionRequest};
use mr_damper_msgs::{ForceEstimate, Message, Mode};
use mr_damper_node::commands::logging::{self, LogFormat, Outputs};
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::rosout;
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use mr_damper_node::settings::interrupt::Interrupt;
use mr_damper_node::streams::player::{PlaybackOptions, Played, Player};
use std::sync::atomic::Ordering;

const NODE: &str = "/mr_damper";
const MANAGED: &str = "/managed/mr_damper";

fn run(seconds: f64) -> Run {
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(seconds);
    record(&experiment, &Plant::default(), &Channels::default(), 7)
}

fn set(config: &mut Config, name: &str, value: Value) {
    config.set(name, &value).expect("a parameter");
}

fn double(name: &str, double_value: f64) -> Parameter {
    let value = ParameterValue { r#type: ParameterValue::DOUBLE, double_value, ..Default::default() };
    Parameter { name: name.to_owned(), value }
}

fn text(name: &str, string_value: &str) -> Parameter {
    let string_value = string_value.to_owned();
    let value = ParameterValue { r#type: ParameterValue::STRING, string_value, ..Default::default() };
    Parameter { name: name.to_owned(), value }
}

fn transition(label: &str) -> ChangeStateRequest {
    ChangeStateRequest { transition: Transition { id: 0, label: label.to_owned() } }
}

/// Plays `run`, and returns once the node has taken each sample.
fn play(service: &DamperNode, config: &Config, args: &RosArgs, run: &Run, clock: bool) {
    let taken = || {
        let counters = service.counters().estimator;
        [&counters.idle, &counters.used, &counters.refused]
            .map(|count| count.load(Ordering::Relaxed))
            .iter()
            .sum()
    };
    let before: u64 = taken();
    let player = Player::start(config, args, clock).expect("a player");
    let interrupt = Interrupt::manual();
    assert!(player.wait_for_listener(std::time::Duration::from_secs(10), &interrupt));
    let plan = PlaybackOptions { clock, ..PlaybackOptions::default() };
    let mut played = Played::default();
    player.play(run, &plan, &mut played, &interrupt, None, &|_| {});
    wait_until("the played samples at the node", || taken() >= before + played.samples);
    player.stop();
}

#[test]
fn peers_configure_activate_and_deactivate_the_node() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    // The log is also published on /rosout.
    logging::start(LogFormat::Text, "info", Outputs { stderr: true, rosout: true });
    let mut config = config(domain.id());
    set(&mut config, "autostart", Value::Bool(false));
    let args = RosArgs::in_namespace("/managed");
    // Other nodes of this process also log.
    let inside = rosout::span(&args.full_name()).entered();
    let (service, _) = DamperNode::start(&config, &args, false).expect("it starts without a model");
    drop(inside);
    let mut peer = Caller::new(&config);
    let state = |peer: &mut Caller| {
        peer.call::<GetState>(MANAGED, "get_state", Default::default()).current_state.label
    };
    let events =
        peer.ros.subscribe::<TransitionEvent>("/managed/mr_damper/transition_event").expect("a topic");
    let log = peer.ros.subscribe::<Log>("/rosout").expect("a topic");
    assert_eq!(state(&mut peer), "unconfigured");

    // Without a model the transition fails, the log gives the reason, and nothing changes.
    let change = |peer: &mut Caller, label: &str| {
        peer.call::<ChangeState>(MANAGED, "change_state", transition(label)).success
    };
    assert!(!change(&mut peer, "configure") && !change(&mut peer, "activate"));
    assert_eq!(state(&mut peer), "unconfigured");

    // Before it runs, the model can be set as a parameter; a running node takes it only from load_model.
    let parameters = vec![text("model", "thesis/fuzzy-tanh/rp3-cs")];
    let results =
        peer.call::<SetParameters>(MANAGED, "set_parameters", SetParametersRequest { parameters }).results;
    assert!(results[0].successful, "{}", results[0].reason);
    assert!(change(&mut peer, "configure"));
    assert_eq!(state(&mut peer), "inactive");
    let ways = peer.call::<GetAvailableTransitions>(MANAGED, "get_available_transitions", Default::default());
    let ways: Vec<_> = ways.available_transitions.iter().map(|way| way.transition.label.as_str()).collect();
    assert_eq!(ways, ["cleanup", "activate", "shutdown"]);

    // While inactive, the node ignores its inputs.
    let run = run(0.5);
    let estimates = || service.counters().ros_sink.estimates.load(Ordering::Relaxed);
    play(&service, &config, &args, &run, false);
    assert_eq!(estimates(), 0);
    assert!(service.counters().estimator.idle.load(Ordering::Relaxed) > 0);
    assert!(change(&mut peer, "activate"));
    play(&service, &config, &args, &run, false);
    wait_until("estimates of the run", || estimates() >= run.displacement_m.len() as u64);
    assert!(change(&mut peer, "deactivate"));
    let before = estimates();
    play(&service, &config, &args, &run, false);
    assert_eq!(estimates(), before);
    assert!(change(&mut peer, "shutdown") && !change(&mut peer, "configure"));

    let mut told = Vec::new();
    while let Some((event, _)) = events.take().expect("readable") {
        told.push((event.start_state.id, event.transition.label, event.goal_state.id));
    }
    let told: Vec<_> = told.iter().map(|(from, by, to)| (*from, by.as_str(), *to)).collect();
    let wanted = [
        (State::UNCONFIGURED, "configure", State::INACTIVE),
        (State::INACTIVE, "activate", State::ACTIVE),
        (State::ACTIVE, "deactivate", State::INACTIVE),
        (State::INACTIVE, "shutdown", State::FINALIZED),
    ];
    assert_eq!(told, wanted);
    let mut lines = Vec::new();
    wait_until("the log", || {
        while let Some((line, _)) = log.take().expect("readable") {
            lines.push(line);
        }
        lines.iter().any(|line: &Log| line.msg.contains("finalized"))
    });
    let refused = lines.iter().find(|line| line.msg.contains("change_state refused")).expect("a line");
    assert!(refused.msg.contains("parameter model is not set"), "{}", refused.msg);
    assert_eq!((refused.level, refused.name.as_str()), (Log::WARN, "managed.mr_damper"));
    drop((events, log));
    peer.stop();
    service.stop().expect("it ends");
}

#[test]
fn parameters_are_described_and_set_atomically() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let mut config = config(domain.id());
    set(&mut config, "model", Value::Text("thesis/fuzzy-tanh/rp3-cs".to_owned()));
    let (service, _) = DamperNode::start(&config, &RosArgs::default(), false).expect("it starts");
    let mut peer = Caller::new(&config);
    let events = peer.ros.subscribe::<ParameterEvent>("/parameter_events").expect("a topic");

    let names = vec!["coast_s".to_owned(), "domain_id".to_owned()];
    let request = DescribeParametersRequest { names: names.clone() };
    let described = peer.call::<DescribeParameters>(NODE, "describe_parameters", request).descriptors;
    assert_eq!(described[0].floating_point_range[0].to_value, 3600.0);
    assert!(described[0].description.ends_with(", s [default: 0.2]") && !described[0].read_only);
    assert!(described[1].read_only && described[1].integer_range[0].to_value == 232);

    let coast_s = |peer: &mut Caller| {
        let request = GetParametersRequest { names: vec!["coast_s".to_owned()] };
        peer.call::<GetParameters>(NODE, "get_parameters", request).values[0].double_value
    };
    let atomically = |peer: &mut Caller, parameters| {
        let request = SetParametersAtomicallyRequest { parameters };
        peer.call::<SetParametersAtomically>(NODE, "set_parameters_atomically", request).result
    };
    // The second value is out of range, so the first one is not set either.
    let refused = atomically(&mut peer, vec![double("coast_s", 0.7), double("hold_s", -1.0)]);
    assert!(!refused.successful && refused.reason.contains("hold_s is -1"), "{}", refused.reason);
    assert_eq!(coast_s(&mut peer), 0.2);
    for (parameter, says) in [
        (text("model", "thesis/fuzzy-tanh/rp1-cs"), "load_model"),
        (double("domain_id", 1.0), "whole number"),
        (double("coats_s", 1.0), "did you mean coast_s"),
    ] {
        let refused = atomically(&mut peer, vec![parameter]);
        assert!(!refused.successful && refused.reason.contains(says), "{}", refused.reason);
    }
    let done = atomically(&mut peer, vec![double("coast_s", 0.7), double("hold_s", 2.0)]);
    assert!(done.successful, "{}", done.reason);
    assert_eq!(coast_s(&mut peer), 0.7);
    let mut changed = Vec::new();
    wait_until("an event", || {
        while let Some((event, _)) = events.take().expect("readable") {
            changed.extend(event.changed_parameters);
        }
        changed.len() == 2
    });
    assert_eq!(changed, [double("coast_s", 0.7), double("hold_s", 2.0)]);

    let request = GetTypeDescriptionRequest {
        type_name: ForceEstimate::TYPE.to_owned(),
        type_hash: ForceEstimate::TYPE_HASH.to_owned(),
        include_type_sources: true,
    };
    let described = peer.call::<GetTypeDescription>(NODE, "get_type_description", request);
    assert!(described.successful && described.type_sources.len() == 3, "{described:?}");
    drop(events);
    peer.stop();
    service.stop().expect("it ends");
}

#[test]
fn set_mode_holds_the_mode_and_simulated_time_going_back_resets_the_node() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let mut config = config(domain.id());
    set(&mut config, "model", Value::Text("thesis/fuzzy-tanh/rp3-cs".to_owned()));
    set(&mut config, "use_sim_time", Value::Bool(true));
    let (service, watched) = DamperNode::start(&config, &RosArgs::default(), true).expect("it starts");
    let mut watched = watched.expect("asked for");
    let mut peer = Caller::new(&config);
    let hold = |peer: &mut Caller, mode: Mode| {
        let request = SetModeRequest { mode: mode as u8, automatic: false };
        peer.call::<SetMode>("", "set_mode", request)
    };
    assert!(!hold(&mut peer, Mode::ArxCoast).success);
    assert!(hold(&mut peer, Mode::Model).success);
    let run = run(1.0);
    let mut modes = |run: &Run| {
        play(&service, &config, &RosArgs::default(), run, true);
        let mut modes = Vec::new();
        while let Ok(event) = watched.events.pop() {
            if let mr_damper_model::pipeline::Event::Transition(change) = event {
                modes.push((change.to.name(), change.cause.text()));
            }
        }
        modes
    };
    let asked = "the mode was asked for";
    assert_eq!(modes(&run), [("model", asked)], "measured force arrives but is not used");
    // The same run again, with the same stamps: simulated time goes back.
    let again = modes(&run);
    assert_eq!(again.first(), Some(&("fault", "reset")), "{again:?}");
    assert_eq!(again.last(), Some(&("model", asked)), "{again:?}");
    let request = SetModeRequest { mode: 0, automatic: true };
    assert!(peer.call::<SetMode>("", "set_mode", request).success);
    let auto = modes(&run);
    assert_eq!(auto.last().map(|change| change.0), Some("arx"), "{auto:?}");
    assert!(peer.call::<Reset>("", "reset", Default::default()).success);
    // The order in which /clock and the first samples of a run arrive is undefined: samples that arrive before the time goes back belong
    // to the past.
    let refused = service.counters().estimator.refused.load(Ordering::Relaxed);
    assert!(refused <= 2 * 2 * 3, "{refused} samples refused in two repeated runs");
    let clock = service.control().clock().now().expect("/clock was received");
    let last = run.displacement_m.stamps.last().expect("a run");
    assert!((last.since(clock).get()).abs() < 0.01, "the node's time is the run's time");
    peer.stop();
    service.stop().expect("it ends");
}
