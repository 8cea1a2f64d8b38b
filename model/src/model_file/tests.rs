//! Files in and out, and what is said of broken ones.

use super::*;
use crate::force::{
    Arx, Dependence, FuzzySets, FuzzyTanh, Lazy, LazyMetric, LazyPoint, Lpv, Network, NetworkScaling,
    Normalisation,
};
use crate::preset;
use crate::units::Second;

fn file(name: &str) -> ModelFile {
    ModelFile { model: preset::load(name).expect("preset"), provenance: Provenance::default() }
}

fn error_of(text: &str) -> String {
    ModelFile::from_toml(text).expect_err("a broken file").to_string()
}

#[test]
fn every_preset_survives_the_file_bit_for_bit() {
    for name in preset::names() {
        let written = file(&name);
        let text = written.to_toml().expect("writes");
        let read = ModelFile::from_toml(&text).unwrap_or_else(|e| panic!("{name}: {e}\n{text}"));
        assert_eq!(read, written, "{name}");
    }
}

#[test]
fn a_wrong_unit_is_named_with_the_right_one() {
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
        ("effects = []", "effects = [{id = \"coil_lag\"}]", "effects holds 1 entries"),
    ] {
        assert!(text.contains(from), "the test must change the file: {from}");
        let message = error_of(&text.replace(from, to));
        assert!(message.contains(expected), "{to}: {message}");
    }
    let message = error_of("schema = ");
    assert!(message.contains("line 1"), "{message}");
}

/// A file with `force` in place of the preset's model.
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

/// A fuzzy-tanh model whose sets have each a width of its own.
fn of_unlike_widths() -> ForceModel {
    let ForceModel::FuzzyTanh(model) = file("thesis/fuzzy-tanh/rp3-cs").model.force else {
        panic!("a preset")
    };
    let sigmas = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7];
    let sets = FuzzySets::with_widths(model.drive(), model.sets().centres(), &sigmas).expect("sets");
    ForceModel::FuzzyTanh(FuzzyTanh::new(sets, model.functions(), 4.0).expect("a model"))
}

#[test]
fn models_that_learn_from_data_survive_the_file_bit_for_bit() {
    let savaresi = |drive| {
        Arx::savaresi([1.6, -0.7], [4e3, -3e3], [250.0, 80.0], drive, Second(0.002), 9.0).expect("a model")
    };
    let arx = [None, Some((DriveKind::CoilCurrent, [30.0, -4.0]))].map(|d| ForceModel::Arx(savaresi(d)));
    for force in networks().into_iter().chain(lazies()).chain(arx).chain(lpvs()).chain([of_unlike_widths()]) {
        let written = file_of(force);
        let text = written.to_toml().expect("writes");
        let read = ModelFile::from_toml(&text).unwrap_or_else(|e| panic!("{}: {e}\n{text}", force.name()));
        assert!(read == written, "{}", force.name());
    }
}

#[test]
fn a_broken_one_of_them_is_refused_by_name() {
    let text = |force: ForceModel| file_of(force).to_toml().expect("writes");
    let (network, lazy) = (text(networks()[1]), text(lazies()[1]));
    let (lpv, widths) = (text(lpvs()[0]), text(of_unlike_widths()));
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
    ] {
        assert!(text.contains(from), "the test must change the file: {from}");
        let message = error_of(&text.replacen(from, to, 1));
        assert!(message.contains(expected), "{to}: {message}");
    }
}
