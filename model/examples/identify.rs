//! Identifies both models from two made-up runs and prints what was found.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example identify
//! ```

use mr_damper_model::force::ForceModel;
use mr_damper_model::identify::{ModelSpec, Options, Watch, identify};
use mr_damper_model::rig::{Channels, Experiment, Plant, record};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let experiment = Experiment::thesis("RP3-CS").ok_or("the rig knows its experiments")?;
    let runs: Vec<_> =
        (1..=2).map(|seed| record(&experiment, &Plant::default(), &Channels::default(), seed)).collect();
    for spec in [ModelSpec::ARX_SEMI_ACTIVE, ModelSpec::FUZZY_TANH] {
        let found = identify(spec, &runs, &Options::default(), &Watch::none())?;
        println!("{}", found.model.force.name());
        for (name, fit) in [
            ("free run", found.free_run),
            ("one step ahead", found.one_step),
            ("persistence", found.persistence),
        ] {
            if let Some(fit) = fit {
                println!("  {name:15} RSSE {:7.2} N   ESR {:.5}", fit.rsse_n, fit.esr);
            }
        }
        for run in &found.runs {
            println!("  {}: {} samples, offset {:.1} N", run.name, run.samples, run.force_offset_n);
        }
        match found.model.force {
            ForceModel::Arx(arx) => {
                println!("  rank {:?}, poles {:.4?}", found.rank, arx.pole_moduli());
            }
            ForceModel::FuzzyTanh(fuzzy) => {
                for (centre, f) in fuzzy.centres().iter().zip(fuzzy.functions()) {
                    println!("  {centre:.2} A: {f:.4?}");
                }
            }
            other => println!("  {} parameters", other.parameter_count()),
        }
    }
    Ok(())
}
