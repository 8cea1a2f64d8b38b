//! Compares the scheme with a fine integration of the same equations, and its sensitivities with differences.

use super::super::ForceLaw;
use super::*;

const RATE_HZ: f64 = 512.0;

/// The damper that the source identified (1.5 V lower limit), z in cm; it yields within 0.02 mm.
const SPENCER: [f64; 9] = [2_100.0, 28_300.0, 4_690.0, 500.0, 140.0, 36_300.0, 2.0, 36_300.0, 30_100.0];
/// A larger damper with a wide soft loop.
const SOFT: [f64; 9] = [1_500.0, 60_000.0, 8_000.0, 1_000.0, 600.0, 900.0, 1.2, 300.0, 1_000.0];
/// Exponent 1, with equal loading and unloading.
const SHARP: [f64; 9] = [800.0, 20_000.0, 500.0, 0.0, 1_000.0, 4_000.0, 1.0, 0.0, 4_000.0];

/// A motion with its exact velocity, as a sum of sines: m, Hz, rad.
type Motion = &'static [(f64, f64, f64)];
const SLOW: Motion = &[(0.015, 2.0, 0.3)];
const FAST: Motion = &[(0.004, 10.0, 0.0)];
const MIXED: Motion = &[(0.008, 0.7, 0.1), (0.004, 2.9, 1.0), (0.0015, 7.3, 2.0), (0.0005, 13.1, 0.5)];

fn motion(parts: Motion, t: f64) -> (f64, f64) {
    parts.iter().fold((0.0, 0.0), |(x, v), (size, hz, phase)| {
        let omega = std::f64::consts::TAU * hz;
        (x + size * (omega * t + phase).sin(), v + size * omega * (omega * t + phase).cos())
    })
}

fn inputs(parts: Motion, k: usize) -> Inputs {
    let (displacement_m, velocity_m_s) = motion(parts, k as f64 / RATE_HZ);
    Inputs {
        dt_s: (k > 0).then_some(1.0 / RATE_HZ),
        displacement_m,
        velocity_m_s,
        acceleration_m_s2: f64::NAN,
        drive: 0.0,
        case_temp_c: f64::NAN,
    }
}

/// Forces by the classic Runge-Kutta scheme with 500 steps per sample, with the exact velocity.
fn fine(p: &[f64; 9], parts: Motion, samples: usize) -> Vec<f64> {
    let [c0, c1, k0, k1, alpha, gamma, n, beta, a] = *p;
    let rate = |s: [f64; 2], t: f64| {
        let (x, v) = motion(parts, t);
        let ([y, z], magnitude) = (s, s[1].abs());
        let y_rate = (alpha * z + c0 * v + k0 * (x - y)) / (c0 + c1);
        let slip = v - y_rate;
        let z_rate =
            -gamma * slip.abs() * z * magnitude.powf(n - 1.0) - beta * slip * magnitude.powf(n) + a * slip;
        [y_rate, z_rate]
    };
    let along = |s: [f64; 2], k: [f64; 2], h: f64| [s[0] + h * k[0], s[1] + h * k[1]];
    let h = 1.0 / RATE_HZ / 500.0;
    let mut s = [motion(parts, 0.0).0, 0.0];
    let mut forces = Vec::with_capacity(samples);
    for sample in 0..samples {
        let t0 = sample as f64 / RATE_HZ;
        forces.push(c1 * rate(s, t0)[0] + k1 * motion(parts, t0).0);
        for j in 0..500 {
            let t = t0 + f64::from(j) * h;
            let q1 = rate(s, t);
            let q2 = rate(along(s, q1, 0.5 * h), t + 0.5 * h);
            let q3 = rate(along(s, q2, 0.5 * h), t + 0.5 * h);
            let q4 = rate(along(s, q3, h), t + h);
            for i in 0..2 {
                s[i] += h / 6.0 * (q1[i] + 2.0 * q2[i] + 2.0 * q3[i] + q4[i]);
            }
        }
    }
    forces
}

const DAMPERS: [(&str, [f64; 9]); 3] = [("spencer", SPENCER), ("soft", SOFT), ("sharp", SHARP)];
const MOTIONS: [(&str, Motion); 3] = [("slow", SLOW), ("fast", FAST), ("mixed", MIXED)];

fn run(p: &[f64; 9], parts: Motion, samples: usize) -> Vec<f64> {
    let mut hidden = Hidden::default();
    (0..samples).map(|k| ForceLaw::BoucWen.force_n(p, &inputs(parts, k), &mut hidden)).collect()
}

#[test]
fn the_step_agrees_with_a_fine_integration() {
    for ((name, p), (motion, parts)) in DAMPERS.iter().flat_map(|d| MOTIONS.map(|m| (d, m))) {
        let exact = fine(p, parts, 512);
        let coarse = run(p, parts, 512);
        let peak = exact.iter().fold(0.0_f64, |peak, f| peak.max(f.abs()));
        let errors = || exact.iter().zip(&coarse).map(|(e, c)| (e - c).abs() / peak);
        let rms = (errors().map(|e| e * e).sum::<f64>() / 512.0).sqrt();
        assert!(rms < 1e-3, "{name} {motion}: rms {rms}");
        // The error is largest just after a reversal at 10 Hz, where the stiff damper yields within half a
        // sample.
        let worst = errors().fold(0.0_f64, f64::max);
        assert!(worst < 5e-3, "{name} {motion}: worst {worst}");
    }
}

#[test]
fn sensitivities_along_a_run_agree_with_differences() {
    for ((name, p), (motion, parts)) in DAMPERS.iter().flat_map(|d| MOTIONS.map(|m| (d, m))) {
        let plain = run(p, parts, 300);
        let (mut hidden, mut s) = (Hidden::default(), [[0.0; 9]; MAX_HIDDEN]);
        let mut found = Vec::new();
        for (k, force) in plain.iter().enumerate() {
            let step = ForceLaw::BoucWen.sensitivity(p, &inputs(parts, k), &mut hidden);
            assert!((step.force_n - force).abs() <= 1e-9 * (1.0 + force.abs()));
            let chain = |by_hidden: &[f64; MAX_HIDDEN], j: usize| -> f64 {
                by_hidden.iter().zip(&s).map(|(a, row)| a * row[j]).sum()
            };
            found.push(std::array::from_fn::<f64, 9, _>(|j| {
                step.force_by_parameter[j] + chain(&step.force_by_hidden, j)
            }));
            s = std::array::from_fn(|h| {
                std::array::from_fn(|j| step.hidden_by_parameter[h][j] + chain(&step.hidden_by_hidden[h], j))
            });
        }
        for (j, parameter) in BoucWen::PARAMETERS.iter().enumerate() {
            let d = 1e-6 * p[j].abs().max(1.0);
            let shifted = |by: f64| {
                let mut q = *p;
                q[j] += by;
                run(&q, parts, 300)
            };
            let (up, down) = (shifted(d), shifted(-d));
            let differences: Vec<f64> = up.iter().zip(&down).map(|(u, l)| (u - l) / (2.0 * d)).collect();
            let size = differences.iter().map(|f| f * f).sum::<f64>().sqrt();
            let error =
                differences.iter().zip(&found).map(|(f, row)| (f - row[j]).powi(2)).sum::<f64>().sqrt();
            assert!(error <= 1e-4 * size, "{name} {motion} {}: {error} of {size}", parameter.name);
        }
    }
}

#[test]
fn derivatives_by_the_hidden_variables_agree_with_differences() {
    let at = Inputs { velocity_m_s: 0.08, displacement_m: 0.004, ..inputs(SLOW, 1) };
    let hidden = [2e-4, 0.4, 0.07];
    let found = ForceLaw::BoucWen.sensitivity(&SOFT, &at, &mut hidden.clone());
    for h in 0..MAX_HIDDEN {
        let shifted = |by: f64| {
            let mut start = hidden;
            start[h] += by;
            (ForceLaw::BoucWen.force_n(&SOFT, &at, &mut start), start)
        };
        let ((up, next_up), (down, next_down)) = (shifted(1e-7), shifted(-1e-7));
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-5 * (1.0 + a.abs());
        assert!(close((up - down) / 2e-7, found.force_by_hidden[h]), "force by {h}");
        for g in 0..MAX_HIDDEN {
            let difference = (next_up[g] - next_down[g]) / 2e-7;
            let exact = found.hidden_by_hidden[g][h];
            assert!(close(difference, exact), "{g} by {h}: {difference} against {exact}");
        }
    }
}

#[test]
fn a_change_of_the_scale_of_z_leaves_the_force() {
    let [c0, c1, k0, k1, alpha, gamma, n, beta, a] = SOFT;
    let s: f64 = 3.0;
    let shape = s.powf(1.0 - n);
    let scaled = [c0, c1, k0, k1, alpha / s, gamma * shape, n, beta * shape, a * s];
    for (one, other) in run(&SOFT, MIXED, 512).iter().zip(run(&scaled, MIXED, 512)) {
        assert!((one - other).abs() < 1e-8 * (1.0 + one.abs()), "{one} against {other}");
    }
}

#[test]
fn any_step_stays_bounded() {
    // Samples 0.1 s apart, at 1 m/s in either direction, from a start: far beyond the motion of any rig.
    let bound = |p: &[f64; 9]| p[4] + (p[0] + p[2] * 0.1) * 1.0 + p[3] * 0.1;
    for (name, p) in DAMPERS {
        let mut hidden = Hidden::default();
        for k in 0..200 {
            let velocity_m_s = if (k / 3) % 2 == 0 { 1.0 } else { -1.0 };
            let at =
                Inputs { dt_s: (k > 0).then_some(0.1), displacement_m: 0.0, velocity_m_s, ..inputs(SLOW, 1) };
            let force = ForceLaw::BoucWen.force_n(&p, &at, &mut hidden);
            assert!(force.abs() < 2.0 * bound(&p), "{name} at {k}: {force}");
        }
    }
}

#[test]
fn an_unknown_input_gives_no_force_and_leaves_the_state() {
    let mut hidden = [1e-4, 0.2, 0.03];
    let gone = Inputs { velocity_m_s: f64::NAN, ..inputs(SLOW, 5) };
    assert!(ForceLaw::BoucWen.force_n(&SOFT, &gone, &mut hidden).is_nan());
    assert_eq!(hidden, [1e-4, 0.2, 0.03]);
    assert!(ForceLaw::BoucWen.force_n(&SOFT, &inputs(SLOW, 5), &mut hidden).is_finite());
}
