//! Calibration of the interval on generated residuals, and its parts.
//!
//! `MR_DAMPER_LONG=1 cargo test --release -p mr-damper-model --lib error_ratio -- --nocapture` draws 20 times as many runs and prints the
//! rates.

use super::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Time between two values, s.
const STEP_S: f64 = 0.01;
/// Correlation of the residuals before and after.
const ALIKE: f64 = 0.7;
/// Largest rate of runs without a true change whose interval is below one.
const FALSE_RATE: f64 = 0.035;

/// Lengths of the test runs, s.
const SECONDS: [f64; 5] = [3.0, 6.0, 12.0, 30.0, 90.0];

/// How the residual is distributed.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Residual {
    /// A normal AR(1) process.
    Normal,
    /// The same, with an amplitude that the excitation changes from 0.1 to 10 times, correlated over 0.7 s.
    Modulated,
    /// The third power of the AR(1) process is added, which gives a large excess kurtosis.
    HeavyTailed,
    /// An AR(1) process that is added has a quarter of the power and a correlation time of 2 s.
    SlowPart,
    /// At half of the levels of the current the error after is a fifth, at the others the nine-fold; a level lasts for 0.3 to 1.8 s.
    Levels,
}

const RESIDUALS: [Residual; 5] =
    [Residual::Normal, Residual::Modulated, Residual::HeavyTailed, Residual::SlowPart, Residual::Levels];
/// Correlation times of the residual, s. The longest exceed every length of a block.
const CORRELATION_S: [f64; 6] = [0.0, 0.05, 0.2, 0.5, 1.0, 5.0];

/// A stationary AR(1) process of unit variance.
struct Process {
    decay: f64,
    value: f64,
}

fn normal(random: &mut Pcg64Mcg) -> f64 {
    let (size, angle): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - size).ln()).sqrt() * (TAU * angle).cos()
}

impl Process {
    fn new(correlation_s: f64, random: &mut Pcg64Mcg) -> Self {
        let decay = if correlation_s > 0.0 { (-STEP_S / correlation_s).exp() } else { 0.0 };
        Self { decay, value: normal(random) }
    }

    fn next(&mut self, random: &mut Pcg64Mcg) -> f64 {
        self.value = self.decay * self.value + (1.0 - self.decay * self.decay).sqrt() * normal(random);
        self.value
    }
}

/// A run whose true error ratio is `ratio`.
fn run(residual: Residual, correlation_s: f64, seconds: f64, ratio: f64, seed: u64) -> Residuals {
    let random = &mut Pcg64Mcg::seed_from_u64(seed);
    let [mut common, mut own] = [correlation_s; 2].map(|s| Process::new(s, random));
    let [mut slow, mut own_slow, mut size] = [2.0, 2.0, 0.7].map(|s| Process::new(s, random));
    let (mut gain, mut left) = (1.0, 0);
    let other = (1.0 - ALIKE * ALIKE).sqrt();
    let (mut before, mut after) = (Vec::new(), Vec::new());
    for _ in 0..(seconds / STEP_S).round() as usize {
        let mut b = common.next(random);
        let mut a = ALIKE * b + other * own.next(random);
        match residual {
            Residual::Normal => {}
            Residual::Modulated => {
                let size = size.next(random).exp();
                (b, a) = (b * size, a * size);
            }
            Residual::HeavyTailed => (b, a) = (b + 0.3 * b.powi(3), a + 0.3 * a.powi(3)),
            Residual::SlowPart => {
                let slow = slow.next(random);
                b += 0.5 * slow;
                a += 0.5 * (0.5 * slow + 0.75_f64.sqrt() * own_slow.next(random));
            }
            Residual::Levels => {
                if left == 0 {
                    left = (random.random_range(0.3..1.8) / STEP_S) as u32;
                    gain = if random.random_bool(0.5) { 1.8 } else { 0.2 };
                }
                left -= 1;
                a *= f64::sqrt(gain);
            }
        }
        before.push(b);
        after.push(ratio.sqrt() * a);
    }
    Residuals { step_s: STEP_S, before, after }
}

/// Wilson's 95 % interval of a rate.
fn wilson(hits: u32, of: u32) -> [f64; 2] {
    const Z: f64 = 1.959_964;
    let (n, share) = (f64::from(of), f64::from(hits) / f64::from(of));
    let middle = share + Z * Z / (2.0 * n);
    let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
    [middle - half, middle + half].map(|end| end / (1.0 + Z * Z / n))
}

fn is_long() -> bool {
    std::env::var("MR_DAMPER_LONG").as_deref() == Ok("1")
}

/// Number of runs with an interval and of those whose interval is below one, by number of blocks.
type Counts = BTreeMap<usize, (u32, u32)>;

/// Draws `draws` runs of each length and correlation time, without and with a given length of the blocks: 1/1 to 1/30 of the run.
fn counts(residual: Residual, ratio: f64, draws: u32) -> Counts {
    let mut counts = Counts::new();
    for (case, correlation_s) in CORRELATION_S.into_iter().enumerate() {
        for seconds in SECONDS {
            for draw in 0..draws {
                let seed = u64::from(draw) + 1_000_000 * case as u64 + 1_000 * seconds as u64;
                let runs = [run(residual, correlation_s, seconds, ratio, seed)];
                let parts = 1 + draw % 30;
                for least_s in [None, Some(seconds / f64::from(parts))] {
                    let found = error_ratio(&runs, least_s);
                    if let Ok([_, high]) = found.ci95 {
                        assert!((LEAST_BLOCKS..=MOST_BLOCKS as usize).contains(&found.blocks));
                        let count = counts.entry(found.blocks).or_default();
                        count.0 += 1;
                        count.1 += u32::from(high < 1.0);
                    }
                }
            }
        }
    }
    counts
}

fn draws() -> u32 {
    if is_long() { 3000 } else { 150 }
}

#[test]
fn without_a_true_change_the_interval_is_rarely_below_one_at_any_number_of_blocks() {
    let mut all = Counts::new();
    for residual in RESIDUALS {
        let of = counts(residual, 1.0, draws());
        for (blocks, (given, below)) in &of {
            let sum = all.entry(*blocks).or_default();
            *sum = (sum.0 + given, sum.1 + below);
        }
        let (given, below) = of.values().fold((0, 0), |sum, c| (sum.0 + c.0, sum.1 + c.1));
        let [low, high] = wilson(below, given);
        println!("{residual:?}: {below} of {given} below one, {low:.4} to {high:.4}");
        assert!(low <= FALSE_RATE, "{residual:?}: {below} of {given}, Wilson {low} to {high}");
    }
    for (blocks, (given, below)) in all {
        let [low, high] = wilson(below, given);
        let rate = f64::from(below) / f64::from(given);
        println!("{blocks} blocks: {below} of {given} below one, {rate:.4} ({low:.4} to {high:.4})");
        assert!(low <= FALSE_RATE, "{blocks} blocks: {below} of {given}, Wilson {low} to {high}");
        assert!(!is_long() || rate <= FALSE_RATE, "{blocks} blocks: {below} of {given}");
    }
}

#[test]
fn a_halved_error_is_proved_with_ten_blocks_or_more() {
    let (mut given, mut below) = (0, 0);
    for (blocks, count) in counts(Residual::Normal, 0.5, draws() / 5) {
        println!("{blocks} blocks: {} of {} below one", count.1, count.0);
        if blocks >= 10 {
            (given, below) = (given + count.0, below + count.1);
        }
    }
    let [low, _] = wilson(below, given);
    println!("10 blocks or more: {below} of {given}");
    assert!(low >= 0.9, "{below} of {given}");
}

/// A run in which each block of 1 s has these squared errors before and after. Every other value is zero, so the values have no positive
/// correlation.
fn in_blocks(sums: &[[f64; 2]]) -> Residuals {
    let spread =
        |side: usize| sums.iter().flat_map(|sum| [(sum[side] / 25.0).sqrt(), 0.0].repeat(25)).collect();
    Residuals { step_s: COARSE_S, before: spread(0), after: spread(1) }
}

#[test]
fn the_ends_of_the_interval_are_the_ratios_at_which_the_t_test_is_at_its_bound() {
    let sums =
        [[3.0, 1.0], [1.0, 0.4], [4.0, 0.9], [2.0, 0.9], [2.5, 0.7], [1.5, 0.6], [3.5, 1.6], [2.2, 0.4]];
    let found = error_ratio(&[in_blocks(&sums)], Some(1.0));
    assert_eq!(found.blocks, 8);
    let total = |side: usize| sums.iter().map(|sum| sum[side]).sum::<f64>();
    assert!((found.ratio - total(1) / total(0)).abs() < 1e-12);
    let tau_s = correlation_time_s(&[in_blocks(&sums)]);
    let t = |q: f64| {
        let d: Vec<f64> = sums.iter().map(|[before, after]| after - q * before).collect();
        let mean = d.iter().sum::<f64>() / 8.0;
        let variance = d.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / 7.0 / (1.0 - tau_s);
        mean / (variance / 8.0).sqrt()
    };
    let [low, high] = found.ci95.expect("an interval");
    assert!(low < found.ratio && found.ratio < high);
    // The 98 % quantile of Student's t with 7 degrees of freedom, from a table.
    assert!(
        (t(low) - 2.516_752).abs() < 1e-4 && (t(high) + 2.516_752).abs() < 1e-4,
        "{} {}",
        t(low),
        t(high)
    );
}

#[test]
fn short_runs_give_no_interval_but_the_motion_that_is_needed() {
    let short = run(Residual::Normal, 0.2, 4.0, 0.1, 1);
    let found = error_ratio(&[short], Some(1.0));
    let Err(NoInterval::TooShort { seconds, needed_s, blocks, .. }) = found.ci95 else {
        panic!("{found:?}");
    };
    assert!(
        (seconds - 4.0).abs() < 1e-9 && blocks == found.blocks && blocks < LEAST_BLOCKS && needed_s >= 8.0
    );
    let long = error_ratio(&[run(Residual::Normal, 0.2, 2.0 * needed_s, 0.1, 1)], Some(1.0));
    assert!(long.ci95.is_ok_and(|[_, high]| high < 1.0), "{long:?}");
    for runs in [&[][..], &[Residuals { step_s: 0.0, before: vec![1.0], after: vec![1.0] }]] {
        assert!(error_ratio(runs, None).ci95.is_err());
    }
}

#[test]
fn an_error_in_one_block_gives_no_interval_and_no_error_no_ratio() {
    let mut sums = [[0.01, 0.01]; 10];
    sums[4] = [50.0, 5.0];
    let found = error_ratio(&[in_blocks(&sums)], Some(1.0));
    let Err(why @ NoInterval::Uneven { .. }) = found.ci95 else { panic!("{found:?}") };
    assert!(why.needed_s().is_some_and(|s| s > 10.0), "{why}");
    let none = error_ratio(&[in_blocks(&[[0.0, 0.0]; 10])], Some(1.0));
    assert_eq!((none.ci95, NoInterval::NoError.needed_s()), (Err(NoInterval::NoError), None));
}

#[test]
fn the_same_model_before_and_after_has_a_ratio_of_one() {
    let Residuals { before, .. } = run(Residual::Normal, 0.05, 30.0, 1.0, 3);
    let found = error_ratio(&[Residuals { step_s: STEP_S, after: before.clone(), before }], None);
    let [low, high] = found.ci95.expect("an interval");
    assert!((low - 1.0).abs() < 1e-6 && (high - 1.0).abs() < 1e-6, "{found:?}");
}

#[test]
fn blocks_lie_within_runs_and_short_runs_are_joined() {
    let run = |seconds: usize, value: f64| Residuals {
        step_s: STEP_S,
        before: vec![value; seconds * 100],
        after: vec![2.0 * value; seconds * 100],
    };
    // 5 s are two blocks of at least 2 s; two runs of 1 s are one block; the last run is shorter than a block and joins the last.
    let runs = [run(5, 1.0), run(1, 2.0), run(1, 3.0), run(2, 4.0), run(1, 5.0)];
    let before: Vec<f64> = block_sums(&runs, 2.0).iter().map(|sums| sums[0]).collect();
    assert_eq!(before, [250.0, 250.0, 400.0 + 900.0, 3200.0 + 2500.0]);
    assert!(block_sums(&runs, 2.0).iter().all(|[b, a]| 4.0 * b == *a));
    assert_eq!(block_sums(&runs[1..2], 2.0), [[400.0, 1600.0]]);
    assert!(block_sums(&[], 2.0).is_empty());
}

#[test]
fn runs_of_about_a_tenth_of_the_motion_are_a_block_each() {
    // A tenth is 2.93 s. Eight runs are shorter, and joined in pairs they would leave six blocks.
    let runs: Vec<Residuals> = [2.9, 2.8, 2.9, 3.2, 2.9, 2.8, 2.9, 3.1, 2.9, 2.9]
        .into_iter()
        .zip(0..)
        .map(|(seconds, seed)| run(Residual::Normal, 0.05, seconds, 0.1, seed))
        .collect();
    let found = error_ratio(&runs, None);
    assert!(found.blocks >= 8 && found.ci95.is_ok_and(|[_, high]| high < 0.2), "{found:?}");
}

#[test]
fn a_slow_effect_does_not_lengthen_the_blocks() {
    // A drift that the effect removes, in white noise. The difference of the squared errors is as slow as the run is long.
    let random = &mut Pcg64Mcg::seed_from_u64(5);
    let after: Vec<f64> = (0..3000).map(|_| normal(random)).collect();
    let before = after.iter().enumerate().map(|(k, r)| r + 2e-3 * (k as f64 - 1500.0)).collect();
    let found = error_ratio(&[Residuals { step_s: STEP_S, before, after }], None);
    assert!(found.blocks == 10 && found.ci95.is_ok_and(|[_, high]| high < 1.0), "{found:?}");
}
