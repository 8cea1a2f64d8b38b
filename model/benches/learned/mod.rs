//! Learned inverse models with hand-set numbers.

use mr_damper_model::force::Normalisation;
use mr_damper_model::inverse::{
    FuzzyAxis, InverseFuzzy, InverseKind, InverseModel, InverseNetwork, InverseScaling,
};
use mr_damper_model::model::Model;
use mr_damper_model::units::Second;

/// `model` with a learned inverse of the given kind for 512 Hz. It follows no demand well, but its current depends on all inputs and
/// leaves the limits at both ends.
pub(crate) fn with_learned(model: Model, kind: InverseKind) -> Model {
    let of = |mean, deviation| Normalisation { mean, deviation };
    let scaling = InverseScaling {
        displacement_m: of(0.0, 0.006),
        velocity_m_s: of(0.0, 0.1),
        force_n: of(0.0, 500.0),
        current_a: of(1.2, 1.5),
    };
    let inverse = match kind.network() {
        Some(structure) => {
            let weights: Vec<f64> =
                (0..structure.weights(true)).map(|k| 0.4 * (f64::from(k as u32) * 1.7).sin()).collect();
            let period = Second(1.0 / 512.0);
            InverseNetwork::new(structure, scaling, &weights, period).map(InverseModel::Network)
        }
        None => {
            let axis =
                |std_dev| FuzzyAxis { mean: 0.0, std_dev, centres: [-1.5, 0.0, 1.5], sigmas: [0.7; 3] };
            let conclusions =
                std::array::from_fn(|r| std::array::from_fn(|m| (f64::from((4 * r + m) as u32) * 0.9).sin()));
            let axes = [axis(0.1), axis(4.0), axis(500.0)];
            InverseFuzzy::new(axes, &conclusions, 1.2, 0.9).map(InverseModel::Fuzzy)
        }
    };
    Model { inverse: Some(inverse.expect("numbers in range")), ..model }
}
