"""Runs from files, frames of every kind, and dictionaries; and what is refused."""

import array
import pickle

import duckdb
import numpy
import pandas
import polars
import pyarrow
import pyarrow.csv
import pytest

import mr_damper


def kinds(path):
    """The content of a CSV file in every kind of table."""
    table = pandas.read_csv(path)
    return {
        "pandas": table,
        "pandas nullable": table.convert_dtypes(),
        "pandas pyarrow": pandas.read_csv(path, dtype_backend="pyarrow"),
        "polars": polars.read_csv(path, infer_schema_length=None),
        "pyarrow": pyarrow.csv.read_csv(path),
        "duckdb": duckdb.sql(f"select * from read_csv('{path}')"),
        "duckdb reader": duckdb.sql(f"select * from read_csv('{path}')").arrow(),
        "numpy": {name: table[name].to_numpy() for name in table},
        "lists": {name: table[name].to_list() for name in table},
        "arrays": {name: array.array("d", table[name]) for name in table},
        "strided": {name: numpy.repeat(table[name].to_numpy(), 2)[::2] for name in table},
    }


KINDS = [
    "pandas", "pandas nullable", "pandas pyarrow", "polars", "pyarrow", "duckdb", "duckdb reader", "numpy", "lists", "arrays", "strided",
]  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_a_table_of_any_kind_is_the_run_of_its_csv_file(files, kind):
    of_file = mr_damper.read_run(files[0])
    of_table = mr_damper.read_run(kinds(files[0])[kind])
    assert of_table.channels == of_file.channels
    assert of_table.traces() == of_file.traces()
    # The file is in canonical form.
    assert of_table.sha256 == of_file.sha256
    assert (of_table.drive, len(of_table)) == ("current_a", len(of_file))


def test_simulated_runs_are_those_of_the_command(files):
    runs = mr_damper.simulate("RP3-CS", replicates=3, duration=6)
    assert [run.sha256 for run in runs] == [mr_damper.read_run(path).sha256 for path in files]
    assert runs[0].duration_s == pytest.approx(6.0, abs=0.01)
    assert runs[0].rate_hz == pytest.approx(512.0, rel=1e-4)


def test_units_are_those_of_the_columns_names():
    time_s = [0.0, 0.002, 0.004]
    si = {"time_s": time_s, "displacement_m": [0.001, 0.002, 0.004], "force_n": [1500.0, 1000.0, 500.0], "current_a": [0.25] * 3}
    other = {"time_s": time_s, "displacement_mm": [1, 2, 4], "force_kn": [1.5, 1.0, 0.5], "current_ma": [250.0] * 3}
    assert mr_damper.read_run(other).traces() == mr_damper.read_run(si).traces()


def test_stamps_are_exact():
    ns = [1_700_000_000_123_456_789, 1_700_000_000_125_456_789]
    of_ns = mr_damper.read_run({"t": ns, "displacement_m": [0.0, 0.001]}, map={"time": "t,unit=ns"})
    stamps = {"time_s": numpy.array(ns, "datetime64[ns]"), "displacement_m": [0.0, 0.001]}
    aware = pandas.DataFrame({"time_s": pandas.to_datetime(ns, utc=True), "displacement_m": [0.0, 0.001]})
    arrow = pyarrow.table({"time_s": pyarrow.array(ns, pyarrow.timestamp("ns")), "displacement_m": [0.0, 0.001]})
    expected = numpy.array(ns).tobytes()
    for run in (of_ns, *map(mr_damper.read_run, (stamps, aware, pandas.DataFrame(stamps), arrow))):
        assert run.traces()["displacement_m"][0] == expected
    # As text in a CSV file: 0.1 + 0.2 is not 0.3, but both are 300 ms.
    assert mr_damper.read_run({"time_s": [0.0, 0.1 + 0.2], "displacement_m": [0, 1]}).traces()["displacement_m"][0] == (
        numpy.array([0, 300_000_000]).tobytes()
    )


def test_a_null_is_an_empty_cell_and_nan_is_an_error():
    table = {"time_s": [0.0, 0.1, 0.2], "displacement_m": [0.0, 0.1, 0.2], "case_temp_c": [20.0, None, 21.0]}
    tables = [table, polars.DataFrame(table), pyarrow.table(table), pandas.DataFrame(table).convert_dtypes()]
    for run in tables:
        with pytest.warns(mr_damper.MrDamperWarning, match="column `case_temp_c`: 1 empty cell"):
            assert len(mr_damper.read_run(run).traces()["case_temp_c"][1]) == 16
    for run in (pandas.DataFrame(table), polars.DataFrame({**table, "case_temp_c": [20.0, float("nan"), 21.0]})):
        with pytest.raises(mr_damper.Error, match=r"row 1, column `case_temp_c`: `NaN` is not finite") as raised:
            mr_damper.read_run(run)
        assert (raised.value.code, raised.value.row, raised.value.column) == ("row", 1, "case_temp_c")
    with pytest.warns(mr_damper.MrDamperWarning, match="1 empty cell"):
        run = mr_damper.read_run(pandas.DataFrame(table), nan="empty")
    assert len(run.traces()["case_temp_c"][1]) == 16
    with pytest.raises(mr_damper.UsageError, match="nan is 'drop'"):
        mr_damper.read_run(table, nan="drop")


def test_a_channel_with_a_lower_rate_has_nan_between_its_samples():
    nan = float("nan")
    table = {"time_s": numpy.arange(9) / 8, "displacement_m": numpy.arange(9.0)}
    for regular in ([1, nan, nan] * 3, [nan, 1, nan, nan, 2, nan, nan, 3, nan]):
        run = mr_damper.read_run({**table, "case_temp_c": numpy.array(regular)})
        assert len(run.traces()["case_temp_c"][1]) == 3 * 8
    for irregular in ([1, nan, nan, 2, 3, nan, 4, nan, nan], [1, nan, nan, 2, nan, nan, nan, nan, nan], [1, nan] * 4 + [1], [nan] * 9):
        with pytest.raises(mr_damper.Error, match='`NaN` is not finite; .*nan="empty"'):
            mr_damper.read_run({**table, "case_temp_c": numpy.array(irregular)})


TIMES = [0.0, 0.1, 0.2]


@pytest.mark.parametrize(
    ("table", "text", "code", "fields"),
    [
        ({"time_s": TIMES}, "no column displacement", "table", {}),
        ({"displacement_m": TIMES}, "no column `time_s`", "table", {}),
        ({"time_s": TIMES, "displacement": TIMES}, "the unit belongs to the name", "table", {}),
        ({"time_s": TIMES, "displacement_furlong": TIMES}, "displacement_m, displacement_mm, displacement_in", "table", {}),
        ({"time_s": [0.0, 0.2, 0.1], "displacement_m": TIMES}, "sort the rows and remove duplicates", "row", {"row": 2, "column": "time_s"}),
        ({"time_s": [0.0, 0.1, 0.1], "displacement_m": TIMES}, "0.1 s of the row before", "row", {"row": 2, "value": "0.1"}),
        ({"time_s": [0.0, float("nan"), 0.2], "displacement_m": TIMES}, "is not a time", "row", {"row": 1}),
        ({"time_s": [0.0, 1e12, 0.2], "displacement_m": TIMES}, "within 292 years", "row", {"row": 1}),
        ({"time_s": TIMES, "displacement_m": [0.0, float("inf"), 0.0]}, "is not finite", "row", {"row": 1, "value": "inf"}),
        ({"time_s": TIMES, "displacement_m": [0.0]}, "all columns need the same number of rows", "table", {}),
        ({"time_s": [], "displacement_m": []}, "no sample of displacement", "no_displacement", {}),
        ({}, "a table without columns", "table", {}),
        ({"time_s": TIMES, "displacement_m": ["a", "b", "c"]}, "holds a value that is not a number", "column", {"column": "displacement_m"}),
        ({"time_s": TIMES, "displacement_m": numpy.zeros((3, 1))}, "has 2 dimensions", "column", {}),
        ({"time_s": TIMES, "displacement_m": TIMES, "displacement_mm": TIMES}, "are the same quantity", "table", {}),
        ({"time_s": TIMES, "displacement_m": TIMES, "current_a": TIMES, "command_v": TIMES}, "choose with --drive", "both_drives", {}),
        (pyarrow.table({"time_s": TIMES, "displacement_m": ["a", "b", "c"]}), "holds Utf8, and only numbers", "table", {}),
        (7, "int is not a run; a run is a path", "not_a_run", {"type": "int"}),
        ([7], "int is not a run", "not_a_run", {}),
        ("absent.csv", "absent.csv: cannot open", "io", {"file": "absent.csv", "action": "open"}),
    ],
)  # fmt: skip
def test_wrong_tables_are_refused_with_what_to_do(table, text, code, fields):
    with pytest.raises(mr_damper.Error) as raised:
        mr_damper.read_runs(table)
    assert text in str(raised.value)
    assert raised.value.code == code
    assert {name: raised.value.fields.get(name) for name in fields} == fields


def test_a_column_that_occurs_twice_is_refused():
    table = pandas.DataFrame([[0.0, 1.0, 2.0]], columns=["time_s", "displacement_m", "displacement_m"])
    with pytest.raises(mr_damper.Error, match="column `displacement_m` occurs twice"):
        mr_damper.read_run(table)


def test_a_faulty_file_gives_the_sentence_of_the_command(tmp_path, command):
    path = tmp_path / "bad.csv"
    path.write_text("time_s,displacement_m\n0,0\n1,x\n")
    done = command("evaluate", "thesis/fuzzy-tanh/rp3-cs", path, check=False)
    with pytest.raises(mr_damper.Error) as raised:
        mr_damper.read_run(path)
    assert done.returncode == 1
    assert str(raised.value) in done.stderr
    assert (raised.value.file, raised.value.line, raised.value.column, raised.value.value) == (str(path), 3, "displacement_m", "x")


def test_bad_rows_are_skipped_on_request():
    table = {"time_s": [0.0, 0.1, 0.2, 0.3], "displacement_m": [0.0, float("nan"), 0.2, 0.3]}
    with pytest.warns(mr_damper.MrDamperWarning, match="1 bad row skipped"):
        assert len(mr_damper.read_run(table, skip_bad_rows=True)) == 3


def test_unknown_options_are_refused():
    with pytest.raises(TypeError, match="unknown options: mapp"):
        mr_damper.read_run({}, mapp={})
    with pytest.raises(mr_damper.UsageError, match="invalid value 'volts' for '--drive"):
        mr_damper.read_run({"time_s": TIMES, "displacement_m": TIMES}, drive="volts")


def test_a_run_is_written_and_pickled(tmp_path, files):
    run = mr_damper.read_run(files[0])
    for name in ("run.mcap", "bag", "run.csv"):
        run.save(tmp_path / name)
        assert mr_damper.read_run(tmp_path / name).traces() == run.traces()
    assert (tmp_path / "run.csv").read_bytes() == files[0].read_bytes()
    copy = pickle.loads(pickle.dumps(run))
    assert (copy.traces(), copy.sha256, copy.drive, copy.name) == (run.traces(), run.sha256, run.drive, run.name)
    with pytest.raises(mr_damper.Error, match="exists already"):
        run.save(tmp_path / "run.csv")
