//! Writing and reading of model files, and the errors for invalid files.

use super::*;
use crate::effect::term::{Argument, Form, Modulator, Term, Terms};
use crate::effect::{Effect, EffectModel, Effects};
use crate::force::{
    Arx, Dependence, FuzzySets, FuzzyTanh, Lazy, LazyMetric, LazyPoint, Lpv, MaxwellSlip, Network,
    NetworkScaling, Normalisation, SlipFunction, SlipGrid,
};
use crate::inverse_model::{FuzzyAxis, InverseFuzzy, InverseModel, InverseNetwork, InverseScaling};
use crate::preset;
use crate::units::Second;
use proptest::prelude::*;

fn file(name: &str) -> ModelFile {
    ModelFile { model: preset::load(name).expect("preset"), provenance: Provenance::default() }
}

fn error_of(text: &str) -> String {
    ModelFile::from_toml(text).expect_err("a broken file").to_string()
}

#[test]
fn every_preset_is_bit_identical_after_write_and_read() {
    for name in preset::names() {
        let written = file(&name);
        let text = written.to_toml().expect("writes");
        let read = ModelFile::from_toml(&text).unwrap_or_else(|e| panic!("{name}: {e}\n{text}"));
        assert_eq!(read, written, "{name}");
    }
}

#[test]
fn an_error_for_a_wrong_unit_names_the_right_one() {
    let text = file("thesis/fuzzy-tanh/rp3-cs").to_toml().expect("writes");
    let message = error_of(&text.replace("yield_force_n", "yield_force_lbf"));
    assert!(
        message.contains("parameters.yield_force_lbf is unknown; did you mean yield_force_n?"),
        "{message}"
    );
    let message = error_of(&text.replace("drive = \"current_a\"", "drive = \"command_v\""));
    assert!(message.contains("membership_centres_v and membership_sigma_v"), "{message}");
    let message = error_of(&text.replace("drive = \"current_a\"", "drive = \"current_ma\""));
    assert!(message.contains("current_ma") && message.contains("current_a"), "{message}");
}

#[test]
fn other_errors_name_the_key() {
    let text = file("thesis/fuzzy-tanh/rp3-cs").to_toml().expect("writes");
    for (from, to, expected) in [
        ("membership_sigma_a = 0.2", "membership_sigma_a = -0.2", "membership_sigma_a is -0.2"),
        ("membership_sigma_a = 0.2", "membership_sigma_a = nan", "membership_sigma_a is NaN"),
        ("mr-damper/model/1", "mr-damper/model/9", "schema is \"mr-damper/model/9\""),
        ("model = \"fuzzy-tanh\"", "model = \"fuzzy\"", "model is \"fuzzy\""),
        ("rate_hz = 512.0", "rate_hz = 0.0", "conditioning.rate_hz is 0"),
        ("cutoff_hz = 20.0", "cutoff_rad_s = 20.0", "cutoff_rad_s"),
        (
            "effects = []",
            "effects = [{id = \"coil_lg\"}]",
            "effects[0].id is \"coil_lg\"; did you mean coil_lag?",
        ),
    ] {
        assert!(text.contains(from), "the test must change the file: {from}");
        let message = error_of(&text.replace(from, to));
        assert!(message.contains(expected), "{to}: {message}");
    }
    let message = error_of("schema = ");
    assert!(message.contains("line 1"), "{message}");
}

/// A preset file whose model is replaced by `force`.
fn file_of(force: ForceModel) -> ModelFile {
    let preset = file("thesis/fuzzy-tanh/rp3-cs");
    ModelFile { model: Model { force, ..preset.model }, ..preset }
}

fn networks() -> Vec<ForceModel> {
    let mut all = Vec::new();
    for structure in NetworkStructure::ALL {
        for drive in [None, Some(DriveKind::CoilCurrent), Some(DriveKind::CommandVoltage)] {
            let weights: Vec<f64> =
                (0..structure.weights(drive.is_some())).map(|k| f64::from(k as u32).sin() / 3.0).collect();
            let scaling = NetworkScaling {
                displacement_m: Normalisation { mean: 1e-4, deviation: 0.006 },
                velocity_m_s: Normalisation { mean: -0.002, deviation: 0.07 },
                drive: drive.map(|kind| (kind, Normalisation { mean: 0.9, deviation: 0.6 })),
                force_deviation_n: 410.0,
            };
            let network = Network::new(structure, scaling, &weights, Second(1.0 / 512.0), 31.0);
            all.push(ForceModel::Network(network.expect("a network")));
        }
    }
    all
}

fn lazies() -> Vec<ForceModel> {
    let point = |k: u32| LazyPoint {
        displacement_m: 0.01 * f64::from(k).sin(),
        velocity_m_s: 0.2 * f64::from(7 * k).cos(),
        drive: 0.0,
        force_n: 300.0 * f64::from(3 * k).sin(),
    };
    let of = |drive: Option<DriveKind>| {
        let drive_scale = drive.map(|kind| (kind, 0.7));
        let points: Vec<LazyPoint> = (0..40)
            .map(|k| LazyPoint { drive: drive.map_or(0.0, |_| f64::from(k % 5) * 0.4), ..point(k) })
            .collect();
        let metric = LazyMetric { displacement_scale_m: 0.01, velocity_scale_m_s: 0.1, drive_scale };
        ForceModel::Lazy(Lazy::new(metric, [6, 14], &points, 12.5).expect("a model"))
    };
    vec![of(None), of(Some(DriveKind::CoilCurrent)), of(Some(DriveKind::CommandVoltage))]
}

fn lpvs() -> Vec<ForceModel> {
    let widths = FuzzySets::with_widths(DriveKind::CommandVoltage, &[0.0, 1.5, 2.0], &[0.5, 0.2, 0.1]);
    let polynomial = Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 2 };
    let of = |dependence| {
        let coefficients: Vec<f64> = (0..27).map(|k| f64::from(k).sin() * 30.0).collect();
        ForceModel::Lpv(Lpv::new(dependence, &coefficients, Second(0.002), -3.5).expect("a model"))
    };
    vec![of(polynomial), of(Dependence::Fuzzy(widths.expect("sets")))]
}

/// Maxwell-slip models over a current, over a voltage, and without a drive.
fn slips() -> Vec<ForceModel> {
    let sets = |drive| FuzzySets::with_widths(drive, &[0.0, 1.5, 2.0], &[0.5, 0.2, 0.1]).expect("sets");
    let function = |k: u32| SlipFunction {
        damping_slopes_n_s_m: std::array::from_fn(|j| (f64::from(k) + j as f64).sin().abs() * 900.0),
        bristle_forces_n: std::array::from_fn(|j| (f64::from(k) - j as f64).sin().abs() * 90.0),
        stiffness_n_m: -1e3 / f64::from(k + 3),
        set_offset_n: 7.0 / f64::from(k + 3),
    };
    let of = |drive: Option<DriveKind>| {
        let grid = SlipGrid::new([0.01, 0.03, 0.1], [5e-4, 1e-3, 2e-3, 4e-3, 8e-3]).expect("a grid");
        let functions: Vec<SlipFunction> = (0..if drive.is_some() { 3 } else { 1 }).map(function).collect();
        ForceModel::MaxwellSlip(MaxwellSlip::new(grid, drive.map(sets), &functions, -3.5).expect("a model"))
    };
    vec![of(Some(DriveKind::CoilCurrent)), of(Some(DriveKind::CommandVoltage)), of(None)]
}

/// A fuzzy-tanh model whose sets have different widths.
fn of_unlike_widths() -> ForceModel {
    let ForceModel::FuzzyTanh(model) = file("thesis/fuzzy-tanh/rp3-cs").model.force else {
        panic!("a preset")
    };
    let sigmas = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7];
    let sets = FuzzySets::with_widths(model.drive(), model.sets().centres(), &sigmas).expect("sets");
    ForceModel::FuzzyTanh(FuzzyTanh::new(sets, model.functions(), 4.0).expect("a model"))
}

#[test]
fn data_driven_models_are_bit_identical_after_write_and_read() {
    let savaresi = |drive| {
        Arx::savaresi([1.6, -0.7], [4e3, -3e3], [250.0, 80.0], drive, Second(0.002), 9.0).expect("a model")
    };
    let arx = [None, Some((DriveKind::CoilCurrent, [30.0, -4.0]))].map(|d| ForceModel::Arx(savaresi(d)));
    let delayed = |drive| {
        Arx::delayed([1.6, -0.7, 0.05], [4e3, -3e3, 1.0], [250.0, 80.0, -2.0], drive, Second(0.002), 9.0)
    };
    let voltage = Some((DriveKind::CommandVoltage, [30.0, -4.0, 1.5]));
    let arx = arx.into_iter().chain([None, voltage].map(|d| ForceModel::Arx(delayed(d).expect("a model"))));
    let data_driven = networks().into_iter().chain(lazies()).chain(arx).chain(lpvs()).chain(slips());
    for force in data_driven.chain([of_unlike_widths()]) {
        let written = file_of(force);
        let text = written.to_toml().expect("writes");
        let read = ModelFile::from_toml(&text).unwrap_or_else(|e| panic!("{}: {e}\n{text}", force.name()));
        assert!(read == written, "{}", force.name());
    }
}

#[test]
fn a_wang_liao_file_without_an_input_layer_is_a_narx_network() {
    for narx in networks().into_iter().filter(|force| force.name() == "narx") {
        let written = file_of(narx);
        let text = written.to_toml().expect("writes");
        assert!(text.contains("model = \"narx\"") && !text.contains("input_gains"), "{text}");
        let old = text.replace("model = \"narx\"", "model = \"wang-liao\"");
        let read = ModelFile::from_toml(&old).expect("reads");
        assert!(read == written, "the same numbers by the name narx");
    }
    let wang_liao = networks().into_iter().find(|force| force.name() == "wang-liao").expect("one");
    let text = file_of(wang_liao).to_toml().expect("writes");
    for (from, to, expected) in [
        ("input_gains = [", "input_gains = [0.5, ", "parameters.input_gains has 16 values"),
        ("input_gains", "input_gain", "did you mean input_gains?"),
        ("model = \"wang-liao\"", "model = \"narx\"", "parameters.input_gains has 15 values"),
    ] {
        let error = ModelFile::from_toml(&text.replacen(from, to, 1)).expect_err("refused").to_string();
        assert!(error.contains(expected), "{error}");
    }
    let line = text.lines().find(|line| line.starts_with("input_biases")).expect("a line");
    let error = ModelFile::from_toml(&text.replace(line, "")).expect_err("refused").to_string();
    assert!(error.contains("parameters.input_biases has 0 values"), "{error}");
}

#[test]
fn an_error_in_a_data_driven_model_names_the_key() {
    let text = |force: ForceModel| file_of(force).to_toml().expect("writes");
    let (network, lazy) = (text(networks()[1]), text(lazies()[1]));
    let (lpv, widths) = (text(lpvs()[0]), text(of_unlike_widths()));
    let (slip, passive) = (text(slips()[0]), text(slips()[2]));
    for (text, from, to, expected) in [
        (&network, "force_deviation_n = 410.0", "force_deviation_n = 0.0", "force_deviation_n is 0"),
        (&network, "force_deviation_n", "force_deviation_lbf", "did you mean force_deviation_n?"),
        (&network, "hidden_biases = [", "hidden_biases = [0.0, ", "hidden_biases has 16 values"),
        (&network, "hidden_weights = [[", "hidden_weights = [[0.0, ", "hidden_weights[0] has 21 values"),
        (&network, "current_mean_a", "voltage_mean_v", "current_mean_a and current_deviation_a"),
        (&network, "drive = \"current_a\"\n", "", "drive is absent"),
        (&lazy, "neighbours = [6, 14]", "neighbours = [6, 60]", "neighbours[1] is 60"),
        (&lazy, "points_force_n = [", "points_force_n = [0.0, ", "points_force_n has 41 values"),
        (&lpv, "force_lags = [[", "force_lags = [[0.0, ", "parameters.force_lags[1] has 3 values"),
        (
            &lpv,
            "velocity_lags_n_s_m = [[",
            "velocity_lags_n_s_m = [[0.0, ",
            "velocity_lags_n_s_m[0] has 4 values",
        ),
        (&lpv, "dependence = \"polynomial\"", "dependence = \"none\"", "drive is \"current_a\""),
        (&widths, "membership_sigma_a = [", "membership_sigma_a = [0.3, ", "membership_sigma_a has 8 values"),
        (&widths, "membership_sigma_a = [0.1", "membership_sigma_a = [0.0", "membership_sigma_a[0] is 0"),
        (&lazy, "current_scale_a", "voltage_scale_v", "current_scale_a and points_current_a"),
        (&slip, "stiffness_n_m = [", "stiffness_n_m = [0.0, ", "parameters.stiffness_n_m has 4 values"),
        (&slip, "bristle_forces_n = [[0.0", "bristle_forces_n = [[-1.0", "bristle_forces_n[0][0] is -1"),
        (&slip, "knot_speeds_m_s = [0.01", "knot_speeds_m_s = [0.05", "knot_speeds_m_s[1] is 0.03"),
        (&slip, "bristle_forces_n", "bristle_forces_lbf", "did you mean bristle_forces_n?"),
        (&slip, "drive = \"current_a\"\n", "", "drive is absent"),
        (&passive, "[parameters]", "drive = \"current_a\"\n[parameters]", "membership_centres_a"),
    ] {
        assert!(text.contains(from), "the test must change the file: {from}");
        let message = error_of(&text.replacen(from, to, 1));
        assert!(message.contains(expected), "{to}: {message}");
    }
}

/// An effect whose parameters lie at the given shares of their ranges.
fn effect_at(index: usize, shares: [f64; 2]) -> EffectModel {
    let effect = Effect::ALL[index % Effect::ALL.len()];
    let value = |(p, share): (&crate::effect::Parameter, f64)| p.range[0] + share * (p.range[1] - p.range[0]);
    let values: Vec<f64> = effect.parameters().iter().zip(shares).map(value).collect();
    EffectModel::new(effect, &values).expect("within range")
}

fn file_with(effects: &[EffectModel]) -> ModelFile {
    let plain = file("thesis/fuzzy-tanh/rp3-cs");
    let mut effects = effects.to_vec();
    effects.sort_by_key(|effect| effect.is_of_load_cell());
    let effects = Effects::new(&effects).expect("few enough");
    ModelFile { model: Model { effects, ..plain.model }, ..plain }
}

#[test]
fn effects_are_tables_in_order_of_application() {
    let lag = EffectModel::new(Effect::CoilLagRiseFall, &[0.005, 0.019]).expect("within range");
    let gas = EffectModel::new(Effect::GasSpring, &[1200.0]).expect("within range");
    let text = file_with(&[lag, gas]).to_toml().expect("writes");
    let effects: Vec<&str> = text.lines().skip_while(|l| *l != "[[effects]]").take(9).collect();
    assert_eq!(
        effects.join("\n"),
        "[[effects]]\nid = \"coil_lag\"\nform = \"rise_fall\"\ntau_rise_s = 0.005\ntau_fall_s = 0.019\n\n\
         [[effects]]\nid = \"gas_spring\"\nstiffness_n_m = 1200.0"
    );
    // Whole numbers may be written without a decimal point.
    let read = ModelFile::from_toml(&text.replace("1200.0", "1200")).expect("reads");
    assert_eq!(read, file_with(&[lag, gas]));
}

#[test]
fn terms_are_tables_after_the_effects() {
    let kind = (Modulator::Force, Argument::Time, Form::Step);
    let term = Term::new(kind, -0.126, &[11.5, 0.05], [0.0, 30.0]).expect("a term");
    let plain = file_with(&[EffectModel::new(Effect::GasSpring, &[1200.0]).expect("within range")]);
    let effects = plain.model.effects.with_terms(Terms::new(&[term]).expect("few enough"));
    let file = ModelFile { model: Model { effects, ..plain.model }, ..plain };
    let text = file.to_toml().expect("writes");
    let table = "[[effects]]\nid = \"term\"\nmodulator = \"force\"\nargument = \"time\"\nform = \"step\"\n\
                 confirmed_in = [0.0, 30.0]\nequation = \"F' = F (1 - 0.126 H(t - 11.5 s)),  t: time since the start\"\n\n\
                 [effects.parameters]\namount = -0.126\nat = 11.5\nwidth = 0.05\n\n\
                 [effects.units]\namount = \"\"\nat = \"s\"\nwidth = \"s\"\n";
    assert!(text.contains(table), "{text}");
    assert_eq!(ModelFile::from_toml(&text).expect("reads"), file);
    for (from, to, expected) in [
        ("\"force\"", "\"forse\"", "effects[1].modulator is \"forse\"; did you mean force?"),
        ("\"step\"", "\"steps\"", "effects[1].form is \"steps\"; did you mean step?"),
        ("modulator =", "modulater =", "effects[1].modulater is unknown; did you mean modulator?"),
        ("amount = -0.126\n", "", "effects[1].parameters.amount is missing"),
        ("width = 0.05", "widht = 0.05", "effects[1].parameters.widht is unknown; did you mean width?"),
        ("width = 0.05", "width = \"wide\"", "effects[1].parameters.width is \"wide\""),
        ("width = 0.05", "width = 0.0", "effects[1]: effect term: parameters must be finite, and widths"),
        ("at = \"s\"", "at = \"ms\"", "effects[1].units.at is \"ms\", but the number is in \"s\""),
        ("[0.0, 30.0]", "[0.0]", "effects[1].confirmed_in is [0.0], not two numbers"),
    ] {
        let error = ModelFile::from_toml(&text.replace(from, to)).expect_err(to).to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn an_error_in_an_effect_names_the_key() {
    let text = file("thesis/fuzzy-tanh/rp3-cs").to_toml().expect("writes");
    let passive = "[[effects]]\nid = \"remanence\"\nhalf_width_drive = 0.1";
    for (effects, expected) in [
        (
            "[[effects]]\nid = \"coil_lg\"",
            "effects[0].id is \"coil_lg\"; did you mean coil_lag? (known are coil_lag, remanence,",
        ),
        ("[[effects]]\nid = 3", "effects[0].id is 3, not a string in quotes"),
        ("[[effects]]\ntau_s = 0.01", "effects[0].id is missing"),
        ("[[effects]]\nid = \"coil_lag\"\ntau_s = 0.01", "coil_lag needs form, one of one_tau, rise_fall"),
        (
            "[[effects]]\nid = \"force_lag\"\nform = \"two_pole\"",
            "but force_lag has the forms first_order, series_spring",
        ),
        ("[[effects]]\nid = \"inertia\"\nform = \"heavy\"", "inertia has one form only"),
        (
            "[[effects]]\nid = \"friction\"\nform = \"coulomb\"",
            "form is \"coulomb\", but friction has no form, or the form own_scale",
        ),
        (
            "[[effects]]\nid = \"friction\"\nfriction_lbf = 3",
            "effects[0].friction_lbf is unknown; did you mean friction_n?",
        ),
        ("[[effects]]\nid = \"friction\"", "effects[0].friction_n is missing"),
        (
            "[[effects]]\nid = \"friction\"\nfriction_n = \"3\"",
            "effects[0].friction_n is \"3\", not a number",
        ),
        ("[[effects]]\nid = \"friction\"\nfriction_n = -3", "friction_n is -3, but must be"),
        (
            "[[effects]]\nid = \"coil_lag\"\nform = \"one_tau\"\ntau_s = 3",
            "tau_s is 3, but must be 0 to 0.04",
        ),
        ("[[effects]]\nid = \"friction\"\nfriction_n = nan", "friction_n is NaN"),
        (
            "[[effects]]\nid = \"friction\"\nfriction_n = 3\n[[effects]]\nid = \"end_stop\"\nstiffness_n_m = 1e5\nclearance_m = -1",
            "effects[1]: effect end_stop: clearance_m is -1, but must be finite and at least 0",
        ),
        (passive.repeat(4).replace("0.1[[", "0.1\n[[").as_str(), "effects has 4 values, but at most 3"),
        (
            "[[effects]]\nid = \"sensor_delay\"\ndelay_s = 1e-3\n[[effects]]\nid = \"friction\"\nfriction_n = 3",
            "effect friction comes after sensor_delay",
        ),
        ("effects = 3", "effects"),
    ] {
        let message = error_of(&text.replace("effects = []", effects));
        assert!(message.contains(expected), "{effects}: {message}");
    }
    let passive_model = file("thesis/sp-passive/rp3-cs");
    let text = passive_model.to_toml().expect("writes").replace("effects = []", passive);
    assert!(error_of(&text).contains("effect remanence acts on the drive, but the sp model has none"));
}

proptest! {
    #[test]
    fn any_effects_are_bit_identical_after_write_and_read(
        chosen in prop::collection::vec((0..Effect::ALL.len(), 0.0..=1.0f64, 0.0..=1.0f64), 0..=3),
    ) {
        let effects: Vec<EffectModel> = chosen.iter().map(|(index, a, b)| effect_at(*index, [*a, *b])).collect();
        let written = file_with(&effects);
        let read = ModelFile::from_toml(&written.to_toml().expect("writes"));
        prop_assert_eq!(read, Ok(written));
    }

    /// A file with a random defect gives an error or a model that can be written again, but never a panic.
    #[test]
    fn a_random_defect_gives_an_error_or_a_model(
        index in 0..Effect::ALL.len(),
        at in 0.0..1.0f64,
        length in 0..12_usize,
        put in prop::sample::select(vec!["", "-", "9", "nan", "inf", "1e400", "\"", "[", "]", "\n", "= ", "_", "é", "[[effects]]\n"]),
    ) {
        let text = file_with(&[effect_at(index, [0.5, 0.5]), effect_at(index + 5, [0.3, 0.9])]).to_toml().expect("writes");
        let (from, to) = (text.find("[[effects]]").expect("there"), text.find("[parameters]").expect("there"));
        let start = from + ((to - from) as f64 * at) as usize;
        let broken = format!("{}{put}{}", &text[..start], &text[(start + length).min(to)..]);
        if let Ok(read) = ModelFile::from_toml(&broken) {
            prop_assert_eq!(ModelFile::from_toml(&read.to_toml().expect("writes")), Ok(read));
        }
    }
}

/// Each kind of learned inverse, with different numbers in each place.
fn inverses() -> [InverseModel; 3] {
    let networks = [NetworkStructure::Narx, NetworkStructure::Chen].map(|structure| {
        let weights: Vec<f64> =
            (0..structure.weights(true)).map(|k| (f64::from(k as u32) * 0.7).sin() / 3.0).collect();
        let scaling = InverseScaling {
            displacement_m: Normalisation { mean: 1e-4, deviation: 0.006 },
            velocity_m_s: Normalisation { mean: -0.002, deviation: 0.07 },
            force_n: Normalisation { mean: 11.0, deviation: 410.0 },
            current_a: Normalisation { mean: 0.9, deviation: 0.6 },
        };
        let network = InverseNetwork::new(structure, scaling, &weights, Second(1.0 / 512.0));
        InverseModel::Network(network.expect("a network"))
    });
    let axis =
        |mean, std_dev| FuzzyAxis { mean, std_dev, centres: [-1.1, 0.2, 1.3], sigmas: [0.5, 0.6, 0.7] };
    let axes = [axis(0.01, 0.1), axis(-0.3, 4.0), axis(20.0, 400.0)];
    let conclusions =
        std::array::from_fn(|r| std::array::from_fn(|m| (f64::from((4 * r + m) as u32) * 0.3).cos()));
    let rules = InverseFuzzy::new(axes, &conclusions, 1.1, 0.7).expect("rules");
    let [wang_liao, chen] = networks;
    [wang_liao, chen, InverseModel::Fuzzy(rules)]
}

#[test]
fn every_inverse_model_is_bit_identical_after_write_and_read() {
    let plain = file("thesis/fuzzy-tanh/rp3-cs");
    assert!(!plain.to_toml().expect("writes").contains("inverse_model"), "old readers read files without it");
    for inverse in inverses() {
        let written = ModelFile { model: Model { inverse: Some(inverse), ..plain.model }, ..plain.clone() };
        let text = written.to_toml().expect("writes");
        assert!(text.contains(&format!("[inverse_model]\nkind = \"{}\"", inverse.kind().name())), "{text}");
        let read = ModelFile::from_toml(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
        assert_eq!(read, written);
        assert_ne!(read, plain);
    }
}

#[test]
fn an_invalid_inverse_model_is_refused_with_its_key() {
    let plain = file("thesis/fuzzy-tanh/rp3-cs");
    let [wang_liao, chen, wang_hu] = inverses().map(|inverse| {
        let model = Model { inverse: Some(inverse), ..plain.model };
        ModelFile { model, ..plain.clone() }.to_toml().expect("writes")
    });
    for (text, from, to, expected) in [
        (
            &chen,
            "kind = \"chen\"",
            "kind = \"chan\"",
            "model file: inverse_model.kind is \"chan\", but must be chen, wang-liao or wang-hu",
        ),
        (&chen, "kind = \"chen\"\n", "", "model file: inverse_model.kind is missing"),
        (
            &chen,
            "current_mean_a",
            "current_mean_ma",
            "model file: inverse_model.current_mean_ma is unknown; did you mean current_mean_a?",
        ),
        (
            &chen,
            "kind = \"chen\"",
            "kind = \"wang-liao\"",
            "inverse_model.hidden_weights has 25 values, but 15 (one for each hidden neuron) are needed",
        ),
        (
            &wang_liao,
            "force_deviation_n = 410.0",
            "force_deviation_n = 0.0",
            "force_deviation_n is 0, but must be positive and finite",
        ),
        (
            &wang_liao,
            "sample_period_s = 0.001953125",
            "sample_period_s = -1.0",
            "sample_period_s is -1, but must be positive and finite",
        ),
        (
            &wang_hu,
            "force_centres = [-1.1, 0.2, 1.3]",
            "force_centres = [-1.1, 1.3]",
            "inverse_model.force_centres has 2 values, but 3 (one for each set) are needed",
        ),
        (
            &wang_hu,
            "current_std_dev_a = 0.7",
            "current_std_dev_a = nan",
            "current_std_dev_a is NaN, but must be positive and finite",
        ),
        (
            &wang_hu,
            "drive = \"current_a\"",
            "drive = \"command_v\"",
            "membership_centres_v and membership_sigma_v",
        ),
    ] {
        assert!(text.contains(from), "the test must change the file: {from}\n{text}");
        let message = error_of(&text.replacen(from, to, 1));
        assert!(message.contains(expected), "{to}: {message}");
    }
    let passive = file("thesis/sp-passive/rp-icps");
    let model = Model { inverse: Some(inverses()[0]), ..passive.model };
    let text = ModelFile { model, ..passive }.to_toml().expect("writes");
    assert_eq!(
        error_of(&text),
        "model file: inverse_model computes a coil current, so drive must be \"current_a\", but it is absent; remove the table \
         inverse_model"
    );
}
