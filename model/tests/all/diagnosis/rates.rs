//! Rates of correctly and wrongly named effects over the seeds of a case specification, with intervals.

use super::cases::CaseSpec;
use super::outcome::Outcome;
use mr_damper_model::effect::Effect;
use std::collections::BTreeMap;

/// Id in the library for an effect of the rig; `None` if the library does not have it.
pub(crate) fn library_id(rig_id: &str) -> Option<&'static str> {
    // In the library a spring in series is a form of the force lag.
    let id = if rig_id == "series_spring" { "force_lag" } else { rig_id };
    Effect::ALL.into_iter().map(Effect::id).find(|known| *known == id)
}

/// Number of hits and number of trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Rate {
    pub(crate) hits: u32,
    pub(crate) of: u32,
}

impl Rate {
    /// Counts one case.
    pub(crate) fn count(&mut self, hit: bool) {
        self.hits += u32::from(hit);
        self.of += 1;
    }

    /// Adds the counts of `other`.
    pub(crate) fn merge(&mut self, other: Self) {
        self.hits += other.hits;
        self.of += other.of;
    }

    /// Wilson's 95 % interval; 0 to 1 if nothing was counted.
    pub(crate) fn interval(self) -> [f64; 2] {
        const Z: f64 = 1.959_963_985;
        if self.of == 0 {
            return [0.0, 1.0];
        }
        let n = f64::from(self.of);
        let p = f64::from(self.hits) / n;
        let widened = 1.0 + Z * Z / n;
        let centre = (p + Z * Z / (2.0 * n)) / widened;
        let half = Z / widened * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
        [(centre - half).max(0.0), (centre + half).min(1.0)]
    }

    /// The rate as text, for example `19/20 [0.764 0.991]`.
    pub(crate) fn text(self) -> String {
        let [low, high] = self.interval();
        let short = |p: f64| format!("{p:.3}");
        format!("{}/{} [{} {}]", self.hits, self.of, short(low), short(high))
    }
}

fn is_within(ids: &[String], id: &str) -> bool {
    ids.iter().any(|named| named == id)
}

/// True if each effect of `spec` was named, by its id or in a class with it.
pub(crate) fn is_right(spec: &CaseSpec, outcome: &Outcome) -> bool {
    let is_named = |id: &str| outcome.named.iter().any(|named| is_within(&named.ids, id));
    spec.truth.iter().all(|(id, _)| library_id(id).is_some_and(is_named))
}

/// The effects that were named but are not present, by form or id.
pub(crate) fn wrong_names(spec: &CaseSpec, outcome: &Outcome) -> Vec<String> {
    let own = spec.kind.own_effect().and_then(library_id);
    let there: Vec<&str> = spec.truth.iter().filter_map(|(id, _)| library_id(id)).chain(own).collect();
    let wrong = outcome.named.iter().filter(|named| !there.iter().any(|id| is_within(&named.ids, id)));
    wrong.map(|named| named.form.unwrap_or(&named.ids[0]).to_owned()).collect()
}

/// Results of a case specification over its seeds.
#[derive(Debug, Clone, Default)]
pub(crate) struct Row {
    /// Cases in which all effects were named, each by its id or in a class with it.
    pub(crate) right: Rate,
    /// Cases in which an effect was named that is not present.
    pub(crate) wrong: Rate,
    changes: Vec<f64>,
    before: Vec<f64>,
    after: Vec<f64>,
    removed: Vec<f64>,
    undone: Vec<f64>,
    /// Relative errors of the parameters of effects that were named by their own id.
    errors: Vec<f64>,
    verdicts: BTreeMap<&'static str, u32>,
    /// Effects that were named but are not present, by id and form.
    wrong_names: BTreeMap<String, u32>,
    /// Changes since the healthy runs: of the injected effects, and of those that the healthy damper has.
    since_healthy: [BTreeMap<&'static str, u32>; 2],
}

impl Row {
    /// Counts one outcome of `spec`, whose effects change the force by the share `change`. If the outcome for the healthy damper is known
    /// (`healthy`), also counts the share of the error brought by the effects that was removed.
    pub(crate) fn take(
        &mut self,
        spec: &CaseSpec,
        outcome: &Outcome,
        healthy: Option<&Outcome>,
        change: f64,
    ) {
        self.right.count(is_right(spec, outcome));
        let wrong = wrong_names(spec, outcome);
        self.wrong.count(!wrong.is_empty());
        wrong.into_iter().for_each(|name| *self.wrong_names.entry(name).or_default() += 1);
        for (id, size) in &spec.truth {
            // The spring has its own form, with a different parameter from the lag's.
            let form = (*id == "series_spring").then_some("series_spring");
            let own = outcome.named.iter().find(|named| {
                named.ids.first().map(String::as_str) == library_id(id)
                    && (library_id(id) != Some("force_lag")
                        || (named.form == Some("series_spring")) == form.is_some())
            });
            self.errors.extend(own.map(|named| (named.value / size - 1.0).abs()));
        }
        self.changes.push(change);
        self.before.push(outcome.before);
        self.after.extend(outcome.after);
        self.removed.extend(outcome.removed);
        let undone = healthy.filter(|_| outcome.after.is_some()).map(|healthy| {
            let [[own, _], [before, after]] = [healthy.over_noise_n2, outcome.over_noise_n2];
            (before - after) / (before - own)
        });
        self.undone.extend(undone);
        *self.verdicts.entry(outcome.verdict.name()).or_default() += 1;
        let own = spec.kind.own_effect().and_then(library_id);
        for named in &outcome.named {
            let is = |id: &str| is_within(&named.ids, id);
            let is_injected = spec.truth.iter().any(|(id, _)| library_id(id).is_some_and(is));
            let kind = [is_injected, own.is_some_and(is)].into_iter().position(|of_kind| of_kind);
            if let (Some(kind), Some(change)) = (kind, named.change) {
                *self.since_healthy[kind].entry(change.name()).or_default() += 1;
            }
        }
    }

    /// Median relative error of the parameters.
    pub(crate) fn error(&self) -> f64 {
        median(&self.errors)
    }

    /// The row of the table below [`head`].
    pub(crate) fn text(&self, spec: &CaseSpec) -> String {
        let sizes: Vec<String> = spec.truth.iter().map(|(_, size)| format!("{size}")).collect();
        let verdicts: Vec<String> = self.verdicts.iter().map(|(name, n)| format!("{name} {n}")).collect();
        let wrong: Vec<String> = self.wrong_names.iter().map(|(name, n)| format!("{name} {n}")).collect();
        let since: Vec<String> = ["injected", "own"]
            .iter()
            .zip(&self.since_healthy)
            .flat_map(|(what, changes)| {
                changes.iter().map(move |(change, n)| format!("; {what}: change {change} {n}"))
            })
            .collect();
        format!(
            "{:<40} {:>14} {:>7.2} {:>9.2e} {:>9.2e} {:>7.1} {:>8.1} {:>7.1} {:>20} {:>20}  {}{}{}{}",
            spec.name(),
            sizes.join(", "),
            100.0 * median(&self.changes),
            median(&self.before),
            median(&self.after),
            100.0 * median(&self.removed),
            100.0 * median(&self.undone),
            100.0 * self.error(),
            self.right.text(),
            self.wrong.text(),
            verdicts.join(", "),
            if wrong.is_empty() { "" } else { "; wrong: " },
            wrong.join(", "),
            since.concat(),
        )
    }
}

/// Head of the table.
///
/// The columns are medians over the seeds. `before` and `after` are the NMSE (thesis: ESR) on the test run. `gone` is the share removed
/// there of the error above the noise; `undone` is the share removed of the error above the base's misfit of the healthy damper. `off` is
/// the relative error of the parameter. Rates are given with Wilson's 95 % interval.
pub(crate) fn head() -> String {
    format!(
        "{:<40} {:>14} {:>7} {:>9} {:>9} {:>7} {:>8} {:>7} {:>20} {:>20}  {}",
        "case",
        "size",
        "dF/F %",
        "before",
        "after",
        "gone %",
        "undone %",
        "off %",
        "right",
        "wrong",
        "verdicts"
    )
}

/// Median; NaN without values.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => f64::NAN,
        n => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
    }
}
