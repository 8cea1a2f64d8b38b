//! Discrete derivatives of displacement: causal, and valid for any sequence of steps.
//!
//! ```text
//! backward:  v_k = (x_k - x_{k-1}) / dt_k                                  (thesis, chapter 3)
//! three:     v_k = d_k + (d_k - d_{k-1}) dt_k / (dt_k + dt_{k-1}),    d the backward difference
//! slope:     v_k = sum (t_j - mean t)(x_j - mean x) / sum (t_j - mean t)^2   over the window's samples
//! ```
//!
//! The backward difference has a delay of half a sample. The slope has a delay of half a window, and its
//! noise falls with the window's length to the power 3/2. The parabola through three points has no delay to
//! first order, and 1.8 times the noise of the backward difference. It is meant for diagnosis, where a delay
//! would look like an effect, and needs a filter after the model.
//!
//! Source: `[thesis]` in the bibliography (node/docs/guide/bibliography.md), chapter 3 of the thesis, for the backward difference.

/// Most samples in the slope's window. At high rates this makes the window shorter than requested: at 3 kHz,
/// 21 ms.
const WINDOW: usize = 64;

/// A derivative. Immutable; its memory is in `State`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Derivative {
    /// Difference of the last two samples.
    Backward,
    /// Slope of the parabola through the last three samples, at the last one; the backward difference while
    /// there are only two.
    ThreePoint,
    /// Least-squares slope over a trailing window of the given length, s.
    Slope {
        /// Length of the window, s.
        window_s: f64,
    },
}

/// State of one derivative: the last values, and their times since the last reset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct State {
    time_s: f64,
    len: usize,
    next: usize,
    times_s: [f64; WINDOW],
    values: [f64; WINDOW],
}

impl Default for State {
    fn default() -> Self {
        Self { time_s: 0.0, len: 0, next: 0, times_s: [0.0; WINDOW], values: [0.0; WINDOW] }
    }
}

impl Derivative {
    /// Processes one value, `dt_s` seconds after the previous one (`None` discards all previous values).
    /// Returns the derivative, or `None` while there is only one value.
    #[inline]
    pub(crate) fn step(&self, state: &mut State, dt_s: Option<f64>, value: f64) -> Option<f64> {
        match (self, dt_s) {
            (_, None) => {
                state.len = 0;
                state.next = 0;
                state.time_s = 0.0;
                state.push(value);
                None
            }
            (Self::Backward, Some(dt)) => {
                let before = state.values[0];
                state.values[0] = value;
                Some((value - before) / dt)
            }
            (Self::ThreePoint, Some(dt)) => {
                let difference = (value - state.values[0]) / dt;
                let (difference_before, dt_before) = (state.values[1], state.times_s[1]);
                let turned = if state.len > 1 {
                    (difference - difference_before) * dt / (dt + dt_before)
                } else {
                    0.0
                };
                state.values[..2].copy_from_slice(&[value, difference]);
                state.times_s[1] = dt;
                state.len = 2;
                Some(difference + turned)
            }
            (Self::Slope { window_s }, Some(dt)) => {
                state.time_s += dt;
                state.push(value);
                Some(state.slope(*window_s))
            }
        }
    }
}

impl State {
    fn push(&mut self, value: f64) {
        self.times_s[self.next] = self.time_s;
        self.values[self.next] = value;
        self.next = (self.next + 1) % WINDOW;
        self.len = (self.len + 1).min(WINDOW);
    }

    /// Slope over the samples not older than `window_s`, at least over the last two.
    fn slope(&self, window_s: f64) -> f64 {
        let at = |age: usize| (self.next + WINDOW - 1 - age) % WINDOW;
        let newest = at(0);
        let (t0, x0) = (self.times_s[newest], self.values[newest]);
        let (mut n, mut st, mut sx, mut stt, mut stx) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for age in 0..self.len {
            let (t, x) = (self.times_s[at(age)] - t0, self.values[at(age)] - x0);
            // A small tolerance: a window of 10 ms at 1 kHz holds 11 samples on every machine.
            if age > 1 && -t > window_s + 1e-9 {
                break;
            }
            n += 1.0;
            st += t;
            sx += x;
            stt += t * t;
            stx += t * x;
        }
        (n * stx - st * sx) / (n * stt - st * st)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn derivative_of_a_line_is_its_slope(
            slope in -3.0..3.0f64,
            start in -0.1..0.1f64,
            steps in prop::collection::vec(1e-4..5e-3f64, 2..200),
            window_s in 1e-3..0.05f64,
        ) {
            for derivative in [Derivative::Backward, Derivative::ThreePoint, Derivative::Slope { window_s }] {
                let mut state = State::default();
                let mut t = 0.0;
                prop_assert_eq!(derivative.step(&mut state, None, start), None);
                for dt in &steps {
                    t += dt;
                    let v = derivative.step(&mut state, Some(*dt), start + slope * t);
                    prop_assert!((v.expect("two values") - slope).abs() < 1e-8, "{v:?} {slope}");
                }
            }
        }
    }

    #[test]
    fn three_point_derivative_has_no_delay() {
        // On a parabola the slope changes steadily: the backward difference lags by half a step, three points
        // do not.
        let mut state = State::default();
        let (mut t, mut steps) = (0.0, [1e-3, 2e-3, 5e-4, 1.5e-3].iter().cycle());
        Derivative::ThreePoint.step(&mut state, None, 1.0);
        for k in 0..50 {
            let dt = *steps.next().expect("an endless cycle");
            t += dt;
            let v = Derivative::ThreePoint
                .step(&mut state, Some(dt), 1.0 + 0.3 * t + 4.0 * t * t)
                .expect("two values");
            assert!(k == 0 || (v - 0.3 - 8.0 * t).abs() < 1e-9, "{k}: {v}");
        }
    }

    #[test]
    fn slope_has_less_noise_than_backward_difference() {
        // Deterministic "noise" of one quantisation step with alternating sign.
        let noise = |k: usize| if k.is_multiple_of(2) { 1e-6 } else { -1e-6 };
        let worst = |derivative: Derivative| {
            let mut state = State::default();
            derivative.step(&mut state, None, noise(0));
            (1..200)
                .filter_map(|k| derivative.step(&mut state, Some(1e-3), noise(k)))
                .skip(20)
                .fold(0.0_f64, |worst, v| worst.max(v.abs()))
        };
        assert!(worst(Derivative::Backward) > 20.0 * worst(Derivative::Slope { window_s: 0.01 }));
    }
}
