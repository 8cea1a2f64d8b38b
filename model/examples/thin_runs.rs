//! Measures what the weak prior of the identification does for runs that do not show all of a damper: models by least squares alone, and
//! the models that `identify` gives, on other runs of the virtual rig.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example thin_runs -- [SECONDS [SEEDS [FIRST]]]
//! ```
//!
//! `SECONDS` is the length of each run (8 if it is not given), `SEEDS` the number of runs of each experiment (20), `FIRST` the first seed.
//! Each model is fitted to one run and simulated on a run of each other experiment.

use mr_damper_model::force::{ForceLaw, Form};
use mr_damper_model::identify::{
    Dataset, DatasetOptions, Identified, ModelSpec, Options, Structure, SweptRange, Watch, identify, score,
};
use mr_damper_model::model::Model;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::Run;
use rayon::prelude::*;
use std::error::Error;

const TRAINING: [&str; 4] = ["RP-ICPS", "RP-APRBS", "RP-PRBS", "RP1-CS"];

fn run(experiment: &str, seconds: f64, seed: u64) -> Run {
    let experiment = Experiment::thesis(experiment).expect("of the thesis").with_duration_s(seconds);
    record(&experiment.with_pattern(seed), &Plant::default(), &Channels::default(), seed)
}

/// Mean NMSE of the simulation on the `others`; infinite if one of them is not simulated.
fn mean_nmse(model: &Model, others: &[Run]) -> f64 {
    let nmse = |run: &Run| {
        let data = Dataset::from_run(run, &model.conditioning, &DatasetOptions::default()).ok()?;
        let scores = score(&model.augmented(), &data, &Watch::none()).ok()?;
        Some(scores.free_run_without_offset?.esr)
    };
    let sum: f64 = others.iter().map(|run| nmse(run).unwrap_or(f64::INFINITY)).sum();
    sum / others.len() as f64
}

/// NMSE of a fit on its training run.
fn training_nmse(found: &Identified) -> f64 {
    found.free_run.map_or(f64::INFINITY, |fit| fit.esr)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let seconds: f64 = words.next().map_or(Ok(8.0), |word| word.parse())?;
    let seeds: u64 = words.next().map_or(Ok(20), |word| word.parse())?;
    let first: u64 = words.next().map_or(Ok(1), |word| word.parse())?;
    let law = |law| ModelSpec::new(Structure::Law(law), Form::SemiActive);
    let specs = [
        ModelSpec::FUZZY_TANH,
        ModelSpec::new(Structure::MaxwellSlip, Form::SemiActive)?,
        law(ForceLaw::Sp)?,
        law(ForceLaw::BoucWen)?,
        law(ForceLaw::Kwok)?,
        law(ForceLaw::Choi)?,
    ];
    let options = Options { choose_velocity: false, ..Options::default() };
    println!(
        "                                                 of fits with prior: median NMSE of training, of other runs, and the worst"
    );
    println!(
        "model          fits  refused  prior  faults left   alone  prior    alone  prior    alone  prior"
    );
    for spec in specs {
        let jobs: Vec<(&str, u64)> =
            TRAINING.iter().flat_map(|name| (first..first + seeds).map(|seed| (*name, seed))).collect();
        let one = |(name, seed): &(&str, u64)| -> Option<[f64; 5]> {
            let training = run(name, seconds, *seed);
            let found = identify(spec, &[training], &options, &Watch::none()).ok()?;
            let left = found.swept.as_ref().map_or(0, |swept: &SweptRange| swept.faults.len());
            let Some(alone) = &found.without_prior else {
                return Some([f64::NAN, left as f64, 0.0, 0.0, 0.0]);
            };
            let others: Vec<Run> = Experiment::names()
                .filter(|other| other != name)
                .map(|other| run(other, seconds, seed + 100_000))
                .collect();
            let alone_nmse = alone.free_run.map_or(f64::INFINITY, |fit| fit.esr);
            let on_others = [&alone.model, &found.model].map(|model| mean_nmse(model, &others));
            Some([alone_nmse, left as f64, training_nmse(&found), on_others[0], on_others[1]])
        };
        let results: Vec<Option<[f64; 5]>> = jobs.par_iter().map(one).collect();
        let fits: Vec<[f64; 5]> = results.iter().flatten().copied().collect();
        let with_prior: Vec<[f64; 5]> = fits.iter().filter(|fit| !fit[0].is_nan()).copied().collect();
        let of = |column: usize| -> Vec<f64> { with_prior.iter().map(|fit| fit[column]).collect() };
        let worst = |column: usize| of(column).into_iter().fold(f64::NAN, f64::max);
        print!("{:<14} {:>4}  {:>7}", spec.structure().name(), fits.len(), results.len() - fits.len());
        print!("  {:>5}  {:>11}", with_prior.len(), fits.iter().filter(|fit| fit[1] > 0.0).count());
        if with_prior.is_empty() {
            println!();
            continue;
        }
        let medians = [0, 2, 3, 4].map(|column| median(of(column)));
        println!(
            "   {:.4} {:.4}   {:.4} {:.4}   {:6.2} {:.3}",
            medians[0],
            medians[1],
            medians[2],
            medians[3],
            worst(3),
            worst(4)
        );
    }
    Ok(())
}
