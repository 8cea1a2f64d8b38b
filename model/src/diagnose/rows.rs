//! The rows that the sums of a diagnosis are computed over.
//!
//! A model is always stepped over **all** rows of a run, because model, effects and filters have internal states. The sums contain
//! the rows that count ([`crate::identify::Row::counts`]); of long runs every n-th of them. Every series is concatenated run by run, and
//! each run's mean is removed: sessions differ in their force offset, and no effect in the library is an offset.

use super::cycle::Cycles;
use crate::condition::{ApplyTo, LowPassState};
use crate::effect::{Augmented, AugmentedOnJets, AugmentedState, JetState, Need, Solved};
use crate::force::jet::Jet;
use crate::identify::{Dataset, Row, walk};
use crate::parallel;
pub(super) use crate::statistics::dot;
use nalgebra::DMatrix;
use std::ops::{ControlFlow, Range};

/// The scalar products of all pairs of `columns`.
pub(super) fn gram(columns: &[Vec<f64>]) -> DMatrix<f64> {
    let n = columns.len();
    let lower: Vec<Vec<f64>> =
        parallel::map_indices(n, |a| (0..=a).map(|b| dot(&columns[a], &columns[b])).collect());
    DMatrix::from_fn(n, n, |a, b| lower[a.max(b)][a.min(b)])
}

/// The selected rows of several runs.
pub(super) struct Rows<'a> {
    runs: Vec<RunRows<'a>>,
    /// Force to explain, N: the measured force, or in paired mode the force built from the difference to the reference.
    measured_n: Vec<f64>,
}

/// The selected rows of one run.
pub(super) struct RunRows<'a> {
    pub(super) dataset: &'a Dataset,
    /// Indices of the rows, increasing.
    pub(super) indices: Vec<usize>,
    /// Their positions in the concatenated series.
    pub(super) range: Range<usize>,
    /// Time that each row stands for, s. The rows that are left out at rest do not count.
    pub(super) step_s: f64,
    /// The cycles of the motion, in paired mode if it is cyclic; all rows are then within whole cycles.
    pub(super) cycles: Option<Cycles>,
}

/// True if the row has the drive that a model may need.
pub(super) fn is_driven(needs_drive: bool, row: &Row) -> bool {
    !needs_drive || row.drive.is_finite()
}

impl RunRows<'_> {
    /// Time of each row since the run's first row, s.
    pub(super) fn times_s(&self) -> impl Iterator<Item = f64> {
        let rows = &self.dataset.rows;
        self.indices.iter().map(move |&k| rows[k].stamp.since(rows[0].stamp).get())
    }

    /// The same; if the rows are stretches of a longer run, without the time between them.
    pub(super) fn times_in_stretches_s(&self) -> Vec<f64> {
        if self.is_stretches() {
            return (0..self.indices.len()).map(|row| row as f64 * self.step_s).collect();
        }
        self.times_s().collect()
    }

    fn is_stretches(&self) -> bool {
        !self.dataset.pasts.is_empty()
    }

    /// Simulated force of `model` at the selected rows, N; `None` if it is not finite on one of them.
    fn predict(&self, model: &Augmented) -> Option<Vec<f64>> {
        self.predict_on(model, self.dataset)
    }

    /// The same with the rows of `dataset` in place of the run's own.
    pub(super) fn predict_on(&self, model: &Augmented, dataset: &Dataset) -> Option<Vec<f64>> {
        Self::predict_at(model, dataset, &self.indices)
    }

    /// The same with the run changed by `change`, which may add rows but keeps the stamps of the others.
    fn predict_changed(&self, model: &Augmented, change: fn(&Dataset) -> Dataset) -> Option<Vec<f64>> {
        let dataset = change(self.dataset);
        let mut indices = Vec::with_capacity(self.indices.len());
        let mut wanted = self.indices.iter().map(|&k| self.dataset.rows[k].stamp).peekable();
        // An added row comes before the row whose stamp it has, so the last one with a stamp counts.
        for (index, row) in dataset.rows.iter().enumerate() {
            let last = dataset.rows.get(index + 1).is_none_or(|next| next.stamp != row.stamp);
            if last && wanted.next_if_eq(&row.stamp).is_some() {
                indices.push(index);
            }
        }
        if indices.len() == self.indices.len() { Self::predict_at(model, &dataset, &indices) } else { None }
    }

    /// Simulated force of `model` at the rows `indices` of `dataset`, N; `None` if it is not finite on one of them.
    fn predict_at(model: &Augmented, dataset: &Dataset, indices: &[usize]) -> Option<Vec<f64>> {
        let mut predicted = Vec::with_capacity(indices.len());
        let (mut index, mut finite) = (0, true);
        // The return value is not needed: the check below decides if all selected rows were reached.
        let _ = walk(model, dataset, |_, said| {
            if indices.get(predicted.len()) == Some(&index) {
                finite &= said.free_run_n.is_finite();
                predicted.push(said.free_run_n);
            }
            index += 1;
            // Stop after the last selected row, or at a force that is not finite.
            if !finite || predicted.len() == indices.len() {
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(())
        });
        (finite && predicted.len() == indices.len()).then_some(predicted)
    }

    /// See [`Rows::solved`].
    fn solved(&self, model: &Augmented) -> Option<Solved> {
        let mut solved = Solved::of(model)?;
        self.simulate(model, |force_n, state| solved.push(force_n, state));
        Some(solved)
    }

    /// Calls `take` at each sample with the simulated force of `model`, N, and its state after it. The force is before the filter of the output;
    /// `None` if there is none.
    pub(super) fn simulate(&self, model: &Augmented, mut take: impl FnMut(Option<f64>, &AugmentedState)) {
        let mut state = AugmentedState::default();
        for row in &self.dataset.rows {
            if row.dt_s.is_none() {
                state = model.begin(self.dataset.past(row));
            }
            let driven = is_driven(model.force().drive().is_some(), row);
            let force_n = if driven { model.free_run(&mut state, &row.inputs()) } else { None };
            take(force_n, &state);
        }
    }

    /// Derivatives of the simulated force of `model` at the selected rows, for each direction; `None` if the force is not finite on one of
    /// them. As in [`walk`], with a new state for each segment.
    fn derivatives<const N: usize>(
        &self,
        model: &AugmentedOnJets<N>,
        solved: Option<&Solved>,
    ) -> Option<Vec<[f64; N]>> {
        let Dataset { conditioning, rows, .. } = self.dataset;
        let filter = (conditioning.apply_to == ApplyTo::Output).then(|| conditioning.low_pass());
        let (mut state, mut output) = (JetState::default(), None);
        let mut found = Vec::with_capacity(self.indices.len());
        for (index, row) in rows.iter().enumerate() {
            if row.dt_s.is_none() {
                (state, output) = (model.begin(self.dataset.past(row)), None);
            }
            let driven = is_driven(model.needs_drive(), row);
            if let Some(solved) = solved {
                solved.prepare(index, &mut state);
            }
            let force = if driven { model.free_run(&mut state, &row.inputs()) } else { None };
            let force = force.filter(|jet| jet.re.is_finite());
            let by = force.map(|Jet { by, .. }| match &filter {
                Some(filter) => {
                    let fresh = output.is_none();
                    let state = output.get_or_insert_with(LowPassState::<N>::default);
                    filter.step_each(state, row.dt_s.filter(|_| !fresh), by)
                }
                None => by,
            });
            if self.indices.get(found.len()) == Some(&index) {
                found.push(by?);
            }
            if found.len() == self.indices.len() {
                break;
            }
        }
        (found.len() == self.indices.len()).then_some(found)
    }
}

impl<'a> Rows<'a> {
    /// Selects the rows of `datasets` that count; with more than `most`, every n-th of them.
    pub(super) fn new(datasets: &'a [Dataset], most: usize) -> Self {
        let counted: usize = datasets.iter().map(Dataset::counted).sum();
        let every = counted.div_ceil(most.max(1)).max(1);
        let mut start = 0;
        let runs: Vec<RunRows> = datasets
            .iter()
            .map(|dataset| {
                let warm = dataset.rows.iter().any(|row| row.case_temp_c.is_finite());
                // If the run has a case temperature, rows before its first reading are left out: effects that need it cannot use them.
                let counts = |k: &usize| {
                    let row = &dataset.rows[*k];
                    row.counts && (!warm || row.case_temp_c.is_finite())
                };
                let indices: Vec<usize> = (0..dataset.rows.len()).filter(counts).step_by(every).collect();
                let range = start..start + indices.len();
                start = range.end;
                let step_s = if dataset.rate_hz > 0.0 { every as f64 / dataset.rate_hz } else { 0.0 };
                RunRows { dataset, indices, range, step_s, cycles: None }
            })
            .collect();
        let force =
            |run: &RunRows| run.indices.iter().map(|&k| run.dataset.rows[k].force_n).collect::<Vec<_>>();
        let measured_n = runs.iter().flat_map(force).collect();
        Self { runs, measured_n }
    }

    /// The rows that `keep` takes, given the number of the run and the index of the row.
    pub(super) fn retain(self, keep: impl Fn(usize, usize) -> bool) -> Self {
        let mut measured_n = Vec::with_capacity(self.measured_n.len());
        let mut runs = Vec::with_capacity(self.runs.len());
        for (number, run) in self.runs.into_iter().enumerate() {
            let start = measured_n.len();
            let kept = run.indices.iter().zip(run.range.clone()).filter(|(k, _)| keep(number, **k));
            let (indices, force_n): (Vec<usize>, Vec<f64>) =
                kept.map(|(k, at)| (*k, self.measured_n[at])).unzip();
            measured_n.extend(force_n);
            runs.push(RunRows { indices, range: start..measured_n.len(), ..run });
        }
        Self { runs, measured_n }
    }

    /// The same rows, with the cycles of each run.
    pub(super) fn with_cycles(mut self, cycles: impl Iterator<Item = Option<Cycles>>) -> Self {
        self.runs.iter_mut().zip(cycles).for_each(|(run, cycles)| run.cycles = cycles);
        self
    }

    /// The same rows of `datasets`, which replace the runs and have as many rows.
    pub(super) fn with_datasets<'b>(&self, datasets: &'b [Dataset]) -> Rows<'b> {
        let replaced = |(run, dataset): (&RunRows, &'b Dataset)| {
            debug_assert_eq!(run.dataset.rows.len(), dataset.rows.len(), "one row for each");
            RunRows { dataset, indices: run.indices.clone(), range: run.range.clone(), ..*run }
        };
        let runs = self.runs.iter().zip(datasets).map(replaced).collect();
        Rows { runs, measured_n: self.measured_n.clone() }
    }

    /// The same rows with a different force to explain.
    pub(super) fn with_force(self, measured_n: Vec<f64>) -> Self {
        debug_assert_eq!(measured_n.len(), self.measured_n.len(), "one force a row");
        Self { measured_n, ..self }
    }

    /// Number of selected rows.
    pub(super) const fn len(&self) -> usize {
        self.measured_n.len()
    }

    /// The runs.
    pub(super) fn runs(&self) -> &[RunRows<'a>] {
        &self.runs
    }

    /// True if some runs are stretches of longer ones.
    pub(super) fn are_stretches(&self) -> bool {
        self.runs.iter().any(RunRows::is_stretches)
    }

    /// The force to explain, N.
    pub(super) fn measured_n(&self) -> &[f64] {
        &self.measured_n
    }

    /// Simulated force of `model` over all runs, N; `None` if it is not finite.
    pub(super) fn predict(&self, model: &Augmented) -> Option<Vec<f64>> {
        self.concatenated(|run| run.predict(model))
    }

    /// Change of the simulated force from `here_n` to that of `there`, divided by `step`; `None` if it is not finite.
    pub(super) fn difference(&self, there: &Augmented, here_n: &[f64], step: f64) -> Option<Vec<f64>> {
        let mut there = self.predict(there)?;
        there.iter_mut().zip(here_n).for_each(|(there, here)| *there = (*there - here) / step);
        Some(there)
    }

    /// The same as [`Rows::predict`] with every run changed by `change`, which keeps the rows and may add others between them.
    pub(super) fn predict_changed(
        &self,
        model: &Augmented,
        change: fn(&Dataset) -> Dataset,
    ) -> Option<Vec<f64>> {
        self.concatenated(|run| run.predict_changed(model, change))
    }

    /// The force that an effect of `model` solves for in each run, for [`Rows::derivatives`] of the same model; `None` if no effect does.
    pub(super) fn solved(&self, model: &Augmented) -> Vec<Option<Solved>> {
        parallel::map(&self.runs, |run| run.solved(model))
    }

    /// Derivatives of the simulated force of `model` over all runs, each run's mean removed, one series for each of the first `count`
    /// directions. Zeros where they are not finite. `solved` is [`Rows::solved`] of the same model.
    pub(super) fn derivatives<const N: usize>(
        &self,
        model: &AugmentedOnJets<N>,
        solved: &[Option<Solved>],
        count: usize,
    ) -> Vec<Vec<f64>> {
        let of_run = |k: usize| self.runs[k].derivatives(model, solved[k].as_ref());
        let found = self.joined(parallel::map_indices(self.runs.len(), of_run)).unwrap_or_default();
        let series = |direction: usize| self.derivative(found.iter().map(|by| by[direction]).collect());
        (0..count).map(series).collect()
    }

    /// `series` as a derivative: each run's mean removed; zeros if it is not finite, or does not have every row.
    pub(super) fn derivative(&self, mut series: Vec<f64>) -> Vec<f64> {
        if series.len() != self.len() || !series.iter().all(|value| value.is_finite()) {
            return vec![0.0; self.len()];
        }
        self.centre(&mut series);
        series
    }

    /// The series that `of_run` gives, run by run; `None` if it gives none for one run.
    fn concatenated<T: Send>(&self, of_run: impl Fn(&RunRows) -> Option<Vec<T>> + Sync) -> Option<Vec<T>> {
        self.joined(parallel::map(&self.runs, of_run))
    }

    /// The series of all runs as one; `None` if one is missing.
    fn joined<T>(&self, parts: Vec<Option<Vec<T>>>) -> Option<Vec<T>> {
        let mut all = Vec::with_capacity(self.len());
        for part in parts {
            all.extend(part?);
        }
        Some(all)
    }

    /// Force to explain minus `predicted_n`, each run's mean removed, N.
    pub(super) fn residual(&self, predicted_n: &[f64]) -> Vec<f64> {
        let mut residual: Vec<f64> = self
            .measured_n
            .iter()
            .zip(predicted_n)
            .map(|(measured, predicted)| measured - predicted)
            .collect();
        self.centre(&mut residual);
        residual
    }

    /// Removes each run's mean from `series`.
    pub(super) fn centre(&self, series: &mut [f64]) {
        for run in &self.runs {
            let part = &mut series[run.range.clone()];
            let mean = part.iter().sum::<f64>() / part.len().max(1) as f64;
            part.iter_mut().for_each(|value| *value -= mean);
        }
    }

    /// Sum of the squared deviations of the force to explain from each run's mean, N².
    pub(super) fn spread(&self) -> f64 {
        let mut force = self.measured_n.clone();
        self.centre(&mut force);
        dot(&force, &force)
    }

    /// Name of a run without the channel `need`; `None` if all runs have it.
    pub(super) fn lacking(&self, need: Need) -> Option<&str> {
        let lacks = |run: &&RunRows| {
            let value = |k: &usize| {
                let row = &run.dataset.rows[*k];
                match need {
                    Need::Drive => row.drive,
                    Need::CaseTemperature => row.case_temp_c,
                }
            };
            !run.indices.iter().map(value).all(f64::is_finite)
        };
        self.runs.iter().find(lacks).map(|run| run.dataset.name.as_str())
    }
}
