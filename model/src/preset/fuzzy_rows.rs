//! The thesis' three current-fuzzy tanh models, of seven functions each, from `data/fuzzy-tanh.csv`.
//!
//! Of the columns d4 and d5 only the ratio d4/d5 = kappa (1/s) matters; `force::fuzzy_tanh` explains why it is
//! this ratio and not its inverse.

use super::tables::{FUZZY_TANH, rows_of};
use crate::error::Error;
use crate::force::{FuzzySets, FuzzyTanh, Membership, TanhFunction};
use crate::sample::DriveKind;
use crate::units::{M_PER_IN, N_M_PER_LBF_IN, N_PER_LBF};

/// Centres of the membership functions, A.
pub(crate) const CENTRES_A: [f64; 7] = [0.0, 0.4, 0.8, 1.2, 1.6, 2.1, 2.5];
/// Standard deviation of the membership functions, A.
pub(crate) const SIGMA_A: f64 = 0.2;

/// The model of `experiment`; `None` unless it is one of the last three.
pub(super) fn model(experiment: &str) -> Option<FuzzyTanh> {
    let function = |[d1, d2, d3, d4, d5]: [f64; 5]| TanhFunction {
        yield_force_n: d1 * N_PER_LBF,
        post_yield_damping_n_s_m: d2 * N_M_PER_LBF_IN,
        pre_yield_slope_s_m: d3 / M_PER_IN,
        coupling_per_s: d4 / d5,
    };
    let functions: Vec<TanhFunction> = rows_of(&FUZZY_TANH, experiment).into_iter().map(function).collect();
    // Without a row for the experiment, the number of functions differs from the number of centres.
    FuzzyTanh::new(sets(&CENTRES_A).ok()?, &functions, 0.0).ok()
}

/// Membership functions of the thesis' width around `centres`, A.
pub(super) fn sets(centres: &[f64]) -> Result<FuzzySets, Error> {
    FuzzySets::new(Membership { drive: DriveKind::CoilCurrent, sigma: SIGMA_A }, centres)
}
