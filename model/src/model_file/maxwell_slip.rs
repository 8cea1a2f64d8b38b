//! Parameters of a Maxwell-slip model in a model file. Knots and lengths are shared by all sets; every other list has one entry for each
//! set, or one entry if the model has no drive.

use super::memberships::{self, Memberships};
use super::{drive_error, table_into};
use crate::error::Error;
use crate::force::{
    FuzzySets, MaxwellSlip, SLIP_BRISTLES, SLIP_KNOTS, SLIP_SEGMENTS, SlipFunction, SlipGrid,
};
use crate::sample::DriveKind;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Parameters {
    force_offset_n: f64,
    #[serde(flatten)]
    memberships: Memberships,
    /// Positive knots of the damping curve.
    knot_speeds_m_s: [f64; SLIP_KNOTS],
    bristle_lengths_m: [f64; SLIP_BRISTLES],
    /// From the fastest compression to the fastest extension.
    damping_slopes_n_s_m: Vec<[f64; SLIP_SEGMENTS]>,
    /// In the order of the lengths.
    bristle_forces_n: Vec<[f64; SLIP_BRISTLES]>,
    stiffness_n_m: Vec<f64>,
    set_offset_n: Vec<f64>,
}

/// The known keys except the memberships' keys, to suggest the nearest one.
const KEYS: [&str; 7] = [
    "force_offset_n",
    "knot_speeds_m_s",
    "bristle_lengths_m",
    "damping_slopes_n_s_m",
    "bristle_forces_n",
    "stiffness_n_m",
    "set_offset_n",
];

impl Parameters {
    pub(super) fn of(model: &MaxwellSlip) -> Self {
        let functions = model.functions();
        Self {
            force_offset_n: model.force_offset_n(),
            memberships: model.sets().map_or_else(Memberships::default, Memberships::of),
            knot_speeds_m_s: *model.grid().knot_speeds_m_s(),
            bristle_lengths_m: *model.grid().bristle_lengths_m(),
            damping_slopes_n_s_m: functions.iter().map(|f| f.damping_slopes_n_s_m).collect(),
            bristle_forces_n: functions.iter().map(|f| f.bristle_forces_n).collect(),
            stiffness_n_m: functions.iter().map(|f| f.stiffness_n_m).collect(),
            set_offset_n: functions.iter().map(|f| f.set_offset_n).collect(),
        }
    }

    /// The sets over `drive`; `None` without one.
    fn sets(&self, drive: Option<DriveKind>) -> Result<Option<FuzzySets>, Error> {
        match drive {
            Some(drive) => self.memberships.read(drive).map(Some),
            None if self.memberships == Memberships::default() => Ok(None),
            None => Err(drive_error(drive, "no membership centres and no membership sigma")),
        }
    }
}

pub(super) fn read(drive: Option<DriveKind>, table: &toml::Table) -> Result<MaxwellSlip, Error> {
    let keys = [&memberships::KEYS[..], &KEYS].concat();
    let p: Parameters = table_into("parameters", table.clone(), &keys)?;
    let sets = p.sets(drive)?;
    let n = sets.map_or(1, |sets| sets.len());
    for (name, found) in [
        ("damping_slopes_n_s_m", p.damping_slopes_n_s_m.len()),
        ("bristle_forces_n", p.bristle_forces_n.len()),
        ("stiffness_n_m", p.stiffness_n_m.len()),
        ("set_offset_n", p.set_offset_n.len()),
    ] {
        if found != n {
            return Err(Error::Length {
                name: format!("parameters.{name}"),
                found,
                expected: format!("{n} (one for each membership centre, or one without a drive)"),
            });
        }
    }
    let functions: Vec<SlipFunction> = (0..n)
        .map(|j| SlipFunction {
            damping_slopes_n_s_m: p.damping_slopes_n_s_m[j],
            bristle_forces_n: p.bristle_forces_n[j],
            stiffness_n_m: p.stiffness_n_m[j],
            set_offset_n: p.set_offset_n[j],
        })
        .collect();
    MaxwellSlip::new(
        SlipGrid::new(p.knot_speeds_m_s, p.bristle_lengths_m)?,
        sets,
        &functions,
        p.force_offset_n,
    )
}
