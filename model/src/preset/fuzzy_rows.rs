//! Coefficients of the thesis' current-fuzzy tanh model (table D.1): three models of seven functions.
//!
//! Columns as printed: A1 lbf, A2 lbf·s/in, A3 s/in, X0, V0. Only the ratio X0/V0 = kappa (1/s) matters;
//! `force::fuzzy_tanh` explains why it is this ratio and not its inverse. Centres 0 to 2.5 A, sigma .2 A.

use crate::error::Error;
use crate::force::{FuzzySets, FuzzyTanh, Membership, TanhFunction};
use crate::sample::DriveKind;
use crate::units::{M_PER_IN, N_M_PER_LBF_IN, N_PER_LBF};

/// Centres of the membership functions, A.
pub const CENTRES_A: [f64; 7] = [0.0, 0.4, 0.8, 1.2, 1.6, 2.1, 2.5];
/// Standard deviation of the membership functions, A.
pub const SIGMA_A: f64 = 0.2;

#[rustfmt::skip]
const ROWS: [[[f64; 5]; 7]; 3] = [
    [ // RP1-CS
        [25.2265, 3.0650, 4.6028, -3200.0681, 2109.8135],
        [52.1981, 3.0503, 0.6770, 415.0016, -183.1820],
        [81.5221, 3.2595, 0.4783, 629.8635, -272.7241],
        [171.6249, 0.2753, 0.2504, 714.7907, -317.1429],
        [48.3849, 24.2010, 0.7565, -148.0621, 68.6384],
        [34.6003, 34.5981, 4.0249, -26.3173, 13.9835],
        [38.5583, 37.7723, 4.2741, -23.6473, 13.2332],
    ],
    [ // RP2-CS
        [17.0918, 3.2781, 2.7087, -1.4775, 1.8047],
        [54.4845, 2.6434, 0.6610, -708.1935, 301.5387],
        [87.0530, 2.3311, 0.4572, -719.4389, 303.4493],
        [197.3649, -2.2904, 0.2292, 808.5372, -353.0962],
        [64.9750, 20.2574, 0.5609, 70.4272, -31.7165],
        [39.5097, 32.6552, 3.2390, 1054.1195, -541.9325],
        [43.2435, 35.7863, 3.5948, 11.8777, -6.4219],
    ],
    [ // RP3-CS
        [17.0222, 3.3977, 2.6617, -2929.4556, 2468.9527],
        [53.8456, 2.6965, 0.6524, -766.0747, 300.3521],
        [83.8162, 3.2644, 0.4669, 1423.8401, -559.0957],
        [99.6419, 10.2792, 0.3517, -76.7070, 31.5043],
        [35.9105, 28.2310, 1.2507, -866.9619, 378.8263],
        [31.8596, 35.6241, 3.5689, -378.2586, 178.2317],
        [36.6054, 38.4434, 3.6598, -480.9478, 238.9911],
    ],
];

/// The model identified on `RP<set + 1>-CS`.
pub(super) fn model(set: usize) -> Option<FuzzyTanh> {
    let functions = ROWS.get(set)?.map(|[a1, a2, a3, x0, v0]| TanhFunction {
        yield_force_n: a1 * N_PER_LBF,
        post_yield_damping_n_s_m: a2 * N_M_PER_LBF_IN,
        pre_yield_slope_s_m: a3 / M_PER_IN,
        coupling_per_s: x0 / v0,
    });
    // The table holds finite numbers only, so construction cannot fail; a `None` would fail the tests.
    FuzzyTanh::new(sets(&CENTRES_A).ok()?, &functions, 0.0).ok()
}

/// Membership functions of the thesis' width around `centres`, A.
pub(super) fn sets(centres: &[f64]) -> Result<FuzzySets, Error> {
    FuzzySets::new(Membership { drive: DriveKind::CoilCurrent, sigma: SIGMA_A }, centres)
}
