//! The energy that a damper takes up in a cycle, as a check on the cause of a change.
//!
//! ```text
//! W_r = mean over the cycles of  integral r v dt         r: the residual, force still to explain
//! W_e = mean over the cycles of  integral (M_with - M_without) v dt
//! ```
//!
//! An effect that takes up energy must show in the energy of the residual. A fit alone does not ensure that: an error of phase, for
//! example, looks like friction, but leaves the energy of a cycle as it is. Known for runs with a cyclic motion.

use super::Thresholds;
use super::rows::Rows;
use crate::condition::{ApplyTo, LowPassState};
use crate::identify::{Dataset, Row};
use crate::statistics::block_sums::t95;

/// Mean energy of a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Work {
    mean_j: f64,
    /// The same with all power counted as positive.
    moved_j: f64,
    /// Half of its 95 % interval.
    margin_j: f64,
}

impl Work {
    fn is_neutral(&self, thresholds: &Thresholds) -> bool {
        self.mean_j.abs() <= thresholds.energy_neutral * self.moved_j
    }
}

/// Energy of the residual and of an effect, J per cycle, that contradict each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Contradiction {
    pub(super) residual_j: f64,
    pub(super) effect_j: f64,
}

/// True if an effect that changes the simulated force by `change_n` takes up no energy on a cyclic motion, as a spring or a mass does.
pub(super) fn is_neutral(rows: &Rows, change_n: &[f64], thresholds: &Thresholds) -> bool {
    work(rows, change_n).is_some_and(|work| work.is_neutral(thresholds))
}

/// The energies of an effect that changes the simulated force by `change_n`, and of the residual before it was added, if the residual
/// denies the effect. `None` also if the motion of a run is not cyclic.
pub(super) fn denies(
    rows: &Rows,
    residual_n: &[f64],
    change_n: &[f64],
    thresholds: &Thresholds,
) -> Option<Contradiction> {
    let (residual, effect) = (work(rows, residual_n)?, work(rows, change_n)?);
    let (found, there) = (effect.mean_j, residual.mean_j);
    if effect.is_neutral(thresholds) {
        return None;
    }
    let other_way = found * there < 0.0 && found.abs() > residual.margin_j;
    let too_much = found.abs() > thresholds.energy_ratio * there.abs() + residual.margin_j;
    (other_way || too_much).then_some(Contradiction { residual_j: there, effect_j: found })
}

fn work(rows: &Rows, force_n: &[f64]) -> Option<Work> {
    let (mut energies, mut moved_j) = (Vec::new(), 0.0);
    for run in rows.runs() {
        let cycles = run.cycles?;
        let velocity_m_s = velocity_m_s(run.dataset);
        let mut own = vec![0.0; cycles.count];
        for ((&k, at), time_s) in run.indices.iter().zip(run.range.clone()).zip(run.times_s()) {
            let Some(number) = cycles.number(time_s) else { continue };
            let energy_j = force_n[at] * velocity_m_s[k] * run.step_s;
            own[number] += energy_j;
            moved_j += energy_j.abs();
        }
        energies.extend(own);
    }
    let count = energies.len() as f64;
    let mean_j = energies.iter().sum::<f64>() / count;
    let squares = energies.iter().map(|e| (e - mean_j).powi(2)).sum::<f64>();
    let margin_j = t95(energies.len()) * (squares / (count - 1.0) / count).sqrt();
    margin_j.is_finite().then_some(Work { mean_j, moved_j: moved_j / count, margin_j })
}

/// The velocity at each row, m/s, behind the filter that the force is behind.
fn velocity_m_s(run: &Dataset) -> Vec<f64> {
    if run.conditioning.apply_to != ApplyTo::Output {
        return run.rows.iter().map(|row| row.velocity_m_s).collect();
    }
    let (filter, mut state) = (run.conditioning.low_pass(), LowPassState::default());
    let filtered = |row: &Row| match row.velocity_m_s.is_finite() {
        true => filter.step(&mut state, row.dt_s, row.velocity_m_s),
        false => f64::NAN,
    };
    run.rows.iter().map(filtered).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::condition::Conditioning;
    use crate::diagnose::cycle::Cycles;
    use crate::identify::DatasetOptions;
    use crate::rig::{Channels, Experiment, Plant, record};

    /// Whether the energy of `residual` denies the force `change`, both functions of displacement and velocity, on ten cycles.
    fn is_denied(residual: fn(f64, f64) -> f64, change: fn(f64, f64) -> f64) -> bool {
        let run = record(&Experiment::sine(0.01, 2.0, 1.2, 8.0), &Plant::default(), &Channels::PERFECT, 1);
        let conditioning = Conditioning { apply_to: ApplyTo::None, ..Conditioning::default() };
        let data = [Dataset::from_run(&run, &conditioning, &DatasetOptions::default()).expect("rows")];
        let rows = Rows::new(&data, usize::MAX).with_cycles(std::iter::once(Cycles::of(&data[0])));
        assert!(rows.runs()[0].cycles.is_some(), "a sine is cyclic");
        let of = |force: fn(f64, f64) -> f64| -> Vec<f64> {
            let rows = rows.runs()[0].indices.iter().map(|&k| data[0].rows[k]);
            rows.map(|row| force(row.displacement_m, row.velocity_m_s)).collect()
        };
        denies(&rows, &of(residual), &of(change), &Thresholds::default()).is_some()
    }

    #[test]
    fn an_effect_must_show_in_the_energy_of_the_residual() {
        let friction = |_, v: f64| 50.0 * v.signum();
        assert!(!is_denied(friction, |_, v| 48.0 * v.signum()), "about the same energy");
        assert!(is_denied(friction, |_, v| -48.0 * v.signum()), "the other way");
        assert!(is_denied(friction, |_, v| 120.0 * v.signum()), "too much");
        assert!(is_denied(|x, _| 5000.0 * x, friction), "a spring takes up nothing");
        assert!(!is_denied(|x, _| 5000.0 * x, |x, _| 4000.0 * x), "a spring is not denied");
        assert!(!is_denied(friction, |x, _| 4000.0 * x), "and takes up nothing that friction could deny");
    }
}
