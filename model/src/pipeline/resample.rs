//! Resampling: the seeded channel's history on the model's own period, when samples come at other times.
//!
//! A model that is autoregressive in force holds for one sample period T: its lags are signals at t - T, t - 2 T, ... When
//! displacements jitter or are lost, the newest samples are not at these times. The history is then interpolated between the last
//! rows:
//!
//! ```text
//! rows      ... a      b  c        k        times of the displacements
//! lags       k-4T   k-3T   k-2T   k-T  k    times of the history
//! ```
//!
//! Displacement is interpolated by the parabola through the two rows around a time and an older one; the drive is held. A backward
//! difference is computed from the interpolated displacements at the lags, because the model was identified with a difference over T.
//! If a gap between two samples is longer than T, rows are inserted T apart: their displacement is interpolated, and their force is
//! the measured force at that time, or else the model's prediction. Forces of a grid are replaced by measured ones where readings
//! exist.

use crate::condition::VelocitySource;
use crate::force::{DEPTH, History};

/// Number of rows that are kept: more than a publisher sends within the lags when it catches up.
const KEPT: usize = 64;
/// Share of a period within which a row counts as being at a given time.
pub(super) const SAME: f64 = 1e-3;
/// Least distance of the parabola's older row, as a share of a period: rows close together do not determine a curvature.
const APART: f64 = 0.5;
/// Displacements that a history needs: one per lag, and two more for the derivatives.
pub(super) const POINTS: usize = DEPTH + 2;

/// A conditioned sample, and its force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Row {
    /// Time since the channel's own origin, s.
    pub(super) at_s: f64,
    pub(super) displacement_m: f64,
    pub(super) velocity_m_s: f64,
    pub(super) drive: f64,
    /// Measured force, or else predicted, N; NaN if neither is known.
    pub(super) force_n: f64,
    /// The row was inserted between two samples.
    pub(super) is_between: bool,
}

impl Row {
    const NONE: Self = Self {
        at_s: f64::NAN,
        displacement_m: f64::NAN,
        velocity_m_s: f64::NAN,
        drive: f64::NAN,
        force_n: f64::NAN,
        is_between: false,
    };
}

/// The last rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rows {
    rows: [Row; KEPT],
    next: usize,
    len: usize,
}

impl Default for Rows {
    fn default() -> Self {
        Self { rows: [Row::NONE; KEPT], next: 0, len: 0 }
    }
}

impl Rows {
    #[inline]
    pub(super) fn push(&mut self, row: Row) {
        self.rows[self.next] = row;
        self.next = (self.next + 1) % KEPT;
        self.len = (self.len + 1).min(KEPT);
    }

    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    const fn slot(&self, age: usize) -> usize {
        (self.next + KEPT - 1 - age) % KEPT
    }

    fn get(&self, age: usize) -> Option<&Row> {
        (age < self.len).then(|| &self.rows[self.slot(age)])
    }

    pub(super) fn newest(&self) -> Option<Row> {
        self.get(0).copied()
    }

    /// Sets the force of the newest row.
    #[inline]
    pub(super) fn set_newest_force(&mut self, force_n: f64) {
        if self.len > 0 {
            let slot = self.slot(0);
            self.rows[slot].force_n = force_n;
        }
    }

    /// Sets the force of the sample that is `age` samples older than the newest.
    #[inline]
    pub(super) fn seed(&mut self, age: usize, force_n: f64) {
        let mut samples = 0;
        for row_age in age..self.len {
            if row_age == age {
                samples = (0..age).filter(|before| !self.rows[self.slot(*before)].is_between).count();
            }
            let slot = self.slot(row_age);
            if self.rows[slot].is_between {
                continue;
            }
            if samples == age {
                self.rows[slot].force_n = force_n;
                return;
            }
            samples += 1;
        }
    }

    /// Clears all forces, so that only measured ones can make a history again.
    pub(super) fn forget_forces(&mut self) {
        for row in &mut self.rows {
            row.force_n = f64::NAN;
        }
    }

    /// The row at `at_s`, interpolated; `None` before the first row and after the last.
    fn at(&self, at_s: f64, period_s: f64) -> Option<Row> {
        let older = (0..self.len).find(|age| self.rows[self.slot(*age)].at_s <= at_s + SAME * period_s)?;
        let a = self.get(older)?;
        if (at_s - a.at_s).abs() <= SAME * period_s {
            return Some(*a);
        }
        let b = self.get(older.checked_sub(1)?)?;
        Some(self.between(at_s, older, b, period_s))
    }

    /// The row at `at_s` between the row of age `older` and a newer one, `b`.
    fn between(&self, at_s: f64, older: usize, b: &Row, period_s: f64) -> Row {
        let a = &self.rows[self.slot(older)];
        let third = (older + 1..self.len)
            .map(|age| &self.rows[self.slot(age)])
            .find(|row| a.at_s - row.at_s >= APART * period_s);
        let curve = |of: fn(&Row) -> f64| {
            let (ya, yb) = (of(a), of(b));
            let slope = (yb - ya) / (b.at_s - a.at_s);
            let line = ya + slope * (at_s - a.at_s);
            let Some(c) = third.filter(|c| of(c).is_finite()) else { return line };
            let curvature = (slope - (ya - of(c)) / (a.at_s - c.at_s)) / (b.at_s - c.at_s);
            line + curvature * (at_s - a.at_s) * (at_s - b.at_s)
        };
        let share = (at_s - a.at_s) / (b.at_s - a.at_s);
        Row {
            at_s,
            displacement_m: curve(|row| row.displacement_m),
            velocity_m_s: a.velocity_m_s + share * (b.velocity_m_s - a.velocity_m_s),
            drive: a.drive,
            force_n: curve(|row| row.force_n),
            is_between: true,
        }
    }

    /// The row at `at_s` between the newest row and `next`, which comes after it. Its force is NaN.
    pub(super) fn towards(&self, next: &Row, at_s: f64, period_s: f64) -> Option<Row> {
        (self.len > 0).then(|| Row { force_n: f64::NAN, ..self.between(at_s, 0, next, period_s) })
    }

    /// The rows at `at_s` and at whole periods before it, newest first. Unknown values are NaN.
    pub(super) fn grid(&self, at_s: f64, period_s: f64) -> Grid {
        let mut points = [Row::NONE; POINTS];
        for (lag, point) in points.iter_mut().enumerate() {
            let lag_s = at_s - lag as f64 * period_s;
            *point = self.at(lag_s, period_s).unwrap_or(Row { at_s: lag_s, ..Row::NONE });
        }
        Grid { points, period_s }
    }
}

/// Rows at a spacing of one period, newest first.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    pub(super) points: [Row; POINTS],
    period_s: f64,
}

impl Grid {
    /// The history with the point of age `newest` as its newest sample. Unknown values are NaN.
    pub(super) fn history(&self, newest: usize, velocity: VelocitySource) -> History {
        let point = |lag: usize| self.points.get(newest + lag).copied().unwrap_or(Row::NONE);
        let x = |lag: usize| point(lag).displacement_m;
        let difference = |lag: usize| (x(lag) - x(lag + 1)) / self.period_s;
        History::of(
            std::array::from_fn(|lag| point(lag + 1).force_n),
            std::array::from_fn(x),
            std::array::from_fn(|lag| match velocity {
                VelocitySource::Backward => difference(lag),
                VelocitySource::ThreePoint => 1.5 * difference(lag) - 0.5 * difference(lag + 1),
                VelocitySource::Slope | VelocitySource::Measured => point(lag).velocity_m_s,
            }),
            std::array::from_fn(|lag| point(lag).drive),
        )
    }
}
