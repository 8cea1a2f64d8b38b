//! Experiments of the thesis (Table 3.2), by name: what the actuator and the current do, and how long.

use super::current::Current;
use super::signal::{Displacement, RATE_HZ, Road};

/// A planned run.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiment {
    /// Name, as in Table 3.2 where it is one of those.
    pub name: String,
    /// What the actuator does.
    pub displacement: Displacement,
    /// What the current does.
    pub current: Current,
    /// Duration in seconds.
    pub duration_s: f64,
    /// Seed of the excitation, when it shall not be the run's own: runs with one pattern and seeds of their
    /// own are replicates, equal but for the noise of their sensors.
    pub pattern: Option<u64>,
}

/// One row of Table 3.2: name, current, duration (s), maximum frequency (Hz), span (m).
type Row = (&'static str, fn() -> Current, f64, f64, f64);

const TABLE: [Row; 8] = [
    ("RP-ICPS", || Current::ICPS, 30.0, 5.5, 0.026_416),
    ("RP-APRBS", || Current::APRBS, 30.0, 4.5, 0.027_432),
    ("RP-PRBS", || Current::PRBS, 30.0, 4.2, 0.029_718),
    ("RP-APRBS-L", || Current::APRBS, 600.0, 4.5, 0.027_432),
    ("RP-ICPS-L", || Current::ICPS, 600.0, 5.5, 0.025_908),
    ("RP1-CS", Current::stepped, 210.0, 5.5, 0.033_528),
    ("RP2-CS", Current::stepped, 210.0, 4.5, 0.033_274),
    ("RP3-CS", Current::stepped, 210.0, 4.5, 0.036_068),
];

impl Experiment {
    /// Names that [`Experiment::thesis`] knows, in the order of Table 3.2.
    pub fn names() -> impl Iterator<Item = &'static str> {
        TABLE.iter().map(|row| row.0)
    }

    /// The thesis' experiment called `name`; `None` when there is no such experiment.
    #[must_use]
    pub fn thesis(name: &str) -> Option<Self> {
        let &(name, current, duration_s, band_hz, span_m) = TABLE.iter().find(|row| row.0 == name)?;
        let road = Road { level_hz: LEVEL_HZ, band_hz, span_m: Some(span_m), ..Road::SMOOTH_HIGHWAY };
        Some(Self {
            name: name.to_owned(),
            displacement: Displacement::Road(road),
            current: current(),
            duration_s,
            pattern: None,
        })
    }

    /// A sine with a constant current: what maps of force over velocity are made from.
    #[must_use]
    pub fn sine(amplitude_m: f64, frequency_hz: f64, current_a: f64, duration_s: f64) -> Self {
        Self {
            name: format!("sine {frequency_hz} Hz {current_a} A"),
            displacement: Displacement::Sine { amplitude_m, frequency_hz },
            current: Current::Constant { current_a },
            duration_s,
            pattern: None,
        }
    }

    /// This experiment with another duration in seconds. Steps of a stepped current share it equally.
    #[must_use]
    pub fn with_duration_s(self, duration_s: f64) -> Self {
        Self { duration_s, ..self }
    }

    /// This experiment with its excitation fixed by a seed of its own; see [`Experiment::pattern`].
    #[must_use]
    pub fn with_pattern(self, pattern: u64) -> Self {
        Self { pattern: Some(pattern), ..self }
    }

    /// Number of samples; none for a duration that is not a positive number.
    #[must_use]
    pub fn samples(&self) -> usize {
        // The cast takes anything negative or not a number to zero.
        (self.duration_s * RATE_HZ).round() as usize
    }
}

/// Frequency in hertz below which the thesis' roads are taken as level; see [`super::signal`].
const LEVEL_HZ: f64 = 2.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_an_experiment() {
        assert_eq!(Experiment::names().count(), 8);
        for name in Experiment::names() {
            assert_eq!(Experiment::thesis(name).map(|e| e.name).as_deref(), Some(name));
        }
        assert_eq!(Experiment::thesis("RP-XYZ"), None);
    }

    #[test]
    fn durations_can_be_overridden() {
        let samples = |duration| Experiment::thesis("RP3-CS").map(|e| e.with_duration_s(duration).samples());
        assert_eq!(samples(7.0), Some(7 * 512));
        assert_eq!(samples(-1.0), Some(0));
        assert_eq!(samples(f64::NAN), Some(0));
    }
}
