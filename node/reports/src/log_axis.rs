//! Range and ticks of logarithmic axes. An axis is a linear [`Scale`] over decimal logarithms.

use super::scale::{Scale, range};

/// A scale over the decimal logarithms of `values`, with a margin at both ends. Values that are not positive are
/// ignored.
pub(super) fn log_scale(values: impl Iterator<Item = f64>, place_from: f64, place_to: f64) -> Scale {
    let (from, to) = range(values.filter(|value| *value > 0.0).map(f64::log10));
    // Less than a third of a decade might contain no tick.
    let short = (0.35 - (to - from)).max(0.0) / 2.0;
    Scale { from: from - short, to: to + short, place_from, place_to }
}

/// Ticks at round values, as logarithms with labels: decades, with 2 and 5 or finer steps in between where the span is
/// short.
pub(super) fn log_ticks(scale: &Scale) -> Vec<(f64, String)> {
    let factors: &[f64] = match scale.to - scale.from {
        span if span <= 0.7 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
        span if span <= 1.6 => &[1.0, 2.0, 5.0],
        span if span <= 3.0 => &[1.0, 3.0],
        _ => &[1.0],
    };
    let (first, last) = (scale.from.floor() as i32, scale.to.ceil() as i32);
    (first..=last)
        .flat_map(|decade| factors.iter().map(move |factor| (decade, factor)))
        .map(|(decade, factor)| (f64::from(decade) + factor.log10(), label(*factor, decade)))
        .filter(|(at, _)| scale.holds(*at))
        .collect()
}

/// The label of `factor` × 10^`decade`: written out for decades from -4 to 5, with an exponent beyond.
fn label(factor: f64, decade: i32) -> String {
    match decade {
        -4..=5 => {
            let decimals = (-decade).max(0) as usize + usize::from(factor.fract() > 0.0 && decade <= 0);
            format!("{:.decimals$}", factor * 10_f64.powi(decade))
        }
        _ => format!("{factor:.0}e{decade}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(values: &[f64]) -> Vec<String> {
        let scale = log_scale(values.iter().copied(), 0.0, 100.0);
        log_ticks(&scale).into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_decades_with_finer_steps_on_short_spans() {
        assert_eq!(labels(&[0.01, 0.3]), ["0.01", "0.02", "0.05", "0.1", "0.2"]);
        assert_eq!(labels(&[0.1, 0.2]), ["0.1", "0.15", "0.2"]);
        assert_eq!(labels(&[0.001, 0.5]), ["0.001", "0.003", "0.01", "0.03", "0.1", "0.3"]);
        assert_eq!(labels(&[5.0, 4e5]), ["10", "100", "1000", "10000", "100000"]);
        assert!(!labels(&[0.04, 0.04]).is_empty());
    }

    #[test]
    fn values_without_a_logarithm_are_ignored() {
        let scale = log_scale([0.0, -1.0, f64::NAN].into_iter(), 0.0, 100.0);
        assert!(scale.from < scale.to);
    }
}
