//! `mr-damper serve` as a process, over real DDS and plain TCP: the page shows the values of the topics, and stalled readers, wrong
//! requests and excess connections do not affect other clients.

use crate::domain::Domain;
use crate::serve_support::{Page, Stream, StreamEvent};
use crate::turn::turn;
use crate::wait::PATIENCE;
use crate::zenoh_support;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_msgs::{ForceEstimate, ForceResidual, Message, Mode, Validity};
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::participant::Ros;
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use mr_damper_node::settings::interrupt::Interrupt;
use mr_damper_node::streams::player::{PlaybackOptions, Played, Player};
use ros2_client::{NodeOptions, Subscription};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value as Json;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Long enough to fill a stalled reader's buffers.
const RUN_S: f64 = 12.0;

/// A node in the namespace `/left`, its player, and a peer that subscribes to its outputs.
struct Setup {
    service: DamperNode,
    player: Player,
    ros: Ros,
    estimates: Subscription<ForceEstimate>,
    residuals: Subscription<ForceResidual>,
}

impl Setup {
    fn set(domain: &Domain) -> Self {
        let mut config = Config { domain_id: domain.id(), align_wait_s: 0.5, ..Config::default() };
        config.set("model", &Value::Text("thesis/fuzzy-tanh/rp3-cs".into())).expect("a text");
        let args = RosArgs::in_namespace("/left");
        let (service, _) = DamperNode::start(&config, &args, false).expect("the service starts");
        let mut ros = Ros::start(&config, &args, NodeOptions::new(), "peer").expect("a peer starts");
        Self {
            estimates: ros.subscribe("/left/force_estimate").expect("a topic"),
            residuals: ros.subscribe("/left/force_residual").expect("a topic"),
            player: Player::start(&config, &args, false).expect("the player starts"),
            service,
            ros,
        }
    }

    fn stop(self) {
        self.player.stop();
        self.service.stop().expect("no thread panicked");
        drop((self.estimates, self.residuals));
        self.ros.stop();
    }
}

fn play(player: &Player) {
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(RUN_S);
    let run = record(&experiment, &Plant::default(), &Channels::default(), 5);
    let interrupt = Interrupt::manual();
    assert!(player.wait_for_listener(Duration::from_secs(20), &interrupt), "the node listens");
    player.play(&run, &PlaybackOptions::default(), &mut Played::default(), &interrupt, None, &|_| {});
}

/// Messages indexed by their stamps.
type Heard<M> = BTreeMap<i64, M>;

fn drain<M: Message>(subscription: &Subscription<M>, into: &mut Heard<M>, stamp: fn(&M) -> i64) {
    while let Some((message, _)) = subscription.take().expect("readable") {
        into.insert(stamp(&message), message);
    }
}

/// JSON has all digits, but serde_json sometimes reads the last of seventeen digits off by one.
fn is_shown_as(value: f64, shown: &Json) -> bool {
    match shown.as_f64() {
        Some(shown) => (shown - value).abs() <= 4.0 * f64::EPSILON * value.abs(),
        None => shown.is_null() && !value.is_finite(),
    }
}

/// Compares the values in `shown` with the message of the same stamp. Returns false if the peer missed that message.
fn is_that_of_the_topic(shown: &Json, heard: &Heard<ForceEstimate>) -> bool {
    let Some(message) = heard.get(&shown["stamp_ns"].as_i64().expect("a stamp")) else { return false };
    for (figure, value) in [
        ("force_n", message.force),
        ("std_dev_n", message.std_dev),
        ("band_low_n", message.band_low),
        ("band_high_n", message.band_high),
        ("input_age_s", message.input_age),
    ] {
        assert!(is_shown_as(value, &shown[figure]), "{figure} is {value}, in {shown}");
    }
    let (mode, validity) = (Mode::try_from(message.mode), Validity::try_from(message.validity));
    assert_eq!(shown["mode"], mode.expect("known").name());
    assert_eq!(shown["validity"], validity.expect("known").name());
    assert_eq!(shown["reasons"].as_array().map(Vec::len), Some(message.reasons.names().count()));
    assert_eq!(shown["model"], *message.model);
    true
}

/// Checks the events of a reader that keeps up, from the first batch on.
fn keeps_up(events: &[StreamEvent], heard: &Heard<ForceEstimate>, residuals: &Heard<ForceResidual>) {
    let batches: Vec<(&Json, Instant)> = events
        .iter()
        .filter_map(|event| (event.name == "batch").then_some((&event.data, event.at)))
        .collect();
    assert_eq!((events[0].name.as_str(), &events[0].data["schema"]), ("start", &"mr-damper/serve/1".into()));
    assert!(events.iter().all(|event| event.name != "skipped"), "no batch is skipped");
    let mut next = events[0].data["batch"].as_u64().expect("a number");
    for (batch, _) in &batches {
        next += 1;
        assert_eq!(batch["batch"], next, "no batch is missing or repeated");
    }
    let seconds = (batches[batches.len() - 1].1 - batches[0].1).as_secs_f64();
    let rate = batches.len() as f64 / seconds;
    println!("{} batches in {seconds:.1} s: {rate:.1} a second", batches.len());
    // Fifty per second on an idle machine.
    assert!((10.0..55.0).contains(&rate), "{rate:.1} batches a second");

    let states = || batches.iter().filter_map(|(batch, _)| batch["dampers"].get(0));
    let shown = states().filter(|state| !state["estimate"].is_null());
    let same = shown.clone().filter(|state| is_that_of_the_topic(&state["estimate"], heard)).count();
    assert!(same > 30 && same * 10 > shown.count() * 8, "{same} estimates equal the topic's");
    let mut same = 0;
    for residual in states().map(|state| &state["residual"]).filter(|residual| !residual.is_null()) {
        if let Some(message) = residuals.get(&residual["stamp_ns"].as_i64().expect("a stamp")) {
            assert!(is_shown_as(message.residual, &residual["residual_n"]), "{residual}");
            assert!(is_shown_as(message.measured, &residual["measured_n"]), "{residual}");
            same += 1;
        }
    }
    assert!(same > 30, "{same} residuals equal the topic's");

    // Points are thinned, but each is a point of the topic.
    let forces: Vec<u32> = heard.values().map(|message| (message.force as f32).to_bits()).collect();
    let points = batches.iter().filter_map(|(batch, _)| batch["points"].get(0)?["estimate"].as_array());
    let points: Vec<&Json> = points.flatten().collect();
    let of_topic =
        |point: &&&Json| point[1].as_f64().is_none_or(|force| forces.contains(&(force as f32).to_bits()));
    let known = points.iter().filter(of_topic).count();
    let per_s = points.len() as f64 / RUN_S;
    assert!(per_s > 50.0 && per_s < 260.0, "{per_s:.0} points a second");
    assert!(known * 100 > points.len() * 95, "{known} of {} points are points of the topic", points.len());
}

/// Checks that the history has the whole run, with extremes in order.
fn has_history(page: &Page) {
    let answer = page.ask("GET /history?damper=left&from_s=1 ", &page.host(), "");
    assert_eq!(answer.status, 200, "{}", answer.body);
    let history: Json = serde_json::from_str(&answer.body).expect("JSON");
    for series in ["estimate", "measured", "residual", "velocity", "displacement", "drive"] {
        let buckets = history[series].as_array().expect("a list");
        let expected = (RUN_S - 1.0) / history["bucket_s"].as_f64().expect("a length");
        assert!(
            (buckets.len() as f64 - expected).abs() < 0.2 * expected,
            "{series}: {} buckets",
            buckets.len()
        );
        let is_ordered = |bucket: &Json| bucket[1].as_f64() <= bucket[2].as_f64();
        assert!(buckets.iter().all(is_ordered), "{series}: the smallest value precedes the largest");
    }
    assert_eq!(history["command"], serde_json::json!([]), "nothing was commanded");
}

/// The first damper, once the page shows that it is silent, which takes at most 5 s.
fn silent(page: &Page) -> Json {
    let deadline = Instant::now() + Duration::from_secs(5);
    loop {
        let damper = page.snapshot()["dampers"][0].clone();
        // Rates cover the last second.
        if damper["level"] == "silent" && damper["rates_hz"] == serde_json::json!({}) {
            return damper;
        }
        assert!(Instant::now() < deadline, "waited for silence: {damper}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn values_equal_the_topics_and_a_stalled_reader_does_not_affect_the_others() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let page = Page::start(&["--domain-id", &domain.id().to_string()]);
    let empty = page.snapshot();
    assert_eq!(
        (&empty["schema"], empty["dampers"].as_array().map(Vec::len)),
        (&"mr-damper/serve/1".into(), Some(0))
    );
    // The damper starts later than the page, and the page finds it.
    let setup = Setup::set(&domain);
    let deadline = Instant::now() + Duration::from_secs(20);
    while page.snapshot()["dampers"][0]["name"] != "left" {
        assert!(Instant::now() < deadline, "the damper is found: {}", page.snapshot());
        std::thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(page.snapshot()["dampers"][0]["level"], "silent");

    let mut stalled = Stream::open_with_small_buffer(&page);
    let stream = Stream::open(&page);
    let (mut heard, mut residuals, done) = (Heard::new(), Heard::new(), AtomicBool::new(false));
    let events = std::thread::scope(|scope| {
        let reading = scope.spawn(|| stream.read_until(|| done.load(Ordering::Relaxed)));
        let playing = scope.spawn(|| play(&setup.player));
        let mut end: Option<Instant> = None;
        while end.is_none_or(|end| Instant::now() < end) {
            drain(&setup.estimates, &mut heard, |message| message.header.stamp.as_nanos());
            drain(&setup.residuals, &mut residuals, |message| message.header.stamp.as_nanos());
            // The page sends its last batches meanwhile. `keeps_up` allows for estimates that are not heard.
            if playing.is_finished() {
                end.get_or_insert_with(|| Instant::now() + Duration::from_millis(300));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        done.store(true, Ordering::Relaxed);
        reading.join().expect("no panic")
    });
    keeps_up(&events, &heard, &residuals);

    // The stalled reader gets the oldest batches, then the number of batches it missed, then new ones.
    stalled.widen();
    let late = stalled.read_until_event("skipped");
    let skipped: u64 = late[late.len() - 1].data.to_string().parse().expect("a count");
    println!("{skipped} batches skipped");
    let next = stalled.read_until_event("batch");
    let before = late.iter().rev().find(|event| event.name == "batch").expect("batches came before");
    let number = |event: &StreamEvent| event.data["batch"].as_u64().expect("a number");
    assert_eq!(number(&next[next.len() - 1]), number(before) + skipped + 1, "the count is right");

    has_history(&page);
    setup.stop();
    let state = silent(&page);
    assert_eq!(state["estimate"]["stale"], true, "{state}");
    let status = state["status"].as_str().expect("words");
    assert!(status.starts_with("no estimate for ") && status.ends_with("no displacement either"), "{status}");
    assert!(state["estimate"]["age_s"].as_f64() > Some(1.0));
}

#[test]
fn wrong_requests_and_excess_streams_are_refused_and_ctrl_c_ends_open_streams() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let mut page = Page::start(&["--domain-id", &domain.id().to_string(), "--dampers", "left,rear/right"]);
    let names = |json: &Json| {
        let all = json["dampers"].as_array().expect("a list").iter();
        all.map(|state| state["name"].as_str().expect("a name").to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(
        names(&page.snapshot()),
        ["left", "rear/right"],
        "dampers named by --dampers are shown before they publish"
    );
    let own = page.host();
    let port = own.rsplit(':').next().expect("a port");
    for (request, host, status) in [
        ("GET / ", own.clone(), 200),
        ("HEAD / ", own.clone(), 200),
        ("GET /page.js ", format!("localhost:{port}"), 200),
        ("GET /snapshot ", "evil.example".to_owned(), 421),
        ("GET /events ", format!("evil.example:{port}"), 421),
        ("GET / ", String::new(), 421),
        ("POST / ", own.clone(), 405),
        ("DELETE /snapshot ", own.clone(), 405),
        ("OPTIONS /events ", own.clone(), 405),
        ("GET /history?damper=left ", own.clone(), 200),
        ("GET /history?damper=rear/right&from_s=-1.5 ", own.clone(), 200),
        ("GET /history?damper=nobody ", own.clone(), 404),
        ("GET /history?damper=left&from_s=x ", own.clone(), 400),
        ("GET /history ", own.clone(), 400),
        ("GET /history?damper=left ", "evil.example".to_owned(), 421),
        ("GET /etc/passwd ", own.clone(), 404),
        ("GET /../Cargo.toml ", own.clone(), 404),
    ] {
        let answer = page.ask(request, &host, "");
        assert_eq!(answer.status, status, "{request} of {host}: {}", answer.head);
        for header in ["default-src 'none'", "nosniff", "no-store", "frame-ancestors 'none'"] {
            assert!(answer.head.contains(header), "{header} in {}", answer.head);
        }
        assert!(!answer.head.to_lowercase().contains("access-control"), "{}", answer.head);
    }
    for (path, site, status) in [
        ("/snapshot", "cross-site", 403),
        ("/events", "same-site", 403),
        ("/snapshot", "none", 200),
        ("/", "cross-site", 200),
    ] {
        let answer = page.ask(&format!("GET {path} "), &own, &format!("Sec-Fetch-Site: {site}\r\n"));
        assert_eq!(answer.status, status, "{path} from {site}");
    }
    // A page of an allowed origin may read the values, and nothing else.
    let friend =
        Page::start(&["--domain-id", &domain.id().to_string(), "--allow-origin", "http://localhost:8000"]);
    let from = |site: &str| format!("Origin: {site}\r\nSec-Fetch-Site: cross-site\r\n");
    for (request, site, status) in [
        ("GET /snapshot ", "http://localhost:8000", 200),
        ("GET /events ", "http://localhost:8000", 200),
        ("GET /snapshot ", "http://localhost:8001", 403),
        ("GET /page.js ", "http://localhost:8000", 403),
        ("GET /history?damper=left ", "http://localhost:8000", 403),
        ("POST /snapshot ", "http://localhost:8000", 403),
    ] {
        let answer = friend.ask(request, &friend.host(), &from(site));
        assert_eq!(answer.status, status, "{request} from {site}: {}", answer.body);
        let allows = answer.head.contains("access-control-allow-origin: http://localhost:8000\r\n");
        assert_eq!(allows, status == 200, "{request} from {site}: {}", answer.head);
    }
    assert_eq!(friend.ask("GET /snapshot ", "evil.example", &from("http://localhost:8000")).status, 421);
    // The page fetches nothing from elsewhere: it contains no address.
    let scripts = [
        "/page.js",
        "/overview.js",
        "/detail.js",
        "/range.js",
        "/charts.js",
        "/trails.js",
        "/export.js",
        "/words.js",
    ];
    for part in ["/", "/page.css"].into_iter().chain(scripts) {
        let body = page.ask(&format!("GET {part} "), &own, "").body;
        assert!(body.len() > 1000 && !body.contains("http:") && !body.contains("https:"), "{part}");
    }

    let mut open: Vec<Stream> = (0..16).map(|_| Stream::open(&page)).collect();
    let full = page.ask("GET /events ", &own, "");
    assert_eq!((full.status, full.body.contains("16 pages are open")), (503, true));
    drop(open.pop());
    let deadline = Instant::now() + Duration::from_secs(5);
    while page.ask("HEAD /events ", &own, "").status != 200 {
        assert!(Instant::now() < deadline, "the place of a closed stream is free again");
        std::thread::sleep(Duration::from_millis(50));
    }

    let pid = Pid::from_child(&page.child);
    let asked = Instant::now();
    kill_process(pid, Signal::INT).expect("it runs");
    let status = page.child.wait().expect("it ends");
    println!("ended {:.2?} after Ctrl-C", asked.elapsed());
    // Below one second on an idle machine.
    assert!(asked.elapsed() < Duration::from_secs(3), "it took {:?}", asked.elapsed());
    assert_eq!(status.code(), Some(0));
}

#[test]
fn the_mirror_on_zenoh_is_shown() {
    let _turn = turn(module_path!());
    let mut rig = zenoh_support::Rig::start();
    let page = Page::start(&["--zenoh", &rig.endpoint]);
    // `mr-damper top` runs at the same time, without a terminal.
    let mut top = Command::new(env!("CARGO_BIN_EXE_mr-damper"))
        .args(["top", "--zenoh", &rig.endpoint])
        .stdout(std::process::Stdio::piped())
        .spawn()
        .expect("it starts");
    let began = Instant::now();
    let (mut k, mut shown) = (0, Json::Null);
    // Waits for the first estimate, then continues for a second.
    while shown.is_null() || began.elapsed() < Duration::from_secs(2) {
        assert!(began.elapsed() < PATIENCE, "an estimate from the mirror: {}", page.snapshot());
        for _ in 0..20 {
            k += 1;
            rig.feeder.push(zenoh_support::displacement(k * 1_000_000));
            rig.feeder.push(zenoh_support::estimate(k * 1_000_000, k as f64));
            std::thread::sleep(Duration::from_millis(1));
        }
        shown = page.snapshot()["dampers"][0]["estimate"].clone();
    }
    let snapshot = page.snapshot();
    let damper = &snapshot["dampers"][0];
    assert_eq!((&snapshot["source"], &damper["name"]), (&"zenoh".into(), &zenoh_support::DAMPER.into()));
    let estimate = &damper["estimate"];
    let stamp_ns = estimate["stamp_ns"].as_i64().expect("a stamp");
    assert_eq!(estimate["force_n"].as_f64(), Some(stamp_ns as f64 / 1e6), "force and stamp belong together");
    assert_eq!(
        (&estimate["mode"], &estimate["validity"]),
        (&"model".into(), &"EXTRAPOLATING".into()),
        "{damper}"
    );
    assert_eq!(estimate["reasons"], serde_json::json!(["OUTSIDE_ENVELOPE"]));
    let hz = damper["rates_hz"]["force_estimate"].as_f64();
    assert!(hz > Some(10.0) && hz < Some(60.0), "thinned by the mirror: {damper}");
    // The mirror has stopped, and the page says so.
    rig.mirror.stop();
    silent(&page);
    // `top` prints a line a second, and says so too.
    let (mut printed, mut lines, stopped) =
        (top.stdout.take().expect("piped"), String::new(), Instant::now());
    let mut reader = BufReader::new(&mut printed);
    while !lines.contains("front_left: no estimate for") {
        assert!(stopped.elapsed() < PATIENCE, "waited for silence: {lines}");
        assert!(reader.read_line(&mut lines).expect("text") > 0, "it has ended: {lines}");
    }
    kill_process(Pid::from_child(&top), Signal::INT).expect("it runs");
    reader.read_to_string(&mut lines).expect("text");
    assert_eq!(top.wait().expect("it ends").code(), Some(0));
    let speaks = "front_left: EXTRAPOLATING, mode model: outside envelope; F ";
    assert!(lines.lines().any(|line| line.contains(speaks)), "{lines}");
    let last = lines.lines().last().expect("lines");
    assert!(last.contains("front_left: no estimate for") && !last.contains(" F "), "{lines}");
    assert!(!lines.contains('\u{1b}'), "no escape codes: {lines}");
}

#[test]
fn unusable_options_are_refused_with_a_message() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let taken = taken.local_addr().expect("an address").to_string();
    let domain = domain.id().to_string();
    for (arguments, code, says) in [
        (["--listen", "127.0.0.1:99999"], 2, "127.0.0.1:99999"),
        (["--listen", "0.0.0.0:8330"], 2, "--listen 0.0.0.0:8330 is not on loopback"),
        (["--dampers", "front-left"], 2, "\"front-left\" is not a namespace"),
        (["--lisen", "127.0.0.1:1"], 2, "--listen"),
        (["--allow-origin", "http://a/b"], 2, "no path"),
        (["--zenoh-config", "x.json5"], 2, "needs --zenoh endpoint"),
        (["--zenoh", "tcp/127.0.0.1:1"], 2, "cannot be used with"),
        (["--listen", taken.as_str()], 1, "choose another port"),
    ] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
        command.args(["serve", "--domain-id", &domain]).args(arguments);
        let output = command.output().expect("it runs");
        let stderr = String::from_utf8_lossy(&output.stderr).to_lowercase();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {stderr}");
        assert!(stderr.contains(says), "{arguments:?}: {stderr}");
        assert!(output.stdout.is_empty());
    }
}
