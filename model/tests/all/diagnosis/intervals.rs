//! How often the 95 % intervals of a diagnosis contain the true parameter.
//!
//! A run is generated with one effect of the rig at full size, with the defaults of `mr-damper close` (base fuzzy-tanh, low-pass on the
//! output, three-point velocity, 25 restarts). The diagnosis may name only the effect that is there, so a count does not depend on how
//! often it is named against others.

use super::cases::{Kind, sizes, spec};
use super::outcome::CONDITIONING;
use super::rates::{Rate, library_id};
use mr_damper_model::Error;
use mr_damper_model::diagnose::{EffectSet, Runs, Settings, close};
use mr_damper_model::identify::{Dataset, DatasetOptions, ModelSpec, Options, Watch, identify_datasets};
use rayon::prelude::*;

/// Largest number of rows for the search of the base, as in `mr-damper close`.
const MOST_ROWS: usize = 30_000;

/// One interval with the true value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Interval {
    pub(crate) truth: f64,
    /// The parameter in the model.
    pub(crate) value: f64,
    pub(crate) ci95: [f64; 2],
}

impl Interval {
    /// Half the width.
    pub(crate) fn half(&self) -> f64 {
        0.5 * (self.ci95[1] - self.ci95[0])
    }

    /// True if the truth is inside.
    pub(crate) fn contains(&self) -> bool {
        (self.ci95[0]..=self.ci95[1]).contains(&self.truth)
    }

    /// Distance of the interval's middle from the truth, in half widths.
    fn bias(&self) -> f64 {
        (0.5 * (self.ci95[0] + self.ci95[1]) - self.truth) / self.half()
    }
}

/// The interval for the effect `id` of the rig with the seed `seed`; `None` if the diagnosis does not name it.
///
/// # Errors
/// As identification and diagnosis.
pub(crate) fn interval(id: &str, seed: u64) -> Result<Option<Interval>, Error> {
    let case = spec(&format!("{} {id} x1", Kind::Single.name())).case(seed)?;
    let rows = |runs: &[mr_damper_model::sample::Run]| -> Result<Vec<Dataset>, Error> {
        runs.iter().map(|run| Dataset::from_run(run, &CONDITIONING, &DatasetOptions::default())).collect()
    };
    let (estimate, confirm) = (rows(&case.estimate)?, rows(&case.confirm)?);
    let options = Options {
        conditioning: CONDITIONING,
        choose_velocity: false,
        most_rows: Some(MOST_ROWS),
        ..Options::default()
    };
    let base = identify_datasets(ModelSpec::FUZZY_TANH, &estimate, &options, &Watch::none())?.model;
    let known = library_id(id).unwrap_or_else(|| panic!("{id} is in the library of effects"));
    let settings = Settings { effects: EffectSet::only(&[known])?, ..Settings::default() };
    let runs = Runs { estimate: &estimate, confirm: &confirm, ..Runs::default() };
    let found = close(&base, &runs, &settings, &Watch::none(), &|_| {})?;
    // In the library a spring in series is a form of the force lag, and the coil lag has a form with two time constants.
    let form = match id {
        "series_spring" => Some("series_spring"),
        "force_lag" => Some("first_order"),
        "coil_lag" => Some("one_tau"),
        _ => None,
    };
    let own = found
        .effects
        .iter()
        .find(|named| named.effect.effect().id() == known && named.effect.effect().form() == form);
    let size = case.truth[0].1;
    // The rig's fade counts from 23 °C, the library's from 25 °C.
    let truth = if id == "thermal_fade" { size / (1.0 + 2.0 * size) } else { size };
    Ok(own.map(|named| Interval {
        truth,
        value: named.effect.parameters()[0],
        ci95: named.parameters[0].ci95,
    }))
}

/// The intervals of one effect over several seeds.
#[derive(Debug, Clone, Default)]
pub(crate) struct Coverage {
    pub(crate) inside: Rate,
    pub(crate) found: Vec<Interval>,
    pub(crate) cases: usize,
}

impl Coverage {
    /// The intervals of `id` for these seeds.
    ///
    /// # Errors
    /// As [`interval`].
    pub(crate) fn of(id: &str, seeds: std::ops::Range<u64>) -> Result<Self, Error> {
        let all = seeds.into_par_iter().map(|seed| interval(id, seed)).collect::<Result<Vec<_>, _>>()?;
        let cases = all.len();
        let found: Vec<Interval> = all.into_iter().flatten().collect();
        let hits = found.iter().filter(|interval| interval.contains()).count();
        let inside = Rate { hits: hits as u32, of: found.len() as u32 };
        Ok(Self { inside, found, cases })
    }

    fn mean(&self, value: impl Fn(&Interval) -> f64) -> f64 {
        self.found.iter().map(value).sum::<f64>() / self.found.len() as f64
    }

    /// The row of the table below [`head`].
    pub(crate) fn text(&self, id: &str) -> String {
        let bias = self.mean(Interval::bias);
        let spread = (self.mean(|i| (i.bias() - bias).powi(2))).sqrt();
        format!(
            "{id:<20} {:>3} of {:<3} {:>20} {bias:>8.2} {spread:>8.2} {:>11.3e} {:>11.3e} {:>11.3e}",
            self.found.len(),
            self.cases,
            self.inside.text(),
            self.mean(Interval::half),
            self.mean(|i| i.value),
            self.mean(|i| i.truth),
        )
    }
}

/// Ids of all effects that are measured.
pub(crate) fn ids() -> Vec<&'static str> {
    sizes().into_iter().map(|(id, _)| id).collect()
}

/// Head of the table: how often the effect was named, truth inside the interval with Wilson's 95 % interval, mean and standard deviation
/// of the error in half widths, half width, and value in the model.
pub(crate) fn head() -> String {
    format!(
        "{:<20} {:>10} {:>20} {:>8} {:>8} {:>11} {:>11} {:>11}",
        "effect", "named", "inside", "bias", "spread", "half", "value", "truth"
    )
}
