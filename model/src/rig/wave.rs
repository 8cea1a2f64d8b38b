//! Displacements other than roads and plain sines: modulated sines, chirp, stepped frequency, slopes.
//!
//! ```text
//! AM     x = A (1 + m sin(2 pi fm t + p)) / (1 + m) sin(2 pi fc t)
//! FM     x = A sin(th),   th' = 2 pi (fc + fd sin(2 pi fm t + p))
//! CHS    x = A sin(th),   th' = 2 pi (f0 + (f1 - f0) t / T)
//! SFS    x = A cos(2 pi f_k (t - t_k))                            t in t_k..t_{k+1}
//! TPNVS  x' = +-v_k, from -A to A and back, its corners rounded by a constant acceleration
//! ```
//!
//! | symbol | field | unit | meaning |
//! |---|---|---|---|
//! | A | `amplitude_m` | m | amplitude |
//! | m | `depth` | - | depth of the modulation, 0 to 1 |
//! | fc, fm, fd | `carrier_hz`, `modulation_hz`, `deviation_hz` | Hz | carrier, modulation, deviation |
//! | f0, f1 | `from_hz`, `to_hz` | Hz | frequencies at start and end of a chirp |
//! | f_k | `low_hz` .. `high_hz`, `steps` | Hz | frequencies of the steps, equally spaced |
//! | v_k | `slowest_m_s` .. `fastest_m_s`, `slopes` | m/s | speeds of the slopes, equally spaced |
//! | p, T | | rad, s | random phase, duration of the run |
//!
//! A step of frequency lasts a whole number of periods and begins and ends at a crest, where velocity is zero, so displacement and
//! velocity do not jump. TPNVS is the papers' "triangular wave with positive and negative variable slopes": the rising slopes go from
//! slow to fast and the falling slopes from fast to slow (a single slope rises slowly and falls fast). The phase p and the first step or
//! slope are random, so runs with different seeds differ; a chirp has no random part. Each wave is faded in and out like a road.
//!
//! Source: experiments of the first paper. It names the signals and gives the band (0.5 to 14.5 Hz) and range (0.04 m); all other
//! values are chosen here.
//! See `[thesis-paper1]` in the bibliography (node/docs/guide/bibliography.md).

use super::signal::{Motion, RATE_HZ, remove_mean, sampled};
use crate::Error;
use rand::{Rng, RngExt};
use std::f64::consts::TAU;

/// Time in which the actuator accelerates from rest to a slope's speed, in seconds.
const CORNER_S: f64 = 0.02;

/// A modulated or stepped sine, a chirp, or triangles; see the equations at the top of this file.
///
/// ```
/// use mr_damper_model::rig::{Channels, Displacement, Experiment, Plant, Wave, record};
///
/// // Triangles of 0.03 to 0.24 m/s: the speed is constant between reversals.
/// let slopes = Wave::Slopes { amplitude_m: 0.015, slowest_m_s: 0.03, fastest_m_s: 0.24, slopes: 8 };
/// let experiment = Experiment { displacement: Displacement::Wave(slopes), ..Experiment::sine(0.01, 1.0, 1.2, 10.0) };
/// let run = record(&experiment, &Plant::default(), &Channels::PERFECT, 1);
/// let speeds_m_s = run.displacement_m.values.windows(2).map(|pair| (pair[1] - pair[0]).abs() * 512.0);
/// let fastest_m_s = speeds_m_s.fold(0.0, f64::max);
/// assert!((fastest_m_s - 0.24).abs() < 0.01, "{fastest_m_s} m/s");
/// assert!(Wave::Chirp { amplitude_m: 0.01, from_hz: 1.0, to_hz: 1e6 }.check().is_err());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wave {
    /// Amplitude-modulated sine (AM).
    AmplitudeModulated {
        /// Highest amplitude, in metres.
        amplitude_m: f64,
        /// Depth of the modulation, 0 to 1.
        depth: f64,
        /// Frequency of the carrier, in hertz.
        carrier_hz: f64,
        /// Frequency of the modulation, in hertz.
        modulation_hz: f64,
    },
    /// Frequency-modulated sine (FM).
    FrequencyModulated {
        /// Amplitude in metres.
        amplitude_m: f64,
        /// Mean frequency, in hertz.
        carrier_hz: f64,
        /// Largest deviation from it, in hertz; not above it.
        deviation_hz: f64,
        /// Frequency of the modulation, in hertz.
        modulation_hz: f64,
    },
    /// Sine whose frequency changes linearly over the run (CHS).
    Chirp {
        /// Amplitude in metres.
        amplitude_m: f64,
        /// Frequency at the start, in hertz.
        from_hz: f64,
        /// Frequency at the end, in hertz.
        to_hz: f64,
    },
    /// Sine whose frequency steps, each step for an equal share of the run (SFS).
    SteppedFrequency {
        /// Amplitude in metres.
        amplitude_m: f64,
        /// Lowest frequency, in hertz.
        low_hz: f64,
        /// Highest frequency, in hertz.
        high_hz: f64,
        /// Number of frequencies.
        steps: u32,
    },
    /// Triangles with slopes of several constant velocities (TPNVS).
    Slopes {
        /// Amplitude in metres.
        amplitude_m: f64,
        /// Least speed, in m/s.
        slowest_m_s: f64,
        /// Greatest speed, in m/s.
        fastest_m_s: f64,
        /// Number of speeds.
        slopes: u32,
    },
}

impl Wave {
    /// Checks that amplitudes, frequencies, speeds and counts are within their ranges.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the field.
    pub fn check(&self) -> Result<(), Error> {
        let amplitude =
            |a| Error::check("amplitude_m", a, "above 0 and at most 1", |a| a > 0.0 && a <= 1.0).map(drop);
        let frequency = |name: &str, f| {
            Error::check(name, f, "above 0 and at most 100 Hz", |f| f > 0.0 && f <= 100.0).map(drop)
        };
        let count = |name: &str, n: u32| {
            Error::check(name, f64::from(n), "1 to 1000", |n| (1.0..=1e3).contains(&n)).map(drop)
        };
        match *self {
            Self::AmplitudeModulated { amplitude_m, depth, carrier_hz, modulation_hz } => {
                amplitude(amplitude_m)?;
                Error::check("depth", depth, "0 to 1", |m| (0.0..=1.0).contains(&m))?;
                frequency("carrier_hz", carrier_hz)?;
                frequency("modulation_hz", modulation_hz)
            }
            Self::FrequencyModulated { amplitude_m, carrier_hz, deviation_hz, modulation_hz } => {
                amplitude(amplitude_m)?;
                frequency("carrier_hz", carrier_hz)?;
                let expected = "0 or above, and not above carrier_hz";
                Error::check("deviation_hz", deviation_hz, expected, |d| (0.0..=carrier_hz).contains(&d))?;
                frequency("modulation_hz", modulation_hz)
            }
            Self::Chirp { amplitude_m, from_hz, to_hz } => {
                amplitude(amplitude_m)?;
                frequency("from_hz", from_hz)?;
                frequency("to_hz", to_hz)
            }
            Self::SteppedFrequency { amplitude_m, low_hz, high_hz, steps } => {
                amplitude(amplitude_m)?;
                frequency("low_hz", low_hz)?;
                frequency("high_hz", high_hz)?;
                count("steps", steps)
            }
            Self::Slopes { amplitude_m, slowest_m_s, fastest_m_s, slopes } => {
                amplitude(amplitude_m)?;
                let speed = |name: &str, v| {
                    Error::check(name, v, "0.001 to 10 m/s", |v| (1e-3..=10.0).contains(&v)).map(drop)
                };
                speed("slowest_m_s", slowest_m_s)?;
                speed("fastest_m_s", fastest_m_s)?;
                count("slopes", slopes)
            }
        }
    }

    /// The motion over `samples` samples. A wave that fails [`Wave::check`] may give values that are not
    /// finite.
    pub(super) fn motion(&self, samples: usize, rng: &mut impl Rng) -> Motion {
        let duration_s = samples as f64 / RATE_HZ;
        let mut motion = match *self {
            Self::AmplitudeModulated { amplitude_m, depth, carrier_hz, modulation_hz } => {
                let phase = TAU * rng.random::<f64>();
                let (carrier, slow) = (TAU * carrier_hz, TAU * modulation_hz);
                let a = amplitude_m / (1.0 + depth);
                sampled(samples, |t| {
                    let (sin_m, cos_m) = (slow * t + phase).sin_cos();
                    let (sin, cos) = (carrier * t).sin_cos();
                    let envelope = 1.0 + depth * sin_m;
                    (a * envelope * sin, a * (envelope * carrier * cos + depth * slow * cos_m * sin))
                })
            }
            Self::FrequencyModulated { amplitude_m, carrier_hz, deviation_hz, modulation_hz } => {
                let phase = TAU * rng.random::<f64>();
                sampled(samples, |t| {
                    let (sin_m, cos_m) = (TAU * modulation_hz * t + phase).sin_cos();
                    let turned = deviation_hz / modulation_hz * (phase.cos() - cos_m);
                    let omega = TAU * (carrier_hz + deviation_hz * sin_m);
                    turning(amplitude_m, TAU * carrier_hz * t + turned, omega)
                })
            }
            Self::Chirp { amplitude_m, from_hz, to_hz } => {
                let sweep = (to_hz - from_hz) / duration_s;
                sampled(samples, |t| {
                    let turned = TAU * t * (from_hz + sweep * t / 2.0);
                    turning(amplitude_m, turned, TAU * (from_hz + sweep * t))
                })
            }
            Self::SteppedFrequency { amplitude_m, low_hz, high_hz, steps } => {
                let mut frequencies = spread(low_hz, high_hz, steps);
                rotate(&mut frequencies, rng);
                stepped(samples, amplitude_m, &frequencies)
            }
            Self::Slopes { amplitude_m, slowest_m_s, fastest_m_s, slopes } => {
                let mut rising = spread(slowest_m_s, fastest_m_s, slopes);
                let mut speeds: Vec<(f64, f64)> =
                    rising.iter().copied().zip(spread(fastest_m_s, slowest_m_s, slopes)).collect();
                rotate(&mut speeds, rng);
                rising.clear();
                rising.extend(speeds.iter().flat_map(|&(up, down)| [up, down]));
                triangles(samples, amplitude_m, &rising)
            }
        };
        remove_mean(&mut motion.displacement_m);
        motion
    }
}

/// Displacement and velocity of a sine at phase `angle` (rad) with angular frequency `omega` (rad/s).
fn turning(amplitude_m: f64, angle: f64, omega: f64) -> (f64, f64) {
    let (sin, cos) = angle.sin_cos();
    (amplitude_m * sin, amplitude_m * omega * cos)
}

/// `count` equally spaced values from `first` to `last`; for a count of one, `first`.
fn spread(first: f64, last: f64, count: u32) -> Vec<f64> {
    let gaps = f64::from(count.max(2) - 1);
    (0..count.max(1)).map(|k| first + (last - first) * f64::from(k) / gaps).collect()
}

/// Rotates the list to start at a random member.
fn rotate<T>(list: &mut [T], rng: &mut impl Rng) {
    let first = (rng.random::<f64>() * list.len() as f64) as usize;
    list.rotate_left(first);
}

/// Cosines with the given frequencies one after another, each for a whole number of periods.
fn stepped(samples: usize, amplitude_m: f64, frequencies: &[f64]) -> Motion {
    let share_s = samples as f64 / RATE_HZ / frequencies.len() as f64;
    let (mut step, mut start_s) = (0, 0.0);
    let length_s = |f: f64| (share_s * f).round().max(1.0) / f;
    sampled(samples, |t| {
        while step + 1 < frequencies.len() && t >= start_s + length_s(frequencies[step]) {
            start_s += length_s(frequencies[step]);
            step += 1;
        }
        let omega = TAU * frequencies[step];
        let (sin, cos) = (omega * (t - start_s)).sin_cos();
        (amplitude_m * cos, -amplitude_m * omega * sin)
    })
}

/// Strokes between -A and A, alternately up and down, cycling through the given speeds. Starts in the middle.
fn triangles(samples: usize, amplitude_m: f64, speeds: &[f64]) -> Motion {
    let mut strokes = speeds.iter().copied().cycle();
    let mut stroke = Stroke::new(0.0, amplitude_m, strokes.next().unwrap_or(0.0));
    let mut start_s = 0.0;
    sampled(samples, |t| {
        while t - start_s >= stroke.duration_s {
            start_s += stroke.duration_s;
            stroke = Stroke::new(stroke.to_m, -stroke.to_m, strokes.next().unwrap_or(0.0));
        }
        stroke.at(t - start_s)
    })
}

/// One slope: constant acceleration, constant speed, constant deceleration.
struct Stroke {
    from_m: f64,
    to_m: f64,
    speed_m_s: f64,
    corner_s: f64,
    duration_s: f64,
}

impl Stroke {
    fn new(from_m: f64, to_m: f64, speed_m_s: f64) -> Self {
        let at_speed_s = (to_m - from_m).abs() / speed_m_s;
        // A stroke too short for its corners accelerates and decelerates without constant speed in between.
        let corner_s = CORNER_S.min(at_speed_s);
        Self { from_m, to_m, speed_m_s, corner_s, duration_s: at_speed_s + corner_s }
    }

    /// Displacement and velocity `t` seconds after the start.
    fn at(&self, t: f64) -> (f64, f64) {
        let direction = (self.to_m - self.from_m).signum();
        let (v, corner) = (self.speed_m_s, self.corner_s);
        let left = self.duration_s - t;
        let (way, speed) = if t < corner {
            (v * t * t / corner / 2.0, v * t / corner)
        } else if left < corner {
            ((self.to_m - self.from_m).abs() - v * left * left / corner / 2.0, v * left / corner)
        } else {
            (v * (t - corner / 2.0), v)
        };
        (self.from_m + direction * way, direction * speed)
    }
}

#[cfg(test)]
mod tests;
