//! Correlations of the residual with quantities that might explain it. A correlation does not prove a cause.
//!
//! Velocity, acceleration and the slope of the current come from least-squares parabolas over a centred sliding window.
//! The window needs later samples, so this works on finished runs only, not in the live path.

use super::recording::Recording;
use mr_damper_model::sample::{Channel, Stamp, Trace};
use mr_damper_model::statistics::correlation::pearson;
use mr_damper_model::statistics::parabola::parabola;

/// Half the width of the sliding window, in samples (8 samples are 15.6 ms at 512 Hz).
const HALF: usize = 8;

/// One residual with the motion at the same time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResidualPoint {
    /// Displacement, m.
    pub displacement_m: f64,
    /// Velocity, m/s.
    pub velocity_m_s: f64,
    /// Acceleration, m/s².
    pub acceleration_m_s2: f64,
    /// The drive, in its unit (A or V).
    pub drive: f64,
    /// Slope of the drive, A/s or V/s.
    pub drive_slope: f64,
    /// Measured force, N.
    pub measured_n: f64,
    /// Simulated force (free run), N.
    pub predicted_n: f64,
    /// Measured minus simulated force, N.
    pub residual_n: f64,
}

/// Every residual of a recording with the motion at the same time, without those near the ends of the recording.
#[must_use]
pub fn residual_points(recording: &Recording) -> Vec<ResidualPoint> {
    let motion = recording.input(Channel::Displacement);
    let drive = recording.input(Channel::Drive);
    let at = |trace: &Trace, stamp: Stamp| trace.stamps.binary_search(&stamp).ok();
    recording
        .residuals
        .iter()
        .filter_map(|residual| {
            let [displacement_m, velocity_m_s, acceleration_m_s2] =
                parabola(motion, at(motion, residual.stamp)?, HALF)?;
            let held = drive.stamps.partition_point(|stamp| *stamp <= residual.stamp).checked_sub(1)?;
            let [drive, drive_slope, _] = parabola(drive, held, HALF)?;
            Some(ResidualPoint {
                displacement_m,
                velocity_m_s,
                acceleration_m_s2,
                drive,
                drive_slope,
                measured_n: residual.measured.get(),
                predicted_n: residual.predicted.get(),
                residual_n: residual.residual.get(),
            })
        })
        .collect()
}

/// Correlation of the residual with displacement, velocity, speed, acceleration, current and its slope, by name.
#[must_use]
pub fn correlations(points: &[ResidualPoint]) -> Vec<(String, f64)> {
    type Pick = fn(&ResidualPoint) -> f64;
    let suspects: [(&str, Pick); 6] = [
        ("displacement x", |p| p.displacement_m),
        ("velocity v", |p| p.velocity_m_s),
        ("speed |v|", |p| p.velocity_m_s.abs()),
        ("acceleration a", |p| p.acceleration_m_s2),
        ("current i", |p| p.drive),
        ("slope of the current di/dt", |p| p.drive_slope),
    ];
    let with = |pick: Pick| {
        let pairs: Vec<(f64, f64)> = points.iter().map(|point| (pick(point), point.residual_n)).collect();
        pearson(&pairs)
    };
    suspects.iter().map(|(name, pick)| ((*name).to_owned(), with(*pick))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_residual_made_of_speed_correlates_with_speed_only() {
        let points: Vec<ResidualPoint> = (0..1000)
            .map(|k| {
                let t = f64::from(k) * 0.01;
                ResidualPoint {
                    displacement_m: t.sin(),
                    velocity_m_s: t.cos(),
                    acceleration_m_s2: -t.sin(),
                    drive: 1.0,
                    drive_slope: 0.0,
                    measured_n: 0.0,
                    predicted_n: 0.0,
                    residual_n: 5.0 * t.cos().abs() + 1.0,
                }
            })
            .collect();
        let found = correlations(&points);
        let of = |name: &str| found.iter().find(|(n, _)| n.starts_with(name)).map_or(f64::NAN, |(_, r)| *r);
        assert!((of("speed") - 1.0).abs() < 1e-12);
        assert!(of("velocity").abs() < 0.2 && of("displacement").abs() < 0.2);
        assert_eq!(of("current"), 0.0);
    }
}
