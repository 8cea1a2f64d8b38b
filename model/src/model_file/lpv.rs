//! Parameters of an LPV model in a model file. Each regressor has a list with one coefficient for each power
//! of the drive (in its unit over that power of the drive's unit), or for each fuzzy set.

use super::law::dependence;
use super::memberships::{self, Memberships};
use super::table_into;
use crate::error::Error;
use crate::force::{Dependence, LAGS, LPV_REGRESSORS, Lpv};
use crate::sample::DriveKind;
use crate::units::Second;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Parameters {
    sample_period_s: f64,
    force_offset_n: f64,
    /// `polynomial` or `fuzzy`.
    dependence: String,
    #[serde(flatten)]
    memberships: Memberships,
    /// Coefficients of F_{k-1}, F_{k-2}, F_{k-3}.
    force_lags: [Vec<f64>; LAGS],
    /// Coefficients of x_k, x_{k-1}, x_{k-2}.
    displacement_lags_n_m: [Vec<f64>; LAGS],
    /// Coefficients of v_k, v_{k-1}, v_{k-2}.
    velocity_lags_n_s_m: [Vec<f64>; LAGS],
}

/// The known keys except the memberships' keys, to suggest the nearest one.
const KEYS: [&str; 6] = [
    "sample_period_s",
    "force_offset_n",
    "dependence",
    "force_lags",
    "displacement_lags_n_m",
    "velocity_lags_n_s_m",
];

impl Parameters {
    pub(super) fn of(model: &Lpv) -> Self {
        let copies = || model.coefficients().chunks_exact(LPV_REGRESSORS);
        let lists = |signal: usize| {
            std::array::from_fn(|lag| copies().map(|copy| copy[signal * LAGS + lag]).collect::<Vec<f64>>())
        };
        Self {
            sample_period_s: model.sample_period().get(),
            force_offset_n: model.force_offset_n(),
            dependence: model.dependence().name().to_owned(),
            memberships: match model.dependence() {
                Dependence::Fuzzy(sets) => Memberships::of(sets),
                _ => Memberships::default(),
            },
            force_lags: lists(0),
            displacement_lags_n_m: lists(1),
            velocity_lags_n_s_m: lists(2),
        }
    }
}

pub(super) fn read(drive: Option<DriveKind>, table: &toml::Table) -> Result<Lpv, Error> {
    let keys = [&memberships::KEYS[..], &KEYS].concat();
    let p: Parameters = table_into("parameters", table.clone(), &keys)?;
    let dependence = dependence(&p.dependence, drive, p.force_lags[0].len(), &p.memberships)?;
    let copies = dependence.copies();
    let signals = [
        ("force_lags", &p.force_lags),
        ("displacement_lags_n_m", &p.displacement_lags_n_m),
        ("velocity_lags_n_s_m", &p.velocity_lags_n_s_m),
    ];
    let mut coefficients = vec![0.0; copies * LPV_REGRESSORS];
    for (signal, (name, lists)) in signals.into_iter().enumerate() {
        for (lag, list) in lists.iter().enumerate() {
            if list.len() != copies {
                return Err(Error::Length {
                    name: format!("parameters.{name}[{lag}]"),
                    found: list.len(),
                    expected: format!(
                        "{copies} (one for each power of the drive, or each membership centre)"
                    ),
                });
            }
            for (copy, value) in list.iter().enumerate() {
                coefficients[copy * LPV_REGRESSORS + signal * LAGS + lag] = *value;
            }
        }
    }
    Lpv::new(dependence, &coefficients, Second(p.sample_period_s), p.force_offset_n)
}
