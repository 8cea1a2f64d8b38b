//! Drift of the load cell.
//!
//! ```text
//! F' = F + b t
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | b | `rate_n_s` | N/s | drift |
//! | t | state | s | time since the run began |
//!
//! Time starts at the first sample, and again after a gap, because the length of a gap is not known here.

use super::term::Past;
use super::{Definition, EffectState, Inside, Inversion, Layer, Parameter, Properties, Unit, Values};
use crate::force::law::Scale;
use crate::force::{Inputs, Number};

/// Fastest drift, 1/s: two per cent of the largest force a minute.
const MOST_1_S: f64 = 0.02 / 60.0;

pub(super) struct LoadCellDrift;

impl Definition for LoadCellDrift {
    const PROPERTIES: Properties = Properties {
        id: "load_cell_drift",
        form: None,
        what: "the load cell's zero drifts in proportion to time",
        parameters: &[Parameter::relative(
            "rate_n_s",
            Unit::new("_n_s", "N/s"),
            Scale::new(1, 0, 0, 0),
            [-MOST_1_S, MOST_1_S],
            0.02 * MOST_1_S,
        )],
        example: &[0.2],
        separated_by: "a long run, or rest before and after it",
        confounders: &["thermal_fade"],
        needs: &[],
        follows_time: true,
        layer: Layer::Measurement(2),
        inversion: Inversion::Subtract,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [rate_n_s, ..]: Values<R>,
        state: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        // Before the first sample it is the time that lies before.
        let first = state.elapsed.is_first();
        // Time also advances at samples without a force.
        state.held[0] = match state.elapsed.hit(inputs.dt_s) {
            Some(since_s) => state.held[0] + since_s,
            None if first => state.held[0],
            None => R::from(0.0),
        };
        let time_s = state.held[0];
        Some(inside.run(inputs)? + rate_n_s * time_s)
    }

    fn resume<R: Number>(state: &mut EffectState<R>, past: &Past) {
        state.held[0] = R::from(past.time_s);
    }
}
