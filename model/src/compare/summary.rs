//! Summary over many cells: means over tests, the best training experiment, and the order of the models.

use super::{BoxPlot, Finished, Predictor};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// A model and its predictor: figures of different predictors are never ranked together.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Class {
    /// The predictor.
    pub predictor: Predictor,
    /// Name of the model.
    pub model: String,
    /// How the drive enters the model.
    pub form: String,
}

/// Cross-validation of a model that was trained on one experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Name of the experiment.
    pub trained_on: String,
    /// Mean RMSE over all tests, N; `None` if any test has no figure, since a mean of the others would be too
    /// low.
    pub mean_rsse_n: Option<f64>,
    /// 95 % interval of the mean RMSE, N, from the scatter of the means by tested experiment (by fold over folds); `None` without
    /// a mean, or with fewer than two of these. It is approximate: all tests share a model or training runs.
    pub rsse_interval_n: Option<[f64; 2]>,
    /// Mean NMSE over all tests; `None` as above.
    pub mean_esr: Option<f64>,
    /// Number of tests.
    pub tests: usize,
    /// Number of tests without a figure: the model diverged, or the run does not suit it.
    pub without: usize,
}

/// Cross-validation of a model over all training experiments.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// The model.
    pub class: Class,
    /// Number of identified parameters (in the last cell that has a model).
    pub parameters: usize,
    /// One row for each training experiment that yielded a model.
    pub rows: Vec<Row>,
    /// NMSE of every test that has one.
    pub esr: Vec<f64>,
    /// Number of tests without a figure.
    pub without: usize,
    /// Training experiments without a model, and the reason.
    pub failures: Vec<(String, String)>,
}

impl Summary {
    /// Summaries of all models, grouped by predictor and then sorted by the mean NMSE of the best training
    /// experiment, lowest first. Models without such a mean are last.
    #[must_use]
    pub fn of(cells: &[Finished]) -> Vec<Self> {
        let mut all: Vec<Self> = Vec::new();
        for cell in cells {
            for figure in &cell.identification {
                let row = Row::of(cell, figure.predictor);
                let summary = entry(&mut all, cell, figure.predictor);
                summary.parameters = cell.parameters.unwrap_or(summary.parameters);
                summary.without += row.without;
                summary.rows.push(row);
                summary.esr.extend(figures(cell, figure.predictor).filter_map(|(_, esr)| esr));
            }
        }
        for cell in cells {
            if let Some(why) = &cell.failure {
                entry(&mut all, cell, Predictor::FreeRun)
                    .failures
                    .push((cell.trained_on.clone(), why.clone()));
            }
        }
        all.sort_by(|a, b| {
            let mean = |summary: &Self| summary.best().and_then(|row| row.mean_esr).unwrap_or(f64::INFINITY);
            a.class
                .predictor
                .cmp(&b.class.predictor)
                .then(mean(a).total_cmp(&mean(b)))
                .then(a.class.cmp(&b.class))
        });
        all
    }

    /// The row of the training experiment with the lowest mean NMSE; `None` if no row has one.
    #[must_use]
    pub fn best(&self) -> Option<&Row> {
        let with = self.rows.iter().filter(|row| row.mean_esr.is_some());
        with.min_by(|a, b| a.mean_esr.unwrap_or(f64::NAN).total_cmp(&b.mean_esr.unwrap_or(f64::NAN)))
    }

    /// Box plot of the NMSE of all tests that have one.
    #[must_use]
    pub fn spread(&self) -> Option<BoxPlot> {
        BoxPlot::of(self.esr.iter().copied())
    }

    /// Median NMSE, where tests without a figure count as worse than all others; `None` if the median falls
    /// on one of those.
    #[must_use]
    pub fn median_esr(&self) -> Option<f64> {
        let mut all = self.esr.clone();
        all.resize(self.esr.len() + self.without, f64::INFINITY);
        all.sort_by(f64::total_cmp);
        let (low, high) = (*all.get(all.len().checked_sub(1)? / 2)?, *all.get(all.len() / 2)?);
        Some(0.5 * (low + high)).filter(|median| median.is_finite())
    }
}

impl Row {
    fn of(cell: &Finished, predictor: Predictor) -> Self {
        let (mut rsse_n, mut esr, mut tests, mut with) = (0.0, 0.0, 0_usize, 0_usize);
        for found in figures(cell, predictor) {
            tests += 1;
            if let (Some(r), Some(e)) = found {
                (rsse_n, esr, with) = (rsse_n + r, esr + e, with + 1);
            }
        }
        let mean = |sum: f64| (tests > 0 && with == tests).then(|| sum / tests as f64);
        Self {
            trained_on: cell.trained_on.clone(),
            mean_rsse_n: mean(rsse_n),
            rsse_interval_n: mean(rsse_n).and_then(|mean| interval(cell, predictor, mean)),
            mean_esr: mean(esr),
            tests,
            without: tests - with,
        }
    }
}

/// 95 % interval of the mean RMSE `mean_n`: Student's t with the means by tested experiment as independent values.
fn interval(cell: &Finished, predictor: Predictor, mean_n: f64) -> Option<[f64; 2]> {
    let mut groups: Vec<(&str, f64, f64)> = Vec::new();
    for test in &cell.cross_validation {
        for rsse_n in test.figures.iter().filter(|f| f.predictor == predictor).filter_map(|f| f.rsse_n) {
            match groups.iter_mut().find(|(name, ..)| *name == test.tested_on) {
                Some((_, sum, count)) => (*sum, *count) = (*sum + rsse_n, *count + 1.0),
                None => groups.push((&test.tested_on, rsse_n, 1.0)),
            }
        }
    }
    let n = groups.len() as f64;
    let t = StudentsT::new(0.0, 1.0, n - 1.0).ok()?.inverse_cdf(0.975);
    let means: Vec<f64> = groups.iter().map(|(_, sum, count)| sum / count).collect();
    let centre = means.iter().sum::<f64>() / n;
    let variance = means.iter().map(|mean| (mean - centre).powi(2)).sum::<f64>() / (n - 1.0);
    let half = t * (variance / n).sqrt();
    Some([mean_n - half, mean_n + half])
}

/// RMSE and NMSE of the cell's tests.
fn figures(cell: &Finished, predictor: Predictor) -> impl Iterator<Item = (Option<f64>, Option<f64>)> {
    let all = cell.cross_validation.iter().flat_map(|test| &test.figures);
    all.filter(move |figure| figure.predictor == predictor).map(|figure| (figure.rsse_n, figure.esr))
}

/// The summary of the cell's model, created if it is missing.
fn entry<'a>(all: &'a mut Vec<Summary>, cell: &Finished, predictor: Predictor) -> &'a mut Summary {
    let class = Class { predictor, model: cell.model.clone(), form: cell.form.clone() };
    let index = all.iter().position(|summary| summary.class == class).unwrap_or_else(|| {
        let (rows, esr, failures) = (Vec::new(), Vec::new(), Vec::new());
        all.push(Summary { class, parameters: 0, rows, esr, without: 0, failures });
        all.len() - 1
    });
    &mut all[index]
}
