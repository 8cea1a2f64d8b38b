//! Our part of `tests/peers/fis_peer.py`: the force of a model of fuzzy rules at given normalised inputs.
//!
//! ```text
//! fis_grid MODEL.toml GRID.txt      GRID.txt has the normalised inputs of one point in each line
//! ```
//!
//! Prints the normalised output of each point, which is the output of the model's FIS file.

use mr_damper_model::force::{ForceModel, Inputs, Signal};
use mr_damper_model::model_file::ModelFile;
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(model), Some(grid)) = (arguments.next(), arguments.next()) else {
        return Err("usage: fis_grid MODEL.toml GRID.txt".into());
    };
    let file = ModelFile::from_toml(&std::fs::read_to_string(model)?)?;
    let ForceModel::Tsk(rules) = file.model.force else {
        return Err(format!("a model {} has no rules", file.model.force.name()).into());
    };
    let scale = rules.output();
    for line in std::fs::read_to_string(grid)?.lines() {
        let mut inputs = Inputs {
            dt_s: None,
            displacement_m: f64::NAN,
            velocity_m_s: f64::NAN,
            acceleration_m_s2: f64::NAN,
            drive: f64::NAN,
            case_temp_c: f64::NAN,
        };
        for (input, number) in rules.inputs().iter().zip(line.split_whitespace()) {
            let raw = input.mean() + input.std_dev() * number.parse::<f64>()?;
            match input.signal() {
                Signal::Displacement => inputs.displacement_m = raw,
                Signal::Velocity => inputs.velocity_m_s = raw,
                Signal::Acceleration => inputs.acceleration_m_s2 = raw,
                Signal::Drive(_) => inputs.drive = raw,
                Signal::Force => return Err("a force is no input of a damper's model".into()),
            }
        }
        let normalised = (rules.force_n(&inputs) - rules.force_offset_n() - scale.mean_n) / scale.std_dev_n;
        println!("{normalised:?}");
    }
    Ok(())
}
