//! Measures how often the 95 % interval of an effect's parameter contains the true value, on generated runs.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example interval_coverage -- [SEEDS] [EFFECT...]
//! ```
//!
//! `SEEDS` is the number of cases for each effect (40 if it is not given); without an effect all are measured.

#[path = "../tests/all/diagnosis/mod.rs"]
mod diagnosis;

use diagnosis::intervals::{Coverage, head, ids};
use diagnosis::rates::Rate;
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let seeds: u64 = words.next().map_or(Ok(40), |word| word.parse().map_err(|e| format!("{word}: {e}")))?;
    let only: Vec<String> = words.collect();
    if let Some(unknown) = only.iter().find(|id| !ids().contains(&id.as_str())) {
        return Err(format!("unknown effect {unknown}; the effects are {}", ids().join(", ")).into());
    }
    println!("{}", head());
    let mut all = Rate::default();
    for id in ids().into_iter().filter(|id| only.is_empty() || only.iter().any(|known| known == id)) {
        let coverage = Coverage::of(id, 0..seeds)?;
        println!("{}", coverage.text(id));
        all.merge(coverage.inside);
    }
    println!("all effects: {}", all.text());
    Ok(())
}
