//! Commands from Zenoh to the real service: obeyed once, in time, and only from authorised users.

use crate::domain::Domain;
use crate::turn::turn;
use crate::wait::{PATIENCE, until};
use crate::zenoh_support::keys::{Keys, with_password};
use crate::zenoh_support::sessions::{endpoint, session};
use mr_damper_base::clock::system_now;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_msgs::CurrentCommand;
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::participant::Ros;
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use mr_damper_node::settings::interrupt::Interrupt;
use mr_damper_node::streams::player::{PlaybackOptions, Played, Player};
use ros2_client::{NodeOptions, Subscription};
use serde_json::{Value as Json, json};
use std::time::Duration;
use zenoh::{Session, Wait};

fn config(domain: &Domain, keys: &Keys, endpoint: &str) -> Config {
    let mut config = Config { domain_id: domain.id(), ..Config::default() };
    let file = keys.ready("password.json5", endpoint).file.expect("a file");
    let commands = ["force_request", "load_model", "set_mode"].map(str::to_owned).to_vec();
    for (name, value) in [
        ("model", Value::Text("thesis/fuzzy-tanh/rp3-cs".into())),
        ("zenoh.config", Value::Text(file.display().to_string())),
        ("zenoh.listen", Value::TextList(vec![endpoint.to_owned()])),
        ("zenoh.commands", Value::TextList(commands)),
    ] {
        config.set(name, &value).expect("in range");
    }
    config
}

/// A command with `seq` whose deadline is two seconds from now.
fn command(seq: u64, field: &str, value: impl Into<Json>) -> Vec<u8> {
    let deadline_ns = system_now().nanos() + 2_000_000_000;
    let mut command = json!({ "seq": seq, "deadline_ns": deadline_ns });
    command[field] = value.into();
    serde_json::to_vec(&command).expect("JSON")
}

/// Sends a command; returns the node's answer (message or error), or `None` without an answer.
fn tell(session: &Session, name: &str, payload: &[u8]) -> Option<Result<String, String>> {
    let key = format!("mr_damper/mr_damper/cmd/{name}");
    let replies =
        session.get(key).payload(payload).timeout(Duration::from_secs(2)).wait().expect("a selector");
    let text = |bytes: &[u8], field: &str| {
        let answer: Json = serde_json::from_slice(bytes).expect("answers are JSON");
        answer[field].as_str().expect("a text").to_owned()
    };
    replies.recv().ok().map(|reply| match reply.into_result() {
        Ok(sample) => Ok(text(&sample.payload().to_bytes(), "message")),
        Err(error) => Err(text(&error.payload().to_bytes(), "error")),
    })
}

fn commands(session: &Session) -> Json {
    until("the status", || {
        let replies = session.get("mr_damper/mr_damper/status").wait().expect("a selector");
        let sample = replies.recv().ok()?.into_result().ok()?;
        let status: Json = serde_json::from_slice(&sample.payload().to_bytes()).expect("JSON");
        Some(status["commands"].clone())
    })
}

#[test]
fn only_the_supervisor_commands() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let (keys, endpoint) = (Keys::new(), endpoint());
    let (config, args) = (config(&domain, &keys, &endpoint), RosArgs::default());
    let (service, _) = DamperNode::start(&config, &args, false).expect("the service starts");
    let mut ros = Ros::start(&config, &args, NodeOptions::new(), "listener").expect("a peer starts");
    let currents: Subscription<CurrentCommand> = ros.subscribe("/current_command").expect("a topic");
    let supervisor = with_password(&endpoint, "supervisor", "of the four");
    let reader = with_password(&endpoint, "reader", "of the news");
    let nobody = session(&endpoint, &[]);
    let said = until("an answer", || tell(&supervisor, "set_mode", &command(1, "mode", "auto")));
    assert_eq!(said.as_deref(), Ok("the mode is auto"));
    assert_eq!(commands(&reader)["obeyed"], 1);

    // Spoofed commands: from a user who may only read, from a peer without a password, and through
    // wildcard keys.
    let spoof = command(1000, "mode", "fault");
    for (who, session) in [("reader", &reader), ("nobody", &nobody)] {
        assert_eq!(tell(session, "set_mode", &spoof), None, "{who}");
        session.put("mr_damper/mr_damper/cmd/set_mode", spoof.clone()).wait().expect("it is sent");
        session.put("mr_damper/**", spoof.clone()).wait().expect("it is sent");
    }
    assert_eq!(tell(&supervisor, "*", &spoof), None, "wildcard keys are refused for every user");
    let counted = until("the wildcard is counted", || {
        let counted = commands(&reader);
        (counted["refused"].as_u64() > Some(0)).then_some(counted)
    });
    assert_eq!(counted["obeyed"], 1, "{counted}");
    let why = counted["last_refusal"].as_str().expect("a text");
    assert!(why.contains("it was sent to mr_damper/mr_damper/cmd/*"), "{why}");
    assert_eq!(service.control().config().settings.only_mode, None);

    // The supervisor's own commands are checked as well.
    let overheard = command(2, "mode", "model");
    assert_eq!(tell(&supervisor, "set_mode", &overheard), Some(Ok("the mode is model".to_owned())));
    for (name, payload, word) in [
        ("set_mode", overheard, "must be above 2"),
        ("set_mode", command(3, "mode", "hold"), "limited time"),
        ("set_mode", command(4, "mode", "turbo"), "auto, arx, model, fault"),
        ("load_model", command(1, "model", "/etc/passwd"), "zenoh.model_dir"),
        ("load_model", command(2, "model", "thesis/none"), "thesis/none"),
        ("force_request", command(1, "force_lbf", 3.0), "force_lbf"),
        ("force_request", br#"{"seq":1,"deadline_ns":1,"force_n":5}"#.to_vec(), "deadline"),
    ] {
        let refused = tell(&supervisor, name, &payload).expect("an answer").expect_err("refused");
        assert!(refused.contains(word), "{refused}");
    }
    let loaded = tell(&supervisor, "load_model", &command(3, "model", "thesis/fuzzy-tanh/rp2-cs"));
    assert!(matches!(&loaded, Some(Ok(said)) if said.contains("rp2-cs")), "{loaded:?}");

    // A force request is put as on the ROS topic, and takes effect with the next displacement.
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(3.0);
    let run = record(&experiment, &Plant::default(), &Channels::default(), 7);
    let interrupt = Interrupt::manual();
    let player = Player::start(&config, &args, false).expect("the player starts");
    assert!(player.wait_for_listener(PATIENCE, &interrupt), "the node listens");
    let mut seq = 10;
    let asked = std::thread::scope(|scope| {
        let playing = scope.spawn(|| {
            player.play(&run, &PlaybackOptions::default(), &mut Played::default(), &interrupt, None, &|_| {})
        });
        let asked = until("a current for the force", || {
            seq += 1;
            let payload = command(seq, "force_n", 123.5);
            supervisor.put("mr_damper/mr_damper/cmd/force_request", payload).wait().expect("it is sent");
            std::iter::from_fn(|| currents.take().expect("readable"))
                .find(|(command, _)| command.force_requested == 123.5)
        });
        playing.join().expect("no panic");
        asked
    });
    assert!(asked.0.current >= 0.0, "{:?}", asked.0);
    player.stop();
    drop(currents);
    ros.stop();
    service.stop().expect("no thread panicked");
}

#[test]
fn commands_from_other_machines_need_access_control() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let mut config = Config { domain_id: domain.id(), ..Config::default() };
    for (name, value) in [
        ("model", Value::Text("thesis/fuzzy-tanh/rp3-cs".into())),
        ("zenoh.listen", Value::TextList(vec!["tcp/0.0.0.0:0".to_owned()])),
        ("zenoh.allow_non_loopback", Value::Bool(true)),
        ("zenoh.commands", Value::TextList(vec!["set_mode".to_owned()])),
    ] {
        config.set(name, &value).expect("in range");
    }
    let refused = DamperNode::start(&config, &RosArgs::default(), false).err().expect("refused").to_string();
    assert!(refused.contains("access_control") && refused.contains("tcp/0.0.0.0:0"), "{refused}");
    config.zenoh.listen = Vec::new();
    let refused = DamperNode::start(&config, &RosArgs::default(), false).err().expect("refused").to_string();
    assert!(refused.contains("Zenoh has no endpoint"), "{refused}");
    config.zenoh.listen = vec![endpoint()];
    config.zenoh.commands = vec!["self_destruct".to_owned()];
    let refused = DamperNode::start(&config, &RosArgs::default(), false).err().expect("refused").to_string();
    assert!(refused.contains("self_destruct") && refused.contains("force_request"), "{refused}");
}
