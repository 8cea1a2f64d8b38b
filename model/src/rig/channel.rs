//! The measurement chain: from the true signals of the rig to logged values.
//!
//! ```text
//! reading = q round((filtered value + offset + drift t + sigma n) / q),        n normal with deviation 1
//! ```
//!
//! sigma is a channel's noise, q its quantisation step; both may be zero. Displacement, current and force may each have an anti-alias
//! filter (second-order Butterworth). By default they have none, like the thesis' force channel. The noise is white and added
//! after the filter. The values of [`Channels::default`] are typical of the LVDT, load cell, 1 ohm shunt and type J thermocouple of a
//! servo-hydraulic bench, read with 16 bit.

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
    /// Noise of an additional velocity transducer, in m/s; `None` without such a channel. It has no quantisation and no filter.
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
    /// Amplitude of mains hum (50 Hz) in the force channel, in newtons.
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
    /// True if a second thermocouple, with the same errors as the case's, logs the room temperature (`ambient_temp_c`).
    pub ambient: bool,
}

impl Channels {
    /// A measurement chain without any error.
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

    /// These channels with the room temperature logged too, as the thesis' logger does.
    #[must_use]
    pub fn with_ambient(self) -> Self {
        Self { ambient: true, ..self }
    }

    /// These channels with a velocity transducer whose noise is `noise_m_s`, in m/s.
    #[must_use]
    pub fn with_velocity(self, noise_m_s: f64) -> Self {
        Self { velocity_noise_m_s: Some(noise_m_s), ..self }
    }

    /// These channels with a tenth of the displacement noise and quantisation, for tests in which a model computed from displacement alone
    /// must reach the noise of the force.
    #[must_use]
    pub fn with_fine_displacement(self) -> Self {
        Self { displacement_noise_m: 3e-7, displacement_step_m: 1e-7, ..self }
    }

    /// Checks that every field is finite and within its range.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the first field that fails.
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

/// `values`, one per sample, delayed by `delay_s` seconds: linear between samples, constant beyond the ends.
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

/// `values` behind the filter, if there is one.
pub(super) fn filtered(values: Vec<f64>, filter: Option<SecondOrder>) -> Vec<f64> {
    match filter {
        Some(filter) => filter.filter(&values),
        None => values,
    }
}

impl Channels {
    /// Rod force at the converter: delayed and filtered, with load-cell drift and mains hum.
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

/// Error of one channel: noise (standard deviation), quantisation step and offset, in the channel's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sensor {
    pub(super) noise: f64,
    pub(super) step: f64,
    pub(super) offset: f64,
}

impl Sensor {
    /// Reading of this sensor for `value`.
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
    fn a_sensor_adds_noise_and_quantises() {
        let sensor = Sensor { noise: 3.0, step: 0.5, offset: 10.0 };
        let mut rng = stream(1, Purpose::ForceNoise);
        let readings: Vec<f64> = (0..20_000).map(|_| sensor.read(100.0, &mut rng)).collect();
        assert!(readings.iter().all(|f| (f / 0.5).fract() == 0.0));
        let mean = readings.iter().sum::<f64>() / 2e4;
        let std = (readings.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / 2e4).sqrt();
        assert!((mean - 110.0).abs() < 0.1 && (std - 3.0).abs() < 0.06, "{mean} {std}");
    }

    #[test]
    fn the_force_channel_has_delay_and_drift() {
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
    fn invalid_channels_are_rejected_with_the_field_name() {
        assert_eq!(Channels::default().check(), Ok(()));
        let refused = |channels: Channels| channels.check().err().map(|e| e.to_string()).unwrap_or_default();
        assert!(refused(Channels { force_noise_n: -1.0, ..Channels::PERFECT }).starts_with("force_noise_n"));
        assert!(refused(Channels { force_delay_s: 2.0, ..Channels::PERFECT }).starts_with("force_delay_s"));
        let filter = Some(SecondOrder::butterworth(0.0));
        assert!(refused(Channels { force_filter: filter, ..Channels::PERFECT }).starts_with("corner_hz"));
    }

    #[test]
    fn a_perfect_sensor_reads_the_true_value() {
        let mut rng = stream(1, Purpose::ForceNoise);
        assert_eq!(Sensor { noise: 0.0, step: 0.0, offset: 0.0 }.read(1.234, &mut rng), 1.234);
    }
}
