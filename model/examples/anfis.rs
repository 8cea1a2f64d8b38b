//! Identifies every TSK model on one virtual run, tests it on another, and prints times and errors.
//!
//! ```text
//! cargo run --release -p mr-damper-model --example anfis
//! ```

use mr_damper_model::condition::Conditioning;
use mr_damper_model::force::{Shape, Tsk, TskKind};
use mr_damper_model::identify::{
    Algorithm, Dataset, DatasetOptions, Evolution, Learning, TskOptions, Watch, fit_tsk,
};
use mr_damper_model::metrics::{ErrorSum, Fit};
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::DriveKind;
use std::time::Instant;

/// Fit of `model` to the counted rows of `dataset`.
fn fit(model: &Tsk, dataset: &Dataset) -> Option<Fit> {
    let mut sum = ErrorSum::default();
    for row in dataset.rows.iter().filter(|row| row.counts) {
        let force_n = model.force_n(&row.inputs());
        if force_n.is_finite() {
            sum.add(row.force_n, force_n);
        }
    }
    sum.fit()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let experiment = Experiment::thesis("RP-ICPS").ok_or("the rig has no experiment RP-ICPS")?;
    let dataset = |seed| {
        let run = record(&experiment, &Plant::default(), &Channels::default(), seed);
        Dataset::from_run(&run, &Conditioning::THESIS, &DatasetOptions::default())
    };
    let (train, test) = (dataset(1)?, dataset(2)?);
    println!("{} samples, trained on {}, tested on {}", train.counted(), train.name, test.name);
    println!(
        "{:28} {:>7} {:>8} {:>10} {:>10} {:>10}",
        "model", "numbers", "seconds", "first ESR", "train ESR", "test ESR"
    );
    let gradient = TskOptions { learning: Learning::Gradient, ..TskOptions::default() };
    let mut tried = vec![("anfis, Jang's gradient".to_owned(), TskKind::Anfis, true, gradient)];
    for kind in TskKind::ALL {
        for (form, drive) in [("", true), (" passive", false)] {
            tried.push((format!("{}{form}", kind.name()), kind, drive, TskOptions::default()));
        }
    }
    let plain = TskOptions::default();
    let genetic = Evolution { algorithm: Algorithm::Genetic, ..plain.evolution };
    tried.extend([
        (
            "tsk-324, Gaussians".to_owned(),
            TskKind::Atray,
            true,
            TskOptions { shape: Some(Shape::Gaussian), ..plain },
        ),
        (
            "tsk-555, back-propagation".to_owned(),
            TskKind::Ahn,
            true,
            TskOptions { learning: Learning::BackPropagation, ..plain },
        ),
        ("tsk-evolved, ga".to_owned(), TskKind::Evolved, true, TskOptions { evolution: genetic, ..plain }),
    ]);
    for (name, kind, with_drive, options) in tried {
        let drive = with_drive.then_some(DriveKind::CoilCurrent);
        let start = Instant::now();
        let found = fit_tsk(std::slice::from_ref(&train), kind, drive, &options, &Watch::none())?;
        let seconds = start.elapsed().as_secs_f64();
        let (trained, tested) = (fit(&found.model, &train), fit(&found.model, &test));
        let (trained, tested) = (trained.ok_or("no rows")?, tested.ok_or("no rows")?);
        let first = trained.esr * (found.epoch_rsse_n[0] / trained.rsse_n).powi(2);
        println!(
            "{name:28} {:7} {seconds:8.3} {first:10.5} {:10.5} {:10.5}  {} epochs",
            found.model.parameter_count(),
            trained.esr,
            tested.esr,
            found.epoch_rsse_n.len()
        );
    }
    Ok(())
}
