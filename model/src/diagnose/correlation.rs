//! The signals that the remaining residual correlates with, as a pointer for further work by hand.

use super::Settings;
use super::blocks::Blocks;
use super::finding::Correlation;
use super::rows::Rows;
use crate::identify::Row;
use crate::statistics::block_sums::p_value;
use crate::statistics::correlation::of_centred;

/// Largest probability of listing any correlation by chance when there is none.
const SIGNIFICANCE: f64 = 0.05;
/// Least size of a correlation that is listed.
const LEAST: f64 = 0.05;

/// Name of a signal, and its value at a row, given the row before.
type Signal = (&'static str, fn(&Row, Option<&Row>) -> f64);

const SIGNALS: [Signal; 11] = [
    ("displacement", |row, _| row.displacement_m),
    ("velocity", |row, _| row.velocity_m_s),
    ("speed", |row, _| row.velocity_m_s.abs()),
    ("sign of velocity", |row, _| row.velocity_m_s.signum()),
    ("acceleration", |row, _| row.acceleration_m_s2),
    ("drive", |row, _| row.drive),
    ("drive rate", drive_rate),
    ("drive rate times sign of velocity", |row, before| drive_rate(row, before) * row.velocity_m_s.signum()),
    ("drive times velocity", |row, _| row.drive * row.velocity_m_s),
    ("case temperature", |row, _| row.case_temp_c),
    ("time", |row, _| row.stamp.nanos() as f64 * 1e-9),
];

fn drive_rate(row: &Row, before: Option<&Row>) -> f64 {
    match (before, row.dt_s) {
        (Some(before), Some(dt_s)) => (row.drive - before.drive) / dt_s,
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
        series.extend(
            run.indices.iter().map(|&k| signal(&all[k], k.checked_sub(1).map(|before| &all[before]))),
        );
    }
    if !series.iter().all(|value| value.is_finite()) {
        return None;
    }
    rows.centre(&mut series);
    let coefficient = of_centred(&series, residual);
    let products: Vec<f64> = series.iter().zip(residual).map(|(s, r)| s * r).collect();
    let sums = Blocks::against(rows, &products, settings.training_block_s()).sums(&series, residual);
    let p = p_value(&sums, settings.seed) * SIGNALS.len() as f64;
    (coefficient.abs() >= LEAST && p <= SIGNIFICANCE).then_some(Correlation { with, coefficient })
}
