//! Parameters of an ARX model in a model file.

use super::{drive_error, table_into};
use crate::error::Error;
use crate::force::{Arx, LAGS};
use crate::sample::DriveKind;
use crate::units::Second;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Parameters {
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

/// The keys, for "did you mean".
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
        let lags = |kind| arx.drive_lags().filter(|(k, _)| *k == kind).map(|(_, lags)| lags);
        Self {
            sample_period_s: arx.sample_period().get(),
            force_offset_n: arx.force_offset_n(),
            coefficient_resolution: arx.resolution(),
            force_lags: arx.force_lags(),
            displacement_lags_n_m: arx.displacement_lags_n_m(),
            velocity_lags_n_s_m: arx.velocity_lags_n_s_m(),
            current_lags_n_a: lags(DriveKind::CoilCurrent),
            voltage_lags_n_v: lags(DriveKind::CommandVoltage),
        }
    }
}

pub(super) fn read(drive: Option<DriveKind>, table: &toml::Table) -> Result<Arx, Error> {
    let p: Parameters = table_into("parameters", table.clone(), &KEYS)?;
    let lags = match (drive, p.current_lags_n_a, p.voltage_lags_n_v) {
        (None, None, None) => None,
        (Some(kind @ DriveKind::CoilCurrent), Some(lags), None)
        | (Some(kind @ DriveKind::CommandVoltage), None, Some(lags)) => Some((kind, lags)),
        (drive, _, _) => {
            let wanted = match drive {
                None => "neither current_lags_n_a nor voltage_lags_n_v",
                Some(DriveKind::CoilCurrent) => "current_lags_n_a and not voltage_lags_n_v",
                Some(DriveKind::CommandVoltage) => "voltage_lags_n_v and not current_lags_n_a",
            };
            return Err(drive_error(drive, wanted));
        }
    };
    let resolution =
        Error::check("coefficient_resolution", p.coefficient_resolution, "zero or positive", |r| r >= 0.0)?;
    Arx::new(
        p.force_lags,
        p.displacement_lags_n_m,
        p.velocity_lags_n_s_m,
        lags,
        Second(p.sample_period_s),
        p.force_offset_n,
    )
    .map(|arx| arx.with_resolution(resolution))
}
