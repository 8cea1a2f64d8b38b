//! Two dampers in one process: one gets invalid data, and the other's estimates are bit-identical to a run without that
//! data.

use crate::domain::Domain;
use crate::live_support::{Ended, offline};
use crate::turn::turn;
use crate::wait::comes_true;
use mr_damper_base::clock::system_now;
use mr_damper_model::pipeline::Event;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::Run;
use mr_damper_msgs::{CoilCurrent, CurrentCommand, Displacement, Force, ForceEstimate};
use mr_damper_node::estimation::wire::header;
use mr_damper_node::nodes::fleet::Fleet;
use mr_damper_node::ros2::participant::Ros;
use mr_damper_node::settings::config::{RosArgs, dampers};
use mr_damper_node::settings::interrupt::Interrupt;
use mr_damper_node::streams::player::{PlaybackOptions, Played, Player};
use ros2_client::{NodeOptions, Subscription};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

fn vehicle(dir: &std::path::Path, domain: i64) -> std::path::PathBuf {
    let path = dir.join("vehicle.toml");
    let text = format!(
        "dampers = [\"left\", \"right\"]\ndomain_id = {domain}\nalign_wait_s = 0.5\n\
         model = \"thesis/fuzzy-tanh/rp3-cs\"\nlaw = \"fixed\"\n\
         [left.fixed]\ncurrent_a = 0.5\n\
         [right]\nmodel = \"thesis/fuzzy-tanh/rp1-cs\"\n[right.fixed]\ncurrent_a = 1.5\n"
    );
    std::fs::write(&path, text).expect("written");
    path
}

fn run() -> Run {
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(4.0);
    record(&experiment, &Plant::default(), &Channels::default(), 11)
}

fn estimated(event: Event) -> Option<u64> {
    match event {
        Event::Estimate(estimate) => Some(estimate.force.get().to_bits()),
        _ => None,
    }
}

#[test]
fn invalid_data_of_one_damper_never_affects_the_other() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = tempfile::tempdir().expect("a directory");
    let all =
        dampers(Some(&vehicle(dir.path(), domain.id())), &RosArgs::default(), &[]).expect("a good file");
    let [left, right] = all.as_slice() else { panic!("two dampers") };
    let fleet = Fleet::start(&all).expect("both start");
    assert_eq!(fleet.services().map(|(name, _)| name).collect::<Vec<_>>(), ["left", "right"]);

    let mut ros =
        Ros::start(&left.config, &RosArgs::default(), NodeOptions::new(), "peer").expect("a peer starts");
    let estimates: Subscription<ForceEstimate> = ros.subscribe("/left/force_estimate").expect("a topic");
    let commands: [Subscription<CurrentCommand>; 2] =
        ["/left/current_command", "/right/current_command"].map(|name| ros.subscribe(name).expect("a topic"));
    let of_right: Subscription<ForceEstimate> = ros.subscribe("/right/force_estimate").expect("a topic");
    let displacement = ros.publish::<Displacement>("/right/displacement").expect("a topic");
    let current = ros.publish::<CoilCurrent>("/right/coil_current").expect("a topic");
    let force = ros.publish::<Force>("/right/measured_force").expect("a topic");

    let (interrupt, run) = (Interrupt::manual(), run());
    let player = Player::start(&left.config, &left.args, false).expect("the player starts");
    assert!(player.wait_for_listener(Duration::from_secs(20), &interrupt), "the node listens");
    let expected = offline(&left.config, &run, estimated);
    let done = AtomicBool::new(false);
    let (mut heard, mut told, mut right_said) = (Vec::new(), [const { Vec::new() }; 2], 0_u32);
    std::thread::scope(|scope| {
        let ended = Ended(&done);
        scope.spawn(|| {
            player.play(&run, &PlaybackOptions::default(), &mut Played::default(), &interrupt, None, &|_| {})
        });
        scope.spawn(|| {
            let rubbish = [f64::NAN, 1e300, -1e300, f64::INFINITY, 0.0, 0.01, -0.01, 5.0];
            let mut k = 0_usize;
            while !done.load(Ordering::Relaxed) {
                // The stamps jump 20 s back and 3 s ahead.
                let stamp = system_now().shifted([0, -20_000_000_000, 3_000_000_000][k % 3]);
                let value = rubbish[(k * 5 + k / 7) % rubbish.len()];
                let sent = displacement
                    .publish(Displacement { header: header(stamp, ""), displacement: value, variance: 0.0 })
                    .is_ok()
                    & current
                        .publish(CoilCurrent { header: header(stamp, ""), current: value, variance: -1.0 })
                        .is_ok()
                    & force
                        .publish(Force { header: header(stamp, ""), force: value, variance: f64::NAN })
                        .is_ok();
                assert!(sent);
                k += 1;
                std::thread::sleep(Duration::from_millis(1));
            }
        });
        // If some do not come, the assertion below reports how many came.
        let _ = comes_true(|| {
            while let Some((message, _)) = estimates.take().expect("readable") {
                heard.push(message);
            }
            for (subscription, told) in commands.iter().zip(&mut told) {
                while let Some((message, _)) = subscription.take().expect("readable") {
                    told.push(message.current);
                }
            }
            while of_right.take().expect("readable").is_some() {
                right_said += 1;
            }
            heard.len() >= expected.len()
        });
        drop(ended);
    });
    let said: Vec<u64> = heard.iter().map(|message| message.force.to_bits()).collect();
    assert!(
        said.starts_with(&expected),
        "{} estimates, {} expected: some of them differ",
        said.len(),
        expected.len()
    );
    assert!(heard.iter().all(|message| message.model == "thesis/fuzzy-tanh/rp3-cs" || message.mode < 2));
    assert!(right_said > 100, "the damper with invalid data still answers: {right_said}");
    // Each damper has its own parameters. The first command has no time step in which the current could change, so the last
    // one is checked.
    assert_eq!(told.map(|told| told.last().copied()), [Some(0.5), Some(1.5)]);
    assert_ne!(left.config.model, right.config.model);
    assert_eq!(fleet.dead_thread(), None);
    player.stop();
    drop((estimates, commands, of_right, displacement, current, force));
    ros.stop();
    fleet.stop().expect("no thread panicked");
}

#[test]
fn a_damper_that_cannot_start_is_named_and_the_others_stop() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = tempfile::tempdir().expect("a directory");
    let mut all =
        dampers(Some(&vehicle(dir.path(), domain.id())), &RosArgs::default(), &[]).expect("a good file");
    all[1].config.model = "thesis/fuzzy-tanh/rp9-cs".to_owned();
    let refused = Fleet::start(&all).err().expect("there is no such preset").to_string();
    assert!(refused.starts_with("damper right: ") && refused.contains("rp9-cs"), "{refused}");
}
