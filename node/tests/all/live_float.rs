//! Inputs without a stamp, over real DDS: every sample at 1 kHz gives an estimate, also under load.

use crate::domain::Domain;
use crate::live_support::{Ended, config, wait_for_discovery};
use crate::turn::turn;
use crate::wait::comes_true;
use mr_damper_base::clock::system_now;
use mr_damper_model::pipeline::{Estimate, Event, Reasons, Refused};
use mr_damper_msgs::standard::{Float64, Header, JointState};
use mr_damper_node::estimation::estimator::EventReceiver;
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::participant::{Output, Ros};
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use ros2_client::NodeOptions;
use rustdds::GUID;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

const SAMPLES: u32 = 5000;
const PERIOD: Duration = Duration::from_millis(1);
const AMPLITUDE_M: f64 = 0.01;
const RATE_RAD_S: f64 = 6.0;
/// Tests run one at a time, so that their loads do not add up.
static ALONE: Mutex<()> = Mutex::new(());

fn of_type(domain: i64, of: &str, joint: &str) -> Config {
    let mut config = config(domain);
    config.set("model", &Value::Text("thesis/fuzzy-tanh/rp3-cs".into())).expect("a text");
    for input in ["displacement", "coil_current"] {
        config.set(&format!("{input}.type"), &Value::Text(of.into())).expect("a type");
        config.set(&format!("{input}.joint"), &Value::Text(joint.into())).expect("a joint");
    }
    config
}

/// The node's estimates, and its reasons for refusing samples.
#[derive(Default)]
struct Came {
    estimates: Vec<Estimate>,
    refused: Vec<Refused>,
}

impl Came {
    /// True once each of the [`SAMPLES`] has an estimate or was refused.
    fn is_complete(&self) -> bool {
        self.estimates.len() + self.refused.len() >= SAMPLES as usize
    }

    fn take(&mut self, receiver: &mut EventReceiver) {
        while let Ok(event) = receiver.events.pop() {
            match event {
                Event::Estimate(estimate) if estimate.received.is_some() => self.estimates.push(estimate),
                Event::Refusal(refusal) => self.refused.push(refusal.why),
                _ => {}
            }
        }
    }
}

/// Feeds a node with [`SAMPLES`] samples of displacement and current, one [`PERIOD`] apart, through `publishers`.
fn feed(config: &Config, load: bool, publishers: impl FnOnce(&mut Ros) -> Publishers) -> Came {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let (service, receiver) =
        DamperNode::start(config, &RosArgs::default(), true).expect("the service starts");
    let mut receiver = receiver.expect("a receiver was requested");
    let mut ros =
        Ros::start(config, &RosArgs::default(), NodeOptions::new(), "sensor").expect("a peer starts");
    let publishers = publishers(&mut ros);
    wait_for_discovery(&mut ros, &publishers.guids(), &mut receiver);
    let (ended, busy) = (AtomicBool::new(false), AtomicBool::new(false));
    let came = std::thread::scope(|scope| {
        let _ended = Ended(&ended);
        let collecting = scope.spawn(|| {
            let mut came = Came::default();
            while !came.is_complete() && !ended.load(Ordering::Acquire) {
                came.take(&mut receiver);
                std::thread::sleep(Duration::from_millis(5));
            }
            came
        });
        for _ in 0..2 {
            scope.spawn(|| {
                while !ended.load(Ordering::Acquire) {
                    // Half a second of load alternates with half a second of rest.
                    if !(load && busy.load(Ordering::Acquire)) {
                        std::thread::sleep(Duration::from_millis(1));
                    }
                }
            });
        }
        let start = Instant::now();
        for k in 0..SAMPLES {
            std::thread::sleep((start + PERIOD * k).saturating_duration_since(Instant::now()));
            busy.store((k / 500) % 2 == 1, Ordering::Release);
            let t = start.elapsed().as_secs_f64();
            publishers.publish(AMPLITUDE_M * (RATE_RAD_S * t).sin());
        }
        busy.store(false, Ordering::Release);
        // If some do not come, the test's assertion reports how many came.
        let _ = comes_true(|| collecting.is_finished());
        ended.store(true, Ordering::Release);
        collecting.join().expect("no panic")
    });
    drop(publishers);
    ros.stop();
    service.stop().expect("no thread panicked");
    came
}

enum Publishers {
    Float { displacement: Output<Float64>, current: Output<Float64> },
    Joint { displacement: Output<JointState>, current: Output<JointState> },
}

impl Publishers {
    fn float(ros: &mut Ros) -> Self {
        let displacement = ros.publish("/displacement").expect("a topic");
        Self::Float { displacement, current: ros.publish("/coil_current").expect("a topic") }
    }

    fn joint(ros: &mut Ros) -> Self {
        let displacement = ros.publish("/displacement").expect("a topic");
        Self::Joint { displacement, current: ros.publish("/coil_current").expect("a topic") }
    }

    fn guids(&self) -> [GUID; 2] {
        match self {
            Self::Float { displacement, current } => [displacement.guid(), current.guid()],
            Self::Joint { displacement, current } => [displacement.guid(), current.guid()],
        }
    }

    fn publish(&self, displacement_m: f64) {
        match self {
            Self::Float { displacement, current } => {
                current.publish(Float64 { data: 0.8 }).expect("sent");
                displacement.publish(Float64 { data: displacement_m }).expect("sent");
            }
            Self::Joint { displacement, current } => {
                let state = |position, effort| JointState {
                    header: Header::default(),
                    name: vec!["rod".to_owned()],
                    position: vec![position],
                    velocity: vec![],
                    effort: vec![effort],
                };
                current.publish(state(0.0, 0.8)).expect("sent");
                displacement.publish(state(displacement_m, 0.0)).expect("sent");
            }
        }
    }
}

fn assert_none_is_lost(what: &str, came: &Came) {
    let (estimates, refused) = (came.estimates.len(), came.refused.len());
    assert_eq!((estimates, refused), (SAMPLES as usize, 0), "{what}: estimates, refused samples");
    let now = system_now();
    for pair in came.estimates.windows(2) {
        let [before, estimate] = pair else { unreachable!("pairs") };
        assert!(estimate.stamp > before.stamp, "{what}: stamps increase");
        assert!(now.since(estimate.stamp).get() < 60.0, "{what}: stamps are less than a minute old");
        assert!(!estimate.reasons.any(Reasons::LATE), "{what}: {estimate:?}");
    }
    // The stamps keep the spacing of the samples, so the velocities are right, and so are the forces.
    let beyond =
        came.estimates[10..].iter().filter(|estimate| estimate.reasons.has(Reasons::OUTSIDE_ENVELOPE));
    assert!(
        beyond.count() * 100 < SAMPLES as usize,
        "{what}: the rod never had velocities outside the envelope"
    );
}

#[test]
fn a_float64_is_never_refused() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let came = feed(&of_type(domain.id(), "std_msgs/msg/Float64", ""), false, Publishers::float);
    assert_none_is_lost("Float64 at 1 kHz", &came);
}

#[test]
fn a_float64_is_never_refused_under_load() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let came = feed(&of_type(domain.id(), "std_msgs/msg/Float64", ""), true, Publishers::float);
    assert_none_is_lost("Float64 at 1 kHz under load", &came);
}

#[test]
fn a_joint_state_with_a_zero_stamp_is_never_refused_under_load() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let came = feed(&of_type(domain.id(), "sensor_msgs/msg/JointState", "rod"), true, Publishers::joint);
    assert_none_is_lost("JointState at 1 kHz under load", &came);
}
