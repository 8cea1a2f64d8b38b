"""The numbers are those of the command of the same wheel, bit-identical."""

import csv
import json
import pickle
import re

import numpy
import pandas
import polars
import pytest

import mr_damper
from conftest import DATA

# Training runs, validation runs, and the words and options of a quick fit, of each set of recorded runs.
SETS = {
    "utfsm-mr": (
        ["sine-10mm2hz-0.00a", "sine-10mm2hz-1.00a"],
        ["sine-10mm2hz-0.50a"],
        ["--model", "fuzzy-tanh", "--restarts", "2"],
        dict(model="fuzzy-tanh", restarts=2),
    ),
    "utfpr-mr": (
        ["ensaio1-1", "ensaio1-2", "ensaio-A-1", "ensaio-B-1"],
        ["ensaio-B-3"],
        ["--model", "sp", "--restarts", "2", "--velocity", "three-point"],
        dict(model="sp", restarts=2, velocity="three-point"),
    ),
    "nees-mr": (["ranran-50"], [], ["--model", "arx", "--rate", "300.48"], dict(model="arx", rate=300.48)),
    "dyno": (
        ["dyno-t1-1-1-18-18-s5-n10-150psi"],
        ["dyno-t1-1-1-18-18-s5-n10-50psi"],
        ["--model", "kwok", "--passive", "--restarts", "1", "--map", "measured_force=force_n,sign=-1"],
        dict(model="kwok", passive=True, restarts=1, map={"measured_force": "force_n,sign=-1"}),
    ),
    "emps": (["emps-estimation"], [], ["--model", "linear", "--passive"], dict(model="linear", passive=True)),
}


def assert_same_model(path, model, tmp_path):
    """The model file that the command wrote is the one that ``model`` writes, byte for byte except for the time of writing."""
    model.save(tmp_path / "own.toml")
    own, written = (re.sub(r'(?m)^date = "[^"]+"$', "date", file.read_text()) for file in (tmp_path / "own.toml", path))
    assert own == written


def assert_same_forces(path, prediction):
    """The table that ``mr-damper predict`` wrote has the bits of ``prediction``."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    for name in mr_damper.Prediction.NUMBERS:
        written = numpy.array([float(row[name] or "nan") for row in rows])
        own = getattr(prediction, name)
        assert numpy.where(numpy.isnan(own), 0, own).tobytes() == numpy.where(numpy.isnan(written), 0, written).tobytes(), name
        assert (numpy.isnan(own) == numpy.isnan(written)).all(), name
    for name in ("mode", "validity", "reasons"):
        assert [row[name] for row in rows] == getattr(prediction, name)


@pytest.mark.parametrize("name", SETS)
def test_fit_predict_and_evaluate_on_recorded_runs(name, tmp_path, command):
    training, held_out, words, options = SETS[name]
    if not (DATA / name).is_dir():
        pytest.skip(f"there is no folder {DATA / name} (MR_DAMPER_DATA)")
    training, held_out = ([DATA / name / f"{stem}.csv" for stem in stems] for stems in (training, held_out))
    out = tmp_path / "command.toml"
    validate = ["--validate", *held_out] if held_out else []
    report = tmp_path / "report.json"
    command("--quiet", "identify", *training, *words, "--out", out, *validate, "--json", report)
    model = mr_damper.DamperModel(**options).fit(training, validate=held_out)
    assert_same_model(out, model, tmp_path)
    figures, own = json.loads(report.read_text()), model.result_.to_dict()
    for document in (figures, own):
        del document["seconds"]
    assert own == figures
    load = [word for word in words if word.startswith("measured_force")]
    load = ["--map", *load] if load else []
    for run in training + held_out:
        command("--quiet", "predict", out, run, "--out", tmp_path / f"{run.stem}.csv", *load)
        assert_same_forces(tmp_path / f"{run.stem}.csv", model.predictions(run))
    # All runs of the set, also runs with another drive or sign: both give the same figures, or the same error.
    runs = sorted((DATA / name).glob("*.csv"))
    done = command("evaluate", out, *runs, "--json", *load, check=False)
    try:
        own = model.evaluate(runs).to_dict()
    except mr_damper.Error as error:
        assert (done.returncode, str(error) in done.stderr) == (1, True)
        return
    evaluated = json.loads(done.stdout)
    for document in (evaluated, own):
        del document["model"]
    assert own == evaluated


def test_a_model_from_frames_has_the_parameters_of_the_model_from_files(files, fitted):
    for read in (pandas.read_csv, polars.read_csv):
        model = mr_damper.DamperModel("fuzzy-tanh", restarts=2, sets=3).fit([read(files[0])], validate=read(files[1]))
        assert model.parameters == fitted.parameters
        assert model.result_.validation == fitted.result_.validation
        run = model.to_dict()["provenance"]["runs"][0]
        assert (run["name"], run["sha256"]) == ("runs[0]", fitted.to_dict()["provenance"]["runs"][0]["sha256"])


def test_the_inverse_and_the_report_are_those_of_the_command(files, tmp_path, command):
    out = tmp_path / "model.toml"
    words = ["--model", "sp", "--restarts", "1", "--inverse", "wang-hu", "--filter", "output", "--velocity", "slope", "--huber", "80"]
    command("--quiet", "identify", *words, files[0], "--out", out, "--report", tmp_path / "report.html")
    model = mr_damper.identify(files[0], "sp", restarts=1, inverse="wang-hu", filter="output", velocity="slope", huber=80.0)
    assert_same_model(out, model, tmp_path)
    assert without_seconds(model.result_.to_html()) == without_seconds((tmp_path / "report.html").read_text())
    assert "srcdoc" in model.result_._repr_html_()


def test_the_fis_file_is_that_of_the_command(files, tmp_path, command, fitted):
    words = ["--model", "anfis", "--passive", "--restarts", "1"]
    command("--quiet", "identify", *words, files[0], "--out", tmp_path / "model.toml", "--fis", tmp_path / "model.fis")
    model = mr_damper.identify(files[0], "anfis", passive=True, restarts=1)
    assert_same_model(tmp_path / "model.toml", model, tmp_path)
    (tmp_path / "own").mkdir()
    model.save(tmp_path / "own" / "model.fis")
    name = re.compile(r"(?m)^Name=.*$")
    own, written = (name.sub("", (tmp_path / path).read_text()) for path in ("own/model.fis", "model.fis"))
    assert own == written
    with pytest.raises(mr_damper.Error, match="fuzzy rules|rules"):
        fitted.save(tmp_path / "other.fis")


def without_seconds(page):
    """The report without the measured time."""
    return re.sub(r"\d+\.\d s", "T s", page)


@pytest.fixture(scope="module")
def lagging(tmp_path_factory):
    """Paths of three runs of a damper whose coil lags, and a model of the same damper without the lag."""
    options = dict(duration=24, plain=True)
    (healthy,) = mr_damper.simulate("RP-ICPS", replicates=1, seed=9, **options)
    runs = mr_damper.simulate("RP-ICPS", replicates=3, seed=8, effect={"coil_lag": 0.02}, **options)
    folder = tmp_path_factory.mktemp("lagging")
    paths = [folder / f"{number}.csv" for number in range(3)]
    for run, path in zip(runs, paths):
        run.save(path)
    return paths, mr_damper.DamperModel("fuzzy-tanh", restarts=2).fit(healthy)


def test_close_is_that_of_the_command(lagging, tmp_path, command):
    files, base = lagging
    options = dict(terms=0, effects=["friction", "coil_lag"], fixed_base=True)
    words = ["--terms", "0", "--effects", "friction,coil_lag", "--fixed-base"]
    base.save(tmp_path / "base.toml")
    out, report = tmp_path / "augmented.toml", tmp_path / "report.json"
    runs = ["--estimate", files[0], "--confirm", files[1], "--test", files[2]]
    command("--quiet", "close", "--base", tmp_path / "base.toml", *words, *runs, "--out", out, "--json", report)
    closing = mr_damper.close(base, estimate=files[0], confirm=files[1], test=files[2], **options)
    written, own = json.loads(report.read_text()), closing.to_dict()
    for document in (written, own):
        document.pop("model_file", None)
        document.pop("seconds")
    assert own == written
    # The planted effect, by its definition in the rig.
    (effect,) = closing.effects
    assert effect.id == "coil_lag"
    assert effect.ci95["tau_s"][0] < effect.parameters["tau_s"] < effect.ci95["tau_s"][1]
    assert effect.parameters["tau_s"] == pytest.approx(0.02, rel=0.1)
    assert_same_model(out, closing.model, tmp_path)
    assert closing.model.score(files[2]) > base.score(files[2])
    assert list(closing.to_frame("effects", "polars")["id"]) == ["coil_lag"]
    assert "<html" in closing.to_html()
    assert "srcdoc" in closing._repr_html_()
    assert "coil_lag" in str(closing)
    again = pickle.loads(pickle.dumps(closing))
    assert (again, again.to_html(), again.model.parameters) == (closing, closing.to_html(), closing.model.parameters)


def test_warnings_of_a_diagnosis_are_python_warnings(files):
    with pytest.warns(mr_damper.MrDamperWarning, match="there are no test runs"):
        with pytest.raises(mr_damper.Error, match="give at least 18 s of motion") as raised:
            mr_damper.close("linear", estimate=files[0], confirm=files[1], passive=True, terms=0)
    assert raised.value.code == "too_short"
    assert raised.value.needed_blocks == 6


def test_compare_is_that_of_the_command(files, tmp_path, command):
    report = tmp_path / "report.json"
    words = ["--models", "sp,arx", "--restarts", "1", "--train", files[0], "--test", files[1], files[2]]
    command("--quiet", "compare", *words, "--json", report)
    comparison = mr_damper.compare(files[0], files[1:], models=["sp", "arx"], restarts=1)
    written, own = json.loads(report.read_text()), comparison.to_dict()

    def figures(document):
        del document["models"]
        for row in document["identification"]:
            del row["seconds"]
        return document

    assert figures(own) == figures(written)
    assert len(comparison.to_frame("identification")) == len(comparison.identification)
    with pytest.raises(mr_damper.Error, match="there is no table 'absent'; there are cross_validation"):
        comparison.to_frame("absent")


def test_compare_takes_a_folder(folder):
    comparison = mr_damper.compare(runs_dir=folder, models=["linear"], passive_only=True)
    assert {row.experiment for row in comparison.experiments} == {"RP3-CS"}


def test_frames_with_one_name_are_kept_apart(files):
    tables = [pandas.read_csv(path) for path in files]
    comparison = mr_damper.compare(tables[0], tables[1:], models=["linear"], passive_only=True)
    hashes = [row.sha256 for row in comparison.experiments]
    assert len(set(hashes)) == 3
    with pytest.raises(mr_damper.Error, match="has the same content as"):
        mr_damper.close("linear", estimate=tables[0], confirm=tables[0], passive=True)
