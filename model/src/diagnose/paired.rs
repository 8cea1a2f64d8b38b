//! Paired mode: what changed since a healthy run with the same excitation.
//!
//! ```text
//! d                 = F_run - F_reference at the same crank angle or time ([`super::alignment`])
//! force to explain  = M(theta) + d - c        M the base, which is not refitted
//! c                 = mean over the cycles of M(run) - M(reference) at that crank angle; zero if the motion is not cyclic
//! ```
//!
//! The base's own errors are the same in run and reference and cancel in the difference. In this form all further steps are
//! the same as in absolute mode, with no base coefficients to project off. c is the force of the small difference between two motions that
//! a machine makes at one setting. A row without a reference force is left out. The noise counts twice, once for each run.
//!
//! # Cycles
//! The cycles of a machine that repeats one motion are replicates. d of one cycle minus d of the next one, each without its mean, is noise,
//! and shows its size. A block of the significance tests then need not be longer than a cycle.
//!
//! # Mean force
//! The mean of a residual is removed everywhere else, because sessions differ in their force offset. Between a run and its reference it is
//! evidence: the pressure of the gas changed, or the zero of the load cell.
//!
//! # Zero of the displacement, and temperature
//! A run gets the zero of its reference, which is the base's: some effects depend on position. The base is identified on the healthy runs, at
//! their temperature. If a run is warmer or colder than its reference, an effect of
//! temperature acts on the difference. Otherwise it acts on the temperature itself.

use super::alignment::{ALIKE, Aligned, Alignment, Between, align};
use super::cycle::{Cycles, MeanCycle, times_s};
use super::rows::Rows;
use super::{Settings, Thresholds};
use crate::effect::{Augmented, REFERENCE_TEMP_C};
use crate::error::{DiagnosisError, Error};
use crate::identify::{Dataset, Row, walk};
use crate::statistics::block_sums::t95;
use std::ops::ControlFlow;

/// Points of a mean cycle.
const POINTS: usize = 128;
/// Least number of cycles from which noise is computed, and of blocks for the interval of a mean force.
const LEAST: usize = 3;
/// Least number of pairs whose means show what differs from run to run.
const LEAST_PAIRS: usize = 3;
/// Length of the mean of a temperature, s.
const SLOW_S: f64 = 60.0;

/// Force of the matching reference at each row of `run`, N; `None` at rows where it has no force. The match is the first of `references`
/// with the excitation of `run`, placed on it by crank angle if the motion is cyclic, otherwise by time. Returns `None` if no reference
/// matches.
///
/// ```
/// use mr_damper_model::condition::Conditioning;
/// use mr_damper_model::diagnose::reference_force_n;
/// use mr_damper_model::identify::{Dataset, DatasetOptions};
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let rows = |frequency_hz, seed| {
///     let run = record(&Experiment::sine(0.01, frequency_hz, 1.2, 3.0), &Plant::default(), &Channels::default(), seed);
///     Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default())
/// };
/// // The second reference has the excitation of the run. Its force differs by the noise of the load cell.
/// let (run, references) = (rows(2.0, 1)?, [rows(3.0, 2)?, rows(2.0, 3)?]);
/// let force_n = reference_force_n(&run, &references).expect("the excitation matches");
/// let differences_n = run.rows.iter().zip(&force_n).filter_map(|(row, n)| n.map(|n| (row.force_n - n).abs()));
/// assert!(differences_n.filter(|n| n.is_finite()).fold(0.0, f64::max) < 50.0);
/// assert_eq!(reference_force_n(&run, &references[..1]), None);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[must_use]
pub fn reference_force_n(run: &Dataset, references: &[Dataset]) -> Option<Vec<Option<f64>>> {
    let (aligned, reference) = matching(run, references, 0)?;
    let force_n =
        |at: &Option<Between>| (*at).map(|at| at.of(reference, |row| row.force_n)).filter(|f| f.is_finite());
    Some(aligned.at.iter().map(force_n).collect())
}

/// A reference with the excitation of `run`, placed on it: number `own` if it has that, otherwise the first.
fn matching<'a>(run: &Dataset, references: &'a [Dataset], own: usize) -> Option<(Aligned, &'a Dataset)> {
    let own_first = references.get(own).into_iter().chain(references);
    own_first.into_iter().find_map(|reference| Some((align(run, reference)?, reference)))
}

/// The mean force of the runs minus the mean force of their references.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanShift {
    /// Mean over all training and validation runs, N.
    pub force_n: f64,
    /// Its 95 % interval, from the means of blocks; a block is a cycle if the motion is cyclic. With three runs or more, it also contains what
    /// differs from run to run.
    pub ci95_n: [f64; 2],
    /// Number of blocks.
    pub blocks: usize,
}

impl MeanShift {
    /// True if the interval does not include zero.
    #[must_use]
    pub fn is_proved(&self) -> bool {
        self.ci95_n[0] > 0.0 || self.ci95_n[1] < 0.0
    }
}

/// A run with its reference.
pub(super) struct PairedRun {
    cycles: Option<Cycles>,
    /// Time since the run's first row, s, and d, N, at each selected row.
    differences: Vec<(f64, f64)>,
}

/// The selected rows of several runs in paired mode.
pub(super) struct Paired<'a> {
    pub(super) rows: Rows<'a>,
    /// One for each run.
    pub(super) pairs: Vec<PairedRun>,
}

/// The rows of `datasets` with the force to explain of paired mode. The reference of the first run is number `first`, of the next one the
/// next, and so on, unless it has another excitation; then it is the first that has the run's.
///
/// # Errors
/// [`DiagnosisError::BaseDivergesPaired`]; [`DiagnosisError::NoReference`].
pub(super) fn rows<'a>(
    datasets: &'a [Dataset],
    (references, first): (&[Dataset], usize),
    base: &Augmented,
    most: usize,
) -> Result<Paired<'a>, Error> {
    let placed = datasets.iter().zip(first..).map(|(run, own)| {
        let missing = || DiagnosisError::NoReference { run: run.name.clone(), most: ALIKE };
        Ok(matching(run, references, own).ok_or_else(missing)?)
    });
    let placed = placed.collect::<Result<Vec<_>, Error>>()?;
    let healthy_n = |run: usize, k: usize| {
        let (aligned, reference) = &placed[run];
        aligned.at[k].map(|at| at.of(reference, |row| row.force_n)).filter(|force_n| force_n.is_finite())
    };
    let rows = Rows::new(datasets, most).retain(|run, k| healthy_n(run, k).is_some());
    let Some(predicted_n) = rows.predict(base) else {
        return Err(DiagnosisError::BaseDivergesPaired.into());
    };
    let mut force_n = Vec::with_capacity(rows.len());
    let mut pairs = Vec::with_capacity(placed.len());
    for (number, (run, (aligned, reference))) in rows.runs().iter().zip(&placed).enumerate() {
        let by_motion = by_motion(base, run.dataset, reference, aligned);
        let mut differences = Vec::with_capacity(run.indices.len());
        for ((&k, at), time_s) in run.indices.iter().zip(run.range.clone()).zip(run.times_s()) {
            let difference_n = run.dataset.rows[k].force_n - healthy_n(number, k).unwrap_or(f64::NAN);
            differences.push((time_s, difference_n));
            let by_motion_n = by_motion.as_ref().map_or(0.0, |mean| mean.at(time_s));
            force_n.push(predicted_n[at] + difference_n - by_motion_n);
        }
        pairs.push(PairedRun { cycles: aligned.cycles, differences });
    }
    let cycles = pairs.iter().map(|pair| pair.cycles);
    Ok(Paired { rows: rows.with_force(force_n).with_cycles(cycles), pairs })
}

/// The force of the difference between two motions, c in the module's equation; `None` if the motion is not cyclic.
fn by_motion(
    base: &Augmented,
    run: &Dataset,
    reference: &Dataset,
    aligned: &Aligned,
) -> Option<MeanCycle<POINTS>> {
    let cycles = aligned.cycles?;
    let [ours, theirs] = [run, reference].map(|dataset| simulated_n(base, dataset));
    let apart_n = times_s(run).zip(&aligned.at).zip(run.rows.iter().zip(&ours)).filter_map(
        |((time_s, at), (row, force_n))| {
            let at = at.filter(|_| row.counts && cycles.number(time_s).is_some())?;
            Some((time_s, force_n - at.of_series(&theirs)))
        },
    );
    Some(cycles.mean(apart_n.filter(|(_, apart_n)| apart_n.is_finite())))
}

/// Simulated force of `model` at all rows, N; NaN where it is not known.
fn simulated_n(model: &Augmented, dataset: &Dataset) -> Vec<f64> {
    let mut force_n = Vec::with_capacity(dataset.rows.len());
    // The closure never breaks.
    let _ = walk(model, dataset, |_, said| {
        force_n.push(said.free_run_n);
        ControlFlow::Continue(())
    });
    force_n
}

/// Longest period if the motion of all runs is cyclic, s.
pub(super) fn period_s(pairs: &[PairedRun]) -> Option<f64> {
    let longest = |longest: f64, pair: &PairedRun| Some(longest.max(pair.cycles?.period_s));
    if pairs.is_empty() { None } else { pairs.iter().try_fold(0.0, longest) }
}

/// Noise of the difference between runs and references, root mean square, N: from cycle to cycle. `None` if a motion is not cyclic or has
/// too few cycles.
///
/// ```text
/// s^2 = mean over rows of (e(t + P) - e(t))^2 / (1 + (1 - w)^2 + w^2),   e: d without the mean of its cycle
/// ```
///
/// t + P lies between two rows, of which the later one has the weight w.
pub(super) fn noise_n(pairs: &[PairedRun]) -> Option<f64> {
    let (mut squares, mut rows) = (0.0, 0.0_f64);
    for pair in pairs {
        let cycles = pair.cycles?;
        let means = means(pair, |time_s| cycles.number(time_s));
        if means.len() < LEAST {
            return None;
        }
        let own = |(time_s, difference_n): &(f64, f64)| {
            let number = cycles.number(*time_s)?;
            let at = means.binary_search_by_key(&number, |(of, _)| *of).ok()?;
            Some(difference_n - means[at].1)
        };
        let mut after = 0;
        for now in &pair.differences {
            let there_s = now.0 + cycles.period_s;
            while after < pair.differences.len() && pair.differences[after].0 < there_s {
                after += 1;
            }
            let Some([before, next]) =
                after.checked_sub(1).and_then(|before| pair.differences.get(before..=after))
            else {
                continue;
            };
            let (Some(here), [Some(low), Some(high)]) = (own(now), [before, next].map(own)) else { continue };
            let weight = (there_s - before.0) / (next.0 - before.0);
            let apart = low + weight * (high - low) - here;
            squares += apart * apart / (1.0 + (1.0 - weight).powi(2) + weight * weight);
            rows += 1.0;
        }
    }
    (rows > 0.0).then(|| (squares / rows).sqrt())
}

/// The mean of the difference in each block that `number` gives, in order of time.
fn means(pair: &PairedRun, number: impl Fn(f64) -> Option<usize>) -> Vec<(usize, f64)> {
    let mut sums: Vec<(usize, f64, f64)> = Vec::new();
    for (time_s, difference_n) in &pair.differences {
        let Some(number) = number(*time_s) else { continue };
        match sums.last_mut().filter(|(last, ..)| *last == number) {
            Some((_, sum, count)) => (*sum, *count) = (*sum + difference_n, *count + 1.0),
            None => sums.push((number, *difference_n, 1.0)),
        }
    }
    sums.into_iter().map(|(number, sum, count)| (number, sum / count)).collect()
}

/// The change of the mean force since the references; `None` without pairs or with too few blocks.
pub(super) fn mean_shift<'a>(
    pairs: impl Iterator<Item = &'a PairedRun>,
    settings: &Settings,
) -> Option<MeanShift> {
    let block_s = settings.training_block_s();
    let of_pair = |pair: &PairedRun| match pair.cycles {
        Some(cycles) => means(pair, |time_s| cycles.number(time_s)),
        None => means(pair, |time_s| Some((time_s / block_s) as usize)),
    };
    let by_pair: Vec<Vec<f64>> =
        pairs.map(|pair| of_pair(pair).into_iter().map(|(_, mean_n)| mean_n).collect()).collect();
    let blocks = by_pair.concat();
    if blocks.len() < LEAST {
        return None;
    }
    let count = blocks.len() as f64;
    let force_n = blocks.iter().sum::<f64>() / count;
    let own: Vec<f64> = blocks.iter().map(|mean_n| mean_n - force_n).collect();
    let squares = own.iter().map(|e| e * e).sum::<f64>();
    // Neighbouring blocks of a force that drifts are alike, so they count for less.
    let alike = own.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / squares.max(f64::MIN_POSITIVE);
    let alike = alike.clamp(0.0, 0.9);
    let error_n = (squares / (count - 1.0) / count * (1.0 + alike) / (1.0 - alike)).sqrt();
    let half_n = (t95(blocks.len()) * error_n).max(half_by_pairs_n(&by_pair, force_n));
    Some(MeanShift { force_n, ci95_n: [force_n - half_n, force_n + half_n], blocks: blocks.len() })
}

/// Half of the 95 % interval of the mean `force_n` by the scatter of the pairs' own means, N: what differs from run to run, blocks of a run have in
/// common. 0 with fewer pairs than show a scatter.
fn half_by_pairs_n(by_pair: &[Vec<f64>], force_n: f64) -> f64 {
    let means: Vec<f64> = by_pair
        .iter()
        .filter(|blocks| !blocks.is_empty())
        .map(|blocks| blocks.iter().sum::<f64>() / blocks.len() as f64)
        .collect();
    if means.len() < LEAST_PAIRS {
        return 0.0;
    }
    let count = means.len() as f64;
    let squares = means.iter().map(|mean_n| (mean_n - force_n).powi(2)).sum::<f64>();
    t95(means.len()) * (squares / (count - 1.0) / count).sqrt()
}

/// Runs on the scales of their references, and how each was placed.
pub(super) struct OnScales {
    pub(super) runs: Vec<Dataset>,
    pub(super) alignments: Vec<Alignment>,
}

/// `runs` on the scales of their references: with the zero of their displacement, and with temperatures relative to theirs unless runs and
/// references are about as warm. A run without a reference is not changed.
///
/// The relative temperature is a mean over [`SLOW_S`]: the force follows the fluid, which warms more slowly than the case at its sensor.
pub(super) fn on_scales_of(
    (references, first): (&[Dataset], usize),
    runs: &[Dataset],
    thresholds: &Thresholds,
) -> OnScales {
    let (mut changed, mut alignments) = (runs.to_vec(), Vec::with_capacity(runs.len()));
    let mut warmer_k: Vec<Vec<Option<f64>>> = Vec::with_capacity(runs.len());
    for (run, own) in changed.iter_mut().zip(first..) {
        let Some((aligned, reference)) = matching(run, references, own) else {
            warmer_k.push(vec![None; run.rows.len()]);
            continue;
        };
        let warmer = |(row, at): (&Row, &Option<Between>)| {
            let warmer_k = row.case_temp_c - (*at)?.of(reference, |row| row.case_temp_c);
            Some(warmer_k).filter(|warmer_k| warmer_k.is_finite())
        };
        warmer_k.push(run.rows.iter().zip(&aligned.at).map(warmer).collect());
        run.rows.iter_mut().for_each(|row| row.displacement_m -= aligned.alignment.offset_m);
        alignments.push(aligned.alignment);
    }
    let contrast = |warmer_k: &Vec<Option<f64>>| {
        let known: Vec<f64> = warmer_k.iter().copied().flatten().collect();
        (known.iter().sum::<f64>() / known.len().max(1) as f64).abs() >= thresholds.least_contrast_k
    };
    if warmer_k.iter().any(contrast) {
        for (run, warmer_k) in changed.iter_mut().zip(&warmer_k) {
            let slow_k = slow(&times_s(run).collect::<Vec<_>>(), warmer_k);
            run.rows
                .iter_mut()
                .zip(slow_k)
                .for_each(|(row, slow_k)| row.case_temp_c = REFERENCE_TEMP_C + slow_k);
        }
    }
    OnScales { runs: changed, alignments }
}

/// Mean of the known values within half of [`SLOW_S`] of each time; NaN if there is none.
fn slow(times_s: &[f64], values: &[Option<f64>]) -> Vec<f64> {
    let (mut from, mut to, mut sum, mut count) = (0, 0, 0.0, 0.0_f64);
    let mean = |time_s: &f64| {
        while to < times_s.len() && times_s[to] <= time_s + 0.5 * SLOW_S {
            (sum, count) = values[to].map_or((sum, count), |value| (sum + value, count + 1.0));
            to += 1;
        }
        while times_s[from] < time_s - 0.5 * SLOW_S {
            (sum, count) = values[from].map_or((sum, count), |value| (sum - value, count - 1.0));
            from += 1;
        }
        if count > 0.5 { sum / count } else { f64::NAN }
    };
    times_s.iter().map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pairs of 30 s with these mean differences, N, and a scatter of 0.1 N from one 3 s to the next.
    fn pairs(means_n: &[f64]) -> Vec<PairedRun> {
        let pair = |mean_n: &f64| {
            let difference =
                |k: u32| (f64::from(k), mean_n + if (k / 3).is_multiple_of(2) { 0.1 } else { -0.1 });
            PairedRun { cycles: None, differences: (0..30).map(difference).collect() }
        };
        means_n.iter().map(pair).collect()
    }

    #[test]
    fn a_shift_of_the_mean_force_must_exceed_what_differs_from_run_to_run() {
        let shift =
            |means_n: &[f64]| mean_shift(pairs(means_n).iter(), &Settings::default()).expect("blocks");
        let apart = shift(&[1.2, -1.2, 0.5, 4.8, -0.3, 1.8]);
        assert!(!apart.is_proved(), "{apart:?}");
        let alike = shift(&[38.0, 39.0, 40.0]);
        assert!(alike.is_proved() && (alike.force_n - 39.0).abs() < 1e-9, "{alike:?}");
        assert!(shift(&[38.0, 40.0]).is_proved(), "two runs cannot show a scatter");
    }

    #[test]
    fn a_slow_mean_covers_half_its_length_to_either_side() {
        let times_s: Vec<f64> = (0..200).map(f64::from).collect();
        let values: Vec<Option<f64>> = (0..200).map(|k| (k != 100).then_some(f64::from(k))).collect();
        let found = slow(&times_s, &values);
        let mean = |from: u32, to: u32| {
            let kept: Vec<f64> = (from..=to).filter(|k| *k != 100).map(f64::from).collect();
            kept.iter().sum::<f64>() / kept.len() as f64
        };
        for (k, [from, to]) in [(0, [0, 30]), (90, [60, 120]), (199, [169, 199])] {
            assert!((found[k] - mean(from, to)).abs() < 1e-9, "{k}: {}", found[k]);
        }
        assert!(slow(&times_s, &[None; 200]).iter().all(|value| value.is_nan()));
    }
}
