//! The choice of segments.
//!
//! ```text
//! q_AB = (z / 4) min(1, sqrt(share / 0.4))        z: expected discrimination, share: d_AB^2 / d_A^2
//! cost = sum of w / q^2 over the pairs                                the worst pairs decide, and no pair is without influence
//! ```
//!
//! The scalar products of a plan are the sums of its segments' products, so a plan costs one factorisation and no simulation. The search
//! starts with the mean of all candidates in each place, replaces place by place with the best candidate, and goes over all places until
//! nothing improves.

use super::criterion::{PairOfForms, Squares, squares};
use crate::error::Error;
use crate::identify::Watch;
use crate::parallel;
use nalgebra::DMatrix;

/// Independent samples of the error in a second. The error of a good model is noise through the filter of the force (tens a second) and
/// misfit that follows the motion (a few a second).
pub(super) const INDEPENDENT_PER_S: f64 = 10.0;
/// Wanted expected discrimination.
const WANTED_Z: f64 = 4.0;
/// Wanted share of the change by the truth that the rival cannot take. Below a tenth the diagnosis puts both in one class.
const WANTED_SHARE: f64 = 0.4;
/// Largest number of uses of one candidate in a part: a run that repeats one segment trusts the model there too much.
const MOST_USES: usize = 2;
/// Largest number of rounds over all places.
const ROUNDS: usize = 4;

/// A pair with its weight in the cost, and the quality above which more does not count.
pub(super) struct Weighted {
    pub(super) pair: PairOfForms,
    pub(super) weight: f64,
    pub(super) enough: f64,
}

/// Expected discrimination of a squared distance over `rows` rows of `seconds` seconds: half the distance of the two models in standard
/// deviations of the sum that decides between them.
pub(super) fn discrimination(squares: f64, rows: f64, seconds: f64, noise_n: f64) -> f64 {
    0.5 * (INDEPENDENT_PER_S * seconds * squares / rows.max(1.0)).sqrt() / noise_n
}

/// The cost of distances over `rows` rows of `seconds` seconds.
pub(super) fn cost(found: &[Squares], pairs: &[Weighted], rows: f64, seconds: f64, noise_n: f64) -> f64 {
    let one = |(found, weighted): (&Squares, &Weighted)| {
        let z = discrimination(found.apart, rows, seconds, noise_n);
        let share = if found.alone > 0.0 { found.apart / found.alone } else { 0.0 };
        let quality = (z / WANTED_Z * (share / WANTED_SHARE).sqrt().min(1.0)).clamp(1e-6, weighted.enough);
        weighted.weight / (quality * quality)
    };
    found.iter().zip(pairs).map(one).sum()
}

/// The scalar products of a candidate with its number of rows.
#[derive(Clone)]
pub(super) struct Sums {
    pub(super) gram: DMatrix<f64>,
    pub(super) rows: f64,
}

/// The inputs of the search.
pub(super) struct Search<'a> {
    pub(super) candidates: &'a [Sums],
    pub(super) nuisance: usize,
    pub(super) pairs: &'a [Weighted],
    /// Time of a row, s.
    pub(super) row_s: f64,
    pub(super) noise_n: f64,
    /// Number of places of a part, and of parts.
    pub(super) places: usize,
    pub(super) parts: usize,
}

impl Search<'_> {
    fn cost(&self, sums: &Sums) -> f64 {
        let found = squares(&sums.gram, self.nuisance, self.pairs.iter().map(|weighted| &weighted.pair));
        // Each part has these sums once more; the squares and the rows grow together.
        let seconds = sums.rows * self.row_s * self.parts as f64;
        cost(&found, self.pairs, sums.rows, seconds, self.noise_n)
    }

    /// The candidates at the places, best first found; empty without candidates.
    pub(super) fn run(&self, watch: &Watch) -> Result<Vec<usize>, Error> {
        let Some(first) = self.candidates.first() else { return Ok(Vec::new()) };
        let n = first.gram.nrows();
        let empty = Sums { gram: DMatrix::zeros(n, n), rows: 0.0 };
        let mut mean = self.candidates.iter().fold(empty, |sum, one| add(&sum, one, 1.0));
        let count = self.candidates.len() as f64;
        mean = Sums { gram: mean.gram / count, rows: mean.rows / count };
        let mut chosen: Vec<Option<usize>> = vec![None; self.places.max(1)];
        let mut total =
            Sums { gram: &mean.gram * chosen.len() as f64, rows: mean.rows * chosen.len() as f64 };
        let mut least = f64::INFINITY;
        for round in 0..ROUNDS {
            let mut improved = false;
            for place in 0..chosen.len() {
                if watch.is_cancelled() {
                    return Err(Error::Cancelled);
                }
                let here = chosen[place].map_or(&mean, |k| &self.candidates[k]);
                let without = add(&total, here, -1.0);
                let costs: Vec<f64> =
                    parallel::map(self.candidates, |one| self.cost(&add(&without, one, 1.0)));
                let uses = |k: usize| {
                    chosen.iter().enumerate().filter(|(at, other)| *at != place && **other == Some(k)).count()
                };
                let free = costs.iter().enumerate().filter(|(k, _)| uses(*k) < MOST_USES);
                let best = free.min_by(|a, b| a.1.total_cmp(b.1));
                let Some((best, cost)) = best else { continue };
                // In the first round each place is taken, even if the mean of all candidates is better.
                if round == 0 || *cost < least * (1.0 - 1e-9) {
                    improved |= chosen[place] != Some(best);
                    chosen[place] = Some(best);
                    least = *cost;
                    total = add(&without, &self.candidates[best], 1.0);
                }
            }
            if !improved {
                break;
            }
        }
        Ok(chosen.into_iter().flatten().collect())
    }
}

fn add(a: &Sums, b: &Sums, sign: f64) -> Sums {
    Sums { gram: &a.gram + &b.gram * sign, rows: a.rows + sign * b.rows }
}
