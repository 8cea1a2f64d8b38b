//! A weak prior for the range that the runs do not show.
//!
//! Where the runs have few rows, least squares may end at parameters that no damper has (see [`super::swept`]). A second fit then
//! also sees a weak prior: the sines of that sweep, with the force of a step and a viscous damping that grow with the
//! drive,
//!
//! ```text
//! f = A1 tanh(A3 u) + A2 u,    A1 = a0 + a1 |i|,    A2 = b0 + b1 |i|,    a0, a1, b0, b1 >= 0,    u = v + kappa x
//! ```
//!
//! fitted to the same runs. Its rows have so small a weight that they decide only where the runs do not: a sine of the prior
//! weighs as much as 0.05 s of measured rows. A hundredth of this weight leaves faults, and four times as much gives the same
//! errors on other runs within 2 % (decision 21).
//!
//! A polynomial of the velocity cannot follow its runs and also stay bounded at higher speeds. So the prior may double the
//! training error, and if all faults lie above the runs' speeds, it may raise it by 15 %. Otherwise the fit alone is kept, unless
//! it diverges.

use super::dataset::{Dataset, Row};
use super::report::Identified;
use super::row_problem::Prior;
use super::score::walk;
use super::swept::{Range, Sine, SweptFaultKind};
use super::{Loss, Options, Watch, law};
use crate::effect::Augmented;
use crate::error::Error;
use crate::force::ForceModel;
use crate::sample::DriveKind;
use std::ops::ControlFlow;

/// Largest ratio of the training NMSE with the prior to that without.
const MOST_COST: f64 = 2.0;
/// The same, if all faults lie above the speeds of the runs.
const MOST_COST_ABOVE: f64 = 1.15;
/// Weight of all rows of one sine, as time in which measured rows have the same weight, s.
const WORTH_S: f64 = 0.05;
/// Rows of the runs that the prior is fitted to: it need not be exact.
const ROWS: usize = 20_000;
/// Restarts of that fit.
const RESTARTS: u32 = 8;

/// True if the fit `with` a prior is to replace the fit `alone`.
pub(super) fn is_better(with: &Identified, alone: &Identified) -> bool {
    let nmse = |found: &Identified| found.free_run.map_or(f64::INFINITY, |fit| fit.esr);
    let diverges = alone.faults().iter().any(|fault| fault.kind == SweptFaultKind::Diverges);
    let all_above = alone.faults().iter().all(|fault| fault.sine.is_above_the_runs);
    let most = match (diverges, all_above) {
        (true, _) => f64::INFINITY,
        (false, true) => MOST_COST_ABOVE,
        (false, false) => MOST_COST,
    };
    with.faults().len() < alone.faults().len() && nmse(with) <= most * nmse(alone)
}

/// The prior for a model of `datasets` that depends on `drive`. `None` if the runs have no motion.
pub(super) fn prior(
    datasets: &[Dataset],
    drive: Option<DriveKind>,
    seed: u64,
    watch: &Watch,
) -> Result<Option<Prior>, Error> {
    let Some(range) = Range::of(datasets, drive) else { return Ok(None) };
    let quiet = Watch { progress: None, ..*watch };
    let options = Options {
        restarts: RESTARTS,
        most_rows: Some(ROWS),
        loss: Loss::Squares,
        seed,
        ..Options::default()
    };
    let growing = law::fit_growing(datasets, drive, &options, &quiet)?.with_force_offset_n(0.0);
    let sines: Vec<Sine> = range.sines().collect();
    let mut rows: Vec<Row> = sines.iter().flat_map(|sine| range.rows(sine, 1)).collect();
    let magnitudes = rows.iter().map(|row| Row { drive: row.drive.abs(), ..*row }).collect();
    let mut unknown = rows.iter_mut();
    let growing = Augmented::from(ForceModel::Law(growing));
    let walked = walk(&growing, &datasets[0].with_rows(magnitudes), |_, predicted| {
        if let Some(row) = unknown.next() {
            let force_n = predicted.free_run_n;
            *row = Row { force_n, raw_force_n: force_n, counts: force_n.is_finite(), ..*row };
        }
        ControlFlow::Continue(())
    });
    debug_assert!(walked.is_continue(), "the closure never stops the walk");
    let worth_rows = WORTH_S * datasets[0].rate_hz * sines.len() as f64;
    let weight = worth_rows / rows.len() as f64;
    Ok(Some(Prior { run: datasets[0].with_rows(rows), weight }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::condition::Conditioning;
    use crate::identify::DatasetOptions;
    use crate::sample::{Run, Stamp, Trace};

    /// Coils have no polarity: runs at negative currents, too, give a prior that takes energy from the motion at each current.
    #[test]
    fn the_prior_takes_energy_at_each_drive_and_weighs_little() {
        let trace = |f: &dyn Fn(f64) -> f64| Trace {
            stamps: (0..5000).map(|k| Stamp::from_nanos(k * 2_000_000)).collect(),
            values: (0..5000).map(|k| f(f64::from(k) * 2e-3)).collect(),
        };
        let current_a = |t: f64| 1.5 * (1.1 * t).sin() + 0.5;
        let velocity_m_s = |t: f64| 0.2 * (10.0 * t).cos();
        let force_n = |t: f64| (100.0 + 500.0 * current_a(t).max(0.0)) * (40.0 * velocity_m_s(t)).tanh();
        let run = Run {
            name: "made".to_owned(),
            displacement_m: trace(&|t| 0.02 * (10.0 * t).sin()),
            drive: Some((DriveKind::CoilCurrent, trace(&current_a))),
            force_n: Some(trace(&force_n)),
            ..Run::default()
        };
        let data = Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default());
        let data = [data.expect("a run")];
        let found = prior(&data, Some(DriveKind::CoilCurrent), 0, &Watch::none());
        let Prior { run, weight } = found.expect("a fit").expect("the run moves");
        assert!(run.rows.iter().any(|row| row.drive < -0.9), "the lowest current is -1 A");
        let mut energies_j = Vec::new();
        for row in &run.rows {
            if row.dt_s.is_none() {
                energies_j.push(0.0);
            }
            let last_j = energies_j.last_mut().expect("a sine begins without a time step");
            *last_j += row.force_n * row.velocity_m_s * row.dt_s.unwrap_or(0.0);
        }
        assert_eq!(energies_j.len(), 20);
        assert!(energies_j.iter().all(|energy_j| *energy_j > 0.0), "{energies_j:?}");
        // All sines together weigh as much as one second of the run.
        let rows = weight * run.counted() as f64;
        assert!((rows / 500.0 - 1.0).abs() < 0.01, "{rows}");
    }
}
