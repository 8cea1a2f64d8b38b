//! The energy that a damper takes up in a cycle, as a check on the cause of a change.
//!
//! ```text
//! W_r = mean over the cycles of  integral r v dt         r: the residual, force still to explain
//! W_e = mean over the cycles of  integral (M_with - M_without) v dt
//! ```
//!
//! An effect that takes up energy must show in the energy of the residual. A fit alone does not ensure that: an error of phase, for
//! example, looks like friction, but leaves the energy of a cycle as it is. Known for runs with a cyclic motion.

use super::rows::Rows;
use crate::statistics::block_sums::t95;

/// Times that an effect may take up the energy that the residual has.
const MOST: f64 = 2.0;

/// Mean energy of a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Work {
    mean_j: f64,
    /// Half of its 95 % interval.
    margin_j: f64,
}

/// Energy of the residual and of an effect, J per cycle, that contradict each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Contradiction {
    pub(super) residual_j: f64,
    pub(super) effect_j: f64,
}

/// The energies of an effect that changes the simulated force by `change_n`, and of the residual before it was added, if the residual
/// denies the effect. `None` also if the motion of a run is not cyclic.
pub(super) fn denies(rows: &Rows, residual_n: &[f64], change_n: &[f64]) -> Option<Contradiction> {
    let (residual, effect) = (work(rows, residual_n)?, work(rows, change_n)?);
    let (found, there) = (effect.mean_j, residual.mean_j);
    let other_way = found * there < 0.0 && found.abs() > residual.margin_j;
    let too_much = found.abs() > MOST * there.abs() + residual.margin_j;
    (other_way || too_much).then_some(Contradiction { residual_j: there, effect_j: found })
}

fn work(rows: &Rows, force_n: &[f64]) -> Option<Work> {
    let mut energies: Vec<f64> = Vec::new();
    for run in rows.runs() {
        let cycles = run.cycles?;
        let mut own = vec![0.0; cycles.count];
        for ((&k, at), time_s) in run.indices.iter().zip(run.range.clone()).zip(run.times_s()) {
            let Some(number) = cycles.number(time_s) else { continue };
            own[number] += force_n[at] * run.dataset.rows[k].velocity_m_s * run.step_s;
        }
        energies.extend(own);
    }
    let count = energies.len() as f64;
    let mean_j = energies.iter().sum::<f64>() / count;
    let squares = energies.iter().map(|e| (e - mean_j).powi(2)).sum::<f64>();
    let margin_j = t95(energies.len()) * (squares / (count - 1.0) / count).sqrt();
    margin_j.is_finite().then_some(Work { mean_j, margin_j })
}
