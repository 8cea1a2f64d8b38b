//! The response of each effect against a closed form or values computed by hand.

use super::*;
use crate::condition::{LowPass, LowPassState};
use crate::force::{FuzzySets, FuzzyTanh, Membership, TanhFunction};
use crate::units::Hertz;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const DT_S: f64 = 0.002;

/// Force = drive + offset as long as the damper moves: (0 + 1 i) tanh(large) + 0 v.
fn drive_as_force() -> ForceModel {
    let drive = Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 1 };
    law(ForceLaw::Sp, drive, &[0.0, 0.0, 1e3, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
}

/// Inputs with this drive at a constant step, for [`drive_as_force`].
fn driven(drive: impl IntoIterator<Item = f64>, dt_s: f64) -> Vec<Inputs> {
    let at = |(k, drive): (usize, f64)| Inputs {
        dt_s: (k > 0).then_some(dt_s),
        displacement_m: 0.0,
        velocity_m_s: 1.0,
        acceleration_m_s2: 0.0,
        drive,
        case_temp_c: f64::NAN,
    };
    drive.into_iter().enumerate().map(at).collect()
}

/// Response of `effect` to this force or drive signal.
fn made_of(effect: EffectModel, signal: impl IntoIterator<Item = f64>, dt_s: f64) -> Vec<f64> {
    let mut forces = run(&augmented(drive_as_force(), &[effect]), &driven(signal, dt_s));
    forces.iter_mut().for_each(|f| *f -= OFFSET_N);
    forces
}

/// One sample of a moving damper.
fn at(x: f64, v: f64, a: f64) -> Inputs {
    Inputs {
        dt_s: None,
        displacement_m: x,
        velocity_m_s: v,
        acceleration_m_s2: a,
        drive: 1.0,
        case_temp_c: f64::NAN,
    }
}

/// Change that `effect` makes to the first force of a dashpot of 900 N s/m.
fn added(effect: EffectModel, inputs: Inputs) -> f64 {
    run(&augmented(dashpot(900.0), &[effect]), &[inputs])[0] - OFFSET_N - 900.0 * inputs.velocity_m_s
}

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} is not {b}");
}

/// A ramp from `from` to `to` within the first sample, then constant, through a first-order lag.
fn lagged_step(from: f64, to: f64, tau: f64, h: f64, t: f64) -> f64 {
    to + (from - to) * (tau / h) * ((h / tau).exp() - 1.0) * (-t / tau).exp()
}

#[test]
fn the_step_response_of_first_order_lags_is_the_closed_form() {
    for h in [0.0005, 0.002, 0.05] {
        let step = (0..200).map(|k| if k == 0 { 0.2 } else { 1.7 });
        for effect in [with(Effect::CoilLag, &[0.012]), with(Effect::CoilLagRiseFall, &[0.012, 0.03])] {
            for (k, y) in made_of(effect, step.clone(), h).into_iter().enumerate().skip(1) {
                close(y, lagged_step(0.2, 1.7, 0.012, h, k as f64 * h), 1e-12);
            }
        }
        for (k, y) in made_of(with(Effect::ForceLag, &[0.012]), step, h).into_iter().enumerate().skip(1) {
            close(y, lagged_step(0.2, 1.7, 0.012, h, k as f64 * h), 1e-12);
        }
        let fall = (0..200).map(|k| if k == 0 { 1.7 } else { 0.2 });
        let found = made_of(with(Effect::CoilLagRiseFall, &[0.012, 0.03]), fall, h);
        for (k, y) in found.into_iter().enumerate().skip(1) {
            close(y, lagged_step(1.7, 0.2, 0.03, h, k as f64 * h), 1e-12);
        }
    }
}

/// The sampling rate may change within a run: splitting some steps of a ramp does not change the result.
#[test]
fn lags_do_not_depend_on_the_steps() {
    let model = augmented(drive_as_force(), &[with(Effect::CoilLag, &[0.02])]);
    let at_times = |times: &[f64]| {
        let mut inputs = driven(times.iter().map(|t| 3.0 * t), 1.0);
        for k in 1..times.len() {
            inputs[k].dt_s = Some(times[k] - times[k - 1]);
        }
        *run(&model, &inputs).last().expect("some")
    };
    let coarse = at_times(&[0.0, 0.01, 0.02, 0.04, 0.05]);
    let fine = at_times(&[0.0, 0.001, 0.01, 0.013, 0.02, 0.021, 0.022, 0.04, 0.05]);
    close(coarse, fine, 1e-12);
    // r (t - tau (1 - exp(-t/tau)))
    close(coarse - OFFSET_N, 3.0 * (0.05 - 0.02 * (1.0 - (-2.5_f64).exp())), 1e-12);
}

#[test]
fn a_lag_covers_the_time_of_samples_that_are_not_finite() {
    let model = augmented(drive_as_force(), &[with(Effect::CoilLag, &[0.02])]);
    let mut inputs = driven((0..20).map(|k| 0.1 * f64::from(k)), DT_S);
    inputs[8..12].iter_mut().for_each(|at| at.drive = f64::NAN);
    let forces = run(&model, &inputs);
    let t = 19.0 * DT_S;
    close(forces[19] - OFFSET_N, 50.0 * (t - 0.02 * (1.0 - (-t / 0.02).exp())), 1e-12);
}

#[test]
fn remanence_is_a_play_operator() {
    let current = [0.5, 0.55, 0.8, 0.75, 0.65, 0.5, 0.2, 0.25, 0.5];
    // Computed by hand for a half width of 0.1: constant within the width, following beyond.
    let field = [0.5, 0.5, 0.7, 0.7, 0.7, 0.6, 0.3, 0.3, 0.4];
    let found = made_of(with(Effect::Remanence, &[0.1]), current, DT_S);
    for (a, b) in found.iter().zip(field) {
        close(*a, b, 1e-12);
    }
}

#[test]
fn a_delay_is_a_shift_of_samples() {
    let signal = |t: f64| (40.0 * t).sin() + 0.3 * (170.0 * t).cos();
    let times = || (0..400).map(|k| f64::from(k) * DT_S);
    for samples in [0_usize, 1, 3, 5] {
        let found = made_of(with(Effect::SensorDelay, &[samples as f64 * DT_S]), times().map(signal), DT_S);
        for (k, t) in times().enumerate() {
            let then = t - (k.min(samples) as f64) * DT_S;
            close(found[k], signal(then), 1e-9);
        }
    }
    // Half way between two samples the result is their mean; before the first sample it is the first.
    let found = made_of(with(Effect::SensorDelay, &[2.5 * DT_S]), times().map(signal), DT_S);
    for (k, found) in found.iter().enumerate().skip(3) {
        let (a, b) = (signal((k - 2) as f64 * DT_S), signal((k - 3) as f64 * DT_S));
        close(*found, 0.5 * (a + b), 1e-9);
    }
    close(found[2], signal(0.0), 1e-12);
}

/// Above 6.2 kHz the memory keeps fewer samples but covers the same time. A ramp is not affected, because it is linear.
#[test]
fn the_longest_delay_works_at_any_rate() {
    for rate_hz in [100.0, 1e3, 6e3, 7e3, 2e4, 1e5] {
        let count = (0.05 * rate_hz) as usize + 3;
        let ramp = (0..count).map(|k| k as f64 / rate_hz);
        let found = made_of(with(Effect::SensorDelay, &[MAX_DELAY_S]), ramp, 1.0 / rate_hz);
        let last = (count - 1) as f64 / rate_hz;
        close(found[count - 1], last - MAX_DELAY_S, 1e-9);
    }
}

#[test]
fn an_early_force_uses_inputs_extrapolated_to_first_order() {
    let (d, at) = (-0.005, at(0.01, 0.2, -3.0));
    let found = run(&augmented(tanh(), &[with(Effect::SensorDelay, &[d])]), &[at])[0];
    let (x, v) = (0.01_f64 + 0.005 * 0.2, 0.2_f64 + 0.005 * -3.0);
    let u = v + 3.0 * x;
    close(found, 600.0 * (30.0 * u).tanh() + 700.0 * u + OFFSET_N, 1e-9);
}

#[test]
fn anti_alias_mismatch_is_a_low_pass_with_that_delay() {
    let signal: Vec<f64> = (0..500).map(|k| (0.05 * f64::from(k)).sin() + f64::from(k % 50) / 50.0).collect();
    let found = made_of(with(Effect::AntiAliasMismatch, &[0.016]), signal.iter().copied(), DT_S);
    let filter = LowPass::new(Hertz(1.0 / (std::f64::consts::TAU * 0.008)));
    let mut state = LowPassState::default();
    for (k, u) in signal.iter().enumerate() {
        close(found[k], filter.step(&mut state, (k > 0).then_some(DT_S), *u), 1e-9);
    }
    // In steady state a ramp is late by the delay.
    let found =
        made_of(with(Effect::AntiAliasMismatch, &[0.016]), (0..500).map(|k| f64::from(k) * DT_S), DT_S);
    close(found[499], 499.0 * DT_S - 0.016, 1e-9);
}

#[test]
fn static_effects_match_their_equations() {
    close(added(with(Effect::GasSpring, &[5e3]), at(-0.02, 0.1, 0.0)), -100.0, 1e-10);
    close(added(with(Effect::Inertia, &[2.0]), at(0.0, 0.1, -7.0)), -14.0, 1e-10);
    close(added(with(Effect::Friction, &[80.0]), at(0.0, -0.005, 0.0)), -80.0 * 1.0_f64.tanh(), 1e-10);
    close(added(with(Effect::Friction, &[80.0]), at(0.0, 0.5, 0.0)), 80.0, 1e-10);
    // The dashpot's 90 N grow or fall by a tenth; the offset is not scaled.
    close(added(with(Effect::Asymmetry, &[0.1]), at(0.0, 0.1, 0.0)), 9.0, 1e-10);
    close(added(with(Effect::Asymmetry, &[0.1]), at(0.0, -0.1, 0.0)), 9.0, 1e-10);
    close(added(with(Effect::PositionDependence, &[-5.0]), at(0.02, 0.1, 0.0)), -9.0, 1e-10);
    close(added(with(Effect::VelocitySaturation, &[-300.0]), at(0.0, -0.2, 0.0)), 12.0, 1e-10);
    let stop = with(Effect::EndStop, &[1e5, 0.01]);
    close(added(stop, at(0.009, 0.1, 0.0)), 0.0, 1e-12);
    close(added(stop, at(0.012, 0.1, 0.0)), 200.0, 1e-9);
    close(added(stop, at(-0.012, 0.1, 0.0)), -200.0, 1e-9);
    let fade = with(Effect::ThermalFade, &[-0.002]);
    close(added(fade, Inputs { case_temp_c: 65.0, ..at(0.0, 0.1, 0.0) }), -0.08 * 90.0, 1e-10);
    assert!(added(fade, at(0.0, 0.1, 0.0)).is_nan(), "a sample without a temperature has no force");
    // The force falls to zero at most: it does not change sign at any temperature.
    close(
        added(with(Effect::ThermalFade, &[-0.01]), Inputs { case_temp_c: 400.0, ..at(0.0, 0.1, 0.0) }),
        -90.0,
        1e-10,
    );
}

#[test]
fn drift_grows_with_the_time_since_the_start_of_the_run() {
    let found = made_of(with(Effect::LoadCellDrift, &[0.5]), [1.0; 1001], 0.01);
    close(found[0], 1.0, 1e-12);
    close(found[1000], 1.0 + 0.5 * 10.0, 1e-9);
    // Time also advances while the force is not finite.
    let mut signal = [1.0; 1001];
    signal[200..400].fill(f64::NAN);
    close(made_of(with(Effect::LoadCellDrift, &[0.5]), signal, 0.01)[1000], 1.0 + 0.5 * 10.0, 1e-9);
}

/// A triangle wave of 0.1 m/s and 10 mm through 2 mm of play: 20 ms without force after each reversal.
#[test]
fn a_dead_zone_removes_the_force_over_its_length() {
    let (speed, gap_m, h) = (0.1, 2e-3, 0.001);
    let model = augmented(dashpot(900.0), &[with(Effect::Deadzone, &[gap_m])]);
    let mut x = 0.0;
    let inputs: Vec<Inputs> = (0..400)
        .map(|k| {
            let v = if (k / 100) % 2 == 0 { speed } else { -speed };
            x += v * h;
            Inputs { dt_s: (k > 0).then_some(h), ..at(x, v, 0.0) }
        })
        .collect();
    for (k, force_n) in run(&model, &inputs).into_iter().enumerate() {
        let plain_n = 900.0 * inputs[k].velocity_m_s;
        let crossing = k >= 100 && k % 100 < 20;
        let expected = if crossing { 0.0 } else { plain_n };
        // At the two samples around the end of the gap the force may be partial.
        if k % 100 != 19 && k % 100 != 20 {
            close(force_n - OFFSET_N, expected, 1e-6);
        }
    }
}

/// Maxwell element: F = C (v - c dF/dt); with backward differences (C v + (C c/h) F before) / (1 + C c/h).
#[test]
fn a_spring_and_a_dashpot_are_a_maxwell_element() {
    let (damping, compliance) = (20e3, 8e-6);
    let model = augmented(dashpot(damping), &[with(Effect::SeriesSpring, &[compliance])]);
    let mut inputs = motion(1000);
    inputs.iter_mut().for_each(|at| at.drive = f64::NAN);
    let mut before = None;
    for (at, found) in inputs.iter().zip(run(&model, &inputs)) {
        let expected = match (before, at.dt_s) {
            (Some(before), Some(h)) => {
                let share = damping * compliance / h;
                (damping * at.velocity_m_s + share * before) / (1.0 + share)
            }
            _ => damping * at.velocity_m_s,
        };
        close(found - OFFSET_N, expected, 1e-7 * damping);
        before = Some(expected);
    }
    // For a sine with small steps the amplitude is C v0 / sqrt(1 + (omega C c)^2).
    let (omega, h, compliance) = (40.0_f64, 2e-5, 1e-6);
    let model = augmented(dashpot(damping), &[with(Effect::SeriesSpring, &[compliance])]);
    let sine: Vec<Inputs> = (0..20_000)
        .map(|k| {
            let t = k as f64 * h;
            let (x, v) = (0.005 * (omega * t).sin(), 0.005 * omega * (omega * t).cos());
            Inputs { dt_s: (k > 0).then_some(h), ..at(x, v, 0.0) }
        })
        .collect();
    let amplitude = run(&model, &sine)[10_000..].iter().map(|f| f - OFFSET_N).fold(0.0, f64::max);
    let exact = damping * 0.005 * omega / (1.0 + (omega * damping * compliance).powi(2)).sqrt();
    close(amplitude / exact, 1.0, 1e-3);
}

/// Rod and piston agree at every sample: the force is the model's force at the piston's position and velocity.
#[test]
fn a_spring_balances_a_stiff_model_at_every_sample() {
    let compliance = 2e-7;
    let model = augmented(tanh(), &[with(Effect::SeriesSpring, &[compliance])]);
    let (inputs, mut before) = (motion(3000), None);
    for (at, force_n) in inputs.iter().zip(run(&model, &inputs)) {
        let stretch = compliance * (force_n - OFFSET_N);
        let rate = match (before, at.dt_s) {
            (Some(before), Some(h)) => (stretch - before) / h,
            _ => 0.0,
        };
        let u = at.velocity_m_s - rate + 3.0 * (at.displacement_m - stretch);
        let answer = (200.0 + 400.0 * at.drive) * (30.0 * u).tanh() + 700.0 * u + OFFSET_N;
        close(force_n, answer, 1e-7);
        before = Some(stretch);
    }
}

/// The same damper in two forms, with noise in the velocity and springs from stiff to soft. The fuzzy tanh model is solved by Newton
/// steps, with one evaluation where possible; the force law over fuzzy sets is solved by secants to full precision.
#[test]
fn newton_steps_agree_with_the_full_solution() {
    let sets = FuzzySets::new(Membership { drive: DriveKind::CoilCurrent, sigma: 0.5 }, &[0.4, 1.2, 2.0]);
    let sets = sets.expect("sets");
    let rows = [[300.0, 700.0, 30.0, 3.0], [700.0, 900.0, 40.0, 4.0], [1100.0, 1300.0, 45.0, 3.0]];
    let functions = rows.map(TanhFunction::new);
    let fuzzy = ForceModel::FuzzyTanh(FuzzyTanh::new(sets, &functions, OFFSET_N).expect("a model"));
    let as_law: Vec<f64> = rows.iter().flat_map(|[a1, a2, a3, kappa]| [*a1, *a2, *a3, *kappa, 1.0]).collect();
    let plain = law(ForceLaw::Sp, Dependence::Fuzzy(sets), &as_law);
    let mut inputs = motion(4000);
    let mut random = Pcg64Mcg::seed_from_u64(1);
    for at in &mut inputs {
        at.velocity_m_s += random.random_range(-2e-3..2e-3);
    }
    let size = |signal: &[f64]| signal.iter().map(|n| n * n).sum::<f64>().sqrt();
    let off = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
    for compliance in [1e-8, 1e-7, 3e-7, 1e-6] {
        let forces = |force, share: f64| {
            run(&augmented(force, &[with(Effect::SeriesSpring, &[compliance * (1.0 + share)])]), &inputs)
        };
        let (quick, all) = (forces(fuzzy, 0.0), forces(plain, 0.0));
        let wrong = off(&quick, &all);
        let share = size(&wrong) / size(&all);
        assert!(share < 1e-3, "{compliance}: root mean square differs by {share:.1e}");
        assert!(wrong.iter().all(|n| n.abs() < 6.0), "less than 6 N off, of about 1300 N");
        // The derivative by the compliance, from which scores are computed, agrees with the full solution.
        let [fine, exact] = [(fuzzy, &quick), (plain, &all)].map(|(force, at)| off(&forces(force, 1e-5), at));
        let share = size(&off(&fine, &exact)) / size(&exact);
        assert!(share < 2e-2, "{compliance}: scores differ by {share:.1e}");
    }
}

/// A soft spring in series with every force law, including laws with state and with branches: every sample has a force.
#[test]
fn a_soft_spring_finds_a_force_for_every_law() {
    let inputs = motion(2000);
    for kind in ForceLaw::ALL {
        let coefficients: Vec<f64> = match kind {
            ForceLaw::BoucWen => vec![700.0, 8000.0, 300.0, 0.0, 400.0, 300.0, 1.2, 300.0, 400.0],
            _ => kind
                .parameters()
                .iter()
                .map(|p| {
                    let [low, high] = p.start;
                    let scale = size(p.scale) * 5.0_f64.powi(p.scale.acceleration);
                    scale * if low > 0.0 { (low * high).sqrt() } else { 0.3 * low + 0.7 * high }
                })
                .collect(),
        };
        let model =
            augmented(law(kind, Dependence::None, &coefficients), &[with(Effect::SeriesSpring, &[1e-6])]);
        let forces = run(&model, &inputs);
        let missing = forces[1..].iter().filter(|f| !f.is_finite()).count();
        assert_eq!(missing, 0, "{}", kind.name());
        assert!(forces[1..].iter().all(|f| f.abs() < 2e4), "{}", kind.name());
    }
}
