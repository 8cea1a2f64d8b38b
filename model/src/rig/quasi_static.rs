//! The rig's other valve: a force by velocity and current alone, rigid, without a hysteresis of its own.
//!
//! ```text
//! valve     Fv = lean (Fy(i, T) tanh((s' + kappa s) / vy) + c0(i, T) s')
//! rigid     s follows x with a play of +-g/2;         within the gap s' = 0 and Fv = 0
//! spring    Fv = ks (x - s -+ g/2) at either edge;    within the gap s' = 0 and Fv = 0
//! ```
//!
//! | symbol | field | unit | meaning |
//! |---|---|---|---|
//! | vy | `yield_velocity_m_s` | m/s | velocity over which the fluid yields |
//! | kappa | `coupling_per_s` | 1/s | how much displacement counts as velocity |
//! | s | [`super::plant::PlantState::behind_compliance_m`] | m | displacement of the piston |
//! | x | | m | displacement of the rod |
//! | Fy, c0, lean | as in [`super::plant`] | N, N·s/m, - | yield force, damping, direction and position |
//! | g, ks | `free_play_m`, `series_stiffness_n_m` | m, N/m | free play; spring in series, infinite for none |
//!
//! Source: the Bingham damper with a smooth step, as most MR dampers are drawn. It is the ground for tests of a
//! diagnosis: a model that is a step and a damping at each current can follow it to the noise, so that what it leaves
//! over is the effect that was put in. Yield force and damping follow the current as the other valve's do, smoothly
//! and not by fuzzy sets.
//!
//! With a spring the piston's displacement is a differential equation, s' = w(x - s, s), as stiff as the spring. It is
//! integrated by TR-BDF2 (Bank et al. 1985, with its inner point in the middle), which is of second order and damps
//! what is too fast for its step, so that a spring may be as stiff as it likes. Each of its stages seeks
//! the rate at which valve and spring agree; their difference grows with the rate, so there is one.

use super::plant::{Instant, Plant, PlantState, Valve};
use crate::Error;

/// Difference of play and edge, in metres, that is none: displacements are rounded.
const ROUNDED_M: f64 = 1e-15;

/// Most steps of the search for a rate; halving alone takes 60 to the last bit.
const SEARCH_STEPS: u32 = 100;

/// Share of a rate, and rate in m/s, below which a search is done.
const RATE_TOLERANCE: f64 = 1e-14;

/// What the valve's force is like over velocity; see the equations at the top of this file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuasiStatic {
    /// Velocity vy over which the fluid yields, in m/s.
    pub yield_velocity_m_s: f64,
    /// Coupling kappa: how much displacement counts as velocity, in 1/s.
    pub coupling_per_s: f64,
}

impl QuasiStatic {
    pub(super) fn check(&self) -> Result<(), Error> {
        Error::check("yield_velocity_m_s", self.yield_velocity_m_s, "above 0", |v| v > 0.0)?;
        Error::check("coupling_per_s", self.coupling_per_s, "-100 to 100", |k| k.abs() <= 100.0)?;
        Ok(())
    }

    /// Force of the valve in newtons when the piston is at `s_m` and moves at `rate_m_s`; and how much it grows with
    /// the rate, in N·s/m, when the piston is the further away the faster it moved: s = ... + `reach_s` s'.
    fn force(&self, valve: &Valve, rate_m_s: f64, s_m: f64, reach_s: f64) -> (f64, f64) {
        let step = ((rate_m_s + self.coupling_per_s * s_m) / self.yield_velocity_m_s).tanh();
        let steepness = (1.0 - step * step) * (1.0 + self.coupling_per_s * reach_s) / self.yield_velocity_m_s;
        (valve.yield_n * step + valve.viscous * rate_m_s, valve.yield_n * steepness + valve.viscous)
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
        let valve = self.valve(state).scaled(self.lean(x_m, v_m_s));
        form.force(&valve, v_m_s, s_m, 0.0).0
    }

    /// Displacement of the piston `step_s` seconds after it was at `s_m`, with the rod and the valve as they are at
    /// the start, in the middle and at the end.
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
        // Trapezium to the middle, then backward differences over start, middle and end.
        let quarter_s = step_s / 4.0;
        let base_m = s_m + quarter_s * self.rate_m_s(form, start, s_m, 0.0);
        let middle_m = base_m + quarter_s * self.rate_m_s(form, middle, base_m, quarter_s);
        let base_m = (4.0 * middle_m - s_m) / 3.0;
        base_m + step_s / 3.0 * self.rate_m_s(form, end, base_m, step_s / 3.0)
    }

    /// The rate w in m/s at which valve and spring agree, when the piston is at `base_m` + `reach_s` w.
    ///
    /// Within the gap it is none, and a piston that comes to the gap's edge stays there.
    fn rate_m_s(&self, form: &QuasiStatic, (x_m, valve): Instant, base_m: f64, reach_s: f64) -> f64 {
        let has_gap = self.free_play_m > 0.0;
        let beyond_m = (x_m - base_m).abs() - 0.5 * self.free_play_m;
        if has_gap && beyond_m <= 0.0 {
            return 0.0;
        }
        // Mirrored so that the spring pulls upward: the valve is alike to both sides.
        let side = (x_m - base_m).signum();
        let stiffness = self.series_stiffness_n_m;
        let pull_n = stiffness * beyond_m;
        let excess = |rate: f64| {
            let (force_n, slope) = form.force(valve, rate, side * base_m + reach_s * rate, reach_s);
            (force_n - pull_n + stiffness * reach_s * rate, slope + stiffness * reach_s)
        };
        // The step lies within -Fy..Fy, so the rate does between those of the straight rest.
        let straight = valve.viscous + stiffness * reach_s;
        let (low, high) = ((pull_n - valve.yield_n) / straight, (pull_n + valve.yield_n) / straight);
        let slack = if has_gap && reach_s > 0.0 { beyond_m / reach_s } else { f64::INFINITY };
        if slack <= low || slack < high && excess(slack).0 <= 0.0 {
            return side * slack;
        }
        side * root(low, high.min(slack), excess)
    }
}

/// Where `function`, which rises from `low` to `high` and is given with its slope, is zero: Newton's steps while they
/// halve, or else halves.
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
