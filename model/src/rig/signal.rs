//! Displacement of the rig's actuator: a road profile, a sine, or a wave of [`super::wave`].
//!
//! ```text
//! x(t) = sum_j a_j cos(2 pi f_j t - phi_j),       f_j = f_min + (j - 1) df,  df = (f_max - f_min) / n
//! a_j  = sqrt(2 df S(f_j)) B(f_j) A(f_j)          phi_j uniform in 0..2 pi
//! S(f) = Cr V^(N-1) / (f^2 + f_l^2)^(N/2)         -> Cr V^(N-1) / f^N  well above f_l
//! B(f) = 1 / sqrt(1 + (f/f_b)^4)                  band of the set point (two-pole Butterworth)
//! A(f) = 1 / sqrt(1 + (f/f_a)^4)                  roll-off of the servo actuator, 15 Hz
//! ```
//!
//! | symbol | field | unit | meaning |
//! |---|---|---|---|
//! | Cr, N | `roughness_ft`, `exponent` | ft² per cycle/ft, - | roughness and slope of the road |
//! | V | `speed_m_s` | m/s | travelling speed |
//! | f_min, f_max, n | `f_min_hz`, `f_max_hz`, `harmonics` | Hz, Hz, - | the harmonics |
//! | f_l | `level_hz` | Hz | the spectrum is level below this frequency |
//! | f_b | `band_hz` | Hz | band of the set point |
//! | f_a | `servo_hz` | Hz | bandwidth of the actuator |
//!
//! The sum is scaled to a given span, faded in from rest and out to rest, and has zero mean.
//!
//! Source: thesis 3.3, 3.4 and Table 3.1 (100 harmonics, 0.2 to 20.5 Hz, smooth highway at 25 mph), with the standard form of the
//! spectrum. The thesis prints Cr w_c^(-N) / V, with the constant w_c = 0.5 cycles/ft in place of the frequency f. That spectrum is
//! level, with a standard deviation of 0.02 in, but the thesis' recorded runs have 0.16 to 0.20 in. The standard form gives 0.22 in
//! and must be meant; [`Road::SMOOTH_HIGHWAY`] is this plain road.
//!
//! Two parameters are added here, `level_hz` and `band_hz`. The plain power law has so much power at 0.2 Hz that velocity is 6 to 8 1/s
//! times displacement (standard deviations). The thesis' recorded runs have 14 to 16 1/s, and little power above 4 to 6 Hz. The two
//! parameters reproduce this. Physically, the damper stroke of a car does not contain the slow waves of a road, because the body
//! follows them.
//!
//! See `[thesis]` in the bibliography (node/docs/guide/bibliography.md), equations 3.3 and 3.4 and table 3.1 of the thesis.

use super::wave::Wave;
use rand::{Rng, RngExt};
use std::f64::consts::TAU;

/// Sampling rate of all recorded channels except temperatures, Hz.
pub const RATE_HZ: f64 = 512.0;

/// Time over which a displacement fades in from rest and out to rest, in seconds.
pub const FADE_S: f64 = 0.5;

/// Metres in one foot, the unit of the thesis' road table.
const M_PER_FT: f64 = 0.3048;

/// A displacement with its velocity, sampled at [`RATE_HZ`].
///
/// For generated displacements the velocity is the exact derivative, so the plant can interpolate between samples without the error of
/// a finite difference.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Motion {
    /// Displacement in metres, positive in extension, with zero mean.
    pub displacement_m: Vec<f64>,
    /// Velocity in m/s.
    pub velocity_m_s: Vec<f64>,
}

impl Motion {
    /// The motion of a displacement recorded at [`RATE_HZ`], in metres, with the velocity by central differences.
    #[must_use]
    pub fn recorded(displacement_m: Vec<f64>) -> Self {
        let last = displacement_m.len().saturating_sub(1);
        let velocity = |k: usize| {
            let (before, after) = (k.saturating_sub(1), (k + 1).min(last));
            (displacement_m[after] - displacement_m[before]) * RATE_HZ / (after - before).max(1) as f64
        };
        let velocity_m_s = (0..displacement_m.len()).map(velocity).collect();
        Self { displacement_m, velocity_m_s }
    }
}

/// Displacement of the actuator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Displacement {
    /// A random road profile.
    Road(Road),
    /// A sine.
    Sine {
        /// Amplitude in metres, as reached by the actuator.
        amplitude_m: f64,
        /// Frequency in hertz.
        frequency_hz: f64,
    },
    /// A modulated or stepped sine, a chirp, or triangles.
    Wave(Wave),
}

impl Displacement {
    /// The motion over `samples` samples. Random phases come from `rng`; a plain sine uses no random numbers.
    #[must_use]
    pub fn motion(&self, samples: usize, rng: &mut impl Rng) -> Motion {
        self.motion_while(samples, rng, &mut || true).unwrap_or_default()
    }

    /// As [`Displacement::motion`], but calls `go_on` once per second of a road's run and returns `None` as soon as it returns false. A
    /// long road takes up to a second to compute.
    pub fn motion_while(
        &self,
        samples: usize,
        rng: &mut impl Rng,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Option<Motion> {
        Some(match *self {
            Self::Road(road) => return road.motion(samples, rng, go_on),
            Self::Sine { amplitude_m, frequency_hz } => {
                // The phase of a quarter period makes it start at zero.
                let tone = Tone { amplitude_m, frequency_hz, phase_rad: TAU / 4.0 };
                let mut motion = sum_of(&[tone], samples, go_on)?;
                remove_mean(&mut motion.displacement_m);
                motion
            }
            Self::Wave(wave) => wave.motion(samples, rng),
        })
    }
}

/// A road profile with the gain of the actuator; see the equations at the top of this file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Road {
    /// Exponent of the spectrum (N), dimensionless.
    pub exponent: f64,
    /// Roughness (Cr) in ft² per cycle/ft at 1 cycle/ft, the unit of the thesis' Table 3.1.
    pub roughness_ft: f64,
    /// Travelling speed (V) in m/s.
    pub speed_m_s: f64,
    /// Number of harmonics.
    pub harmonics: u32,
    /// Lowest frequency in hertz.
    pub f_min_hz: f64,
    /// End of the frequency range in hertz.
    pub f_max_hz: f64,
    /// Frequency in hertz below which the spectrum is level; 0 gives the plain power law.
    pub level_hz: f64,
    /// Band of the set point in hertz; infinite for none.
    pub band_hz: f64,
    /// Bandwidth of the servo actuator in hertz; infinite for none.
    pub servo_hz: f64,
    /// Span (highest minus lowest displacement) in metres to which the profile is scaled; `None` keeps the amplitude of the spectrum.
    pub span_m: Option<f64>,
}

impl Road {
    /// The thesis' road: smooth highway at 25 mph, 100 harmonics from 0.2 to 20.5 Hz, plain power law,
    /// 15 Hz actuator, not scaled.
    pub const SMOOTH_HIGHWAY: Self = Self {
        exponent: 2.1,
        roughness_ft: 1.2e-6,
        speed_m_s: 11.176,
        harmonics: 100,
        f_min_hz: 0.2,
        f_max_hz: 20.5,
        level_hz: 0.0,
        band_hz: f64::INFINITY,
        servo_hz: 15.0,
        span_m: None,
    };

    /// Power spectral density of the road at `f_hz`, in m²/Hz, without the gains of set-point band and actuator.
    #[must_use]
    pub fn psd_m2_hz(&self, f_hz: f64) -> f64 {
        let speed_ft_s = self.speed_m_s / M_PER_FT;
        let level = (f_hz * f_hz + self.level_hz * self.level_hz).powf(self.exponent / 2.0);
        self.roughness_ft * speed_ft_s.powf(self.exponent - 1.0) / level * M_PER_FT * M_PER_FT
    }

    fn motion(&self, samples: usize, rng: &mut impl Rng, go_on: &mut dyn FnMut() -> bool) -> Option<Motion> {
        let step_hz = (self.f_max_hz - self.f_min_hz) / f64::from(self.harmonics);
        let tones: Vec<Tone> = (0..self.harmonics)
            .map(|j| {
                let frequency_hz = self.f_min_hz + f64::from(j) * step_hz;
                let amplitude_m = (2.0 * step_hz * self.psd_m2_hz(frequency_hz)).sqrt()
                    * two_pole_gain(frequency_hz / self.band_hz)
                    * two_pole_gain(frequency_hz / self.servo_hz);
                Tone { amplitude_m, frequency_hz, phase_rad: TAU * rng.random::<f64>() }
            })
            .collect();
        let mut motion = sum_of(&tones, samples, go_on)?;
        if let Some(target) = self.span_m {
            let span = span(&motion.displacement_m);
            // A run too short to move has zero span and is not scaled.
            let gain = if span > 0.0 { target / span } else { 1.0 };
            motion.displacement_m.iter_mut().chain(&mut motion.velocity_m_s).for_each(|x| *x *= gain);
        }
        remove_mean(&mut motion.displacement_m);
        Some(motion)
    }
}

/// One harmonic: a cos(2 pi f t - phi).
#[derive(Debug, Clone, Copy)]
struct Tone {
    amplitude_m: f64,
    frequency_hz: f64,
    phase_rad: f64,
}

/// Sum of harmonics, faded in and out, with its exact derivative; `None` if `go_on` returned false.
fn sum_of(tones: &[Tone], samples: usize, go_on: &mut dyn FnMut() -> bool) -> Option<Motion> {
    let mut going = true;
    let motion = sampled(samples, |t| {
        going = going && (t.fract() != 0.0 || go_on());
        if !going {
            return (0.0, 0.0);
        }
        let (mut x, mut v) = (0.0, 0.0);
        for tone in tones {
            let omega = TAU * tone.frequency_hz;
            let (sin, cos) = (omega * t - tone.phase_rad).sin_cos();
            x += tone.amplitude_m * cos;
            v -= tone.amplitude_m * omega * sin;
        }
        (x, v)
    });
    going.then_some(motion)
}

/// Displacement and velocity from `at`, called with the time of each sample in seconds, in order; faded in and out.
pub(super) fn sampled(samples: usize, mut at: impl FnMut(f64) -> (f64, f64)) -> Motion {
    let mut motion =
        Motion { displacement_m: Vec::with_capacity(samples), velocity_m_s: Vec::with_capacity(samples) };
    for k in 0..samples {
        let (x, v) = at(k as f64 / RATE_HZ);
        let (fade, slope) = fade(k, samples);
        motion.displacement_m.push(fade * x);
        motion.velocity_m_s.push(fade * v + slope * x);
    }
    motion
}

/// Weight of the fade at sample `k` and its time derivative in 1/s. The fade is a quintic from 0 to 1 with zero velocity and
/// acceleration at its ends, so that the actuator starts and stops smoothly.
fn fade(k: usize, samples: usize) -> (f64, f64) {
    let last = samples.saturating_sub(1);
    // In a run too short for two full fades, each fade takes half of the run.
    let length_s = FADE_S.min(last as f64 / RATE_HZ / 2.0);
    let (edge, direction) = if 2 * k <= last { (k, 1.0) } else { (last - k, -1.0) };
    let u = edge as f64 / RATE_HZ / length_s;
    if u.is_nan() || u >= 1.0 {
        return (1.0, 0.0);
    }
    let weight = u * u * u * (10.0 + u * (6.0 * u - 15.0));
    let slope = 30.0 * u * u * (1.0 - u) * (1.0 - u) / length_s;
    (weight, direction * slope)
}

/// Gain of a two-pole Butterworth low-pass at `ratio` = f/f_c.
fn two_pole_gain(ratio: f64) -> f64 {
    1.0 / (1.0 + ratio.powi(4)).sqrt()
}

/// Highest minus lowest value.
fn span(values: &[f64]) -> f64 {
    let (low, high) =
        values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| (low.min(x), high.max(x)));
    high - low
}

/// Subtracts the mean.
pub(super) fn remove_mean(values: &mut [f64]) {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter_mut().for_each(|x| *x -= mean);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    fn std(values: &[f64]) -> f64 {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / values.len() as f64).sqrt()
    }

    /// Power of `x` in the band `low..high` hertz, by a plain discrete Fourier transform.
    fn band_power(x: &[f64], low: f64, high: f64) -> f64 {
        let length_s = x.len() as f64 / RATE_HZ;
        let (first, last) = ((low * length_s) as usize, (high * length_s) as usize);
        (first..last)
            .map(|bin| {
                let omega = TAU * bin as f64 / x.len() as f64;
                let (re, im) = x.iter().enumerate().fold((0.0, 0.0), |(re, im), (k, x)| {
                    let (sin, cos) = (omega * k as f64).sin_cos();
                    (re + x * cos, im - x * sin)
                });
                (re * re + im * im) / (x.len() as f64).powi(2)
            })
            .sum()
    }

    #[test]
    fn the_unscaled_road_has_the_standard_deviation_of_its_spectrum() {
        // The integral of the spectrum gives 0.22 in. The sum uses the power at the lower end of each frequency cell, where the
        // spectrum is highest, and gives 0.289 in.
        let road = Road { servo_hz: f64::INFINITY, ..Road::SMOOTH_HIGHWAY };
        let motion = Displacement::Road(road).motion(60 * 512, &mut Pcg64Mcg::seed_from_u64(3));
        let inches = std(&motion.displacement_m) / 0.0254;
        assert!((inches - 0.289).abs() < 0.01, "{inches} in");
    }

    #[test]
    fn a_scaled_road_has_its_span_zero_mean_and_starts_and_ends_at_rest() {
        let road = Road { span_m: Some(0.0264), ..Road::SMOOTH_HIGHWAY };
        let motion = Displacement::Road(road).motion(30 * 512, &mut Pcg64Mcg::seed_from_u64(1));
        assert!((span(&motion.displacement_m) - 0.0264).abs() < 1e-12);
        assert!(motion.displacement_m.iter().sum::<f64>().abs() < 1e-9);
        let first_and_last = [motion.velocity_m_s[0], motion.velocity_m_s[30 * 512 - 1]];
        assert_eq!(first_and_last, [0.0, 0.0]);
    }

    #[test]
    fn velocity_is_the_derivative_of_displacement() {
        let motion = Displacement::Road(Road::SMOOTH_HIGHWAY).motion(1024, &mut Pcg64Mcg::seed_from_u64(5));
        for (x, v) in motion.displacement_m.windows(3).zip(&motion.velocity_m_s[1..]) {
            let difference = (x[2] - x[0]) * RATE_HZ / 2.0;
            assert!((difference - v).abs() < 1e-3, "{difference} against {v}");
        }
    }

    #[test]
    fn the_spectrum_falls_with_its_exponent() {
        // For a spectrum of 1/f^2.1 the power per octave falls by a factor of 2^1.1 from octave to octave.
        let road = Road { servo_hz: f64::INFINITY, ..Road::SMOOTH_HIGHWAY };
        let x = Displacement::Road(road).motion(30 * 512, &mut Pcg64Mcg::seed_from_u64(9)).displacement_m;
        let ratio = band_power(&x, 1.0, 4.0) / band_power(&x, 4.0, 16.0);
        let slope = ratio.log2() / 2.0 + 1.0;
        assert!((slope - 2.1).abs() < 0.15, "slope {slope}");
    }

    #[test]
    fn the_actuator_rolls_off_at_15_hz() {
        let with = Road::SMOOTH_HIGHWAY;
        let without = Road { servo_hz: f64::INFINITY, ..with };
        let power = |road| {
            let x = Displacement::Road(road).motion(30 * 512, &mut Pcg64Mcg::seed_from_u64(2)).displacement_m;
            band_power(&x, 14.5, 15.5)
        };
        let gain = (power(with) / power(without)).sqrt();
        assert!((gain - 0.707).abs() < 0.02, "gain {gain}");
    }

    #[test]
    fn short_runs_do_not_divide_by_zero() {
        for samples in 0..5 {
            let motion = Displacement::Road(Road { span_m: Some(0.01), ..Road::SMOOTH_HIGHWAY })
                .motion(samples, &mut Pcg64Mcg::seed_from_u64(0));
            assert_eq!(motion.displacement_m.len(), samples);
            assert!(motion.displacement_m.iter().chain(&motion.velocity_m_s).all(|x| x.is_finite()));
        }
    }
}
