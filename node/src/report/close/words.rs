//! A closing in words: the same sentences for terminal and report.

use mr_damper_model::diagnose::{Closing, Found, Mode, Named, NoiseFloor, Refused, Sealed, Verdict};
use mr_damper_model::effect::{Effect, EffectModel};
use mr_damper_model::sample::DriveKind;
use mr_damper_model::units::N_PER_LBF;

/// Three significant digits; plain where that is short, else with an exponent.
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

/// The same without zeros at the end: for numbers that were set and not measured.
#[must_use]
pub fn round(value: f64) -> String {
    let text = figure(value);
    let (mantissa, exponent) = text.split_once('e').map_or((text.as_str(), None), |(m, e)| (m, Some(e)));
    let short =
        if mantissa.contains('.') { mantissa.trim_end_matches('0').trim_end_matches('.') } else { mantissa };
    exponent.map_or_else(|| short.to_owned(), |exponent| format!("{short}e{exponent}"))
}

/// A share in per cent.
#[must_use]
pub fn percent(share: f64) -> String {
    let per_cent = 100.0 * share;
    let decimals = usize::from(per_cent.abs() < 9.95);
    // Adding zero turns -0 into 0.
    format!("{:.decimals$} %", per_cent + 0.0)
}

/// An interval of shares in per cent.
#[must_use]
pub fn percents([low, high]: [f64; 2]) -> String {
    format!("{} to {}", percent(low).trim_end_matches(" %"), percent(high))
}

/// The least p-value that means anything here.
const LEAST_P: f64 = 1e-12;

/// A p-value.
#[must_use]
pub fn p_value(p: f64) -> String {
    if p < LEAST_P { format!("< {LEAST_P:e}") } else { figure(p) }
}

/// A p-value, with its letter.
#[must_use]
pub fn chance(p: f64) -> String {
    format!("p {}{}", if p < LEAST_P { "" } else { "= " }, p_value(p))
}

/// A force in newtons and in pounds.
#[must_use]
pub fn force(newtons: f64) -> String {
    format!("{newtons:.2} N ({:.2} lbf)", newtons / N_PER_LBF)
}

/// Name and unit of a parameter that is called `name` in model files.
#[must_use]
pub fn quantity(name: &str, drive: Option<DriveKind>) -> (String, &'static str) {
    // Longest first: the unit is all that the end of a name says.
    const UNITS: [(&str, &str); 10] = [
        ("_n_s2_m2", "N s²/m²"),
        ("_per_k", "1/K"),
        ("_per_m", "1/m"),
        ("_n_m", "N/m"),
        ("_m_n", "m/N"),
        ("_n_s", "N/s"),
        ("_kg", "kg"),
        ("_n", "N"),
        ("_m", "m"),
        ("_s", "s"),
    ];
    let of_drive = match drive {
        Some(DriveKind::CommandVoltage) => "V",
        _ => "A",
    };
    let units = std::iter::once(("_drive", of_drive)).chain(UNITS);
    let found =
        units.into_iter().find_map(|(suffix, unit)| name.strip_suffix(suffix).map(|stem| (stem, unit)));
    let (stem, unit) = found.unwrap_or((name, ""));
    (stem.replace('_', " "), unit)
}

/// A parameter with its interval, and the range that physics leaves it.
#[must_use]
pub fn parameter(found: &Found, drive: Option<DriveKind>) -> String {
    let (name, unit) = quantity(found.name, drive);
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let [low, high] = found.ci95.map(figure);
    let [from, to] = found.range.map(round);
    format!(
        "{name} = {}{unit}, 95 %: {low} to {high}{unit}; physical range {from} to {to}{unit}",
        figure(found.value)
    )
}

/// Titles, with commas and a last "and".
#[must_use]
pub fn list(names: &[String]) -> String {
    match names {
        [] => String::new(),
        [one] => one.clone(),
        [most @ .., last] => format!("{} and {last}", most.join(", ")),
    }
}

/// Titles of the effects that were named.
#[must_use]
pub fn titles(closing: &Closing) -> Vec<String> {
    closing.effects.iter().map(|named| title(&named.effect)).collect()
}

/// Id and form of an effect.
#[must_use]
pub fn title(effect: &EffectModel) -> String {
    effect.effect().title()
}

/// The verdict, in a sentence or two.
#[must_use]
pub fn verdict(closing: &Closing) -> String {
    let left = &closing.left_over;
    let (lof, names) = (figure(left.lof_before), list(&titles(closing)));
    let (verb, gone) =
        (if closing.effects.len() == 1 { "accounts" } else { "account" }, percent(1.0 - left.share));
    match closing.verdict {
        Verdict::NothingToExplain => format!(
            "Nothing to explain: what the base leaves over is no more than noise (lack of fit {lof})."
        ),
        Verdict::Explained => {
            format!("Explained: {names} {verb} for {gone} of the error that noise does not explain.")
        }
        Verdict::PartlyExplained => format!(
            "Partly explained: {names} {verb} for {gone} of the error that noise does not explain; {} is left.",
            percent(left.share)
        ),
        Verdict::Unexplained => format!(
            "Unexplained: the base misses more than noise (lack of fit {lof}), and no effect of the library accounts \
             for it on every run."
        ),
        Verdict::BaseInadequate => {
            let why = closing.base_fault.as_deref().unwrap_or("it misses too much");
            format!("Base inadequate (lack of fit {lof}): {why}. A name would mean nothing.")
        }
    }
}

/// The name of a run without folders.
#[must_use]
pub fn file_name(run: &str) -> String {
    std::path::Path::new(run).file_name().map_or(run.to_owned(), |name| name.to_string_lossy().into_owned())
}

/// Effects that were refused and not named in a later round after all.
#[must_use]
pub fn refused(closing: &Closing) -> Vec<&Refused> {
    let named = |refused: &&Refused| closing.effects.iter().any(|n| n.effect.effect() == refused.effect);
    closing.refused.iter().filter(|refused| !named(refused)).collect()
}

/// What paired mode is; `None` in absolute mode.
#[must_use]
pub fn paired(mode: Mode) -> Option<&'static str> {
    (mode == Mode::Paired).then_some(
        "Paired mode: what is left over is the difference to the healthy runs of the same excitation, and the base stays as \
         it is.",
    )
}

/// Blocks below which sign flips give no p that survives the correction for some fifteen tests.
const FEW_BLOCKS: usize = 10;

/// What a person can do after this verdict.
#[must_use]
pub fn next_step(closing: &Closing) -> Option<&'static str> {
    match (closing.verdict, closing.mode) {
        (Verdict::Unexplained, _) if closing.blocks < FEW_BLOCKS => Some(
            "The estimate runs are short: with fewer than 10 blocks of evidence hardly any effect can be told from chance. Give \
             longer runs; 30 s of motion are a good start.",
        ),
        (Verdict::Unexplained | Verdict::PartlyExplained, _) => Some(
            "What is left and what it goes with stands below. An effect of your own is one file more: see \
             model/src/effect/mod.rs.",
        ),
        (Verdict::BaseInadequate, Mode::Absolute) => Some(
            "Take a base that comes closer (`mr-damper compare` ranks them), or give healthy runs of the same \
             excitation with --reference.",
        ),
        (Verdict::BaseInadequate, Mode::Paired) => {
            Some("Take a base that comes closer: `mr-damper compare` ranks them.")
        }
        (Verdict::NothingToExplain | Verdict::Explained, _) => None,
    }
}

/// What the sealed runs prove, in a sentence.
#[must_use]
pub fn proof(test: Option<&Sealed>) -> String {
    let Some(sealed) = test else {
        return "NOT PROVED: there were no sealed runs. Give runs that nothing has touched with --test."
            .to_owned();
    };
    let runs = match sealed.runs.len() {
        1 => "the sealed run".to_owned(),
        count => format!("the {count} sealed runs"),
    };
    let [low, high] = sealed.ratio_ci95;
    let share = format!("{} of what it was (95 %: {})", percent(sealed.ratio), percents(sealed.ratio_ci95));
    let gone = sealed.removed.map_or(String::new(), |removed| {
        format!(" {} of the error that noise does not explain is gone.", percent(removed))
    });
    if high < 1.0 {
        format!("On {runs}, read once, the squared error falls to {share}.{gone}")
    } else if low > 1.0 {
        format!("NOT PROVED: on {runs}, read once, the squared error grows to {share}.")
    } else {
        format!("NOT PROVED: on {runs}, read once, the squared error comes to {share}: it may be no better.")
    }
}

/// Where the noise floor is, and where it comes from.
#[must_use]
pub fn noise_floor(floor: &NoiseFloor) -> String {
    use mr_damper_model::diagnose::FloorSource;
    let source = match floor.source {
        FloorSource::Replicates => "from replicates",
        FloorSource::Declared => "as declared",
        FloorSource::Estimated => {
            "estimated from the force's own jitter: white noise alone, so a lower bound; --replicates or --noise-floor \
             make it sure"
        }
    };
    format!("noise floor {}, ESR {}, {source}", force(floor.rsse_n), figure(floor.esr))
}

/// Effects that the data cannot tell from the one that was named, and for each of them (the named one first) the
/// excitation that would. `None` when there are none.
#[must_use]
pub fn class(named: &Named) -> Option<(String, Vec<(String, &'static str)>)> {
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
    fn every_parameter_of_the_library_has_a_name_and_a_unit() {
        for effect in Effect::ALL {
            for parameter in effect.parameters() {
                let (name, unit) = quantity(parameter.name, Some(DriveKind::CoilCurrent));
                assert!(!name.is_empty(), "{}", parameter.name);
                // Asymmetry is a share.
                assert_eq!(unit.is_empty(), effect == Effect::Asymmetry, "{}: {unit}", parameter.name);
            }
        }
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
