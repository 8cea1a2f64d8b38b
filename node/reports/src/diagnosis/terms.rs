//! Discovered terms: words and numbers for terminal, report and JSON, and their part of the page.

use super::words;
use crate::page::capital;
use crate::plot::{Ink, Plot, Series, Shape};
use maud::{Markup, html};
use mr_damper_model::diagnose::discover::{Claim, Discovery, FoundTerm, Hum, Hypothesis, RefusedTerm};
use mr_damper_model::effect::term::{Argument, Modulator, Term, TermNumber};
use mr_damper_model::sample::DriveKind;

/// Highest frequency in the picture of a resonance, in units of its own.
const OVER_RESONANCE: f64 = 2.5;
/// Points of the curve in the picture of a term.
const POINTS: u32 = 400;

/// Width of an interval, as a multiple of the value, from which on it says nothing.
const UNDETERMINED: f64 = 20.0;

/// Captions of the picture of a term.
const CLOSED_FORM: &str = "The curve c g(q) of the term over the range of its argument in the data.";
const BOTH_CURVES: &str = "The curve c g(q) of the term over the range of its argument in the data, and the same curve without a closed form. A part of it that \
     the base model can follow, such as its level, is not determined by the runs and is that of the closed form.";

/// The heading of the hum.
pub(super) const HUM: &str = "In the measured force alone";

/// The heading of the terms.
pub(super) const HEADING: &str = "Terms beside the effects of the library";

/// That a cause is a hypothesis.
pub(super) const HYPOTHESES: &str =
    "Hypotheses about the cause, with what would tell them apart. The data show the term, not its cause";

/// A number of a term: its name, unit and 95 % interval.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Number {
    pub(super) name: &'static str,
    pub(super) value: f64,
    pub(super) unit: String,
    /// `None` if the discovery has no interval of it.
    pub(super) ci95: Option<[f64; 2]>,
}

impl Number {
    /// The number with its unit and interval.
    pub(super) fn in_words(&self) -> String {
        let with_unit = |text: String| format!("{text} {}", self.unit).trim_end().to_owned();
        let value = with_unit(format!("{} = {}", self.name, words::figure(self.value)));
        let Some([low, high]) = self.ci95 else { return value };
        if high - low > UNDETERMINED * self.value.abs() {
            return format!("{value}, which the runs determine only together with the other numbers");
        }
        let [low, high] = [low, high].map(words::figure);
        format!("{value}, 95 %: {}", with_unit(format!("{low} to {high}")))
    }
}

/// The numbers of a term. `ci95` has an interval for each of them, or none at all.
pub(super) fn numbers(term: &Term, ci95: &[[f64; 2]], drive: Option<DriveKind>) -> Vec<Number> {
    let one = |(place, TermNumber { name, value, unit }): (usize, TermNumber)| Number {
        name,
        value,
        unit,
        ci95: ci95.get(place).copied(),
    };
    term.numbers(words::drive_unit(drive)).into_iter().enumerate().map(one).collect()
}

/// The claim about a term in words; `library` is the id of the library's effect that has its form, if one has it.
pub(super) fn claim(claim: Claim, library: Option<&str>) -> String {
    let says = match claim {
        Claim::Effect { .. } if library.is_some() => "an effect",
        Claim::Effect { .. } => "an effect that the library does not have",
        Claim::Structure { .. } => "the healthy damper has it too: the structure of the base lacks it",
        Claim::EffectOrStructure { on_healthy: None } => {
            "effect or structure of the base: cannot tell without healthy runs with the same excitation (--healthy)"
        }
        Claim::EffectOrStructure { on_healthy: Some(_) } => {
            "effect or structure of the base: the healthy runs cannot tell either"
        }
    };
    let known = library.map_or_else(String::new, |id| {
        format!("; the library has this form as {id}, which was searched and not named")
    });
    let ratio = on_healthy(claim).map_or_else(String::new, |ratio| {
        format!("; on the healthy runs its amount is {} of this", words::percent(ratio))
    });
    format!("{says}{ratio}{known}")
}

/// The amount on the healthy runs as a share of the term's; `None` without healthy runs.
pub(super) const fn on_healthy(claim: Claim) -> Option<f64> {
    match claim {
        Claim::Effect { on_healthy } | Claim::EffectOrStructure { on_healthy } => on_healthy,
        Claim::Structure { on_healthy } => Some(on_healthy),
    }
}

/// The range of the argument in the data.
pub(super) fn confirmed(term: &Term, drive: Option<DriveKind>) -> String {
    let (_, argument, _) = term.kind();
    let [low, high] = term.confirmed_in().map(words::round);
    let range = format!("{low} to {high} {}", term.argument_unit(words::drive_unit(drive)));
    format!("confirmed for {} from {}; beyond that the term extrapolates", argument.words(), range.trim_end())
}

/// The pairs of modulator and argument that these runs cannot distinguish from the term's; `None` if there are none.
pub(super) fn class(found: &FoundTerm) -> Option<String> {
    let pairs: Vec<String> = found.class.iter().map(|pair| pair_name(*pair)).collect();
    (!pairs.is_empty()).then(|| pairs.join(", "))
}

/// A modulator and an argument.
fn pair_name((modulator, argument): (Modulator, Argument)) -> String {
    format!("({}, {})", modulator.name(), argument.name())
}

/// The probability of chance, and the share of the error that the term removes.
pub(super) fn evidence(found: &FoundTerm) -> String {
    format!(
        "{}, corrected for all pairs of modulator and argument; removes {} of the squared error on the validation runs",
        words::chance(found.p),
        words::percent(found.confirmed)
    )
}

/// The best term that was not accepted, with the reason.
pub(super) fn refused(refused: &RefusedTerm, drive: Option<DriveKind>) -> String {
    let equation = refused.term.equation(words::drive_unit(drive));
    format!("{}, {equation}: {}", words::term_title(&refused.term), refused.why)
}

/// The hum in sentences: what it is, how certain it is, and what to do.
pub(super) fn hum(hum: &Hum) -> [String; 3] {
    let Hypothesis { cause, test } = hum.hypothesis();
    [
        hum.sentence(),
        format!(
            "{}; it is {} of the squared error on the validation runs. It is not in the model, because its phase changes from run to run",
            capital(&words::chance(hum.p)),
            words::percent(hum.share)
        ),
        format!("Hypothesis: {cause}; to test it: {test}"),
    ]
}

/// The terms on the page, each with a picture of its curve; nothing if there are none.
pub(super) fn markup(discovery: &Discovery, drive: Option<DriveKind>) -> Markup {
    html! {
        @if !discovery.terms.is_empty() {
            h3 { (HEADING) }
            p { "A term is an effect that no entry of the library describes: F\u{2019} = F + c m g(q). It is in the model file. "
                "It was fitted on the training runs and accepted on the validation runs." }
            @for found in &discovery.terms { (one(found, drive)) }
        }
        @if let Some(found) = &discovery.hum {
            h3 { (HUM) }
            @let [what, evidence, hypothesis] = hum(found);
            p.named { (what) }
            ul { li { (evidence) "." } li { (hypothesis) "." } }
        }
    }
}

fn one(found: &FoundTerm, drive: Option<DriveKind>) -> Markup {
    let term = &found.term;
    let unit = words::drive_unit(drive);
    let hypotheses = found.hypotheses();
    html! {
        p.named { b { (words::term_title(term)) } ": " code { (term.equation(unit)) } }
        ul {
            li { (term.sentence(unit)) }
            @for number in numbers(term, &found.ci95, drive) { li { (number.in_words()) } }
            li { (capital(&confirmed(term, drive))) "." }
            li { (capital(&claim(found.claim, term.in_library()))) "." }
            li { (evidence(found)) "." }
            @if let Some(others) = class(found) { li { "Or one of " (others) ": these runs cannot distinguish them." } }
            @if !hypotheses.is_empty() {
                li {
                    (HYPOTHESES) ":"
                    ul { @for of in hypotheses { li { (of.cause) "; to test it: " (of.test) } } }
                }
            }
        }
        @match term.gain(0.0) {
            Some(_) => (response(term).figure("The gain of the resonance, from its argument to the force.")),
            None => (picture(found, drive).figure(if found.curve.is_empty() { CLOSED_FORM } else { BOTH_CURVES })),
        }
    }
}

/// The gain of a resonance over the frequency.
fn response(term: &Term) -> Plot {
    let most_hz = OVER_RESONANCE * term.parameters().first().copied().unwrap_or(1.0);
    Plot {
        description: format!("Gain of the {} over the frequency", words::term_title(term)),
        x_label: "frequency, Hz".to_owned(),
        y_label: "gain".to_owned(),
        ..line([0.0, most_hz], |hz| term.gain(hz))
    }
}

/// The curve c g(q) over the confirmed range, and the curve without a closed form behind it.
fn picture(found: &FoundTerm, drive: Option<DriveKind>) -> Plot {
    let term = &found.term;
    let (_, argument, _) = term.kind();
    let label =
        |name: &str, unit: &str| if unit.is_empty() { name.to_owned() } else { format!("{name}, {unit}") };
    let mut plot = Plot {
        description: format!("Curve of the {} over its argument", words::term_title(term)),
        x_label: label(argument.words(), &term.argument_unit(words::drive_unit(drive))),
        y_label: label("c g(q)", &term.curve_unit(words::drive_unit(drive))),
        ..line(term.confirmed_in(), |q| Some(term.curve(q)))
    };
    if let ([closed], false) = (plot.series.as_mut_slice(), found.curve.is_empty()) {
        closed.name = "closed form".to_owned();
        let end = |end: usize| found.curve.iter().map(move |point| (point.argument, point.ci95[end]));
        let band = end(0).chain(found.curve.iter().rev().map(|point| (point.argument, point.ci95[1])));
        let middle = found.curve.iter().map(|point| (point.argument, point.value));
        let series = |name: &str, ink, shape, points| Series { name: name.to_owned(), ink, shape, points };
        let behind = [
            series("95 % band", Ink::Trend, Shape::Area, band.collect()),
            series("without a closed form", Ink::Trend, Shape::Dashed, middle.collect()),
        ];
        plot.series.splice(0..0, behind);
    }
    plot
}

/// A plot of `value` over a range, without its texts.
fn line([low, high]: [f64; 2], value: impl Fn(f64) -> Option<f64>) -> Plot {
    let at = |index: u32| low + (high - low) * f64::from(index) / f64::from(POINTS);
    Plot {
        height: 220.0,
        series: vec![Series {
            name: String::new(),
            ink: Ink::Estimate,
            shape: Shape::Line,
            points: (0..=POINTS).filter_map(|index| Some((at(index), value(at(index))?))).collect(),
        }],
        ..Plot::default()
    }
}
