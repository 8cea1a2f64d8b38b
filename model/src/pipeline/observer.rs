//! The observer: measured force corrects the free-running model through a bias.
//!
//! ```text
//! b' = b + (1 - e^(-dt/T)) (r - b)          r = measured force - free run, when measured force comes
//! F  = F_free + b e^(-a/T_c)                a: age of the newest measured force beyond force_timeout_s
//! ```
//!
//! | symbol | what | unit |
//! |---|---|---|
//! | T | time constant of [`UseForce::Observer`] | s |
//! | T_c | `coast_s`: without measured force the bias is believed for about as long as ARX coasts | s |
//!
//! A first-order Luenberger observer of a constant disturbance. It changes the estimate alone: the residual stays that of the free
//! run, which shows what the model lacks.

use super::settings::{Settings, UseForce};
use crate::sample::Stamp;

/// The bias.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Observer {
    bias_n: f64,
    last: Option<Stamp>,
}

impl Observer {
    /// Takes a residual of the free run.
    #[inline]
    pub(super) fn see(&mut self, stamp: Stamp, dt_s: Option<f64>, residual_n: f64, settings: &Settings) {
        let UseForce::Observer(tau_s) = settings.use_measured_force else { return };
        if !residual_n.is_finite() {
            return;
        }
        match dt_s {
            Some(dt_s) => self.bias_n -= (-dt_s / tau_s).exp_m1() * (residual_n - self.bias_n),
            None => self.bias_n = 0.0,
        }
        self.last = Some(stamp);
    }

    /// What is added to the free run at `now`, N.
    #[inline]
    pub(super) fn bias_n(&self, now: Stamp, settings: &Settings) -> f64 {
        let (UseForce::Observer(_), Some(last)) = (settings.use_measured_force, self.last) else {
            return 0.0;
        };
        let over_s = now.since(last).get() - settings.force_timeout_s;
        if over_s <= 0.0 {
            self.bias_n
        } else if settings.coast_s > 0.0 {
            self.bias_n * (-over_s / settings.coast_s).exp()
        } else {
            0.0
        }
    }
}
