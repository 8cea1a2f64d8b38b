//! The real service and a peer that behaves like nodes on rmw_zenoh: a plain Zenoh session with hand-written keys. The tests
//! check what the node shows, publishes, accepts and refuses. `tests/interop_zenoh` tests the same with an independent
//! implementation.

use crate::domain::Domain;
use crate::turn::turn;
use crate::wait::wait_until;
use crate::zenoh_support::keys::{Keys, with_password};
use crate::zenoh_support::sessions::{endpoint, router, session};
use mr_damper_base::clock::system_now;
use mr_damper_model::pipeline::{Event, Pipeline};
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::{Drive, Reading, Sample};
use mr_damper_msgs::standard::{Header, Temperature, Time};
use mr_damper_msgs::{CoilCurrent, Displacement, Force, ForceEstimate, Message, cdr};
use mr_damper_node::estimation::models;
use mr_damper_node::estimation::wire;
use mr_damper_node::nodes::damper_node::DamperNode;
use mr_damper_node::nodes::fleet::Fleet;
use mr_damper_node::settings::config::{Config, Damper, RosArgs, Value};
use mr_damper_node::streams::sink::zenoh::RmwStats;
use std::collections::HashSet;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::sample::{Sample as ZenohSample, SampleKind};
use zenoh::{Session, Wait};

/// DDS domains that only this test binary uses.
const FORCE_ESTIMATE: &str = "mr_damper_msgs::msg::dds_::ForceEstimate_/\
                              RIHS01_9dc78705ac5ed035bf624baa16dcbe27da337cfbb7421937be2c52883cc4de96";
const DISPLACEMENT: &str = "mr_damper_msgs::msg::dds_::Displacement_/\
                            RIHS01_a396173d439a26bd2d68f5f701d40519e45d54b57f26fac73387b1979dcb2964";

fn config(domain: i64, endpoint: &str, rmw: &str) -> Config {
    // A busy machine may stop a thread for longer than the default wait, and one sample out of order changes the result.
    let mut config = Config { domain_id: domain, align_wait_s: 0.5, ..Config::default() };
    for (name, value) in [
        ("model", Value::Text("thesis/fuzzy-tanh/rp3-cs".into())),
        ("zenoh.listen", Value::TextList(vec![endpoint.to_owned()])),
        ("zenoh.rmw", Value::Text(rmw.into())),
    ] {
        config.set(name, &value).expect("in range");
    }
    config
}

/// Collects the samples that arrive on `key`, in order.
fn inbox(session: &Session, key: &str) -> (Arc<Mutex<Vec<ZenohSample>>>, Subscriber<()>) {
    let came: Arc<Mutex<Vec<ZenohSample>>> = Arc::default();
    let filled = Arc::clone(&came);
    let push = move |sample| filled.lock().expect("no panic").push(sample);
    let subscriber = session.declare_subscriber(key.to_owned()).callback(push).wait().expect("a key");
    (came, subscriber)
}

/// The liveliness tokens of a domain, sorted, without the session's own token.
fn tokens(session: &Session, domain: i64) -> Vec<String> {
    let replies = session.liveliness().get(format!("@ros2_lv/{domain}/**")).wait().expect("a key");
    let tokens = replies.into_iter().filter_map(|reply| reply.into_result().ok());
    let mut tokens: Vec<_> = tokens.map(|token| token.key_expr().as_str().to_owned()).collect();
    tokens.sort_by_key(|token| token.splitn(6, '/').nth(5).map(str::to_owned));
    tokens
}

fn attachment(seq: i64) -> Vec<u8> {
    let stamp_ns = system_now().nanos();
    [&seq.to_le_bytes()[..], &stamp_ns.to_le_bytes(), &[16], &[7; 16]].concat()
}

/// Another node's publisher of an input. It blocks when Zenoh is congested, because losses on the way are not under test.
fn publisher<M: Message>(session: &Session, domain: i64, topic: &str) -> Publisher<'static> {
    let key = format!("{domain}/corner/{topic}/{}/{}", M::DDS_TYPE, M::TYPE_HASH);
    let blocking = zenoh::qos::CongestionControl::Block;
    session.declare_publisher(key).congestion_control(blocking).wait().expect("a key")
}

fn put(publisher: &Publisher<'_>, payload: Vec<u8>, seq: i64) {
    publisher.put(payload).attachment(attachment(seq)).wait().expect("it is sent");
}

fn header(sample: &Sample) -> Header {
    Header { stamp: Time::from_nanos_saturating(sample.stamp.nanos()), frame_id: "rig".to_owned() }
}

fn stats(service: &DamperNode) -> RmwStats {
    service.mirror().expect("there is one").stats().rmw.expect("it is seen")
}

fn estimates(came: &Mutex<Vec<ZenohSample>>) -> Vec<ForceEstimate> {
    let read = |sample: &ZenohSample| cdr::from_slice(&sample.payload().to_bytes()).expect("CDR");
    came.lock().expect("no panic").iter().map(read).collect()
}

/// The sample moved later by `shift_ns`, received at its stamp.
fn shifted(sample: &Sample, shift_ns: i64) -> Sample {
    let stamp = sample.stamp.shifted(shift_ns);
    Sample { stamp, received: stamp, ..*sample }
}

#[test]
fn inputs_by_rmw_zenoh_give_estimates_bit_identical_to_a_replay() {
    let _turn = turn(module_path!());
    let lease = Domain::lease();
    let domain = lease.id();
    let (endpoint, args) = (endpoint(), RosArgs::in_namespace("/corner"));
    let config = config(domain, &endpoint, "both");
    let (service, _) = DamperNode::start(&config, &args, false).expect("the service starts");
    let peer = session(&endpoint, &[]);
    let (came, _subscriber) = inbox(&peer, &format!("{domain}/corner/force_estimate/{FORCE_ESTIMATE}"));
    wait_until("the node, 4 outputs and 8 inputs", || tokens(&peer, domain).len() == 13);

    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(3.0);
    let run = record(&experiment, &Plant::default(), &Channels::default(), 7);
    let start = system_now();
    let first = run.samples().next().expect("it has samples").stamp;
    let shift_ns = start.nanos() - first.nanos();
    let samples: Vec<_> = run.samples().map(|sample| shifted(&sample, shift_ns)).collect();
    let displacement = publisher::<Displacement>(&peer, domain, "displacement");
    let current = publisher::<CoilCurrent>(&peer, domain, "coil_current");
    let force = publisher::<Force>(&peer, domain, "measured_force");
    let temperature = publisher::<Temperature>(&peer, domain, "case_temperature");
    let mut seq = [0; 4];
    for sample in &samples {
        std::thread::sleep(
            Duration::try_from_secs_f64(sample.stamp.since(system_now()).get()).unwrap_or_default(),
        );
        let (header, variance) = (header(sample), 0.0);
        let (which, publisher, payload) = match sample.reading {
            Reading::Displacement(x) => {
                (0, &displacement, cdr::to_vec(&Displacement { header, displacement: x.get(), variance }))
            }
            Reading::Drive(Drive::CoilCurrent(i)) => {
                (1, &current, cdr::to_vec(&CoilCurrent { header, current: i.get(), variance }))
            }
            Reading::Force(f) => (2, &force, cdr::to_vec(&Force { header, force: f.get(), variance })),
            Reading::CaseTemperature(t) => {
                (3, &temperature, cdr::to_vec(&Temperature { header, temperature: t.get(), variance }))
            }
            other => panic!("the rig has no {other:?}"),
        };
        put(publisher, payload.expect("it can be written"), seq[which]);
        seq[which] += 1;
    }

    let (models, _) = models::from_config(&config).expect("it loads");
    let settings = config.pipeline_settings(models.free.conditioning.cutoff_hz);
    let mut pipeline = Pipeline::new(models, settings).expect("it runs");
    let names = service.names().read().expect("no panic").clone();
    let mut expected = Vec::new();
    for sample in &samples {
        pipeline.step(sample, &mut |event| {
            if let Event::Estimate(estimate) = event {
                let message = wire::force_estimate(&estimate, &names, "rig");
                expected.push(cdr::to_vec(&message).expect("it can be written"));
            }
        });
    }
    assert!(expected.len() > 1000, "{} estimates", expected.len());
    wait_until("every estimate", || came.lock().expect("no panic").len() >= expected.len());
    let came = came.lock().expect("no panic").clone();
    let token = tokens(&peer, domain)
        .into_iter()
        .find(|token| token.contains("/MP/%/%corner/mr_damper/%corner%force_estimate/"));
    let gid = mr_damper_node::zenoh::rmw::gid(&token.expect("its publisher is seen"));
    for (index, (got, expected)) in came.iter().zip(&expected).enumerate() {
        assert_eq!(got.payload().to_bytes(), expected.as_slice(), "estimate {index}");
        let attachment = got.attachment().expect("each has one").to_bytes();
        let (seq, rest) = attachment.split_first_chunk::<8>().expect("33 bytes");
        assert_eq!(i64::from_le_bytes(*seq), index as i64 + 1);
        assert_eq!((rest.len(), rest[8], &rest[9..]), (25, 16, &gid[..]));
    }
    let told = stats(&service);
    let counted = (told.taken, told.lost, told.refused, told.mismatched);
    assert_eq!(counted, (samples.len() as u64, 0, 0, 0), "{told:?}");

    // When the node stops, all its tokens disappear at once.
    let (gone, _watching) = {
        let gone: Arc<Mutex<usize>> = Arc::default();
        let count = Arc::clone(&gone);
        let note = move |token: ZenohSample| {
            *count.lock().expect("no panic") += usize::from(token.kind() == SampleKind::Delete);
        };
        let liveliness = peer.liveliness();
        let watching = liveliness.declare_subscriber(format!("@ros2_lv/{domain}/**")).callback(note);
        (gone, watching.wait().expect("a key"))
    };
    service.stop().expect("no thread panicked");
    wait_until("13 tokens are taken back", || *gone.lock().expect("no panic") == 13);
}

#[test]
fn malformed_messages_are_refused_and_counted_and_do_no_harm() {
    let _turn = turn(module_path!());
    let lease = Domain::lease();
    let domain = lease.id();
    let (endpoint, args) = (endpoint(), RosArgs::in_namespace("/corner"));
    let (service, _) =
        DamperNode::start(&config(domain, &endpoint, "both"), &args, false).expect("the service starts");
    let peer = session(&endpoint, &[]);
    let (came, _subscriber) = inbox(&peer, &format!("{domain}/corner/force_estimate/{FORCE_ESTIMATE}"));
    wait_until("the node is seen", || tokens(&peer, domain).len() == 13);

    let displacement = publisher::<Displacement>(&peer, domain, "displacement");
    let now =
        || Header { stamp: Time::from_nanos_saturating(system_now().nanos()), frame_id: "rig".to_owned() };
    let good =
        || cdr::to_vec(&Displacement { header: now(), displacement: 0.001, variance: 0.0 }).expect("CDR");
    let key = format!("{domain}/corner/displacement/{DISPLACEMENT}");
    let mut refused = 0;
    let mut refuse = |why: &str| {
        refused += 1;
        wait_until(why, || stats(&service).refused == refused);
        let told = stats(&service).last_refusal.expect("it is kept");
        assert!(told.starts_with("displacement: ") && told.contains(why), "{why}: {told}");
    };
    // Messages cut at every length, a wrong encoding, a text with a huge length, and a text that is not UTF-8.
    for length in 0..good().len() {
        put(&displacement, good()[..length].to_vec(), 1);
        refuse("mr_damper_msgs/msg/Displacement");
    }
    for (at, bytes) in [(0, [0, 7, 0, 0]), (12, [0xff; 4]), (16, [0xc3, 0x28, 0, 0])] {
        let mut bad = good();
        bad[at..at + 4].copy_from_slice(&bytes);
        put(&displacement, bad, 1);
        refuse("mr_damper_msgs/msg/Displacement");
    }
    displacement.put(vec![0; 65_537]).attachment(attachment(1)).wait().expect("it is sent");
    refuse("65537 bytes");
    for length in [1, 16, 32, 34, 4096] {
        let mut wrong = attachment(1);
        wrong.resize(length, 0);
        displacement.put(good()).attachment(wrong).wait().expect("it is sent");
        refuse(&format!("{length} bytes"));
    }
    displacement.put(good()).wait().expect("it is sent");
    refuse("0 bytes");
    let mut wrong = attachment(1);
    wrong[16] = 15;
    displacement.put(good()).attachment(wrong).wait().expect("it is sent");
    refuse("gid of 15 bytes");
    displacement.delete().attachment(attachment(1)).wait().expect("it is sent");
    refuse("it deletes");
    let around = format!("{domain}/corner/displacement/*/*");
    peer.put(around.clone(), good()).attachment(attachment(1)).wait().expect("it is sent");
    refuse(&format!("it was sent to {around}"));

    // Another type hash gives another key: the node does not receive it, but sees its publisher.
    let wrong = key.replace("RIHS01_a3", "RIHS01_a4");
    let token = |dds_type: &str| {
        let (begin, end) = (format!("@ros2_lv/{domain}/{}/0/1/MP/%/%/sensor", peer.zid()), "::,10:,:,:,,");
        peer.liveliness()
            .declare_token(format!("{begin}/%corner%displacement/{dds_type}/{end}"))
            .wait()
            .expect("a key")
    };
    let _wrong = token(wrong.split_once("displacement/").expect("its topic").1);
    peer.put(wrong, good()).attachment(attachment(1)).wait().expect("it is sent");
    wait_until("the publisher is seen", || stats(&service).mismatched == 1);
    let _right = token(DISPLACEMENT);

    // Correct messages still pass as before.
    let current = publisher::<CoilCurrent>(&peer, domain, "coil_current");
    let drive = CoilCurrent { header: now(), current: 1.0, variance: 0.0 };
    put(&current, cdr::to_vec(&drive).expect("CDR"), 1);
    for seq in 1..=20 {
        put(&displacement, good(), seq);
        std::thread::sleep(Duration::from_millis(2));
    }
    wait_until("an estimate", || estimates(&came).iter().any(|estimate| estimate.force.is_finite()));
    put(&displacement, good(), 25);
    wait_until("four samples counted as lost", || stats(&service).lost == 4);
    let told = stats(&service);
    assert_eq!((told.taken, told.refused, told.mismatched), (22, refused, 1), "{told:?}");
    service.stop().expect("no thread panicked");
}

#[test]
fn the_node_is_seen_only_if_enabled_and_takes_inputs_only_with_both() {
    let _turn = turn(module_path!());
    let lease = Domain::lease();
    let domain = lease.id();
    for (rmw, seen) in [("off", 0), ("publish", 5)] {
        let (endpoint, args) = (endpoint(), RosArgs::in_namespace("/corner"));
        let (service, _) =
            DamperNode::start(&config(domain, &endpoint, rmw), &args, false).expect("the service starts");
        let peer = session(&endpoint, &[]);
        let status = || peer.get("mr_damper/corner/status").wait().expect("a key").recv();
        wait_until("the mirror", || status().is_ok_and(|reply| reply.result().is_ok()));
        let tokens = tokens(&peer, domain);
        assert_eq!(tokens.len(), seen, "{tokens:?}");
        assert!(tokens.iter().all(|token| !token.contains("/MS/")), "{tokens:?}");
        let displacement = publisher::<Displacement>(&peer, domain, "displacement");
        for seq in 0..20 {
            put(&displacement, cdr::to_vec(&Displacement::default()).expect("CDR"), seq);
        }
        assert!(status().is_ok(), "earlier samples have arrived by now");
        assert_eq!(
            service.mirror().expect("there is one").stats().rmw.map(|told| told.taken),
            (seen > 0).then_some(0)
        );
        assert_eq!(service.counters().source.messages.load(std::sync::atomic::Ordering::Relaxed), 0);
        service.stop().expect("no thread panicked");
    }
}

#[test]
fn several_dampers_are_several_nodes_in_one_session() {
    let _turn = turn(module_path!());
    let lease = Domain::lease();
    let domain = lease.id();
    let endpoint = endpoint();
    let dampers = ["/left", "/right"].map(|namespace| Damper {
        config: config(domain, &endpoint, "both"),
        args: RosArgs::in_namespace(namespace),
    });
    let fleet = Fleet::start(&dampers).expect("both start");
    let peer = session(&endpoint, &[]);
    wait_until("two nodes, 8 outputs, 16 inputs", || tokens(&peer, domain).len() == 26);
    let tokens = tokens(&peer, domain);
    let split = |token: &String| -> Vec<String> { token.split('/').map(str::to_owned).collect() };
    let tokens: Vec<_> = tokens.iter().map(split).collect();
    let zid = peer.info().peers_zid().wait().next().expect("the node's session").to_string();
    assert!(tokens.iter().all(|token| token[2] == zid), "{zid}: {tokens:?}");
    let ids: HashSet<_> = tokens.iter().map(|token| &token[4]).collect();
    assert_eq!(ids.len(), tokens.len(), "no entity id occurs twice: {tokens:?}");
    for namespace in ["%left", "%right"] {
        let of: Vec<_> = tokens.iter().filter(|token| token[7] == namespace).collect();
        let nodes: HashSet<_> = of.iter().map(|token| &token[3]).collect();
        assert_eq!((of.len(), nodes.len()), (13, 1), "{tokens:?}");
        let mut topics = of.iter().filter_map(|token| token.get(9));
        assert!(topics.all(|topic| topic.starts_with(&format!("{namespace}%"))), "{tokens:?}");
    }
    fleet.stop().expect("no thread panicked");
}

#[test]
fn the_router_may_start_late_and_stop() {
    let _turn = turn(module_path!());
    let lease = Domain::lease();
    let domain = lease.id();
    let (endpoint, args) = (endpoint(), RosArgs::in_namespace("/corner"));
    let mut config = config(domain, &endpoint, "both");
    config.zenoh.connect = std::mem::take(&mut config.zenoh.listen);
    config.zenoh.mode = "client".to_owned();
    let (service, _) = DamperNode::start(&config, &args, false).expect("it starts without the router");
    let mut taken = 0;
    for _ in 0..2 {
        let router = router(&endpoint);
        let peer = session(&endpoint, &[]);
        wait_until("the node is seen", || tokens(&peer, domain).len() == 13);
        let displacement = publisher::<Displacement>(&peer, domain, "displacement");
        wait_until("the node receives a sample", || {
            put(&displacement, cdr::to_vec(&Displacement::default()).expect("CDR"), 0);
            stats(&service).taken > taken
        });
        taken = stats(&service).taken;
        router.close().wait().expect("it ends");
        assert!(service.mirror().expect("there is one").is_alive());
    }
    service.stop().expect("no thread panicked");
}

#[test]
fn with_access_rules_all_users_see_outputs_and_only_one_feeds_inputs() {
    let _turn = turn(module_path!());
    let lease = Domain::lease();
    let domain = lease.id();
    let (keys, endpoint, args) = (Keys::new(), endpoint(), RosArgs::in_namespace("/corner"));
    let mut config = config(domain, &endpoint, "both");
    let file = keys.ready("rmw-access.json5", &endpoint).file.expect("a file");
    config.zenoh.config = file.display().to_string();
    let (service, _) = DamperNode::start(&config, &args, false).expect("the service starts");
    let reader = with_password(&endpoint, "reader", "of the news");
    let supervisor = with_password(&endpoint, "supervisor", "of the four");
    let nobody = session(&endpoint, &[]);
    for user in [&reader, &supervisor] {
        wait_until("the node is seen", || tokens(user, domain).len() == 13);
    }
    let outputs = [&reader, &supervisor]
        .map(|user| inbox(user, &format!("{domain}/corner/force_estimate/{FORCE_ESTIMATE}")));
    let feed = |user: &Session, seq: i64| {
        let displacement = publisher::<Displacement>(user, domain, "displacement");
        let header = Header { stamp: Time::from_nanos_saturating(system_now().nanos()), ..Header::default() };
        let message = Displacement { header, displacement: 0.001, variance: 0.0 };
        put(&displacement, cdr::to_vec(&message).expect("CDR"), seq);
        let around = format!("{domain}/corner/displacement/*/*");
        let payload = cdr::to_vec(&message).expect("CDR");
        user.put(around, payload).attachment(attachment(seq)).wait().expect("it is sent");
    };
    for seq in 0..50 {
        feed(&reader, seq);
        feed(&nobody, seq);
        std::thread::sleep(Duration::from_millis(5));
    }
    let told = stats(&service);
    assert_eq!((told.taken, told.refused), (0, 0), "nothing is taken from users without the right: {told:?}");
    let mut seq = 0;
    wait_until("the supervisor's samples", || {
        feed(&supervisor, seq);
        seq += 1;
        std::thread::sleep(Duration::from_millis(5));
        stats(&service).taken > 10
    });
    wait_until("estimates at both users", || outputs.iter().all(|(came, _)| estimates(came).len() > 10));
    assert!(tokens(&nobody, domain).is_empty());
    service.stop().expect("no thread panicked");
}
