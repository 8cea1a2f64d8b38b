//! The live page in a browser: what stands in its table is what the server says.

use crate::interop_files::utf8;
use crate::interop_support::gate::{Outcome, interop};
use crate::interop_support::json::{count, found, text, texts, truth};
use crate::interop_support::process::script;
use crate::interop_support::{Lab, PRESET};
use crate::{PEER, SHUTDOWN};
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_node::run::{SaveOptions, save};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::Duration;

const PAGE: &str = "http://127.0.0.1:8330/";
/// What a browser is called, where one is.
const BROWSERS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];
/// Figures of the page with their digits; `None`: texts.
const FIGURES: [(&str, Option<usize>); 10] = [
    ("estimate.force_n", Some(1)),
    ("estimate.band_low_n", Some(1)),
    ("estimate.band_high_n", Some(1)),
    ("estimate.mode", None),
    ("estimate.validity", None),
    ("measured.force_n", Some(1)),
    ("residual.residual_n", Some(1)),
    ("residual.windowed_rsse_n", Some(1)),
    ("residual.windowed_esr", Some(4)),
    ("drive.value", Some(3)),
];

#[test]
fn a_browser_s_table_says_what_the_server_says() {
    interop("live page in a browser", |lab| {
        let Some(browser) = browser() else {
            return Outcome::Skipped(format!("none of {} is on PATH", BROWSERS.join(", ")));
        };
        let _page = lab.mr_damper(&["serve"]);
        let namespace = ["-r", "__ns:=/front_left"];
        let mut node = lab.node(PRESET, &namespace);
        let run = lab.folder().join("run.csv");
        let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(4.0);
        save(&record(&experiment, &Plant::default(), &Channels::default(), 3), &run, &SaveOptions::default())
            .expect("room in the temporary directory");
        let replay = ["--quiet", "replay", utf8(&run), "--wait", "20", "--ros-args"];
        lab.mr_damper(&[&replay[..], &namespace].concat()).output(PEER);
        // From now on nothing moves, and the page has to say so.
        node.signal("INT");
        node.wait(SHUTDOWN);
        std::thread::sleep(Duration::from_millis(1500));

        let snapshot = snapshot(lab);
        let damper = found(&snapshot, "/dampers/0");
        assert!(truth(damper, "/estimate/stale") && text(damper, "/level") == "silent", "{damper:#}");
        let saw = look(lab, &browser, &[]);
        for (path, digits) in FIGURES {
            let cell = found(&saw, &format!("/figures/{path}"));
            let (value, shown) = (text(cell, "/0"), text(cell, "/1"));
            let said = found(damper, &format!("/{}", path.replace('.', "/")));
            match (digits, said.as_f64()) {
                (None, _) => assert_eq!((value, shown), (text(said, ""), text(said, "")), "{path}"),
                (Some(digits), Some(said)) => {
                    // serde_json reads the last of seventeen digits by one off at times.
                    let off = value.parse::<f64>().map(|value| (value - said).abs() / said.abs().max(1e-300));
                    assert!(off.is_ok_and(|off| off < 1e-15), "{path}: {value}, {said}");
                    assert_eq!(shown.replace('−', "-"), format!("{said:.digits$}"), "{path}");
                }
                (Some(_), None) => assert_eq!((value, shown), ("", "–"), "{path} is {said}"),
            }
        }
        let status = text(&saw, "/status");
        assert!(status.starts_with("no estimate for "), "{status}");
        assert!(text(&saw, "/classes").contains("silent"), "it is greyed: {saw:#}");
        assert_eq!(count(&saw, "/wide"), 0, "nothing sticks out: {saw:#}");
        assert_eq!(texts(&saw, "/errors"), [""; 0], "{saw:#}");
        let own = |name: &&str| name.starts_with(PAGE);
        assert!(texts(&saw, "/fetched").iter().all(own), "nothing is fetched from elsewhere: {saw:#}");
        let drawn = found(&saw, "/drawn").as_array().expect("a list of charts");
        assert!(drawn.len() == 3 && drawn.iter().all(|chart| *chart == true), "{saw:#}");

        // A telephone, in the dark, by its keys.
        let frozen = look(lab, &browser, &["--size", "360x740", "--dark", "--keys", "space ?"]);
        assert!(text(&frozen, "/banner").starts_with("Frozen at ") && truth(&frozen, "/help"), "{frozen:#}");
        assert_eq!(count(&frozen, "/wide"), 0, "nothing sticks out at 360 pixels: {frozen:#}");
        Outcome::Passed(format!("{} figures of the table are those of /snapshot; {status}", FIGURES.len()))
    });
}

fn browser() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let all = std::env::split_paths(&path).flat_map(|folder| BROWSERS.map(|name| folder.join(name)));
    all.into_iter().find(|file| file.is_file())
}

/// All figures, by an HTTP client that is not ours.
fn snapshot(lab: &Lab) -> Value {
    let script = format!("import urllib.request as u; print(u.urlopen('{PAGE}snapshot').read().decode())");
    lab.start_with("snapshot", Path::new("python3"), &["-c", &script], &[]).json(PEER)
}

/// What stands on the page after some seconds of the browser's.
fn look(lab: &Lab, browser: &Path, arguments: &[&str]) -> Value {
    let (peer, profile) = (script("page_peer.py"), lab.folder().join("profile"));
    let peer = [utf8(&peer), utf8(browser), PAGE, utf8(&profile)];
    lab.start_with("page_peer.py", Path::new("python3"), &[&peer, arguments].concat(), &[]).json(PEER)
}
