//! Tests of the view of dampers: values, status, ages, charts.

use super::*;
use mr_damper_model::sample::Stamp;
use mr_damper_msgs::standard::{Header, Time};
use mr_damper_msgs::{
    CoilCurrent, CommandVoltage, CurrentCommand, Displacement, Force, ForceEstimate, ForceResidual, Mode,
    ModeChange, Reasons, Validity,
};
use serde_json::json as expected;

/// A header with a stamp `at_s` seconds after the first one.
fn header(at_s: f64) -> Header {
    let stamp = Stamp::from_nanos(1_700_000_000_000_000_000).shifted((at_s * 1e9).round() as i64);
    Header { stamp: Time::from_nanos_saturating(stamp.nanos()), frame_id: String::new() }
}

fn displacement(at_s: f64, displacement: f64) -> DamperMessage {
    DamperMessage::Displacement(Displacement { header: header(at_s), displacement, variance: 0.0 })
}

fn estimate(at_s: f64, mode: Mode, validity: Validity, reasons: Reasons) -> DamperMessage {
    DamperMessage::Estimate(ForceEstimate {
        header: header(at_s),
        force: -120.5,
        std_dev: 10.25,
        model: "a model".to_owned(),
        mode: mode.into(),
        validity: validity.into(),
        reasons,
        input_age: 0.002,
        band_low: -140.0,
        band_high: f64::NAN,
        band_calibrated: true,
    })
}

fn residual(at_s: f64, alarm: bool) -> DamperMessage {
    DamperMessage::Residual(ForceResidual {
        header: header(at_s),
        measured: -118.0,
        predicted: -120.5,
        residual: 2.5,
        normalised: 0.25,
        windowed_rsse: 9.5,
        windowed_esr: 0.125,
        window: 10.0,
        alarm,
    })
}

fn force(at_s: f64, force: f64) -> DamperMessage {
    DamperMessage::MeasuredForce(Force { header: header(at_s), force, variance: 0.0 })
}

/// The condition of the damper as the page shows it.
fn says(view: &DamperView, now_s: f64) -> String {
    let state = view.state(now_s);
    let level = serde_json::to_string(&state.level).expect("JSON");
    format!("{now_s} {}: {}", level.trim_matches('"'), state.status)
}

#[test]
fn the_status_describes_the_damper_and_silence_has_priority() {
    let mut view = DamperView::new("left");
    let mut shown = vec![says(&view, 0.0)];
    view.take(displacement(0.0, 0.0), 0.1);
    shown.push(says(&view, 0.3));
    view.take(estimate(0.0, Mode::Arx, Validity::Valid, Reasons::NONE), 1.0);
    shown.push(says(&view, 1.5));
    shown.push(says(&view, 2.0));
    shown.push(says(&view, 2.001));
    view.take(residual(0.1, true), 3.0);
    view.take(estimate(0.1, Mode::Model, Validity::Valid, Reasons::NONE), 3.0);
    shown.push(says(&view, 3.5));
    view.take(estimate(0.2, Mode::Model, Validity::Degraded, Reasons::LATE | Reasons::SENSOR_STUCK), 4.5);
    shown.push(says(&view, 4.5));
    view.take(
        estimate(
            0.3,
            Mode::Fault,
            Validity::Invalid,
            Reasons::from_bits(Reasons::DISPLACEMENT_LOST.bits() | 1 << 31),
        ),
        5.0,
    );
    shown.push(says(&view, 5.0));
    view.take(displacement(0.4, 0.0), 7.9);
    shown.push(says(&view, 8.2));
    shown.push(says(&view, 305.0));
    assert_eq!(
        shown,
        [
            "0 silent: no estimate received yet; no displacement either: is the node running, and does a sensor publish?",
            "0.3 silent: no estimate received yet; displacement is received: is the node active?",
            "1.5 good: VALID, mode arx",
            "2 good: VALID, mode arx",
            "2.001 silent: no estimate for 1.0 s, and no displacement either",
            &format!("3.5 warning: VALID, mode model; residual alarm: {}", mr_damper_base::alarm::ADVICE),
            "4.5 warning: DEGRADED, mode model: late, sensor stuck",
            "5 bad: INVALID, mode fault: displacement lost, 0x80000000",
            "8.2 silent: no estimate for 3.2 s, although displacement is received",
            "305 silent: no estimate for 5 min, and no displacement either",
        ]
    );
}

#[test]
fn values_equal_those_in_the_messages_and_have_ages() {
    let mut view = DamperView::new("left");
    view.take(estimate(0.5, Mode::Arx, Validity::Valid, Reasons::NONE), 1.0);
    view.take(residual(0.25, false), 1.25);
    view.take(
        DamperMessage::CoilCurrent(CoilCurrent { header: header(0.5), current: 0.75, variance: 0.0 }),
        1.5,
    );
    view.take(
        DamperMessage::Command(CurrentCommand {
            header: header(0.5),
            current: 1.5,
            force_requested: -500.0,
            force_expected: -450.0,
            achievable: false,
            dissipative: true,
            limited_by: 3,
            achievable_min: -900.0,
            achievable_max: -40.0,
        }),
        0.5,
    );
    view.take(
        DamperMessage::Mode(ModeChange {
            header: header(0.1),
            from_mode: 4,
            to_mode: 9,
            reason: "newer".to_owned(),
        }),
        1.0,
    );
    view.note_unreadable();
    let mut registry = DamperRegistry::default();
    registry.add("left");
    *registry.view("left").expect("it was added") = view;
    let json = serde_json::to_value(registry.snapshot(2.0)).expect("JSON");
    let zero_ns = 1_700_000_000_000_000_000_i64;
    assert_eq!(
        json,
        expected!({
            "schema": "mr-damper/serve/1", "source": "ros", "now_s": 2.0, "batch": 0,
            "dampers": [{
                "name": "left", "level": "good", "status": "VALID, mode arx",
                "estimate": {
                    "stamp_ns": zero_ns + 500_000_000, "age_s": 1.0, "stale": false, "force_n": -120.5, "std_dev_n": 10.25,
                    "band_low_n": -140.0, "band_high_n": null, "band_calibrated": true, "mode": "arx", "validity": "VALID",
                    "reasons": [], "input_age_s": 0.002, "model": "a model",
                },
                "measured": {"stamp_ns": zero_ns + 250_000_000, "age_s": 0.75, "stale": false, "force_n": -118.0},
                "drive": {"stamp_ns": zero_ns + 500_000_000, "age_s": 0.5, "stale": false, "unit": "A", "value": 0.75},
                "residual": {
                    "stamp_ns": zero_ns + 250_000_000, "age_s": 0.75, "stale": false, "measured_n": -118.0,
                    "predicted_n": -120.5, "residual_n": 2.5, "normalised": 0.25, "windowed_rsse_n": 9.5,
                    "windowed_esr": 0.125, "window_s": 10.0, "alarm": false,
                },
                "command": {
                    "stamp_ns": zero_ns + 500_000_000, "age_s": 1.5, "stale": true, "current_a": 1.5,
                    "force_requested_n": -500.0, "force_expected_n": -450.0, "achievable": false, "dissipative": true,
                    "limited_by": "rate", "achievable_min_n": -900.0, "achievable_max_n": -40.0,
                },
                "changes": [{
                    "stamp_ns": zero_ns + 100_000_000, "age_s": 1.0, "from": "fault", "to": "9 is not a known mode",
                    "reason": "newer",
                }],
                "rates_hz": {"coil_current": 1.0, "force_estimate": 1.0, "force_residual": 1.0, "mode": 1.0},
                "points_age_s": {"command": 1.5, "drive": 0.5, "estimate": 1.0, "measured": 0.75, "residual": 0.75},
                "unreadable": 1,
            }],
        })
    );
}

#[test]
fn measured_force_is_taken_from_the_node_if_the_node_reports_it() {
    let mut view = DamperView::new("left");
    let shown = |view: &DamperView, now_s| view.state(now_s).measured.map(|measured| measured.value.force_n);
    view.take(force(0.0, 118.0), 0.0);
    assert_eq!(shown(&view, 0.0), Some(118.0), "as published on its topic");
    view.take(residual(0.1, false), 0.1);
    view.take(force(0.2, 118.0), 0.2);
    assert_eq!(shown(&view, 0.2), Some(-118.0), "with the node's sign");
    view.take(force(2.0, 119.0), 2.0);
    assert_eq!(shown(&view, 2.0), Some(119.0));
    let volts =
        DamperMessage::CommandVoltage(CommandVoltage { header: header(2.0), voltage: 2.5, variance: 0.0 });
    view.take(volts, 2.0);
    let drive = view.state(2.0).drive.expect("a drive").value;
    assert_eq!(drive, DriveReading { unit: "V", value: 2.5 });
}

#[test]
fn charts_continue_from_batch_to_batch_and_restart_when_time_is_set_back() {
    let mut registry = DamperRegistry::default();
    registry.add("right");
    registry.add("left");
    registry.add("left");
    let play = |registry: &mut DamperRegistry, from: u32, to: u32| {
        for k in from..to {
            let at_s = f64::from(k) * 0.01;
            registry.take("left", displacement(at_s, 0.5 * at_s), at_s);
            registry.take("left", estimate(at_s, Mode::Model, Validity::Valid, Reasons::NONE), at_s);
            registry.take("left", residual(at_s, false), at_s);
            registry.take("nobody", residual(at_s, false), at_s);
        }
    };
    let parsed = |text: &str| serde_json::from_str::<serde_json::Value>(text).expect("JSON");
    play(&mut registry, 0, 10);
    let (number, first) = registry.batch(0.1);
    let first = parsed(&first);
    assert_eq!((number, &first["batch"], &first["points"][0]["era"]), (1, &expected!(1), &expected!(0)));
    assert_eq!(first["dampers"][0]["name"], "left", "in the order of names, each once");
    assert_eq!(first["dampers"].as_array().map(Vec::len), Some(2));
    assert_eq!(first["points"].as_array().map(Vec::len), Some(1), "the right damper is silent");
    assert_eq!(first["points"][0]["estimate"][3], expected!([0.03, -120.5, -140.0, null, 2.0]));
    // The slope of 0.5 over three samples is assigned to the middle sample.
    assert_eq!(first["points"][0]["velocity"][0], expected!([0.01, 0.5]));
    assert_eq!(first["points"][0]["estimate"].as_array().map(Vec::len), Some(10));

    play(&mut registry, 10, 13);
    let second = parsed(&registry.batch(0.13).1);
    assert_eq!(second.get("dampers"), None, "values are sent with every fifth batch");
    assert_eq!(second["points"][0]["residual"], expected!([[0.1, 2.5], [0.11, 2.5], [0.12, 2.5]]));
    assert_eq!(parsed(&registry.batch(0.14).1), expected!({"now_s": 0.14, "batch": 3}), "nothing is new");

    play(&mut registry, 400, 402);
    play(&mut registry, 100, 102);
    let anew = parsed(&registry.batch(4.0).1);
    assert_eq!(anew["points"][0]["era"], 1);
    assert_eq!(anew["points"][0]["estimate"].as_array().map(Vec::len), Some(2), "earlier points are removed");
    assert_eq!(anew["points"][0]["estimate"][0][0], 0.0);
    let start = serde_json::to_value(registry.start(4.0)).expect("JSON");
    assert_eq!(start["points"][0]["estimate"], anew["points"][0]["estimate"]);
    assert_eq!((&start["batch"], &start["schema"]), (&expected!(4), &expected!("mr-damper/serve/1")));
}

#[test]
fn a_line_ages_while_a_node_repeats_its_last_stamp() {
    let mut view = DamperView::new("left");
    let invalid = |at_s| estimate(at_s, Mode::Fault, Validity::Invalid, Reasons::DISPLACEMENT_LOST);
    for now_s in [0.0, 0.1, 0.2] {
        view.take(displacement(now_s, 0.0), now_s);
        view.take(invalid(now_s), now_s);
    }
    for now_s in [1.2, 2.2, 3.2] {
        view.take(invalid(0.2), now_s);
    }
    let state = view.state(3.2);
    assert_eq!(state.estimate.map(|estimate| estimate.age_s), Some(0.0));
    assert!((state.points_age_s["estimate"] - 3.0).abs() < 1e-12, "{:?}", state.points_age_s);
    assert!((state.points_age_s["displacement"] - 3.0).abs() < 1e-12, "{:?}", state.points_age_s);
    assert!(!state.points_age_s.contains_key("measured"));
    let mut registry = DamperRegistry::default();
    registry.add("left");
    *registry.view("left").expect("it was added") = view;
    let shown = on_screen(&registry, 3.2, 0, None, (80, 24));
    assert!(shown.contains("INVALID") && shown.contains("STOPPED 3.0 s ago; force before"), "{shown}");
}

#[test]
fn charts_show_motion_drive_and_command_and_the_last_minutes() {
    let mut registry = DamperRegistry::default();
    registry.add("left");
    let command = |at_s| {
        DamperMessage::Command(CurrentCommand {
            header: header(at_s),
            current: 0.5,
            force_requested: -500.0,
            force_expected: -450.0,
            achievable: true,
            dissipative: true,
            limited_by: 0,
            achievable_min: -900.0,
            achievable_max: -40.0,
        })
    };
    let current = |at_s, current| {
        DamperMessage::CoilCurrent(CoilCurrent { header: header(at_s), current, variance: 0.0 })
    };
    // 1 kHz; one sample of the current, which the points leave out, is a spike.
    for k in 0..120_000_u32 {
        let at_s = f64::from(k) * 1e-3;
        registry.take("left", displacement(at_s, f64::from(k % 4) * 0.25), at_s);
        registry.take("left", current(at_s, if k == 30_001 { 2.0 } else { 0.25 }), at_s);
        registry.take("left", command(at_s), at_s);
    }
    let start = serde_json::to_value(registry.start(120.0)).expect("JSON");
    let points = &start["points"][0];
    assert_eq!(points["zero_ns"], expected!(1_700_000_000_000_000_000_i64));
    let newest =
        |series: &str| points[series].as_array().and_then(|all| all.last()).cloned().expect("points");
    assert_eq!(newest("displacement"), expected!([119.997, 0.25]));
    assert_eq!(newest("drive"), expected!([119.997, 0.25]));
    assert_eq!(newest("command"), expected!([119.997, -500.0, -450.0, 0.5]));

    let history = registry.history("left", 29.95).expect("a damper");
    let json = serde_json::to_value(&history).expect("JSON");
    assert_eq!(json["bucket_s"], 0.1);
    assert_eq!((&json["zero_ns"], &json["era"]), (&points["zero_ns"], &expected!(0)));
    assert_eq!(json["drive"][0], expected!([29.9, 0.25, 0.25]));
    assert_eq!(json["drive"][1], expected!([30.0, 0.25, 2.0]), "the spike is kept");
    assert_eq!(json["command"][0], expected!([29.9, -500.0, -500.0, -450.0, -450.0, 0.5, 0.5]));
    assert_eq!(history.drive.len(), 901);
    assert_eq!(registry.history("left", f64::NEG_INFINITY).expect("a damper").drive.len(), 1200);
    assert_eq!(registry.history("nobody", 0.0), None);

    // Volts do not continue a line of amperes.
    let volts =
        DamperMessage::CommandVoltage(CommandVoltage { header: header(120.0), voltage: 2.5, variance: 0.0 });
    registry.take("left", volts, 120.0);
    assert_eq!(registry.history("left", 0.0).expect("a damper").drive.len(), 1);
}

fn on_screen(
    registry: &DamperRegistry,
    now_s: f64,
    selected: usize,
    frozen_s: Option<f64>,
    size: (u16, u16),
) -> String {
    let states = registry.snapshot(now_s).dampers;
    let view = registry.views().nth(selected);
    let points = view.and_then(|view| view.points(&mut ChartCursor::default()));
    let points = points.as_ref();
    let content = screen::ScreenContent { states: &states, selected, points, frozen_s, origin: "on ROS" };
    let backend = ratatui::backend::TestBackend::new(size.0, size.1);
    let mut terminal = ratatui::Terminal::new(backend).expect("a test backend cannot fail");
    terminal.draw(|frame| screen::draw(frame, &content)).expect("a test backend cannot fail");
    terminal.backend().to_string()
}

/// Two dampers: one publishes until 3 s, the other only until 1 s.
fn vehicle() -> DamperRegistry {
    let mut registry = DamperRegistry::default();
    registry.add("front_left");
    registry.add("front_right");
    for k in 0..300 {
        let at_s = f64::from(k) * 0.01;
        for name in ["front_left", "front_right"].into_iter().take(if k < 100 { 2 } else { 1 }) {
            registry.take(name, displacement(at_s, 0.0), at_s);
            registry.take(name, residual(at_s, name == "front_left"), at_s);
            registry.take(name, estimate(at_s, Mode::Model, Validity::Valid, Reasons::NONE), at_s);
        }
    }
    let change =
        ModeChange { header: header(2.0), from_mode: 0, to_mode: 2, reason: "no measured force".to_owned() };
    registry.take("front_left", DamperMessage::Mode(change), 2.0);
    registry
}

#[test]
fn a_terminal_shows_current_values_and_leaves_out_stale_ones() {
    let registry = vehicle();
    insta::assert_snapshot!(on_screen(&registry, 3.0, 0, None, (80, 24)));
    let silent = on_screen(&registry, 3.0, 1, Some(4.2), (110, 30));
    insta::assert_snapshot!(silent);
    for (width, height) in [(1, 1), (20, 4), (300, 90)] {
        on_screen(&DamperRegistry::default(), 0.0, 0, None, (width, height));
        on_screen(&registry, 3.0, 1, None, (width, height));
    }
    let lines: Vec<String> = registry.snapshot(3.0).dampers.iter().map(screen::line).collect();
    insta::assert_snapshot!(lines.join("\n"));
}

/// The names and column heads of the table at this width.
fn table_at(names: &[&str], width: u16) -> Vec<String> {
    let mut registry = DamperRegistry::default();
    for name in names {
        registry.add(name);
        registry.take(name, estimate(0.0, Mode::ArxCoast, Validity::Extrapolating, Reasons::NONE), 0.0);
    }
    let shown = on_screen(&registry, 0.1, 0, None, (width, 40));
    shown
        .lines()
        .skip(1)
        .take(names.len() + 1)
        .map(|line| line.trim_matches('"').trim_end().to_owned())
        .collect()
}

#[test]
fn names_tell_dampers_apart_in_a_narrow_terminal() {
    let corners = ["front_left", "front_right", "rear_left", "rear_right"];
    assert_eq!(
        table_at(&corners, 70),
        [
            "damper        mode      validity        est. N  meas. N resid. N    Hz",
            "▶front_left   arx_coast EXTRAPOLATING   -120.5        -        -     1",
            " front_right  arx_coast EXTRAPOLATING   -120.5        -        -     1",
            " rear_left    arx_coast EXTRAPOLATING   -120.5        -        -     1",
            " rear_right   arx_coast EXTRAPOLATING   -120.5        -        -     1",
        ]
    );
    let long = [
        "depot_3/vehicle_0017/front_left",
        "depot_3/vehicle_0017/front_right",
        "depot_3/vehicle_0018/rear_left",
    ];
    let rows = table_at(&long, 44);
    assert_eq!(rows[0], "damper                validity        est. N");
    assert_eq!(rows[1], "▶depot_…17/front_left EXTRAPOLATING   -120.5");
    for width in [30, 44, 60, 70, 80, 120] {
        let rows = table_at(&long, width);
        let name =
            |row: &String| row.split(' ').find(|word| !word.is_empty()).map(|word| word.replace('▶', ""));
        let mut names: Vec<String> = rows[1..].iter().filter_map(name).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), long.len(), "{width} columns: {names:?}");
    }
}
