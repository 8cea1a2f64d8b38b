//! Conventions of ROS 2 over real DDS: QoS overrides, and how long new clients wait.

use crate::domain::Domain;
use crate::live_support::{Caller, config};
use crate::turn::turn;
use crate::wait::wait_until;
use mr_damper_msgs::lifecycle::GetState;
use mr_damper_msgs::rcl::{
    DescribeParameters, DescribeParametersRequest, GetParameters, GetParametersRequest, ListParameters,
    ListParametersRequest, Parameter, ParameterValue, SetParameters, SetParametersRequest,
};
use mr_damper_msgs::{ForceEstimate, ForceResidual};
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use std::time::{Duration, Instant};

const NODE: &str = "/mr_damper";

fn set(config: &mut Config, name: &str, value: &str) {
    config.set(name, &Value::parse(value)).expect("a parameter");
}

#[test]
fn qos_overrides_apply_and_peers_can_read_but_not_set_them() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let name = "qos_overrides./force_estimate.publisher.reliability".to_owned();
    let mut own = config(domain.id());
    set(&mut own, "model", "thesis/fuzzy-tanh/rp3-cs");
    set(&mut own, &name, "best_effort");
    let (service, _) = DamperNode::start(&own, &RosArgs::default(), false).expect("it starts");

    // A reliable reader does not match a best-effort publisher. Only the publisher of the first topic is
    // best-effort.
    let mut reading = config(domain.id());
    for topic in ["/force_estimate", "/force_residual"] {
        set(&mut reading, &format!("qos_overrides.{topic}.subscription.reliability"), "reliable");
    }
    let mut peer = Caller::new(&reading);
    let estimates = peer.ros.subscribe::<ForceEstimate>("/force_estimate").expect("a topic");
    let residuals = peer.ros.subscribe::<ForceResidual>("/force_residual").expect("a topic");
    wait_until("the residuals' publisher", || peer.ros.writers_of(residuals.guid()) == 1);
    // A match of the other topic would be known within this time.
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(peer.ros.writers_of(estimates.guid()), 0, "best effort does not match reliable");

    let listed = peer.call::<ListParameters>(NODE, "list_parameters", ListParametersRequest::default());
    assert!(listed.result.names.contains(&name), "{:?}", listed.result.names);
    let names = vec![name.clone()];
    let got =
        peer.call::<GetParameters>(NODE, "get_parameters", GetParametersRequest { names: names.clone() });
    assert_eq!(got.values[0].string_value, "best_effort");
    let told =
        peer.call::<DescribeParameters>(NODE, "describe_parameters", DescribeParametersRequest { names });
    assert!(told.descriptors[0].read_only, "{told:?}");
    let value = ParameterValue {
        r#type: ParameterValue::STRING,
        string_value: "reliable".to_owned(),
        ..ParameterValue::default()
    };
    let request = SetParametersRequest { parameters: vec![Parameter { name, value }] };
    let refused = peer.call::<SetParameters>(NODE, "set_parameters", request);
    assert!(!refused.results[0].successful && refused.results[0].reason.contains("read-only"), "{refused:?}");
    drop((estimates, residuals));
    peer.stop();
    service.stop().expect("an orderly end");
}

/// `MR_DAMPER_CLIENTS=200` measures more clients; the default is 40.
#[test]
fn a_new_client_in_a_running_participant_does_not_wait_for_a_heartbeat() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let clients = std::env::var("MR_DAMPER_CLIENTS").ok().and_then(|text| text.parse().ok()).unwrap_or(40);
    let mut own = config(domain.id());
    set(&mut own, "model", "thesis/fuzzy-tanh/rp3-cs");
    let (service, _) = DamperNode::start(&own, &RosArgs::default(), false).expect("it starts");
    let mut peer = Caller::new(&own);
    let mut ask = || {
        let began = Instant::now();
        let _ = peer.call::<GetState>(NODE, "get_state", Default::default());
        began.elapsed()
    };
    // The first call lets the participants discover each other.
    ask();
    let mut waits: Vec<Duration> = (0..clients).map(|_| ask()).collect();
    waits.sort_unstable();
    let late = waits.iter().filter(|wait| **wait > Duration::from_millis(200)).count();
    let (median, longest) = (waits[clients / 2], waits[clients - 1]);
    println!("{clients} clients: median {median:?}, longest {longest:?}, {late} above 0.2 s");
    // Waiting for a heartbeat would take one second with RustDDS, and three with Fast DDS.
    assert!(longest < Duration::from_secs(1), "{waits:?}");
    peer.stop();
    service.stop().expect("an orderly end");
}
