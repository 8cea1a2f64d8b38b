//! The model file: TOML with a model, the data it was identified from, and its expected error.
//!
//! ```toml
//! schema = "mr-damper/model/1"
//! model = "fuzzy-tanh"
//! drive = "current_a"          # or "command_v"; absent for a passive ARX
//! effects = []                 # no effects; or, in order of application:
//!
//! [[effects]]
//! id = "coil_lag"              # see `crate::effect`
//! form = "one_tau"             # if an id has more than one form
//! tau_s = 0.01                 # parameters by name
//!
//! [parameters]                 # unit-suffixed names; see `Parameters`
//! [inverse_model]              # a learned inverse, if one was identified; see [`crate::inverse::InverseModel`]
//! [conditioning]               # filter, derivative, rate
//! [envelope]                   # training ranges
//! [expected]                   # expected RMSE, N
//! [expected.uncertainty]       # widths by region, if calibrated; see `crate::uncertainty`
//! [provenance]                 # runs with SHA-256, tool version, seed, metrics
//! ```
//!
//! Each kind of model has a submodule with its parameter table. Reading is strict: an unknown key, a missing
//! key, or a parameter in another unit is an error that names the key.

mod arx;
mod effects;
mod fuzzy_tanh;
mod inverse_model;
mod law;
mod lazy;
mod lpv;
mod maxwell_slip;
mod memberships;
mod network;
mod tsk;

use crate::condition::Conditioning;
use crate::edit_distance::edit_distance;
use crate::error::{Error, ModelFileError};
use crate::force::{ArxShape, ForceLaw, ForceModel, NetworkStructure, TskKind};
use crate::metrics::Fit;
use crate::model::{Envelope, Expected, Model};
use crate::sample::{DriveKind, Run};
use serde::{Deserialize, Serialize};

/// The value of `schema` in files that this version reads and writes.
pub const SCHEMA: &str = "mr-damper/model/1";

/// A model and its provenance, as stored in a file.
///
/// ```
/// use mr_damper_model::model_file::{ModelFile, Provenance};
/// use mr_damper_model::preset;
///
/// let file = ModelFile { model: preset::load("thesis/sp-passive/rp-icps")?, provenance: Provenance::default() };
/// let text = file.to_toml()?;
/// assert_eq!(ModelFile::from_toml(&text)?, file);
///
/// // An unknown key is an error that names it.
/// let error = ModelFile::from_toml(&text.replace("[conditioning]", "[conditionning]")).unwrap_err();
/// assert!(error.to_string().contains("conditionning"), "{error}");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ModelFile {
    /// The model.
    pub model: Model,
    /// Origin of the model.
    pub provenance: Provenance,
}

/// Origin of a model.
///
/// ```
/// use mr_damper_model::model_file::{ModelFile, Provenance, Role, TrainingRun};
/// # use mr_damper_model::preset;
///
/// let run = TrainingRun {
///     name: "monday.csv".to_owned(), samples: 5_120, force_offset_n: -12.5, role: Some(Role::Estimate), ..TrainingRun::default()
/// };
/// let provenance = Provenance { tool: "my tool 1.0".to_owned(), runs: vec![run], ..Provenance::default() };
/// # let model = preset::load(preset::BEST_ARX)?;
/// let text = ModelFile { model, provenance }.to_toml()?;
/// assert!(text.contains("role = \"estimate\"") && text.contains("force_offset_n = -12.5"), "{text}");
/// assert_eq!(ModelFile::from_toml(&text)?.provenance.runs[0].role, Some(Role::Estimate));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Provenance {
    /// Program and version that wrote the file.
    pub tool: String,
    /// Date of writing, RFC 3339.
    pub date: String,
    /// Seed of the random restarts.
    pub seed: u64,
    /// Number of restarts.
    pub restarts: u32,
    /// Rank of the regression (ARX); less than the number of coefficients if regressors are collinear.
    pub rank: Option<u32>,
    /// True if the runs alone did not determine the model, and a weak prior was added to the fit
    /// ([`crate::identify::WithoutPrior`]).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub weak_prior: bool,
    /// Runs that the model was made with: training runs, and those with another [`Role`].
    pub runs: Vec<TrainingRun>,
    /// Simulation error on the training runs, without the offset of each run.
    pub training_free_run: Option<Fit>,
    /// Error of the one-step-ahead prediction on the training runs.
    pub training_one_step: Option<Fit>,
    /// Simulation error on the validation runs, with the file's own offset.
    pub validation_free_run: Option<Fit>,
    /// Error of the one-step-ahead prediction on the validation runs.
    pub validation_one_step: Option<Fit>,
    /// Error of persistence, which predicts the force of the previous sample; the reference for one-step
    /// figures.
    pub persistence: Option<Fit>,
}

/// A run that was used in an identification.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingRun {
    /// Path or name of the run.
    pub name: String,
    /// SHA-256 of the file, in hex; empty if the run was not a file.
    pub sha256: String,
    /// Number of samples that were used.
    pub samples: u64,
    /// The run's identified force offset, N.
    pub force_offset_n: f64,
    /// Role of the run in the diagnosis that produced the model; absent for an ordinary training run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub role: Option<Role>,
}

impl TrainingRun {
    /// A run with this role that no offset was identified for. Its hash is empty.
    #[must_use]
    pub fn of(run: &Run, role: Role) -> Self {
        let samples = run.displacement_m.len() as u64;
        Self { name: run.name.clone(), samples, role: Some(role), ..Self::default() }
    }
}

/// Role of a run in a diagnosis (see [`crate::diagnose`]) or beside an identification. Files keep the words of the command-line flags
/// `--estimate`, `--confirm`, `--test` and `--validate`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// The base model of the diagnosis was trained on it, or chosen with it.
    Base,
    /// Training run: effects were found on it.
    Estimate,
    /// Validation run: it decided whether a finding is confirmed.
    Confirm,
    /// Test run: read once, at the end.
    Test,
    /// Validation run of an identification (`identify --validate`): the model's expected error and its band are from it. Also a run of
    /// `evaluate --calibrate`, for the band alone.
    Validate,
    /// Healthy reference run of the same excitation.
    Reference,
    /// One of several runs of one excitation, for the noise floor.
    Replicate,
    /// Run of the healthy damper: it tells a discovered term from a lack of the base's structure.
    Healthy,
}

/// `[conditioning]` of the file: the settings, and the sample rate that they were used at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct FileConditioning {
    rate_hz: f64,
    #[serde(flatten)]
    conditioning: Conditioning,
}

/// Parameters by name, with the unit in the name. One flat table per model keeps files easy to read and
/// compare.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Parameters {
    Arx(arx::Parameters),
    FuzzyTanh(fuzzy_tanh::Parameters),
    Law(law::Parameters),
    Lazy(lazy::Parameters),
    Lpv(lpv::Parameters),
    MaxwellSlip(maxwell_slip::Parameters),
    Network(network::Parameters),
    Tsk(tsk::Parameters),
}

impl Parameters {
    fn of(force: &ForceModel) -> Self {
        match force {
            ForceModel::Arx(model) => Self::Arx(arx::Parameters::of(model)),
            ForceModel::FuzzyTanh(model) => Self::FuzzyTanh(fuzzy_tanh::Parameters::of(model)),
            ForceModel::Law(model) => Self::Law(law::Parameters::of(model)),
            ForceModel::Lazy(model) => Self::Lazy(lazy::Parameters::of(model)),
            ForceModel::Lpv(model) => Self::Lpv(lpv::Parameters::of(model)),
            ForceModel::MaxwellSlip(model) => Self::MaxwellSlip(maxwell_slip::Parameters::of(model)),
            ForceModel::Network(model) => Self::Network(network::Parameters::of(model)),
            ForceModel::Tsk(model) => Self::Tsk(tsk::Parameters::of(model)),
        }
    }
}

#[derive(Debug, Serialize)]
struct Written<'a> {
    schema: &'a str,
    model: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    drive: Option<DriveKind>,
    effects: Vec<effects::Written>,
    parameters: Parameters,
    #[serde(skip_serializing_if = "Option::is_none")]
    inverse_model: Option<inverse_model::Written>,
    conditioning: FileConditioning,
    envelope: Envelope,
    expected: Expected,
    provenance: &'a Provenance,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Read {
    schema: String,
    model: String,
    drive: Option<DriveKind>,
    #[serde(default)]
    effects: Vec<toml::Table>,
    parameters: toml::Table,
    inverse_model: Option<toml::Table>,
    conditioning: toml::Table,
    #[serde(default)]
    envelope: Envelope,
    #[serde(default)]
    expected: Expected,
    #[serde(default)]
    provenance: Provenance,
}

impl ModelFile {
    /// The file's text.
    ///
    /// # Errors
    /// If a number cannot be written as TOML.
    pub fn to_toml(&self) -> Result<String, Error> {
        let Model { force, effects, conditioning, rate_hz, envelope, expected, inverse } = self.model;
        let written = Written {
            schema: SCHEMA,
            model: force.name(),
            drive: force.drive(),
            effects: effects::write(&effects, &force),
            parameters: Parameters::of(&force),
            inverse_model: inverse.as_ref().map(inverse_model::Written::of),
            conditioning: FileConditioning { rate_hz, conditioning },
            envelope,
            expected,
            provenance: &self.provenance,
        };
        toml::to_string(&written).map_err(|error| ModelFileError::Write { message: error.to_string() }.into())
    }

    /// Parses a file's text.
    ///
    /// # Errors
    /// [`Error::ModelFile`] with the line or key, the value and what to do; [`Error::OutOfRange`] and
    /// [`Error::Length`] for invalid numbers.
    pub fn from_toml(text: &str) -> Result<Self, Error> {
        let read: Read = toml::from_str(text).map_err(|error| ModelFileError::Syntax {
            line: error.span().map(|span| line_at(text, span.start)),
            message: error.to_string(),
        })?;
        if read.schema != SCHEMA {
            return Err(ModelFileError::Schema { found: read.schema, known: SCHEMA }.into());
        }
        let force = match read.model.as_str() {
            "arx" => ForceModel::Arx(arx::read(ArxShape::PLAIN, read.drive, &read.parameters)?),
            "arx-delayed" => ForceModel::Arx(arx::read(ArxShape::DELAYED, read.drive, &read.parameters)?),
            "savaresi" => ForceModel::Arx(arx::read(ArxShape::SAVARESI, read.drive, &read.parameters)?),
            "fuzzy-tanh" => ForceModel::FuzzyTanh(fuzzy_tanh::read(read.drive, &read.parameters)?),
            "lpv" => ForceModel::Lpv(lpv::read(read.drive, &read.parameters)?),
            "maxwell-slip" => ForceModel::MaxwellSlip(maxwell_slip::read(read.drive, &read.parameters)?),
            "boada" => ForceModel::Lazy(lazy::read(read.drive, &read.parameters)?),
            name => match (ForceLaw::named(name), TskKind::from_name(name), NetworkStructure::named(name)) {
                (Some(law), _, _) => ForceModel::Law(law::read(law, read.drive, &read.parameters)?),
                (_, Some(kind), _) => ForceModel::Tsk(tsk::read(kind, read.drive, &read.parameters)?),
                (_, _, Some(structure)) => {
                    ForceModel::Network(network::read(structure, read.drive, &read.parameters)?)
                }
                (None, None, None) => return Err(unknown_model(name)),
            },
        };
        let mut table = read.conditioning;
        let rate_hz = match table.remove("rate_hz") {
            Some(toml::Value::Float(rate)) => rate,
            Some(toml::Value::Integer(rate)) => rate as f64,
            Some(other) => return Err(not_a_number("conditioning.rate_hz".to_owned(), &other)),
            None => return Err(missing("conditioning.rate_hz".to_owned())),
        };
        Error::check("conditioning.rate_hz", rate_hz, "positive and finite", |r| r > 0.0)?;
        let conditioning: Conditioning = table_into("conditioning", table, &[])?;
        conditioning.validate()?;
        let effects = effects::read(&read.effects, &force)?;
        let (envelope, expected) = (read.envelope, read.expected);
        let inverse = read.inverse_model.map(|table| inverse_model::read(read.drive, &table)).transpose()?;
        let model = Model { force, effects, conditioning, rate_hz, envelope, expected, inverse };
        Ok(Self { model, provenance: read.provenance })
    }
}

fn unknown_model(name: &str) -> Error {
    let mut known = vec!["arx", "savaresi", "lpv", "fuzzy-tanh", "maxwell-slip", "boada"];
    known.extend(ForceLaw::ALL.map(ForceLaw::name));
    known.extend(NetworkStructure::ALL.map(NetworkStructure::name));
    known.extend(TskKind::ALL.map(TskKind::name));
    ModelFileError::UnknownName { name: name.to_owned(), known }.into()
}

/// Deserialises one table. The error for an unknown key suggests the key (and unit) that was probably
/// intended.
fn table_into<T: serde::de::DeserializeOwned>(
    name: &str,
    table: toml::Table,
    known: &[&str],
) -> Result<T, Error> {
    for key in table.keys() {
        if !known.is_empty() && !known.contains(&key.as_str()) {
            let nearest = known.iter().min_by_key(|k| edit_distance(k, key)).unwrap_or(&"");
            let (key, nearest) = (format!("{name}.{key}"), (*nearest).to_owned());
            return Err(ModelFileError::UnknownKey { key, nearest }.into());
        }
    }
    table.try_into().map_err(|error: toml::de::Error| {
        ModelFileError::Table { table: name.to_owned(), message: error.to_string().trim().to_owned() }.into()
    })
}

/// The error for a drive that does not match the parameters; `needed` names the parameters that would.
fn drive_error(drive: Option<DriveKind>, needed: &str) -> Error {
    ModelFileError::OtherDrive { drive, needed: needed.to_owned() }.into()
}

fn missing(key: String) -> Error {
    ModelFileError::MissingKey { key }.into()
}

fn not_a_number(key: String, found: &toml::Value) -> Error {
    ModelFileError::WrongType { key, found: found.to_string(), expected: "a number" }.into()
}

/// Number of the line with the byte `at` of `text`, from 1.
fn line_at(text: &str, at: usize) -> usize {
    1 + text.bytes().take(at).filter(|byte| *byte == b'\n').count()
}

#[cfg(test)]
mod tests;
