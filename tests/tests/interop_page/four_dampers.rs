//! Four dampers on the live page: they fit a screen, the keyboard reaches everything, and axe-core finds no serious fault.

use super::{PAGE, browser, look, run};
use crate::PEER;
use crate::interop_files::utf8;
use crate::interop_support::gate::{Outcome, interop_alone};
use crate::interop_support::json::{found, text, texts, truth};
use crate::interop_support::process::{Program, script};
use crate::interop_support::{Lab, PRESET};
use mr_damper_runs::{SaveOptions, save};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::Duration;

const DAMPERS: [&str; 4] = ["front_left", "front_right", "rear_left", "rear_right"];

/// A server of the page, a node with four dampers, and a replay for each of them.
struct Vehicle {
    _page: Program,
    _node: Program,
    replays: Vec<Program>,
}

impl Vehicle {
    fn start(lab: &Lab) -> Self {
        let config = lab.folder().join("vehicle.toml");
        let text = format!("dampers = {DAMPERS:?}\nmodel = \"{PRESET}\"\n");
        std::fs::write(&config, text).expect("room in the temporary directory");
        let replay = |(damper, seed): (&str, u64)| {
            let file = lab.folder().join(format!("{damper}.csv"));
            let written = save(&run(60.0, 0.0, seed), &file, &SaveOptions::default());
            written.expect("room in the temporary directory");
            let namespace = format!("__ns:=/{damper}");
            let options = ["--quiet", "replay", "--loop", utf8(&file), "--wait", "20"];
            lab.mr_damper(&[&options[..], &["--ros-args", "-r", &namespace]].concat())
        };
        Self {
            _page: lab.mr_damper(&["serve"]),
            _node: lab.mr_damper(&["node", "--config", utf8(&config)]),
            replays: DAMPERS.into_iter().zip(1..).map(replay).collect(),
        }
    }

    /// Ends the replay of the last damper, so that nothing more is received of it.
    fn stop_last(&mut self) {
        let mut last = self.replays.pop().expect("a replay");
        last.signal("INT");
        last.wait(PEER);
    }
}

/// What `page_walk.py` reports.
fn walk(lab: &Lab, what: &str, browser: &Path, arguments: &[&str]) -> Value {
    let (peer, profile) = (script("page_walk.py"), lab.folder().join("walk"));
    let peer = [utf8(&peer), what, utf8(browser), PAGE, utf8(&profile)];
    lab.start_with("page_walk.py", Path::new("python3"), &[&peer, arguments].concat(), &[]).json(4 * PEER)
}

#[test]
#[ignore = "needs Chromium"]
fn the_keyboard_reaches_four_dampers_that_fit_a_screen() {
    interop_alone("four dampers in a browser", |lab| {
        let Some(browser) = browser() else {
            return Outcome::Missing("no Chromium is on PATH".to_owned());
        };
        let mut vehicle = Vehicle::start(lab);
        let saw = walk(lab, "walk", &browser, &[]);
        let overview = found(&saw, "/overview");
        let mut names = texts(overview, "/names");
        names.sort_unstable();
        assert_eq!(names, DAMPERS);
        assert!(truth(overview, "/inside") && truth(overview, "/charts"), "all fit the screen: {saw:#}");
        assert_eq!(text(overview, "/link"), "live, 4 dampers");
        let order = texts(&saw, "/order");
        for damper in DAMPERS {
            assert!(order.contains(&format!("a {damper}").as_str()), "Tab reaches {damper}: {order:?}");
        }
        let opened = texts(&saw, "/opened_order").join(", ");
        for part in [
            "a All dampers",
            "button Freeze",
            "select",
            "Cursor in the charts",
            "PNG",
            "CSV",
            "summary Values",
        ] {
            assert!(opened.contains(part), "Tab reaches {part}: {opened}");
        }
        assert_eq!(texts(&saw, "/unseen"), [""; 0], "what has the focus is marked");
        let into = text(&saw, "/into");
        assert_eq!(format!("#{}", into.trim_start_matches("article damper ")), text(&saw, "/hash"));
        let shown = ["force", "residual", "velocity", "displacement", "drive", "loop"];
        assert_eq!(texts(&saw, "/shown"), shown, "nothing is commanded, so no command is drawn");
        // The cursor is in all charts at once.
        for series in ["measured", "estimate", "residual", "velocity", "displacement", "drive"] {
            let value = text(&saw, &format!("/at/{series}")).replace('−', "-");
            assert!(value.parse::<f64>().is_ok(), "{series} is {value} at the cursor: {saw:#}");
        }
        assert!(text(&saw, "/held").contains("Newest values are not shown"), "{saw:#}");
        exports(&saw);
        // After 40 minutes as after 25: a minute of points, ten minutes of buckets.
        let [before, after, points_s, buckets_s, newest_s] =
            [0, 1, 2, 3, 4].map(|k| found(&saw, &format!("/kept/{k}")).as_f64().expect("a number"));
        assert!(before == after && after < 8e6, "the page keeps {before} bytes of a damper, later {after}");
        assert!((60.0..64.0).contains(&(newest_s - points_s)), "points since {points_s} of {newest_s} s");
        assert!(
            (600.0..620.0).contains(&(newest_s - buckets_s)),
            "buckets since {buckets_s} of {newest_s} s"
        );
        assert_eq!(
            (truth(&saw, "/escape/0"), truth(&saw, "/escape/1"), text(&saw, "/back")),
            (true, true, ""),
            "Escape first removes the cursor, then returns to the tile; the browser's way back returns too"
        );
        assert_eq!(texts(&saw, "/errors"), [""; 0], "{saw:#}");

        // A damper without displacement comes first, is counted as a fault, and its chart looks stopped, although the node still
        // publishes INVALID estimates.
        vehicle.stop_last();
        let first = "document.querySelector('.summary')";
        let looks = format!(
            "{first}?.dataset.damper === 'rear_right' \
             && /^stopped, newest value .* ago$/.test({first}.querySelector('.stopped').textContent) \
             && document.querySelector('#counts').innerText.includes('1 fault')"
        );
        std::thread::sleep(Duration::from_secs(2));
        look(lab, &browser, &["--size", "1920x1080", "--step", &looks]);
        Outcome::Passed(format!("{} and {} stops of Tab", order.len(), texts(&saw, "/opened_order").len()))
    });
}

/// Checks the exported table and picture.
fn exports(saw: &Value) {
    let csv = text(saw, "/csv");
    let (head, rows) = csv.split_once('\n').expect("lines");
    let columns: Vec<&str> = head.split(',').collect();
    assert_eq!(columns[..3], ["time_s", "stamp_s", "estimate_n"]);
    let full = rows.lines().filter(|row| {
        let cells: Vec<&str> = row.split(',').collect();
        // The last three are of a command, and nothing is commanded.
        cells.len() == columns.len() && cells[..11].iter().all(|cell| cell.parse::<f64>().is_ok())
    });
    assert!(full.count() > 500, "a row has all values of its time: {}", &csv[..csv.len().min(1000)]);
    assert!(text(saw, "/png").starts_with("data:image/png;base64,"));
    assert!(text(saw, "/long_csv").contains("estimate_n_min,estimate_n_max"), "{saw:#}");
}

/// The file axe.min.js: `MR_DAMPER_AXE`, or the one that `setup.sh axe` installs.
fn axe() -> PathBuf {
    let base = std::env::var_os("MR_DAMPER_INTEROP_DIR");
    let base = base.map_or_else(|| "/var/tmp/mr-damper-interop".into(), PathBuf::from);
    let installed = base.join("axe/node_modules/axe-core/axe.min.js");
    std::env::var_os("MR_DAMPER_AXE").map_or(installed, PathBuf::from)
}

#[test]
#[ignore = "needs Chromium and axe-core"]
fn axe_finds_no_serious_fault() {
    interop_alone("accessibility of the live page", |lab| {
        let Some(browser) = browser() else {
            return Outcome::Missing("no Chromium is on PATH".to_owned());
        };
        let axe = axe();
        if !axe.is_file() {
            return Outcome::Missing(format!("{} is missing: run tests/interop/setup.sh axe", axe.display()));
        }
        let mut vehicle = Vehicle::start(lab);
        // The tile of a damper that has stopped is checked too.
        std::thread::sleep(Duration::from_secs(5));
        vehicle.stop_last();
        let saw = walk(lab, "axe", &browser, &["--axe", utf8(&axe)]);
        let states = found(&saw, "/axe").as_object().expect("states");
        assert_eq!(states.len(), 9, "{states:#?}");
        let (mut serious, mut others) = (Vec::new(), 0);
        for (state, violations) in states {
            for violation in violations.as_array().expect("a list") {
                match text(violation, "/impact") {
                    "serious" | "critical" => serious.push(format!("{state}: {violation:#}")),
                    _ => others += 1,
                }
            }
        }
        assert!(serious.is_empty(), "{}", serious.join("\n"));
        Outcome::Passed(format!("9 states, none serious or critical, {others} lesser"))
    });
}
