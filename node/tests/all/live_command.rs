//! Current commands of the real service, over real DDS: a supervisor requests forces and gets currents, also after it stops
//! sending.

use crate::domain::Domain;
use crate::live_support::offline;
use crate::turn::turn;
use mr_damper_model::inverse::LimitedBy;
use mr_damper_model::pipeline::{Event, StampedCommand};
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::{Run, Stamp, Trace};
use mr_damper_msgs::{CurrentCommand, Force, ForceEstimate, LimitedBy as OnWire, Message};
use mr_damper_node::estimation::wire::header;
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::participant::Ros;
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use mr_damper_node::settings::interrupt::Interrupt;
use mr_damper_node::streams::player::{PlaybackOptions, Played, Player};
use ros2_client::{NodeOptions, Subscription};
use std::time::{Duration, Instant};

/// Number of samples between two requests.
const EVERY: usize = 64;

/// A run of the virtual rig that requests 80 % of the measured force, eight times a second.
fn run() -> Run {
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(4.0);
    let run = record(&experiment, &Plant::default(), &Channels::default(), 7);
    let force = run.force_n.as_ref().expect("a force");
    let at = |k: usize| (force.stamps[k], 0.8 * force.values[k]);
    let (stamps, values) = (0..force.len()).step_by(EVERY).map(at).unzip();
    Run { force_request_n: Some(Trace { stamps, values }), ..run }
}

fn config(domain: i64) -> Config {
    let mut config = Config { domain_id: domain, align_wait_s: 0.5, deadline_s: 10.0, ..Config::default() };
    for (name, value) in [
        ("model", Value::Text("thesis/fuzzy-tanh/rp3-cs".into())),
        ("request_timeout_s", Value::Double(0.2)),
        ("current.safe_a", Value::Double(0.25)),
        ("current.safe_after_s", Value::Double(0.3)),
    ] {
        config.set(name, &value).expect("in range");
    }
    config
}

fn commanded(event: Event) -> Option<StampedCommand> {
    match event {
        Event::Command(commanded) => Some(commanded),
        _ => None,
    }
}

fn drain<M: Message>(subscription: &Subscription<M>, into: &mut Vec<M>) {
    while let Some((message, _)) = subscription.take().expect("readable") {
        into.push(message);
    }
}

#[test]
fn requested_forces_give_currents_and_silence_gives_the_safe_current() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let (config, args, run) = (config(domain.id()), RosArgs::default(), run());
    let (service, _) = DamperNode::start(&config, &args, false).expect("the service starts");
    let mut ros = Ros::start(&config, &args, NodeOptions::new(), "supervisor").expect("a peer starts");
    let commands: Subscription<CurrentCommand> = ros.subscribe("/current_command").expect("a topic");
    let estimates: Subscription<ForceEstimate> = ros.subscribe("/force_estimate").expect("a topic");
    let interrupt = Interrupt::manual();
    let player = Player::start(&config, &args, false).expect("the player starts");
    assert!(player.wait_for_listener(Duration::from_secs(20), &interrupt), "the node listens");

    let (mut heard, mut estimated) = (Vec::new(), Vec::new());
    std::thread::scope(|scope| {
        let playing = scope.spawn(|| {
            player.play(&run, &PlaybackOptions::default(), &mut Played::default(), &interrupt, None, &|_| {})
        });
        // Listens for one more second after the run, without requests.
        let mut end: Option<Instant> = None;
        while end.is_none_or(|end| Instant::now() < end) {
            drain(&commands, &mut heard);
            drain(&estimates, &mut estimated);
            if playing.is_finished() {
                end.get_or_insert_with(|| Instant::now() + Duration::from_secs(1));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    });
    let expected = offline(&config, &run, commanded);
    let samples = run.displacement_m.len();
    assert_eq!(expected.len(), samples, "the first request comes with the first displacement");
    let (live, silent) = heard.split_at(samples.min(heard.len()));
    assert_eq!(live.len(), samples, "one command per displacement");
    let first = live[0].header.stamp.as_nanos();
    let shift = |stamp: Stamp| stamp.nanos() - expected[0].stamp.nanos() + first;
    let (mut same, mut asked_later) = (0, 0);
    for (message, commanded) in live.iter().zip(&expected) {
        assert_eq!(message.header.stamp.as_nanos(), shift(commanded.stamp));
        assert!((0.0..=2.5).contains(&message.current));
        let command = &commanded.command;
        let alike = |ours: f64, theirs: f64| ours.to_bits() == theirs.to_bits();
        if alike(message.force_requested, command.requested.get())
            && alike(message.current, command.current.get())
        {
            same += 1;
            assert_eq!(message.limited_by, command.limited_by as u8);
            assert_eq!(message.achievable_max.to_bits(), command.achievable[1].get().to_bits());
        } else {
            // The node does not delay a displacement until a request arrives, so a request may come after its displacement.
            asked_later += 1;
        }
    }
    println!(
        "{samples} commands: {same} bit-identical to the offline ones, {asked_later} with another request"
    );
    assert!(same > samples * 9 / 10, "{same} of {samples}");
    assert!(live.iter().filter(|m| m.limited_by == u8::from(OnWire::None)).count() > samples / 4);

    // Without requests, the current has reached the safe current by now.
    assert!(silent.len() > 10, "{} commands in a second of silence", silent.len());
    assert!(silent.iter().all(|m| m.limited_by == LimitedBy::Safe as u8));
    assert_eq!(silent.last().map(|m| m.current), Some(0.25));

    // Estimates have an uncertainty band, which is marked as not calibrated.
    let sound: Vec<_> = estimated.iter().filter(|e| e.force.is_finite() && e.std_dev.is_finite()).collect();
    assert!(sound.len() > samples * 9 / 10);
    assert!(sound.iter().all(|e| e.band_low < e.force && e.force < e.band_high && !e.band_calibrated));
    player.stop();
    drop((commands, estimates));
    ros.stop();
    service.stop().expect("no thread panicked");
}

/// Invalid and impossible requests: each is answered, and estimates continue.
#[test]
fn bad_requests_are_answered_and_harm_nothing() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let (config, args) = (config(domain.id()), RosArgs::default());
    let (service, _) = DamperNode::start(&config, &args, false).expect("the service starts");
    let mut ros = Ros::start(&config, &args, NodeOptions::new(), "supervisor").expect("a peer starts");
    let commands: Subscription<CurrentCommand> = ros.subscribe("/current_command").expect("a topic");
    let request = ros.publish::<Force>("/force_request").expect("a topic");
    let interrupt = Interrupt::manual();
    let player = Player::start(&config, &args, false).expect("the player starts");
    assert!(player.wait_for_listener(Duration::from_secs(20), &interrupt), "the node listens");
    // The run holds no requests: the supervisor sends them.
    let run = Run { force_request_n: None, ..run() };
    let asked = [
        ("NaN", f64::NAN),
        ("too large", 9e4),
        ("beyond any load cell", 1e7),
        ("too large the other way", -9e4),
    ];
    let answers = std::thread::scope(|scope| {
        scope.spawn(|| {
            player.play(&run, &PlaybackOptions::default(), &mut Played::default(), &interrupt, None, &|_| {})
        });
        asked.map(|(what, force)| {
            let begin = Instant::now();
            let mut heard = Vec::new();
            while begin.elapsed() < Duration::from_millis(700) {
                let stamp = mr_damper_base::clock::system_now();
                request
                    .publish(Force { header: header(stamp, ""), force, variance: 0.0 })
                    .expect("published");
                std::thread::sleep(Duration::from_millis(10));
                drain(&commands, &mut heard);
            }
            (what, heard)
        })
    });
    for (what, heard) in &answers {
        // The first third may still answer the previous request.
        let settled = &heard[heard.len() / 3..];
        let mut why: Vec<u8> = settled.iter().map(|m| m.limited_by).collect();
        why.sort_unstable();
        why.dedup();
        println!("{what}: {} commands, limited by {why:?}", heard.len());
        assert!(settled.iter().all(|m| (0.0..=2.5).contains(&m.current)));
        match *what {
            "NaN" | "beyond any load cell" => {
                // Neither value counts as a request, and no earlier request is valid any more: the safe current is commanded.
                assert!(why.iter().all(|by| *by == u8::from(OnWire::Safe)), "{why:?}");
            }
            _ => {
                let of = [OnWire::CurrentMax, OnWire::Passivity, OnWire::CurrentMin].map(u8::from);
                assert!(!why.is_empty() && why.iter().all(|by| of.contains(by)), "{why:?}");
                assert!(settled.iter().all(|m| !m.achievable));
            }
        }
    }
    player.stop();
    drop((commands, request));
    ros.stop();
    service.stop().expect("no thread panicked");
}
