//! Sentences about a diagnosis, shared by terminal and report.

use crate::page::capital;
use mr_damper_model::diagnose::{
    Alignment, Change, DiagnosisMode, DiagnosisResult, FoundParameter, NamedEffect, NoiseFloor, Refusal,
    RefusedEffect, Searched, SinceHealthy, Stage, StructureRow, TestResult, Verdict,
};
use mr_damper_model::effect::term::{ID, Term};
use mr_damper_model::effect::{Effect, EffectModel, Parameter};
use mr_damper_model::sample::DriveKind;

/// Text of a stage, for progress messages.
#[must_use]
pub fn stage_in_words(stage: Stage) -> String {
    match stage {
        Stage::Structure(name) => format!("{name}: identifying this structure"),
        Stage::Search(round) => format!("effect {round}: searching with each structure"),
        Stage::Base => "refitting the base".to_owned(),
        Stage::Scores(round) => format!("effect {round}: scores of the library"),
        Stage::Refits(round) => format!("effect {round}: refitting the best candidates"),
        Stage::Pruning => "removing effects that are not needed".to_owned(),
        Stage::Alternative => "checking whether an alternative structure of the base would do".to_owned(),
        Stage::Terms(round) => format!("term {round}: searching for what the library does not have"),
        Stage::Completion => "fitting the model found to all runs".to_owned(),
        Stage::TestRuns => "reading the test runs".to_owned(),
    }
}

/// `value` with three significant digits; in scientific notation below 1e-3 and from 1e6.
#[must_use]
pub fn figure(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        return "0".to_owned();
    }
    if !(1e-3..1e6).contains(&size) {
        return format!("{value:.2e}");
    }
    let decimals = (2.0 - size.log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{value:.decimals$}")
}

/// Like [`figure`] but without trailing zeros: for numbers that were set rather than measured.
#[must_use]
pub fn round(value: f64) -> String {
    let text = figure(value);
    let (mantissa, exponent) = text.split_once('e').map_or((text.as_str(), None), |(m, e)| (m, Some(e)));
    let short =
        if mantissa.contains('.') { mantissa.trim_end_matches('0').trim_end_matches('.') } else { mantissa };
    exponent.map_or_else(|| short.to_owned(), |exponent| format!("{short}e{exponent}"))
}

/// A share in percent.
#[must_use]
pub fn percent(share: f64) -> String {
    let per_cent = 100.0 * share;
    let decimals = usize::from(per_cent.abs() < 9.95);
    // Adding zero turns -0 into 0.
    format!("{:.decimals$} %", per_cent + 0.0)
}

/// An interval of shares in percent.
#[must_use]
pub fn percents([low, high]: [f64; 2]) -> String {
    format!("{} to {}", percent(low).trim_end_matches(" %"), percent(high))
}

/// The smallest p-value that is shown as a number.
const LEAST_P: f64 = 1e-12;

/// A p-value as text, without the letter p.
#[must_use]
pub fn p_value(p: f64) -> String {
    if p < LEAST_P { format!("< {LEAST_P:e}") } else { figure(p) }
}

/// A p-value as text, such as `p = 0.0300`.
#[must_use]
pub fn chance(p: f64) -> String {
    format!("p {}{}", if p < LEAST_P { "" } else { "= " }, p_value(p))
}

/// A force in newtons.
#[must_use]
pub fn force(newtons: f64) -> String {
    format!("{newtons:.2} N")
}

/// Heading of the list of structures.
pub(crate) const STRUCTURES: &str = "Structures of the base, by RMSE on the validation runs";

/// Heading of the effects that were searched, and neither named nor refused.
pub(crate) const NOT_NAMED: &str =
    "Searched and not named: the score may be chance, or another effect promised more";

/// Heading of the effects that the settings exclude.
pub(crate) const EXCLUDED: &str = "Not searched: excluded by the settings";

/// Name of a structure that was tried as base.
pub(crate) fn structure_name(row: &StructureRow) -> String {
    if row.given { format!("{} (given)", row.structure) } else { row.structure.to_owned() }
}

/// That the base which was given fits worse than the one that was chosen; `None` if it was chosen, or if there was no choice.
pub(crate) fn other_base(result: &DiagnosisResult) -> Option<String> {
    let (chosen, _) = result.chosen().filter(|(row, _)| !row.given)?;
    let given = result.structures.iter().find(|row| row.given)?;
    let of = if result.is_augmented() { "of this result and of its model file" } else { "of this result" };
    Some(format!(
        "The base given has not the damper's structure: on the validation runs {} fits worse than {}, also with the effects found. {} is \
         the base {of}.",
        given.structure, chosen.structure, chosen.structure
    ))
}

/// How a structure of the base fits.
pub(crate) fn structure(row: &StructureRow) -> String {
    let fit = match &row.outcome {
        Ok(fit) => fit,
        Err(error) => return format!("not usable: {error}"),
    };
    let effects = match fit.effects.as_slice() {
        [] => "no effect found".to_owned(),
        effects => format!("with {} {}", effects.join(", "), force(fit.rsse_n)),
    };
    let place = match (fit.chosen, fit.fits_as_well) {
        (true, _) => "; chosen",
        (false, true) => "; fits about as well as the best",
        (false, false) => "",
    };
    format!("alone {}; {effects}{place}", force(fit.alone_rsse_n))
}

/// Readable name and unit of the parameter that model files call `name`; for a parameter that no effect has (from a newer node), the
/// name alone.
#[must_use]
pub fn quantity(name: &str, drive: Option<DriveKind>) -> (String, &'static str) {
    let Some(parameter) = Parameter::named(name) else { return (name.replace('_', " "), "") };
    (parameter.label(), parameter.unit.symbol().unwrap_or_else(|| drive_unit(drive)))
}

/// The unit of a drive; A if the drive is not known.
pub(crate) const fn drive_unit(drive: Option<DriveKind>) -> &'static str {
    match drive {
        Some(drive) => drive.unit(),
        None => "A",
    }
}

/// A parameter with its 95 % interval and its physical range.
#[must_use]
pub fn parameter(found: &FoundParameter, drive: Option<DriveKind>) -> String {
    let (name, unit) = quantity(found.name, drive);
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let [low, high] = found.ci95.map(figure);
    let [from, to] = found.range.map(round);
    format!(
        "{name} = {}{unit}, 95 %: {low} to {high}{unit}; physical range {from} to {to}{unit}",
        figure(found.value)
    )
}

/// Whether an effect is new since the healthy runs; `None` without them.
#[must_use]
pub fn since_healthy(named: &NamedEffect, drive: Option<DriveKind>) -> Option<String> {
    let SinceHealthy { amount, change } = named.since_healthy?;
    let (name, unit) = quantity(amount.name, drive);
    let [value, low, high] = [amount.value, amount.ci95[0], amount.ci95[1]].map(figure);
    let there = format!("{name} = {value} {unit}").trim_end().to_owned();
    let there = format!("on the healthy runs {there}, 95 %: {low} to {high} {unit}").trim_end().to_owned();
    Some(match change {
        Change::New => format!("new: the healthy damper does not have it; {there}"),
        Change::Amount => format!("changed: the healthy damper has it with another amount; {there}"),
        Change::None => format!("not new: the healthy damper has it too; {there}"),
        Change::Unknown => "new or not: the healthy runs cannot show it".to_owned(),
    })
}

/// The names joined with commas and a final "and".
#[must_use]
pub fn list(names: &[String]) -> String {
    match names {
        [] => String::new(),
        [one] => one.clone(),
        [most @ .., last] => format!("{} and {last}", most.join(", ")),
    }
}

/// Titles of the named effects and of the discovered terms.
#[must_use]
pub fn titles(result: &DiagnosisResult) -> Vec<String> {
    let effects = result.effects.iter().map(|named| title(&named.effect));
    effects.chain(result.discovery.terms.iter().map(|found| term_title(&found.term))).collect()
}

/// Modulator, argument and form of a term.
#[must_use]
pub fn term_title(term: &Term) -> String {
    let (modulator, argument, form) = term.kind();
    format!("{ID} ({}, {}, {})", modulator.name(), argument.name(), form.name())
}

/// Id and form of an effect.
#[must_use]
pub fn title(effect: &EffectModel) -> String {
    effect.effect().title()
}

/// The verdict, in a sentence or two.
#[must_use]
pub fn verdict(result: &DiagnosisResult) -> String {
    let left = &result.remaining;
    let titles = titles(result);
    let (lof, names) = (figure(left.lof_before), list(&titles));
    let (verb, gone) = (if titles.len() == 1 { "accounts" } else { "account" }, percent(1.0 - left.share));
    match result.verdict {
        Verdict::NothingToExplain => format!(
            "Nothing to explain: the residual of the base model is not larger than noise (lack of fit {lof})."
        ),
        Verdict::Explained => {
            format!(
                "Explained: {names} {verb} for {gone} of the reducible error (above the noise floor) of the validation runs."
            )
        }
        Verdict::PartlyExplained => format!(
            "Partly explained: {names} {verb} for {gone} of the reducible error (above the noise floor) of the validation runs; {} remains.",
            percent(left.share)
        ),
        Verdict::Unexplained if result.is_augmented() => format!(
            "Unexplained: the error of the base model is above the noise floor (lack of fit {lof}), and the test runs do not \
             prove that {names} would reduce it."
        ),
        Verdict::Unexplained => format!(
            "Unexplained: the error of the base model is above the noise floor (lack of fit {lof}), and no effect {} \
             accounts for it on every run.",
            if excluded(result).is_empty() { "of the library" } else { "that was searched" }
        ),
        Verdict::BaseInadequate => {
            let fault = result.base_fault.as_ref().map(ToString::to_string);
            let why = fault.as_deref().unwrap_or("its error is too large");
            format!("Base inadequate (lack of fit {lof}): {why}. Naming an effect would be meaningless.")
        }
    }
}

/// The name of a run, without folders.
#[must_use]
pub fn file_name(run: &str) -> String {
    std::path::Path::new(run).file_name().map_or(run.to_owned(), |name| name.to_string_lossy().into_owned())
}

/// The refused effects, without those that were named in a later round.
#[must_use]
pub fn refused(result: &DiagnosisResult) -> Vec<&RefusedEffect> {
    let named = |refused: &&RefusedEffect| result.effects.iter().any(|n| n.effect.effect() == refused.effect);
    result.refused.iter().filter(|refused| !named(refused)).collect()
}

/// Titles of the effects that the settings exclude.
#[must_use]
pub fn excluded(result: &DiagnosisResult) -> Vec<String> {
    let excluded = result.untestable.iter().filter(|refused| refused.why == Refusal::Excluded);
    excluded.map(|refused| refused.effect.title()).collect()
}

/// The effects that the runs cannot test.
#[must_use]
pub fn untestable(result: &DiagnosisResult) -> Vec<&RefusedEffect> {
    result.untestable.iter().filter(|refused| refused.why != Refusal::Excluded).collect()
}

/// Titles of the effects that were searched, and neither named nor refused.
#[must_use]
pub fn not_named(result: &DiagnosisResult) -> Vec<String> {
    let named = result.effects.iter().map(|named| named.effect.effect());
    let refused = result.refused.iter().chain(&result.untestable).map(|refused| refused.effect);
    let known: Vec<String> = named.chain(refused).map(Effect::title).collect();
    let mut found: Vec<String> = Vec::new();
    for title in result.candidates.iter().map(|candidate| candidate.effect.title()) {
        if !known.contains(&title) && !found.contains(&title) {
            found.push(title);
        }
    }
    found
}

/// Explains paired mode; `None` in absolute mode.
#[must_use]
pub fn paired(mode: DiagnosisMode) -> Option<&'static str> {
    (mode == DiagnosisMode::Paired).then_some(
        "Paired mode: the residual is the difference to the healthy runs of the same excitation; the base model is not \
         refitted.",
    )
}

/// The change of the mean force since the reference runs, with its cause; `None` if no change is proved.
#[must_use]
pub fn mean_shift(result: &DiagnosisResult) -> Option<String> {
    let shift = result.mean_shift.filter(|shift| shift.is_proved())?;
    let [low, high] = shift.ci95_n.map(figure);
    let cause = match result.causes_of_mean_shift() {
        [_] => "the pressure of the gas changed",
        _ => "the pressure of the gas or the zero of the load cell changed; these runs cannot tell which",
    };
    Some(format!(
        "Since the reference runs the mean force has changed by {} (95 %: {low} to {high} N): {cause}. The model file keeps the force \
         offset of its base.",
        force(shift.force_n)
    ))
}

/// The fault of the augmented model on sines over the whole range of its runs, as a sentence. `None` without one, or if nothing was added.
pub fn swept_fault(result: &DiagnosisResult) -> Option<String> {
    let warning = result.swept.as_ref().filter(|_| result.is_augmented())?.warning()?;
    Some(format!("Beyond the runs, {warning}."))
}

/// The range over which the augmented model has no fault, as a sentence. `None` if it has one, or if nothing was added.
pub fn swept_range(result: &DiagnosisResult) -> Option<String> {
    let swept = result.swept.as_ref().filter(|swept| result.is_augmented() && swept.faults.is_empty())?;
    Some(format!("{}.", capital(&swept.to_string())))
}

/// How a run was placed on its reference.
pub(crate) fn alignment(of: &Alignment) -> String {
    let by = match of.period_s {
        Some(period_s) => format!("by crank angle (period {} s)", figure(period_s)),
        None => format!("by time ({:+.4} s)", of.lag_s),
    };
    format!(
        "{} on {} {by}; the zeros of displacement are {} mm apart, {} of the displacement differs",
        file_name(&of.run),
        file_name(&of.reference),
        figure(1e3 * of.offset_m),
        percent(of.difference)
    )
}

/// With fewer blocks than this, sign flips cannot give a p-value that survives the correction for about fifteen tests.
const FEW_BLOCKS: usize = 10;

/// The next step that the user can take after this verdict; `None` when none is needed.
#[must_use]
pub fn next_step(result: &DiagnosisResult) -> Option<&'static str> {
    let no_interval = result.test.as_ref().is_some_and(|test| test.ratio_ci95.is_err());
    match (result.verdict, result.mode) {
        (Verdict::Unexplained, _) if no_interval && result.is_augmented() => {
            Some("Give longer test runs with --test.")
        }
        (Verdict::Unexplained, _) if result.blocks < FEW_BLOCKS => Some(
            "The training runs are too short: with fewer than 10 blocks hardly any effect can be distinguished from chance. \
             Give longer runs with --estimate; 30 s of motion is a good start.",
        ),
        (Verdict::Unexplained, _) if result.refused.iter().any(at_end_of_range) => Some(
            "An effect was refused because its value would be outside of the physical range of an MR damper; it is listed below. \
             If this machine can have such a value, give its range with --range.",
        ),
        (Verdict::Unexplained | Verdict::PartlyExplained, _)
            if result.remaining.correlates_with.is_empty() =>
        {
            Some("To try an effect of your own, add a file: see model/src/effect/mod.rs.")
        }
        (Verdict::Unexplained | Verdict::PartlyExplained, _) => Some(
            "The remaining error and the signals that correlate with it are listed below. To try an effect of your own, \
             add a file: see model/src/effect/mod.rs.",
        ),
        (Verdict::BaseInadequate, DiagnosisMode::Absolute) => Some(
            "Use a base model that fits better (`mr-damper compare` ranks models), or give healthy runs of the same \
             excitation with --reference.",
        ),
        (Verdict::BaseInadequate, DiagnosisMode::Paired) => {
            Some("Use a base model that fits better: `mr-damper compare` ranks models.")
        }
        (Verdict::NothingToExplain | Verdict::Explained, _) => None,
    }
}

fn at_end_of_range(refused: &RefusedEffect) -> bool {
    matches!(refused.why, Refusal::AtEndOfRange { .. })
}

/// The result on the test runs, in a sentence. A test run (`--test`) is read once, at the end.
#[must_use]
pub fn proof(test: Option<&TestResult>) -> String {
    let Some(test) = test else {
        return "NOT PROVED: there were no test runs. Give runs that were used for nothing else with --test."
            .to_owned();
    };
    let runs = match test.runs.len() {
        1 => "the test run".to_owned(),
        count => format!("the {count} test runs"),
    };
    let interval = match test.ratio_ci95 {
        Ok(interval) => interval,
        Err(why) => {
            return format!(
                "NOT PROVED: on {runs}, read once, the squared error comes to {} of what it was, without a 95 % interval: {why}.",
                percent(test.ratio)
            );
        }
    };
    let [low, high] = interval;
    let share = format!("{} of what it was (95 %: {})", percent(test.ratio), percents(interval));
    let gone = test.removed.map_or(String::new(), |removed| {
        format!(" {} of the error above the noise floor is removed.", percent(removed))
    });
    if high < 1.0 {
        format!("On {runs}, read once, the squared error falls to {share}.{gone}")
    } else if low > 1.0 {
        format!("NOT PROVED: on {runs}, read once, the squared error grows to {share}.")
    } else {
        format!("NOT PROVED: on {runs}, read once, the squared error comes to {share}: this may be chance.")
    }
}

/// The noise floor and its source.
#[must_use]
pub fn noise_floor(floor: &NoiseFloor) -> String {
    use mr_damper_model::diagnose::FloorSource;
    let source = match floor.source {
        FloorSource::Unknown => {
            return "noise floor unknown: the runs do not show which part of the residual is noise, so no part of it counts as \
                    noise; give --replicates or --noise-floor"
                .to_owned();
        }
        FloorSource::Replicates => "from replicates",
        FloorSource::Declared => "as declared",
        FloorSource::Cycles => "from the scatter between cycles",
        FloorSource::Estimated => {
            "estimated from the sample-to-sample noise of the force: white noise only, so a lower bound; give \
             --replicates or --noise-floor for a reliable value"
        }
    };
    format!("noise floor {}, NMSE {}, {source}", force(floor.rsse_n), figure(floor.esr))
}

/// The part of the runs on which the search was made; `None` if it was all of them.
#[must_use]
pub fn searched(result: &DiagnosisResult) -> Option<String> {
    let Searched { used_s, of_s } = result.searched?;
    Some(format!(
        "The runs are long. Effects and terms were searched on stretches: {used_s:.0} s of the {of_s:.0} s of motion in the training runs. \
         Coefficients, intervals and errors are those of all runs, but for the errors of the structures of the base. To search on more, give \
         --search-samples."
    ))
}

/// The effects that the data cannot distinguish from the named one, and for each effect of the class (the named one
/// first) the excitation that would. `None` when the named effect is the only one.
#[must_use]
pub fn class(named: &NamedEffect) -> Option<(String, Vec<(String, &'static str)>)> {
    let own = named.effect.effect().id();
    let others: Vec<String> =
        named.class.iter().filter(|id| **id != own).map(|id| (*id).to_owned()).collect();
    if others.is_empty() {
        return None;
    }
    let settles = named
        .class
        .iter()
        .filter_map(|id| Effect::ALL.into_iter().find(|effect| effect.id() == *id))
        .map(|effect| (effect.id().to_owned(), effect.separated_by()))
        .collect();
    Some((others.join(", "), settles))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_have_a_readable_name_and_a_unit() {
        assert_eq!(quantity("asymmetry", None), ("asymmetry".to_owned(), ""));
        assert_eq!(quantity("cavity_m3", None), ("cavity m3".to_owned(), ""));
        assert_eq!(quantity("quadratic_n_s2_m2", None), ("quadratic".to_owned(), "N s²/m²"));
        assert_eq!(
            quantity("half_width_drive", Some(DriveKind::CommandVoltage)),
            ("half width".to_owned(), "V")
        );
        assert_eq!(quantity("tau_rise_s", None), ("tau rise".to_owned(), "s"));
        assert_eq!(quantity("rate_n_s", None), ("rate".to_owned(), "N/s"));
    }

    #[test]
    fn figures_have_three_digits() {
        let text = [0.0, 0.012, -1.5e-7, 31.0, 1234.5, 2e7, 0.00018].map(figure);
        assert_eq!(text, ["0", "0.0120", "-1.50e-7", "31.0", "1234", "2.00e7", "1.80e-4"]);
        assert_eq!([0.04, 1500.0, 2e7, 0.0].map(round), ["0.04", "1500", "2e7", "0"]);
        assert_eq!(percents([0.024, 0.33]), "2.4 to 33 %");
        assert_eq!(
            (percent(-0.0), chance(0.0), chance(0.03)),
            ("0.0 %".to_owned(), "p < 1e-12".to_owned(), "p = 0.0300".to_owned())
        );
    }
}
