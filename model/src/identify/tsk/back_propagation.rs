//! Back-propagation: gradient descent on memberships, conclusions and offsets together, without least squares.
//!
//! ```text
//! e   = o_run + sum_r W_r(m) f_r(c) - F / std              E = 1/(2 B) sum e^2 over a batch of B rows
//! c  <- c - h dE/dc,    o <- o - h dE/do,    m <- m - 0.1 h dE/dm                            (one batch)
//! h   = rate (1 - epoch/epochs) / Z,    Z = 1 + largest |z|^2,    z = (u_1, ..., u_m, 1) or 1
//! ```
//!
//! An epoch visits each row of a sample once, in a seeded random order, in batches. The weights W_r are not negative and
//! have the sum one, so Z bounds the second derivative of E by the conclusions and the offset: with a rate below 2 their
//! step cannot overshoot. The rate falls linearly, which averages the noise of the batches away. Memberships stay within
//! the bounds of hybrid learning. The result is the epoch with the lowest error on the sample. Conclusions start at zero,
//! memberships at the uniform grid. A rule that no row reaches keeps its zero.
//!
//! Source: `[ahn2008]` in the bibliography (node/docs/guide/bibliography.md), section 2.1.4 of the thesis.

use super::premises::{Link, Premises};
use super::sums::{Sums, fire, regressors};
use super::{Data, FittedTsk, Progress, Watch, evolve};
use crate::error::Error;
use crate::force::{MAX_INPUTS, TskInput, TskKind};
use rand::RngExt;
use std::ops::Range;
use std::sync::atomic::Ordering;

/// Step of the memberships as a share of the step of the conclusions.
const MEMBERSHIP_SHARE: f64 = 0.1;

/// Schedule of back-propagation. It visits `epochs` times `rows` rows, so its time is bounded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BackPropagation {
    /// Number of epochs; at least one is run.
    pub epochs: usize,
    /// Rows of a batch; at least one.
    pub batch: usize,
    /// Rate of the first epoch; above 0 and below 2.
    pub rate: f64,
    /// Largest number of rows in the sample.
    pub rows: usize,
    /// Seed of the sample and of the order of rows. The same seed and rows give the same model on any number of
    /// threads.
    pub seed: u64,
}

impl Default for BackPropagation {
    fn default() -> Self {
        Self { epochs: 60, batch: 16, rate: 1.0, rows: 8192, seed: 0 }
    }
}

/// The trained numbers, or a gradient with respect to them.
#[derive(Debug, Clone, PartialEq)]
struct Unknowns {
    /// Parameters of the memberships.
    memberships: Vec<f64>,
    /// Conclusions, ordered by coefficient.
    conclusions: Vec<f64>,
    /// Offset of each run.
    offsets: Vec<f64>,
}

/// A row: number of its run, and number within the run.
type Place = (usize, usize);

/// Fits a model of `kind`.
pub(super) fn fit(
    data: &Data,
    kind: TskKind,
    settings: &BackPropagation,
    watch: &Watch,
) -> Result<FittedTsk, Error> {
    Error::check("back_propagation.rate", settings.rate, "above 0 and below 2", |r| r > 0.0 && r < 2.0)?;
    let sample = evolve::sample(data, settings.rows, settings.seed);
    let (found, errors) = descend(&sample, &data.premises, settings, watch)?;
    let inputs = data.premises.inputs(&found.memberships)?;
    // The offsets of whole runs: the mean of the rules over all rows, not over the sample alone.
    let rule_means: Vec<f64> = (0..data.sums.runs.len())
        .map(|run| {
            let count = data.sums.runs[run].target.len();
            let output = |range| sum(&data.sums, &inputs, &found.conclusions, run, range, |output, _| output);
            output(0..count) / count.max(1) as f64
        })
        .collect();
    let (model, offsets_n) = data.assemble(kind, &inputs, &found.conclusions, &rule_means)?;
    let scale = data.sums.rows() as f64 / sample.rows().max(1) as f64;
    let errors: Vec<f64> = errors.iter().map(|error| scale * error).collect();
    Ok(FittedTsk { model, offsets_n, epoch_rsse_n: data.rsse_n(&errors), converged: true })
}

/// Trains on all rows of `sums`. Returns the best unknowns, and the lowest sum of squared errors after each epoch.
fn descend(
    sums: &Sums,
    premises: &Premises,
    settings: &BackPropagation,
    watch: &Watch,
) -> Result<(Unknowns, Vec<f64>), Error> {
    let bounds = premises.bounds();
    let mut here = Unknowns {
        memberships: premises.start(),
        conclusions: vec![0.0; sums.len()],
        offsets: vec![0.0; sums.runs.len()],
    };
    let mut places: Vec<Place> = sums
        .runs
        .iter()
        .enumerate()
        .flat_map(|(run, rows)| (0..rows.target.len()).map(move |k| (run, k)))
        .collect();
    let largest = largest_square(sums);
    let epochs = settings.epochs.max(1);
    let (mut best, mut lowest, mut errors) = (here.clone(), f64::INFINITY, Vec::with_capacity(epochs));
    for epoch in 0..epochs {
        if sums.cancel.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        let step = settings.rate * (1.0 - epoch as f64 / epochs as f64) / (1.0 + largest);
        shuffle(&mut places, settings.seed, epoch);
        for batch in places.chunks(settings.batch.max(1)) {
            let inputs = premises.inputs(&here.memberships)?;
            let links = premises.links(&here.memberships);
            let gradient = gradient(sums, &inputs, &links, &here, batch);
            let moved = |(to, g): (&mut f64, &f64)| *to -= step * g;
            here.conclusions.iter_mut().zip(&gradient.conclusions).for_each(moved);
            here.offsets.iter_mut().zip(&gradient.offsets).for_each(moved);
            let own = here.memberships.iter_mut().zip(&gradient.memberships).zip(&bounds);
            own.for_each(|((to, g), b)| *to = (*to - MEMBERSHIP_SHARE * step * g).clamp(b[0], b[1]));
        }
        let error = error(sums, &premises.inputs(&here.memberships)?, &here.conclusions)?;
        if error < lowest {
            (best, lowest) = (here.clone(), error);
        }
        errors.push(lowest);
        watch.report(Progress::Epoch { done: epoch as u32 + 1, of: epochs as u32 });
    }
    Ok((best, errors))
}

/// Gradient of E over the rows of a batch.
fn gradient(sums: &Sums, inputs: &[TskInput], links: &[Link], at: &Unknowns, batch: &[Place]) -> Unknowns {
    let mut gradient = Unknowns {
        memberships: vec![0.0; at.memberships.len()],
        conclusions: vec![0.0; at.conclusions.len()],
        offsets: vec![0.0; at.offsets.len()],
    };
    let rules = sums.rules();
    let mut weights = vec![0.0; rules];
    let mut functions = vec![0.0; rules];
    for &(run, k) in batch {
        let u = &sums.runs[run].u[k];
        let z = regressors(u, sums.width);
        let firing = fire(inputs, u);
        functions_at(&at.conclusions, &z, &mut functions);
        let (output, under) = sums.under(&firing, &functions);
        let e = (at.offsets[run] + output - sums.runs[run].target[k]) / batch.len() as f64;
        sums.outer(&firing.map(|f| f.weights), &mut weights);
        for (own, z) in gradient.conclusions.chunks_exact_mut(rules).zip(&z) {
            own.iter_mut().zip(&weights).for_each(|(g, w)| *g += e * z * w);
        }
        gradient.offsets[run] += e;
        for link in links {
            let slope = firing[link.input].slopes[link.set][link.number] * link.factor;
            gradient.memberships[link.parameter] += e * (under[link.input][link.set] - output) * slope;
        }
    }
    gradient
}

/// Outputs of the rules.
fn functions_at(conclusions: &[f64], z: &[f64; MAX_INPUTS + 1], functions: &mut [f64]) {
    functions.fill(0.0);
    for (own, z) in conclusions.chunks_exact(functions.len()).zip(z) {
        functions.iter_mut().zip(own).for_each(|(f, c)| *f += z * c);
    }
}

/// Sum over rows of one run of a function of the output and the target.
fn sum(
    sums: &Sums,
    inputs: &[TskInput],
    conclusions: &[f64],
    run: usize,
    range: Range<usize>,
    of: impl Fn(f64, f64) -> f64,
) -> f64 {
    let mut functions = vec![0.0; sums.rules()];
    let one = |k: usize| {
        let u = &sums.runs[run].u[k];
        functions_at(conclusions, &regressors(u, sums.width), &mut functions);
        of(sums.under(&fire(inputs, u), &functions).0, sums.runs[run].target[k])
    };
    range.map(one).sum()
}

/// Sum of squared errors, each run with its best offset.
fn error(sums: &Sums, inputs: &[TskInput], conclusions: &[f64]) -> Result<f64, Error> {
    let parts = sums.chunks(|run, range| {
        let count = range.len() as f64;
        let total = |of: fn(f64, f64) -> f64| sum(sums, inputs, conclusions, run, range.clone(), of);
        (run, [count, total(|output, target| output - target), total(|o, t| (o - t).powi(2))])
    });
    let mut runs = vec![[0.0; 3]; sums.runs.len()];
    for (run, part) in parts.ok_or(Error::Cancelled)? {
        runs[run].iter_mut().zip(part).for_each(|(total, part)| *total += part);
    }
    Ok(runs.iter().map(|[count, sum, squares]| squares - sum * sum / count.max(1.0)).sum())
}

/// Largest square of the regressors of any row.
fn largest_square(sums: &Sums) -> f64 {
    let square =
        |u: &[f64; MAX_INPUTS]| regressors(u, sums.width)[..sums.width].iter().map(|z| z * z).sum::<f64>();
    sums.runs.iter().flat_map(|run| &run.u).map(square).fold(0.0, f64::max)
}

/// Puts the rows in a random order (Fisher and Yates).
fn shuffle(places: &mut [Place], seed: u64, epoch: usize) {
    let mut random = evolve::stream(seed, epoch + 1, places.len());
    for last in (1..places.len()).rev() {
        let pick = (random.random::<f64>() * (last + 1) as f64) as usize;
        places.swap(last, pick);
    }
}

#[cfg(test)]
mod tests;
