//! A term around a damper whose force is known.
//!
//! ```text
//! F' = F + c m g(q)           F: force of the damper with its effects, simulated once
//! ```
//!
//! A term that does not act on an input leaves F as it is, whatever its numbers are. A fit of its numbers thus needs one simulation of the
//! damper, and for other numbers of the term only the term itself and the filter of the output, over all samples.

use super::series::Filters;
use super::{with_term, with_terms};
use crate::diagnose::rows::{Rows, RunRows, is_driven};
use crate::effect::Augmented;
use crate::effect::term::{MAX_TERM_VALUES, Term, Terms, TermsState, around};
use crate::force::jet::Jet;
use crate::parallel;

/// A force with its derivatives by the numbers of a term.
type ByTerm = Jet<MAX_TERM_VALUES>;

/// A damper with its simulated force on some runs.
pub(super) struct Damper<'a> {
    model: &'a Augmented,
    rows: &'a Rows<'a>,
    /// For each run the force at each sample, N: with the terms that act on an input, without the others. NaN where there is none.
    force_n: Vec<Vec<f64>>,
}

/// The simulated force with a term at the selected rows.
pub(super) struct WithTerm {
    pub(super) predicted_n: Vec<f64>,
    /// The derivatives by the numbers of the term, each run's mean removed.
    pub(super) columns: Vec<Vec<f64>>,
}

impl<'a> Damper<'a> {
    /// The damper of `model`; `None` if `model` has effects of the load cell, because they act on the term too.
    pub(super) fn new(model: &'a Augmented, rows: &'a Rows<'a>) -> Option<Self> {
        let effects = model.effects();
        if effects.include_load_cell() {
            return None;
        }
        let on_inputs: Vec<Term> =
            effects.terms().iter().filter(|term| term.kind().0.acts_on_input()).copied().collect();
        let inside = with_terms(model, &on_inputs).ok()?;
        let of_run = |run: &RunRows| {
            let mut force_n = Vec::with_capacity(run.dataset.rows.len());
            run.simulate(&inside, |simulated_n, _| force_n.push(simulated_n.unwrap_or(f64::NAN)));
            force_n
        };
        Some(Self { model, rows, force_n: parallel::map(rows.runs(), of_run) })
    }

    /// The damper with `term`, which must not act on an input, beside the terms of the model. `None` if the force is not finite at a row.
    pub(super) fn with(&self, term: &Term) -> Option<WithTerm> {
        let model = with_term(self.model, *term).ok()?;
        let count = term.values().len();
        // The numbers of the term are the last ones.
        let mut others =
            0..model.effects().terms().iter().map(|term| term.values().len()).sum::<usize>() - count;
        let mut own = 0..;
        let terms: Terms<ByTerm> = model.effects().terms().map(|value| match others.next() {
            Some(_) => Jet::from(value),
            None => Jet::variable(value, own.next().unwrap_or_default()),
        });
        let (needs_drive, offset_n) = (model.force().drive().is_some(), model.force().force_offset_n());
        let mut series: Vec<Vec<f64>> = vec![Vec::with_capacity(self.rows.len()); 1 + count];
        for (run, force_n) in self.rows.runs().iter().zip(&self.force_n) {
            let mut filters = Filters::new(&run.dataset.conditioning, 1 + count);
            let mut state = TermsState::default();
            let mut wanted = run.indices.iter().peekable();
            for (index, (row, force_n)) in run.dataset.rows.iter().zip(force_n).enumerate() {
                if row.dt_s.is_none() {
                    state = run.dataset.past(row).map_or_else(TermsState::default, TermsState::after);
                }
                let is_row = wanted.next_if(|next| **next == index).is_some();
                let force = match is_driven(needs_drive, row) {
                    true => around(&terms, &mut state, &row.inputs().lifted(), *force_n, offset_n),
                    false => ByTerm::from(f64::NAN),
                };
                if force.re.is_finite() {
                    let values = filters.step(row.dt_s, std::iter::once(force.re).chain(force.by));
                    if is_row {
                        series.iter_mut().zip(values).for_each(|(series, value)| series.push(*value));
                    }
                } else if is_row {
                    return None;
                }
            }
        }
        let columns = series.split_off(1).into_iter().map(|column| self.rows.derivative(column)).collect();
        series.pop().map(|predicted_n| WithTerm { predicted_n, columns })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::condition::{ApplyTo, Conditioning};
    use crate::diagnose::joint::{Joint, Nearby};
    use crate::diagnose::ranges::Ranges;
    use crate::diagnose::space::Space;
    use crate::effect::term::{Argument, Form, Modulator};
    use crate::effect::{Effect, EffectModel, Effects};
    use crate::identify::{Dataset, DatasetOptions, Scales, Watch};
    use crate::preset;
    use crate::rig::{Channels, Experiment, Plant, record};

    fn datasets(filter: ApplyTo) -> Vec<Dataset> {
        let run = record(&Experiment::sine(0.01, 2.0, 1.0, 3.0), &Plant::default(), &Channels::default(), 1);
        let conditioning = Conditioning { apply_to: filter, ..Conditioning::default() };
        vec![Dataset::from_run(&run, &conditioning, &DatasetOptions::default()).expect("the run is complete")]
    }

    /// A damper with a lag, a spring in series and a term that acts on its velocity.
    fn damper() -> Augmented {
        let effect = |effect, value| EffectModel::new(effect, &[value]).expect("it is in its range");
        let effects = [effect(Effect::CoilLag, 0.01), effect(Effect::SeriesSpring, 2e-7)];
        let kind = (Modulator::ForcePerVelocity, Argument::Displacement, Form::Linear);
        let term = Term::new(kind, 0.5, &[], [-1.0, 1.0]).expect("a term");
        let effects =
            Effects::new(&effects).expect("in their order").with_terms(Terms::new(&[term]).expect("one"));
        Augmented::new(preset::load(preset::BEST_FUZZY_TANH).expect("a preset").force, effects)
            .expect("a model")
    }

    #[test]
    fn a_term_around_a_known_force_is_the_simulated_one_with_its_derivatives() {
        let terms = [
            ((Modulator::One, Argument::Displacement, Form::Quadratic), 1e5, vec![]),
            ((Modulator::Force, Argument::Time, Form::Step), -0.1, vec![1.5, 0.2]),
            ((Modulator::SignVelocity, Argument::Energy, Form::Decay), 60.0, vec![20.0]),
            ((Modulator::ForceInExtension, Argument::Force, Form::Tanh), 0.2, vec![300.0]),
            ((Modulator::One, Argument::Force, Form::Resonance), 0.2, vec![12.0, 0.1]),
        ];
        let model = damper();
        for filter in [ApplyTo::None, ApplyTo::Output] {
            let datasets = datasets(filter);
            let rows = Rows::new(&datasets, 300);
            let around = Damper::new(&model, &rows).expect("it has no effect of the load cell");
            let joint = Joint {
                rows: &rows,
                scales: Scales::of(&datasets).expect("scales"),
                ranges: Ranges::default(),
                base_moves: true,
                watch: &Watch::default(),
            };
            for (kind, amount, parameters) in &terms {
                let term = Term::new(*kind, *amount, parameters, [-1e6, 1e6]).expect("a term");
                let found = around.with(&term).expect("it is finite");
                let whole = with_term(&model, term).expect("a model");
                let simulated_n = rows.predict(&whole).expect("it is finite");
                let close = |a: &[f64], b: &[f64], share: f64| {
                    let most = b.iter().fold(0.0, |most, b| f64::max(most, b.abs()));
                    most > 0.0
                        && a.len() == b.len()
                        && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= share * most)
                };
                assert!(close(&found.predicted_n, &simulated_n, 1e-12), "{kind:?}, {filter:?}");
                let space = Space::new(&whole, joint.scales, joint.ranges, true).expect("a space");
                let values = space.values();
                let all = vec![true; values.len()];
                let columns = crate::diagnose::derivatives::columns(
                    &joint,
                    &space,
                    &values,
                    &simulated_n,
                    &all,
                    Nearby::new(),
                );
                let columns = columns.expect("it is not cancelled");
                let own = &columns[columns.len() - term.values().len()..];
                assert_eq!(own.len(), found.columns.len());
                for (a, b) in found.columns.iter().zip(own) {
                    assert!(close(a, b, 1e-7), "{kind:?}, {filter:?}");
                }
            }
        }
    }

    #[test]
    fn an_effect_of_the_load_cell_acts_on_a_term_too() {
        let datasets = datasets(ApplyTo::None);
        let rows = Rows::new(&datasets, 300);
        let late = EffectModel::new(Effect::SensorDelay, &[3e-3]).expect("in its range");
        let effects = Effects::new(&[late]).expect("one effect");
        let model = Augmented::new(*damper().force(), effects).expect("a model");
        assert!(Damper::new(&model, &rows).is_none());
    }
}
