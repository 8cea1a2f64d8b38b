//! The sweep of a model over the whole range of its runs, in the JSON of an identification and of a diagnosis.

use mr_damper_model::identify::{SweptFault, SweptRange, SweptSine};
use mr_damper_model::sample::Drive;
use serde::Serialize;

/// The model on sines over the whole range of its runs.
#[derive(Debug, Serialize)]
pub struct SweptReport {
    sines: Vec<SweptSineReport>,
    faults: Vec<SweptFaultReport>,
    /// The result as one sentence.
    #[serde(skip)]
    summary: String,
}

/// One sine. Force and energy are `null` if the simulation did not stay finite.
#[derive(Debug, Serialize)]
struct SweptSineReport {
    /// A or V; `null` for a model without drive.
    drive: Option<f64>,
    peak_speed_m_s: f64,
    runs_s: f64,
    largest_n: Option<f64>,
    energy_j: Option<f64>,
}

/// A fault.
#[derive(Debug, Serialize)]
pub struct SweptFaultReport {
    code: &'static str,
    drive: Option<f64>,
    peak_speed_m_s: f64,
    text: String,
}

impl SweptReport {
    /// The report of `swept`.
    #[must_use]
    pub fn of(swept: &SweptRange) -> Self {
        let sine = |sine: &SweptSine| SweptSineReport {
            drive: sine.drive.map(Drive::get),
            peak_speed_m_s: sine.speed.0,
            runs_s: sine.runs_s,
            largest_n: sine.response.map(|response| response.largest.0),
            energy_j: sine.response.map(|response| response.energy_j),
        };
        Self {
            sines: swept.sines.iter().map(sine).collect(),
            faults: swept.faults.iter().map(SweptFaultReport::of).collect(),
            summary: swept.to_string(),
        }
    }

    /// The result as one sentence without a full stop.
    #[must_use]
    pub fn summary(&self) -> &str {
        &self.summary
    }
}

impl SweptFaultReport {
    /// The report of `fault`.
    #[must_use]
    pub fn of(fault: &SweptFault) -> Self {
        Self {
            code: fault.kind.name(),
            drive: fault.sine.drive.map(Drive::get),
            peak_speed_m_s: fault.sine.speed.0,
            text: fault.to_string(),
        }
    }
}
