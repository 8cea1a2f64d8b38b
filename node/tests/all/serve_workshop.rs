//! `mr-damper serve --workshop` as a process, over real DDS and plain TCP: diagnoses, uploads and replays work, and requests without
//! permission start nothing.

use crate::domain::Domain;
use crate::live_support::config;
use crate::live_support::lagging::{LAG_S, base, run, write};
use crate::serve_support::Page;
use crate::turn::turn;
use crate::wait::{until, wait_until};
use mr_damper_model::evaluate::evaluate;
use mr_damper_model::pipeline::Settings;
use mr_damper_model::preset;
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::participant::Ros;
use mr_damper_node::settings::config::{Config, RosArgs};
use mr_damper_runs::{SaveOptions, save};
use ros2_client::NodeOptions;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value as Json, json};
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// Long enough for a diagnosis on a busy machine.
const LONG: Duration = Duration::from_secs(90);
const MODEL: &str = "thesis/fuzzy-tanh/rp3-cs";

fn open(domain: i64, dir: &Path, arguments: &[&str]) -> Page {
    let (domain, dir) = (domain.to_string(), dir.display().to_string());
    let own = ["--domain-id", &domain, "--workshop", &dir];
    Page::start(&[&own[..], arguments].concat())
}

/// A node in the namespace `/front_left` with one minute of history of a damper with coil lag.
fn lagging_node(domain: i64, dir: &Path) -> DamperNode {
    let path = dir.join("base.toml");
    write(&path, base());
    let model = path.display().to_string();
    let config = Config { model, close_loop_out: dir.display().to_string(), ..config(domain) };
    let (service, _) =
        DamperNode::start(&config, &RosArgs::in_namespace("/front_left"), false).expect("the service starts");
    let history = service.history();
    for sample in run(60.0, LAG_S, 2).samples() {
        history.lock().expect("no panic").push(&sample);
    }
    service
}

/// Starts a diagnosis as soon as the damper is known.
fn start_closing(page: &Page, damper: &str) {
    let body = json!({ "damper": damper }).to_string();
    wait_until("the damper is known", || page.post("/closing", body.as_bytes()).status == 200);
}

fn files(dir: &Path) -> Vec<String> {
    let mut all: Vec<String> = fs::read_dir(dir)
        .expect("readable")
        .map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned())
        .collect();
    all.sort();
    all
}

#[test]
fn a_diagnosis_names_the_missing_effect_keeps_its_report_and_can_be_cancelled() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let (dir, models) =
        (tempfile::tempdir().expect("a directory"), tempfile::tempdir().expect("a directory"));
    let service = lagging_node(domain.id(), models.path());
    let before = service.control().config().model;
    let page = open(domain.id(), dir.path(), &[]);
    start_closing(&page, "front_left");
    let again = page.post("/closing", br#"{"damper": "front_left"}"#);
    assert_eq!((again.status, again.body.contains("is under way")), (409, true), "{}", again.body);
    let shown = page.workshop_once("the end of the closing", LONG, |shop| {
        let state = shop["closings"]["front_left"]["state"].as_str();
        assert_ne!(state, Some("failed"), "{shop}");
        state == Some("done")
    });
    let closing = &shown["closings"]["front_left"];
    let found = &closing["found"];
    let effect = &found["effects"][0];
    assert_eq!(effect["id"], "coil_lag", "{found:#}");
    assert_eq!(found["effects"].as_array().map(Vec::len), Some(1), "{found:#}");
    let error = |row: &Json, when: &str| row[when]["rsse_n"].as_f64().expect("a figure");
    let sealed = &found["errors"][0];
    assert_eq!(sealed["runs"], "sealed part");
    assert!(error(sealed, "after") < 0.5 * error(sealed, "before"), "{sealed}");
    let line = found["load_line"].as_str().expect("a line");
    let service_name = format!("ROS_DOMAIN_ID={} ros2 service call /front_left/load_model ", domain.id());
    assert!(line.starts_with(&service_name), "{line}");
    assert!(line.contains(found["model_file"].as_str().expect("a path")), "{line}");
    assert_eq!(service.control().config().model, before, "the new model is not loaded");

    // Page and JSON of the report are on disk, and are served with a policy that lets nothing in them run.
    let name = closing["report"].as_str().expect("a name");
    assert_eq!(shown["reports"], json!([name]));
    let answer = page.ask(&format!("GET /reports/{name} "), &page.host(), "");
    assert_eq!(answer.status, 200);
    assert!(answer.head.contains("sandbox") && !answer.head.contains("script-src"), "{}", answer.head);
    let value = effect["parameters"][0].as_str().expect("words");
    assert!(value.starts_with("tau = 0.01") && answer.body.contains(value), "{value} in {}", answer.body);
    let json_name = name.replace(".html", ".json");
    assert_eq!(files(&dir.path().join("reports")), [name.to_owned(), json_name.clone()]);
    let json = page.ask(&format!("GET /reports/{json_name} "), &page.host(), "");
    let report: Json = serde_json::from_str(&json.body).expect("JSON");
    assert_eq!((&report["schema"], &report["verdict"]), (&"mr-damper/close/1".into(), &found["verdict"]));
    let tau_s = report["effects"][0]["parameters"]["tau_s"].as_f64().expect("a figure");
    assert!((tau_s - LAG_S).abs() < 0.1 * LAG_S, "{tau_s}");

    // A second diagnosis is cancelled, and the node is free again.
    start_closing(&page, "front_left");
    page.workshop_once("work", LONG, |shop| {
        shop["closings"]["front_left"]["says"].as_str().is_some_and(|says| says != "asking the node")
    });
    assert_eq!(page.post("/closing/cancel", br#"{"damper": "front_left"}"#).status, 200);
    let shown = page.workshop_once("the end", Duration::from_secs(20), |shop| {
        !matches!(shop["closings"]["front_left"]["state"].as_str(), Some("working" | "cancelling"))
    });
    assert_eq!(shown["closings"]["front_left"]["state"], "cancelled", "{shown}");
    assert_eq!(page.post("/closing/cancel", br#"{"damper": "front_left"}"#).status, 404);
    assert_eq!(files(&dir.path().join("reports")).len(), 2, "a cancelled diagnosis leaves no report");
    service.stop().expect("no thread panicked");
}

#[test]
fn uploaded_runs_are_replayed_on_their_own_topics_with_the_metrics_of_evaluate() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let (dir, other) = (tempfile::tempdir().expect("a directory"), tempfile::tempdir().expect("a directory"));
    let page = open(domain.id(), dir.path(), &[]);
    let recorded = run(20.0, 0.0, 7);
    for name in ["run.csv", "run.mcap"] {
        let path = other.path().join(name);
        save(&recorded, &path, &SaveOptions::default()).expect("room");
        let sent = fs::read(&path).expect("written");
        let answer = page.post(&format!("/runs?name={name}"), &sent);
        assert_eq!(answer.status, 200, "{}", answer.body);
        let about: Json = serde_json::from_str(&answer.body).expect("JSON");
        assert_eq!((&about["name"], &about["bytes"]), (&name.into(), &sent.len().into()));
        assert_eq!(about["samples"], recorded.displacement_m.len());
        let length_s = about["length_s"].as_f64().expect("a figure");
        assert!((length_s - recorded.duration().get()).abs() < 1e-9, "{length_s}");
        assert_eq!(
            fs::read(dir.path().join("runs").join(name)).expect("kept"),
            sent,
            "the kept file is identical"
        );
    }
    let listed: Json = serde_json::from_str(&page.ask("GET /runs ", &page.host(), "").body).expect("JSON");
    assert_eq!((&listed[0]["name"], &listed[1]["name"]), (&"run.csv".into(), &"run.mcap".into()));
    let channels = listed[1]["channels"].as_array().expect("a list");
    assert!(
        ["displacement_m", "force_n", "current_a"].iter().all(|name| channels.contains(&(*name).into())),
        "{listed}"
    );

    let peer =
        Ros::start(&config(domain.id()), &RosArgs::default(), NodeOptions::new(), "peer").expect("a peer");
    // ARX uses measured force: it is the only one of the two models with metrics of both kinds.
    for (name, model) in [("run.csv", MODEL), ("run.mcap", preset::BEST_ARX)] {
        let body = json!({ "run": name, "model": model, "rate": 4.0 }).to_string();
        let answer = page.post("/replay", body.as_bytes());
        assert_eq!(answer.status, 200, "{}", answer.body);
        let refused = page.post("/replay", body.as_bytes());
        assert_eq!(
            (refused.status, refused.body.contains("only one replay at a time")),
            (409, true),
            "{}",
            refused.body
        );
        wait_until("samples", || page.workshop()["replay"]["at_s"].as_f64() > Some(0.5));
        // Rates cover the last second, so they take up to a second to rise.
        wait_until("its rate", || {
            page.snapshot()["dampers"][0]["rates_hz"]["force_estimate"].as_f64() > Some(50.0)
        });
        let snapshot = page.snapshot();
        let damper = &snapshot["dampers"][0];
        assert_eq!(damper["name"], format!("workshop: {name}"), "{damper}");
        assert_eq!(
            snapshot["dampers"].as_array().map(Vec::len),
            Some(1),
            "the damper is listed once: {snapshot}"
        );
        assert!(
            damper["estimate"]["model"].as_str().is_some_and(|running| running.starts_with("thesis/")),
            "{damper}"
        );
        // The replay publishes only on its own topics.
        let own = format!("/workshop_{}/displacement", page.child.id());
        wait_until("its topic", || peer.published().iter().any(|(topic, _)| *topic == own));
        let others = peer
            .published()
            .into_iter()
            .filter(|(topic, _)| topic.ends_with("displacement") && *topic != own);
        assert_eq!(others.count(), 0);
        let refused = page.post("/runs/delete", json!({ "run": name }).to_string().as_bytes());
        assert_eq!(
            (refused.status, refused.body.contains("stop that first")),
            (409, true),
            "{}",
            refused.body
        );

        let turn = |turn: Json| page.post("/replay/turn", turn.to_string().as_bytes()).status;
        assert_eq!((turn(json!({ "turn": "pause" })), turn(json!({ "turn": "pause" }))), (200, 409));
        let at_s = until("a replay that stands still for 700 ms", || {
            let at_s = page.workshop()["replay"]["at_s"].clone();
            std::thread::sleep(Duration::from_millis(700));
            (page.workshop()["replay"]["at_s"] == at_s).then_some(at_s)
        });
        assert_eq!(
            (turn(json!({ "turn": "rate", "rate": 5.0 })), turn(json!({ "turn": "rate", "rate": 50.0 }))),
            (200, 400)
        );
        assert_eq!(turn(json!({ "turn": "resume" })), 200);
        let shown = page.workshop_once("the end of the run", LONG, |shop| {
            shop["replay"]["state"] == "ended" && shop["replay"]["figures"]["state"] != "computing"
        });
        assert!(shown["replay"]["at_s"].as_f64() > at_s.as_f64(), "{shown}");
        let figures = &shown["replay"]["figures"];
        let truth =
            evaluate(preset::load(model).expect("a preset"), &recorded, Settings::default(), |_| true)
                .expect("the model fits the run");
        for (figure, fit) in
            [("free_run", truth.free_run), ("one_step", truth.one_step), ("persistence", truth.persistence)]
        {
            let shown = figures[figure]["rsse_n"].as_f64();
            let same = match (shown, fit) {
                (Some(shown), Some(fit)) => (shown / fit.rsse_n - 1.0).abs() < 1e-12,
                (shown, fit) => shown.is_none() && fit.is_none(),
            };
            assert!(same, "{figure} is {fit:?}, in {figures}");
        }
        assert_eq!(truth.one_step.is_some(), model == preset::BEST_ARX);
        assert_eq!(turn(json!({ "turn": "stop" })), 200);
        wait_until("its card is gone", || page.snapshot()["dampers"] == json!([]));
    }
    // A deleted run is removed together with its metadata.
    assert_eq!(page.post("/runs/delete", br#"{"run": "run.mcap"}"#).status, 200);
    assert_eq!(page.post("/runs/delete", br#"{"run": "run.mcap"}"#).status, 404);
    assert_eq!(files(&dir.path().join("runs")), ["run.csv", "run.csv.about.json"]);
    peer.stop();
}

#[test]
fn a_diagnosis_of_the_replayed_damper_uses_the_replayed_run() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let (dir, other) = (tempfile::tempdir().expect("a directory"), tempfile::tempdir().expect("a directory"));
    // A model file put into the directory is found.
    fs::create_dir_all(dir.path().join("models")).expect("room");
    write(&dir.path().join("models/base.toml"), base());
    // So is a run, also as a bag directory; a run that cannot be used says why.
    let runs = dir.path().join("runs");
    save(&run(2.0, 0.0, 1), &runs.join("bag"), &SaveOptions::default()).expect("room");
    fs::write(runs.join("broken.csv"), "rubbish").expect("room");
    let page = open(domain.id(), dir.path(), &[]);
    let shown = page.workshop_once("a look at the runs", LONG, |shop| {
        shop["runs"].as_array().is_some_and(|runs| runs.iter().all(|run| run["state"] != "opening"))
    });
    let [bag, broken] = [&shown["runs"][0], &shown["runs"][1]];
    assert_eq!((&bag["name"], &bag["state"]), (&"bag".into(), &"ready".into()), "{shown}");
    assert_eq!((&broken["name"], &broken["state"]), (&"broken.csv".into(), &"unusable".into()), "{shown}");
    assert!(broken["why"].as_str().is_some_and(|why| why.contains("line 1")), "{broken}");
    assert_eq!(page.post("/runs/delete", br#"{"run": "broken.csv"}"#).status, 200);
    assert_eq!(page.post("/runs/delete", br#"{"run": "bag"}"#).status, 200);
    assert_eq!(files(&runs), [""; 0]);
    let path = other.path().join("lags.csv");
    save(&run(60.0, LAG_S, 2), &path, &SaveOptions::default()).expect("room");
    assert_eq!(page.post("/runs?name=lags.csv", &fs::read(&path).expect("written")).status, 200);
    assert_eq!(page.workshop()["models"][0], "base.toml");
    let answer = page.post("/replay", br#"{"run": "lags.csv", "model": "base.toml", "rate": 10}"#);
    assert_eq!(answer.status, 200, "{}", answer.body);
    page.workshop_once("the end of the run", LONG, |shop| shop["replay"]["state"] == "ended");
    let damper = "workshop: lags.csv";
    start_closing(&page, damper);
    let shown = page.workshop_once("the end of the closing", LONG, |shop| {
        let state = shop["closings"][damper]["state"].as_str();
        assert_ne!(state, Some("failed"), "{shop}");
        state == Some("done")
    });
    assert_eq!(shown["closings"][damper]["found"]["effects"][0]["id"], "coil_lag", "{shown:#}");
    // The new model is available for replay at once.
    let models: Vec<&str> =
        shown["models"].as_array().expect("a list").iter().filter_map(Json::as_str).collect();
    let made: Vec<_> =
        models.iter().filter(|name| name.ends_with(".toml") && **name != "base.toml").collect();
    assert_eq!(made.len(), 1, "{models:?}");
}

#[test]
fn unusable_uploads_leave_no_files_and_unauthorised_requests_start_nothing() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = tempfile::tempdir().expect("a directory");
    let page = open(domain.id(), dir.path(), &["--upload-limit-mb", "1"]);
    let good = b"time_s,displacement_m,force_n\n0,0,1\n0.5,0.001,2\n1,0.002,3\n";
    let big = vec![b'0'; (1 << 20) + 1];
    for (name, body, status, says) in [
        ("x.csv", &b"rubbish"[..], 400, "x.csv, line 1"),
        ("x.csv", b"time_s,displacement_m\n0,0\n0,1\n", 400, "x.csv, line 3"),
        ("x.csv", b"", 400, "x.csv"),
        ("x.mcap", b"rubbish", 400, "x.mcap: not an MCAP file"),
        ("x.db3", b"rubbish", 400, "x.db3"),
        ("x.mcap.zstd", b"rubbish", 400, "x.mcap.zstd"),
        ("x.exe", good, 400, "does not have the extension of a run"),
        ("../../x.csv", good, 400, "names a path"),
        ("..%2F..%2Fx.csv", good, 400, "names a path"),
        ("%00.csv", good, 400, "names a path"),
        (".x.csv", good, 400, "begins with a dot"),
        ("", good, 400, "needs a name"),
        ("x.csv&drive=steam", good, 400, "\"steam\""),
        ("x.csv&speed=9", good, 400, "speed"),
        ("x.csv", &big, 413, "--upload-limit-mb"),
    ] {
        let answer = page.post(&format!("/runs?name={name}"), body);
        assert_eq!(answer.status, status, "{name}: {}", answer.body);
        assert!(answer.body.contains(says), "{name}: \"{says}\" is missing in: {}", answer.body);
        assert!(!answer.body.contains(&dir.path().display().to_string()), "{}", answer.body);
    }
    // An upload larger than allowed whose length is not announced, because it is chunked.
    let own = format!("Origin: http://{}\r\nX-Mr-Damper-Token: {}\r\n", page.host(), page.token());
    let chunked = [b"100001\r\n".as_slice(), &big, b"\r\n0\r\n\r\n"].concat();
    let answer = page.post_chunked("/runs?name=x.csv", &own, &chunked);
    assert_eq!(answer.status, 413, "{}", answer.body);
    // An upload that is cut off in the middle.
    let mut cut = page.begin_post("/runs?name=x.csv", &own, good.len());
    cut.write_all(&good[..20]).expect("sent");
    page.workshop_once("the upload", Duration::from_secs(10), |shop| shop["uploads"][0]["name"] == "x.csv");
    drop(cut);
    page.workshop_once("its end", Duration::from_secs(10), |shop| shop["uploads"] == json!([]));
    assert_eq!(page.workshop()["runs"], json!([]));
    for part in ["runs", "incoming"] {
        assert_eq!(files(&dir.path().join(part)), [""; 0], "{part}");
    }
    assert_eq!(
        files(dir.path().parent().expect("a parent")).iter().filter(|name| *name == "x.csv").count(),
        0
    );

    assert_eq!(page.post("/runs?name=a%20b.csv", good).status, 200, "a good upload is still accepted");
    assert_eq!(page.post("/runs?name=a_b.csv", good).status, 200);
    assert_eq!(
        files(&dir.path().join("runs")),
        ["a_b-2.csv", "a_b-2.csv.about.json", "a_b.csv", "a_b.csv.about.json"],
        "no file is overwritten"
    );
    let (host, token) = (page.host(), page.token());
    let replay = format!("{{\"run\": \"a_b.csv\", \"model\": \"{MODEL}\"}}");
    let requests = [
        ("/replay", replay.as_bytes()),
        ("/runs?name=y.csv", good),
        ("/runs/delete", b"{\"run\": \"a_b.csv\"}"),
        ("/closing", b"{\"damper\": \"left\"}"),
        ("/closing/cancel", b"{}"),
        ("/replay/turn", b"{}"),
    ];
    for (path, body) in requests {
        for headers in [
            String::new(),
            format!("Origin: http://{host}\r\n"),
            format!("X-Mr-Damper-Token: {token}\r\n"),
            format!("Origin: http://{host}\r\nX-Mr-Damper-Token: {}\r\n", "0".repeat(32)),
            format!("Origin: http://evil.example\r\nX-Mr-Damper-Token: {token}\r\n"),
            format!("Origin: null\r\nX-Mr-Damper-Token: {token}\r\n"),
            format!("Sec-Fetch-Site: cross-site\r\nX-Mr-Damper-Token: {token}\r\n"),
        ] {
            let answer = page.post_with(path, &headers, body);
            assert_eq!(answer.status, 403, "{path} with {headers}: {}", answer.body);
            assert!(answer.body.len() > 20, "the answer explains the refusal: {}", answer.body);
        }
        for method in ["GET", "PUT", "DELETE", "OPTIONS"] {
            let status = page.ask(&format!("{method} {path} "), &host, "").status;
            let fine = if method == "GET" && path.starts_with("/runs?") { 200 } else { 405 };
            assert!(status == fine || (status == 403 && method != "GET"), "{method} {path}: {status}");
        }
    }
    let shop = page.workshop();
    assert_eq!((&shop["replay"], &shop["closings"]), (&Json::Null, &json!({})), "nothing was started");
    assert_eq!(shop["runs"].as_array().map(Vec::len), Some(2), "{shop}");
    for (path, body, status) in [
        ("/replay", "{\"run\": \"nothing.csv\", \"model\": \"x\"}", 404),
        ("/replay", "{\"run\": \"a_b.csv\", \"model\": \"../base.toml\"}", 404),
        ("/replay", "{\"run\": \"a_b.csv\", \"model\": \"thesis/fuzzy-tanh/rp3-cs\", \"rate\": 11}", 400),
        ("/replay/turn", "{\"turn\": \"pause\"}", 404),
        ("/closing", "{\"damper\": \"nobody\"}", 404),
        ("/closing", "{\"damper\": \"nobody\", \"history_s\": -1}", 400),
        ("/runs/delete", "{\"run\": \"../base.toml\"}", 404),
    ] {
        assert_eq!(page.post(path, body.as_bytes()).status, status, "{path} {body}");
    }
    assert_eq!(page.ask("GET /reports/..%2F.lock ", &host, "").status, 404);
}

#[test]
fn the_workshop_needs_its_flag_and_a_loopback_address() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = tempfile::tempdir().expect("a directory");
    let domain = domain.id().to_string();
    let page = Page::start(&["--domain-id", &domain]);
    let host = page.host();
    let whole = page.ask("GET / ", &host, "").body;
    assert!(
        !whole.contains("token") && !whole.contains("workshop") && !whole.contains("WORKSHOP"),
        "{whole}"
    );
    assert!(page.snapshot().get("workshop").is_none());
    let headers = format!("Origin: http://{host}\r\nSec-Fetch-Site: same-origin\r\nX-Mr-Damper-Token: 0\r\n");
    for path in [
        "/workshop",
        "/workshop.js",
        "/workshop.css",
        "/runs",
        "/runs?name=x.csv",
        "/runs/delete",
        "/replay",
        "/replay/turn",
        "/closing",
        "/closing/cancel",
        "/reports/x.html",
    ] {
        for answer in [page.ask(&format!("GET {path} "), &host, ""), page.post_with(path, &headers, b"{}")] {
            assert_eq!(
                (answer.status, answer.body.contains("--workshop DIR")),
                (404, true),
                "{path}: {}",
                answer.body
            );
        }
    }
    let shown = page.post_with("/snapshot", &headers, b"{}");
    assert_eq!((shown.status, shown.body.contains("--workshop DIR")), (405, true), "{}", shown.body);

    let shop = dir.path().join("shop").display().to_string();
    for arguments in [&["--listen", "0.0.0.0:0"][..], &["--listen", "0.0.0.0:0", "--any-host"]] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
        command.args(["serve", "--domain-id", &domain, "--workshop", &shop]).args(arguments);
        let output = command.output().expect("it runs");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), stderr.contains("not on loopback")), (Some(2), true), "{stderr}");
    }
    assert!(!Path::new(&shop).exists(), "no directory was created");
    // The Zenoh mirror carries no actions, and the answer says so.
    let held = Page::start(&["--zenoh", "tcp/127.0.0.1:1", "--workshop", &shop]);
    let refused = held.post("/closing", br#"{"damper": "left"}"#);
    assert_eq!(
        (refused.status, refused.body.contains("carries no actions")),
        (400, true),
        "{}",
        refused.body
    );
    let mut second = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    let output =
        second.args(["serve", "--listen", "127.0.0.1:0", "--workshop", &shop]).output().expect("it runs");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(
        (output.status.code(), stderr.contains("another mr-damper serve")),
        (Some(1), true),
        "{stderr}"
    );
}

#[test]
fn ctrl_c_ends_an_upload_a_replay_and_a_diagnosis_and_leaves_no_partial_file() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let (dir, models) =
        (tempfile::tempdir().expect("a directory"), tempfile::tempdir().expect("a directory"));
    let service = lagging_node(domain.id(), models.path());
    let mut page = open(domain.id(), dir.path(), &[]);
    let path = models.path().join("run.csv");
    save(&run(60.0, 0.0, 3), &path, &SaveOptions::default()).expect("room");
    assert_eq!(page.post("/runs?name=run.csv", &fs::read(&path).expect("written")).status, 200);
    let body = json!({ "run": "run.csv", "model": MODEL }).to_string();
    assert_eq!(page.post("/replay", body.as_bytes()).status, 200);
    page.workshop_once("samples", LONG, |shop| shop["replay"]["at_s"].as_f64() > Some(0.2));
    start_closing(&page, "front_left");
    page.workshop_once("work", LONG, |shop| {
        shop["closings"]["front_left"]["says"].as_str().is_some_and(|says| says != "asking the node")
    });
    let own = format!("Origin: http://{}\r\nX-Mr-Damper-Token: {}\r\n", page.host(), page.token());
    let mut half = page.begin_post("/runs?name=half.csv", &own, 1 << 20);
    half.write_all(b"time_s,displacement_m\n0,0\n").expect("sent");
    page.workshop_once("the upload", LONG, |shop| shop["uploads"][0]["name"] == "half.csv");
    assert_eq!(files(&dir.path().join("incoming")).len(), 1);

    let asked = Instant::now();
    kill_process(Pid::from_child(&page.child), Signal::INT).expect("it runs");
    let status = page.child.wait().expect("it ends");
    println!("ended {:.2?} after Ctrl-C", asked.elapsed());
    // Below one second on an idle machine.
    assert!(asked.elapsed() < Duration::from_secs(3), "it took {:?}", asked.elapsed());
    assert_eq!(status.code(), Some(0));
    assert_eq!(files(&dir.path().join("incoming")), [""; 0]);
    assert_eq!(files(&dir.path().join("runs")), ["run.csv", "run.csv.about.json"]);
    service.stop().expect("no thread panicked");
}
