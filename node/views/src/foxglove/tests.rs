//! Tests of the endpoint: the protocol's messages, the queue, and connections over TCP.

use super::protocol::{self, Level, Reply, Request, Subscription};
use super::queue::{MOST_BYTES, MOST_REPLIES, Queue, SubscribeError, Waiting};
use super::server::is_local;
use super::*;
use mr_damper_msgs::standard::{Float64, Header, Time};
use mr_damper_msgs::{Descriptor, Force, Message as _, cdr, rcl};
use serde_json::{Value, json};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::Duration;
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

const SUBSCRIPTION: Subscription = Subscription { id: 7, channel_id: 0 };

#[test]
fn requests_of_the_specification_are_read() {
    // The examples of the specification.
    let read = |text: &str| Request::read(text).unwrap_or_else(|error| panic!("{text}: {error}"));
    let subscribe =
        r#"{"op": "subscribe", "subscriptions": [{"id": 0, "channelId": 3}, {"id": 1, "channelId": 5}]}"#;
    let subscriptions = [(0, 3), (1, 5)].map(|(id, channel_id)| Subscription { id, channel_id });
    assert_eq!(read(subscribe), Request::Subscribe(subscriptions.into()));
    assert_eq!(read(r#"{"op": "unsubscribe", "subscriptionIds": [0, 1]}"#), Request::Unsubscribe(vec![0, 1]));
    let get = r#"{"op": "getParameters", "parameterNames": ["/int_param"], "id": "request-123"}"#;
    assert_eq!(read(get), Request::GetParameters(vec!["/int_param".into()], Some("request-123".into())));
    let set =
        r#"{"op": "setParameters", "parameters": [{"name": "/a", "value": 3}, {"name": "/b"}], "id": "q"}"#;
    assert_eq!(read(set), Request::SetParameters(vec!["/a".into(), "/b".into()], Some("q".into())));
    for other in ["advertise", "unadvertise", "subscribeParameterUpdates", "fetchAsset", "x"] {
        assert_eq!(
            read(&format!(r#"{{"op": "{other}", "channels": 1}}"#)),
            Request::NotOffered(other.into())
        );
    }
    let binary = Request::read_binary(&[1, 0, 0, 0, 0, 9]).expect("an opcode");
    assert_eq!(binary, Request::NotOffered("message data".into()));
}

#[test]
fn unreadable_requests_are_errors_that_show_the_beginning() {
    let long = format!("\u{7}{}", "x".repeat(1000));
    for (text, says) in [
        ("", "message \"\" is not a JSON object"),
        ("[]", "message \"[]\" is not a JSON object"),
        (r#"{"a": 1}"#, "missing field `op`"),
        (r#"{"op": "subscribe"}"#, "message \"subscribe\" cannot be read: missing field `subscriptions`"),
        (
            r#"{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 0}]}"#,
            "invalid value: integer `-1`",
        ),
        (r#"{"op": "unsubscribe", "subscriptionIds": [4294967296]}"#, "invalid value: integer `4294967296`"),
        (&long, "message \" xxx"),
    ] {
        let error = Request::read(text).expect_err(text).to_string();
        assert!(error.contains(says) && error.len() < 300, "{error}");
    }
    assert!(Request::read_binary(&[]).is_err());
}

#[test]
fn messages_to_viewers_have_the_form_of_the_specification() {
    assert_eq!(
        protocol::message_data(0x0102, 0x0304, &[9, 8])[..],
        [1, 2, 1, 0, 0, 4, 3, 0, 0, 0, 0, 0, 0, 9, 8]
    );
    assert_eq!(protocol::time(1)[..], [2, 1, 0, 0, 0, 0, 0, 0, 0]);
    let status = Reply::Status { level: Level::Warning, message: "m" }.text();
    let status: Value = serde_json::from_str(&status).expect("JSON");
    assert_eq!(status, json!({"op": "status", "level": 1, "message": "m"}));
    let info = Reply::ServerInfo { name: "n", capabilities: &["time"], session_id: "1" }.text();
    let info: Value = serde_json::from_str(&info).expect("JSON");
    assert_eq!(info, json!({"op": "serverInfo", "name": "n", "capabilities": ["time"], "sessionId": "1"}));
}

#[test]
fn parameters_keep_their_types() {
    use rcl::ParameterValue as Ros;
    let shown = |of: Ros| serde_json::to_value(parameters::parameter_value("p".into(), &of)).expect("JSON");
    let double = |double_value| Ros { r#type: Ros::DOUBLE, double_value, ..Ros::default() };
    assert_eq!(shown(double(2.0)), json!({"name": "p", "value": 2.0, "type": "float64"}));
    assert_eq!(shown(double(f64::NAN)), json!({"name": "p"}));
    assert_eq!(
        shown(Ros { r#type: Ros::INTEGER, integer_value: 2, ..Ros::default() }),
        json!({"name": "p", "value": 2})
    );
    let text = Ros { r#type: Ros::STRING, string_value: "x".into(), ..Ros::default() };
    assert_eq!(shown(text), json!({"name": "p", "value": "x"}));
    let list = Ros { r#type: Ros::DOUBLE_ARRAY, double_array_value: vec![1.0, 2.5], ..Ros::default() };
    assert_eq!(shown(list), json!({"name": "p", "value": [1.0, 2.5], "type": "float64_array"}));
    assert_eq!(shown(Ros::default()), json!({"name": "p"}));
}

#[test]
fn a_full_queue_drops_the_oldest_messages_and_counts_them() {
    let mut queue = Queue::default();
    queue.subscribe(SUBSCRIPTION, 1).expect("a channel");
    let payload: Arc<[u8]> = vec![0; 1000].into();
    let count = 2 * MOST_BYTES / 1000;
    for time in 0..count {
        queue.message(0, time as u64, &payload);
    }
    // Of a channel without subscription nothing is kept.
    queue.message(1, 0, &payload);
    let kept = queue.due(usize::MAX).messages;
    assert_eq!(queue.take_dropped(), (count - kept.len()) as u64);
    assert_eq!(queue.take_dropped(), 0);
    assert!(kept.len() * 1000 <= MOST_BYTES && kept.len() * 1200 > MOST_BYTES, "{} messages", kept.len());
    let times: Vec<u64> = kept
        .iter()
        .map(|of| if let Waiting::Message(7, time, _) = of { *time } else { panic!("{of:?}") })
        .collect();
    let newest: Vec<u64> = (count - kept.len()..count).map(|time| time as u64).collect();
    assert_eq!(times, newest, "the newest messages, in their order");
    // The bytes are counted back.
    queue.message(0, 1, &payload);
    assert_eq!((queue.due(1).messages.len(), queue.take_dropped()), (1, 0));
}

#[test]
fn replies_are_bounded_and_not_dropped_silently() {
    let mut queue = Queue::default();
    for _ in 0..MOST_REPLIES {
        queue.reply("r".into());
    }
    assert!(!queue.has_overflowed());
    queue.reply("one too many".into());
    assert!(queue.has_overflowed());
}

#[test]
fn subscriptions_are_checked() {
    let mut queue = Queue::default();
    let of = |id, channel_id| Subscription { id, channel_id };
    assert_eq!(queue.subscribe(of(1, 2), 2), Err(SubscribeError::NoChannel { id: 1, channel: 2 }));
    assert_eq!(queue.subscribe(of(1, 0), 2), Ok(()));
    assert_eq!(queue.subscribe(of(1, 1), 2), Err(SubscribeError::Taken { id: 1 }));
    assert_eq!(queue.subscribe(of(2, 0), 2), Err(SubscribeError::Twice { id: 2, channel: 0 }));
    queue.message(0, 1, &vec![1].into());
    assert!(queue.unsubscribe(1) && !queue.unsubscribe(1));
    assert!(queue.due(9).messages.is_empty(), "nothing of an ended subscription is sent");
}

#[test]
fn only_pages_of_this_machine_are_local() {
    for local in
        ["", "file://", "http://localhost:8080", "https://LOCALHOST", "http://127.0.0.1:9", "http://[::1]:9"]
    {
        assert!(is_local(local), "{local}");
    }
    for other in [
        "null",
        "https://app.foxglove.dev",
        "http://localhost.evil.example",
        "http://127.0.0.1.evil.example",
        "http://localhost@evil.example",
        "http://evil@localhost",
        "http://10.0.0.1",
        "chrome-extension://localhost",
        "?",
    ] {
        assert!(!is_local(other), "{other}");
    }
}

/// An endpoint with the channels of `/x` (forces) and `/y`.
struct Endpoint {
    server: FoxgloveServer,
    channels: Arc<Channels>,
    x: ChannelId,
}

impl Endpoint {
    fn start(channels: Channels) -> Self {
        let channels = Arc::new(channels);
        let x = channels.add("/x", Descriptor::of::<Force>());
        channels.add("/y", Descriptor::of::<Float64>());
        let origins = ["https://app.foxglove.dev".parse().expect("an origin")];
        let address = "127.0.0.1:0".parse().expect("an address");
        let server =
            FoxgloveServer::start(address, false, &origins, Arc::clone(&channels)).expect("a free port");
        Self { server, channels, x }
    }

    /// Connects with these headers; the error is the status of the answer.
    fn connect(&self, headers: &[(&'static str, &str)]) -> Result<Client, u16> {
        let mut request =
            format!("ws://{}/any/path", self.server.address()).into_client_request().expect("a URL");
        for (name, value) in headers {
            request.headers_mut().insert(*name, value.parse().expect("a header"));
        }
        let stream = TcpStream::connect(self.server.address()).expect("it listens");
        stream.set_read_timeout(Some(Duration::from_secs(10))).expect("a time");
        match tungstenite::client(request, stream) {
            Ok((socket, answer)) => {
                let protocol = answer.headers().get("sec-websocket-protocol").expect("a subprotocol");
                Ok(Client { socket, protocol: protocol.to_str().expect("text").to_owned() })
            }
            Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(answer))) => {
                Err(answer.status().as_u16())
            }
            Err(other) => panic!("{other}"),
        }
    }

    fn viewer(&self) -> Client {
        let mut client =
            self.connect(&[("sec-websocket-protocol", "foxglove.websocket.v1")]).expect("connected");
        assert_eq!(client.json()["op"], "serverInfo");
        assert_eq!(client.json()["op"], "advertise");
        client
    }
}

struct Client {
    socket: WebSocket<TcpStream>,
    protocol: String,
}

impl Client {
    fn send(&mut self, text: Value) {
        self.socket.send(Message::Text(text.to_string().into())).expect("sent");
    }

    fn json(&mut self) -> Value {
        match self.socket.read().expect("a message") {
            Message::Text(text) => serde_json::from_str(&text).expect("JSON"),
            other => panic!("not a text: {other:?}"),
        }
    }

    fn binary(&mut self) -> Vec<u8> {
        match self.socket.read().expect("a message") {
            Message::Binary(bytes) => bytes.to_vec(),
            other => panic!("not binary: {other:?}"),
        }
    }
}

fn force(force: f64) -> Vec<u8> {
    let header = Header { stamp: Time { sec: 1, nanosec: 2 }, frame_id: "damper".into() };
    cdr::to_vec(&Force { header, force, variance: f64::NAN }).expect("written")
}

#[test]
fn both_subprotocols_connect_and_others_are_refused() {
    let endpoint = Endpoint::start(Channels::live("s".into(), false));
    for (offered, selected) in [
        ("foxglove.websocket.v1", "foxglove.websocket.v1"),
        ("foxglove.sdk.v1", "foxglove.sdk.v1"),
        ("foxglove.websocket.v1, foxglove.sdk.v1", "foxglove.sdk.v1"),
    ] {
        let mut client = endpoint.connect(&[("sec-websocket-protocol", offered)]).expect(offered);
        assert_eq!(client.protocol, selected);
        let info = client.json();
        assert_eq!((&info["op"], &info["capabilities"]), (&json!("serverInfo"), &json!([])));
        let channels = client.json()["channels"].clone();
        assert_eq!(channels[0]["topic"], "/x");
        assert_eq!(channels[0]["schemaName"], Force::TYPE);
        assert_eq!(channels[0]["schema"], Force::DEFINITION);
        assert_eq!(
            (&channels[0]["encoding"], &channels[0]["schemaEncoding"]),
            (&json!("cdr"), &json!("ros2msg"))
        );
    }
    assert_eq!(endpoint.connect(&[("sec-websocket-protocol", "graphql")]).err(), Some(400));
    assert_eq!(endpoint.connect(&[]).err(), Some(400));
    endpoint.server.stop().expect("no error");
}

#[test]
fn hosts_and_origins_are_checked() {
    let endpoint = Endpoint::start(Channels::live("s".into(), false));
    let connect =
        |name, value| endpoint.connect(&[("sec-websocket-protocol", "foxglove.sdk.v1"), (name, value)]).err();
    assert_eq!(connect("origin", "http://localhost:8080"), None);
    assert_eq!(connect("origin", "https://app.foxglove.dev"), None, "it is allowed by name");
    for origin in ["https://evil.example", "null", "https://app.foxglove.dev.evil.example"] {
        assert_eq!(connect("origin", origin), Some(403), "{origin}");
    }
    assert_eq!(connect("host", "evil.example:8765"), Some(421));
    let beyond = require_loopback_for_viewers("0.0.0.0:8765".parse().expect("an address"), false);
    let says = beyond.expect_err("refused").to_string();
    assert!(
        says.starts_with("--foxglove=0.0.0.0:8765 is not on loopback") && says.contains("ssh -L 8765:"),
        "{says}"
    );
}

#[test]
fn subscribers_get_all_bytes_and_later_viewers_the_kept_message() {
    let endpoint = Endpoint::start(Channels::live("s".into(), false));
    let mut viewer = endpoint.viewer();
    assert!(!endpoint.channels.is_wanted(endpoint.x));
    assert_eq!(endpoint.channels.subscribers(), 0);
    viewer.send(
        json!({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": 0}, {"id": 8, "channelId": 9}]}),
    );
    // The reply to the wrong subscription says that the right one is in effect.
    let refusal = viewer.json();
    assert_eq!((&refusal["op"], &refusal["level"]), (&json!("status"), &json!(2)));
    assert!(refusal["message"].as_str().expect("a text").contains("channel 9 does not exist"), "{refusal}");
    assert!(endpoint.channels.is_wanted(endpoint.x));
    let bytes = force(-512.25);
    endpoint.channels.publish(endpoint.x, 1_000_000_002, &bytes);
    assert_eq!(viewer.binary(), protocol::message_data(7, 1_000_000_002, &bytes));
    endpoint.channels.publish(endpoint.x, -1, &bytes);
    assert_eq!(viewer.binary(), protocol::message_data(7, 0, &bytes), "times before 1970 are sent as 0");
    // A new channel is advertised to connected viewers, and its kept message is sent on subscription.
    let mode = endpoint.channels.add("/mode", Descriptor::of::<Force>());
    assert_eq!(viewer.json()["channels"][0]["id"], 2);
    endpoint.channels.publish_kept(mode, 5, &bytes);
    viewer.send(json!({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 2}]}));
    assert_eq!(viewer.binary(), protocol::message_data(1, 5, &bytes));
}

#[test]
fn requests_to_change_something_are_refused() {
    let endpoint = Endpoint::start(Channels::live("s".into(), true));
    let double = rcl::ParameterValue { r#type: 3, double_value: 2.5, ..rcl::ParameterValue::default() };
    let parameter = rcl::Parameter { name: "coast_s".into(), value: double };
    endpoint.channels.set_parameters("/left/mr_damper", &[parameter]);
    let mut viewer = endpoint.viewer();
    let asked = json!({"op": "getParameters", "parameterNames": [], "id": "all"});
    let values = json!({"op": "parameterValues", "id": "all",
        "parameters": [{"name": "/left/mr_damper.coast_s", "value": 2.5, "type": "float64"}]});
    viewer.send(asked.clone());
    assert_eq!(viewer.json(), values);
    assert!(endpoint.channels.take_parameter_request() && !endpoint.channels.take_parameter_request());
    let set = json!([{"name": "/left/mr_damper.coast_s", "value": 9.0}]);
    viewer.send(json!({"op": "setParameters", "parameters": set, "id": "s"}));
    let refusal = viewer.json();
    assert_eq!(refusal["level"], 2);
    assert!(refusal["message"].as_str().expect("a text").contains("read-only"), "{refusal}");
    assert_eq!(viewer.json()["parameters"], values["parameters"], "the value in effect");
    for request in [json!({"op": "advertise", "channels": []}), json!({"op": "fetchAsset"}), json!([1])] {
        viewer.send(request.clone());
        let refusal = viewer.json();
        assert_eq!((&refusal["op"], &refusal["level"]), (&json!("status"), &json!(2)), "{request}");
    }
    viewer.socket.send(Message::Binary(vec![1, 0, 0, 0, 0].into())).expect("sent");
    assert!(viewer.json()["message"].as_str().expect("a text").contains("\"message data\" is not offered"));
    viewer.send(asked);
    assert_eq!(viewer.json(), values, "nothing has changed");
}

#[test]
fn a_viewer_that_does_not_read_delays_nobody_and_is_told_what_it_lost() {
    let endpoint = Endpoint::start(Channels::live("s".into(), false));
    let (mut stalled, mut reading) = (endpoint.viewer(), endpoint.viewer());
    for viewer in [&mut stalled, &mut reading] {
        viewer.send(json!({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": 0}]}));
    }
    while endpoint.channels.subscribers() < 2 {
        std::thread::sleep(Duration::from_millis(5));
    }
    // More than all buffers of the system and the queue hold.
    let bytes = vec![0; 4000];
    let total = 8 * MOST_BYTES / bytes.len();
    let (mut longest, mut heard) = (Duration::ZERO, Vec::new());
    for time in 0..total {
        let begun = std::time::Instant::now();
        endpoint.channels.publish(endpoint.x, time as i64, &bytes);
        longest = longest.max(begun.elapsed());
        heard.push(reading.binary()[5]);
    }
    assert_eq!(heard.len(), total, "the other viewer got every message");
    assert!(longest < Duration::from_secs(1), "publishing took {longest:?}");
    let (mut times, mut statuses) = (Vec::new(), Vec::new());
    while times.last() != Some(&(total as u64 - 1)) || statuses.is_empty() {
        match stalled.socket.read().expect("a message") {
            Message::Binary(bytes) => {
                times.push(u64::from_le_bytes(bytes[5..13].try_into().expect("eight bytes")));
            }
            Message::Text(text) => statuses.push(text.to_string()),
            other => panic!("{other:?}"),
        }
    }
    assert!(
        times.len() < total && times.is_sorted(),
        "{} of {total} messages arrived, in order",
        times.len()
    );
    assert!(statuses[0].contains("Send buffer limit reached"), "{statuses:?}");
}
