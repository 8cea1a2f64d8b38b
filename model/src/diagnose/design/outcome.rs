//! The result of a design: how well the run separates each pair of rivals.

use super::NoiseSource;
use super::criterion::Squares;
use super::search::discrimination;
use crate::effect::EffectModel;
use crate::sample::Run;
use statrs::distribution::{ContinuousCDF, Normal};

/// Least share of an effect's change that its rival must not be able to take. The diagnosis puts effects in one class from nine tenths on.
pub(super) const LEAST_SHARE: f64 = 0.1;
/// Expected discrimination at a probability of 95 %.
pub(super) const Z_95: f64 = 1.644_853_627;

/// How well a run tells an effect from its rival.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Separation {
    /// Distance of the force with the effect from the model without it, after a refit, root mean square, N.
    pub alone_n: f64,
    /// Distance from the rival, after a refit, root mean square, N.
    pub distance_n: f64,
    /// Share of the squared distance from the model without the effect that the rival cannot take.
    pub share: f64,
    /// Expected discrimination: half the distance in standard deviations of the sum that decides.
    pub discrimination: f64,
    /// Probability that the run prefers the effect to its rival, if the effect is there.
    pub probability: f64,
    /// Time of such a run at which this probability is 95 %, s; infinite if the run does not separate them.
    pub needed_s: f64,
}

impl Separation {
    pub(super) fn new(found: Squares, rows: f64, seconds: f64, noise_n: f64, duration_s: f64) -> Self {
        let rms = |squares: f64| (squares / rows.max(1.0)).sqrt();
        let discrimination = discrimination(found.apart, rows, seconds, noise_n);
        let probability = Normal::standard().cdf(discrimination);
        Self {
            alone_n: rms(found.alone),
            distance_n: rms(found.apart),
            share: if found.alone > 0.0 { found.apart / found.alone } else { 0.0 },
            discrimination,
            probability,
            needed_s: if discrimination > 0.0 {
                duration_s * (Z_95 / discrimination).powi(2)
            } else {
                f64::INFINITY
            },
        }
    }

    /// True if a diagnosis is expected to name the effect and not the rival: the probability is at least 95 %, and the rival cannot take
    /// more than nine tenths of the effect's change.
    #[must_use]
    pub fn is_enough(&self) -> bool {
        self.discrimination >= Z_95 && self.share >= LEAST_SHARE
    }
}

/// An effect and its rival.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// The effect that is taken as present, with its size.
    pub truth: EffectModel,
    /// True if the size comes from the model; false for a typical one. That changes the force on the road as much as the known size of a rival
    /// does, else by 5 %; or it is at the end of the physical range.
    pub size_is_known: bool,
    /// Id of the rival; `None` for the model without the effect.
    pub rival: Option<&'static str>,
    /// Separation by the designed run.
    pub designed: Separation,
    /// True if true refits of the rival confirmed the distance; false if it follows from derivatives only.
    pub is_checked: bool,
    /// Separation by a road profile of the same length within the same limits.
    pub road: Separation,
}

/// A segment of the run.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedSegment {
    /// Start, s.
    pub start_s: f64,
    /// Duration, s.
    pub duration_s: f64,
    /// Its motion and its course of the drive, in words.
    pub what: String,
}

/// Largest values of the run, by differences of its samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reached {
    /// Displacement to either side, m.
    pub stroke_m: f64,
    /// Speed, m/s.
    pub speed_m_s: f64,
    /// Acceleration, m/s².
    pub acceleration_m_s2: f64,
    /// Smallest and largest drive; `None` without a drive.
    pub drive: Option<[f64; 2]>,
}

/// A designed run.
#[derive(Debug, Clone, PartialEq)]
pub struct Design {
    /// Displacement and drive of the run. It has no force.
    pub run: Run,
    /// The road that the design is compared with, at 512 Hz.
    pub road: Run,
    /// The pairs, the least separated one first.
    pub pairs: Vec<Pair>,
    /// The segments in order.
    pub segments: Vec<PlannedSegment>,
    /// The largest values of the run.
    pub reached: Reached,
    /// Noise and misfit that the figures assume, root mean square, N.
    pub noise_n: f64,
    /// Its source.
    pub noise_source: NoiseSource,
    /// Time in which the damper moves, s.
    pub moving_s: f64,
    /// End of the part that serves as training run, s; the rest serves as validation run. `None` if the run is too short for parts.
    pub split_s: Option<f64>,
    /// Rise of the case temperature over the run that the figures assume, K; `None` if no effect needs a temperature.
    pub assumed_rise_k: Option<f64>,
}

impl Design {
    /// The pair with the least expected discrimination; `None` without pairs.
    #[must_use]
    pub fn least(&self) -> Option<&Pair> {
        self.pairs.first()
    }
}
