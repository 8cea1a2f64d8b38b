//! Measures how often a diagnosis discovers an effect that its library does not have, on generated runs.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example discovery_rates -- [--seeds 2] [--first 0] [--only TEXT] [--fixed] [--no-healthy] [--terms]
//!     --only TEXT    cases whose name contains it: "null", "wrong base", "aeration"
//!     --fixed        with the base fuzzy-tanh, not the one that `close --base auto` chooses
//!     --no-healthy   without a run of the healthy damper
//!     --terms        prints the terms of each case
//! ```
//!
//! A case has three runs of 30 s (training, validation, test) and one of the healthy damper with another excitation. The truth is the base's
//! form (quasi-static valve), a Bouc-Wen valve, or a bristle valve. "Right" is about the first term that the healthy run does not show too. Its
//! modulator and argument, or a pair of its class, are in the list of the effect in [`truth`]. The list has the effect's own signals, and
//! signals that go with them. A constant form has no argument. A hum is right if it is found at 50 Hz.

#[path = "../tests/all/diagnosis/mod.rs"]
mod diagnosis;

use diagnosis::cases::{CaseSpec, Kind, OUTSIDE, Valve};
use diagnosis::instruments::Instrument;
use diagnosis::outcome::{Instrumentation, Prepared, names};
use diagnosis::rates::Rate;
use mr_damper_model::Error;
use mr_damper_model::diagnose::discover::{Claim, FoundTerm};
use mr_damper_model::diagnose::{DiagnosisResult, Settings};
use mr_damper_model::effect::term::{Argument, Form, Modulator};
use mr_damper_model::rig::inject::EFFECTS;

/// The first of the rig's effects that were written after the lists of modulators, arguments and forms.
const FIRST_AFTER: &str = "seal_drag";

/// Modulators and arguments with which an effect counts as found.
fn truth(id: &str) -> (&'static [Modulator], &'static [Argument]) {
    use Argument as Q;
    use Modulator as M;
    const SCALES: &[Modulator] =
        &[M::Force, M::ForceInExtension, M::ForceInCompression, M::SignVelocity, M::DriveSignVelocity];
    const CURRENT: &[Modulator] = &[M::ForcePerDrive, M::Force, M::DriveSignVelocity, M::SignVelocity];
    const GROWS: &[Argument] = &[Q::Time, Q::Path, Q::Energy, Q::TemperatureRise];
    match id {
        "position_ripple" | "bore_score" => (SCALES, &[Q::Displacement, Q::DisplacementMagnitude]),
        "force_loss" | "wear_step" | "seal_blowout" => (SCALES, GROWS),
        "seal_drag" => (&[M::One, M::SignVelocity, M::Velocity], &[Q::Velocity, Q::Speed]),
        "stray_field" => (&[M::One, M::Drive], &[Q::Drive]),
        "mount_resonance" => (&[M::One], &[Q::Force]),
        "thixotropy" => (SCALES, &[Q::TimeSinceReversal, Q::Travel, Q::MeanSpeed, Q::Speed, Q::Velocity]),
        "wall_slip" => (SCALES, &[Q::Speed, Q::Velocity, Q::Drive]),
        "aeration" => (SCALES, &[Q::MeanSpeed, Q::Speed]),
        "cavitation" => (
            &[M::Force, M::ForceInExtension, M::ForceInCompression],
            &[Q::Travel, Q::TimeSinceReversal, Q::Displacement, Q::DisplacementSignVelocity],
        ),
        "relief_valve" => (&[M::One, M::Force, M::SignVelocity], &[Q::Force]),
        "core_saturation" => (CURRENT, &[Q::Drive]),
        "current_sensor_creep" => (CURRENT, &[Q::Time]),
        _ => (&[], &[]),
    }
}

struct Arguments {
    seeds: u64,
    first: u64,
    only: String,
    fixed: bool,
    healthy: bool,
    terms: bool,
}

fn arguments() -> Result<Arguments, Box<dyn std::error::Error>> {
    let mut given =
        Arguments { seeds: 2, first: 0, only: String::new(), fixed: false, healthy: true, terms: false };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
        match word.as_str() {
            "--seeds" => given.seeds = value()?.parse()?,
            "--first" => given.first = value()?.parse()?,
            "--only" => given.only = value()?,
            "--fixed" => given.fixed = true,
            "--no-healthy" => given.healthy = false,
            "--terms" => given.terms = true,
            _ => return Err(format!("{word} is unknown; see the top of the example").into()),
        }
    }
    Ok(given)
}

fn diagnose(spec: &CaseSpec, seed: u64, given: &Arguments) -> Result<DiagnosisResult, Error> {
    let healthy = if given.healthy { spec.healthy_runs(seed)? } else { Vec::new() };
    let prepared = Prepared::new(&spec.case(seed)?, &healthy, Instrumentation::Auto)?;
    let prepared = if given.fixed { prepared.with_fuzzy_tanh()? } else { prepared };
    prepared.diagnose(&Settings::default())
}

/// True if the term, or a pair of its class, is of the effect `id`.
fn is_right(id: &str, found: &FoundTerm) -> bool {
    let (modulators, arguments) = truth(id);
    let (modulator, argument, form) = found.term.kind();
    if form == Form::Constant {
        return modulators.contains(&modulator);
    }
    let pairs = std::iter::once((modulator, argument)).chain(found.class.iter().copied());
    pairs.into_iter().any(|(m, q)| modulators.contains(&m) && arguments.contains(&q))
}

fn print_terms(result: &DiagnosisResult) {
    for found in &result.discovery.terms {
        println!(
            "      {} [{} {:?} {:?}] p {:.4}, removes {:.0} %; class {:?}",
            found.term.equation("A"),
            found.claim.name(),
            found.claim,
            found.ci95,
            found.p,
            100.0 * found.confirmed,
            found.class
        );
    }
    if let Some(hum) = &result.discovery.hum {
        println!("      {}", hum.sentence());
    }
    if let Some(refused) = &result.discovery.refused {
        println!("      refused: {}: {}", refused.term.equation("A"), refused.why);
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let given = arguments()?;
    let after = EFFECTS.iter().skip_while(|effect| effect.id != FIRST_AFTER).map(|e| (e.id, e.typical));
    let effects: Vec<(&'static str, f64)> =
        std::iter::once(("null", 0.0)).chain(OUTSIDE).chain(after).collect();
    println!(
        "right: first term that the healthy run does not show;  removed: share of the reducible test error"
    );
    for kind in [Kind::Outside, Kind::WrongBase(Valve::BoucWen), Kind::WrongBase(Valve::Bristle)] {
        let (mut right, mut removed) = (Rate::default(), Vec::new());
        let [mut false_effects, mut false_hums] = [Rate::default(), Rate::default()];
        for (id, size) in &effects {
            let name = format!("{} {id}", kind.name());
            if !name.contains(&given.only) {
                continue;
            }
            let truth = if *id == "null" { Vec::new() } else { vec![(*id, *size)] };
            let spec = CaseSpec { kind, truth, share: 1.0, instrument: Instrument::Fine };
            for seed in given.first..given.first + given.seeds {
                let result = diagnose(&spec, seed, &given)?;
                let terms = &result.discovery.terms;
                let ids = names(&result);
                let hum = result.discovery.hum;
                let first = terms.iter().find(|found| !matches!(found.claim, Claim::Structure { .. }));
                let is_right = match *id {
                    "mains_hum" => hum.is_some_and(|hum| (hum.frequency_hz - 50.0).abs() < 0.1),
                    id => first.is_some_and(|first| is_right(id, first)),
                };
                false_hums.count(*id != "mains_hum" && hum.is_some());
                let share = result.test.as_ref().and_then(|test| test.removed).unwrap_or(0.0);
                let called = terms.iter().filter(|found| found.claim.is_effect()).count();
                if *id == "null" {
                    false_effects.count(called > 0);
                } else {
                    right.count(is_right);
                    removed.push(share);
                }
                println!(
                    "{name:<44} {seed:>4}  right {:<5} effects called {called}  removed {share:>6.3}  library {ids:?}  {}",
                    is_right,
                    first.map_or_else(String::new, |first| first.term.equation("A")),
                );
                if given.terms {
                    print_terms(&result);
                }
            }
        }
        removed.sort_by(f64::total_cmp);
        let median = removed.get(removed.len() / 2).copied().unwrap_or(f64::NAN);
        println!(
            "{}: right {}, median removed {median:.3}; called effects without one {}, hums without one {}",
            kind.name(),
            right.text(),
            false_effects.text(),
            false_hums.text()
        );
    }
    Ok(())
}
