//! Linear least squares in which some unknowns must not be negative, by the active-set method of Lawson and Hanson on the normal
//! equations.
//!
//! ```text
//! minimise   x'A x / 2 - b'x   where x_j >= 0 for j in N
//! minimum    g = A x - b:   g_j = 0 where x_j > 0 or j is not in N,   g_j >= 0 where x_j = 0       (Karush, Kuhn and Tucker)
//! ```
//!
//! The unknowns that are not in N are free from the start. Of the unknowns at zero, the one whose gradient falls most steeply is
//! released, and the system of all free ones is solved. If the solution has negative unknowns, the way to it ends where the first one
//! reaches zero; this one is held again, and the rest is solved once more. Each solution has a smaller value than the one before, so
//! no set of free unknowns occurs twice, and the method ends.
//!
//! The system is scaled to a unit diagonal, so the units of the unknowns do not matter.
//!
//! Source: `[lawson1974]`, chapter 23, on the normal equations as in `[bro1997]` (node/docs/guide/bibliography.md).

use nalgebra::{DMatrix, DVector};

/// A gradient smaller than this, relative to the largest entry of the scaled right side, counts as zero.
const FLAT: f64 = 1e-11;
/// Most releases per unknown. The method needs about one.
const RELEASES: usize = 5;

/// The minimum, or the best point if the releases were used up.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Minimum {
    /// The unknowns.
    pub(super) x: DVector<f64>,
    /// False when the releases were used up, or a system could not be solved.
    pub(super) converged: bool,
}

/// Minimises `x'A x / 2 - b'x` with `square` as A and `right` as b. The unknowns for which `nonnegative` is true must not be negative.
/// An unknown with a zero on the diagonal of A has no effect and stays zero.
pub(super) fn minimise(
    square: &DMatrix<f64>,
    right: &DVector<f64>,
    nonnegative: impl Fn(usize) -> bool,
) -> Minimum {
    let n = right.len();
    let scale = square.diagonal().map(|d| if d > 0.0 { d.sqrt().recip() } else { 0.0 });
    let a = DMatrix::from_fn(n, n, |j, k| square[(j, k)] * scale[j] * scale[k]);
    let b = right.component_mul(&scale);
    let system = System { a, b };
    let (x, converged) = system.solve(&nonnegative, |j| scale[j] > 0.0);
    Minimum { x: x.component_mul(&scale), converged }
}

/// A scaled system.
struct System {
    a: DMatrix<f64>,
    b: DVector<f64>,
}

impl System {
    fn solve(
        &self,
        nonnegative: &impl Fn(usize) -> bool,
        known: impl Fn(usize) -> bool,
    ) -> (DVector<f64>, bool) {
        let n = self.b.len();
        let flat = FLAT * self.b.amax();
        let mut free: Vec<bool> = (0..n).map(|j| known(j) && !nonnegative(j)).collect();
        let mut x = DVector::zeros(n);
        if !self.advance(&mut x, &mut free, nonnegative) {
            return (x, false);
        }
        // Unknowns that rounding held again at once after a release; they are not released twice in a row.
        let mut refused = vec![false; n];
        for _ in 0..RELEASES * n.max(1) {
            let descent = &self.b - &self.a * &x;
            let steepest = (0..n)
                .filter(|&j| known(j) && !free[j] && !refused[j] && descent[j] > flat)
                .max_by(|&j, &k| descent[j].total_cmp(&descent[k]));
            let Some(steepest) = steepest else { return (x, true) };
            free[steepest] = true;
            if !self.advance(&mut x, &mut free, nonnegative) {
                return (x, false);
            }
            if free[steepest] {
                refused.fill(false);
            } else {
                refused[steepest] = true;
            }
        }
        (x, false)
    }

    /// Moves `x` to the minimum over the free unknowns, holding those that would become negative. False if a system has no solution.
    fn advance(&self, x: &mut DVector<f64>, free: &mut [bool], nonnegative: &impl Fn(usize) -> bool) -> bool {
        loop {
            let Some(target) = self.over(free) else { return false };
            let limits = |j: usize| free[j] && nonnegative(j) && target[j] <= 0.0;
            let share = (0..x.len())
                .filter(|&j| limits(j))
                .map(|j| if x[j] > 0.0 { x[j] / (x[j] - target[j]) } else { 0.0 })
                .fold(f64::INFINITY, f64::min);
            if share == f64::INFINITY {
                *x = target;
                return true;
            }
            let held: Vec<usize> = (0..x.len())
                .filter(|&j| limits(j))
                .filter(|&j| x[j] <= 0.0 || x[j] / (x[j] - target[j]) <= share)
                .collect();
            *x += (target - &*x) * share;
            // At least one unknown is held in every turn, so the loop ends.
            for j in held {
                (x[j], free[j]) = (0.0, false);
            }
        }
    }

    /// The minimum over the free unknowns without regard to their signs; the others are zero.
    fn over(&self, free: &[bool]) -> Option<DVector<f64>> {
        let chosen: Vec<usize> = (0..free.len()).filter(|&j| free[j]).collect();
        let m = chosen.len();
        let mut all = DVector::zeros(free.len());
        if m > 0 {
            let a = DMatrix::from_fn(m, m, |j, k| self.a[(chosen[j], chosen[k])]);
            let b = DVector::from_fn(m, |j, _| self.b[chosen[j]]);
            let solution = a.cholesky()?.solve(&b);
            chosen.iter().zip(solution.iter()).for_each(|(&j, value)| all[j] = *value);
        }
        Some(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A positive definite system from a matrix of `n + 4` rows, and its right side.
    fn system(n: usize) -> impl Strategy<Value = (DMatrix<f64>, DVector<f64>)> {
        let rows = n + 4;
        (prop::collection::vec(-1.0..1.0_f64, rows * n), prop::collection::vec(-1.0..1.0_f64, rows)).prop_map(
            move |(entries, y)| {
                let m = DMatrix::from_row_slice(rows, n, &entries);
                let mut square = m.transpose() * &m;
                square += DMatrix::identity(n, n) * 1e-5;
                (square, m.transpose() * DVector::from_vec(y))
            },
        )
    }

    proptest! {
        #[test]
        fn the_minimum_meets_the_conditions_of_karush_kuhn_and_tucker(
            (square, right) in (1..14_usize).prop_flat_map(system), mask in 0_u32..16_384,
        ) {
            let nonnegative = |j: usize| mask >> j & 1 == 1;
            let found = minimise(&square, &right, nonnegative);
            prop_assert!(found.converged);
            let gradient = &square * &found.x - &right;
            for (j, (x, g)) in found.x.iter().zip(gradient.iter()).enumerate() {
                prop_assert!(*x >= 0.0 || !nonnegative(j), "x[{j}] = {x}");
                let at_zero = nonnegative(j) && *x == 0.0;
                prop_assert!(if at_zero { *g >= -1e-9 } else { g.abs() < 1e-9 }, "x[{j}] = {x}, gradient {g}");
            }
        }

        #[test]
        fn units_do_not_matter((square, right) in system(6), powers in prop::array::uniform6(-8..8_i32)) {
            let nonnegative = |j: usize| j < 4;
            let plain = minimise(&square, &right, nonnegative);
            let unit = powers.map(|power| 10.0_f64.powi(power));
            let scaled = DMatrix::from_fn(6, 6, |j, k| square[(j, k)] * unit[j] * unit[k]);
            let found = minimise(&scaled, &DVector::from_fn(6, |j, _| right[j] * unit[j]), nonnegative);
            for (j, unit) in unit.iter().enumerate() {
                prop_assert!((found.x[j] * unit - plain.x[j]).abs() < 1e-6 * (1.0 + plain.x[j].abs()));
            }
        }
    }

    #[test]
    fn an_unknown_that_wants_to_be_negative_is_zero_and_the_others_adapt() {
        let square = DMatrix::from_row_slice(2, 2, &[2.0, 1.0, 1.0, 2.0]);
        // Without the bound: (5, -4).
        let right = DVector::from_vec(vec![6.0, -3.0]);
        let found = minimise(&square, &right, |_| true);
        assert!((found.x[0] - 3.0).abs() < 1e-12 && found.x[1] == 0.0, "{found:?}");
        let free = minimise(&square, &right, |_| false);
        assert!((free.x[0] - 5.0).abs() < 1e-12 && (free.x[1] + 4.0).abs() < 1e-12, "{free:?}");
    }

    #[test]
    fn an_unknown_without_effect_stays_zero() {
        let square = DMatrix::from_row_slice(2, 2, &[2.0, 0.0, 0.0, 0.0]);
        for bound in [true, false] {
            let found = minimise(&square, &DVector::from_vec(vec![6.0, 0.0]), |_| bound);
            assert!(found.converged && (found.x[0] - 3.0).abs() < 1e-12 && found.x[1] == 0.0, "{found:?}");
        }
    }
}
