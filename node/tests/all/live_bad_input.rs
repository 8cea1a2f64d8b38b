//! Bad input over real DDS: the node refuses each bad sample, reports it, and loses no good sample.

use crate::domain::Domain;
use crate::live_support::wait_for_discovery;
use crate::turn::turn;
use crate::wait::comes_true;
use mr_damper_base::clock::system_now;
use mr_damper_model::pipeline::{Event, Mode, Reasons, Refused, Validity};
use mr_damper_model::sample::{Channel, Stamp};
use mr_damper_msgs::{CoilCurrent, Displacement, Force};
use mr_damper_node::estimation::wire::header;
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::participant::{Output, Ros};
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use ros2_client::NodeOptions;
use std::time::{Duration, Instant};

const PERIOD: Duration = Duration::from_millis(2);

/// A peer of a node on `domain_id`, and the node's events.
struct TestNode {
    config: Config,
    ros: Ros,
    displacement: Output<Displacement>,
    current: Output<CoilCurrent>,
    force: Output<Force>,
}

impl TestNode {
    fn new(domain_id: i64) -> Self {
        let mut config = Config { domain_id, align_wait_s: 0.3, ..Config::default() };
        config.set("model", &Value::Text("thesis/fuzzy-tanh/rp3-cs".into())).expect("a text");
        let mut ros =
            Ros::start(&config, &RosArgs::default(), NodeOptions::new(), "peer").expect("a peer starts");
        let displacement = ros.publish("/displacement").expect("a topic");
        let current = ros.publish("/coil_current").expect("a topic");
        let force = ros.publish("/measured_force").expect("a topic");
        Self { config, ros, displacement, current, force }
    }

    fn send_displacement(&self, stamp: Stamp, displacement: f64) {
        let message = Displacement { header: header(stamp, ""), displacement, variance: 0.0 };
        self.displacement.publish(message).expect("sent");
    }

    fn send_current(&self, stamp: Stamp, current: f64) {
        self.current
            .publish(CoilCurrent { header: header(stamp, ""), current, variance: 0.0 })
            .expect("sent");
    }

    fn send_force(&self, stamp: Stamp, force: f64) {
        self.force.publish(Force { header: header(stamp, ""), force, variance: 0.0 }).expect("sent");
    }

    /// Runs the service, calls `send` for samples 0 to `count` with their stamps, and returns all events once `count`
    /// estimates have come.
    fn events(self, count: usize, send: impl Fn(&Self, usize, Stamp)) -> Vec<Event> {
        self.events_of(count, count, send)
    }

    /// Like [`Self::events`], but returns once `wanted` estimates have come.
    fn events_of(mut self, count: usize, wanted: usize, send: impl Fn(&Self, usize, Stamp)) -> Vec<Event> {
        let (service, receiver) =
            DamperNode::start(&self.config, &RosArgs::default(), true).expect("the service starts");
        let mut receiver = receiver.expect("a receiver was requested");
        let publishers = [self.displacement.guid(), self.current.guid(), self.force.guid()];
        wait_for_discovery(&mut self.ros, &publishers, &mut receiver);
        let (start, first) = (Instant::now(), system_now());
        for k in 0..count {
            let since = PERIOD * u32::try_from(k).expect("few samples");
            std::thread::sleep((start + since).saturating_duration_since(Instant::now()));
            send(&self, k, first.shifted(i64::try_from(since.as_nanos()).expect("some seconds")));
        }
        let (mut events, mut estimates) = (Vec::new(), 0);
        // If some do not come, the test's assertion reports how many came.
        let _ = comes_true(|| {
            while let Ok(event) = receiver.events.pop() {
                estimates += usize::from(matches!(event, Event::Estimate(_)));
                events.push(event);
            }
            estimates >= wanted
        });
        service.stop().expect("no thread panicked");
        let Self { ros, displacement, current, force, .. } = self;
        drop((displacement, current, force));
        ros.stop();
        events
    }
}

#[test]
fn each_bad_sample_is_refused_and_flagged_and_no_good_one_is_lost() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let events = TestNode::new(domain.id()).events(1000, |under_test, k, stamp| {
        let t = k as f64 * PERIOD.as_secs_f64();
        under_test.send_current(stamp, 0.8);
        if k < 700 {
            under_test.send_force(stamp, 400.0 * (6.0 * t).cos());
        }
        under_test.send_displacement(stamp, 0.01 * (6.0 * t).sin());
        match k {
            100 => under_test.send_displacement(stamp.shifted(1_000_000), f64::NAN),
            150 => under_test.send_current(stamp.shifted(1_000_000), f64::INFINITY),
            200 => under_test.send_force(stamp.shifted(1_000_000), f64::NAN),
            250 => under_test.send_displacement(stamp.shifted(-10_000_000_000), 0.0),
            // Ten seconds back: a force only a few milliseconds back may be sorted into order within its batch.
            300 => under_test.send_force(stamp.shifted(-10_000_000_000), 0.0),
            _ => {}
        }
    });
    let refused: Vec<_> = events
        .iter()
        .filter_map(|event| match event {
            Event::Refusal(refusal) => Some((refusal.sample.reading.channel(), refusal.why)),
            _ => None,
        })
        .collect();
    assert_eq!(
        refused,
        [
            (Channel::Displacement, Refused::NotFinite),
            (Channel::Drive, Refused::NotFinite),
            (Channel::Force, Refused::NotFinite),
            (Channel::Displacement, Refused::TimeBack),
            (Channel::Force, Refused::TimeBack),
        ]
    );
    let estimates: Vec<_> = events
        .iter()
        .filter_map(|event| if let Event::Estimate(estimate) = event { Some(estimate) } else { None })
        .collect();
    assert_eq!(estimates.len(), 1000, "one for each good displacement");
    let (first, others) = estimates.split_first().expect("there are some");
    assert!(first.reasons.has(Reasons::SETTLING), "the velocity needs two displacements: {first:?}");
    assert!(
        others.iter().all(|estimate| estimate.force.get().abs() < 5000.0),
        "every other estimate has a force"
    );
    let flagged = estimates.iter().filter(|estimate| estimate.reasons.has(Reasons::INPUT_REFUSED));
    assert_eq!(flagged.count(), refused.len(), "the estimate after a refusal is flagged");
    let modes: Vec<_> = events
        .iter()
        .filter_map(|event| if let Event::Transition(t) = event { Some(t.to) } else { None })
        .collect();
    assert!(
        modes.ends_with(&[Mode::Arx, Mode::ArxCoast, Mode::Model]),
        "modes after the force stops: {modes:?}"
    );
}

#[test]
fn without_any_current_every_estimate_is_invalid_and_says_why() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let events = TestNode::new(domain.id())
        .events(200, |under_test, k, stamp| under_test.send_displacement(stamp, 1e-5 * k as f64));
    let estimates: Vec<_> = events
        .iter()
        .filter_map(|event| if let Event::Estimate(estimate) = event { Some(estimate) } else { None })
        .collect();
    assert_eq!(estimates.len(), 200);
    for estimate in estimates {
        assert!(estimate.force.get().is_nan(), "the force is NaN and not a plausible number");
        assert_eq!((estimate.validity, estimate.mode), (Validity::Invalid, Mode::Fault));
        assert!(estimate.reasons.has(Reasons::DRIVE_MISSING));
    }
}

#[test]
fn a_clock_jump_of_hours_is_flagged_and_costs_two_samples_each_way() {
    const HOURS_NS: i64 = 2 * 3_600 * 1_000_000_000;
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    // Correct, two hours ahead, two hours behind, correct again.
    let jumped = |k: usize| [0, HOURS_NS, -HOURS_NS, 0][k / 300];
    let events = TestNode::new(domain.id()).events_of(1200, 1196, |under_test, k, stamp| {
        let (t, stamp) = (k as f64 * PERIOD.as_secs_f64(), stamp.shifted(jumped(k)));
        under_test.send_current(stamp, 0.8);
        under_test.send_force(stamp, 400.0 * (6.0 * t).cos());
        under_test.send_displacement(stamp, 0.01 * (6.0 * t).sin());
    });
    let refused = events.iter().filter_map(|event| match event {
        Event::Refusal(refusal) => Some((refusal.sample.reading.channel(), refusal.why)),
        _ => None,
    });
    let refused: Vec<_> = refused.filter(|(channel, _)| *channel == Channel::Displacement).collect();
    let expected = [Refused::Ahead, Refused::Ahead, Refused::TimeBack, Refused::TimeBack];
    assert_eq!(
        refused,
        expected.map(|why| (Channel::Displacement, why)),
        "the third sample after each jump is accepted"
    );
    let now = system_now();
    let (mut live, mut late) = (0, 0);
    for event in &events {
        let Event::Estimate(estimate) = event else { continue };
        assert_eq!(estimate.force.get().is_nan(), estimate.validity == Validity::Invalid, "{estimate:?}");
        if estimate.reasons.has(Reasons::DISPLACEMENT_LOST) {
            assert_ne!(estimate.validity, Validity::Valid, "{estimate:?}");
            continue;
        }
        live += 1;
        let behind_s = now.since(estimate.stamp).get();
        late += usize::from(behind_s > 3600.0);
        assert!(
            behind_s < 3600.0 || estimate.reasons.has(Reasons::LATE),
            "an estimate hours behind is flagged LATE: {estimate:?}"
        );
    }
    assert_eq!((live, late), (1196, 298));
    let last =
        events.iter().rev().find_map(|e| if let Event::Estimate(last) = e { Some(last) } else { None });
    assert!(last.is_some_and(|last| last.force.get().is_finite()), "estimates continue: {last:?}");
}
