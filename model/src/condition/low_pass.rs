//! Second-order low-pass with two equal poles (thesis 3.5).
//!
//! ```text
//! H(s) = 1 / (tau s + 1)^2,   tau = 1 / (2 pi f_c)
//! ```
//!
//! At the corner frequency f_c (20 Hz in the thesis) the gain is -6.02 dB; it is -3.01 dB at .644 f_c. The
//! delay at low frequency is 2 tau. Each pole is discretised so that its response to a piecewise linear input
//! is exact for any step dt, since sampled displacement is nearly piecewise linear:
//!
//! ```text
//! y_k = p y_{k-1} + (1 - q) u_k + (q - p) u_{k-1},   p = exp(-dt/tau),  q = (1 - p) tau / dt
//! ```
//!
//! Source: `[thesis]` in the bibliography (node/docs/guide/bibliography.md), equation 3.5 of the thesis.

use crate::elementary::{exp, exp_m1};
use crate::units::Hertz;

/// The filter. Immutable; its memory is in [`State`].
///
/// ```
/// use mr_damper_model::condition::{LowPass, LowPassState};
/// use mr_damper_model::units::Hertz;
///
/// // A sine of 20 Hz, at the corner frequency: half of its amplitude passes (-6.02 dB).
/// let (filter, mut state) = (LowPass::new(Hertz(20.0)), LowPassState::default());
/// let passed = (0..8_000).map(|k| {
///     let t_s = f64::from(k) / 8_000.0;
///     filter.step(&mut state, (k > 0).then_some(1.0 / 8_000.0), (std::f64::consts::TAU * 20.0 * t_s).sin())
/// });
/// let amplitude = passed.skip(4_000).fold(0.0, f64::max);
/// assert!((amplitude - 0.5).abs() < 1e-3, "{amplitude}");
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowPass {
    tau_s: f64,
}

/// State of the filter for `N` signals with one clock: inputs, outputs of both poles, and the coefficients of the last step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State<const N: usize = 1> {
    input: [f64; N],
    first: [f64; N],
    second: [f64; N],
    dt_s: f64,
    pole: f64,
    ramp: f64,
}

impl<const N: usize> Default for State<N> {
    fn default() -> Self {
        Self { input: [0.0; N], first: [0.0; N], second: [0.0; N], dt_s: 0.0, pole: 0.0, ramp: 0.0 }
    }
}

impl LowPass {
    /// A filter with both poles at `cutoff`.
    #[must_use]
    pub fn new(cutoff: Hertz) -> Self {
        Self { tau_s: 1.0 / (std::f64::consts::TAU * cutoff.get()) }
    }

    /// Time constant of each pole, s.
    #[must_use]
    pub const fn tau_s(&self) -> f64 {
        self.tau_s
    }

    /// Filters one value, `dt_s` seconds after the previous one. `None` restarts the filter at rest at
    /// `value`.
    #[inline]
    pub fn step(&self, state: &mut State, dt_s: Option<f64>, value: f64) -> f64 {
        let [filtered] = self.step_each(state, dt_s, [value]);
        filtered
    }

    /// [`LowPass::step`] for one value of each signal.
    #[inline]
    pub(crate) fn step_each<const N: usize>(
        &self,
        state: &mut State<N>,
        dt_s: Option<f64>,
        values: [f64; N],
    ) -> [f64; N] {
        let Some(dt_s) = dt_s else {
            *state = State { input: values, first: values, second: values, ..*state };
            return values;
        };
        if dt_s != state.dt_s {
            // The rate is usually constant, so the exponential of the last step is kept.
            let ratio = dt_s / self.tau_s;
            state.dt_s = dt_s;
            state.pole = exp(-ratio);
            state.ramp = -exp_m1(-ratio) / ratio;
        }
        let (p, q) = (state.pole, state.ramp);
        for (k, value) in values.into_iter().enumerate() {
            let first = p * state.first[k] + (1.0 - q) * value + (q - p) * state.input[k];
            state.second[k] = p * state.second[k] + (1.0 - q) * first + (q - p) * state.first[k];
            state.first[k] = first;
        }
        state.input = values;
        state.second
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn gain_db_at(filter: &LowPass, frequency_hz: f64, rate_hz: f64) -> f64 {
        let mut state = State::default();
        let dt = 1.0 / rate_hz;
        let (mut sine, mut cosine, mut periods) = (0.0, 0.0, 0.0);
        // 100 s after 2 s of settling: a whole number of periods of each tested frequency.
        for k in 0..(102.0 * rate_hz) as usize {
            let phase = std::f64::consts::TAU * frequency_hz * k as f64 * dt;
            let y = filter.step(&mut state, (k > 0).then_some(dt), phase.sin());
            if k as f64 * dt >= 2.0 {
                sine += y * phase.sin();
                cosine += y * phase.cos();
                periods += 0.5;
            }
        }
        20.0 * (sine.hypot(cosine) / periods).log10()
    }

    #[test]
    fn gain_matches_the_published_values() {
        let filter = LowPass::new(Hertz(20.0));
        assert!((filter.tau_s() - 0.008).abs() < 1e-4, "the thesis prints 0.008 s");
        assert!((gain_db_at(&filter, 20.0, 2048.0) + 6.02).abs() < 0.02);
        assert!((gain_db_at(&filter, 12.87, 2048.0) + 3.01).abs() < 0.02);
        assert!(gain_db_at(&filter, 0.5, 512.0).abs() < 0.02);
    }

    proptest! {
        // The discretisation is exact for a ramp and any steps: y = r (t - 2 tau + (t + 2 tau) e^(-t/tau)).
        #[test]
        fn response_to_a_ramp_is_exact(steps in prop::collection::vec(1e-4..0.02f64, 1..60), slope in -5.0..5.0f64) {
            let filter = LowPass::new(Hertz(20.0));
            let tau = filter.tau_s();
            let mut state = State::default();
            let mut t = 0.0;
            filter.step(&mut state, None, 0.0);
            for dt in steps {
                t += dt;
                // Only the first pole has a piecewise linear input; its exact response is r (t - tau (1 -
                // e^(-t/tau))).
                filter.step(&mut state, Some(dt), slope * t);
                let exact = slope * (t - tau * (1.0 - (-t / tau).exp()));
                prop_assert!((state.first[0] - exact).abs() < 1e-12 * (1.0 + exact.abs()));
            }
        }

        #[test]
        fn a_constant_passes_unchanged(value in -1e3..1e3f64, dt in 1e-5..0.1f64) {
            let filter = LowPass::new(Hertz(20.0));
            let mut state = State::default();
            filter.step(&mut state, None, value);
            for _ in 0..100 {
                let y = filter.step(&mut state, Some(dt), value);
                prop_assert!((y - value).abs() <= 1e-9 * value.abs());
            }
        }
    }
}
