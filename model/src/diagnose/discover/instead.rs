//! A term in place of an effect of the library.
//!
//! ```text
//! effect      the effects of the library
//! beside      the same with the terms that were found beside them
//! instead     one of the effects taken out, the model refitted, and the terms that are found without it
//! e           squared error on the validation runs
//! taken       e(instead, one term) <= (1 - term_surpasses) e(effect)
//!             e(instead) <= (1 + least_confirmed) e(beside), with no more effects and terms
//!             and e with the space of structures projected off grows by no more than least_confirmed
//! given up    the best term with everything else as it is leaves more than term_far times the e that it must reach
//! ```
//!
//! The library names the nearest of its effects, also for a damper whose effect it does not have: a cubic spring looks like an end stop. This
//! name leaves an error, and the terms that are found beside it describe the difference. One term in place of the name leaves
//! much less. The library is preferred otherwise: beside a base that is not of the damper's structure, a term can describe an effect and a part
//! of the structure at once, and fit a little better than the effect. A term that only describes structure cannot do what an effect does beyond
//! all structures.

use super::{Claim, Found, FoundTerm, Limits, Search, SquaredErrors, Stage};
use crate::diagnose::DiagnosisResult;
use crate::diagnose::joint::Fitted;
use crate::diagnose::space::without_effect;
use crate::error::Error;

/// Evaluations of the refit without an effect.
const REFIT: usize = 30;

/// Number of effects and terms of a model.
fn parts(fitted: &Fitted) -> usize {
    let effects = fitted.model.effects();
    effects.as_slice().len() + effects.terms().iter().count()
}

/// `beside`, which is `library` with the terms found, or what is found with at most `most` terms if named effects of `result` are taken out.
pub(super) fn instead(
    search: &Search,
    mut library: Found,
    beside: Found,
    result: &DiagnosisResult,
    most: usize,
    stage: &dyn Fn(Stage),
) -> Result<Found, Error> {
    let thresholds = &search.settings.thresholds;
    let (alike, surpasses) = (1.0 + thresholds.least_confirmed, 1.0 - thresholds.term_surpasses);
    let mut best = beside;
    // `library` has the effects that stand so far, and the terms in place of the others.
    for named in &result.effects {
        let first = library.discovery.terms.len() + 1;
        if first > most {
            break;
        }
        let model = &library.fitted.model;
        let Some(index) = model.effects().position(named.effect.effect()) else { continue };
        let Some(own) = search.confirm_errors(&library.fitted)? else { continue };
        let goal = SquaredErrors { all: surpasses * own.all, beyond: alike * own.beyond };
        let Some(fitted) = search.joint.refit(&without_effect(model, index)?, REFIT)? else { continue };
        let mut other = Found { fitted, ..library.clone() };
        for count in first..=most {
            let goal = (count == first).then_some(goal);
            other = search.run(other, Limits { only_beyond: false, most: count, goal }, stage)?;
            let is_structure = |term: &FoundTerm| matches!(term.claim, Claim::Structure { .. });
            if other.discovery.terms.len() < count
                || other.discovery.terms.iter().any(is_structure)
                || parts(&other.fitted) > parts(&best.fitted)
            {
                break;
            }
            if let Some(goal) = goal
                && !search.reaches(&other.fitted, goal)?
            {
                break;
            }
            let Some(of_best) = search.confirm_errors(&best.fitted)? else { break };
            if search.reaches(&other.fitted, of_best.times(alike))? {
                best = other.clone();
                library = other;
                break;
            }
        }
    }
    Ok(best)
}
