//! Checks of settings and runs before any work. Those that need no base also come before a base is identified.

use super::rows::Rows;
use super::{Runs, Settings, score};
use crate::effect::MAX_EFFECTS;
use crate::error::{DiagnosisError, Error};
use crate::identify::{Dataset, check_runs, check_sign};
use crate::model::Model;

/// Rejects settings out of range, and runs that cannot give a valid result with `base`.
pub(super) fn check(base: &Model, runs: &Runs, settings: &Settings) -> Result<(), Error> {
    check_without_base(runs, settings)?;
    for (_, run) in with_roles(runs) {
        check_runs(&base.augmented(), run)?;
        if run.conditioning != base.conditioning {
            return Err(DiagnosisError::OtherConditioning { run: run.name.clone() }.into());
        }
    }
    Ok(())
}

/// The same for a base that is not identified yet; also rejects training runs that are too short.
pub(super) fn check_before_base(runs: &Runs, settings: &Settings) -> Result<(), Error> {
    check_without_base(runs, settings)?;
    score::check_length(&Rows::new(runs.estimate, settings.most_rows), settings)
}

fn check_without_base(runs: &Runs, settings: &Settings) -> Result<(), Error> {
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
    let all: Vec<(&str, &Dataset)> = with_roles(runs).collect();
    for (index, (role, run)) in all.iter().enumerate() {
        if let Some((before, twin)) = all[..index].iter().find(|(_, other)| same_content(run, other)) {
            return Err(DiagnosisError::SameRun {
                roles: [role, before],
                runs: [run.name.clone(), twin.name.clone()],
            }
            .into());
        }
        if run.counted() == 0 {
            return Err(DiagnosisError::NothingMoves { role, run: run.name.clone() }.into());
        }
        check_sign(run)?;
    }
    Ok(())
}

/// All runs, with the names of their roles.
fn with_roles<'a>(runs: &Runs<'a>) -> impl Iterator<Item = (&'static str, &'a Dataset)> + use<'a> {
    let by_role = [
        ("estimate", runs.estimate),
        ("confirm", runs.confirm),
        ("test", runs.test),
        ("reference", runs.reference),
    ];
    by_role.into_iter().flat_map(|(role, runs)| runs.iter().map(move |run| (role, run)))
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
