//! Runs as CSV: which files are read, which are refused and with which message, and lossless round
//! trips.

use mr_damper_model::sample::{DriveKind, Run, Stamp, Trace};
use mr_damper_runs::{ColumnMapping, LoadOptions, Loaded, Map, Note, RunError, SaveOptions, load, save};
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A directory with one file in it.
fn file(name: &str, content: impl AsRef<[u8]>) -> (TempDir, PathBuf) {
    let dir = tempfile::tempdir().expect("temporary directory");
    let path = dir.path().join(name);
    std::fs::write(&path, content).expect("file written");
    (dir, path)
}

fn read(content: impl AsRef<[u8]>, options: &LoadOptions) -> Result<Loaded, RunError> {
    let (_dir, path) = file("run.csv", content);
    load(&path, options)
}

fn good(content: impl AsRef<[u8]>) -> Loaded {
    read(content, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// The error's text, with the temporary path cut to the file name.
fn refusal(content: impl AsRef<[u8]>, options: &LoadOptions) -> String {
    let (dir, path) = file("run.csv", content);
    let error = load(&path, options).expect_err("must be refused").to_string();
    error.replace(&format!("{}/", dir.path().display()), "")
}

fn skipping() -> LoadOptions {
    LoadOptions { skip_bad_rows: true, ..LoadOptions::default() }
}

fn thesis() -> LoadOptions {
    LoadOptions { thesis_txt: true, ..LoadOptions::default() }
}

fn nanos(trace: &Trace) -> Vec<i64> {
    trace.stamps.iter().map(|stamp| stamp.nanos()).collect()
}

#[test]
fn a_column_of_text_that_nothing_uses_is_left_out_with_a_note() {
    let loaded = good("time_s,operator,displacement_m,count\n0,,0.1,7\n1,\"Mu, A\",0.2,8\n2,4,0.3,9\n");
    assert_eq!(loaded.run.displacement_m.values, [0.1, 0.2, 0.3]);
    let names: Vec<_> = loaded.run.other.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["count"]);
    let notes: Vec<_> = loaded.notes.iter().map(ToString::to_string).collect();
    assert_eq!(notes, ["column `operator` is left out: it holds text (line 3: `Mu, A`)"]);
    // A column of numbers with one bad cell loses no numbers without a word.
    let text = refusal("time_s,displacement_m,count\n0,0.1,7\n1,0.2,x\n", &LoadOptions::default());
    assert!(
        text.contains("line 3, column `count`: `x` is not a number, as the cells above it are"),
        "{text}"
    );
}

#[test]
fn reads_columns_in_any_order_with_units() {
    let loaded =
        good("force_lbf,time_s,current_ma,displacement_mm,note_x\n1,0,250,25.4,7\n2,0.5,500,-25.4,8\n");
    let run = loaded.run;
    assert_eq!(run.displacement_m.values, [0.0254, -0.0254]);
    assert_eq!(nanos(&run.displacement_m), [0, 500_000_000]);
    assert_eq!(run.force_n.expect("force").values, [4.448_221_6, 8.896_443_2]);
    let (kind, current) = run.drive.expect("drive");
    assert_eq!((kind, current.values), (DriveKind::CoilCurrent, vec![0.25, 0.5]));
    assert_eq!(run.other[0].0, "note_x");
    assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
}

#[test]
fn tolerates_what_spreadsheets_do() {
    let plain = good("time_s,displacement_m\n0,1\n1,2\n").run;
    for text in [
        "\u{feff}time_s,displacement_m\r\n0,1\r\n1,2\r\n",
        " time_s , displacement_m \n 0 , 1 \n\t1,2",
        "\"time_s\",\"displacement_m\"\n\n0,1\n\n1,2\n\n",
        "\u{feff}\"time_s\",Displacement_M\n0,1\n1,+2.0\n   \n",
    ] {
        let run = good(text).run;
        assert_eq!(run.displacement_m, plain.displacement_m, "{text:?}");
    }
}

#[test]
fn epochs_keep_their_nanoseconds() {
    let run =
        good("time_s,displacement_m\n1700000000.000000001,0\n1700000000.000000002,0\n1.700000001e9,0\n").run;
    assert_eq!(
        nanos(&run.displacement_m),
        [1_700_000_000_000_000_001, 1_700_000_000_000_000_002, 1_700_000_001_000_000_000]
    );
}

#[test]
fn thesis_files_have_an_order_instead_of_a_header() {
    for text in [
        "0 1.0 10 0.5 20 30 0.25\n0.01 1.5 11 0.5 20 30 0.25\n",
        "  0\t1.0\t10\t0.5\t20\t30\t0.25\r\n  0.01\t1.5\t11\t0.5\t20\t30\t0.25\r\n\r\n",
        "\u{feff}0, 1.0, 10, 0.5, 20, 30, 0.25\n0.01,1.5,11,0.5,20,30,0.25",
    ] {
        let run = read(text, &thesis()).unwrap_or_else(|error| panic!("{error}")).run;
        assert_eq!(run.displacement_m.values, [0.0254, 1.5 * 0.0254]);
        assert_eq!(run.drive_kind(), Some(DriveKind::CoilCurrent));
        assert_eq!(run.force_n.expect("force").values, [44.482_216, 11.0 * 4.448_221_6]);
        assert_eq!(run.case_temp_c.expect("case temperature").values, [30.0, 30.0]);
        let names: Vec<_> = run.other.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["ambient_temp_c", "setpoint_m"]);
    }
    assert_eq!(
        refusal("time x f i a c s\n0 1 2 3 4 5 6\n", &thesis()),
        "run.csv, line 1: a header row, but --thesis-txt files have none; leave --thesis-txt out for CSV \
         with column names"
    );
    assert_eq!(
        refusal("0 1 2 3 4 5 6\n1 1 2 3\n", &thesis()),
        "run.csv, line 2: 4 fields, 7 expected (no value for `ambient_temp_c`); correct the row, or drop \
         such rows with --skip-bad-rows"
    );
}

#[test]
fn every_refusal_says_where_and_what_to_do() {
    const HEAD: &str = "time_s,displacement_m,force_n\n0,0,1\n";
    const NO_TIME: &str = "is not a time in decimal seconds within 292 years";
    const ADVICE: &str = "; correct it, or drop such rows with --skip-bad-rows";
    for (rows, text) in [
        ("1,NaN,1\n", format!("line 3, column `displacement_m`: `NaN` is not finite{ADVICE}")),
        ("1,0,-inf\n", format!("line 3, column `force_n`: `-inf` is not finite{ADVICE}")),
        ("1,0,1e999\n", format!("line 3, column `force_n`: `1e999` is not finite{ADVICE}")),
        ("1,0,1\n2,0,x1\n", format!("line 4, column `force_n`: `x1` is not a number{ADVICE}")),
        ("1;0,1,2\n", format!("line 3, column `time_s`: `1;0` {NO_TIME}{ADVICE}")),
        (",1,2\n", format!("line 3, column `time_s`: `` {NO_TIME}{ADVICE}")),
        ("1,,\n", format!("line 3, column `time_s`: `1` is a time without any value{ADVICE}")),
        (
            "1,0\n",
            "line 3: 2 fields, 3 expected (no value for `force_n`); correct the row, or drop such rows with \
             --skip-bad-rows"
                .into(),
        ),
        (
            "1,0,1,9\n",
            "line 3: 4 fields, 3 expected (`9` is one too many); correct the row, or drop such rows with \
             --skip-bad-rows"
                .into(),
        ),
        (
            "0.5,0,1\n0.5,0,1\n",
            "line 4, column `time_s`: 0.5 s does not come after 0.5 s of the row before; times must increase \
             by 1 ns at least: sort or correct the file, or drop such rows with --skip-bad-rows"
                .into(),
        ),
    ] {
        assert_eq!(refusal(format!("{HEAD}{rows}"), &LoadOptions::default()), format!("run.csv, {text}"));
    }
}

#[test]
fn headers_that_cannot_be_used_are_explained() {
    for (text, refusal_text) in [
        (
            "t,displacement_m\n0,0\n",
            "line 1: no column `time_s` among: t, displacement_m; the unit belongs to the name, as in \
             displacement_mm, or say which column it is, as in --map time=t",
        ),
        (
            "time_s,displacement\n0,0\n",
            "line 1: no column displacement (displacement_m, displacement_mm, displacement_in) among: \
             time_s, displacement; the unit belongs to the name, as in displacement_mm, or say which column it is, \
             as in --map displacement=displacement",
        ),
        (
            "t,x_in,F\n0,0,0\n",
            "line 1: no column `time_s` and no displacement (displacement_m, displacement_mm, displacement_in) among: \
             t, x_in, F; the unit belongs to the name, as in displacement_mm, or say which column it is, as in --map time=t",
        ),
        (
            "time_s;displacement_m\n0;0\n",
            "line 1: no column `time_s` among: time_s;displacement_m; the fields seem to be split by `;` or \
             tabs: split them by commas, and write numbers with decimal points",
        ),
        (
            "time_s,displacement_m,displacement_mm\n",
            "line 1: columns `displacement_m` and `displacement_mm` are the same quantity: remove one of \
             them",
        ),
        (
            "time_s,displacement_m,a,a\n",
            "line 1: columns `a` and `a` are the same quantity: remove one of them",
        ),
        ("time_s,,displacement_m\n", "line 1: column 2 has no name: name it or remove it"),
        ("time_s,displacement_m,\u{b}\u{a0}\n", "line 1: column 3 has no name: name it or remove it"),
    ] {
        let message = refusal(text, &LoadOptions::default());
        // A header without time or displacement is answered with all names, so that one attempt more is enough.
        let (said, names) = message.split_once(", or name the columns with").unwrap_or((&message, ""));
        assert_eq!(said, format!("run.csv, {refusal_text}"));
        assert_eq!(names.ends_with("all names are time_s, time_ms, time_us, time_ns, displacement_m, displacement_mm, displacement_in, \
            velocity_m_s, velocity_mm_s, velocity_in_s, force_n, force_lbf, force_kn, current_a, current_ma, command_v, case_temp_c, \
            case_temp_f, body_velocity_m_s, force_request_n, ambient_temp_c, ambient_temp_f, setpoint_m, setpoint_mm, \
            setpoint_in"), refusal_text.contains("the unit belongs to the name"), "{message}");
    }
    for (text, hint) in
        [("", "the file is empty"), ("time_s,displacement_m\n", "there is no row of data below the header")]
    {
        let expected = format!("run.csv: no sample of displacement; {hint}");
        assert_eq!(refusal(text, &LoadOptions::default()), expected);
    }
    assert!(refusal(b"time_s,displacement_m,\xff\n", &LoadOptions::default()).contains("not UTF-8"));
}

#[test]
fn a_file_without_header_is_told_to_add_one() {
    const SAID: &str = "all fields are numbers, so the file has no header row; add one with the names in the order of the columns, such as \
                        `time_s,displacement_m,current_a,force_n`";
    const THESIS: &str =
        ", or give --thesis-txt for the order time, displacement, force, current, ambient, case, set point";
    for (text, line, more) in [
        // Equal numbers are not columns of the same quantity.
        ("0,0,1,12.5\n0.01,0.001,1,13\n", 1, ""),
        ("\u{feff}0.5,-1e-3,,nan\r\n", 1, ""),
        ("0 0.1 5\n", 1, ""),
        ("0,0.1,5,0.5,20,30,0.1\n", 1, THESIS),
        ("  0\t0.1\t5\t0.5\t20\t30\t0.1\n", 1, THESIS),
        ("# a title, with a comma\n\n0,1,2\n", 3, ""),
        ("# t,x,F\n0,1,2\n", 2, "; if line 1 is the header, remove its `#`"),
    ] {
        assert_eq!(
            refusal(text, &LoadOptions::default()),
            format!("run.csv, line {line}: {SAID}{more}"),
            "{text:?}"
        );
    }
    // Numbers may be names, as pandas writes them.
    let map = LoadOptions {
        map: Map::new(["time=0", "displacement=1"].map(|text| text.parse().expect("a mapping")).into())
            .expect("a map"),
        ..LoadOptions::default()
    };
    assert_eq!(read("0,1\n0,5\n1,6\n", &map).expect("loads").run.displacement_m.values, [5.0, 6.0]);
}

#[test]
fn rows_longer_than_the_header_are_not_to_be_skipped() {
    const HEAD: &str = "time_s,displacement_m,current_a,force_n\n";
    const COMMAS: &str = "4 expected; the numbers probably have decimal commas, and a comma splits two fields: write the numbers with \
                          decimal points";
    const SHORT: &str = "4 expected; the header has too few names for the rows below it: name every column, or remove the surplus \
                         fields from every row";
    const SEPARATOR: &str = "4 expected; the fields seem to be split by `;`, tabs or blanks: split them by commas, and write numbers \
                             with decimal points";
    for (rows, said) in [
        ("0,000,0,5,1,0,12,5\n0,001,0,5,1,0,12,5\n", format!("8 fields, {COMMAS}")),
        // Whole numbers have no comma.
        ("0,0,001,1,12,5\n0,01,0,002,1,12,5\n", format!("6 fields, {COMMAS}")),
        ("0,0.5,1,12,\n1,0.5,1,13,\n", format!("5 fields, {SHORT}")),
        ("0,0.5,1,12,7,8,9,10\n", format!("8 fields, {SHORT}")),
        ("0,000;0,5;1,0;12,5\n0,001;0,5;1,0;12,5\n", format!("5 fields, {SEPARATOR}")),
        ("0;0.5;1;12\n1;0.5;1;12\n", format!("1 field, {SEPARATOR}")),
        ("0\t0.5\t1\t12\n", format!("1 field, {SEPARATOR}")),
    ] {
        let text = format!("{HEAD}{rows}");
        for options in [LoadOptions::default(), skipping()] {
            assert_eq!(refusal(&text, &options), format!("run.csv, line 2: {said}"), "{rows:?}");
        }
    }
    // One such row is a bad row.
    let some = refusal(format!("{HEAD}0,0,5,1,12\n1,2,3,4\n"), &LoadOptions::default());
    assert!(some.ends_with("line 2: 5 fields, 4 expected (`12` is one too many); correct the row, or drop such rows with --skip-bad-rows"));
    let six = "0,0,5,1,12\n".repeat(6);
    let good: String = (1..20).map(|k| format!("{k},2,3,4\n")).collect();
    let run = read(format!("{HEAD}{six}{good}"), &skipping()).expect("most rows are good").run;
    assert_eq!(run.displacement_m.len(), 19);
}

#[test]
fn a_row_of_units_below_the_header_is_named() {
    let text = "time_s,displacement_m,current_a,force_n\n\ns,m,A,N\n0,1,2,3\n";
    assert_eq!(
        refusal(text, &LoadOptions::default()),
        "run.csv, line 3: `s, m, A, N` looks like a row of units, because no field is a number: remove the row"
    );
    assert_eq!(read(text, &skipping()).expect("one bad row").run.displacement_m.values, [1.0]);
    // A row with a number is a bad row.
    let text = "time_s,displacement_m\ns,0\n0,1\n";
    assert!(refusal(text, &LoadOptions::default()).contains("`s` is not a time in decimal seconds"));
}

#[test]
fn comments_before_the_header_are_skipped() {
    let plain = good("time_s,displacement_m\n0,1\n1,2\n").run;
    for text in [
        "# made by X\ntime_s,displacement_m\n0,1\n1,2\n",
        "\u{feff}# made by \"X\r\n\r\n  #, \"open\r\ntime_s,displacement_m\r\n0,1\r\n1,2\r\n",
        // The form of numpy.savetxt.
        "# time_s,displacement_m\n0,1\n1,2\n",
        "# made by X\n#Time_S, Displacement_m\n0,1\n1,2\n",
    ] {
        assert_eq!(good(text).run.displacement_m, plain.displacement_m, "{text:?}");
    }
    let map = Map::new(["time=t", "displacement=x"].map(|text| text.parse().expect("a mapping")).into());
    let options = LoadOptions { map: map.expect("a map"), ..LoadOptions::default() };
    let run = read("# t,x\n0,1\n1,2\n", &options).expect("loads").run;
    assert_eq!(run.displacement_m, plain.displacement_m);
    // A `#` may be the name of a column, or belong to it.
    for (name, rest) in
        [("#", "time_s,displacement_m\n7,0,1\n8,1,2\n"), ("# row", "displacement_m,time_s\n7,1,0\n8,2,1\n")]
    {
        let run = good(format!("{name},{rest}")).run;
        assert_eq!(run.displacement_m, plain.displacement_m);
        assert_eq!((run.other[0].0.as_str(), &run.other[0].1.values[..]), (name, &[7.0, 8.0][..]));
    }
    let map = Map::new(["time=# t", "displacement=x"].map(|text| text.parse().expect("a mapping")).into());
    let options = LoadOptions { map: map.expect("a map"), ..LoadOptions::default() };
    assert_eq!(read("# t,x\n0,1\n1,2\n", &options).expect("loads").run.displacement_m, plain.displacement_m);
    let units = refusal("# time_s,displacement_m\ns,m\n0,1\n", &LoadOptions::default());
    assert!(units.contains("line 2: `s, m` looks like a row of units"), "{units}");
    assert_eq!(
        refusal("# nothing\n#\n", &LoadOptions::default()),
        "run.csv: no sample of displacement; the file holds only comments, which begin with `#`"
    );
    let loaded = good("# made by X\ntime_s,displacement_m\n0,0\n");
    // printf '# made by X\ntime_s,displacement_m\n0,0\n' | sha256sum
    assert_eq!(loaded.sha256_hex(), "77cd7286c50199f794bb14c8ed6d338f8b5f47e00ff412403b647a784edad28c");
}

#[test]
fn lines_are_numbered_as_in_an_editor() {
    for (text, line) in [
        ("# made by X\n# today\ntime_s,displacement_m\n0,1\n1,x\n", 5),
        ("# time_s,displacement_m\n0,1\n1,x\n", 3),
        ("time_s,displacement_m\r\n0,1\r\n1,x\r\n", 3),
        ("time_s,displacement_m\n\n\n0,1\n\n1,x\n", 6),
        ("\n\u{a0}\n", 2),
        ("\r\n#\r\n\r\ntime_s,displacement_m\r\n\r\n0,1\r\n\r\n  \r\n1,x", 9),
        ("time_s,displacement_m\r0,1\r1,x\r", 3),
        ("time_s,\"displacement\n_m\"\n0,1\n1,2\n", 1),
        ("\"time_s\",displacement_m,\"a\nb\"\n0,1,2\n1,x,2\n", 4),
        // Beyond the buffer of the library.
        (
            &*format!(
                "time_s,displacement_m\r\n{}9999,x\r\n",
                (0..5000).map(|k| format!("{k},1\r\n")).collect::<String>()
            ),
            5002,
        ),
    ] {
        let said = refusal(text, &LoadOptions::default());
        assert!(said.starts_with(&format!("run.csv, line {line}")), "{line}: {said}");
    }
}

#[test]
fn only_columns_that_fit_are_suggested() {
    const LACKS: &str =
        "run.csv, line 1: no column displacement (displacement_m, displacement_mm, displacement_in) among:";
    for (header, said) in [
        (
            "time_s,force_n,current_a",
            "time_s, force_n, current_a; all of them hold other quantities: add what is missing to the file",
        ),
        (
            "time_ms,force_n,current_a",
            "time_ms, force_n, current_a; all of them hold other quantities: add what is missing to the file",
        ),
        ("time_s,force_n,stroke", "say which column it is, as in --map displacement=stroke, or"),
        ("time_s,force_n,u2 [mm]", "say which column it is, as in --map 'displacement=u2 [mm]', or"),
        ("time_s,force_n,A,load_kN", "say which column it is, as in --map displacement=COLUMN, or"),
    ] {
        let message = refusal(format!("{header}\n0,1,2,3\n"), &LoadOptions::default());
        assert!(message.starts_with(LACKS) && message.contains(said), "{message}");
    }
    let message = refusal("displacement_m,force_n\n0,1\n", &LoadOptions::default());
    assert!(message.ends_with("no column `time_s` among: displacement_m, force_n; all of them hold other quantities: add what is missing to \
                               the file"), "{message}");
    let message = refusal("index,v_m_s,displacement_m\n0,1,2\n", &LoadOptions::default());
    assert!(message.contains("as in --map time=COLUMN, or"), "{message}");
}

#[test]
fn a_time_may_be_in_another_unit() {
    for (name, scale) in [("time_ms", 1_000_000), ("Time_us", 1000), ("time_ns", 1)] {
        let loaded = good(format!("displacement_m,{name}\n0,1\n1,2\n"));
        assert_eq!(nanos(&loaded.run.displacement_m), [scale, 2 * scale]);
        assert_eq!(loaded.notes, []);
    }
    // Beside `time_s` such a column is carried through.
    let run = good("time_ms,time_s,displacement_m\n5,0,1\n6,1,2\n").run;
    assert_eq!((run.other[0].0.as_str(), &run.other[0].1.values[..]), ("time_ms", &[5.0, 6.0][..]));
    assert!(
        refusal("time_ms,time_us,displacement_m\n", &LoadOptions::default())
            .contains("columns `time_ms` and `time_us` are the same quantity")
    );
    let unknown = "time_h=t".parse::<ColumnMapping>().expect_err("unknown").to_string();
    assert!(unknown.contains("names are time_s, time_ms, time_us, time_ns, displacement_m"), "{unknown}");
}

#[test]
fn bad_rows_are_skipped_and_counted_on_request() {
    let text = "time_s,displacement_m\n0,0\n1,nan\n2,2\n1.5,9\n3\n3,3\n4,x\n5,5\n6,6\n7,7\n";
    let loaded = read(text, &skipping()).expect("loads");
    assert_eq!(loaded.run.displacement_m.values, [0.0, 2.0, 3.0, 5.0, 6.0, 7.0]);
    let [Note::RowsSkipped { count: 4, first }] = loaded.notes.as_slice() else {
        panic!("{:?}", loaded.notes)
    };
    assert_eq!(first.len(), 4);
    assert!(first[1].ends_with("line 5, column `time_s`: 1.5 s does not come after 2 s of the row before"));
    let note = loaded.notes[0].to_string();
    assert!(note.starts_with("4 bad rows skipped; the first: "), "{note}");
    // Skipping rows does not repair a file that is mostly wrong.
    let mostly = refusal("time_s,displacement_m\n0,0\n1,a\n2,b\n", &skipping());
    assert_eq!(
        mostly,
        "run.csv: 2 bad rows against 1 good ones, so this is not a run with a few faults; the first: \
         run.csv, line 3, column `displacement_m`: `a` is not a number"
    );
}

#[test]
fn with_two_drives_one_must_be_chosen() {
    let text = "time_s,displacement_m,current_a,command_v\n0,0,1,5\n";
    assert_eq!(
        refusal(text, &LoadOptions::default()),
        "run.csv: both a coil current (current_a) and a command voltage (command_v) are recorded, and a \
         model takes one of them; choose with --drive current_a or --drive command_v"
    );
    for (kind, value, other) in
        [(DriveKind::CoilCurrent, 1.0, "command_v"), (DriveKind::CommandVoltage, 5.0, "current_a")]
    {
        let run =
            read(text, &LoadOptions { drive: Some(kind), ..LoadOptions::default() }).expect("loads").run;
        assert_eq!(run.drive.map(|(kind, trace)| (kind, trace.values)), Some((kind, vec![value])));
        assert_eq!(run.other[0].0, other);
    }
    // A single drive needs no choice, and is not mistaken for the other kind.
    let run = read(
        "time_s,displacement_m,command_v\n0,0,5\n",
        &LoadOptions { drive: Some(DriveKind::CommandVoltage), ..LoadOptions::default() },
    );
    assert_eq!(run.expect("loads").run.drive_kind(), Some(DriveKind::CommandVoltage));
}

#[test]
fn holes_and_look_alikes_are_noted() {
    let loaded = good("time_s,displacement_m,force,case_temp_c\n0,0,1,\n1,0,,\n");
    assert_eq!(loaded.run.case_temp_c, None);
    let notes: Vec<_> = loaded.notes.iter().map(ToString::to_string).collect();
    assert_eq!(
        notes,
        [
            "column `force`: 1 empty cell taken as no sample",
            "column `force` is carried through but not used: known names are force_n, force_lbf, force_kn; \
             or say its unit, as in --map measured_force=force,unit=UNIT",
            "column `case_temp_c`: 2 empty cells taken as no sample",
        ]
    );
}

#[test]
fn paths_without_a_run_are_refused() {
    let (dir, path) = file("run.xlsx", "PK");
    let text = |path: &Path| {
        let error = load(path, &LoadOptions::default()).expect_err("refused").to_string();
        error.replace(&format!("{}/", dir.path().display()), "")
    };
    assert_eq!(
        text(&path),
        "run.xlsx: not a run: a .xlsx file; a run is a CSV file, a rosbag2 directory with metadata.yaml, an \
         .mcap or .db3 file, or a log of a bus (.mf4, .asc, .blf, .log)"
    );
    assert!(text(&dir.path().join("none.csv")).starts_with("none.csv: cannot open: No such file"));
    std::fs::create_dir(dir.path().join("empty")).expect("created");
    assert!(
        text(&dir.path().join("empty"))
            .contains("a directory without metadata.yaml and without .mcap or .db3 files")
    );
    for name in ["a.mcap", "a.db3"] {
        std::fs::write(dir.path().join("empty").join(name), "").expect("written");
    }
    assert!(text(&dir.path().join("empty")).contains("that holds both .mcap and .db3 files; name the one"));
}

#[test]
fn written_files_are_canonical_and_not_overwritten() {
    let (dir, path) =
        file("in.csv", "b,command_v,time_s,a,displacement_in\n0.1,5,1.50,1e-9,1\n1e22,5,2,-0,1\n");
    let run = load(&path, &LoadOptions::default()).expect("loads").run;
    let out = dir.path().join("sub").join("out.csv");
    save(&run, &out, &SaveOptions::default()).expect("saved");
    let text = std::fs::read_to_string(&out).expect("read");
    assert_eq!(text, "time_s,displacement_m,command_v,b,a\n1.5,0.0254,5,0.1,1e-9\n2,0.0254,5,1e22,-0\n");
    let error = save(&run, &out, &SaveOptions::default()).expect_err("refused").to_string();
    assert!(
        error.ends_with("out.csv: exists already and is not overwritten; remove it or choose another name")
    );
    let error = save(&run, &dir.path().join("out.xls"), &SaveOptions::default()).expect_err("refused");
    assert!(
        error.to_string().contains("name a .csv, .mcap or .db3 file, or a directory without extension"),
        "{error}"
    );
    // No partial file is left.
    assert_eq!(std::fs::read_dir(out.parent().expect("parent")).expect("listed").count(), 1);
}

#[test]
fn the_hash_is_computed_over_the_file() {
    let loaded = good("time_s,displacement_m\n0,0\n");
    // printf 'time_s,displacement_m\n0,0\n' | sha256sum
    assert_eq!(loaded.sha256_hex(), "9a2efd4238c890512bfbc0c1ff019fea34af5c7ed69db5665a7af5044ba8085f");
}

#[test]
#[ignore = "needs the measured runs: set MR_DAMPER_DATA"]
fn measured_runs_load() {
    let data = std::env::var_os("MR_DAMPER_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let folders = std::fs::read_dir(&data).unwrap_or_else(|error| {
        panic!("no measured runs at {}: {error}; set MR_DAMPER_DATA", data.display())
    });
    let mut count = 0;
    for folder in folders.flatten().filter(|entry| entry.path().is_dir()) {
        for entry in std::fs::read_dir(folder.path()).expect("folder listed").flatten() {
            let path = entry.path();
            if path.extension().is_some_and(|extension| extension == "csv") {
                let loaded = load(&path, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
                assert!(loaded.notes.is_empty(), "{}: {:?}", path.display(), loaded.notes);
                assert!(loaded.run.force_n.is_some(), "{}", path.display());
                // Runs of machines other than MR dampers have no drive.
                let is_mr = folder.file_name().to_string_lossy().ends_with("-mr");
                assert!(!is_mr || loaded.run.drive.is_some(), "{}", path.display());
                count += 1;
            }
        }
    }
    eprintln!("{count} measured runs loaded");
    assert!(count > 0);
}

/// Any run that a CSV file can hold: each channel has its own stamps and any finite values.
fn any_run() -> impl Strategy<Value = Run> {
    fn trace(least: usize) -> impl Strategy<Value = Trace> {
        let finite = any::<u64>().prop_map(f64::from_bits).prop_filter("finite", |value| value.is_finite());
        proptest::collection::btree_map(-3_000_000_000_i64..3_000_000_000, finite, least..12).prop_map(
            |samples| Trace {
                stamps: samples.keys().map(|&nanos| Stamp::from_nanos(nanos)).collect(),
                values: samples.into_values().collect(),
            },
        )
    }
    let channels =
        (trace(1), proptest::option::of(trace(1)), proptest::option::of(trace(1)), trace(1), trace(1));
    channels.prop_map(|(displacement_m, force_n, velocity_m_s, drive, other)| Run {
        displacement_m,
        force_n,
        velocity_m_s,
        drive: Some((DriveKind::CommandVoltage, drive)),
        other: vec![("a \"quoted\", name".into(), other)],
        ..Run::default()
    })
}

proptest! {
    #[test]
    fn csv_keeps_every_bit(run in any_run()) {
        let dir = tempfile::tempdir().expect("temporary directory");
        let path = dir.path().join("run.csv");
        save(&run, &path, &SaveOptions::default()).expect("saved");
        let back = load(&path, &LoadOptions::default()).expect("loaded").run;
        // Debug text distinguishes -0.0 from 0.0; equality does not.
        let expected = Run { name: back.name.clone(), ..run };
        prop_assert_eq!(format!("{back:?}"), format!("{expected:?}"));
    }

    #[test]
    fn hostile_bytes_do_not_panic(
        bytes in proptest::collection::vec(any::<u8>(), 0..400),
        skip: bool,
        txt: bool,
    ) {
        let _ = read(&bytes, &LoadOptions { skip_bad_rows: skip, thesis_txt: txt, ..LoadOptions::default() });
    }

    #[test]
    fn hostile_rows_do_not_panic(rows in "([-0-9.eE,\"\r\n naif]{0,60}\n){0,8}", skip: bool) {
        let text = format!("time_s,displacement_m,force_lbf\n{rows}");
        if let Ok(loaded) = read(text, &LoadOptions { skip_bad_rows: skip, ..LoadOptions::default() }) {
            let stamps = &loaded.run.displacement_m.stamps;
            prop_assert!(stamps.is_sorted_by(|a, b| a < b));
        }
    }
}
