//! How far the estimate may be off, by mode.
//!
//! | mode | standard deviation and 90 % band |
//! |---|---|
//! | `arx`, `arx_coast` | one step of the seeded model, growing with the time since the newest measured force |
//! | `model` | free run of the free model |
//! | `hold` | the last one's, within [`HOLD_S`] growing to all that the training forces reached |
//! | `fault` | none |
//!
//! All but `hold` grow with the age of the drive. The band is the one of what the mode's model says. Right after a change of
//! mode the estimate is elsewhere ([`super::bump`]): the band is stretched to hold it, and the step that is left adds
//! to the standard deviation. A model without calibration gives the RSSE of its identification, and the band
//! that a normal distribution has with it.

use super::event::Reasons;
use super::mode::Mode;
use super::{Pipeline, lane};
use crate::force::DEPTH;
use crate::model::Model;
use crate::sample::Stamp;
use crate::uncertainty::{NORMAL_HALF_BAND, Operating, Predictor, Spread};

/// Reasons for which the model is not where it was calibrated, or its inputs are not what they say.
pub(crate) const BEYOND_CALIBRATION: Reasons = Reasons(
    Reasons::OUTSIDE_ENVELOPE.0
        | Reasons::SETTLING.0
        | Reasons::TEMPERATURE_MISSING.0
        | Reasons::SENSOR_STUCK.0
        | Reasons::VELOCITY_DISAGREES.0
        | Reasons::DRIVE_IMPLAUSIBLE.0,
);

/// Time in which a damper's force can become any other, s: a quarter of a slow stroke. A drive that is lost holds an
/// estimate at once; silence of displacement is noticed later than this.
const HOLD_S: f64 = 0.1;

/// The newest measured force from which on the seeded lane has a history of nothing but measured ones.
///
/// When force comes back, the lags behind it are still the model's own predictions, and its next predictions are no
/// better than while it coasted.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Seeds {
    index: u64,
    unbroken: usize,
    newest: Option<Stamp>,
}

impl Seeds {
    /// Force was measured at `stamp`, the one of displacement number `index`.
    #[inline]
    pub(super) fn add(&mut self, index: u64, stamp: Stamp) {
        self.unbroken = if index == self.index.wrapping_add(1) { (self.unbroken + 1).min(DEPTH) } else { 1 };
        self.index = index;
        if self.unbroken == DEPTH {
            self.newest = Some(stamp);
        }
    }
}

/// How far an estimate may be off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Doubt {
    pub(super) std_dev_n: f64,
    pub(super) band_n: [f64; 2],
    pub(super) calibrated: bool,
}

impl Doubt {
    /// Nothing is known.
    pub(super) const NONE: Self = Self { std_dev_n: f64::NAN, band_n: [f64::NAN; 2], calibrated: false };

    /// `force_n` is put out where the model says `force_n - bump_n`.
    fn around(force_n: f64, bump_n: f64, spread: Spread) -> Self {
        let (model_n, half_n) = (force_n - bump_n, spread.half_band_n);
        Self {
            std_dev_n: spread.std_dev_n.hypot(bump_n),
            band_n: [(model_n - half_n).min(force_n), (model_n + half_n).max(force_n)],
            calibrated: spread.calibrated,
        }
    }

    /// `force_n` is held since `held_s`, and the training forces lie within `range_n`, as likely anywhere in it.
    fn held(self, force_n: f64, range_n: Option<[f64; 2]>, held_s: f64) -> Self {
        let Some([low_n, high_n]) = range_n.filter(|_| force_n.is_finite()) else { return Self::NONE };
        let share = (held_s / HOLD_S).clamp(0.0, 1.0);
        let [last_low_n, last_high_n] = self.band_n;
        let off_n = ((high_n - low_n) / 12.0_f64.sqrt()).hypot(force_n - 0.5 * (low_n + high_n));
        Self {
            // `max` and `min` take the other number where the last one was not known.
            std_dev_n: (self.std_dev_n.max(0.0)).hypot(share * off_n),
            band_n: [
                last_low_n.min(force_n + share * (low_n - force_n).min(0.0)),
                last_high_n.max(force_n + share * (high_n - force_n).max(0.0)),
            ],
            calibrated: false,
        }
    }
}

impl Pipeline {
    /// Where a lane was at the last displacement; `None` before the first, and for a lane that there is not.
    #[must_use]
    pub(crate) const fn operating(&self, predictor: Predictor) -> Option<Operating> {
        match predictor {
            Predictor::FreeRun => self.free_at,
            Predictor::OneStep => self.seeded_at,
        }
    }

    /// Notes where the lanes are at `stamp`. Call it before the force of that stamp is taken in.
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
        let seeded_at = self.seeded.as_ref().map(|lane| at(Predictor::OneStep, lane.velocity_m_s()));
        (self.free_at, self.seeded_at) = (Some(free_at), seeded_at);
    }

    /// How far `force_n`, put out in `mode` at `stamp`, may be off.
    pub(super) fn doubt(&self, stamp: Stamp, force_n: f64, mode: Mode, reasons: Reasons) -> Doubt {
        let free_n = self.free.expected_rsse_n();
        let by_lane = |model: Option<&Model>, at: Option<Operating>, expected_n: Option<f64>| {
            let calibrated = at.and_then(|at| model?.expected.uncertainty.as_ref()?.spread(&at));
            let guess = |std_dev_n| Spread {
                std_dev_n,
                half_band_n: NORMAL_HALF_BAND * std_dev_n,
                calibrated: false,
            };
            let spread = calibrated.or_else(|| expected_n.map(guess));
            let doubt = spread.map_or(Doubt::NONE, |s| Doubt::around(force_n, self.bump.offset_n(), s));
            Doubt { calibrated: doubt.calibrated && !reasons.any(BEYOND_CALIBRATION), ..doubt }
        };
        let seeded = self.seeded.as_ref();
        let one_step_n = seeded.and_then(lane::SeededLane::expected_rsse_n);
        match mode {
            Mode::Arx => by_lane(seeded.map(lane::SeededLane::model), self.seeded_at, one_step_n),
            // Without calibration, a coasting ARX is somewhere between: the free-running figure is the careful one.
            Mode::ArxCoast => by_lane(seeded.map(lane::SeededLane::model), self.seeded_at, free_n),
            Mode::Model => by_lane(Some(self.free.model()), self.free_at, free_n),
            Mode::Hold => {
                let lost = reasons.has(Reasons::DISPLACEMENT_LOST);
                let held_s = if lost { HOLD_S } else { self.machine.seconds_in_mode(stamp) };
                self.last_doubt.held(force_n, self.free.model().envelope.force_n, held_s)
            }
            Mode::Fault => Doubt::NONE,
        }
    }
}
