//! Checks of settings and runs before any work.

use super::{Runs, Settings};
use crate::effect::MAX_EFFECTS;
use crate::error::{DiagnosisError, Error};
use crate::identify::{Dataset, check_runs};
use crate::model::Model;

/// Rejects settings out of range, and runs that cannot give a valid result.
pub(super) fn check(base: &Model, runs: &Runs, settings: &Settings) -> Result<(), Error> {
    Error::check("significance", settings.significance, "between 0 and 0.5", |s| s > 0.0 && s <= 0.5)?;
    Error::check("block_s", settings.training_block_s(), "between 0.1 and 60 s", |s| {
        (0.1..=60.0).contains(&s)
    })?;
    Error::check("most_effects", settings.most_effects as f64, "1 to 3", |n| {
        (1.0..=MAX_EFFECTS as f64).contains(&n)
    })?;
    if runs.estimate.is_empty() {
        return Err(DiagnosisError::NoTrainingRuns.into());
    }
    if runs.confirm.is_empty() {
        return Err(DiagnosisError::NoValidationRun.into());
    }
    let by_role = [
        ("estimate", runs.estimate),
        ("confirm", runs.confirm),
        ("test", runs.test),
        ("reference", runs.reference),
    ];
    let all: Vec<(&str, &Dataset)> =
        by_role.iter().flat_map(|(role, runs)| runs.iter().map(move |run| (*role, run))).collect();
    for (index, (role, run)) in all.iter().enumerate() {
        if let Some((before, twin)) = all[..index].iter().find(|(_, other)| same_content(run, other)) {
            return Err(DiagnosisError::SameRun {
                roles: [role, before],
                runs: [run.name.clone(), twin.name.clone()],
            }
            .into());
        }
        check_runs(&base.augmented(), run)?;
        if run.conditioning != base.conditioning {
            return Err(DiagnosisError::OtherConditioning { run: run.name.clone() }.into());
        }
        if run.counted() == 0 {
            return Err(DiagnosisError::NothingMoves { role, run: run.name.clone() }.into());
        }
    }
    Ok(())
}

/// True if the measured numbers are the same. The names and start times of the runs do not matter.
fn same_content(a: &Dataset, b: &Dataset) -> bool {
    let same = |x: f64, y: f64| x == y || (x.is_nan() && y.is_nan());
    a.rows.len() == b.rows.len()
        && a.rows.iter().zip(&b.rows).all(|(a, b)| {
            same(a.raw_force_n, b.raw_force_n)
                && same(a.displacement_m, b.displacement_m)
                && same(a.drive, b.drive)
        })
}
