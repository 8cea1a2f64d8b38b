//! Tests of the effects that the library does not contain.

use super::super::inject::{EFFECTS, Effect, inject};
use super::super::response::Response;
use super::super::signal::RATE_HZ;
use super::*;
use crate::rig::{Channels, Experiment, Motion, Plant, plant, record};
use std::f64::consts::TAU;

/// The effects whose equations are in this module.
fn effects() -> impl Iterator<Item = &'static Effect> {
    EFFECTS.iter().skip_while(|effect| effect.id != "seal_drag")
}

fn with(plant: Plant, id: &str, size: f64) -> Plant {
    let (mut plant, mut channels) = (plant, Channels::PERFECT);
    assert_eq!(inject(id, size, &mut plant, &mut channels), Ok(()), "{id}");
    plant
}

/// Force on RP-ICPS over `duration_s`, N.
fn force_n(plant: &Plant, duration_s: f64) -> Vec<f64> {
    let experiment = Experiment::thesis("RP-ICPS").expect("an experiment").with_duration_s(duration_s);
    record(&experiment, plant, &Channels::PERFECT, 1).force_n.expect("the rig records force").values
}

fn rms(values: impl Iterator<Item = f64>, count: usize) -> f64 {
    (values.map(|value| value * value).sum::<f64>() / count as f64).sqrt()
}

/// RMS of the change of `force` from `plain`, N.
fn change_n(force: &[f64], plain: &[f64]) -> f64 {
    rms(force.iter().zip(plain).map(|(a, b)| a - b), plain.len())
}

/// Forces of the rigid quasi-static valve with `id` and without it, N, at a steady `current_a`.
fn forces_n(id: &str, size: f64, motion: &Motion, current_a: f64) -> [Vec<f64>; 2] {
    let respond = |plant: Plant| {
        plant.respond(motion, &vec![current_a; motion.displacement_m.len()], plant::SUB_STEPS).force_n
    };
    [respond(with(Plant::quasi_static(), id, size)), respond(Plant::quasi_static())]
}

/// Extension with a constant velocity from rest at 1 A for 2 s: the last force with `id` and without it, N.
fn last_n(id: &str, size: f64, velocity_m_s: f64) -> [f64; 2] {
    let displacement_m = (0..1024).map(|k| velocity_m_s * f64::from(k) / RATE_HZ).collect();
    let motion = Motion { displacement_m, velocity_m_s: vec![velocity_m_s; 1024] };
    forces_n(id, size, &motion, 1.0).map(|force| force[1023])
}

/// A sine of 10 mm and 2 Hz for 10 s. Its path is 0.08 m a second.
fn sine() -> Motion {
    let angle = |k: u32| TAU * 2.0 * f64::from(k) / RATE_HZ;
    Motion {
        displacement_m: (0..5120).map(|k| 0.01 * angle(k).sin()).collect(),
        velocity_m_s: (0..5120).map(|k| 0.01 * TAU * 2.0 * angle(k).cos()).collect(),
    }
}

fn assert_near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-6 * expected.abs().max(1.0), "{found}, expected {expected}");
}

#[test]
fn there_are_twelve_with_ids_of_their_own() {
    assert_eq!(effects().count(), 12);
    let mut ids: Vec<&str> = EFFECTS.iter().map(|effect| effect.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), EFFECTS.len());
}

#[test]
fn typical_sizes_change_the_force_by_3_to_15_percent() {
    let plain = force_n(&Plant::default(), 30.0);
    let mean = plain.iter().sum::<f64>() / plain.len() as f64;
    let std_n = rms(plain.iter().map(|force| force - mean), plain.len());
    for effect in effects() {
        let changed = change_n(&force_n(&with(Plant::default(), effect.id, effect.typical), 30.0), &plain);
        let share = changed / std_n;
        println!("{} {} {}: {:.1} %", effect.id, effect.typical, effect.unit, 100.0 * share);
        assert!((0.03..0.15).contains(&share), "{}: {share}", effect.id);
    }
}

#[test]
fn forces_are_finite_and_changed_with_each_valve_form() {
    for healthy in [Plant::default(), Plant::quasi_static(), Plant::shear_thinning(), Plant::bristle()] {
        let plain = force_n(&healthy, 10.0);
        for effect in effects() {
            let force = force_n(&with(healthy, effect.id, effect.typical), 10.0);
            assert!(force.iter().all(|n| n.is_finite() && n.abs() < 5e3), "{}", effect.id);
            let changed = change_n(&force, &plain);
            assert!(changed > 1.0, "{} {:?}: {changed} N", effect.id, healthy.valve_form);
            let removed = with(with(healthy, effect.id, effect.typical), effect.id, 0.0);
            assert!(removed == healthy, "{}", effect.id);
        }
    }
}

#[test]
fn added_forces_match_their_equations() {
    let motion = sine();
    let [drag, plain] = forces_n("seal_drag", 40.0, &motion, 1.0);
    for ((force, plain), v) in drag.iter().zip(&plain).zip(&motion.velocity_m_s) {
        assert_near(force - plain, 40.0 * (10.0 * v.abs()).powf(0.4) * v.signum());
    }
    let [field, plain] = forces_n("stray_field", 10.0, &motion, 1.5);
    assert!(field.iter().zip(&plain).all(|(force, plain)| (force - plain - 22.5).abs() < 1e-9));
}

#[test]
fn a_relief_valve_acts_on_force_and_a_score_on_displacement() {
    let motion = sine();
    let [relief, plain] = forces_n("relief_valve", 0.4, &motion, 2.5);
    assert!(plain.iter().any(|force| *force > 600.0) && plain.iter().any(|force| *force < -600.0));
    for (force, plain) in relief.iter().zip(&plain) {
        assert_near(force.abs(), plain.abs() - 0.4 * (plain.abs() - 500.0).max(0.0));
    }
    let [score, plain] = forces_n("bore_score", 0.3, &motion, 1.0);
    for ((force, plain), x) in score.iter().zip(&plain).zip(&motion.displacement_m) {
        assert_near(*force, plain * (1.0 - 0.3 / (1.0 + ((x - 0.003) / 0.002).powi(4))));
    }
}

#[test]
fn a_seal_blows_out_after_its_path_and_leaks_in_compression() {
    let [leaking, plain] = forces_n("seal_blowout", 0.2, &sine(), 1.0);
    // 0.5 m of path end after 6.25 s.
    let fails = 3200;
    assert_eq!(leaking[..fails], plain[..fails]);
    for (force, plain) in leaking[fails + 2..].iter().zip(&plain[fails + 2..]) {
        assert_near(*force, if *plain < 0.0 { 0.8 * plain } else { *plain });
    }
}

#[test]
fn a_void_takes_force_from_compression_until_it_is_closed() {
    let (motion, [cavitating, plain]) = (sine(), forces_n("cavitation", 0.1, &sine(), 2.5));
    assert!(cavitating.iter().zip(&plain).all(|(force, plain)| force.abs() <= plain.abs()));
    assert!(cavitating.iter().zip(&plain).all(|(force, plain)| *plain < 0.0 || force == plain));
    // The void is at most a tenth of the stroke of 20 mm, so compression has its force again below 8 mm.
    for ((force, plain), x) in cavitating.iter().zip(&plain).zip(&motion.displacement_m) {
        assert!(*x > 0.0079 || force == plain, "{force} N of {plain} N at {x} m");
    }
    let least = cavitating.iter().zip(&plain).map(|(force, plain)| force / plain).fold(1.0, f64::min);
    assert!((0.2..0.4).contains(&least), "{least}");
}

#[test]
fn gas_grows_with_fast_strokes_and_separates() {
    let mut state = UndeclaredState::START;
    let (faults, second) = (Undeclared { aeration: 0.2, ..Undeclared::default() }, 8192);
    (0..second).for_each(|_| faults.step(&mut state, 1.0 / 8192.0, -0.2, 0.0));
    let (mix, separate) = (8.0 / MIX_S, 1.0 / SEPARATE_S);
    assert!((state.gas - mix / (mix + separate)).abs() < 1e-3, "{state:?}");
    assert_near(faults.transmitted_n(-100.0, &state), -100.0 * (1.0 - 0.2 * state.gas));
    let full = state.gas;
    (0..second).for_each(|_| faults.step(&mut state, 1.0 / 8192.0, 0.0, 0.0));
    assert!((state.gas / full - (-separate).exp()).abs() < 1e-3, "{state:?}");
}

#[test]
fn structure_and_slip_change_the_yield_force() {
    let yield_n = Plant::quasi_static().yield_n.at(1.0) * (0.05_f64 / 0.03).tanh();
    let [built, plain] = last_n("thixotropy", 0.5, 0.05);
    let structure = (1.0 / BUILD_S) / (1.0 / BUILD_S + 0.05 / BREAK_M);
    assert!((built - plain - 0.5 * structure * yield_n).abs() < 0.01, "{built} N, {plain} N");
    let lost = |velocity_m_s: f64| {
        let [slipping, plain] = last_n("wall_slip", 0.5, velocity_m_s);
        (plain - slipping) / (Plant::quasi_static().yield_n.at(1.0) * (velocity_m_s / 0.03).tanh())
    };
    assert!(lost(0.01) < 0.01 && lost(0.2) > 0.49, "{} {}", lost(0.01), lost(0.2));
    assert_near(lost(0.08), 0.25);
}

#[test]
fn the_current_saturates_and_creeps() {
    let [saturated, _] = forces_n("core_saturation", 0.5, &sine(), 2.0);
    let [_, weaker] = forces_n("core_saturation", 0.5, &sine(), 2.0 / 2.0_f64.powf(0.25));
    saturated.iter().zip(&weaker).for_each(|(force, weaker)| assert_near(*force, *weaker));
    let [creeping, plain] = forces_n("current_sensor_creep", 0.25, &sine(), 2.0);
    let [_, before] = forces_n("current_sensor_creep", 0.25, &sine(), 2.0 / (1.0 + 0.25 * 6.75 / 7.0));
    let (at, reset) = (6.75 * RATE_HZ, 7.0 * RATE_HZ + 2.0);
    assert!((creeping[at as usize] - before[at as usize]).abs() < 0.1);
    assert!((creeping[reset as usize] - plain[reset as usize]).abs() < 0.5);
}

#[test]
fn the_mount_amplifies_its_resonance() {
    let swing = |hz: f64, share: f64| {
        let force_n = (0..2048).map(|k| 100.0 * (TAU * hz * f64::from(k) / RATE_HZ).sin()).collect();
        let mut response = Response { force_n, ..Response::default() };
        response.resonate(share);
        response.force_n[1024..].iter().fold(0.0_f64, |most, force| most.max(force.abs()))
    };
    assert!((swing(1.0, 1.0) - 100.0).abs() < 0.5);
    // At resonance the mode is 1/(2 zeta) = 8.3 times the force, a quarter period late.
    let expected = 100.0 * (0.5_f64.powi(2) + (0.5 / 0.12_f64).powi(2)).sqrt();
    assert!((swing(32.0, 0.5) / expected - 1.0).abs() < 0.05, "{}", swing(32.0, 0.5));
}

#[test]
fn sizes_out_of_range_are_rejected_with_the_field_name() {
    let refused = |faults: Undeclared| faults.check().err().map(|e| e.to_string()).unwrap_or_default();
    assert_eq!(refused(Undeclared::default()), "");
    let score = refused(Undeclared { bore_score: 0.5, ..Undeclared::default() });
    assert!(score.contains("bore_score") && score.contains("0 to 0.4"), "{score}");
    assert!(refused(Undeclared { aeration: f64::NAN, ..Undeclared::default() }).contains("aeration"));
}
