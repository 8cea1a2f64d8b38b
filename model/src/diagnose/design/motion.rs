//! Displacement of one segment of a designed run: it starts and ends at rest at its home, within the limits.
//!
//! ```text
//! stroke  a move from rest to rest, speed v(t) = s (1 - cos(pi t / r)) / 2 while it starts, s, and the same while it stops
//!         r = pi s / (2 a): the acceleration reaches a;  a move of length d < s r has s = sqrt(2 a d / pi)
//! burst   x(t) = home + A w(t) u(t),   w(t) = sin^2 over the first and last part,   A: the largest that keeps the limits
//! ```
//!
//! The limits hold for the function, so they hold for differences of its samples: a first difference is the mean of the speed over one
//! sample, a second difference a weighted mean of the acceleration.

use super::limits::Limits;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};

/// Share of a limit that a segment uses, so that rounding does not exceed it.
const USED: f64 = 0.98;
/// Tones of a random burst: for each second, but no fewer and no more than these.
const TONES_PER_S: f64 = 6.0;
const TONES: [usize; 2] = [12, 120];
/// Longest rise and fall of a burst, s.
const RISE_S: f64 = 0.4;

/// Motion of a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Motion {
    /// Moves at constant speed between the two sides of home.
    Strokes {
        /// Length of a move from side to side, as a share of the room around home.
        length: f64,
        /// Speed, as a share of the limit.
        speed: f64,
    },
    /// A burst of a sine.
    Sine {
        /// Frequency, Hz.
        frequency_hz: f64,
        /// Amplitude, as a share of the largest within the limits.
        share: f64,
    },
    /// A burst whose frequency grows.
    Chirp {
        /// First and last frequency, Hz.
        band_hz: [f64; 2],
    },
    /// A burst of tones with random phases, up to a frequency.
    Random {
        /// Highest frequency, Hz.
        most_hz: f64,
        /// Amplitude, as a share of the largest within the limits.
        share: f64,
        /// Seed of the phases.
        seed: u64,
    },
}

/// Displacement relative to home at each sample of a segment of `samples` samples, m.
pub(super) fn displacement(motion: &Motion, home_m: f64, samples: usize, limits: &Limits) -> Vec<f64> {
    let length_s = samples as f64 / limits.rate_hz;
    let room_m = USED * (limits.stroke_m - home_m.abs()).max(0.0);
    match *motion {
        Motion::Strokes { length, speed } => {
            strokes(0.5 * length * 2.0 * room_m, speed * USED * limits.speed_m_s, samples, limits)
        }
        Motion::Sine { frequency_hz, share } => {
            burst(|t| (TAU * frequency_hz * t).sin(), share, room_m, length_s, samples, limits)
        }
        Motion::Chirp { band_hz: [low, high] } => {
            let phase = |t: f64| TAU * (low * t + 0.5 * (high - low) * t * t / length_s);
            // The amplitude falls with the frequency, so that no part of the band is lost to the limit of acceleration.
            let amplitude = |t: f64| low / (low + (high - low) * t / length_s);
            burst(|t| amplitude(t) * phase(t).sin(), 1.0, room_m, length_s, samples, limits)
        }
        Motion::Random { most_hz, share, seed } => {
            let mut rng = Pcg64Mcg::seed_from_u64(seed);
            let count = ((TONES_PER_S * length_s) as usize).clamp(TONES[0], TONES[1]);
            let mut tone = |k: usize| {
                let frequency_hz = most_hz * (k as f64 + 0.2 + 0.8 * rng.random::<f64>()) / count as f64;
                (frequency_hz, TAU * rng.random::<f64>())
            };
            let tones: Vec<(f64, f64)> = (0..count).map(&mut tone).collect();
            let value = |t: f64| -> f64 {
                tones.iter().map(|(f, phase)| (TAU * f * t + phase).sin() / (1.0 + f)).sum()
            };
            burst(value, share, room_m, length_s, samples, limits)
        }
    }
}

/// Moves from home to one side, then from side to side, and back home at the end, each from rest to rest.
fn strokes(side_m: f64, speed_m_s: f64, samples: usize, limits: &Limits) -> Vec<f64> {
    let length_s = samples as f64 / limits.rate_hz;
    let mut targets_m = Vec::new();
    let (mut at_m, mut to_m, mut time_s) = (0.0, side_m, 0.0);
    // The way back home from the next target must fit as well.
    loop {
        let there = Stroke::new(to_m - at_m, speed_m_s, limits);
        let back = Stroke::new(-to_m, speed_m_s, limits);
        if targets_m.len() >= 10_000 || time_s + there.duration_s + back.duration_s > length_s {
            break;
        }
        targets_m.push(to_m);
        time_s += there.duration_s;
        (at_m, to_m) = (to_m, -to_m);
    }
    if targets_m.is_empty() {
        // Not even one move fits: a shorter one, out and back in half of the time each.
        let mut shorter_m = side_m;
        for _ in 0..60 {
            if 2.0 * Stroke::new(shorter_m, speed_m_s, limits).duration_s <= length_s {
                break;
            }
            shorter_m *= 0.7;
        }
        if 2.0 * Stroke::new(shorter_m, speed_m_s, limits).duration_s > length_s {
            return vec![0.0; samples];
        }
        targets_m.push(shorter_m);
    }
    targets_m.push(0.0);
    let mut values = Vec::with_capacity(samples);
    let (mut from_m, mut start_s) = (0.0, 0.0);
    for to_m in targets_m {
        let stroke = Stroke::new(to_m - from_m, speed_m_s, limits);
        while values.len() < samples {
            let t = values.len() as f64 / limits.rate_hz - start_s;
            if t >= stroke.duration_s {
                break;
            }
            values.push(from_m + stroke.at(t));
        }
        start_s += stroke.duration_s;
        from_m = to_m;
    }
    values.resize(samples, 0.0);
    values
}

/// A move from rest to rest.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stroke {
    length_m: f64,
    speed_m_s: f64,
    ramp_s: f64,
    pub(super) duration_s: f64,
}

impl Stroke {
    pub(super) fn new(length_m: f64, most_m_s: f64, limits: &Limits) -> Self {
        let acceleration = USED * limits.acceleration_m_s2;
        let speed_m_s = most_m_s.min((2.0 * acceleration * length_m.abs() / PI).sqrt());
        if speed_m_s <= 0.0 {
            return Self { length_m: 0.0, speed_m_s: 0.0, ramp_s: 0.0, duration_s: 0.0 };
        }
        let ramp_s = PI * speed_m_s / (2.0 * acceleration);
        // Each ramp covers half of what the full speed would.
        Self { length_m, speed_m_s, ramp_s, duration_s: length_m.abs() / speed_m_s + ramp_s }
    }

    /// Displacement at `t` seconds, m.
    pub(super) fn at(&self, t: f64) -> f64 {
        if self.ramp_s <= 0.0 {
            return 0.0;
        }
        let ramp = |t: f64| 0.5 * self.speed_m_s * (t - self.ramp_s / PI * (PI * t / self.ramp_s).sin());
        let t = t.clamp(0.0, self.duration_s);
        let whole = self.length_m.abs();
        let left = self.duration_s - t;
        let way = if t < self.ramp_s && left < self.ramp_s {
            // The two ramps touch only at one instant.
            if t < left { ramp(t) } else { whole - ramp(left) }
        } else if t < self.ramp_s {
            ramp(t)
        } else if left < self.ramp_s {
            whole - ramp(left)
        } else {
            0.5 * self.speed_m_s * self.ramp_s + self.speed_m_s * (t - self.ramp_s)
        };
        way.copysign(self.length_m)
    }
}

/// `unit` in a window, scaled to `share` of the largest amplitude that keeps the limits.
fn burst(
    unit: impl Fn(f64) -> f64,
    share: f64,
    room_m: f64,
    length_s: f64,
    samples: usize,
    limits: &Limits,
) -> Vec<f64> {
    let rise_s = RISE_S.min(0.4 * length_s);
    let window = |t: f64| {
        let edge_s = t.min(length_s - t).max(0.0);
        if edge_s >= rise_s { 1.0 } else { (0.5 * PI * edge_s / rise_s).sin().powi(2) }
    };
    let value = |t: f64| window(t) * unit(t);
    let mut values: Vec<f64> = (0..samples).map(|k| value(k as f64 / limits.rate_hz)).collect();
    // The function is examined at four points for each sample, so that the limits hold at any rate.
    let step_s = 0.25 / limits.rate_hz;
    let (mut most, mut fastest, mut sharpest) = (0.0_f64, 0.0_f64, 0.0_f64);
    let [mut before, mut here] = [value(0.0), value(step_s)];
    for k in 2..4 * samples + 4 {
        let after = value((k as f64 * step_s).min(length_s));
        most = most.max(here.abs());
        fastest = fastest.max((after - here).abs() / step_s);
        sharpest = sharpest.max((after - 2.0 * here + before).abs() / (step_s * step_s));
        (before, here) = (here, after);
    }
    let limit = |limit: f64, unit: f64| if unit > 0.0 { limit / unit } else { f64::INFINITY };
    let amplitude = limit(room_m, most)
        .min(limit(USED * limits.speed_m_s, fastest))
        .min(limit(USED * limits.acceleration_m_s2, sharpest));
    let amplitude = if amplitude.is_finite() { share * amplitude } else { 0.0 };
    values.iter_mut().for_each(|value| *value *= amplitude);
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_stroke_ends_at_its_length_within_speed_and_acceleration(
            length_m in -0.1..0.1_f64, most_m_s in 1e-3..1.0_f64, acceleration in 0.1..100.0_f64,
        ) {
            let limits = Limits { acceleration_m_s2: acceleration, ..Limits::default() };
            let stroke = Stroke::new(length_m, most_m_s, &limits);
            prop_assert!((stroke.at(stroke.duration_s) - length_m).abs() < 1e-12);
            let step_s = (stroke.duration_s / 5000.0).max(1e-9);
            for k in 1..5000 {
                let [a, b, c] = [k - 1, k, k + 1].map(|k| stroke.at(f64::from(k) * step_s));
                prop_assert!((b - a).abs() <= most_m_s * step_s * (1.0 + 1e-9) + 1e-15);
                prop_assert!((c - 2.0 * b + a).abs() <= acceleration * step_s * step_s + 1e-13);
            }
        }
    }
}
