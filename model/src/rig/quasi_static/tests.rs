//! The quasi-static valve against forces computed by hand, energy, play, and an independent integration.

use super::super::inject::inject;
use super::super::plant::SUB_STEPS;
use super::super::signal::{Motion, RATE_HZ};
use super::super::{Channels, Plant, ValveForm};
use super::*;
use proptest::prelude::*;
use std::f64::consts::TAU;

const FORM: QuasiStatic =
    QuasiStatic { yield_velocity_m_s: 0.025, coupling_per_s: 3.0, ..QuasiStatic::NEWTONIAN };

/// A plant without driver lag, so that the current in the fluid equals the command.
fn plant() -> Plant {
    Plant { valve_form: ValveForm::QuasiStatic(FORM), driver_lag_s: 0.0, ..Plant::quasi_static() }
}

fn motion(samples: usize, at: impl Fn(f64) -> (f64, f64)) -> Motion {
    let mut motion = Motion::default();
    for k in 0..samples {
        let (x, v) = at(k as f64 / RATE_HZ);
        motion.displacement_m.push(x);
        motion.velocity_m_s.push(v);
    }
    motion
}

/// Two periods of a sine of 12 mm amplitude, starting at its lower end.
fn sine(hz: f64) -> Motion {
    let omega = TAU * hz;
    motion((2.0 * RATE_HZ / hz) as usize, |t| {
        let (sin, cos) = (omega * t).sin_cos();
        (-0.012 * cos, 0.012 * omega * sin)
    })
}

fn respond(plant: &Plant, motion: &Motion, current_a: f64) -> Vec<f64> {
    plant.respond(motion, &vec![current_a; motion.displacement_m.len()], SUB_STEPS).force_n
}

/// The equation of the valve's force, at the reference temperature.
fn by_hand_n(plant: &Plant, current_a: f64, s_m: f64, rate_m_s: f64) -> f64 {
    let (fy, c0) = (plant.yield_n.at(current_a), plant.viscous_n_s_m.at(current_a));
    fy * f64::tanh((rate_m_s + 3.0 * s_m) / 0.025) + c0 * rate_m_s
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), f| (sum + f * f, count + 1));
    (sum / f64::from(count.max(1))).sqrt()
}

#[test]
fn points_of_the_force_velocity_map_match_the_equation() {
    let plant = plant();
    for current_a in [0.0, 0.7, 2.5] {
        for speed_m_s in [-0.2, -0.01, 0.0, 0.02, 0.3] {
            let force = respond(&plant, &motion(64, |t| (0.002 + speed_m_s * t, speed_m_s)), current_a);
            for (k, force) in force.iter().enumerate() {
                let expected =
                    by_hand_n(&plant, current_a, 0.002 + speed_m_s * k as f64 / RATE_HZ, speed_m_s);
                assert!(
                    (force - expected).abs() < 1e-9,
                    "{current_a} A, {speed_m_s} m/s: {force} {expected}"
                );
            }
        }
    }
    // The thesis' damper has 39 lbf at 6 in/s without current and 264 lbf at 2.5 A; this one is of similar size.
    let at_6_in_s = |current_a: f64| by_hand_n(&plant, current_a, 0.0, 0.1524) / 4.448;
    assert!((25.0..60.0).contains(&at_6_in_s(0.0)), "{}", at_6_in_s(0.0));
    assert!((180.0..300.0).contains(&at_6_in_s(2.5)), "{}", at_6_in_s(2.5));
}

proptest! {
    #[test]
    fn force_grows_with_velocity_and_its_size_with_current(
        x in -0.02..0.02f64, v in -0.5..0.5f64, faster in 1e-3..0.2f64, i in 0.0..2.4f64, more in 0.01..1.0f64
    ) {
        let plant = plant();
        let force = |v: f64, i: f64| {
            let state = plant.at_rest(x, i);
            plant.force_n(&state, x, v)
        };
        prop_assert!(force(v + faster, i) > force(v, i));
        // Only where displacement does not change the sign of the force.
        if v.abs() > 3.0 * x.abs() {
            prop_assert!(force(v, i + more).abs() > force(v, i).abs());
            prop_assert!(force(v, i) * v > 0.0);
        }
    }
}

#[test]
fn the_valve_dissipates_energy_and_its_heat_is_that_energy() {
    let spring = Plant { series_stiffness_n_m: 1e6, ..plant() };
    let play = Plant { free_play_m: 1e-3, ..plant() };
    let both = Plant { free_play_m: 1e-3, ..spring };
    for plant in [plant(), spring, play, both] {
        let plant = Plant { heat_transfer_w_k: 0.0, coil_ohm: 0.0, ..plant };
        for current_a in [0.0, 1.0, 2.5] {
            let motion = sine(1.5);
            let response = plant.respond(&motion, &vec![current_a; motion.displacement_m.len()], SUB_STEPS);
            let power = response.force_n.iter().zip(&motion.velocity_m_s).map(|(f, v)| f * v);
            let work_j = power.sum::<f64>() / RATE_HZ;
            let last = response.temperature_c.len() - 1;
            let heat_j = (response.temperature_c[last] - plant.start_c) * plant.heat_capacity_j_k;
            assert!(work_j > 0.0 && (heat_j / work_j - 1.0).abs() < 0.02, "{heat_j} J of {work_j} J");
        }
    }
}

#[test]
fn the_force_is_zero_within_the_gap_and_the_pistons_force_beyond_it() {
    let gap_m = 2e-3;
    let plant = Plant { free_play_m: gap_m, ..plant() };
    let motion = sine(1.5);
    let force = respond(&plant, &motion, 1.5);
    let (mut without, mut with) = (0, 0);
    // The motion starts at the lower end, with the piston in the middle of its gap.
    for (k, force) in force.iter().enumerate().skip(1) {
        let (x, v) = (motion.displacement_m[k], motion.velocity_m_s[k]);
        let turned_m = if v > 0.0 { -0.012 } else { 0.012 };
        let first = k < (RATE_HZ / 3.0) as usize;
        let free_m = if first { gap_m / 2.0 } else { gap_m };
        let went_m = (x - turned_m).abs();
        if went_m < free_m {
            without += 1;
            assert_eq!(*force, 0.0, "sample {k}: {went_m} m from the reversal");
        } else {
            with += 1;
            let piston_m = x - gap_m / 2.0 * v.signum();
            let expected = by_hand_n(&plant, 1.5, piston_m, v);
            assert!((force - expected).abs() < 1e-9, "sample {k}: {force} for {expected}");
        }
    }
    assert!(without > 100 && with > 400, "{without} {with}");
}

/// Force through a spring, one value per sample: Heun's method on F' = ks (v - w(F)) with a step of 2 us, w by bisection.
fn sprung_by_hand_n(plant: &Plant, current_a: f64, hz: f64, samples: usize) -> Vec<f64> {
    let (ks, omega) = (plant.series_stiffness_n_m, TAU * hz);
    let x = |t: f64| -0.012 * (omega * t).cos();
    let rate = |t: f64, force_n: f64| {
        let (mut low, mut high) = (-5.0, 5.0);
        for _ in 0..45 {
            let middle = 0.5 * (low + high);
            if by_hand_n(plant, current_a, x(t) - force_n / ks, middle) < force_n {
                low = middle;
            } else {
                high = middle;
            }
        }
        ks * (0.012 * omega * (omega * t).sin() - 0.5 * (low + high))
    };
    let h = 1.0 / (RATE_HZ * 1000.0);
    let mut force_n = 0.0;
    let mut forces = Vec::new();
    for k in 0..samples {
        forces.push(force_n);
        for j in 0..1000 {
            let t = (k * 1000 + j) as f64 * h;
            let first = rate(t, force_n);
            let second = rate(t + h, force_n + h * first);
            force_n += h / 2.0 * (first + second);
        }
    }
    forces
}

#[test]
fn a_spring_in_series_matches_an_independent_integration() {
    for (series_stiffness_n_m, current_a) in [(2e5, 0.3), (1e6, 2.0)] {
        let plant = Plant { series_stiffness_n_m, ..plant() };
        let samples = 300;
        let found = respond(&plant, &sine(3.0), current_a);
        let expected = sprung_by_hand_n(&plant, current_a, 3.0, samples);
        let off = rms(found.iter().zip(&expected).map(|(a, b)| a - b)) / rms(expected.iter().copied());
        assert!(off < 2e-4, "{series_stiffness_n_m} N/m: {off}");
        let rigid = respond(&self::plant(), &sine(3.0), current_a);
        let change = rms(found.iter().zip(&rigid).map(|(a, b)| a - b)) / rms(rigid.iter().copied());
        assert!(change > 0.02, "{series_stiffness_n_m} N/m changes nothing: {change}");
    }
}

#[test]
fn a_very_stiff_spring_is_rigid_and_the_sub_step_is_fine_enough() {
    let motion = sine(3.0);
    let rigid = respond(&plant(), &motion, 1.0);
    let stiff = respond(&Plant { series_stiffness_n_m: 1e10, ..plant() }, &motion, 1.0);
    let off = rms(stiff.iter().zip(&rigid).map(|(a, b)| a - b).skip(8)) / rms(rigid.iter().copied());
    assert!(off < 1e-3, "{off}");
    let command: Vec<f64> = (0..rigid.len()).map(|k| if k % 100 < 50 { 0.2 } else { 2.2 }).collect();
    for (series_stiffness_n_m, free_play_m) in
        [(1e5, 0.0), (1e6, 0.0), (1e6, 1e-3), (1e8, 0.0), (f64::INFINITY, 1e-3)]
    {
        let plant = Plant { series_stiffness_n_m, free_play_m, ..plant() };
        let whole = plant.respond(&motion, &command, SUB_STEPS).force_n;
        let half = plant.respond(&motion, &command, 2 * SUB_STEPS).force_n;
        let change = rms(whole.iter().zip(&half).map(|(a, b)| a - b)) / rms(half.iter().copied());
        assert!(change < 1e-3, "{series_stiffness_n_m} N/m, {free_play_m} m: {change}");
    }
}

#[test]
fn a_spring_is_added_and_removed_by_its_compliance() {
    let (mut plant, mut channels) = (Plant::quasi_static(), Channels::PERFECT);
    let mut after = |size| inject("series_spring", size, &mut plant, &mut channels).map(|()| plant);
    assert_eq!(after(5e-7), Ok(Plant { series_stiffness_n_m: 1.0 / 5e-7, ..Plant::quasi_static() }));
    assert_eq!(after(0.0), Ok(Plant::quasi_static()));
    // The other valve is never stiffer than its own compliance.
    let mut bouc_wen = Plant::default();
    assert_eq!(inject("series_spring", 1e-9, &mut bouc_wen, &mut channels), Ok(()));
    assert_eq!(bouc_wen, Plant::default());
}

#[test]
fn invalid_valves_are_rejected_with_the_field_name() {
    assert_eq!(Plant::quasi_static().check(), Ok(()));
    let refused = |plant: Plant| plant.check().err().map(|e| e.to_string()).unwrap_or_default();
    let form = |yield_velocity_m_s, coupling_per_s| {
        let form = QuasiStatic { yield_velocity_m_s, coupling_per_s, ..FORM };
        Plant { valve_form: ValveForm::QuasiStatic(form), ..plant() }
    };
    assert!(refused(form(0.0, 1.0)).starts_with("yield_velocity_m_s"));
    assert!(refused(form(0.02, 1e4)).starts_with("coupling_per_s"));
    assert!(refused(Plant { series_stiffness_n_m: 0.0, ..plant() }).starts_with("series_stiffness_n_m"));
    let infinite = Plant { series_stiffness_n_m: f64::INFINITY, ..Plant::default() };
    assert!(
        refused(infinite).starts_with("series_stiffness_n_m"),
        "a Bouc-Wen valve needs a finite stiffness"
    );
}
