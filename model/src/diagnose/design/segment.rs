//! Segments of a designed run: a motion around a home with a course of the drive.

use super::limits::Limits;
use super::motion::{Motion, displacement};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::fmt::Write;

/// Course of the drive over a segment, as shares of its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Course {
    /// One value.
    Constant(f64),
    /// Two values in turn.
    Steps { values: [f64; 2], half_s: f64 },
    /// Linear from low to high and back, this often.
    Ramps { times: f64 },
    /// Pulses from low that get smaller, which remove a remanence.
    Pulses { each_s: f64 },
    /// Random values, each held for a time.
    Random { hold_s: f64, seed: u64 },
}

impl Course {
    /// The share at `t` seconds of a segment of `length_s` seconds.
    fn at(&self, t: f64, length_s: f64) -> f64 {
        match *self {
            Self::Constant(share) => share,
            Self::Steps { values, half_s } => values[(t / half_s).floor() as usize % 2],
            Self::Ramps { times } => {
                let turn = (times * t / length_s).fract();
                1.0 - (2.0 * turn - 1.0).abs()
            }
            Self::Pulses { each_s } => {
                let on = ((t / each_s).floor() as usize).is_multiple_of(2);
                if on { (1.0 - t / length_s).max(0.0) } else { 0.0 }
            }
            Self::Random { hold_s, seed } => {
                let number = (t / hold_s).floor() as u64;
                let mut rng = Pcg64Mcg::seed_from_u64(seed.wrapping_mul(1_000_003).wrapping_add(number));
                rng.random::<f64>()
            }
        }
    }

    fn words(&self, limits: &Limits, unit: &str) -> String {
        let value = |share: f64| format!("{:.3}", limits.drive_at(share));
        let short = |share: f64| value(share).trim_end_matches('0').trim_end_matches('.').to_owned();
        match *self {
            Self::Constant(share) => format!("{} {unit}", short(share)),
            Self::Steps { values: [a, b], half_s } => {
                format!("steps between {} and {} {unit} each {half_s} s", short(a), short(b))
            }
            Self::Ramps { times } => {
                let noun = if times == 1.0 { "ramp" } else { "ramps" };
                format!("{times} {noun} between {} and {} {unit}", short(0.0), short(1.0))
            }
            Self::Pulses { .. } => format!("falling pulses from {} {unit}", short(1.0)),
            Self::Random { hold_s, .. } => {
                format!("random steps between {} and {} {unit} each {hold_s} s", short(0.0), short(1.0))
            }
        }
    }
}

/// A segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Segment {
    pub(super) motion: Motion,
    pub(super) course: Course,
    /// Home, as a share of the stroke.
    pub(super) home: f64,
    /// Its limit of the speed, m/s.
    pub(super) speed_m_s: f64,
}

impl Segment {
    pub(super) fn home_m(&self, limits: &Limits) -> f64 {
        self.home * limits.stroke_m
    }

    /// Displacement (m) and drive at each of `samples` samples.
    pub(super) fn play(&self, samples: usize, limits: &Limits) -> (Vec<f64>, Vec<f64>) {
        let home_m = self.home_m(limits);
        let own = Limits { speed_m_s: self.speed_m_s, ..*limits };
        let mut displacement_m = displacement(&self.motion, home_m, samples, &own);
        displacement_m.iter_mut().for_each(|x| *x += home_m);
        let length_s = samples as f64 / limits.rate_hz;
        let drive = |k: usize| limits.drive_at(self.course.at(k as f64 / limits.rate_hz, length_s));
        (displacement_m, (0..samples).map(drive).collect())
    }

    /// The mirrored segment.
    pub(super) fn mirrored(self) -> Self {
        Self { home: -self.home, ..self }
    }

    /// The motion and the course of the drive, in words.
    pub(super) fn words(&self, peaks: [f64; 2], limits: &Limits, unit: &str) -> String {
        let [span_m, speed_m_s] = peaks;
        let mut text = match self.motion {
            Motion::Strokes { .. } => "strokes".to_owned(),
            Motion::Sine { frequency_hz, .. } => format!("{frequency_hz} Hz"),
            Motion::Chirp { band_hz: [low, high] } => format!("{low} to {high} Hz"),
            Motion::Random { most_hz, .. } => format!("random motion up to {most_hz} Hz"),
        };
        // Writing to a string does not fail.
        let _ = write!(text, " of {:.2} mm", 1e3 * span_m);
        if self.home != 0.0 {
            let _ = write!(text, " around {:.2} mm", 1e3 * self.home_m(limits));
        }
        let _ = write!(text, ", up to {speed_m_s:.3} m/s");
        if limits.drive.is_some() {
            let _ = write!(text, "; {}", self.course.words(limits, unit));
        }
        text
    }
}

/// Frequencies of bursts, Hz.
const FREQUENCIES_HZ: [f64; 8] = [0.8, 1.6, 3.0, 5.0, 8.0, 12.0, 18.0, 25.0];
/// Homes, as shares of the stroke.
const HOMES: [f64; 4] = [0.0, 0.0, 0.6, -0.6];

/// `count` candidates from all motions, courses and homes, in an order that depends on `seed`.
pub(super) fn candidates(limits: &Limits, length_s: f64, count: usize, seed: u64) -> Vec<Segment> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut motions = Vec::new();
    for speed in [0.02, 0.05, 0.12, 0.3, 0.6, 1.0] {
        for length in [1.0, 0.5, 0.2, 0.05] {
            motions.push(Motion::Strokes { length, speed });
        }
    }
    // Bursts have at least one period and five samples a quarter period.
    let plays = |f: &f64| *f * length_s >= 1.5 && *f <= limits.rate_hz / 20.0;
    for frequency_hz in FREQUENCIES_HZ.into_iter().filter(plays) {
        for share in [1.0, 0.4, 0.15] {
            motions.push(Motion::Sine { frequency_hz, share });
        }
    }
    for band_hz in [[0.8, 6.0], [2.0, 14.0], [5.0, 25.0]] {
        if plays(&band_hz[0]) && plays(&band_hz[1]) {
            motions.push(Motion::Chirp { band_hz });
        }
    }
    for most_hz in [3.0, 8.0, 14.0, 25.0] {
        if plays(&most_hz) {
            for share in [1.0, 0.5, 0.2] {
                motions.push(Motion::Random { most_hz, share, seed: rng.random() });
            }
        }
    }
    // In whole milliseconds, so that a plan is easy to read.
    let hold = |share: f64| (1e3 * share * length_s).round().max(1.0) / 1e3;
    let courses = |rng: &mut Pcg64Mcg| -> Vec<Course> {
        if limits.drive.is_none() {
            return vec![Course::Constant(0.0)];
        }
        vec![
            Course::Constant(0.0),
            Course::Constant(0.0),
            Course::Constant(0.2),
            Course::Constant(0.5),
            Course::Constant(1.0),
            Course::Steps { values: [0.0, 1.0], half_s: hold(0.1) },
            Course::Steps { values: [1.0, 0.0], half_s: hold(0.05) },
            Course::Steps { values: [0.3, 0.8], half_s: hold(0.12) },
            Course::Ramps { times: 1.0 },
            Course::Ramps { times: 4.0 },
            Course::Pulses { each_s: hold(0.1) },
            Course::Random { hold_s: hold(0.1), seed: rng.random() },
            Course::Random { hold_s: hold(0.04), seed: rng.random() },
        ]
    };
    // Motions, courses and homes are dealt like cards, so that a part of all combinations has each of them about equally often.
    let mut found = Vec::with_capacity(count);
    let (mut motion_deck, mut course_deck) = (Vec::new(), Vec::new());
    while found.len() < count {
        if motion_deck.is_empty() {
            motion_deck.clone_from(&motions);
            shuffle(&mut motion_deck, &mut rng);
        }
        if course_deck.is_empty() {
            course_deck = courses(&mut rng);
            shuffle(&mut course_deck, &mut rng);
        }
        let (Some(motion), Some(course)) = (motion_deck.pop(), course_deck.pop()) else { break };
        let home = HOMES[rng.random_range(0..HOMES.len())];
        found.push(Segment { motion, course, home, speed_m_s: limits.speed_m_s });
    }
    found
}

/// Random motion over a whole run, with random steps of the drive: what separates effects that follow time, and a run in which the model
/// errs little.
pub(super) fn whole(limits: &Limits, seed: u64) -> Vec<Segment> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let plays = |(most_hz, _): &(f64, f64)| *most_hz <= limits.rate_hz / 20.0;
    let kinds = [(5.0, 0.25), (8.0, 0.2), (8.0, 1.0), (14.0, 0.2), (25.0, 0.2)];
    let segment = |(most_hz, hold_s): (f64, f64)| {
        let motion = Motion::Random { most_hz, share: 1.0, seed: rng.random() };
        let course = Course::Random { hold_s, seed: rng.random() };
        Segment { motion, course, home: 0.0, speed_m_s: limits.speed_m_s }
    };
    kinds.into_iter().filter(plays).map(segment).collect()
}

/// Shuffles `items` (Fisher-Yates).
pub(super) fn shuffle<T>(items: &mut [T], rng: &mut Pcg64Mcg) {
    for k in (1..items.len()).rev() {
        items.swap(k, rng.random_range(0..=k));
    }
}
