//! Autoregressive feed-forward networks: `wang-liao` (recurrent direct model), `narx` and `chen`.
//!
//! ```text
//! u   = [ x_k .. x_{k-p+1}, v_k .. v_{k-p+1}, (i_k .. i_{k-q+1},) F_{k-1} .. F_{k-r} ],  each as (s - mean) / deviation
//! g_i = tanh( a_i u_i + d_i ), or u_i                          i = 1 .. n,   with or without neurons in the input layer
//! h_j = tanh( sum_i W_ji g_i + b_j )                          j = 1 .. H
//! F_k = F0 + deviation_F ( sum_j c_j h_j + c_0 )
//! ```
//!
//! | symbol | field | unit | meaning |
//! |---|---|---|---|
//! | x, v | history | m, m/s | displacement from the rest position, velocity; positive in extension |
//! | i | history | A or V | drive: coil current, or command voltage; semi-active form only |
//! | F | history | N | force, including the session's offset: measured (one-step-ahead prediction) or predicted (simulation, free run) |
//! | W, b, c, a, d | `weights` | 1 | weights of normalised signals |
//! | mean, deviation | `Scaling` | of the signal | mean and standard deviation of the training data |
//! | F0 | `force_offset_n` | N | mean force of the session; it is also the mean in the normalisation of force |
//!
//! | structure | lags of x, v, i, F | input layer | hidden | source |
//! |---|---|---|---|---|
//! | `wang-liao` passive | 5, 5, -, 5 | 15 neurons | 15 | Wang and Liao: a recurrent direct model, no current |
//! | `wang-liao` semi-active | 5, 5, 5, 5 | 20 neurons | 15 | our extension: five samples of the drive and their neurons |
//! | `narx` | as `wang-liao` | inputs as they are | 15 | a usual NARX network of this size |
//! | `chen` semi-active | 2, 2, 2, 1 | inputs as they are | 25 | Chen: 7 inputs |
//! | `chen` passive | 2, 2, -, 1 | inputs as they are | 25 | the same without the drive |
//!
//! The thesis describes the network of Wang and Liao by "fifteen input layer neurons, five for each input", where "the form of the input
//! and hidden layers was sigmoidal and that of the output layer was linear". As five neurons belong to each signal, and five samples of
//! each signal are its inputs, each input neuron is taken to see one input alone, with a weight a and a bias d of its own.
//!
//! The activation function is tanh. A logistic function gives the same set of models: sigma(z) = (1 + tanh(z/2)) /
//! 2, and the weights absorb the factors.
//!
//! The lags are whole samples, so a network holds at one rate only. Outside its training data it saturates: it
//! extrapolates to a constant that need not be correct.
//!
//! Source: `[wangliao2001]` and `[chen2009]` in the bibliography (node/docs/guide/bibliography.md), section 2.1.3 of the thesis.

use super::history::{DEPTH, History, known};
use crate::elementary::tanh_in_lanes;
use crate::error::Error;
use crate::lanes::widest;
use crate::sample::DriveKind;
use crate::units::Second;

/// Largest number of inputs of a network.
pub const MAX_NETWORK_INPUTS: usize = 20;
/// Largest number of hidden neurons.
pub const MAX_NETWORK_HIDDEN: usize = 25;
/// Number of hidden neurons, padded to whole vectors. The weights of the padding are zero.
const LANES: usize = MAX_NETWORK_HIDDEN.next_multiple_of(PER_VECTOR);
/// Number of inputs, padded to whole vectors.
const INPUT_LANES: usize = MAX_NETWORK_INPUTS.next_multiple_of(PER_VECTOR);
/// Number of values per vector: 32 bytes.
const PER_VECTOR: usize = 4;

/// Structure of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum NetworkStructure {
    /// Five lags of each signal, each with a neuron of its own in the input layer; 15 hidden neurons.
    WangLiao,
    /// Five lags of each signal, 15 hidden neurons.
    Narx,
    /// Two lags of each input, one of force, 25 hidden neurons.
    Chen,
}

impl NetworkStructure {
    /// All structures.
    pub const ALL: [Self; 3] = [Self::WangLiao, Self::Narx, Self::Chen];

    /// The structure called `name`, as in the contract.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|structure| structure.name() == name)
    }

    /// The model's name, as in the contract: `wang-liao`, `narx`, `chen`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::WangLiao => "wang-liao",
            Self::Narx => "narx",
            Self::Chen => "chen",
        }
    }

    /// Number of samples each of displacement, of velocity and (in the semi-active form) of drive among the inputs.
    #[must_use]
    pub const fn input_lags(self) -> usize {
        match self {
            Self::WangLiao | Self::Narx => 5,
            Self::Chen => 2,
        }
    }

    /// Number of samples of past force among the inputs.
    #[must_use]
    pub const fn force_lags(self) -> usize {
        match self {
            Self::WangLiao | Self::Narx => 5,
            Self::Chen => 1,
        }
    }

    /// Number of hidden neurons.
    #[must_use]
    pub const fn hidden(self) -> usize {
        match self {
            Self::WangLiao | Self::Narx => 15,
            Self::Chen => 25,
        }
    }

    /// Number of inputs of the passive form, or of the semi-active form (`driven`).
    #[must_use]
    pub const fn inputs(self, driven: bool) -> usize {
        let signals = if driven { 3 } else { 2 };
        signals * self.input_lags() + self.force_lags()
    }

    /// True if the input layer has neurons: each input passes a sigmoid of its own.
    #[must_use]
    pub const fn has_input_neurons(self) -> bool {
        matches!(self, Self::WangLiao)
    }

    /// Number of weights of the passive form, or of the semi-active form (`driven`): W, b, c and c_0 and, for a structure with
    /// neurons in the input layer, a and d.
    #[must_use]
    pub const fn weights(self, driven: bool) -> usize {
        let inputs = self.inputs(driven);
        let input_layer = if self.has_input_neurons() { 2 * inputs } else { 0 };
        self.hidden() * (inputs + 2) + 1 + input_layer
    }
}

/// Mean and standard deviation by which one signal is normalised, in the signal's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normalisation {
    /// Mean of the training data.
    pub mean: f64,
    /// Standard deviation of the training data; positive.
    pub deviation: f64,
}

impl Normalisation {
    /// The normalised value.
    #[inline]
    #[must_use]
    pub const fn apply(&self, value: f64) -> f64 {
        (value - self.mean) / self.deviation
    }

    /// Checks that the mean is finite and the deviation positive.
    pub(crate) fn check(&self, mean_name: &str, deviation_name: &str) -> Result<(), Error> {
        Error::check(mean_name, self.mean, "finite", |_| true)?;
        Error::check(deviation_name, self.deviation, "positive and finite", |d| d > 0.0)?;
        Ok(())
    }
}

/// Normalisation of the signals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NetworkScaling {
    /// Displacement, m.
    pub displacement_m: Normalisation,
    /// Velocity, m/s.
    pub velocity_m_s: Normalisation,
    /// Drive, A or V, with its kind; `None` for the passive form.
    pub drive: Option<(DriveKind, Normalisation)>,
    /// Standard deviation of force, N; its mean is the force offset.
    pub force_deviation_n: f64,
}

/// An autoregressive network with one hidden layer and, for `wang-liao`, neurons in the input layer.
///
/// ```
/// use mr_damper_model::force::{ForceModel, FreeRun, Inputs, Network, NetworkScaling, NetworkStructure, Normalisation};
/// use mr_damper_model::units::Second;
///
/// let scaling = NetworkScaling {
///     displacement_m: Normalisation { mean: 0.0, deviation: 0.005 },
///     velocity_m_s: Normalisation { mean: 0.0, deviation: 0.1 },
///     drive: None,
///     force_deviation_n: 300.0,
/// };
/// // Five inputs: x_k, x_{k-1}, v_k, v_{k-1}, F_{k-1}. One neuron is used: 2 tanh(v_k / 0.1 m/s).
/// let (structure, inputs, hidden) = (NetworkStructure::Chen, 5, 25);
/// let mut weights = vec![0.0; structure.weights(false)];
/// (weights[2 * hidden], weights[(inputs + 1) * hidden]) = (1.0, 2.0);
/// let network = ForceModel::Network(Network::new(structure, scaling, &weights, Second(1.0 / 512.0), 0.0)?);
/// # let extending = Inputs {
/// #     dt_s: Some(1.0 / 512.0), displacement_m: 0.0, velocity_m_s: 0.1, acceleration_m_s2: 0.0, drive: f64::NAN, case_temp_c: 25.0,
/// # };
/// let mut state = FreeRun::default();
/// let force_n = (0..10).filter_map(|_| network.free_run(&mut state, &extending)).last();
/// assert!((force_n.expect("its history is full") - 300.0 * 2.0 * 1.0_f64.tanh()).abs() < 1e-6);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Network {
    structure: NetworkStructure,
    scaling: NetworkScaling,
    inputs: usize,
    /// Row by input, column by hidden neuron.
    hidden: [[f64; LANES]; MAX_NETWORK_INPUTS],
    hidden_bias: [f64; LANES],
    output: [f64; LANES],
    output_bias: f64,
    /// a and d of the input layer; not used by a structure without neurons there.
    input_gain: [f64; INPUT_LANES],
    input_bias: [f64; INPUT_LANES],
    sample_period_s: f64,
    force_offset_n: f64,
}

impl Network {
    /// A network from its normalised `weights`: W input by input (the weights of one input to all hidden neurons are
    /// adjacent), then b, then c, then c_0, then a and d if the input layer has neurons. The inputs are in the order of the equation above.
    ///
    /// # Errors
    /// When the number of weights is not [`NetworkStructure::weights`], a number is not finite, or a deviation or
    /// the sample period is not positive.
    pub fn new(
        structure: NetworkStructure,
        scaling: NetworkScaling,
        weights: &[f64],
        sample_period: Second,
        force_offset_n: f64,
    ) -> Result<Self, Error> {
        let driven = scaling.drive.is_some();
        let count = structure.weights(driven);
        if weights.len() != count {
            return Err(Error::Length {
                name: "weights".to_owned(),
                found: weights.len(),
                expected: count.to_string(),
            });
        }
        scaling.displacement_m.check("displacement_mean_m", "displacement_deviation_m")?;
        scaling.velocity_m_s.check("velocity_mean_m_s", "velocity_deviation_m_s")?;
        if let Some((kind, drive)) = scaling.drive {
            let unit = if kind == DriveKind::CoilCurrent { "current_a" } else { "command_v" };
            drive.check(&format!("{unit} mean"), &format!("{unit} deviation"))?;
        }
        Error::check("force_deviation_n", scaling.force_deviation_n, "positive and finite", |d| d > 0.0)?;
        Error::check("force_offset_n", force_offset_n, "finite", |_| true)?;
        let sample_period_s =
            Error::check("sample_period_s", sample_period.get(), "positive and finite", |t| t > 0.0)?;
        for (j, weight) in weights.iter().enumerate() {
            Error::check(&format!("weights[{j}]"), *weight, "finite", |_| true)?;
        }
        let network = Self {
            structure,
            scaling,
            inputs: structure.inputs(driven),
            hidden: [[0.0; LANES]; MAX_NETWORK_INPUTS],
            hidden_bias: [0.0; LANES],
            output: [0.0; LANES],
            output_bias: 0.0,
            input_gain: [0.0; INPUT_LANES],
            input_bias: [0.0; INPUT_LANES],
            sample_period_s,
            force_offset_n,
        };
        Ok(network.with_weights(weights))
    }

    /// The same network with other weights, as many as it has.
    pub(crate) fn with_weights(mut self, weights: &[f64]) -> Self {
        let hidden = self.structure.hidden();
        let (rows, rest) = weights.split_at(hidden * (self.inputs + 2));
        let mut rows = rows.chunks_exact(hidden);
        for to in self.hidden[..self.inputs].iter_mut().chain([&mut self.hidden_bias, &mut self.output]) {
            if let Some(from) = rows.next() {
                to[..hidden].copy_from_slice(from);
            }
        }
        let (output_bias, input_layer) = rest.split_at(1);
        self.output_bias = output_bias[0];
        if self.structure.has_input_neurons() {
            let (gain, bias) = input_layer.split_at(self.inputs);
            self.input_gain[..self.inputs].copy_from_slice(gain);
            self.input_bias[..self.inputs].copy_from_slice(bias);
        }
        self
    }

    /// The normalised weights, in the order of [`Network::new`].
    #[must_use]
    pub fn weights(&self) -> Vec<f64> {
        let rows = self.hidden[..self.inputs].iter().chain([&self.hidden_bias, &self.output]);
        let hidden = self.structure.hidden();
        let rest = if self.structure.has_input_neurons() { self.inputs } else { 0 };
        let input_layer = self.input_gain[..rest].iter().chain(&self.input_bias[..rest]);
        rows.flat_map(|row| &row[..hidden]).chain([&self.output_bias]).chain(input_layer).copied().collect()
    }

    /// The structure of the network.
    #[must_use]
    pub const fn structure(&self) -> NetworkStructure {
        self.structure
    }

    /// The normalisation of its signals.
    #[must_use]
    pub const fn scaling(&self) -> NetworkScaling {
        self.scaling
    }

    /// The drive that the model needs; `None` for the passive form.
    #[must_use]
    pub const fn drive(&self) -> Option<DriveKind> {
        match self.scaling.drive {
            Some((kind, _)) => Some(kind),
            None => None,
        }
    }

    /// Number of inputs.
    #[must_use]
    pub const fn inputs(&self) -> usize {
        self.inputs
    }

    /// Number of weights.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        self.structure.weights(self.scaling.drive.is_some())
    }

    /// The sample period at which the weights hold.
    #[must_use]
    pub const fn sample_period(&self) -> Second {
        Second(self.sample_period_s)
    }

    /// Force offset of the session, N.
    #[must_use]
    pub const fn force_offset_n(&self) -> f64 {
        self.force_offset_n
    }

    /// The same model with another session's force offset, N.
    #[must_use]
    pub const fn with_force_offset_n(mut self, force_offset_n: f64) -> Self {
        self.force_offset_n = force_offset_n;
        self
    }

    /// The predicted force, N; `None` if a needed lag is not known.
    #[inline]
    #[must_use]
    pub fn predict_n(&self, history: &History) -> Option<f64> {
        let mut inputs = [0.0; MAX_NETWORK_INPUTS];
        if !self.gather(history, &mut inputs) {
            return None;
        }
        let output = widest(
            #[inline(always)]
            || self.forward(&inputs[..self.inputs]),
        );
        Some(self.force_offset_n + self.scaling.force_deviation_n * output)
    }

    /// Fills `inputs` with the normalised inputs from `history`; false if one is not known.
    #[inline]
    fn gather(&self, history: &History, inputs: &mut [f64; MAX_NETWORK_INPUTS]) -> bool {
        let (lags, force_lags) = (self.structure.input_lags(), self.structure.force_lags());
        let force = Normalisation { mean: self.force_offset_n, deviation: self.scaling.force_deviation_n };
        let mut at = 0;
        let mut complete = true;
        let mut take = |slots: &[f64; DEPTH], count: usize, by: Normalisation| {
            complete &= known(slots, count);
            for (to, from) in inputs[at..at + count].iter_mut().zip(slots) {
                *to = by.apply(*from);
            }
            at += count;
        };
        take(&history.displacement_m, lags, self.scaling.displacement_m);
        take(&history.velocity_m_s, lags, self.scaling.velocity_m_s);
        if let Some((_, drive)) = self.scaling.drive {
            take(&history.drive, lags, drive);
        }
        take(&history.force_n, force_lags, force);
        complete
    }

    /// The normalised output for normalised `inputs`.
    #[inline(always)]
    pub(crate) fn forward(&self, inputs: &[f64]) -> f64 {
        if self.structure.has_input_neurons() {
            let neurons = self.input_neurons(inputs);
            self.hidden_and_output(&neurons[..self.inputs]).0
        } else {
            self.hidden_and_output(inputs).0
        }
    }

    /// g, the values of the neurons in the input layer.
    #[inline(always)]
    fn input_neurons(&self, inputs: &[f64]) -> [f64; INPUT_LANES] {
        let mut neurons = self.input_bias;
        for ((neuron, gain), input) in neurons.iter_mut().zip(&self.input_gain).zip(inputs) {
            *neuron += gain * input;
        }
        for value in &mut neurons {
            *value = tanh_in_lanes(*value);
        }
        neurons
    }

    /// The normalised output for the values `inputs` of the input layer, and the values of the hidden neurons.
    #[inline(always)]
    fn hidden_and_output(&self, inputs: &[f64]) -> (f64, [f64; LANES]) {
        let lanes = self.structure.hidden().next_multiple_of(PER_VECTOR);
        let mut hidden = self.hidden_bias;
        for (input, weights) in inputs.iter().zip(&self.hidden) {
            for (sum, weight) in hidden[..lanes].iter_mut().zip(&weights[..lanes]) {
                *sum += input * weight;
            }
        }
        for value in &mut hidden[..lanes] {
            *value = tanh_in_lanes(*value);
        }
        let mut sums = [0.0; PER_VECTOR];
        for (values, weights) in
            hidden[..lanes].chunks_exact(PER_VECTOR).zip(self.output.chunks_exact(PER_VECTOR))
        {
            for ((value, weight), sum) in values.iter().zip(weights).zip(&mut sums) {
                *sum += *value * weight;
            }
        }
        (sums.iter().sum::<f64>() + self.output_bias, hidden)
    }

    /// The normalised output for normalised `inputs`, with its derivatives by every weight (in the order of
    /// [`Network::new`]) and by every input, computed by back-propagation.
    ///
    /// ```text
    /// d/dc_j = h_j      d/dc_0 = 1      delta_j = c_j (1 - h_j^2)
    /// d/dW_ji = delta_j g_i      d/db_j = delta_j      d/dg_i = sum_j delta_j W_ji
    /// d/dd_i = (1 - g_i^2) d/dg_i      d/da_i = u_i d/dd_i      d/du_i = a_i d/dd_i
    /// ```
    ///
    /// Without neurons in the input layer g_i is u_i.
    ///
    /// # Panics
    /// When a slice is shorter than the number of inputs or weights.
    #[inline(always)]
    pub(crate) fn gradient(&self, inputs: &[f64], by_weight: &mut [f64], by_input: &mut [f64]) -> f64 {
        let count = self.structure.hidden();
        let inputs = &inputs[..self.inputs];
        let neurons = self.structure.has_input_neurons().then(|| self.input_neurons(inputs));
        let values = neurons.as_ref().map_or(inputs, |neurons| &neurons[..self.inputs]);
        let (output, hidden) = self.hidden_and_output(values);
        let mut delta = [0.0; LANES];
        for ((delta, value), weight) in delta.iter_mut().zip(&hidden).zip(&self.output) {
            *delta = weight * (1.0 - value * value);
        }
        let mut rows = by_weight.chunks_exact_mut(count);
        for ((value, weights), by_input) in values.iter().zip(&self.hidden).zip(by_input.iter_mut()) {
            let mut sums = [0.0; PER_VECTOR];
            for (weights, delta) in weights.chunks_exact(PER_VECTOR).zip(delta.chunks_exact(PER_VECTOR)) {
                for ((sum, weight), delta) in sums.iter_mut().zip(weights).zip(delta) {
                    *sum += weight * delta;
                }
            }
            *by_input = sums.iter().sum();
            for (to, delta) in rows.next().into_iter().flatten().zip(&delta) {
                *to = value * delta;
            }
        }
        for values in [&delta, &hidden] {
            for (to, value) in rows.next().into_iter().flatten().zip(values) {
                *to = *value;
            }
        }
        let at = count * (self.inputs + 2);
        by_weight[at] = 1.0;
        if let Some(neurons) = neurons {
            let (by_gain, by_bias) = by_weight[at + 1..].split_at_mut(self.inputs);
            for (i, by_input) in by_input[..self.inputs].iter_mut().enumerate() {
                let slope = *by_input * (1.0 - neurons[i] * neurons[i]);
                (by_gain[i], by_bias[i]) = (inputs[i] * slope, slope);
                *by_input = self.input_gain[i] * slope;
            }
        }
        output
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_dual::{Dual64, DualNum};
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    const ONE: Normalisation = Normalisation { mean: 0.0, deviation: 1.0 };

    fn network(structure: NetworkStructure, driven: bool, seed: u64) -> Network {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let weights: Vec<f64> =
            (0..structure.weights(driven)).map(|_| 2.0 * random.random::<f64>() - 1.0).collect();
        let scaling = NetworkScaling {
            displacement_m: Normalisation { mean: 0.001, deviation: 0.005 },
            velocity_m_s: Normalisation { mean: -0.01, deviation: 0.1 },
            drive: driven.then_some((DriveKind::CoilCurrent, Normalisation { mean: 0.8, deviation: 0.5 })),
            force_deviation_n: 400.0,
        };
        Network::new(structure, scaling, &weights, Second(1.0 / 512.0), 35.0).expect("a network")
    }

    /// The equation at the head of this file, for any number type.
    fn by_the_equation<D: DualNum + Copy>(structure: NetworkStructure, weights: &[D], inputs: &[D]) -> D {
        let (n, hidden) = (inputs.len(), structure.hidden());
        let first = hidden * (n + 2) + 1;
        let neuron = |i: usize| match structure {
            NetworkStructure::WangLiao => (weights[first + i] * inputs[i] + weights[first + n + i]).tanh(),
            NetworkStructure::Narx | NetworkStructure::Chen => inputs[i],
        };
        let inputs: Vec<D> = (0..n).map(neuron).collect();
        (0..hidden).fold(weights[hidden * (n + 2)], |sum, j| {
            let z = (0..n).fold(weights[hidden * n + j], |z, i| z + weights[hidden * i + j] * inputs[i]);
            sum + weights[hidden * (n + 1) + j] * z.tanh()
        })
    }

    #[test]
    fn gradient_agrees_with_the_equation() {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        for structure in NetworkStructure::ALL {
            for driven in [false, true] {
                let network = network(structure, driven, 7);
                let (n, weights) = (structure.inputs(driven), network.weights());
                let inputs: Vec<f64> = (0..n).map(|_| 3.0 * random.random::<f64>() - 1.5).collect();
                let (mut by_weight, mut by_input) = (vec![0.0; weights.len()], vec![0.0; n]);
                let output = network.gradient(&inputs, &mut by_weight, &mut by_input);
                for which in 0..weights.len() + n {
                    let dual = |(k, value): (usize, &f64)| Dual64::new(*value, f64::from(k == which));
                    let weights: Vec<Dual64> = weights.iter().enumerate().map(dual).collect();
                    let inputs: Vec<Dual64> =
                        inputs.iter().enumerate().map(|(k, v)| dual((k + by_weight.len(), v))).collect();
                    let truth = by_the_equation(structure, &weights, &inputs);
                    let found = by_weight.iter().chain(&by_input).nth(which).expect("as many");
                    assert!((truth.eps - found).abs() < 1e-13, "{structure:?} {which}: {truth} {found}");
                    assert!((truth.re - output).abs() < 1e-13);
                }
            }
        }
    }

    #[test]
    fn the_vectors_of_the_processor_change_no_bit() {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        for structure in NetworkStructure::ALL {
            let network = network(structure, true, 13);
            let (n, count) = (network.inputs(), network.parameter_count());
            for _ in 0..1000 {
                let inputs: Vec<f64> = (0..n).map(|_| 8.0 * random.random::<f64>() - 4.0).collect();
                let (mut by_weight, mut by_input) =
                    ([vec![0.0; count], vec![0.0; count]], [[0.0; MAX_NETWORK_INPUTS]; 2]);
                let in_pairs = network.gradient(&inputs, &mut by_weight[0], &mut by_input[0]);
                let in_widest = widest(
                    #[inline(always)]
                    || network.gradient(&inputs, &mut by_weight[1], &mut by_input[1]),
                );
                assert_eq!(in_pairs.to_bits(), in_widest.to_bits(), "{structure:?}");
                assert_eq!((&by_weight[0], by_input[0]), (&by_weight[1], by_input[1]), "{structure:?}");
            }
        }
    }

    #[test]
    fn prediction_normalises_and_orders_the_lags() {
        for structure in NetworkStructure::ALL {
            let network = network(structure, true, 11);
            let history = History {
                force_n: [100.0, -50.0, 25.0, 310.0, 8.0],
                displacement_m: [0.001, 0.002, -0.003, 0.004, 0.0],
                velocity_m_s: [0.05, 0.04, 0.03, -0.02, 0.2],
                drive: [0.5, 1.0, 1.5, 2.0, 0.1],
            };
            let (p, r) = (structure.input_lags(), structure.force_lags());
            let inputs: Vec<f64> = history.displacement_m[..p]
                .iter()
                .map(|x| (x - 0.001) / 0.005)
                .chain(history.velocity_m_s[..p].iter().map(|v| (v + 0.01) / 0.1))
                .chain(history.drive[..p].iter().map(|i| (i - 0.8) / 0.5))
                .chain(history.force_n[..r].iter().map(|f| (f - 35.0) / 400.0))
                .collect();
            let truth = 35.0 + 400.0 * by_the_equation(structure, &network.weights(), &inputs);
            let found = network.predict_n(&history).expect("all is known");
            assert!((found - truth).abs() < 1e-9, "{found} {truth}");
            let unknown = History { force_n: [f64::NAN; DEPTH], ..history };
            assert_eq!(network.predict_n(&unknown), None);
        }
    }

    #[test]
    fn invalid_networks_are_refused() {
        let scaling =
            NetworkScaling { displacement_m: ONE, velocity_m_s: ONE, drive: None, force_deviation_n: 1.0 };
        let make = |scaling, count: usize, weight: f64| {
            Network::new(NetworkStructure::Narx, scaling, &vec![weight; count], Second(0.002), 0.0)
        };
        assert!(make(scaling, 256, 0.1).is_ok());
        let text = make(scaling, 255, 0.1).expect_err("too few").to_string();
        assert_eq!(text, "weights has 255 values, but 256 are needed");
        let text = make(scaling, 256, f64::NAN).expect_err("not finite").to_string();
        assert!(text.contains("weights[0] is NaN"), "{text}");
        let still = Normalisation { deviation: 0.0, ..ONE };
        let text = make(NetworkScaling { displacement_m: still, ..scaling }, 256, 0.1).expect_err("still");
        assert!(text.to_string().contains("displacement_deviation_m is 0"), "{text}");
    }

    proptest! {
        #[test]
        fn weights_are_restored(seed: u64, driven: bool) {
            for structure in NetworkStructure::ALL {
                let network = network(structure, driven, seed);
                prop_assert_eq!(network.with_weights(&network.weights()), network);
                prop_assert_eq!(network.weights().len(), structure.weights(driven));
            }
        }
    }
}
