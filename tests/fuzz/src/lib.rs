//! Shared by the fuzz targets: an allocator with a limit, a directory for files, and checks of everything that was read.

use cap::Cap;
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Event, Models, Pipeline, Settings, Validity};
use mr_damper_model::sample::{DriveKind, Run, Sample, Trace};
use mr_damper_node::settings::config::{Config, Damper, RosArgs, TABLE, Value, dampers};
use mr_damper_runs::{LoadOptions, Loaded, Map, RunError, SaveOptions, load, save};
use std::alloc::System;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use tempfile::TempDir;

/// Bytes that a target may have allocated at once. It includes the 32 MiB that a compressed chunk may always use. Inputs are a
/// thousand times smaller, so code that allocates more has trusted a length field.
const MEMORY_LIMIT: usize = 128 << 20;

/// Counts all allocations of Rust code; for SQLite and zstd there is libFuzzer's `-rss_limit_mb`.
#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, MEMORY_LIMIT);

/// Directory for inputs that are read as files; below `TMPDIR`, which `run.sh` places in memory.
static SCRATCH: LazyLock<TempDir> = LazyLock::new(|| tempfile::tempdir().expect("a temporary directory"));

/// A path in this process's directory.
#[must_use]
pub fn scratch(name: &str) -> PathBuf {
    SCRATCH.path().join(name)
}

/// Writes `bytes` to the file `name` of this process, and returns its path.
#[must_use]
pub fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let path = scratch(name);
    std::fs::write(&path, bytes).expect("the temporary directory is writable");
    path
}

/// Loads a run; if both drives were recorded, with the current.
///
/// # Errors
/// As [`load`]; checks that the error names the file.
pub fn load_run(path: &Path, options: &LoadOptions) -> Result<Loaded, RunError> {
    let loaded = match load(path, options) {
        Err(RunError::BothDrives { .. }) => {
            load(path, &LoadOptions { drive: Some(DriveKind::CoilCurrent), ..options.clone() })
        }
        other => other,
    };
    match &loaded {
        Ok(loaded) => check_run(&loaded.run),
        Err(error) => {
            let text = error.to_string();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            assert!(text.contains(&*name), "the error does not name {name}: {text}");
        }
    }
    loaded
}

/// A DBC file with the messages of the seeds.
const DBC: &str = r#"VERSION ""
BO_ 288 SUSP_FL: 8 ECU
 SG_ Position : 0|16@1- (0.01,0.5) [0|0] "mm" ECU
 SG_ Page M : 16|8@1+ (1,0) [0|0] "" ECU
 SG_ Oil m1 : 24|16@1- (0.1,-40) [0|0] "degC" ECU
BO_ 2566848513 RIG: 12 ECU
 SG_ Load : 7|32@0- (1,0) [0|0] "kN" ECU
 SG_ Coil : 32|64@1- (1,0) [0|0] "A" ECU
SIG_VALTYPE_ 2566848513 Load : 1;
SIG_VALTYPE_ 2566848513 Coil : 2;
"#;

/// Loads a log of a CAN bus by different maps, and checks each run.
pub fn check_log(name: &str, bytes: &[u8]) {
    let (path, dbc) = (file(name, bytes), file("car.dbc", DBC.as_bytes()));
    let maps = [
        &["displacement=SUSP_FL.Position", "measured_force=RIG.Load", "case_temperature=SUSP_FL.Oil"][..],
        &["displacement=RIG.Load,unit=mm,sign=-1", "coil_current=RIG.Coil"],
        &["displacement=Stroke"],
        &[],
    ];
    for (map, skip_bad_rows) in maps.into_iter().zip([false, true, false, true]) {
        let mappings = map.iter().map(|text| text.parse().expect("a mapping")).collect();
        let map = Map::new(mappings).expect("distinct");
        let options = LoadOptions { dbc: vec![dbc.clone()], map, skip_bad_rows, ..LoadOptions::default() };
        if let Ok(loaded) = load_run(&path, &options) {
            check_pipeline_of(&loaded.run);
            check_csv_of(&loaded.run);
        }
    }
}

/// Checks that a run has finite values, one value per stamp, and increasing stamps.
pub fn check_run(run: &Run) {
    assert!(!run.displacement_m.is_empty(), "a run without displacement");
    for (name, trace) in traces(run) {
        assert_eq!(trace.stamps.len(), trace.values.len(), "{name}");
        assert!(trace.values.iter().all(|value| value.is_finite()), "{name} is not finite");
        assert!(trace.stamps.is_sorted_by(|a, b| a < b), "the stamps of {name} do not increase");
    }
}

fn traces(run: &Run) -> impl Iterator<Item = (&str, &Trace)> {
    let known = [
        ("displacement_m", Some(&run.displacement_m)),
        ("velocity_m_s", run.velocity_m_s.as_ref()),
        ("force_n", run.force_n.as_ref()),
        ("drive", run.drive.as_ref().map(|(_, trace)| trace)),
        ("case_temp_c", run.case_temp_c.as_ref()),
        ("body_velocity_m_s", run.body_velocity_m_s.as_ref()),
        ("force_request_n", run.force_request_n.as_ref()),
    ];
    let known = known.into_iter().filter_map(|(name, trace)| Some((name, trace?)));
    known.chain(run.other.iter().map(|(name, trace)| (name.as_str(), trace)))
}

/// Runs a run through the pipeline of a published model, and checks that results are finite or marked as invalid.
pub fn check_pipeline_of(run: &Run) {
    static MODEL: LazyLock<Model> =
        LazyLock::new(|| mr_damper_model::preset::load("thesis/fuzzy-tanh/rp3-cs").expect("a preset"));
    run_pipeline(*MODEL, run.samples()).expect("a preset runs");
}

/// Runs samples through the pipeline of a model, and checks each event.
///
/// # Errors
/// If the model cannot run.
pub fn run_pipeline(
    model: Model,
    samples: impl Iterator<Item = Sample>,
) -> Result<(), mr_damper_model::Error> {
    let mut pipeline = Pipeline::new(Models::alone(model), Settings::default())?;
    let mut check = |event: Event| check_event(&event);
    for sample in samples {
        pipeline.step(&sample, &mut check);
    }
    Ok(())
}

fn check_event(event: &Event) {
    match event {
        Event::Estimate(estimate) => {
            let force_n = estimate.force.get();
            assert!(
                force_n.is_finite() || (force_n.is_nan() && estimate.validity == Validity::Invalid),
                "{estimate:?}"
            );
        }
        Event::Residual(residual) => {
            let numbers = [residual.measured, residual.predicted, residual.residual, residual.windowed_rsse];
            assert!(numbers.iter().all(|number| number.get().is_finite()), "{residual:?}");
        }
        Event::Command(commanded) => {
            let current_a = commanded.command.current.get();
            assert!(current_a.is_finite() && current_a >= 0.0, "{commanded:?}");
        }
        Event::Input(_) | Event::Refusal(_) | Event::Transition(_) | Event::Alarm(_) => {}
    }
}

/// Writes a run as CSV and reads it again: the result must be bit-identical, and writing it again gives the same text.
pub fn check_csv_of(run: &Run) {
    let [first, second] = ["first.csv", "second.csv"].map(scratch);
    let again = saved_and_loaded(run, &first).expect("what was read can be written as CSV");
    assert_same(run, &again);
    let _ = saved_and_loaded(&again, &second).expect("what was read can be written as CSV");
    let texts = [first, second].map(|path| std::fs::read(path).expect("written"));
    assert!(texts[0] == texts[1], "CSV changes when it is read and written again");
}

/// Writes a run as a bag of the storage that `name` implies, and reads it again, if a bag can hold its times.
pub fn check_bag_of(run: &Run, name: &str) {
    match saved_and_loaded(run, &scratch(name)) {
        Ok(again) => assert_same(run, &again),
        Err(RunError::Unwritable { .. }) => {}
        Err(error) => panic!("{error}"),
    }
}

fn saved_and_loaded(run: &Run, path: &Path) -> Result<Run, RunError> {
    // It may exist from a previous input.
    let _ = std::fs::remove_file(path);
    save(run, path, &SaveOptions::default())?;
    let options = LoadOptions { drive: run.drive_kind(), ..LoadOptions::default() };
    Ok(load(path, &options).unwrap_or_else(|error| panic!("our own file: {error}")).run)
}

/// Panics if two runs differ in more than their name and the order of unused columns.
fn assert_same(left: &Run, right: &Run) {
    let bits = |run: &Run| {
        let mut all: Vec<_> = traces(run)
            .map(|(name, trace)| {
                let values: Vec<u64> = trace.values.iter().map(|value| value.to_bits()).collect();
                (name.to_owned(), trace.stamps.clone(), values)
            })
            .collect();
        all.sort();
        (run.drive_kind().map(DriveKind::name), all)
    };
    assert_eq!(bits(left), bits(right));
}

/// Checks the configuration from `--config` and `--ros-args`: every setting is in its range, and a configuration file written from
/// it has the same settings.
pub fn check_config(file: Option<&Path>, args: &RosArgs) {
    let Ok(dampers) = dampers(file, args, &[]) else { return };
    assert!(!dampers.is_empty());
    for Damper { config, args } in dampers {
        assert!(args.namespace().starts_with('/'), "{}", args.namespace());
        let path = self::file("again.toml", toml_of(&config).as_bytes());
        let again = mr_damper_node::settings::config::dampers(Some(&path), &RosArgs::default(), &[]);
        let again = again.unwrap_or_else(|error| panic!("our own file: {error}"));
        let first = &again.first().expect("a damper").config;
        assert_eq!(Config { dampers: vec![], ..first.clone() }, Config { dampers: vec![], ..config });
    }
}

fn toml_of(config: &Config) -> String {
    let mut table = toml::Table::new();
    for parameter in TABLE.iter().filter(|parameter| parameter.name != "dampers") {
        let value = config.get(parameter.name).expect("in the table");
        assert_eq!(parameter.check(&value).expect("in its range"), value, "{}", parameter.name);
        table.insert(
            parameter.name.to_owned(),
            match value {
                Value::Bool(value) => value.into(),
                Value::Integer(value) => value.into(),
                Value::Double(value) => value.into(),
                Value::Text(value) => value.into(),
                Value::TextList(values) => values.into(),
                Value::DoubleList(values) => values.into(),
            },
        );
    }
    toml::to_string(&table).expect("TOML holds all of these")
}
