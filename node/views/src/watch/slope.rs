//! Velocity from displacement, for the chart of force over velocity: the slope over a short window, at the middle of the window.

use std::collections::VecDeque;

/// Length of the window, s: short compared with the motion of a rod, long enough to average the sensor's noise.
const WINDOW_S: f64 = 0.02;
/// Minimum number of samples for a slope, even if they span more than the window.
const FEWEST: usize = 3;
/// Maximum number of samples that are kept.
const MOST: usize = 64;
/// Samples further apart than this belong to different motions, s.
const GAP_S: f64 = 0.5;

/// The newest displacements.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Slope {
    samples: VecDeque<(f64, f64)>,
}

impl Slope {
    /// Adds a displacement, m, at `at_s`. Returns the mean time of the window, s, and the velocity there, m/s. `None` for a repeated
    /// time or a value that is not finite, and while there are too few samples.
    pub(super) fn take(&mut self, at_s: f64, displacement_m: f64) -> Option<(f64, f64)> {
        let last_s = self.samples.back().map_or(f64::NEG_INFINITY, |sample| sample.0);
        if !displacement_m.is_finite() || at_s == last_s {
            return None;
        }
        if at_s < last_s || at_s - last_s > GAP_S {
            self.samples.clear();
        }
        self.samples.push_back((at_s, displacement_m));
        let is_spare = |samples: &VecDeque<(f64, f64)>| {
            samples.len() > MOST
                || samples.len() > FEWEST && samples.front().is_some_and(|first| at_s - first.0 > WINDOW_S)
        };
        while is_spare(&self.samples) {
            self.samples.pop_front();
        }
        if self.samples.len() < FEWEST {
            return None;
        }
        let count = self.samples.len() as f64;
        let mean = |of: fn(&(f64, f64)) -> f64| self.samples.iter().map(of).sum::<f64>() / count;
        let (middle_s, middle_m) = (mean(|sample| sample.0), mean(|sample| sample.1));
        let products = |of: &dyn Fn(f64, f64) -> f64| {
            self.samples.iter().map(|&(s, m)| of(s - middle_s, m - middle_m)).sum::<f64>()
        };
        Some((middle_s, products(&|s, m| s * m) / products(&|s, _| s * s)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_velocity_of_a_sine_is_found_in_the_middle_of_the_window() {
        for rate_hz in [50.0, 512.0, 4000.0] {
            let (omega, mut slope, mut worst) = (2.0 * std::f64::consts::PI * 2.0, Slope::default(), 0.0_f64);
            for k in 0..4000 {
                let at_s = f64::from(k) / rate_hz;
                if let Some((middle_s, velocity)) = slope.take(at_s, 0.01 * (omega * at_s).sin()) {
                    worst = worst.max((velocity - 0.01 * omega * (omega * middle_s).cos()).abs());
                    assert!(at_s - middle_s <= 1.0 / rate_hz + WINDOW_S / 2.0);
                }
            }
            assert!(worst < 0.02 * 0.01 * omega, "{rate_hz} Hz: off by {worst} of {} m/s", 0.01 * omega);
        }
    }

    #[test]
    fn gaps_repeats_and_invalid_values_give_no_velocity() {
        let mut slope = Slope::default();
        for (at_s, displacement_m) in [(0.0, 0.0), (0.001, 0.0), (0.001, 9.0), (0.002, f64::NAN)] {
            assert_eq!(slope.take(at_s, displacement_m), None);
        }
        assert_eq!(slope.take(0.002, 0.0), Some((0.001, 0.0)));
        assert_eq!(slope.take(1.0, 5.0), None, "after a gap");
        assert_eq!(slope.take(0.0, 5.0), None, "and when time goes back");
    }
}
