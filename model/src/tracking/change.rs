//! Test whether a value changes, from the values of the windows.
//!
//! ```text
//! v   = x' b + m s e,   x = (1, z - z_1, 0 .. 1 .. 0),   e normal      z: excitation of the window; the 1 stands at its kind of excitation
//! m   = max(1, h / mean of h)                                          h: half of the window's interval, against the windows before
//! b_0 ~ anything;   slopes ~ N(0, (SLOPE s)^2);   kinds ~ N(0, (KIND s)^2);   s anything
//! u   = Phi^-1(T((v - x' b) / (s sqrt(m^2 + x' P x))))                 b, s, s^2 P: mean, scale and variance after the n windows before;
//!                                                                      T: Student's t with n - 1 degrees
//! e_l = exp(l u - l^2 / 2)                                             e-value at the stake l; u is limited to +-[`MOST`]
//! M_l = e_l (M_l + 1)                                                  evidence: Shiryaev-Roberts, from 0
//! change when  mean over l of M_l >= N
//! ```
//!
//! A force that the base lacks moves the estimate of a value, and differently for each excitation. Therefore the value may depend on the excitation:
//! by a slope, and by a constant for each kind of excitation. Windows are of one kind if their z differ by less than [`APART`]. So a window with
//! a new excitation is weak evidence, and it is compared with windows of its kind once there are some. A window that determines the value poorly
//! is weaker evidence, too.
//!
//! **Guarantee.** If the values follow the first three lines, the u are independent and standard normal. Each e_l then has the expectation
//! 1, so the mean of M_l minus the number of values is a martingale. Therefore the mean number of values before a false alarm is at
//! least N, as in the alarm of the residual. The limit of u makes alarms only rarer. The example `change_alarms` measures the rate on a rig whose
//! base the model does not have.
//!
//! After a change the comparison begins again with the values that follow, and the change stays reported.
//!
//! Source: `[hawkins1987]` (self-starting control charts), with recursive residuals of a regression `[brown1975]` in place of deviations from
//! the mean, and `[shin2023]` in the bibliography (node/docs/guide/bibliography.md).

use super::excitation::COVARIATES;
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Stakes: small ones detect a small change, large ones a large change sooner, in either direction.
const STAKES: [f64; 6] = [-2.0, -1.0, -0.5, 0.5, 1.0, 2.0];
/// Limit of u, so that a single odd window is no change.
const MOST: f64 = 3.5;
/// Values before the first comparison.
const LEAST: u32 = 3;
/// Standard deviation of a slope, in standard deviations of the value.
const SLOPE: f64 = 10.0;
/// Standard deviation of what a kind of excitation adds, in standard deviations of the value.
const KIND: f64 = 3.0;
/// Distance of z beyond which a window is of another kind.
const APART: f64 = 0.2;
/// Largest number of kinds; later windows belong to the nearest one.
const KINDS: usize = 32;
const COEFFICIENTS: usize = 1 + COVARIATES + KINDS;

/// A value as a window found it.
///
/// ```
/// use mr_damper_model::tracking::Observed;
///
/// let (stroke_m, speed_m_s, drive) = (0.008_f64, 0.12_f64, 0.4);
/// let observed = Observed { value: 0.0121, half: 0.0004, excitation: [stroke_m.ln(), speed_m_s.ln(), drive] };
/// assert!(observed.half < observed.value);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observed {
    /// The value, in any unit.
    pub value: f64,
    /// Half of its 95 % interval, in the same unit.
    pub half: f64,
    /// Excitation of the window: see [`EffectValue::excitation`](super::EffectValue::excitation).
    pub excitation: [f64; COVARIATES],
}

/// The test whether one value changes: `change.rs` begins with its equations.
///
/// ```
/// use mr_damper_model::tracking::{ChangeTest, Observed};
///
/// // At most one false alarm in a thousand values. The value jumps at the 40th.
/// let mut test = ChangeTest::new(1000.0);
/// let value = |k: u32| 12.0 + 0.1 * (2.4 * f64::from(k)).sin() + if k < 40 { 0.0 } else { 0.5 };
/// let excitation = [-5.0, -2.0, 0.4];
/// let changed = (0..60).find(|k| test.see(&Observed { value: value(*k), half: 0.2, excitation }));
/// assert!((40..46).contains(&changed.expect("a change")));
/// ```
#[derive(Debug, Clone)]
pub struct ChangeTest {
    /// N.
    least_evidence: f64,
    count: u32,
    /// z of the first window of each kind.
    kinds: Vec<[f64; COVARIATES]>,
    /// b.
    mean: DVector<f64>,
    /// P.
    variance: DMatrix<f64>,
    /// (n - 1) s^2: sum of the squared, scaled differences of each value to its prediction.
    squares: f64,
    /// Sum of h.
    halves: f64,
    evidence: [f64; STAKES.len()],
    has_changed: bool,
}

impl ChangeTest {
    /// A test with at least `values` values, in the mean, before a false alarm.
    #[must_use]
    pub fn new(values: f64) -> Self {
        let deviations = [SLOPE; COVARIATES].into_iter().chain([KIND; KINDS]);
        let variances = DVector::from_iterator(
            COEFFICIENTS,
            std::iter::once(0.0).chain(deviations.map(|deviation| deviation * deviation)),
        );
        Self {
            least_evidence: values,
            count: 0,
            kinds: Vec::new(),
            mean: DVector::zeros(COEFFICIENTS),
            variance: DMatrix::from_diagonal(&variances),
            squares: 0.0,
            halves: 0.0,
            evidence: [0.0; STAKES.len()],
            has_changed: false,
        }
    }

    /// Number of values since the start or the last change.
    #[must_use]
    pub const fn windows(&self) -> u32 {
        self.count
    }

    /// True once the value has changed.
    #[must_use]
    pub const fn has_changed(&self) -> bool {
        self.has_changed
    }

    /// Takes the next value. True if it completes the evidence for a change. A value whose numbers are not all finite is left out.
    pub fn see(&mut self, observed: &Observed) -> bool {
        let Observed { value, half, excitation } = *observed;
        if ![value, half].iter().chain(&excitation).all(|number| number.is_finite()) {
            return false;
        }
        let x = self.regressors(&excitation);
        if self.count == 0 {
            // The first value determines the mean for its own kind of excitation.
            let (mean, kind) = (0, 1 + COVARIATES);
            self.mean[mean] = value;
            let of_kind = self.variance[(kind, kind)];
            self.variance[(mean, mean)] = 1.0 + of_kind;
            self.variance[(mean, kind)] = -of_kind;
            self.variance[(kind, mean)] = -of_kind;
            (self.count, self.halves) = (1, half);
            return false;
        }
        let difference = value - self.mean.dot(&x);
        let spread = &self.variance * &x;
        let mean_half = self.halves / f64::from(self.count);
        let wider = if half > mean_half && mean_half > 0.0 { half / mean_half } else { 1.0 };
        let scale = wider * wider + x.dot(&spread);
        if self.count >= LEAST
            && let Some(u) = self.normal(difference / scale.sqrt())
        {
            for (evidence, stake) in self.evidence.iter_mut().zip(STAKES) {
                *evidence = (stake * u - 0.5 * stake * stake).exp() * (*evidence + 1.0);
            }
        }
        if self.evidence.iter().sum::<f64>() / STAKES.len() as f64 >= self.least_evidence {
            *self = Self { has_changed: true, ..Self::new(self.least_evidence) };
            return true;
        }
        self.count += 1;
        self.halves += half;
        self.mean.axpy(difference / scale, &spread, 1.0);
        self.variance.ger(-1.0 / scale, &spread, &spread, 1.0);
        self.squares += difference * difference / scale;
        false
    }

    /// x of an excitation; a new kind of excitation is noted.
    fn regressors(&mut self, excitation: &[f64; COVARIATES]) -> DVector<f64> {
        let distance = |kind: &[f64; COVARIATES]| {
            kind.iter().zip(excitation).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
        };
        let nearest = self.kinds.iter().map(distance).enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        let kind = match nearest {
            Some((kind, apart)) if apart <= APART || self.kinds.len() == KINDS => kind,
            _ => {
                self.kinds.push(*excitation);
                self.kinds.len() - 1
            }
        };
        let mut x = DVector::zeros(COEFFICIENTS);
        x[0] = 1.0;
        for (at, (z, first)) in excitation.iter().zip(self.kinds[0]).enumerate() {
            x[1 + at] = z - first;
        }
        x[1 + COVARIATES + kind] = 1.0;
        x
    }

    /// u of a scaled difference to the prediction; `None` if all values before were as predicted.
    fn normal(&self, difference: f64) -> Option<f64> {
        // A comparison with NaN is false, too.
        if !(self.squares > 0.0 && difference.is_finite()) {
            return None;
        }
        let degrees = f64::from(self.count) - 1.0;
        let t = difference / (self.squares / degrees).sqrt();
        let student = StudentsT::new(0.0, 1.0, degrees).ok()?;
        let normal = Normal::standard();
        // The lower tail keeps its digits.
        let u = normal.inverse_cdf(student.cdf(-t.abs())).abs().min(MOST).copysign(t);
        u.is_finite().then_some(u)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// How the excitation changes.
    #[derive(Clone, Copy)]
    enum Excitation {
        /// The covariates stay as they are.
        Same,
        /// New ones are drawn after ten values.
        Stages,
    }

    /// Values until the alarm, at most `most`; the value at `index` is moved by `shift(index)` standard deviations.
    fn run(seed: u64, least: f64, most: u32, excitation: Excitation, shift: impl Fn(u32) -> f64) -> u32 {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let normal = |random: &mut Pcg64Mcg| Normal::standard().inverse_cdf(random.random_range(1e-12..1.0));
        // The test knows neither mean nor scale nor what the excitation adds.
        let (mean, scale) = (random.random_range(-100.0..100.0), 10_f64.powf(random.random_range(-6.0..6.0)));
        let slopes = [(); COVARIATES].map(|()| 4.0 * normal(&mut random));
        let kinds = [(); 8].map(|()| 3.0 * normal(&mut random));
        let mut kind = 0;
        let mut test = ChangeTest::new(least);
        (0..most)
            .find(|index| {
                if matches!(excitation, Excitation::Stages) && index % 10 == 0 {
                    kind = random.random_range(0..kinds.len());
                }
                let excitation = [3.0 + f64::from(u8::try_from(kind).unwrap_or(0)); COVARIATES];
                let bias: f64 = slopes.iter().zip(excitation).map(|(slope, z)| slope * z).sum();
                let value = mean + scale * (normal(&mut random) + bias + kinds[kind] + shift(*index));
                test.see(&Observed { value, half: 2.0 * scale, excitation })
            })
            .unwrap_or(most)
    }

    #[test]
    fn false_alarms_are_as_rare_as_stated() {
        const LEAST: f64 = 100.0;
        for excitation in [Excitation::Same, Excitation::Stages] {
            let runs: Vec<f64> =
                (0..400).map(|seed| f64::from(run(seed, LEAST, 20_000, excitation, |_| 0.0))).collect();
            let mean = runs.iter().sum::<f64>() / runs.len() as f64;
            let error = (runs.iter().map(|n| (n - mean).powi(2)).sum::<f64>()).sqrt() / runs.len() as f64;
            assert!(mean - 2.0 * error >= LEAST, "{mean} +- {error}");
        }
    }

    #[test]
    fn changes_and_drifts_are_found() {
        // A false alarm in a thousand hours of minutes, as by default for two values.
        const LEAST: f64 = 120_000.0;
        const BEGIN: u32 = 100;
        let found_within = |windows: u32, excitation: Excitation, shift: fn(u32) -> f64| {
            let in_time = BEGIN..BEGIN + windows;
            (0..100).filter(|seed| in_time.contains(&run(*seed, LEAST, 400, excitation, shift))).count()
        };
        let step = |index| if index < BEGIN { 0.0 } else { 4.0 };
        let drift = |index: u32| 0.1 * f64::from(index.saturating_sub(BEGIN));
        for (excitation, windows) in [(Excitation::Same, [12, 120]), (Excitation::Stages, [30, 150])] {
            let found =
                [found_within(windows[0], excitation, step), found_within(windows[1], excitation, drift)];
            assert!(found.iter().all(|found| *found >= 90), "{found:?}");
        }
    }

    #[test]
    fn equal_values_and_odd_numbers_are_no_change() {
        let mut test = ChangeTest::new(100.0);
        for value in [1.0, 1.0, 1.0, 1.0, 1.0, f64::MAX, 1.0] {
            test.see(&Observed { value, half: 0.0, excitation: [0.0; COVARIATES] });
        }
        let mut test = ChangeTest::new(100.0);
        for value in [1.0, 2.0, 1.0, 2.0, 1.0, f64::INFINITY, 1.0, f64::NAN, 2.0] {
            assert!(!test.see(&Observed { value, half: f64::NAN, excitation: [f64::NAN, 0.0, 1e300] }));
        }
        assert_eq!(test.windows(), 0);
        let observed = |value| Observed { value, half: 0.1, excitation: [-5.0, -2.0, 0.4] };
        assert!([1.0, 2.0, 1.0, 2.0, 9.0].map(observed).iter().all(|it| !test.see(it)));
        assert_eq!(test.windows(), 5);
    }

    #[test]
    fn a_value_that_follows_the_excitation_has_not_changed() {
        // Without covariates, one stage of another excitation would be a change: 8 standard deviations.
        let mut test = ChangeTest::new(120_000.0);
        let mut random = Pcg64Mcg::seed_from_u64(1);
        for index in 0..200 {
            let z = f64::from(index / 20 % 3);
            let value = 8.0 * z + Normal::standard().inverse_cdf(random.random_range(1e-12..1.0));
            assert!(!test.see(&Observed { value, half: 2.0, excitation: [z, 0.0, 0.0] }), "{index}");
        }
    }
}
