//! Uncertainty of the estimate, by mode.
//!
//! | mode | standard deviation and 90 % band |
//! |---|---|
//! | `arx`, `arx_coast` | seeded model, one step ahead, growing with the time since the newest measured force |
//! | `model` | simulation (free run) of the free-run model |
//! | `hold` | uncertainty of the last estimate, growing within [`HOLD_S`] to the whole range of the training forces |
//! | `fault` | none |
//!
//! In all modes but `hold`, the uncertainty also grows with the age of the drive. The band belongs to the output of the
//! mode's model. Right after a change of mode the estimate differs from that output ([`super::bump`]): the band is extended
//! to contain the estimate, and the remaining offset adds to the standard deviation. Without a calibration, the standard
//! deviation is the RMSE of the model's identification, and the band follows from a normal distribution.

use super::Pipeline;
use super::event::Reasons;
use super::mode::Mode;
use super::model_channel::SeededChannel;
use crate::elementary::hypot;
use crate::force::DEPTH;
use crate::model::Model;
use crate::sample::Stamp;
use crate::uncertainty::{NORMAL_HALF_BAND, Operating, Predictor, Spread};

/// Reasons that put the model outside its calibration: it is outside the calibrated range, or its inputs are implausible.
pub(crate) const BEYOND_CALIBRATION: Reasons = Reasons(
    Reasons::OUTSIDE_ENVELOPE.0
        | Reasons::SETTLING.0
        | Reasons::TEMPERATURE_MISSING.0
        | Reasons::SENSOR_STUCK.0
        | Reasons::VELOCITY_DISAGREES.0
        | Reasons::DRIVE_IMPLAUSIBLE.0,
);

/// Time in which a damper's force can change to any other value, s: a quarter of a slow stroke. If the drive is lost, the
/// estimate is held at once; lost displacement is noticed later than this.
const HOLD_S: f64 = 0.1;

/// The newest measured force at which the whole history of the seeded channel was measured.
///
/// When measured force returns, the older lags are still the model's own predictions. The next predictions are then as
/// uncertain as while the channel coasted.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Seeds {
    index: u64,
    unbroken: usize,
    newest: Option<Stamp>,
}

impl Seeds {
    /// Notes that force was measured at `stamp`, the stamp of displacement number `index`.
    #[inline]
    pub(super) fn add(&mut self, index: u64, stamp: Stamp) {
        self.unbroken = if index == self.index.wrapping_add(1) { (self.unbroken + 1).min(DEPTH) } else { 1 };
        self.index = index;
        if self.unbroken == DEPTH {
            self.newest = Some(stamp);
        }
    }
}

/// Uncertainty of an estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EstimateUncertainty {
    pub(super) std_dev_n: f64,
    pub(super) band_n: [f64; 2],
    pub(super) calibrated: bool,
}

impl EstimateUncertainty {
    /// The uncertainty is not known.
    pub(super) const NONE: Self = Self { std_dev_n: f64::NAN, band_n: [f64::NAN; 2], calibrated: false };

    /// Uncertainty of the output `force_n`, where the model's own force is `force_n - bump_n`.
    fn around(force_n: f64, bump_n: f64, spread: Spread) -> Self {
        let (model_n, half_n) = (force_n - bump_n, spread.half_band_n);
        Self {
            std_dev_n: hypot(spread.std_dev_n, bump_n),
            band_n: [(model_n - half_n).min(force_n), (model_n + half_n).max(force_n)],
            calibrated: spread.calibrated,
        }
    }

    /// Uncertainty of a force that has been held for `held_s`. The force is taken as uniformly distributed over the training
    /// range `range_n`.
    fn held(self, force_n: f64, range_n: Option<[f64; 2]>, held_s: f64) -> Self {
        let Some([low_n, high_n]) = range_n.filter(|_| force_n.is_finite()) else { return Self::NONE };
        let share = (held_s / HOLD_S).clamp(0.0, 1.0);
        let [last_low_n, last_high_n] = self.band_n;
        let off_n = hypot((high_n - low_n) / 12.0_f64.sqrt(), force_n - 0.5 * (low_n + high_n));
        Self {
            // `max` and `min` return the other number if the last value is NaN.
            std_dev_n: hypot(self.std_dev_n.max(0.0), share * off_n),
            band_n: [
                last_low_n.min(force_n + share * (low_n - force_n).min(0.0)),
                last_high_n.max(force_n + share * (high_n - force_n).max(0.0)),
            ],
            calibrated: false,
        }
    }
}

impl Pipeline {
    /// Operating point of a channel at the last displacement; `None` before the first, and for a channel that does not
    /// exist.
    #[must_use]
    pub(crate) const fn operating(&self, predictor: Predictor) -> Option<Operating> {
        match predictor {
            Predictor::FreeRun => self.free_at,
            Predictor::OneStep => self.seeded_at,
        }
    }

    /// Notes the operating points of the channels at `stamp`. Call it before the force of that stamp is processed.
    pub(super) fn note_operating(&mut self, stamp: Stamp) {
        let drive = self.drive.at(stamp);
        let at = |predictor, velocity_m_s| Operating {
            predictor,
            velocity_m_s,
            drive: drive.map_or(f64::NAN, |(_, drive)| drive),
            coast_s: self.seeds.newest.map_or(f64::NAN, |at| stamp.since(at).get()),
            drive_age_s: drive.map_or(f64::NAN, |(at, _)| stamp.since(at).get()),
        };
        let free_at = at(Predictor::FreeRun, self.free.velocity_m_s());
        let seeded_at = self.seeded.as_ref().map(|channel| at(Predictor::OneStep, channel.velocity_m_s()));
        (self.free_at, self.seeded_at) = (Some(free_at), seeded_at);
    }

    /// Uncertainty of the output `force_n` in `mode` at `stamp`.
    pub(super) fn uncertainty(
        &self,
        stamp: Stamp,
        force_n: f64,
        mode: Mode,
        reasons: Reasons,
    ) -> EstimateUncertainty {
        let free_n = self.free.expected_rsse_n();
        let by_channel = |model: Option<&Model>, at: Option<Operating>, expected_n: Option<f64>| {
            let calibrated = at.and_then(|at| model?.expected.uncertainty.as_ref()?.spread(&at));
            let guess = |std_dev_n| Spread {
                std_dev_n,
                half_band_n: NORMAL_HALF_BAND * std_dev_n,
                calibrated: false,
            };
            let spread = calibrated.or_else(|| expected_n.map(guess));
            let uncertainty = spread.map_or(EstimateUncertainty::NONE, |s| {
                EstimateUncertainty::around(force_n, self.bump.offset_n(), s)
            });
            EstimateUncertainty {
                calibrated: uncertainty.calibrated && !reasons.any(BEYOND_CALIBRATION),
                ..uncertainty
            }
        };
        let seeded = self.seeded.as_ref();
        let one_step_n = seeded.and_then(SeededChannel::expected_rsse_n);
        match mode {
            Mode::Arx => by_channel(seeded.map(SeededChannel::model), self.seeded_at, one_step_n),
            // A coasting ARX model has an error between prediction and simulation. Without calibration the larger figure,
            // the simulation's, is used.
            Mode::ArxCoast => by_channel(seeded.map(SeededChannel::model), self.seeded_at, free_n),
            Mode::Model => by_channel(Some(self.free.model()), self.free_at, free_n),
            Mode::Hold => {
                let lost = reasons.has(Reasons::DISPLACEMENT_LOST);
                // The force has been held since the last estimate, also through a gap before this mode began.
                let since_s = self.last_estimated.map_or(HOLD_S, |at| stamp.since(at).get());
                let held_s = if lost { HOLD_S } else { since_s };
                self.last_uncertainty.held(force_n, self.free.model().envelope.force_n, held_s)
            }
            Mode::Fault => EstimateUncertainty::NONE,
        }
    }
}
