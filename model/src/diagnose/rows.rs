//! The rows that a closing's sums are taken over.
//!
//! A model is always stepped over **all** rows of a run, since it, its effects and filters remember. What enters sums
//! are the rows that count ([`crate::identify::Row::counts`]), of long runs every n-th. Every series is concatenated run by
//! run, and each run's mean is taken out: sessions differ in their force offset, and no effect is one.

use crate::effect::{Augmented, Need};
use crate::identify::{Dataset, walk};
use rayon::prelude::*;
use std::ops::{ControlFlow, Range};

/// Some runs, as sums see them.
pub(super) struct Rows<'a> {
    runs: Vec<RunRows<'a>>,
    /// Measured force, N; what stands for it in paired mode.
    measured_n: Vec<f64>,
}

/// The rows of one run that enter.
pub(super) struct RunRows<'a> {
    pub(super) dataset: &'a Dataset,
    /// Indices of the rows, increasing.
    pub(super) indices: Vec<usize>,
    /// Where they stand in the concatenated series.
    pub(super) range: Range<usize>,
}

impl RunRows<'_> {
    /// Time of each row since the run's first row, s.
    pub(super) fn times_s(&self) -> impl Iterator<Item = f64> {
        let rows = &self.dataset.rows;
        self.indices.iter().map(move |&k| rows[k].stamp.since(rows[0].stamp).get())
    }

    /// Free run of `model` at the rows that enter, N; `None` where it is not finite on one of them.
    fn predict(&self, model: &Augmented) -> Option<Vec<f64>> {
        self.predict_on(model, self.dataset)
    }

    /// The same on other rows in place of the run's.
    pub(super) fn predict_on(&self, model: &Augmented, dataset: &Dataset) -> Option<Vec<f64>> {
        let mut predicted = Vec::with_capacity(self.indices.len());
        let (mut index, mut finite) = (0, true);
        // Broken off or not, what counts is whether all rows were reached.
        let _ = walk(model, dataset, |_, said| {
            if self.indices.get(predicted.len()) == Some(&index) {
                finite &= said.free_run_n.is_finite();
                predicted.push(said.free_run_n);
            }
            index += 1;
            // Nothing after the last row that enters matters, nor after one that is not finite.
            if !finite || predicted.len() == self.indices.len() {
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(())
        });
        (finite && predicted.len() == self.indices.len()).then_some(predicted)
    }
}

impl<'a> Rows<'a> {
    /// The rows of `datasets` that enter: those that count and `takes` lets in, about `most` at most.
    pub(super) fn new(datasets: &'a [Dataset], most: usize) -> Self {
        let counted: usize = datasets.iter().map(Dataset::counted).sum();
        let every = counted.div_ceil(most.max(1)).max(1);
        let mut start = 0;
        let runs: Vec<RunRows> = datasets
            .iter()
            .map(|dataset| {
                let warm = dataset.rows.iter().any(|row| row.case_temp_c.is_finite());
                // Rows before the first reading of the temperature would be lost to effects that need it.
                let counts = |k: &usize| {
                    let row = &dataset.rows[*k];
                    row.counts && (!warm || row.case_temp_c.is_finite())
                };
                let indices: Vec<usize> = (0..dataset.rows.len()).filter(counts).step_by(every).collect();
                let range = start..start + indices.len();
                start = range.end;
                RunRows { dataset, indices, range }
            })
            .collect();
        let force =
            |run: &RunRows| run.indices.iter().map(|&k| run.dataset.rows[k].force_n).collect::<Vec<_>>();
        let measured_n = runs.iter().flat_map(force).collect();
        Self { runs, measured_n }
    }

    /// The same rows with another force to explain.
    pub(super) fn with_force(self, measured_n: Vec<f64>) -> Self {
        debug_assert_eq!(measured_n.len(), self.measured_n.len(), "one force a row");
        Self { measured_n, ..self }
    }

    /// Number of rows that enter.
    pub(super) const fn len(&self) -> usize {
        self.measured_n.len()
    }

    /// The runs.
    pub(super) fn runs(&self) -> &[RunRows<'a>] {
        &self.runs
    }

    /// The force to explain, N.
    pub(super) fn measured_n(&self) -> &[f64] {
        &self.measured_n
    }

    /// Free run of `model` over all runs, N; `None` where it is not finite.
    pub(super) fn predict(&self, model: &Augmented) -> Option<Vec<f64>> {
        let parts: Vec<Option<Vec<f64>>> = self.runs.par_iter().map(|run| run.predict(model)).collect();
        let mut all = Vec::with_capacity(self.len());
        for part in parts {
            all.extend(part?);
        }
        Some(all)
    }

    /// Measured minus predicted, each run's mean taken out, N.
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

    /// Takes each run's mean out of `series`.
    pub(super) fn centre(&self, series: &mut [f64]) {
        for run in &self.runs {
            let part = &mut series[run.range.clone()];
            let mean = part.iter().sum::<f64>() / part.len().max(1) as f64;
            part.iter_mut().for_each(|value| *value -= mean);
        }
    }

    /// Squared deviation of the measured force from each run's mean, summed, N².
    pub(super) fn spread(&self) -> f64 {
        let mut force = self.measured_n.clone();
        self.centre(&mut force);
        dot(&force, &force)
    }

    /// Name of a run that lacks what `need` says; `None` when all have it.
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

/// Sum of products.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
