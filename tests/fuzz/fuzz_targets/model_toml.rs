//! A model file: written and read again, it is unchanged, and its pipeline gives finite numbers or marks the estimate invalid.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::run_pipeline;
use mr_damper_model::model_file::ModelFile;
use mr_damper_model::sample::{Drive, DriveKind, Reading, Sample, Stamp};
use mr_damper_model::units::{Celsius, Metre, MetrePerSecond, Newton};

fuzz_target!(|text: &str| {
    let Ok(read) = ModelFile::from_toml(text) else { return };
    let written = read.to_toml().expect("what was read can be written");
    let again =
        ModelFile::from_toml(&written).unwrap_or_else(|error| panic!("our own file: {error}\n{written}"));
    assert_eq!(again, read, "{written}");
    // A model may need inputs that this motion lacks, or more than a search can solve: then it is refused, without a panic.
    let _ = run_pipeline(read.model, motion(read.model.force.drive()));
});

/// A tenth of a second of a sine of 10 mm and 2 Hz at 500 Hz, with every measurable quantity and a requested force.
fn motion(drive: Option<DriveKind>) -> impl Iterator<Item = Sample> {
    let drive = drive.unwrap_or(DriveKind::CoilCurrent);
    (0..50_u32).flat_map(move |k| {
        let (t_s, stamp) = (f64::from(k) / 500.0, Stamp::from_nanos(i64::from(k) * 2_000_000));
        let phase = std::f64::consts::TAU * 2.0 * t_s;
        let (x_m, v_m_s) = (0.01 * phase.sin(), 0.1257 * phase.cos());
        [
            Reading::CaseTemperature(Celsius(30.0)),
            Reading::Drive(Drive::new(drive, 1.0 + 0.5 * phase.cos())),
            Reading::Velocity(MetrePerSecond(v_m_s)),
            Reading::Force(Newton(900.0 * (v_m_s * 20.0).tanh())),
            Reading::ForceRequest(Newton(600.0 * (v_m_s * 20.0).tanh())),
            Reading::Displacement(Metre(x_m)),
        ]
        .map(|reading| Sample { stamp, received: stamp, reading })
    })
}
