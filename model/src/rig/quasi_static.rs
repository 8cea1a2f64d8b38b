//! The rig's quasi-static valve: its force depends on velocity and current, without hysteresis of its own.
//!
//! ```text
//! valve     Fv = lean (Fy(i, T) tanh((s' + kappa s) / vy) + c0(i, T) s' (1 + (s'/vf)^2)^((n - 1)/2))
//! rigid     s follows x with a play of +-g/2;         within the gap s' = 0 and Fv = 0
//! spring    Fv = ks (x - s -+ g/2) at either edge;    within the gap s' = 0 and Fv = 0
//! ```
//!
//! | symbol | field | unit | meaning |
//! |---|---|---|---|
//! | vy | `yield_velocity_m_s` | m/s | velocity scale over which the fluid yields |
//! | kappa | `coupling_per_s` | 1/s | factor by which displacement adds to velocity |
//! | n | `flow_exponent` | - | exponent of the flow far above vf: 1 for a Newtonian fluid, below 1 if shear thins it |
//! | vf | `flow_velocity_m_s` | m/s | velocity above which shear thins the fluid |
//! | s | [`super::plant::PlantState::behind_compliance_m`] | m | displacement of the piston |
//! | x | | m | displacement of the rod |
//! | Fy, c0, lean | as in [`super::plant`] | N, N·s/m, - | yield force, damping, factor of direction and position |
//! | g, ks | `free_play_m`, `series_stiffness_n_m` | m, N/m | free play; spring in series, infinite for none |
//!
//! Source: the Bingham damper with a smooth step, the common picture of an MR damper; with n below 1, the viscosity of Carreau's fluid
//! (`[carreau1972]`). It is used in tests of the diagnosis: a model with
//! a step and a damping at each current can follow it down to the noise, so the remaining residual is the effect that was
//! injected. Yield force and damping depend on the current as in the other valve, by smooth functions and not by fuzzy sets.
//!
//! With a spring, the piston's displacement follows a differential equation, s' = w(x - s, s), which is as stiff as the spring. It is
//! integrated by TR-BDF2 (Bank et al. 1985, with its inner point in the middle). The method is of second order and damps components that
//! are too fast for its step, so the spring may be of any stiffness. Each stage solves for the rate at which valve force and
//! spring force agree. Their difference grows with the rate, so exactly one solution exists.
//!
//! See `[bank1985]` in the bibliography (node/docs/guide/bibliography.md), for the integration.

use super::plant::{Instant, Plant, PlantState, Valve};
use crate::Error;

/// Distance from the edge of the play, in metres, that counts as zero because displacements are rounded.
const ROUNDED_M: f64 = 1e-15;

/// Largest number of steps in the search for a rate; bisection alone needs 60 for full precision.
const SEARCH_STEPS: u32 = 100;

/// Step of the search, relative to |rate| + 1 m/s, below which it ends.
const RATE_TOLERANCE: f64 = 1e-14;

/// Shape of the valve's force over velocity; see the equations at the top of this file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuasiStatic {
    /// Velocity scale vy over which the fluid yields, in m/s.
    pub yield_velocity_m_s: f64,
    /// Coupling kappa: factor by which displacement adds to velocity, in 1/s.
    pub coupling_per_s: f64,
    /// Exponent n of the flow.
    pub flow_exponent: f64,
    /// Velocity vf above which shear thins the fluid, in m/s.
    pub flow_velocity_m_s: f64,
}

impl QuasiStatic {
    /// A valve that yields over 30 mm/s, with a Newtonian fluid and without coupling.
    pub const NEWTONIAN: Self =
        Self { yield_velocity_m_s: 0.03, coupling_per_s: 0.0, flow_exponent: 1.0, flow_velocity_m_s: 0.05 };

    pub(super) fn check(&self) -> Result<(), Error> {
        Error::check("yield_velocity_m_s", self.yield_velocity_m_s, "above 0", |v| v > 0.0)?;
        Error::check("coupling_per_s", self.coupling_per_s, "-100 to 100", |k| k.abs() <= 100.0)?;
        Error::check("flow_exponent", self.flow_exponent, "above 0, at most 1", |n| n > 0.0 && n <= 1.0)?;
        Error::check("flow_velocity_m_s", self.flow_velocity_m_s, "above 0", |v| v > 0.0)?;
        Ok(())
    }

    /// Force of the valve in newtons if the piston is at `s_m` and moves at `rate_m_s`, and its derivative by the rate in N·s/m. The
    /// derivative includes that the position depends on the rate, s = ... + `reach_s` s'.
    fn force(&self, valve: &Valve, rate_m_s: f64, s_m: f64, reach_s: f64) -> (f64, f64) {
        let step = ((rate_m_s + self.coupling_per_s * s_m) / self.yield_velocity_m_s).tanh();
        let steepness = (1.0 - step * step) * (1.0 + self.coupling_per_s * reach_s) / self.yield_velocity_m_s;
        let (share, slope) = self.thinned(rate_m_s);
        (
            valve.yield_n * step + valve.viscous * share * rate_m_s,
            valve.yield_n * steepness + valve.viscous * slope,
        )
    }

    /// Viscosity and slope of the viscous force at `rate_m_s`, as shares of those at rest.
    fn thinned(&self, rate_m_s: f64) -> (f64, f64) {
        if self.flow_exponent == 1.0 {
            return (1.0, 1.0);
        }
        let square = (rate_m_s / self.flow_velocity_m_s).powi(2);
        let share = (1.0 + square).powf(0.5 * (self.flow_exponent - 1.0));
        (share, share * (1.0 + self.flow_exponent * square) / (1.0 + square))
    }
}

impl Plant {
    /// Force of the quasi-static valve in newtons, at `state`, displacement `x_m` and velocity `v_m_s` of the rod.
    pub(super) fn quasi_static_n(&self, form: &QuasiStatic, state: &PlantState, x_m: f64, v_m_s: f64) -> f64 {
        let s_m = state.behind_compliance_m;
        if self.series_stiffness_n_m.is_finite() {
            return self.spring_n(x_m - s_m);
        }
        let to_edge_m = 0.5 * self.free_play_m - (x_m - s_m) * v_m_s.signum();
        if self.free_play_m > 0.0 && (to_edge_m > ROUNDED_M || v_m_s == 0.0) {
            return 0.0;
        }
        let valve = self.valve_at(state, x_m, v_m_s);
        form.force(&valve, v_m_s, s_m, 0.0).0
    }

    /// Displacement of the piston `step_s` seconds after it was at `s_m`. The array holds displacement of the rod and valve at the start,
    /// in the middle and at the end of the step.
    pub(super) fn quasi_static_step(
        &self,
        form: &QuasiStatic,
        s_m: f64,
        step_s: f64,
        [start, middle, end]: [Instant; 3],
    ) -> f64 {
        if self.series_stiffness_n_m == f64::INFINITY {
            let half_m = 0.5 * self.free_play_m;
            let follow = |s: f64, x: f64| s.max(x - half_m).min(x + half_m);
            return follow(follow(s_m, middle.0), end.0);
        }
        // Trapezoidal rule to the middle, then backward differences over start, middle and end.
        let quarter_s = step_s / 4.0;
        let base_m = s_m + quarter_s * self.rate_m_s(form, start, s_m, 0.0);
        let middle_m = base_m + quarter_s * self.rate_m_s(form, middle, base_m, quarter_s);
        let base_m = (4.0 * middle_m - s_m) / 3.0;
        base_m + step_s / 3.0 * self.rate_m_s(form, end, base_m, step_s / 3.0)
    }

    /// The rate w in m/s at which the forces of valve and spring agree, with the piston at `base_m` + `reach_s` w.
    ///
    /// It is zero within the gap. A piston that reaches the edge of the gap stays there.
    fn rate_m_s(&self, form: &QuasiStatic, (x_m, valve): Instant, base_m: f64, reach_s: f64) -> f64 {
        let has_gap = self.free_play_m > 0.0;
        let beyond_m = (x_m - base_m).abs() - 0.5 * self.free_play_m;
        if has_gap && beyond_m <= 0.0 {
            return 0.0;
        }
        // Mirrored so that the spring pulls in positive direction; the valve is symmetric.
        let side = (x_m - base_m).signum();
        let stiffness = self.series_stiffness_n_m;
        let pull_n = stiffness * beyond_m;
        let excess = |rate: f64| {
            let (force_n, slope) = form.force(valve, rate, side * base_m + reach_s * rate, reach_s);
            (force_n - pull_n + stiffness * reach_s * rate, slope + stiffness * reach_s)
        };
        // The tanh part lies within -Fy..Fy, so the solutions of the linear part with these two values bracket the rate.
        let straight = valve.viscous + stiffness * reach_s;
        let (mut low, mut high) = ((pull_n - valve.yield_n) / straight, (pull_n + valve.yield_n) / straight);
        // A thinner fluid flows faster; its solution is further from zero.
        while form.flow_exponent < 1.0 && excess(low).0 > 0.0 {
            low *= 2.0;
        }
        while form.flow_exponent < 1.0 && excess(high).0 < 0.0 {
            high *= 2.0;
        }
        let slack = if has_gap && reach_s > 0.0 { beyond_m / reach_s } else { f64::INFINITY };
        if slack <= low || slack < high && excess(slack).0 <= 0.0 {
            return side * slack;
        }
        side * root(low, high.min(slack), excess)
    }
}

/// The root of `function` between `low` and `high`. The function is increasing and returns its value and slope. Takes Newton steps while
/// each is at most half of the one before, and bisects otherwise.
fn root(mut low: f64, mut high: f64, function: impl Fn(f64) -> (f64, f64)) -> f64 {
    let mut at = 0.5 * (low + high);
    let mut last_step = high - low;
    for _ in 0..SEARCH_STEPS {
        let (value, slope) = function(at);
        if value < 0.0 {
            low = at;
        } else {
            high = at;
        }
        let newton = at - value / slope;
        let good = newton >= low && newton <= high && (newton - at).abs() <= 0.5 * last_step;
        let next = if good { newton } else { 0.5 * (low + high) };
        last_step = (next - at).abs();
        at = next;
        if last_step <= RATE_TOLERANCE * (1.0 + at.abs()) {
            break;
        }
    }
    at
}

#[cfg(test)]
mod tests;
