//! Value and derivatives of a recorded signal, from a least-squares parabola in a centred sliding window.
//!
//! ```text
//! min over a, b, c of sum_{k=-h..h} (y_k - a - b k - c k²)²       value a,   slope b / dt,   curvature 2 c / dt²
//! ```
//!
//! The window needs later samples, so this works on finished runs only, not in the live path.
//!
//! Source: `[savitzky1964]` in the bibliography (node/docs/guide/bibliography.md).

use crate::sample::Trace;

/// Value, first and second derivative at sample `index`, from a least-squares parabola over evenly spaced samples.
/// The window reaches `half` samples to either side. `None` near an end or a gap, and for a window of one sample.
///
/// ```
/// use mr_damper_model::sample::{Stamp, Trace};
/// use mr_damper_model::statistics::parabola::parabola;
///
/// // A free fall, at 500 Hz: after 0.1 s, 0.049 m deep and 0.981 m/s fast
/// let fall = Trace {
///     stamps: (0..100).map(|k| Stamp::from_nanos(k * 2_000_000)).collect(),
///     values: (0..100).map(|k| 0.5 * 9.81 * (f64::from(k) * 0.002).powi(2)).collect(),
/// };
/// let [depth_m, speed_m_s, acceleration_m_s2] = parabola(&fall, 50, 8).expect("the window is within the trace");
/// assert!((depth_m - 0.04905).abs() < 1e-9 && (speed_m_s - 0.981).abs() < 1e-9);
/// assert!((acceleration_m_s2 - 9.81).abs() < 1e-6);
/// assert_eq!(parabola(&fall, 5, 8), None);
/// ```
#[must_use]
pub fn parabola(trace: &Trace, index: usize, half: usize) -> Option<[f64; 3]> {
    if half == 0 {
        return None;
    }
    let (from, to) = (index.checked_sub(half)?, index.checked_add(half)?);
    let span_s = trace.stamps.get(to)?.since(trace.stamps[from]).get();
    let step_s = span_s / (2 * half) as f64;
    let near_s = trace.stamps[index].since(trace.stamps[from]).get();
    if step_s <= 0.0 || (near_s - 0.5 * span_s).abs() > step_s {
        return None;
    }
    Some(fit(trace.values.get(from..=to)?, step_s))
}

/// Value, first and second derivative in the middle of `values`, an odd number of at least three, `step_s` apart.
#[must_use]
pub(crate) fn fit(values: &[f64], step_s: f64) -> [f64; 3] {
    let half = values.len() / 2;
    let (mut s0, mut s2, mut s4) = (0.0, 0.0, 0.0);
    let (mut sy, mut sky, mut skky) = (0.0, 0.0, 0.0);
    for (offset, value) in values.iter().enumerate() {
        let k = offset as f64 - half as f64;
        s0 += 1.0;
        s2 += k * k;
        s4 += k.powi(4);
        sy += value;
        sky += k * value;
        skky += k * k * value;
    }
    let curve = (s0 * skky - s2 * sy) / (s0 * s4 - s2 * s2);
    let middle = (sy - curve * s2) / s0;
    [middle, sky / s2 / step_s, 2.0 * curve / (step_s * step_s)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::Stamp;

    #[test]
    fn a_parabola_is_recovered_exactly() {
        let trace = Trace {
            stamps: (0..40).map(|k| Stamp::from_nanos(k * 2_000_000)).collect(),
            values: (0..40)
                .map(|k| {
                    let t = f64::from(k) * 2e-3;
                    1.0 + 2.0 * t + 3.0 * t * t
                })
                .collect(),
        };
        let [value, slope, curve] = parabola(&trace, 20, 8).expect("inside");
        assert!((value - 1.0848).abs() < 1e-9 && (slope - 2.24).abs() < 1e-9 && (curve - 6.0).abs() < 1e-6);
        assert_eq!(parabola(&trace, 3, 8), None);
        assert_eq!(parabola(&trace, 36, 8), None);
        assert_eq!(parabola(&trace, 20, 0), None);
    }
}
