//! Cycles of a run: where displacement rises through the middle of its range.
//!
//! ```text
//! middle     m = (max x + min x)/2,          band  b = (max x - min x)/10
//! start      x rises through m, after it was below m - b, and reaches m + b before it falls below m - b again
//! ```
//!
//! The band keeps noise near the middle from starting cycles. A start is the first sample at or above the middle, so it is late
//! by less than one sample period.

use mr_damper_model::sample::{Stamp, Trace};

/// Half the band around the middle, as a share of the range.
const BAND: f64 = 0.1;

/// The stamps at which cycles of `displacement` begin, in order.
pub(super) fn starts(displacement: &Trace) -> Vec<Stamp> {
    let (low, high) = displacement
        .values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)));
    let (middle, band) = (0.5 * (low + high), BAND * (high - low));
    let mut starts = Vec::new();
    // True after displacement was below the band; then the first sample at or above the middle is a candidate.
    let (mut was_low, mut candidate) = (false, None);
    for (stamp, x) in displacement.stamps.iter().zip(&displacement.values) {
        if *x < middle - band {
            (was_low, candidate) = (true, None);
        } else if was_low {
            if *x < middle {
                candidate = None;
            } else {
                candidate.get_or_insert(*stamp);
            }
            if *x > middle + band {
                starts.extend(candidate.take());
                was_low = false;
            }
        }
    }
    starts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trace(samples: usize, rate_hz: f64, x: impl Fn(f64) -> f64) -> Trace {
        let time_s = |k: usize| k as f64 / rate_hz;
        Trace {
            stamps: (0..samples).map(|k| Stamp::from_seconds(time_s(k)).expect("a time")).collect(),
            values: (0..samples).map(|k| x(time_s(k))).collect(),
        }
    }

    #[test]
    fn a_sine_starts_where_it_rises_through_its_middle() {
        // 2 Hz with an offset: rises through the middle at 0.1, 0.6, 1.1, ... s. The first start needs a sample below before it.
        let sine = trace(2560, 512.0, |t| 0.03 + 0.01 * (std::f64::consts::TAU * 2.0 * (t - 0.1)).sin());
        let found = starts(&sine);
        assert_eq!(found.len(), 10);
        for (k, start) in found.iter().enumerate() {
            let late_s = start.since(Stamp::from_seconds(0.1 + 0.5 * k as f64).expect("a time")).get();
            assert!((0.0..1.0 / 512.0).contains(&late_s), "{k}: {late_s}");
        }
    }

    #[test]
    fn noise_near_the_middle_starts_no_cycle() {
        // A triangle with a ripple of 4 % of the range, which crosses the middle several times.
        let wave = |t: f64| {
            let phase = t.rem_euclid(1.0);
            let triangle = if phase < 0.5 { 4.0 * phase - 1.0 } else { 3.0 - 4.0 * phase };
            triangle + 0.08 * (400.0 * t).sin()
        };
        let found = starts(&trace(5000, 1000.0, wave));
        assert_eq!(found.len(), 5, "{found:?}");
        assert!(starts(&trace(100, 100.0, |_| 1.0)).is_empty());
        assert!(starts(&Trace::default()).is_empty());
    }
}
