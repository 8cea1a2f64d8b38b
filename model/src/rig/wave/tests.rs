//! The defining property of each wave, outside its fades.

use super::*;
use crate::rig::signal::FADE_S;
use proptest::prelude::*;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

const SAMPLES: usize = 30 * 512;
const RUN_S: f64 = 30.0;

fn motion(wave: Wave, seed: u64) -> Motion {
    wave.motion(SAMPLES, &mut Pcg64Mcg::seed_from_u64(seed))
}

/// Samples outside the fades.
fn clear() -> std::ops::Range<usize> {
    let fade = (FADE_S * RATE_HZ) as usize;
    fade..SAMPLES - fade
}

/// Times at which the displacement rises through zero, in seconds, by linear interpolation.
fn crossings(motion: &Motion) -> Vec<f64> {
    let x = &motion.displacement_m;
    clear()
        .filter(|&k| x[k - 1] < 0.0 && x[k] >= 0.0)
        .map(|k| (k as f64 - x[k] / (x[k] - x[k - 1])) / RATE_HZ)
        .collect()
}

/// Time in the middle of each period, and its frequency.
fn frequencies(motion: &Motion) -> Vec<(f64, f64)> {
    crossings(motion).windows(2).map(|t| ((t[0] + t[1]) / 2.0, 1.0 / (t[1] - t[0]))).collect()
}

fn extremes(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    values.into_iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
}

/// Checks that each velocity is the slope of the neighbouring displacements, that the motion rests at both ends, and that the mean
/// displacement is zero.
fn is_sound(motion: &Motion, tolerance_m_s: f64) -> Result<(), TestCaseError> {
    let (x, v) = (&motion.displacement_m, &motion.velocity_m_s);
    prop_assert_eq!((x.len(), v.len()), (SAMPLES, SAMPLES));
    for k in 1..SAMPLES - 1 {
        let slope = (x[k + 1] - x[k - 1]) * RATE_HZ / 2.0;
        prop_assert!((slope - v[k]).abs() < tolerance_m_s, "at {}: {} for {}", k, v[k], slope);
    }
    let mean = x.iter().sum::<f64>() / SAMPLES as f64;
    prop_assert!(mean.abs() < 1e-12);
    prop_assert!(v[0].abs() < 1e-12 && v[SAMPLES - 1].abs() < 1e-12);
    prop_assert!((x[0] - x[SAMPLES - 1]).abs() < 1e-12);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn am_has_its_amplitude_its_depth_and_one_frequency(
        amplitude_m in 0.002..0.02, depth in 0.1..0.9, carrier_hz in 3.0..8.0, seed: u64
    ) {
        let wave =
            Wave::AmplitudeModulated { amplitude_m, depth, carrier_hz, modulation_hz: 0.2 };
        prop_assert_eq!(wave.check(), Ok(()));
        let motion = motion(wave, seed);
        is_sound(&motion, 0.02 * amplitude_m * TAU * carrier_hz)?;
        let x = &motion.displacement_m;
        // The highest displacement of each period is a sample of the envelope.
        let period = (RATE_HZ / carrier_hz).ceil() as usize;
        let crests = x[clear()].chunks_exact(period).map(|one| extremes(one.iter().copied()).1);
        let (low, high) = extremes(crests);
        prop_assert!((high / amplitude_m - 1.0).abs() < 0.02, "crest {high} of {amplitude_m}");
        let found = (high - low) / (high + low);
        prop_assert!((found - depth).abs() < 0.05, "depth {found} for {depth}");
        for (_, f) in frequencies(&motion) {
            prop_assert!((f / carrier_hz - 1.0).abs() < 0.02, "{f} Hz");
        }
    }

    #[test]
    fn fm_has_its_band_and_its_amplitude(
        carrier_hz in 4.0..8.0, deviation_hz in 0.5..3.0, amplitude_m in 0.001..0.01, seed: u64
    ) {
        let wave = Wave::FrequencyModulated { amplitude_m, carrier_hz, deviation_hz, modulation_hz: 0.1 };
        prop_assert_eq!(wave.check(), Ok(()));
        let motion = motion(wave, seed);
        is_sound(&motion, 0.05 * amplitude_m * TAU * (carrier_hz + deviation_hz))?;
        let (low, high) = extremes(frequencies(&motion).into_iter().map(|(_, f)| f));
        // At the lowest frequencies the modulation changes within a period.
        prop_assert!((low - (carrier_hz - deviation_hz)).abs() < 0.15, "lowest {low} Hz");
        prop_assert!((high - (carrier_hz + deviation_hz)).abs() < 0.06, "highest {high} Hz");
        let (_, crest) = extremes(motion.displacement_m[clear()].iter().copied());
        prop_assert!((crest / amplitude_m - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_chirp_runs_linearly_from_one_frequency_to_the_other(
        from_hz in 0.5..14.0, to_hz in 0.5..14.0, seed: u64
    ) {
        let motion = motion(Wave::Chirp { amplitude_m: 0.002, from_hz, to_hz }, seed);
        is_sound(&motion, 0.02 * 0.002 * TAU * 14.0)?;
        for (t, f) in frequencies(&motion) {
            let expected = from_hz + (to_hz - from_hz) * t / RUN_S;
            prop_assert!((f / expected - 1.0).abs() < 0.02, "{f} Hz at {t} s for {expected} Hz");
        }
    }

    #[test]
    fn each_step_of_frequency_has_its_share_of_the_run(steps in 1u32..8, seed: u64) {
        let wave = Wave::SteppedFrequency { amplitude_m: 0.002, low_hz: 2.0, high_hz: 9.0, steps };
        let motion = motion(wave, seed);
        // Acceleration jumps between steps; a central difference is off there by a quarter of a sample times the jump.
        is_sound(&motion, 0.004)?;
        let found = frequencies(&motion);
        for expected in spread(2.0, 9.0, steps) {
            let time: f64 = found.iter().filter(|(_, f)| (f / expected - 1.0).abs() < 0.02).map(|(_, f)| 1.0 / f).sum();
            let share = RUN_S / f64::from(steps);
            // The fades and the periods in which the frequency changes are not counted.
            prop_assert!(time <= share + 0.6 && time > share - 2.2, "{expected} Hz: {time} s of {share} s");
        }
    }

    #[test]
    fn slopes_have_the_given_speeds_up_and_down(slopes in 2u32..7, seed: u64) {
        let wave = Wave::Slopes { amplitude_m: 0.01, slowest_m_s: 0.05, fastest_m_s: 0.2, slopes };
        let motion = motion(wave, seed);
        is_sound(&motion, 0.01)?;
        let (low, high) = extremes(motion.displacement_m[clear()].iter().copied());
        prop_assert!((high - low - 0.02).abs() < 2e-4, "span {}", high - low);
        let v = &motion.velocity_m_s[clear()];
        for speed in spread(0.05, 0.2, slopes) {
            for expected in [speed, -speed] {
                let held = v.iter().filter(|v| (*v - expected).abs() < 1e-9).count();
                prop_assert!(held > 20, "{expected} m/s is held for {held} samples");
            }
        }
        // Corners take 40 ms of each stroke, and a stroke takes at least 120 ms.
        let constant = v.windows(2).filter(|v| (v[1] - v[0]).abs() < 1e-9).count();
        prop_assert!(constant > v.len() / 2, "{constant} of {}", v.len());
    }
}

#[test]
fn invalid_waves_are_rejected_with_the_field_name() {
    let refused = |wave: Wave| wave.check().err().map(|e| e.to_string()).unwrap_or_default();
    let chirp = |amplitude_m, to_hz| Wave::Chirp { amplitude_m, from_hz: 1.0, to_hz };
    assert_eq!(chirp(0.01, 2.0).check(), Ok(()));
    assert!(refused(chirp(0.0, 2.0)).starts_with("amplitude_m"));
    assert!(refused(chirp(0.01, f64::NAN)).starts_with("to_hz"));
    let fm = Wave::FrequencyModulated {
        amplitude_m: 0.01,
        carrier_hz: 2.0,
        deviation_hz: 3.0,
        modulation_hz: 0.1,
    };
    assert!(refused(fm).starts_with("deviation_hz"));
    let slopes = |slopes| Wave::Slopes { amplitude_m: 0.01, slowest_m_s: 0.05, fastest_m_s: 0.2, slopes };
    assert!(refused(slopes(0)).starts_with("slopes"));
}

#[test]
fn different_seeds_give_different_waves_except_for_the_chirp() {
    let am = Wave::AmplitudeModulated { amplitude_m: 0.01, depth: 0.5, carrier_hz: 2.0, modulation_hz: 0.1 };
    assert_eq!(motion(am, 1), motion(am, 1));
    assert_ne!(motion(am, 1), motion(am, 2));
    let chirp = Wave::Chirp { amplitude_m: 0.01, from_hz: 1.0, to_hz: 5.0 };
    assert_eq!(motion(chirp, 1), motion(chirp, 2));
}
