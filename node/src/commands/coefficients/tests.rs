//! Tests of the table of coefficients.

use super::*;
use mr_damper_model::effect::term::{Argument, Form, Modulator, Terms};
use mr_damper_model::effect::{Effect, Effects};
use mr_damper_model::preset;

fn coefficients(name: &str) -> Vec<Coefficient> {
    of_model(&preset::load(name).expect(name)).expect(name)
}

fn named<'a>(all: &'a [Coefficient], name: &str) -> &'a Coefficient {
    all.iter().find(|it| it.name == name).unwrap_or_else(|| panic!("{name} is not in {all:?}"))
}

#[test]
fn symbols_and_units_are_those_of_the_equations() {
    for (preset, name, symbol, unit) in [
        ("thesis/fuzzy-tanh/rp3-cs", "yield_force_n[2]", "A_{1,2}", "N"),
        ("thesis/fuzzy-tanh/rp3-cs", "post_yield_damping_n_s_m[0]", "A_{2,0}", "N s/m"),
        ("thesis/fuzzy-tanh/rp3-cs", "pre_yield_slope_s_m[6]", "A_{3,6}", "s/m"),
        ("thesis/fuzzy-tanh/rp3-cs", "coupling_per_s[1]", "\\kappa_{1}", "1/s"),
        ("thesis/fuzzy-tanh/rp3-cs", "membership_centres_a[1]", "c_{1}", "A"),
        ("thesis/fuzzy-tanh/rp3-cs", "force_offset_n", "F_0", "N"),
        ("thesis/sp-semi-active/rp-icps", "yield_force_n[0]", "A_{1,0}", "N"),
        ("thesis/sp-semi-active/rp-icps", "yield_force_n[1]", "A_{1,1}", "N/A"),
        ("thesis/sp-semi-active/rp-icps", "post_yield_damping_n_s_m[2]", "A_{2,2}", "N s/m/A^2"),
        ("thesis/sp-passive/rp-icps", "coupling_stroke_m", "X_0", "m"),
        // Equation 4.4 of the thesis counts a1 to a12 through force, displacement, velocity and current.
        ("thesis/arx-semi-active/rp-icps", "force_lags[0]", "a_{1}", "1"),
        ("thesis/arx-semi-active/rp-icps", "displacement_lags_n_m[0]", "a_{4}", "N/m"),
        ("thesis/arx-semi-active/rp-icps", "velocity_lags_n_s_m[2]", "a_{9}", "N s/m"),
        ("thesis/arx-semi-active/rp-icps", "current_lags_n_a[2]", "a_{12}", "N/A"),
    ] {
        let all = coefficients(preset);
        let found = named(&all, name);
        assert_eq!((found.symbol.as_str(), found.unit.as_str()), (symbol, unit), "{preset} {name}");
    }
    assert_eq!(symbols::symbol("li", "falling_stiffness_n_m", &[1]), "k_{r,1}^{-}");
    assert_eq!(symbols::symbol("choi", "rising_b6_n_s6_m6", &[]), "b_6^{+}");
    assert_eq!(symbols::unit("rising_b6_n_s6_m6", None), "N s^6/m^6");
    assert_eq!(symbols::symbol("savaresi", "displacement_lags_n_m", &[0]), "a_{3}");
    assert_eq!(symbols::symbol("anfis", "conclusions", &[3, 1]), "");
}

#[test]
fn discovered_terms_are_numbered_and_each_number_has_its_unit() {
    let lag = Term::new(
        (Modulator::ForcePerDrive, Argument::DriveChange, Form::Linear),
        -0.688,
        &[],
        [-1.125, 0.99],
    );
    let decay = Term::new((Modulator::Force, Argument::Velocity, Form::Decay), -0.472, &[0.341], [-0.2, 0.2]);
    let both = [lag.expect("a term"), decay.expect("a term")];
    let mut model = preset::load("thesis/fuzzy-tanh/rp3-cs").expect("a preset");
    model.effects = Effects::NONE.with_terms(Terms::new(&both).expect("two terms"));
    let all = of_model(&model).expect("coefficients");
    for (name, value, unit) in [
        ("term[0].amount", -0.688, "A/A"),
        ("term[0].confirmed_in[0]", -1.125, "A"),
        ("term[1].amount", -0.472, "1"),
        ("term[1].scale", 0.341, "m/s"),
        ("term[1].confirmed_in[1]", 0.2, "m/s"),
    ] {
        let found = named(&all, name);
        assert_eq!((found.value, found.unit.as_str()), (value, unit), "{name}");
    }
    let equations = equations(&model);
    assert_eq!(equations.len(), 2);
    assert!(
        equations.iter().any(|equation| equation.starts_with("term[0]: i' = i - 0.688")),
        "{equations:?}"
    );
    // One term alone has no number.
    model.effects = Effects::NONE.with_terms(Terms::new(&both[..1]).expect("one term"));
    assert_eq!(named(&of_model(&model).expect("coefficients"), "term.amount").unit, "A/A");
}

#[test]
fn effects_have_the_units_of_the_library() {
    let mut model = preset::load("thesis/fuzzy-tanh/rp3-cs").expect("a preset");
    let spring = Effect::named("force_lag", Some("series_spring")).expect("an effect").example();
    model.effects = Effects::new(&[spring]).expect("one effect");
    let all = of_model(&model).expect("coefficients");
    assert_eq!(named(&all, "force_lag.compliance_m_n").unit, "m/N");
    assert_eq!(symbols::plain_unit("N s²/m²"), "N s^2/m^2");
    assert_eq!(symbols::plain_unit(""), "1");
}

#[test]
fn every_parameter_of_every_force_law_has_a_symbol() {
    use mr_damper_model::force::ForceLaw;
    for law in ForceLaw::ALL {
        for parameter in law.parameters() {
            assert_ne!(
                symbols::symbol(law.name(), parameter.name, &[]),
                "",
                "{} {}",
                law.name(),
                parameter.name
            );
        }
    }
}

#[test]
fn the_csv_holds_each_number_of_the_model_file_exactly() {
    let model = preset::load("thesis/sp-semi-active/rp3-cs").expect("a preset");
    let text = table(&of_model(&model).expect("coefficients"), Format::Csv, &["a note".to_owned()]);
    let mut lines = text.lines();
    assert_eq!((lines.next(), lines.next()), (Some("# a note"), Some("name,symbol,value,unit")));
    let file = ModelFile { model, provenance: Provenance::default() }.to_toml().expect("a file");
    let file: toml::Table = toml::from_str(&file).expect("TOML");
    let mut count = 0;
    for line in lines {
        // The symbol of an indexed parameter has a comma, so it is quoted.
        let (name, rest) = line.split_once(',').expect("cells");
        let rest = rest.strip_prefix('"').map_or_else(
            || rest.split_once(',').expect("symbol").1,
            |quoted| quoted.split_once("\",").expect("a closing quote").1,
        );
        let value: f64 = rest.split(',').next().and_then(|cell| cell.parse().ok()).expect(line);
        let (key, index) = name.split_once('[').unwrap_or((name, ""));
        let stored = &file["parameters"][key];
        let stored = match index.trim_end_matches(']').parse::<usize>() {
            Ok(index) => &stored[index],
            Err(_) => stored,
        };
        assert_eq!(stored.as_float(), Some(value), "{line}");
        count += 1;
    }
    assert_eq!(count, 1 + model.force.parameter_count(), "the offset and all coefficients");
}

#[test]
fn errors_get_columns_in_every_format() {
    let mut all = coefficients("thesis/sp-passive/rp-icps");
    all[1].standard_error = Some(0.25);
    all[1].bootstrap = Some(Scatter { standard_error: 12.5, interval: [1e-7, 2.0] });
    let note = ["the error covers one fit".to_owned()];
    for (format, parts) in [
        (Format::Text, ["2.5 %", "1.00000e-7", "the error covers one fit"]),
        (Format::Csv, ["bootstrap_low,bootstrap_high", ",0.0000001,2", "# the error covers one fit"]),
        (Format::Markdown, ["| 2.5 % | 97.5 % |", "| 1.00000e-7 | 2 |", "the error covers one fit"]),
        (Format::Latex, ["2.5 \\%", "$1.00000 \\times 10^{-7}$", "% the error covers one fit"]),
    ] {
        let text = table(&all, format, &note);
        for part in parts {
            assert!(text.contains(part), "{format:?}: {part}\n{text}");
        }
    }
}

#[test]
fn the_scatter_is_that_of_numpy() {
    // x = [3, 1, 4, 1, 5, 9, 2, 6]; numpy: x.std(ddof=1), quantile(x, [.025, .975])
    let scatter = Scatter::of(vec![3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0, 6.0]).expect("several");
    assert!((scatter.standard_error - 2.748_376_143_938_713).abs() < 1e-14, "{scatter:?}");
    assert!(
        (scatter.interval[0] - 1.0).abs() < 1e-14 && (scatter.interval[1] - 8.475).abs() < 1e-14,
        "{scatter:?}"
    );
    assert_eq!(Scatter::of(vec![1.0]), None);
}

#[test]
fn numbers_have_six_digits() {
    for (value, text) in [
        (0.0, "0"),
        (1_234.567_89, "1234.57"),
        (-0.001_234_567_8, "-0.00123457"),
        (2.0, "2"),
        (1e-9, "1.00000e-9"),
        (123_456_789.0, "1.23457e8"),
        (f64::NAN, "NaN"),
    ] {
        assert_eq!(short(value), text);
    }
    assert_eq!(Format::of(Path::new("a.tex")).ok(), Some(Format::Latex));
    assert!(
        Format::of(Path::new("a.xls")).is_err_and(|error| error.to_string().contains(".csv, .md or .tex"))
    );
}
