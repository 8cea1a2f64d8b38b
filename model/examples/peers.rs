//! Our part of `tests/peers/run.sh`: times our identification on the data that the Python tools were timed
//! on, and prints the times and errors of both.
//!
//! ```text
//! peers DIR EPOCHS        DIR holds train.csv, test.csv and peers.toml, written by tests/peers/peers.py
//! ```

use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::evaluate::{Evaluation, evaluate};
use mr_damper_model::force::{ForceLaw, ForceModel, TskKind};
use mr_damper_model::identify::{
    Dataset, DatasetOptions, Form, ModelSpec, Options, Structure, TskOptions, Watch, fit_tsk,
    identify_datasets,
};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::Settings;
use mr_damper_model::sample::{DriveKind, Run, Stamp, Trace};
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(dir), Some(epochs)) = (arguments.next(), arguments.next()) else {
        return Err("usage: peers DIR EPOCHS".into());
    };
    let dir = Path::new(&dir);
    let (train, test) = (read(&dir.join("train.csv"))?, read(&dir.join("test.csv"))?);
    let peers = std::fs::read_to_string(dir.join("peers.toml"))?;
    let peers: toml::Table = toml::from_str(&peers)?;
    let conditioning = Conditioning { velocity: VelocitySource::Measured, ..Conditioning::default() };
    let options = Options { conditioning, choose_velocity: false, ..Options::default() };
    // All samples, as in the peers.
    let dataset_options = DatasetOptions { moving_only: false, ..DatasetOptions::default() };
    let datasets = [Dataset::from_run(&train, &conditioning, &dataset_options)?];

    let fit = |spec| identify_datasets(spec, &datasets, &options, &Watch::none());
    let sp = ModelSpec::new(Structure::Law(ForceLaw::Sp), Form::SemiActive)?;
    let template = fit(ModelSpec::ARX_SEMI_ACTIVE)?.model;
    let tsk_options = TskOptions { epochs: epochs.parse()?, ..TskOptions::default() };
    let anfis =
        || fit_tsk(&datasets, TskKind::Anfis, Some(DriveKind::CoilCurrent), &tsk_options, &Watch::none());

    // The minimum of twenty, for both: any interruption affects a fit of a few milliseconds.
    let (mut arx_s, mut arx) = timed(|| fit(ModelSpec::ARX_SEMI_ACTIVE))?;
    for _ in 0..19 {
        let (seconds, again) = timed(|| fit(ModelSpec::ARX_SEMI_ACTIVE))?;
        (arx_s, arx) = (arx_s.min(seconds), again);
    }
    let (sp_s, sp) = timed(|| fit(sp))?;
    let (anfis_s, anfis) = timed(anfis)?;
    let anfis = Model { force: ForceModel::Tsk(anfis.model), ..template };

    println!(
        "{:<44} {:>10} {:>10} {:>8} {:>9} {:>9}",
        "", "peer, s", "ours, s", "ratio", "peer ESR", "our ESR"
    );
    let scored = |model| evaluate(model, &test, Settings::default(), |_| true);
    let rows = [
        ("ARX, 12 coefficients (numpy)", "arx", arx_s, one_step(&scored(arx.model)?), 1.0),
        ("tanh, 15 coefficients, 25 restarts (scipy lm)", "sp", sp_s, free(&scored(sp.model)?), 10.0),
        ("ANFIS, 27 rules (anfis-toolbox)", "anfis", anfis_s, free(&scored(anfis)?), 30.0),
    ];
    let mut missed = false;
    for (name, key, seconds, esr, goal) in rows {
        let (peer_s, peer_esr) = (number(&peers, key, "seconds")?, number(&peers, key, "esr")?);
        let ratio = peer_s / seconds;
        // If the fits differ only by rounding, so do the errors.
        let holds = ratio >= goal && esr <= 1.01 * peer_esr;
        missed |= !holds;
        let mark = if holds { "" } else { "   MISSED" };
        println!("{name:<44} {peer_s:>10.4} {seconds:>10.4} {ratio:>8.1} {peer_esr:>9.5} {esr:>9.5}{mark}");
    }
    Ok(if missed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn timed<T, E>(work: impl Fn() -> Result<T, E>) -> Result<(f64, T), E> {
    let start = Instant::now();
    let result = work()?;
    Ok((start.elapsed().as_secs_f64(), result))
}

fn free(evaluation: &Evaluation) -> f64 {
    evaluation.free_run.map_or(f64::NAN, |fit| fit.esr)
}

fn one_step(evaluation: &Evaluation) -> f64 {
    evaluation.one_step.map_or(f64::NAN, |fit| fit.esr)
}

/// The number `key` of the peer `name`.
fn number(peers: &toml::Table, name: &str, key: &str) -> Result<f64, Box<dyn Error>> {
    let value = peers.get(name).and_then(|peer| peer.get(key)).and_then(toml::Value::as_float);
    value.ok_or_else(|| format!("peers.toml has no {name}.{key}").into())
}

/// A run from the columns time_s, displacement_m, velocity_m_s, current_a, force_n, in this order.
fn read(path: &Path) -> Result<Run, Box<dyn Error>> {
    let text = std::fs::read_to_string(path)?;
    let mut traces: [Trace; 4] = Default::default();
    for line in text.lines().skip(1) {
        let values = line.split(',').map(str::parse).collect::<Result<Vec<f64>, _>>()?;
        let [time_s, signals @ ..] = values.as_slice() else { return Err("a row is empty".into()) };
        for (trace, value) in traces.iter_mut().zip(signals) {
            trace.stamps.push(Stamp::from_nanos((time_s * 1e9).round() as i64));
            trace.values.push(*value);
        }
    }
    let [displacement_m, velocity, current, force] = traces;
    Ok(Run {
        name: path.display().to_string(),
        displacement_m,
        velocity_m_s: Some(velocity),
        drive: Some((DriveKind::CoilCurrent, current)),
        force_n: Some(force),
        ..Run::default()
    })
}
