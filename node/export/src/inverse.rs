//! The parts of the source of an inverse controller.

use crate::features::Features;
use crate::parameter::CParameter;
use mr_damper_model::effect::{Effect, EffectModel};
use mr_damper_model::force::{ForceModel, Tsk, TskInput, TskSet};
use mr_damper_model::inverse::{InverseMap, InverseParts};
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
        });
        if coil.is_some() {
            fragments.push("inverse_coil");
        }
        fragments.push("inverse");
        Self { parts, fragments, kept, coil }
    }

    /// Sets the conditions of the fragments.
    pub(crate) fn set(&self, features: &mut Features, model: &Model) {
        let searches = self.parts.map == InverseMap::Search;
        let bare = self.kept.is_empty() && model.effects.terms().is_empty();
        for (name, value) in [
            ("INVERSE_HAS_COIL", self.coil.is_some()),
            ("INVERSE_RISE_FALL", self.has_rise_and_fall(model)),
            ("INVERSE_ADDS", !searches),
            ("INVERSE_BARE", bare),
            ("INVERSE_LINEAR", self.parts.linear),
            ("INVERSE_FOLDED", !self.parts.linear && self.parts.folded),
            ("INVERSE_BRACKET", !self.parts.linear && !self.parts.folded),
        ] {
            features.set(name, value);
        }
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
        }
        all
    }
}

/// The sets and conclusions of the rules.
fn fuzzy(rules: &Tsk) -> Vec<CParameter> {
    let mut all = Vec::new();
    let signals = [("displacement", "m", "m"), ("velocity", "m_s", "m/s"), ("force", "n", "N")];
    for (input, (name, suffix, unit)) in rules.inputs().iter().zip(signals) {
        let named = |what: &str| format!("inverse_{name}_{what}");
        let about = format!("inverse: normalisation of {name}");
        all.push(CParameter::scalar(named(&format!("mean_{suffix}")), unit, &about, input.mean()));
        all.push(CParameter::scalar(named(&format!("scale_{suffix}")), unit, &about, input.std_dev()));
        let about = format!("inverse: fuzzy sets of the normalised {name}: centre, sigma");
        all.push(CParameter::rows(named("sets"), "", about, input.len(), gaussians(input)));
    }
    let about = "inverse: of each rule, for displacement, velocity, force and one; the displacement's set varies slowest";
    all.push(CParameter::rows("inverse_conclusions", "", about, rules.rules(), rules.conclusions().to_vec()));
    all
}

/// Centre and width of each set.
fn gaussians(input: &TskInput) -> Vec<f64> {
    let numbers = |set| match set {
        TskSet::Gaussian { centre, sigma } => [centre, sigma],
        // The rules of an inverse have no other sets.
        _ => [f64::NAN; 2],
    };
    input.sets().flat_map(numbers).collect()
}
