//! Zenoh clients in Python, with the ready configurations of `launch-configs/zenoh`.

mod rmw;

use crate::interop_support::gate::{self, Outcome, interop, interop_alone};
use crate::interop_support::json::{count, found, number, text, texts, truth};
use crate::interop_support::process::Program;
use crate::interop_support::{Distro, Lab, NODE, PRESET, ZENOH_ENDPOINT};
use crate::{PEER, SHUTDOWN};
use std::path::{Path, PathBuf};

const PASSWORD: &str = "of the four";

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn zenoh_commands_with_a_password() {
    interop("zenoh commands", |lab| {
        let users = lab.folder().join("users.txt");
        std::fs::write(&users, format!("supervisor:{PASSWORD}\n")).expect("room in the temporary directory");
        let settings = std::fs::read_to_string(ready("password.json5")).expect("it is in the repository");
        let settings = settings.replace("\"users.txt\"", &format!("{:?}", users.to_str().expect("UTF-8")));
        let file = lab.folder().join("password.json5");
        std::fs::write(&file, settings).expect("room in the temporary directory");
        let config = format!("zenoh.config:={}", file.display());
        let listen = format!("zenoh.listen:=['{ZENOH_ENDPOINT}']");
        let commands = "zenoh.commands:=[force_request, load_model, set_mode]";
        let _node = lab.node(PRESET, &["-p", &config, "-p", &listen, "-p", commands]);
        let damper = NODE.trim_start_matches('/');
        let arguments = [ZENOH_ENDPOINT, damper, "supervisor", PASSWORD];
        let saw = lab.peer("zenoh_supervisor.py", &arguments).json(PEER);

        for name in ["set_mode", "load_model", "force_request"] {
            assert!(truth(&saw, &format!("/{name}/obeyed")), "{name}: {saw:#}");
        }
        assert!(text(&saw, "/load_model/message").contains("rp2-cs"), "{saw:#}");
        for (name, word) in
            [("set_mode_again", "seq"), ("unknown_mode", "turbo"), ("any_file", "zenoh.model_dir")]
        {
            assert!(text(&saw, &format!("/{name}/error")).contains(word), "{name}: {saw:#}");
        }
        assert_eq!((count(&saw, "/commands/obeyed"), count(&saw, "/commands/refused")), (3, 4), "{saw:#}");
        assert!(text(&saw, "/commands/last_refusal").contains("much"), "{saw:#}");
        assert!(found(&saw, "/with_a_wrong_password").is_null(), "{saw:#}");
        assert!(texts(&saw, "/last").iter().all(|key| key.contains("/state/")), "{saw:#}");
        Outcome::Passed(
            "3 commands obeyed, 4 refused with a reason, no data with a wrong password".to_owned(),
        )
    });
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn the_python_example_prints_what_it_receives() {
    interop("zenoh example in Python", |lab| {
        // The example starts before the node, and waits.
        let mut example = lab.peer("../../node/examples/zenoh_estimates.py", &[ZENOH_ENDPOINT, "20"]);
        std::thread::sleep(std::time::Duration::from_secs(1));
        assert!(example.is_running(), "the example did not wait for the node");
        let listen = format!("zenoh.listen:=['{ZENOH_ENDPOINT}']");
        let _node = lab.node(PRESET, &["-p", &listen]);
        let sender = lab.ros(Distro::Jazzy, "ros_peer.py", &["--node", NODE, "--seconds", "8"]);
        let text = example.output(PEER);
        let _ = sender.json(PEER);
        let begins = format!("mr_damper{NODE}/web/force_estimate ");
        assert_eq!(text.lines().count(), 20, "{text}");
        assert!(text.lines().all(|line| line.starts_with(&begins) && line.contains(" N ")), "{text}");
        Outcome::Passed("20 lines".to_owned())
    });
}

/// A file of launch-configs/zenoh.
fn ready(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../launch-configs/zenoh").join(name)
}

/// A router with a storage, with the ready configuration, listening on [`ZENOH_ENDPOINT`].
fn storing_router(lab: &Lab) -> Result<Program, String> {
    let program = gate::optional_environment("router")?.join("fleet-router");
    Ok(lab.start_with("fleet-router", &program, &[ready("storage.json5").to_str().expect("UTF-8")], &[]))
}

#[test]
#[ignore = "needs the router of tests/interop/setup.sh router"]
fn a_routers_storage_has_the_last_values_of_a_stopped_vehicle() {
    interop("zenoh storage", |lab| {
        let _router = match storing_router(lab) {
            Ok(router) => router,
            Err(why) => return Outcome::Missing(why),
        };
        let config = format!("zenoh.config:={}", ready("client.json5").display());
        let mut node = lab.node(PRESET, &["-r", "__ns:=/truck/front_left", "-p", &config]);
        let mut reader = lab.peer("zenoh_storage.py", &[ZENOH_ENDPOINT, "truck/front_left"]);
        assert_eq!(text(&reader.json_line(PEER), "/event"), "ready");
        let arguments = ["--node", "/truck/front_left/mr_damper", "--seconds", "4"];
        let _ = lab.ros(Distro::Jazzy, "ros_peer.py", &arguments).json(PEER);
        // The sender may take any time to leave: the node is ended once it has reported that its inputs are gone.
        assert_eq!(text(&reader.json_line(PEER), "/event"), "given up");
        node.signal("INT");
        assert_eq!(node.wait(SHUTDOWN).code(), Some(0));
        let saw = reader.json(PEER);

        assert!(truth(&saw, "/gone"), "the liveliness token disappeared: {saw:#}");
        let (heard, stored) = (found(&saw, "/heard"), found(&saw, "/stored"));
        let keys = heard.as_object().map_or(0, serde_json::Map::len);
        assert!(keys >= 4, "{saw:#}");
        // No old force may be found in the storage.
        let last = &heard["mr_damper/truck/front_left/web/force_estimate"];
        assert!(last["validity"] == "INVALID" && last["force_n"].is_null(), "{saw:#}");
        assert_eq!(stored, heard, "the storage has the last value of each key");
        Outcome::Passed(format!(
            "{keys} keys, each with its last value, from the router after the vehicle stopped"
        ))
    });
}

#[test]
#[ignore = "needs the router of tests/interop/setup.sh router"]
fn a_small_fleet_loses_nothing_through_a_router() {
    interop_alone("zenoh fleet", |lab| {
        let mut router = match storing_router(lab) {
            Ok(router) => router,
            Err(why) => return Outcome::Missing(why),
        };
        let listen = "zenoh.listen:=['tcp/127.0.0.1:7448']";
        let _node = lab.node(PRESET, &["-p", listen]);
        let sender = lab.ros(Distro::Jazzy, "ros_peer.py", &["--node", NODE, "--seconds", "12"]);
        let process = router.id().to_string();
        let arguments =
            ["--damper", "tcp/127.0.0.1:7448", "--router", ZENOH_ENDPOINT, "--router-pid", &process];
        let fleet = ["--vehicles", "10", "--dampers", "4", "--record-s", "2", "--seconds", "4"];
        let program = gate::example("zenoh_fleet");
        let told =
            lab.start_with("zenoh_fleet", &program, &[arguments.as_slice(), &fleet].concat(), &[]).json(PEER);
        let _ = sender.json(PEER);
        router.signal("INT");
        assert_eq!(router.wait(PEER).code(), Some(0));

        assert_eq!((count(&told, "/dampers"), count(&told, "/lost")), (40, 0), "{told:#}");
        let rate = number(&told, "/sent_per_s");
        assert!(rate > 40.0 * 20.0, "each damper sends at least 20 messages per second: {told:#}");
        Outcome::Passed(format!(
            "{rate:.0} messages per second of 40 dampers, none lost, {:.0} us of the router's processor time for each",
            number(&told, "/router_us_per_message")
        ))
    });
}
