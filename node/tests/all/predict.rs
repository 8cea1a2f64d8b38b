//! `predict`: the table and the bag hold the same forces, and the bag holds the run.

use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_msgs::{ForceEstimate, ForceResidual, Message, ModeChange, cdr};
use mr_damper_runs::{LoadOptions, SaveOptions, load, save};
use std::path::Path;
use std::process::{Command, Output};

const MODEL: &str = "thesis/fuzzy-tanh/rp3-cs";

fn predict(dir: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command
        .args(["--quiet", "predict", MODEL, "run.csv"])
        .args(more)
        .current_dir(dir)
        .output()
        .expect("it runs")
}

fn with_run() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(2.0);
    let run = record(&experiment, &Plant::default(), &Channels::default(), 1);
    save(&run, &dir.path().join("run.csv"), &SaveOptions::default())
        .expect("room in the temporary directory");
    dir
}

/// The messages of a topic, in the order of the file, with their log times.
fn messages<M: Message>(file: &Path, topic: &str) -> Vec<(u64, M)> {
    let bytes = std::fs::read(file).expect("a file");
    let all = mcap::MessageStream::new(&bytes).expect("MCAP").map(|message| message.expect("a sound file"));
    let of_topic = all.filter(|message| message.channel.topic == topic);
    of_topic.map(|message| (message.log_time, cdr::from_slice(&message.data).expect("CDR"))).collect()
}

#[test]
fn the_bag_holds_the_run_and_the_forces_of_the_table() {
    let dir = with_run();
    for target in [&["--out", "forces.csv"][..], &["--out", "forces.mcap", "--namespace", "/car/left"]] {
        let output = predict(dir.path(), target);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    let table = std::fs::read_to_string(dir.path().join("forces.csv")).expect("a file");
    let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|line| line.split(',').collect()).collect();
    let file = dir.path().join("forces.mcap");
    let estimates = messages::<ForceEstimate>(&file, "/car/left/force_estimate");
    assert_eq!(estimates.len(), rows.len());
    for ((log_time, estimate), row) in estimates.iter().zip(&rows) {
        let seconds = format!("{}.{:09}", log_time / 1_000_000_000, log_time % 1_000_000_000);
        let [of_bag, of_table] = [seconds.as_str(), row[0]].map(|text| text.parse::<f64>().expect("a time"));
        assert_eq!(of_bag.to_bits(), of_table.to_bits());
        let force_n = row[1].parse().unwrap_or(f64::NAN);
        assert!(
            estimate.force.to_bits() == f64::to_bits(force_n)
                || (estimate.force.is_nan() && force_n.is_nan())
        );
        assert_eq!((estimate.model.as_str(), estimate.header.frame_id.as_str()), (MODEL, "car_left"));
    }
    let residuals = messages::<ForceResidual>(&file, "/car/left/force_residual");
    let of_table: Vec<&str> = rows.iter().map(|row| row[8]).filter(|cell| !cell.is_empty()).collect();
    assert!(residuals.len() > 900 && residuals.len() == of_table.len());
    for ((_, residual), cell) in residuals.iter().zip(of_table) {
        assert_eq!(residual.residual.to_string(), cell);
    }
    assert!(!messages::<ModeChange>(&file, "/car/left/mode").is_empty());
    // The run in the bag is the run that it was made from.
    let [from, copy] = ["run.csv", "forces.mcap"]
        .map(|name| load(&dir.path().join(name), &LoadOptions::default()).expect("a run").run);
    assert_eq!(
        (from.displacement_m, from.drive, from.force_n),
        (copy.displacement_m, copy.drive, copy.force_n)
    );
}

#[test]
fn a_run_whose_displacements_are_all_implausible_is_an_error_that_names_the_unit() {
    let dir = with_run();
    let path = dir.path().join("run.csv");
    let mut run = load(&path, &LoadOptions::default()).expect("a run").run;
    run.displacement_m.values.iter_mut().for_each(|value| *value += 1.25);
    std::fs::remove_file(&path).expect("it is there");
    save(&run, &path, &SaveOptions::default()).expect("room in the temporary directory");
    let output = predict(dir.path(), &["--out", "forces.csv"]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{message}");
    for word in ["no displacement can be used", "the limit is 1 m", "displacement_mm", "offset=X"] {
        assert!(message.contains(word), "{word}: {message}");
    }
    assert!(!dir.path().join("forces.csv").exists());
}

#[test]
fn a_target_of_unknown_kind_and_an_existing_bag_are_refused() {
    let dir = with_run();
    std::fs::write(dir.path().join("there.mcap"), "").expect("room");
    for (arguments, why) in [
        (&["--out", "forces.parquet"][..], "name a .csv, .mcap or .db3 file"),
        (&["--out", "there.mcap"], "exists"),
        (&["--out", "forces.csv", "--compression", "zstd"], "--compression does not apply to forces.csv"),
    ] {
        let output = predict(dir.path(), arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains(why), "{arguments:?}: {message}");
    }
    assert_eq!(std::fs::read(dir.path().join("there.mcap")).expect("a file"), b"");
    assert!(!dir.path().join("forces.parquet").exists());
}
