//! Block bootstrap: the interval of a ratio of sums.
//!
//! ```text
//! ratio* = sum_k after_{b(k)} / sum_k before_{b(k)}          b(k): B blocks drawn with replacement from B
//! interval: the 2.5 % and 97.5 % quantiles of 4000 such ratios
//! ```
//!
//! Errors of neighbouring samples are correlated, so blocks are drawn and not samples.
//!
//! Source: `[block-bootstrap]` in the bibliography (node/docs/guide/bibliography.md).

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Number of resamples.
const RESAMPLES: usize = 4000;

/// 95 % interval of the ratio of the second sum to the first, from the sums of each block; NaN without a block.
///
/// ```
/// use mr_damper_model::statistics::bootstrap::ratio_interval_95;
/// // The squared error before and after, in eight blocks: it falls to a tenth everywhere, up to the noise of the blocks.
/// let blocks = [(10.0, 1.1), (12.0, 1.0), (9.0, 0.9), (11.0, 1.2), (10.0, 1.0), (8.0, 0.7), (13.0, 1.4), (10.0, 1.0)];
/// let [low, high] = ratio_interval_95(&blocks, 0);
/// assert!(0.08 < low && low < 0.1 && 0.1 < high && high < 0.12, "{low} {high}");
/// ```
#[must_use]
pub fn ratio_interval_95(blocks: &[(f64, f64)], seed: u64) -> [f64; 2] {
    if blocks.is_empty() {
        return [f64::NAN; 2];
    }
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut ratios: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            let (before, after) = (0..blocks.len()).fold((0.0, 0.0), |(before, after), _| {
                let (b, a) = blocks[random.random_range(0..blocks.len())];
                (before + b, after + a)
            });
            after / before
        })
        .collect();
    ratios.sort_by(f64::total_cmp);
    let at = |q: f64| ratios[((q * RESAMPLES as f64) as usize).min(RESAMPLES - 1)];
    [at(0.025), at(0.975)]
}

#[cfg(test)]
mod tests {
    use super::super::tests::noise;
    use super::*;

    #[test]
    fn the_interval_covers_the_true_ratio_in_about_nineteen_of_twenty_trials() {
        // The ratio of the expected sums is 0.5. With 30 blocks the percentile interval covers a little less than its level.
        let covers = |seed: u64| {
            let blocks: Vec<(f64, f64)> = noise(2 * seed + 1, 30)
                .zip(noise(2 * seed + 2, 30))
                .map(|(b, a)| (10.0 + b, 5.0 + a))
                .collect();
            let [low, high] = ratio_interval_95(&blocks, seed);
            low <= 0.5 && 0.5 <= high
        };
        let covered = (0..200).filter(|seed| covers(*seed)).count();
        assert!((178..=198).contains(&covered), "{covered} of 200");
    }

    #[test]
    fn equal_blocks_have_an_interval_of_one_point_and_no_block_has_none() {
        assert_eq!(ratio_interval_95(&[(4.0, 1.0); 5], 7), [0.25; 2]);
        assert!(ratio_interval_95(&[], 7).iter().all(|end| end.is_nan()));
    }

    #[test]
    fn the_same_seed_gives_the_same_interval() {
        let blocks: Vec<(f64, f64)> = noise(5, 12).map(|x| (10.0 + x, 3.0 - x)).collect();
        assert_eq!(ratio_interval_95(&blocks, 1), ratio_interval_95(&blocks, 1));
        assert_ne!(ratio_interval_95(&blocks, 1), ratio_interval_95(&blocks, 2));
    }
}
