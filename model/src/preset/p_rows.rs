//! The thesis' phase-transition model P, from `data/p-passive.csv` and, quadratic in the current,
//! `data/p-semi-active.csv`.
//!
//! Some printed entries have only one or two digits (c31 of RP-ICPS, c42 of RP-PRBS), so p4 of RP-PRBS at 2.5 A
//! is 3e-5 +- 12e-5.

use super::tables::{P_PASSIVE, P_SEMI_ACTIVE, find};
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

/// The passive relation of `experiment`.
pub(super) fn passive(experiment: &str) -> Option<Phase> {
    Phase::new(None, &super::in_si(find(&P_PASSIVE, [experiment])?, SI)).ok()
}

/// The semi-active relation of `experiment`.
pub(super) fn semi_active(experiment: &str) -> Option<Phase> {
    let copies = super::quadratic_in_si(find(&P_SEMI_ACTIVE, [experiment])?, SI);
    Phase::new(Some(DriveKind::CoilCurrent), copies.as_flattened()).ok()
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
        for name in EXPERIMENTS {
            let alone = passive(name).expect("a relation");
            let why = alone.cannot_run(0.0).expect("diverges");
            assert!(why.roots.iter().flatten().all(|root| root.re_per_s > 0.0), "{name}: {why}");
            folding += usize::from(why.folds_at_n.is_some());
            let with_current = semi_active(name).expect("a relation");
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
        let found =
            passive("rp-icps").expect("a relation").same_instant_n(4.0 * M_PER_IN, &measured, f64::NAN);
        assert!((found / N_PER_LBF - expected_lbf).abs() < 1e-9, "{found}");
        // Static velocity of the semi-active form at 1 A: p = 17.558, p4 = 4.275e-5, p5 = -7.71e-10.
        let still = ForceMotion { rate_n_s: 0.0, curvature_n_s2: 0.0, ..measured };
        let expected_in_s = (80.0 - 4.275e-5 * 80f64.powi(3) + 7.71e-10 * 80f64.powi(5)) / 17.558;
        let found = semi_active("rp-icps").expect("a relation").velocity_m_s(&still, 1.0) / M_PER_IN;
        assert!((found - expected_in_s).abs() < 1e-9, "{found} instead of {expected_in_s}");
    }
}
