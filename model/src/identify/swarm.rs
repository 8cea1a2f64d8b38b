//! Particle swarm with an inertia weight and limited velocities.
//!
//! ```text
//! u <- w u + c1 r1 (own - p) + c2 r2 (best - p),   |u_j| <= limit (high_j - low_j)
//! p <- p + u,                                      within the bounds
//! w = 0.9 falling linearly to 0.4,  c1 = c2 = 2,   r1, r2 uniform in [0, 1), drawn anew for each coordinate
//! ```
//!
//! p is a particle's position, one coordinate per parameter of the force model; u its velocity; own the best position of the
//! particle so far; best that of the swarm. The start range [low, high] of a coordinate is the law's range of starting
//! values in the scales of the data; a coefficient of a higher power of the drive starts within the width of that range
//! over the range of the drive, to both sides of zero. A particle that reaches a bound of the law stays on it with zero velocity.
//!
//! Every parameter is searched, also those in which the force is linear, and no gradient is used: this is the published fit.
//! A session's force offset, f0 in the source, is the best one for each position. The default fit
//! ([`super::search`]) is faster and ends at a minimum.
//!
//! The costs of one generation are evaluated in parallel, and random numbers are drawn between generations, so results do
//! not depend on the number of threads. The number of evaluations is at most [`PARTICLES`] times one more than [`GENERATIONS`].
//!
//! Source: `[kwok2006]` for the method, `[shi1998]` for the inertia weight and the constants, in the bibliography
//! (node/docs/guide/bibliography.md). The copy of the thesis does not have the constants of Kwok et al.

use super::dataset::Dataset;
use super::row_problem::RowProblem;
use super::search::{self, Found, SearchedModel};
use super::{Options, Progress, Watch};
use crate::error::{Error, IdentifyError};
use crate::parallel;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Number of particles.
pub(super) const PARTICLES: usize = 32;
/// Largest number of generations.
pub(super) const GENERATIONS: usize = 200;
/// Inertia weight of the first and of the last generation.
const INERTIA: [f64; 2] = [0.9, 0.4];
/// Acceleration towards a particle's own best position and towards the swarm's.
const ACCELERATION: f64 = 2.0;
/// Largest velocity, as a share of the start range.
const LIMIT: f64 = 0.2;
/// Number of rows on which particles are compared.
const ROWS: usize = 2048;
/// The swarm has gathered when the best costs of half of the particles are within this share of the lowest.
const GATHERED: f64 = 1e-2;
/// The swarm stops when the best costs of all particles are within this share of the lowest.
const STOPPED: f64 = 1e-9;

/// A model that a swarm can search.
pub(super) trait Swarmed: SearchedModel {
    /// Range of starting values of each parameter, within its bounds.
    fn start_ranges(&self) -> Vec<[f64; 2]>;
}

/// Searches the parameters of `searched` on a sample of the rows of `datasets`, and evaluates the result on all rows.
pub(super) fn search<S: Swarmed>(
    datasets: &[Dataset],
    searched: &S,
    options: &Options,
    watch: &Watch,
) -> Result<Found, Error> {
    let sample = RowProblem::sample(datasets, searched.clone(), ROWS, options.seed, watch.flag());
    let (bounds, ranges) = (searched.bounds(), searched.start_ranges());
    let cost = |parameters: &[f64]| sample.cost(parameters, options.loss);
    let gathered = fly(&bounds, &ranges, options.seed, watch, cost).ok_or(Error::Cancelled)?;
    if !gathered.cost.is_finite() {
        return Err(IdentifyError::NoFiniteError.into());
    }
    let restart_rsse_n = vec![(gathered.cost / sample.counted().max(1) as f64).sqrt()];
    search::finish(datasets, searched, &gathered.position, options, watch).map(|found| Found {
        restart_rsse_n,
        converged: gathered.converged,
        ..found
    })
}

/// The best position of a swarm.
#[derive(Debug, Clone, PartialEq)]
struct Gathered {
    position: Vec<f64>,
    cost: f64,
    /// True when half of the particles found a cost as low as the lowest.
    converged: bool,
}

/// One particle: position, velocity, and its best position with the cost there.
struct Particle {
    position: Vec<f64>,
    velocity: Vec<f64>,
    own: Vec<f64>,
    cost: f64,
}

/// Minimises `cost` within `bounds`, from positions in `ranges`; `None` if cancelled. A cost that is not finite is never
/// the lowest.
fn fly(
    bounds: &[[f64; 2]],
    ranges: &[[f64; 2]],
    seed: u64,
    watch: &Watch,
    cost: impl Fn(&[f64]) -> Option<f64> + Sync,
) -> Option<Gathered> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut particles: Vec<Particle> = (0..PARTICLES)
        .map(|_| {
            let position: Vec<f64> =
                ranges.iter().map(|[low, high]| low + (high - low) * random.random::<f64>()).collect();
            let velocity = vec![0.0; ranges.len()];
            Particle { own: position.clone(), position, velocity, cost: f64::INFINITY }
        })
        .collect();
    let mut best = Gathered { position: particles[0].own.clone(), cost: f64::INFINITY, converged: false };
    for generation in 0..=GENERATIONS {
        let costs: Option<Vec<f64>> =
            parallel::map(&particles, |particle| cost(&particle.position)).into_iter().collect();
        for (particle, cost) in particles.iter_mut().zip(costs?) {
            if cost < particle.cost {
                particle.cost = cost;
                particle.own.copy_from_slice(&particle.position);
            }
            // Of equal costs the first particle's stays.
            if particle.cost < best.cost {
                best.cost = particle.cost;
                best.position.copy_from_slice(&particle.own);
            }
        }
        watch.report(Progress::Epoch { done: generation as u32, of: GENERATIONS as u32 });
        let as_low = |share: f64| particles.iter().filter(|p| p.cost <= best.cost * (1.0 + share)).count();
        best.converged = best.cost.is_finite() && 2 * as_low(GATHERED) >= PARTICLES;
        if generation == GENERATIONS || as_low(STOPPED) == PARTICLES {
            break;
        }
        let progress = generation as f64 / GENERATIONS as f64;
        let inertia = INERTIA[0] + (INERTIA[1] - INERTIA[0]) * progress;
        for particle in &mut particles {
            advance(particle, &best.position, inertia, [bounds, ranges], &mut random);
        }
    }
    Some(best)
}

/// Moves a particle by one generation.
fn advance(
    particle: &mut Particle,
    best: &[f64],
    inertia: f64,
    [bounds, ranges]: [&[[f64; 2]]; 2],
    random: &mut Pcg64Mcg,
) {
    for j in 0..best.len() {
        let (p, limit) = (particle.position[j], LIMIT * (ranges[j][1] - ranges[j][0]));
        let [r1, r2] = [random.random::<f64>(), random.random::<f64>()];
        let pulled = ACCELERATION * (r1 * (particle.own[j] - p) + r2 * (best[j] - p));
        let velocity = (inertia * particle.velocity[j] + pulled).clamp(-limit, limit);
        let moved = (p + velocity).clamp(bounds[j][0], bounds[j][1]);
        particle.velocity[j] = if moved == p + velocity { velocity } else { 0.0 };
        particle.position[j] = moved;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

    /// Distance from a given minimum, along axes of different scale.
    fn bowl(p: &[f64]) -> f64 {
        (p[0] - 300.0).powi(2) / 1e4 + (p[1] + 0.02).powi(2) * 1e4 + (p[2] - 1.0).powi(2)
    }

    /// Rastrigin's function: its only global minimum is the origin, among 11^2 local ones in the range.
    fn rastrigin(p: &[f64]) -> f64 {
        p.iter().map(|x| x * x - 10.0 * (std::f64::consts::TAU * x).cos() + 10.0).sum()
    }

    #[test]
    fn a_swarm_finds_the_known_minimum_within_its_evaluations() {
        let count = AtomicUsize::new(0);
        let counted = |p: &[f64]| {
            count.fetch_add(1, Ordering::Relaxed);
            Some(bowl(p))
        };
        let ranges = [[0.0, 1000.0], [-0.1, 0.1], [-3.0, 0.0]];
        let found = fly(&[FREE; 3], &ranges, 3, &Watch::none(), counted).expect("not cancelled");
        // The third coordinate lies outside of the start range and inside of the bounds.
        for (found, truth, scale) in
            [(found.position[0], 300.0, 1e2), (found.position[1], -0.02, 1e-2), (found.position[2], 1.0, 1.0)]
        {
            assert!((found - truth).abs() < 0.02 * scale, "{found} {truth}");
        }
        assert!(found.cost < 1e-4, "{found:?}");
        assert!(count.load(Ordering::Relaxed) <= PARTICLES * (GENERATIONS + 1));
    }

    #[test]
    fn a_swarm_leaves_local_minima() {
        for seed in 0..5 {
            let cost = |p: &[f64]| Some(rastrigin(p));
            let found =
                fly(&[FREE; 2], &[[-5.12, 5.12]; 2], seed, &Watch::none(), cost).expect("not cancelled");
            assert!(found.cost < 1e-2, "seed {seed}: {found:?}");
        }
    }

    #[test]
    fn bounds_hold_and_costs_that_are_not_finite_lose() {
        let bounds = [[0.0, 1000.0], [-0.01, 0.1], [-3.0, 0.5]];
        let cost = |p: &[f64]| Some(if p[0] < 200.0 { f64::NAN } else { bowl(p) });
        let found = fly(&bounds, &[[0.0, 1000.0], [0.0, 0.1], [-3.0, 0.0]], 1, &Watch::none(), cost);
        let found = found.expect("not cancelled");
        assert_eq!((found.position[1], found.position[2]), (-0.01, 0.5));
        assert!((found.position[0] - 300.0).abs() < 0.1, "{found:?}");
        let nowhere = fly(&bounds, &bounds, 1, &Watch::none(), |_| Some(f64::NAN)).expect("not cancelled");
        assert!(nowhere.cost.is_infinite() && !nowhere.converged);
    }

    #[test]
    fn the_result_does_not_depend_on_the_number_of_threads() {
        let run = || {
            let cost = |p: &[f64]| Some(rastrigin(p));
            fly(&[FREE; 4], &[[-5.12, 5.12]; 4], 9, &Watch::none(), cost)
        };
        let in_pool = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(run)
        };
        assert_eq!(in_pool(1), in_pool(4));
    }
}
