//! Files in and out, and what is said of broken ones.

use super::*;
use crate::preset;

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
