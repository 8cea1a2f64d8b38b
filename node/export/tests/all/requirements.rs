//! The requirements in the guide (node/docs/guide/16-requirements.md): each is held by a test here or elsewhere, on readings by hand.

use crate::cases::{fuzzy_tanh, with};
use crate::compile::{parse, run_bytes, write};
use mr_damper_export::CExport;
use mr_damper_export::vectors::{Expected, Readings};
use mr_damper_model::effect::Effect;
use mr_damper_model::inverse::{InverseController, Limits, Method};
use mr_damper_model::pipeline::Settings;
use std::path::Path;

// Bits of `flags`, as the header of the export defines them.
const DRIVE_MISSING: u32 = 1;
const DRIVE_STALE: u32 = 2;
const GAP: u32 = 8;
const REFUSED: u32 = 16;
const RANGE: u32 = 16_384;
const RATE: u32 = 32_768;

const LIMITS: Limits = Limits {
    current_max_a: 2.0,
    rate_max_a_s: 50.0,
    safe_a: 0.25,
    safe_after_s: 0.5,
    hold_m_s: 2e-3,
    lead_s: 4e-3,
    feedback_s: 15e-3,
    feedback_gain: 1.2,
};

/// Readings at 1 kHz along a sine of 8 mm at 2 Hz, with a current of 1 A at every sample.
fn sine(count: usize) -> Vec<Readings> {
    let at = |k: usize| Readings {
        time_ns: 1_000_000_000 + 1_000_000 * k as i64,
        displacement_m: 8e-3 * (std::f64::consts::TAU * 2e-3 * k as f64).sin(),
        drive: 1.0,
        velocity_m_s: f64::NAN,
        case_temp_c: f64::NAN,
        force_request_n: f64::NAN,
    };
    (0..count).map(at).collect()
}

/// What the exported code returns for `readings`.
fn estimates(readings: &[Readings]) -> Vec<Expected> {
    let source = CExport::new("damper", &fuzzy_tanh()).source().expect("it is exported");
    let dir = tempfile::tempdir().expect("a directory");
    write(dir.path(), &source);
    run_bytes(dir.path(), &source, "gcc", "-O2", readings).chunks_exact(24).map(parse).collect()
}

/// A command of the exported code.
#[derive(Debug, Clone, Copy)]
struct Command {
    current_a: f64,
    is_commanded: bool,
    is_dissipative: bool,
    limited_by: u32,
}

/// The commands for `readings` of a damper with a coil lag.
fn commands(readings: &[Readings]) -> Vec<Command> {
    let model = with(fuzzy_tanh(), &[Effect::CoilLag.example()]);
    let controller = InverseController::with_method(&model, LIMITS, Method::Search).expect("an inverse");
    let parts = controller.parts().expect("it has an inverse");
    let source = CExport::new("damper", &model).inverse(&parts).source().expect("it is exported");
    let dir = tempfile::tempdir().expect("a directory");
    write(dir.path(), &source);
    let command = |bytes: &[u8]| {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
        Command {
            current_a: f64::from_le_bytes(bytes[32..40].try_into().expect("eight bytes")),
            is_commanded: word(28) & 1 == 1,
            is_dissipative: word(28) & 4 == 4,
            limited_by: word(24),
        }
    };
    run_bytes(dir.path(), &source, "gcc", "-O2", readings).chunks_exact(80).map(command).collect()
}

#[test]
fn a_displacement_that_cannot_be_gives_no_estimate_and_is_flagged() {
    let mut readings = sine(100);
    readings[40].displacement_m = f64::NAN;
    readings[50].displacement_m = f64::INFINITY;
    readings[60].displacement_m = 1.5;
    readings[70].displacement_m += 0.4;
    let found = estimates(&readings);
    for (k, flags) in [(40, REFUSED), (50, REFUSED), (60, REFUSED | RANGE), (70, REFUSED | RATE)] {
        assert!(!found[k].accepted && found[k].force_n.is_nan(), "{k}");
        assert_eq!(found[k].flags, flags, "{k}");
        // The next estimate says that a reading before it was refused, and has a force.
        assert!(found[k + 1].force_n.is_finite() && found[k + 1].flags & flags == flags, "{k}");
        assert_eq!(found[k + 2].flags & flags, 0, "{k}");
    }
}

#[test]
fn without_a_drive_there_is_no_force() {
    let mut readings = sine(60);
    readings[..30].iter_mut().for_each(|reading| reading.drive = f64::NAN);
    let found = estimates(&readings);
    assert!(found[..30].iter().all(|own| own.force_n.is_nan() && own.flags & DRIVE_MISSING != 0));
    assert!(found[30..].iter().all(|own| own.force_n.is_finite() && own.flags & DRIVE_MISSING == 0));
}

#[test]
fn an_old_drive_is_flagged_with_the_first_sample_after_its_timeout() {
    let timeout = (1e3 * Settings::default().input_timeout_s) as usize;
    let mut readings = sine(100 + timeout + 100);
    readings[101..].iter_mut().for_each(|reading| reading.drive = f64::NAN);
    let found = estimates(&readings);
    let stale: Vec<usize> = (0..found.len()).filter(|k| found[*k].flags & DRIVE_STALE != 0).collect();
    assert_eq!(stale.first(), Some(&(101 + timeout)), "the last drive was read at sample 100");
    // The last drive is held.
    assert!(found[2..].iter().all(|own| own.force_n.is_finite()));
}

#[test]
fn a_gap_is_flagged_at_its_end_and_one_sample_has_no_force() {
    let gap = (1e3 * Settings::default().gap_s) as usize;
    for (lost, is_gap) in [(gap - 1, false), (gap, true)] {
        let mut readings = sine(400);
        readings.drain(100..100 + lost);
        let found = estimates(&readings);
        assert_eq!(found[100].flags & GAP != 0, is_gap, "{lost} lost samples");
        assert_eq!(found[100].force_n.is_nan(), is_gap, "{lost} lost samples");
        assert!(found[101].force_n.is_finite() && found[101].flags & GAP == 0, "{lost} lost samples");
    }
}

#[test]
fn a_new_place_of_the_rod_is_accepted_at_the_third_sample() {
    let mut readings = sine(200);
    readings[100..].iter_mut().for_each(|reading| reading.displacement_m += 0.1);
    let found = estimates(&readings);
    let accepted: Vec<bool> = found[99..104].iter().map(|own| own.accepted).collect();
    assert_eq!(accepted, [true, false, false, true, true]);
    assert!(found[102].flags & GAP != 0 && found[103].force_n.is_finite());
}

#[test]
fn a_clock_that_is_set_back_is_accepted_at_the_third_sample() {
    let mut readings = sine(200);
    readings[100..].iter_mut().for_each(|reading| reading.time_ns -= 5_000_000_000);
    let found = estimates(&readings);
    let accepted: Vec<bool> = found[99..104].iter().map(|own| own.accepted).collect();
    assert_eq!(accepted, [true, false, false, true, true]);
    // A stamp that repeats is refused alone.
    let mut readings = sine(200);
    readings[100].time_ns = readings[99].time_ns;
    let found = estimates(&readings);
    assert!(!found[100].accepted && found[101].accepted && found[101].force_n.is_finite());
}

/// Requests along the motion from sample 100 on.
fn requested() -> Vec<Readings> {
    let mut readings = sine(3000);
    for k in 100..readings.len() {
        let speed_m_s = (readings[k].displacement_m - readings[k - 1].displacement_m) / 1e-3;
        readings[k].force_request_n = 6000.0 * speed_m_s;
        readings[k].drive = if k % 700 < 350 { f64::NAN } else { readings[k].drive };
    }
    readings
}

#[test]
fn commands_begin_with_the_first_request_and_stay_within_range_and_rate() {
    let mut readings = requested();
    for k in (200..3000).step_by(37) {
        readings[k].force_request_n = [f64::INFINITY, -4e5, 3000.0, -3000.0][k % 4];
        readings[k].displacement_m = [f64::NAN, readings[k].displacement_m][k % 2];
    }
    let found = commands(&readings);
    assert!(found[..100].iter().all(|own| !own.is_commanded && own.current_a == LIMITS.safe_a));
    assert!(found[100].is_commanded);
    let mut moves = 0;
    for (k, pair) in found.windows(2).enumerate() {
        let change_a = (pair[1].current_a - pair[0].current_a).abs();
        assert!((0.0..=LIMITS.current_max_a).contains(&pair[1].current_a), "{k}: {pair:?}");
        // A sample that was refused leaves its time to the next one.
        let steps = if pair[0].is_commanded { 1.0 } else { 2.0 };
        assert!(change_a <= steps * LIMITS.rate_max_a_s * 1e-3 * (1.0 + 1e-9), "{k}: {pair:?}");
        moves += usize::from(change_a > 0.0);
    }
    assert!(moves > 1000, "the current changes: {moves}");
}

#[test]
fn a_force_that_would_drive_the_rod_never_raises_the_current() {
    let mut readings = requested();
    readings[1000..2000].iter_mut().for_each(|reading| reading.force_request_n *= -1.0);
    let found = commands(&readings);
    let mut seen = 0;
    for pair in found.windows(2) {
        if pair[1].is_commanded && !pair[1].is_dissipative && pair[1].limited_by == 4 {
            seen += 1;
            assert!(pair[1].current_a <= pair[0].current_a, "{pair:?}");
        }
    }
    assert!(seen > 500, "{seen}");
}

#[test]
fn without_requests_the_current_is_safe_after_timeout_and_fall_time() {
    let mut readings = requested();
    readings[1500..].iter_mut().for_each(|reading| reading.force_request_n = f64::NAN);
    let found = commands(&readings);
    let timeout = (1e3 * Settings::default().request_timeout_s) as usize;
    let safe: Vec<usize> = (1500..3000).filter(|k| found[*k].limited_by == 5).collect();
    assert_eq!(safe.first(), Some(&(1500 + timeout)), "the last request was at sample 1499");
    let fall = (1e3 * LIMITS.safe_after_s) as usize;
    let end = &found[1500 + timeout + fall + 1..];
    assert!(end.iter().all(|own| (own.current_a - LIMITS.safe_a).abs() < 1e-12), "{:?}", end[0]);
}

/// The page names tests as `file`: `test`. Each exists, and each test above is named.
#[test]
fn each_requirement_is_traced_to_tests_that_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let read = |path: &str| {
        std::fs::read_to_string(root.join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
    };
    let page = read("node/docs/guide/16-requirements.md");
    let rows: Vec<&str> = page.lines().filter(|line| line.starts_with("| R-")).collect();
    assert!(rows.len() >= 15, "{} requirements", rows.len());
    let mut named = Vec::new();
    for row in &rows {
        let tests: Vec<&str> = row.rsplit('|').nth(1).expect("cells").split("`: `").collect();
        assert!(tests.len() > 1, "no test: {row}");
        for pair in tests.windows(2) {
            let path = pair[0].rsplit('`').next().expect("a path");
            let name = pair[1].split('`').next().expect("a name");
            let text = read(path);
            let is_test = text.split("#[test]").skip(1).any(|rest| {
                // Other attributes may come in between.
                let head: Vec<&str> = rest.lines().take(4).map(str::trim).collect();
                head.iter().any(|line| line.starts_with(&format!("fn {name}(")))
            });
            assert!(is_test, "{path} has no test {name}");
            named.push(name.to_owned());
        }
    }
    let own = read("node/export/tests/all/requirements.rs");
    for name in own.split("#[test]\nfn ").skip(1).filter_map(|rest| rest.split('(').next()) {
        assert!(
            named.iter().any(|own| own == name) || name.starts_with("each_requirement"),
            "{name} is not named"
        );
    }
}
