//! Evolution of memberships, as in Du and Zhang's evolutionary TSK model. Each individual is a list of the memberships'
//! parameters. Its conclusions are solved by least squares, and its cost is the error of that fit on a sample of the
//! rows. Children are bred by differential evolution (Storn and Price 1997, rand/1/bin), where a child replaces its own
//! parent if it is not worse, or by the genetic algorithm of `genetic.rs`. Both cost the same number of fits.
//!
//! Source: `[storn1997]` and `[duzhang2006]` in the bibliography (node/docs/guide/bibliography.md).

use super::genetic;
use super::sums::{Rows, Sums};
use super::{Data, Progress, Watch};
use crate::error::Error;
use crate::parallel;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// How children are bred and selected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Algorithm {
    /// Differential evolution.
    #[default]
    Differential,
    /// A genetic algorithm: tournaments, crossover, mutation, elitism.
    Genetic,
}

/// Settings of the evolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evolution {
    /// How children are bred and selected.
    pub algorithm: Algorithm,
    /// Number of individuals; at least four.
    pub population: usize,
    /// Number of generations.
    pub generations: usize,
    /// Weight of the difference of two individuals that is added to a third, in differential evolution.
    pub difference: f64,
    /// Share of parameters that a child takes from that sum, in differential evolution.
    pub crossover: f64,
    /// Number of rows in the sample.
    pub rows: usize,
    /// Seed. The same seed and rows give the same model on any number of threads.
    pub seed: u64,
}

impl Default for Evolution {
    fn default() -> Self {
        Self {
            algorithm: Algorithm::default(),
            population: 24,
            generations: 40,
            difference: 0.6,
            crossover: 0.8,
            rows: 2048,
            seed: 0,
        }
    }
}

/// Parameters and their cost.
pub(super) type Individual = (Vec<f64>, f64);

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
    let sample = sample(data, settings.rows, settings.seed);
    let scale = data.sums.rows() as f64 / sample.rows().max(1) as f64;
    let cost = |parameters: &[f64]| -> Option<f64> {
        let inputs = data.premises.inputs(parameters).ok()?;
        let solved = data.solve(&sample, &inputs, ridge)?;
        // Power of the targets minus the explained power.
        Some(sample.power() - solved.linear.rhs.dot(&solved.conclusions))
    };
    let seen = |generation: usize, lowest: f64| {
        costs.push(scale * lowest);
        watch.report(Progress::Epoch { done: generation as u32, of: settings.generations as u32 });
    };
    search(&cost, &data.premises.start(), &data.premises.bounds(), settings, seen).ok_or(Error::Cancelled)
}

/// Minimises `cost` within `bounds` and returns the best parameters; `None` if a cost is `None`. The first individual is
/// `start`; the others are spread over the bounds. `seen` gets the lowest cost after each generation.
pub(super) fn search(
    cost: &(impl Fn(&[f64]) -> Option<f64> + Sync),
    start: &[f64],
    bounds: &[[f64; 2]],
    settings: &Evolution,
    mut seen: impl FnMut(usize, f64),
) -> Option<Vec<f64>> {
    let size = settings.population.max(4);
    let first = |index: usize| {
        let mut random = stream(settings.seed, 0, index);
        let parameters: Vec<f64> = if index == 0 {
            start.to_vec()
        } else {
            bounds.iter().map(|b| b[0] + (b[1] - b[0]) * random.random::<f64>()).collect()
        };
        cost(&parameters).map(|cost| (parameters, cost))
    };
    let mut population: Vec<Individual> =
        parallel::map_indices(size, first).into_iter().collect::<Option<_>>()?;
    for generation in 1..=settings.generations {
        let child = |index: usize| {
            let mut random = stream(settings.seed, generation, index);
            let child = match settings.algorithm {
                Algorithm::Differential => breed(&population, index, settings, bounds, &mut random),
                Algorithm::Genetic => genetic::child(&population, bounds, &mut random),
            };
            let child_cost = cost(&child)?;
            Some(match settings.algorithm {
                Algorithm::Differential if child_cost > population[index].1 => population[index].clone(),
                _ => (child, child_cost),
            })
        };
        let mut next = parallel::map_indices(size, child).into_iter().collect::<Option<Vec<_>>>()?;
        if settings.algorithm == Algorithm::Genetic {
            genetic::keep_best(&mut next, best(&population));
        }
        population = next;
        seen(generation, best(&population).1);
    }
    Some(best(&population).0.clone())
}

/// The individual with the lowest cost; the first of equals.
fn best(population: &[Individual]) -> &Individual {
    population.iter().fold(&population[0], |best, one| if one.1 < best.1 { one } else { best })
}

/// A child of individual `index`: a third individual plus the difference of two others, crossed with the
/// parent. A parameter outside its bounds is moved half way between the parent's value and the bound.
fn breed(
    population: &[Individual],
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
pub(super) fn stream(seed: u64, generation: usize, index: usize) -> Pcg64Mcg {
    let own = ((generation as u64) << 32 | index as u64).wrapping_add(1);
    Pcg64Mcg::seed_from_u64(seed ^ own.wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

/// One random row from each group of rows of each run, with the mean of the targets removed again.
pub(super) fn sample<'a>(data: &Data<'a>, rows: usize, seed: u64) -> Sums<'a> {
    let stride = data.sums.rows().div_ceil(rows.max(1)).max(1);
    let pick = |(index, run): (usize, &Rows)| {
        let mut random = stream(seed, usize::MAX >> 32, index);
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
