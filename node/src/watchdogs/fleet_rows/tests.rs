//! Rows of a pipeline that runs, and files that cannot be written.

use super::*;
use mr_damper_model::effect::Effect;
use mr_damper_model::pipeline::{Models, Pipeline, Settings};
use mr_damper_model::preset;
use mr_damper_model::sample::{Drive, Reading, Sample};
use mr_damper_model::tracking::Quantity;
use mr_damper_model::units::{Ampere, Metre, Newton};

/// 2026-11-27, 8:59:58 in UTC.
const BEGIN_NS: i64 = 1_795_769_998_000_000_000;

fn value(quantity: Quantity, value: f64) -> EffectValue {
    EffectValue {
        stamp: Stamp::from_nanos(1_795_769_999_000_000_001),
        quantity,
        running: 1.0,
        value,
        ci95: [value - 0.5, value + 0.5],
        windows: 3,
        excitation: [0.0, 0.0, 0.25],
        changed: false,
    }
}

/// Four seconds of a triangle of 0.1 m/s at 1 A, with a force of zero, over the end of an hour. Returns the residuals.
fn run(rows: &mut FleetRows) -> Vec<f64> {
    let model = preset::load(preset::BEST_FUZZY_TANH).expect("a preset");
    let mut pipeline = Pipeline::new(Models::alone(model), Settings::default()).expect("good settings");
    let mut residuals_n = Vec::new();
    for step in 0..2000 {
        let t_s = 2e-3 * f64::from(step);
        let stamp = Stamp::from_nanos(BEGIN_NS + 2_000_000 * i64::from(step));
        let x_m = 0.1 * (0.25 - (t_s % 1.0 - 0.5).abs());
        for reading in [
            Reading::Drive(Drive::CoilCurrent(Ampere(1.2))),
            Reading::Force(Newton(0.0)),
            Reading::Displacement(Metre(x_m)),
        ] {
            pipeline.step(&Sample { stamp, received: stamp, reading }, &mut |event| {
                if let Event::Residual(residual) = event {
                    residuals_n.push(residual.residual.get());
                }
                rows.take(&event, None);
            });
        }
    }
    residuals_n
}

fn read(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

#[test]
fn each_hour_has_its_files_and_the_last_one_is_written_at_the_end() {
    let dir = tempfile::tempdir().expect("a directory");
    let lag = Quantity::Effect { effect: Effect::CoilLag, parameter: 0 };
    let mut rows = FleetRows::new(dir.path(), "car 1/front_left");
    let residuals_n = run(&mut rows);
    let Some(hour) = &mut rows.hour else { panic!("an hour has begun") };
    let values = [value(Quantity::ForceRatio, 1.5), value(lag, f64::NAN)];
    hour.values = WindowValues { values: &values, window_s: 60.0, model_hash: "abc" }.rows().collect();
    drop(rows);
    let damper = "damper=car%201%2Ffront_left/day=2026-11-27";
    let names = ["1795769998000000000.csv", "1795770000000000000.csv"];
    let hours = names.map(|name| read(dir.path(), &format!("hours/{damper}/{name}")));
    assert!(
        hours[0].starts_with(&format!("{HOURS}\n2026-11-27T08:59:58.000000000Z,1.998,1000,")),
        "{}",
        hours[0]
    );
    assert!(
        hours[1].starts_with(&format!("{HOURS}\n2026-11-27T09:00:00.000000000Z,1.998,1000,")),
        "{}",
        hours[1]
    );

    // The regions hold the residuals of both hours, but for those that wait at the end. A triangle has two velocities, and its turns.
    let regions: Vec<String> = names
        .iter()
        .flat_map(|name| {
            let text = read(dir.path(), &format!("residuals/{damper}/{name}"));
            text.lines().skip(1).map(str::to_owned).collect::<Vec<_>>()
        })
        .collect();
    let number = |row: &String, at: usize| row.split(',').nth(at).and_then(|cell| cell.parse::<f64>().ok());
    assert!(regions.iter().all(|row| row.contains(",1,1.5,")), "{regions:?}");
    let samples: f64 = regions.iter().filter_map(|row| number(row, 6)).sum();
    let squares_n2: f64 =
        regions.iter().filter_map(|row| Some(number(row, 6)? * number(row, 8)?.powi(2))).sum();
    let known = &residuals_n[residuals_n.len() - samples as usize - 5..residuals_n.len() - 5];
    let expected_n2: f64 = known.iter().map(|residual_n| residual_n * residual_n).sum();
    assert!(
        samples > 1500.0 && (squares_n2 / expected_n2 - 1.0).abs() < 1e-9,
        "{samples}, {squares_n2}, {expected_n2}"
    );
    let fast = regions.iter().filter(|row| row.contains(",0.05,0.15,") || row.contains(",-0.15,-0.05,"));
    assert!(fast.filter_map(|row| number(row, 6)).sum::<f64>() > 0.95 * samples, "{regions:?}");

    // `model/python/tests/test_fleet.py` reads this text.
    assert_eq!(
        read(dir.path(), &format!("values/{damper}/{}", names[1])),
        "time,effect,form,parameter,running,value,low,high,displacement_std_m,velocity_rms_m_s,drive_share,window_s,model_hash\n\
         2026-11-27T08:59:59.000000001Z,,,force_ratio,1,1.5,1,2,1,1,0.25,60,abc\n\
         2026-11-27T08:59:59.000000001Z,coil_lag,one_tau,tau_s,1,,,,1,1,0.25,60,abc\n"
    );
}

#[test]
fn files_that_cannot_be_written_are_kept() {
    let dir = tempfile::tempdir().expect("a directory");
    let out = dir.path().join("out");
    fs::write(&out, "in the way").expect("a file");
    let mut rows = FleetRows::new(&out, "");
    run(&mut rows);
    assert_eq!(rows.files.len(), 2, "hours and residuals of the first hour");
    fs::remove_file(&out).expect("removed");
    drop(rows);
    for table in ["hours", "residuals"] {
        let day = out.join(table).join("damper=mr_damper/day=2026-11-27");
        assert_eq!(fs::read_dir(day).expect("a folder").count(), 2, "{table}");
    }
}
