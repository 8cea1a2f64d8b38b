//! Random numbers of the rig: one seed, with an independent stream for each purpose.

use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Purpose of a stream of random numbers. Streams do not share numbers, so a change to one (say, a quieter sensor) does not change the
/// others: two runs with the same seed then have the same excitation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    Displacement = 1,
    Current = 2,
    DisplacementNoise = 3,
    CurrentNoise = 4,
    ForceNoise = 5,
    CaseNoise = 6,
    AmbientNoise = 7,
    Drift = 8,
    VelocityNoise = 9,
}

/// The generator for a purpose.
pub(super) fn stream(seed: u64, purpose: Purpose) -> Pcg64Mcg {
    // The multiplier (odd, from the golden ratio) spreads the purposes over the seeds; `seed_from_u64` then mixes the bits.
    Pcg64Mcg::seed_from_u64(seed ^ (purpose as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

/// A normal value with mean 0 and deviation 1 (Marsaglia's polar method; the second value is dropped).
pub(super) fn normal(rng: &mut impl Rng) -> f64 {
    loop {
        let (u, v) = (2.0 * rng.random::<f64>() - 1.0, 2.0 * rng.random::<f64>() - 1.0);
        let s = u * u + v * v;
        if s > 0.0 && s < 1.0 {
            return u * (-2.0 * s.ln() / s).sqrt();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_values_have_unit_moments() {
        let mut rng = stream(1, Purpose::ForceNoise);
        let n = 200_000;
        let (mut mean, mut var, mut fourth) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            let x = normal(&mut rng);
            mean += x / f64::from(n);
            var += x * x / f64::from(n);
            fourth += x.powi(4) / f64::from(n);
        }
        assert!(mean.abs() < 0.01 && (var - 1.0).abs() < 0.02 && (fourth - 3.0).abs() < 0.1);
    }
}
