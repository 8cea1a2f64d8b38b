//! Parameters of a fuzzy-tanh model in a model file.

use super::memberships::{self, Memberships};
use super::table_into;
use crate::error::{Error, ModelFileError};
use crate::force::{FuzzyTanh, TanhFunction};
use crate::sample::DriveKind;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Parameters {
    force_offset_n: f64,
    #[serde(flatten)]
    memberships: Memberships,
    yield_force_n: Vec<f64>,
    post_yield_damping_n_s_m: Vec<f64>,
    pre_yield_slope_s_m: Vec<f64>,
    coupling_per_s: Vec<f64>,
}

/// The known keys except the memberships' keys, to suggest the nearest one.
const KEYS: [&str; 5] =
    ["force_offset_n", "yield_force_n", "post_yield_damping_n_s_m", "pre_yield_slope_s_m", "coupling_per_s"];

impl Parameters {
    pub(super) fn of(model: &FuzzyTanh) -> Self {
        let column = |get: fn(&TanhFunction) -> f64| model.functions().iter().map(get).collect();
        Self {
            force_offset_n: model.force_offset_n(),
            memberships: Memberships::of(model.sets()),
            yield_force_n: column(|t| t.yield_force_n),
            post_yield_damping_n_s_m: column(|t| t.post_yield_damping_n_s_m),
            pre_yield_slope_s_m: column(|t| t.pre_yield_slope_s_m),
            coupling_per_s: column(|t| t.coupling_per_s),
        }
    }
}

pub(super) fn read(drive: Option<DriveKind>, table: &toml::Table) -> Result<FuzzyTanh, Error> {
    let keys = [&memberships::KEYS[..], &KEYS].concat();
    let p: Parameters = table_into("parameters", table.clone(), &keys)?;
    let drive = drive.ok_or(ModelFileError::MissingDrive { model: "fuzzy-tanh" })?;
    let sets = p.memberships.read(drive)?;
    let n = sets.len();
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
                expected: format!("{n} (one for each membership centre)"),
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
    FuzzyTanh::new(sets, &functions, p.force_offset_n)
}
