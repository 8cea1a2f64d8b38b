//! The thesis' published models, by name.
//!
//! - `thesis/arx-passive/<experiment>` and `thesis/arx-semi-active/<experiment>`: 16 ARX rows
//! - `thesis/fuzzy-tanh/<rp1-cs|rp2-cs|rp3-cs>`: three current-fuzzy tanh models
//! - `thesis/fuzzy-tanh/<set>/<level>a`: one of their 21 functions alone, e.g. `thesis/fuzzy-tanh/rp3-cs/1.2a`
//! - `thesis/anfis/<experiment>`: eight ANFIS models of 27 rules
//!
//! All were identified at 512 Hz on displacement that had passed two poles at 20 Hz, velocity being the
//! backward difference. They describe one damper (an ACDelco MagneRide unit, 0 to 2.5 A, up to about
//! 1.4 kN): for any other, identify a model.

mod anfis_rows;
mod arx_rows;
mod fuzzy_rows;

pub use fuzzy_rows::{CENTRES_A, SIGMA_A};

use crate::condition::Conditioning;
use crate::error::Error;
use crate::force::{ForceModel, FuzzyTanh, Membership};
use crate::model::{Envelope, Expected, Model};
use crate::sample::DriveKind;

/// The thesis' experiments, in the order of its tables, in lower case as preset names have them.
pub const EXPERIMENTS: [&str; 8] =
    ["rp-icps", "rp-aprbs", "rp-prbs", "rp-aprbs-l", "rp-icps-l", "rp1-cs", "rp2-cs", "rp3-cs"];

/// Widths of the recorded displacement, m, in the order of [`EXPERIMENTS`] (table 3.2).
const SPANS_M: [f64; 8] =
    [0.026_416, 0.027_432, 0.029_718, 0.027_432, 0.025_908, 0.033_528, 0.033_274, 0.036_068];

/// The ARX model that predicts best over all the thesis' experiments (section 5.1).
pub const BEST_ARX: &str = "thesis/arx-semi-active/rp-icps-l";
/// The fuzzy-tanh model that predicts best over all the thesis' experiments (section 5.1).
pub const BEST_FUZZY_TANH: &str = "thesis/fuzzy-tanh/rp3-cs";

/// The ANFIS model that predicts best over all the thesis' experiments (section 5.1).
pub const BEST_ANFIS: &str = "thesis/anfis/rp1-cs";

/// Names of all presets.
#[must_use]
pub fn names() -> Vec<String> {
    let mut names = Vec::with_capacity(40);
    for form in ["arx-passive", "arx-semi-active", "anfis"] {
        names.extend(EXPERIMENTS.iter().map(|experiment| format!("thesis/{form}/{experiment}")));
    }
    for set in &EXPERIMENTS[5..] {
        names.push(format!("thesis/fuzzy-tanh/{set}"));
        names.extend(CENTRES_A.iter().map(|level| format!("thesis/fuzzy-tanh/{set}/{level:.1}a")));
    }
    names
}

/// The preset called `name`.
///
/// # Errors
/// [`Error::UnknownPreset`] with the nearest name.
pub fn load(name: &str) -> Result<Model, Error> {
    find(name).ok_or_else(|| Error::UnknownPreset {
        name: name.to_owned(),
        nearest: names()
            .into_iter()
            .min_by_key(|known| edit_distance(known, name))
            .unwrap_or_else(|| BEST_FUZZY_TANH.to_owned()),
    })
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
    let ((force, expected), envelope) = match (form, level) {
        ("arx-passive", None) => (arx(arx_rows::passive(row)?), span),
        ("arx-semi-active", None) => (arx(arx_rows::semi_active(row)?), span),
        ("fuzzy-tanh", level) => {
            let (model, rsse_n) = fuzzy_rows::model(row.checked_sub(5)?)?;
            let model = match level {
                None => model,
                Some(level) => {
                    let j = CENTRES_A.iter().position(|c| format!("{c:.1}a") == level)?;
                    single(&model, j)?
                }
            };
            (free_running(ForceModel::FuzzyTanh(model), rsse_n), span)
        }
        ("anfis", None) => {
            let (model, envelope, rsse_n) = anfis_rows::model(row)?;
            (free_running(ForceModel::Tsk(model), rsse_n), envelope)
        }
        _ => return None,
    };
    Some(Model {
        force,
        conditioning: Conditioning::THESIS,
        rate_hz: 512.0,
        envelope: Envelope { drive: force.drive().map(|_| [0.0, 2.5]), ..envelope },
        expected,
    })
}

fn arx((arx, rsse_n): (crate::force::Arx, f64)) -> (ForceModel, Expected) {
    (ForceModel::Arx(arx), Expected { free_run_rsse_n: None, one_step_rsse_n: Some(rsse_n) })
}

fn free_running(force: ForceModel, rsse_n: f64) -> (ForceModel, Expected) {
    (force, Expected { free_run_rsse_n: Some(rsse_n), one_step_rsse_n: None })
}

/// Function `j` of `model` alone, the same at any current.
fn single(model: &FuzzyTanh, j: usize) -> Option<FuzzyTanh> {
    let membership = Membership { drive: DriveKind::CoilCurrent, sigma: SIGMA_A };
    let (centres, functions) = (model.centres().get(j..=j)?, model.functions().get(j..=j)?);
    FuzzyTanh::new(membership, centres, functions, 0.0).ok()
}

/// Levenshtein distance, to suggest a name.
pub(crate) fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let substitute = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = substitute.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}
