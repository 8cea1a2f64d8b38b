//! Values of effects while the real service runs, over real DDS: published on `effect_values`, reported on `/diagnostics`, and taken by the
//! running model if that is allowed.

use crate::domain::Domain;
use crate::live_support::lagging::{LAG_S, base, run, write};
use crate::turn::turn;
use crate::wait::wait_until;
use mr_damper_model::effect::{Effect, EffectModel, Effects};
use mr_damper_model::model::Model;
use mr_damper_msgs::EffectValue;
use mr_damper_msgs::standard::DiagnosticArray;
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::participant::Ros;
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use mr_damper_node::settings::interrupt::Interrupt;
use mr_damper_node::streams::player::{PlaybackOptions, Played, Player, Rate};
use ros2_client::NodeOptions;
use std::time::Duration;

/// The lag in the model that is loaded, s: a third too long.
const LOADED_S: f64 = 0.016;

#[test]
fn values_are_published_and_the_model_takes_them() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = tempfile::tempdir().expect("a directory");
    let path = dir.path().join("lag.toml");
    let lag = EffectModel::new(Effect::CoilLag, &[LOADED_S]).expect("a lag");
    write(&path, Model { effects: Effects::new(&[lag]).expect("one effect"), ..base() });
    let mut config = Config {
        model: path.display().to_string(),
        domain_id: domain.id(),
        use_sim_time: true,
        align_wait_s: 0.5,
        ..Config::default()
    };
    for (name, value) in [
        ("effects.track", Value::Bool(true)),
        ("effects.adapt", Value::Bool(true)),
        ("effects.window_s", Value::Double(48.0)),
        ("fleet.out", Value::Text(dir.path().display().to_string())),
    ] {
        config.set(name, &value).expect("in range");
    }
    let args = RosArgs::in_namespace("/corner");
    let (service, _) = DamperNode::start(&config, &args, false).expect("the service starts");
    let loaded_hash = service.control().models_names().hash;
    let mut peer = Ros::start(&config, &args, NodeOptions::new(), "peer").expect("a peer starts");
    let values = peer.subscribe::<EffectValue>("/corner/effect_values").expect("a topic");
    let statuses = peer.subscribe::<DiagnosticArray>("/diagnostics").expect("a topic");
    let player = Player::start(&config, &args, false).expect("the player starts");
    let interrupt = Interrupt::manual();
    assert!(player.wait_for_listener(Duration::from_secs(20), &interrupt), "the node listens");
    let options = PlaybackOptions { rate: Rate::Times(8.0), clock: true, ..PlaybackOptions::default() };
    player.play(&run(52.0, LAG_S, 2), &options, &mut Played::default(), &interrupt, None, &|_| {});

    let mut found: Vec<EffectValue> = Vec::new();
    wait_until("the values of a window", || {
        found.extend(values.take().expect("readable").map(|(value, _)| value));
        found.len() == 2
    });
    let [ratio, found] = &found[..] else { unreachable!("two values") };
    assert_eq!((&*ratio.effect, &*ratio.parameter, ratio.running), ("", "force_ratio", 1.0));
    assert!((ratio.value - 1.0).abs() < 0.1, "{ratio:?}");
    assert_eq!((&*found.effect, &*found.form, &*found.parameter), ("coil_lag", "one_tau", "tau_s"));
    assert_eq!(
        (&*found.header.frame_id, found.running, found.window, found.windows),
        ("corner", LOADED_S, 48.0, 1)
    );
    assert!(
        (found.value / LAG_S - 1.0).abs() < 0.1 && found.low < found.value && found.value < found.high,
        "{found:?}"
    );
    assert!(!found.changed, "one window shows no change");

    // The model has gone a third of the way. Its base is the loaded one, and its hash is not.
    let mut running = None;
    wait_until("the adapted model", || {
        running = service.control().models().map(|models| models.free);
        running.is_some_and(|model| model.effects.as_slice()[0].parameters()[0] != LOADED_S)
    });
    let adapted_s = running.expect("a model").effects.as_slice()[0].parameters()[0];
    let expected_s = LOADED_S + (found.value - LOADED_S) / 3.0;
    assert!((adapted_s - expected_s).abs() < 1e-9, "{adapted_s} s, {expected_s} s");
    assert_ne!(service.control().models_names().hash, loaded_hash);

    let mut status = None;
    wait_until("the status of the effects", || {
        let array = statuses.take().expect("readable");
        let mut all = array.into_iter().flat_map(|(array, _)| array.status);
        status = all.find(|status| status.name.ends_with(": effects") && !status.values.is_empty());
        status.is_some()
    });
    let status = status.expect("a status");
    assert_eq!((&*status.message, &*status.values[3].key), ("no value has changed", "coil_lag.tau_s"));
    player.stop();
    drop((values, statuses));
    peer.stop();
    service.stop().expect("no thread panicked");
    // The rows of the hour that has begun. A sample before the first simulated time is in an hour of its own.
    let rows = |table: &str| -> Vec<String> {
        let days = std::fs::read_dir(dir.path().join(table).join("damper=corner")).expect("a damper");
        let files = days.flat_map(|day| std::fs::read_dir(day.expect("a day").path()).expect("a folder"));
        let texts = files.map(|file| std::fs::read_to_string(file.expect("a file").path()).expect("a text"));
        texts.flat_map(|text| text.lines().skip(1).map(str::to_owned).collect::<Vec<_>>()).collect()
    };
    let count = |row: &String, at: usize| row.split(',').nth(at).and_then(|cell| cell.parse().ok());
    let estimates: Vec<u64> = rows("hours").iter().filter_map(|row| count(row, 2)).collect();
    let residuals: Vec<u64> = rows("residuals").iter().filter_map(|row| count(row, 6)).collect();
    assert!(estimates.iter().sum::<u64>() > 20_000, "{estimates:?}");
    assert!(residuals.len() > 5 && residuals.iter().sum::<u64>() > 20_000, "{residuals:?}");
    let values = rows("values");
    assert!(values.len() == 2 && values.iter().all(|row| row.ends_with(&loaded_hash)), "{values:?}");
}
