//! Access with the ready configurations of `launch-configs/zenoh`, each used to start a mirror: who may connect
//! and read.

use crate::domain::Domain;
use crate::serve_support::Page;
use crate::turn::turn;
use crate::wait::{PATIENCE, wait_until};
use crate::zenoh_support::keys::{Keys, connected, with_password};
use crate::zenoh_support::*;
use mr_damper_node::streams::sink::zenoh::{Link, ZenohConfig};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use zenoh::{Session, Wait};

/// Domain of the nodes that act as routers; nothing else uses it.
const MODEL: &str = "model:=thesis/fuzzy-tanh/rp3-cs";

/// A mirror with the ready configuration `name`; `scheme` is `tcp` or `tls`.
fn rig(keys: &Keys, name: &str, scheme: &str) -> Rig {
    let endpoint = endpoint().replace("tcp/", &format!("{scheme}/"));
    let link = Link::open(&keys.ready(name, &endpoint)).expect("the port is free");
    let (mirror, feeder) = mirror(&link, DAMPER);
    Rig { mirror, link, feeder, endpoint }
}

/// True if `session` gets an answer to one query of `tail`.
fn answered(session: &Session, tail: &str) -> bool {
    let selector = format!("mr_damper/{DAMPER}/{tail}");
    let replies = session.get(selector).timeout(Duration::from_secs(2)).wait().expect("a selector");
    replies.recv().is_ok_and(|reply| reply.result().is_ok())
}

/// Checks that an admitted session gets every sample.
fn assert_reads(session: &Session, rig: &mut Rig) {
    let inbox = subscribe(session, &format!("mr_damper/{DAMPER}/state/*"));
    rig.feeder.run(100, 500.0, |k| vec![estimate(i64::from(k) + 1, 7.0)]);
    wait_until("100 estimates", || inbox.of("force_estimate").len() == 100);
}

#[test]
fn with_mutual_tls_only_certificates_of_the_authority_may_read() {
    let _turn = turn(module_path!());
    let keys = Keys::new();
    let mut rig = rig(&keys, "mutual-tls.json5", "tls");
    let reader = keys.tls(&rig.endpoint, Some("reader"), "ca");
    assert_reads(&reader, &mut rig);

    let stranger = keys.tls(&rig.endpoint, Some("stranger"), "ca");
    let nameless = keys.tls(&rig.endpoint, None, "ca");
    let plain = session(&rig.endpoint.replace("tls/", "tcp/"), &[]);
    // This one has a valid certificate, but does not trust the node.
    let wary = keys.tls(&rig.endpoint, Some("reader"), "other-ca");
    for (who, session) in [("stranger", stranger), ("nameless", nameless), ("plain", plain), ("wary", wary)] {
        assert_eq!(connected(&session), 0, "{who}");
        assert!(!answered(&session, "status"), "{who}");
    }
    assert!(answered(&reader, "status"), "refused sessions do not block an admitted one");
}

#[test]
fn with_tls_clients_verify_the_node() {
    let _turn = turn(module_path!());
    let keys = Keys::new();
    let mut rig = rig(&keys, "tls.json5", "tls");
    assert_reads(&keys.tls(&rig.endpoint, None, "ca"), &mut rig);
    let wary = keys.tls(&rig.endpoint, None, "other-ca");
    assert_eq!(connected(&wary), 0);
    assert!(!answered(&wary, "status"));
}

#[test]
fn sessions_with_wrong_or_missing_credentials_receive_nothing() {
    let _turn = turn(module_path!());
    let keys = Keys::new();
    let mut rig = rig(&keys, "password.json5", "tcp");
    let reader = with_password(&rig.endpoint, "reader", "of the news");
    assert_reads(&reader, &mut rig);
    for (who, session) in [
        ("wrong password", with_password(&rig.endpoint, "reader", "of the olds")),
        ("another's password", with_password(&rig.endpoint, "reader", "of the four")),
        ("wrong name", with_password(&rig.endpoint, "writer", "of the news")),
        ("none", session(&rig.endpoint, &[])),
    ] {
        assert_eq!(connected(&session), 0, "{who}");
        assert!(!answered(&session, "status"), "{who}");
    }
    assert!(answered(&reader, "status"));
    // A reader may query only the keys that it may read.
    assert!(!answered(&reader, "cmd/*") && !answered(&reader, "secret"));
}

#[test]
fn a_page_shows_dampers_only_with_the_right_password() {
    let _turn = turn(module_path!());
    let keys = Keys::new();
    let mut rig = rig(&keys, "password.json5", "tcp");
    let file = |name: &str, password: &str| {
        let path = keys.path(name);
        let text = format!(
            "{{ transport: {{ auth: {{ usrpwd: {{ user: \"reader\", password: \"{password}\" }} }} }} }}"
        );
        std::fs::write(&path, text).expect("writable");
        path.display().to_string()
    };
    let (good, bad) = (file("good.json5", "of the news"), file("bad.json5", "of the olds"));
    let with = |more: &[&str]| Page::start(&[&["--zenoh", rig.endpoint.as_str()], more].concat());
    let [nobody, wrong, reader] =
        [with(&[]), with(&["--zenoh-config", &bad]), with(&["--zenoh-config", &good])];
    let (mut k, began) = (0, Instant::now());
    while reader.snapshot()["dampers"][0]["estimate"].is_null() {
        assert!(began.elapsed() < PATIENCE, "an estimate from the mirror: {}", reader.snapshot());
        k += 1;
        rig.feeder.push(estimate(k * 1_000_000, k as f64));
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(reader.snapshot()["dampers"][0]["name"], DAMPER);
    for page in [nobody, wrong] {
        assert_eq!(page.snapshot()["dampers"], serde_json::json!([]));
    }
    // A missing configuration file is an error and is not ignored.
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    let output = command
        .args(["top", "--zenoh", &rig.endpoint, "--zenoh-config", "nowhere.json5"])
        .output()
        .expect("it runs");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && stderr.contains("nowhere.json5"), "{stderr}");
}

#[test]
fn a_thin_link_gets_estimates_at_its_rate_and_no_denied_topics() {
    let _turn = turn(module_path!());
    let keys = Keys::new();
    let mut rig = rig(&keys, "thin.json5", "tcp");
    let session = session(&rig.endpoint, &[]);
    let inbox = subscribe(&session, &format!("mr_damper/{DAMPER}/state/*"));
    let (count, rate_hz) = (1000_u32, 500.0);
    rig.feeder.run(count, rate_hz, |k| {
        let at = i64::from(k) + 1;
        vec![displacement(at), estimate(at, 7.0), residual(at, 1.0)]
    });
    wait_until("every residual", || inbox.of("force_residual").len() == count as usize);
    let estimates = inbox.of("force_estimate").len();
    // 50 Hz over 2 s; a busy machine takes longer.
    assert!((50..=200).contains(&estimates), "{estimates} estimates");
    assert_eq!(inbox.of("displacement").len(), 0);
    let status = ask(&session, "status");
    let routes = status["routes"].as_array().expect("a list").clone();
    let of =
        |tail: &str| routes.iter().find(|route| route["key"].as_str().is_some_and(|key| key.ends_with(tail)));
    assert_eq!(
        of("state/displacement").expect("a route")["sent"],
        count,
        "the gap in seq shows the withheld samples"
    );
}

#[test]
fn an_embedded_router_forwards_between_other_sessions() {
    let _turn = turn(module_path!());
    let keys = Keys::new();
    let mut rig = rig(&keys, "router.json5", "tcp");
    let client = |_| session(&rig.endpoint, &[("mode", "\"client\"".to_owned())]);
    let [one, other] = [(); 2].map(client);
    let inbox = Inbox::default();
    let to = inbox.clone();
    one.declare_subscriber("dashboard/*")
        .callback(move |sample| to.push(sample))
        .background()
        .wait()
        .expect("a key");
    wait_until("a sample from the other session", || {
        other.put("dashboard/note", "hello").wait().expect("a session");
        inbox.len() > 0
    });
    assert_reads(&one, &mut rig);
}

/// A node that is a router, in its own process; killed when dropped.
struct RouterProcess(Child);

impl RouterProcess {
    /// Starts a router node, and waits until it listens at `endpoint`.
    fn start(domain: &Domain, endpoint: &str) -> Self {
        let config = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../launch-configs/zenoh/router.json5")
            .display()
            .to_string();
        let parameters =
            [format!("zenoh.config:={config}"), format!("zenoh.listen:=[\"{endpoint}\"]"), MODEL.to_owned()];
        let node = Command::new(env!("CARGO_BIN_EXE_mr-damper"))
            .args(["--quiet", "node", "--ros-args"])
            .args(parameters.iter().flat_map(|parameter| ["-p", parameter]))
            .env("ROS_DOMAIN_ID", domain.id().to_string())
            .stdin(Stdio::null())
            .spawn();
        let router = Self(node.expect("the node starts"));
        let address = endpoint.trim_start_matches("tcp/");
        wait_until("the router listens", || TcpStream::connect(address).is_ok());
        router
    }
}

impl Drop for RouterProcess {
    fn drop(&mut self) {
        // SIGKILL: no peer is notified.
        self.0.kill().expect("it runs");
        self.0.wait().expect("it was killed");
    }
}

#[test]
fn a_client_reconnects_soon_after_its_router_was_killed() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let keys = Keys::new();
    let at = endpoint();
    let config =
        ZenohConfig { listen: Vec::new(), connect: vec![at.clone()], ..keys.ready("client.json5", &at) };
    let link = Link::open(&config).expect("a client starts in any case");
    let first = RouterProcess::start(&domain, &at);
    wait_until("the router", || link.connected() == 1);
    drop(first);
    wait_until("that it is gone", || link.connected() == 0);
    // Long enough for retries to reach their largest spacing.
    std::thread::sleep(Duration::from_secs(4));
    let _second = RouterProcess::start(&domain, &at);
    let back = Instant::now();
    wait_until("the router again", || link.connected() == 1);
    let took = back.elapsed();
    eprintln!("a router that came back was found {took:?} after it listened");
    // Retries are at most a second apart. On a busy machine they may be late.
    assert!(took < Duration::from_secs(3), "{took:?}");
}

#[test]
fn late_joiners_get_the_last_value_of_each_key() {
    let _turn = turn(module_path!());
    let mut rig = Rig::start();
    rig.feeder
        .run(3, 100.0, |k| vec![displacement(i64::from(k) + 1), estimate(i64::from(k) + 1, f64::from(k))]);
    let late = session(&rig.endpoint, &[]);
    wait_until("the third sample is counted", || {
        ask(&late, "status")["routes"]
            .as_array()
            .is_some_and(|routes| routes.iter().any(|route| route["sent"] == 3))
    });
    let last = |selector: &str| {
        let replies = late.get(format!("mr_damper/{selector}")).wait().expect("a selector");
        replies.into_iter().map(|reply| reply.into_result().expect("a sample")).collect::<Vec<_>>()
    };
    let estimates = last("*/state/force_estimate");
    assert_eq!(estimates.len(), 1);
    let value = cbor(&estimates[0]);
    assert_eq!((&value["seq"], &value["force_n"]), (&3.into(), &2.0.into()));
    let mut keys: Vec<_> =
        last(&format!("{DAMPER}/state/*")).iter().map(|s| s.key_expr().to_string()).collect();
    keys.sort();
    assert_eq!(
        keys,
        ["mr_damper/front_left/state/displacement", "mr_damper/front_left/state/force_estimate"]
    );
    wait_until("web value", || last("**/web/force_estimate").iter().any(|s| json(s)["force_n"] == 2.0));
    assert!(last(&format!("{DAMPER}/state/measured_force")).is_empty(), "no force was measured");
}
