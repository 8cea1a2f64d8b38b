//! The excitation of a window, as three numbers.
//!
//! ```text
//! z = (ln s_x, ln s_v, mean |i| / i_max)
//! ```
//!
//! s_x is the standard deviation of the displacement, s_v the root mean square of its difference quotients over 20 ms, i the drive, and i_max
//! the largest drive in the data that the model comes from.

use crate::sample::{Reading, Sample, Stamp};

/// Time over which a velocity is a difference quotient, s. Noise of the sensor counts less than over one sample.
const APART_S: f64 = 0.02;
/// Number of covariates.
pub(super) const COVARIATES: usize = 3;

/// Sums over the samples of a window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Excitation {
    largest_drive: f64,
    last: Option<(Stamp, f64)>,
    sums: Sums,
}

#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    displacements: f64,
    x: f64,
    xx: f64,
    velocities: f64,
    vv: f64,
    drives: f64,
    i: f64,
}

impl Excitation {
    /// Without samples, for a model whose data have drives up to `largest_drive`, in amperes or volts; `None` if that is not known.
    pub(super) fn new(largest_drive: Option<f64>) -> Self {
        let largest_drive = largest_drive.filter(|largest| *largest > 0.0).unwrap_or(1.0);
        Self { largest_drive, last: None, sums: Sums::default() }
    }

    pub(super) fn see(&mut self, sample: &Sample, gap_s: f64) {
        let sums = &mut self.sums;
        match sample.reading {
            Reading::Displacement(x) => {
                let x_m = x.get();
                sums.displacements += 1.0;
                sums.x += x_m;
                sums.xx += x_m * x_m;
                let (stamp, from_m) = *self.last.get_or_insert((sample.stamp, x_m));
                let apart_s = sample.stamp.since(stamp).get();
                if (APART_S..gap_s.max(2.0 * APART_S)).contains(&apart_s) {
                    sums.velocities += 1.0;
                    sums.vv += ((x_m - from_m) / apart_s).powi(2);
                }
                if !(0.0..APART_S).contains(&apart_s) {
                    self.last = Some((sample.stamp, x_m));
                }
            }
            Reading::Drive(drive) => {
                sums.drives += 1.0;
                sums.i += drive.get().abs();
            }
            _ => {}
        }
    }

    /// The covariates z of the samples since the last call; `None` without motion.
    pub(super) fn take(&mut self) -> Option<[f64; COVARIATES]> {
        let Sums { displacements, x, xx, velocities, vv, drives, i } = std::mem::take(&mut self.sums);
        let mean = x / displacements;
        let drive = if drives > 0.0 { i / drives / self.largest_drive } else { 0.0 };
        let found = [0.5 * (xx / displacements - mean * mean).ln(), 0.5 * (vv / velocities).ln(), drive];
        found.iter().all(|z| z.is_finite()).then_some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::Drive;
    use crate::units::{Ampere, Metre};

    #[test]
    fn a_sine_at_a_current_has_its_amplitudes() {
        let mut excitation = Excitation::new(Some(2.0));
        for step in 0..10_000 {
            let t_s = 1e-3 * f64::from(step);
            let stamp = Stamp::from_nanos(1_000_000 * i64::from(step));
            let x_m = 0.02 + 0.01 * (std::f64::consts::TAU * 2.0 * t_s).sin();
            excitation
                .see(&Sample { stamp, received: stamp, reading: Reading::Displacement(Metre(x_m)) }, 0.1);
            let reading = Reading::Drive(Drive::CoilCurrent(Ampere(0.5)));
            excitation.see(&Sample { stamp, received: stamp, reading }, 0.1);
        }
        let [stroke, speed, drive] = excitation.take().expect("a motion");
        let effective = std::f64::consts::FRAC_1_SQRT_2;
        assert!((stroke.exp() / (0.01 * effective) - 1.0).abs() < 1e-3);
        assert!((speed.exp() / (0.01 * std::f64::consts::TAU * 2.0 * effective) - 1.0).abs() < 0.01);
        assert!((drive - 0.25).abs() < 1e-12);
        assert_eq!(excitation.take(), None);
    }
}
