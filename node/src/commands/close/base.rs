//! The base model of a diagnosis: a model file, a preset, or a named model that is identified first.

use super::RecordedArgs;
use super::roles::Given;
use crate::commands::conditioning::{FilterArg, VelocityArg};
use crate::commands::context::CliContext;
use crate::commands::progress::Working;
use crate::estimation::models;
use crate::settings::error::{NodeError, PartError};
use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::diagnose::{self, Bases, DiagnosisResult, Runs, Settings, Stage};
use mr_damper_model::force::ForceLaw;
use mr_damper_model::identify::{Form, ModelSpec, Options, Structure, Watch, identify};
use mr_damper_model::model::Model;
use mr_damper_model::model_file::{Role, TrainingRun};
use mr_damper_model::sample::{DriveKind, Run};
use std::path::Path;

/// Maximum number of rows in the final fit of a base that is identified here. The diagnosis refits the base anyway.
const MOST_ROWS: usize = 30_000;

/// The base that was asked for.
pub(super) enum Base {
    /// An existing model.
    Model(Box<Identified>),
    /// A model that is first identified on the training or reference runs.
    Name(ModelSpec),
    /// The structure is chosen among several, which are identified on the training runs.
    Auto(Vec<ModelSpec>),
}

/// The bases that can be diagnosed; at least one.
pub(super) struct Prepared {
    /// The base in use, or named and identified.
    given: Option<Box<Identified>>,
    /// Other structures to identify and diagnose, with the settings of their identification.
    structures: Vec<ModelSpec>,
    options: Options,
}

/// Value of `--base` that leaves the structure to the runs.
pub(super) const AUTO: &str = "auto";

/// A base model that is ready to use.
pub(super) struct Identified {
    /// The model.
    pub(super) model: Model,
    /// Its origin, for messages and the report.
    pub(super) source: String,
    /// Runs from which it was identified before this diagnosis.
    pub(super) runs: Vec<TrainingRun>,
    /// Number of restarts in its identification by this command; 0 for an existing model.
    pub(super) restarts: u32,
}

/// The base is neither a file nor the name of a model.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "--base {base}: there is no such file and no such model. Models are {}; `mr-damper presets` lists the presets",
    models.join(", ")
)]
struct UnknownBase {
    /// The value of `--base`.
    base: String,
    /// Names of all models that can be identified.
    models: Vec<&'static str>,
}

impl PartError for UnknownBase {}

impl Base {
    /// The base that `args` ask for.
    ///
    /// # Errors
    /// When the file, preset or model does not exist, or a flag is given that does not apply to an existing model.
    pub(super) fn of(args: &RecordedArgs) -> Result<Self, NodeError> {
        let form = if args.passive { Form::Passive } else { Form::SemiActive };
        if args.base == AUTO && args.fixed_base {
            return Err(NodeError::Usage(
                "--fixed-base needs the base that it is about: give a model file or the name of a model with --base".to_owned(),
            ));
        }
        if args.base == AUTO {
            if args.reference.is_empty() {
                return Ok(Self::Auto(diagnose::default_structures(!args.passive)?));
            }
            return Err(NodeError::Usage(
                "--base auto, the default, cannot be combined with --reference: only the changes since the reference runs are \
                 diagnosed, and their force takes the place of a base. Give the model in use with --base"
                    .to_owned(),
            ));
        }
        let names: Vec<&'static str> = Structure::all().into_iter().map(Structure::name).collect();
        if names.contains(&args.base.as_str()) {
            return Ok(Self::Name(ModelSpec::named(&args.base, form)?));
        }
        let path = Path::new(&args.base);
        let file = path.exists() || path.extension().is_some() || args.base.starts_with("thesis/");
        if !file {
            return Err(UnknownBase { base: args.base.clone(), models: names }.into());
        }
        if let Some(flag) = superfluous(args) {
            return Err(NodeError::Usage(format!(
                "{flag} cannot be combined with --base {}: an existing model holds its own form, filter and derivative. \
                 Leave {flag} out, or name a model to identify (--base fuzzy-tanh)",
                args.base
            )));
        }
        let (model, runs) = if path.exists() {
            let file = models::load_file(path)?;
            // The coefficients do not depend on the runs that its band was calibrated on.
            let made_with = file.provenance.runs.into_iter().filter(|run| run.role != Some(Role::Validate));
            (file.model, made_with.collect())
        } else {
            (models::load(&args.base)?, Vec::new())
        };
        Ok(Self::Model(Box::new(Identified { model, source: args.base.clone(), runs, restarts: 0 })))
    }

    /// The drive that the base needs, if it is known before the identification.
    pub(super) fn drive(&self) -> Option<DriveKind> {
        match self {
            Self::Model(base) => base.model.force.drive(),
            Self::Name(_) | Self::Auto(_) => None,
        }
    }

    /// True if the runs must contain a drive.
    pub(super) fn needs_drive(&self) -> bool {
        match self {
            Self::Model(base) => base.model.force.drive().is_some(),
            Self::Name(spec) => spec.needs_drive(),
            Self::Auto(structures) => structures.iter().any(|spec| spec.needs_drive()),
        }
    }

    /// Refuses a test run from which the base was identified, and warns about such a validation run.
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
                    "given with --test, but {} was made with this very run (SHA-256 {}...): a test run must not have been \
                     used before. Give another run, or another base",
                    base.source,
                    &given.sha256[..12]
                ),
            }),
            Role::Confirm if known => {
                tracing::warn!(
                    run = %given.path.display(),
                    "the base was made with this validation run, which validates less than a new run would"
                );
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// The bases, ready to be diagnosed. A named model is identified here, on the reference runs if there are any, else on the training
    /// runs.
    ///
    /// # Errors
    /// When the model cannot be identified from these runs; [`NodeError::Interrupted`].
    pub(super) fn prepared(
        self,
        given: &[Given],
        args: &RecordedArgs,
        context: &CliContext,
        working: &Working,
    ) -> Result<Prepared, NodeError> {
        let options = options(args)?;
        let spec = match self {
            Self::Model(base) => return Prepared::around(*base, options, args),
            Self::Auto(structures) => return Ok(Prepared { given: None, structures, options }),
            Self::Name(spec) => spec,
        };
        // Reference runs show how the healthy damper behaves.
        let (role, whose) = match args.reference.is_empty() {
            true => (Role::Estimate, "estimate"),
            false => (Role::Reference, "reference"),
        };
        let runs: Vec<Run> =
            given.iter().filter(|given| given.role == role).map(|given| given.run.clone()).collect();
        working.stage("identifying the base");
        let progress = |progress| working.progress(progress);
        let watch = Watch { cancel: Some(context.interrupt.flag()), progress: Some(&progress) };
        let found = identify(spec, &runs, &options, &watch)?;
        for warning in &found.warnings {
            tracing::warn!("the base: {warning}");
        }
        let base = Identified {
            model: found.model,
            source: format!("{}, identified on the {whose} runs", args.base),
            runs: Vec::new(),
            restarts: u32::try_from(found.restart_rsse_n.len()).unwrap_or(u32::MAX),
        };
        Prepared::around(base, options, args)
    }
}

impl Prepared {
    /// `given` with the structures that compete with it. None competes with --fixed-base, with reference runs, or with the linear law: to
    /// that law all else is an effect, also what another structure contains, such as friction.
    ///
    /// All structures have the conditioning of a diagnosis without a base. A velocity that is computed late, or a force without the filter,
    /// makes a lag of its own, which would depend on the base. Only a measured velocity is kept.
    fn around(mut given: Identified, options: Options, args: &RecordedArgs) -> Result<Self, NodeError> {
        let is_linear = given.model.force.name() == ForceLaw::Linear.name();
        if args.fixed_base || is_linear || !args.reference.is_empty() {
            let options = Options { conditioning: given.model.conditioning, ..options };
            return Ok(Self { given: Some(Box::new(given)), structures: Vec::new(), options });
        }
        let structures = diagnose::default_structures(given.model.force.drive().is_some())?;
        let mut conditioning = options.conditioning;
        if given.model.conditioning.velocity == VelocitySource::Measured {
            conditioning.velocity = VelocitySource::Measured;
        }
        if given.model.conditioning != conditioning {
            tracing::info!(
                "the diagnosis uses its own filter and velocity, as without --base; with --fixed-base it uses the base's"
            );
        }
        given.model.conditioning = conditioning;
        Ok(Self { given: Some(Box::new(given)), structures, options: Options { conditioning, ..options } })
    }

    /// How runs become rows.
    pub(super) fn conditioning(&self) -> &Conditioning {
        &self.options.conditioning
    }

    /// The diagnosis of `runs`: of the best of several bases, or of the given one alone.
    ///
    /// # Errors
    /// Those of [`diagnose::close_any`].
    pub(super) fn diagnose(
        &self,
        runs: &Runs,
        settings: &Settings,
        watch: &Watch,
        stage: &dyn Fn(Stage),
    ) -> Result<DiagnosisResult, mr_damper_model::Error> {
        match (&self.given, self.structures.as_slice()) {
            (Some(base), []) => diagnose::close(&base.model, runs, settings, watch, stage),
            (given, structures) => {
                let given = given.as_ref().map(|base| &base.model);
                diagnose::close_any(
                    &Bases { given, structures, options: &self.options },
                    runs,
                    settings,
                    watch,
                    stage,
                )
            }
        }
    }

    /// The base that `result` is about.
    pub(super) fn of_result(self, result: &DiagnosisResult) -> Identified {
        let chosen = result.chosen().filter(|(row, _)| !row.given);
        match (self.given, chosen) {
            (Some(given), None) => *given,
            (given, chosen) => {
                let beside =
                    given.as_ref().map_or_else(String::new, |given| format!(", beside {}", given.source));
                Identified {
                    model: result.before,
                    source: format!(
                        "chosen among {} structures on the validation runs{beside}",
                        result.structures.len()
                    ),
                    runs: given.map_or_else(Vec::new, |given| given.runs),
                    restarts: chosen.map_or(0, |(_, fit)| fit.restarts),
                }
            }
        }
    }
}

/// Settings of the identification of a base.
fn options(args: &RecordedArgs) -> Result<Options, NodeError> {
    Ok(Options {
        conditioning: args.conditioning.conditioning(FilterArg::Output, VelocityArg::ThreePoint)?,
        // A delayed derivative could absorb a lag of the damper.
        choose_velocity: false,
        dataset: args.conditioning.dataset(),
        most_rows: Some(MOST_ROWS),
        restarts: args.restarts.unwrap_or(Options::default().restarts),
        seed: args.seed,
        ..Options::default()
    })
}

/// The first given flag that applies only to a base that is identified here.
fn superfluous(args: &RecordedArgs) -> Option<&'static str> {
    let own = [("--passive", args.passive), ("--restarts", args.restarts.is_some())];
    args.conditioning.given().or(own.into_iter().find_map(|(flag, given)| given.then_some(flag)))
}
