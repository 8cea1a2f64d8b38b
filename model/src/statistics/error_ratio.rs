//! The interval of the error ratio on test runs: squared error after, divided by squared error before.
//!
//! ```text
//! d_b(q)   = A_b - q B_b            A_b, B_b: squared error of block b after and before, b = 1 .. n
//! T(q)     = sum d_b / sqrt(n s^2)  s^2 = sum (d_b - mean d)^2 / (n - 1), over (1 - tau / L)
//! interval = { q : |T(q)| <= t }    t: 98 % quantile of Student's t with n - 1 degrees of freedom
//! L        = max(6 tau, share total / 10, 0.8 s)     length of a block, with the largest share of 1, 0.95, ... 0.8 that gives
//!            n = 8 blocks or more; if none does, there is no interval
//! tau      = 1 + 2 sum of the autocorrelations of w, up to the first that is not positive
//! w        = s (m - beta s)         s = r_before - r_after,  m = (r_before + r_after) / 2,  beta = sum s m / sum s^2
//! ```
//!
//! The interval is Fieller's: the set of ratios that a t test on block sums does not reject. The base is better or worse on the same
//! samples, so both errors are compared block by block. A t test on few block sums keeps its level when the blocks differ in variance:
//! Student's quantile is conservative for normal variables of unequal variance, at any number of blocks. This holds for a level of
//! 5 % (Bakirov and Székely; Ibragimov and Müller).
//!
//! The difference of the squared errors is d(1) = -2 s m, and s is known: it is what the effects change in the simulation. Without a true
//! change m is independent of s, with beta = 0. So chance is in w, and its correlation time counts. An effect that is slow by
//! itself, such as a drift, makes d slow but not w.
//!
//! The blocks are as long as the data allow, because a correlation time that is estimated on a short run is too short. If the
//! autocorrelation decays exponentially, sums over blocks of length L show the share 1 - tau / 2 L of the long-run variance. The divisor
//! (1 - tau / L) takes tau twice as long as estimated.
//!
//! Source: `[fieller1954]`, `[bakirov2005]` and `[ibragimov2010]` in the bibliography (node/docs/guide/bibliography.md).

use statrs::distribution::{ContinuousCDF, StudentsT};
use thiserror::Error;

/// Least length of a block, in correlation times.
const CORRELATION_TIMES: f64 = 6.0;
/// Least number of blocks for which an interval is given. With 6 blocks, an error that changes with the level of the current gave an
/// interval below one in 10 % of the runs without a change.
const LEAST_BLOCKS: usize = 8;
/// Largest number of blocks: more blocks hardly narrow the interval, and longer blocks are safer. With up to 20 blocks, residuals with a
/// slow part that white noise hides gave an interval below one in 6 % of the runs without a change.
const MOST_BLOCKS: f64 = 10.0;
/// Lengths of a block that are tried, as shares of a tenth of the motion.
const LENGTHS: [f64; 5] = [1.0, 0.95, 0.9, 0.85, 0.8];
/// Least length of a block, s.
const LEAST_S: f64 = 0.8;
/// Quantile of Student's t. The nominal quantile of a 95 % interval, 97.5 %, is not enough: the sums are skewed if the error changes with
/// the level of the current. Then the interval was below one in 4.1 % of the runs without a change.
const QUANTILE: f64 = 0.98;
/// Step of the series that the correlation time is computed from, s.
const COARSE_S: f64 = 0.02;
/// Longest lag of the autocorrelation, as a share of the longest run.
const LONGEST_SHARE: f64 = 0.5;

/// Why the error ratio has no interval.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum NoInterval {
    /// The test runs hold fewer independent blocks than an interval needs.
    #[error(
        "the test runs hold {seconds:.1} s of motion, which is {blocks} independent blocks of {block_s:.2} s, but an interval needs 8: \
         give at least {needed_s:.0} s of motion"
    )]
    TooShort {
        /// Motion in the test runs, s.
        seconds: f64,
        /// Number of blocks in it.
        blocks: usize,
        /// Length of a block, s.
        block_s: f64,
        /// Motion that is needed, s: a lower bound, because longer runs can show a longer correlation time.
        needed_s: f64,
    },
    /// Most of the squared error of the base is in few blocks.
    #[error(
        "most of the squared error of the base lies in few of the {blocks} blocks of {block_s:.2} s, so the ratio has no bounded \
         interval: give at least {needed_s:.0} s of motion, with the same excitation throughout"
    )]
    Uneven {
        /// Number of blocks.
        blocks: usize,
        /// Length of a block, s.
        block_s: f64,
        /// Motion that is needed if further blocks are as unequal, s.
        needed_s: f64,
    },
    /// The base has no error on the test runs.
    #[error("the error of the base on the test runs is zero, so a ratio cannot be computed")]
    NoError,
}

impl NoInterval {
    /// Motion that an interval needs, s; `None` if no length of runs would help.
    #[must_use]
    pub const fn needed_s(&self) -> Option<f64> {
        match self {
            Self::TooShort { needed_s, .. } | Self::Uneven { needed_s, .. } => Some(*needed_s),
            Self::NoError => None,
        }
    }
}

/// Residuals of one run, N.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Residuals {
    /// Time between two values, s.
    pub(crate) step_s: f64,
    /// Residual before.
    pub(crate) before: Vec<f64>,
    /// Residual after, at the same times.
    pub(crate) after: Vec<f64>,
}

impl Residuals {
    const fn seconds(&self) -> f64 {
        self.before.len() as f64 * self.step_s
    }

    /// The change by the effects, s, and the mean residual, m, of each sample.
    fn changes(&self) -> impl Iterator<Item = (f64, f64)> {
        self.before.iter().zip(&self.after).map(|(before, after)| (before - after, 0.5 * (before + after)))
    }
}

/// The ratio of the squared errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ErrorRatio {
    /// Squared error after, divided by squared error before.
    pub(crate) ratio: f64,
    /// 95 % interval of the ratio, or why there is none.
    pub(crate) ci95: Result<[f64; 2], NoInterval>,
    /// Number of blocks.
    pub(crate) blocks: usize,
    /// Mean length of a block, s.
    pub(crate) block_s: f64,
}

/// The ratio of the squared errors of `runs`, with blocks of at least `least_s` if that is longer than the data require.
#[must_use]
pub(crate) fn error_ratio(runs: &[Residuals], least_s: Option<f64>) -> ErrorRatio {
    let square = |of: fn(&Residuals) -> &[f64]| runs.iter().flat_map(of).map(|r| r * r).sum::<f64>();
    let (before, after) = (square(|run| &run.before), square(|run| &run.after));
    let (ratio, seconds) = (after / before, runs.iter().map(Residuals::seconds).sum::<f64>());
    if before <= 0.0 {
        return ErrorRatio { ratio, ci95: Err(NoInterval::NoError), blocks: 0, block_s: 0.0 };
    }
    let tau_s = correlation_time_s(runs);
    let needed_s = LEAST_S.max(least_s.unwrap_or(0.0)).max(CORRELATION_TIMES * tau_s);
    let (length_s, blocks) = blocks(runs, needed_s, seconds / MOST_BLOCKS);
    let n = blocks.len() as f64;
    let block_s = seconds / n.max(1.0);
    let done = |ci95| ErrorRatio { ratio, ci95, blocks: blocks.len(), block_s };
    if blocks.len() < LEAST_BLOCKS {
        let needed_s = (LEAST_BLOCKS as f64 * needed_s).ceil();
        return done(Err(NoInterval::TooShort {
            seconds,
            blocks: blocks.len(),
            block_s: length_s,
            needed_s,
        }));
    }
    let shown = 1.0 - tau_s / block_s;
    let squared_t =
        StudentsT::new(0.0, 1.0, n - 1.0).map_or(f64::INFINITY, |t| t.inverse_cdf(QUANTILE)).powi(2);
    let (mean_before, mean_after) = (before / n, after / n);
    let product = |of: fn(f64, f64) -> f64| {
        let sum = blocks.iter().map(|[b, a]| of(b - mean_before, a - mean_after)).sum::<f64>();
        squared_t * n * sum / ((n - 1.0) * shown)
    };
    // (after - q before)^2 <= t^2 n s^2(q) is a quadratic inequality in q.
    let square = before * before - product(|b, _| b * b);
    let middle = after * before - product(|b, a| a * b);
    let constant = after * after - product(|_, a| a * a);
    if square <= 0.0 {
        let needed_s = (seconds * (1.0 - square / (before * before))).ceil();
        return done(Err(NoInterval::Uneven { blocks: blocks.len(), block_s, needed_s }));
    }
    let half = (middle * middle - square * constant).max(0.0).sqrt();
    done(Ok([((middle - half) / square).max(0.0), (middle + half) / square]))
}

/// Length of a block, at least `needed_s` and as close to `longest_s` as gives enough blocks, s, and the sums over the blocks. Whole runs
/// that are a little shorter than a block are joined in pairs, which can halve the number of blocks.
fn blocks(runs: &[Residuals], needed_s: f64, longest_s: f64) -> (f64, Vec<[f64; 2]>) {
    let of = |share: &f64| {
        let length_s = needed_s.max(share * longest_s);
        (length_s, block_sums(runs, length_s))
    };
    let enough = |(_, blocks): &(f64, Vec<[f64; 2]>)| blocks.len() >= LEAST_BLOCKS;
    LENGTHS.iter().map(of).find(enough).unwrap_or_else(|| of(&LENGTHS[0]))
}

/// Sums of the squared errors before and after over blocks of at least `length_s`, each within one run. Whole runs that are shorter are
/// joined until they are long enough.
fn block_sums(runs: &[Residuals], length_s: f64) -> Vec<[f64; 2]> {
    let add = |sums: &mut [f64; 2], more: [f64; 2]| {
        sums[0] += more[0];
        sums[1] += more[1];
    };
    let mut blocks: Vec<[f64; 2]> = Vec::new();
    let (mut joined, mut joined_s) = ([0.0; 2], 0.0);
    for run in runs {
        let count = (run.seconds() / length_s + 1e-9) as usize;
        if count == 0 {
            add(&mut joined, [super::dot(&run.before, &run.before), super::dot(&run.after, &run.after)]);
            joined_s += run.seconds();
            if joined_s >= length_s {
                blocks.push(std::mem::take(&mut joined));
                joined_s = 0.0;
            }
            continue;
        }
        let first = blocks.len();
        blocks.resize(first + count, [0.0; 2]);
        for (k, (before, after)) in run.before.iter().zip(&run.after).enumerate() {
            add(&mut blocks[first + k * count / run.before.len()], [before * before, after * after]);
        }
    }
    if joined_s > 0.0 {
        match blocks.last_mut() {
            Some(last) => add(last, joined),
            None => blocks.push(joined),
        }
    }
    blocks
}

/// Integrated autocorrelation time of w over all runs, s.
fn correlation_time_s(runs: &[Residuals]) -> f64 {
    let changes = || runs.iter().flat_map(Residuals::changes);
    let beta = changes().map(|(s, m)| s * m).sum::<f64>() / changes().map(|(s, _)| s * s).sum::<f64>();
    let (mut deviations, mut step_s, mut longest) = (Vec::new(), 0.0_f64, 0);
    for run in runs {
        let every = ((COARSE_S / run.step_s).round() as usize).max(1);
        let series: Vec<f64> = run.changes().map(|(s, m)| s * (m - beta * s)).collect();
        let means: Vec<f64> =
            series.chunks(every).map(|part| part.iter().sum::<f64>() / part.len() as f64).collect();
        let mean = means.iter().sum::<f64>() / means.len().max(1) as f64;
        step_s = step_s.max(every as f64 * run.step_s);
        longest = longest.max(means.len());
        deviations.push(means.iter().map(|value| value - mean).collect::<Vec<f64>>());
    }
    let at_lag = |lag: usize| {
        let product = |run: &Vec<f64>| super::dot(run.get(lag..).unwrap_or_default(), run);
        deviations.iter().map(product).sum::<f64>()
    };
    let power = at_lag(0);
    let mut sum = 0.5;
    for lag in 1..(LONGEST_SHARE * longest as f64) as usize {
        let correlation = at_lag(lag) / power;
        // The rest of the autocorrelation is noise about zero.
        if correlation.is_nan() || correlation <= 0.0 {
            break;
        }
        sum += correlation;
    }
    2.0 * sum * step_s
}

#[cfg(test)]
mod tests;
