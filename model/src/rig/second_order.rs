//! A second-order low-pass, used for the servo of the actuator and for anti-alias filters.
//!
//! ```text
//! y'' = w^2 (u - y) - 2 zeta w y',        w = 2 pi corner_hz
//! ```
//!
//! | symbol | meaning |
//! |---|---|
//! | u, y | input and output |
//! | w, zeta | natural frequency (rad/s) and damping |
//!
//! With a damping of 0.707 it is a Butterworth filter, 3 dB down at the corner. It delays slow signals by 2 zeta / w, which is 15 ms for
//! the servo. It is integrated as a differential equation by the Runge-Kutta method of fourth order.

use super::signal::{Motion, RATE_HZ};
use crate::Error;
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// A second-order low-pass; see the equation at the top of this file.
///
/// ```
/// use mr_damper_model::rig::{Motion, SecondOrder};
///
/// // At a constant 0.1 m/s, the actuator of 15 Hz is 15 ms behind its set point: 1.5 mm.
/// let set_point = Motion::recorded((0..1024).map(|k| 0.1 * f64::from(k) / 512.0).collect());
/// let followed = SecondOrder::SERVO.follow(&set_point);
/// let behind_m = set_point.displacement_m[1000] - followed.displacement_m[1000];
/// assert!((behind_m - 0.0015).abs() < 1e-5, "{behind_m} m");
/// assert!((SecondOrder::with_delay_s(0.015).corner_hz - 15.0).abs() < 0.01);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SecondOrder {
    /// Corner frequency in hertz.
    pub corner_hz: f64,
    /// Damping zeta, without unit.
    pub damping: f64,
}

/// Output y and its derivative.
type State = [f64; 2];

impl SecondOrder {
    /// The thesis' servo-hydraulic actuator: 15 Hz (thesis 3.2). Order and damping are chosen here.
    pub const SERVO: Self = Self::butterworth(15.0);

    /// A Butterworth filter with the corner frequency `corner_hz`.
    #[must_use]
    pub const fn butterworth(corner_hz: f64) -> Self {
        Self { corner_hz, damping: FRAC_1_SQRT_2 }
    }

    /// The Butterworth filter that delays slow signals by `delay_s` seconds.
    #[must_use]
    pub fn with_delay_s(delay_s: f64) -> Self {
        Self::butterworth(2.0 * FRAC_1_SQRT_2 / (TAU * delay_s))
    }

    /// Checks that the corner is above 0 and below 10 kHz, and the damping between 0.05 and 10.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the field.
    pub fn check(&self) -> Result<(), Error> {
        Error::check("corner_hz", self.corner_hz, "above 0 and below 10 kHz", |f| f > 0.0 && f < 1e4)?;
        Error::check("damping", self.damping, "between 0.05 and 10", |d| (0.05..=10.0).contains(&d))?;
        Ok(())
    }

    /// The motion of an actuator that follows the set point `set`, starting at rest.
    #[must_use]
    pub fn follow(&self, set: &Motion) -> Motion {
        let (x, v) = (&set.displacement_m, &set.velocity_m_s);
        let mut state = [x.first().copied().unwrap_or(0.0), 0.0];
        let mut motion = Motion::default();
        for k in 0..x.len().min(v.len()) {
            motion.displacement_m.push(state[0]);
            motion.velocity_m_s.push(state[1]);
            if k + 1 < x.len() {
                // Cubic with the values and slopes of the set point at both ends.
                let (m0, m1) = (v[k] / RATE_HZ, v[k + 1] / RATE_HZ);
                let rise = x[k + 1] - x[k];
                let input =
                    |u: f64| x[k] + u * (m0 + u * (3.0 * rise - 2.0 * m0 - m1 + u * (m0 + m1 - 2.0 * rise)));
                state = self.sample(state, input);
            }
        }
        motion
    }

    /// `values` (one per sample) filtered; the filter starts at rest at the first value.
    #[must_use]
    pub fn filter(&self, values: &[f64]) -> Vec<f64> {
        let Some(&first) = values.first() else { return Vec::new() };
        let mut state = [first, 0.0];
        let mut filtered = vec![first];
        filtered.extend(values.windows(2).map(|pair| {
            state = self.sample(state, |u| pair[0] + u * (pair[1] - pair[0]));
            state[0]
        }));
        filtered
    }

    /// The state after one sample; `input` is u at a fraction of the sample.
    fn sample(&self, mut state: State, input: impl Fn(f64) -> f64) -> State {
        let w = TAU * self.corner_hz;
        let stiffest = w * (1.0 + 2.0 * self.damping);
        // A step of a quarter of the fastest time constant is accurate to about 1e-5 and well within the stability limit.
        let steps = (4.0 * stiffest / RATE_HZ).ceil().max(1.0);
        let h = 1.0 / (RATE_HZ * steps);
        let rates = |[y, rate]: State, u: f64| [rate, w * w * (u - y) - 2.0 * self.damping * w * rate];
        let moved = |[y, rate]: State, by: f64, [dy, d_rate]: State| [y + by * dy, rate + by * d_rate];
        for step in 0..steps as u32 {
            let at = |part: f64| input((f64::from(step) + part) / steps);
            let a = rates(state, at(0.0));
            let b = rates(moved(state, h / 2.0, a), at(0.5));
            let c = rates(moved(state, h / 2.0, b), at(0.5));
            let d = rates(moved(state, h, c), at(1.0));
            state = moved(state, h / 6.0, std::array::from_fn(|n| a[n] + 2.0 * (b[n] + c[n]) + d[n]));
        }
        state
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sine(hz: f64, samples: usize) -> Vec<f64> {
        (0..samples).map(|k| (TAU * hz * k as f64 / RATE_HZ).sin()).collect()
    }

    /// Amplitude and delay (s) of `y` as a sine of `hz`, over its second half.
    fn gain_and_delay(y: &[f64], hz: f64) -> (f64, f64) {
        let half = y.len() / 2;
        let (mut s, mut c) = (0.0, 0.0);
        for (k, y) in y.iter().enumerate().skip(half) {
            let (sin, cos) = (TAU * hz * k as f64 / RATE_HZ).sin_cos();
            s += 2.0 * y * sin / half as f64;
            c += 2.0 * y * cos / half as f64;
        }
        (s.hypot(c), (-c).atan2(s) / (TAU * hz))
    }

    proptest! {
        #[test]
        fn gain_and_delay_match_the_transfer_function(
            hz in 1u32..40, corner_hz in 5.0..200.0, damping in 0.3..1.5
        ) {
            let hz = f64::from(hz);
            let found = gain_and_delay(&SecondOrder { corner_hz, damping }.filter(&sine(hz, 8 * 512)), hz);
            let ratio = hz / corner_hz;
            let (re, im) = (1.0 - ratio * ratio, 2.0 * damping * ratio);
            // The input is linear between samples, which reduces the amplitude of a sine by the share (pi f / rate)^2 / 3.
            let linear = 1.0 - (TAU / 2.0 * hz / RATE_HZ).powi(2) / 3.0;
            prop_assert!((found.0 - linear / re.hypot(im)).abs() < 2e-3, "gain {found:?}");
            prop_assert!((found.1 - im.atan2(re) / (TAU * hz)).abs() < 1e-4, "delay {found:?}");
        }
    }

    #[test]
    fn a_ramp_is_delayed_by_the_given_delay() {
        let ramp: Vec<f64> = (0..1024).map(|k| k as f64 / RATE_HZ).collect();
        let behind = ramp[1023] - SecondOrder::with_delay_s(0.02).filter(&ramp)[1023];
        assert!((behind - 0.02).abs() < 1e-6, "{behind} s");
    }

    #[test]
    fn velocity_is_the_slope_of_the_filtered_displacement() {
        let x = sine(5.0, 2048);
        let v = (0..2048).map(|k| TAU * 5.0 * (TAU * 5.0 * f64::from(k) / RATE_HZ).cos()).collect();
        let motion = SecondOrder::SERVO.follow(&Motion { displacement_m: x, velocity_m_s: v });
        // Start after the transient, which comes from the velocity jump at the start of the set point.
        for k in 256..2047 {
            let slope = (motion.displacement_m[k + 1] - motion.displacement_m[k - 1]) * RATE_HZ / 2.0;
            assert!((slope - motion.velocity_m_s[k]).abs() < 0.05, "at {k}");
        }
        let (gain, _) = gain_and_delay(&motion.displacement_m, 5.0);
        assert!((gain - 1.0 / (1.0 + 3f64.powi(-4)).sqrt()).abs() < 1e-4, "{gain}");
    }

    #[test]
    fn invalid_corners_and_dampings_are_rejected() {
        assert_eq!(SecondOrder::SERVO.check(), Ok(()));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 2e4] {
            assert!(SecondOrder::butterworth(bad).check().is_err(), "{bad}");
        }
        assert!(SecondOrder { corner_hz: 15.0, damping: 0.0 }.check().is_err());
    }
}
