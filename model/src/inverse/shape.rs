//! Checks whether a model's force is monotonic in the current, which the search for a current needs.
//!
//! ```text
//! s F(i, x, v) >= s F(j, x, v) for i > j,   s = sign (F(i_max, x, v) - F(0, x, v))
//! ```
//!
//! The condition is checked on a grid of displacement, velocity and current within the model's envelope. A model with memory reaches
//! each point at constant velocity and with the current on, for long enough to forget its initial state. A fall of at most a
//! hundredth of the model's largest force counts as rounding of fitted coefficients; a larger fall is a fold. The sign s may differ
//! from point to point: just after a reversal, the force of a damper with hysteresis still acts along the motion.
//!
//! If the force lies on the straight line from F(0) to F(i_max) at every tested point, to rounding, it is linear in the current at
//! each motion, and the current for a force has a closed form, see [`super::Solver`]. This is tested along a sine, which covers both
//! branches of a hysteresis loop with the model's state on each.

use super::cycle::{Cycle, CyclePoints};
use super::prepare;
use crate::effect::{Augmented, AugmentedState, REFERENCE_TEMP_C};
use crate::force::Inputs;
use crate::model::Model;

/// Number of currents of the grid.
const CURRENTS: usize = 26;
/// Displacements of the grid, as shares of the range.
const DISPLACEMENTS: [f64; 3] = [0.1, 0.5, 0.9];
/// Velocities of the grid, as shares of the larger end.
const VELOCITIES: [f64; 6] = [0.1, 0.3, 0.7, -0.1, -0.3, -0.7];
/// Samples of motion before each point.
const APPROACH: usize = 48;
/// Largest fall that counts as rounding, as a share of the model's largest force.
const ROUNDING: f64 = 0.01;
/// Largest distance from a line that counts as straight, as a share of the model's largest force.
const STRAIGHT: f64 = 1e-9;
/// Currents at which straightness is tested, as shares of the largest.
const ALONG_LINE: [f64; 4] = [0.2, 0.4, 0.6, 0.8];
/// If the current changes the force by less than this share of the model's largest force, it counts as ineffective.
pub(super) const HARDLY: f64 = 0.01;

/// The range of motion of the checks: the model's envelope or, without one, the range of a damper of a seat or a small vehicle.
pub(super) struct Bounds {
    /// Ends of the stroke, m.
    pub(super) stroke_m: [f64; 2],
    /// Larger end of the velocity, m/s.
    pub(super) fastest_m_s: f64,
    /// Sample rate, Hz.
    pub(super) rate_hz: f64,
}

impl Bounds {
    pub(super) fn of(model: &Model) -> Self {
        let fastest_m_s = |[low, high]: [f64; 2]| high.abs().max(low.abs());
        Self {
            stroke_m: model.envelope.displacement_m.unwrap_or([-0.015, 0.015]),
            fastest_m_s: model.envelope.velocity_m_s.map_or(0.2, fastest_m_s),
            rate_hz: if model.rate_hz > 0.0 { model.rate_hz } else { 512.0 },
        }
    }
}

/// A place where the force turns back as the current grows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fold {
    /// Displacement, m.
    pub displacement_m: f64,
    /// Velocity, m/s.
    pub velocity_m_s: f64,
    /// Current above which it turns back, A.
    pub current_a: f64,
    /// Fall of the force, N.
    pub fall_n: f64,
}

/// Shape of a model's force over the current.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// Largest force on the grid, N.
    pub most_n: f64,
    /// The deepest fold; `None` if the force is monotonic.
    pub fold: Option<Fold>,
    /// Largest distance of the force at one motion from the straight line between the forces at zero and at the largest current, N;
    /// infinite if one of them is not finite.
    pub bend_n: f64,
    /// Number of grid points with a finite force, and number of all grid points.
    pub points: [usize; 2],
}

impl Shape {
    /// Checks `model` from zero current to `current_max_a`.
    #[must_use]
    pub fn of(model: &Model, current_max_a: f64) -> Self {
        let Bounds { stroke_m: [low_m, high_m], fastest_m_s, rate_hz } = Bounds::of(model);
        let dt_s = 1.0 / rate_hz;
        let augmented = model.augmented();
        let mut shape = Self { most_n: 0.0, fold: None, bend_n: 0.0, points: [0; 2] };
        for displacement_m in DISPLACEMENTS.map(|share| low_m + share * (high_m - low_m)) {
            for velocity_m_s in VELOCITIES.map(|share| share * fastest_m_s) {
                let force_n = |current_a| arrive(&augmented, displacement_m, velocity_m_s, current_a, dt_s);
                shape.look(displacement_m, velocity_m_s, current_max_a, force_n);
            }
        }
        if shape.has_force() {
            shape.bend_n = bend_n(model, current_max_a);
        }
        shape
    }

    fn look(
        &mut self,
        displacement_m: f64,
        velocity_m_s: f64,
        current_max_a: f64,
        force_n: impl Fn(f64) -> Option<f64>,
    ) {
        let grid = (0..CURRENTS).map(|step| current_max_a * step as f64 / (CURRENTS - 1) as f64);
        let points: Vec<(f64, f64)> =
            grid.filter_map(|current_a| Some((current_a, force_n(current_a)?))).collect();
        self.points = [self.points[0] + points.len(), self.points[1] + CURRENTS];
        let (Some(first), Some(last)) = (points.first(), points.last()) else { return };
        let way = (last.1 - first.1).signum();
        let mut top = *first;
        for point in &points {
            self.most_n = self.most_n.max(point.1.abs());
            let fall_n = way * (top.1 - point.1);
            if fall_n <= 0.0 {
                top = *point;
            } else if self.fold.is_none_or(|fold| fall_n > fold.fall_n) {
                self.fold = Some(Fold { displacement_m, velocity_m_s, current_a: top.0, fall_n });
            }
        }
    }

    /// True if the model has a finite force at every grid point.
    #[must_use]
    pub const fn has_force(&self) -> bool {
        self.points[0] == self.points[1]
    }

    /// True if the force at each motion is linear in the current, to rounding.
    #[must_use]
    pub fn is_linear(&self) -> bool {
        self.bend_n <= STRAIGHT * self.most_n
    }

    /// The fold, if it is deeper than rounding.
    #[must_use]
    pub fn real_fold(&self) -> Option<Fold> {
        self.fold.filter(|fold| fold.fall_n > ROUNDING * self.most_n)
    }
}

/// Largest distance of the force of `model`, without its coil lag, from a straight line over the current, N.
fn bend_n(model: &Model, current_max_a: f64) -> f64 {
    let Ok(augmented) = prepare::without_lag(model) else { return f64::INFINITY };
    let mut bend_n = 0.0_f64;
    for reach in [0.3, 0.9] {
        Cycle::of(model).along(&augmented, reach, 0.5 * current_max_a, CyclePoints::On, |at| {
            let off_n = |share: f64| {
                let [low_n, high_n, here_n] =
                    [0.0, 1.0, share].map(|share| at.force_n_at(share * current_max_a).unwrap_or(f64::NAN));
                (low_n + share * (high_n - low_n) - here_n).abs()
            };
            for off_n in ALONG_LINE.map(off_n) {
                bend_n = if off_n.is_finite() { bend_n.max(off_n) } else { f64::INFINITY };
            }
        });
    }
    bend_n
}

/// Force of `model`, N, after it has reached `displacement_m` with `velocity_m_s` and `current_a`; `None` if it is not finite.
fn arrive(
    model: &Augmented,
    displacement_m: f64,
    velocity_m_s: f64,
    current_a: f64,
    dt_s: f64,
) -> Option<f64> {
    let mut state = AugmentedState::default();
    let mut force_n = None;
    for step in 0..=APPROACH {
        let to_go_s = dt_s * (APPROACH - step) as f64;
        let inputs = Inputs {
            dt_s: (step > 0).then_some(dt_s),
            displacement_m: displacement_m - velocity_m_s * to_go_s,
            velocity_m_s,
            acceleration_m_s2: 0.0,
            drive: current_a,
            // No temperature is known when a model is loaded.
            case_temp_c: REFERENCE_TEMP_C,
        };
        force_n = model.free_run(&mut state, &inputs);
    }
    force_n.filter(|force_n| force_n.is_finite())
}
