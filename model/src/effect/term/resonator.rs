//! The filter of the form `resonance`.
//!
//! ```text
//! y'' = w² (q - y) - 2 b w y',        w = 2 pi a
//! T   = tan(w dt / 2),  z = y' / w
//! z  <- ((1 - 2 b T - T²) z + T (q + q_before - 2 y)) / (1 + 2 b T + T²)
//! y  <- y + T (z_before + z)
//! ```
//!
//! This is the bilinear transform, warped such that the resonance lies at its frequency at any rate of samples. Frequencies above nearly
//! half the rate act as that.

use crate::force::jet::Real;
use std::f64::consts::{FRAC_PI_2, PI};

/// Largest w dt / 2.
const MOST: f64 = 1.5;

/// State of the filter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Resonator<R = f64> {
    before: R,
    y: R,
    z: R,
}

/// T for a sample `step_s` after the one before.
#[inline]
pub(crate) fn warped<R: Real>(frequency_hz: R, step_s: f64) -> R {
    let half = (frequency_hz * (PI * step_s)).min(R::from(MOST));
    half.sin() / (half + FRAC_PI_2).sin()
}

impl<R: Real> Resonator<R> {
    /// One sample `q` with the T of [`warped`]; 0 for the first one, at which the filter is at rest. A value that is not finite leaves the
    /// state as it is.
    #[inline]
    pub(crate) fn step(&mut self, t: R, damping: R, q: R) -> R {
        if !q.re().is_finite() {
            return q;
        }
        if t.re() <= 0.0 {
            *self = Self { before: q, y: q, z: R::from(0.0) };
            return q;
        }
        let (friction, square) = (damping * t * 2.0, t * t);
        let Self { before, y, z } = *self;
        let next = (z * (-friction - square + 1.0) + t * (q + before - y * 2.0)) / (friction + square + 1.0);
        *self = Self { before: q, y: y + t * (z + next), z: next };
        self.y
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Gain and phase of the differential equation at `f_hz`.
    fn expected(f_hz: f64, own_hz: f64, damping: f64) -> (f64, f64) {
        let r = f_hz / own_hz;
        let (re, im) = (1.0 - r * r, 2.0 * damping * r);
        (1.0 / re.hypot(im), -im.atan2(re))
    }

    #[test]
    fn a_sine_has_gain_and_phase_of_the_equation() {
        let (own_hz, damping, rate_hz) = (20.0, 0.08, 1024.0);
        for f_hz in [4.0, 18.0, 20.0, 25.0, 60.0] {
            let mut filter = Resonator::default();
            let (mut re, mut im) = (0.0, 0.0);
            for k in 0..4096 {
                let t_s = f64::from(k) / rate_hz;
                let t = if k == 0 { 0.0 } else { warped(own_hz, 1.0 / rate_hz) };
                let y = filter.step(t, damping, (TAU * f_hz * t_s).sin());
                if k >= 3072 {
                    let angle = TAU * f_hz * t_s;
                    (re, im) = (re + y * angle.sin() / 512.0, im + y * angle.cos() / 512.0);
                }
            }
            let (gain, phase) = expected(f_hz, own_hz, damping);
            assert!((re.hypot(im) / gain - 1.0).abs() < 0.03, "{f_hz} Hz: gain {} {gain}", re.hypot(im));
            assert!((im.atan2(re) - phase).abs() < 0.05, "{f_hz} Hz: phase {} {phase}", im.atan2(re));
        }
    }

    #[test]
    fn it_rests_at_a_constant_and_is_stable_at_any_step() {
        let mut filter = Resonator::default();
        for k in 0..100_i32 {
            let t = warped(30.0, f64::from(k.min(1)) * 1e-3);
            assert!((filter.step(t, 0.1, 5.0_f64) - 5.0).abs() < 1e-12);
        }
        for step_s in [1e-4, 1e-2, 1.0, 100.0] {
            let t = warped(30.0, step_s);
            let swing = (0..500).map(|k| match k {
                0 => filter.step(0.0, 0.02, 6.0),
                _ => filter.step(t, 0.02, 5.0),
            });
            assert!(swing.fold(0.0_f64, |most, y| most.max((y - 5.0).abs())) < 4.0, "{step_s} s");
        }
    }
}
