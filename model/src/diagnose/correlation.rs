//! The signals that the remaining residual correlates with, as a pointer for further work by hand.

use super::Settings;
use super::blocks::Blocks;
use super::finding::Correlation;
use super::rows::{Rows, dot};
use crate::identify::Row;
use crate::statistics::block_sums::p_value;
use crate::statistics::correlation::of_centred;

/// A row with what a signal needs besides.
struct Place<'a> {
    row: &'a Row,
    before: Option<&'a Row>,
    /// Time since the run's first row, s.
    time_s: f64,
}

/// Name of a signal, and its value at a row.
type Signal = (&'static str, fn(&Place) -> f64);

const SIGNALS: [Signal; 11] = [
    ("displacement", |at| at.row.displacement_m),
    ("velocity", |at| at.row.velocity_m_s),
    ("speed", |at| at.row.velocity_m_s.abs()),
    ("sign of velocity", |at| at.row.velocity_m_s.signum()),
    ("acceleration", |at| at.row.acceleration_m_s2),
    ("drive", |at| at.row.drive),
    ("drive rate", drive_rate),
    ("drive rate times sign of velocity", |at| drive_rate(at) * at.row.velocity_m_s.signum()),
    ("drive times velocity", |at| at.row.drive * at.row.velocity_m_s),
    ("case temperature", |at| at.row.case_temp_c),
    ("time", |at| at.time_s),
];

fn drive_rate(at: &Place) -> f64 {
    match (at.before, at.row.dt_s) {
        (Some(before), Some(dt_s)) => (at.row.drive - before.drive) / dt_s,
        _ => 0.0,
    }
}

/// The signals that `residual` correlates with, strongest first.
pub(super) fn correlates_with(rows: &Rows, residual: &[f64], settings: &Settings) -> Vec<Correlation> {
    let mut found: Vec<Correlation> =
        SIGNALS.iter().filter_map(|signal| correlation(rows, residual, signal, settings)).collect();
    found.sort_by(|a, b| b.coefficient.abs().total_cmp(&a.coefficient.abs()));
    found
}

fn correlation(
    rows: &Rows,
    residual: &[f64],
    (with, signal): &Signal,
    settings: &Settings,
) -> Option<Correlation> {
    let mut series: Vec<f64> = Vec::with_capacity(residual.len());
    for run in rows.runs() {
        let all = &run.dataset.rows;
        let places = run.indices.iter().zip(run.times_s()).map(|(&k, time_s)| Place {
            row: &all[k],
            before: k.checked_sub(1).map(|before| &all[before]),
            time_s,
        });
        series.extend(places.map(|at| signal(&at)));
    }
    if !series.iter().all(|value| value.is_finite()) {
        return None;
    }
    rows.centre(&mut series);
    let coefficient = of_centred(&series, residual);
    // The block length follows from what the signal does not explain: the signal itself may be as slow as time.
    let slope = dot(&series, residual) / dot(&series, &series).max(f64::MIN_POSITIVE);
    let rest: Vec<f64> = series.iter().zip(residual).map(|(s, r)| s * (r - slope * s)).collect();
    let sums = Blocks::against(rows, &rest, settings.training_block_s()).sums(&series, residual);
    let p = p_value(&sums, settings.seed) * SIGNALS.len() as f64;
    (coefficient.abs() >= settings.thresholds.least_correlation && p <= settings.thresholds.correlation_p)
        .then_some(Correlation { with, coefficient })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::condition::Conditioning;
    use crate::identify::{Dataset, DatasetOptions};
    use crate::rig::{Channels, Experiment, Plant, record};
    use crate::sample::Trace;

    /// The correlations of a residual that grows with time, in a run that begins `epoch_ns` after the epoch.
    fn found(epoch_ns: i64) -> Vec<Correlation> {
        let mut run =
            record(&Experiment::sine(0.01, 1.0, 1.2, 60.0), &Plant::default(), &Channels::default(), 1);
        let shift = |trace: &mut Trace| {
            trace.stamps.iter_mut().for_each(|stamp| *stamp = stamp.shifted(epoch_ns));
        };
        shift(&mut run.displacement_m);
        run.drive.iter_mut().for_each(|(_, trace)| shift(trace));
        [&mut run.force_n, &mut run.velocity_m_s, &mut run.case_temp_c].into_iter().flatten().for_each(shift);
        let data =
            [Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default()).expect("rows")];
        let rows = Rows::new(&data, usize::MAX);
        // A slope in noise: without the noise, neighbouring rows would not be independent.
        let noise = |k: usize| (k * 7_919 % 1_000) as f64 / 500.0 - 1.0;
        let mut residual: Vec<f64> =
            rows.runs()[0].times_s().enumerate().map(|(k, time_s)| 0.02 * time_s + noise(k)).collect();
        rows.centre(&mut residual);
        correlates_with(&rows, &residual, &Settings::default())
    }

    #[test]
    fn correlations_do_not_depend_on_the_epoch() {
        let at_zero = found(0);
        assert!(at_zero.iter().any(|correlation| correlation.with == "time"), "{at_zero:?}");
        assert_eq!(at_zero, found(1_700_000_000_123_456_789));
    }
}
