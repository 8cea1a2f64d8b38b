//! The real service on a CAN bus in memory: inputs from frames, estimates and commands as frames; faults of the bus; and the error on a
//! kernel without CAN.

use crate::domain::Domain;
use crate::turn::turn;
use crate::wait::wait_until;
use mr_damper_base::clock::system_now;
use mr_damper_model::evaluate::{Evaluator, evaluate};
use mr_damper_model::pipeline::{Estimate, Event, Settings};
use mr_damper_model::preset;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::{Run, Stamp};
use mr_damper_node::estimation::estimator::EventReceiver;
use mr_damper_node::nodes::damper_node::{DamperNode, Process};
use mr_damper_node::settings::config::{Config, RosArgs, Value};
use mr_damper_node::streams::can::{BusFault, Frame, MemoryBus, SendFault};
use mr_damper_runs::bus::{CanId, candump_line};
use mr_damper_runs::{LoadOptions, Map, Mapping, load};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

const DBC: &str = r#"VERSION ""
BU_: ECU
BO_ 288 SUSP_FL: 8 ECU
 SG_ Position : 0|16@1- (0.01,0) [0|0] "mm" ECU
 SG_ Coil : 16|16@1+ (1,0) [0|0] "mA" ECU
 SG_ Load : 32|16@1- (0.1,0) [0|0] "N" ECU
 SG_ Demand : 48|16@1- (1,0) [0|0] "N" ECU
BO_ 289 DAMPER_FL: 8 ECU
 SG_ Crc : 0|8@1+ (1,0) [0|0] "" ECU
 SG_ Alive : 8|4@1+ (1,0) [0|0] "" ECU
 SG_ Validity : 12|3@1+ (1,0) [0|0] "" ECU
 SG_ Force : 16|16@1- (0.1,0) [0|0] "N" ECU
 SG_ High : 32|16@1- (1,0) [0|0] "N" ECU
BO_ 290 COIL_FL: 4 ECU
 SG_ Current : 0|16@1+ (0.001,0) [0|2.5] "A" ECU
 SG_ Alive : 16|4@1+ (1,0) [0|0] "" ECU
 SG_ Limit : 20|3@1+ (1,0) [0|0] "" ECU
"#;
const MAP: [&str; 3] = ["displacement=Position", "coil_current=Coil", "measured_force=Load"];
const ESTIMATE: &str = "force_estimate=DAMPER_FL,force=Force,band_high=High,validity=Validity,counter=Alive,checksum=Crc,data_id=0x123";
const COMMAND: &str = "current_command=COIL_FL,current=Current,limited_by=Limit,counter=Alive";

fn id(value: u32) -> CanId {
    CanId::new(value, false).expect("in range")
}

/// The frames of a run of the virtual rig, with times since its start.
fn frames(seconds: f64) -> Vec<(i64, [u8; 8])> {
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(seconds);
    let run = record(&experiment, &Plant::default(), &Channels::default(), 7);
    let (force, drive) = (run.force_n.as_ref().expect("a force"), &run.drive.as_ref().expect("a drive").1);
    let first = run.displacement_m.stamps[0];
    let frame = |k: usize| {
        let mut data = [0; 8];
        data[..2].copy_from_slice(&((run.displacement_m.values[k] * 1e5).round() as i16).to_le_bytes());
        data[2..4].copy_from_slice(&((drive.values[k] * 1e3).round() as u16).to_le_bytes());
        data[4..6].copy_from_slice(&((force.values[k] * 10.0).round() as i16).to_le_bytes());
        data[6..].copy_from_slice(&((force.values[k] * 0.8).round() as i16).to_le_bytes());
        (run.displacement_m.stamps[k].nanos() - first.nanos(), data)
    };
    (0..run.displacement_m.len()).map(frame).collect()
}

/// The run that a log of the frames gives offline.
fn offline_run(dir: &Path, frames: &[(i64, [u8; 8])]) -> Run {
    let log: String =
        frames.iter().map(|(nanos, data)| candump_line(*nanos, "can0", id(288), data)).collect();
    let path = dir.join("drive.log");
    std::fs::write(&path, log).expect("written");
    let mappings: Vec<Mapping> = MAP.iter().map(|text| text.parse().expect("a mapping")).collect();
    let map = Map::new(mappings).expect("distinct");
    load(&path, &LoadOptions { dbc: vec![dir.join("car.dbc")], map, ..LoadOptions::default() })
        .expect("a run")
        .run
}

fn config(domain: &Domain, dir: &Path, map: &[&str], out: &[&str]) -> Config {
    let dbc = dir.join("car.dbc");
    std::fs::write(&dbc, DBC).expect("written");
    let list = |items: &[&str]| Value::TextList(items.iter().map(|item| (*item).to_owned()).collect());
    let mut config =
        Config { domain_id: domain.id(), align_wait_s: 0.5, deadline_s: 5.0, ..Config::default() };
    for (name, value) in [
        ("model", Value::Text("thesis/fuzzy-tanh/rp3-cs".into())),
        ("arx_model", Value::Text("none".into())),
        ("can.interface", Value::Text("can0".into())),
        ("can.dbc", list(&[dbc.to_str().expect("a path")])),
        ("can.map", list(map)),
        ("can.out", list(out)),
        ("can.period_s", Value::Double(0.0)),
    ] {
        config.set(name, &value).expect("in range");
    }
    config
}

fn start(config: &Config, bus: &MemoryBus) -> (DamperNode, EventReceiver) {
    let process = Process::join(config, None).expect("a domain").with_can_bus(Arc::new(bus.clone()));
    let started =
        DamperNode::start_in(&process, config, &RosArgs::default(), true).expect("the service starts");
    (started.0, started.1.expect("a receiver was requested"))
}

/// Puts frames onto the bus at their times, and returns all events until `done` of them says that nothing more comes.
fn play(
    bus: &MemoryBus,
    frames: &[(i64, [u8; 8])],
    events: &mut EventReceiver,
    done: impl Fn(&[Event]) -> bool,
) -> Vec<Event> {
    let (began, start) = (Instant::now(), system_now());
    let mut all = Vec::new();
    for (nanos, data) in frames {
        let due = began + Duration::from_nanos(u64::try_from(*nanos).expect("positive"));
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        bus.put(Frame::new(id(288), start.shifted(*nanos), data).expect("8 bytes"));
        while let Ok(event) = events.events.pop() {
            all.push(event);
        }
    }
    let end = Instant::now() + Duration::from_secs(20);
    while !done(&all) && Instant::now() < end {
        while let Ok(event) = events.events.pop() {
            all.push(event);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    all
}

/// The content of a frame of DAMPER_FL for an estimate, computed without the encoder: force and upper end in their steps, or the least
/// number for NaN; validity.
fn expected(estimate: &Estimate) -> (i16, i16, u8) {
    let raw = |value: f64, step: f64| {
        if value.is_nan() { i16::MIN } else { (value / step).round_ties_even() as i16 }
    };
    (raw(estimate.force.get(), 0.1), raw(estimate.band[1].get(), 1.0), estimate.validity as u8)
}

#[test]
fn frames_give_the_estimates_of_the_log_and_each_estimate_its_frame() {
    let _turn = turn(module_path!());
    let (domain, dir, bus) =
        (Domain::lease(), tempfile::tempdir().expect("a directory"), MemoryBus::default());
    let config = config(&domain, dir.path(), &MAP, &[ESTIMATE]);
    let frames = frames(3.0);
    let run = offline_run(dir.path(), &frames);
    let model = preset::load("thesis/fuzzy-tanh/rp3-cs").expect("a preset");
    let offline = evaluate(model, &run, Settings::default(), |_| true).expect("the run has all channels");
    let residuals = offline.free_run.as_ref().expect("a free run").samples;

    let (service, mut receiver) = start(&config, &bus);
    let is_residual = |event: &&Event| matches!(event, Event::Residual(_));
    let events =
        play(&bus, &frames, &mut receiver, |all| all.iter().filter(is_residual).count() as u64 >= residuals);
    let counters = service.counters();
    service.stop().expect("no thread panicked");

    let mut evaluator = Evaluator::default();
    events.iter().for_each(|event| evaluator.take(event, |_| true));
    assert_eq!(evaluator.finish().free_run, offline.free_run, "bit-identical, and no sample lost");

    // Every frame is the quantised value of an estimate, in order. Estimates that come together share a frame.
    let estimates = events
        .iter()
        .filter_map(|event| if let Event::Estimate(it) = event { Some(expected(it)) } else { None });
    let estimates: Vec<_> = estimates.collect();
    let sent = bus.sent();
    let mut at = 0;
    for (index, frame) in sent.iter().enumerate() {
        let data = frame.data();
        assert_eq!((frame.id, data.len(), usize::from(data[1] & 15)), (id(289), 8, index % 15));
        let word = |at: usize| i16::from_le_bytes([data[at], data[at + 1]]);
        let found = (word(2), word(4), data[1] >> 4);
        let place = estimates[at..].iter().position(|estimate| *estimate == found);
        at += place.unwrap_or_else(|| panic!("frame {index} matches no estimate: {data:02x?}"));
    }
    assert!(sent.len() > estimates.len() * 8 / 10, "{} frames of {} estimates", sent.len(), estimates.len());
    let can = counters.can.as_ref().expect("a bus");
    let read = |count: &std::sync::atomic::AtomicU64| count.load(Ordering::Relaxed);
    assert_eq!((read(&can.frames), read(&can.values)), (frames.len() as u64, 3 * frames.len() as u64));
    assert_eq!(read(&can.estimates), sent.len() as u64);
    assert_eq!(counters.lost(), 0, "{}", counters.losses_in_words());
}

#[test]
fn commands_are_sent_on_request_and_end_with_the_safe_current() {
    let _turn = turn(module_path!());
    let (domain, dir, bus) =
        (Domain::lease(), tempfile::tempdir().expect("a directory"), MemoryBus::default());
    let map = ["displacement=Position", "coil_current=Coil", "force_request=Demand"];
    let mut config = config(&domain, dir.path(), &map, &[COMMAND]);
    for (name, value) in [("request_timeout_s", 0.2), ("current.safe_a", 0.25), ("current.safe_after_s", 0.3)]
    {
        config.set(name, &Value::Double(value)).expect("in range");
    }
    let (service, mut receiver) = start(&config, &bus);
    let frames = frames(2.0);
    let is_safe =
        |event: &Event| matches!(event, Event::Command(it) if (it.command.current.get() - 0.25).abs() < 1e-9);
    let events = play(&bus, &frames, &mut receiver, |all| {
        all.last().is_some_and(is_safe) || all.iter().rev().take(40).any(is_safe)
    });
    // While the controller is off the bus, and while its queue is full, no command is sent.
    std::thread::sleep(Duration::from_millis(100));
    let sent = bus.sent();
    bus.fault(BusFault::Off);
    std::thread::sleep(Duration::from_millis(200));
    let _ = bus.sent();
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(bus.sent(), []);
    bus.refuse(Some(SendFault::Full));
    bus.fault(BusFault::Restarted);
    let can = service.counters().can.expect("a bus");
    wait_until("the bus", || can.queue_full.load(Ordering::Relaxed) > 0);
    assert!(can.not_sent.load(Ordering::Relaxed) > 0);
    bus.refuse(None);
    service.stop().expect("no thread panicked");
    let after = bus.sent();
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(bus.sent(), [], "nothing is sent after the end, as on ROS topics");

    let currents: Vec<u16> = events
        .iter()
        .filter_map(
            |event| if let Event::Command(it) = event { Some(it.command.current.get()) } else { None },
        )
        .map(|current_a| (current_a / 0.001).round_ties_even() as u16)
        .collect();
    assert!(sent.len() > 500, "{} commands", sent.len());
    let mut at = 0;
    for frame in &sent[..currents.len().min(sent.len()) / 2] {
        let data = frame.data();
        let found = u16::from_le_bytes([data[0], data[1]]);
        assert!(found <= 2500);
        let place = currents[at..].iter().position(|current| *current == found);
        at += place.unwrap_or_else(|| panic!("{data:02x?} is no command"));
    }
    let last = after.last().or(sent.last()).expect("commands").data();
    assert_eq!(u16::from_le_bytes([last[0], last[1]]), 250, "the safe current");
}

#[test]
fn a_faulty_bus_is_counted_and_its_inputs_become_old() {
    let _turn = turn(module_path!());
    let (domain, dir, bus) =
        (Domain::lease(), tempfile::tempdir().expect("a directory"), MemoryBus::default());
    let mut config = config(&domain, dir.path(), &MAP, &[ESTIMATE]);
    config.set("input_timeout_s", &Value::Double(0.2)).expect("in range");
    let (service, mut receiver) = start(&config, &bus);
    let frames = frames(1.0);
    let _ = play(&bus, &frames, &mut receiver, |all| !all.is_empty());
    bus.put(Frame::new(id(5), system_now(), &[1]).expect("a frame"));
    bus.put(Frame::new(id(288), system_now(), &[1, 2, 3]).expect("a frame"));
    for fault in [BusFault::Error, BusFault::Off, BusFault::Down, BusFault::Failed("no answer".to_owned())] {
        bus.fault(fault);
    }
    let can = service.counters().can.expect("a bus");
    wait_until("the bus", || can.failed.load(Ordering::Relaxed) == 1);
    let counts = [&can.other, &can.short, &can.errors, &can.bus_off, &can.down]
        .map(|count| count.load(Ordering::Relaxed));
    // The short frame holds the position, but neither current nor force.
    assert_eq!(counts, [1, 2, 1, 1, 1]);
    assert!(can.is_off());
    // Without displacement, the last frames say that the estimate is not valid.
    let is_invalid = |frame: &Frame| frame.data()[1] >> 4 == 4;
    let mut last = None;
    wait_until("the bus", || {
        last = bus.sent().last().copied().or(last);
        last.as_ref().is_some_and(is_invalid)
    });
    let data = last.expect("a frame");
    assert_eq!(data.data()[2..4], [0, 0x80], "the force is not available");
    service.stop().expect("no thread panicked");
}

#[test]
fn a_kernel_without_can_and_wrong_parameters_are_errors() {
    let (domain, dir) = (Domain::lease(), tempfile::tempdir().expect("a directory"));
    let good = config(&domain, dir.path(), &MAP, &[ESTIMATE]);
    let error = |config: &Config| match DamperNode::start(config, &RosArgs::default(), false) {
        Ok(_) => panic!("it started"),
        Err(error) => (error.to_string(), error.is_wrong_usage()),
    };
    let (said, is_wrong_usage) = error(&good);
    assert!(!is_wrong_usage, "{said}");
    if Path::new("/proc/sys/net/core").exists()
        && !std::fs::read_to_string("/proc/net/protocols").unwrap_or_default().contains("CAN")
    {
        assert!(said.contains("can.interface can0: this kernel has no CAN sockets"), "{said}");
    } else {
        assert!(said.contains("can.interface can0"), "{said}");
    }
    let with = |name: &str, value: &str| {
        let mut config = good.clone();
        let value = if name == "can.interface" {
            Value::Text(value.into())
        } else {
            Value::TextList(vec![value.into()])
        };
        config.set(name, &value).expect("in range");
        error(&config)
    };
    for (name, value, why) in [
        ("can.interface", "", "can.map is set, but can.interface is not"),
        ("can.interface", "file:", "must be an interface such as can0, or file:LOG"),
        ("can.interface", "file:nowhere.log", "No such file"),
        (
            "can.check",
            "SUSP_FL,counter=Position",
            "can.check: SUSP_FL,counter=Position: SUSP_FL.Position is not suitable",
        ),
        ("can.map", "displacement=Pos", "can.map: displacement=Pos: no message of the DBC files has it"),
        ("can.out", "force_estimate=SUSP_FL,force=Load", "is an input already"),
        ("can.dbc", "nowhere.dbc", "nowhere.dbc: cannot open"),
    ] {
        let (said, is_wrong_usage) = with(name, value);
        assert!(said.contains(why), "{name}={value}: {said}");
        assert_eq!(is_wrong_usage, !value.contains("nowhere"), "{said}");
    }
}

#[test]
fn a_log_is_played_as_a_bus_and_sent_frames_are_written() {
    let _turn = turn(module_path!());
    let (domain, dir) = (Domain::lease(), tempfile::tempdir().expect("a directory"));
    let mut config = config(&domain, dir.path(), &MAP, &[ESTIMATE]);
    let run = offline_run(dir.path(), &frames(1.0));
    let [log, out] = ["drive.log", "sent.log"].map(|name| dir.path().join(name).display().to_string());
    config.set("can.interface", &Value::Text(format!("file:{log},out={out}"))).expect("a text");
    let (service, receiver) =
        DamperNode::start(&config, &RosArgs::default(), true).expect("the service starts");
    let (mut receiver, mut stamps) = (receiver.expect("a receiver"), Vec::<Stamp>::new());
    let can = service.counters().can.expect("a bus");
    wait_until("the bus", || {
        while let Ok(event) = receiver.events.pop() {
            if let Event::Estimate(estimate) = event
                && estimate.received.is_some()
            {
                stamps.push(estimate.stamp);
            }
        }
        can.ended.load(Ordering::Relaxed) == 1 && stamps.len() >= run.displacement_m.len()
    });
    service.stop().expect("no thread panicked");
    let since = |stamps: &[Stamp]| stamps.iter().map(|it| it.nanos() - stamps[0].nanos()).collect::<Vec<_>>();
    assert_eq!(since(&stamps), since(&run.displacement_m.stamps), "the spacing of the log, exactly");
    let sent = std::fs::read_to_string(&out).expect("sent frames");
    assert_eq!(
        sent.lines().filter(|line| line.contains(" out 121#")).count() as u64,
        can.estimates.load(Ordering::Relaxed)
    );
}
