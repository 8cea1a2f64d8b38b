//! Parameters of a lazy learner in a model file.

use super::{drive_error, table_into};
use crate::error::Error;
use crate::force::{Lazy, LazyMetric, LazyPoint};
use crate::sample::DriveKind;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Parameters {
    force_offset_n: f64,
    /// Smallest and largest number of points in a local regression.
    neighbours: [usize; 2],
    displacement_scale_m: f64,
    velocity_scale_m_s: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    current_scale_a: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    voltage_scale_v: Option<f64>,
    /// Displacement of each point.
    points_displacement_m: Vec<f64>,
    points_velocity_m_s: Vec<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    points_current_a: Option<Vec<f64>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    points_voltage_v: Option<Vec<f64>>,
    /// Force of each point, without the offset.
    points_force_n: Vec<f64>,
}

/// The known keys, to suggest the nearest one.
const KEYS: [&str; 11] = [
    "force_offset_n",
    "neighbours",
    "displacement_scale_m",
    "velocity_scale_m_s",
    "current_scale_a",
    "voltage_scale_v",
    "points_displacement_m",
    "points_velocity_m_s",
    "points_current_a",
    "points_voltage_v",
    "points_force_n",
];

impl Parameters {
    pub(super) fn of(lazy: &Lazy) -> Self {
        let metric = lazy.metric();
        let column = |get: fn(LazyPoint) -> f64| -> Vec<f64> { lazy.points().map(get).collect() };
        let scale = |kind| metric.drive_scale.filter(|(k, _)| *k == kind).map(|(_, scale)| scale);
        let drive = |kind| scale(kind).map(|_| column(|p| p.drive));
        Self {
            force_offset_n: lazy.force_offset_n(),
            neighbours: lazy.neighbours(),
            displacement_scale_m: metric.displacement_scale_m,
            velocity_scale_m_s: metric.velocity_scale_m_s,
            current_scale_a: scale(DriveKind::CoilCurrent),
            voltage_scale_v: scale(DriveKind::CommandVoltage),
            points_displacement_m: column(|p| p.displacement_m),
            points_velocity_m_s: column(|p| p.velocity_m_s),
            points_current_a: drive(DriveKind::CoilCurrent),
            points_voltage_v: drive(DriveKind::CommandVoltage),
            points_force_n: column(|p| p.force_n),
        }
    }
}

pub(super) fn read(drive: Option<DriveKind>, table: &toml::Table) -> Result<Lazy, Error> {
    let p: Parameters = table_into("parameters", table.clone(), &KEYS)?;
    let current = p.current_scale_a.zip(p.points_current_a.as_ref());
    let voltage = p.voltage_scale_v.zip(p.points_voltage_v.as_ref());
    let (any_current, any_voltage) = (
        p.current_scale_a.is_some() || p.points_current_a.is_some(),
        p.voltage_scale_v.is_some() || p.points_voltage_v.is_some(),
    );
    let driven = match (drive, current, voltage) {
        (None, None, None) if !any_current && !any_voltage => None,
        (Some(kind @ DriveKind::CoilCurrent), Some(found), None) if !any_voltage => Some((kind, found)),
        (Some(kind @ DriveKind::CommandVoltage), None, Some(found)) if !any_current => Some((kind, found)),
        _ => {
            let needed = match drive {
                None => "neither scale nor points of current or voltage",
                Some(DriveKind::CoilCurrent) => "current_scale_a and points_current_a, but no voltage keys",
                Some(DriveKind::CommandVoltage) => {
                    "voltage_scale_v and points_voltage_v, but no current keys"
                }
            };
            return Err(drive_error(drive, needed));
        }
    };
    let count = p.points_displacement_m.len();
    for (name, found) in [
        ("points_velocity_m_s", p.points_velocity_m_s.len()),
        ("points_current_a or points_voltage_v", driven.map_or(count, |(_, (_, points))| points.len())),
        ("points_force_n", p.points_force_n.len()),
    ] {
        if found != count {
            return Err(Error::Length {
                name: format!("parameters.{name}"),
                found,
                expected: format!("{count} (one for each of points_displacement_m)"),
            });
        }
    }
    let point = |j: usize| LazyPoint {
        displacement_m: p.points_displacement_m[j],
        velocity_m_s: p.points_velocity_m_s[j],
        drive: driven.map_or(0.0, |(_, (_, points))| points[j]),
        force_n: p.points_force_n[j],
    };
    let metric = LazyMetric {
        displacement_scale_m: p.displacement_scale_m,
        velocity_scale_m_s: p.velocity_scale_m_s,
        drive_scale: driven.map(|(kind, (scale, _))| (kind, scale)),
    };
    Lazy::new(metric, p.neighbours, &(0..count).map(point).collect::<Vec<_>>(), p.force_offset_n)
}
