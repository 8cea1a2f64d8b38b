//! Compares the virtual rig with the thesis' damper: standard deviation of force by experiment, and force by
//! velocity.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example rig_calibration [SEEDS]
//! ```

use mr_damper_model::rig::current::STEPS_A;
use mr_damper_model::rig::{Channels, Experiment, Plant, SecondOrder, record};
use std::f64::consts::TAU;

const N_PER_LBF: f64 = 4.448_221_6;
const M_PER_IN: f64 = 0.0254;

/// Standard deviation of force in lbf, computed from RSSE (RMSE) and ESR (NMSE) in the thesis' tables 4.1 to
/// 4.7.
const THESIS_LBF: [f64; 8] = [93.67, 94.72, 77.73, 94.28, 93.69, 94.84, 94.73, 97.49];

/// Force in lbf at 1, 3, 6 and 8 in/s, by current: table D.1, mean of the three stepped experiments.
const THESIS_FV_LBF: [[f64; 4]; 7] = [
    [22.9, 29.5, 39.3, 45.7],
    [33.9, 59.9, 70.3, 75.9],
    [39.6, 83.4, 101.2, 107.6],
    [42.8, 109.9, 158.5, 172.7],
    [55.7, 120.7, 195.1, 243.6],
    [69.5, 138.2, 241.1, 309.7],
    [76.8, 151.5, 263.5, 338.1],
];

fn std(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / values.len() as f64).sqrt()
}

/// Standard deviations of displacement (in), velocity (in/s) and force (lbf) of one run.
fn deviations(experiment: &Experiment, seed: u64) -> [f64; 3] {
    let run = record(experiment, &Plant::default(), &Channels::PERFECT, seed);
    let x = run.displacement_m.values;
    let v: Vec<f64> = x.windows(2).map(|pair| (pair[1] - pair[0]) * 512.0).collect();
    let force = run.force_n.map(|trace| trace.values).unwrap_or_default();
    [std(&x) / M_PER_IN, std(&v) / M_PER_IN, std(&force) / N_PER_LBF]
}

/// Force in lbf at the peak velocity of a sine of 1.5 Hz, for that peak velocity and current.
fn force_lbf(speed_in_s: f64, current_a: f64) -> f64 {
    let experiment = Experiment::sine(speed_in_s * M_PER_IN / (TAU * 1.5), 1.5, current_a, 4.0);
    let plant = Plant::default().with_temperature_fade_per_k(0.0);
    let run = record(&experiment, &plant, &Channels::PERFECT, 0);
    // The 1.5 Hz sine starts at zero displacement; at 2 s it has completed three periods, and velocity is at
    // its maximum.
    run.force_n.map_or(f64::NAN, |trace| trace.values[1024]) / N_PER_LBF
}

fn main() {
    let seeds = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(8);
    println!("standard deviation of force over {seeds} seeds, lbf (root of the mean variance, range)");
    println!("experiment   thesis    rig          range     off     x in  v in/s");
    for (name, thesis) in Experiment::names().zip(THESIS_LBF) {
        let Some(experiment) = Experiment::thesis(name) else { continue };
        let experiment = experiment.with_servo(SecondOrder::SERVO);
        let half = seeds / 2;
        // Two threads, because the long experiments are 80 minutes of damper time.
        let all: Vec<[f64; 3]> = std::thread::scope(|scope| {
            let of = |range: std::ops::Range<u64>| {
                let experiment = &experiment;
                move || range.map(|seed| deviations(experiment, seed)).collect::<Vec<_>>()
            };
            let (first, second) = (scope.spawn(of(0..half)), of(half..seeds)());
            first.join().unwrap_or_default().into_iter().chain(second).collect()
        });
        let rms = |n: usize| (all.iter().map(|d| d[n] * d[n]).sum::<f64>() / all.len() as f64).sqrt();
        let (low, high) =
            all.iter().fold((f64::INFINITY, 0.0f64), |(low, high), d| (low.min(d[2]), high.max(d[2])));
        println!(
            "{name:11} {thesis:7.1} {:7.1} {low:8.1} to {high:5.1} {:+6.1} %  {:6.3}  {:6.2}",
            rms(2),
            100.0 * (rms(2) / thesis - 1.0),
            rms(0),
            rms(1)
        );
    }
    println!("\nforce at 1, 3, 6, 8 in/s, lbf (thesis in brackets)");
    for (current_a, thesis) in STEPS_A.into_iter().zip(THESIS_FV_LBF) {
        let row: Vec<String> = [1.0, 3.0, 6.0, 8.0]
            .into_iter()
            .zip(thesis)
            .map(|(speed, thesis)| {
                let found = force_lbf(speed, current_a);
                format!("{found:6.1} ({thesis:5.1}, {:+4.0} %)", 100.0 * (found / thesis - 1.0))
            })
            .collect();
        println!("{current_a:.1} A  {}", row.join("  "));
    }
}
