//! Inverse networks `chen` and `wang-liao`: the current from motion, demanded force and past currents.
//!
//! ```text
//! u   = [ x_k .. x_{k-p+1}, v_k .. v_{k-p+1}, F_k .. F_{k-p+1}, i_{k-1} .. i_{k-r} ],  each as (s - mean) / deviation
//! h_j = tanh( sum_n W_jn u_n + b_j )                          j = 1 .. H
//! i_k = mean_i + deviation_i ( sum_j c_j h_j + c_0 )
//! ```
//!
//! | structure | samples of x, v, F | past currents | hidden | inputs |
//! |---|---|---|---|---|
//! | `chen` | 2 each | 1 | 25 | 7 |
//! | `wang-liao` | 5 each | 5 | 15 | 20 |
//!
//! `chen` has the seven inputs of Chen's direct network with force and current exchanged. For `wang-liao` the thesis says only that Wang and
//! Liao model the direct and the inverse dynamics, and gives the inputs of the direct network alone (five samples each of displacement,
//! velocity and force). The inverse is our reading: five samples of the demanded force, and five past currents in the place of the five
//! past forces that the direct network feeds back.
//!
//! The output is fed back, so an inverse network is the semi-active direct [`Network`] with two signals exchanged, in its equation and in
//! its training.
//!
//! Source: `[chen2009]` and `[wangliao2001]` in the bibliography (node/docs/guide/bibliography.md), section 2.1.3 of the thesis.

use crate::error::Error;
use crate::force::{History, Network, NetworkScaling, NetworkStructure, Normalisation};
use crate::sample::DriveKind;
use crate::units::Second;

/// Normalisation of the signals of an inverse network.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InverseScaling {
    /// Displacement, m.
    pub displacement_m: Normalisation,
    /// Velocity, m/s.
    pub velocity_m_s: Normalisation,
    /// Force without the session's offset, N.
    pub force_n: Normalisation,
    /// Current, A.
    pub current_a: Normalisation,
}

/// An inverse network.
///
/// ```
/// use mr_damper_model::force::{Inputs, NetworkStructure, Normalisation};
/// use mr_damper_model::inverse::{InverseModel, InverseNetwork, InverseScaling, InverseState};
/// use mr_damper_model::units::Second;
///
/// let unit = Normalisation { mean: 0.0, deviation: 1.0 };
/// let scaling = InverseScaling {
///     displacement_m: unit,
///     velocity_m_s: unit,
///     force_n: Normalisation { mean: 0.0, deviation: 500.0 },
///     current_a: Normalisation { mean: 1.0, deviation: 0.5 },
/// };
/// // Inputs: x_k, x_{k-1}, v_k, v_{k-1}, F_k, F_{k-1}, i_{k-1}. One neuron is used: 2 tanh(F_k / 500 N).
/// let (structure, hidden) = (NetworkStructure::Chen, 25);
/// let mut weights = vec![0.0; structure.weights(true)];
/// (weights[4 * hidden], weights[8 * hidden]) = (1.0, 2.0);
/// let model = InverseModel::Network(InverseNetwork::new(structure, scaling, &weights, Second(1.0 / 512.0))?);
/// let mut state = InverseState::default();
/// let mut current_a = |dt_s| {
///     let at = Inputs {
///         dt_s, displacement_m: 0.0, velocity_m_s: 0.1, acceleration_m_s2: 0.0, drive: f64::NAN, case_temp_c: 25.0,
///     };
///     let current_a = model.step(&mut state, &at, 500.0);
///     state.feed(current_a.unwrap_or(0.8));
///     current_a
/// };
/// assert_eq!(current_a(None), None, "the sample before is not known");
/// let found = current_a(Some(1.0 / 512.0)).expect("two samples are known");
/// assert!((found - (1.0 + 0.5 * 2.0 * 1.0_f64.tanh())).abs() < 1e-12);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InverseNetwork {
    /// The direct network with the force in the place of the drive, and the current in the place of the force.
    exchanged: Network,
    /// Normalisation of the force.
    force_n: Normalisation,
}

impl InverseNetwork {
    /// An inverse network from its normalised `weights`: W input by input in the order of the equation above (the weights of one input to
    /// all hidden neurons are adjacent), then b, then c, then c_0.
    ///
    /// # Errors
    /// When the structure has neurons in its input layer, the number of weights is not [`NetworkStructure::weights`] of the semi-active form,
    /// a number is not finite, or a deviation or the sample period is not positive.
    pub fn new(
        structure: NetworkStructure,
        scaling: InverseScaling,
        weights: &[f64],
        sample_period: Second,
    ) -> Result<Self, Error> {
        let neurons = if structure.has_input_neurons() { structure.inputs(true) } else { 0 };
        Error::check("neurons of the input layer", neurons as f64, "0 in an inverse network", |n| n == 0.0)?;
        let InverseScaling { displacement_m, velocity_m_s, force_n, current_a } = scaling;
        force_n.check("force_mean_n", "force_deviation_n")?;
        current_a.check("current_mean_a", "current_deviation_a")?;
        let exchanged = NetworkScaling {
            displacement_m,
            velocity_m_s,
            drive: Some((DriveKind::CoilCurrent, force_n)),
            force_deviation_n: current_a.deviation,
        };
        Network::new(structure, exchanged, weights, sample_period, current_a.mean)
            .map(|exchanged| Self { exchanged, force_n })
    }

    /// The inverse network that `exchanged` is: a semi-active network whose drive is the force and whose force is the current. `None` for
    /// the passive form.
    pub(crate) fn of_exchanged(exchanged: Network) -> Option<Self> {
        exchanged.scaling().drive.map(|(_, force_n)| Self { exchanged, force_n })
    }

    /// The structure.
    #[must_use]
    pub const fn structure(&self) -> NetworkStructure {
        self.exchanged.structure()
    }

    /// The normalisation of its signals.
    #[must_use]
    pub const fn scaling(&self) -> InverseScaling {
        let NetworkScaling { displacement_m, velocity_m_s, force_deviation_n, .. } = self.exchanged.scaling();
        let current_a = Normalisation { mean: self.exchanged.force_offset_n(), deviation: force_deviation_n };
        InverseScaling { displacement_m, velocity_m_s, force_n: self.force_n, current_a }
    }

    /// The normalised weights, in the order of [`InverseNetwork::new`].
    #[must_use]
    pub fn weights(&self) -> Vec<f64> {
        self.exchanged.weights()
    }

    /// Number of weights.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        self.exchanged.parameter_count()
    }

    /// The sample period at which the weights hold.
    #[must_use]
    pub const fn sample_period(&self) -> Second {
        self.exchanged.sample_period()
    }

    /// The current, A; `None` if a needed lag is not known.
    #[inline]
    pub(super) fn current_a(&self, exchanged: &History) -> Option<f64> {
        self.exchanged.predict_n(exchanged)
    }
}
