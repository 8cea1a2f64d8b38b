//! Parameters of a network in a model file.

use super::{drive_error, table_into};
use crate::error::Error;
use crate::force::{Network, NetworkScaling, NetworkStructure, Normalisation};
use crate::sample::DriveKind;
use crate::units::Second;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Parameters {
    sample_period_s: f64,
    /// Force offset, which is also the mean for the normalisation of forces.
    force_offset_n: f64,
    force_deviation_n: f64,
    displacement_mean_m: f64,
    displacement_deviation_m: f64,
    velocity_mean_m_s: f64,
    velocity_deviation_m_s: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    current_mean_a: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    current_deviation_a: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    voltage_mean_v: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    voltage_deviation_v: Option<f64>,
    /// For each hidden neuron, a list with its input weights.
    hidden_weights: Vec<Vec<f64>>,
    /// One for each hidden neuron.
    hidden_biases: Vec<f64>,
    /// One for each hidden neuron.
    output_weights: Vec<f64>,
    output_bias: f64,
    /// `wang-liao`: weight of each neuron in the input layer. Absent in a structure without such neurons.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    input_gains: Option<Vec<f64>>,
    /// `wang-liao`: bias of each neuron in the input layer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    input_biases: Option<Vec<f64>>,
}

/// The known keys, to suggest the nearest one.
const KEYS: [&str; 17] = [
    "sample_period_s",
    "force_offset_n",
    "force_deviation_n",
    "displacement_mean_m",
    "displacement_deviation_m",
    "velocity_mean_m_s",
    "velocity_deviation_m_s",
    "current_mean_a",
    "current_deviation_a",
    "voltage_mean_v",
    "voltage_deviation_v",
    "hidden_weights",
    "hidden_biases",
    "output_weights",
    "output_bias",
    "input_gains",
    "input_biases",
];

impl Parameters {
    pub(super) fn of(network: &Network) -> Self {
        let (hidden, inputs) = (network.structure().hidden(), network.inputs());
        let weights = network.weights();
        let layers = Layers::of(&weights, hidden, inputs);
        let scaling = network.scaling();
        let drive = |kind| scaling.drive.filter(|(k, _)| *k == kind).map(|(_, drive)| drive);
        let (current, voltage) = (drive(DriveKind::CoilCurrent), drive(DriveKind::CommandVoltage));
        let has_neurons = network.structure().has_input_neurons();
        let input_layer = has_neurons.then(|| &weights[(inputs + 2) * hidden + 1..]);
        Self {
            sample_period_s: network.sample_period().get(),
            force_offset_n: network.force_offset_n(),
            force_deviation_n: scaling.force_deviation_n,
            displacement_mean_m: scaling.displacement_m.mean,
            displacement_deviation_m: scaling.displacement_m.deviation,
            velocity_mean_m_s: scaling.velocity_m_s.mean,
            velocity_deviation_m_s: scaling.velocity_m_s.deviation,
            current_mean_a: current.map(|n| n.mean),
            current_deviation_a: current.map(|n| n.deviation),
            voltage_mean_v: voltage.map(|n| n.mean),
            voltage_deviation_v: voltage.map(|n| n.deviation),
            hidden_weights: layers.hidden_weights,
            hidden_biases: layers.hidden_biases,
            output_weights: layers.output_weights,
            output_bias: layers.output_bias,
            input_gains: input_layer.map(|layer| layer[..inputs].to_vec()),
            input_biases: input_layer.map(|layer| layer[inputs..].to_vec()),
        }
    }
}

/// Refuses a list of another length than `expected`; `what` says which one that is.
fn check_length(name: String, found: usize, expected: usize, what: &str) -> Result<(), Error> {
    if found == expected {
        return Ok(());
    }
    Err(Error::Length { name, found, expected: format!("{expected} ({what})") })
}

/// The weights of a network as a file holds them.
pub(super) struct Layers {
    /// For each hidden neuron, a list with its input weights.
    pub(super) hidden_weights: Vec<Vec<f64>>,
    /// One for each hidden neuron.
    pub(super) hidden_biases: Vec<f64>,
    /// One for each hidden neuron.
    pub(super) output_weights: Vec<f64>,
    pub(super) output_bias: f64,
}

impl Layers {
    /// The layers of a network with `weights` in the order of [`Network::new`].
    pub(super) fn of(weights: &[f64], hidden: usize, inputs: usize) -> Self {
        let row = |j| (0..inputs).map(|i| weights[i * hidden + j]).collect();
        Self {
            hidden_weights: (0..hidden).map(row).collect(),
            hidden_biases: weights[inputs * hidden..][..hidden].to_vec(),
            output_weights: weights[(inputs + 1) * hidden..][..hidden].to_vec(),
            output_bias: weights[(inputs + 2) * hidden],
        }
    }

    /// The weights in the order of [`Network::new`], from the layers in `table` of the file.
    pub(super) fn weights(&self, table: &str, hidden: usize, inputs: usize) -> Result<Vec<f64>, Error> {
        let check = check_length;
        let neurons = "one for each hidden neuron";
        check(format!("{table}.hidden_weights"), self.hidden_weights.len(), hidden, neurons)?;
        check(format!("{table}.hidden_biases"), self.hidden_biases.len(), hidden, neurons)?;
        check(format!("{table}.output_weights"), self.output_weights.len(), hidden, neurons)?;
        for (j, row) in self.hidden_weights.iter().enumerate() {
            check(format!("{table}.hidden_weights[{j}]"), row.len(), inputs, "one for each input")?;
        }
        let mut weights: Vec<f64> =
            (0..inputs).flat_map(|i| self.hidden_weights.iter().map(move |row| row[i])).collect();
        weights.extend(self.hidden_biases.iter().chain(&self.output_weights).chain([&self.output_bias]));
        Ok(weights)
    }
}

/// The drive's normalisation, from the file's values in both units.
pub(super) fn drive_normalisation(
    drive: Option<DriveKind>,
    current: (Option<f64>, Option<f64>),
    voltage: (Option<f64>, Option<f64>),
) -> Result<Option<(DriveKind, Normalisation)>, Error> {
    match (drive, current, voltage) {
        (None, (None, None), (None, None)) => Ok(None),
        (Some(kind @ DriveKind::CoilCurrent), (Some(mean), Some(deviation)), (None, None))
        | (Some(kind @ DriveKind::CommandVoltage), (None, None), (Some(mean), Some(deviation))) => {
            Ok(Some((kind, Normalisation { mean, deviation })))
        }
        _ => {
            let needed = match drive {
                None => "neither mean nor deviation of current or voltage",
                Some(DriveKind::CoilCurrent) => "current_mean_a and current_deviation_a, but no voltage keys",
                Some(DriveKind::CommandVoltage) => {
                    "voltage_mean_v and voltage_deviation_v, but no current keys"
                }
            };
            Err(drive_error(drive, needed))
        }
    }
}

/// Reads a network. A file of `wang-liao` without an input layer is from before that structure had one: it is the same network by
/// the name `narx`.
pub(super) fn read(
    structure: NetworkStructure,
    drive: Option<DriveKind>,
    table: &toml::Table,
) -> Result<Network, Error> {
    let p: Parameters = table_into("parameters", table.clone(), &KEYS)?;
    let drive = drive_normalisation(
        drive,
        (p.current_mean_a, p.current_deviation_a),
        (p.voltage_mean_v, p.voltage_deviation_v),
    )?;
    let structure = match (structure, &p.input_gains, &p.input_biases) {
        (NetworkStructure::WangLiao, None, None) => NetworkStructure::Narx,
        (structure, _, _) => structure,
    };
    let (hidden, inputs) = (structure.hidden(), structure.inputs(drive.is_some()));
    let layers = Layers {
        hidden_weights: p.hidden_weights,
        hidden_biases: p.hidden_biases,
        output_weights: p.output_weights,
        output_bias: p.output_bias,
    };
    let mut weights = layers.weights("parameters", hidden, inputs)?;
    let expected = if structure.has_input_neurons() { inputs } else { 0 };
    for (name, list) in [("input_gains", &p.input_gains), ("input_biases", &p.input_biases)] {
        let list = list.as_deref().unwrap_or_default();
        let what = if expected > 0 { "one for each input" } else { "this structure has no input layer" };
        check_length(format!("parameters.{name}"), list.len(), expected, what)?;
        weights.extend(list);
    }
    let scaling = NetworkScaling {
        displacement_m: Normalisation { mean: p.displacement_mean_m, deviation: p.displacement_deviation_m },
        velocity_m_s: Normalisation { mean: p.velocity_mean_m_s, deviation: p.velocity_deviation_m_s },
        drive,
        force_deviation_n: p.force_deviation_n,
    };
    Network::new(structure, scaling, &weights, Second(p.sample_period_s), p.force_offset_n)
}
