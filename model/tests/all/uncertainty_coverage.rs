//! Coverage of the calibrated 90 % bands of the running pipeline: the share of measured forces inside, on runs that were used neither for
//! identification nor for calibration.
//!
//! Generated runs are replicates of two experiments with random motion and current, each with its own excitation, on a rig with drift
//! ([`mr_damper_model::rig::Drift`]). Measured runs are in the folder `MR_DAMPER_DATA`. They are assigned to identification, calibration
//! and test at random, so that calibration and test are exchangeable. A single draw may differ from 90 % because there are few runs, so
//! the mean over draws is tested. `MR_DAMPER_LONG=1` uses more sets and more draws; `--nocapture` shows all figures.

use crate::coverage::{Away, Row, Tally, cover, generated};
use crate::measured::folder;
use mr_damper_model::calibrate::calibrate;
use mr_damper_model::identify::{ModelSpec, Options, Watch, identify};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::Mode;
use mr_damper_model::sample::Run;
use mr_damper_model::uncertainty::Predictor;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;

/// Runs for identification, for calibration and for the test.
type Parts = [Vec<Run>; 3];

fn long() -> bool {
    std::env::var_os("MR_DAMPER_LONG").is_some()
}

/// A model identified on `train` and calibrated on `held_out`.
fn model(spec: ModelSpec, [train, held_out, _]: &Parts) -> Model {
    let options = Options { restarts: 4, most_rows: Some(4000), ..Options::default() };
    let mut model = identify(spec, train, &options, &Watch::none()).expect("identifies").model;
    model.expected.uncertainty = Some(calibrate(&model, held_out).expect("enough to calibrate with"));
    model
}

/// All rows of the test runs.
fn rows(model: &Model, test: &[Run], away: Away) -> Vec<Row> {
    (0..).zip(test).flat_map(|(seed, run)| cover(model, run, away, seed)).collect()
}

/// Checks that the coverage of the rows selected by `which` lies within `range`, prints it under `name`, and returns it.
fn assert_covers(name: &str, rows: &[Row], range: [f64; 2], which: impl Fn(&Row) -> bool) -> f64 {
    let tally = Tally::of(rows.iter().filter(|row| which(row)));
    println!("{name}: {}", tally.text());
    assert!(tally.rows > 400, "{name}: {tally:?}");
    assert!((range[0]..=range[1]).contains(&tally.coverage()), "{name}: {}", tally.text());
    tally.coverage()
}

const ACCEPTED: [f64; 2] = [0.88, 0.92];

/// Range for a single set of runs while an input is missing. Errors then differ more from run to run, and only eight runs are used for
/// calibration. The mean over sets must be within [`ACCEPTED`].
const OF_A_SET: [f64; 2] = [0.85, 0.95];

/// Checks that the mean over sets is within [`ACCEPTED`].
fn assert_mean(name: &str, shares: &[f64]) {
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    println!("{name}: {:.1} % over {} sets", 100.0 * mean, shares.len());
    assert!((ACCEPTED[0]..=ACCEPTED[1]).contains(&mean), "{name}: {mean}");
}

/// Range for a region. It has about 200 effective rows or more in calibration and in test, so the difference of the two shares has a
/// standard deviation of 3 %. Three standard deviations are allowed, because there are twelve regions.
const OF_A_REGION: [f64; 2] = [0.81, 0.99];

/// Checks the coverage of each region. With all inputs present, each region has a different band width.
fn assert_regions(name: &str, rows: &[Row], mode: Mode) {
    let mut regions: BTreeMap<u64, Vec<Row>> = BTreeMap::new();
    for row in rows.iter().filter(|row| row.mode == mode && row.calibrated) {
        regions.entry((1e6 * row.width_n).round() as u64).or_default().push(*row);
    }
    assert_eq!(regions.len(), 12, "{name}");
    for (width, rows) in regions {
        assert_covers(&format!("{name}, -/+ {:.1} N", 0.5e-6 * width as f64), &rows, OF_A_REGION, |_| true);
    }
}

/// Sets of replicates: per experiment two for identification, four for calibration and five for the test.
fn sets() -> impl Iterator<Item = (u64, Parts)> {
    let parts = |set| [generated(1..=2, set), generated(3..=6, set), generated(7..=11, set)];
    (1..=if long() { 8 } else { 1 }).map(move |set| (set, parts(set)))
}

#[test]
fn simulation_bands_cover_nine_of_ten_generated_forces() {
    let mut when_aged = Vec::new();
    for (set, parts) in sets() {
        let model = model(ModelSpec::FUZZY_TANH, &parts);
        let all = rows(&model, &parts[2], Away::None);
        assert_covers(&format!("set {set}, fuzzy-tanh"), &all, ACCEPTED, |_| true);
        assert_regions(&format!("set {set}, fuzzy-tanh"), &all, Mode::Model);
        let aged = rows(&model, &parts[2], Away::Drive);
        let is_aged = |row: &Row| row.drive_age_s > 0.003;
        when_aged.push(assert_covers(
            &format!("set {set}, fuzzy-tanh, drive held"),
            &aged,
            OF_A_SET,
            is_aged,
        ));
        for [from, to] in [[0.003, 0.04], [0.04, 0.15], [0.15, 0.3]] {
            let name = format!("set {set}, fuzzy-tanh, drive held for {from} to {to} s");
            assert_covers(&name, &aged, [0.82, 0.98], |row| (from..to).contains(&row.drive_age_s));
        }
    }
    assert_mean("fuzzy-tanh, drive held", &when_aged);
}

#[test]
fn one_step_ahead_bands_cover_nine_of_ten_generated_forces() {
    let mut when_coasting = Vec::new();
    for (set, parts) in sets() {
        let model = model(ModelSpec::ARX_SEMI_ACTIVE, &parts);
        let all = rows(&model, &parts[2], Away::None);
        assert_covers(&format!("set {set}, arx"), &all, ACCEPTED, |row| row.mode == Mode::Arx);
        assert_regions(&format!("set {set}, arx"), &all, Mode::Arx);
        let lost = rows(&model, &parts[2], Away::Force);
        let coasts = |row: &Row| row.mode != Mode::Model && row.coast_s > 0.003;
        assert_covers(&format!("set {set}, arx, force lost at times"), &lost, ACCEPTED, |_| true);
        when_coasting.push(assert_covers(&format!("set {set}, arx, coasting"), &lost, OF_A_SET, coasts));
        for [from, to] in [[0.003, 0.02], [0.02, 0.06], [0.06, 0.15], [0.15, 0.25]] {
            let name = format!("set {set}, arx, coasting for {from} to {to} s");
            assert_covers(&name, &lost, [0.82, 0.98], |row| coasts(row) && (from..to).contains(&row.coast_s));
        }
        let model_mode = format!("set {set}, arx in simulation");
        assert_covers(&model_mode, &lost, [0.8, 0.98], |row| row.mode == Mode::Model);
        let aged = rows(&model, &parts[2], Away::Drive);
        assert_covers(&format!("set {set}, arx, drive held"), &aged, ACCEPTED, |row| row.drive_age_s > 0.003);
    }
    assert_mean("arx, coasting", &when_coasting);
}

/// Random thirds of the runs.
fn thirds(runs: &[Run], random: &mut Pcg64Mcg) -> Parts {
    let mut order: Vec<usize> = (0..runs.len()).collect();
    order.shuffle(random);
    [0, 1, 2].map(|part| order.iter().skip(part).step_by(3).map(|k| runs[*k].clone()).collect())
}

/// Random thirds of runs with all combinations of motions and currents (sorted by motion), as a Latin square: each motion and each
/// current is in every part.
fn latin_thirds(runs: &[Run], currents: usize, random: &mut Pcg64Mcg) -> Parts {
    let mut shuffled = |count: usize| {
        let mut order: Vec<usize> = (0..count).collect();
        order.shuffle(random);
        order
    };
    let (motion, current) = (shuffled(runs.len() / currents), shuffled(currents));
    let turn = random.random_range(0..3);
    let part_of = |k: usize| (motion[k / currents] + current[k % currents] + turn) % 3;
    [0, 1, 2].map(|part| (0..runs.len()).filter(|k| part_of(*k) == part).map(|k| runs[k].clone()).collect())
}

/// Range while coasting. utfsm-mr has five runs for calibration, so a run that is left out is predicted from four, and the resulting
/// level is a little high (92.0 % over 40 draws).
const OF_FEW: [f64; 2] = [0.87, 0.93];

/// Checks that the mean coverage over draws is within `range`, and prints the coverage of each draw.
fn assert_draws(
    name: &str,
    spec: ModelSpec,
    away: Away,
    range: [f64; 2],
    which: impl Fn(&Row) -> bool,
    draw: impl Fn(&mut Pcg64Mcg) -> Parts,
) {
    let mut shares = Vec::new();
    let mut counted = Tally::default();
    for seed in 0..if long() { 40 } else { 10 } {
        let parts = draw(&mut Pcg64Mcg::seed_from_u64(seed));
        let model = model(spec, &parts);
        let predictor = if spec == ModelSpec::FUZZY_TANH { Predictor::FreeRun } else { Predictor::OneStep };
        assert!(model.expected.uncertainty.is_some_and(|u| u.covers(predictor)), "{name} {seed}");
        let rows = rows(&model, &parts[2], away);
        let tally = Tally::of(rows.iter().filter(|row| which(row)));
        shares.push(tally.coverage());
        counted.rows += tally.rows;
    }
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    let each: Vec<String> = shares.iter().map(|share| format!("{:.1}", 100.0 * share)).collect();
    println!(
        "{name}: {:.1} % over {} draws ({} rows): {}",
        100.0 * mean,
        shares.len(),
        counted.rows,
        each.join(" ")
    );
    assert!((range[0]..=range[1]).contains(&mean), "{name}: {mean}");
}

#[test]
#[ignore = "needs the measured runs: set MR_DAMPER_DATA"]
fn bands_cover_nine_of_ten_measured_forces() {
    let one_step = |row: &Row| row.mode == Mode::Arx && row.coast_s < 0.015;
    let coasts = |row: &Row| row.mode != Mode::Model && row.coast_s > 0.015;
    let runs = folder("utfsm-mr");
    assert_eq!(runs.len(), 30);
    let draw = |random: &mut Pcg64Mcg| latin_thirds(&runs, 5, random);
    assert_draws("utfsm-mr, fuzzy-tanh", ModelSpec::FUZZY_TANH, Away::None, ACCEPTED, |_| true, draw);
    // An ARX model is valid at one rate: the three motions at 1000 Hz are used.
    let fast = |run: &&Run| ["10mm2hz", "5mm3hz", "5mm4hz"].iter().any(|motion| run.name.contains(motion));
    let fast: Vec<Run> = runs.iter().filter(fast).cloned().collect();
    let draw = |random: &mut Pcg64Mcg| latin_thirds(&fast, 5, random);
    assert_draws("utfsm-mr, arx", ModelSpec::ARX_SEMI_ACTIVE, Away::None, ACCEPTED, one_step, draw);
    assert_draws("utfsm-mr, arx coasting", ModelSpec::ARX_SEMI_ACTIVE, Away::Force, OF_FEW, coasts, draw);
    let runs = folder("utfpr-mr");
    let draw = |random: &mut Pcg64Mcg| thirds(&runs, random);
    assert_draws("utfpr-mr, fuzzy-tanh", ModelSpec::FUZZY_TANH, Away::None, ACCEPTED, |_| true, draw);
    assert_draws("utfpr-mr, arx", ModelSpec::ARX_SEMI_ACTIVE, Away::None, ACCEPTED, one_step, draw);
    assert_draws("utfpr-mr, arx coasting", ModelSpec::ARX_SEMI_ACTIVE, Away::Force, OF_FEW, coasts, draw);
}
