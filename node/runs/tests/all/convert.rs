//! Conversion of parts of a run: what is written, and what is said of it.

use crate::run_support::{plain, temporary};
use mr_damper_runs::{Converted, RunError, RunSection, SaveOptions, convert};
use std::f64::consts::TAU;
use std::path::Path;

/// Writes 7.6 s of a sine of 1 Hz at 1 kHz to `run.csv`, or of no motion.
fn write(dir: &Path, moves: bool) {
    let x = |t: f64| if moves { 0.01 * (TAU * (t - 0.1)).sin() } else { 0.01 };
    let rows: String =
        (0..7600).map(|k| f64::from(k) / 1000.0).map(|t| format!("{t:.3},{:.6}\n", x(t))).collect();
    std::fs::write(dir.join("run.csv"), format!("time_s,displacement_m\n{rows}")).expect("written");
}

/// Converts `run.csv` to `to`.
fn part(dir: &Path, to: &str, options: SaveOptions) -> Result<Converted, RunError> {
    convert(&dir.join("run.csv"), &dir.join(to), &plain(), &options)
}

fn of(section: RunSection) -> SaveOptions {
    SaveOptions { part: section, ..SaveOptions::default() }
}

fn from(start_s: f64, duration_s: Option<f64>) -> RunSection {
    RunSection { start_s, duration_s, ..RunSection::default() }
}

#[test]
fn a_conversion_says_what_was_written() {
    let dir = temporary();
    write(dir.path(), true);
    let cycles = |first, last| RunSection { cycles: Some((first, last)), ..RunSection::default() };
    for (number, (options, said)) in [
        (SaveOptions::default(), "7600 displacements, 7.6 s"),
        (
            SaveOptions { resample_hz: Some(10.0), ..SaveOptions::default() },
            "76 displacements, 7.5 s (the run has 7600, 7.6 s)",
        ),
        (of(from(2.0, Some(3.0))), "3000 displacements, 3.0 s (the run has 7600, 7.6 s)"),
        (of(from(0.0, Some(7.6))), "7600 displacements, 7.6 s (the run has 7600, 7.6 s)"),
        (
            of(from(2.0, Some(300.0))),
            "5600 displacements, 5.6 s of the 300 s requested (the run has 7600, 7.6 s)",
        ),
        (
            of(from(7.5, Some(0.2))),
            "100 displacements, 0.099 s of the 0.2 s requested (the run has 7600, 7.6 s)",
        ),
        (of(cycles(2, 4)), "3000 displacements, 3.0 s (the run has 7600, 7.6 s)"),
        (
            of(RunSection { start_s: 1.0, duration_s: Some(2.5), ..cycles(2, 4) }),
            "2000 displacements, 2.0 s of the 2.5 s requested (the run has 7600, 7.6 s)",
        ),
    ]
    .into_iter()
    .enumerate()
    {
        let to = format!("{number}.csv");
        let converted = part(dir.path(), &to, options).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(converted.to_string(), said);
        let text = std::fs::read_to_string(dir.path().join(to)).expect("written");
        assert_eq!(text.lines().count(), 1 + converted.written.samples);
    }
}

#[test]
fn a_part_that_does_not_exist_is_explained() {
    let dir = temporary();
    write(dir.path(), true);
    let cycles = |first, last| RunSection { cycles: Some((first, last)), ..RunSection::default() };
    let whole = RunSection { whole_cycles: true, ..RunSection::default() };
    let refused = |options: RunSection| {
        let error = part(dir.path(), "out.csv", of(options)).expect_err("refused").to_string();
        error.split_once("out.csv: cannot write ").expect("the target").1.to_owned()
    };
    for (options, said) in [
        (
            RunSection { start_s: 4.0, ..cycles(2, 4) },
            "the part from 4 s on in cycles 2:4: these cycles end 3.000 s after they begin, and the start counts from there: give an \
             earlier start",
        ),
        (
            from(10.0, None),
            "the part from 10 s on: the run has 7.599 s of displacement, none of it in this part: give an earlier start",
        ),
        (from(-1.0, None), "the part from -1 s on: the start must be 0 s or more"),
        (from(1.0, Some(0.0)), "the part from 1 s on: its duration is 0 s, but must be above 0 s"),
        (
            from(1.0002, Some(0.0002)),
            "the part from 1.0002 s on: no sample of displacement is in this part: give a longer duration",
        ),
        (
            cycles(5, 9),
            "cycles 5:9: the run has 7 whole cycles, in which displacement rises through the middle of its range; give the first and \
             the last, from 1:1 to 1:7",
        ),
        (
            RunSection { duration_s: Some(0.5), ..whole },
            "whole cycles from 0 s on: this part of the run holds no whole cycle: make it longer, or leave --whole-cycles out",
        ),
    ] {
        assert_eq!(refused(options), said);
    }
    write(dir.path(), false);
    for (options, what) in [(cycles(1, 2), "cycles 1:2"), (whole, "whole cycles from 0 s on")] {
        assert_eq!(
            refused(options),
            format!(
                "{what}: displacement never rises twice through the middle of its range, so the run has no whole cycle: cut it with \
                 --start and --duration alone"
            )
        );
    }
    assert!(!dir.path().join("out.csv").exists());
}
