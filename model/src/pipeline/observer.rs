//! The observer: measured force corrects the simulation through a bias.
//!
//! ```text
//! b' = b + (1 - e^(-dt/T)) (r - b)          r = measured minus simulated force, at each measured force
//! F  = F_free + b e^(-a/T_c)                a: age of the newest measured force beyond force_timeout_s
//! ```
//!
//! | symbol | what | unit |
//! |---|---|---|
//! | T | time constant of [`UseForce::Observer`] | s |
//! | T_c | `coast_s`: without measured force, the bias is kept for about as long as ARX coasts | s |
//!
//! This is a first-order Luenberger observer of a constant disturbance. It changes the estimate only. The residual is still taken
//! from the simulation and shows what the model lacks.
//!
//! Source: `[luenberger]` in the bibliography (node/docs/guide/bibliography.md).

use super::settings::{Settings, UseForce};
use crate::elementary::{exp, exp_m1};
use crate::sample::Stamp;

/// The bias.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Observer {
    bias_n: f64,
    last: Option<Stamp>,
}

impl Observer {
    /// Takes a residual of the simulation.
    #[inline]
    pub(super) fn see(&mut self, stamp: Stamp, dt_s: Option<f64>, residual_n: f64, settings: &Settings) {
        let UseForce::Observer(tau_s) = settings.use_measured_force else { return };
        if !residual_n.is_finite() {
            return;
        }
        match dt_s {
            Some(dt_s) => self.bias_n -= exp_m1(-dt_s / tau_s) * (residual_n - self.bias_n),
            None => self.bias_n = 0.0,
        }
        self.last = Some(stamp);
    }

    /// Correction that is added to the simulation at `now`, N.
    #[inline]
    pub(super) fn bias_n(&self, now: Stamp, settings: &Settings) -> f64 {
        let (UseForce::Observer(_), Some(last)) = (settings.use_measured_force, self.last) else {
            return 0.0;
        };
        let over_s = now.since(last).get() - settings.force_timeout_s;
        if over_s <= 0.0 {
            self.bias_n
        } else if settings.coast_s > 0.0 {
            self.bias_n * exp(-over_s / settings.coast_s)
        } else {
            0.0
        }
    }
}
