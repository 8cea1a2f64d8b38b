//! Identification of the fuzzy-tanh model: its parameters, their bounds and their starting values.

use super::dataset::Dataset;
use super::free_sets::FreeSets;
use super::levels::Memberships;
use super::row_problem::{Columns, Training};
use super::scales::Scales;
use super::search::{self, Found, SearchedModel};
use super::tanh_columns::{PER_FUNCTION, TanhColumns};
use super::{Options, Watch};
use crate::error::Error;
use crate::force::{FuzzyTanh, TanhFunction};

/// Names of the parameters of one function, as in the model file.
pub(super) const NAMES: [&str; PER_FUNCTION] =
    ["yield_force_n", "post_yield_damping_n_s_m", "pre_yield_slope_s_m", "coupling_per_s"];

/// Result of the fit.
pub(super) struct Fitted {
    /// The model; its offset is the mean of the runs' offsets.
    pub(super) model: FuzzyTanh,
    /// Its sets.
    pub(super) memberships: Memberships,
    /// Result of the search: functions, followed by sets if they were free.
    pub(super) found: Found,
}

/// Fits the model to `training`, whose drive is of the memberships' kind.
pub(super) fn fit(
    training: Training,
    memberships: Memberships,
    options: &Options,
    watch: &Watch,
) -> Result<Fitted, Error> {
    let datasets = training.runs;
    let searched = tanh_columns(datasets, &memberships)?;
    memberships.check_support(datasets, PER_FUNCTION)?;
    let found = search::search(training, &searched, options, watch)?;
    let model = model(datasets, &memberships, &found.natural, &found)?;
    Ok(Fitted { model, memberships, found })
}

/// As [`fit`], with free centres and widths, starting from `start`. The drive takes `levels` discrete values,
/// or `None` if it varies continuously.
pub(super) fn fit_free(
    training: Training,
    start: &Memberships,
    levels: Option<usize>,
    options: &Options,
    watch: &Watch,
) -> Result<Fitted, Error> {
    let datasets = training.runs;
    let searched = FreeSets::new(tanh_columns(datasets, start)?, start.sets, levels)?;
    start.check_support(datasets, PER_FUNCTION)?;
    let found = search::search(training, &searched, options, watch)?;
    let memberships = searched.found(&found.natural)?;
    let model = model(datasets, &memberships, searched.own(&found.natural), &found)?;
    Ok(Fitted { model, memberships, found })
}

fn model(
    datasets: &[Dataset],
    memberships: &Memberships,
    natural: &[f64],
    found: &Found,
) -> Result<FuzzyTanh, Error> {
    let functions: Vec<TanhFunction> = natural.as_chunks().0.iter().copied().map(TanhFunction::new).collect();
    FuzzyTanh::new(memberships.sets, &functions, super::mean_offset(datasets, &found.offsets_n))
}

/// Mean of the runs' NMSE after a few restarts on a sample of the rows.
pub(super) fn sample_esr(
    datasets: &[Dataset],
    memberships: &Memberships,
    seed: u64,
    watch: &Watch,
) -> Result<f64, Error> {
    let searched = tanh_columns(datasets, memberships)?;
    memberships.check_support(datasets, PER_FUNCTION)?;
    search::sample_esr(datasets, &searched, seed, watch)
}

fn tanh_columns(datasets: &[Dataset], memberships: &Memberships) -> Result<TanhColumns, Error> {
    Ok(TanhColumns { sets: memberships.sets, scales: Scales::of(datasets)? })
}

impl SearchedModel for TanhColumns {
    /// The step is at most a few times the measured force. Its slope lies between a step that spans all
    /// speeds and one that is complete within a thousandth of them. The coupling is limited to twice the
    /// highest frequency, where it would act purely as stiffness. Damping is unbounded.
    fn bounds(&self) -> Vec<[f64; 2]> {
        let s = &self.scales;
        let one = [
            [0.0, 5.0 * s.force_n],
            [f64::NEG_INFINITY, f64::INFINITY],
            [(0.3 / s.velocity_m_s).ln(), (1e3 / s.velocity_m_s).ln()],
            [-2.0 * s.frequency_1_s, 2.0 * s.frequency_1_s],
        ];
        one.repeat(self.sets.len())
    }

    fn is_linear(&self, j: usize) -> bool {
        j % PER_FUNCTION < 2
    }

    fn draw(&self, restart: u32, uniform: &mut dyn FnMut(f64, f64) -> f64) -> Vec<f64> {
        let mut start = vec![0.0; self.parameters()];
        // Functions of one damper are similar: all are drawn around one slope and one coupling. The first
        // restart is a fixed guess, a step over a tenth of all speeds without a loop.
        let (slope, coupling) =
            if restart == 0 { (10.0, 0.0) } else { (uniform(0.0, 5.3).exp(), uniform(-0.5, 0.5)) };
        for p in start.chunks_exact_mut(PER_FUNCTION) {
            let (stretch, shift) =
                if restart == 0 { (1.0, 0.0) } else { (uniform(-0.7, 0.7).exp(), uniform(-0.2, 0.2)) };
            p[2] = (slope * stretch / self.scales.velocity_m_s).ln();
            p[3] = (coupling + shift) * self.scales.frequency_1_s;
        }
        start
    }

    fn settle(&self, start: &mut [f64]) {
        for p in start.chunks_exact_mut(PER_FUNCTION) {
            // A step of zero height would leave its slope undetermined.
            p[0] = p[0].max(0.02 * self.scales.force_n);
        }
    }

    fn natural_slopes(&self, parameters: &[f64]) -> Vec<f64> {
        let slope = |(j, p): (usize, &f64)| if j % PER_FUNCTION == 2 { p.exp() } else { 1.0 };
        parameters.iter().enumerate().map(slope).collect()
    }
}
