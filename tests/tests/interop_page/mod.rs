//! The live page in a browser: its table shows the server's values, `serve --workshop` works, and a page of another site reads only
//! what it may.

mod four_dampers;
mod viewers;

use crate::interop_files::utf8;
use crate::interop_support::gate::{Outcome, interop};
use crate::interop_support::json::{count, found, text, texts, truth};
use crate::interop_support::process::script;
use crate::interop_support::{Lab, PRESET};
use crate::{PEER, SHUTDOWN};
use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::identify::{ModelSpec, Options, Watch, identify};
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::Run;
use mr_damper_runs::{SaveOptions, save};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::Duration;

const PAGE: &str = "http://127.0.0.1:8330/";
/// Names of browsers to look for on PATH.
const BROWSERS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];
/// Values of the page with their number of digits; `None` for text.
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
#[ignore = "needs Chromium"]
fn the_browsers_table_shows_the_servers_values() {
    interop("live page in a browser", |lab| {
        let Some(browser) = browser() else {
            return Outcome::Missing(format!("none of {} is on PATH", BROWSERS.join(", ")));
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
        // From now on nothing moves, and the page must say so.
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
                    // serde_json sometimes reads the last of seventeen digits off by one.
                    let off = value.parse::<f64>().map(|value| (value - said).abs() / said.abs().max(1e-300));
                    assert!(off.is_ok_and(|off| off < 1e-15), "{path}: {value}, {said}");
                    assert_eq!(shown.replace('−', "-"), format!("{said:.digits$}"), "{path}");
                }
                (Some(_), None) => assert_eq!((value, shown), ("", "–"), "{path} is {said}"),
            }
        }
        let status = text(&saw, "/status");
        assert!(status.starts_with("no estimate for "), "{status}");
        assert!(text(&saw, "/classes").contains("silent"), "the card is greyed: {saw:#}");
        assert_eq!(count(&saw, "/wide"), 0, "the page fits the window width: {saw:#}");
        assert_eq!(texts(&saw, "/errors"), [""; 0], "{saw:#}");
        let own = |name: &&str| name.starts_with(PAGE);
        assert!(texts(&saw, "/fetched").iter().all(own), "nothing is fetched from elsewhere: {saw:#}");
        let drawn = found(&saw, "/drawn").as_array().expect("a list of charts");
        assert!(drawn.len() == 6 && drawn.iter().all(|chart| *chart == true), "{saw:#}");

        // A telephone's size, in dark mode, controlled by keys.
        let frozen = look(lab, &browser, &["--size", "360x740", "--dark", "--keys", "space ?"]);
        assert!(text(&frozen, "/banner").starts_with("Frozen at ") && truth(&frozen, "/help"), "{frozen:#}");
        // While frozen, ages refer to the time of freezing: none says "now" or "ago".
        let of_then = |age: &&str| *age == "never" || *age == "at that time" || age.ends_with(" before");
        let ages = texts(&frozen, "/ages");
        assert!(ages.len() > 20 && ages.iter().all(of_then), "{ages:?}");
        assert_eq!(count(&frozen, "/wide"), 0, "the page fits a width of 360 pixels: {frozen:#}");
        Outcome::Passed(format!("{} values of the table equal /snapshot; {status}", FIGURES.len()))
    });
}

fn browser() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let all = std::env::split_paths(&path).flat_map(|folder| BROWSERS.map(|name| folder.join(name)));
    all.into_iter().find(|file| file.is_file())
}

/// The whole snapshot, fetched by an independent HTTP client.
fn snapshot(lab: &Lab) -> Value {
    let script = format!("import urllib.request as u; print(u.urlopen('{PAGE}snapshot').read().decode())");
    lab.start_with("snapshot", Path::new("python3"), &["-c", &script], &[]).json(PEER)
}

/// The content of the page after some seconds in the browser.
fn look(lab: &Lab, browser: &Path, arguments: &[&str]) -> Value {
    look_at(lab, browser, PAGE, arguments)
}

/// Like [`look`], for another page.
fn look_at(lab: &Lab, browser: &Path, page: &str, arguments: &[&str]) -> Value {
    let (peer, profile) = (script("page_peer.py"), lab.folder().join("profile"));
    let peer = [utf8(&peer), utf8(browser), page, utf8(&profile)];
    lab.start_with("page_peer.py", Path::new("python3"), &[&peer, arguments].concat(), &[]).json(PEER)
}

/// A run of a damper with a coil lag of `lag_s`.
fn run(seconds: f64, lag_s: f64, seed: u64) -> Run {
    let experiment = Experiment::thesis("RP-APRBS").expect("a thesis experiment").with_duration_s(seconds);
    let channels = Channels::default().with_fine_displacement();
    record(&experiment, &Plant::quasi_static().with_coil_lag_s(lag_s), &channels, seed)
}

/// A model file of the damper without the lag.
fn base() -> String {
    let options = Options {
        conditioning: Conditioning { velocity: VelocitySource::ThreePoint, ..Conditioning::default() },
        choose_velocity: false,
        restarts: 3,
        ..Options::default()
    };
    let found = identify(ModelSpec::FUZZY_TANH, &[run(20.0, 0.0, 1)], &options, &Watch::none());
    let model = found.expect("the rig's damper can be identified").model;
    ModelFile { model, provenance: Provenance::default() }.to_toml().expect("writable")
}

#[test]
#[ignore = "needs Chromium"]
fn a_browser_uploads_a_run_replays_it_diagnoses_it_and_shows_the_report() {
    interop("workshop in a browser", |lab| {
        let Some(browser) = browser() else {
            return Outcome::Missing(format!("none of {} is on PATH", BROWSERS.join(", ")));
        };
        let (shop, file) = (lab.folder().join("shop"), lab.folder().join("lags.csv"));
        std::fs::create_dir_all(shop.join("models")).expect("room in the temporary directory");
        std::fs::write(shop.join("models/base.toml"), base()).expect("room in the temporary directory");
        save(&run(60.0, 0.012, 2), &file, &SaveOptions::default()).expect("room in the temporary directory");
        let _page = lab.mr_damper(&["serve", "--workshop", utf8(&shop)]);
        let told =
            |id: &str, text: &str| format!("document.querySelector('{id}')?.textContent.includes('{text}')");
        // The element may appear later.
        let click = |id: &str| {
            format!(
                "(() => {{ const found = document.querySelector('{id}'); found?.click(); return found !== null; }})()"
            )
        };
        let steps = [
            told("#upload-told", "lags.csv is uploaded"),
            "(() => { const [model, rate] = ['#model', '#rate'].map((id) => document.querySelector(id)); \
             [model.value, rate.value] = ['base.toml', 10]; return model.value === 'base.toml'; })()"
                .to_owned(),
            click("#runs button"),
            told("#replay-told", "played to its end"),
            told("#figures", "free run"),
            click(".card .ask"),
            "document.querySelector('.card .found a') !== null".to_owned(),
            "document.querySelector('.card.selected .last-report:not([hidden]) a')?.href.includes('/reports/')".to_owned(),
        ];
        let mut arguments = vec!["--file", utf8(&file)];
        steps.iter().for_each(|step| arguments.extend(["--step", step.as_str()]));
        let saw = look(lab, &browser, &arguments);
        assert_eq!(text(&saw, "/name"), "workshop: lags.csv", "{saw:#}");
        let (closing, summary) = (text(&saw, "/closing"), text(&saw, "/found"));
        assert!(summary.contains("coil lag") && summary.contains("tau = 0.01"), "{saw:#}");
        assert!(summary.contains("squared error left") && summary.contains("/load_model"), "{saw:#}");
        assert!(summary.contains("among the models to replay with"), "{saw:#}");
        assert_eq!(count(&saw, "/wide"), 0, "the page fits the window width: {saw:#}");
        assert_eq!(texts(&saw, "/errors"), [""; 0], "{saw:#}");
        let own = |name: &&str| name.starts_with(PAGE);
        assert!(texts(&saw, "/fetched").iter().all(own), "nothing is fetched from elsewhere: {saw:#}");
        // The report is a separate page; opening the live page again shows the same state, also at a telephone's size.
        let again = look(lab, &browser, &["--size", "360x740", "--dark"]);
        assert_eq!((text(&again, "/found"), count(&again, "/wide")), (summary, 0), "{again:#}");
        let report = format!("{}{}", PAGE.trim_end_matches('/'), text(&saw, "/report"));
        let script = format!(
            "import urllib.request as u; import json; print(json.dumps(u.urlopen('{report}').read().decode()))"
        );
        let whole = lab.start_with("report", Path::new("python3"), &["-c", &script], &[]).json(PEER);
        assert!(whole.as_str().is_some_and(|page| page.contains("coil lag")), "{whole}");
        Outcome::Passed(closing.to_owned())
    });
}

#[test]
#[ignore = "needs Chromium"]
fn a_browser_shows_the_force_on_another_sites_page_if_allowed() {
    interop("somebody else's page in a browser", |lab| {
        let Some(browser) = browser() else {
            return Outcome::Missing(format!("none of {} is on PATH", BROWSERS.join(", ")));
        };
        let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../node/examples");
        let server = ["-m", "http.server", "8000", "--bind", "127.0.0.1", "--directory", utf8(&examples)];
        let _theirs = lab.start_with("http.server", Path::new("python3"), &server, &[]);
        let _page = lab.mr_damper(&["serve", "--allow-origin", "http://127.0.0.1:8000"]);
        let _other = lab.mr_damper(&["serve", "--listen", "127.0.0.1:8331"]);
        let namespace = ["-r", "__ns:=/front_left"];
        let _node = lab.node(PRESET, &namespace);
        let file = lab.folder().join("run.csv");
        save(&run(60.0, 0.0, 3), &file, &SaveOptions::default()).expect("room in the temporary directory");
        let replay = ["--quiet", "replay", utf8(&file), "--wait", "20", "--ros-args"];
        let _replay = lab.mr_damper(&[&replay[..], &namespace].concat());
        let url = "http://127.0.0.1:8000/live_in_browser.html";
        let shows = r"/front_left: −?-?[\d.]+ N, VALID/.test(document.body.innerText) && document.querySelector('#link').textContent === 'live'";
        let saw = look_at(lab, &browser, url, &["--step", shows]);
        // The other server does not allow that page.
        let refused = "document.querySelector('#link').textContent.startsWith('no data from the server')";
        look_at(
            lab,
            &browser,
            &format!("{url}?server=http://127.0.0.1:8331"),
            &["--seconds", "4", "--step", refused],
        );
        Outcome::Passed(text(&saw, "/body").replace('\n', "; "))
    });
}
