//! The score of an effect: how the simulation changes when a little of the effect is added, and whether the residual correlates with
//! that change.
//!
//! ```text
//! g   = (M(theta, probe) - M(theta, absent)) / probe       through the whole simulator, each run's mean removed
//! g'  = g projected off the Jacobian of the base and of the effects already in the model
//! c   = g'r / g'g'                                          size of the effect by linear regression
//! drop    = (g'r)^2 / g'g'                                  drop of squared error that the linear model predicts
//! ```

use super::Settings;
use super::blocks::Blocks;
use super::derivative_span::DerivativeSpan;
use super::finding::RefusedEffect;
use super::joint::{Fitted, Joint, Nearby};
use super::refusal::Refusal;
use super::rows::{Rows, dot};
use super::space::with_effect;
use crate::effect::{Augmented, Effect, EffectModel, Parameter};
use crate::error::{DiagnosisError, Error};
use crate::parallel;
use crate::statistics::block_sums::{least_p, p_value};

/// Least change of the force by the probe of an effect, root mean square, as a share of the force's scale; below it the runs do not excite
/// the effect.
const LEAST_CHANGE: f64 = 1e-9;
/// Share of a score that remains after projection, from which the first fit may use the known derivatives.
const MOSTLY_ITS_OWN: f64 = 0.8;
/// Starts of a refit, as shares of the size that the score indicates.
const SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.1];
/// Further starts of a shape parameter, as shares of the data's scale.
const SHAPES: [f64; 4] = [0.3, 0.5, 0.65, 0.9];

/// The score of one effect.
#[derive(Debug, Clone)]
pub(super) struct Score {
    pub(super) effect: Effect,
    /// The projected score, N per unit of the effect's first parameter.
    pub(super) own: Vec<f64>,
    /// Share of the score's length that remains after projection.
    pub(super) identifiable: f64,
    /// Probability that the residual correlates with the score by chance; 1 if the indicated size has the wrong sign.
    pub(super) p: f64,
    /// Drop of squared error that the linear model predicts, N².
    pub(super) predicted_drop: f64,
    /// Block sums of its test; zeros if the indicated size has the wrong sign.
    pub(super) sums: Vec<f64>,
    /// The score before projection.
    whole: Vec<f64>,
    /// Size of the effect by linear regression, as a difference of the first parameter from its neutral value.
    regressed: f64,
    /// Value at which a shape parameter is held, as a share of the data's scale.
    shape: f64,
}

/// All scores of a round.
pub(super) struct Scores {
    /// Scores of the effects that these runs can test.
    pub(super) able: Vec<Score>,
    /// Scores of effects whose test could never be significant on these runs.
    pub(super) silent: Vec<Score>,
    /// The effects that these runs cannot test, each with the reason.
    pub(super) untestable: Vec<RefusedEffect>,
    span: DerivativeSpan,
}

/// The scores of all effects that may be added to `fitted`.
pub(super) fn scores(
    joint: &Joint,
    confirm: &Rows,
    fitted: &Fitted,
    settings: &Settings,
) -> Result<Scores, Error> {
    let span = DerivativeSpan::new(joint, fitted)?;
    let (effects, left_out): (Vec<Effect>, Vec<Effect>) =
        candidates(&fitted.model).partition(|effect| settings.effects.has(*effect));
    let one = |effect: &Effect| {
        if joint.watch.is_cancelled() {
            return Err(Error::Cancelled);
        }
        Ok(score(joint, confirm, fitted, &span, *effect, settings))
    };
    let found: Vec<Result<Score, RefusedEffect>> =
        parallel::map(&effects, one).into_iter().collect::<Result<_, _>>()?;
    let mut scores = Vec::new();
    let excluded = |effect| RefusedEffect { effect, why: Refusal::Excluded };
    let mut untestable: Vec<RefusedEffect> = left_out.into_iter().map(excluded).collect();
    for result in found {
        match result {
            Ok(score) => scores.push(score),
            Err(refused) => untestable.push(refused),
        }
    }
    // A test that can never be significant is left out, so that it does not weaken the correction of the others.
    let (able, silent): (Vec<Score>, Vec<Score>) =
        scores.into_iter().partition(|score| least_p(score.sums.len()) <= settings.significance);
    untestable.extend(silent.iter().map(|score| RefusedEffect {
        effect: score.effect,
        why: Refusal::TooFewBlocks { blocks: score.sums.len() },
    }));
    Ok(Scores { able, silent, untestable, span })
}

impl Scores {
    /// A first fit of `fitted` with the effect of `score`, with at most `evaluations`. If most of the score remains after projection, the
    /// fit starts with the derivatives that the scores were computed with. Otherwise the small rest of the score decides, and those
    /// derivatives are not accurate enough for it.
    pub(super) fn refit(
        &self,
        joint: &Joint,
        fitted: &Fitted,
        score: &Score,
        evaluations: usize,
    ) -> Result<Option<Fitted>, Error> {
        let start = self.start(joint, fitted, score)?;
        let nearby = match score.identifiable >= MOSTLY_ITS_OWN {
            true => self.span.nearby(&start, score.effect, &score.whole),
            false => Nearby::new(),
        };
        joint.refit_from(&start, nearby, evaluations)
    }

    /// Start of a refit of `fitted` with the effect of `score`. The indicated size is often beyond the range of the linear model, so
    /// several shares of it are tried, each with the base coefficients as they are and with room made for it; the best is used.
    fn start(&self, joint: &Joint, fitted: &Fitted, score: &Score) -> Result<Augmented, Error> {
        let parameter = &score.effect.parameters()[0];
        let size = joint.scales.size(parameter.scale);
        let neutral = parameter.neutral * size;
        let [low, high] = joint.ranges.of(score.effect, 0, parameter, size);
        let amount = |share: f64| (neutral + share * score.regressed).clamp(low, high);
        let at = |amount: f64| with_amount(joint, fitted, score.effect, amount, score.shape);
        // With the effect absent the model is as good as before, so the start is never worse than `fitted`.
        let mut start = at(neutral)?;
        let mut least = fitted.squares;
        for amount in SHARES.map(amount) {
            let plain = at(amount)?;
            let moved = self.span.makes_room(joint, &plain, &score.whole, amount - neutral);
            for other in [Some(plain), moved].into_iter().flatten() {
                let found = Fitted::squares_of(&other, joint.rows);
                if found < least {
                    (start, least) = (other, found);
                }
            }
        }
        Ok(start)
    }
}

/// `fitted` with an effect whose first parameter is `amount`. A shape parameter, if the effect has one, is `shape` times the data's
/// scale.
fn with_amount(
    joint: &Joint,
    fitted: &Fitted,
    effect: Effect,
    amount: f64,
    shape: f64,
) -> Result<Augmented, Error> {
    let value = |(index, parameter): (usize, &Parameter)| match index {
        0 => amount,
        _ if parameter.is_shape() => shape * joint.scales.size(parameter.scale),
        _ => parameter.neutral * joint.scales.size(parameter.scale),
    };
    let values: Vec<f64> = effect.parameters().iter().enumerate().map(value).collect();
    with_effect(&fitted.model, EffectModel::new(effect, &values)?)
}

/// Effects that may be added: none whose id is in the model already, and no refined form, which is tried after the plain form was named.
fn candidates(model: &Augmented) -> impl Iterator<Item = Effect> {
    let there: Vec<&str> = model.effects().as_slice().iter().map(|e| e.effect().id()).collect();
    let refinement = |effect: &Effect| Effect::ALL.iter().any(|other| other.refined() == Some(*effect));
    Effect::ALL.into_iter().filter(move |effect| !refinement(effect) && !there.contains(&effect.id()))
}

fn score(
    joint: &Joint,
    confirm: &Rows,
    fitted: &Fitted,
    span: &DerivativeSpan,
    effect: Effect,
    settings: &Settings,
) -> Result<Score, RefusedEffect> {
    let refused = |why| RefusedEffect { effect, why };
    for need in effect.needs() {
        if let Some(run) = joint.rows.lacking(*need).or_else(|| confirm.lacking(*need)) {
            return Err(refused(Refusal::MissingChannel { run: run.to_owned(), channel: need.name() }));
        }
    }
    // If an effect has a shape parameter, the test uses the shape's neutral value, and the refit starts from the best of several shapes.
    let Some(shape) = effect.parameters().iter().find(|p| p.is_shape()) else {
        return held_score(joint, fitted, span, effect, 0.0, settings).map_err(refused);
    };
    let tested = held_score(joint, fitted, span, effect, shape.neutral, settings).map_err(refused)?;
    let others =
        SHAPES.iter().filter_map(|shape| held_score(joint, fitted, span, effect, *shape, settings).ok());
    let best =
        others.fold(
            tested.clone(),
            |best, other| if other.predicted_drop > best.predicted_drop { other } else { best },
        );
    Ok(Score { p: tested.p, sums: tested.sums, ..best })
}

/// The score of `effect` with its shape parameter, if it has one, held at `shape` times the data's scale. The error is the
/// reason why it cannot be computed.
fn held_score(
    joint: &Joint,
    fitted: &Fitted,
    span: &DerivativeSpan,
    effect: Effect,
    shape: f64,
    settings: &Settings,
) -> Result<Score, Refusal> {
    let parameter = &effect.parameters()[0];
    let size = joint.scales.size(parameter.scale);
    let (neutral, step) = (parameter.neutral * size, parameter.probe * size);
    let probed = with_amount(joint, fitted, effect, neutral + step, shape)
        .map_err(|error| Refusal::Invalid { error: Box::new(error) })?;
    let own = joint.rows.difference(&probed, &fitted.predicted_n, step);
    let Some(mut own) = own else { return Err(Refusal::Diverges) };
    joint.rows.centre(&mut own);
    let change_n = step.abs() * (dot(&own, &own) / own.len().max(1) as f64).sqrt();
    let needed_n = LEAST_CHANGE * joint.scales.force_n;
    if change_n < needed_n {
        return Err(Refusal::NotExcited { change_n, needed_n, excitation: effect.separated_by() });
    }
    let whole = own.clone();
    let identifiable = span.take_out(&mut own);
    if identifiable < settings.thresholds.least_identifiable {
        return Err(Refusal::NotIdentifiable {
            identifiable,
            needed: settings.thresholds.least_identifiable,
            excitation: effect.separated_by(),
        });
    }
    let power = dot(&own, &own);
    let regressed = dot(&own, &fitted.residual_n) / power;
    let range = joint.ranges.of(effect, 0, parameter, size);
    let [low, high] = [range[0].min(neutral), range[1].max(neutral)];
    let possible = (low..=high).contains(&(neutral + 1e-3 * regressed.signum() * step.abs()));
    // The block length follows from the correlation of the rest after the effect is removed: the effect itself may be slow.
    let rest: Vec<f64> = own.iter().zip(&fitted.residual_n).map(|(g, r)| g * (r - regressed * g)).collect();
    let blocks = Blocks::of_test(joint.rows, &rest, settings.training_block_s());
    let mut sums = blocks.sums(&own, &fitted.residual_n);
    if !possible {
        sums.fill(0.0);
    }
    let p = p_value(&sums, settings.seed);
    let predicted_drop = if possible { regressed * regressed * power } else { 0.0 };
    Ok(Score { effect, own, identifiable, p, predicted_drop, sums, whole, regressed, shape })
}

/// Rejects runs with fewer blocks than a test needs, before any work.
pub(super) fn check_length(rows: &Rows, settings: &Settings) -> Result<(), Error> {
    let needed = (2..).find(|&blocks| least_p(blocks) <= settings.significance).unwrap_or(2);
    let found = Blocks::new(rows, settings.training_block_s()).count();
    if found >= needed {
        return Ok(());
    }
    Err(DiagnosisError::TooShort {
        blocks: found,
        needed_blocks: needed,
        block_s: settings.training_block_s(),
        needed_s: needed as f64 * settings.training_block_s(),
    }
    .into())
}
