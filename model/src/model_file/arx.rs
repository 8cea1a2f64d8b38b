//! Parameters of an ARX model in a model file (`arx`, `arx-delayed` or `savaresi`): three or two coefficients per signal. Those
//! of displacement, velocity and drive belong to samples k, k-1, ... or, for `arx-delayed`, to k-1, k-2, ...

use super::{drive_error, table_into};
use crate::error::Error;
use crate::force::{Arx, ArxShape, LAGS};
use crate::sample::DriveKind;
use crate::units::Second;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Parameters {
    sample_period_s: f64,
    force_offset_n: f64,
    /// Half a unit of the last digit if the coefficients were copied from print; absent if they are exact.
    #[serde(default, skip_serializing_if = "is_zero")]
    coefficient_resolution: f64,
    /// Coefficients of F_{k-1}, F_{k-2}, ...
    force_lags: Vec<f64>,
    /// Coefficients of x_k, x_{k-1}, ... (from x_{k-1} on for `arx-delayed`).
    displacement_lags_n_m: Vec<f64>,
    /// Coefficients of v_k, v_{k-1}, ...
    velocity_lags_n_s_m: Vec<f64>,
    /// Coefficients of i_k, i_{k-1}, ... if the drive is a current.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    current_lags_n_a: Option<Vec<f64>>,
    /// Coefficients of the drive if it is a command voltage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    voltage_lags_n_v: Option<Vec<f64>>,
}

/// The known keys, to suggest the nearest one.
const KEYS: [&str; 8] = [
    "sample_period_s",
    "force_offset_n",
    "coefficient_resolution",
    "force_lags",
    "displacement_lags_n_m",
    "velocity_lags_n_s_m",
    "current_lags_n_a",
    "voltage_lags_n_v",
];

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde calls")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Parameters {
    pub(super) fn of(arx: &Arx) -> Self {
        let list = |lags: [f64; LAGS]| lags[..arx.lags()].to_vec();
        let drive = |kind| arx.drive_lags().filter(|(k, _)| *k == kind).map(|(_, lags)| list(lags));
        Self {
            sample_period_s: arx.sample_period().get(),
            force_offset_n: arx.force_offset_n(),
            coefficient_resolution: arx.resolution(),
            force_lags: list(arx.force_lags()),
            displacement_lags_n_m: list(arx.displacement_lags_n_m()),
            velocity_lags_n_s_m: list(arx.velocity_lags_n_s_m()),
            current_lags_n_a: drive(DriveKind::CoilCurrent),
            voltage_lags_n_v: drive(DriveKind::CommandVoltage),
        }
    }
}

pub(super) fn read(shape: ArxShape, drive: Option<DriveKind>, table: &toml::Table) -> Result<Arx, Error> {
    let p: Parameters = table_into("parameters", table.clone(), &KEYS)?;
    let driven = match (drive, p.current_lags_n_a, p.voltage_lags_n_v) {
        (None, None, None) => None,
        (Some(kind @ DriveKind::CoilCurrent), Some(lags), None)
        | (Some(kind @ DriveKind::CommandVoltage), None, Some(lags)) => Some((kind, lags)),
        (drive, _, _) => {
            let needed = match drive {
                None => "neither current_lags_n_a nor voltage_lags_n_v",
                Some(DriveKind::CoilCurrent) => "current_lags_n_a and not voltage_lags_n_v",
                Some(DriveKind::CommandVoltage) => "voltage_lags_n_v and not current_lags_n_a",
            };
            return Err(drive_error(drive, needed));
        }
    };
    let resolution =
        Error::check("coefficient_resolution", p.coefficient_resolution, "zero or positive", |r| r >= 0.0)?;
    let period = Second(p.sample_period_s);
    let lists = [&p.force_lags[..], &p.displacement_lags_n_m, &p.velocity_lags_n_s_m];
    let driven = driven.as_ref().map(|(kind, list)| (*kind, list.as_slice()));
    let arx = shape.model(lists, driven, period, p.force_offset_n)?;
    Ok(arx.with_resolution(resolution))
}
