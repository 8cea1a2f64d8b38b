//! The demo's outcome as text for a terminal.

use super::demo::DemoOutcome;
use super::{correlate, demo_diagnosis, diagnosis};
use mr_damper_model::metrics::Fit;
use std::fmt::Write;

/// The outcome in lines of at most 110 columns.
#[must_use]
pub fn text(outcome: &DemoOutcome) -> String {
    // Writing to a string cannot fail.
    let mut text = String::new();
    let width = outcome.figures.iter().map(|figure| figure.name.chars().count()).max().unwrap_or(0);
    let _ = writeln!(text, "{:<width$} {:>9}  {:>8} {:>8}  {:>8}", "", "RMSE", "NMSE", "samples", "offline");
    for figure in &outcome.figures {
        let offline = figure.offline.map_or("-".to_owned(), |fit| format!("{:.5}", fit.esr));
        let _ = writeln!(text, "{:<width$} {}  {offline:>8}", figure.name, cells(figure.live));
    }
    if let Some(agreement) = outcome.agreement {
        let _ = writeln!(text, "{}", agreement.text());
    }
    for note in &outcome.notes {
        let _ = writeln!(text, "{note}");
    }
    let _ = writeln!(text, "\nmodes");
    for period in outcome.recording.periods() {
        let reasons = period.reasons.names().collect::<Vec<_>>().join(" ");
        let _ = writeln!(
            text,
            "  {:6.2} to {:6.2} s  {:<10} {:<13} {}{}{}",
            period.span_s.0,
            period.span_s.1,
            period.mode.name(),
            period.worst.name(),
            period.cause,
            if reasons.is_empty() { "" } else { "; " },
            reasons
        );
    }
    let _ = writeln!(text, "\nalarm");
    let alarms = demo_diagnosis::alarms(&outcome.recording);
    if alarms.is_empty() {
        let _ = writeln!(text, "  none");
    }
    for alarm in &alarms {
        let _ = writeln!(text, "  {alarm}");
    }
    let _ = writeln!(text, "\nremaining residual of the simulation: correlation with");
    let found = correlate::correlations(&correlate::residual_points(&outcome.recording));
    let facts: Vec<String> = found
        .iter()
        .map(|(name, r)| format!("{} {r:+.2}", name.rsplit(' ').next().unwrap_or(name)))
        .collect();
    let _ = writeln!(text, "  {}", facts.join("   "));
    let _ = writeln!(text, "\ntraffic");
    for (name, value) in &outcome.counts {
        let _ = writeln!(text, "  {name}: {value}");
    }
    if let Some(result) = &outcome.diagnosis {
        let _ = writeln!(text, "\ndiagnosis and model augmentation");
        match result {
            Ok(found) => text += &demo_diagnosis::text(found),
            Err(why) => diagnosis::paragraph(&mut text, 2, &why.to_string()),
        }
    }
    text
}

fn cells(fit: Option<Fit>) -> String {
    match fit {
        Some(fit) => format!("{:7.2} N  {:8.5} {:8}", fit.rsse_n, fit.esr, fit.samples),
        None => format!("{:>9}  {:>8} {:>8}", "-", "-", "-"),
    }
}
