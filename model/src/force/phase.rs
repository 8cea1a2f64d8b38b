//! Phase-transition model P (Wang and Kamath; thesis 2.1, 4.6, 4.7): a relation, not a model that can be
//! simulated.
//!
//! ```text
//! F = p1 v + p2 F' + p3 F'' + p4 F^3 + p5 F^5               one instant; all F measured, ' is d/dt
//! v = (F - p2 F' - p3 F'' - p4 F^3 - p5 F^5) / p1           the same, in the source's first form
//! p_j(i) = c_j0 + c_j1 i + ... + c_jd i^d                   semi-active form; the thesis has d = 2
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | p1 | `damping_n_s_m` | N·s/m | slope of force over velocity at low force |
//! | p2 | `force_rate_s` | s | coefficient of F' |
//! | p3 | `force_curvature_s2` | s² | coefficient of F'' |
//! | p4 | `cubic_per_n2` | N^-2 | coefficient of F^3 |
//! | p5 | `quintic_per_n4` | N^-4 | coefficient of F^5 |
//! | v, F | inputs | m/s, N | velocity, positive in extension, and measured force without its offset |
//!
//! # Why it is not a [`ForceModel`](super::ForceModel)
//! The right side contains the force of the same instant that it is to predict, and its derivatives, which
//! need future samples. Its error figures (`same_instant`) say how well the relation holds, and cannot be
//! compared with the figures of other models. Solved for F'', the relation is an oscillator; near rest its
//! characteristic equation is `1 - p2 s - p3 s^2 = 0`. With p2 > 0 and p3 < 0, as in every published set,
//! both roots lie in the right half plane and any error grows. The static curve v(F) folds back in many sets,
//! so that one velocity has three forces. [`Phase::cannot_run`] computes both.
//!
//! Source: `[wang2006]` in the bibliography (node/docs/guide/bibliography.md), equations 2.1, 4.6 and 4.7 of the thesis.

use super::dependence::MAX_DEGREE;
use crate::error::{CannotRun, Error, Root};
use crate::sample::DriveKind;

/// Number of parameters at one current.
pub const PHASE_PARAMETERS: usize = 5;

/// Names of the parameters, with their units.
pub const PHASE_NAMES: [&str; PHASE_PARAMETERS] =
    ["damping_n_s_m", "force_rate_s", "force_curvature_s2", "cubic_per_n2", "quintic_per_n4"];

/// The relation with its coefficients.
///
/// ```
/// use mr_damper_model::force::{ForceMotion, PHASE_NAMES};
/// use mr_damper_model::preset;
///
/// let relation = preset::phase("thesis/p-passive/rp-icps")?;
/// let measured = ForceMotion { force_n: 200.0, rate_n_s: 1e4, curvature_n_s2: 0.0 };
/// // Both forms of the equation agree.
/// let velocity_m_s = relation.velocity_m_s(&measured, f64::NAN);
/// assert!((relation.same_instant_n(velocity_m_s, &measured, f64::NAN) - 200.0).abs() < 1e-9);
///
/// // As a differential equation it is unstable, with p2 > 0 and p3 < 0.
/// let [_, p2, p3, ..] = relation.parameters_at(f64::NAN);
/// assert!(PHASE_NAMES[1] == "force_rate_s" && p2 > 0.0 && p3 < 0.0);
/// let why = relation.cannot_run(f64::NAN).expect("no published relation can run");
/// assert!(why.is_unstable() && why.roots.iter().flatten().all(|root| root.re_per_s > 0.0));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phase {
    drive: Option<DriveKind>,
    copies: usize,
    coefficients: [[f64; PHASE_PARAMETERS]; MAX_DEGREE + 1],
}

/// Measured force of one instant, without its offset, and its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceMotion {
    /// F, N.
    pub force_n: f64,
    /// F', N/s.
    pub rate_n_s: f64,
    /// F'', N/s².
    pub curvature_n_s2: f64,
}

impl Phase {
    /// The relation with `coefficients`, copy by copy: p1 to p5; for a semi-active form (with `drive`) first
    /// their constants, then their coefficients of i, and so on.
    ///
    /// # Errors
    /// When there are not 5 numbers without drive, or 10, 15, 20, 25 or 30 (degree 1 to 5) with one, or a number
    /// is not finite.
    pub fn new(drive: Option<DriveKind>, coefficients: &[f64]) -> Result<Self, Error> {
        let (copies, rest) = coefficients.as_chunks::<PHASE_PARAMETERS>();
        let allowed = if drive.is_some() { 2..=MAX_DEGREE + 1 } else { 1..=1 };
        if !rest.is_empty() || !allowed.contains(&copies.len()) {
            return Err(Error::Length {
                name: "coefficients of p".to_owned(),
                found: coefficients.len(),
                expected: "5 without a drive, or 10, 15, 20, 25 or 30 with one,".to_owned(),
            });
        }
        for (index, value) in coefficients.iter().enumerate() {
            let name = format!("{}[{}]", PHASE_NAMES[index % PHASE_PARAMETERS], index / PHASE_PARAMETERS);
            Error::check(&name, *value, "finite", |_| true)?;
        }
        let mut phase = Self { drive, copies: copies.len(), coefficients: Default::default() };
        phase.coefficients[..copies.len()].copy_from_slice(copies);
        Ok(phase)
    }

    /// The variable of the polynomials; `None` for a passive relation.
    #[must_use]
    pub const fn drive(&self) -> Option<DriveKind> {
        self.drive
    }

    /// All coefficients, copy by copy; see [`Phase::new`].
    #[must_use]
    pub fn coefficients(&self) -> &[f64] {
        self.coefficients[..self.copies].as_flattened()
    }

    /// Number of coefficients.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        PHASE_PARAMETERS * self.copies
    }

    /// p1 to p5 at `drive`, in the unit of the drive's kind. A passive relation ignores `drive`.
    #[inline]
    #[must_use]
    pub fn parameters_at(&self, drive: f64) -> [f64; PHASE_PARAMETERS] {
        // Start from the last copy, not from zero: a passive relation must ignore a NaN drive.
        let mut p = self.coefficients[self.copies - 1];
        for copy in self.coefficients[..self.copies - 1].iter().rev() {
            for (value, coefficient) in p.iter_mut().zip(copy) {
                *value = *value * drive + coefficient;
            }
        }
        p
    }

    /// The right side of the relation, N: it computes the force of an instant from the measured force of the
    /// same instant, so it is not a prediction.
    #[inline]
    #[must_use]
    pub fn same_instant_n(&self, velocity_m_s: f64, measured: &ForceMotion, drive: f64) -> f64 {
        let [p1, p2, p3, p4, p5] = self.parameters_at(drive);
        p1 * velocity_m_s + implied(&[p2, p3, p4, p5], measured)
    }

    /// Velocity that the measured force of an instant implies, m/s. Not finite if p1 is zero at this drive.
    #[inline]
    #[must_use]
    pub fn velocity_m_s(&self, measured: &ForceMotion, drive: f64) -> f64 {
        let [p1, p2, p3, p4, p5] = self.parameters_at(drive);
        (measured.force_n - implied(&[p2, p3, p4, p5], measured)) / p1
    }

    /// The reasons why the relation cannot predict force at `drive`; `None` if it could: all roots in the
    /// left half plane, and a static velocity that rises with force throughout.
    #[must_use]
    pub fn cannot_run(&self, drive: f64) -> Option<CannotRun> {
        let [_, p2, p3, p4, p5] = self.parameters_at(drive);
        let why = CannotRun { roots: roots(p2, p3), folds_at_n: fold(p4, p5) };
        (why.is_unstable() || why.folds_at_n.is_some()).then_some(why)
    }
}

#[inline]
fn implied([p2, p3, p4, p5]: &[f64; 4], measured: &ForceMotion) -> f64 {
    let f = measured.force_n;
    let square = f * f;
    p2 * measured.rate_n_s + p3 * measured.curvature_n_s2 + (p4 + p5 * square) * square * f
}

/// Roots of 1 - p2 s - p3 s^2.
fn roots(p2: f64, p3: f64) -> [Option<Root>; 2] {
    let real = |re_per_s| Root { re_per_s, im_rad_s: 0.0 };
    if p3 == 0.0 {
        return [(p2 != 0.0).then(|| real(p2.recip())), None];
    }
    let (half, product) = (-0.5 * p2 / p3, -p3.recip());
    let square = half * half - product;
    if square < 0.0 {
        let im_rad_s = (-square).sqrt();
        return [1.0, -1.0].map(|sign| Some(Root { re_per_s: half, im_rad_s: sign * im_rad_s }));
    }
    // The larger root by the formula and the other by the product, to avoid cancellation.
    let larger = half + square.sqrt().copysign(half);
    [Some(real(larger)), Some(real(product / larger))]
}

/// Smallest F > 0 where dv/dF, which is proportional to 1 - 3 p4 F^2 - 5 p5 F^4, becomes zero.
fn fold(p4: f64, p5: f64) -> Option<f64> {
    let passes = if p5 == 0.0 {
        [1.0 / (3.0 * p4), f64::NAN]
    } else {
        // With q = 1/F^2: q^2 - 3 p4 q - 5 p5 = 0, so the largest q gives the smallest F.
        let (half, square) = (1.5 * p4, 2.25 * p4 * p4 + 5.0 * p5);
        [half + square.sqrt(), half - square.sqrt()].map(f64::recip)
    };
    let least = passes.into_iter().filter(|square| *square > 0.0 && square.is_finite()).reduce(f64::min);
    least.map(f64::sqrt)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn roots_solve_the_characteristic_equation(p2 in -0.05..0.05f64, p3 in -6e-4..6e-4f64) {
            prop_assume!(p3.abs() > 1e-6);
            for root in roots(p2, p3).into_iter().flatten() {
                let (a, b) = (root.re_per_s, root.im_rad_s);
                let re = 1.0 - p2 * a - p3 * (a * a - b * b);
                let im = -p2 * b - 2.0 * p3 * a * b;
                prop_assert!(re.abs() < 1e-9 * (1.0 + (p3 * (a * a + b * b)).abs()), "{root:?}: {re}");
                prop_assert!(im.abs() < 1e-9 * (1.0 + (p2 * b).abs()), "{root:?}: {im}");
            }
        }

        #[test]
        fn force_and_velocity_are_one_relation(
            v in -0.3..0.3f64, force_n in -900.0..900.0f64, rate_n_s in -1e4..1e4f64,
            curvature_n_s2 in -1e5..1e5f64, i in 0.0..2.5f64,
        ) {
            let copies = [2_000.0, 0.017, -3e-4, 1.3e-6, -7e-13, 500.0, 1e-3, 1e-5, -1e-7, 1e-14];
            let phase = Phase::new(Some(DriveKind::CoilCurrent), &copies).expect("a relation");
            let measured = ForceMotion { force_n, rate_n_s, curvature_n_s2 };
            // A velocity change of dv changes the force by p1 dv.
            let shift = v - phase.velocity_m_s(&measured, i);
            let expected = force_n + phase.parameters_at(i)[0] * shift;
            prop_assert!((phase.same_instant_n(v, &measured, i) - expected).abs() < 1e-8 * (1.0 + expected.abs()));
        }
    }

    #[test]
    fn a_much_larger_root_does_not_reduce_the_accuracy_of_the_other() {
        // 1 - s/20 - p3 s^2: one root is near 20 1/s, whatever the other is.
        for p3 in [1e-14, -1e-14] {
            let nearest =
                roots(0.05, p3).into_iter().flatten().map(|root| (root.re_per_s / 20.0 - 1.0).abs());
            assert!(nearest.fold(f64::INFINITY, f64::min) < 1e-8, "{p3}: {:?}", roots(0.05, p3));
        }
    }

    #[test]
    fn the_fold_is_where_the_static_velocity_stops_rising() {
        let phase = Phase::new(None, &[3_000.0, 0.0, 0.0, 1.28e-6, -6.7e-13]).expect("a relation");
        let fold_n = phase.cannot_run(0.0).and_then(|why| why.folds_at_n).expect("it folds");
        let v =
            |force_n| phase.velocity_m_s(&ForceMotion { force_n, rate_n_s: 0.0, curvature_n_s2: 0.0 }, 0.0);
        assert!(v(fold_n) > v(fold_n - 1.0) && v(fold_n) > v(fold_n + 1.0), "{fold_n} N");
        // The smaller of two folds, and folds without the fifth power.
        for (p4, p5) in [(1.28e-6, -6.7e-13), (1.28e-6, 0.0), (0.0, 1e-13), (-1e-6, 1e-12)] {
            let slope = |f: f64| 1.0 - 3.0 * p4 * f.powi(2) - 5.0 * p5 * f.powi(4);
            let at = fold(p4, p5).expect("it folds");
            assert!(slope(at).abs() < 1e-9, "{p4} {p5}: {at} N, {}", slope(at));
            assert!((1..100).all(|k| slope(at * f64::from(k) / 100.0) > 0.0), "{p4} {p5}: {at} N");
        }
        assert_eq!([fold(0.0, 0.0), fold(-1e-6, 0.0), fold(-1e-6, -1e-12)], [None; 3]);
    }

    #[test]
    fn a_stable_rising_relation_could_run() {
        let phase = Phase::new(None, &[3_000.0, -0.02, -3e-4, 0.0, 0.0]).expect("a relation");
        assert_eq!(phase.cannot_run(0.0), None);
        let unstable = Phase::new(None, &[3_000.0, 0.02, -3e-4, 0.0, 0.0]).expect("a relation");
        let why = unstable.cannot_run(0.0).expect("diverges");
        assert!(why.is_unstable() && why.folds_at_n.is_none());
        assert_eq!(
            why.to_string(),
            "integrated forward it diverges: near rest it has a root at 33.3 ± 47.1i 1/s"
        );
    }

    #[test]
    fn wrong_numbers_are_named() {
        let error = |drive, p: &[f64]| Phase::new(drive, p).expect_err("refused").to_string();
        assert!(error(None, &[1.0; 10]).contains("10 values"));
        assert!(error(Some(DriveKind::CoilCurrent), &[1.0; 5]).contains("5 values"));
        assert!(error(None, &[1.0, 1.0, f64::NAN, 1.0, 1.0]).contains("force_curvature_s2[0] is NaN"));
    }
}
