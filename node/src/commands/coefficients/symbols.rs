//! Symbols and units of the parameters in model files.
//!
//! The symbols are those of the equations in the module documentation of `model/src/force`.

use mr_damper_model::sample::DriveKind;
use mr_damper_model::units::unit_of_name;

/// Symbols of parameters by the name in the model file, in LaTeX's notation. The first matching line counts; a line without
/// models is for all.
const SYMBOLS: [(&[&str], &str, &str); 41] = [
    (&["arctan", "sp", "fuzzy-tanh"], "yield_force_n", "A_1"),
    (&["arctan", "sp", "fuzzy-tanh"], "post_yield_damping_n_s_m", "A_2"),
    (&["arctan", "sp", "fuzzy-tanh"], "pre_yield_slope_s_m", "A_3"),
    (&["arctan", "sp"], "coupling_velocity_m_s", "V_0"),
    (&["arctan", "sp"], "coupling_stroke_m", "X_0"),
    (&["fuzzy-tanh"], "coupling_per_s", "\\kappa"),
    (&["kwok"], "viscous_damping_n_s_m", "c"),
    (&["kwok"], "stiffness_n_m", "k"),
    (&["kwok"], "hysteresis_force_n", "\\alpha"),
    (&["kwok"], "steepness_s_m", "\\beta"),
    (&["kwok"], "loop_width", "\\delta"),
    (&["linear"], "damping_n_s_m", "c"),
    (&["linear"], "stiffness_n_m", "k"),
    (&["cesmeci-engin"], "post_yield_damping_n_s_m", "c_b"),
    (&["cesmeci-engin"], "yield_force_n", "f_y"),
    (&["cesmeci-engin"], "steepness_s_m", "k_p"),
    (&["cesmeci-engin"], "hysteretic_velocity_m_s", "v_0"),
    (&["cesmeci-engin"], "effective_mass_kg", "m"),
    (&["li"], "yield_force_n", "L_1"),
    (&["li"], "steepness_s_m", "L_2"),
    (&["li"], "hysteretic_velocity_m_s", "L_3"),
    (&["li"], "post_yield_damping_n_s_m", "L_4"),
    (&["li"], "stiffness_n_m", "k_r"),
    (&["choi"], "b0_n", "b_0"),
    (&["bouc-wen"], "high_velocity_damping_n_s_m", "c_0"),
    (&["bouc-wen"], "low_velocity_damping_n_s_m", "c_1"),
    (&["bouc-wen"], "high_velocity_stiffness_n_m", "k_0"),
    (&["bouc-wen"], "accumulator_stiffness_n_m", "k_1"),
    (&["bouc-wen"], "hysteresis_force_n", "\\alpha"),
    (&["bouc-wen"], "hysteresis_gamma_per_m", "\\gamma"),
    (&["bouc-wen"], "hysteresis_exponent", "n"),
    (&["bouc-wen"], "hysteresis_beta_per_m", "\\beta"),
    (&["bouc-wen"], "hysteresis_slope_per_m", "A"),
    (&[], "force_offset_n", "F_0"),
    (&[], "membership_centres_a", "c"),
    (&[], "membership_centres_v", "c"),
    (&[], "membership_sigma_a", "\\sigma"),
    (&[], "membership_sigma_v", "\\sigma"),
    (&[], "sample_period_s", "T_s"),
    (&["maxwell-slip"], "stiffness_n_m", "k"),
    (&["maxwell-slip"], "bristle_lengths_m", "d"),
];

/// First regressor of each list of an ARX model in its equation: F, x, v, drive.
const LAGS: [(&str, usize); 5] = [
    ("force_lags", 0),
    ("displacement_lags_n_m", 1),
    ("velocity_lags_n_s_m", 2),
    ("current_lags_n_a", 3),
    ("voltage_lags_n_v", 3),
];

/// The symbol of the parameter `key` at the place `indices` of its list; empty if the equation has none.
pub(super) fn symbol(model: &str, key: &str, indices: &[usize]) -> String {
    if let Some((_, block)) = LAGS.iter().find(|(name, _)| *name == key)
        && let [lag, rest @ ..] = indices
    {
        // a1 is the first coefficient of force; the thesis counts through all lists.
        let lags = if model == "savaresi" { 2 } else { 3 };
        return indexed(&format!("a_{{{}}}", block * lags + lag + 1), rest);
    }
    let (branch, base) = match (key.strip_prefix("rising_"), key.strip_prefix("falling_")) {
        (Some(base), _) => ("^{+}", base),
        (_, Some(base)) => ("^{-}", base),
        (None, None) => ("", key),
    };
    let power = base.strip_prefix('b').and_then(|rest| rest.split_once('_')).map(|(power, _)| power);
    let found = match power {
        Some(power) if model == "choi" => Some(format!("b_{power}")),
        _ => SYMBOLS
            .iter()
            .find(|(models, name, _)| *name == base && (models.is_empty() || models.contains(&model)))
            .map(|(.., symbol)| (*symbol).to_owned()),
    };
    found.map(|symbol| indexed(&symbol, indices) + branch).unwrap_or_default()
}

/// `symbol` with further indices: `A_1` at 2 is `A_{1,2}`.
fn indexed(symbol: &str, indices: &[usize]) -> String {
    if indices.is_empty() {
        return symbol.to_owned();
    }
    let place: Vec<String> = indices.iter().map(usize::to_string).collect();
    let place = place.join(",");
    match symbol.split_once('_') {
        Some((base, own)) => format!("{base}_{{{},{place}}}", own.trim_matches(['{', '}'])),
        None => format!("{symbol}_{{{place}}}"),
    }
}

/// The unit that the name `key` ends in, over a power of the drive.
pub(super) fn unit(key: &str, exponent: Option<(DriveKind, usize)>) -> String {
    let base = unit_of_name(key).unwrap_or_else(|| "1".to_owned());
    let Some((drive, power)) = exponent.filter(|(_, power)| *power > 0) else { return base };
    let of = drive.unit();
    let of = if power == 1 { of.to_owned() } else { format!("{of}^{power}") };
    format!("{base}/{of}")
}

/// The unit with this symbol of the model library, written as in the names of units here: `N s^2/m^2` for `N s²/m²`, and `1` for none.
pub(super) fn plain_unit(symbol: &str) -> String {
    match symbol {
        "" => "1".to_owned(),
        symbol => symbol.replace('²', "^2").replace('³', "^3"),
    }
}
