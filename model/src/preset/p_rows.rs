//! Coefficients of the thesis' phase-transition model P (tables B.7 passive; B.8 and B.9 semi-active,
//! quadratic in the current).
//!
//! Printed units: p1 lbf·s/in, p2 s, p3 s^2, p4 lbf^-2, p5 lbf^-4. Some entries have only one or two digits
//! (p31 of RP-ICPS, p42 of RP-PRBS), so p4 of RP-PRBS at 2.5 A is 3e-5 +- 12e-5.

use crate::force::Phase;
use crate::sample::DriveKind;
use crate::units::{N_M_PER_LBF_IN, N_PER_LBF};

/// Factors that convert p1 to p5 to SI.
const SI: [f64; 5] = [
    N_M_PER_LBF_IN,
    1.0,
    1.0,
    1.0 / (N_PER_LBF * N_PER_LBF),
    1.0 / (N_PER_LBF * N_PER_LBF * N_PER_LBF * N_PER_LBF),
];

#[rustfmt::skip]
const PASSIVE: [[f64; 5]; 8] = [
    [19.049, 0.017, -0.0003, 2.53e-5, -2.63e-10], // RP-ICPS
    [22.503, 0.018, -0.00024, 2.31e-5, -3.05e-10], // RP-APRBS
    [13.089, 0.014, -0.00021, 3.68e-5, -4.22e-10], // RP-PRBS
    [25.043, 0.017, -0.00019, 2.21e-5, -3.38e-10], // RP-APRBS-L
    [21.261, 0.017, -0.00025, 2.39e-5, -2.65e-10], // RP-ICPS-L
    [16.395, 0.018, -0.00039, 1.90e-5, -1.48e-10], // RP1-CS
    [14.236, 0.020, -0.0005, 1.96e-5, -1.44e-10], // RP2-CS
    [14.903, 0.019, -0.0005, 2.00e-5, -1.56e-10], // RP3-CS
];

/// For each experiment: the constants, the coefficients of i, and the coefficients of i^2.
#[rustfmt::skip]
const SEMI_ACTIVE: [[[f64; 5]; 3]; 8] = [
    [ // RP-ICPS
        [11.834, 0.0120, -0.0001, 7.32e-5, -1.44e-9],
        [4.090, 0.0015, -0.00016, -3.52e-5, 7.75e-10],
        [1.634, 0.0007, 2.88e-5, 4.75e-6, -1.06e-10],
    ],
    [ // RP-APRBS
        [11.548, 0.0161, -0.00015, 5.76e-5, -1.48e-9],
        [12.648, 0.0030, -4.56e-5, -2.42e-5, 7.17e-10],
        [-2.426, -0.0011, -2.35e-6, 3.11e-6, -7.68e-11],
    ],
    [ // RP-PRBS
        [8.282, 0.0073, -0.00015, 0.000153, -4.53e-9],
        [1.055, 0.0094, -1.88e-5, -0.0001, 3.34e-9],
        [3.021, -0.0025, 2.12e-5, 2.05e-5, -6.48e-10],
    ],
    [ // RP-APRBS-L
        [9.505, 0.0085, -0.00016, 8.61e-5, -1.36e-9],
        [3.519, 0.0056, -0.00022, -4.82e-5, 7.00e-10],
        [1.806, -0.0018, 0.000109, 9.18e-6, -1.04e-10],
    ],
    [ // RP-ICPS-L
        [9.689, 0.0140, -0.00014, 9.48e-5, -4.40e-9],
        [13.204, 0.0036, -8.91e-5, -5.84e-5, 3.55e-9],
        [-0.838, -0.0011, 4.50e-5, 1.03e-5, -7.51e-10],
    ],
    [ // RP1-CS
        [3.743, 0.0281, -0.00054, 0.000188, -6.74e-9],
        [4.212, -0.0127, 0.000221, -0.00014, 5.53e-9],
        [8.070, 0.0057, -4.04e-5, 2.28e-5, -1.13e-9],
    ],
    [ // RP2-CS
        [4.687, 0.0243, -0.00041, 0.000142, -5.08e-9],
        [3.416, -0.0091, 2.99e-5, -9.38e-5, 4.12e-9],
        [5.055, 0.0036, 1.04e-5, 1.51e-5, -8.37e-10],
    ],
    [ // RP3-CS
        [6.604, 0.0256, -0.00031, 2.81e-5, -2.07e-9],
        [15.716, -0.0035, -4.24e-5, -1.08e-5, 1.62e-9],
        [0.148, 0.0010, 4.08e-5, -3.26e-7, -3.18e-10],
    ],
];

/// The passive model of experiment number `row`.
pub(super) fn passive(row: usize) -> Option<Phase> {
    Phase::new(None, &in_si(PASSIVE.get(row)?)).ok()
}

/// The semi-active model of experiment number `row`.
pub(super) fn semi_active(row: usize) -> Option<Phase> {
    let copies = SEMI_ACTIVE.get(row)?.map(|copy| in_si(&copy));
    Phase::new(Some(DriveKind::CoilCurrent), copies.as_flattened()).ok()
}

fn in_si(row: &[f64; 5]) -> [f64; 5] {
    std::array::from_fn(|j| row[j] * SI[j])
}

#[cfg(test)]
mod tests {
    use super::super::EXPERIMENTS;
    use super::*;
    use crate::force::ForceMotion;
    use crate::units::M_PER_IN;

    #[test]
    fn no_published_set_can_run_as_a_model() {
        let mut folding = 0;
        for (row, name) in EXPERIMENTS.iter().enumerate() {
            let alone = passive(row).expect("a relation");
            let why = alone.cannot_run(0.0).expect("diverges");
            assert!(why.roots.iter().flatten().all(|root| root.re_per_s > 0.0), "{name}: {why}");
            folding += usize::from(why.folds_at_n.is_some());
            let with_current = semi_active(row).expect("a relation");
            for i in [0.0, 0.5, 1.0, 1.5, 2.0, 2.5] {
                let why = with_current.cannot_run(i).expect("diverges");
                assert_eq!(
                    why.roots.iter().flatten().filter(|r| r.re_per_s > 0.0).count(),
                    2,
                    "{name} {i} A"
                );
            }
        }
        assert_eq!(folding, 5, "number of passive sets whose static velocity is not monotonic");
    }

    #[test]
    fn terms_match_the_printed_numbers() {
        // RP-ICPS, passive, in the printed units, at v = 4 in/s, F = 80 lbf, F' = 500 lbf/s, F'' = -20000
        // lbf/s^2.
        let expected_lbf = 19.049 * 4.0 + 0.017 * 500.0 + 0.0003 * 20_000.0 + 2.53e-5 * 80f64.powi(3)
            - 2.63e-10 * 80f64.powi(5);
        let measured = ForceMotion {
            force_n: 80.0 * N_PER_LBF,
            rate_n_s: 500.0 * N_PER_LBF,
            curvature_n_s2: -20_000.0 * N_PER_LBF,
        };
        let found = passive(0).expect("a relation").same_instant_n(4.0 * M_PER_IN, &measured, f64::NAN);
        assert!((found / N_PER_LBF - expected_lbf).abs() < 1e-9, "{found}");
        // Static velocity of the semi-active form at 1 A: p = 17.558, p4 = 4.275e-5, p5 = -7.71e-10.
        let still = ForceMotion { rate_n_s: 0.0, curvature_n_s2: 0.0, ..measured };
        let expected_in_s = (80.0 - 4.275e-5 * 80f64.powi(3) + 7.71e-10 * 80f64.powi(5)) / 17.558;
        let found = semi_active(0).expect("a relation").velocity_m_s(&still, 1.0) / M_PER_IN;
        assert!((found - expected_in_s).abs() < 1e-9, "{found} instead of {expected_in_s}");
    }
}
