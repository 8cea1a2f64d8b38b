//! Measures how often the diagnosis names a correct or a wrong effect, on generated runs with known effects.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example diagnosis_rates -- [--seeds 20] [--first 0] [--only TEXT] [--velocity | --auto] [--healthy]
//!     --only TEXT   the case with this name, "null", or all cases whose name contains it: "single", "coil_lag", "x0.5"
//!     --first N     the first seed
//!     --velocity    with a velocity transducer, and nine sets instead of seven, so that the base model fits better
//!     --auto        with the base that `close --base auto` chooses; without the paired cases, which have no such base
//!     --healthy     with a run of the healthy damper, and another excitation: says whether the effects named are new
//! ```

#[path = "../tests/all/diagnosis/mod.rs"]
mod diagnosis;

use diagnosis::cases::{Kind, catalogue};
use diagnosis::outcome::{Instrumentation, diagnose};
use diagnosis::rates::{Rate, Row, head};
use rayon::prelude::*;
use std::error::Error;

struct Arguments {
    seeds: u64,
    only: String,
    first: u64,
    instrumentation: Instrumentation,
    healthy: bool,
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let mut given = Arguments {
        seeds: 20,
        only: String::new(),
        first: 0,
        instrumentation: Instrumentation::Displacement,
        healthy: false,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
        match word.as_str() {
            "--seeds" => given.seeds = value()?.parse().map_err(|e| format!("--seeds: {e}"))?,
            "--only" => given.only = value()?,
            "--first" => given.first = value()?.parse().map_err(|e| format!("--first: {e}"))?,
            "--velocity" => given.instrumentation = Instrumentation::Velocity,
            "--healthy" => given.healthy = true,
            "--auto" => given.instrumentation = Instrumentation::Auto,
            _ => {
                return Err(format!(
                    "{word} is unknown; the options are --seeds N, --first N, --only TEXT, --velocity, --auto and --healthy"
                )
                .into());
            }
        }
    }
    Ok(given)
}

fn main() -> Result<(), Box<dyn Error>> {
    let given = arguments()?;
    let mut specs: Vec<_> =
        catalogue().into_iter().filter(|spec| spec.name().contains(&given.only)).collect();
    if specs.iter().any(|spec| spec.name() == given.only) {
        specs.retain(|spec| spec.name() == given.only);
    }
    if given.instrumentation == Instrumentation::Auto {
        specs.retain(|spec| spec.kind != Kind::Paired);
    }
    if specs.is_empty() {
        return Err(format!("no case has a name that contains \"{}\"", given.only).into());
    }
    println!("{}", head());
    let mut groups: Vec<((Kind, bool, f64), [Rate; 2])> = Vec::new();
    for spec in &specs {
        let mut row = Row::default();
        let seeds = given.first..given.first + given.seeds;
        // The same case without effects gives the error of the base model itself; only these kinds need it.
        let has_twin = matches!(spec.kind, Kind::Single | Kind::Pair);
        let one = |seed| {
            let twin =
                has_twin.then(|| diagnose(&spec.healthy(seed)?, &[], given.instrumentation)).transpose()?;
            let healthy = if given.healthy { spec.healthy_runs(seed)? } else { Vec::new() };
            Ok::<_, mr_damper_model::Error>((
                diagnose(&spec.case(seed)?, &healthy, given.instrumentation)?,
                twin,
                spec.change(seed)?,
            ))
        };
        // Results are collected in the order of the seeds.
        for (outcome, twin, change) in seeds.into_par_iter().map(one).collect::<Result<Vec<_>, _>>()? {
            row.take(spec, &outcome, twin.as_ref(), change);
        }
        println!("{}", row.text(spec));
        let key = (spec.kind, spec.truth.is_empty(), spec.share);
        let at = groups.iter().position(|(known, _)| *known == key).unwrap_or_else(|| {
            groups.push((key, [Rate::default(); 2]));
            groups.len() - 1
        });
        groups[at].1[0].merge(row.right);
        groups[at].1[1].merge(row.wrong);
    }
    println!();
    for ((kind, is_null, share), [right, wrong]) in groups {
        let what = if is_null { "without effect".to_owned() } else { format!("x{share}") };
        println!("{:<12} {what:<16} right {:>22}   wrong {:>22}", kind.name(), right.text(), wrong.text());
    }
    Ok(())
}
