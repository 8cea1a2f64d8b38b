//! Simulated time, over real DDS: one type on `/clock`, a diagnostic while no clock arrives, and clock time for samples without a
//! stamp.

use crate::domain::Domain;
use crate::live_support::{config, wait_for_discovery};
use crate::turn::turn;
use crate::wait::{comes_true, wait_until};
use mr_damper_model::pipeline::{Event, Reasons};
use mr_damper_model::sample::Stamp;
use mr_damper_msgs::Message;
use mr_damper_msgs::standard::{Clock, DiagnosticArray, Float64, Time};
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::participant::Ros;
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use mr_damper_node::streams::player::Player;
use ros2_client::NodeOptions;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

fn simulated(domain: i64) -> Config {
    let mut config = config(domain);
    config.set("model", &Value::Text("thesis/fuzzy-tanh/rp3-cs".into())).expect("a text");
    config.set("use_sim_time", &Value::Bool(true)).expect("a truth");
    config
}

#[test]
fn clock_has_only_its_own_type() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let of_others = rustdds::DomainParticipantBuilder::new(domain.id() as u16)
        .with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)])
        .build()
        .expect("a participant");
    let config = simulated(domain.id());
    let (service, _) = DamperNode::start(&config, &RosArgs::default(), false).expect("it starts");
    let player = Player::start(&config, &RosArgs::default(), true).expect("a player starts");
    let types = || {
        let readers = of_others.discovered_readers().into_iter();
        let readers = readers.map(|reader| reader.subscription_topic_data);
        let writers = of_others.discovered_writers().into_iter().map(|writer| writer.publication_topic_data);
        let of_readers =
            readers.filter(|topic| topic.topic_name() == "rt/clock").map(|t| t.type_name().clone());
        let of_writers = writers.filter(|topic| topic.topic_name == "rt/clock").map(|t| t.type_name);
        let mut types: Vec<String> = of_readers.chain(of_writers).collect();
        types.sort();
        types
    };
    wait_until("reader and writer of /clock", || types().len() >= 2);
    // An endpoint of another type would be discovered within this time; nothing marks the end of discovery.
    std::thread::sleep(Duration::from_secs(3));
    assert_eq!(types(), [Clock::DDS_TYPE; 2], "one reader (the node) and one writer (the player)");
    player.stop();
    service.stop().expect("no thread panicked");
}

#[test]
fn a_missing_clock_is_reported_until_it_arrives() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let config = simulated(domain.id());
    let (service, _) = DamperNode::start(&config, &RosArgs::default(), false).expect("it starts");
    let mut peer =
        Ros::start(&config, &RosArgs::default(), NodeOptions::new(), "peer").expect("a peer starts");
    let diagnostics = peer.subscribe::<DiagnosticArray>("/diagnostics").expect("a topic");
    let clock = peer.publish::<Clock>("/clock").expect("a topic");
    let mut said = String::new();
    let mut listen = || {
        while let Ok(Some((array, _))) = diagnostics.take() {
            let status = array.status.into_iter().find(|status| status.name.ends_with(": node"));
            said = status.map_or(String::new(), |status| format!("{} {}", status.level, status.message));
        }
        said.clone()
    };
    wait_until("a status that mentions /clock", || listen().contains("/clock"));
    assert!(listen().contains("use_sim_time") && !listen().starts_with('0'), "{}", listen());
    wait_until("a status without /clock", || {
        clock.publish(Clock { clock: Time { sec: 5, nanosec: 0 } }).expect("sent");
        !listen().contains("/clock")
    });
    drop((diagnostics, clock));
    peer.stop();
    service.stop().expect("no thread panicked");
}

#[test]
fn samples_without_a_stamp_are_spread_between_clock_ticks_and_none_is_lost() {
    const SAMPLES: u32 = 2000;
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let mut config = simulated(domain.id());
    for input in ["displacement", "coil_current"] {
        config.set(&format!("{input}.type"), &Value::Text("std_msgs/msg/Float64".into())).expect("a type");
    }
    let (service, receiver) = DamperNode::start(&config, &RosArgs::default(), true).expect("it starts");
    let mut receiver = receiver.expect("a receiver was requested");
    let mut peer =
        Ros::start(&config, &RosArgs::default(), NodeOptions::new(), "peer").expect("a peer starts");
    let clock = peer.publish::<Clock>("/clock").expect("a topic");
    let displacement = peer.publish::<Float64>("/displacement").expect("a topic");
    let current = peer.publish::<Float64>("/coil_current").expect("a topic");
    let tick = |ms: u32| {
        let time = Time { sec: (ms / 1000) as i32, nanosec: ms % 1000 * 1_000_000 };
        clock.publish(Clock { clock: time }).expect("sent");
    };
    // Before the first tick, the node does not know at which time such a sample was taken.
    let unreadable = || service.counters().source.unreadable.load(Ordering::Relaxed);
    wait_until("a sample before the first simulated time is not used", || {
        displacement.publish(Float64 { data: 0.0 }).expect("sent");
        unreadable() > 0
    });
    let now = || service.control().clock().now();
    wait_until("simulated time at the node", || {
        tick(60_000);
        now().is_some()
    });
    let publishers = [clock.guid(), displacement.guid(), current.guid()];
    wait_for_discovery(&mut peer, &publishers, &mut receiver);
    let before = unreadable();
    // The simulation starts again, because the rate of a tick that was waited for says nothing.
    tick(1000);
    wait_until("the time of the new simulation", || now() == Some(Stamp::from_nanos(1_000_000_000)));
    // Simulated time runs at half the speed of system time, in steps of 10 ms with ten samples in each step.
    let start = Instant::now();
    for k in 0..SAMPLES {
        std::thread::sleep((start + Duration::from_millis(2) * k).saturating_duration_since(Instant::now()));
        if k % 10 == 0 {
            tick(1000 + k);
        }
        current.publish(Float64 { data: 0.8 }).expect("sent");
        displacement.publish(Float64 { data: 0.01 * (6.0 * f64::from(k) * 1e-3).sin() }).expect("sent");
    }
    let (mut estimates, mut refused) = (Vec::new(), 0);
    // If some do not come, the next assertion reports how many came.
    let _ = comes_true(|| {
        while let Ok(event) = receiver.events.pop() {
            match event {
                Event::Estimate(estimate) if estimate.received.is_some() => estimates.push(estimate),
                Event::Refusal(_) => refused += 1,
                _ => {}
            }
        }
        estimates.len() + refused >= SAMPLES as usize
    });
    assert_eq!(unreadable(), before, "only samples before the first simulated time");
    assert_eq!((estimates.len(), refused), (SAMPLES as usize, 0), "estimates, refused samples");
    assert!(estimates.iter().all(|e| (1.0..3.1).contains(&(e.stamp.nanos() as f64 * 1e-9))), "simulated");
    let mut steps_ms: Vec<f64> =
        estimates.windows(2).map(|pair| pair[1].stamp.since(pair[0].stamp).get() * 1e3).collect();
    steps_ms.sort_by(f64::total_cmp);
    let quantile = |share: f64| steps_ms[(share * steps_ms.len() as f64) as usize];
    assert!((0.7..1.3).contains(&quantile(0.5)), "the median step is {} ms instead of 1 ms", quantile(0.5));
    assert!(quantile(0.1) > 0.05, "one step in ten is {} ms or shorter", quantile(0.1));
    let beyond = estimates[100..].iter().filter(|e| e.reasons.has(Reasons::OUTSIDE_ENVELOPE));
    assert!(beyond.count() * 20 < SAMPLES as usize, "the rod never had velocities outside the envelope");
    drop((clock, displacement, current));
    peer.stop();
    service.stop().expect("no thread panicked");
}
