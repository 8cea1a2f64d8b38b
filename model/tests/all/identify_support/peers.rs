//! The problem for timing against Python peers: 30 s at 512 Hz of 120 sines and a stepping current, and the force of a tanh damper with a
//! coil lag, noise, and a 20 Hz filter on all channels. The peers use different random numbers for the same problem.

use mr_damper_model::condition::Conditioning;
use mr_damper_model::identify::{Dataset, Row};
use mr_damper_model::sample::{DriveKind, Stamp};
use mr_damper_model::units::{M_PER_IN, N_PER_LBF};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, SQRT_2, TAU};

const RATE_HZ: f64 = 512.0;
const SAMPLES: usize = 15_360;

/// Second-order Butterworth low-pass at 20 Hz, by the bilinear transform.
fn low_pass(values: &[f64]) -> Vec<f64> {
    let k = (PI * 20.0 / RATE_HZ).tan();
    let norm = 1.0 + SQRT_2 * k + k * k;
    let (b, a1, a2) = (k * k / norm, 2.0 * (k * k - 1.0) / norm, (1.0 - SQRT_2 * k + k * k) / norm);
    let [mut x1, mut x2, mut y1, mut y2] = [0.0; 4];
    let step = |x: &f64| {
        let y = b * (x + 2.0 * x1 + x2) - a1 * y1 - a2 * y2;
        (x2, x1, y2, y1) = (x1, *x, y1, y);
        y
    };
    values.iter().map(step).collect()
}

/// Central difference, one-sided at the ends.
fn gradient(values: &[f64]) -> Vec<f64> {
    let last = values.len() - 1;
    (0..=last)
        .map(|k| {
            let (from, to) = (k.saturating_sub(1), (k + 1).min(last));
            (values[to] - values[from]) * RATE_HZ / (to - from) as f64
        })
        .collect()
}

/// The peers' data for a seed, in SI units.
pub(crate) fn synth(seed: u64) -> Dataset {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut uniform = || random.random::<f64>();
    let tones: Vec<(f64, f64)> =
        (0..120).map(|j| (TAU * (0.5 + 14.5 * f64::from(j) / 119.0), TAU * uniform())).collect();
    let at =
        |k: usize| tones.iter().map(|(w, phase)| (w * k as f64 / RATE_HZ + phase).sin() / w).sum::<f64>();
    let mut x: Vec<f64> = (0..SAMPLES).map(at).collect();
    let peak = x.iter().fold(0.0_f64, |peak, x| peak.max(x.abs()));
    x.iter_mut().for_each(|x| *x *= 0.5 / peak);
    let levels: Vec<f64> = (0..SAMPLES / 64).map(|_| 2.5 * uniform()).collect();
    let current: Vec<f64> = (0..SAMPLES).map(|k| levels[k / 64]).collect();
    let share = 1.0 - (-1.0 / (RATE_HZ * 0.008)).exp();
    let mut lagged = 0.0;
    let v = gradient(&x);
    let force: Vec<f64> = (0..SAMPLES)
        .map(|k| {
            lagged += share * (current[k] - lagged);
            let i = lagged;
            let tanh = (0.45 * (v[k] + (2.0 + 0.8 * i) * x[k])).tanh();
            let noise = (-2.0 * (1.0 - uniform()).ln()).sqrt() * (TAU * uniform()).cos();
            (5.0 + 3.0 * i) * v[k] + 10.0 * x[k] + (40.0 + 90.0 * i) * tanh + 6.0 + 2.0 * noise
        })
        .collect();
    let (x, i, force) = (low_pass(&x), low_pass(&current), low_pass(&force));
    let v = gradient(&x);
    let a = gradient(&v);
    let row = |k: usize| Row {
        stamp: Stamp::from_nanos(k as i64 * 1_953_125),
        dt_s: (k > 0).then_some(1.0 / RATE_HZ),
        displacement_m: x[k] * M_PER_IN,
        velocity_m_s: v[k] * M_PER_IN,
        acceleration_m_s2: a[k] * M_PER_IN,
        drive: i[k],
        force_n: force[k] * N_PER_LBF,
        case_temp_c: f64::NAN,
        raw_force_n: force[k] * N_PER_LBF,
        counts: true,
    };
    let rows = (0..SAMPLES).map(row).collect();
    Dataset::from_rows(
        &format!("peers seed {seed}"),
        Some(DriveKind::CoilCurrent),
        Conditioning::default(),
        RATE_HZ,
        rows,
    )
}
