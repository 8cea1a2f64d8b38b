//! Whether the healthy damper has a named effect too.
//!
//! ```text
//! p           first parameter of the effect, on the training runs
//! h           the same in a joint fit of the model to the healthy runs
//! w_h, w_p    widths of their 95 % intervals
//! alike       |h - p| <= (w_h + w_p) / 2
//! ```
//!
//! | on the healthy runs | change |
//! |---|---|
//! | the interval of h reaches the neutral value, and h and p are alike | unknown: these runs cannot show the effect |
//! | the interval of h reaches the neutral value, or h is at most 0.2 p | new |
//! | h and p are alike, or differ by less than a quarter | none |
//! | otherwise | another amount |
//!
//! The healthy damper's own effects are not faults: its model lacked them from the start. Terms that are effects themselves are not in the model
//! that is fitted to the healthy runs.

use super::discover::with_terms;
use super::finding::{Change, DiagnosisResult, FoundParameter, NamedEffect, SinceHealthy};
use super::interval::{Contents, Intervals};
use super::joint::{Fitted, Joint};
use super::round::FINAL;
use super::rows::Rows;
use super::{Runs, Settings, Thresholds};
use crate::effect::term::Term;
use crate::effect::{Augmented, EffectModel, Effects};
use crate::error::Error;
use crate::identify::{Scales, Watch};
use crate::parallel;

/// Share of an effect's amount at the second start of the fit to the healthy runs.
const NEARLY_WITHOUT: f64 = 0.05;

/// `result` with what `runs.healthy` says about each effect that was named.
pub(super) fn compared(
    result: DiagnosisResult,
    runs: &Runs,
    settings: &Settings,
    watch: &Watch,
) -> Result<DiagnosisResult, Error> {
    if runs.healthy.is_empty() || result.effects.is_empty() {
        return Ok(result);
    }
    let rows = Rows::new(runs.healthy, settings.most_rows);
    let joint = Joint {
        rows: &rows,
        scales: Scales::of(runs.estimate)?,
        ranges: settings.ranges,
        base_moves: true,
        watch,
    };
    // A fit that begins with the effects may end beside the least error of a damper without them.
    let found = of_healthy(&result)?;
    let starts = [found, nearly_without(&found)?];
    let fits: Vec<Option<Fitted>> =
        parallel::map(&starts, |start| joint.refit(start, FINAL)).into_iter().collect::<Result<_, _>>()?;
    let best = fits.into_iter().flatten().min_by(|a, b| a.squares.total_cmp(&b.squares));
    let Some(fitted) = best else { return Ok(result) };
    let intervals = Intervals::new(&joint, &fitted, settings.training_block_s(), Contents::All)?;
    let compared = |named: NamedEffect| {
        let index = fitted.model.effects().position(named.effect.effect());
        let on_healthy = index.and_then(|index| intervals.of(index).first().copied());
        let since_healthy = on_healthy
            .zip(named.parameters.first())
            .map(|(amount, now)| SinceHealthy { amount, change: change(now, &amount, &settings.thresholds) });
        NamedEffect { since_healthy, ..named }
    };
    let effects = result.effects.into_iter().map(compared).collect();
    Ok(DiagnosisResult { effects, ..result })
}

/// The model found, without those terms that are effects.
fn of_healthy(result: &DiagnosisResult) -> Result<Augmented, Error> {
    let (found, own) = (result.after.effects, result.before.effects.terms().iter().count());
    let claims =
        std::iter::repeat_n(None, own).chain(result.discovery.terms.iter().map(|term| Some(term.claim)));
    let kept: Vec<Term> = (found.terms().iter().zip(claims))
        .filter(|(_, claim)| !claim.is_some_and(|claim| claim.is_effect()))
        .map(|(term, _)| *term)
        .collect();
    with_terms(&result.after.augmented(), &kept)
}

/// `model` with a twentieth of the amount of each effect.
fn nearly_without(model: &Augmented) -> Result<Augmented, Error> {
    let smaller = |effect: &EffectModel| {
        let mut parameters = effect.parameters().to_vec();
        parameters[0] *= NEARLY_WITHOUT;
        EffectModel::new(effect.effect(), &parameters)
    };
    let effects: Vec<EffectModel> =
        model.effects().as_slice().iter().map(smaller).collect::<Result<_, _>>()?;
    Augmented::new(*model.force(), Effects::new(&effects)?.with_terms(*model.effects().terms()))
}

/// How an amount that is `now` has changed since it was `healthy`.
fn change(now: &FoundParameter, healthy: &FoundParameter, thresholds: &Thresholds) -> Change {
    let half = |found: &FoundParameter| 0.5 * (found.ci95[1] - found.ci95[0]);
    // Amounts with an interval that is not a number are not apart.
    let apart = (healthy.value - now.value).abs() > half(healthy) + half(now);
    // Amounts are neutral at zero.
    let is_shown = healthy.ci95[0] > 0.0 || healthy.ci95[1] < 0.0;
    match (is_shown, apart) {
        (false, false) => Change::Unknown,
        (false, true) => Change::New,
        _ if healthy.value.abs() <= thresholds.effect_on_healthy * now.value.abs() => Change::New,
        (true, false) => Change::None,
        _ if healthy.is_close_to(now, thresholds.same_parameter) => Change::None,
        _ => Change::Amount,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_amount_is_compared_with_that_of_the_healthy_damper() {
        let since = |healthy, half_width| {
            change(
                &FoundParameter::tau_s(0.012, 0.001),
                &FoundParameter::tau_s(healthy, half_width),
                &Thresholds::default(),
            )
        };
        assert_eq!(since(0.0001, 0.001), Change::New, "nothing there");
        assert_eq!(since(0.002, 0.0005), Change::New, "a sixth of it");
        assert_eq!(since(0.0115, 0.001), Change::None, "within the intervals");
        assert_eq!(since(0.0095, 0.0001), Change::None, "21 % apart");
        assert_eq!(since(0.006, 0.001), Change::Amount, "half of it");
        assert_eq!(since(-0.006, 0.001), Change::Amount, "another sign");
        assert_eq!(since(0.006, 0.02), Change::Unknown, "the interval reaches zero and the amount");
        assert_eq!(since(0.0, f64::INFINITY), Change::Unknown, "nothing is known");
    }
}
