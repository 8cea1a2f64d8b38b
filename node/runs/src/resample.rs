//! Resamples a run to an even rate.
//!
//! ```text
//! t_k = t_0 + k/f,    x(t_k) = x_a + (x_b - x_a) (t_k - t_a)/(t_b - t_a)        t_a <= t_k <= t_b: neighbouring samples
//! ```
//!
//! The grid begins at the first displacement and is the same for all channels. No value is made up: outside of a channel's own
//! samples, and in gaps of more than [`GAP_S`], the channel has no sample. The channels are not filtered, so motion above half the rate
//! appears at a wrong frequency; a channel that is slower than the rate is interpolated.

use super::RunError;
use mr_damper_model::sample::{Run, Stamp, Trace};
use std::path::Path;

/// Time between displacements across which nothing is interpolated, s: the gap at which the pipeline restarts.
const GAP_S: f64 = 0.1;
/// Largest rate, Hz.
const MOST_HZ: f64 = 100_000.0;

/// `run` with all channels at `rate_hz`.
///
/// # Errors
/// [`RunError::Unwritable`] for a rate that is not positive or above 100 kHz.
pub(super) fn resampled(run: &Run, rate_hz: f64, path: &Path) -> Result<Run, RunError> {
    if !(rate_hz > 0.0 && rate_hz <= MOST_HZ) {
        return Err(RunError::Unwritable {
            path: path.to_owned(),
            what: format!("the run at {rate_hz} Hz"),
            why: format!("the rate must be above 0 and at most {MOST_HZ} Hz"),
        });
    }
    let (Some(first), Some(last)) = (run.displacement_m.stamps.first(), run.displacement_m.stamps.last())
    else {
        return Ok(run.clone());
    };
    // From the index, so that rounding errors do not add up.
    let at = |k: usize| first.shifted((k as f64 * 1e9 / rate_hz).round() as i64);
    let grid: Vec<Stamp> = (0..).map(at).take_while(|stamp| stamp <= last).collect();
    let of = |trace: &Trace| interpolated(trace, &grid);
    Ok(Run {
        name: run.name.clone(),
        displacement_m: without_gaps(of(&run.displacement_m), &run.displacement_m),
        velocity_m_s: run.velocity_m_s.as_ref().map(of),
        drive: run.drive.as_ref().map(|(kind, trace)| (*kind, of(trace))),
        force_n: run.force_n.as_ref().map(|trace| without_gaps(of(trace), trace)),
        case_temp_c: run.case_temp_c.as_ref().map(of),
        body_velocity_m_s: run.body_velocity_m_s.as_ref().map(of),
        force_request_n: run.force_request_n.as_ref().map(of),
        other: run.other.iter().map(|(name, trace)| (name.clone(), of(trace))).collect(),
    })
}

/// Linear interpolation of `trace` at the stamps of `grid` that lie within its samples.
fn interpolated(trace: &Trace, grid: &[Stamp]) -> Trace {
    let mut out = Trace::default();
    let mut next = 0;
    for stamp in grid {
        while next < trace.len() && trace.stamps[next] < *stamp {
            next += 1;
        }
        let value = match (next.checked_sub(1), trace.stamps.get(next)) {
            (_, Some(after)) if after == stamp => trace.values[next],
            (Some(before), Some(after)) => {
                let (from, span_s) = (trace.stamps[before], after.since(trace.stamps[before]).get());
                let share = stamp.since(from).get() / span_s;
                trace.values[before] + share * (trace.values[next] - trace.values[before])
            }
            // Before the first sample, or after the last.
            _ => continue,
        };
        out.stamps.push(*stamp);
        out.values.push(value);
    }
    out
}

/// `resampled` without the samples in the gaps of `trace`.
fn without_gaps(resampled: Trace, trace: &Trace) -> Trace {
    let mut gaps = trace.stamps.windows(2).filter(|pair| pair[1].since(pair[0]).get() > GAP_S).peekable();
    let mut out = Trace::default();
    for (stamp, value) in resampled.stamps.into_iter().zip(resampled.values) {
        while gaps.next_if(|gap| gap[1] <= stamp).is_some() {}
        if gaps.peek().is_none_or(|gap| stamp <= gap[0]) {
            out.stamps.push(stamp);
            out.values.push(value);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::sample::DriveKind;

    fn trace(samples: &[(f64, f64)]) -> Trace {
        Trace {
            stamps: samples.iter().map(|(t, _)| Stamp::from_seconds(*t).expect("a time")).collect(),
            values: samples.iter().map(|(_, value)| *value).collect(),
        }
    }

    #[test]
    fn a_line_stays_a_line_at_every_rate() {
        let uneven = [0.0, 0.003, 0.004, 0.009, 0.0131, 0.02].map(|t| (t, 1.0 + 50.0 * t));
        let run = Run {
            displacement_m: trace(&uneven),
            drive: Some((DriveKind::CoilCurrent, trace(&[(0.0, 1.0), (0.02, 3.0)]))),
            force_n: Some(trace(&[(0.005, 7.0), (0.015, 9.0)])),
            ..Run::default()
        };
        for rate_hz in [300.0, 512.0, 1000.0] {
            let even = resampled(&run, rate_hz, Path::new("a.csv")).expect("a rate");
            let x = &even.displacement_m;
            assert_eq!(x.len(), (0.02 * rate_hz).floor() as usize + 1);
            assert!((x.mean_rate_hz().expect("several") / rate_hz - 1.0).abs() < 1e-6);
            for (stamp, value) in x.stamps.iter().zip(&x.values) {
                let line = 1.0 + 50.0 * stamp.since(Stamp::from_seconds(0.0).expect("zero")).get();
                assert!((value - line).abs() < 1e-12, "{value} {line}");
            }
            // No force is made up before its first and after its last sample.
            let force = even.force_n.expect("force");
            assert!(force.values.iter().all(|f| (7.0..=9.0).contains(f)));
            assert!(force.len() < x.len());
        }
    }

    #[test]
    fn nothing_is_interpolated_across_a_gap_and_bad_rates_are_refused() {
        let run = Run {
            displacement_m: trace(&[(0.0, 0.0), (0.05, 1.0), (0.3, 5.0), (0.35, 6.0)]),
            ..Run::default()
        };
        let even = resampled(&run, 100.0, Path::new("a.csv")).expect("a rate");
        let times_ms: Vec<i64> = even.displacement_m.stamps.iter().map(|s| s.nanos() / 1_000_000).collect();
        assert_eq!(times_ms, [0, 10, 20, 30, 40, 50, 300, 310, 320, 330, 340, 350]);
        for rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e6] {
            let error = resampled(&run, rate_hz, Path::new("a.csv")).expect_err("refused").to_string();
            assert!(error.contains("above 0 and at most"), "{error}");
        }
    }
}
