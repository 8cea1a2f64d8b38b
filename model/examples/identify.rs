//! Identifies several models from two generated runs and prints the results: the models that the node runs by
//! default, and those that the thesis leaves to future work (free fuzzy sets, ARX with coefficients that
//! depend on the current).
//!
//! ```text
//! cargo run --release -p mr-damper-model --example identify
//! ```

use mr_damper_model::force::ForceModel;
use mr_damper_model::identify::{Form, ModelSpec, Options, Placement, Watch, identify};
use mr_damper_model::rig::{Channels, Experiment, Plant, record};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let experiment = Experiment::thesis("RP3-CS").ok_or("the rig has no experiment RP3-CS")?;
    let runs: Vec<_> =
        (1..=2).map(|seed| record(&experiment, &Plant::default(), &Channels::default(), seed)).collect();
    for (name, form, placement) in [
        ("arx", Form::SemiActive, Placement::FromRuns),
        ("savaresi", Form::SemiActive, Placement::FromRuns),
        ("lpv", Form::SemiActive, Placement::FromRuns),
        ("fuzzy-tanh", Form::SemiActive, Placement::FromRuns),
        ("fuzzy-tanh", Form::FreeFuzzy, Placement::Even(4)),
    ] {
        let options = Options { placement, ..Options::default() };
        let found = identify(ModelSpec::named(name, form)?, &runs, &options, &Watch::none())?;
        println!("{name} ({})", form.name());
        for (name, fit) in [
            ("free run", found.free_run),
            ("one step ahead", found.one_step),
            ("persistence", found.persistence),
        ] {
            if let Some(fit) = fit {
                println!("  {name:15} RMSE {:7.2} N   NMSE {:.5}", fit.rsse_n, fit.esr);
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
                let sets = fuzzy.sets().centres().iter().zip(fuzzy.sets().sigmas());
                for ((centre, sigma), f) in sets.zip(fuzzy.functions()) {
                    println!("  {centre:.2} A, width {sigma:.2} A: {f:.4?}");
                }
            }
            other => println!("  {} parameters", other.parameter_count()),
        }
    }
    Ok(())
}
