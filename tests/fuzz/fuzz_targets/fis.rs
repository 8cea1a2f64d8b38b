//! MATLAB's `.fis`: written and read again, it is unchanged, and a system that forms a model survives the
//! model file.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_model::fis::{Fis, Scaling};
use mr_damper_model::force::{ForceModel, OutputScale, Signal, TskKind};
use mr_damper_model::{model_file::ModelFile, preset, sample::DriveKind};

fuzz_target!(|text: &str| {
    let fis = match Fis::parse(text) {
        Ok(fis) => fis,
        Err(error) => return assert!(error.to_string().starts_with("line "), "{error}"),
    };
    assert!(fis.conclusions.iter().all(|number| number.is_finite()), "{fis:?}");
    let written = fis.to_text();
    let again = Fis::parse(&written).unwrap_or_else(|error| panic!("our own text: {error}\n{written}"));
    assert_eq!(again, fis, "{written}");

    let signals = [Signal::Displacement, Signal::Velocity, Signal::Drive(DriveKind::CoilCurrent)];
    let scaling = Scaling {
        inputs: signals.into_iter().take(fis.inputs.len()).map(|signal| (signal, 0.0, 1.0)).collect(),
        output: OutputScale { mean_n: 0.0, std_dev_n: 1.0 },
        force_offset_n: 0.0,
    };
    if let Ok(tsk) = fis.model(TskKind::Anfis, &scaling) {
        assert_eq!(Fis::of(&tsk, "again").conclusions, fis.conclusions);
        let mut model = preset::load("thesis/anfis/rp3-cs").expect("a preset");
        model.force = ForceModel::Tsk(tsk);
        let file = ModelFile { model, provenance: Default::default() };
        if let Ok(text) = file.to_toml() {
            assert_eq!(ModelFile::from_toml(&text).unwrap_or_else(|error| panic!("{error}\n{text}")), file);
        }
    }
});
