//! The base of a closing: a model file, a preset, or a name that is identified first.

use super::roles::Given;
use super::{RecordedArgs, interrupted};
use crate::command::Surroundings;
use crate::command::conditioning::{FilterArg, VelocityArg};
use crate::command::progress::Working;
use crate::error::NodeError;
use crate::models;
use mr_damper_model::identify::{Form, ModelSpec, Options, Structure, Watch, identify};
use mr_damper_model::model::Model;
use mr_damper_model::model_file::{Role, TrainingRun};
use mr_damper_model::sample::{DriveKind, Run};
use std::path::Path;

/// Most rows that a base is finished on when it is identified here; the closing refits it anyway.
const MOST_ROWS: usize = 30_000;

/// What the closing starts from.
pub(super) enum Base {
    /// A model that is there.
    Model(Box<Identified>),
    /// One to identify on the estimate runs.
    Name(ModelSpec),
}

/// A base that can run.
pub(super) struct Identified {
    /// The model.
    pub(super) model: Model,
    /// Where it comes from, in a few words.
    pub(super) source: String,
    /// Runs that it was made from before this closing.
    pub(super) runs: Vec<TrainingRun>,
    /// Restarts that this closing made to identify it.
    pub(super) restarts: u32,
}

impl Base {
    /// The base that `args` ask for.
    ///
    /// # Errors
    /// When there is no such file, preset or name, or flags are given that it leaves nothing to say.
    pub(super) fn of(args: &RecordedArgs) -> Result<Self, NodeError> {
        let names: Vec<&str> = Structure::all().into_iter().map(Structure::name).collect();
        if names.contains(&args.base.as_str()) {
            let form = if args.passive { Form::Passive } else { Form::SemiActive };
            return Ok(Self::Name(ModelSpec::named(&args.base, form)?));
        }
        let path = Path::new(&args.base);
        let file = path.exists() || path.extension().is_some() || args.base.starts_with("thesis/");
        if !file {
            return Err(NodeError::Failed(format!(
                "--base {}: there is no such file, and no such model; models are {}, presets those that `mr-damper \
                 presets` lists",
                args.base,
                names.join(", ")
            )));
        }
        if let Some(flag) = superfluous(args) {
            return Err(NodeError::Usage(format!(
                "{flag} does not go with --base {}: a model that is there holds its own form, filter and derivative. \
                 Leave {flag} out, or name a model to identify (--base fuzzy-tanh)",
                args.base
            )));
        }
        let (model, runs) = if path.exists() {
            let file = models::load_file(path)?;
            (file.model, file.provenance.runs)
        } else {
            (models::load(&args.base)?, Vec::new())
        };
        Ok(Self::Model(Box::new(Identified { model, source: args.base.clone(), runs, restarts: 0 })))
    }

    /// The drive that the base wants, where that is known before it is identified.
    pub(super) fn drive(&self) -> Option<DriveKind> {
        match self {
            Self::Model(base) => base.model.force.drive(),
            Self::Name(_) => None,
        }
    }

    /// True when runs must hold a drive.
    pub(super) fn wants_drive(&self) -> bool {
        match self {
            Self::Model(base) => base.model.force.drive().is_some(),
            Self::Name(spec) => spec.wants_drive(),
        }
    }

    /// Refuses a sealed run that the base was made from, and warns of a confirm run.
    ///
    /// # Errors
    /// [`NodeError::File`] with the run.
    pub(super) fn check_unknown(&self, given: &Given) -> Result<(), NodeError> {
        let Self::Model(base) = self else { return Ok(()) };
        let known = base.runs.iter().any(|run| run.sha256 == given.sha256);
        match given.role {
            Role::Test if known => Err(NodeError::File {
                path: given.path.clone(),
                message: format!(
                    "given with --test, but {} was made with this very run (SHA-256 {}...): a sealed run is one that \
                     nothing has touched. Give another run, or another base",
                    base.source,
                    &given.sha256[..12]
                ),
            }),
            Role::Confirm if known => {
                tracing::warn!(
                    run = %given.path.display(),
                    "the base was made with this confirm run: it confirms less than one that is new to it"
                );
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// The base itself; one that is named is identified on the estimate runs first.
    ///
    /// # Errors
    /// When the estimate runs do not carry the model; [`NodeError::Interrupted`].
    pub(super) fn identified(
        self,
        given: &[Given],
        args: &RecordedArgs,
        around: &Surroundings,
        working: &Working,
    ) -> Result<Identified, NodeError> {
        let spec = match self {
            Self::Model(base) => return Ok(*base),
            Self::Name(spec) => spec,
        };
        // What is healthy says how a healthy damper behaves.
        let (role, whose) = match args.reference.is_empty() {
            true => (Role::Estimate, "estimate"),
            false => (Role::Reference, "reference"),
        };
        let runs: Vec<Run> =
            given.iter().filter(|given| given.role == role).map(|given| given.run.clone()).collect();
        let options = Options {
            conditioning: args.conditioning.conditioning(FilterArg::Output, VelocityArg::ThreePoint)?,
            // A derivative that is late as the damper is late would take the lag for its own.
            choose_velocity: false,
            dataset: args.conditioning.dataset(),
            most_rows: Some(MOST_ROWS),
            restarts: args.restarts.unwrap_or(Options::default().restarts),
            seed: args.seed,
            ..Options::default()
        };
        working.stage("identifying the base");
        let progress = |progress| working.progress(progress);
        let watch = Watch { cancel: Some(around.interrupt.flag()), progress: Some(&progress) };
        let found = identify(spec, &runs, &options, &watch).map_err(interrupted)?;
        for warning in &found.warnings {
            tracing::warn!("the base: {warning}");
        }
        Ok(Identified {
            model: found.model,
            source: format!("{}, identified on the {whose} runs", args.base),
            runs: Vec::new(),
            restarts: u32::try_from(found.restart_rsse_n.len()).unwrap_or(u32::MAX),
        })
    }
}

/// The first flag that only a base to be identified leaves open.
fn superfluous(args: &RecordedArgs) -> Option<&'static str> {
    let own = [("--passive", args.passive), ("--restarts", args.restarts.is_some())];
    args.conditioning.given().or(own.into_iter().find_map(|(flag, given)| given.then_some(flag)))
}
