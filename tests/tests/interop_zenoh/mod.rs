//! Zenoh from Python, with the ready configurations of `launch-configs/zenoh`.

mod rmw;

use crate::PEER;
use crate::interop_support::gate::{Outcome, interop};
use crate::interop_support::json::{count, found, text, texts, truth};
use crate::interop_support::{Distro, NODE, PRESET, ZENOH_ENDPOINT};
use std::path::Path;

const PASSWORD: &str = "of the four";

#[test]
fn zenoh_commands_with_a_password() {
    interop("zenoh commands", |lab| {
        let users = lab.folder().join("users.txt");
        std::fs::write(&users, format!("supervisor:{PASSWORD}\n")).expect("room in the temporary directory");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../launch-configs/zenoh/password.json5");
        let ready = std::fs::read_to_string(source).expect("it is in the repository");
        let ready = ready.replace("\"users.txt\"", &format!("{:?}", users.to_str().expect("UTF-8")));
        let file = lab.folder().join("password.json5");
        std::fs::write(&file, ready).expect("room in the temporary directory");
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
            "3 commands obeyed, 4 refused with their reason, a wrong password hears nothing".to_owned(),
        )
    });
}

#[test]
fn the_example_in_python_prints_what_it_hears() {
    interop("zenoh example in Python", |lab| {
        let listen = format!("zenoh.listen:=['{ZENOH_ENDPOINT}']");
        let _node = lab.node(PRESET, &["-p", &listen]);
        let sender = lab.ros(Distro::Jazzy, "ros_peer.py", &["--node", NODE, "--seconds", "6"]);
        let text = lab.peer("../../node/examples/zenoh_estimates.py", &[ZENOH_ENDPOINT, "20"]).output(PEER);
        let _ = sender.json(PEER);
        let begins = format!("mr_damper{NODE}/web/force_estimate ");
        assert_eq!(text.lines().count(), 20, "{text}");
        assert!(text.lines().all(|line| line.starts_with(&begins) && line.contains(" N ")), "{text}");
        Outcome::Passed("20 lines".to_owned())
    });
}
