//! Tests of the live view with an artificial summary, as a line and as a screen.

use super::*;
use mr_damper_model::pipeline::{
    AlarmChange, Cause, Estimate, Event, Mode, Reasons, Residual, Slot, Transition,
};
use mr_damper_model::sample::{Drive, DriveKind, Reading, Sample, Stamp};
use mr_damper_model::units::{Metre, Newton, Second};
use ratatui::backend::TestBackend;

/// Six seconds at 100 Hz: measured force stops at 4 s, and the ARX model coasts for half a second.
fn summary() -> LiveSummary {
    let mut summary = LiveSummary::new(RunInfo {
        title: "demo · rig RP-ICPS".to_owned(),
        free_model: "thesis/fuzzy-tanh/rp3-cs".to_owned(),
        seeded_model: "thesis/arx".to_owned(),
        reach: "domain 77, this machine only".to_owned(),
        zenoh: "tcp/127.0.0.1:7447".to_owned(),
        length_s: 10.0,
    });
    for k in 0..=600 {
        step(&mut summary, k);
    }
    summary.counts =
        Counts { sent: 1603, taken: 1603, refused: 0, lost: 2, incomplete: 0, estimates: 601, received: 601 };
    summary.played_s = 6.0;
    summary
}

fn step(summary: &mut LiveSummary, k: i64) {
    let at_s = k as f64 * 0.01;
    // Real stamps are large, and only their differences matter.
    let stamp = Stamp::from_nanos(1_700_000_000_000_000_000 + k * 10_000_000);
    let mut see = |event: Event| summary.take(&event, at_s);
    let sample = |reading| Event::Input(Sample { stamp, received: stamp.shifted(200_000), reading });
    see(sample(Reading::Drive(Drive::new(DriveKind::CoilCurrent, 1.0))));
    let force_n = 800.0 * (2.0 * at_s).sin();
    if k < 400 {
        see(sample(Reading::Force(Newton(force_n))));
    }
    see(sample(Reading::Displacement(Metre(0.01))));
    let change = |from, to, cause| Event::Transition(Transition { stamp, from, to, cause });
    match k {
        0 => see(change(Mode::Fault, Mode::Arx, Cause::ForceFresh)),
        400 => see(change(Mode::Arx, Mode::ArxCoast, Cause::ForceLost)),
        450 => see(change(Mode::ArxCoast, Mode::Model, Cause::CoastEnded)),
        _ => {}
    }
    let (mode, reasons) = match k {
        0..400 => (Mode::Arx, Reasons::NONE),
        400..450 => (Mode::ArxCoast, Reasons::FORCE_LOST),
        _ => (Mode::Model, Reasons::OUTSIDE_ENVELOPE),
    };
    see(Event::Estimate(Estimate {
        stamp,
        received: None,
        force: Newton(force_n - 20.0),
        smoothing: Newton(0.0),
        std_dev: Newton(30.0),
        slot: Slot::Free,
        mode,
        validity: reasons.validity(),
        reasons,
        input_age: Second(0.0),
        band: [Newton(force_n - 70.0), Newton(force_n + 30.0)],
        calibrated: false,
    }));
    if k < 400 {
        see(Event::Residual(Residual {
            stamp,
            measured: Newton(force_n),
            predicted: Newton(force_n - 50.0),
            load_cell: Newton(0.0),
            residual: Newton(50.0 * (7.0 * at_s).sin()),
            expected_rsse: Newton(f64::NAN),
            normalised: 1.0,
            windowed_rsse: Newton(51.5),
            windowed_esr: 0.0123,
            window: Second(5.0),
            counts: true,
            alarm: false,
        }));
    }
    summary.round_trip.note(7e-4);
}

fn drawn(summary: &LiveSummary, width: u16, height: u16) -> String {
    let mut terminal =
        ratatui::Terminal::new(TestBackend::new(width, height)).expect("a test backend cannot fail");
    terminal.draw(|frame| screen::draw(frame, summary)).expect("a test backend cannot fail");
    terminal.backend().to_string()
}

#[test]
fn a_line_tells_the_figures_without_escape_codes() {
    let mut early = LiveSummary::new(RunInfo::default());
    let mut lines = vec![plain::line(&early)];
    for k in 0..200 {
        step(&mut early, k);
    }
    lines.push(plain::line(&early));
    lines.push(plain::line(&summary()));
    assert!(lines.iter().all(|line| line.chars().all(|c| c >= ' ')));
    insta::assert_snapshot!(lines.join("\n"));
}

#[test]
fn the_screen_shows_everything_where_there_is_room() {
    insta::assert_snapshot!(drawn(&summary(), 110, 34));
}

#[test]
fn the_screen_fits_the_smallest_usual_terminal() {
    insta::assert_snapshot!(drawn(&summary(), 80, 24));
}

#[test]
fn an_alarm_is_shown_until_it_is_cleared() {
    let mut summary = summary();
    let stamp = Stamp::from_nanos(1_700_000_002_500_000_000);
    summary.take(&Event::Alarm(AlarmChange { stamp, raised: true, ratio: 4.25 }), 6.0);
    let at = |summary: &LiveSummary| plain::line(summary).contains("ALARM since 2.5 s");
    for (width, height) in [(110, 34), (80, 24)] {
        assert!(drawn(&summary, width, height).contains("ALARM since 2.5 s: 4.2 times the expected error"));
    }
    assert!(at(&summary));
    insta::assert_snapshot!(summary.alarm.expect("it stands").text(), @"  2.5 s  ALARM (stamp 1700000002.500): the simulation's residual is 4.2 times the model's expected error");
    summary.take(&Event::Alarm(AlarmChange { stamp, raised: false, ratio: f64::NAN }), 6.0);
    assert!(!at(&summary) && !drawn(&summary, 110, 34).contains("ALARM"));
}

#[test]
fn it_does_not_panic_at_any_size_or_state() {
    let empty = LiveSummary::new(RunInfo::default());
    for (width, height) in [(1, 1), (10, 3), (40, 12), (300, 100)] {
        drawn(&empty, width, height);
        drawn(&summary(), width, height);
    }
    let mut odd = summary();
    step(&mut odd, 10_000_000);
    step(&mut odd, 1);
    drawn(&odd, 80, 24);
}

#[test]
fn the_board_stays_small() {
    let mut summary = LiveSummary::new(RunInfo::default());
    for k in 0..100_000 {
        step(&mut summary, k % 400 + k / 400 * 400);
    }
    assert!(summary.estimated.len() <= 402, "{}", summary.estimated.len());
}
