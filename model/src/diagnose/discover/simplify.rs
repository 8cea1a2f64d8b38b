//! Simpler forms of the terms that were found.
//!
//! ```text
//! candidates  constant, linear and quadratic forms of a term's own modulator and argument with at least ALIKE of its power along them; and,
//!             if there are any or another term has changed, no term at all; the model is refitted with each
//! e           squared error on the validation runs, plus the same with the space of structures projected off
//! gain        e(no term) - e(candidate)
//! taken       no term: neither of the two errors grows by more than least_confirmed
//!             fewer numbers: gain of at least (1 - form_alike) times the term's
//!             as many numbers: a larger gain than the term's
//! ```
//!
//! A term is found while the model still lacks the other terms, so its form describes a part of them, too: without a friction in the model, a
//! mass seems to act only where the rod moves. And the search looks at what no structure can describe, which of a friction is its sharp edge
//! alone. With all terms in the model, a simpler form fits as well, and some terms are not needed any more.

use super::screen::{OF_CONSTANT, repeats};
use super::series::Series;
use super::{Claim, Found, Search, SquaredErrors, with_terms};
use crate::diagnose::joint::Fitted;
use crate::diagnose::rows::dot;
use crate::effect::term::{Form, Term};
use crate::error::Error;
use crate::parallel;
use crate::statistics::range;

/// Evaluations of the refit with another form.
const REFIT: usize = 30;
/// Least share of a term's power on the training runs that lies along a candidate (the squared correlation of the two).
const ALIKE: f64 = 0.8;

/// Simplifies the terms of `found`. Returns true if another search is worth its time: a term was removed, or the model fits better.
pub(super) fn simplify(search: &Search, found: &mut Found) -> Result<bool, Error> {
    let most = found.discovery.terms.len();
    if most == 0 {
        return Ok(false);
    }
    let of_base = search.of_base.terms().iter().count();
    let before = search.confirm_squares(&found.fitted);
    // A term that is simplified may let the others be simplified, so each is tried again after that, once.
    let (mut index, mut unchanged, mut changed) = (0, 0, false);
    for _ in 0..2 * most {
        let count = found.discovery.terms.len();
        if unchanged >= count {
            break;
        }
        index %= count;
        let simpler = match found.discovery.terms[index].claim {
            // A term that the healthy damper has, too, is a detail of its structure.
            Claim::Structure { .. } => None,
            _ => simpler(search, &found.fitted, of_base + index, changed)?,
        };
        let Some(fitted) = simpler else {
            (index, unchanged) = (index + 1, unchanged + 1);
            continue;
        };
        let is_removed = fitted.model.effects().terms().iter().count() < of_base + count;
        (found.fitted, changed) = (fitted, true);
        if is_removed {
            found.discovery.terms.remove(index);
            found.beyond.remove(index);
            unchanged = 0;
        } else {
            (index, unchanged) = (index + 1, 1);
        }
    }
    let better = 1.0 - search.settings.thresholds.term_least_share;
    let fits_better = || search.confirm_squares(&found.fitted) <= better * before;
    Ok(found.discovery.terms.len() < most || changed && fits_better())
}

/// The best model with a simpler form of term `index`, or without the term if it is not needed: an effect in the model may have the simpler form, and
/// then takes its place. `None` without a simpler form, unless the model has `changed` since the term was found.
fn simpler(search: &Search, fitted: &Fitted, index: usize, changed: bool) -> Result<Option<Fitted>, Error> {
    let terms: Vec<Term> = fitted.model.effects().terms().iter().copied().collect();
    let candidates = candidates(search, fitted, &terms, index);
    if candidates.is_empty() && !changed {
        return Ok(None);
    }
    let refit = |candidate: Option<Term>| -> Result<Option<(Fitted, SquaredErrors)>, Error> {
        let mut with_candidate = terms.clone();
        with_candidate.splice(index..=index, candidate);
        let model = with_terms(&fitted.model, &with_candidate)?;
        let Some(other) = search.joint.refit(&model, REFIT)? else { return Ok(None) };
        Ok(search.confirm_errors(&other)?.map(|errors| (other, errors)))
    };
    let (Some(own), Some((none, without))) = (search.confirm_errors(fitted)?, refit(None)?) else {
        return Ok(None);
    };
    let thresholds = &search.settings.thresholds;
    let alike = 1.0 + thresholds.least_confirmed;
    if without.all <= alike * own.all && without.beyond <= alike * own.beyond {
        return Ok(Some(none));
    }
    let needed = |candidate: &Term| {
        let fewer = candidate.values().len() < terms[index].values().len();
        let share = if fewer { 1.0 - thresholds.form_alike } else { 1.0 };
        share * (without.sum() - own.sum()).max(0.0)
    };
    let refits = parallel::map(&candidates, |candidate| Ok((*candidate, refit(Some(*candidate))?)));
    let refits: Vec<(Term, Option<(Fitted, SquaredErrors)>)> =
        refits.into_iter().collect::<Result<_, Error>>()?;
    let taken = refits.into_iter().filter_map(|(candidate, refit)| {
        let (fitted, errors) = refit?;
        let gain = without.sum() - errors.sum();
        (gain > needed(&candidate)).then_some((fitted, gain))
    });
    let best = taken.max_by(|(_, a), (_, b)| a.total_cmp(b));
    Ok(best.map(|(fitted, _)| fitted))
}

/// The simpler forms of term `index` that are like it, each with the amount that comes closest to it on the training runs.
fn candidates(search: &Search, fitted: &Fitted, terms: &[Term], index: usize) -> Vec<Term> {
    let term = &terms[index];
    let (modulator, argument, form) = term.kind();
    if matches!(form, Form::Constant | Form::Resonance) {
        return Vec::new();
    }
    let series = Series::new(&fitted.model, search.train, &fitted.predicted_n);
    let force_n = |term: &Term| -> Option<Vec<f64>> {
        let (modulator, argument, _) = term.kind();
        let (m, q) = (series.modulator(modulator)?, series.argument(argument)?);
        let mut force_n: Vec<f64> = m.iter().zip(q).map(|(m, q)| m * term.curve(*q)).collect();
        search.train.centre(&mut force_n);
        Some(force_n)
    };
    let own_n = force_n(term);
    let others = || terms.iter().enumerate().filter(|(other, _)| *other != index);
    let with_form = |simple: Form| {
        let of = if simple == Form::Constant { OF_CONSTANT } else { argument };
        if simple == form || others().any(|(_, other)| repeats((modulator, of), other)) {
            return None;
        }
        let range =
            if of == argument { term.confirmed_in() } else { range(series.argument(of)?.iter().copied()) };
        let unit = Term::new((modulator, of, simple), 1.0, &[], range).ok()?;
        let (own_n, unit_n) = (own_n.as_ref()?, force_n(&unit)?);
        let (along, power) = (dot(own_n, &unit_n), dot(&unit_n, &unit_n));
        let like = along * along > ALIKE * power * dot(own_n, own_n);
        if like { unit.with_values(&[along / power]) } else { None }
    };
    [Form::Constant, Form::Linear, Form::Quadratic].into_iter().filter_map(with_form).collect()
}
