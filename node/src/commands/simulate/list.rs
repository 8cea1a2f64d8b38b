//! `simulate --list`: experiments and effects.

use super::plan::OWN;
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_model::rig::inject::EFFECTS;
use mr_damper_model::rig::{Current, Displacement, Experiment, Wave};
use std::io::Write;

/// Prints experiments and effects to stdout.
pub(super) fn print() -> Result<(), NodeError> {
    match std::io::stdout().lock().write_all(text().as_bytes()) {
        // A closed pipe (`| head`) is not an error.
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(NodeError::io("writing to stdout")(error))
        }
        _ => Ok(()),
    }
}

fn text() -> String {
    let mut text = "experiment   displacement       current   replicates  duration\n".to_owned();
    let mut group = |title: &str, experiments: Vec<Experiment>| {
        text += &format!("{title}\n");
        for e in &experiments {
            let (x, i) = (displacement(e), current(e));
            let (name, replicates, seconds) = (&e.name, e.replicates, e.duration_s);
            text += &format!("  {name:<11} {x:<18} {i:<9} {replicates:>10}  {seconds:>6.0} s\n");
        }
        let runs: u32 = experiments.iter().map(|e| e.replicates).sum();
        let total: f64 = experiments.iter().map(|e| f64::from(e.replicates) * e.duration_s).sum();
        text += &format!("  {}, {total:.0} s\n", shown::count(runs, "run"));
    };
    group("the thesis' (all)", Experiment::names().filter_map(Experiment::thesis).collect());
    let paper = Experiment::paper1_names().filter_map(Experiment::paper1).collect();
    group("the first paper's (paper1)", paper);
    text += "from flags (--amplitude, --frequency, --to-frequency, --current, --duration)\n  ";
    text += &OWN.join(", ");
    text += "\n\neffects (--effect ID=SIZE; size 0 removes one)\n";
    for e in EFFECTS {
        let range = format!("{} to {}", e.range.0, e.range.1);
        text += &format!("  {:<20} {:<8} {range:<14} {}\n", e.id, e.unit, e.what);
    }
    text
}

fn displacement(experiment: &Experiment) -> &'static str {
    match experiment.displacement {
        Displacement::Road(_) => "road",
        Displacement::Sine { .. } => "sine",
        Displacement::Wave(wave) => match wave {
            Wave::AmplitudeModulated { .. } => "AM sine",
            Wave::FrequencyModulated { .. } => "FM sine",
            Wave::Chirp { .. } => "chirp",
            Wave::SteppedFrequency { .. } => "stepped frequency",
            Wave::Slopes { .. } => "slopes (TPNVS)",
        },
    }
}

fn current(experiment: &Experiment) -> &'static str {
    match experiment.current {
        Current::Constant { .. } if !experiment.replicate_currents_a.is_empty() => "seven",
        Current::Constant { .. } => "constant",
        Current::Stepped { .. } => "stepped",
        Current::Icps { .. } => "ICPS",
        Current::Aprbs { .. } => "APRBS",
        Current::Prbs { .. } => "PRBS",
    }
}
