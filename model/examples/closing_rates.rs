//! Measures how often the diagnosis names a correct or a wrong effect, on generated runs with known effects.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example closing_rates -- [--seeds 20] [--first 0] [--only TEXT] [--velocity]
//!     --only TEXT   the case with this name, "null", or all cases whose name contains it: "single", "coil_lag", "x0.5"
//!     --first N     the first seed
//!     --velocity    with a velocity transducer, and nine sets instead of seven, so that the base model fits better
//! ```

#[path = "../tests/closing/mod.rs"]
mod closing;

use closing::cases::{Kind, catalogue};
use closing::judge::{Bench, judge};
use closing::rates::{Rate, Row, head};
use rayon::prelude::*;
use std::error::Error;

struct Arguments {
    seeds: u64,
    only: String,
    first: u64,
    bench: Bench,
}

fn arguments() -> Result<Arguments, String> {
    let mut given = Arguments { seeds: 20, only: String::new(), first: 0, bench: Bench::Displacement };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
        match word.as_str() {
            "--seeds" => given.seeds = value()?.parse().map_err(|e| format!("--seeds: {e}"))?,
            "--only" => given.only = value()?,
            "--first" => given.first = value()?.parse().map_err(|e| format!("--first: {e}"))?,
            "--velocity" => given.bench = Bench::Velocity,
            _ => {
                return Err(format!(
                    "{word} is unknown; the options are --seeds N, --first N, --only TEXT and --velocity"
                ));
            }
        }
    }
    Ok(given)
}

fn main() -> Result<(), Box<dyn Error>> {
    let given = arguments()?;
    let mut plans: Vec<_> =
        catalogue().into_iter().filter(|plan| plan.name().contains(&given.only)).collect();
    if plans.iter().any(|plan| plan.name() == given.only) {
        plans.retain(|plan| plan.name() == given.only);
    }
    if plans.is_empty() {
        return Err(format!("no case has a name that contains \"{}\"", given.only).into());
    }
    println!("{}", head());
    let mut groups: Vec<((Kind, bool, f64), [Rate; 2])> = Vec::new();
    for plan in &plans {
        let mut row = Row::default();
        let seeds = given.first..given.first + given.seeds;
        // The same case without effects gives the error of the base model itself; only these kinds need it.
        let has_twin = matches!(plan.kind, Kind::Single | Kind::Pair);
        let one = |seed| {
            let healthy = has_twin.then(|| judge(&plan.healthy(seed)?, given.bench)).transpose()?;
            Ok::<_, mr_damper_model::Error>((
                judge(&plan.case(seed)?, given.bench)?,
                healthy,
                plan.change(seed)?,
            ))
        };
        // Results are collected in the order of the seeds.
        for (outcome, healthy, change) in seeds.into_par_iter().map(one).collect::<Result<Vec<_>, _>>()? {
            row.take(plan, &outcome, healthy.as_ref(), change);
        }
        println!("{}", row.text(plan));
        let key = (plan.kind, plan.truth.is_empty(), plan.share);
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
