//! The parts of the source of an inverse controller.

use crate::features::Features;
use crate::parameter::CParameter;
use mr_damper_model::effect::{Effect, EffectModel};
use mr_damper_model::force::{ForceModel, Normalisation, Tsk, TskInput, TskSet};
use mr_damper_model::inverse::{
    FuzzyAxis, InverseFuzzy, InverseMap, InverseModel, InverseNetwork, InverseParts,
};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::Settings;

/// The inverse of a model.
#[derive(Debug)]
pub(crate) struct Inverse<'a> {
    parts: &'a InverseParts,
    /// Fragments, besides those that they need, in the order of the source.
    pub(crate) fragments: Vec<&'static str>,
    /// Indices of the model's effects that are in its model: effects of the damper without lags of the coil.
    pub(crate) kept: Vec<usize>,
    /// Index of the lag that the lead compensates: the outermost one.
    coil: Option<usize>,
}

impl<'a> Inverse<'a> {
    pub(crate) fn of(model: &Model, parts: &'a InverseParts) -> Self {
        let effects = model.effects.of_damper();
        let lags = |effect: &EffectModel| effect.effect().lags_drive();
        let of_damper = || effects.as_slice().iter().enumerate();
        let kept: Vec<usize> =
            of_damper().filter(|(_, effect)| !lags(effect)).map(|(index, _)| index).collect();
        let coil = of_damper().filter(|(_, effect)| lags(effect)).map(|(index, _)| index).next_back();
        let only_add = effects.terms().is_empty()
            && kept.iter().all(|index| effects.as_slice()[*index].effect().only_adds());
        let is_still = only_add && matches!(model.force, ForceModel::FuzzyTanh(_));
        let mut fragments = vec![if is_still { "inverse_still" } else { "inverse_moment" }];
        fragments.extend(match parts.map {
            InverseMap::Search => ["inverse_search"].as_slice(),
            InverseMap::Polynomial { .. } => &["inverse_polynomial", "inverse_surrogate"],
            InverseMap::Fuzzy { .. } => &["inverse_fuzzy", "inverse_surrogate"],
            InverseMap::Learned(InverseModel::Network(_)) => &["inverse_network", "inverse_learned"],
            InverseMap::Learned(InverseModel::Fuzzy(_)) => &["inverse_learned_rules", "inverse_learned"],
        });
        if coil.is_some() {
            fragments.push("inverse_coil");
        }
        fragments.push("inverse");
        Self { parts, fragments, kept, coil }
    }

    /// Sets the conditions of the fragments.
    pub(crate) fn set(&self, features: &mut Features, model: &Model) {
        let map = &self.parts.map;
        let bare = self.kept.is_empty() && model.effects.terms().is_empty();
        for (name, value) in [
            ("INVERSE_HAS_COIL", self.coil.is_some()),
            ("INVERSE_RISE_FALL", self.has_rise_and_fall(model)),
            ("INVERSE_ADDS", matches!(map, InverseMap::Polynomial { .. } | InverseMap::Fuzzy { .. })),
            ("INVERSE_CLIPS", !matches!(map, InverseMap::Search)),
            ("INVERSE_LEARNED", self.is_learned()),
            ("INVERSE_REMEMBERS", matches!(map, InverseMap::Learned(InverseModel::Network(_)))),
            ("INVERSE_BARE", bare),
            ("INVERSE_LINEAR", self.parts.linear),
            ("INVERSE_FOLDED", !self.parts.linear && self.parts.folded),
            ("INVERSE_BRACKET", !self.parts.linear && !self.parts.folded),
        ] {
            features.set(name, value);
        }
    }

    /// True for a learned inverse, which the search substitutes where it gives no current.
    pub(crate) const fn is_learned(&self) -> bool {
        matches!(self.parts.map, InverseMap::Learned(_))
    }

    /// Constants of the header, `MRD_` names without the prefix, and what they are.
    pub(crate) fn sizes(&self) -> Vec<(&'static str, usize, &'static str)> {
        let InverseMap::Learned(InverseModel::Network(network)) = &self.parts.map else {
            return Vec::new();
        };
        let structure = network.structure();
        vec![
            ("INVERSE_LAGS", structure.input_lags(), "samples of displacement, velocity and demanded force"),
            ("INVERSE_CURRENT_LAGS", structure.force_lags(), "past currents"),
            ("INVERSE_INPUTS", structure.inputs(true), "inputs of the inverse network"),
            ("INVERSE_HIDDEN", structure.hidden(), "hidden neurons of the inverse network"),
        ]
    }

    /// True if the coil has a time constant for each side.
    fn has_rise_and_fall(&self, model: &Model) -> bool {
        let effects = model.effects.of_damper();
        self.coil.is_some_and(|index| effects.as_slice()[index].parameters().len() == 2)
    }

    /// Fields of the time constants of the coil; `fields` has the fields of each effect.
    pub(crate) fn coil_fields<'f>(&self, fields: &[&'f [String]]) -> [&'f str; 2] {
        match self.coil.map(|index| fields[index]) {
            Some([rise, fall]) => [rise, fall],
            Some([both]) => [both, both],
            _ => ["", ""],
        }
    }

    /// The sum of the stiffnesses of gas springs as an expression.
    pub(crate) fn stiffness(&self, model: &Model, fields: &[&[String]]) -> String {
        let effects = model.effects.of_damper();
        let springs = effects.as_slice().iter().zip(fields);
        let springs = springs.filter(|(effect, _)| effect.effect() == Effect::GasSpring);
        let terms: Vec<String> = springs.map(|(_, fields)| format!("p->{}", fields[0])).collect();
        if terms.is_empty() { "0.0".to_owned() } else { terms.join(" + ") }
    }

    /// Its parameters.
    pub(crate) fn parameters(&self, settings: &Settings) -> Vec<CParameter> {
        let limits = &self.parts.limits;
        let rate_a_s = if limits.rate_max_a_s.is_finite() { limits.rate_max_a_s } else { 0.0 };
        let scalar = |name: &str, unit: &str, about: &str, value: f64| {
            CParameter::scalar(format!("inverse_{name}"), unit, format!("inverse: {about}"), value)
        };
        let mut all = vec![
            scalar("current_max_a", "A", "largest current", limits.current_max_a).within([1e-9, 100.0]),
            scalar("rate_max_a_s", "A/s", "largest change of the current; 0 for no limit", rate_a_s)
                .within([0.0, 1e9]),
            scalar("safe_a", "A", "current without a demand", limits.safe_a).within([0.0, 100.0]),
            scalar("safe_after_s", "s", "time to reach the safe current", limits.safe_after_s)
                .within([0.0, 60.0]),
            scalar("hold_m_s", "m/s", "speed below which the last current is held", limits.hold_m_s)
                .within([0.0, 1.0]),
            scalar(
                "request_timeout_s",
                "s",
                "age beyond which a request has expired",
                settings.request_timeout_s,
            )
            .within([1e-9, 3600.0]),
            scalar("force_most_n", "N", "largest force of the model", self.parts.most_n),
            CParameter::scalar(
                "force_max_n",
                "N",
                "inverse: requests beyond it are refused",
                settings.plausible.force_max_n,
            ),
        ];
        if self.coil.is_some() {
            let about = "time constant of the coil current with lead compensation";
            all.push(scalar("lead_s", "s", about, limits.lead_s).within([0.0, 60.0]));
        }
        match &self.parts.map {
            InverseMap::Search => {}
            InverseMap::Polynomial { fastest_m_s, rising, falling } => {
                all.push(scalar(
                    "fastest_m_s",
                    "m/s",
                    "velocity that the powers are scaled with",
                    *fastest_m_s,
                ));
                for (branch, when, [base, slope]) in
                    [("rising", "a >= 0", rising), ("falling", "a < 0", falling)]
                {
                    let name = |unit: &str| format!("inverse_{branch}_{unit}");
                    let about =
                        |what: &str| format!("inverse: {what} of the powers of the velocity for {when}");
                    all.push(CParameter::array(name("n"), "N", about("forces"), base));
                    all.push(CParameter::array(name("n_a"), "N/A", about("forces for 1 A"), slope));
                }
            }
            InverseMap::Fuzzy { rules, displacement_m, fastest_m_s } => {
                all.push(scalar("fastest_m_s", "m/s", "largest speed of the fit", *fastest_m_s));
                let about = "inverse: range of the fit, low and high";
                all.push(CParameter::array("inverse_displacement_range_m", "m", about, displacement_m));
                all.extend(fuzzy(rules));
            }
            InverseMap::Learned(InverseModel::Network(network)) => all.extend(learned_network(network)),
            InverseMap::Learned(InverseModel::Fuzzy(rules)) => all.extend(learned_rules(rules)),
        }
        all
    }
}

/// A signal of the inverse: its name, and its unit as the end of a name and as a symbol.
type SignalName = (&'static str, &'static str, &'static str);

const DISPLACEMENT: SignalName = ("displacement", "m", "m");
const VELOCITY: SignalName = ("velocity", "m_s", "m/s");
const ACCELERATION: SignalName = ("acceleration", "m_s2", "m/s2");
const FORCE: SignalName = ("force", "n", "N");
const CURRENT: SignalName = ("current", "a", "A");

/// Mean and scale of a signal.
fn scale((name, suffix, unit): SignalName, mean: f64, scale: f64) -> [CParameter; 2] {
    let about = format!("inverse: normalisation of {name}");
    let named = |what: &str| format!("inverse_{name}_{what}_{suffix}");
    [
        CParameter::scalar(named("mean"), unit, &about, mean),
        CParameter::scalar(named("scale"), unit, &about, scale),
    ]
}

/// Gaussian sets of a normalised signal: centre and width of each.
fn sets((name, _, _): SignalName, sets: &[[f64; 2]]) -> CParameter {
    let about = format!("inverse: fuzzy sets of the normalised {name}: centre, sigma");
    CParameter::rows(format!("inverse_{name}_sets"), "", about, sets.len(), sets.as_flattened().to_vec())
}

/// The sets and conclusions of the fitted rules.
fn fuzzy(rules: &Tsk) -> Vec<CParameter> {
    let mut all = Vec::new();
    for (input, signal) in rules.inputs().iter().zip([DISPLACEMENT, VELOCITY, FORCE]) {
        all.extend(scale(signal, input.mean(), input.std_dev()));
        all.push(sets(signal, &gaussians(input)));
    }
    let about = "inverse: of each rule, for displacement, velocity, force and one; the displacement's set varies slowest";
    all.push(CParameter::rows("inverse_conclusions", "", about, rules.rules(), rules.conclusions().to_vec()));
    all
}

/// The normalisation, sets and conclusions of learned rules.
fn learned_rules(rules: &InverseFuzzy) -> Vec<CParameter> {
    let mut all = Vec::new();
    for (axis, signal) in rules.axes().iter().zip([VELOCITY, ACCELERATION, FORCE]) {
        let FuzzyAxis { mean, std_dev, centres, sigmas } = *axis;
        let gaussians: Vec<[f64; 2]> =
            centres.iter().zip(sigmas).map(|(centre, sigma)| [*centre, sigma]).collect();
        all.extend(scale(signal, mean, std_dev));
        all.push(sets(signal, &gaussians));
    }
    let about =
        "inverse: of each rule, for velocity, acceleration, force and one; the velocity's set varies slowest";
    let conclusions = rules.conclusions();
    let flat = conclusions.as_flattened().to_vec();
    all.push(CParameter::rows("inverse_conclusions", "", about, conclusions.len(), flat));
    let [mean_a, std_dev_a] = rules.current_scale_a();
    all.extend(scale(CURRENT, mean_a, std_dev_a));
    all
}

/// The normalisation, weights and sample period of a learned network.
fn learned_network(network: &InverseNetwork) -> Vec<CParameter> {
    let (structure, scaling, weights) = (network.structure(), network.scaling(), network.weights());
    let (hidden, inputs) = (structure.hidden(), structure.inputs(true));
    let (matrix, rest) = weights.split_at(hidden * inputs);
    let (hidden_bias, rest) = rest.split_at(hidden);
    let (output, output_bias) = rest.split_at(hidden);
    let period_s = network.sample_period().get();
    let about = "inverse: sample period of the training";
    let mut all = vec![CParameter::scalar("inverse_sample_period_s", "s", about, period_s)];
    for (signal, Normalisation { mean, deviation }) in [
        (DISPLACEMENT, scaling.displacement_m),
        (VELOCITY, scaling.velocity_m_s),
        (FORCE, scaling.force_n),
        (CURRENT, scaling.current_a),
    ] {
        all.extend(scale(signal, mean, deviation));
    }
    let about = "inverse: W, by input and hidden neuron";
    all.extend([
        CParameter::rows("inverse_hidden_weights", "", about, inputs, matrix.to_vec()),
        CParameter::array("inverse_hidden_bias", "", "inverse: b", hidden_bias),
        CParameter::array("inverse_output_weights", "", "inverse: c", output),
        CParameter::scalar("inverse_output_bias", "", "inverse: c0", output_bias[0]),
    ]);
    all
}

/// Centre and width of each set.
fn gaussians(input: &TskInput) -> Vec<[f64; 2]> {
    let numbers = |set| match set {
        TskSet::Gaussian { centre, sigma } => [centre, sigma],
        // The rules of an inverse have no other sets.
        _ => [f64::NAN; 2],
    };
    input.sets().map(numbers).collect()
}
