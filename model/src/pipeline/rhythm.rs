//! How displacements come: at which rate, and how evenly.
//!
//! A step is even when it differs from the mean of the last ones by no more than a fifth. While the last steps were even, as many as a
//! history has lags, the samples themselves are the lags of a model. While they were even for longer, their mean is the
//! period. Otherwise jitter and lost samples are in the mean, and only a rate that is far off is another one.

use crate::force::DEPTH;

/// The rhythm of a stream of samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rhythm {
    nominal_s: f64,
    /// Mean of the last even steps, s, and how many it is the mean of.
    mean_s: f64,
    steps: u32,
    /// The same of all steps, over [`Self::LONG_S`].
    long_mean_s: f64,
    long_steps: u32,
    /// Even steps in a row, at most [`Self::STEPS`].
    even: u32,
}

impl Rhythm {
    /// Steps that the mean is taken over.
    const STEPS: u32 = 50;
    /// The time that the mean of uneven steps is taken over, s: a publisher that stands still and catches up is a small part of it.
    const LONG_S: f64 = 0.25;
    /// Departure of a step from the mean up to which it is even.
    const EVEN: f64 = 0.2;
    /// Departure of the mean from the model's period beyond which its coefficients mean nothing.
    const TOLERANCE: f64 = 0.05;
    /// Shortest and longest mean of uneven steps, in periods of the model. Lost samples make steps longer.
    const UNEVEN: [f64; 2] = [0.9, 1.4];

    /// A rhythm of which nothing was seen, for a model of period `nominal_s`.
    pub(super) const fn new(nominal_s: f64) -> Self {
        Self {
            nominal_s,
            mean_s: nominal_s,
            steps: 0,
            long_mean_s: nominal_s,
            long_steps: 0,
            even: Self::STEPS,
        }
    }

    /// Period of the model, s.
    pub(super) const fn nominal_s(&self) -> f64 {
        self.nominal_s
    }

    /// Takes a step.
    #[inline]
    pub(super) fn see(&mut self, dt_s: f64) {
        let is_even = self.steps == 0 || (dt_s / self.mean_s - 1.0).abs() <= Self::EVEN;
        self.even = if is_even { (self.even + 1).min(Self::STEPS) } else { 0 };
        if is_even {
            self.steps = (self.steps + 1).min(Self::STEPS);
            self.mean_s += (dt_s - self.mean_s) / f64::from(self.steps);
        } else {
            self.steps = 0;
        }
        let most = ((Self::LONG_S / self.nominal_s) as u32).max(Self::STEPS);
        self.long_steps = (self.long_steps + 1).min(most);
        self.long_mean_s += (dt_s - self.long_mean_s) / f64::from(self.long_steps);
    }

    /// True when the samples themselves are the lags of a model.
    pub(super) const fn is_even(&self) -> bool {
        self.even >= DEPTH as u32
    }

    /// True when samples come at the model's rate.
    #[inline]
    pub(super) fn is_at_rate(&self) -> bool {
        if self.even == Self::STEPS {
            return (self.mean_s / self.nominal_s - 1.0).abs() <= Self::TOLERANCE;
        }
        let periods = self.long_mean_s / self.nominal_s;
        // The jitter at both ends of so many steps.
        let jitter = 1.0 / f64::from(self.long_steps.max(1));
        let [shortest, longest] = Self::UNEVEN;
        (shortest - jitter..=longest + jitter).contains(&periods)
    }
}
