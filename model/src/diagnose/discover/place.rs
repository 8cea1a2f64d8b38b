//! The place of a term that begins or ends within a long run.
//!
//! ```text
//! F' = F + c m g(q - a)       a: place; q: time, path, energy or rise of the temperature
//! a    = argmin |r(a)|^2      on the training runs: on a grid over the range of q, then on two finer ones around the best
//! q    = argmin |r(q)|^2      on the validation runs, each q with its place
//! ```
//!
//! A search on stretches knows the place only as far as the stretches show it, and all of these arguments grow from one stretch to the next. A
//! sudden change between two of them leaves an error at all samples between it and the place, and no gradient leads there. So place and argument
//! are searched on all samples before the model is fitted to them.

use super::around::Damper;
use super::series::Series;
use super::with_terms;
use crate::diagnose::rows::{Rows, dot};
use crate::effect::Augmented;
use crate::effect::term::{Argument, Form, Term};
use crate::error::Error;
use crate::statistics::range;

/// Steps of the first grid over the range, and of the finer ones to either side of the best place.
const STEPS: usize = 64;
const FINER: i32 = 8;
/// Finer grids.
const REFINED: usize = 2;

/// `model` with the places of its terms from number `first` on, and the arguments that these are on, as they fit the training runs `train` and the
/// validation runs `confirm` best.
pub(in crate::diagnose) fn placed(
    model: Augmented,
    first: usize,
    train: &Rows,
    confirm: &Rows,
) -> Result<Augmented, Error> {
    let mut terms: Vec<Term> = model.effects().terms().iter().copied().collect();
    for index in first..terms.len() {
        if !has_place(&terms[index]) {
            continue;
        }
        let mut others = terms.clone();
        let term = others.remove(index);
        let without = with_terms(&model, &others)?;
        let Some(predicted_n) = train.predict(&without) else { continue };
        let series = Series::new(&without, train, &predicted_n);
        let on = |argument: &Argument| {
            on_argument(&term, *argument, range(series.argument(*argument)?.iter().copied()))
        };
        let growing = Argument::ALL.iter().filter(|argument| argument.counts_from_start());
        let (Some(on_train), Some(on_confirm)) =
            (Damper::new(&without, train), Damper::new(&without, confirm))
        else {
            continue;
        };
        let placed = growing.filter_map(on).filter_map(|term| {
            let term = best(&on_train, term, train)?;
            Some((term, squares(&on_confirm, &term, confirm)?))
        });
        if let Some((term, _)) = placed.min_by(|(_, a), (_, b)| a.total_cmp(b)) {
            terms[index] = term;
        }
    }
    with_terms(&model, &terms)
}

/// True if the first parameter of the term is a place on an argument that counts from the start.
fn has_place(term: &Term) -> bool {
    let (modulator, argument, form) = term.kind();
    let is_place = matches!(form, Form::Step | Form::Ramp | Form::HingeAbove | Form::HingeBelow);
    argument.counts_from_start() && is_place && !modulator.acts_on_input()
}

/// `term` on another argument that has the range `low` to `high`, with its numbers scaled to that range.
fn on_argument(term: &Term, argument: Argument, [low, high]: [f64; 2]) -> Option<Term> {
    let (modulator, own, form) = term.kind();
    if own == argument {
        return Some(*term);
    }
    let [own_low, own_high] = term.confirmed_in();
    let scale = (high - low) / (own_high - own_low);
    let amount = match form {
        Form::HingeAbove | Form::HingeBelow => term.amount() / scale,
        _ => term.amount(),
    };
    let (place, sizes) = term.parameters().split_first()?;
    let mut parameters = vec![low + (place - own_low) * scale];
    parameters.extend(sizes.iter().map(|size| size * scale));
    Term::new((modulator, argument, form), amount, &parameters, [low, high]).ok()
}

/// Squared error with `term` on `rows`, N²; `None` if it cannot be simulated.
fn squares(damper: &Damper, term: &Term, rows: &Rows) -> Option<f64> {
    let residual_n = rows.residual(&damper.with(term)?.predicted_n);
    Some(dot(&residual_n, &residual_n)).filter(|squares| squares.is_finite())
}

/// `term` at the place with the least squared error; `None` if it cannot be simulated.
fn best(damper: &Damper, term: Term, train: &Rows) -> Option<Term> {
    let [low, high] = term.confirmed_in();
    let at = |place: f64| {
        let mut values = term.values().to_vec();
        values[1] = place.clamp(low, high);
        let moved = term.with_values(&values)?;
        Some((moved, squares(damper, &moved, train)?))
    };
    let mut step = (high - low) / STEPS as f64;
    let mut least = at(term.values()[1]);
    for round in 0..=REFINED {
        let centre = least.map_or(low, |(term, _)| term.values()[1]);
        let places: Vec<f64> = match round {
            0 => (0..=STEPS).map(|k| low + step * k as f64).collect(),
            _ => (-FINER..=FINER).map(|k| centre + step * f64::from(k)).collect(),
        };
        least = places.into_iter().filter_map(at).chain(least).min_by(|(_, a), (_, b)| a.total_cmp(b));
        step /= f64::from(FINER);
    }
    least.map(|(term, _)| term)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::term::{Argument, Form, Modulator};
    use crate::identify::{Dataset, DatasetOptions};
    use crate::preset;
    use crate::rig::{Channels, Experiment, Plant, record};

    #[test]
    fn a_change_between_two_stretches_is_found_on_all_samples() {
        let experiment = Experiment::thesis("RP-APRBS").expect("an experiment").with_duration_s(60.0);
        let run = record(&experiment, &Plant::default(), &Channels::default(), 1);
        let options = DatasetOptions { rate_hz: Some(128.0), ..DatasetOptions::default() };
        let data = [Dataset::from_run(&run, &Default::default(), &options).expect("rows")];
        let base = Augmented::from(preset::load(preset::BEST_FUZZY_TANH).expect("a preset").force);
        let kind = (Modulator::Force, Argument::Time, Form::Step);
        let step = |at_s| Term::new(kind, -0.15, &[at_s, 0.1], [0.0, 60.0]).expect("a term");
        let constant = (Modulator::SignVelocity, Argument::Displacement, Form::Constant);
        let drag = Term::new(constant, 40.0, &[], [-1.0, 1.0]).expect("a term");
        let model = |at_s| with_terms(&base, &[step(at_s), drag]).expect("a model");
        let rows = Rows::new(&data, usize::MAX);
        let truth_n = rows.predict(&model(23.4)).expect("it is finite");
        let rows = rows.with_force(truth_n);
        // Begun on another argument, too.
        let on_path = on_argument(&step(41.0), Argument::Path, [0.0, 8.0]).expect("a term");
        for begun in [step(41.0), on_path] {
            let begun = with_terms(&base, &[begun, drag]).expect("a model");
            let found = placed(begun, 0, &rows, &rows).expect("a model");
            let terms: Vec<&Term> = found.effects().terms().iter().collect();
            assert_eq!((terms[0].kind(), terms[1]), (kind, &drag));
            assert!((terms[0].values()[1] - 23.4).abs() < 0.02, "{:?}", terms[0]);
        }
        // Terms of the base stay.
        assert_eq!(placed(model(41.0), 1, &rows, &rows).expect("a model"), model(41.0));
    }
}
