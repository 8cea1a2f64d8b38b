//! Current commands of the thesis' experiments (thesis 3.2).
//!
//! | signal | rule |
//! |---|---|
//! | constant | one current |
//! | SC, stepped | levels one after another, each for an equal share of the run |
//! | ICPS | a new amplitude, uniform between two bounds, every `hold_s` |
//! | APRBS | each sample keeps the last amplitude with probability alpha, or draws a bounded normal one |
//! | PRBS | two levels by a maximum-length binary sequence, each bit held for some samples |
//!
//! For APRBS the thesis prints alpha = 0.01, which by its own rule would be white noise; 0.99 must be meant (mean hold 100 samples,
//! 0.195 s). It does not give the mean and deviation of the normal distribution. Here they are 1.2 and 0.5 A. After bounding these
//! reproduce the mean and deviation of the thesis' long record, 1.19 and 0.47 A; these two follow from the input ranges of its ANFIS
//! models if the record reaches both bounds. Its record of 30 s, with 150 draws, has 1.07 and 0.50 A.
//!
//! For PRBS the thesis states two levels "bound between 0 and 2.5 A". These two cannot be the levels of the recorded current: its range
//! is -0.84 to 1.89 standard deviations around the mean, a product of -1.59, but for two levels the product is -1. Its mean and
//! deviation (0.77 and 0.92 A) fit two levels of 0 and 1.86 A with peaks up to 2.5 A, so these levels are used here.
//!
//! Source: `[thesis]` in the bibliography (node/docs/guide/bibliography.md), equations 3.1 and 3.2 of the thesis.

use super::noise::normal;
use super::signal::RATE_HZ;
use rand::{Rng, RngExt};

/// The currents of the thesis' stepped signal, in amperes.
pub const STEPS_A: [f64; 7] = [0.0, 0.4, 0.8, 1.2, 1.6, 2.1, 2.5];

/// A current command.
///
/// ```
/// use mr_damper_model::rig::{Channels, Current, Experiment, Plant, record};
///
/// let current = Current::Stepped { levels_a: vec![0.5, 2.0] };
/// let experiment = Experiment { current, ..Experiment::sine(0.01, 1.0, 0.0, 4.0) };
/// let run = record(&experiment, &Plant::default(), &Channels::PERFECT, 1);
/// let (_, current_a) = run.drive.expect("the rig measures the current");
/// // Each level takes half of the run.
/// assert!((current_a.values[1000] - 0.5).abs() < 0.01 && (current_a.values[2000] - 2.0).abs() < 0.01);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum Current {
    /// One current throughout.
    Constant {
        /// The current in amperes.
        current_a: f64,
    },
    /// Levels one after another (SC), each for an equal share of the run.
    Stepped {
        /// The levels in amperes; an empty list gives zero current.
        levels_a: Vec<f64>,
    },
    /// Uniform random amplitudes held for a fixed time (ICPS).
    Icps {
        /// Lower bound in amperes.
        low_a: f64,
        /// Upper bound in amperes.
        high_a: f64,
        /// Hold in seconds.
        hold_s: f64,
    },
    /// Normally distributed amplitudes held for a random time (APRBS).
    Aprbs {
        /// Lower bound in amperes.
        low_a: f64,
        /// Upper bound in amperes.
        high_a: f64,
        /// Mean before bounding, in amperes; between the bounds.
        mean_a: f64,
        /// Standard deviation before bounding, in amperes.
        deviation_a: f64,
        /// Probability that a sample keeps the last amplitude.
        hold_probability: f64,
    },
    /// Two levels by a maximum-length binary sequence of 2^15 - 1 bits (PRBS).
    Prbs {
        /// Lower level in amperes.
        low_a: f64,
        /// Upper level in amperes.
        high_a: f64,
        /// Samples for which each bit is held.
        hold_samples: usize,
    },
}

impl Current {
    /// The thesis' ICPS: 0 to 2.5 A, held 0.2 s.
    pub const ICPS: Self = Self::Icps { low_a: 0.0, high_a: 2.5, hold_s: 0.2 };
    /// The thesis' APRBS: 0 to 2.5 A, mean hold 100 samples.
    pub const APRBS: Self =
        Self::Aprbs { low_a: 0.0, high_a: 2.5, mean_a: 1.2, deviation_a: 0.5, hold_probability: 0.99 };
    /// The thesis' PRBS: 0 and 1.86 A (see the top of this file), each bit held for 100 samples.
    pub const PRBS: Self = Self::Prbs { low_a: 0.0, high_a: 1.86, hold_samples: 100 };

    /// The thesis' stepped signal: [`STEPS_A`].
    #[must_use]
    pub fn stepped() -> Self {
        Self::Stepped { levels_a: STEPS_A.to_vec() }
    }

    /// The command in amperes, one value for each of `samples` samples at [`RATE_HZ`].
    #[must_use]
    pub fn command_a(&self, samples: usize, rng: &mut impl Rng) -> Vec<f64> {
        match self {
            Self::Constant { current_a } => vec![*current_a; samples],
            Self::Stepped { levels_a } => (0..samples)
                .map(|k| levels_a.get(k * levels_a.len() / samples).copied().unwrap_or(0.0))
                .collect(),
            Self::Icps { low_a, high_a, hold_s } => {
                // The hold is counted in time, not in samples: 0.2 s are 102.4 samples, so holds have 102 or 103 samples.
                let slot = |k: usize| (k as f64 / (hold_s * RATE_HZ)).floor();
                let mut amplitude = uniform(*low_a, *high_a, rng);
                (0..samples)
                    .map(|k| {
                        if k > 0 && slot(k) != slot(k - 1) {
                            amplitude = uniform(*low_a, *high_a, rng);
                        }
                        amplitude
                    })
                    .collect()
            }
            Self::Aprbs { low_a, high_a, mean_a, deviation_a, hold_probability } => {
                let draw = |rng: &mut _| bounded_normal(*mean_a, *deviation_a, *low_a, *high_a, rng);
                let mut amplitude = draw(rng);
                (0..samples)
                    .map(|k| {
                        if k > 0 && rng.random::<f64>() >= *hold_probability {
                            amplitude = draw(rng);
                        }
                        amplitude
                    })
                    .collect()
            }
            Self::Prbs { low_a, high_a, hold_samples } => {
                let mut register = Register::new(rng);
                let mut level = if register.bit() { *high_a } else { *low_a };
                (0..samples)
                    .map(|k| {
                        if k > 0 && k % (*hold_samples).max(1) == 0 {
                            level = if register.bit() { *high_a } else { *low_a };
                        }
                        level
                    })
                    .collect()
            }
        }
    }
}

fn uniform(low: f64, high: f64, rng: &mut impl Rng) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// A normal value, drawn again until it lies within the bounds.
fn bounded_normal(mean: f64, deviation: f64, low: f64, high: f64, rng: &mut impl Rng) -> f64 {
    // With bounds far from the mean almost every value would be rejected; the clamped mean is used then.
    for _ in 0..100 {
        let value = mean + deviation * normal(rng);
        if (low..=high).contains(&value) {
            return value;
        }
    }
    mean.max(low).min(high)
}

/// Linear feedback shift register of x^15 + x^14 + 1, with a period of 2^15 - 1 bits.
struct Register(u16);

impl Register {
    fn new(rng: &mut impl Rng) -> Self {
        // The register would stay in the state zero for ever.
        Self(((rng.random::<u32>() & 0x7fff) as u16).max(1))
    }

    fn bit(&mut self) -> bool {
        let feedback = (self.0 >> 14 ^ self.0 >> 13) & 1;
        self.0 = (self.0 << 1 | feedback) & 0x7fff;
        feedback == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    const RUN: usize = 600 * 512;

    fn command(current: &Current, samples: usize) -> Vec<f64> {
        current.command_a(samples, &mut Pcg64Mcg::seed_from_u64(11))
    }

    /// Lengths of the runs of equal values, in samples.
    fn holds(command: &[f64]) -> Vec<usize> {
        command.chunk_by(|a, b| a == b).map(<[f64]>::len).collect()
    }

    fn mean_and_std(values: &[f64]) -> (f64, f64) {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let var = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / values.len() as f64;
        (mean, var.sqrt())
    }

    #[test]
    fn icps_holds_200_ms_and_is_uniform() {
        let command = command(&Current::ICPS, RUN);
        let holds = holds(&command);
        assert_eq!(holds.len(), 3000);
        assert!(holds[..2999].iter().all(|&n| n == 102 || n == 103));
        let (mean, std) = mean_and_std(&command);
        assert!((mean - 1.25).abs() < 0.05 && (std - 2.5 / 12f64.sqrt()).abs() < 0.03, "{mean} {std}");
        assert!(command.iter().all(|i| (0.0..=2.5).contains(i)));
    }

    #[test]
    fn aprbs_holds_about_100_samples() {
        let command = command(&Current::APRBS, RUN);
        let holds = holds(&command);
        let mean_hold = RUN as f64 / holds.len() as f64;
        assert!((mean_hold - 100.0).abs() < 6.0, "{mean_hold}");
        let (mean, std) = mean_and_std(&command);
        assert!((mean - 1.2).abs() < 0.05 && (std - 0.47).abs() < 0.03, "{mean} {std}");
        assert!(command.iter().all(|i| (0.0..=2.5).contains(i)));
    }

    #[test]
    fn prbs_has_two_levels_in_equal_parts_and_holds_multiples_of_100_samples() {
        let command = command(&Current::PRBS, RUN);
        assert!(command.iter().all(|&i| i == 0.0 || i == 1.86));
        assert!(holds(&command)[..100].iter().all(|n| n % 100 == 0));
        let (mean, _) = mean_and_std(&command);
        assert!((mean - 0.93).abs() < 0.07, "{mean}");
    }

    #[test]
    fn the_register_runs_through_all_states() {
        let mut register = Register(1);
        let period = (1..).find(|_| {
            register.bit();
            register.0 == 1
        });
        assert_eq!(period, Some(32767));
    }

    #[test]
    fn steps_share_the_run_equally() {
        let holds = holds(&command(&Current::stepped(), 210 * 512));
        assert_eq!(holds, [30 * 512; 7]);
        assert_eq!(command(&Current::Stepped { levels_a: vec![] }, 3), [0.0; 3]);
    }
}
