//! The curve of a term without a closed form, with its 95 % band, to be compared with the closed form.
//!
//! ```text
//! M_k   = m hat_k(q)                      hat functions on a few knots of the argument, each run's mean removed
//! P     = M - N C,  C = K^-1 N'M          what the nuisance space cannot follow; N without the numbers of the term itself
//! delta = (P'M + ridge)^-1 P'e            e: what the model with the term leaves, of training and validation runs
//! curve = c g(knots) + delta
//! band  = curve +- t sqrt(diag V),  V = B (sum_b s_b s_b') B n / (n - k),   B = (P'M + ridge)^-1,   s_b = sum in block b of P (e - P delta)
//! ```
//!
//! The band follows from sums over blocks, because samples of a residual are not independent. A direction of the curve that the base or the
//! space of structures can follow is not determined by these runs: the ridge keeps it at the closed form. This holds for the level of a curve
//! whose modulator is one, since each run has its own force offset.

use super::claim::Healthy;
use super::nuisance::{KnownStructure, Side, Sides};
use super::screen::{Hats, knots};
use super::{BothBlocks, Search};
use crate::diagnose::joint::Fitted;
use crate::diagnose::rows::{Rows, dot};
use crate::effect::term::{Form, Term};
use crate::error::Error;
use crate::statistics::block_sums::t95;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Largest number of knots.
const MOST_KNOTS: usize = 12;
/// Least number of knots: with fewer a curve has no shape.
const LEAST_KNOTS: usize = 4;
/// Least number of blocks per knot.
const BLOCKS_PER_KNOT: usize = 2;
/// Added to the diagonal, as a share of the power of each hat function.
const RIDGE: f64 = 1e-3;

/// The curve of a term at one value of its argument.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// The argument, in its unit.
    pub argument: f64,
    /// The curve there without a closed form, in the unit of c g(q).
    pub value: f64,
    /// Its 95 % band.
    pub ci95: [f64; 2],
}

/// The curve of term `index` of `fitted`. Empty for a resonance, and if the runs have too few blocks.
///
/// # Errors
/// [`Error::Cancelled`]; errors of the simulation.
pub(super) fn curve(
    search: &Search,
    fitted: &Fitted,
    healthy_rows: &Rows,
    blocks: &BothBlocks,
    index: usize,
) -> Result<Vec<CurvePoint>, Error> {
    let count = (blocks.count() / BLOCKS_PER_KNOT).min(MOST_KNOTS);
    let term = fitted.model.effects().terms().iter().nth(index).copied();
    let Some(term) = term.filter(|term| count >= LEAST_KNOTS && term.kind().2 != Form::Resonance) else {
        return Ok(Vec::new());
    };
    let healthy = Healthy::new(search, healthy_rows, &fitted.model)?;
    let known = healthy.as_ref().and_then(Healthy::structure);
    points(search, fitted, known, blocks, (index, &term), count).map(Option::unwrap_or_default)
}

/// The points; `None` if the model cannot be simulated, the argument does not vary, or the runs do not determine the curve.
fn points(
    search: &Search,
    fitted: &Fitted,
    known: Option<&KnownStructure>,
    blocks: &BothBlocks,
    (index, term): (usize, &Term),
    count: usize,
) -> Result<Option<Vec<CurvePoint>>, Error> {
    let Some(sides) = Sides::without_term(search, fitted, known, index)? else { return Ok(None) };
    let (_, argument, _) = term.kind();
    let series = sides.train.series.argument(argument);
    let Some(at) = series.and_then(|series| knots(argument, series, count)) else { return Ok(None) };
    let columns = |side: &Side| Columns::new(side, term, &at);
    let (Some(train), Some(confirm)) = (columns(&sides.train), columns(&sides.confirm)) else {
        return Ok(None);
    };
    let parts = [(train, &blocks.train), (confirm, &blocks.confirm)];
    let parts = parts.map(|(columns, blocks)| (columns, |a: &[f64], b: &[f64]| blocks.sums(a, b)));
    let Some((delta, half)) = deviation(&parts) else { return Ok(None) };
    let point = |(place, argument): (usize, &f64)| {
        let value = term.curve(*argument) + delta[place];
        CurvePoint { argument: *argument, value, ci95: [value - half[place], value + half[place]] }
    };
    let points: Vec<CurvePoint> = at.iter().enumerate().map(point).collect();
    Ok(points.iter().all(|point| point.ci95.iter().all(|end| end.is_finite())).then_some(points))
}

/// The hat functions on one side with the nuisance space projected off, and what the model leaves.
struct Columns {
    /// M, column by column.
    whole: Vec<Vec<f64>>,
    /// P, column by column.
    projected: Vec<Vec<f64>>,
    /// e.
    rest_n: Vec<f64>,
}

impl Columns {
    fn new(side: &Side, term: &Term, at: &[f64]) -> Option<Self> {
        let (modulator, argument, _) = term.kind();
        let hats = Hats::new(side, modulator, argument, at)?;
        let unit = |k: usize| DVector::from_fn(at.len(), |row, _| f64::from(row == k));
        let whole: Vec<Vec<f64>> = (0..at.len()).map(|k| hats.series(side, &unit(k))).collect();
        let projected = whole.iter().map(|column| side.nuisance.project(column.clone())).collect();
        Some(Self { whole, projected, rest_n: side.fitted_rest_n.clone() })
    }
}

/// Delta and half the width of its 95 % band. Each part has a function that sums the product of two series over each of its blocks. `None`
/// if there are not more blocks than knots, or the sums cannot be inverted.
fn deviation<S: Fn(&[f64], &[f64]) -> Vec<f64>>(
    parts: &[(Columns, S)],
) -> Option<(DVector<f64>, DVector<f64>)> {
    let knots = parts.first()?.0.whole.len();
    let (mut square, mut along) = (DMatrix::<f64>::zeros(knots, knots), DVector::<f64>::zeros(knots));
    for (Columns { whole, projected, rest_n }, _) in parts {
        square += DMatrix::from_fn(knots, knots, |a, b| dot(&projected[a], &whole[b]));
        along += DVector::from_fn(knots, |k, _| dot(&projected[k], rest_n));
        for k in 0..knots {
            square[(k, k)] += RIDGE * dot(&whole[k], &whole[k]);
        }
    }
    let inverse = Cholesky::new(square)?.inverse();
    let delta = &inverse * along;
    let (mut variance, mut blocks) = (DVector::<f64>::zeros(knots), 0_usize);
    for (Columns { projected, rest_n, .. }, sums) in parts {
        let mut rest_n = rest_n.clone();
        for (column, delta) in projected.iter().zip(delta.iter()) {
            rest_n.iter_mut().zip(column).for_each(|(rest, value)| *rest -= delta * value);
        }
        let scores: Vec<Vec<f64>> = projected.iter().map(|column| sums(column, &rest_n)).collect();
        let here = scores.first()?.len();
        let score = |block: usize| DVector::from_iterator(knots, scores.iter().map(|sums| sums[block]));
        for block in 0..here {
            variance += (&inverse * score(block)).map(|step| step * step);
        }
        blocks += here;
    }
    let free = blocks as f64 - knots as f64;
    let t = t95(blocks.checked_sub(knots)?.max(1) + 1);
    (free > 0.0).then(|| (delta, variance.map(|v| t * (v * blocks as f64 / free).sqrt())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// Sums of products over blocks of 250 rows.
    fn sums(a: &[f64], b: &[f64]) -> Vec<f64> {
        a.chunks(250).zip(b.chunks(250)).map(|(a, b)| dot(a, b)).collect()
    }

    /// A function that sums products over blocks.
    type BlockSums = fn(&[f64], &[f64]) -> Vec<f64>;

    /// Two sides of 3000 rows in blocks of 250: six hat functions of a slow argument, no nuisance, and a residual that is the curve
    /// `truth` plus correlated noise.
    fn sides(truth: &[f64; 6], random: &mut Pcg64Mcg) -> [(Columns, BlockSums); 2] {
        [0.0, 1.0].map(|side: f64| {
            let argument = |row: usize| 2.5 + 2.5 * (0.011 * row as f64 + side).sin();
            let hat = |k: usize, row: usize| (1.0 - (argument(row) - k as f64).abs()).max(0.0);
            let whole: Vec<Vec<f64>> = (0..6).map(|k| (0..3000).map(|row| hat(k, row)).collect()).collect();
            let mut noise = 0.0;
            let rest_n = (0..3000).map(|row| {
                // A correlation time of about ten rows.
                noise = 0.9 * noise + (0..4).map(|_| random.random::<f64>() - 0.5).sum::<f64>();
                noise + (0..6).map(|k| truth[k] * hat(k, row)).sum::<f64>()
            });
            (
                Columns { projected: whole.clone(), rest_n: rest_n.collect(), whole },
                sums as fn(&[f64], &[f64]) -> Vec<f64>,
            )
        })
    }

    #[test]
    fn the_band_contains_the_true_curve_in_95_of_100_cases() {
        let truth = [0.4, -0.2, 0.0, 0.3, 0.5, -0.4];
        let (mut inside, mut all) = (0.0, 0.0);
        for seed in 0..300 {
            let parts = sides(&truth, &mut Pcg64Mcg::seed_from_u64(seed));
            let (delta, half) = deviation(&parts).expect("more blocks than knots");
            for k in 0..6 {
                inside += f64::from((delta[k] - truth[k]).abs() <= half[k]);
                all += 1.0;
            }
        }
        let share = inside / all;
        assert!((0.92..0.98).contains(&share), "{share}");
    }

    #[test]
    fn a_curve_needs_more_blocks_than_knots() {
        let mut parts = sides(&[0.0; 6], &mut Pcg64Mcg::seed_from_u64(1));
        for (columns, _) in &mut parts {
            for series in columns.whole.iter_mut().chain(&mut columns.projected).chain([&mut columns.rest_n])
            {
                series.truncate(750);
            }
        }
        assert!(deviation(&parts).is_none(), "six blocks, six knots");
    }
}
