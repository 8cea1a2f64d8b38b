//! The model file: TOML that holds a model, what it was identified from, and what to expect of it.
//!
//! ```toml
//! schema = "mr-damper/model/1"
//! model = "fuzzy-tanh"
//! drive = "current_a"          # or "command_v"; absent for a passive ARX
//! effects = []                 # in order of application
//!
//! [parameters]                 # unit-suffixed names; see `Parameters`
//! [conditioning]               # filter, derivative, rate
//! [envelope]                   # training ranges
//! [expected]                   # RSSE to expect, N
//! [provenance]                 # runs with SHA-256, tool version, seed, metrics
//! ```
//!
//! Reading is strict: an unknown key, a missing one, or a parameter in another unit is an error that names it.

use crate::condition::Conditioning;
use crate::error::Error;
use crate::force::{Arx, ForceModel, FuzzyTanh, LAGS, Membership, TanhFunction};
use crate::metrics::Fit;
use crate::model::{Envelope, Expected, Model};
use crate::preset::edit_distance;
use crate::sample::DriveKind;
use crate::units::Second;
use serde::{Deserialize, Serialize};

/// The value of `schema` in files that this version reads and writes.
pub const SCHEMA: &str = "mr-damper/model/1";

/// A model with its history, as a file holds it.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelFile {
    /// The model.
    pub model: Model,
    /// How it came about.
    pub provenance: Provenance,
}

/// How a model came about.
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
    /// Rank of the regression (ARX); below the number of coefficients where regressors are collinear.
    pub rank: Option<u32>,
    /// Runs that it was trained on.
    pub runs: Vec<TrainingRun>,
    /// Fit on the training runs, running free, offset of each run taken out.
    pub training_free_run: Option<Fit>,
    /// Fit on the training runs, one step ahead.
    pub training_one_step: Option<Fit>,
    /// Fit on the validation runs, running free, with the file's own offset.
    pub validation_free_run: Option<Fit>,
    /// Fit on the validation runs, one step ahead.
    pub validation_one_step: Option<Fit>,
    /// One step ahead, predicting that the force stays what it was: what one-step figures are to be held against.
    pub persistence: Option<Fit>,
}

/// A run that took part in an identification.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingRun {
    /// Its path or name.
    pub name: String,
    /// SHA-256 of the file, in hex; empty when the run was not a file.
    pub sha256: String,
    /// Samples that counted.
    pub samples: u64,
    /// Force offset that was identified for it, N.
    pub force_offset_n: f64,
}

/// Parameters by name, with the unit in the name. One flat table a model keeps files easy to read and diff.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
enum Parameters {
    Fuzzy(FuzzyParameters),
    Arx(ArxParameters),
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FuzzyParameters {
    force_offset_n: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    membership_sigma_a: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    membership_sigma_v: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    membership_centres_a: Option<Vec<f64>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    membership_centres_v: Option<Vec<f64>>,
    yield_force_n: Vec<f64>,
    post_yield_damping_n_s_m: Vec<f64>,
    pre_yield_slope_s_m: Vec<f64>,
    coupling_per_s: Vec<f64>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ArxParameters {
    sample_period_s: f64,
    force_offset_n: f64,
    /// Half a unit of the last digit when the coefficients were copied from print; absent when they are exact.
    #[serde(default, skip_serializing_if = "is_zero")]
    coefficient_resolution: f64,
    /// a1..a3.
    force_lags: [f64; LAGS],
    /// a4..a6.
    displacement_lags_n_m: [f64; LAGS],
    /// a7..a9.
    velocity_lags_n_s_m: [f64; LAGS],
    /// a10..a12 on current.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    current_lags_n_a: Option<[f64; LAGS]>,
    /// a10..a12 on command voltage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    voltage_lags_n_v: Option<[f64; LAGS]>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde calls")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// `[conditioning]` of the file: the settings and the rate that they were used at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct FileConditioning {
    rate_hz: f64,
    #[serde(flatten)]
    conditioning: Conditioning,
}

#[derive(Debug, Serialize)]
struct Written<'a> {
    schema: &'a str,
    model: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    drive: Option<DriveKind>,
    effects: [&'a str; 0],
    parameters: Parameters,
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
    /// When a number cannot be written as TOML.
    pub fn to_toml(&self) -> Result<String, Error> {
        let Model { force, conditioning, rate_hz, envelope, expected } = self.model;
        let written = Written {
            schema: SCHEMA,
            model: force.name(),
            drive: force.drive(),
            effects: [],
            parameters: Parameters::of(&force),
            conditioning: FileConditioning { rate_hz, conditioning },
            envelope,
            expected,
            provenance: &self.provenance,
        };
        toml::to_string(&written).map_err(|e| file_error(e.to_string()))
    }

    /// Reads a file's text.
    ///
    /// # Errors
    /// [`Error::ModelFile`] with the key, the value and what to do; [`Error::OutOfRange`] and
    /// [`Error::Length`] for numbers that make no model.
    pub fn from_toml(text: &str) -> Result<Self, Error> {
        let read: Read = toml::from_str(text).map_err(|e| file_error(e.to_string()))?;
        if read.schema != SCHEMA {
            return Err(file_error(format!(
                "schema is \"{}\"; this version reads \"{SCHEMA}\"",
                read.schema
            )));
        }
        if !read.effects.is_empty() {
            return Err(file_error(format!(
                "effects holds {} entries, but this version knows no effects; use a newer mr-damper",
                read.effects.len()
            )));
        }
        let force = match read.model.as_str() {
            "fuzzy-tanh" => fuzzy_from(&read)?,
            "arx" => arx_from(&read)?,
            other => {
                return Err(file_error(format!(
                    "model is \"{other}\"; known are \"arx\" and \"fuzzy-tanh\""
                )));
            }
        };
        let mut table = read.conditioning;
        let rate_hz = match table.remove("rate_hz") {
            Some(toml::Value::Float(rate)) => rate,
            Some(toml::Value::Integer(rate)) => rate as f64,
            Some(other) => return Err(file_error(format!("conditioning.rate_hz is {other}, not a number"))),
            None => return Err(file_error("conditioning.rate_hz is missing".to_owned())),
        };
        Error::check("conditioning.rate_hz", rate_hz, "positive and finite", |r| r > 0.0)?;
        let conditioning: Conditioning = table_into("conditioning", table, &[])?;
        conditioning.validate()?;
        let model = Model { force, conditioning, rate_hz, envelope: read.envelope, expected: read.expected };
        Ok(Self { model, provenance: read.provenance })
    }
}

impl Parameters {
    fn of(force: &ForceModel) -> Self {
        match force {
            ForceModel::FuzzyTanh(f) => {
                let (amperes, volts) = match f.drive() {
                    DriveKind::CoilCurrent => (Some(()), None),
                    DriveKind::CommandVoltage => (None, Some(())),
                };
                let column = |get: fn(&TanhFunction) -> f64| f.functions().iter().map(get).collect();
                Self::Fuzzy(FuzzyParameters {
                    force_offset_n: f.force_offset_n(),
                    membership_sigma_a: amperes.map(|()| f.sigma()),
                    membership_sigma_v: volts.map(|()| f.sigma()),
                    membership_centres_a: amperes.map(|()| f.centres().to_vec()),
                    membership_centres_v: volts.map(|()| f.centres().to_vec()),
                    yield_force_n: column(|t| t.yield_force_n),
                    post_yield_damping_n_s_m: column(|t| t.post_yield_damping_n_s_m),
                    pre_yield_slope_s_m: column(|t| t.pre_yield_slope_s_m),
                    coupling_per_s: column(|t| t.coupling_per_s),
                })
            }
            ForceModel::Arx(arx) => {
                let lags = |kind| arx.drive_lags().filter(|(k, _)| *k == kind).map(|(_, lags)| lags);
                Self::Arx(ArxParameters {
                    sample_period_s: arx.sample_period().get(),
                    force_offset_n: arx.force_offset_n(),
                    coefficient_resolution: arx.resolution(),
                    force_lags: arx.force_lags(),
                    displacement_lags_n_m: arx.displacement_lags_n_m(),
                    velocity_lags_n_s_m: arx.velocity_lags_n_s_m(),
                    current_lags_n_a: lags(DriveKind::CoilCurrent),
                    voltage_lags_n_v: lags(DriveKind::CommandVoltage),
                })
            }
        }
    }
}

/// Keys of the two parameter tables, for "did you mean".
const FUZZY_KEYS: [&str; 9] = [
    "force_offset_n",
    "membership_sigma_a",
    "membership_sigma_v",
    "membership_centres_a",
    "membership_centres_v",
    "yield_force_n",
    "post_yield_damping_n_s_m",
    "pre_yield_slope_s_m",
    "coupling_per_s",
];
const ARX_KEYS: [&str; 8] = [
    "sample_period_s",
    "force_offset_n",
    "coefficient_resolution",
    "force_lags",
    "displacement_lags_n_m",
    "velocity_lags_n_s_m",
    "current_lags_n_a",
    "voltage_lags_n_v",
];

fn fuzzy_from(read: &Read) -> Result<ForceModel, Error> {
    let p: FuzzyParameters = table_into("parameters", read.parameters.clone(), &FUZZY_KEYS)?;
    let drive = read.drive.ok_or_else(|| {
        file_error("drive is missing; a fuzzy-tanh model needs \"current_a\" or \"command_v\"".to_owned())
    })?;
    let (unit, sigma, centres, foreign) = match drive {
        DriveKind::CoilCurrent => {
            ("a", p.membership_sigma_a, &p.membership_centres_a, p.membership_centres_v.is_some())
        }
        DriveKind::CommandVoltage => {
            ("v", p.membership_sigma_v, &p.membership_centres_v, p.membership_centres_a.is_some())
        }
    };
    let (Some(sigma), Some(centres), false) = (sigma, centres, foreign) else {
        return Err(file_error(format!(
            "drive is \"{drive}\", so parameters must hold membership_centres_{unit} and membership_sigma_{unit}, \
             and none in the other unit"
        )));
    };
    let n = centres.len();
    for (name, list) in [
        ("yield_force_n", &p.yield_force_n),
        ("post_yield_damping_n_s_m", &p.post_yield_damping_n_s_m),
        ("pre_yield_slope_s_m", &p.pre_yield_slope_s_m),
        ("coupling_per_s", &p.coupling_per_s),
    ] {
        if list.len() != n {
            return Err(Error::Length {
                name: format!("parameters.{name}"),
                found: list.len(),
                expected: format!("{n} (one for each of membership_centres_{unit})"),
            });
        }
    }
    let functions: Vec<TanhFunction> = (0..n)
        .map(|j| TanhFunction {
            yield_force_n: p.yield_force_n[j],
            post_yield_damping_n_s_m: p.post_yield_damping_n_s_m[j],
            pre_yield_slope_s_m: p.pre_yield_slope_s_m[j],
            coupling_per_s: p.coupling_per_s[j],
        })
        .collect();
    FuzzyTanh::new(Membership { drive, sigma }, centres, &functions, p.force_offset_n)
        .map(ForceModel::FuzzyTanh)
}

fn arx_from(read: &Read) -> Result<ForceModel, Error> {
    let p: ArxParameters = table_into("parameters", read.parameters.clone(), &ARX_KEYS)?;
    let drive = match (read.drive, p.current_lags_n_a, p.voltage_lags_n_v) {
        (None, None, None) => None,
        (Some(kind @ DriveKind::CoilCurrent), Some(lags), None)
        | (Some(kind @ DriveKind::CommandVoltage), None, Some(lags)) => Some((kind, lags)),
        (drive, _, _) => {
            return Err(file_error(format!(
                "drive is {}, which wants {} in parameters and nothing else of the kind",
                drive.map_or("absent".to_owned(), |d| format!("\"{d}\"")),
                match drive {
                    None => "neither current_lags_n_a nor voltage_lags_n_v",
                    Some(DriveKind::CoilCurrent) => "current_lags_n_a",
                    Some(DriveKind::CommandVoltage) => "voltage_lags_n_v",
                }
            )));
        }
    };
    let resolution =
        Error::check("coefficient_resolution", p.coefficient_resolution, "zero or positive", |r| r >= 0.0)?;
    Arx::new(
        p.force_lags,
        p.displacement_lags_n_m,
        p.velocity_lags_n_s_m,
        drive,
        Second(p.sample_period_s),
        p.force_offset_n,
    )
    .map(|arx| ForceModel::Arx(arx.with_resolution(resolution)))
}

/// Deserialises one table; an unknown key gets a hint on the key (and unit) that was probably meant.
fn table_into<T: serde::de::DeserializeOwned>(
    name: &str,
    table: toml::Table,
    known: &[&str],
) -> Result<T, Error> {
    for key in table.keys() {
        if !known.is_empty() && !known.contains(&key.as_str()) {
            let nearest = known.iter().min_by_key(|k| edit_distance(k, key)).unwrap_or(&"");
            return Err(file_error(format!(
                "{name}.{key} is unknown; did you mean {nearest}? (the suffix is the unit: _n newtons, _a amperes, \
                 _v volts, _s seconds, _m metres; convert the numbers when the unit differs)"
            )));
        }
    }
    table.try_into().map_err(|e: toml::de::Error| file_error(format!("[{name}]: {}", e.to_string().trim())))
}

fn file_error(message: String) -> Error {
    Error::ModelFile { message }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preset;

    fn file(name: &str) -> ModelFile {
        ModelFile { model: preset::load(name).expect("preset"), provenance: Provenance::default() }
    }

    fn error_of(text: &str) -> String {
        ModelFile::from_toml(text).expect_err("a broken file").to_string()
    }

    #[test]
    fn every_preset_survives_the_file_bit_for_bit() {
        for name in preset::names() {
            let written = file(&name);
            let text = written.to_toml().expect("writes");
            let read = ModelFile::from_toml(&text).unwrap_or_else(|e| panic!("{name}: {e}\n{text}"));
            assert_eq!(read, written, "{name}");
        }
    }

    #[test]
    fn a_wrong_unit_is_named_with_the_right_one() {
        let text = file("thesis/fuzzy-tanh/rp3-cs").to_toml().expect("writes");
        let message = error_of(&text.replace("yield_force_n", "yield_force_lbf"));
        assert!(
            message.contains("parameters.yield_force_lbf is unknown; did you mean yield_force_n?"),
            "{message}"
        );
        let message = error_of(&text.replace("drive = \"current_a\"", "drive = \"command_v\""));
        assert!(message.contains("membership_centres_v and membership_sigma_v"), "{message}");
        let message = error_of(&text.replace("drive = \"current_a\"", "drive = \"current_ma\""));
        assert!(message.contains("current_ma") && message.contains("current_a"), "{message}");
    }

    #[test]
    fn other_errors_name_the_key() {
        let text = file("thesis/fuzzy-tanh/rp3-cs").to_toml().expect("writes");
        for (from, to, expected) in [
            ("membership_sigma_a = 0.2", "membership_sigma_a = -0.2", "membership_sigma_a is -0.2"),
            ("membership_sigma_a = 0.2", "membership_sigma_a = nan", "membership_sigma_a is NaN"),
            ("mr-damper/model/1", "mr-damper/model/9", "schema is \"mr-damper/model/9\""),
            ("model = \"fuzzy-tanh\"", "model = \"fuzzy\"", "model is \"fuzzy\""),
            ("rate_hz = 512.0", "rate_hz = 0.0", "conditioning.rate_hz is 0"),
            ("cutoff_hz = 20.0", "cutoff_rad_s = 20.0", "cutoff_rad_s"),
            ("effects = []", "effects = [{id = \"coil_lag\"}]", "effects holds 1 entries"),
        ] {
            assert!(text.contains(from), "the test must change the file: {from}");
            let message = error_of(&text.replace(from, to));
            assert!(message.contains(expected), "{to}: {message}");
        }
        let message = error_of("schema = ");
        assert!(message.contains("line 1"), "{message}");
    }
}
