"""DamperModel: predictions, steps, files, errors, scikit-learn."""

import copy
import inspect
import math
import pickle
import re
import subprocess
import sys

import numpy
import pandas
import polars
import pytest

import mr_damper


def test_predict_gives_one_force_for_each_displacement(files, fitted):
    run = mr_damper.read_run(files[2])
    force_n = fitted.predict(run)
    assert (force_n.dtype, force_n.shape) == (numpy.float64, (len(run),))
    (measured_n,) = [numpy.frombuffer(values) for name, (_, values) in run.traces().items() if name == "force_n"]
    rmse_n = math.sqrt(numpy.nanmean((force_n - measured_n) ** 2))
    evaluated = fitted.evaluate(run).runs[0].free_run
    assert rmse_n == pytest.approx(evaluated.rsse_n, rel=1e-9)
    assert fitted.score(run) == pytest.approx(1 - evaluated.esr, rel=1e-12)
    # The score by its definition: NMSE over the variance.
    variance_n2 = numpy.var(measured_n[~numpy.isnan(force_n)])
    assert fitted.score(run) == pytest.approx(1 - rmse_n**2 / variance_n2, rel=1e-12)
    both = fitted.predict([files[2], run])
    assert [one.tobytes() for one in both] == [force_n.tobytes()] * 2


def test_a_prediction_is_a_frame(files, fitted):
    prediction = fitted.predictions(files[2])
    for library, kind in (("pandas", pandas.DataFrame), ("polars", polars.DataFrame)):
        frame = prediction.to_frame(library)
        assert isinstance(frame, kind)
        assert list(frame.columns) == list(prediction.to_dict())
        assert numpy.array_equal(frame["simulation_n"].to_numpy(), prediction.simulation_n, equal_nan=True)


def test_one_step_ahead_needs_a_model_that_uses_force(files, fitted):
    arx = mr_damper.DamperModel("arx").fit(files[0])
    ahead_n = arx.predict(files[2], steps_ahead=1)
    evaluated = arx.evaluate(files[2]).runs[0]
    measured_n = arx.predictions(files[2]).measured_n
    rmse_n = math.sqrt(numpy.nanmean((ahead_n - measured_n) ** 2))
    assert rmse_n == pytest.approx(evaluated.one_step.rsse_n, rel=1e-9)
    assert evaluated.one_step.rsse_n < evaluated.free_run.rsse_n
    with pytest.raises(mr_damper.UsageError, match="steps_ahead=1 needs a model that predicts from measured force"):
        fitted.predict(files[2], steps_ahead=1)
    with pytest.raises(mr_damper.UsageError, match="steps_ahead is 2; give 1"):
        arx.predict(files[2], steps_ahead=2)


@pytest.mark.parametrize("name", ["arx", "fuzzy-tanh"])
def test_steps_are_the_prediction_of_the_run(files, name):
    model = mr_damper.DamperModel(name, restarts=1).fit(files[0])
    table = pandas.read_csv(files[2]).iloc[:2000]
    whole = model.predictions(table)
    for _ in range(2):
        rows = table[["time_s", "displacement_m", "current_a", "force_n"]].itertuples(index=False)
        steps = [model.step(t, displacement_m=x, current_a=i, force_n=f) for t, x, i, f in rows]
        for column in mr_damper.Prediction.NUMBERS:
            own = numpy.array([getattr(step, column) for step in steps])
            assert numpy.array_equal(own, getattr(whole, column), equal_nan=True), column
        assert [step.mode for step in steps] == whole.mode
        model.reset()


def test_a_step_reports_what_it_refuses(fitted):
    model = mr_damper.DamperModel.load("thesis/fuzzy-tanh/rp3-cs")
    assert model.step(0.0, current_a=1.0) is None
    assert model.step(0.001, displacement_m=0.0).validity
    with pytest.warns(mr_damper.MrDamperWarning, match="displacement: the value is not finite"):
        model.step(0.002, displacement_m=float("nan"))
    with pytest.raises(mr_damper.UsageError, match="either as time_s or as time_ns"):
        model.step(displacement_m=0.0)
    with pytest.raises(mr_damper.Error, match="give a finite time"):
        model.step(float("nan"), displacement_m=0.0)


def test_a_model_is_saved_loaded_and_pickled(tmp_path, files, fitted):
    fitted.save(tmp_path / "model.toml")
    force_n = fitted.predict(files[2])
    for again in (mr_damper.DamperModel.load(tmp_path / "model.toml"), pickle.loads(pickle.dumps(fitted)), copy.deepcopy(fitted)):
        assert again.predict(files[2]).tobytes() == force_n.tobytes()
        assert again.parameters == fitted.parameters
    assert set(fitted.parameters) >= {"a1_n", "a2_n_s_m"} or fitted.parameters
    with pytest.raises(mr_damper.Error, match="absent.toml"):
        mr_damper.DamperModel.load("absent.toml")


def test_a_result_has_fields_and_frames(fitted):
    result = fitted.result_
    assert result.training.free_run.rsse_n == result["training"]["free_run"]["rsse_n"] > 0
    assert list(result.to_frame()["parameter"]) == [row.parameter for row in result.estimates]
    assert len(result.to_frame("runs", "polars")) == 1
    with pytest.raises(AttributeError, match="has no field 'absent'"):
        result.absent
    with pytest.raises(AttributeError, match="read-only"):
        result.seed = 1
    again = pickle.loads(pickle.dumps(result))
    assert again == result
    assert "<table>" in again._repr_html_()
    with pytest.raises(mr_damper.Error, match="the report needs the runs"):
        again.to_html()


def test_errors_have_the_fields_of_their_kind(files):
    table = pandas.read_csv(files[0])
    with pytest.raises(mr_damper.Error, match="has no force_n") as raised:
        mr_damper.DamperModel("sp").fit(table.drop(columns="force_n"))
    assert (raised.value.code, raised.value.channel, raised.value.run) == ("missing_channel", "force_n", "runs")
    assert pickle.loads(pickle.dumps(raised.value)).fields == raised.value.fields
    with pytest.raises(mr_damper.Error, match="opposite signs") as raised:
        mr_damper.DamperModel("sp").fit(table.assign(force_n=-table["force_n"]))
    assert raised.value.code == "reversed_force"
    assert raised.value.correlation < 0
    with pytest.raises(mr_damper.UsageError, match="invalid value 'fuzy-tanh' for '--model .*a similar value exists: 'fuzzy-tanh'"):
        mr_damper.DamperModel("fuzy-tanh").fit(table)
    with pytest.raises(mr_damper.UsageError, match="invalid value '9' for '--degree"):
        mr_damper.DamperModel("sp", degree=9).fit(table)
    with pytest.raises(mr_damper.UsageError, match="y is given"):
        mr_damper.DamperModel("sp").fit(table, table["force_n"])
    with pytest.raises(mr_damper.NotFittedError, match="call fit"):
        mr_damper.DamperModel("sp").predict(table)
    with pytest.raises(mr_damper.Error, match="no runs to identify from"):
        mr_damper.DamperModel("sp").fit([])


def test_every_option_of_identify_is_an_option_of_the_model(command):
    text = command("identify", "--help").stdout
    # In Python, files are written by methods; printing, progress and logs are the caller's.
    others = {"out", "fis", "report", "json", "validate", "quiet", "log_format", "help", "version", "coefficients", "bootstrap", "units"}
    flags = {flag.replace("-", "_") for flag in re.findall(r"^ +(?:-\w, )?--([a-z-]+)", text, re.MULTILINE)} - others
    options = set(inspect.signature(mr_damper.DamperModel).parameters)
    assert {"fit_variant" if flag == "fit" else flag for flag in flags} == options


def test_options_and_clones(files):
    clone = pytest.importorskip("sklearn.base").clone
    model = mr_damper.DamperModel("sp", restarts=1, centres=[0.0, 1.0], map={"time": "time_s"})
    again = clone(model)
    assert again.get_params() == model.get_params()
    assert repr(again) == "DamperModel('sp', restarts=1, centres=[0.0, 1.0], map={'time': 'time_s'})"
    assert again.set_params(degree=1).degree == 1
    with pytest.raises(mr_damper.UsageError, match="'degre' is not an option"):
        again.set_params(degre=1)


@pytest.mark.filterwarnings("ignore:the runs alone do not determine the model")  # each holds few levels of the current
def test_cross_validation_over_runs(files):
    selection = pytest.importorskip("sklearn.model_selection")
    search = selection.GridSearchCV(mr_damper.DamperModel("sp", restarts=1), {"degree": [1, 2]}, cv=3, error_score="raise")
    search.fit(list(files))
    assert search.best_params_["degree"] in (1, 2)
    expected = mr_damper.DamperModel("sp", restarts=1, degree=1).fit(files[1:]).score(files[0])
    assert search.cv_results_["split0_test_score"][0] == pytest.approx(expected, rel=1e-12)


def test_the_library_works_without_numpy(files, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import sys\n"
        "for name in ('numpy', 'pandas', 'polars', 'pyarrow', 'sklearn'): sys.modules[name] = None\n"
        "import mr_damper\n"
        "runs = mr_damper.simulate('sine', duration=3)\n"
        "model = mr_damper.DamperModel.load('thesis/fuzzy-tanh/rp3-cs')\n"
        "force_n = model.predict(runs[0])\n"
        "assert force_n.typecode == 'd' and len(force_n) == len(runs[0])\n"
        "try: model.predictions(runs[0]).to_frame()\n"
        "except mr_damper.Error as error: assert error.code == 'no_frames'\n"
        "else: raise SystemExit('no error')\n"
        "print(model.evaluate(runs[0]).runs[0].free_run.rsse_n)\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) > 0


def test_columns_and_signs_of_others(files):
    pandas = pytest.importorskip("pandas")
    table = pandas.read_csv(files[0], comment="#")
    force = next(name for name in table.columns if name.startswith("force"))
    other = table.rename(columns={force: "F"})
    other["F"] = -other["F"]
    model = mr_damper.DamperModel("sp", restarts=1)
    expected = model.fit(table).parameters
    found = mr_damper.DamperModel("sp", restarts=1, column={force: "F"}, sign={"force": -1}).fit(other).parameters
    assert found == expected
