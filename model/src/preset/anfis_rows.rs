//! The thesis' ANFIS models, eight of nine Gaussians and 27 rules each, from `data/anfis-*.csv`.
//!
//! The numbers in `anfis-ranges.csv`, `anfis-memberships.csv` and `anfis-conclusions.csv` are as printed, for
//! normalised inputs (displacement, velocity, current) and normalised force. Characters that are lost in print
//! were restored from the digits around them. Two leading digits are uncertain, and were chosen for a smooth
//! surface: the slope of rule 18 over velocity in RP-ICPS, and the slope of rule 14 over current in RP-APRBS.
//! Some last digits without effect are uncertain in RP-APRBS, RP-ICPS-L, RP2-CS and RP3-CS. The order of rules
//! is lexicographic; it is partly illegible in print, but the surfaces support it.
//!
//! The normalisation is not printed. `anfis-normalisation.csv` is a reconstruction, and the scale of every model
//! depends on it:
//!
//! - displacement: width of the recorded range over the width of the normalised input range. The mean is not
//!   known; here displacement is relative to the mean of the recording.
//! - current: from the extremes 0 and 2.5 A. Doubtful for RP-PRBS, whose two levels do not fit it.
//! - velocity: estimated to about 10 % from agreement with the other models of the same data; its mean is
//!   assumed to be zero. This is the least certain of the four.
//! - force: square root of the variance that the error tables imply, to a few percent; its mean is assumed to
//!   be zero.

use super::tables::{ANFIS_CONCLUSIONS, ANFIS_MEMBERSHIPS, ANFIS_NORMALISATION, ANFIS_RANGES, find, rows_of};
use crate::error::Error;
use crate::force::{Order, OutputScale, Signal, Tsk, TskInput, TskKind, TskSet};
use crate::model::Envelope;
use crate::sample::DriveKind;
use crate::units::{M_PER_IN, N_PER_LBF};

/// The model of `experiment`, and the ranges of its data except the drive.
pub(super) fn model(experiment: &str) -> Option<(Tsk, Envelope)> {
    let normalisation = Normalisation::new(find(&ANFIS_NORMALISATION, [experiment])?);
    let sets = rows_of(&ANFIS_MEMBERSHIPS, experiment);
    let conclusions = rows_of(&ANFIS_CONCLUSIONS, experiment);
    // The tables hold valid numbers only, so construction cannot fail; a `None` would fail the tests.
    let tsk = normalisation.tsk(&sets, conclusions.as_flattened()).ok()?;
    Some((tsk, normalisation.envelope(&find(&ANFIS_RANGES, [experiment])?)))
}

/// Normalisation of the inputs and of the force.
struct Normalisation {
    /// Mean and standard deviation of displacement (m), velocity (m/s) and current (A).
    inputs: [(f64, f64); 3],
    /// Standard deviation of the force, whose mean is zero.
    force_std_dev_lbf: f64,
}

impl Normalisation {
    fn new([displacement_in, velocity_in_s, current_a, current_mean_a, force_std_dev_lbf]: [f64; 5]) -> Self {
        let inputs =
            [(0.0, displacement_in * M_PER_IN), (0.0, velocity_in_s * M_PER_IN), (current_mean_a, current_a)];
        Self { inputs, force_std_dev_lbf }
    }

    /// The model with three membership functions (sigma, centre) for each input.
    fn tsk(&self, sets: &[[f64; 2]], conclusions: &[f64]) -> Result<Tsk, Error> {
        let gaussian = |[sigma, centre]: &[f64; 2]| TskSet::Gaussian { centre: *centre, sigma: *sigma };
        let signals = [Signal::Displacement, Signal::Velocity, Signal::Drive(DriveKind::CoilCurrent)];
        let inputs = signals
            .into_iter()
            .zip(&self.inputs)
            .zip(sets.chunks(3))
            .map(|((signal, (mean, std_dev)), sets)| {
                let sets: Vec<TskSet> = sets.iter().map(gaussian).collect();
                TskInput::new(signal, *mean, *std_dev, &sets)
            })
            .collect::<Result<Vec<_>, Error>>()?;
        let output = OutputScale { mean_n: 0.0, std_dev_n: self.force_std_dev_lbf * N_PER_LBF };
        Tsk::new(TskKind::Anfis, &inputs, Order::First, conclusions, output, 0.0)
    }

    /// The ranges in SI units: minimum and maximum of displacement, velocity, current and force.
    fn envelope(&self, ranges: &[f64; 8]) -> Envelope {
        let range = |j: usize| {
            let (mean, std_dev) = self.inputs[j];
            [ranges[2 * j], ranges[2 * j + 1]].map(|u| mean + std_dev * u)
        };
        Envelope {
            displacement_m: Some(range(0)),
            velocity_m_s: Some(range(1)),
            drive: None,
            force_n: Some([ranges[6], ranges[7]].map(|f| f * self.force_std_dev_lbf * N_PER_LBF)),
            case_temp_c: None,
        }
    }
}

#[cfg(test)]
mod tests;
