//! The Zenoh mirror under faults: taken ports, wrong endpoints, absent routers, consumers that do not read, peers that send invalid
//! bytes.

use crate::turn::turn;
use crate::wait::{PATIENCE, comes_true, wait_until};
use crate::zenoh_support::sessions::router;
use crate::zenoh_support::*;
use mr_damper_node::streams::sink::zenoh::{Damper, Link, Mirror, MirrorState, ZenohConfig, ZenohError};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};
use zenoh::Wait;

#[test]
fn a_taken_port_is_named_with_what_to_do() {
    let _turn = turn(module_path!());
    let holder = std::net::TcpListener::bind("127.0.0.1:0").expect("loopback has a free port");
    let taken = format!("tcp/{}", holder.local_addr().expect("a bound socket has an address"));
    let config = ZenohConfig { listen: vec![endpoint(), taken.clone()], ..ZenohConfig::default() };
    let error = Link::open(&config).expect_err("the port is taken");
    assert!(matches!(error, ZenohError::PortInUse { .. }), "{error:?}");
    let message = error.to_string();
    assert!(message.contains(&taken) && message.contains("choose another port"), "{message}");
}

#[test]
fn non_loopback_endpoints_are_refused_unless_allowed() {
    let _turn = turn(module_path!());
    let error = Link::open(&listening("tcp/0.0.0.0:0")).expect_err("this endpoint is open to all");
    assert!(error.to_string().contains("allow_non_loopback"), "{error}");
    let allowed = ZenohConfig { allow_non_loopback: true, ..listening("tcp/0.0.0.0:0") };
    Link::open(&allowed).expect("this was allowed").close();
}

#[test]
fn names_that_are_not_valid_keys_are_refused() {
    let _turn = turn(module_path!());
    let link = Link::open(&listening(&endpoint())).expect("the port is free");
    for name in ["", "/", "a//b", "a*", "front left", "a/$*"] {
        let (_, events) = rtrb::RingBuffer::new(1);
        let started = Mirror::start(&link, Damper::named(name), names(), events, Arc::default());
        assert!(matches!(started, Err(ZenohError::DamperName { .. })), "{name}");
    }
}

#[test]
fn an_absent_router_does_not_delay_the_start_and_is_found_later() {
    let _turn = turn(module_path!());
    for as_client in [false, true] {
        let endpoint = endpoint();
        let absent = ZenohConfig { connect: vec![endpoint.clone()], ..ZenohConfig::default() };
        let config = if as_client { client(&endpoint) } else { absent };
        let start = Instant::now();
        let link = Link::open(&config).expect("it opens without a router");
        let (mirror, mut feeder) = mirror(&link, DAMPER);
        assert!(start.elapsed() < Duration::from_secs(3), "client {as_client}: {:?}", start.elapsed());
        feeder.push(estimate(1, 1.0));
        wait_until("the event is taken", || mirror.stats().events == 1);
        assert!(mirror.is_alive());
        assert_eq!(mirror.stats().state == MirrorState::Connecting, as_client);

        let router = router(&endpoint);
        let inbox = subscribe(&router, "mr_damper/*/state/*");
        feeder.push(estimate(2, 2.0));
        wait_until("the sample", || inbox.len() == 1);
        assert_eq!(cbor(&inbox.samples()[0])["seq"], 2);
        wait_until("the router is counted", || mirror.stats().connected == 1);
    }
}

#[test]
fn a_client_without_its_router_stops_at_once() {
    let _turn = turn(module_path!());
    let link = Link::open(&client(&endpoint())).expect("it opens without a router");
    let (mirror, mut feeder) = mirror(&link, DAMPER);
    feeder.push(estimate(1, 1.0));
    wait_until("the mirror runs without its router", || mirror.stats().events == 1);
    let start = Instant::now();
    mirror.stop();
    link.close();
    assert!(start.elapsed() < Duration::from_secs(1), "{:?}", start.elapsed());
}

#[test]
fn a_closed_session_is_reported_and_the_ring_is_still_drained() {
    let _turn = turn(module_path!());
    let mut rig = Rig::start();
    wait_until("the mirror runs", || rig.mirror.stats().state == MirrorState::Running);
    rig.link.close();
    wait_until("the failure", || !rig.mirror.is_alive());
    let stats = rig.mirror.stats();
    assert_eq!(stats.state, MirrorState::Failed);
    assert!(stats.failure.is_some_and(|why| why.contains("closed")));
    rig.feeder.run(20_000, 1e6, |k| vec![estimate(i64::from(k), 1.0)]);
    wait_until("all events are taken or counted", || {
        let stats = rig.mirror.stats();
        stats.events + stats.ring_dropped == 20_000
    });
    let stats = rig.mirror.stats();
    let route =
        stats.routes.iter().find(|route| route.key.ends_with("state/force_estimate")).expect("a route");
    assert_eq!((route.sent, route.dropped), (0, stats.events));
}

#[test]
fn stopping_publishes_pending_samples_and_is_quick() {
    let _turn = turn(module_path!());
    let mut rig = Rig::start();
    let session = session(&rig.endpoint, &[]);
    let inbox = subscribe(&session, "mr_damper/front_left/*/force_estimate");
    for k in 0..1000 {
        rig.feeder.push(estimate(k, k as f64));
    }
    let start = Instant::now();
    rig.mirror.stop();
    rig.link.close();
    assert!(start.elapsed() < Duration::from_secs(1), "{:?}", start.elapsed());
    let complete = comes_true(|| {
        inbox.of("state/force_estimate").last().is_some_and(|sample| cbor(sample)["seq"] == 1000)
            && inbox.of("web/force_estimate").last().is_some_and(|sample| json(sample)["force_n"] == 999.0)
    });
    let [state, web] = ["state/force_estimate", "web/force_estimate"].map(|tail| inbox.of(tail));
    assert!(
        complete,
        "of 1000 samples came {}, the last one is {:?}; on the web {}, the last one is {:?}",
        state.len(),
        state.last().map(cbor),
        web.len(),
        web.last().map(json)
    );
}

#[test]
fn a_consumer_that_does_not_read_delays_nobody() {
    let _turn = turn(module_path!());
    let mut rig = Rig::start();
    let stall = Arc::new(AtomicBool::new(false));
    let slow = session(&proxy::proxy(&rig.endpoint, &stall), &[]);
    let slow_inbox = subscribe(&slow, "mr_damper/**");
    let healthy = session(&rig.endpoint, &[]);
    let inbox = subscribe(&healthy, "mr_damper/front_left/state/force_estimate");
    stall.store(true, Ordering::Release);

    // Far more than the sockets and queues in between can hold (a few megabytes).
    const COUNT: u32 = 40_000;
    let start = Instant::now();
    let mut worst = 0;
    rig.feeder.run(COUNT, 10_000.0, |k| vec![estimate(i64::from(k), 1.0), displacement(i64::from(k))]);
    wait_until("the ring is empty", || {
        let stats = rig.mirror.stats();
        worst = worst.max(stats.ring_dropped);
        stats.events + stats.ring_dropped == u64::from(COUNT) * 2
    });
    // Blocking puts would take seconds each, and overflow the ring within the first one.
    assert_eq!(worst, 0, "the ring overflowed");
    assert!(start.elapsed() < PATIENCE, "{:?}", start.elapsed());
    assert!(slow_inbox.of("state/displacement").len() < COUNT as usize, "the consumer did not stall");
    // A query whose answer blocks delays neither samples nor, for long, the answers to others.
    let _pending = slow.get("mr_damper/front_left/history").wait().expect("the selector is valid");
    assert_eq!(ask(&healthy, "status")["ring_dropped"], 0);
    let before = inbox.len();
    rig.feeder.push(estimate(1, 1.0));
    wait_until("the healthy consumer gets samples", || inbox.len() > before);

    let stopping = Instant::now();
    rig.mirror.stop();
    rig.link.close();
    assert!(stopping.elapsed() < Duration::from_secs(1), "{:?}", stopping.elapsed());
}

/// The bytes that a session sends to `endpoint` while it opens and subscribes.
fn said_by_a_session(endpoint: &str) -> Vec<u8> {
    let listener = TcpListener::bind("127.0.0.1:0").expect("loopback has a free port");
    let relay = format!("tcp/{}", listener.local_addr().expect("a bound socket has an address"));
    let to = TcpStream::connect(endpoint.trim_start_matches("tcp/")).expect("the mirror listens");
    let relaying = thread::spawn(move || {
        let (from, _) = listener.accept().expect("the session connects");
        let [mut back_to, mut back_from] = [&from, &to].map(|end| end.try_clone().expect("a handle"));
        // Ends when one of the two sockets closes.
        thread::spawn(move || std::io::copy(&mut back_from, &mut back_to));
        let (mut said, mut part) = (Vec::new(), [0; 4096]);
        let (mut from, mut to) = (from, to);
        while let Ok(length @ 1..) = from.read(&mut part) {
            said.extend_from_slice(&part[..length]);
            if to.write_all(&part[..length]).is_err() {
                break;
            }
        }
        said
    });
    let session = session(&relay, &[]);
    let inbox = subscribe(&session, "mr_damper/**");
    drop(inbox);
    session.close().wait().expect("it closes");
    relaying.join().expect("no panic")
}

#[test]
fn peers_that_send_partial_frames_or_invalid_bytes_harm_nobody() {
    const TIMES: u64 = 300;
    let _turn = turn(module_path!());
    mr_damper_node::process::panics::watch();
    let mut rig = Rig::start();
    let healthy = session(&rig.endpoint, &[]);
    let inbox = subscribe(&healthy, "mr_damper/front_left/state/force_estimate");
    let said = said_by_a_session(&rig.endpoint);
    assert!(said.len() > 100, "{} bytes of a handshake and more", said.len());
    let mut state = 5_u64;
    let mut random = move |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let (mut refused, start) = (0, Instant::now());
    for turn in 0..TIMES {
        let mut bytes = said[..1 + random(said.len())].to_vec();
        match turn % 4 {
            // Truncated bytes.
            0 => {}
            1 => (0..1 + random(4)).for_each(|_| {
                let at = random(bytes.len());
                bytes[at] = random(256) as u8;
            }),
            // A frame length larger than the data that follows.
            2 => bytes[..1].iter_mut().for_each(|byte| *byte = 0xFF),
            _ => bytes.iter_mut().for_each(|byte| *byte = random(256) as u8),
        }
        let mut peer =
            TcpStream::connect(rig.endpoint.trim_start_matches("tcp/")).expect("the mirror listens");
        // The mirror may have closed the connection by then.
        refused += u64::from(peer.write_all(&bytes).is_err());
        rig.feeder.push(estimate(turn as i64, 1.0));
    }
    wait_until("all samples at the healthy consumer", || inbox.len() as u64 == TIMES);
    assert!(rig.mirror.is_alive());
    assert_eq!(mr_damper_node::process::panics::of_middleware(), None);
    // The next client is served.
    let next = session(&rig.endpoint, &[]);
    assert_eq!(ask(&next, "status")["ring_dropped"], 0);
    println!("{TIMES} broken peers in {:?}, {refused} of them disconnected while they sent", start.elapsed());
    rig.mirror.stop();
    rig.link.close();
}
