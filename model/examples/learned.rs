//! Identifies the data-driven models (networks, lazy learning) from one generated run and evaluates them on
//! another: simulation, one-step-ahead prediction and persistence (the force equals the previous force).
//!
//! ```text
//! cargo run --release -p mr-damper-model --example learned
//! ```

use mr_damper_model::condition::Conditioning;
use mr_damper_model::evaluate::evaluate;
use mr_damper_model::identify::{Form, ModelSpec, Options, Watch, identify};
use mr_damper_model::metrics::Fit;
use mr_damper_model::pipeline::Settings;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let experiment = Experiment::thesis("RP-ICPS").ok_or("the rig has no experiment RP-ICPS")?;
    let [training, test] =
        [1, 2].map(|seed| record(&experiment, &Plant::default(), &Channels::default(), seed));
    let options = Options { conditioning: Conditioning::THESIS, ..Options::default() };
    for name in ["wang-liao", "narx", "chen", "boada"] {
        for form in [Form::Passive, Form::SemiActive] {
            let begin = Instant::now();
            let spec = ModelSpec::named(name, form)?;
            let found = identify(spec, std::slice::from_ref(&training), &options, &Watch::none())?;
            println!("{name} {}: identified in {:.2} s", form.name(), begin.elapsed().as_secs_f64());
            println!("  candidates, RMSE on held-back rows: {:.1?} N", found.restart_rsse_n);
            for warning in &found.warnings {
                println!("  {warning}");
            }
            print("training", found.free_run, found.one_step, found.persistence);
            let tested = evaluate(found.model, &test, Settings::default(), |_| true)?;
            print("test", tested.free_run, tested.one_step, tested.persistence);
        }
    }
    Ok(())
}

fn print(run: &str, free_run: Option<Fit>, one_step: Option<Fit>, persistence: Option<Fit>) {
    let esr = |fit: Option<Fit>| fit.map_or("-".to_owned(), |fit| format!("{:.5}", fit.esr));
    println!(
        "  {run:8} NMSE: simulation {}, one step {}, persistence {}",
        esr(free_run),
        esr(one_step),
        esr(persistence)
    );
}
