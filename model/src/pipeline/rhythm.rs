//! Sample rhythm: the rate of the displacements and its regularity.
//!
//! A step is even if it differs from the mean of the last ones by at most a fifth. If as many steps as a history has lags were even,
//! the samples themselves are the lags of a model. If [`Rhythm::STEPS`] in a row were even, their mean is the period. Otherwise the
//! mean contains jitter and lost samples, and only a mean that is far off counts as another rate.

use crate::force::DEPTH;

/// The rhythm of a stream of samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rhythm {
    nominal_s: f64,
    /// Mean of the last even steps, s, and their number.
    mean_s: f64,
    steps: u32,
    /// The same for all steps, over [`Self::LONG_S`].
    long_mean_s: f64,
    long_steps: u32,
    /// Even steps in a row, at most [`Self::STEPS`].
    even: u32,
}

impl Rhythm {
    /// Number of steps in the mean.
    const STEPS: u32 = 50;
    /// Time over which uneven steps are averaged, s: a publisher that pauses and catches up is a small part of it.
    const LONG_S: f64 = 0.25;
    /// Largest relative departure of an even step from the mean.
    const EVEN: f64 = 0.2;
    /// Largest relative departure of the mean from the model's period; beyond it the model's coefficients do not apply.
    const TOLERANCE: f64 = 0.05;
    /// Shortest and longest mean of uneven steps, in periods of the model. Lost samples make steps longer.
    const UNEVEN: [f64; 2] = [0.9, 1.4];

    /// A rhythm without any steps yet, for a model of period `nominal_s`.
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

    /// Takes a step of `dt_s`.
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

    /// True if the samples themselves are the lags of a model.
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
        // The effect of jitter at both ends of the averaged time.
        let jitter = 1.0 / f64::from(self.long_steps.max(1));
        let [shortest, longest] = Self::UNEVEN;
        (shortest - jitter..=longest + jitter).contains(&periods)
    }
}
