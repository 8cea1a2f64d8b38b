//! Plausibility checks: each reading is compared with the others.
//!
//! ```text
//! stuck displacement   x unchanged for T_s while |v| > V measured, or the force has moved by a tenth of its training range
//! stuck force          F unchanged while the rod has moved by a fifth of its training range
//! velocity             sum (dx - int v dt)^2 > 0.05 sum (dx^2 + (int v dt)^2)     over stretches of 0.1 s, forgetting over 1 s
//! drive                i beyond (-0.1, 1.2) i_max, or |di| > 1.5 r dt + 0.05 i_max
//! passivity            int (F - P) v dt < -0.2 int |F - P| |v| dt                 forgetting over T_p
//! ```
//!
//! | symbol | what |
//! |---|---|
//! | x, v, F, i | displacement, measured velocity, measured force, current: raw readings |
//! | T_s, T_p | [`Plausible::stuck_s`], [`Plausible::passive_window_s`] |
//! | V | [`MOVING_M_S`] |
//! | i_max, r | `current.max_a`, `current.rate_max_a_s`: limits of the driver |
//! | P | force of the model at rest: offset and gas spring |
//!
//! A limit on travel, work or the range of the drive that was passed is half as far from what is normal until the quantity is within it. So
//! a quantity that stays near a limit does not make a check toggle.
//!
//! Velocity is integrated and compared with the change of displacement, because a differentiated displacement is too noisy. Readings
//! out of a sensor's range, and jumps, do not reach these checks: the gate refuses them. A force that is stuck or drives the rod is
//! used for residuals only.

use super::event::Reasons;
use crate::elementary::exp;
use crate::error::Error;
use crate::inverse::Limits;
use crate::model::{Model, Preload};
use crate::sample::{DriveKind, Stamp};

/// Measured speed above which a rod moves, m/s.
const MOVING_M_S: f64 = 0.02;
/// Share of the force's training range: if the force changes by more, the rod moves.
const FORCE_MOVED: f64 = 0.1;
/// Share of the displacement's training range: if the rod moves by more, a load cell must have changed.
const ROD_MOVED: f64 = 0.2;
/// The same for a model without a training range, m.
const ROD_MOVED_M: f64 = 5e-3;
/// Length of the stretches over which travel is compared, s, and the time constant with which they are forgotten, s.
const STRETCH_S: f64 = 0.1;
const STRETCHES_S: f64 = 1.0;
/// Largest squared difference of the two, as a share of the sum of their squares.
const DISAGREES: f64 = 0.05;
/// Root mean square travel per stretch below which velocity is not checked, m.
const LEAST_WAY_M: f64 = 5e-4;
/// Share of the absolute work that a damper may deliver.
const GIVES: f64 = 0.2;
/// Factor of a limit that was passed, until the quantity is within it.
const RELEASE: f64 = 0.5;
/// Mean speed below which the work is not checked, m/s.
const LEAST_SPEED_M_S: f64 = 5e-3;

/// Limits of plausible readings.
///
/// ```
/// use mr_damper_model::pipeline::{Plausible, Settings};
///
/// // A stroke of 60 mm, and a load cell for 5 kN
/// let plausible = Plausible { displacement_max_m: 0.03, force_max_n: 5_000.0, ..Plausible::default() };
/// let settings = Settings { plausible, ..Settings::default() };
/// assert!(settings.validate().is_ok());
/// let error = Plausible { stuck_s: 0.0, ..plausible }.validate().unwrap_err();
/// assert_eq!(error.to_string(), "plausible.stuck_s is 0, but must be above 0 and at most 1e9");
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plausible {
    /// Largest displacement either way, m. Larger ones are refused.
    pub displacement_max_m: f64,
    /// Largest speed of the rod, m/s. A measured speed above it is refused. So is a displacement that would need a higher speed,
    /// until three in a row agree.
    pub speed_max_m_s: f64,
    /// Largest force either way, N. Larger ones are refused, measured or requested.
    pub force_max_n: f64,
    /// Time without change after which displacement is stuck, s.
    pub stuck_s: f64,
    /// Time constant with which the work of the damper is forgotten, s.
    pub passive_window_s: f64,
}

impl Default for Plausible {
    fn default() -> Self {
        Self {
            displacement_max_m: 1.0,
            speed_max_m_s: 5.0,
            force_max_n: 1e5,
            stuck_s: 0.1,
            passive_window_s: 2.0,
        }
    }
}

impl Plausible {
    /// Checks that every number lies in its range.
    ///
    /// # Errors
    /// Names the setting, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        let above =
            |name, value| Error::check(name, value, "above 0 and at most 1e9", |x| x > 0.0 && x <= 1e9);
        above("plausible.displacement_max_m", self.displacement_max_m)?;
        above("plausible.speed_max_m_s", self.speed_max_m_s)?;
        above("plausible.force_max_n", self.force_max_n)?;
        above("plausible.stuck_s", self.stuck_s)?;
        above("plausible.passive_window_s", self.passive_window_s)?;
        Ok(())
    }
}

/// Number of equal readings in a row from which a signal may be stuck.
const EQUAL: u32 = 5;

/// Properties of the damper that the checks use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DamperProperties {
    /// Widths of the training ranges, m and N; NaN if not known.
    pub(super) stroke_m: f64,
    pub(super) forces_n: f64,
    /// Limits of the driver, A and A/s; infinite if the drive is not a current.
    pub(super) current_max_a: f64,
    pub(super) current_rate_a_s: f64,
    /// Force at rest.
    pub(super) preload: Preload,
}

impl DamperProperties {
    /// The properties from `model` and the driver's limits.
    pub(super) fn of(model: &Model, limits: &Limits) -> Self {
        let width = |range: Option<[f64; 2]>| range.map_or(f64::NAN, |[low, high]| high - low);
        let is_current = model.force.drive() == Some(DriveKind::CoilCurrent);
        Self {
            stroke_m: width(model.envelope.displacement_m),
            forces_n: width(model.envelope.force_n),
            current_max_a: if is_current { limits.current_max_a } else { f64::INFINITY },
            current_rate_a_s: limits.rate_max_a_s,
            preload: model.preload(),
        }
    }
}

/// The checks of one damper's readings.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct PlausibilityChecks {
    displacement: StuckCheck,
    force: StuckCheck,
    travel: Travel,
    work: AbsorbedWork,
    drive_odd: bool,
}

/// A reading that may be stuck, and how far another one has moved meanwhile.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct StuckCheck {
    last: Option<f64>,
    since: Stamp,
    /// Readings since then.
    count: u32,
    /// Range of the other reading since then.
    other: Option<[f64; 2]>,
    /// Largest measured speed since then, m/s.
    speed_m_s: f64,
}

impl StuckCheck {
    /// Takes a reading; any change from the last one restarts the count.
    fn see(&mut self, stamp: Stamp, value: f64) {
        if self.last != Some(value) {
            *self = Self { last: Some(value), since: stamp, ..Self::default() };
        }
        self.count = self.count.saturating_add(1);
    }

    fn see_other(&mut self, value: f64) {
        let [low, high] = self.other.unwrap_or([value; 2]);
        self.other = Some([low.min(value), high.max(value)]);
    }

    fn other_moved(&self) -> f64 {
        self.other.map_or(0.0, |[low, high]| high - low)
    }
}

/// Travel by displacement and by measured velocity.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Travel {
    /// Where and when the stretch began.
    begin: Option<(Stamp, f64)>,
    by_velocity_m: f64,
    /// Sums of squares with exponential forgetting, and their weight.
    apart: f64,
    both: f64,
    weight: f64,
    disagrees: bool,
}

impl Travel {
    fn see(&mut self, stamp: Stamp, dt_s: f64, displacement_m: f64, velocity_m_s: f64) {
        let Some((begin, from_m)) = self.begin else {
            self.begin = Some((stamp, displacement_m));
            return;
        };
        self.by_velocity_m += velocity_m_s * dt_s;
        let stretch_s = stamp.since(begin).get();
        if stretch_s < STRETCH_S {
            return;
        }
        let (way_m, keep) = (displacement_m - from_m, exp(-stretch_s / STRETCHES_S));
        self.apart = keep * self.apart + (way_m - self.by_velocity_m).powi(2);
        self.both = keep * self.both + way_m.powi(2) + self.by_velocity_m.powi(2);
        self.weight = keep * self.weight + 1.0;
        (self.begin, self.by_velocity_m) = (Some((stamp, displacement_m)), 0.0);
        let factor = factor(self.disagrees);
        self.disagrees = self.weight >= 3.0
            && self.both > factor * self.weight * LEAST_WAY_M.powi(2)
            && self.apart > factor * DISAGREES * self.both;
    }

    /// Discards the present stretch, because velocity is missing or history restarts.
    fn breaks(&mut self) {
        (self.begin, self.by_velocity_m) = (None, 0.0);
    }
}

/// Factor of a limit; `passed` says whether the quantity was beyond it so far.
const fn factor(passed: bool) -> f64 {
    if passed { RELEASE } else { 1.0 }
}

/// Work that the damper absorbs, with exponential forgetting.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct AbsorbedWork {
    taken_j: f64,
    to_and_fro_j: f64,
    way_m: f64,
    time_s: f64,
    /// True if the damper drives the rod.
    gives: bool,
}

impl AbsorbedWork {
    fn see(&mut self, dt_s: f64, force_n: f64, velocity_m_s: f64, window_s: f64) {
        let keep = exp(-dt_s / window_s);
        let power_w = force_n * velocity_m_s;
        self.taken_j = keep * self.taken_j + power_w * dt_s;
        self.to_and_fro_j = keep * self.to_and_fro_j + power_w.abs() * dt_s;
        self.way_m = keep * self.way_m + velocity_m_s.abs() * dt_s;
        self.time_s = keep * self.time_s + dt_s;
        let factor = factor(self.gives);
        self.gives = self.time_s > 0.3 * window_s
            && self.way_m > factor * LEAST_SPEED_M_S * self.time_s
            && self.taken_j < -factor * GIVES * self.to_and_fro_j;
    }
}

/// A displacement with its time step and velocity.
pub(super) struct CheckedDisplacement {
    pub(super) stamp: Stamp,
    pub(super) dt_s: Option<f64>,
    pub(super) displacement_m: f64,
    /// Measured velocity, if it is fresh.
    pub(super) velocity_m_s: Option<f64>,
}

impl PlausibilityChecks {
    /// Takes a current in A and the one before it, if there is one. A voltage is never odd.
    #[inline]
    pub(super) fn drive(
        &mut self,
        stamp: Stamp,
        current_a: f64,
        before: Option<(Stamp, f64)>,
        damper: &DamperProperties,
    ) {
        let most_a = damper.current_max_a;
        let factor = factor(self.drive_odd);
        let beyond = !(-0.1 * factor * most_a..=(1.0 + 0.2 * factor) * most_a).contains(&current_a);
        let jumps = before.is_some_and(|(at, last_a)| {
            let can_a = 1.5 * damper.current_rate_a_s * stamp.since(at).get() + 0.05 * most_a;
            (current_a - last_a).abs() > can_a
        });
        self.drive_odd = most_a.is_finite() && (beyond || jumps);
    }

    /// Takes a measured force.
    #[inline]
    pub(super) fn force(&mut self, stamp: Stamp, force_n: f64) {
        self.force.see(stamp, force_n);
        self.displacement.see_other(force_n);
    }

    /// Takes a displacement.
    #[inline]
    pub(super) fn displacement(&mut self, seen: &CheckedDisplacement) {
        self.displacement.see(seen.stamp, seen.displacement_m);
        self.force.see_other(seen.displacement_m);
        match (seen.velocity_m_s, seen.dt_s) {
            (Some(velocity_m_s), Some(dt_s)) => {
                self.displacement.speed_m_s = self.displacement.speed_m_s.max(velocity_m_s.abs());
                self.travel.see(seen.stamp, dt_s, seen.displacement_m, velocity_m_s);
            }
            _ => self.travel.breaks(),
        }
    }

    /// Takes the force minus its value at rest, measured at a sample, with the model's velocity at that sample.
    #[inline]
    pub(super) fn work(&mut self, dt_s: f64, force_n: f64, velocity_m_s: f64, plausible: &Plausible) {
        self.work.see(dt_s, force_n, velocity_m_s, plausible.passive_window_s);
    }

    /// True while measured force is stuck or drives the rod: it may then be used for residuals only.
    #[inline]
    pub(super) fn force_is_odd(&self, damper: &DamperProperties) -> bool {
        self.force_is_stuck(damper) || self.work.gives
    }

    fn force_is_stuck(&self, damper: &DamperProperties) -> bool {
        let enough_m = if damper.stroke_m > 0.0 { ROD_MOVED * damper.stroke_m } else { ROD_MOVED_M };
        self.force.count >= EQUAL && self.force.other_moved() > enough_m
    }

    /// The implausible readings at `now`.
    #[inline]
    pub(super) fn reasons(&self, now: Stamp, damper: &DamperProperties, plausible: &Plausible) -> Reasons {
        let mut reasons = Reasons::NONE;
        let still =
            self.displacement.count >= EQUAL && now.since(self.displacement.since).get() >= plausible.stuck_s;
        let others_move = self.displacement.speed_m_s > MOVING_M_S
            || self.displacement.other_moved() > FORCE_MOVED * damper.forces_n;
        if (still && others_move) || self.force_is_stuck(damper) {
            reasons |= Reasons::SENSOR_STUCK;
        }
        if self.travel.disagrees {
            reasons |= Reasons::VELOCITY_DISAGREES;
        }
        if self.drive_odd {
            reasons |= Reasons::DRIVE_IMPLAUSIBLE;
        }
        if self.work.gives {
            reasons |= Reasons::NOT_PASSIVE;
        }
        reasons
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PER_S: f64 = 500.0;

    fn changes(values: impl IntoIterator<Item = bool>) -> usize {
        let values: Vec<bool> = values.into_iter().collect();
        values.windows(2).filter(|pair| pair[0] != pair[1]).count()
    }

    /// A limit that a quantity crosses again and again; each check changes once and stays.
    #[test]
    fn a_quantity_near_its_limit_does_not_make_a_check_toggle() {
        // The damper gives back about a fifth of its work, a little more and a little less in turn.
        let (mut work, mut taken) = (AbsorbedWork::default(), 0.0);
        let gives = (0..20_000).map(|k| {
            let share = GIVES + 0.05 * (f64::from(k) / 1000.0).sin();
            // Force and velocity agree in sign in this part of the samples.
            taken += 0.5 * (1.0 - share);
            let force_n = if taken >= 1.0 { 100.0 } else { -100.0 };
            taken %= 1.0;
            work.see(1.0 / PER_S, force_n, 0.1, 2.0);
            work.gives
        });
        assert_eq!(changes(gives), 1);

        let model = crate::preset::load(crate::preset::BEST_FUZZY_TANH).expect("a preset");
        let damper = DamperProperties {
            current_max_a: 2.0,
            current_rate_a_s: f64::INFINITY,
            ..DamperProperties::of(&model, &Limits::default())
        };
        let mut checks = PlausibilityChecks::default();
        let odd = (0..100).map(|k| {
            let current_a = if k % 2 == 0 { 2.39 } else { 2.41 };
            checks.drive(Stamp::from_nanos(k), current_a, None, &damper);
            checks.drive_odd
        });
        assert_eq!(changes(odd), 1);
        checks.drive(Stamp::from_nanos(100), 2.1, None, &damper);
        assert!(!checks.drive_odd, "well within the range");

        // A velocity that is too large by a share that changes about the limit.
        let mut travel = Travel::default();
        let disagrees = (0..20_000).map(|k| {
            let seconds = f64::from(k) / PER_S;
            let gain = 1.38 + 0.04 * (0.5 * seconds).sin();
            travel.see(Stamp::from_nanos(i64::from(k) * 2_000_000), 1.0 / PER_S, 0.1 * seconds, 0.1 * gain);
            travel.disagrees
        });
        assert_eq!(changes(disagrees), 1);
    }
}
