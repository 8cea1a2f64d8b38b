//! The modulators and arguments of terms as series over the rows.
//!
//! Where the conditioning filters the output of the model, what a term adds is filtered too. The screen filters modulator and argument instead of
//! their product, which is close enough to rank pairs: q behind the filter is late by as much as the force.

use crate::condition::{ApplyTo, Conditioning, LowPassState};
use crate::diagnose::rows::{Rows, RunRows};
use crate::effect::term::{Argument, Form, Modulator, Resonator, Signals, Term, warped};
use crate::effect::{Augmented, AugmentedState};
use crate::force::Inputs;
use crate::statistics::range;

/// Change of an input from which the model's derivative by it is computed, as a share of the input's range.
const SHARE_OF_RANGE: f64 = 1e-3;

/// Number of modulators and arguments.
const SIGNALS: usize = Modulator::ALL.len() + Argument::ALL.len();

/// Arguments of which resonances are searched.
pub(super) const RESONANT: [Argument; 2] = [Argument::Displacement, Argument::Force];

/// Series over rows; `None` for one that is not known on all of them.
pub(super) struct Series {
    modulators: Vec<Option<Vec<f64>>>,
    arguments: Vec<Option<Vec<f64>>>,
    /// For each run all samples, because a filter needs them.
    samples: Vec<Vec<Sample>>,
}

/// One sample of a run, selected or not.
struct Sample {
    step_s: f64,
    /// The values of [`RESONANT`].
    values: [f64; RESONANT.len()],
    is_row: bool,
}

impl Series {
    /// The series of `model` on `rows`.
    pub(super) fn new(model: &Augmented, rows: &Rows, predicted_n: &[f64]) -> Self {
        let mut series: Vec<Vec<f64>> = vec![Vec::new(); SIGNALS];
        let samples = rows.runs().iter().map(|run| of_run(model, run, &mut series)).collect();
        let known = |series: Vec<f64>| {
            (series.len() == rows.len() && series.iter().all(|value| value.is_finite())).then_some(series)
        };
        let mut series = series.into_iter();
        let modulators = Modulator::ALL.map(|modulator| {
            let own = series.next()?;
            known(if modulator.acts_on_input() {
                by_input(model, rows, predicted_n, modulator)?
            } else {
                own
            })
        });
        Self { modulators: modulators.to_vec(), arguments: series.map(known).collect(), samples }
    }

    /// One of [`RESONANT`] behind a resonance, each run's mean removed; `None` if it is not finite.
    pub(super) fn resonance(
        &self,
        rows: &Rows,
        argument: Argument,
        [frequency_hz, damping]: [f64; 2],
    ) -> Option<Vec<f64>> {
        let which = RESONANT.iter().position(|other| *other == argument)?;
        let mut found = Vec::with_capacity(rows.len());
        for run in &self.samples {
            let mut filter = Resonator::default();
            let (mut step_s, mut t) = (0.0, 0.0);
            for sample in run {
                if sample.step_s != step_s {
                    // The rate is usually constant.
                    (step_s, t) = (sample.step_s, warped(frequency_hz, sample.step_s));
                }
                let value = filter.step(t, damping, sample.values[which]);
                if sample.is_row {
                    found.push(value);
                }
            }
        }
        rows.centre(&mut found);
        found.iter().all(|value| value.is_finite()).then_some(found)
    }

    /// The series of a modulator.
    pub(super) fn modulator(&self, modulator: Modulator) -> Option<&[f64]> {
        let index = Modulator::ALL.iter().position(|other| *other == modulator)?;
        self.modulators[index].as_deref()
    }

    /// The series of an argument.
    pub(super) fn argument(&self, argument: Argument) -> Option<&[f64]> {
        let index = Argument::ALL.iter().position(|other| *other == argument)?;
        self.arguments[index].as_deref()
    }
}

/// Appends the signals of `model` at the selected rows of `run`: the modulators, then the arguments. Returns all samples of [`RESONANT`].
fn of_run(model: &Augmented, run: &RunRows, found: &mut [Vec<f64>]) -> Vec<Sample> {
    let effects = model.effects().of_damper();
    let (mut signals, mut state) = (Signals::default(), AugmentedState::default());
    let mut filters = Filters::new(&run.dataset.conditioning, SIGNALS);
    let mut wanted = run.indices.iter().peekable();
    let at = RESONANT.map(|own| Argument::ALL.iter().position(|other| *other == own));
    let mut samples = Vec::with_capacity(run.dataset.rows.len());
    for (index, row) in run.dataset.rows.iter().enumerate() {
        let inputs = row.inputs();
        if row.dt_s.is_none() {
            let past = run.dataset.past(row);
            state = effects.begin(past);
            signals = past.map_or_else(Signals::default, Signals::after);
        }
        signals.before_force(&inputs);
        if let Some(force_n) = effects.free_run(model.force(), &mut state, &inputs).filter(|f| f.is_finite())
        {
            signals.after_force(&inputs, force_n - model.force().force_offset_n());
        }
        let modulators = Modulator::ALL.iter().map(|modulator| modulator.value(&signals, &inputs));
        let arguments = Argument::ALL.iter().map(|argument| argument.value(&signals, &inputs));
        let values = filters.step(row.dt_s, modulators.chain(arguments));
        let is_row = wanted.next_if(|next| **next == index).is_some();
        if is_row {
            found.iter_mut().zip(values).for_each(|(series, value)| series.push(*value));
        }
        let resonant = at.map(|at| at.map_or(f64::NAN, |at| values[Modulator::ALL.len() + at]));
        samples.push(Sample { step_s: signals.step_s(), values: resonant, is_row });
    }
    samples
}

/// The filter of the model's output for several signals, or no filter if the conditioning filters the inputs.
pub(super) struct Filters {
    conditioning: Option<Conditioning>,
    states: Vec<Option<LowPassState>>,
    values: Vec<f64>,
}

impl Filters {
    pub(super) fn new(conditioning: &Conditioning, signals: usize) -> Self {
        Self {
            conditioning: (conditioning.apply_to == ApplyTo::Output).then_some(*conditioning),
            states: vec![None; signals],
            values: vec![0.0; signals],
        }
    }

    /// The signals behind the filter. A signal that is not finite restarts its filter.
    pub(super) fn step(&mut self, dt_s: Option<f64>, signals: impl Iterator<Item = f64>) -> &[f64] {
        let Self { conditioning, states, values } = self;
        let low_pass = conditioning.as_ref().map(Conditioning::low_pass);
        for ((signal, state), value) in signals.zip(states).zip(values) {
            *value = match &low_pass {
                Some(low_pass) if signal.is_finite() => {
                    let dt_s = dt_s.filter(|_| state.is_some());
                    low_pass.step(state.get_or_insert_default(), dt_s, signal)
                }
                _ => {
                    *state = None;
                    signal
                }
            };
        }
        &self.values
    }
}

/// Derivative of the simulated force by a change of an input.
fn by_input(model: &Augmented, rows: &Rows, predicted_n: &[f64], modulator: Modulator) -> Option<Vec<f64>> {
    let input = |inputs: Inputs| match modulator {
        Modulator::ForcePerDrive => inputs.drive,
        _ => inputs.velocity_m_s,
    };
    let all =
        rows.runs().iter().flat_map(|run| run.indices.iter().map(|k| input(run.dataset.rows[*k].inputs())));
    let [low, high] = range(all);
    let step = SHARE_OF_RANGE * (high - low);
    let (kind, everywhere) = ((modulator, Argument::Time, Form::Constant), [0.0, f64::MAX]);
    let term = (step > 0.0).then(|| Term::new(kind, step, &[], everywhere).ok()).flatten()?;
    rows.difference(&super::with_term(model, term).ok()?, predicted_n, step)
}
