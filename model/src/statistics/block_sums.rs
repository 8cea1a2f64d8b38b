//! Significance tests on block sums, and the correction for several tests.
//!
//! ```text
//! B >= 20:  t = mean S / (sd S / sqrt B), p from Student's t with B - 1 degrees of freedom
//! B <  20:  p = share of the sign flips of the S_b that reach |sum S_b|
//! several tests, the least p first:  t tests: Holm's correction;  sign flips: Westfall and Young's, the share of
//!           flips under which any of the remaining tests has a p this small (their step-down min P)
//! ```
//!
//! S_b is the sum of a series over block b of B blocks. Sums over blocks much longer than the correlation time are nearly independent.
//! With few blocks their distribution is not reliable either; but under the null hypothesis each sum could equally have the other
//! sign. All tests are flipped together, so correlated tests are not counted several times: Westfall and Young (1993),
//! Resampling-Based Multiple Testing, section 2.6.
//!
//! Source: `[student]`, `[holm]` and `[westfall1993]` in the bibliography (node/docs/guide/bibliography.md).

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Number of blocks from which Student's t distribution is used.
const MANY: usize = 20;
/// Largest number of blocks for which all 2^(B - 1) sign flips are tried.
const EXACT: usize = 14;
/// Number of sign flips drawn at random for more blocks.
const DRAWN: u32 = 16_384;

/// Sign flips of the sums of `blocks` blocks: all of them, with a flip and its mirror image counted as one, or [`DRAWN`] at random.
struct Flips {
    blocks: usize,
    drawn: Vec<u64>,
}

impl Flips {
    fn new(blocks: usize, seed: u64) -> Self {
        if blocks <= EXACT {
            // The sign of the first sum is fixed, because flipping all signs does not change |T|.
            return Self {
                blocks,
                drawn: (0..1_u64 << blocks.saturating_sub(1)).map(|flips| flips << 1).collect(),
            };
        }
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        // The first flip changes no sign.
        let drawn = std::iter::once(0).chain((1..DRAWN).map(|_| random.random())).collect();
        Self { blocks, drawn }
    }

    /// |sum| of `sums` over their root sum of squares, under each flip; the first value is without a flip.
    fn statistics(&self, sums: &[f64]) -> Vec<f64> {
        let size = sums.iter().map(|s| s * s).sum::<f64>().sqrt();
        let flipped = |flips: &u64| {
            let signed = (0..self.blocks).map(|b| if flips >> b & 1 == 1 { -sums[b] } else { sums[b] });
            // A flip and its mirror image must give the same value in spite of rounding.
            (signed.sum::<f64>().abs() / size * 1e12).round() / 1e12
        };
        if size > 0.0 { self.drawn.iter().map(flipped).collect() } else { vec![0.0; self.drawn.len()] }
    }
}

/// Probability that the mean of block sums is this far from zero by chance; 1 for fewer than two blocks.
#[must_use]
pub(crate) fn p_value(sums: &[f64], seed: u64) -> f64 {
    let blocks = sums.len();
    if blocks < 2 || !sums.iter().all(|s| s.is_finite()) || sums.iter().all(|s| *s == 0.0) {
        return 1.0;
    }
    if blocks >= MANY {
        let mean = sums.iter().sum::<f64>() / blocks as f64;
        let squares = sums.iter().map(|s| (s - mean) * (s - mean)).sum::<f64>();
        let error = (squares / (blocks as f64 * (blocks as f64 - 1.0))).sqrt();
        return 2.0
            * StudentsT::new(0.0, 1.0, blocks as f64 - 1.0).map_or(0.5, |t| t.sf((mean / error).abs()));
    }
    let statistics = Flips::new(blocks, seed).statistics(sums);
    statistics.iter().filter(|t| **t >= statistics[0]).count() as f64 / statistics.len() as f64
}

/// Adjusted p of several tests, each given by its block sums: if all null hypotheses hold, the probability that any adjusted p is below
/// a bound is at most that bound.
///
/// Tests with the same number of blocks form a family, whose sums are flipped together. The probabilities of the families are added; a
/// family with too few blocks to reach such a p adds nothing.
#[must_use]
pub(crate) fn adjusted_p_values(tests: &[&[f64]], seed: u64) -> Vec<f64> {
    let p: Vec<f64> = tests.iter().map(|sums| p_value(sums, seed)).collect();
    let mut counts: Vec<usize> =
        tests.iter().map(|sums| sums.len()).filter(|c| (2..MANY).contains(c)).collect();
    counts.sort_unstable();
    counts.dedup();
    let families: Vec<Family> = counts.iter().map(|count| Family::new(tests, *count, seed)).collect();
    let many: Vec<usize> = (0..tests.len()).filter(|k| tests[*k].len() >= MANY).collect();
    let mut order: Vec<usize> = (0..tests.len()).collect();
    order.sort_by(|a, b| p[*a].total_cmp(&p[*b]));
    let (mut adjusted, mut left, mut largest) = (vec![1.0; tests.len()], vec![true; tests.len()], 0.0_f64);
    for test in order {
        let of_many = many.iter().filter(|k| left[**k]).count() as f64 * p[test];
        let of_few = families.iter().map(|family| family.reaches(p[test], &left)).sum::<f64>();
        largest = largest.max(of_many + of_few).max(p[test]).min(1.0);
        adjusted[test] = largest;
        left[test] = false;
    }
    adjusted
}

/// Tests with the same number of blocks, fewer than [`MANY`].
struct Family {
    /// Index of each test, with its p under every flip.
    members: Vec<(usize, Vec<f64>)>,
    flips: usize,
}

impl Family {
    /// The family of `count` blocks.
    fn new(tests: &[&[f64]], count: usize, seed: u64) -> Self {
        let flips = Flips::new(count, seed);
        let of_count = (0..tests.len()).filter(|k| tests[*k].len() == count);
        let members = of_count.map(|k| (k, shares(&flips.statistics(tests[k])))).collect();
        Self { members, flips: flips.drawn.len() }
    }

    /// Share of the flips under which any of the remaining members has a p of `p` or less.
    fn reaches(&self, p: f64, left: &[bool]) -> f64 {
        let any = |flip: &usize| self.members.iter().any(|(k, own)| left[*k] && own[*flip] <= p);
        (0..self.flips).filter(any).count() as f64 / self.flips as f64
    }
}

/// For each value, the share of all values that are at least as large.
fn shares(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let no_smaller = |value: &f64| sorted.partition_point(|other| other >= value);
    values.iter().map(|value| no_smaller(value) as f64 / values.len() as f64).collect()
}

/// The least p that this number of blocks can give.
#[must_use]
pub(crate) fn least_p(blocks: usize) -> f64 {
    match blocks {
        0 | 1 => 1.0,
        2..=EXACT => 1.0 / f64::from(1_u32 << (blocks - 1)),
        b if b < MANY => 1.0 / f64::from(DRAWN),
        _ => 0.0,
    }
}

/// Half the width of the 95 % interval of a mean over `blocks` blocks, in standard errors.
#[must_use]
pub(crate) fn t95(blocks: usize) -> f64 {
    let degrees = blocks.saturating_sub(1).max(1) as f64;
    StudentsT::new(0.0, 1.0, degrees).map_or(f64::INFINITY, |t| t.inverse_cdf(0.975))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tests_of_many_blocks_get_holms_correction() {
        // Three tests of 30 blocks: the least p is multiplied by 3, the next by 2, and an adjusted p is never below the one before it.
        let sums =
            |mean: f64| -> Vec<f64> { (0..30).map(|k| mean + if k % 2 == 0 { 1.0 } else { -1.0 }).collect() };
        let tests = [sums(0.4), sums(0.6), sums(0.41)];
        let tests: Vec<&[f64]> = tests.iter().map(Vec::as_slice).collect();
        let p: Vec<f64> = tests.iter().map(|sums| p_value(sums, 0)).collect();
        let expected = [(2.0 * p[2]).max(p[0]), 3.0 * p[1], 2.0 * p[2]];
        for (found, expected) in adjusted_p_values(&tests, 0).iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert!(p[1] < p[2] && p[2] < p[0] && p[0] < 2.0 * p[2]);
    }

    #[test]
    fn p_is_uniform_under_the_null_hypothesis() {
        // Sums with mean zero: p is uniform for any number of blocks.
        let mut random = Pcg64Mcg::seed_from_u64(7);
        for blocks in [8, 12, 17, 40] {
            let below = (0..1000).filter(|draw| {
                let sums: Vec<f64> =
                    (0..blocks).map(|_| (0..6).map(|_| random.random_range(-1.0..1.0)).sum()).collect();
                p_value(&sums, *draw) <= 0.05
            });
            // Within three standard deviations of 0.05; the exact test is discrete and may be below it.
            let share = below.count() as f64 / 1000.0;
            assert!((0.025..0.071).contains(&share), "{blocks} blocks: {share}");
        }
    }

    #[test]
    fn family_wise_error_rate_stays_at_its_bound() {
        // Six tests at once, three of them strongly correlated: the probability of any false alarm stays at the bound of 5 %.
        let mut random = Pcg64Mcg::seed_from_u64(11);
        for blocks in [10, 30] {
            let families = (0..600).filter(|family| {
                let common: Vec<f64> = (0..blocks).map(|_| random.random_range(-1.0..1.0)).collect();
                let tests: Vec<Vec<f64>> = (0..6)
                    .map(|k| {
                        let own = if k < 3 { 0.1 } else { 3.0 };
                        common.iter().map(|c| c + own * random.random_range(-1.0..1.0)).collect()
                    })
                    .collect();
                let tests: Vec<&[f64]> = tests.iter().map(Vec::as_slice).collect();
                adjusted_p_values(&tests, *family).iter().any(|p| *p <= 0.05)
            });
            let share = families.count() as f64 / 600.0;
            assert!((0.01..0.078).contains(&share), "{blocks} blocks: {share}");
        }
    }

    #[test]
    fn correlated_tests_count_once_and_tests_without_power_not_at_all() {
        let (plain, noisy) = ([1.0; 10], [1.0, -1.0, 1.0, -1.0, 0.5, -0.7, 1.0, -1.0, 0.2, -0.1]);
        let first = |others: &[&[f64]]| adjusted_p_values(&[&[&plain[..]], others].concat(), 0)[0] * 512.0;
        assert_eq!(first(&[&noisy, &noisy]), 2.0);
        assert_eq!(first(&[&[0.0; 10], &[0.0; 10]]), 1.0);
        // Eight blocks cannot reach a p of 1/512 under any flip. A t test is counted by Holm's correction.
        assert_eq!(first(&[&noisy[..8], &noisy[..8]]), 1.0);
        let dull: Vec<f64> = (0..30).map(|k| if k % 2 == 0 { 1.0 } else { -0.9 }).collect();
        assert_eq!(first(&[&dull, &noisy]), 3.0);
        let silent = adjusted_p_values(&[&plain, &noisy], 0)[1];
        assert!(silent > 0.5, "{silent}");
    }

    #[test]
    fn p_is_bounded_from_below_for_few_blocks() {
        assert_eq!(p_value(&[1.0; 10], 0), least_p(10));
        assert_eq!(least_p(10), 1.0 / 512.0);
        assert_eq!(p_value(&[1.0], 0), 1.0);
        assert_eq!(p_value(&[0.0; 30], 0), 1.0);
        assert!(p_value(&[1.0; 17], 0) < 1e-3);
        assert!((t95(10) - 2.262_157).abs() < 1e-5);
    }
}
