//! The measurement chain: what the logger writes for what the rig does.
//!
//! ```text
//! reading = q round((value + offset + sigma n) / q),        n normal with deviation 1
//! ```
//!
//! sigma is a channel's noise, q its step of quantisation; both may be zero. Noise is white: the chain has no
//! filter of its own, as the thesis' force channel has none. The figures of [`Channels::default`] are of the
//! order of a servo-hydraulic bench's LVDT, load cell, 1 ohm shunt and type J thermocouple read with 16 bit.

use super::noise::normal;
use rand::Rng;

/// Noise and quantisation of each channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Channels {
    /// Noise of displacement, in metres (standard deviation).
    pub displacement_noise_m: f64,
    /// Quantisation of displacement, in metres.
    pub displacement_step_m: f64,
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
    /// Noise of the case thermocouple, in kelvin.
    pub case_noise_k: f64,
    /// Quantisation of the case temperature, in kelvin.
    pub case_step_k: f64,
}

impl Channels {
    /// A chain without noise, quantisation and offset.
    pub const PERFECT: Self = Self {
        displacement_noise_m: 0.0,
        displacement_step_m: 0.0,
        current_noise_a: 0.0,
        current_step_a: 0.0,
        force_noise_n: 0.0,
        force_step_n: 0.0,
        force_offset_n: 0.0,
        case_noise_k: 0.0,
        case_step_k: 0.0,
    };
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
            force_offset_n: 0.0,
            case_noise_k: 0.1,
            case_step_k: 0.05,
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
    fn a_perfect_sensor_reads_the_value() {
        let mut rng = stream(1, Purpose::ForceNoise);
        assert_eq!(Sensor { noise: 0.0, step: 0.0, offset: 0.0 }.read(1.234, &mut rng), 1.234);
    }
}
