"""The numbers are those of the command of the same wheel, bit-identical."""

import csv
import json

import numpy
import pandas
import polars
import pytest

import mr_damper
from conftest import DATA

# Training run, validation run, and the words and options of a quick fit, of each set of recorded runs.
SETS = {
    "utfsm-mr": ("*1A*", ["--model", "fuzzy-tanh", "--restarts", "2"], dict(model="fuzzy-tanh", restarts=2)),
    "utfpr-mr": ("ensaio-A-*", ["--model", "sp", "--restarts", "2"], dict(model="sp", restarts=2)),
    "nees-mr": ("*", ["--model", "arx", "--rate", "300.48"], dict(model="arx", rate=300.48)),
    "dyno": ("*", ["--model", "kwok", "--passive", "--restarts", "1"], dict(model="kwok", passive=True, restarts=1)),
    "emps": ("*", ["--model", "linear", "--passive"], dict(model="linear", passive=True)),
}


def assert_same_model(path, model, tmp_path):
    """The model file that the command wrote is the one that ``model`` writes, byte for byte."""
    model.save(tmp_path / "own.toml")
    assert (tmp_path / "own.toml").read_bytes() == path.read_bytes()


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
    pattern, words, options = SETS[name]
    if not (DATA / name).is_dir():
        pytest.skip(f"there is no folder {DATA / name} (MR_DAMPER_DATA)")
    runs = sorted((DATA / name).glob(f"{pattern}.csv"))[:3]
    training, held_out = runs[:2], runs[2:]
    validate = ["--validate", *held_out] if held_out else []
    out = tmp_path / "command.toml"
    done = command("--quiet", "identify", *words, *training, "--out", out, "--json", *validate, check=False)
    if done.returncode != 0:
        # The command refuses these runs: so does the function, with the same sentence.
        with pytest.raises(mr_damper.Error) as raised:
            mr_damper.DamperModel(**options).fit(training, validate=held_out)
        assert str(raised.value) in done.stderr
        pytest.fail(f"{name}: {done.stderr}")
    model = mr_damper.DamperModel(**options).fit(training, validate=held_out)
    assert_same_model(out, model, tmp_path)
    figures = json.loads(done.stdout)
    own = model.result_.to_dict()
    for report in (figures, own):
        del report["seconds"]
    assert own == figures
    for run in runs:
        command("--quiet", "predict", out, run, "--out", tmp_path / f"{run.stem}.csv")
        assert_same_forces(tmp_path / f"{run.stem}.csv", model.predictions(run))
    evaluated = json.loads(command("evaluate", out, *runs, "--json").stdout)
    own = mr_damper.evaluate(model, runs).to_dict()
    for report in (evaluated, own):
        del report["model"]
    assert own == evaluated


def test_a_model_from_frames_has_the_parameters_of_the_model_from_files(files, fitted):
    for read in (pandas.read_csv, polars.read_csv):
        model = mr_damper.DamperModel("fuzzy-tanh", restarts=2, sets=3).fit([read(files[0])], validate=read(files[1]))
        assert model.parameters == fitted.parameters
        assert model.result_.validation == fitted.result_.validation
        run = model.to_dict()["provenance"]["runs"][0]
        assert (run["name"], run["sha256"]) == ("runs[0]", fitted.to_dict()["provenance"]["runs"][0]["sha256"])


def test_the_inverse_the_fis_rules_and_the_report_are_those_of_the_command(files, tmp_path, command):
    out = tmp_path / "model.toml"
    words = ["--model", "sp", "--restarts", "1", "--inverse", "polynomial", "--filter", "output", "--velocity", "slope", "--huber", "80"]
    command("--quiet", "identify", *words, files[0], "--out", out, "--report", tmp_path / "report.html")
    model = mr_damper.identify(files[0], "sp", restarts=1, inverse="polynomial", filter="output", velocity="slope", huber=80.0)
    assert_same_model(out, model, tmp_path)
    assert without_seconds(model.result_.to_html()) == without_seconds((tmp_path / "report.html").read_text())
    assert "srcdoc" in model.result_._repr_html_()


def without_seconds(page):
    """The report without the measured time."""
    import re

    return re.sub(r"\d+\.\d s", "T s", page)


def test_close_is_that_of_the_command(files, tmp_path, command, fitted):
    options = dict(terms=0, effects=["friction", "gas_spring", "coil_lag"], fixed_base=True)
    words = ["--terms", "0", "--effects", "friction,gas_spring,coil_lag", "--fixed-base"]
    fitted.save(tmp_path / "base.toml")
    out = tmp_path / "augmented.toml"
    runs = ["--estimate", files[0], "--confirm", files[1], "--test", files[2]]
    report = tmp_path / "report.json"
    command("--quiet", "close", "--base", tmp_path / "base.toml", *words, *runs, "--out", out, "--json", report)
    with pytest.warns(mr_damper.MrDamperWarning, match="the base was made with this validation run"):
        closing = mr_damper.close(fitted, estimate=files[0], confirm=files[1], test=files[2], **options)
    written, own = json.loads(report.read_text()), closing.to_dict()
    for document in (written, own):
        document.pop("model_file", None)
        document.pop("seconds", None)
    assert own == written
    assert (closing.model is not None) == out.exists()
    if closing.model is not None:
        assert closing.model.to_dict() == mr_damper.DamperModel.load(out).to_dict()
    assert "<html" in closing.to_html()
    assert "srcdoc" in closing._repr_html_()
    assert str(closing).strip()


def test_a_planted_effect_is_found_and_added():
    runs = mr_damper.simulate("RP3-CS", replicates=3, duration=25, plain=True, perfect=True, effect={"gas_spring": 6000.0})
    base = mr_damper.simulate("RP3-CS", replicates=1, duration=25, plain=True, perfect=True, seed=7)
    model = mr_damper.DamperModel("fuzzy-tanh", restarts=2).fit(base)
    closing = mr_damper.close(
        model, estimate=runs[0], confirm=runs[1], test=runs[2], effects=["gas_spring", "inertia"], terms=0, fixed_base=True
    )
    assert "gas_spring" in [effect.id for effect in closing.effects]
    assert closing.model.score(runs[2]) > model.score(runs[2])
    frame = closing.to_frame()
    assert len(frame) == len(closing.effects)


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


def test_a_refused_diagnosis_has_a_code_and_fields(files):
    with pytest.raises(mr_damper.Error) as raised:
        mr_damper.close("linear", estimate=files[0], confirm=files[1], passive=True, noise_floor=1e6, terms=0)
    assert raised.value.code not in ("other", "usage")
    assert isinstance(raised.value.fields, dict)
