//! The space of structures: what the force of a damper may be, whatever the structure of its model is.
//!
//! ```text
//! S = w_j(i) times { hat functions of v,  bristles z of five lengths,  x }          j: five levels of the drive
//!     u_k(i) times { tanh(4 v / v_max),  v,  z of the middle length }               k: 21 levels
//! L dz/dt = v - |v| z         z <- s + (z - s) exp(-|v| dt / L),   s = sign v
//! ```
//!
//! A sum of such columns is a generalised Maxwell-slip (Prandtl-Ishlinskii) model under fuzzy sets. On healthy dampers with the structures of
//! Bouc-Wen and LuGre it leaves 0.1 to 1 % of the variance of the force, where a static curve leaves 36 to 47 %.
//!
//! Source: `[goldfarb1997]` in the bibliography (node/docs/guide/bibliography.md) for the Maxwell-slip model.

use super::series::Filters;
use crate::diagnose::rows::{Rows, RunRows};
use crate::identify::Scales;
use crate::statistics::range;

/// Lengths of the bristles, as shares of the largest displacement.
const LENGTHS: [f64; 5] = [0.03, 0.06, 0.12, 0.24, 0.48];
/// Places of the hat functions of the velocity, as shares of the largest: dense where the force yields.
const VELOCITIES: [f64; 9] = [-1.0, -0.45, -0.18, -0.06, 0.0, 0.06, 0.18, 0.45, 1.0];
/// Largest number of levels of the drive.
const LEVELS: usize = 5;
/// Largest number of levels of the fine columns, which follow what the fuzzy sets of a base do between their centres.
const FINE_LEVELS: usize = 21;
/// Steepness of the fine columns' yield, relative to the largest velocity.
const STEEP: f64 = 4.0;
/// Columns of one level, coarse and fine.
const OF_LEVEL: usize = VELOCITIES.len() + LENGTHS.len() + 1;
const OF_FINE_LEVEL: usize = 3;

/// The levels of the drive: even over its range; one without a drive that changes.
pub(super) struct Levels {
    coarse: Vec<f64>,
    fine: Vec<f64>,
}

/// The levels of the drive in `rows`.
pub(super) fn levels(rows: &Rows) -> Levels {
    let drives = rows.runs().iter().flat_map(|run| run.indices.iter().map(|k| run.dataset.rows[*k].drive));
    let [low, high] = range(drives.filter(|drive| drive.is_finite()));
    let varies = high - low > 1e-3 * high.abs().max(1e-9);
    if !varies {
        return Levels { coarse: vec![0.0], fine: Vec::new() };
    }
    let even = |n: usize| (0..n).map(|j| low + (high - low) * j as f64 / (n - 1) as f64).collect();
    Levels { coarse: even(LEVELS), fine: even(FINE_LEVELS) }
}

/// The columns of the space over `rows`, each run's mean removed.
pub(super) fn columns(rows: &Rows, scales: &Scales, levels: &Levels) -> Vec<Vec<f64>> {
    let count = OF_LEVEL * levels.coarse.len() + OF_FINE_LEVEL * levels.fine.len();
    let mut columns: Vec<Vec<f64>> = vec![Vec::new(); count];
    for run in rows.runs() {
        of_run(run, scales, levels, &mut columns);
    }
    columns.iter_mut().for_each(|column| rows.centre(column));
    columns
}

fn of_run(run: &RunRows, scales: &Scales, levels: &Levels, columns: &mut [Vec<f64>]) {
    let lengths_m = LENGTHS.map(|length| length * scales.displacement_m);
    let knots = VELOCITIES.map(|place| place * scales.velocity_m_s);
    let mut bristles = [0.0; LENGTHS.len()];
    let mut filters = Filters::new(&run.dataset.conditioning, columns.len());
    let mut wanted = run.indices.iter().peekable();
    for (index, row) in run.dataset.rows.iter().enumerate() {
        let (v, sign) = (row.velocity_m_s, row.velocity_m_s.signum());
        match row.dt_s {
            Some(dt_s) if v.is_finite() => {
                for (z, length_m) in bristles.iter_mut().zip(lengths_m) {
                    *z = sign + (*z - sign) * (-v.abs() * dt_s / length_m).exp();
                }
            }
            _ => bristles = [0.0; LENGTHS.len()],
        }
        let weights = hats(&levels.coarse, row.drive);
        let fine_weights = if levels.fine.is_empty() { Vec::new() } else { hats(&levels.fine, row.drive) };
        let relative = v / scales.velocity_m_s;
        let fine = [(STEEP * relative).tanh(), relative, bristles[LENGTHS.len() / 2]];
        let of_velocity = hats(&knots, v);
        let position = row.displacement_m / scales.displacement_m;
        let own: Vec<f64> = of_velocity.into_iter().chain(bristles).chain([position]).collect();
        let all = weights.iter().flat_map(|weight| own.iter().map(move |value| weight * value));
        let all = all.chain(fine_weights.iter().flat_map(|weight| fine.map(|value| weight * value)));
        let values = filters.step(row.dt_s, all);
        if wanted.next_if(|next| **next == index).is_some() {
            columns.iter_mut().zip(values).for_each(|(column, value)| column.push(*value));
        }
    }
}

/// The hat functions over `knots` at `at`; beyond the ends they are constant. One knot is 1 everywhere.
fn hats(knots: &[f64], at: f64) -> Vec<f64> {
    let mut weights = vec![0.0; knots.len()];
    let (index, share) = place(knots, at);
    weights[index] = 1.0 - share;
    if share > 0.0 {
        weights[index + 1] = share;
    }
    weights
}

/// The knot below `at` and the share of the way to the next one, 0 to 1; clamped to the ends.
pub(super) fn place(knots: &[f64], at: f64) -> (usize, f64) {
    let last = knots.len() - 1;
    let above = knots.partition_point(|knot| *knot <= at);
    if above == 0 || last == 0 || !at.is_finite() {
        return (0, 0.0);
    }
    if above > last {
        return (last, 0.0);
    }
    let (low, high) = (knots[above - 1], knots[above]);
    (above - 1, (at - low) / (high - low))
}
