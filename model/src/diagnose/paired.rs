//! Paired mode: what changed since a healthy run with the same excitation.
//!
//! ```text
//! force to explain = M(theta) + F_run - F_reference        M the base, which is not refitted
//! ```
//!
//! The base's own faults are in run and reference alike and cancel in the difference; written so, everything else goes on as
//! in absolute mode, with nothing to project off. What noise there is counts twice.

use super::floor::forces_at;
use super::rows::Rows;
use crate::effect::Augmented;
use crate::error::Error;
use crate::identify::Dataset;

/// Force of the first of `references` that moves like `run`, at each row of `run`, N; `None` where it has none. `None` at all when
/// none of them moves like it: their displacements differ by more than 10 %, root mean square, by time since the first row.
#[must_use]
pub fn reference_force_n(run: &Dataset, references: &[Dataset]) -> Option<Vec<Option<f64>>> {
    references.iter().find_map(|reference| forces_at(run, reference).ok())
}

/// The rows of `datasets` with the difference to their references as the force to explain. Each run's reference is the first of
/// `references` that moves like it.
pub(super) fn rows<'a>(
    datasets: &'a [Dataset],
    references: &[Dataset],
    base: &Augmented,
    most: usize,
) -> Result<Rows<'a>, Error> {
    let rows = Rows::new(datasets, most);
    let Some(predicted_n) = rows.predict(base) else {
        return Err(Error::Data { message: "the base model does not stay finite on these runs".to_owned() });
    };
    let mut force_n = Vec::with_capacity(rows.len());
    for run in rows.runs() {
        let Some(reference) = reference_force_n(run.dataset, references) else {
            return Err(Error::Data {
                message: format!(
                    "run {}: none of the reference runs has its excitation (displacement within 10 %, from the first sample on); \
                     give a healthy run with the same motion and current for each run, or leave --reference out",
                    run.dataset.name
                ),
            });
        };
        for (&k, at) in run.indices.iter().zip(run.range.clone()) {
            // A row that the reference lacks says nothing: no difference.
            let difference_n = reference[k].map_or(0.0, |healthy_n| run.dataset.rows[k].force_n - healthy_n);
            force_n.push(predicted_n[at] + difference_n);
        }
    }
    Ok(rows.with_force(force_n))
}
