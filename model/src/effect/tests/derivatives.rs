//! The derivatives of a model with effects, against differences of the same model without derivatives.

use super::*;
use crate::effect::term::Terms;
use crate::force::jet::Jet;
use crate::force::{FuzzySets, Membership};

/// Directions of one pass.
const DIRECTIONS: usize = 8;
/// Step of a difference, relative to the number.
const STEP: f64 = 1e-5;

/// Bouc-Wen with parameters that depend on the drive, by polynomials.
pub(super) fn driven_bouc_wen() -> ForceModel {
    let drive = Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 1 };
    let constants = [700.0, 8000.0, 300.0, 50.0, 200.0, 300.0, 1.2, 300.0, 400.0];
    let by_drive = [100.0, 900.0, 0.0, 0.0, 250.0, 0.0, 0.0, 0.0, 0.0];
    law(ForceLaw::BoucWen, drive, &[constants, by_drive].concat())
}

/// Bouc-Wen in two fuzzy sets, each with its own state.
fn fuzzy_bouc_wen() -> ForceModel {
    let membership = Membership { drive: DriveKind::CoilCurrent, sigma: 0.6 };
    let sets = FuzzySets::new(membership, &[0.4, 2.0]).expect("sets");
    let weak = [700.0, 8000.0, 300.0, 0.0, 200.0, 300.0, 1.2, 300.0, 400.0];
    let strong = [900.0, 9000.0, 300.0, 0.0, 800.0, 300.0, 1.2, 300.0, 400.0];
    law(ForceLaw::BoucWen, Dependence::Fuzzy(sets), &[weak, strong].concat())
}

/// The effect with values that clearly change the force. A delay of whole samples would be a point where two branches meet, at each sample.
fn clear(effect: Effect) -> EffectModel {
    if effect == Effect::SensorDelay { with(effect, &[0.0047]) } else { effect.example() }
}

/// The numbers of `model`: coefficients, then parameters of its effects, then the numbers of its terms.
fn numbers(model: &Augmented) -> Vec<f64> {
    let effects = model.effects().as_slice().iter().flat_map(|effect| effect.parameters().to_vec());
    let terms = model.effects().terms().iter().flat_map(|term| term.values().to_vec());
    model.force().coefficients().expect("coefficients").into_iter().chain(effects).chain(terms).collect()
}

/// `model` with other numbers.
fn rebuilt(model: &Augmented, numbers: &[f64]) -> Augmented {
    let (own, mut rest) = numbers.split_at(model.force().parameter_count());
    let force = model.force().with_coefficients(own).expect("coefficients");
    let mut effects = Vec::new();
    for effect in model.effects().as_slice() {
        let (parameters, others) = rest.split_at(effect.parameters().len());
        effects.push(with(effect.effect(), parameters));
        rest = others;
    }
    let mut terms = Vec::new();
    for term in model.effects().terms().iter() {
        let (values, others) = rest.split_at(term.values().len());
        terms.push(term.with_values(values).expect("a term"));
        rest = others;
    }
    let effects =
        Effects::new(&effects).expect("few enough").with_terms(Terms::new(&terms).expect("few enough"));
    Augmented::new(force, effects).expect("effects that fit the model")
}

fn forces(model: &Augmented, inputs: &[Inputs]) -> Vec<f64> {
    let mut state = AugmentedState::default();
    inputs.iter().map(|inputs| model.free_run(&mut state, inputs).unwrap_or(f64::NAN)).collect()
}

/// Forces and derivatives by the numbers `first..first + DIRECTIONS`.
fn jets(model: &Augmented, first: usize, inputs: &[Inputs]) -> Vec<Jet<DIRECTIONS>> {
    let on_jets = AugmentedOnJets::new(model, |number, value| match number.checked_sub(first) {
        Some(direction) if direction < DIRECTIONS => Jet::variable(value, direction),
        _ => Jet::from(value),
    })
    .expect("a model with derivatives");
    let mut state = JetState::default();
    inputs.iter().map(|inputs| on_jets.free_run(&mut state, inputs).unwrap_or(Jet::from(f64::NAN))).collect()
}

/// Root of the sum of squares.
fn length(series: impl Iterator<Item = f64>) -> f64 {
    series.map(|value| value * value).sum::<f64>().sqrt()
}

/// Checks all derivatives of `model` over `inputs`. Where two branches of an effect or of a law meet, a difference may lie between their
/// derivatives, so whole series are compared.
///
/// A spring in series passes each change of branch of a law on to all later samples.
pub(super) fn check(model: &Augmented, name: &str) {
    let has_spring = model.effects().as_slice().iter().any(|effect| effect.effect() == Effect::SeriesSpring);
    let near = if has_spring { 2e-2 } else { 1e-3 };
    // The first sample has no acceleration.
    let inputs = &motion(500)[1..];
    let plain_n = forces(model, inputs);
    let all = numbers(model);
    for first in (0..all.len()).step_by(DIRECTIONS) {
        let found = jets(model, first, inputs);
        let size_n = length(plain_n.iter().copied());
        let apart_n = length(found.iter().zip(&plain_n).map(|(jet, plain_n)| jet.re - plain_n));
        // The spring is solved less closely where derivatives are computed.
        assert!(apart_n <= 1e-4 * size_n, "{name}: forces differ by {apart_n} N of {size_n} N");
        for direction in 0..DIRECTIONS.min(all.len() - first) {
            let number = first + direction;
            let step = STEP * all[number].abs().max(1e-3);
            let moved = |by: f64| {
                let mut moved = all.clone();
                moved[number] += by;
                forces(&rebuilt(model, &moved), inputs)
            };
            let (above_n, below_n) = (moved(step), moved(-step));
            let expected =
                || above_n.iter().zip(&below_n).map(|(above, below)| (above - below) / (2.0 * step));
            let (size, apart) = (
                length(expected()),
                length(found.iter().zip(expected()).map(|(jet, by)| jet.by[direction] - by)),
            );
            // Of a difference of two forces, and of the solver of the spring.
            let rounding = 1e-10 * size_n / step;
            assert!(apart <= near * size + rounding, "{name}, number {number}: {apart} of {size}");
        }
    }
}

#[test]
fn every_effect_has_the_derivatives_of_its_simulation() {
    let thesis = thesis(preset::BEST_FUZZY_TANH);
    let bases = [
        (thesis, "fuzzy-tanh"),
        (tanh(), "sp"),
        (driven_bouc_wen(), "bouc-wen"),
        (fuzzy_bouc_wen(), "fuzzy bouc-wen"),
    ];
    for (base, name) in bases {
        check(&augmented(base, &[]), name);
        for effect in Effect::ALL {
            check(&augmented(base, &[clear(effect)]), &format!("{name} with {}", effect.title()));
        }
    }
}

#[test]
fn effects_inside_of_others_have_derivatives_too() {
    let lag = with(Effect::CoilLag, &[0.012]);
    let inside = [lag, Effect::Friction.example(), Effect::SeriesSpring.example()];
    let outside = [lag, Effect::SeriesSpring.example(), clear(Effect::SensorDelay)];
    for (base, name) in [(driven_bouc_wen(), "bouc-wen"), (fuzzy_bouc_wen(), "fuzzy bouc-wen")] {
        check(&augmented(base, &inside), &format!("{name}, inside a spring"));
        check(&augmented(base, &outside), &format!("{name}, outside of a spring"));
    }
}

#[test]
fn an_absent_effect_has_a_derivative() {
    let inputs = &motion(300)[1..];
    for effect in Effect::ALL {
        let neutral = effect.stepped(None, size);
        let model = augmented(driven_bouc_wen(), &[neutral]);
        let first = model.force().parameter_count();
        let found = jets(&model, first, inputs);
        let by = length(found.iter().map(|jet| jet.by[0]));
        assert!(by.is_finite() && by > 0.0, "{}: {by}", effect.title());
        // In the direction of its physical range, where it has an effect.
        let parameter = &effect.parameters()[0];
        let step = 1e-3 * parameter.probe * size(parameter.scale);
        let mut all = numbers(&model);
        all[first] += step;
        let (there_n, here_n) = (forces(&rebuilt(&model, &all), inputs), forces(&model, inputs));
        let expected = || there_n.iter().zip(&here_n).map(|(there, here)| (there - here) / step);
        let apart = length(found.iter().zip(expected()).map(|(jet, by)| jet.by[0] - by));
        assert!(apart <= 0.02 * length(expected()), "{}: {apart} of {by}", effect.title());
    }
}

#[test]
fn a_model_that_is_not_a_law_has_none() {
    let arx = Augmented::from(thesis(preset::BEST_ARX));
    assert!(AugmentedOnJets::<DIRECTIONS>::new(&arx, |_, value| Jet::from(value)).is_none());
}
