//! Genetic algorithm with real-coded chromosomes, as the alternative to differential evolution.
//!
//! ```text
//! parents     p, q: each the best of three individuals drawn at random (tournament)
//! crossover   with probability 0.9, each gene from the interval of p_j and q_j, widened by half of its length on both
//!             sides (BLX-0.5); otherwise the genes of p
//! mutation    each gene with probability 1/n: plus a tenth of its range times a normal number
//! elitism     the best individual replaces the worst child
//! ```
//!
//! Genes outside their bounds are moved to the bound.
//!
//! Source: `[duzhang2006]` for a genetic algorithm on memberships; crossover `[eshelman1993]`; bibliography in
//! node/docs/guide/bibliography.md.

use super::evolve::Individual;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// Number of individuals in a tournament.
const TOURNAMENT: usize = 3;
/// Probability of a crossover.
const CROSSOVER: f64 = 0.9;
/// Length by which the interval of two genes is widened on each side, as a share of it.
const BLEND: f64 = 0.5;
/// Standard deviation of a mutation, as a share of the gene's range.
const MUTATION: f64 = 0.1;

/// A child of two individuals of `population`.
pub(super) fn child(population: &[Individual], bounds: &[[f64; 2]], random: &mut Pcg64Mcg) -> Vec<f64> {
    let [p, q] = [0, 1].map(|_| &tournament(population, random).0);
    let crossed = random.random::<f64>() < CROSSOVER;
    let gene = |j: usize| {
        let mut gene = p[j];
        if crossed {
            let share = -BLEND + (1.0 + 2.0 * BLEND) * random.random::<f64>();
            gene += share * (q[j] - p[j]);
        }
        let [low, high] = bounds[j];
        if random.random::<f64>() * (bounds.len() as f64) < 1.0 {
            gene += MUTATION * (high - low) * normal(random);
        }
        gene.clamp(low, high)
    };
    (0..p.len()).map(gene).collect()
}

/// Replaces the worst of `children` by the best of their parents.
pub(super) fn keep_best(children: &mut [Individual], best: &Individual) {
    let worst = children.iter_mut().reduce(|worst, one| if one.1 > worst.1 { one } else { worst });
    if let Some(worst) = worst {
        worst.clone_from(best);
    }
}

/// The best of a few individuals drawn with replacement.
fn tournament<'p>(population: &'p [Individual], random: &mut Pcg64Mcg) -> &'p Individual {
    let mut draw = || &population[(random.random::<f64>() * population.len() as f64) as usize];
    let first = draw();
    (1..TOURNAMENT).fold(first, |best, _| {
        let other = draw();
        if other.1 < best.1 { other } else { best }
    })
}

/// A normal number with mean 0 and standard deviation 1 (Box and Muller).
fn normal(random: &mut Pcg64Mcg) -> f64 {
    // 1 - [0, 1) is never zero.
    let radius = (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * random.random::<f64>()).cos()
}

#[cfg(test)]
mod tests {
    use super::super::evolve::{Algorithm, Evolution, search, stream};
    use super::*;

    /// The default budget, on a cost with its minimum at 0.3, -0.6, 0.9, ... and many local minima (Rastrigin's function).
    fn rastrigin(at: &[f64]) -> f64 {
        let one = |(j, x): (usize, &f64)| {
            let z = x - optimum(j);
            z * z - 0.02 * (20.0 * z).cos() + 0.02
        };
        at.iter().enumerate().map(one).sum()
    }

    fn optimum(j: usize) -> f64 {
        [0.3, -0.6, 0.9, 0.1][j % 4]
    }

    fn found(algorithm: Algorithm, seed: u64, generations: usize) -> (Vec<f64>, Vec<f64>) {
        let settings = Evolution { algorithm, seed, generations, ..Evolution::default() };
        let mut lowest = Vec::new();
        let cost = |at: &[f64]| Some(rastrigin(at));
        let found = search(&cost, &[-0.9; 6], &[[-1.0, 1.0]; 6], &settings, |_, cost| lowest.push(cost));
        (found.expect("not cancelled"), lowest)
    }

    #[test]
    fn it_finds_a_known_optimum_and_the_best_cost_never_rises() {
        for seed in 0..4 {
            let (at, lowest) = found(Algorithm::Genetic, seed, 200);
            for (j, x) in at.iter().enumerate() {
                assert!((x - optimum(j)).abs() < 0.02, "seed {seed}: {at:?}");
            }
            assert!(lowest.windows(2).all(|pair| pair[1] <= pair[0]), "{lowest:?}");
            assert_eq!(lowest.last().copied(), Some(rastrigin(&at)));
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_result_on_any_number_of_threads() {
        let on = |threads: usize, seed| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| found(Algorithm::Genetic, seed, 10))
        };
        assert_eq!(on(1, 5), on(3, 5));
        assert_ne!(on(1, 5), on(1, 6));
        assert_ne!(on(1, 5), found(Algorithm::Differential, 5, 10));
    }

    #[test]
    fn children_stay_within_their_bounds_and_the_elite_survives() {
        let bounds = [[-1.0, 1.0], [0.0, 0.5]];
        let population: Vec<Individual> =
            (0..8).map(|k| (vec![if k % 2 == 0 { -1.0 } else { 1.0 }, 0.5], f64::from(k))).collect();
        for index in 0..500 {
            let child = child(&population, &bounds, &mut stream(1, 1, index));
            assert!(child.iter().zip(&bounds).all(|(g, b)| (b[0]..=b[1]).contains(g)), "{child:?}");
        }
        let mut children = vec![(vec![0.0], 3.0), (vec![1.0], 9.0), (vec![2.0], 5.0)];
        keep_best(&mut children, &(vec![7.0], 4.0));
        assert_eq!(children, [(vec![0.0], 3.0), (vec![7.0], 4.0), (vec![2.0], 5.0)]);
    }

    #[test]
    fn mutations_are_normal_numbers() {
        let mut random = stream(3, 1, 0);
        let drawn: Vec<f64> = (0..20_000).map(|_| normal(&mut random)).collect();
        let mean = drawn.iter().sum::<f64>() / drawn.len() as f64;
        let variance = drawn.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / drawn.len() as f64;
        let beyond = drawn.iter().filter(|x| x.abs() > 1.96).count() as f64 / drawn.len() as f64;
        // Five standard errors: 1/sqrt(20000) for the mean, sqrt(2/20000) for the variance.
        assert!(mean.abs() < 0.036 && (variance - 1.0).abs() < 0.05 && (beyond - 0.05).abs() < 0.008);
    }
}
