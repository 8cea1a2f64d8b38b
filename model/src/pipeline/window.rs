//! Error figures over a window with exponential forgetting.
//!
//! ```text
//! S_k = S_{k-1} lambda + s_k,   lambda = exp(-dt / T)
//! ```
//!
//! The recursion is used for the weight, the squared residual and the first two moments of the measured
//! force. Compared with a box window, its memory does not grow with the sample rate, and rounding errors in
//! the sums decay instead of adding up.

use super::settings::Settings;
use crate::elementary::exp;
use crate::sample::Stamp;

/// The sums.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Window {
    last: Option<Stamp>,
    weight: f64,
    squared_residual: f64,
    mean_n: f64,
    spread: f64,
}

/// RMSE and NMSE of a window; the thesis calls them RSSE and ESR.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Windowed {
    pub(super) rsse_n: f64,
    /// NaN while the force has not varied.
    pub(super) esr: f64,
}

impl Window {
    pub(super) fn add(
        &mut self,
        stamp: Stamp,
        measured_n: f64,
        residual_n: f64,
        settings: &Settings,
    ) -> Windowed {
        let dt_s = self.last.map_or(0.0, |last| stamp.since(last).get());
        self.last = Some(stamp);
        let keep = exp(-dt_s / settings.residual_window_s);
        self.weight = self.weight * keep + 1.0;
        self.squared_residual = self.squared_residual * keep + residual_n * residual_n;
        let delta = measured_n - self.mean_n;
        self.mean_n += delta / self.weight;
        self.spread = self.spread * keep + delta * (measured_n - self.mean_n);
        // If the force has not varied, or by too little, the ratio is not finite.
        let esr = Some(self.squared_residual / self.spread).filter(|esr| esr.is_finite()).unwrap_or(f64::NAN);
        Windowed { rsse_n: (self.squared_residual / self.weight).sqrt(), esr }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_follow_a_change_within_the_window() {
        let settings = Settings { residual_window_s: 1.0, ..Settings::default() };
        let mut window = Window::default();
        let mut last = None;
        for k in 0..10_000_i64 {
            let measured = if k % 2 == 0 { 100.0 } else { -100.0 };
            let residual = if k < 5000 { 1.0 } else { 10.0 };
            last = Some(window.add(Stamp::from_nanos(k * 1_000_000), measured, residual, &settings));
            if k == 4999 {
                let figures = last.expect("samples were added");
                assert!((figures.rsse_n - 1.0).abs() < 1e-9 && (figures.esr - 1e-4).abs() < 1e-6);
            }
        }
        let figures = last.expect("samples were added");
        // Five time constants later exp(-5) of the old residual power is left.
        assert!((figures.rsse_n - (100.0 - 99.0 * (-5.0_f64).exp()).sqrt()).abs() < 1e-2, "{figures:?}");
    }
}
