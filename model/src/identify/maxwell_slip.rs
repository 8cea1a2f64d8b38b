//! Identification of the Maxwell-slip model: linear least squares with slopes and bristle forces that are not negative.
//!
//! ```text
//! minimise   sum (F - o_run - sum_i w_i(i) p_i . s)^2 + RIDGE sum_j q_j p_j^2,      q_j = sum of squares of column j
//! s          ramps of v, deflections of the bristles, x, 1                          p_i: coefficients of set i
//! knots      ±V sinh(j) / sinh 4,   j = 0, 1, 2, 3                                  V: peak speed of the runs
//! lengths    X / 32 * (1, 2, 4, 8, 16)                                              X: half of the longest stroke of a run
//! ```
//!
//! The knots are dense where a damper yields. A run with a stroke of 32 mm gives bristles of 0.5, 1, 2, 4 and 8 mm. Both follow from the
//! runs and are not fitted, so the force is linear in all unknowns, and the fit has one minimum and needs no restarts.
//!
//! The deflections depend on the motion only. One pass over the rows therefore sums the normal equations, and memory does not grow with
//! the number of rows. If the conditioning filters the output, each column passes the filter. The offset of a run is eliminated by
//! removing the run's means. The ridge determines what the runs do not: the common part of the set offsets, which a run's offset
//! includes, and coefficients of motion that does not occur. A column that is constant in each run, up to rounding, has no effect.
//!
//! Source: `[albender2005]` for the model and `[lawson1974]` for the fit (node/docs/guide/bibliography.md).

use super::Watch;
use super::dataset::{Dataset, Row};
use super::levels::Memberships;
use super::nonnegative;
use super::row_problem::{Prior, Training};
use super::scales::Scales;
use super::score::score;
use crate::condition::{ApplyTo, LowPass, LowPassState};
use crate::effect::{Augmented, Effects};
use crate::error::{Error, IdentifyError};
use crate::force::{
    ForceModel, FuzzySets, MAX_FUNCTIONS, MaxwellSlip, SLIP_BRISTLES, SLIP_COEFFICIENTS, SLIP_KNOTS,
    SlipFunction, SlipGrid, SlipState,
};
use crate::parallel;
use nalgebra::{DMatrix, DVector};

/// Weight of the ridge, relative to each column's sum of squares.
const RIDGE: f64 = 1e-5;
/// The knots are at `V sinh(j)/sinh(STEEP)`; the outermost one, at the peak speed, is left out, because the curve continues beyond it.
const STEEP: f64 = SLIP_KNOTS as f64 + 1.0;
/// Length of the shortest bristle, as a share of half the longest stroke.
const SHORTEST: f64 = 1.0 / 32.0;
/// A column is constant if less than this share of its squares is left after the means are removed.
const ROUNDING: f64 = 1e-11;
/// Smallest number of rows per coefficient.
const ROWS_PER_COEFFICIENT: usize = 10;

/// Result of the fit.
pub(super) struct Fitted {
    /// The model; its offset is the mean of the runs' offsets.
    pub(super) model: MaxwellSlip,
    /// Offset of each run, N.
    pub(super) offsets_n: Vec<f64>,
    /// False if the active-set method did not end.
    pub(super) converged: bool,
}

/// Fits the model to `training`; without `memberships` it has no drive.
pub(super) fn fit(
    training: Training,
    memberships: Option<&Memberships>,
    watch: &Watch,
) -> Result<Fitted, Error> {
    if let Some(memberships) = memberships {
        memberships.check_support(training.runs, SLIP_COEFFICIENTS)?;
    }
    let design = Design { grid: grid(&Scales::of(training.runs)?)?, sets: memberships.map(|m| m.sets) };
    design.fit(training, RIDGE, watch)
}

/// Mean of the runs' NMSE of the fitted model in simulation, without each run's offset.
pub(super) fn mean_esr(
    datasets: &[Dataset],
    memberships: Option<&Memberships>,
    watch: &Watch,
) -> Result<f64, Error> {
    let fitted = fit(datasets.into(), memberships, watch)?;
    let model = Augmented::unchecked(ForceModel::MaxwellSlip(fitted.model), Effects::NONE);
    let esr = |dataset: &Dataset| -> Result<f64, Error> {
        Ok(score(&model, dataset, watch)?.free_run_without_offset.map_or(f64::INFINITY, |fit| fit.esr))
    };
    let of_runs: Vec<f64> = parallel::map(datasets, esr).into_iter().collect::<Result<_, _>>()?;
    Ok(of_runs.iter().sum::<f64>() / of_runs.len() as f64)
}

/// Knots and lengths for runs with these scales.
fn grid(scales: &Scales) -> Result<SlipGrid, Error> {
    let knots = std::array::from_fn::<f64, SLIP_KNOTS, _>(|j| {
        scales.velocity_m_s * (j as f64 + 1.0).sinh() / STEEP.sinh()
    });
    let lengths = std::array::from_fn::<f64, SLIP_BRISTLES, _>(|k| {
        scales.displacement_m * SHORTEST * 2.0_f64.powi(k as i32)
    });
    SlipGrid::new(knots, lengths)
}

/// Grid and sets, which determine the columns of the regression.
struct Design {
    grid: SlipGrid,
    sets: Option<FuzzySets>,
}

/// Sums over the counted rows of one run.
struct Sums {
    rows: usize,
    /// Products of all pairs of columns; only the upper triangle is filled.
    square: DMatrix<f64>,
    /// Products of each column and the force.
    right: DVector<f64>,
    columns: DVector<f64>,
    force_n: f64,
}

impl Design {
    fn copies(&self) -> usize {
        self.sets.map_or(1, |sets| sets.len())
    }

    fn width(&self) -> usize {
        SLIP_COEFFICIENTS * self.copies()
    }

    /// Weights of the sets at a row; `None` if the row's drive is needed but not known.
    fn weights(&self, row: &Row) -> Option<[f64; MAX_FUNCTIONS]> {
        match &self.sets {
            Some(sets) => row.drive.is_finite().then(|| sets.weights(row.drive)),
            None => {
                let mut one = [0.0; MAX_FUNCTIONS];
                one[0] = 1.0;
                Some(one)
            }
        }
    }

    fn fit(&self, training: Training, ridge: f64, watch: &Watch) -> Result<Fitted, Error> {
        let (n, datasets) = (self.width(), training.runs);
        let of_runs: Vec<Sums> = parallel::map(datasets, |dataset| self.sums(dataset, watch));
        if watch.is_cancelled() {
            return Err(Error::Cancelled);
        }
        let rows: usize = of_runs.iter().map(|sums| sums.rows).sum();
        if rows < ROWS_PER_COEFFICIENT * n {
            return Err(IdentifyError::TooFewSamples {
                model: "maxwell-slip",
                which: None,
                samples: rows,
                needed: ROWS_PER_COEFFICIENT * n,
                count: n,
                parts: "coefficients",
            }
            .into());
        }
        let (mut square, mut right) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
        let mut squares = DVector::<f64>::zeros(n);
        for sums in &of_runs {
            squares += sums.square.diagonal();
            sums.add_centred(1.0, &mut square, &mut right);
        }
        if let Some(Prior { run, weight }) = training.prior {
            let sums = self.sums(run, watch);
            squares += *weight * sums.square.diagonal();
            sums.add_centred(*weight, &mut square, &mut right);
        }
        square.fill_lower_triangle_with_upper_triangle();
        for j in 0..n {
            if square[(j, j)] <= ROUNDING * squares[j] {
                square.row_mut(j).fill(0.0);
                square.column_mut(j).fill(0.0);
            } else {
                square[(j, j)] += ridge * squares[j];
            }
        }
        let found =
            nonnegative::minimise(&square, &right, |j| SlipFunction::is_nonnegative(j % SLIP_COEFFICIENTS));
        let functions: Vec<SlipFunction> =
            found.x.as_slice().as_chunks().0.iter().map(SlipFunction::of).collect();
        let offsets_n: Vec<f64> = of_runs.iter().map(|sums| sums.offset_n(&found.x)).collect();
        let offset_n = super::mean_offset(datasets, &offsets_n);
        let model = MaxwellSlip::new(self.grid, self.sets, &functions, offset_n)?;
        Ok(Fitted { model, offsets_n, converged: found.converged })
    }

    /// The sums over one run, in the order of its rows.
    fn sums(&self, dataset: &Dataset, watch: &Watch) -> Sums {
        let filter =
            (dataset.conditioning.apply_to == ApplyTo::Output).then(|| dataset.conditioning.low_pass());
        let mut filtered = filter.map(|filter| Filtered::new(filter, self.width()));
        let mut state = SlipState::default();
        let mut sums = Sums::new(self.width());
        for (index, row) in dataset.rows.iter().enumerate() {
            if index.is_multiple_of(4096) && watch.is_cancelled() {
                break;
            }
            if row.dt_s.is_none() {
                state = SlipState::default();
                filtered.iter_mut().for_each(Filtered::restart);
            }
            // A simulation does not step over a row without a drive either.
            let Some(weights) = self.weights(row) else { continue };
            let signals = self.grid.step(&mut state, &row.inputs()).values();
            if signals.iter().any(|signal| !signal.is_finite()) {
                continue;
            }
            match &mut filtered {
                Some(filtered) => {
                    let columns = filtered.step(row.dt_s, &weights, &signals);
                    if row.counts {
                        sums.add_all(columns, row.force_n);
                    }
                }
                None if row.counts => sums.add(&weights[..self.copies()], &signals, row.force_n),
                None => {}
            }
        }
        sums
    }
}

/// The columns behind the low-pass on the output.
struct Filtered {
    filter: LowPass,
    states: Vec<LowPassState>,
    columns: DVector<f64>,
    fresh: bool,
}

impl Filtered {
    fn new(filter: LowPass, width: usize) -> Self {
        Self {
            filter,
            states: vec![LowPassState::default(); width],
            columns: DVector::zeros(width),
            fresh: true,
        }
    }

    fn restart(&mut self) {
        self.fresh = true;
    }

    fn step(
        &mut self,
        dt_s: Option<f64>,
        weights: &[f64],
        signals: &[f64; SLIP_COEFFICIENTS],
    ) -> &DVector<f64> {
        let fresh = std::mem::take(&mut self.fresh);
        let dt_s = dt_s.filter(|_| !fresh);
        for (j, (state, column)) in self.states.iter_mut().zip(self.columns.iter_mut()).enumerate() {
            let value = weights[j / SLIP_COEFFICIENTS] * signals[j % SLIP_COEFFICIENTS];
            *column = self.filter.step(state, dt_s, value);
        }
        &self.columns
    }
}

impl Sums {
    fn new(width: usize) -> Self {
        Self {
            rows: 0,
            square: DMatrix::zeros(width, width),
            right: DVector::zeros(width),
            columns: DVector::zeros(width),
            force_n: 0.0,
        }
    }

    /// Adds a row whose columns are `signals` times the weight of each set. Sets without weight are omitted.
    fn add(&mut self, weights: &[f64], signals: &[f64; SLIP_COEFFICIENTS], force_n: f64) {
        const N: usize = SLIP_COEFFICIENTS;
        let width = self.right.len();
        self.rows += 1;
        self.force_n += force_n;
        for (second, own) in weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
            for (q, signal) in signals.iter().enumerate() {
                let (column, value) = (second * N + q, own * signal);
                self.columns[column] += value;
                self.right[column] += value * force_n;
                let products = &mut self.square.as_mut_slice()[column * width..][..width];
                for (first, weight) in weights[..=second].iter().enumerate().filter(|(_, w)| **w != 0.0) {
                    let share = value * weight;
                    let block = &mut products[first * N..][..N];
                    block.iter_mut().zip(signals).for_each(|(sum, signal)| *sum += share * signal);
                }
            }
        }
    }

    /// Adds a row with these columns.
    fn add_all(&mut self, columns: &DVector<f64>, force_n: f64) {
        self.rows += 1;
        self.force_n += force_n;
        self.columns += columns;
        self.right.axpy(force_n, columns, 1.0);
        let width = columns.len();
        for (k, value) in columns.iter().enumerate() {
            let products = &mut self.square.as_mut_slice()[k * width..][..=k];
            products.iter_mut().zip(columns.iter()).for_each(|(sum, other)| *sum += value * other);
        }
    }

    /// Adds the sums of the rows, of this `weight` each, without their means.
    fn add_centred(&self, weight: f64, square: &mut DMatrix<f64>, right: &mut DVector<f64>) {
        if self.rows == 0 {
            return;
        }
        let share = weight / self.rows as f64;
        *square += weight * &self.square;
        square.ger(-share, &self.columns, &self.columns, 1.0);
        *right += weight * &self.right;
        right.axpy(-share * self.force_n, &self.columns, 1.0);
    }

    /// The offset of the run for the coefficients `x`, N.
    fn offset_n(&self, x: &DVector<f64>) -> f64 {
        (self.force_n - self.columns.dot(x)) / self.rows.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::condition::Conditioning;
    use crate::force::Membership;
    use crate::metrics::ErrorSum;
    use crate::sample::{DriveKind, Stamp};

    const RATE_HZ: f64 = 500.0;

    /// A damper with three levels. Some of its coefficients are zero, as in a real one.
    fn truth() -> MaxwellSlip {
        let membership = Membership { drive: DriveKind::CoilCurrent, sigma: 0.25 };
        let sets = FuzzySets::new(membership, &[0.0, 0.5, 1.0]).expect("sets");
        let function = |level: f64| SlipFunction {
            damping_slopes_n_s_m: [0.0, 300.0, 200.0, 1_500.0, 2_500.0, 400.0, 0.0, 250.0]
                .map(|slope| slope * (1.0 + level)),
            bristle_forces_n: [0.0, 150.0, 90.0, 0.0, 30.0].map(|force_n| force_n * level),
            stiffness_n_m: -400.0 + 900.0 * level,
            set_offset_n: 20.0 * level,
        };
        let grid = SlipGrid::new([0.01, 0.03, 0.07], [4e-4, 8e-4, 1.6e-3, 3.2e-3, 6.4e-3]).expect("a grid");
        MaxwellSlip::new(grid, Some(sets), &[0.1, 1.0, 2.0].map(function), 0.0).expect("a model")
    }

    /// Twelve seconds of four sines with a changing current, and the force of `model` plus `offset_n`, behind the low-pass if the
    /// conditioning filters the output. The second half follows a gap.
    fn dataset(model: &MaxwellSlip, phase: f64, offset_n: f64, apply_to: ApplyTo) -> Dataset {
        let conditioning = Conditioning { apply_to, ..Conditioning::default() };
        let filter = conditioning.low_pass();
        let (mut state, mut filter_state) = (SlipState::default(), LowPassState::default());
        let mut rows = Vec::new();
        for k in 0..6_000_i64 {
            let t = k as f64 / RATE_HZ;
            let sines = [(0.008, 5.0), (0.003, 13.1), (0.0012, 31.3), (0.0004, 60.7)];
            let at = |of: fn(f64) -> f64, power: i32| -> f64 {
                let wave = |(j, (a, w)): (usize, &(f64, f64))| {
                    a * w.powi(power) * of(w * t + phase * (1.0 + j as f64))
                };
                sines.iter().enumerate().map(wave).sum()
            };
            let mut row = Row {
                stamp: Stamp::from_nanos(k * 2_000_000),
                dt_s: (k % 3_000 != 0).then_some(1.0 / RATE_HZ),
                displacement_m: at(f64::sin, 0),
                velocity_m_s: at(f64::cos, 1),
                acceleration_m_s2: 0.0,
                drive: 0.5 + 0.5 * (3.1 * t + phase).sin(),
                case_temp_c: f64::NAN,
                force_n: f64::NAN,
                raw_force_n: f64::NAN,
                counts: true,
            };
            row.raw_force_n = model.force_n(&row.inputs(), &mut state) + offset_n;
            row.force_n = match apply_to {
                ApplyTo::Output => filter.step(&mut filter_state, row.dt_s, row.raw_force_n),
                _ => row.raw_force_n,
            };
            rows.push(row);
        }
        Dataset::from_rows(
            &format!("phase {phase}"),
            Some(DriveKind::CoilCurrent),
            conditioning,
            RATE_HZ,
            rows,
        )
    }

    #[test]
    fn coefficients_and_offsets_are_recovered_to_rounding() {
        let truth = truth();
        for apply_to in [ApplyTo::None, ApplyTo::Output] {
            let offsets_n = [60.0, -20.0];
            let datasets = [0.3, 1.7].map(|phase| {
                dataset(&truth, phase, if phase < 1.0 { offsets_n[0] } else { offsets_n[1] }, apply_to)
            });
            let design = Design { grid: *truth.grid(), sets: truth.sets().copied() };
            let found = design.fit(Training::from(&datasets[..]), 1e-12, &Watch::none()).expect("a fit");
            assert!(found.converged);
            for (own, expected) in found.model.functions().iter().zip(truth.functions()) {
                // The common part of the set offsets belongs to the offsets of the runs.
                for (a, b) in own.coefficients()[..SLIP_COEFFICIENTS - 1].iter().zip(expected.coefficients())
                {
                    assert!((a - b).abs() < 1e-6 * (1.0 + b.abs()), "{apply_to:?}: {own:?} {expected:?}");
                }
            }
            let moved_n = |model: &MaxwellSlip| {
                let [first, .., last] = model.functions() else { panic!("three sets") };
                last.set_offset_n - first.set_offset_n
            };
            assert!((moved_n(&found.model) - moved_n(&truth)).abs() < 1e-6);
            let common_n = truth.functions()[0].set_offset_n - found.model.functions()[0].set_offset_n;
            for (found_n, expected_n) in found.offsets_n.iter().zip(offsets_n) {
                assert!((found_n - expected_n - common_n).abs() < 1e-6, "{found_n} {expected_n} {common_n}");
            }
        }
    }

    #[test]
    fn a_prior_of_full_weight_is_one_more_run() {
        let truth = truth();
        let datasets = [0.3, 1.7].map(|phase| dataset(&truth, phase, 0.0, ApplyTo::None));
        let design = Design { grid: *truth.grid(), sets: truth.sets().copied() };
        let fitted = |training: Training| design.fit(training, RIDGE, &Watch::none()).expect("a fit");
        let runs = fitted(Training::from(&datasets[..]));
        let prior = Prior { run: datasets[1].clone(), weight: 1.0 };
        let with_prior = fitted(Training { runs: &datasets[..1], prior: Some(&prior) });
        for (a, b) in runs.model.functions().iter().zip(with_prior.model.functions()) {
            for (a, b) in a.coefficients().iter().zip(b.coefficients()) {
                assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{a} {b}");
            }
        }
        assert_eq!(with_prior.offsets_n.len(), 1);
    }

    #[test]
    fn the_ridge_hardly_changes_the_force() {
        let truth = truth();
        let datasets = [0.3, 1.7].map(|phase| dataset(&truth, phase, 0.0, ApplyTo::None));
        let design = Design { grid: *truth.grid(), sets: truth.sets().copied() };
        let found = design.fit(Training::from(&datasets[..]), RIDGE, &Watch::none()).expect("a fit").model;
        let (mut sum, mut states) = (ErrorSum::default(), [SlipState::default(); 2]);
        for row in &dataset(&truth, 4.1, 0.0, ApplyTo::None).rows {
            let expected_n = truth.force_n(&row.inputs(), &mut states[0]);
            sum.add(expected_n, found.force_n(&row.inputs(), &mut states[1]));
        }
        let esr = sum.fit().expect("rows").esr;
        assert!(esr < 1e-6, "{esr}");
    }

    #[test]
    fn a_current_that_is_constant_in_each_run_moves_no_set_offset() {
        // Its noise must not be taken for a dependence of the offset on the current.
        let truth = truth();
        let datasets = [0.3, 1.7, 2.9].map(|phase| {
            let mut dataset = dataset(&truth, phase, 50.0 * phase, ApplyTo::None);
            for (k, row) in dataset.rows.iter_mut().enumerate() {
                row.drive = if phase < 1.0 { 0.0 } else { 1.0 } + 1e-4 * (k as f64).sin();
                row.force_n += 5.0 * (7.3 * k as f64).sin();
            }
            dataset
        });
        let design = Design { grid: *truth.grid(), sets: truth.sets().copied() };
        let found = design.fit(Training::from(&datasets[..]), RIDGE, &Watch::none()).expect("a fit").model;
        assert!(found.functions().iter().all(|f| f.set_offset_n.abs() < 10.0), "{:?}", found.functions());
    }
}
