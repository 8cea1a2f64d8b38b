//! One round: from the scores to at most one named effect.
//!
//! Significant candidates are ranked by the drop of squared error after a joint refit, never by the largest t. The first that passes
//! every check is named; each one rejected before it is listed with the reason.

use super::Settings;
use super::energy::{Contradiction, denies, is_neutral};
use super::finding::{Candidate, FoundParameter, RefusedEffect};
use super::interval::{Contents, Intervals};
use super::joint::{Fitted, Joint};
use super::refusal::Refusal;
use super::rows::{Rows, dot};
use super::score::{Score, Scores};
use crate::effect::{Effect, EffectModel};
use crate::error::Error;
use crate::parallel;
use crate::statistics::block_sums::adjusted_p_values;

/// Largest number of candidates that are refitted in a round.
const MOST_REFITS: usize = 6;
/// Evaluations of a refit that ranks the candidates.
const RANKING: usize = 8;
/// Evaluations of a complete refit.
pub(super) const FINAL: usize = 60;
/// Effects that change the phase of the force. On one motion they look alike: a spring, a mass and a delay add a force in quadrature.
const OF_PHASE: [&str; 6] =
    ["gas_spring", "end_stop", "inertia", "force_lag", "sensor_delay", "anti_alias_mismatch"];

/// An effect that passed.
pub(super) struct Passed {
    pub(super) effect: Effect,
    pub(super) fitted: Fitted,
    pub(super) class: Vec<&'static str>,
    pub(super) p_adjusted: f64,
}

/// The result of a round.
pub(super) struct Outcome {
    pub(super) passed: Option<Passed>,
    pub(super) candidates: Vec<Candidate>,
    pub(super) refused: Vec<RefusedEffect>,
}

/// A candidate after its refit.
struct Refitted<'a> {
    score: &'a Score,
    p_adjusted: f64,
    fitted: Fitted,
    drop: f64,
}

/// The inputs of a round.
pub(super) struct Round<'a> {
    pub(super) joint: Joint<'a>,
    pub(super) confirm: &'a Rows<'a>,
    pub(super) settings: &'a Settings,
    /// Squared error of the noise on the training rows, N².
    pub(super) noise: f64,
    /// The base's reducible error, of which an effect must remove a share however little is left; zero without this limit. N².
    pub(super) base_reducible: f64,
    /// Sum of the squared force, each run's mean removed, if structures are compared; zero if the base is fixed. N².
    pub(super) force: f64,
    /// Number of the round, from 1.
    pub(super) number: usize,
}

impl Round<'_> {
    /// Selects at most one of the effects that `current` does not have.
    pub(super) fn run(&self, current: &Fitted, all: &Scores) -> Result<Outcome, Error> {
        let thresholds = &self.settings.thresholds;
        let scores = &all.able;
        let tests: Vec<&[f64]> = scores.iter().map(|score| score.sums.as_slice()).collect();
        let adjusted = adjusted_p_values(&tests, self.settings.seed);
        let explainable = (current.squares - self.noise).max(f64::MIN_POSITIVE);
        let mut candidates: Vec<Candidate> = scores
            .iter()
            .zip(&adjusted)
            .map(|(score, p_adjusted)| Candidate {
                effect: score.effect,
                round: self.number,
                identifiable: score.identifiable,
                p: score.p,
                p_adjusted: *p_adjusted,
                promises: score.predicted_drop / explainable,
                removes: None,
            })
            .collect();
        let mut worth: Vec<usize> = (0..scores.len())
            .filter(|&k| {
                adjusted[k] <= self.settings.significance
                    && candidates[k].promises >= thresholds.worth_a_refit
            })
            .collect();
        worth.sort_by(|a, b| scores[*b].predicted_drop.total_cmp(&scores[*a].predicted_drop));
        worth.truncate(MOST_REFITS);
        let ranked = |k: &usize| all.refit(&self.joint, current, &scores[*k], RANKING);
        let fits: Vec<Option<Fitted>> =
            parallel::map(&worth, ranked).into_iter().collect::<Result<_, Error>>()?;
        let mut refits = Vec::new();
        for (k, fitted) in worth.into_iter().zip(fits) {
            let Some(fitted) = fitted else { continue };
            let drop = current.squares - fitted.squares;
            candidates[k].removes = Some(drop / explainable);
            refits.push(Refitted { score: &scores[k], p_adjusted: adjusted[k], fitted, drop });
        }
        refits.sort_by(|a, b| b.drop.total_cmp(&a.drop));
        if let Some(most) = refits.first().map(|best| best.drop).filter(|_| !self.joint.base_moves) {
            // On one motion the form of an effect shows little: of those that remove about as much, the one with the fewest parameters.
            let alike = refits.partition_point(|refitted| refitted.drop >= thresholds.same_class * most);
            refits[..alike].sort_by_key(|refitted| refitted.score.effect.parameters().len());
        }
        let (mut refused, mut passed) = (Vec::new(), None);
        for (rank, best) in refits.iter().enumerate() {
            match self.validate(current, best)? {
                Ok(fitted) => {
                    let mut class = self.class(current, best, &refits, scores)?;
                    // A change since the references that could not be tested, and would remove as much, is not excluded.
                    let as_much = |score: &&Score| {
                        !self.joint.base_moves && score.predicted_drop >= thresholds.same_class * best.drop
                    };
                    for silent in all.silent.iter().filter(as_much) {
                        if !class.contains(&silent.effect.id()) {
                            class.push(silent.effect.id());
                        }
                    }
                    if OF_PHASE.contains(&class[0])
                        && is_neutral(self.joint.rows, &change_n(current, &fitted), thresholds)
                    {
                        let others = OF_PHASE.into_iter().filter(|id| self.settings.effects.has_id(id));
                        let new: Vec<&str> = others.filter(|id| !class.contains(id)).collect();
                        class.extend(new);
                    }
                    let (effect, p_adjusted) = (best.score.effect, best.p_adjusted);
                    let others = &refits[rank + 1..];
                    refused.extend(others.iter().filter(|r| !class.contains(&r.score.effect.id())).map(
                        |r| RefusedEffect {
                            effect: r.score.effect,
                            why: Refusal::OtherRemovesMore {
                                share: r.drop / explainable,
                                other: effect.title(),
                                other_share: best.drop / explainable,
                            },
                        },
                    ));
                    passed = Some(Passed { effect, fitted, class, p_adjusted });
                    break;
                }
                Err(why) => refused.push(RefusedEffect { effect: best.score.effect, why }),
            }
        }
        Ok(Outcome { passed, candidates, refused })
    }

    /// Fits `candidate` completely and checks it: the fitted model, or why it is rejected.
    fn validate(&self, current: &Fitted, candidate: &Refitted) -> Result<Result<Fitted, Refusal>, Error> {
        let thresholds = &self.settings.thresholds;
        let ranked = candidate.drop / (current.squares - self.noise);
        if ranked.is_nan() || ranked < thresholds.hopeless {
            return Ok(Err(Refusal::TooSmall { share: ranked, needed: thresholds.least_share }));
        }
        let Some(fitted) = self.joint.refit(&candidate.fitted.model, FINAL)? else {
            return Ok(Err(Refusal::Diverges));
        };
        let share = (current.squares - fitted.squares) / (current.squares - self.noise);
        if share.is_nan() || share < thresholds.least_share {
            return Ok(Err(Refusal::TooSmall { share, needed: thresholds.least_share }));
        }
        let (effect, drop) = (candidate.score.effect, current.squares - fitted.squares);
        let needed_of_base = match self.force > 0.0 && !effect.follows_time() {
            _ if !self.joint.base_moves => thresholds.least_beside_in_pairs,
            true => thresholds.least_beside,
            false => thresholds.least_of_base,
        };
        if drop < needed_of_base * self.base_reducible {
            return Ok(Err(Refusal::WithinMisfit { share, needed_of_base }));
        }
        if let Err(why) = self.beyond_structure(effect, drop) {
            return Ok(Err(why));
        }
        let change_n = change_n(current, &fitted);
        if let Some(Contradiction { residual_j, effect_j }) =
            denies(self.joint.rows, &current.residual_n, &change_n, thresholds)
        {
            return Ok(Err(Refusal::EnergyContradicts { effect_j, residual_j }));
        }
        let effects = fitted.model.effects().as_slice();
        let Some(index) = fitted.model.effects().position(effect) else {
            return Ok(Err(Refusal::Diverges));
        };
        for found in self.intervals(&fitted, Contents::All)?.of(index) {
            if let Some(why) = implausible(&effects[index], &found, &self.joint) {
                return Ok(Err(why));
            }
        }
        Ok(match self.confirmed(&current.model, &fitted.model) {
            Ok(_) => Ok(fitted),
            Err(why) => Err(why),
        })
    }

    /// Rejects an effect that removes so little squared error that the structure of the base may be the cause.
    pub(super) fn beyond_structure(&self, effect: Effect, drop: f64) -> Result<(), Refusal> {
        let thresholds = &self.settings.thresholds;
        let of_force = if self.force > 0.0 { (drop.max(0.0) / self.force).sqrt() } else { f64::INFINITY };
        match effect.follows_time() || of_force >= thresholds.least_of_force {
            true => Ok(()),
            false => Err(Refusal::WithinStructure { of_force, needed: thresholds.least_of_force }),
        }
    }

    /// Share of the squared error on the validation runs that `after` removes from `before`. The error says why `after` is rejected, for
    /// example which run got worse.
    pub(super) fn confirmed(
        &self,
        before: &crate::effect::Augmented,
        after: &crate::effect::Augmented,
    ) -> Result<f64, Refusal> {
        let thresholds = &self.settings.thresholds;
        let (Some(before), Some(after)) =
            (Fitted::as_is(*before, self.confirm), Fitted::as_is(*after, self.confirm))
        else {
            return Err(Refusal::DivergesInValidation);
        };
        let saved = before.squares - after.squares;
        for run in self.confirm.runs() {
            let squares = |fitted: &Fitted| {
                let part = &fitted.residual_n[run.range.clone()];
                dot(part, part)
            };
            let (was, is) = (squares(&before), squares(&after));
            if is > (1.0 + thresholds.worse_run) * was && is - was > thresholds.matters * saved {
                let run = run.dataset.name.clone();
                return Err(Refusal::WorseInValidation { run, increase: is / was - 1.0 });
            }
        }
        let share = saved / before.squares;
        if share.is_nan() || share < thresholds.least_confirmed {
            return Err(Refusal::TooSmallInValidation { share, needed: thresholds.least_confirmed });
        }
        Ok(share)
    }

    /// Ids of the effects that the data cannot tell from `best`; its own id first.
    fn class(
        &self,
        current: &Fitted,
        best: &Refitted,
        refits: &[Refitted],
        scores: &[Score],
    ) -> Result<Vec<&'static str>, Error> {
        let thresholds = &self.settings.thresholds;
        let mut class = vec![best.score.effect.id()];
        let mut join = |effect: Effect| {
            if !class.contains(&effect.id()) {
                class.push(effect.id());
            }
        };
        for other in refits.iter().filter(|other| other.drop >= thresholds.same_class * best.drop) {
            let effects = other.fitted.model.effects().as_slice();
            let Some(index) = other.fitted.model.effects().position(other.score.effect) else { continue };
            let found = self.intervals(&other.fitted, Contents::Chance)?.of(index);
            let implausible =
                found.iter().any(|found| implausible(&effects[index], found, &self.joint).is_some());
            // A candidate that fails the checks by itself does not join the class.
            if !implausible && self.confirmed(&current.model, &other.fitted.model).is_ok() {
                join(other.score.effect);
            }
        }
        let alike = |a: &[f64], b: &[f64]| {
            dot(a, b).abs() / (dot(a, a) * dot(b, b)).sqrt() >= thresholds.alike_scores
        };
        for score in
            scores.iter().filter(|score| score.predicted_drop > 0.0 && alike(&score.own, &best.score.own))
        {
            join(score.effect);
        }
        Ok(class)
    }

    /// The 95 % intervals of the parameters of `fitted`.
    pub(super) fn intervals<'b>(
        &'b self,
        fitted: &'b Fitted,
        contents: Contents,
    ) -> Result<Intervals<'b>, Error> {
        Intervals::new(&self.joint, fitted, self.settings.training_block_s(), contents)
    }
}

/// Change of the simulated force from `current` to `fitted`, N.
fn change_n(current: &Fitted, fitted: &Fitted) -> Vec<f64> {
    fitted.predicted_n.iter().zip(&current.predicted_n).map(|(with, without)| with - without).collect()
}

/// Why the value found for a parameter is not plausible; `None` if it is.
pub(super) fn implausible(effect: &EffectModel, found: &FoundParameter, joint: &Joint) -> Option<Refusal> {
    let parameter = effect.effect().parameters().iter().find(|p| p.name == found.name)?;
    let [low, high] = found.range;
    let margin = 1e-3 * (high - low);
    // If an end of the range is the neutral value, the interval decides. A shape parameter may lie at an end.
    let neutral = parameter.neutral * joint.scales.size(parameter.scale);
    let ends = |end: f64| {
        !parameter.is_shape() && (end - neutral).abs() > margin && (found.value - end).abs() <= margin
    };
    if ends(low) || ends(high) || found.value < low - margin || found.value > high + margin {
        let (parameter, value, range) = (found.name, found.value, found.range);
        return Some(Refusal::AtEndOfRange { parameter, value, range });
    }
    let [from, to] = found.ci95;
    if parameter.is_shape() && from <= low && to >= high {
        return Some(Refusal::ShapeNotDetermined {
            parameter: found.name,
            ci95: found.ci95,
            range: found.range,
        });
    }
    let is_there = from > neutral || to < neutral;
    if !parameter.is_shape() && !is_there {
        return Some(Refusal::IncludesZero { parameter: found.name, ci95: found.ci95 });
    }
    None
}
