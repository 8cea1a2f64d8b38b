//! Uncertainty bands of the running pipeline, and their table in a model file. Coverage is tested in `uncertainty_coverage.rs`.

use crate::common::{Harness, calibrated, preset};
use mr_damper_model::calibrate::calibrate;
use mr_damper_model::condition::ApplyTo;
use mr_damper_model::model::{Envelope, Model};
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::pipeline::{Estimate, Mode, Models, Settings, UseForce, Validity};
use mr_damper_model::preset::{BEST_ARX, BEST_FUZZY_TANH};
use mr_damper_model::uncertainty::{Operating, Predictor};

fn file(model: Model) -> ModelFile {
    ModelFile { model, provenance: Provenance::default() }
}

fn half_n(estimate: &Estimate) -> f64 {
    0.5 * (estimate.band[1].get() - estimate.band[0].get())
}

/// A [`Harness`] with both models calibrated.
fn harness(settings: Settings) -> Harness {
    let models = Models::alone(calibrated(preset(BEST_FUZZY_TANH)))
        .with_seeded(calibrated(preset(BEST_ARX)))
        .expect("both want a current");
    Harness::of(models, settings)
}

#[test]
fn the_table_read_from_a_file_is_bit_identical() {
    for name in [BEST_FUZZY_TANH, BEST_ARX] {
        let written = file(calibrated(preset(name)));
        let text = written.to_toml().expect("writes");
        assert!(text.contains("[expected.uncertainty.one_step.coasting]"), "{text}");
        assert_eq!(ModelFile::from_toml(&text).expect("reads"), written);
        let without = file(preset(name)).to_toml().expect("writes");
        assert!(!without.contains("uncertainty"));
        assert_eq!(ModelFile::from_toml(&without).expect("an old file").model.expected.uncertainty, None);
    }
}

#[test]
fn an_error_in_the_table_names_the_key() {
    let text = file(calibrated(preset(BEST_FUZZY_TANH))).to_toml().expect("writes");
    for (from, to, expected) in [
        ("half_band_n = [[20.0,", "half_band_n = [[-20.0,", "free_run.half_band_n[0][0] is -20"),
        ("half_band_n = [[20.0,", "half_band_n = [[nan,", "free_run.half_band_n[0][0] is NaN"),
        (
            "half_band_n = [[20.0, 24.0]",
            "half_band_n = [[20.0]",
            "free_run.half_band_n has 1 values in row 0",
        ),
        ("speed_edges_m_s = [0.05, 0.1]", "speed_edges_m_s = [0.1, 0.05]", "must increase"),
        ("speed_edges_m_s = [0.05, 0.1]", "speed_edges_m_s = [0.05, 0.05]", "must increase"),
        ("speed_edges_m_s = [0.05, 0.1]", "speed_edges_m_s = [0.05, inf]", "free_run.speed_edges_m_s is"),
        ("speed_edges_m_s = [0.05, 0.1]", "speed_edges_m_s = [-0.05, 0.1]", "speeds must be above 0"),
        ("speed_edges_m_s = [0.05, 0.1]", "speed_edges_m_s = [0.05]", "free_run.std_dev_n has 3 rows"),
        ("speed_edges_m_s = [0.05, 0.1]", "speed_edges_m_s = [0.1, 0.2, 0.3, 0.4]", "at most 3"),
        ("drive_edges = [1.0]", "drive_edges = []", "free_run.std_dev_n has 2 values in row 0"),
        ("age_s = [0.002, 0.1, 0.3]", "age_s = [0.002, 0.1]", "added_std_dev_n has 3 values"),
        ("age_s = [0.002, 0.1, 0.3]", "age_s = [0.1, 0.002, 0.3]", "drive_held.age_s is"),
        (
            "added_std_dev_n = [0.0, 20.0, 40.0]",
            "added_std_dev_n = [0.0, 40.0, 20.0]",
            "added_std_dev_n[2] is 20",
        ),
        (
            "added_std_dev_n = [0.0, 20.0, 40.0]",
            "added_std_dev_n = [1.0, 20.0, 40.0]",
            "added_std_dev_n[0] is 1",
        ),
        ("std_dev_factor = [1.0, 3.0, 8.0]", "std_dev_factor = [0.5, 3.0, 8.0]", "std_dev_factor[0] is 0.5"),
        ("time_s = [0.001953125, 0.01, 0.25]", "time_s = []", "coasting.time_s has 0 values"),
        ("[expected.uncertainty.free_run]\n", "[expected.uncertainty.free_run]\nspeed = 1.0\n", "speed"),
        ("expected.uncertainty.free_run.drive_held", "expected.uncertainty.free_run.held", "held"),
    ] {
        assert!(text.contains(from), "the test must change the file: {from}\n{text}");
        let message = ModelFile::from_toml(&text.replacen(from, to, 1)).expect_err(to).to_string();
        assert!(message.contains(expected), "{to}: {message}");
    }
    let held = text.find("[expected.uncertainty.free_run.drive_held]").expect("written");
    let next = text.find("[expected.uncertainty.one_step]").expect("written");
    let message = ModelFile::from_toml(&format!("{}{}", &text[..held], &text[next..])).expect_err("without");
    assert!(message.to_string().contains("free_run.drive_held is missing"), "{message}");
}

#[test]
fn the_band_depends_on_the_mode_and_on_the_region() {
    let mut harness = harness(Settings { bumpless_tau_s: 0.0, ..Settings::default() });
    // Force is present for more than 2 s at a time: a force that is lost again within 2 s is not used at once.
    harness.run(0..7685, |k| k % 1537 < 1387);
    let of = |mode| harness.estimates().filter(move |e| e.mode == mode && e.calibrated);
    // Half widths in the table: 2 and 3 N for one-step-ahead prediction, 20 to 44 N for simulation (free run).
    let arx: Vec<f64> = of(Mode::Arx).map(half_n).collect();
    assert!(arx.iter().filter(|h| (**h - 2.0).abs() < 1e-9 || (**h - 3.0).abs() < 1e-9).count() > 300);
    assert!(of(Mode::ArxCoast).count() > 200);
    for pair in harness.estimates().collect::<Vec<_>>().windows(2) {
        // Apart from the region (2 or 3 N), the band only grows while ARX coasts.
        if pair[0].mode == Mode::ArxCoast && pair[1].mode == Mode::ArxCoast {
            assert!(half_n(pair[1]) * 1.5 >= half_n(pair[0]), "{pair:?}");
        }
    }
    let longest = of(Mode::ArxCoast).map(half_n).fold(0.0, f64::max);
    assert!((3.0 * 7.0..=3.0 * 8.0).contains(&longest), "{longest}");
    assert!(of(Mode::Model).count() > 50);
    for estimate in of(Mode::Model) {
        let half = half_n(estimate);
        let known = [20.0, 24.0, 30.0, 34.0, 40.0, 44.0].iter().any(|h| (h - half).abs() < 1e-9);
        assert!(known && (estimate.std_dev.get() - 0.5 * half).abs() < 1e-9, "{estimate:?}");
    }
}

#[test]
fn the_band_after_a_change_of_mode_contains_the_estimate() {
    let mut harness = harness(Settings { bumpless_tau_s: 0.2, ..Settings::default() });
    harness.run(0..900, |k| k % 300 < 150);
    let mut stretched = 0;
    for e in harness.estimates().filter(|e| e.force.is_finite()) {
        assert!(e.band[0] <= e.force && e.force <= e.band[1], "{e:?}");
        let off = e.force.get() - 0.5 * (e.band[0].get() + e.band[1].get());
        stretched += usize::from(off.abs() > 1.0);
    }
    assert!(stretched > 100, "{stretched}");
}

#[test]
fn without_calibration_the_band_comes_from_the_expected_error() {
    let mut harness = Harness::new(Settings { use_measured_force: UseForce::Never, ..Settings::default() });
    harness.run(0..200, |_| true);
    let expected_n = preset(BEST_FUZZY_TANH).expected.free_run_rsse_n.expect("stated");
    let settled: Vec<_> = harness.estimates().skip(1).collect();
    assert!(settled.len() > 190);
    for estimate in settled {
        assert!(!estimate.calibrated && estimate.std_dev.get() == expected_n, "{estimate:?}");
        assert!((half_n(estimate) - 1.645 * expected_n).abs() < 1e-9, "{estimate:?}");
    }
}

#[test]
fn an_old_drive_widens_the_band() {
    let settings = Settings { use_measured_force: UseForce::Never, ..Settings::default() };
    let mut harness = harness(settings);
    harness.constant_current = true;
    harness.run(0..100, |_| false);
    harness.without_drive = true;
    harness.run(100..300, |_| false);
    let last: Vec<_> = harness.estimates().collect();
    let (fresh, aged) = (last[99], last[99 + 154]);
    let base = |e: &Estimate| {
        let half = half_n(e);
        [24.0, 34.0, 44.0].iter().any(|h: &f64| (half - h.hypot(80.0)).abs() < 0.5)
    };
    assert!(fresh.calibrated && half_n(fresh) < 45.0, "{fresh:?}");
    assert!(aged.calibrated && base(aged), "{aged:?} {}", half_n(aged));
    let beyond = last[99 + 199];
    assert!(!beyond.calibrated && base(beyond), "an age beyond the table: {beyond:?}");
}

#[test]
fn the_band_of_a_held_estimate_is_the_full_force_range() {
    let range = [-1500.0, 1400.0];
    for known in [true, false] {
        let mut free = calibrated(preset(BEST_FUZZY_TANH));
        free.envelope = Envelope { force_n: known.then_some(range), ..free.envelope };
        let mut harness = Harness::of(Models::alone(free), Settings::default());
        harness.run(0..200, |_| false);
        for ms in (900..3500).step_by(20) {
            harness.tick(ms);
        }
        let held: Vec<_> = harness.estimates().filter(|e| e.mode == Mode::Hold).collect();
        assert!(held.len() > 5);
        for e in held {
            assert!(!e.calibrated && e.validity == Validity::Stale);
            if known {
                assert_eq!(e.band.map(|n| n.get()), range);
                assert!((800.0..2000.0).contains(&e.std_dev.get()), "{e:?}");
            } else {
                assert!(e.band.iter().all(|n| n.get().is_nan()) && e.std_dev.get().is_nan(), "{e:?}");
            }
        }
        let gone = harness.estimates().last().expect("some");
        assert!(gone.mode == Mode::Fault && gone.band[0].get().is_nan() && !gone.calibrated, "{gone:?}");
    }
}

#[test]
fn the_first_estimate_after_a_gap_was_held_through_it() {
    let range = [-1500.0, 1400.0];
    let mut free = calibrated(preset(BEST_FUZZY_TANH));
    free.envelope = Envelope { force_n: Some(range), ..free.envelope };
    let mut harness = Harness::of(Models::alone(free), Settings::default());
    harness.run(0..200, |_| false);
    harness.run(300..301, |_| false);
    let held = harness.estimates().last().expect("some");
    assert_eq!((held.mode, held.band.map(|n| n.get())), (Mode::Hold, range), "{held:?}");
}

#[test]
fn a_filter_other_than_in_calibration_ends_the_calibration() {
    let calibrated_rows = |filter| {
        let mut harness =
            harness(Settings { filter, use_measured_force: UseForce::Never, ..Settings::default() });
        harness.run(0..400, |_| false);
        harness.estimates().filter(|e| e.calibrated).count()
    };
    assert!(calibrated_rows(None) > 200);
    assert!(calibrated_rows(Some((ApplyTo::Inputs, 20.0))) > 200, "its own");
    assert_eq!(calibrated_rows(Some((ApplyTo::Inputs, 10.0))), 0);
}

#[test]
fn an_extrapolating_estimate_is_not_calibrated() {
    let mut free = calibrated(preset(BEST_FUZZY_TANH));
    free.envelope.velocity_m_s = Some([-0.05, 0.05]);
    let mut harness = Harness::of(Models::alone(free), Settings::default());
    harness.run(0..900, |_| false);
    let (beyond, within): (Vec<&Estimate>, Vec<&Estimate>) =
        harness.estimates().skip(100).partition(|e| e.validity == Validity::Extrapolating);
    assert!(beyond.len() > 100 && beyond.iter().all(|e| !e.calibrated));
    assert!(within.len() > 100 && within.iter().all(|e| e.calibrated));
}

#[test]
fn too_few_calibration_runs_are_rejected() {
    let error = calibrate(&preset(BEST_FUZZY_TANH), &[]).expect_err("no runs").to_string();
    assert!(error.contains("0 of 3") && error.contains("hold out at least 3 runs"), "{error}");
}

#[test]
fn a_table_covers_its_predictors() {
    let table = calibrated(preset(BEST_ARX)).expected.uncertainty.expect("given");
    assert!(table.covers(Predictor::FreeRun) && table.covers(Predictor::OneStep));
    let at = Operating {
        predictor: Predictor::OneStep,
        velocity_m_s: 0.2,
        drive: 0.5,
        coast_s: 0.001_953_125,
        drive_age_s: 0.0,
    };
    assert_eq!(table.spread(&at).map(|s| (s.std_dev_n, s.half_band_n, s.calibrated)), Some((1.5, 3.0, true)));
}
