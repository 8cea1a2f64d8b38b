//! Errors of a comparison.

use crate::settings::error::PartError;
use std::path::PathBuf;

/// Reasons why models cannot be compared.
#[derive(Debug, thiserror::Error)]
pub(super) enum CompareError {
    /// A run is given twice.
    #[error("{} is named twice: give each run once, either with --train or with --test", run.display())]
    RepeatedRun {
        /// The run, as given the second time.
        run: PathBuf,
    },
    /// None of the models has the form that is asked for.
    #[error("{} has no form {} the drive: leave --{} out", models.join(", "), form.drive(), form.flag())]
    NoForm {
        /// The models.
        models: Vec<String>,
        /// The form.
        form: OnlyForm,
    },
    /// More models are asked for than a picture can show.
    #[error("--pictures names {found} models: a picture shows at most {most}")]
    TooManyPictures {
        /// Number of models that are named.
        found: usize,
        /// Number of models in a picture.
        most: usize,
    },
    /// A picture is asked for that no compared model has.
    #[error(
        "--pictures {picture}: no model of this comparison is drawn so; give names of compared models, and :one-step only for a model \
         that predicts from measured force (arx, savaresi, lpv, networks)"
    )]
    NoPicture {
        /// The picture as given.
        picture: String,
    },
    /// No experiment has this name.
    #[error("there is no experiment {name} in the folder; there are {}", known.join(", "))]
    UnknownExperiment {
        /// The name as given.
        name: String,
        /// Names of all experiments in the folder.
        known: Vec<String>,
    },
    /// Levels were to be held out, but the runs do not hold one level each.
    #[error(
        "--folds levels: {}; at least {fewest} levels are needed, and each run must hold one of them: leave --folds out",
        found.map_or_else(|| "the drive of a run varies, or there is none".to_owned(), |found| format!("the runs hold {found} levels"))
    )]
    NoLevels {
        /// Number of levels; `None` if the runs do not hold one level each.
        found: Option<usize>,
        /// Fewest levels.
        fewest: usize,
    },
    /// A finished cell cannot be serialised.
    #[error("a finished cell cannot be written as JSON: {0}")]
    Cell(#[source] serde_json::Error),
}

impl PartError for CompareError {}

/// The only form that is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OnlyForm {
    /// `--passive-only`: without the drive.
    Passive,
    /// `--semi-active-only`: with the drive.
    SemiActive,
}

impl OnlyForm {
    const fn drive(self) -> &'static str {
        match self {
            Self::Passive => "without",
            Self::SemiActive => "with",
        }
    }

    const fn flag(self) -> &'static str {
        match self {
            Self::Passive => "passive-only",
            Self::SemiActive => "semi-active-only",
        }
    }
}
