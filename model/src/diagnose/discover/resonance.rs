//! The screen of resonances: a mass on a spring, driven by the force or the displacement.
//!
//! ```text
//! y'' = w² (q - y) - 2 b w y'             q: one of [`super::series::RESONANT`]
//! A = y'y - y'N K^-1 N'y,  b = y'(r - N d)                       on the training runs, for each w and b of a grid
//! ```
//!
//! The one with the largest gain b²/A on the training runs stands for its argument.

use super::BothBlocks;
use super::claim::Healthy;
use super::nuisance::{Side, Sides};
use super::screen::{Pair, is_identifiable, score};
use super::series::RESONANT;
use crate::diagnose::Thresholds;
use crate::diagnose::rows::dot;
use crate::diagnose::space::bounds_of_term;
use crate::effect::term::{Argument, Form, Modulator, Term};
use crate::parallel;
use crate::statistics::range;

/// Lowest frequency of the grid, Hz, and the ratio of a frequency to the one before.
const LOWEST_HZ: f64 = 3.0;
const RATIO: f64 = 1.09;
/// Share of an end of a range within which a number is at this end.
const AT_END: f64 = 0.02;
/// Highest frequency: this share of the rate of the rows. A higher resonance would stand for the second derivative of its argument, which the
/// structure of the base may lack.
const OF_RATE: f64 = 0.4;
/// A resonance with more damping would stand for a lag of its argument, which the structure of the base may lack.
const DAMPINGS: [f64; 3] = [0.03, 0.08, 0.2];

/// True if `term` is a resonance at the end of a range: with that damping or frequency it has no peak in the data.
pub(super) fn has_no_peak(term: &Term) -> bool {
    let ends = bounds_of_term(term).zip(term.values()).skip(1);
    term.kind().2 == Form::Resonance
        && ends
            .into_iter()
            .any(|([low, high], value)| *value <= low * (1.0 + AT_END) || *value >= high * (1.0 - AT_END))
}

/// The best resonance of each argument.
pub(super) fn pairs<'s>(
    sides: &'s Sides,
    healthy: Option<&'s Healthy>,
    blocks: &'s BothBlocks,
    thresholds: &'s Thresholds,
) -> impl Iterator<Item = Pair> + use<'s> {
    let longest_s = sides.train.rows.runs().iter().map(|run| run.step_s).fold(0.0, f64::max);
    let highest_hz = OF_RATE / longest_s;
    let frequencies = std::iter::successors(Some(LOWEST_HZ), |hz| Some(hz * RATIO));
    let grid: Vec<[f64; 2]> = frequencies
        .take_while(|hz| *hz <= highest_hz)
        .flat_map(|hz| DAMPINGS.map(|damping| [hz, damping]))
        .collect();
    RESONANT.into_iter().filter_map(move |argument| pair(sides, healthy, argument, &grid, blocks, thresholds))
}

/// The amount that fits a side, and the drop of its squared error, N²; `None` if the nuisance columns can take its place.
fn fitted(side: &Side, column: &[f64]) -> Option<[f64; 2]> {
    let power = dot(column, &side.nuisance.project(column.to_vec()));
    let along = dot(column, &side.fitted_rest_n);
    is_identifiable(power, dot(column, column)).then(|| [along / power, along * along / power])
}

fn pair(
    sides: &Sides,
    healthy: Option<&Healthy>,
    argument: Argument,
    grid: &[[f64; 2]],
    blocks: &BothBlocks,
    thresholds: &Thresholds,
) -> Option<Pair> {
    let column = |side: &Side, parameters| side.series.resonance(side.rows, argument, parameters);
    let candidates = parallel::map(grid, |parameters| {
        let [amount, gain] = fitted(&sides.train, &column(&sides.train, *parameters)?)?;
        Some((*parameters, amount, gain))
    });
    let (parameters, amount, train_gain) =
        candidates.into_iter().flatten().max_by(|(.., a), (.., b)| a.total_cmp(b))?;
    let (on_train, on_confirm) = (column(&sides.train, parameters)?, column(&sides.confirm, parameters)?);
    let of_train = sides.train.nuisance.weights(&on_train);
    let of_confirm = sides.confirm.nuisance.weights(&on_confirm);
    let [reverse, _] = fitted(&sides.confirm, &on_confirm).unwrap_or_default();
    let forward = sides.confirm.gains(on_confirm, amount, &of_train, &blocks.confirm);
    let backward = sides.train.gains(on_train, reverse, &of_confirm, &blocks.train);
    let gain: f64 = forward.iter().sum();
    let on_healthy = healthy
        .and_then(|healthy| Some((healthy.share(&column(healthy.side(), parameters)?)? / amount).abs()));
    let range = range(sides.train.series.argument(argument)?.iter().copied());
    Some(Pair {
        modulator: Modulator::One,
        argument,
        form: Form::Resonance,
        amount,
        parameters: parameters.to_vec(),
        range,
        train_gain,
        score: score(gain, parameters.len(), thresholds),
        gains: forward.into_iter().chain(backward).collect(),
        on_healthy,
    })
}
