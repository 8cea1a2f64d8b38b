//! The score of an effect: what adding a little of it would change in the free run, and whether the residual goes that way.
//!
//! ```text
//! g   = (M(theta, probe) - M(theta, absent)) / probe       through the whole simulator, each run's mean taken out
//! g'  = g less what base and effects in the model could do as well (their Jacobian's span)
//! c   = g'r / g'g'                                          how much of it the residual asks for, taken as straight
//! promise = (g'r)^2 / g'g'                                  what of the squared error would go
//! ```

use super::Settings;
use super::basis::Basis;
use super::blocks::{Blocks, least_p, p_of};
use super::finding::Refused;
use super::joint::{Fitted, Joint};
use super::rows::{Rows, dot};
use super::space::{Space, with_effect};
use crate::effect::{Augmented, Effect, EffectModel};
use crate::error::Error;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

/// Share of a score below which the base could take all of the effect.
const LEAST_IDENTIFIABLE: f64 = 0.02;
/// Shares of what a score asks for that a refit may start from.
const SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.1];
/// Added to a unit diagonal, so that columns that are nearly one can be told apart.
const RIDGE: f64 = 1e-9;
/// Further values that a shape parameter may start from, as shares of the data's scale.
const SHAPES: [f64; 4] = [0.3, 0.5, 0.65, 0.9];

/// The score of one effect that these runs can test.
#[derive(Debug, Clone)]
pub(super) struct Score {
    pub(super) effect: Effect,
    /// What is left of the score, unit by unit of the effect's first parameter.
    pub(super) own: Vec<f64>,
    /// Share of the score that is left.
    pub(super) identifiable: f64,
    /// Probability that the residual goes along by chance; 1 where it asks for a value on the wrong side of absent.
    pub(super) p: f64,
    /// Squared error that would go, N².
    pub(super) promise: f64,
    /// The model with as much of the effect as the score asks for.
    pub(super) start: Augmented,
    /// Sums over the blocks of its test; zeros where the residual asks for a value on the wrong side of absent.
    pub(super) sums: Vec<f64>,
}

/// The scores of all effects that may be added to `fitted`, and those that these runs cannot test.
pub(super) fn scores(
    joint: &Joint,
    confirm: &Rows,
    fitted: &Fitted,
    settings: &Settings,
) -> Result<(Vec<Score>, Vec<Refused>), Error> {
    let known = Known::new(joint, fitted)?;
    let effects: Vec<Effect> = candidates(&fitted.model).collect();
    let one = |effect: &Effect| {
        if joint.watch.is_cancelled() {
            return Err(Error::Cancelled);
        }
        Ok(score(joint, confirm, fitted, &known, *effect, settings))
    };
    let found: Vec<Result<Score, Refused>> = effects.par_iter().map(one).collect::<Result<_, _>>()?;
    let (mut scores, mut untestable): (Vec<Score>, Vec<Refused>) = (Vec::new(), Vec::new());
    for result in found {
        match result {
            Ok(score) => scores.push(score),
            Err(refused) => untestable.push(refused),
        }
    }
    // Tests that cannot say yes are none, and must not weigh on the others.
    let (able, silent): (Vec<Score>, Vec<Score>) =
        scores.into_iter().partition(|score| least_p(score.sums.len()) <= settings.significance);
    untestable.extend(silent.into_iter().map(|score| Refused {
        effect: score.effect,
        why: format!(
            "what it would change hangs together for so long that the estimate runs hold {} independent blocks, too few to tell it \
             from chance; give longer runs",
            score.sums.len()
        ),
    }));
    Ok((able, untestable))
}

/// Effects that may be added: one form of an id at most; that a lag differs up and down is found after it is named.
fn candidates(model: &Augmented) -> impl Iterator<Item = Effect> {
    let there: Vec<&str> = model.effects().as_slice().iter().map(|e| e.effect().id()).collect();
    let refinement = |effect: &Effect| Effect::ALL.iter().any(|other| other.refined() == Some(*effect));
    Effect::ALL.into_iter().filter(move |effect| !refinement(effect) && !there.contains(&effect.id()))
}

/// What the model can do by its own numbers.
struct Known {
    basis: Basis,
    columns: Vec<Vec<f64>>,
    /// Of the columns, each over its length.
    square: Option<Cholesky<f64, Dyn>>,
    lengths: Vec<f64>,
    of_base: usize,
}

impl Known {
    fn new(joint: &Joint, fitted: &Fitted) -> Result<Self, Error> {
        let (columns, of_base) = joint.jacobian(fitted)?;
        let lengths: Vec<f64> =
            columns.iter().map(|c| dot(c, c).sqrt()).map(|l| if l > 0.0 { l } else { 1.0 }).collect();
        let n = columns.len();
        let square = DMatrix::from_fn(n, n, |a, b| {
            dot(&columns[a], &columns[b]) / (lengths[a] * lengths[b]) + if a == b { RIDGE } else { 0.0 }
        });
        let square = (n > 0).then(|| square.cholesky()).flatten();
        Ok(Self { basis: Basis::of(columns.clone()), columns, square, lengths, of_base })
    }

    /// `with`, its other numbers moved so that they make up for what they have in common with `amount` of an effect whose score
    /// is `score`. `None` where they make no model.
    fn makes_room(&self, joint: &Joint, with: &Augmented, score: &[f64], amount: f64) -> Option<Augmented> {
        let shared = DVector::from_iterator(
            self.columns.len(),
            self.columns.iter().zip(&self.lengths).map(|(c, length)| dot(c, score) / length),
        );
        let moves = self.square.as_ref()?.solve(&shared);
        let space = Space::new(with, joint.scales, joint.base_moves).ok()?;
        let mut values = space.values();
        // Of several effects only the base makes room: where theirs stand in the list depends on the new one.
        for ((value, bounds), (step, length)) in
            values.iter_mut().zip(space.bounds()).zip(moves.iter().zip(&self.lengths)).take(self.of_base)
        {
            *value = (*value - amount * step / length).clamp(bounds[0], bounds[1]);
        }
        space.model(&values)
    }
}

fn score(
    joint: &Joint,
    confirm: &Rows,
    fitted: &Fitted,
    known: &Known,
    effect: Effect,
    settings: &Settings,
) -> Result<Score, Refused> {
    let refused = |why: String| Refused { effect, why };
    for need in effect.needs() {
        if let Some(run) = joint.rows.lacking(*need).or_else(|| confirm.lacking(*need)) {
            return Err(refused(format!(
                "run {run} has no {}, without which it cannot be tested",
                need.name()
            )));
        }
    }
    // Where an effect has a shape, the test is at the shape that its file holds it at, and the refit starts from the best.
    let Some(shape) = effect.parameters().iter().find(|p| p.is_shape()) else {
        return held_score(joint, fitted, known, effect, 0.0, settings).map_err(refused);
    };
    let tested = held_score(joint, fitted, known, effect, shape.neutral, settings).map_err(refused)?;
    let others =
        SHAPES.iter().filter_map(|shape| held_score(joint, fitted, known, effect, *shape, settings).ok());
    let best =
        others.fold(tested.clone(), |best, other| if other.promise > best.promise { other } else { best });
    Ok(Score { p: tested.p, sums: tested.sums, ..best })
}

/// The score of `effect` with a shape parameter, if it has one, held at `shape` of the data's scale. The error says why there is
/// none.
fn held_score(
    joint: &Joint,
    fitted: &Fitted,
    known: &Known,
    effect: Effect,
    shape: f64,
    settings: &Settings,
) -> Result<Score, String> {
    let parameters = effect.parameters();
    let size = |index: usize| joint.scales.size(parameters[index].scale);
    let at = |first: f64| {
        let value = |(j, p): (usize, &crate::effect::Parameter)| match j {
            0 => first,
            _ if p.is_shape() => shape * size(j),
            _ => p.neutral * size(j),
        };
        let values: Vec<f64> = parameters.iter().enumerate().map(value).collect();
        EffectModel::new(effect, &values)
            .and_then(|model| with_effect(&fitted.model, model))
            .map_err(|e| e.to_string())
    };
    let (neutral, step) = (parameters[0].neutral * size(0), parameters[0].probe * size(0));
    let there = joint.rows.predict(&at(neutral + step)?);
    let Some(mut own) = there else { return Err("the model does not run with it on these runs".to_owned()) };
    own.iter_mut().zip(&fitted.predicted_n).for_each(|(there, here)| *there = (*there - here) / step);
    joint.rows.centre(&mut own);
    let change_n = step.abs() * (dot(&own, &own) / own.len().max(1) as f64).sqrt();
    let force_n = joint.scales.force_n;
    if change_n < 1e-9 * force_n {
        return Err(format!("these runs do not excite it; what would: {}", effect.separated_by()));
    }
    let whole = own.clone();
    let identifiable = known.basis.take_out(&mut own);
    if identifiable < LEAST_IDENTIFIABLE {
        return Err(format!(
            "on these runs other coefficients of the model do the same ({:.1} % of it is its own); what would tell: {}",
            100.0 * identifiable,
            effect.separated_by()
        ));
    }
    let power = dot(&own, &own);
    let asked = dot(&own, &fitted.residual_n) / power;
    let range = parameters[0].range_at(size(0));
    let [low, high] = [range[0].min(neutral), range[1].max(neutral)];
    let possible = (low..=high).contains(&(neutral + 1e-3 * asked.signum() * step.abs()));
    // The correlation of what is left once the effect is in: the effect itself may be slow.
    let rest: Vec<f64> = own.iter().zip(&fitted.residual_n).map(|(g, r)| g * (r - asked * g)).collect();
    let blocks = Blocks::against(joint.rows, &rest, settings.block_s);
    let mut sums = blocks.sums(&own, &fitted.residual_n);
    if !possible {
        sums.fill(0.0);
    }
    let p = p_of(&sums, settings.seed);
    let promise = if possible { asked * asked * power } else { 0.0 };
    // What is asked for is far for a straight line: the best of some shares of it, with room made for them and without.
    let amount = |share: f64| (neutral + share * asked).clamp(range[0].max(low), range[1].min(high));
    let squares = |model: &Augmented| Fitted::as_is(*model, joint.rows).map_or(f64::INFINITY, |f| f.squares);
    let mut start = at(amount(1.0))?;
    let mut least = squares(&start);
    for share in SHARES {
        let moved = known.makes_room(joint, &at(amount(share))?, &whole, amount(share) - neutral);
        let found = moved.as_ref().map_or(f64::INFINITY, squares);
        if let (Some(moved), true) = (moved, found < least) {
            (start, least) = (moved, found);
        }
    }
    Ok(Score { effect, own, identifiable, p, promise, start, sums })
}

/// Refuses runs that hold fewer blocks than a test needs, before any work.
pub(super) fn check_length(rows: &Rows, settings: &Settings) -> Result<(), Error> {
    let needed = (2..).find(|&blocks| least_p(blocks) <= settings.significance).unwrap_or(2);
    let found = Blocks::new(rows, settings.block_s).count();
    if found >= needed {
        return Ok(());
    }
    Err(Error::Data {
        message: format!(
            "the estimate runs hold {found} blocks of {} s in which the damper moves, but {needed} are needed to tell an effect from \
             chance: give {:.0} s of motion or more, in one run or several (30 s are a good start)",
            settings.block_s,
            needed as f64 * settings.block_s
        ),
    })
}
