//! Paired mode: what changed since a healthy run with the same excitation.
//!
//! ```text
//! force to explain = M(theta) + F_run - F_reference        M the base, which is not refitted
//! ```
//!
//! The base's own errors are the same in run and reference and cancel in the difference. In this form all further steps are
//! the same as in absolute mode, with no base coefficients to project off. The noise counts twice, once for each run.

use super::floor::{ALIKE, forces_at};
use super::rows::Rows;
use crate::effect::Augmented;
use crate::error::{DiagnosisError, Error};
use crate::identify::Dataset;

/// Force of the matching reference at each row of `run`, N; `None` at rows where it has no force. The match is the first of
/// `references` whose displacement differs by at most 10 %, root mean square, compared by time since the first row. Returns `None` if no
/// reference matches.
///
/// ```
/// use mr_damper_model::condition::Conditioning;
/// use mr_damper_model::diagnose::reference_force_n;
/// use mr_damper_model::identify::{Dataset, DatasetOptions};
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let rows = |frequency_hz, seed| {
///     let run = record(&Experiment::sine(0.01, frequency_hz, 1.2, 3.0), &Plant::default(), &Channels::default(), seed);
///     Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default())
/// };
/// // The second reference has the excitation of the run. Its force differs by the noise of the load cell.
/// let (run, references) = (rows(2.0, 1)?, [rows(3.0, 2)?, rows(2.0, 3)?]);
/// let force_n = reference_force_n(&run, &references).expect("the excitation matches");
/// let differences_n = run.rows.iter().zip(&force_n).filter_map(|(row, n)| n.map(|n| (row.force_n - n).abs()));
/// assert!(differences_n.filter(|n| n.is_finite()).fold(0.0, f64::max) < 50.0);
/// assert_eq!(reference_force_n(&run, &references[..1]), None);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[must_use]
pub fn reference_force_n(run: &Dataset, references: &[Dataset]) -> Option<Vec<Option<f64>>> {
    references.iter().find_map(|reference| forces_at(run, reference).ok())
}

/// The rows of `datasets` with the force to explain of paired mode. Each run's reference is the one that [`reference_force_n`] finds.
///
/// # Errors
/// [`DiagnosisError::BaseDivergesPaired`]; [`DiagnosisError::NoReference`].
pub(super) fn rows<'a>(
    datasets: &'a [Dataset],
    references: &[Dataset],
    base: &Augmented,
    most: usize,
) -> Result<Rows<'a>, Error> {
    let rows = Rows::new(datasets, most);
    let Some(predicted_n) = rows.predict(base) else {
        return Err(DiagnosisError::BaseDivergesPaired.into());
    };
    let mut force_n = Vec::with_capacity(rows.len());
    for run in rows.runs() {
        let Some(reference) = reference_force_n(run.dataset, references) else {
            return Err(DiagnosisError::NoReference { run: run.dataset.name.clone(), most: ALIKE }.into());
        };
        for (&k, at) in run.indices.iter().zip(run.range.clone()) {
            // A row without a reference force carries no information: its difference is zero.
            let difference_n = reference[k].map_or(0.0, |healthy_n| run.dataset.rows[k].force_n - healthy_n);
            force_n.push(predicted_n[at] + difference_n);
        }
    }
    Ok(rows.with_force(force_n))
}
