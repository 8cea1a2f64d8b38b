//! The Foxglove endpoint with the client and the decoder of a real viewer, and with another receiver of the same messages.

use crate::PEER;
use crate::interop_files::utf8;
use crate::interop_support::gate::{Outcome, environment, interop};
use crate::interop_support::json::{count, found, text};
use crate::interop_support::process::{Program, script};
use crate::interop_support::{Distro, Lab, PRESET};
use serde_json::Value;
use std::path::Path;
use std::time::Duration;

/// Seconds of the run that is compared.
const RUN_S: f64 = 12.0;
/// Topics that a node with a played run has messages on.
const WITH_MESSAGES: [&str; 6] =
    ["displacement", "coil_current", "measured_force", "force_estimate", "force_residual", "mode"];

/// A viewer without a screen.
struct Viewer(Program);

impl Viewer {
    /// Connects to the endpoint with `subprotocol` and keeps the payloads of `topic` in `file`.
    fn connect(lab: &Lab, subprotocol: &str, topic: &str, file: &Path, ask: &[&str]) -> Self {
        let packages = environment("viewer");
        let (peer, packages) = (script("viewer_peer.js"), format!("VIEWER_PACKAGES={}", utf8(&packages)));
        let arguments =
            [&packages, "node", utf8(&peer), "ws://127.0.0.1:8765", subprotocol, utf8(file), topic];
        let mut program =
            lab.start_commanded("viewer_peer.js", Path::new("env"), &[&arguments[..], ask].concat());
        assert_eq!(text(&program.json_line(PEER), "/connected"), subprotocol);
        Self(program)
    }

    /// Disconnects; returns what it saw.
    fn close(self) -> Value {
        let saw = self.0.close();
        assert_eq!(found(&saw, "/errors").as_array().map(Vec::len), Some(0), "{saw:#}");
        saw
    }
}

/// Checks that each message was decoded, and has the time of its header. Returns the number of messages.
fn all_decoded(saw: &Value, has_header_times: bool) -> u64 {
    let channels = found(saw, "/channels").as_object().expect("channels");
    for (topic, channel) in channels {
        assert_eq!(count(channel, "/rewritten"), count(channel, "/messages"), "{topic}: {channel:#}");
        if has_header_times {
            assert_eq!(count(channel, "/other_times"), 0, "{topic}: {channel:#}");
        }
    }
    channels.values().map(|channel| count(channel, "/messages")).sum()
}

/// Writes a run of the virtual rig.
fn run(lab: &Lab) -> std::path::PathBuf {
    let file = lab.folder().join("run.csv");
    let run = super::run(RUN_S, 0.0, 7);
    mr_damper_runs::save(&run, &file, &mr_damper_runs::SaveOptions::default())
        .expect("room in the temporary directory");
    file
}

fn lines(file: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(file).expect("the peer wrote it");
    text.lines().map(str::to_owned).collect()
}

/// True if two payloads in hexadecimal digits are the same message: all bytes are equal, except that the payload from the wire may be
/// padded to four bytes, which its header says in its fourth byte.
fn is_same_message(seen: &str, raw: &str) -> bool {
    let padding = raw.get(seen.len()..).unwrap_or("not shorter");
    seen[..6] == raw[..6]
        && seen[8..] == raw[8..seen.len()]
        && ["", "00", "0000", "000000"].contains(&padding)
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh, jazzy and viewer"]
fn a_viewer_decodes_every_channel_and_gets_the_estimates_bit_identical() {
    interop("Foxglove endpoint, live", |lab| {
        let namespace = ["-r", "__ns:=/front_left"];
        let topic = "/front_left/force_estimate";
        let mut served = lab.mr_damper(&["serve", "--foxglove"]);
        let mut node = lab.node(PRESET, &namespace);
        let raw_file = lab.folder().join("raw.txt");
        let mut raw = lab.ros_commanded(Distro::Jazzy, "raw_estimates.py", &[topic, utf8(&raw_file)]);
        assert_eq!(text(&raw.json_line(PEER), "/event"), "ready");
        let files = ["websocket", "sdk"].map(|name| lab.folder().join(name));
        let viewers = [
            Viewer::connect(lab, "foxglove.websocket.v1", topic, &files[0], &["--ask"]),
            Viewer::connect(lab, "foxglove.sdk.v1", topic, &files[1], &[]),
        ];
        // Discovery of the node by all receivers.
        std::thread::sleep(Duration::from_secs(4));
        let file = run(lab);
        let rows = lines(&file).len() as u64 - 1;
        let replay = ["--quiet", "replay", utf8(&file), "--wait", "20", "--ros-args"];
        lab.mr_damper(&[&replay[..], &namespace].concat()).output(PEER + Duration::from_secs_f64(RUN_S));
        std::thread::sleep(Duration::from_secs(1));
        let saw = viewers.map(Viewer::close);
        let estimates = count(&raw.close(), "/estimates");
        for saw in &saw {
            all_decoded(saw, true);
            for topic in WITH_MESSAGES {
                let messages = count(saw, &format!("/channels/~1front_left~1{topic}/messages"));
                assert!(messages > 0, "{topic}: {saw:#}");
            }
        }
        let raw = lines(&raw_file);
        for file in &files {
            let seen = lines(file);
            let differs = seen.iter().zip(&raw).position(|(seen, raw)| !is_same_message(seen, raw));
            let first = differs.map(|at| (at, &seen[at], &raw[at]));
            assert_eq!(first, None, "an estimate at a viewer, and on the wire");
            // Each displacement of the run causes an estimate. Held estimates follow, and rclpy listens longer.
            assert!(
                seen.len() as u64 >= rows && raw.len() >= seen.len(),
                "{} of {} estimates",
                seen.len(),
                raw.len()
            );
        }
        refused(&saw[0]);
        served.signal("INT");
        assert!(served.wait(crate::SHUTDOWN).success());
        node.signal("INT");
        node.wait(crate::SHUTDOWN);
        Outcome::Passed(format!("{estimates} estimates in {RUN_S} s, bit-identical at two viewers and rclpy"))
    });
}

/// Checks the answers to the requests of `--ask`.
fn refused(saw: &Value) {
    let statuses = found(saw, "/statuses").as_array().expect("statuses");
    for what in ["parameters are not set", "\"advertise\" is not offered", "\"message data\" is not offered"]
    {
        let is_refusal =
            |status: &&Value| text(status, "/message").contains(what) && count(status, "/level") == 2;
        assert!(statuses.iter().any(|status| is_refusal(&status)), "{what}: {saw:#}");
    }
    let coast = found(saw, "/parameters/~1front_left~1mr_damper.coast_s");
    assert!(found(coast, "/value").as_f64().is_some_and(|value| value != 99.0), "{saw:#}");
    assert_eq!(text(coast, "/type"), "float64");
    assert_eq!(text(found(saw, "/parameters/~1front_left~1mr_damper.model"), "/value"), PRESET);
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh, viewer"]
fn a_viewer_gets_a_recorded_run_without_ros() {
    interop("Foxglove endpoint, a recording", |lab| {
        let (file, payloads) = (run(lab), lab.folder().join("payloads"));
        let mut played = lab.mr_damper(&["--quiet", "replay", "--foxglove", utf8(&file), "--rate", "4"]);
        std::thread::sleep(Duration::from_secs(1));
        let viewer = Viewer::connect(lab, "foxglove.websocket.v1", "/displacement", &payloads, &[]);
        std::thread::sleep(Duration::from_secs_f64(RUN_S / 4.0 + 2.0));
        let saw = viewer.close();
        let messages = all_decoded(&saw, true);
        let rows = lines(&file).len() as u64 - 1;
        assert_eq!(count(&saw, "/channels/~1displacement/messages"), rows, "{saw:#}");
        assert_eq!(found(&saw, "/info/capabilities"), &serde_json::json!(["time"]));
        assert!(count(&saw, "/times") >= rows, "{saw:#}");
        played.signal("INT");
        assert!(played.wait(crate::SHUTDOWN).success());
        Outcome::Passed(format!("{messages} messages of {RUN_S} s, each decoded"))
    });
}
