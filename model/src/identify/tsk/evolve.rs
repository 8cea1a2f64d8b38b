//! Differential evolution of memberships (Storn and Price 1997, rand/1/bin), as in Du and Zhang's
//! evolutionary TSK model. Each individual is a list of the memberships' parameters. Its conclusions are
//! solved by least squares, and its cost is the error of that fit on a sample of the rows.
//!
//! Source: `[storn1997]` and `[duzhang2006]` in the bibliography (node/docs/guide/bibliography.md).

use super::sums::{Rows, Sums};
use super::{Data, Progress, Watch};
use crate::error::Error;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

/// Settings of the evolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evolution {
    /// Number of individuals; at least four.
    pub population: usize,
    /// Number of generations.
    pub generations: usize,
    /// Weight of the difference of two individuals that is added to a third.
    pub difference: f64,
    /// Share of parameters that a child takes from that sum.
    pub crossover: f64,
    /// Number of rows in the sample.
    pub rows: usize,
    /// Seed. The same seed and rows give the same model on any number of threads.
    pub seed: u64,
}

impl Default for Evolution {
    fn default() -> Self {
        Self { population: 24, generations: 40, difference: 0.6, crossover: 0.8, rows: 2048, seed: 0 }
    }
}

/// Evolves memberships within their bounds and returns the best. Appends the lowest cost of each generation,
/// scaled to all rows, to `costs`.
pub(super) fn evolve(
    data: &Data,
    ridge: f64,
    settings: &Evolution,
    watch: &Watch,
    costs: &mut Vec<f64>,
) -> Result<Vec<f64>, Error> {
    Error::check("evolution.difference", settings.difference, "above 0 and at most 2", |d| {
        d > 0.0 && d <= 2.0
    })?;
    Error::check("evolution.crossover", settings.crossover, "from 0 to 1", |c| (0.0..=1.0).contains(&c))?;
    let sample = sample(data, settings);
    let scale = data.sums.rows() as f64 / sample.rows().max(1) as f64;
    let bounds = data.premises.bounds();
    let cost = |parameters: &[f64]| -> Option<f64> {
        let inputs = data.premises.inputs(parameters).ok()?;
        let solved = data.solve(&sample, &inputs, ridge)?;
        // Power of the targets minus the explained power.
        Some(sample.power() - solved.linear.rhs.dot(&solved.conclusions))
    };
    let size = settings.population.max(4);
    let first = |index: usize| {
        let mut random = stream(settings.seed, 0, index);
        let start = data.premises.start();
        // The first individual is the uniform grid; the others are spread over the bounds.
        let parameters: Vec<f64> = if index == 0 {
            start
        } else {
            bounds.iter().map(|b| b[0] + (b[1] - b[0]) * random.random::<f64>()).collect()
        };
        cost(&parameters).map(|cost| (parameters, cost))
    };
    let mut population: Vec<(Vec<f64>, f64)> =
        (0..size).into_par_iter().map(first).collect::<Option<_>>().ok_or(Error::Cancelled)?;
    for generation in 1..=settings.generations {
        let child = |index: usize| {
            let mut random = stream(settings.seed, generation, index);
            let child = breed(&population, index, settings, &bounds, &mut random);
            let (parent, parent_cost) = &population[index];
            let child_cost = cost(&child)?;
            Some(if child_cost <= *parent_cost {
                (child, child_cost)
            } else {
                (parent.clone(), *parent_cost)
            })
        };
        let next: Option<Vec<_>> = (0..size).into_par_iter().map(child).collect();
        population = next.ok_or(Error::Cancelled)?;
        costs.push(scale * best(&population).1);
        watch.report(Progress::Epoch { done: generation as u32, of: settings.generations as u32 });
    }
    Ok(best(&population).0.clone())
}

/// The individual with the lowest cost; the first of equals.
fn best(population: &[(Vec<f64>, f64)]) -> &(Vec<f64>, f64) {
    population.iter().fold(&population[0], |best, one| if one.1 < best.1 { one } else { best })
}

/// A child of individual `index`: a third individual plus the difference of two others, crossed with the
/// parent. A parameter outside its bounds is moved half way between the parent's value and the bound.
fn breed(
    population: &[(Vec<f64>, f64)],
    index: usize,
    settings: &Evolution,
    bounds: &[[f64; 2]],
    random: &mut Pcg64Mcg,
) -> Vec<f64> {
    let mut others = [index; 3];
    for k in 0..others.len() {
        loop {
            let pick = (random.random::<f64>() * population.len() as f64) as usize;
            if pick != index && !others[..k].contains(&pick) {
                others[k] = pick;
                break;
            }
        }
    }
    let [a, b, c] = others.map(|k| &population[k].0);
    let parent = &population[index].0;
    let always = (random.random::<f64>() * parent.len() as f64) as usize;
    let number = |j: usize| {
        if random.random::<f64>() >= settings.crossover && j != always {
            return parent[j];
        }
        let mutant = a[j] + settings.difference * (b[j] - c[j]);
        let [low, high] = bounds[j];
        if mutant < low {
            f64::midpoint(low, parent[j])
        } else if mutant > high {
            f64::midpoint(high, parent[j])
        } else {
            mutant
        }
    };
    (0..parent.len()).map(number).collect()
}

/// Random numbers for one individual in one generation.
fn stream(seed: u64, generation: usize, index: usize) -> Pcg64Mcg {
    let own = ((generation as u64) << 32 | index as u64).wrapping_add(1);
    Pcg64Mcg::seed_from_u64(seed ^ own.wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

/// One random row from each group of rows of each run, with the mean of the targets removed again.
fn sample<'a>(data: &Data<'a>, settings: &Evolution) -> Sums<'a> {
    let stride = data.sums.rows().div_ceil(settings.rows.max(1)).max(1);
    let pick = |(index, run): (usize, &Rows)| {
        let mut random = stream(settings.seed, usize::MAX >> 32, index);
        let mut rows = Rows::default();
        for from in (0..run.target.len()).step_by(stride) {
            let k = from + (random.random::<f64>() * stride.min(run.target.len() - from) as f64) as usize;
            rows.u.push(run.u[k]);
            rows.target.push(run.target[k]);
        }
        let mean = super::mean(&rows.target);
        rows.target.iter_mut().for_each(|t| *t -= mean);
        rows
    };
    let runs = data.sums.runs.iter().enumerate().map(pick).collect();
    Sums { runs, parallel: false, ..data.sums }
}
