//! The decision about the best pairs of a screen.
//!
//! A closed form on hat functions is linear in its amount only, and a large effect has bent the base that was fitted without it. So the numbers
//! of each of the best terms are refitted through the simulator, with the nuisance space projected off; then, for the rivals of the best,
//! base, effects and terms together. The validation runs choose among them: within [`Thresholds::term_alike`](crate::diagnose::Thresholds::term_alike) of the least squared error the simplest wins,
//! and the others are its class.

use super::around::{Damper, WithTerm};
use super::nuisance::{KnownStructure, Sides};
use super::resonance::has_no_peak;
use super::screen::Pair;
use super::{BothBlocks, RefusedTerm, Search, TermRefusal, with_term};
use crate::diagnose::derivatives::columns;
use crate::diagnose::joint::{Fitted, Joint, Nearby};
use crate::diagnose::rows::dot;
use crate::diagnose::space::{Space, bounds_of_term};
use crate::effect::Augmented;
use crate::effect::term::{Argument, Form, Modulator, Term};
use crate::error::Error;
use crate::identify::least_squares::{Normal, Problem, Stop, minimise};
use crate::parallel;
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Pairs that are refitted: the best on the validation runs, and the best on the training runs.
const BY_SCORE: usize = 4;
const BY_TRAINING: usize = 2;
/// Evaluations of the refit of a term's numbers, and of the joint refit.
const OF_TERM: usize = 12;
const JOINTLY: usize = 30;
const MOST_RIVALS: usize = 3;
/// Flips of signs.
const FLIPS: u32 = 4_000;
/// Least share of its amount that a decaying term must still have where the data begin.
const LEAST_OF_DECAY: f64 = 0.1;
/// Least number of blocks of both sides: with fewer, no p is below 0.01.
const LEAST_BLOCKS: usize = 7;

/// An accepted term.
pub(super) struct Settled {
    /// The model with the term.
    pub(super) fitted: Fitted,
    pub(super) term: Term,
    pub(super) class: Vec<(Modulator, Argument)>,
    pub(super) p: f64,
    pub(super) confirmed: f64,
}

/// A term after its refits.
struct Refitted {
    fitted: Fitted,
    term: Term,
    /// Squared error on the validation runs, N².
    raw_squares: f64,
    /// The same with the nuisance space projected off, N².
    squares: f64,
    /// Drop of it on each block of both sides, of what was fitted on the other one.
    gains: Vec<f64>,
}

/// Why no term was accepted.
pub(super) enum Unsettled {
    /// The best term leaves a squared error on the validation runs that is far from the goal.
    FarFromGoal,
    /// The term that came closest was refused; `None` if no term helped.
    Refused(Option<RefusedTerm>),
}

/// The best of `pairs` as a term. `goal` is a squared error on the validation runs that the model must come near with it, N².
pub(super) fn settle(
    search: &Search,
    current: &Fitted,
    sides: &Sides,
    known: Option<&KnownStructure>,
    pairs: &[&Pair],
    blocks: &BothBlocks,
    goal: Option<f64>,
) -> Result<Result<Settled, Unsettled>, Error> {
    let thresholds = &search.settings.thresholds;
    let mut chosen: Vec<&Pair> = pairs.iter().copied().take(BY_SCORE).collect();
    let mut by_training: Vec<&Pair> = pairs.iter().copied().skip(BY_SCORE).collect();
    by_training.sort_by(|a, b| b.train_gain.total_cmp(&a.train_gain));
    // The grid of resonances is coarse, so a sharp one has much of its gain only after the refit.
    let is_resonance = |pair: &&Pair| pair.form == Form::Resonance && pair.score > 0.0;
    chosen.extend(by_training.iter().skip(BY_TRAINING).filter(|pair| is_resonance(pair)));
    chosen.extend(by_training.into_iter().take(BY_TRAINING));
    let damper = Damper::new(&current.model, search.train);
    let alone = |pair: &&Pair| alone(search, sides, &current.model, damper.as_ref(), pair);
    let alone: Vec<Option<Alone>> =
        parallel::map(&chosen, alone).into_iter().collect::<Result<_, Error>>()?;
    let mut refits: Vec<Alone> = alone.into_iter().flatten().collect();
    refits.retain(|one| is_sound(&one.term));
    refits.sort_by(|a, b| a.squares.total_cmp(&b.squares));
    // The base was fitted while the effect was there, which has bent it, so the rivals of the best are fitted with it.
    let least = refits.first().map_or(0.0, |best| best.squares);
    if goal.is_some_and(|goal| least > thresholds.term_far * goal) {
        return Ok(Err(Unsettled::FarFromGoal));
    }
    refits.truncate(
        refits.partition_point(|one| one.squares <= thresholds.term_rival * least).min(MOST_RIVALS),
    );
    let refits = parallel::map(&refits, |one| jointly(search, sides, known, one, blocks));
    let refits: Vec<Option<Refitted>> = refits.into_iter().collect::<Result<_, Error>>()?;
    let mut refits: Vec<Refitted> = refits.into_iter().flatten().collect();
    refits.retain(|one| is_sound(&one.term));
    // The nuisance space is not in the model: without it the term must help too.
    refits.retain(|one| {
        one.raw_squares < (1.0 - thresholds.term_least_raw_share) * sides.confirm.raw_squares()
    });
    refits.sort_by(|a, b| a.squares.total_cmp(&b.squares));
    let none = Ok(Err(Unsettled::Refused(None)));
    let Some(least) = refits.first().map(|best| best.squares) else { return none };
    refits.truncate(refits.partition_point(|one| one.squares <= (1.0 + thresholds.term_alike) * least));
    refits.sort_by_key(|one| simplicity(&one.term));
    let others = refits.split_off(1);
    let Some(best) = refits.pop() else { return none };
    let before = sides.confirm.squares();
    let share = 1.0 - best.squares / before;
    let rivals: Vec<&[f64]> =
        pairs.iter().map(|pair| &pair.gains[..]).chain(others.iter().map(|one| &one.gains[..])).collect();
    let p = p_value(&best.gains, &rivals, search.settings.seed);
    let refused = if blocks.count() < LEAST_BLOCKS {
        Some(TermRefusal::TooFewBlocks { blocks: blocks.count(), needed: LEAST_BLOCKS })
    } else if share.is_nan() || share < thresholds.term_least_share {
        Some(TermRefusal::TooSmall { share, needed: thresholds.term_least_share })
    } else if p > thresholds.term_p {
        Some(TermRefusal::NotSignificant { p, allowed: thresholds.term_p })
    } else {
        None
    };
    if let Some(why) = refused {
        return Ok(Err(Unsettled::Refused(Some(RefusedTerm { term: best.term, why }))));
    }
    let kind = |term: &Term| (term.kind().0, term.kind().1);
    let mut class: Vec<(Modulator, Argument)> = Vec::new();
    for other in others.iter().map(|one| kind(&one.term)).filter(|other| *other != kind(&best.term)) {
        if !class.contains(&other) {
            class.push(other);
        }
    }
    let confirmed = 1.0 - best.raw_squares / sides.confirm.raw_squares();
    Ok(Ok(Settled { fitted: best.fitted, term: best.term, class, p, confirmed }))
}

/// A term with its own numbers refitted.
struct Alone {
    fitted: Fitted,
    term: Term,
    /// Squared error on the validation runs with the nuisance space projected off, N².
    squares: f64,
}

/// The term that was added last.
fn last_term(fitted: &Fitted) -> Option<Term> {
    fitted.model.effects().terms().iter().last().copied()
}

/// The term of `pair` with its numbers refitted, everything else as it is; `None` if it cannot be simulated.
fn alone(
    search: &Search,
    sides: &Sides,
    model: &Augmented,
    damper: Option<&Damper>,
    pair: &Pair,
) -> Result<Option<Alone>, Error> {
    let damper = damper.filter(|_| !pair.modulator.acts_on_input());
    let problem = OfTerm { search, sides, model, damper, start: pair.term()? };
    let Some(fitted) = problem.solve()? else { return Ok(None) };
    let Some(confirmed) = Fitted::as_is(fitted.model, search.confirm) else { return Ok(None) };
    let (weights, _) = sides.fit(&fitted.residual_n);
    let rest_n = sides.confirm.nuisance.without(confirmed.residual_n, &weights);
    let squares = dot(&rest_n, &rest_n);
    Ok(last_term(&fitted).map(|term| Alone { fitted, term, squares }))
}

/// `one` with base, effects and terms fitted together, if that fits the validation runs better. `None` if it cannot be simulated.
fn jointly(
    search: &Search,
    sides: &Sides,
    known: Option<&KnownStructure>,
    one: &Alone,
    blocks: &BothBlocks,
) -> Result<Option<Refitted>, Error> {
    let refitted = |fitted: Fitted| -> Result<Option<Refitted>, Error> {
        let Some(after) = Sides::new(search, &fitted, known)? else { return Ok(None) };
        let Some(term) = last_term(&fitted) else { return Ok(None) };
        let mut gains = blocks.confirm.gains(&sides.confirm.rest_n, &after.confirm.rest_n);
        gains.extend(blocks.train.gains(&sides.train.rest_n, &after.train.rest_n));
        let (raw_squares, squares) = (after.confirm.raw_squares(), after.confirm.squares());
        Ok(Some(Refitted { fitted, term, raw_squares, squares, gains }))
    };
    let together = match search.joint.refit(&one.fitted.model, JOINTLY)? {
        Some(fitted) => refitted(fitted)?.filter(|found| found.squares < one.squares),
        None => None,
    };
    match together {
        Some(found) => Ok(Some(found)),
        None => refitted(one.fitted.clone()),
    }
}

/// The fit of the numbers of the term `start`, with everything else in `model` as it is and the nuisance space projected off.
struct OfTerm<'a> {
    search: &'a Search<'a>,
    sides: &'a Sides<'a>,
    model: &'a Augmented,
    /// The damper of `model`, if its force does not depend on the term.
    damper: Option<&'a Damper<'a>>,
    start: Term,
}

impl OfTerm<'_> {
    /// The model with the best numbers; `None` if it cannot be simulated.
    fn solve(&self) -> Result<Option<Fitted>, Error> {
        let bounds: Vec<[f64; 2]> = bounds_of_term(&self.start).collect();
        let stop = Stop { evaluations: OF_TERM, cost: 1e-5, step: 1e-5 };
        let found = minimise(self, self.start.values(), &bounds, &stop).ok_or(Error::Cancelled)?;
        Ok(self.start.with_values(&found.parameters).and_then(|term| self.simulated(term)))
    }

    fn simulated(&self, term: Term) -> Option<Fitted> {
        Fitted::as_is(with_term(self.model, term).ok()?, self.search.train)
    }

    /// The force with `term`, and its derivatives by the numbers of the term, which are the last ones of the model.
    fn with(&self, term: Term) -> Option<WithTerm> {
        if let Some(damper) = self.damper {
            return damper.with(&term);
        }
        let fitted = self.simulated(term)?;
        let joint = Joint { base_moves: false, ..self.search.joint };
        let space = Space::new(&fitted.model, joint.scales, joint.ranges, joint.base_moves).ok()?;
        let values = space.values();
        let first = values.len() - term.values().len();
        let wanted: Vec<bool> = (0..values.len()).map(|number| number >= first).collect();
        let all = columns(&joint, &space, &values, &fitted.predicted_n, &wanted, Nearby::new())?;
        Some(WithTerm { predicted_n: fitted.predicted_n, columns: all.into_iter().skip(first).collect() })
    }
}

impl Problem for OfTerm<'_> {
    fn normal(&self, values: &[f64]) -> Option<Normal> {
        if self.search.joint.watch.is_cancelled() {
            return None;
        }
        let n = values.len();
        let Some(WithTerm { predicted_n, columns }) =
            self.start.with_values(values).and_then(|term| self.with(term))
        else {
            return Some(Normal::impossible(n));
        };
        let nuisance = &self.sides.train.nuisance;
        let residual_n = self.search.train.residual(&predicted_n);
        let (weights, cost) = self.sides.fit(&residual_n);
        let rest_n = nuisance.without(residual_n, &weights);
        let projected: Vec<Vec<f64>> =
            columns.iter().map(|column| nuisance.project(column.clone())).collect();
        Some(Normal {
            cost,
            square: DMatrix::from_fn(n, n, |a, b| dot(&columns[a], &projected[b])),
            // The nuisance weights are the best ones, so they do not add to the gradient.
            gradient: DVector::from_iterator(n, columns.iter().map(|column| -dot(column, &rest_n))),
        })
    }
}

/// False for a term whose numbers describe nothing that is in the data.
fn is_sound(term: &Term) -> bool {
    !has_no_peak(term) && !dies_away_before(term)
}

/// True if the term has died away where the data begin: its amount is then a number for a place where there are none.
fn dies_away_before(term: &Term) -> bool {
    let [low, high] = term.confirmed_in();
    let nearest = low.max(-high).max(0.0);
    let (_, _, form) = term.kind();
    form == Form::Decay && term.curve(nearest).abs() < LEAST_OF_DECAY * term.amount().abs()
}

/// Order of terms that fit alike: fewest numbers, then the argument and the modulator that come first in their lists.
fn simplicity(term: &Term) -> (usize, Argument, Modulator) {
    let (modulator, argument, _) = term.kind();
    (term.values().len(), argument, modulator)
}

/// Probability that the sum of `gains` is as large by chance, if the sign of each block's gain is chance. It is the share of the flips of signs
/// under which the largest sum of any rival, or of `gains` itself, reaches it. Each rival's losses count at most as much as its largest gain.
fn p_value(gains: &[f64], rivals: &[&[f64]], seed: u64) -> f64 {
    let found: f64 = gains.iter().sum();
    let cut = |gains: &[f64]| -> Vec<f64> {
        let most = gains.iter().copied().fold(0.0, f64::max);
        gains.iter().map(|gain| gain.max(-most)).collect()
    };
    let all: Vec<Vec<f64>> = rivals.iter().copied().chain([gains]).map(cut).collect();
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut reached = 1_u32;
    for _ in 0..FLIPS {
        let signs: Vec<f64> =
            gains.iter().map(|_| if random.random::<bool>() { 1.0 } else { -1.0 }).collect();
        let largest = all.iter().map(|gains| dot(gains, &signs)).fold(0.0, f64::max);
        reached += u32::from(largest >= found);
    }
    f64::from(reached) / f64::from(FLIPS + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gains of a pair that helps on each of ten blocks, and of one that does not.
    const STEADY: [f64; 10] = [5.0, 4.0, 6.0, 5.0, 3.0, 5.0, 7.0, 4.0, 5.0, 6.0];
    const CHANCE: [f64; 10] = [9.0, -8.0, 3.0, -4.0, 6.0, -5.0, 1.0, -2.0, 4.0, -3.0];

    #[test]
    fn a_steady_gain_is_significant_and_a_chance_gain_is_not() {
        assert!(p_value(&STEADY, &[], 1) < 0.005);
        assert!(p_value(&CHANCE, &[], 1) > 0.3);
        let local = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 40.0, 42.0, 39.0, 41.0];
        assert!((p_value(&local, &[], 1) - 1.0 / 16.0).abs() < 0.02, "four blocks decide");
    }

    #[test]
    fn a_decay_that_has_ended_where_the_data_begin_is_no_term() {
        let decay = |scale_m_s: f64, confirmed_in: [f64; 2]| {
            let kind = (Modulator::SignVelocity, Argument::Velocity, Form::Decay);
            dies_away_before(&Term::new(kind, 20.0, &[scale_m_s], confirmed_in).expect("a term"))
        };
        assert!(decay(0.001, [0.005, 0.1]) && decay(0.001, [-0.1, -0.005]));
        assert!(!decay(0.001, [-0.1, 0.1]) && !decay(0.01, [0.005, 0.1]));
    }

    #[test]
    fn rivals_are_paid_for_and_one_that_explodes_is_not() {
        let large: Vec<f64> = CHANCE.iter().map(|gain| 3.0 * gain).collect();
        let alone = p_value(&STEADY, &[], 1);
        assert!(p_value(&STEADY, &[&large], 1) > 10.0 * alone);
        // Its largest gain is 1, so its loss counts as 1.
        let exploded = [1.0, 1.0, -1e9, 1.0, 0.5, 1.0, 1.0, 0.2, 1.0, 1.0];
        assert!(p_value(&STEADY, &[&exploded], 1) < 2.0 * alone);
    }
}
