//! Bootstrap over runs: how much a fit depends on which runs were recorded.
//!
//! ```text
//! draw b of B:   run_1*, ..., run_n*  drawn with replacement from the n runs;   theta_b* = fit(run_1*, ..., run_n*)
//! error          standard deviation of theta_1*, ..., theta_B*
//! interval       their 2.5 % and 97.5 % quantiles
//! ```
//!
//! The samples of a run depend on each other, and a run has errors of its own (an offset, a temperature). So whole runs are
//! drawn, not samples. With n runs, a draw leaves out a given run with probability (1 - 1/n)^n, about 0.37.
//!
//! Source: `[efron1993]` in the bibliography (node/docs/guide/bibliography.md), chapters 6 and 13.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Indices of the runs of each of `draws` draws, from `runs` runs; the same for the same `seed`. Empty without runs.
///
/// A draw that holds one run only is drawn again if there are several, because it says nothing about the others.
///
/// ```
/// use mr_damper_model::statistics::bootstrap::resampled_runs;
///
/// let draws = resampled_runs(4, 200, 7);
/// assert!(draws.len() == 200 && draws.iter().all(|runs| runs.len() == 4));
/// assert_eq!(draws, resampled_runs(4, 200, 7));
/// ```
#[must_use]
pub fn resampled_runs(runs: usize, draws: usize, seed: u64) -> Vec<Vec<usize>> {
    if runs == 0 {
        return Vec::new();
    }
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut draw = || -> Vec<usize> {
        loop {
            let drawn: Vec<usize> = (0..runs).map(|_| random.random_range(0..runs)).collect();
            if runs == 1 || drawn.iter().any(|run| *run != drawn[0]) {
                return drawn;
            }
        }
    };
    (0..draws).map(|_| draw()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_drawn_with_replacement_and_by_seed() {
        let draws = resampled_runs(8, 2000, 3);
        assert_eq!(draws, resampled_runs(8, 2000, 3));
        assert_ne!(draws, resampled_runs(8, 2000, 4));
        assert!(draws.iter().all(|draw| draw.len() == 8 && draw.iter().all(|run| *run < 8)));
        // Each run is missing from (1 - 1/8)^8 = 0.3436 of the draws; five standard deviations of 2000 draws are 0.053.
        for run in 0..8 {
            let missing = draws.iter().filter(|draw| !draw.contains(&run)).count() as f64 / 2000.0;
            assert!((missing - 0.3436).abs() < 0.053, "{run}: {missing}");
        }
    }

    #[test]
    fn a_draw_of_one_run_alone_is_drawn_again() {
        assert!(resampled_runs(2, 100, 1).iter().all(|draw| draw[0] != draw[1]));
        assert_eq!(resampled_runs(1, 2, 1), [[0], [0]]);
        assert!(resampled_runs(0, 3, 1).is_empty());
    }
}
