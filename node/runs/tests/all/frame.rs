//! Runs from tables in memory, against the same run as a CSV file.

use mr_damper_runs::{Column, LoadOptions, RunError, Values, from_columns, load};

fn floats(name: &str, values: &[f64]) -> Column {
    Column { name: name.to_owned(), values: Values::Floats(values.to_vec()) }
}

fn refused(columns: &[Column]) -> RunError {
    from_columns("table", columns, &LoadOptions::default()).expect_err("a wrong table")
}

#[test]
fn a_table_is_the_run_of_its_canonical_csv_file() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("run.csv");
    let text = "time_s,displacement_m,force_n,current_a,case_temp_c\n0,0.001,-12.5,1.2,20\n0.001953125,0.002,3e-9,1.2,\n0.3,0.0025,7,1.2,21.5\n";
    std::fs::write(&path, text).expect("room");
    let of_file = load(&path, &LoadOptions::default()).expect("a run");
    let table = [
        floats("time_s", &[0.0, 0.001_953_125, 0.1 + 0.2 - 5e-17]),
        floats("Displacement_mm", &[1.0, 2.0, 2.5]),
        floats("force_n", &[-12.5, 3e-9, 7.0]),
        floats("current_a", &[1.2; 3]),
        Column {
            name: "case_temp_c".to_owned(),
            values: Values::OptionalFloats(vec![Some(20.0), None, Some(21.5)]),
        },
    ];
    let of_table = from_columns(&of_file.run.name, &table, &LoadOptions::default()).expect("a run");
    assert_eq!(of_table.run, of_file.run);
    assert_eq!(of_table.sha256_hex(), of_file.sha256_hex());
    assert_eq!(of_table.notes, of_file.notes);
}

#[test]
fn whole_numbers_and_stamps_are_exact_at_any_epoch() {
    const NS: [i64; 2] = [1_700_000_000_123_456_789, 1_700_000_000_123_456_790];
    let displacement = floats("displacement_m", &[0.0, 1.0]);
    let stamps = Values::Stamps(NS.map(Some).to_vec());
    let table = [Column { name: "time_s".to_owned(), values: stamps }, displacement.clone()];
    let run = from_columns("table", &table, &LoadOptions::default()).expect("a run").run;
    assert_eq!(run.displacement_m.stamps.iter().map(|stamp| stamp.nanos()).collect::<Vec<_>>(), NS);
    // The float of the first time is the same as that of the second.
    let error = refused(&[floats("time_s", &NS.map(|ns| ns as f64 * 1e-9)), displacement]);
    assert!(matches!(error, RunError::Row { row: 1, .. }), "{error}");
}

#[test]
fn errors_name_row_column_and_value() {
    let time = floats("time_s", &[0.0, 0.1, 0.2]);
    let error = refused(&[time.clone(), floats("displacement_m", &[0.0, f64::NAN, 0.0])]);
    assert_eq!(
        error.to_string(),
        "table, row 1, column `displacement_m`: `NaN` is not finite; correct it, or drop such rows with skip_bad_rows"
    );
    let error = refused(&[floats("time_s", &[0.0, 0.1, 0.1]), floats("displacement_m", &[0.0; 3])]);
    assert!(error.to_string().contains("row 2, column `time_s`: `0.1` does not come after 0.1 s"), "{error}");
    let error = refused(&[time.clone(), floats("displacement_m", &[0.0; 2])]);
    assert!(error.to_string().contains("column `displacement_m` has 2 rows, but `time_s` has 3"), "{error}");
    let error = refused(&[time.clone(), floats("displacement_furlong", &[0.0; 3])]);
    assert!(error.to_string().contains("displacement_m, displacement_mm, displacement_in"), "{error}");
    let too_late = Values::Integers(vec![0, i64::MAX / 1_000_000, 1]);
    let error = refused(&[
        Column { name: "time_s".to_owned(), values: too_late },
        floats("displacement_m", &[0.0; 3]),
    ]);
    assert!(matches!(&error, RunError::Row { row: 1, .. }), "{error}");
}
