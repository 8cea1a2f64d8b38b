//! Published models of the thesis, by name.
//!
//! - `thesis/arx-passive/<experiment>` and `thesis/arx-semi-active/<experiment>`: 16 ARX models
//! - `thesis/sp-passive/<experiment>` and `thesis/sp-semi-active/<experiment>`: 16 tanh force laws
//! - `thesis/fuzzy-tanh/<rp1-cs|rp2-cs|rp3-cs>`: three current-fuzzy tanh models
//! - `thesis/fuzzy-tanh/<set>/<level>a`: one of their 21 tanh functions, e.g. `thesis/fuzzy-tanh/rp3-cs/1.2a`
//! - `thesis/anfis/<experiment>`: eight ANFIS models of 27 rules
//!
//! The 16 phase-transition relations (`thesis/p-passive/...`, `thesis/p-semi-active/...`) cannot run as
//! models; only [`phase`] returns them, and [`load`] says why. [`published`] holds the errors that the thesis
//! prints.
//!
//! All models were identified at 512 Hz, on displacement that was low-passed by two poles at 20 Hz, with the
//! backward difference as velocity. They describe one damper (an ACDelco MagneRide unit, 0 to 2.5 A, up to
//! about 1.4 kN); identify a model of your own for any other damper.
//!
//! The printed tables are text files in `model/data`, which the build turns into the arrays of `tables`.
//!
//! ```
//! use mr_damper_model::preset;
//!
//! let model = preset::load("thesis/arx-semi-active/rp-icps-l")?;
//! assert_eq!((model.force.name(), model.force.parameter_count(), model.rate_hz), ("arx", 12, 512.0));
//! assert!(preset::names().iter().all(|name| preset::load(name).is_ok()));
//!
//! // The relation P is not a model: it computes force from the force of the same instant.
//! let name = &preset::phase_names()[0];
//! assert!(preset::load(name).unwrap_err().to_string().contains("cannot run as a model"));
//! assert_eq!(preset::phase(name)?.parameter_count(), 5);
//! # Ok::<(), mr_damper_model::Error>(())
//! ```

mod anfis_rows;
mod arx_rows;
mod fuzzy_rows;
mod p_rows;
pub mod published;
mod sp_rows;
mod tables;

pub(crate) use fuzzy_rows::{CENTRES_A, SIGMA_A};

use crate::condition::Conditioning;
use crate::edit_distance::edit_distance;
use crate::effect::Effects;
use crate::error::Error;
use crate::force::{ForceModel, Form, FuzzyTanh, Phase};
use crate::model::{Envelope, Expected, Model};
use crate::units::N_PER_LBF;

/// The thesis' experiments, in the order of its tables and in lower case, as in preset names.
pub const EXPERIMENTS: [&str; 8] =
    ["rp-icps", "rp-aprbs", "rp-prbs", "rp-aprbs-l", "rp-icps-l", "rp1-cs", "rp2-cs", "rp3-cs"];

/// Widths of the recorded displacement range, m, in the order of [`EXPERIMENTS`] (table 3.2).
const SPANS_M: [f64; 8] =
    [0.026_416, 0.027_432, 0.029_718, 0.027_432, 0.025_908, 0.033_528, 0.033_274, 0.036_068];

/// The ARX model with the lowest error over all the thesis' experiments (section 5.1).
pub const BEST_ARX: &str = "thesis/arx-semi-active/rp-icps-l";
/// The fuzzy-tanh model with the lowest error over all the thesis' experiments (section 5.1).
pub const BEST_FUZZY_TANH: &str = "thesis/fuzzy-tanh/rp3-cs";

/// The ANFIS model with the lowest error over all the thesis' experiments (section 5.1).
pub const BEST_ANFIS: &str = "thesis/anfis/rp1-cs";

/// Names of all presets.
#[must_use]
pub fn names() -> Vec<String> {
    let mut names = Vec::with_capacity(64);
    for form in ["arx-passive", "arx-semi-active", "sp-passive", "sp-semi-active", "anfis"] {
        names.extend(EXPERIMENTS.iter().map(|experiment| format!("thesis/{form}/{experiment}")));
    }
    for set in &EXPERIMENTS[5..] {
        names.push(format!("thesis/fuzzy-tanh/{set}"));
        names.extend(CENTRES_A.iter().map(|level| format!("thesis/fuzzy-tanh/{set}/{level:.1}a")));
    }
    names
}

/// The preset `name`.
///
/// # Errors
/// [`Error::UnknownPreset`] with the most similar name; [`Error::PhaseRelation`] with the reason if `name` is a
/// phase-transition relation.
pub fn load(name: &str) -> Result<Model, Error> {
    if let Some(relation) = find_phase(name) {
        return Err(cannot_run(name, &relation));
    }
    find(name).ok_or_else(|| unknown(name, names()))
}

/// Names of the phase-transition relations.
#[must_use]
pub fn phase_names() -> Vec<String> {
    let of_form = |form| EXPERIMENTS.iter().map(move |experiment| format!("thesis/{form}/{experiment}"));
    ["p-passive", "p-semi-active"].into_iter().flat_map(of_form).collect()
}

/// The phase-transition relation `name`. It relates force to motion but cannot run as a model.
///
/// # Errors
/// [`Error::UnknownPreset`] with the most similar name.
pub fn phase(name: &str) -> Result<Phase, Error> {
    find_phase(name).ok_or_else(|| unknown(name, phase_names()))
}

fn find_phase(name: &str) -> Option<Phase> {
    let (form, experiment) = name.strip_prefix("thesis/")?.split_once('/')?;
    let experiment = EXPERIMENTS.iter().find(|known| **known == experiment)?;
    match form {
        "p-passive" => p_rows::passive(experiment),
        "p-semi-active" => p_rows::semi_active(experiment),
        _ => None,
    }
}

/// The error for a relation that was named as a model.
fn cannot_run(name: &str, relation: &Phase) -> Error {
    Error::PhaseRelation {
        name: name.to_owned(),
        why: relation.cannot_run(0.0).map(Box::new),
        drive: relation.drive().map(|_| 0.0),
        nearest: name.replacen("/p-", "/sp-", 1),
    }
}

fn unknown(name: &str, known: Vec<String>) -> Error {
    let rated = known.into_iter().map(|known| (edit_distance(&known, name), known));
    // A name that differs in more than a third of its characters is not a misspelling.
    let nearest = rated.min().filter(|(distance, known)| 3 * distance <= known.chars().count());
    Error::UnknownPreset { name: name.to_owned(), nearest: nearest.map(|(_, known)| known) }
}

fn find(name: &str) -> Option<Model> {
    let mut parts = name.strip_prefix("thesis/")?.split('/');
    let (form, experiment, level) = (parts.next()?, parts.next()?, parts.next());
    if parts.next().is_some() {
        return None;
    }
    let row = EXPERIMENTS.iter().position(|known| *known == experiment)?;
    let half = SPANS_M[row] / 2.0;
    let span = Envelope { displacement_m: Some([-half, half]), ..Envelope::default() };
    let identified =
        |model, form| Some(published::identification(model, form, experiment)?.rsse_lbf * N_PER_LBF);
    let one_step = |form| Expected { one_step_rsse_n: identified("arx", form), ..Expected::default() };
    let free_run = |form| Expected { free_run_rsse_n: identified("sp", form), ..Expected::default() };
    // The average over all experiments; for fuzzy-tanh, the thesis prints no error on the training data.
    let average = |model| {
        let average = published::cross_validation(model, Form::SemiActive, experiment)?;
        Some(Expected { free_run_rsse_n: Some(average.rsse_lbf * N_PER_LBF), ..Expected::default() })
    };
    let mut envelope = span;
    let (force, expected) = match (form, level) {
        ("arx-passive", None) => (ForceModel::Arx(arx_rows::passive(experiment)?), one_step(Form::Passive)),
        ("arx-semi-active", None) => {
            (ForceModel::Arx(arx_rows::semi_active(experiment)?), one_step(Form::SemiActive))
        }
        ("sp-passive", None) => (ForceModel::Law(sp_rows::passive(experiment)?), free_run(Form::Passive)),
        ("sp-semi-active", None) => {
            (ForceModel::Law(sp_rows::semi_active(experiment)?), free_run(Form::SemiActive))
        }
        ("fuzzy-tanh", level) => {
            let model = fuzzy_rows::model(experiment)?;
            let model = match level {
                None => model,
                Some(level) => {
                    let j = CENTRES_A.iter().position(|c| format!("{c:.1}a") == level)?;
                    single(&model, j)?
                }
            };
            (ForceModel::FuzzyTanh(model), average("fuzzy-tanh")?)
        }
        ("anfis", None) => {
            let (model, own) = anfis_rows::model(experiment)?;
            envelope = own;
            (ForceModel::Tsk(model), average("anfis")?)
        }
        _ => return None,
    };
    Some(Model {
        force,
        effects: Effects::NONE,
        conditioning: Conditioning::THESIS,
        rate_hz: 512.0,
        envelope: Envelope { drive: force.drive().map(|_| [0.0, 2.5]), ..envelope },
        expected,
        inverse: None,
    })
}

/// A row of printed parameters in SI units: each parameter times its factor.
fn in_si(row: [f64; 5], si: [f64; 5]) -> [f64; 5] {
    std::array::from_fn(|j| row[j] * si[j])
}

/// A row of printed polynomials in SI units. A row has the coefficients of 1, i and i² of each parameter; the
/// result has a row of the five parameters for 1, one for i and one for i².
fn quadratic_in_si(row: [f64; 15], si: [f64; 5]) -> [[f64; 5]; 3] {
    std::array::from_fn(|power| std::array::from_fn(|j| row[3 * j + power] * si[j]))
}

/// Function `j` of `model` alone: the force no longer depends on current.
fn single(model: &FuzzyTanh, j: usize) -> Option<FuzzyTanh> {
    let (centres, functions) = (model.sets().centres().get(j..=j)?, model.functions().get(j..=j)?);
    FuzzyTanh::new(fuzzy_rows::sets(centres).ok()?, functions, 0.0).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model_file::{ModelFile, Provenance};

    /// FNV-1a hash: any changed digit changes it.
    fn digest(text: &str) -> String {
        let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        format!("{:016x}", text.bytes().fold(0xcbf2_9ce4_8422_2325, step))
    }

    #[test]
    fn a_relation_that_is_named_as_a_model_is_refused_with_the_reason() {
        for name in phase_names() {
            let message = load(&name).expect_err("no model").to_string();
            let similar = name.replace("/p-", "/sp-");
            for words in ["cannot run as a model", "measured force of the same instant", "diverges", &similar]
            {
                assert!(message.contains(words), "{name}: {message}");
            }
            assert_eq!(message.contains("at 0 A"), name.contains("semi-active"), "{message}");
            assert!(load(&similar).is_ok(), "{similar}");
        }
    }

    /// The tables were compared with the thesis number by number. Update the snapshot only for a deliberate
    /// change, and explain it.
    #[test]
    fn published_tables_match_the_reviewed_snapshot() {
        let mut all = String::new();
        for name in names() {
            let file = ModelFile { model: load(&name).expect("a preset"), provenance: Provenance::default() };
            all += &format!("{name} {}\n", digest(&file.to_toml().expect("a preset can be written")));
        }
        for name in phase_names() {
            let relation = phase(&name).expect("a preset");
            let numbers = format!("{:?} {:?}", relation.drive(), relation.coefficients());
            all += &format!("{name} {}\n", digest(&numbers));
        }
        insta::assert_snapshot!(all);
    }
}
