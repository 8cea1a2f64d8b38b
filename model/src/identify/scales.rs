//! Scales of the data, which set the bounds and starts of a fit.

use super::dataset::Dataset;
use crate::error::{Error, IdentifyError};
use crate::force::law::Scale;

/// Largest values in the runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scales {
    /// Half the range of the measured force, N.
    pub(crate) force_n: f64,
    /// Half the largest stroke, m.
    pub(crate) displacement_m: f64,
    /// Peak speed, m/s.
    pub(crate) velocity_m_s: f64,
    /// Acceleration at that speed and the highest frequency, m/s².
    pub(crate) acceleration_m_s2: f64,
    /// Largest ratio of speed to stroke in any run, an estimate of the highest circular frequency, 1/s.
    pub(crate) frequency_1_s: f64,
    /// Largest magnitude of the drive, A or V; 1 without a drive.
    pub(crate) drive: f64,
}

impl Scales {
    pub(crate) fn of(datasets: &[Dataset]) -> Result<Self, Error> {
        let mut scales = Self {
            force_n: 0.0,
            displacement_m: 0.0,
            velocity_m_s: 0.0,
            acceleration_m_s2: 0.0,
            frequency_1_s: 0.0,
            drive: 0.0,
        };
        for dataset in datasets {
            let e = &dataset.envelope;
            let (Some(x), Some(v), Some(f)) = (e.displacement_m, e.velocity_m_s, e.force_n) else { continue };
            let (speed, stroke) = (v[1].abs().max(v[0].abs()), 0.5 * (x[1] - x[0]));
            scales.force_n = scales.force_n.max(0.5 * (f[1] - f[0]));
            scales.displacement_m = scales.displacement_m.max(stroke);
            scales.velocity_m_s = scales.velocity_m_s.max(speed);
            if stroke > 0.0 {
                scales.frequency_1_s = scales.frequency_1_s.max(speed / stroke);
            }
            if let Some([low, high]) = e.drive {
                scales.drive = scales.drive.max(low.abs()).max(high.abs());
            }
        }
        scales.acceleration_m_s2 = scales.velocity_m_s * scales.frequency_1_s;
        if scales.drive <= 0.0 {
            scales.drive = 1.0;
        }
        if scales.force_n > 0.0 && scales.velocity_m_s > 0.0 && scales.frequency_1_s > 0.0 {
            return Ok(scales);
        }
        Err(IdentifyError::Constant { channel: "force or displacement" }.into())
    }

    /// The size of a parameter with this natural scale.
    pub(crate) fn size(&self, scale: Scale) -> f64 {
        self.force_n.powi(scale.force)
            * self.displacement_m.powi(scale.displacement)
            * self.velocity_m_s.powi(scale.velocity)
            * self.acceleration_m_s2.powi(scale.acceleration)
    }
}
