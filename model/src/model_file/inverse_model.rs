//! The learned inverse model in a model file.
//!
//! ```toml
//! [inverse_model]
//! kind = "chen"                         # or "wang-liao"
//! sample_period_s = 0.001953125
//! displacement_mean_m = 0.0             # likewise velocity_..._m_s, force_..._n, current_..._a
//! displacement_deviation_m = 0.005
//! hidden_weights = [[0.1, 0.2]]         # for each hidden neuron, its weights of x, v, F and past i, newest first
//! hidden_biases = [0.1]
//! output_weights = [0.1]
//! output_bias = 0.1
//!
//! [inverse_model]
//! kind = "wang-hu"
//! velocity_mean_m_s = 0.0               # likewise acceleration_..._m_s2 and force_..._n
//! velocity_std_dev_m_s = 0.1
//! velocity_centres = [-2.0, 0.0, 2.0]
//! velocity_sigmas = [0.8, 0.8, 0.8]
//! conclusions = [[0.1, 0.2, 0.3, 0.4]]  # 27 rules, the sets of the force fastest: slopes of v, a, F, and constant
//! current_mean_a = 0.9
//! current_std_dev_a = 0.7
//! ```
//!
//! The force is without the offset of the session.

use super::network::Layers;
use super::{missing, table_into};
use crate::error::{Error, ModelFileError};
use crate::force::{NetworkStructure, Normalisation};
use crate::inverse_model::{
    FuzzyAxis, InverseFuzzy, InverseKind, InverseModel, InverseNetwork, InverseScaling,
};
use crate::sample::DriveKind;
use crate::units::Second;
use serde::{Deserialize, Serialize};

/// Name of the table.
const TABLE: &str = "inverse_model";

#[derive(Debug, Serialize)]
#[serde(untagged)]
pub(super) enum Written {
    Network(Network),
    Fuzzy(Fuzzy),
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Network {
    kind: String,
    sample_period_s: f64,
    displacement_mean_m: f64,
    displacement_deviation_m: f64,
    velocity_mean_m_s: f64,
    velocity_deviation_m_s: f64,
    force_mean_n: f64,
    force_deviation_n: f64,
    current_mean_a: f64,
    current_deviation_a: f64,
    hidden_weights: Vec<Vec<f64>>,
    hidden_biases: Vec<f64>,
    output_weights: Vec<f64>,
    output_bias: f64,
}

const NETWORK_KEYS: [&str; 14] = [
    "kind",
    "sample_period_s",
    "displacement_mean_m",
    "displacement_deviation_m",
    "velocity_mean_m_s",
    "velocity_deviation_m_s",
    "force_mean_n",
    "force_deviation_n",
    "current_mean_a",
    "current_deviation_a",
    "hidden_weights",
    "hidden_biases",
    "output_weights",
    "output_bias",
];

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Fuzzy {
    kind: String,
    velocity_mean_m_s: f64,
    velocity_std_dev_m_s: f64,
    velocity_centres: Vec<f64>,
    velocity_sigmas: Vec<f64>,
    acceleration_mean_m_s2: f64,
    acceleration_std_dev_m_s2: f64,
    acceleration_centres: Vec<f64>,
    acceleration_sigmas: Vec<f64>,
    force_mean_n: f64,
    force_std_dev_n: f64,
    force_centres: Vec<f64>,
    force_sigmas: Vec<f64>,
    conclusions: Vec<Vec<f64>>,
    current_mean_a: f64,
    current_std_dev_a: f64,
}

const FUZZY_KEYS: [&str; 16] = [
    "kind",
    "velocity_mean_m_s",
    "velocity_std_dev_m_s",
    "velocity_centres",
    "velocity_sigmas",
    "acceleration_mean_m_s2",
    "acceleration_std_dev_m_s2",
    "acceleration_centres",
    "acceleration_sigmas",
    "force_mean_n",
    "force_std_dev_n",
    "force_centres",
    "force_sigmas",
    "conclusions",
    "current_mean_a",
    "current_std_dev_a",
];

impl Written {
    pub(super) fn of(model: &InverseModel) -> Self {
        let kind = model.kind().name().to_owned();
        match model {
            InverseModel::Network(network) => Self::Network(of_network(kind, network)),
            InverseModel::Fuzzy(rules) => Self::Fuzzy(of_rules(kind, rules)),
        }
    }
}

fn of_network(kind: String, network: &InverseNetwork) -> Network {
    let InverseScaling { displacement_m, velocity_m_s, force_n, current_a } = network.scaling();
    let structure = network.structure();
    let layers = Layers::of(&network.weights(), structure.hidden(), structure.inputs(true));
    Network {
        kind,
        sample_period_s: network.sample_period().get(),
        displacement_mean_m: displacement_m.mean,
        displacement_deviation_m: displacement_m.deviation,
        velocity_mean_m_s: velocity_m_s.mean,
        velocity_deviation_m_s: velocity_m_s.deviation,
        force_mean_n: force_n.mean,
        force_deviation_n: force_n.deviation,
        current_mean_a: current_a.mean,
        current_deviation_a: current_a.deviation,
        hidden_weights: layers.hidden_weights,
        hidden_biases: layers.hidden_biases,
        output_weights: layers.output_weights,
        output_bias: layers.output_bias,
    }
}

fn of_rules(kind: String, rules: &InverseFuzzy) -> Fuzzy {
    let [velocity, acceleration, force] = rules.axes();
    let [current_mean_a, current_std_dev_a] = rules.current_scale_a();
    Fuzzy {
        kind,
        velocity_mean_m_s: velocity.mean,
        velocity_std_dev_m_s: velocity.std_dev,
        velocity_centres: velocity.centres.to_vec(),
        velocity_sigmas: velocity.sigmas.to_vec(),
        acceleration_mean_m_s2: acceleration.mean,
        acceleration_std_dev_m_s2: acceleration.std_dev,
        acceleration_centres: acceleration.centres.to_vec(),
        acceleration_sigmas: acceleration.sigmas.to_vec(),
        force_mean_n: force.mean,
        force_std_dev_n: force.std_dev,
        force_centres: force.centres.to_vec(),
        force_sigmas: force.sigmas.to_vec(),
        conclusions: rules.conclusions().iter().map(|conclusion| conclusion.to_vec()).collect(),
        current_mean_a,
        current_std_dev_a,
    }
}

/// Reads the table of a file whose force model has `drive`.
pub(super) fn read(drive: Option<DriveKind>, table: &toml::Table) -> Result<InverseModel, Error> {
    if drive != Some(DriveKind::CoilCurrent) {
        return Err(ModelFileError::InverseDrive { drive }.into());
    }
    let kind = match table.get("kind") {
        None => return Err(missing(format!("{TABLE}.kind"))),
        Some(kind) => {
            kind.as_str().and_then(InverseKind::named).ok_or_else(|| ModelFileError::UnknownWord {
                key: format!("{TABLE}.kind"),
                found: kind.as_str().map_or_else(|| kind.to_string(), str::to_owned),
                expected: "chen, wang-liao or wang-hu",
            })?
        }
    };
    match kind.network() {
        Some(structure) => read_network(structure, table).map(InverseModel::Network),
        None => read_rules(table).map(InverseModel::Fuzzy),
    }
}

fn read_network(structure: NetworkStructure, table: &toml::Table) -> Result<InverseNetwork, Error> {
    let p: Network = table_into(TABLE, table.clone(), &NETWORK_KEYS)?;
    let layers = Layers {
        hidden_weights: p.hidden_weights,
        hidden_biases: p.hidden_biases,
        output_weights: p.output_weights,
        output_bias: p.output_bias,
    };
    let weights = layers.weights(TABLE, structure.hidden(), structure.inputs(true))?;
    let of = |mean, deviation| Normalisation { mean, deviation };
    let scaling = InverseScaling {
        displacement_m: of(p.displacement_mean_m, p.displacement_deviation_m),
        velocity_m_s: of(p.velocity_mean_m_s, p.velocity_deviation_m_s),
        force_n: of(p.force_mean_n, p.force_deviation_n),
        current_a: of(p.current_mean_a, p.current_deviation_a),
    };
    InverseNetwork::new(structure, scaling, &weights, Second(p.sample_period_s))
}

fn read_rules(table: &toml::Table) -> Result<InverseFuzzy, Error> {
    let p: Fuzzy = table_into(TABLE, table.clone(), &FUZZY_KEYS)?;
    let axis = |name: &str, [mean, std_dev]: [f64; 2], centres: &[f64], sigmas: &[f64]| {
        Ok::<_, Error>(FuzzyAxis {
            mean,
            std_dev,
            centres: numbers(&format!("{name}_centres"), centres, "one for each set")?,
            sigmas: numbers(&format!("{name}_sigmas"), sigmas, "one for each set")?,
        })
    };
    let velocity = [p.velocity_mean_m_s, p.velocity_std_dev_m_s];
    let acceleration = [p.acceleration_mean_m_s2, p.acceleration_std_dev_m_s2];
    let force = [p.force_mean_n, p.force_std_dev_n];
    let axes = [
        axis("velocity", velocity, &p.velocity_centres, &p.velocity_sigmas)?,
        axis("acceleration", acceleration, &p.acceleration_centres, &p.acceleration_sigmas)?,
        axis("force", force, &p.force_centres, &p.force_sigmas)?,
    ];
    let rule = |(r, rule): (usize, &Vec<f64>)| {
        numbers::<f64, 4>(&format!("conclusions[{r}]"), rule, "slopes of v, a and F, and a constant")
    };
    let rules = p.conclusions.iter().enumerate().map(rule).collect::<Result<Vec<[f64; 4]>, Error>>()?;
    let conclusions = numbers("conclusions", &rules, "one for each rule")?;
    InverseFuzzy::new(axes, &conclusions, p.current_mean_a, p.current_std_dev_a)
}

/// `values` of the key `key` as an array; an error names the key and the needed length.
fn numbers<T: Copy, const N: usize>(key: &str, values: &[T], what: &str) -> Result<[T; N], Error> {
    values.try_into().map_err(|_| Error::Length {
        name: format!("{TABLE}.{key}"),
        found: values.len(),
        expected: format!("{N} ({what})"),
    })
}
