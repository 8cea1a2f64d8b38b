//! Tests of the table: regions, growth, unknown inputs.

use super::*;
use proptest::prelude::*;

fn growth(nodes: &[(f64, f64)]) -> Growth {
    let nodes: Vec<_> = nodes
        .iter()
        .map(|(at, w)| (*at, Width { std_dev: *w, half_band: 1.5 * *w - 0.5 * nodes[0].1 }))
        .collect();
    Growth::new(&nodes).expect("a growth")
}

/// Widths that differ by region: 10 N more per speed region, 1 N more per drive region.
fn bands(base_n: f64, held: Option<Growth>) -> Bands {
    let mut width_n = [[Width::default(); DRIVES]; SPEEDS];
    for (i, row) in width_n.iter_mut().enumerate() {
        for (j, width) in row.iter_mut().enumerate() {
            let std_dev = base_n + 10.0 * i as f64 + j as f64;
            *width = Width { std_dev, half_band: 2.0 * std_dev };
        }
    }
    let edges = if held.is_some() { Edges::new(&[0.5, 1.5]) } else { Edges::new(&[]) };
    Bands {
        speed_edges_m_s: Edges::new(&[0.1, 0.2, 0.3]).expect("edges"),
        drive_edges: edges.expect("edges"),
        width_n,
        drive_held: held,
    }
}

fn uncertainty() -> Uncertainty {
    let held = growth(&[(0.002, 0.0), (0.1, 30.0), (0.3, 60.0)]);
    Uncertainty {
        free_run: Some(bands(100.0, Some(held))),
        one_step: Some(OneStep {
            bands: bands(5.0, Some(growth(&[(0.002, 0.0), (0.3, 2.0)]))),
            coasting: growth(&[(0.002, 1.0), (0.01, 4.0), (0.25, 12.0)]),
        }),
    }
}

fn at(predictor: Predictor) -> Operating {
    Operating { predictor, velocity_m_s: -0.15, drive: 0.7, coast_s: 0.002, drive_age_s: 0.001 }
}

#[test]
fn regions_are_selected_by_speed_and_drive() {
    let table = uncertainty();
    for (velocity_m_s, drive, expected_n) in
        [(0.0, 0.0, 100.0), (-0.15, 0.7, 111.0), (0.3, 1.5, 132.0), (-9.0, 0.0, 130.0), (0.1, 0.5, 111.0)]
    {
        let at = Operating { velocity_m_s, drive, ..at(Predictor::FreeRun) };
        let expected = Spread { std_dev_n: expected_n, half_band_n: 2.0 * expected_n, calibrated: true };
        assert_eq!(table.spread(&at), Some(expected), "{at:?}");
    }
    assert_eq!(table.spread(&at(Predictor::OneStep)).map(|s| s.std_dev_n), Some(16.0));
}

#[test]
fn growth_is_linear_between_times_and_flagged_beyond_the_last() {
    let table = uncertainty();
    let one_step = |coast_s, drive_age_s| {
        let at = Operating { coast_s, drive_age_s, ..at(Predictor::OneStep) };
        table.spread(&at).expect("known")
    };
    assert!((one_step(0.006, 0.001).std_dev_n - 16.0 * 2.5).abs() < 1e-9);
    assert!((one_step(0.25, 0.001).std_dev_n - 16.0 * 12.0).abs() < 1e-9);
    // A held drive hardly affects the one-step-ahead prediction, but affects coasting as much as the
    // simulation.
    assert!((one_step(0.002, 0.3).std_dev_n - 16.0_f64.hypot(2.0)).abs() < 1e-9);
    assert!((one_step(0.01, 0.3).std_dev_n - 64.0_f64.hypot(60.0)).abs() < 1e-9);
    assert!(one_step(0.3, 0.3).calibrated && !one_step(0.32, 0.3).calibrated);
    assert!(!one_step(0.002, 0.4).calibrated);
    // Beyond the last time the width is at least the width of the simulation.
    let mut weak = table;
    if let Some(one_step) = &mut weak.one_step {
        one_step.coasting = growth(&[(0.002, 1.0), (0.01, 1.1)]);
    }
    let far = Operating { coast_s: 0.1, ..at(Predictor::OneStep) };
    assert_eq!(weak.spread(&far).map(|s| (s.std_dev_n, s.calibrated)), Some((111.0, false)));
}

#[test]
fn unknown_inputs_give_no_spread() {
    let nan = f64::NAN;
    for predictor in [Predictor::FreeRun, Predictor::OneStep] {
        let fine = at(predictor);
        assert!(uncertainty().spread(&fine).is_some());
        for unknown in [
            Operating { velocity_m_s: nan, ..fine },
            Operating { drive: nan, ..fine },
            Operating { drive_age_s: nan, ..fine },
        ] {
            assert_eq!(uncertainty().spread(&unknown), None, "{unknown:?}");
        }
    }
    let lost = |predictor| Operating { coast_s: nan, ..at(predictor) };
    assert_eq!(uncertainty().spread(&lost(Predictor::OneStep)), None);
    assert!(uncertainty().spread(&lost(Predictor::FreeRun)).is_some(), "a simulation uses no force");
    let passive = Uncertainty { free_run: Some(bands(100.0, None)), one_step: None };
    let undriven = Operating { drive: nan, drive_age_s: nan, ..at(Predictor::FreeRun) };
    assert_eq!(passive.spread(&undriven).map(|s| s.std_dev_n), Some(110.0));
    assert_eq!(passive.spread(&at(Predictor::OneStep)), None);
    assert!(passive.covers(Predictor::FreeRun) && !passive.covers(Predictor::OneStep));
}

proptest! {
    #[test]
    fn widths_never_decrease_with_time_and_age(
        velocity_m_s in -1.0..1.0_f64,
        drive in -1.0..3.0_f64,
        [coast_s, coast_more] in [0.0..0.5_f64, 0.0..0.5],
        [drive_age_s, age_more] in [0.0..0.5_f64, 0.0..0.5],
    ) {
        let table = uncertainty();
        for predictor in [Predictor::FreeRun, Predictor::OneStep] {
            let spread = |coast_s, drive_age_s| {
                let at = Operating { predictor, velocity_m_s, drive, coast_s, drive_age_s };
                table.spread(&at).expect("known")
            };
            let base = spread(0.0, 0.0);
            let here = spread(coast_s, drive_age_s);
            for later in [spread(coast_s + coast_more, drive_age_s), spread(coast_s, drive_age_s + age_more)] {
                prop_assert!(later.std_dev_n >= here.std_dev_n * (1.0 - 1e-12), "{here:?} {later:?}");
                prop_assert!(later.half_band_n >= here.half_band_n * (1.0 - 1e-12), "{here:?} {later:?}");
            }
            prop_assert!(here.std_dev_n >= base.std_dev_n && here.half_band_n >= base.half_band_n);
        }
    }
}
