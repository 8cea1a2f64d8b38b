//! Blocks of rows: what of a series counts as independent evidence.
//!
//! ```text
//! S_b = sum over block b of g r      block length max(least, 5 correlation times of g r)
//! B >= 20:  t = mean S / (sd S / sqrt B), p from Student's t with B - 1 degrees of freedom
//! B <  20:  p = share of the sign flips of the S_b that reach |sum S_b|
//! several tests, the least p first:  of t's Holm's correction;  of sign flips Westfall and Young's: the share of
//!           flips under which any of the tests that are left has a p this small (their min P, step down)
//! ```
//!
//! Samples of a residual are not independent, and tests that take them for it find effects in coloured noise every time.
//! Sums over blocks that are long against the correlation nearly are. With few blocks their distribution cannot be relied on
//! either, but under the hypothesis each sum could as well have had the other sign. Westfall and Young (1993), Resampling-Based
//! Multiple Testing, section 2.6: since all tests are flipped together, those that say the same count once.

use super::rows::Rows;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Correlation times in a block.
const CORRELATION_TIMES: f64 = 5.0;
/// Blocks from which Student's distribution is good enough.
const MANY: usize = 20;
/// Up to so many blocks all sign flips are tried, 2^(B - 1) of them.
const EXACT: usize = 14;
/// Sign flips drawn where there are more.
const DRAWN: u32 = 16_384;
/// Step of the series that the correlation time is taken from, s.
const COARSE_S: f64 = 0.02;
/// Longest correlation time that is looked for, as a share of a run.
const LONGEST_SHARE: f64 = 0.5;

/// Rows in blocks.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Blocks {
    /// Block of each row.
    of_row: Vec<usize>,
    count: usize,
}

impl Blocks {
    /// Blocks of about `length_s` within the runs of `rows`; a run shorter than half of that goes with its neighbour.
    pub(super) fn new(rows: &Rows, length_s: f64) -> Self {
        let mut of_row = Vec::with_capacity(rows.len());
        let mut count: usize = 0;
        for run in rows.runs() {
            let times: Vec<f64> = run.times_s().collect();
            let (Some(first), Some(last)) = (times.first(), times.last()) else { continue };
            let span_s = last - first;
            let here = (span_s / length_s).round() as usize;
            if here == 0 {
                count = count.max(1);
                of_row.extend(times.iter().map(|_| count - 1));
                continue;
            }
            let block =
                |time: &f64| count + ((time - first) / span_s * here as f64).min(here as f64 - 1.0) as usize;
            of_row.extend(times.iter().map(block));
            count += here;
        }
        Self { of_row, count }
    }

    /// Blocks of `least_s` at least that are long against the correlation of `series`.
    pub(super) fn against(rows: &Rows, series: &[f64], least_s: f64) -> Self {
        Self::new(rows, least_s.max(CORRELATION_TIMES * correlation_time_s(rows, series)))
    }

    /// Number of blocks.
    pub(super) const fn count(&self) -> usize {
        self.count
    }

    /// Sums of the products of `a` and `b`, block by block.
    pub(super) fn sums(&self, a: &[f64], b: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; self.count];
        for ((a, b), block) in a.iter().zip(b).zip(&self.of_row) {
            sums[*block] += a * b;
        }
        sums
    }
}

/// Integrated autocorrelation time of `series`, the longest of all runs', s: one over the rate at which independent values
/// come.
fn correlation_time_s(rows: &Rows, series: &[f64]) -> f64 {
    let mut longest_s = 0.0_f64;
    for run in rows.runs() {
        let coarse = coarse(&run.times_s().collect::<Vec<_>>(), &series[run.range.clone()]);
        let mean = coarse.iter().sum::<f64>() / coarse.len().max(1) as f64;
        let deviation: Vec<f64> = coarse.iter().map(|value| value - mean).collect();
        let power = super::rows::dot(&deviation, &deviation);
        let lags = (LONGEST_SHARE * deviation.len() as f64) as usize;
        let mut sum = 0.5;
        for lag in 1..lags {
            let correlation = super::rows::dot(&deviation[lag..], &deviation) / power;
            // From here on it is noise about zero.
            if correlation.is_nan() || correlation <= 0.0 {
                break;
            }
            sum += correlation;
        }
        longest_s = longest_s.max(2.0 * sum * COARSE_S);
    }
    longest_s
}

/// Means of `values` over steps of [`COARSE_S`]; steps without a row are left out.
fn coarse(times_s: &[f64], values: &[f64]) -> Vec<f64> {
    let mut means = Vec::new();
    let (mut step, mut sum, mut count) = (i64::MIN, 0.0, 0_u32);
    for (time_s, value) in times_s.iter().zip(values) {
        let here = (time_s / COARSE_S) as i64;
        if here != step {
            if count > 0 {
                means.push(sum / f64::from(count));
            }
            (step, sum, count) = (here, 0.0, 0);
        }
        sum += value;
        count += 1;
    }
    if count > 0 {
        means.push(sum / f64::from(count));
    }
    means
}

/// Sign flips of so many blocks: all of them, each with its mirror image as one, or as many as are worth drawing.
struct Flips {
    blocks: usize,
    drawn: Vec<u64>,
}

impl Flips {
    fn new(blocks: usize, seed: u64) -> Self {
        if blocks <= EXACT {
            // The sign of the first is fixed: a flip of all changes nothing.
            return Self {
                blocks,
                drawn: (0..1_u64 << blocks.saturating_sub(1)).map(|flips| flips << 1).collect(),
            };
        }
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        // None at all is one of them.
        let drawn = std::iter::once(0).chain((1..DRAWN).map(|_| random.random())).collect();
        Self { blocks, drawn }
    }

    /// T of `sums` under each flip; the first is T as it is.
    fn statistics(&self, sums: &[f64]) -> Vec<f64> {
        let size = sums.iter().map(|s| s * s).sum::<f64>().sqrt();
        let flipped = |flips: &u64| {
            let signed = (0..self.blocks).map(|b| if flips >> b & 1 == 1 { -sums[b] } else { sums[b] });
            // Rounding must not part a flip from its mirror image.
            (signed.sum::<f64>().abs() / size * 1e12).round() / 1e12
        };
        if size > 0.0 { self.drawn.iter().map(flipped).collect() } else { vec![0.0; self.drawn.len()] }
    }
}

/// Probability that block sums this far from zero in the mean come about by chance; 1 for fewer than two blocks.
pub(super) fn p_of(sums: &[f64], seed: u64) -> f64 {
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

/// The p of several tests, each of its block sums, so that the chance that any is below a bound where all hypotheses hold is at
/// most that bound.
///
/// Each test is a member of the family of its number of blocks, whose sums can be flipped together. What families add to the chance
/// is summed; one whose blocks are too few to reach such a p adds nothing.
pub(super) fn adjusted(tests: &[&[f64]], seed: u64) -> Vec<f64> {
    let p: Vec<f64> = tests.iter().map(|sums| p_of(sums, seed)).collect();
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

/// Tests whose sums are over the same few blocks.
struct Family {
    /// Index of each, with its p under every flip.
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

    /// Share of the flips under which any of the members that are left has a p of `p` or less.
    fn reaches(&self, p: f64, left: &[bool]) -> f64 {
        let any = |flip: &usize| self.members.iter().any(|(k, own)| left[*k] && own[*flip] <= p);
        (0..self.flips).filter(any).count() as f64 / self.flips as f64
    }
}

/// Of each value the share of all that are no smaller.
fn shares(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let no_smaller = |value: &f64| sorted.partition_point(|other| other >= value);
    values.iter().map(|value| no_smaller(value) as f64 / values.len() as f64).collect()
}

/// The least p that so many blocks can give.
pub(super) fn least_p(blocks: usize) -> f64 {
    match blocks {
        0 | 1 => 1.0,
        2..=EXACT => 1.0 / f64::from(1_u32 << (blocks - 1)),
        b if b < MANY => 1.0 / f64::from(DRAWN),
        _ => 0.0,
    }
}

/// Half the width of the 95 % interval of a mean, in its standard errors, from so many blocks.
pub(super) fn t95(blocks: usize) -> f64 {
    let degrees = blocks.saturating_sub(1).max(1) as f64;
    StudentsT::new(0.0, 1.0, degrees).map_or(f64::INFINITY, |t| t.inverse_cdf(0.975))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_pcg::Pcg64Mcg;

    #[test]
    fn many_blocks_are_corrected_as_holm_did() {
        // Three tests of 30 blocks: the least p counts three times, the next twice, and none less than the one before.
        let sums =
            |mean: f64| -> Vec<f64> { (0..30).map(|k| mean + if k % 2 == 0 { 1.0 } else { -1.0 }).collect() };
        let tests = [sums(0.4), sums(0.6), sums(0.41)];
        let tests: Vec<&[f64]> = tests.iter().map(Vec::as_slice).collect();
        let p: Vec<f64> = tests.iter().map(|sums| p_of(sums, 0)).collect();
        let wanted = [(2.0 * p[2]).max(p[0]), 3.0 * p[1], 2.0 * p[2]];
        for (found, wanted) in adjusted(&tests, 0).iter().zip(wanted) {
            assert!((found - wanted).abs() < 1e-12, "{found} {wanted}");
        }
        assert!(p[1] < p[2] && p[2] < p[0] && p[0] < 2.0 * p[2]);
    }

    #[test]
    fn coarse_steps_are_means_of_the_rows_in_them() {
        // Four rows a step, none in the third, and a step that ends early.
        let row = |k: usize| COARSE_S * (k as f64 + 0.5) / 4.0;
        let times: Vec<f64> = (0..8).chain(12..14).map(row).collect();
        let values: Vec<f64> = (0..10).map(|k| (k * k) as f64).collect();
        assert_eq!(coarse(&times, &values), [3.5, 31.5, 72.5]);
        assert!(coarse(&[], &[]).is_empty());
    }

    #[test]
    fn p_is_what_it_says_it_is() {
        // Sums about zero: p is uniform, whatever the number of blocks.
        let mut random = Pcg64Mcg::seed_from_u64(7);
        for blocks in [8, 12, 17, 40] {
            let below = (0..1000).filter(|draw| {
                let sums: Vec<f64> =
                    (0..blocks).map(|_| (0..6).map(|_| random.random_range(-1.0..1.0)).sum()).collect();
                p_of(&sums, *draw) <= 0.05
            });
            // Within three standard deviations; the exact test is discrete and may fall short.
            let share = below.count() as f64 / 1000.0;
            assert!((0.025..0.071).contains(&share), "{blocks} blocks: {share}");
        }
    }

    #[test]
    fn of_many_tests_on_nothing_one_in_twenty_families_errs() {
        // Six tests at once, some of them nearly one: the chance of any false alarm in a family stays at its bound.
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
                adjusted(&tests, *family).iter().any(|p| *p <= 0.05)
            });
            let share = families.count() as f64 / 600.0;
            assert!((0.01..0.078).contains(&share), "{blocks} blocks: {share}");
        }
    }

    #[test]
    fn tests_that_say_the_same_count_once_and_those_that_cannot_speak_not_at_all() {
        let (plain, noisy) = ([1.0; 10], [1.0, -1.0, 1.0, -1.0, 0.5, -0.7, 1.0, -1.0, 0.2, -0.1]);
        let first = |others: &[&[f64]]| adjusted(&[&[&plain[..]], others].concat(), 0)[0] * 512.0;
        assert_eq!(first(&[&noisy, &noisy]), 2.0);
        assert_eq!(first(&[&[0.0; 10], &[0.0; 10]]), 1.0);
        // Eight blocks reach no p of 1/512 under any flip; those of a t count as they are.
        assert_eq!(first(&[&noisy[..8], &noisy[..8]]), 1.0);
        let dull: Vec<f64> = (0..30).map(|k| if k % 2 == 0 { 1.0 } else { -0.9 }).collect();
        assert_eq!(first(&[&dull, &noisy]), 3.0);
        let silent = adjusted(&[&plain, &noisy], 0)[1];
        assert!(silent > 0.5, "{silent}");
    }

    #[test]
    fn few_blocks_cannot_say_much() {
        assert_eq!(p_of(&[1.0; 10], 0), least_p(10));
        assert_eq!(least_p(10), 1.0 / 512.0);
        assert_eq!(p_of(&[1.0], 0), 1.0);
        assert_eq!(p_of(&[0.0; 30], 0), 1.0);
        assert!(p_of(&[1.0; 17], 0) < 1e-3);
        assert!((t95(10) - 2.262_157).abs() < 1e-5);
    }
}
