//! Replicates: repetitions of an experiment.
//!
//! The thesis fits the first replicate of an experiment and cross-validates with the others. Its bench read the patterns from a file and
//! repeated them, so its replicates had the same excitation. Cross-validation on the excitation of the fit is not an independent test:
//! apart from noise, the error is that on the first replicate. Here the default is therefore [`Pattern::New`], a different excitation
//! of the same kind for each replicate. [`Pattern::Same`] is the thesis' method, from which a noise floor can be computed. In both
//! cases each replicate has new sensor noise, and [`Drift`] changes the damper slightly.

use super::channel::Channels;
use super::experiment::Experiment;
use super::noise::{Purpose, normal, stream};
use super::plant::{Plant, Saturation};

/// Excitation of the replicates of an experiment.
///
/// ```
/// use mr_damper_model::rig::{Channels, Experiment, Pattern, Plant, record};
///
/// let experiment = Experiment::thesis("RP-ICPS").expect("an experiment of the thesis").with_duration_s(2.0);
/// let displacement_m = |number, pattern| {
///     let (experiment, seed) = experiment.replicate(number, 7, pattern);
///     record(&experiment, &Plant::default(), &Channels::PERFECT, seed).displacement_m.values
/// };
/// // Without noise, replicates of the same excitation have the same displacement.
/// assert_eq!(displacement_m(1, Pattern::Same), displacement_m(2, Pattern::Same));
/// assert_ne!(displacement_m(1, Pattern::New), displacement_m(2, Pattern::New));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pattern {
    /// A new excitation of the same kind for each replicate, with its own random phases and currents.
    #[default]
    New,
    /// The excitation of the first replicate.
    Same,
}

/// The seed of replicate `number` (from 1) of the experiment called `name`, in a set with the seed `set`.
///
/// Different experiments, replicates and sets have different seeds, so none shares its excitation with another by accident. The seed is
/// below 2^63, so it fits into a signed integer.
#[must_use]
pub fn seed(name: &str, number: u32, set: u64) -> u64 {
    // FNV-1a over the name, then the finaliser of SplitMix64, so that neighbouring seeds are unrelated.
    let named = name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
        (hash ^ u64::from(byte.to_ascii_lowercase())).wrapping_mul(0x0100_0000_01b3)
    });
    let mut z = (named ^ set.wrapping_mul(0x9e37_79b9_7f4a_7c15))
        .wrapping_add(u64::from(number).wrapping_mul(0xd1b5_4a32_d192_ed03));
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    (z ^ z >> 31) >> 1
}

impl Experiment {
    /// Replicate `number` (from 1) in the set with the seed `set`: the experiment with its pattern and current fixed, and the seed to
    /// record it with.
    /// The first replicate is the same for both kinds of `pattern`.
    #[must_use]
    pub fn replicate(&self, number: u32, set: u64, pattern: Pattern) -> (Self, u64) {
        let seed_of = |number| seed(&self.name, number, set);
        let excitation = match pattern {
            Pattern::New => seed_of(number),
            Pattern::Same => seed_of(1),
        };
        let mut one = self.clone().with_pattern(excitation);
        let turn = number.saturating_sub(1) as usize;
        if let Some(current_a) = self.replicate_currents_a.iter().cycle().nth(turn) {
            one = one.with_constant_current_a(*current_a);
        }
        (one, seed_of(number))
    }
}

/// Variation of damper, room and load cell from run to run (standard deviations). The default values are chosen here, for a bench that is
/// used over a day.
///
/// ```
/// use mr_damper_model::rig::{Channels, Drift, Plant};
///
/// // The offset of the load cell differs from run to run with a standard deviation of 2 N, limited to three of them.
/// let offset_n = |seed| Drift::default().apply(Plant::default(), Channels::PERFECT, seed).1.force_offset_n;
/// let offsets_n: Vec<f64> = (0..200).map(offset_n).collect();
/// let rms_n = (offsets_n.iter().map(|n| n * n).sum::<f64>() / 200.0).sqrt();
/// assert!((rms_n - 2.0).abs() < 0.4 && offsets_n.iter().all(|n| n.abs() <= 6.0), "{rms_n} N");
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// Temperature of the damper at the start, in kelvin.
    pub start_k: f64,
    /// Temperature of the room, in kelvin.
    pub ambient_k: f64,
    /// Relative variation of the yield force, and independently of both dampings.
    pub strength: f64,
    /// Offset of the load cell, in newtons.
    pub offset_n: f64,
}

impl Drift {
    /// No variation between runs.
    pub const NONE: Self = Self { start_k: 0.0, ambient_k: 0.0, strength: 0.0, offset_n: 0.0 };

    /// Plant and channels of the run with the seed `seed`.
    #[must_use]
    pub fn apply(&self, plant: Plant, channels: Channels, seed: u64) -> (Plant, Channels) {
        let mut rng = stream(seed, Purpose::Drift);
        // Limited to three standard deviations, so that no run is an outlier.
        let mut draw = |deviation: f64| deviation * normal(&mut rng).clamp(-3.0, 3.0);
        let scaled =
            |s: Saturation, by: f64| Saturation { at_zero: s.at_zero * by, growth: s.growth * by, ..s };
        let (start_k, ambient_k) = (draw(self.start_k), draw(self.ambient_k));
        let (yielding, viscous) = (1.0 + draw(self.strength), 1.0 + draw(self.strength));
        let plant = Plant {
            start_c: plant.start_c + start_k,
            ambient_c: plant.ambient_c + ambient_k,
            yield_n: scaled(plant.yield_n, yielding),
            viscous_n_s_m: scaled(plant.viscous_n_s_m, viscous),
            roll_off_n_s_m: scaled(plant.roll_off_n_s_m, viscous),
            ..plant
        };
        let force_offset_n = channels.force_offset_n + draw(self.offset_n);
        (plant, Channels { force_offset_n, ..channels })
    }
}

impl Default for Drift {
    fn default() -> Self {
        Self { start_k: 2.0, ambient_k: 0.5, strength: 0.01, offset_n: 2.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{Current, record};
    use std::collections::HashSet;

    #[test]
    fn every_run_has_its_own_seed() {
        let mut seeds = HashSet::new();
        for set in 0..20 {
            for name in Experiment::names().chain(Experiment::paper1_names()) {
                for number in 1..=20 {
                    let seed = seed(name, number, set);
                    assert!(seed < 1 << 63);
                    assert!(seeds.insert(seed), "{name} {number} of {set}");
                }
            }
        }
        assert_eq!(seed("RP-ICPS", 3, 1), seed("rp-icps", 3, 1));
    }

    #[test]
    fn replicates_have_a_new_pattern_or_that_of_the_first() {
        let plan = Experiment::thesis("RP-ICPS").map(|e| e.with_duration_s(2.0)).into_iter();
        for plan in plan {
            let drive = |number, pattern| {
                let (experiment, seed) = plan.replicate(number, 7, pattern);
                let run = record(&experiment, &Plant::default(), &Channels::PERFECT, seed);
                (run.drive, run.displacement_m)
            };
            assert_eq!(drive(1, Pattern::New), drive(1, Pattern::Same));
            assert_eq!(drive(1, Pattern::Same), drive(2, Pattern::Same));
            assert_ne!(drive(1, Pattern::New), drive(2, Pattern::New));
        }
    }

    #[test]
    fn constant_currents_of_the_first_paper_are_seven_or_one() {
        let plan = Experiment::paper1("paper1-6").expect("an experiment of the first paper");
        let levels = |plan: &Experiment| -> Vec<Current> {
            (1..=plan.replicates).map(|k| plan.replicate(k, 0, Pattern::Same).0.current).collect()
        };
        let constant = |current_a| Current::Constant { current_a };
        assert_eq!(levels(&plan), [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0].map(constant));
        assert_eq!(levels(&plan.with_constant_current_a(1.2)), [1.2; 7].map(constant));
    }

    #[test]
    fn drift_has_its_standard_deviations_and_can_be_switched_off() {
        let (plant, channels) = (Plant::default(), Channels::default());
        assert_eq!(Drift::NONE.apply(plant, channels, 5), (plant, channels));
        assert_eq!(Drift::default().apply(plant, channels, 5), Drift::default().apply(plant, channels, 5));
        let runs: Vec<_> = (0..4000).map(|seed| Drift::default().apply(plant, channels, seed)).collect();
        let deviation = |of: &dyn Fn(&(Plant, Channels)) -> f64, nominal: f64| {
            (runs.iter().map(|run| (of(run) - nominal).powi(2)).sum::<f64>() / 4000.0).sqrt()
        };
        let near =
            |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 0.05, "{found} {expected}");
        near(deviation(&|run| run.0.start_c, plant.start_c), 2.0);
        near(deviation(&|run| run.0.yield_n.growth / plant.yield_n.growth, 1.0), 0.01);
        near(deviation(&|run| run.0.viscous_n_s_m.at_zero / plant.viscous_n_s_m.at_zero, 1.0), 0.01);
        near(deviation(&|run| run.1.force_offset_n, 0.0), 2.0);
        assert!(runs.iter().all(|run| run.0.check().is_ok()));
    }
}
