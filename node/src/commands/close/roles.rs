//! The runs of a diagnosis by role, and the checks that refuse a run.

use super::RecordedArgs;
use super::base::Base;
use crate::commands::context::CliContext;
use crate::commands::progress::Working;
use crate::settings::error::NodeError;
use mr_damper_model::model_file::Role;
use mr_damper_model::sample::Run;
use std::path::{Path, PathBuf};

/// A run and its role.
pub(super) struct Given {
    pub(super) role: Role,
    pub(super) path: PathBuf,
    pub(super) run: Run,
    pub(super) sha256: String,
}

/// The flag that gives runs this role.
const fn flag(role: Role) -> &'static str {
    match role {
        Role::Base => "--base",
        Role::Estimate => "--estimate",
        Role::Confirm => "--confirm",
        Role::Test => "--test",
        Role::Validate => "--validate",
        Role::Reference => "--reference",
        Role::Replicate => "--replicates",
        Role::Healthy => "--healthy",
    }
}

/// All paths, in the order in which they are read.
pub(super) fn paths(args: &RecordedArgs) -> Vec<(Role, &Path)> {
    let lists: [(Role, &[PathBuf]); 6] = [
        (Role::Estimate, &args.estimate),
        (Role::Confirm, &args.confirm),
        (Role::Test, &args.test),
        (Role::Reference, &args.reference),
        (Role::Replicate, &args.replicates),
        (Role::Healthy, &args.healthy),
    ];
    lists.into_iter().flat_map(|(role, paths)| paths.iter().map(move |path| (role, path.as_path()))).collect()
}

/// Checks the numbers of runs, before any file is read.
///
/// # Errors
/// [`NodeError::Usage`] without a validation run, with only one replicate, or without a reference run for each other run.
pub(super) fn check_counts(args: &RecordedArgs) -> Result<(), NodeError> {
    if args.confirm.is_empty() {
        return Err(NodeError::Usage(
            "there is no validation run: an effect that was not checked on another run is a guess. Give at least one with \
             --confirm, recorded separately from the training runs"
                .to_owned(),
        ));
    }
    if args.replicates.len() == 1 {
        return Err(NodeError::Usage(format!(
            "{} is the only replicate: the noise floor comes from the difference between runs of one pattern. Give at \
             least two with --replicates, or the floor itself with --noise-floor",
            args.replicates[0].display()
        )));
    }
    let (references, runs) =
        (args.reference.len(), args.estimate.len() + args.confirm.len() + args.test.len());
    if references > 0 && references != runs {
        return Err(NodeError::Usage(format!(
            "there are {references} reference runs for {runs} runs ({} --estimate, {} --confirm, {} --test): give \
             --reference one healthy run with the same excitation for each of them, in that order",
            args.estimate.len(),
            args.confirm.len(),
            args.test.len()
        )));
    }
    Ok(())
}

/// Reads all runs.
///
/// # Errors
/// When a run does not load, has the same content as another, has another kind of drive than `base` or the other runs, or
/// is a test run from which `base` was identified.
pub(super) fn load(
    args: &RecordedArgs,
    base: &Base,
    context: &CliContext,
    working: &Working,
) -> Result<Vec<Given>, NodeError> {
    let paths = paths(args);
    let mut all: Vec<Given> = Vec::with_capacity(paths.len());
    for (role, path) in &paths {
        if context.interrupt.is_raised() {
            return Err(NodeError::Interrupted);
        }
        working.done("reading runs", all.len() as u64, paths.len() as u64);
        let loaded = args.load.load(path)?;
        let given =
            Given { role: *role, path: path.to_path_buf(), sha256: loaded.sha256_hex(), run: loaded.run };
        check_once(&given, &all)?;
        base.check_unknown(&given)?;
        all.push(given);
    }
    check_drives(base, &all)?;
    Ok(all)
}

/// Refuses a run whose content was given before, also under another name.
fn check_once(given: &Given, before: &[Given]) -> Result<(), NodeError> {
    let Some(same) = before.iter().find(|other| other.sha256 == given.sha256) else { return Ok(()) };
    let message = format!(
        "given with {}, has the same content as {}, given with {} (SHA-256 {}...): a run that is used twice would \
         validate itself. Give another run, or leave it out",
        flag(given.role),
        same.path.display(),
        flag(same.role),
        &given.sha256[..12]
    );
    Err(NodeError::File { path: given.path.clone(), message })
}

/// Refuses a run whose drive is not the drive that the base needs, or not the first run's if the base is not identified yet.
fn check_drives(base: &Base, all: &[Given]) -> Result<(), NodeError> {
    if !base.needs_drive() {
        return Ok(());
    }
    let Some(first) = all.first() else { return Ok(()) };
    let needed = base.drive().or(first.run.drive_kind());
    let who = || match base.drive() {
        Some(_) => "the base needs".to_owned(),
        None => format!("{} has", first.path.display()),
    };
    for given in all {
        let message = match (given.run.drive_kind(), needed) {
            (None, needed) => format!(
                "has no {}, which the base needs: record it, or use a base without the drive (a model's name with --passive)",
                needed.map_or("current_a or command_v", |kind| kind.name())
            ),
            (Some(found), Some(needed)) if found != needed => format!(
                "is driven by {found}, but {} {needed}: leave the run out, or choose the column with --drive if the run \
                 holds both",
                who()
            ),
            _ => continue,
        };
        return Err(NodeError::File { path: given.path.clone(), message });
    }
    Ok(())
}
