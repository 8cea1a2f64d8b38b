//! The endpoint for Foxglove, Lichtblick and PlotJuggler as a process: over real DDS (`serve --foxglove`), and for recordings
//! (`replay --foxglove`).

use crate::domain::Domain;
use crate::turn::turn;
use crate::zenoh_support;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_msgs::standard::{Header, Time};
use mr_damper_msgs::{Displacement, Force, ForceEstimate, cdr};
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::ros2::participant::Ros;
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use mr_damper_node::settings::interrupt::Interrupt;
use mr_damper_node::streams::player::{PlaybackOptions, Played, Player};
use mr_damper_runs::{BagOptions, BagWriter, SaveOptions, Topic, save};
use ros2_client::NodeOptions;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value as Json, json};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, ErrorKind};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Error, Message, WebSocket};

/// Time limit of an answer on a busy machine.
const ANSWER: Duration = Duration::from_secs(20);
/// Duration of the played run, s.
const RUN_S: f64 = 3.0;

/// A process with an endpoint on a free port. It is killed at the end of the test, even if the test fails.
struct Endpoint {
    child: Child,
    address: SocketAddr,
}

impl Endpoint {
    fn start(arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
        let mut child = command.args(arguments).stdout(Stdio::piped()).spawn().expect("it starts");
        let stdout = BufReader::new(child.stdout.as_mut().expect("piped"));
        let address = stdout.lines().map_while(Result::ok).find_map(|line| {
            let address = line.strip_prefix("ws://")?;
            Some(address.parse().unwrap_or_else(|_| panic!("no address: {line}")))
        });
        Self { address: address.expect("it says where viewers connect"), child }
    }

    /// Ends the process as Ctrl-C does, and checks that it succeeds within a second or so.
    fn interrupt(mut self) {
        let id = Pid::from_raw(i32::try_from(self.child.id()).expect("an id")).expect("not zero");
        kill_process(id, Signal::INT).expect("it runs");
        let begun = Instant::now();
        let status = self.child.wait().expect("a child of ours");
        assert!(status.success(), "{status}");
        assert!(begun.elapsed() < Duration::from_secs(10), "it took {:?} to end", begun.elapsed());
    }
}

impl Drop for Endpoint {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The messages that a viewer received: payloads with their log times, by topic.
type Received = BTreeMap<String, Vec<(u64, Vec<u8>)>>;

/// A viewer that subscribes to every channel.
struct Viewer {
    socket: WebSocket<TcpStream>,
    info: Json,
    topics: Vec<String>,
    received: Received,
    times: Vec<u64>,
    /// Parameters by name.
    parameters: BTreeMap<String, Json>,
}

impl Viewer {
    fn connect(endpoint: &Endpoint) -> Self {
        let mut request = format!("ws://{}", endpoint.address).into_client_request().expect("a URL");
        request.headers_mut().insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().expect("a header"));
        let stream = TcpStream::connect(endpoint.address).expect("it listens");
        stream.set_read_timeout(Some(Duration::from_millis(100))).expect("a time");
        let (socket, _) = tungstenite::client(request, stream).expect("connected");
        let (info, topics) = (Json::Null, Vec::new());
        Self {
            socket,
            info,
            topics,
            received: Received::new(),
            times: Vec::new(),
            parameters: BTreeMap::new(),
        }
    }

    /// Reads and subscribes until `done`.
    fn read_until(&mut self, what: &str, mut done: impl FnMut(&Self) -> bool) {
        let deadline = Instant::now() + ANSWER;
        while !done(self) {
            assert!(Instant::now() < deadline, "waited for {what}: {:?}, {:?}", self.topics, self.counts());
            match self.socket.read() {
                Ok(Message::Text(text)) => self.take(&serde_json::from_str(&text).expect("JSON")),
                Ok(Message::Binary(bytes)) if bytes[0] == 1 => {
                    let topic = self.topics[number(&bytes[1..5]) as usize].clone();
                    self.received
                        .entry(topic)
                        .or_default()
                        .push((number(&bytes[5..13]), bytes[13..].to_vec()));
                }
                Ok(Message::Binary(bytes)) => self.times.push(number(&bytes[1..9])),
                Ok(_) => {}
                Err(Error::Io(error))
                    if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Err(error) => panic!("{error}"),
            }
        }
    }

    fn take(&mut self, message: &Json) {
        match message["op"].as_str() {
            Some("serverInfo") => self.info = message.clone(),
            Some("advertise") => {
                for channel in message["channels"].as_array().expect("channels") {
                    let id = channel["id"].as_u64().expect("a number");
                    assert_eq!(id as usize, self.topics.len(), "channels are numbered");
                    self.topics.push(channel["topic"].as_str().expect("a topic").to_owned());
                    let subscription = json!({"id": id, "channelId": id});
                    self.send(&json!({"op": "subscribe", "subscriptions": [subscription]}));
                }
            }
            Some("parameterValues") => {
                let parameters = message["parameters"].as_array().expect("parameters").iter();
                self.parameters.extend(
                    parameters.map(|of| (of["name"].as_str().expect("a name").to_owned(), of.clone())),
                );
            }
            _ => panic!("{message}"),
        }
    }

    fn send(&mut self, request: &Json) {
        self.socket.send(Message::Text(request.to_string().into())).expect("sent");
    }

    fn count(&self, topic: &str) -> usize {
        self.received.get(topic).map_or(0, Vec::len)
    }

    fn counts(&self) -> Vec<(&String, usize)> {
        self.received.iter().map(|(topic, messages)| (topic, messages.len())).collect()
    }
}

/// A little-endian number.
fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte))
}

#[test]
fn live_estimates_are_bit_identical_to_the_topics_and_ctrl_c_disconnects_viewers() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let mut config = Config { domain_id: domain.id(), ..Config::default() };
    config.set("model", &Value::Text("thesis/fuzzy-tanh/rp3-cs".into())).expect("a text");
    let args = RosArgs::in_namespace("/left");
    let (service, _) = DamperNode::start(&config, &args, false).expect("the service starts");
    let mut ros = Ros::start(&config, &args, NodeOptions::new(), "peer").expect("a peer starts");
    let estimates = ros.subscribe::<ForceEstimate>("/left/force_estimate").expect("a topic");
    let player = Player::start(&config, &args, false).expect("the player starts");
    let id = domain.id().to_string();
    let endpoint =
        Endpoint::start(&["serve", "--listen", "127.0.0.1:0", "--foxglove=127.0.0.1:0", "--domain-id", &id]);
    let mut viewer = Viewer::connect(&endpoint);
    viewer.read_until("the damper's channels", |viewer| viewer.topics.len() == 12);
    assert_eq!(viewer.info["capabilities"], json!(["parameters"]), "live messages have their own times");
    viewer.send(&json!({"op": "getParameters", "parameterNames": [], "id": "all"}));
    let model = "/left/mr_damper.model";
    viewer.read_until("the node's parameters", |viewer| viewer.parameters.contains_key(model));
    assert_eq!(viewer.parameters[model]["value"], "thesis/fuzzy-tanh/rp3-cs");
    let coast = &viewer.parameters["/left/mr_damper.coast_s"];
    assert_eq!((&coast["value"], &coast["type"]), (&json!(config.settings.coast_s), &json!("float64")));
    // A second viewer, which never reads, delays nobody.
    let _idle = Viewer::connect(&endpoint);

    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(RUN_S);
    let run = record(&experiment, &Plant::default(), &Channels::default(), 5);
    let interrupt = Interrupt::manual();
    assert!(player.wait_for_listener(ANSWER, &interrupt), "the node listens");
    // A held estimate has the stamp of the estimate that is held, so a stamp may have several.
    let mut heard: BTreeMap<u64, Vec<Vec<u8>>> = BTreeMap::new();
    std::thread::scope(|threads| {
        let playing = threads.spawn(|| {
            player.play(&run, &PlaybackOptions::default(), &mut Played::default(), &interrupt, None, &|_| {});
            std::thread::sleep(Duration::from_millis(500));
        });
        viewer.read_until("the end of the run", |_| {
            let is_over = playing.is_finished();
            while let Some((estimate, _)) = estimates.take().expect("readable") {
                let stamp_ns = estimate.header.stamp.as_nanos() as u64;
                heard.entry(stamp_ns).or_default().push(cdr::to_vec(&estimate).expect("written"));
            }
            is_over
        });
    });
    let seen = &viewer.received["/left/force_estimate"];
    let known = seen.iter().filter_map(|(time, bytes)| Some((heard.get(time)?, bytes)));
    let same = known.clone().filter(|(heard, bytes)| heard.contains(bytes)).count();
    println!("{same} of {} estimates are bit-identical; the peer heard {} stamps", seen.len(), heard.len());
    assert_eq!(same, known.count(), "an estimate has the content of the topic");
    // The peer and the endpoint may each miss the first ones, before they have discovered the node.
    assert!(same * 100 >= heard.len() * 98 && same > 1400, "{same} of {}", heard.len());
    for topic in ["/left/displacement", "/left/measured_force", "/left/force_residual", "/left/mode"] {
        assert!(viewer.count(topic) > 0, "{topic}: {:?}", viewer.counts());
    }
    endpoint.interrupt();
    player.stop();
    service.stop().expect("no thread panicked");
    drop(estimates);
    ros.stop();
}

#[test]
fn the_mirror_on_zenoh_is_passed_on_under_the_names_of_ros() {
    let _turn = turn(module_path!());
    let mut rig = zenoh_support::Rig::start();
    let page = ["--listen", "127.0.0.1:0", "--foxglove=127.0.0.1:0"];
    let endpoint = Endpoint::start(&[&["serve", "--zenoh", &rig.endpoint][..], &page].concat());
    let mut viewer = Viewer::connect(&endpoint);
    let topic = format!("/{}/force_estimate", zenoh_support::DAMPER);
    let mut k = 0;
    viewer.read_until("estimates", |viewer| {
        rig.feeder.push(zenoh_support::displacement(k * 1_000_000));
        rig.feeder.push(zenoh_support::estimate(k * 1_000_000, k as f64));
        k += 1;
        viewer.count(&topic) >= 3
    });
    for (time, bytes) in &viewer.received[&topic] {
        let estimate = cdr::from_slice::<ForceEstimate>(bytes).expect("readable");
        assert_eq!(estimate.header.stamp.as_nanos() as u64, *time);
        assert_eq!(estimate.force, (time / 1_000_000) as f64, "the estimate of its stamp");
    }
    assert_eq!(viewer.info["capabilities"], json!([]), "the mirror carries no parameters");
    endpoint.interrupt();
}

/// Writes a bag of displacements, an estimate, and a topic of an unknown type; returns the messages by topic.
fn bag(path: &Path) -> Received {
    let options = BagOptions::default();
    let mut bag = BagWriter::create(path, options).expect("a new directory");
    let displacements = bag.topic(&Topic::of::<Displacement>("/left/displacement")).expect("a topic");
    let estimates = bag.topic(&Topic::of::<ForceEstimate>("/left/force_estimate")).expect("a topic");
    let foreign = Topic { type_name: "their_msgs/msg/Thing", ..Topic::of::<Force>("/thing") };
    let foreign = bag.topic(&foreign).expect("a topic");
    let mut written = Received::new();
    for k in 0..100_u32 {
        // The time of recording is later than the stamp.
        let (stamp_ns, log_ns) = (1_700_000_000_000_000_000 + i64::from(k) * 5_000_000, 300_000);
        let log_ns = stamp_ns + log_ns;
        let stamp = Time::from_nanos(stamp_ns).expect("in range");
        let header = Header { stamp, frame_id: "left".into() };
        let displacement =
            Displacement { header: header.clone(), displacement: f64::from(k) / 3e3, variance: 0.0 };
        let estimate = ForceEstimate {
            header,
            force: f64::from(k) / 7.0,
            band_low: f64::NAN,
            ..ForceEstimate::default()
        };
        let bytes = [cdr::to_vec(&displacement), cdr::to_vec(&estimate)].map(|bytes| bytes.expect("written"));
        for (id, topic, bytes) in
            [(displacements, "/left/displacement", &bytes[0]), (estimates, "/left/force_estimate", &bytes[1])]
        {
            bag.write(id, log_ns, log_ns, bytes).expect("written");
            written.entry(topic.to_owned()).or_default().push((log_ns as u64, bytes.clone()));
        }
        bag.write(foreign, log_ns, log_ns, &bytes[0]).expect("written");
    }
    let _ = bag.finish().expect("finished");
    written
}

#[test]
fn a_bag_is_played_with_all_messages_of_known_types_and_its_own_times() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("bag");
    let written = bag(&path);
    let path = path.to_str().expect("UTF-8");
    let endpoint = Endpoint::start(&["--quiet", "replay", "--foxglove=127.0.0.1:0", path]);
    let mut viewer = Viewer::connect(&endpoint);
    viewer.read_until("all estimates", |viewer| viewer.count("/left/force_estimate") == 100);
    assert_eq!(viewer.info["capabilities"], json!(["time"]));
    assert_eq!(viewer.received, written, "bytes, times and order are the same as in the bag");
    let log_times: Vec<u64> = written["/left/displacement"].iter().map(|(time, _)| *time).collect();
    assert_eq!(viewer.times, log_times, "each time is sent once, before its messages");
    // Playing has ended, and the viewer stays connected.
    viewer.socket.send(Message::Text(r#"{"op": "setParameters"}"#.into())).expect("sent");
    let refusal = loop {
        match viewer.socket.read() {
            Ok(Message::Text(text)) => break text,
            Ok(_) => {}
            Err(Error::Io(error)) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(error) => panic!("{error}"),
        }
    };
    assert!(refusal.contains("read-only"), "{refusal}");
    endpoint.interrupt();
}

#[test]
fn a_csv_run_is_played_in_a_part_and_at_another_speed() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("run.csv");
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(RUN_S);
    let run = record(&experiment, &Plant::default(), &Channels::default(), 5);
    save(&run, &path, &SaveOptions::default()).expect("room in the temporary directory");
    let path = path.to_str().expect("UTF-8");
    let part = ["--start", "1", "--duration", "1", "--rate", "2"];
    let endpoint =
        Endpoint::start(&[&["--quiet", "replay", "--foxglove=127.0.0.1:0", path], &part[..]].concat());
    let mut viewer = Viewer::connect(&endpoint);
    let expected: Vec<(i64, f64)> = (run.displacement_m.stamps.iter().zip(&run.displacement_m.values))
        .map(|(stamp, value)| (stamp.nanos(), *value))
        .filter(|(nanos, _)| {
            let from_ns = run.displacement_m.stamps[0].nanos();
            (from_ns + 1_000_000_000..from_ns + 2_000_000_000).contains(nanos)
        })
        .collect();
    let begun = Instant::now();
    viewer.read_until("the part", |viewer| viewer.count("/displacement") >= expected.len());
    assert!(
        begun.elapsed() > Duration::from_millis(400),
        "a second at twice the speed took {:?}",
        begun.elapsed()
    );
    let seen: Vec<(i64, f64)> = viewer.received["/displacement"]
        .iter()
        .map(|(_, bytes)| cdr::from_slice::<Displacement>(bytes).expect("readable"))
        .map(|message| (message.header.stamp.as_nanos(), message.displacement))
        .collect();
    assert_eq!(seen, expected);
    assert!(
        viewer.count("/measured_force") > 100 && viewer.count("/coil_current") > 100,
        "{:?}",
        viewer.counts()
    );
    endpoint.interrupt();
}

#[test]
fn options_that_do_not_fit_are_refused_and_addresses_beyond_loopback_need_a_flag() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    std::fs::write(dir.path().join("early.csv"), "time_s,displacement_m\n-1.5,0\n0,0.1\n").expect("written");
    for (arguments, code, says) in [
        (&["serve", "--foxglove=0.0.0.0:8765"][..], 1, "--foxglove=0.0.0.0:8765 is not on loopback"),
        (&["serve", "--foxglove=nowhere"], 2, "invalid socket address"),
        (&["replay", "--foxglove", "early.csv", "--clock"], 2, "--clock is for ROS"),
        (&["replay", "--foxglove", "early.csv", "--remap", "a:=b"], 2, "--remap is for ROS"),
        (&["replay", "early.csv", "--allow-origin", "http://localhost:1"], 2, "--foxglove"),
        (&["replay", "--foxglove", "early.csv"], 1, "time -1.5 s is negative"),
        (&["replay", "--foxglove", "absent.mcap"], 1, "absent.mcap: cannot open"),
    ] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
        let out = command.args(arguments).current_dir(dir.path()).output().expect("it runs");
        let text = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(code), "{arguments:?}: {text}");
        assert!(text.contains(says), "{arguments:?}: {text}");
    }
}
