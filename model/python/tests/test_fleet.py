"""Fleets: recordings, tasks on each engine, workers that die, results on disk, and ageing."""

import concurrent.futures
import datetime
import json
import multiprocessing
import os
import pathlib
import re
import shutil
import signal

import duckdb
import numpy as np
import pytest
import scipy.stats

import mr_damper
from mr_damper import fleet
from mr_damper.fleet import _ageing, _store, _tasks

PATTERN = r"(?P<damper>[^/]+)/(?P<day>\d{8})"
BEGIN = datetime.date(2026, 11, 1)
MODEL = "thesis/fuzzy-tanh/rp3-cs"


def record(folder, dampers, days, duration, fade=None):
    """Writes a recording a day of dampers whose force is the model's; ``fade`` gives the ratio of a damper's force on a day."""
    model = mr_damper.DamperModel.load(MODEL)
    for number in range(dampers):
        for day in range(days):
            [run] = mr_damper.simulate("RP-APRBS", replicates=1, duration=duration, seed=1000 * number + day)
            traces = {name: (np.frombuffer(at, "i8"), np.frombuffer(values, "f8")) for name, (at, values) in run.traces().items()}
            stamps, displacement_m = traces["displacement_m"]
            noise_n = np.random.default_rng([number, day]).normal(0.0, 3.0, len(stamps))
            force_n = np.nan_to_num(model.predict(run)) * (fade(number, day) if fade else 1.0) + noise_n
            begin = datetime.datetime.combine(BEGIN + datetime.timedelta(days=day), datetime.time(8), datetime.timezone.utc)
            shift_ns = int(begin.timestamp()) * 10**9 - int(stamps[0])
            table = {
                "time_ns": stamps + shift_ns,
                "displacement_m": displacement_m,
                "current_a": traces["current_a"][1],
                "force_n": force_n,
            }
            where = folder / f"damper {number}"
            where.mkdir(parents=True, exist_ok=True)
            mr_damper.read_run(table, map={"time": "time_ns,unit=ns"}).save(where / f"{begin:%Y%m%d}.csv")
    return fleet.find(folder, PATTERN)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Three recordings of four dampers."""
    return record(tmp_path_factory.mktemp("recordings"), dampers=4, days=3, duration=6)


def test_recordings_are_found_by_their_paths(recordings, tmp_path):
    assert len(recordings) == 12
    assert recordings[0][:2] == ("damper 0", BEGIN)
    (tmp_path / "one.csv").write_text("time_s\n")
    with pytest.raises(mr_damper.Error, match="no recording matches .*: it does not match one.csv"):
        fleet.find(tmp_path, PATTERN)
    with pytest.raises(mr_damper.UsageError, match="no group 'day'"):
        fleet.find(tmp_path, r"(?P<damper>\w+)")
    with pytest.raises(mr_damper.UsageError, match="'one' is no date"):
        fleet.find(tmp_path, r"(?P<day>one)(?P<damper>.)")
    (tmp_path / "a-2026-11.csv").write_text("time_s\n")
    with pytest.raises(mr_damper.UsageError, match="'2026-11' is no date"):
        fleet.find(tmp_path, r"(?P<damper>a)-(?P<day>\d{4}-\d\d)")
    with pytest.raises(mr_damper.UsageError, match="must not be optional"):
        fleet.find(tmp_path, r"(?P<damper>z)?-(?P<day>2026)")
    with pytest.raises(mr_damper.UsageError, match="is no regular expression"):
        fleet.find(tmp_path, "(")
    with pytest.raises(mr_damper.Error, match="no such folder"):
        fleet.find(tmp_path / "absent", PATTERN)


def test_errors_are_those_of_the_library_and_are_kept(recordings, tmp_path):
    outcome = fleet.evaluate(recordings, MODEL, tmp_path)
    assert outcome == (12, 0, [])
    runs = fleet.read(tmp_path, "runs")
    assert runs.column_names[:3] == ["damper", "day", "run"]
    assert runs["damper"].to_pylist() == [recording.damper for recording in recordings]
    expected = mr_damper.evaluate(MODEL, recordings[0].path).runs[0]
    first = runs.to_pylist()[0]
    figures = expected.free_run
    assert (first["rmse_n"], first["nmse"], first["samples"]) == (figures.rsse_n, figures.esr, figures.samples)
    assert first["time"].isoformat() == "2026-11-01T08:00:00+00:00"
    # The regions hold each residual once.
    regions = fleet.read(tmp_path, "residuals").to_pylist()
    of_first = [row for row in regions if row["run"] == recordings[0].path]
    predicted = mr_damper.DamperModel.load(MODEL).predictions(recordings[0].path)
    residual_n = predicted.residual_n[np.isfinite(predicted.residual_n)]
    assert sum(row["samples"] for row in of_first) == len(residual_n)
    assert sum(row["samples"] * row["rmse_n"] ** 2 for row in of_first) == pytest.approx(float(residual_n @ residual_n))
    # Nothing is done twice, and a changed recording is done again.
    assert fleet.evaluate(recordings, MODEL, tmp_path) == (0, 12, [])
    os.utime(recordings[5].path, (1, 1))
    assert fleet.evaluate(recordings, MODEL, tmp_path) == (1, 11, [])
    assert fleet.evaluate(recordings, MODEL, tmp_path, drives=(1.0,)) == (12, 0, [])
    assert len(fleet.read(tmp_path, "runs")) == 12


def test_other_tools_read_the_results(recordings, tmp_path):
    fleet.evaluate(recordings, MODEL, tmp_path)
    files = f"read_parquet('{tmp_path}/runs/*/*/*.parquet', hive_partitioning=true)"
    query = f"select damper, count(*), min(day) from {files} group by damper order by damper"
    assert duckdb.sql(query).fetchall()[0] == ("damper 0", 3, BEGIN)
    part = next((tmp_path / "runs").glob("*/*/*.parquet"))
    field = _store.arrow().parquet.read_schema(part).field("rmse_n")
    assert field.metadata == {b"unit": b"N"}


def test_damper_names_of_digits_stay_text(recordings, tmp_path, monkeypatch):
    """In the package's readers, and in the queries that the guide shows."""
    names = ["007", "12"]
    pairs = [recording._replace(damper=name) for name, recording in zip(names, recordings)]
    monkeypatch.chdir(tmp_path)
    fleet.evaluate(pairs, MODEL, "results")
    fleet.evaluate([pairs[0]._replace(path="/absent.csv")], MODEL, "failed")
    fleet.identify(pairs, out="results", restarts=1, sets=3)
    for table in ("runs", "residuals", "models"):
        assert set(fleet.read("results", table)["damper"].to_pylist()) == set(names)
    assert fleet.read("failed", "failures")["damper"].to_pylist() == ["007"]
    assert sorted(fleet.models("results")) == names
    assert fleet.evaluate(pairs, fleet.models("results"), "results") == (2, 0, [])

    page = (pathlib.Path(__file__).parents[3] / "node/docs/guide/17-fleets.md").read_text()
    [block] = [block for block in re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL) if "read_parquet" in block]
    shown = []
    exec(block, {"fleet": fleet, "print": shown.append})
    own, by_duckdb, by_polars, by_pandas = shown
    assert own["damper"].tolist() == names
    assert {row[0] for row in by_duckdb.fetchall()} == set(names)
    assert by_polars["damper"].to_list() == names
    assert by_pandas.index.tolist() == names
    # DuckDB takes 007 for text, but a column of names without leading zeros for numbers.
    shutil.rmtree("results/residuals/damper=007")
    shown.clear()
    exec(block, {"fleet": fleet, "print": shown.append})
    assert {row[0] for row in shown[1].fetchall()} == {"12"}


def test_values_of_dampers_with_names_of_digits_stay_text(tmp_path):
    begin_ns = int(datetime.datetime(2026, 11, 1, tzinfo=datetime.timezone.utc).timestamp()) * 10**9
    row = {"time": begin_ns, "effect": "", "form": "", "parameter": "force_ratio", "value": 1.0, "low": 0.9, "high": 1.1, "window_s": 60.0}
    row.update(displacement_std_m=0.01, velocity_rms_m_s=0.1, drive_share=0.2, model_hash="a")
    for name in ("007", "12"):
        _store.write(_store.file_of(str(tmp_path), "values", name, BEGIN), "values", [row], "key")
    found = fleet.ageing(tmp_path)
    assert [row["damper"] for row in found.rows] == ["007", "12"]
    assert found.to_frame("pandas")["damper"].tolist() == found.to_frame("polars")["damper"].to_list() == ["007", "12"]
    assert [name for (name,) in duckdb.sql(f"select damper from '{tmp_path}/ageing.parquet'").fetchall()] == ["007", "12"]


def test_a_recording_that_cannot_be_read_is_a_failure_and_the_rest_is_done(recordings, tmp_path):
    broken = tmp_path / "damper 9" / "20261101.csv"
    broken.parent.mkdir()
    broken.write_text("time_s,displacement_m,force_n\n0,0,x\n")
    both = [*recordings[:3], *fleet.find(tmp_path, PATTERN)]
    done, kept, failures = fleet.evaluate(both, MODEL, tmp_path / "out")
    assert (done, kept, len(failures)) == (3, 0, 1)
    assert (failures[0].damper, failures[0].code) == ("damper 9", "cell")
    assert "20261101.csv" in failures[0].message
    # The next call says so again.
    assert fleet.evaluate(both, MODEL, tmp_path / "out") == (0, 3, failures)


def test_wrong_arguments_say_what_to_do(recordings, tmp_path):
    with pytest.raises(mr_damper.UsageError, match="give a dask.distributed.Client"):
        fleet.evaluate(recordings, MODEL, tmp_path, engine="dask")
    with pytest.raises(mr_damper.UsageError, match="model has no damper 'damper 1'"):
        fleet.evaluate(recordings, {"damper 0": MODEL}, tmp_path)
    with pytest.raises(TypeError, match="unknown options: colour"):
        fleet.evaluate(recordings, MODEL, tmp_path, colour=1)
    for given, why in [
        ([], "recordings is empty"),
        ("recordings", "give a list of Recording"),
        (recordings[0], "give a list of Recording"),
        (["a.csv"], "is no Recording"),
        ([fleet.Recording(5, BEGIN, "a.csv")], "damper is 5"),
        ([fleet.Recording("", BEGIN, "a.csv")], "damper is ''"),
        ([fleet.Recording("a", "2026-11-01", "a.csv")], "give a datetime.date"),
        ([fleet.Recording("a", BEGIN, 1)], "path is 1"),
    ]:
        with pytest.raises(mr_damper.UsageError, match=why):
            fleet.evaluate(given, MODEL, tmp_path)
    for wrong, why in [
        (dict(velocities=(0.1, -0.1)), "ascending"),
        (dict(velocities=(float("nan"),)), "velocities is nan"),
        (dict(drives=("a",)), "drives is 'a'"),
    ]:
        with pytest.raises(mr_damper.UsageError, match=why):
            fleet.evaluate(recordings, MODEL, tmp_path, **wrong)
    for window in (10, float("nan"), "60", None):
        with pytest.raises(mr_damper.UsageError, match="window is"):
            fleet.effect_values(recordings, MODEL, tmp_path, window=window)
    with pytest.raises(mr_damper.UsageError, match="model is None"):
        fleet.evaluate(recordings, None, tmp_path)
    with pytest.raises(mr_damper.UsageError, match="validate is 1.5"):
        fleet.identify(recordings, out=tmp_path, validate=1.5)
    with pytest.raises(mr_damper.UsageError, match="leaves no recording for the test"):
        fleet.close(recordings, MODEL, out=tmp_path, split=(0.9, 0.5))
    # An option that every task would refuse ends the call.
    with pytest.raises(mr_damper.UsageError, match="zzz"):
        fleet.close(recordings, MODEL, out=tmp_path, effects=["zzz"])
    with pytest.raises(mr_damper.Error, match="has no results"):
        fleet.read(tmp_path, "runs")
    with pytest.raises(mr_damper.UsageError, match="give a list of names among damper, day"):
        fleet.read(tmp_path, "runs", ["nope"])
    with pytest.raises(mr_damper.UsageError, match="days_per_alarm is 'x'"):
        fleet.ageing(tmp_path, days_per_alarm="x")
    (tmp_path / "file").write_text("")
    with pytest.raises(mr_damper.Error, match="give a folder that can be written"):
        fleet.evaluate(recordings, MODEL, tmp_path / "file")


def test_a_recording_that_is_gone_is_a_failure_and_one_that_is_there_twice_counts_once(recordings, tmp_path):
    gone = fleet.Recording("z", BEGIN, str(tmp_path / "gone.csv"))
    done, _, failures = fleet.evaluate([recordings[0], recordings[0], gone], MODEL, tmp_path / "out")
    assert (done, len(failures), failures[0].damper, failures[0].code) == (1, 1, "z", "io")
    assert "is the recording still there" in failures[0].message
    assert len(fleet.read(tmp_path / "out", "runs")) == 1


def test_models_and_diagnoses_of_each_damper(recordings, tmp_path):
    some = recordings[:6]
    assert fleet.identify(some, "fuzzy-tanh", out=tmp_path, restarts=1, sets=3) == (2, 0, [])
    models = fleet.read(tmp_path, "models").to_pylist()
    assert [(row["damper"], row["training_runs"], row["validation_runs"]) for row in models] == [("damper 0", 2, 1), ("damper 1", 2, 1)]
    coefficients = fleet.read(tmp_path, "coefficients").to_pylist()
    assert {row["damper"] for row in coefficients} == {"damper 0", "damper 1"}
    path = tmp_path / "model.toml"
    path.write_text(models[0]["model_toml"])
    paths = [recording.path for recording in some[:3]]
    assert fleet.models(tmp_path)["damper 0"].parameters == mr_damper.DamperModel.load(path).parameters
    assert fleet.evaluate(some, fleet.models(tmp_path), tmp_path) == (6, 0, [])
    own = mr_damper.DamperModel("fuzzy-tanh", restarts=1, sets=3).fit(paths[:2], validate=paths[2:])
    assert mr_damper.DamperModel.load(path).parameters == own.parameters


def test_diagnoses_of_each_damper(aged, tmp_path):
    some = [*aged[:3], *aged[-2:]]
    done, _, failures = fleet.close(some, MODEL, out=tmp_path, fixed_base=True)
    assert [failure[:3] for failure in failures] == [(some[-1].damper, some[-1].day, "too_few_recordings")]
    [row] = fleet.read(tmp_path, "diagnoses").to_pylist()
    assert (done, row["damper"], row["effect"], row["verdict"]) == (1, "damper 0", None, "nothing_to_explain"), row["text"]
    assert row["before_rmse_n"] == pytest.approx(3.0, rel=0.1)


def test_processes_and_threads(recordings, tmp_path):
    with concurrent.futures.ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as processes:
        assert fleet.evaluate(recordings, MODEL, tmp_path / "processes", engine=processes) == (12, 0, [])
    with concurrent.futures.ThreadPoolExecutor(2) as threads:
        assert fleet.evaluate(recordings, MODEL, tmp_path / "threads", engine=threads) == (12, 0, [])
    assert fleet.read(tmp_path / "processes", "runs") == fleet.read(tmp_path / "threads", "runs")


def test_a_worker_of_dask_that_is_killed_loses_nothing(recordings, tmp_path):
    distributed = pytest.importorskip("distributed")
    alone = tmp_path / "alone"
    fleet.evaluate(recordings, MODEL, alone)
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0")
    with cluster, distributed.Client(cluster) as client:
        victims = sorted(client.run(os.getpid).values())

        def kill(done, of):
            if done == 4:
                os.kill(victims[0], signal.SIGKILL)

        assert fleet.evaluate(recordings, MODEL, tmp_path / "dask", engine=client, progress=kill) == (12, 0, [])
        assert set(client.run(os.getpid).values()) != set(victims), "a worker was killed"
    assert fleet.read(tmp_path / "dask", "runs") == fleet.read(alone, "runs")
    assert fleet.read(tmp_path / "dask", "residuals") == fleet.read(alone, "residuals")


@pytest.fixture(scope="module")
def aged(tmp_path_factory):
    """A recording a day of three dampers. The force of the last one fades by 8 % from the tenth day on."""
    return record(tmp_path_factory.mktemp("aged"), 3, 18, 50, lambda number, day: 0.92 if (number, day >= 10) == (2, True) else 1.0)


def test_ageing_is_found_and_nothing_else(aged, tmp_path):
    assert fleet.effect_values(aged, MODEL, tmp_path / "out", window=48.0) == (54, 0, [])
    found = fleet.ageing(tmp_path / "out")
    assert repr(found) == "Ageing(3 values of 3 dampers, 1 changed)"
    [row] = [row for row in found.rows if row["changed"]]
    assert (row["damper"], row["effect"], row["parameter"], row["days"]) == ("damper 2", "", "force_ratio", 18)
    assert -9.0 < row["change_low_percent"] < -8.0 < row["change_high_percent"] < -7.0
    noticed = row["changed_at"].date()
    assert datetime.timedelta(9) < noticed - BEGIN < datetime.timedelta(16)
    query = f"select damper from '{tmp_path}/out/ageing.parquet' where changed and change_percent < -5"
    assert duckdb.sql(query).fetchall() == [("damper 2",)]
    page = found.to_html()
    assert "1 of 3 dampers have changed" in page and "damper 2" in page
    found.save(tmp_path / "fleet.html")
    assert (tmp_path / "fleet.html").read_text() == page
    assert len(found.to_frame("pandas")) == 3


#: What a node writes: `node/src/watchdogs/fleet_rows/tests.rs` has the same text.
NODE_ROWS = """time,effect,form,parameter,running,value,low,high,displacement_std_m,velocity_rms_m_s,drive_share,window_s,model_hash
2026-11-27T08:59:59.000000001Z,,,force_ratio,1,1.5,1,2,1,1,0.25,60,abc
2026-11-27T08:59:59.000000001Z,coil_lag,one_tau,tau_s,1,,,,1,1,0.25,60,abc
"""


def test_rows_of_a_node_are_read_with_the_rest(aged, tmp_path):
    fleet.effect_values(aged[:1], MODEL, tmp_path, window=48.0)
    folder = tmp_path / "values/damper=car%201%2Ffront_left/day=2026-11-27"
    folder.mkdir(parents=True)
    (folder / "1795766400000000001.csv").write_text(NODE_ROWS)
    rows = fleet.read(tmp_path, "values").to_pylist()
    assert [row["damper"] for row in rows] == ["car 1/front_left"] * 2 + ["damper 0"]
    assert (rows[0]["effect"], rows[0]["value"], rows[0]["time"].nanosecond) == ("", 1.5, 1)
    assert (rows[1]["effect"], rows[1]["form"], rows[1]["value"]) == ("coil_lag", "one_tau", None)
    assert repr(fleet.ageing(tmp_path)) == "Ageing(2 values of 2 dampers, 0 changed)"
    # An infinite border of a region is a number.
    regions = tmp_path / "residuals/damper=a/day=2026-11-27"
    regions.mkdir(parents=True)
    head = "run,time,velocity_from_m_s,velocity_to_m_s,drive_from,drive_to,samples,mean_n,rmse_n"
    (regions / "1.csv").write_text(f"{head}\n,2026-11-27T08:59:59.000000001Z,-inf,-0.15,2,inf,3,-1.5,2\n")
    [region] = fleet.read(tmp_path, "residuals").to_pylist()
    assert (region["run"], region["velocity_from_m_s"], region["drive_to"], region["samples"]) == ("", -float("inf"), float("inf"), 3)


def test_stamps_that_count_from_the_start_of_a_recording_take_the_day(aged, tmp_path):
    """Two recordings a day, one of which is a minute longer, without dates in their stamps."""
    relative = []
    for recording in aged[:6]:
        for part in (1, 2):
            [run] = mr_damper.simulate("RP-APRBS", replicates=1, duration=50 * part, seed=part, effect=None)
            path = tmp_path / f"{recording.day}-{part}.csv"
            run.save(path)
            relative.append(fleet.Recording("r", recording.day, str(path)))
    assert fleet.effect_values(relative, MODEL, tmp_path / "out", window=48.0) == (6, 0, [])
    rows = fleet.read(tmp_path / "out", "values").to_pylist()
    assert [row["time"].date() for row in rows] == [row["day"] for row in rows]
    assert rows == sorted(rows, key=lambda row: row["time"])
    [row] = fleet.ageing(tmp_path / "out").rows
    assert (row["days"], row["windows"], row["changed"]) == (6, 18, False)


def test_recordings_that_overlap_are_a_failure(aged, tmp_path):
    copy = tmp_path / "copy.csv"
    copy.write_bytes(pathlib.Path(aged[0].path).read_bytes())
    twice = [aged[0], aged[0]._replace(path=str(copy))]
    _, _, [failure] = fleet.effect_values(twice, MODEL, tmp_path / "out", window=48.0)
    assert (failure.code, "leave one of the recordings out" in failure.message) == ("overlap", True)


def test_recordings_without_a_window_are_failures(aged, tmp_path):
    run = mr_damper.read_run(aged[0].path).traces()
    table = {"time_ns": np.frombuffer(run["displacement_m"][0], "i8")}
    table.update({name: np.frombuffer(values) for name, (_, values) in run.items() if name != "force_n"})
    mr_damper.read_run(table, map={"time": "time_ns,unit=ns"}).save(tmp_path / "no-force.csv")
    both = [aged[0], aged[0]._replace(damper="x", path=str(tmp_path / "no-force.csv"))]
    done, _, [short, without] = fleet.effect_values(both, MODEL, tmp_path / "out")
    assert (done, short.code, without.code) == (0, "no_window", "no_window")
    assert "they last 50 s" in short.message
    assert "force_n is missing" in without.message


def test_values_of_another_model_are_left_out(aged, tmp_path):
    fleet.effect_values(aged[:9], MODEL, tmp_path, window=48.0)
    fleet.effect_values(aged[9:18], "thesis/fuzzy-tanh/rp1-cs", tmp_path, window=48.0)
    with pytest.warns(mr_damper.MrDamperWarning, match="9 of 18 values are left out"):
        [row] = fleet.ageing(tmp_path).rows
    assert (row["windows"], row["days"]) == (9, 9)


@pytest.mark.parametrize("values", [[1.0] * 20, [1.0] * 20 + [0.9] * 20, [0.0] * 20 + [1.0, 2.0, 1.0], [1.0, float("nan"), 2.0] * 9])
@pytest.mark.parametrize("stroke_m", [0.01, 0.0, float("nan")])
def test_odd_values_are_no_error(values, stroke_m, tmp_path):
    begin_ns = int(datetime.datetime(2026, 11, 1, tzinfo=datetime.timezone.utc).timestamp()) * 10**9
    rows = [
        {"time": begin_ns + day * 86_400 * 10**9, "effect": "", "form": "", "parameter": "force_ratio", "value": value, "low": value, "high": value}
        for day, value in enumerate(values)
    ]
    excitation = {"displacement_std_m": stroke_m, "velocity_rms_m_s": 0.1, "drive_share": 0.2, "window_s": 60.0, "model_hash": "a"}
    _store.write(_store.file_of(str(tmp_path), "values", "a", BEGIN), "values", [{**row, **excitation} for row in rows], "key")
    [row] = fleet.ageing(tmp_path).rows
    assert row["windows"] == sum(value == value for value in values)


def test_quantiles_of_students_t():
    for degrees in (2.0, 2.5, 4.0, 9.0, 40.0):
        assert _ageing.t975(degrees) == pytest.approx(scipy.stats.t.ppf(0.975, degrees), rel=0.01)


def test_a_file_that_a_worker_left_behind_is_removed(recordings, tmp_path):
    fleet.evaluate(recordings[:1], MODEL, tmp_path)
    [made] = (tmp_path / "runs").glob("*/*/*.parquet")
    left = made.with_name(".0.part")
    left.write_bytes(b"PAR1")
    assert len(fleet.read(tmp_path, "runs")) == 1
    fleet.evaluate(recordings[:1], MODEL, tmp_path)
    assert not left.exists()


def test_a_file_is_written_although_another_call_removes_its_part(recordings, tmp_path, monkeypatch):
    replace, calls = os.replace, []

    def removed_once(new, path):
        calls.append(path)
        if len(calls) == 1:
            _store.remove_parts(str(tmp_path), "residuals")
        replace(new, path)

    monkeypatch.setattr(os, "replace", removed_once)
    assert fleet.evaluate(recordings[:1], MODEL, tmp_path) == (1, 0, [])
    assert len(calls) == 3


def test_a_pool_whose_process_dies_says_what_to_do(recordings, tmp_path):
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:

        def kill(done, of):
            if done == 2:
                [os.kill(process, signal.SIGKILL) for process in list(pool._processes)]

        with pytest.raises(concurrent.futures.BrokenExecutor, match="make a new pool, and call the function again"):
            fleet.evaluate(recordings, MODEL, tmp_path, engine=pool, progress=kill)
    done, kept, failures = fleet.evaluate(recordings, MODEL, tmp_path)
    assert (done + kept, failures) == (12, []) and kept >= 2


def test_many_failures_do_not_flood_the_log(recordings, tmp_path, caplog, capsys):
    caplog.set_level("INFO")
    path = str(broken(tmp_path, "bad.csv"))
    given = [recordings[0]._replace(damper=f"d{number}", path=path) for number in range(25)]
    assert len(fleet.evaluate(given, MODEL, tmp_path / "out", progress=True).failures) == 25
    levels = [record.levelname for record in caplog.records]
    assert levels == ["WARNING"] * 20 + ["INFO"] * 5 + ["WARNING"]
    assert caplog.records[-1].message.startswith("5 more failures")
    assert capsys.readouterr().err.endswith("25 of 25 tasks\n")
    with pytest.raises(mr_damper.Error, match="has no results; tasks have failed; table failures says why"):
        fleet.read(tmp_path / "out", "runs")


def test_a_task_is_plain_data(recordings):
    task = _tasks._task("evaluate", recordings[:1], "text", {"load": {}}, "/out")
    assert json.dumps(task, default=str)
    assert pathlib.Path(task.paths[0]).is_absolute()


def broken(folder, name):
    """A recording with a cell that is no number."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("time_s,displacement_m,force_n\n0,0,x\n")
    return path


def without_force(recording, path):
    """A copy of the recording without its force."""
    run = mr_damper.read_run(recording.path).traces()
    table = {"time_ns": np.frombuffer(run["displacement_m"][0], "i8") + 10**12}
    table.update({name: np.frombuffer(values) for name, (_, values) in run.items() if name != "force_n"})
    mr_damper.read_run(table, map={"time": "time_ns,unit=ns"}).save(path)
    return path


def test_the_readable_recordings_of_a_day_are_used(recordings, tmp_path, caplog):
    good = recordings[0]
    empty = tmp_path / "empty.csv"
    empty.write_text("")
    gone = tmp_path / "gone.csv"
    bad = broken(tmp_path, "bad.csv")
    silent = without_force(good, tmp_path / "silent.csv")
    others = [good._replace(path=str(path)) for path in (bad, empty, gone, silent)]
    out = tmp_path / "out"
    done, kept, failures = fleet.evaluate([good, *others, recordings[1]], MODEL, out)
    assert (done, kept) == (2, 0)
    assert fleet.read(out, "runs")["run"].to_pylist() == [good.path, recordings[1].path]
    assert {(pathlib.Path(failure.run).name, failure.code) for failure in failures} == {
        ("bad.csv", "cell"),
        ("empty.csv", "no_displacement"),
        ("gone.csv", "io"),
        ("silent.csv", "missing_channel"),
    }
    assert all(failure.run in failure.message and failure[:2] == good[:2] for failure in failures)
    # The log and a table have each of them.
    assert sorted(record.message.partition(": ")[2] for record in caplog.records) == sorted(failure.message for failure in failures)
    table = fleet.read(out, "failures").to_pylist()
    assert sorted((row["run"], row["code"], row["message"]) for row in table) == sorted((it.run, it.code, it.message) for it in failures)
    assert {(row["damper"], row["day"], row["task"], row["task_failed"]) for row in table} == {(*good[:2], "evaluate", False)}
    assert fleet.Outcome(done, kept, failures).to_frame("pandas")["run"].tolist() == [failure.run for failure in failures]


def test_a_failure_is_tried_again_if_asked_or_if_its_file_has_changed(recordings, tmp_path, caplog):
    good, alone = recordings[0], recordings[0]._replace(damper="z")
    bad = broken(tmp_path, "bad.csv")
    given = [good, good._replace(path=str(bad)), alone._replace(path=str(broken(tmp_path, "worse.csv")))]
    out = tmp_path / "out"
    first = fleet.evaluate(given, MODEL, out)
    assert (first.done, first.kept, len(first.failures)) == (1, 0, 2)
    made = [path.stat().st_mtime_ns for path in sorted(out.glob("*/*/*/*.parquet"))]
    caplog.clear()
    assert fleet.evaluate(given, MODEL, out) == (0, 1, first.failures)
    assert [path.stat().st_mtime_ns for path in sorted(out.glob("*/*/*/*.parquet"))] == made
    assert "retry_failures=True" in caplog.text
    assert fleet.evaluate(given, MODEL, out, retry_failures=True) == (1, 0, first.failures)
    # A recording that was repaired is used, and is a failure no longer.
    bad.write_bytes(pathlib.Path(recordings[1].path).read_bytes())
    again = fleet.evaluate(given, MODEL, out)
    assert (again.done, [failure.damper for failure in again.failures]) == (1, ["z"])
    assert sorted(fleet.read(out, "runs")["run"].to_pylist()) == sorted([good.path, str(bad)])
    assert fleet.read(out, "failures", ["damper", "task_failed"]).to_pylist() == [{"damper": "z", "task_failed": True}]


def test_a_recording_that_could_not_be_opened_is_tried_again(recordings, tmp_path, monkeypatch):
    given = [recordings[0], recordings[0]._replace(path=recordings[1].path)]

    def refused(path, **options):
        if path == recordings[1].path:
            raise mr_damper.Error(f"{path}: cannot open: Permission denied (os error 13)", "io", {"file": path})
        return mr_damper.read_run(path, **options)

    with monkeypatch.context() as patch:
        patch.setattr(_tasks, "read_run", refused)
        done, _, [failure] = fleet.evaluate(given, MODEL, tmp_path)
    assert (done, failure.code) == (1, "io")
    assert "can the workers open it" in failure.message
    assert fleet.evaluate(given, MODEL, tmp_path) == (1, 0, [])


def test_a_recording_that_is_gone_does_not_run_its_day_each_night(recordings, tmp_path):
    gone = tmp_path / "gone.csv"
    given = [recordings[0], recordings[0]._replace(path=str(gone))]
    first = fleet.evaluate(given, MODEL, tmp_path / "out")
    assert (first.done, [failure.run for failure in first.failures]) == (1, [str(gone)])
    assert fleet.evaluate(given, MODEL, tmp_path / "out") == (0, 1, first.failures)
    # A worker that died after it had written the failures has no results yet.
    [made] = (tmp_path / "out/runs").glob("*/*/*.parquet")
    made.unlink()
    assert fleet.evaluate(given, MODEL, tmp_path / "out") == (1, 0, first.failures)
    gone.write_bytes(pathlib.Path(recordings[1].path).read_bytes())
    assert fleet.evaluate(given, MODEL, tmp_path / "out") == (1, 0, [])
    assert len(fleet.read(tmp_path / "out", "failures")) == 0


def test_a_model_is_identified_without_the_recordings_that_fail(recordings, tmp_path):
    good = recordings[:3]
    silent = without_force(good[0], tmp_path / "silent.csv")
    bad = broken(tmp_path, "bad.csv")
    given = [*good, good[0]._replace(path=str(bad)), good[2]._replace(path=str(silent))]
    done, _, failures = fleet.identify(given, "fuzzy-tanh", out=tmp_path / "out", restarts=1, sets=3)
    assert (done, {failure.run: failure.code for failure in failures}) == (1, {str(bad): "cell", str(silent): "missing_channel"})
    assert fleet.identify(good, "fuzzy-tanh", out=tmp_path / "good", restarts=1, sets=3) == (1, 0, [])
    for table in ("models", "coefficients"):
        names = [name for name, _, _ in _store.TABLES[table] if name != "model_toml"]  # It has the time of the fit.
        assert fleet.read(tmp_path / "out", table, names) == fleet.read(tmp_path / "good", table, names)


def test_values_and_diagnoses_are_made_without_the_recordings_that_fail(aged, tmp_path):
    silent = without_force(aged[0], tmp_path / "silent.csv")
    bad = broken(tmp_path, "bad.csv")
    others = [aged[0]._replace(path=str(path)) for path in (bad, silent)]
    out = tmp_path / "out"
    done, _, failures = fleet.effect_values([aged[0], *others], MODEL, out, window=48.0)
    assert (done, {failure.run: failure.code for failure in failures}) == (1, {str(bad): "cell", str(silent): "missing_channel"})
    assert "has no force_n" in next(failure.message for failure in failures if failure.run == str(silent))
    fleet.effect_values(aged[:1], MODEL, tmp_path / "good", window=48.0)
    assert fleet.read(out, "values") == fleet.read(tmp_path / "good", "values")
    # The page about the fleet has them, too.
    page = fleet.ageing(out).to_html()
    assert "Recordings without values: 2" in page and str(bad) in page and str(silent) in page
    done, _, failures = fleet.close([*aged[:3], *others], MODEL, out=tmp_path / "diagnoses", fixed_base=True)
    assert (done, {failure.run for failure in failures}) == (1, {str(bad), str(silent)})
    [row] = fleet.read(tmp_path / "diagnoses", "diagnoses").to_pylist()
    assert row["verdict"] == "nothing_to_explain"


def test_wrong_options_are_refused_before_a_task_runs(recordings, tmp_path):
    class Never(concurrent.futures.Executor):
        def submit(self, *args, **options):
            raise AssertionError("a task was submitted")

    def message(function):
        with pytest.raises(mr_damper.Error) as caught:
            function()
        return type(caught.value), caught.value.code, str(caught.value)

    for model, options in [
        ("nope", {}),
        ("fuzzy-tanh", {"degree": 9}),
        ("fuzzy-tanh", {"sigma": 1.0}),
        ("fuzzy-tanh", {"huber": -3.0}),
        ("fuzzy-tanh", {"cutoff": -1.0}),
        ("fuzzy-tanh", {"drive": "amps"}),
        ("fuzzy-tanh", {"map_file": str(tmp_path / "absent.toml")}),
    ]:
        expected = message(lambda: mr_damper.DamperModel(model, **options).fit(recordings[0].path))
        assert message(lambda: fleet.identify(recordings, model, out=tmp_path / "out", engine=Never(), **options)) == expected
    with pytest.raises(TypeError, match="colour"):
        fleet.identify(recordings, out=tmp_path / "out", engine=Never(), colour=1)
    for options in ({"effects": ["zzz"]}, {"noise_floor": -3.0}, {"drive": "amps"}):
        message(lambda: fleet.close(recordings, MODEL, out=tmp_path / "out", engine=Never(), **options))
    message(lambda: fleet.evaluate(recordings, MODEL, tmp_path / "out", engine=Never(), sign={"force": 3}))
    message(lambda: fleet.effect_values(recordings, MODEL, tmp_path / "out", engine=Never(), drive="amps"))
    assert not (tmp_path / "out").exists()
