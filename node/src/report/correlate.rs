//! Correlations of the residual with quantities that might explain it. A correlation does not prove a cause.
//!
//! Velocity, acceleration and the slope of the current come from least-squares parabolas over a centred sliding window.
//! The window needs later samples, so this works on finished runs only, not in the live path.

use super::recording::Recording;
use mr_damper_model::sample::{Channel, Stamp, Trace};

/// Half the width of the sliding window, in samples (8 samples are 15.6 ms at 512 Hz).
const HALF: usize = 8;

/// One residual with the motion at the same time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOver {
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
pub fn left_over(recording: &Recording) -> Vec<LeftOver> {
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
            Some(LeftOver {
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

/// Value, first and second derivative at sample `index`, from a least-squares parabola over evenly spaced samples.
/// The window reaches `half` samples to either side. `None` near an end or a gap.
pub(super) fn parabola(trace: &Trace, index: usize, half: usize) -> Option<[f64; 3]> {
    let (from, to) = (index.checked_sub(half)?, index + half);
    let span_s = trace.stamps.get(to)?.since(trace.stamps[from]).get();
    let step_s = span_s / (2 * half) as f64;
    let near_s = trace.stamps[index].since(trace.stamps[from]).get();
    if step_s <= 0.0 || (near_s - 0.5 * span_s).abs() > step_s {
        return None;
    }
    let (mut s0, mut s2, mut s4) = (0.0, 0.0, 0.0);
    let (mut sy, mut sky, mut skky) = (0.0, 0.0, 0.0);
    for (offset, value) in trace.values[from..=to].iter().enumerate() {
        let k = offset as f64 - half as f64;
        s0 += 1.0;
        s2 += k * k;
        s4 += k.powi(4);
        sy += value;
        sky += k * value;
        skky += k * k * value;
    }
    let curve = (s0 * skky - s2 * sy) / (s0 * s4 - s2 * s2);
    let middle = (sy - curve * s2) / s0;
    Some([middle, sky / s2 / step_s, 2.0 * curve / (step_s * step_s)])
}

/// Correlation of the residual with displacement, velocity, speed, acceleration, current and its slope, by name.
#[must_use]
pub fn correlations(points: &[LeftOver]) -> Vec<(String, f64)> {
    type Pick = fn(&LeftOver) -> f64;
    let suspects: [(&str, Pick); 6] = [
        ("displacement x", |p| p.displacement_m),
        ("velocity v", |p| p.velocity_m_s),
        ("speed |v|", |p| p.velocity_m_s.abs()),
        ("acceleration a", |p| p.acceleration_m_s2),
        ("current i", |p| p.drive),
        ("slope of the current di/dt", |p| p.drive_slope),
    ];
    suspects.iter().map(|(name, pick)| ((*name).to_owned(), correlation(points, *pick))).collect()
}

/// Pearson's correlation coefficient of the residual and `pick`; zero when one of them is constant.
fn correlation(points: &[LeftOver], pick: fn(&LeftOver) -> f64) -> f64 {
    let count = points.len().max(1) as f64;
    let mean = |value: &dyn Fn(&LeftOver) -> f64| points.iter().map(value).sum::<f64>() / count;
    let (x_mean, y_mean) = (mean(&pick), mean(&|p| p.residual_n));
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for point in points {
        let (x, y) = (pick(point) - x_mean, point.residual_n - y_mean);
        xx += x * x;
        yy += y * y;
        xy += x * y;
    }
    let scale = (xx * yy).sqrt();
    if scale > 0.0 { xy / scale } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_recovered_exactly() {
        let trace = Trace {
            stamps: (0..40).map(|k| Stamp::from_nanos(k * 2_000_000)).collect(),
            values: (0..40)
                .map(|k| {
                    let t = f64::from(k) * 2e-3;
                    1.0 + 2.0 * t + 3.0 * t * t
                })
                .collect(),
        };
        let [value, slope, curve] = parabola(&trace, 20, HALF).expect("inside");
        assert!((value - 1.0848).abs() < 1e-9 && (slope - 2.24).abs() < 1e-9 && (curve - 6.0).abs() < 1e-6);
        assert_eq!(parabola(&trace, 3, HALF), None);
        assert_eq!(parabola(&trace, 36, HALF), None);
    }

    #[test]
    fn a_residual_made_of_speed_correlates_with_speed_only() {
        let points: Vec<LeftOver> = (0..1000)
            .map(|k| {
                let t = f64::from(k) * 0.01;
                LeftOver {
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
