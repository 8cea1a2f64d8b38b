//! Fragments of C code: which one needs which, and what of them goes where.

use crate::error::ExportError;
use crate::features::Features;
use crate::precision::Precision;

/// Fragments of a folder, by name.
macro_rules! fragments {
    ($list:ident in $folder:literal: $($name:literal)+) => {
        const $list: &[(&str, &str)] = &[$(($name, include_str!(concat!($folder, $name, ".c"))),)+];
    };
}

// Those of single precision that know how a number is stored, or how large its rounding error is. They stand in for those of the same
// name.
fragments! { SINGLE in "c/single/":
    "bits" "infinity" "has_minus" "exp" "exp_m1" "tanh" "tanh_in_lanes" "ln" "atan" "sin" "floor" "running_sum" "derivative_slope"
}

fragments! { ALL in "c/":
    "bits" "infinity" "has_minus" "sign" "max" "min" "clamp" "exp" "exp_m1" "tanh" "tanh_in_lanes" "ln" "ln_1p" "atan" "sin"
    "inputs" "gate" "timing" "low_pass" "derivative_backward" "derivative_three_point" "derivative_slope" "step"
    "sets" "weights_polynomial" "weights_fuzzy"
    "force_fuzzy_tanh" "force_slope"
    "law_sp" "law_bouc_wen" "law_kwok" "law_li" "law_cesmeci_engin" "law_choi" "law_arctan" "law_linear"
    "force_law" "force_law_polynomial" "force_law_fuzzy" "force_law_fuzzy_memory"
    "history" "regress" "force_arx" "force_lpv" "force_network"
    "slip" "force_slip" "force_slip_fuzzy" "force_lazy"
    "tsk_gaussian" "tsk_two_sided" "tsk_bell" "tsk_nearest" "tsk_trapezoid" "tsk_triangle" "tsk_share" "force_tsk"
    "finite" "running_sum" "elapsed" "elapsed_miss" "elapsed_by" "lag" "smooth_sign" "scaled" "play" "ring"
    "floor" "term_step" "term_bump" "resonator_state" "resonator" "terms"
    "effect_coil_lag" "effect_coil_lag_rise_fall" "effect_remanence" "effect_thermal_fade" "effect_gas_spring" "effect_inertia"
    "effect_friction" "effect_friction_own_scale" "effect_asymmetry" "effect_force_lag" "effect_series_spring"
    "spring_newton" "effect_sensor_delay_of_force" "effect_sensor_delay_of_displacement" "effect_deadzone"
    "effect_end_stop" "effect_load_cell_drift" "effect_position_dependence" "effect_velocity_saturation"
    "effect_anti_alias_mismatch"
    "inverse_request" "inverse_coil" "inverse_moment" "inverse_still" "inverse_solution" "inverse_ends" "inverse_search" "inverse_polynomial"
    "inverse_rules" "inverse_fuzzy" "inverse_surrogate" "inverse_network" "inverse_learned_rules" "inverse_learned" "inverse"
}

/// A fragment, taken apart.
#[derive(Debug, Clone)]
pub(crate) struct Fragment {
    pub(crate) name: &'static str,
    /// Its first comment.
    pub(crate) about: String,
    needs: Vec<String>,
    pub(crate) header: String,
    pub(crate) source: String,
    pub(crate) instance: String,
}

impl Fragment {
    /// The fragment called `name`.
    pub(crate) fn named(name: &str, precision: Precision) -> Result<Self, ExportError> {
        let fault = |what: &str| ExportError::Fragment { fragment: name.to_owned(), what: what.to_owned() };
        let own = if precision == Precision::Single { SINGLE } else { &[] };
        let (name, text) = own
            .iter()
            .chain(ALL)
            .find(|(known, _)| *known == name)
            .ok_or_else(|| fault("there is none of this name"))?;
        let mut own = Self {
            name,
            about: String::new(),
            needs: Vec::new(),
            header: String::new(),
            source: String::new(),
            instance: String::new(),
        };
        enum Part {
            About,
            Header,
            Source,
            Instance,
        }
        let mut part = Part::About;
        for line in text.lines() {
            let marker = line.trim().trim_start_matches("/*").trim_end_matches("*/").trim();
            match marker.split_whitespace().next() {
                Some("@needs") => own.needs = marker.split_whitespace().skip(1).map(str::to_owned).collect(),
                Some("@header") => part = Part::Header,
                Some("@source") => part = Part::Source,
                Some("@instance") => part = Part::Instance,
                _ => {
                    let target = match part {
                        Part::About => &mut own.about,
                        Part::Header => &mut own.header,
                        Part::Source => &mut own.source,
                        Part::Instance => &mut own.instance,
                    };
                    target.push_str(line);
                    target.push('\n');
                }
            }
        }
        if own.about.trim().is_empty() {
            return Err(fault("it begins without a comment"));
        }
        own.about = format!("{} */\n", own.about.trim_end().trim_end_matches("*/").trim_end());
        Ok(own)
    }
}

/// The fragments that `names` need, and themselves, each once and after all that it needs.
pub(crate) fn link(names: &[&str], precision: Precision) -> Result<Vec<Fragment>, ExportError> {
    fn add(
        name: &str,
        precision: Precision,
        depth: usize,
        linked: &mut Vec<Fragment>,
    ) -> Result<(), ExportError> {
        if linked.iter().any(|fragment| fragment.name == name) {
            return Ok(());
        }
        let fragment = Fragment::named(name, precision)?;
        if depth > ALL.len() {
            return Err(ExportError::Fragment {
                fragment: name.to_owned(),
                what: "it needs itself".to_owned(),
            });
        }
        for needed in &fragment.needs {
            add(needed, precision, depth + 1, linked)?;
        }
        linked.push(fragment);
        Ok(())
    }
    let mut linked = Vec::new();
    names.iter().try_for_each(|name| add(name, precision, 0, &mut linked))?;
    Ok(linked)
}

/// `text` with the conditions on our features resolved.
pub(crate) fn resolve(text: &str, features: &Features) -> Result<String, ExportError> {
    /// A condition that is open: ours with its value, or one of the compiler's.
    enum Open {
        Ours(bool),
        Compilers,
    }
    let mut open = Vec::new();
    let mut resolved = String::with_capacity(text.len());
    for line in text.lines() {
        let directive = line.trim_start();
        if let Some(name) = directive.strip_prefix("#if MRD_") {
            let value = features.get(name.trim()).ok_or_else(|| ExportError::Fragment {
                fragment: line.to_owned(),
                what: "there is no such feature".to_owned(),
            })?;
            open.push(Open::Ours(value));
            continue;
        }
        match (directive.split_whitespace().next(), open.last_mut()) {
            (Some("#if" | "#ifdef" | "#ifndef"), _) => open.push(Open::Compilers),
            (Some("#else"), Some(Open::Ours(value))) => {
                *value = !*value;
                continue;
            }
            (Some("#endif"), _) => {
                if let Some(Open::Ours(_)) = open.pop() {
                    continue;
                }
            }
            _ => {}
        }
        if open.iter().all(|condition| !matches!(condition, Open::Ours(false))) {
            resolved.push_str(line);
            resolved.push('\n');
        }
    }
    Ok(resolved)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All fragments with their precision.
    fn both() -> impl Iterator<Item = (&'static str, &'static str, Precision)> {
        let of = |list: &'static [(&str, &str)], precision| {
            list.iter().map(move |(name, text)| (*name, *text, precision))
        };
        of(ALL, Precision::Double).chain(of(SINGLE, Precision::Single))
    }

    #[test]
    fn each_fragment_is_well_formed_and_can_be_linked() {
        for (name, text, precision) in both() {
            let linked = link(&[name], precision).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(linked.last().map(|fragment| fragment.name), Some(name));
            let own = linked.last().expect("itself");
            assert!(own.about.starts_with("/* ") && own.about.ends_with("*/\n"), "{name}: {}", own.about);
            assert!(text.ends_with('\n'), "{name}");
        }
    }

    /// The functions that `text` defines: their names begin a line after the type.
    fn defined(text: &str) -> Vec<&str> {
        let heads = text.lines().filter(|line| line.starts_with("static ") && line.contains('('));
        heads.filter_map(|line| line.split('(').next()?.rsplit([' ', '*']).next()).collect()
    }

    #[test]
    fn each_fragment_needs_all_that_it_calls() {
        // Functions that the export writes for a model, or that a fragment leaves to another one.
        const GLUE: [&str; 23] = [
            "law_parameters",
            "law",
            "weights",
            "derivative_step",
            "low_pass_step",
            "timing_place",
            "force",
            "tsk_fire",
            "run_",
            "solve_",
            "terms_extrapolate",
            "tau_s",
            "newton_search",
            "moment_",
            "solve",
            "current_",
            "take_request",
            "begin",
            "without_forces",
            "command",
            "approach",
            "coil_tau_s",
            "learned_",
        ];
        for (name, text, precision) in both() {
            let linked = link(&[name], precision).expect("linked");
            let known: Vec<&str> =
                linked.iter().flat_map(|f| defined(&f.source)).chain(defined(text)).collect();
            let calls = text.split("mrd_").skip(1).filter_map(|rest| {
                let end = rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_')?;
                rest[end..].starts_with('(').then_some(&rest[..end])
            });
            for call in calls {
                let is_glue = GLUE.iter().any(|glue| call.starts_with(glue))
                    || ["step", "reset", "silent_current_a"].contains(&call);
                assert!(is_glue || known.contains(&format!("mrd_{call}").as_str()), "{name} calls {call}");
            }
        }
    }

    #[test]
    fn conditions_on_features_are_resolved_and_others_stay() {
        let mut features = Features::default();
        features.set("HAS_DRIVE", true);
        features.set("FILTERS", false);
        let text = "a\n#if MRD_HAS_DRIVE\nb\n#if MRD_FILTERS\nc\n#else\nd\n#endif\n#endif\n#ifdef X\ne\n#else\nf\n#endif\n";
        assert_eq!(resolve(text, &features).expect("known"), "a\nb\nd\n#ifdef X\ne\n#else\nf\n#endif\n");
        assert!(resolve("#if MRD_OTHER\n#endif\n", &features).is_err());
    }
}
