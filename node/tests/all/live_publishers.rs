//! Two publishers of one input, over real DDS: the node names them, and marks estimates from their mixed samples as
//! degraded.

use crate::domain::Domain;
use crate::live_support::{config, wait_for_discovery};
use crate::turn::turn;
use crate::wait::wait_until;
use mr_damper_base::clock::system_now;
use mr_damper_model::pipeline::{Estimate, Event, Validity};
use mr_damper_model::sample::Stamp;
use mr_damper_msgs::standard::DiagnosticArray;
use mr_damper_msgs::{CoilCurrent, Displacement, ForceEstimate};
use mr_damper_node::estimation::estimator::EventReceiver;
use mr_damper_node::estimation::wire::header;
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::participant::{Output, Ros};
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use ros2_client::{NodeOptions, Subscription};
use std::time::{Duration, Instant};

const PERIOD: Duration = Duration::from_millis(2);
const MIXED: &str = "INPUT_INTERLEAVED";
const FRAME: &str = "rod_left";

fn with_model(domain: i64) -> Config {
    let mut config = config(domain);
    config.set("model", &Value::Text("thesis/fuzzy-tanh/rp3-cs".into())).expect("a text");
    config
}

/// A node that publishes displacement; for DDS it is a separate process.
struct Sensor {
    ros: Ros,
    displacement: Output<Displacement>,
}

impl Sensor {
    fn new(config: &Config, name: &str) -> Self {
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let mut ros = Ros::start(config, &RosArgs::default(), options, name).expect("a peer starts");
        let displacement = ros.publish("/displacement").expect("a topic");
        Self { ros, displacement }
    }

    /// Sends a sample, and returns its stamp.
    fn send(&self, displacement: f64) -> Stamp {
        let stamp = system_now();
        let message = Displacement { header: header(stamp, FRAME), displacement, variance: 0.0 };
        self.displacement.publish(message).expect("sent");
        stamp
    }

    fn stop(self) {
        let Self { ros, displacement } = self;
        drop(displacement);
        ros.stop();
    }
}

/// The node under test, with a steady current, and a peer that reads `/diagnostics`.
struct TestNode {
    service: DamperNode,
    receiver: EventReceiver,
    ros: Ros,
    current: Output<CoilCurrent>,
    diagnostics: Subscription<DiagnosticArray>,
    /// Message of the node's status, as last published.
    said: String,
}

impl TestNode {
    fn new(config: &Config) -> Self {
        let (service, receiver) = DamperNode::start(config, &RosArgs::default(), true).expect("it starts");
        let mut ros =
            Ros::start(config, &RosArgs::default(), NodeOptions::new(), "bench").expect("a peer starts");
        let current = ros.publish("/coil_current").expect("a topic");
        let diagnostics = ros.subscribe("/diagnostics").expect("a topic");
        let receiver = receiver.expect("a receiver was requested");
        Self { service, receiver, ros, current, diagnostics, said: String::new() }
    }

    /// Waits until the node receives the current and the samples of `sensors`.
    fn discover(&mut self, sensors: &mut [&mut Sensor]) {
        wait_for_discovery(&mut self.ros, &[self.current.guid()], &mut self.receiver);
        for sensor in sensors {
            wait_for_discovery(&mut sensor.ros, &[sensor.displacement.guid()], &mut self.receiver);
        }
    }

    fn listen(&mut self) -> &str {
        while let Ok(Some((array, _))) = self.diagnostics.take() {
            let status = array.status.into_iter().find(|status| status.name.ends_with(": node"));
            self.said = status.map_or(String::new(), |status| status.message);
        }
        &self.said
    }

    /// The estimates of samples. On a busy machine there are others, which bridge a silence.
    fn estimates(&mut self) -> Vec<Estimate> {
        let mut estimates = Vec::new();
        while let Ok(event) = self.receiver.events.pop() {
            if let Event::Estimate(estimate) = event
                && estimate.received.is_some()
            {
                estimates.push(estimate);
            }
        }
        estimates
    }

    /// Sends displacement from the sensors for `duration`, and returns the estimates once the last sample has one.
    fn feed(&mut self, duration: Duration, sensors: &[(&Sensor, f64)]) -> Vec<Estimate> {
        drop(self.estimates());
        let start = Instant::now();
        let (mut k, mut last) = (0, system_now());
        while start.elapsed() < duration {
            std::thread::sleep((start + PERIOD * k).saturating_duration_since(Instant::now()));
            k += 1;
            let t = start.elapsed().as_secs_f64();
            for (sensor, offset) in sensors {
                last = sensor.send(0.01 * (6.0 * t).sin() + offset);
            }
            // The node waits for a current with the stamp of the displacement before it estimates.
            let current = CoilCurrent { header: header(last, ""), current: 0.8, variance: 0.0 };
            self.current.publish(current).expect("sent");
        }
        let mut estimates = Vec::new();
        wait_until("the estimate of the last sample", || {
            estimates.extend(self.estimates());
            estimates.iter().any(|estimate| estimate.stamp == last)
        });
        estimates
    }

    fn stop(self) {
        let Self { service, ros, current, diagnostics, .. } = self;
        service.stop().expect("no thread panicked");
        drop((current, diagnostics));
        ros.stop();
    }
}

fn is_mixed(estimate: &Estimate) -> bool {
    estimate.reasons.names().any(|name| name == MIXED)
}

#[test]
fn two_publishers_of_displacement_are_named_and_their_estimates_are_degraded() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let config = with_model(domain.id());
    let mut under_test = TestNode::new(&config);
    let mut left = Sensor::new(&config, "left_sensor");
    let mut right = Sensor::new(&config, "right_sensor");
    under_test.discover(&mut [&mut left, &mut right]);
    for (what, offset) in [("2 mm apart", 0.002), ("identical", 0.0)] {
        let estimates = under_test.feed(Duration::from_secs(3), &[(&left, 0.0), (&right, offset)]);
        let settled = &estimates[estimates.len() / 3..];
        assert!(settled.len() > 1000, "{what}: {} estimates", settled.len());
        let unflagged: Vec<_> =
            settled.iter().filter(|e| !is_mixed(e) || e.validity < Validity::Degraded).collect();
        assert!(unflagged.is_empty(), "{what}: of {}: {unflagged:?}", settled.len());
        let said = under_test.listen();
        for part in ["/displacement has 2 publishers", "/left_sensor", "/right_sensor", "mixed"] {
            assert!(said.contains(part), "{what}: {part} in {said}");
        }
    }
    // One of them stops: the node accepts the other again, and the status no longer mentions publishers.
    right.stop();
    under_test.feed(Duration::from_secs(1), &[(&left, 0.0)]);
    let estimates = under_test.feed(Duration::from_secs(2), &[(&left, 0.0)]);
    assert!(estimates.len() > 500 && !estimates.iter().any(is_mixed), "{} estimates", estimates.len());
    wait_until("the status without it", || !under_test.listen().contains("publishers"));
    left.stop();
    under_test.stop();
}

#[test]
fn a_restarted_publisher_does_not_count_as_two() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let config = with_model(domain.id());
    let mut under_test = TestNode::new(&config);
    let mut before = Sensor::new(&config, "sensor");
    let published = under_test.ros.subscribe::<ForceEstimate>("/force_estimate").expect("a topic");
    under_test.discover(&mut [&mut before]);
    let mut estimates = under_test.feed(Duration::from_secs(2), &[(&before, 0.0)]);
    before.stop();
    let after = Sensor::new(&config, "sensor");
    estimates.extend(under_test.feed(Duration::from_secs(3), &[(&after, 0.0)]));
    assert!(estimates.len() > 1500, "{} estimates", estimates.len());
    assert!(!estimates.iter().any(is_mixed));
    assert!(!under_test.listen().contains("publishers"), "{}", under_test.said);
    let (of_first, _) = published.take().expect("readable").expect("an estimate");
    assert_eq!(of_first.header.frame_id, FRAME, "estimates carry the frame of their displacement");
    drop(published);
    after.stop();
    under_test.stop();
}
