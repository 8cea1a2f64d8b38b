//! Limits of the test bench that a designed run keeps.

use crate::error::Error;

/// Shortest and longest run, s.
const DURATION_S: [f64; 2] = [2.0, 600.0];
/// Lowest and highest rate, Hz.
const RATE_HZ: [f64; 2] = [50.0, 2000.0];

/// Limits of a designed run. The run keeps them at each sample, and the differences of its samples keep the limits of speed and
/// acceleration.
///
/// ```
/// use mr_damper_model::diagnose::design::Limits;
///
/// let limits = Limits { stroke_m: 0.02, drive: Some([0.0, 2.0]), ..Limits::default() };
/// limits.check()?;
/// let error = Limits { speed_m_s: 0.0, ..limits }.check().unwrap_err().to_string();
/// assert!(error.contains("speed_m_s is 0"), "{error}");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest displacement to either side of the middle, m.
    pub stroke_m: f64,
    /// Largest speed, m/s.
    pub speed_m_s: f64,
    /// Largest acceleration, m/s².
    pub acceleration_m_s2: f64,
    /// Smallest and largest drive, A or V; `None` for a model without a drive.
    pub drive: Option<[f64; 2]>,
    /// Duration, s.
    pub duration_s: f64,
    /// Rate of the samples, Hz.
    pub rate_hz: f64,
}

impl Default for Limits {
    /// A small test bench: 20 mm to either side, 0.4 m/s, 10 m/s², 30 s at 512 Hz, without a drive.
    fn default() -> Self {
        Self {
            stroke_m: 0.02,
            speed_m_s: 0.4,
            acceleration_m_s2: 10.0,
            drive: None,
            duration_s: 30.0,
            rate_hz: 512.0,
        }
    }
}

impl Limits {
    /// Checks each limit by itself.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the limit.
    pub fn check(&self) -> Result<(), Error> {
        let within = |[low, high]: [f64; 2]| move |value: f64| (low..=high).contains(&value);
        Error::check("stroke_m", self.stroke_m, "1e-6 to 10 m", within([1e-6, 10.0]))?;
        Error::check("speed_m_s", self.speed_m_s, "1e-6 to 100 m/s", within([1e-6, 100.0]))?;
        Error::check("acceleration_m_s2", self.acceleration_m_s2, "1e-6 to 1e5 m/s²", within([1e-6, 1e5]))?;
        Error::check("duration_s", self.duration_s, "2 to 600 s", within(DURATION_S))?;
        Error::check("rate_hz", self.rate_hz, "50 to 2000 Hz", within(RATE_HZ))?;
        if let Some([low, high]) = self.drive {
            Error::check("the smallest drive", low, "finite", |_| true)?;
            Error::check("the largest drive", high, "larger than the smallest drive", |high| high > low)?;
        }
        Ok(())
    }

    /// Number of samples.
    pub(super) fn samples(&self) -> usize {
        (self.duration_s * self.rate_hz).round() as usize
    }

    /// The drive at `share` of its range; NaN without a drive.
    pub(super) fn drive_at(&self, share: f64) -> f64 {
        self.drive.map_or(f64::NAN, |[low, high]| (low + share * (high - low)).clamp(low, high))
    }
}
