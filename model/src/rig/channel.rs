//! The measurement chain: what the logger writes for what the rig does.
//!
//! ```text
//! reading = q round((filtered value + offset + drift t + sigma n) / q),        n normal with deviation 1
//! ```
//!
//! sigma is a channel's noise, q its step of quantisation; both may be zero. Displacement, current and force
//! may each have an anti-alias filter (second-order Butterworth); by default none has, as the thesis' force
//! channel has none. Noise is that of what is logged: white, behind the filter. The figures of [`Channels::default`] are of the
//! order of a servo-hydraulic bench's LVDT, load cell, 1 ohm shunt and type J thermocouple read with 16 bit.

use super::noise::normal;
use super::second_order::SecondOrder;
use super::signal::RATE_HZ;
use crate::Error;
use rand::Rng;
use std::f64::consts::TAU;

/// Frequency of the mains, in hertz.
const MAINS_HZ: f64 = 50.0;

/// Noise, quantisation and filter of each channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Channels {
    /// Noise of displacement, in metres (standard deviation).
    pub displacement_noise_m: f64,
    /// Quantisation of displacement, in metres.
    pub displacement_step_m: f64,
    /// Noise of a velocity transducer beside the displacement's, in m/s; `None` when there is no such channel. It has
    /// neither steps nor a filter.
    pub velocity_noise_m_s: Option<f64>,
    /// Noise of the driver's measured current, in amperes.
    pub current_noise_a: f64,
    /// Quantisation of current, in amperes.
    pub current_step_a: f64,
    /// Noise of force, in newtons.
    pub force_noise_n: f64,
    /// Quantisation of force, in newtons.
    pub force_step_n: f64,
    /// Offset of the load cell, in newtons.
    pub force_offset_n: f64,
    /// Drift of the load cell, in newtons a second.
    pub force_drift_n_s: f64,
    /// Amplitude of the mains' hum (50 Hz) in the force channel, in newtons.
    pub force_hum_n: f64,
    /// Time by which the force channel is late against the others, in seconds; negative for early.
    pub force_delay_s: f64,
    /// Anti-alias filter of displacement.
    pub displacement_filter: Option<SecondOrder>,
    /// Anti-alias filter of current.
    pub current_filter: Option<SecondOrder>,
    /// Anti-alias filter of force.
    pub force_filter: Option<SecondOrder>,
    /// Noise of the case thermocouple, in kelvin.
    pub case_noise_k: f64,
    /// Quantisation of the case temperature, in kelvin.
    pub case_step_k: f64,
    /// True when a second thermocouple, equal to the case's, logs the room (`ambient_temp_c`).
    pub ambient: bool,
}

impl Channels {
    /// A chain without noise, quantisation and offset.
    pub const PERFECT: Self = Self {
        displacement_noise_m: 0.0,
        displacement_step_m: 0.0,
        velocity_noise_m_s: None,
        current_noise_a: 0.0,
        current_step_a: 0.0,
        force_noise_n: 0.0,
        force_step_n: 0.0,
        force_offset_n: 0.0,
        case_noise_k: 0.0,
        case_step_k: 0.0,
        force_drift_n_s: 0.0,
        force_hum_n: 0.0,
        force_delay_s: 0.0,
        displacement_filter: None,
        current_filter: None,
        force_filter: None,
        ambient: false,
    };

    /// These channels with the room's thermocouple logged too, as the thesis' logger does.
    #[must_use]
    pub fn with_ambient(self) -> Self {
        Self { ambient: true, ..self }
    }

    /// These channels with a velocity transducer of so much noise, in m/s.
    #[must_use]
    pub fn with_velocity(self, noise_m_s: f64) -> Self {
        Self { velocity_noise_m_s: Some(noise_m_s), ..self }
    }

    /// These channels with a displacement transducer of a tenth of the noise and steps: for what is to be told to the noise of
    /// the force from displacement alone.
    #[must_use]
    pub fn with_fine_displacement(self) -> Self {
        Self { displacement_noise_m: 3e-7, displacement_step_m: 1e-7, ..self }
    }

    /// Checks that every field is a number and noises, steps and filters are possible.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the first field that is not.
    pub fn check(&self) -> Result<(), Error> {
        for (name, value) in [
            ("displacement_noise_m", self.displacement_noise_m),
            ("displacement_step_m", self.displacement_step_m),
            ("velocity_noise_m_s", self.velocity_noise_m_s.unwrap_or(0.0)),
            ("current_noise_a", self.current_noise_a),
            ("current_step_a", self.current_step_a),
            ("force_noise_n", self.force_noise_n),
            ("force_step_n", self.force_step_n),
            ("force_hum_n", self.force_hum_n),
            ("case_noise_k", self.case_noise_k),
            ("case_step_k", self.case_step_k),
        ] {
            Error::check(name, value, "0 or above", |x| x >= 0.0)?;
        }
        Error::check("force_offset_n", self.force_offset_n, "a finite number", |_| true)?;
        Error::check("force_drift_n_s", self.force_drift_n_s, "a finite number", |_| true)?;
        Error::check("force_delay_s", self.force_delay_s, "between -1 and 1 s", |d| d.abs() <= 1.0)?;
        let filters = [self.displacement_filter, self.current_filter, self.force_filter];
        filters.iter().flatten().try_for_each(SecondOrder::check)
    }
}

/// `values`, one a sample, `delay_s` seconds late: straight lines between samples, ends held.
pub(super) fn delayed(values: &[f64], delay_s: f64) -> Vec<f64> {
    let last = values.len().saturating_sub(1);
    (0..values.len())
        .map(|k| {
            let at = (k as f64 - delay_s * RATE_HZ).clamp(0.0, last as f64);
            let (before, share) = (at as usize, at.fract());
            values[before] + share * (values[(before + 1).min(last)] - values[before])
        })
        .collect()
}

/// `values` as the filter, if there is one, lets them through.
pub(super) fn filtered(values: Vec<f64>, filter: Option<SecondOrder>) -> Vec<f64> {
    match filter {
        Some(filter) => filter.filter(&values),
        None => values,
    }
}

impl Channels {
    /// Rod force as it comes to the converter: late, filtered, with the load cell's drift and the mains' hum.
    pub(super) fn force_signal(&self, force_n: Vec<f64>) -> Vec<f64> {
        let late = if self.force_delay_s == 0.0 { force_n } else { delayed(&force_n, self.force_delay_s) };
        let mut signal = filtered(late, self.force_filter);
        if self.force_drift_n_s != 0.0 {
            let drift = self.force_drift_n_s / RATE_HZ;
            signal.iter_mut().enumerate().for_each(|(k, force)| *force += drift * k as f64);
        }
        if self.force_hum_n != 0.0 {
            let turn = TAU * MAINS_HZ / RATE_HZ;
            signal
                .iter_mut()
                .enumerate()
                .for_each(|(k, force)| *force += self.force_hum_n * (turn * k as f64).sin());
        }
        signal
    }
}

impl Default for Channels {
    fn default() -> Self {
        Self {
            displacement_noise_m: 3e-6,
            displacement_step_m: 1e-6,
            current_noise_a: 2e-3,
            current_step_a: 1e-4,
            force_noise_n: 3.0,
            force_step_n: 0.5,
            case_noise_k: 0.1,
            case_step_k: 0.05,
            ..Self::PERFECT
        }
    }
}

/// One channel's error: noise (standard deviation), step of quantisation and offset, in the channel's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sensor {
    pub(super) noise: f64,
    pub(super) step: f64,
    pub(super) offset: f64,
}

impl Sensor {
    /// What this sensor reads for `value`.
    pub(super) fn read(self, value: f64, rng: &mut impl Rng) -> f64 {
        let noisy = value + self.offset + if self.noise > 0.0 { self.noise * normal(rng) } else { 0.0 };
        if self.step > 0.0 { (noisy / self.step).round() * self.step } else { noisy }
    }
}

#[cfg(test)]
mod tests {
    use super::super::noise::{Purpose, stream};
    use super::*;

    #[test]
    fn a_sensor_adds_its_noise_and_reads_in_whole_steps() {
        let sensor = Sensor { noise: 3.0, step: 0.5, offset: 10.0 };
        let mut rng = stream(1, Purpose::ForceNoise);
        let readings: Vec<f64> = (0..20_000).map(|_| sensor.read(100.0, &mut rng)).collect();
        assert!(readings.iter().all(|f| (f / 0.5).fract() == 0.0));
        let mean = readings.iter().sum::<f64>() / 2e4;
        let std = (readings.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / 2e4).sqrt();
        assert!((mean - 110.0).abs() < 0.1 && (std - 3.0).abs() < 0.06, "{mean} {std}");
    }

    #[test]
    fn force_is_late_or_early_by_its_delay_and_drifts() {
        let ramp: Vec<f64> = (0..512).map(f64::from).collect();
        let late = Channels { force_delay_s: 2.5 / RATE_HZ, ..Channels::PERFECT }.force_signal(ramp.clone());
        let early =
            Channels { force_delay_s: -3.0 / RATE_HZ, ..Channels::PERFECT }.force_signal(ramp.clone());
        assert_eq!((late[0], late[100], early[100], early[511]), (0.0, 97.5, 103.0, 511.0));
        let drifting = Channels { force_drift_n_s: 2.0, ..Channels::PERFECT }.force_signal(vec![1.0; 513]);
        assert_eq!((drifting[0], drifting[512]), (1.0, 3.0));
        assert_eq!(Channels::PERFECT.force_signal(ramp.clone()), ramp);
    }

    #[test]
    fn channels_that_cannot_be_are_refused_by_field() {
        assert_eq!(Channels::default().check(), Ok(()));
        let refused = |channels: Channels| channels.check().err().map(|e| e.to_string()).unwrap_or_default();
        assert!(refused(Channels { force_noise_n: -1.0, ..Channels::PERFECT }).starts_with("force_noise_n"));
        assert!(refused(Channels { force_delay_s: 2.0, ..Channels::PERFECT }).starts_with("force_delay_s"));
        let filter = Some(SecondOrder::butterworth(0.0));
        assert!(refused(Channels { force_filter: filter, ..Channels::PERFECT }).starts_with("corner_hz"));
    }

    #[test]
    fn a_perfect_sensor_reads_the_value() {
        let mut rng = stream(1, Purpose::ForceNoise);
        assert_eq!(Sensor { noise: 0.0, step: 0.0, offset: 0.0 }.read(1.234, &mut rng), 1.234);
    }
}
