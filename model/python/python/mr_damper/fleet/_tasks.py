"""The work on a fleet: tasks, and what a worker does with one."""

import datetime
import hashlib
import itertools
import json
import logging
import math
import os
import pathlib
import sys
import time
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple, TypeVar, Union

from mr_damper import _native
from mr_damper._errors import Error, UsageError
from mr_damper._functions import _load_options
from mr_damper._functions import close as close_one
from mr_damper._model import DamperModel
from mr_damper._options import LOAD_OPTIONS, load_words, words
from mr_damper._results import Closing, frame
from mr_damper._runs import check_load_options, read_run
from mr_damper.fleet import _engine, _store
from mr_damper.fleet._recordings import Recording, checked

ModelLike = Union[DamperModel, str, "os.PathLike[str]"]
Progress = Union[bool, Callable[[int, int], None], None]
Found = TypeVar("Found")
Rows = Dict[str, List[Dict[str, Any]]]
Traces = Dict[str, Tuple[bytes, bytes]]

_LOG = logging.getLogger("mr_damper.fleet")
#: Most failures of a call that the log has as warnings. The others have level INFO.
_MOST_WARNINGS = 20

#: Time by which the velocity of a region is taken to each side, s.
_SIDE_S = 0.01
_DAY_NS = 86_400_000_000_000
#: Time between two recordings whose stamps do not say it, ns.
_APART_NS = 60_000_000_000


class Failure(NamedTuple):
    """A recording that was left out, or a task that failed as a whole."""

    damper: str
    day: datetime.date
    """Day of the task: the day of the recording, or of the last recording of the damper (:func:`identify`, :func:`close`)."""
    code: str
    """Kind of the error: :attr:`mr_damper.Error.code`, or the name of another exception."""
    message: str
    """What failed, where, and what to do."""
    run: str = ""
    """Path of the recording; empty if the error is not of one recording."""


class Outcome(NamedTuple):
    """What a call did."""

    done: int
    """Tasks that were done, with all recordings or without those in ``failures``."""
    kept: int
    """Tasks whose results were there already."""
    failures: List[Failure]
    """Recordings that were left out, and tasks that failed, in this call or in an earlier one. The results that a failed task had before stay."""

    def __repr__(self) -> str:
        return f"Outcome(done={self.done}, kept={self.kept}, failures={len(self.failures)})"

    def to_frame(self, library: Optional[str] = None) -> Any:
        """The failures as a data frame of pandas or polars; the columns are the fields of :class:`Failure`."""
        return frame({name: [getattr(failure, name) for failure in self.failures] for name in Failure._fields}, library)


class _Task(NamedTuple):
    kind: str
    damper: str
    day: datetime.date
    paths: Tuple[str, ...]
    model_toml: Optional[str]
    options: Dict[str, Any]
    out: str
    key: str
    gone: Tuple[str, ...]
    """Those of ``paths`` that did not exist when the task was planned."""


class _Result(NamedTuple):
    """What a worker returns. It is not an exception, because no repetition mends an error of the data."""

    done: bool
    failures: List[Dict[str, Any]]
    """Rows of table ``failures``."""


def evaluate(
    recordings: Iterable[Recording],
    model: Union[ModelLike, Mapping[str, ModelLike]],
    out: Union[str, "os.PathLike[str]"],
    *,
    velocities: Sequence[float] = (-0.15, -0.05, 0.05, 0.15),
    drives: Sequence[float] = (0.5, 1.0, 1.5, 2.0),
    engine: Any = None,
    retries: int = 2,
    retry_failures: bool = False,
    progress: Progress = None,
    **options: Any,
) -> Outcome:
    """The errors of a model on each recording, and the residual by region of velocity and drive: tables ``runs`` and ``residuals``.

    Args:
        recordings: see :func:`find`. There is one task for each damper and day.
        model: a :class:`~mr_damper.DamperModel`, a model file or a preset; or a dict of them by damper.
        out: folder of the results; all workers must reach it under this path.
        velocities: borders of the regions of velocity, m/s, in ascending order.
        drives: borders of the regions of the drive, A or V.
        engine: a ``dask.distributed.Client``, the module ``ray``, an executor of ``concurrent.futures``, or ``None`` for this process.
        retries: how often Dask or Ray repeats a task that fails for another reason than its data.
        retry_failures: ``True`` repeats the tasks of which a recording failed in an earlier call. By default such a task is repeated only if its
            recordings, its model, its options or the version of the package have changed, or if a file could not be opened.
        progress: ``True`` writes progress to stderr; a function receives the number of tasks done and of all tasks.
        options: how recordings are read; see :func:`mr_damper.read_runs`.

    Returns:
        Numbers of tasks that were done and kept, and the failures: a recording that cannot be read or used is left out, and the rest of its day
        is used.

    Raises:
        UsageError: an argument is wrong. No task has run then.
    """
    _check_load(options)
    options = {"velocities": _borders("velocities", velocities), "drives": _borders("drives", drives), "load": options}
    return _run("evaluate", _by_day(recordings), _given(model), out, options, (engine, retries, retry_failures, progress))


def effect_values(
    recordings: Iterable[Recording],
    model: Union[ModelLike, Mapping[str, ModelLike]],
    out: Union[str, "os.PathLike[str]"],
    *,
    window: float = 60.0,
    engine: Any = None,
    retries: int = 2,
    retry_failures: bool = False,
    progress: Progress = None,
    **options: Any,
) -> Outcome:
    """The ratio of measured to expected force and the values of the model's effects over time: table ``values``.

    The rows are those of :meth:`mr_damper.DamperModel.effect_values`: one for each window and value. The recordings of a day share windows, in
    the order of their stamps. If these are not of the recording's day, or the day before or after, they count from the start of the
    recording: then recordings follow each other in the order of their paths, from the begin of the day on.

    Args:
        window: length of a window, s, at least 48. The recordings of a day must have more than that of motion with measured force, or the
            task is a failure: a window needs a residual, which begins when the model's filters have settled.
        recordings, model, out, engine, retries, retry_failures, progress, options: as in :func:`evaluate`.
    """
    window = _number("window", window, 48.0, 86400.0)
    _check_load(options)
    given = {"window": window, "load": options}
    return _run("effect_values", _by_day(recordings), _given(model), out, given, (engine, retries, retry_failures, progress))


def identify(
    recordings: Iterable[Recording],
    model: str = "fuzzy-tanh",
    *,
    out: Union[str, "os.PathLike[str]"],
    validate: float = 0.25,
    engine: Any = None,
    retries: int = 2,
    retry_failures: bool = False,
    progress: Progress = None,
    **options: Any,
) -> Outcome:
    """A model for each damper: tables ``models`` (errors, and the model file as text) and ``coefficients``.

    Args:
        recordings: see :func:`find`. There is one task for each damper; its results have the day of its last recording.
        model: structure, as in :class:`mr_damper.DamperModel`.
        validate: share of a damper's recordings, the last ones, that is not fitted; 0 for none. Recordings that failed do not count.
        out, engine, retries, retry_failures, progress: as in :func:`evaluate`.
        options: those of :class:`mr_damper.DamperModel`.

    Raises:
        UsageError: an argument is wrong, such as the name of the structure. No task has run then.
    """
    _check_identify(DamperModel(model, **options))
    validate = _number("validate", validate, 0.0, 0.9)
    options = {"options": {"model": model, **options}, "validate": validate}
    return _run("identify", _by_damper(recordings), None, out, options, (engine, retries, retry_failures, progress))


def close(
    recordings: Iterable[Recording],
    base: Union[ModelLike, Mapping[str, ModelLike], None] = None,
    *,
    out: Union[str, "os.PathLike[str]"],
    split: Tuple[float, float] = (0.5, 0.25),
    engine: Any = None,
    retries: int = 2,
    retry_failures: bool = False,
    progress: Progress = None,
    **options: Any,
) -> Outcome:
    """The physical effects that the model of each damper lacks: table ``diagnoses``, one row for each value of an effect.

    A damper without an effect has one row, with the verdict and the text of the diagnosis.

    Args:
        recordings: see :func:`find`. There is one task for each damper, which needs three recordings or more.
        base: the model of the damper; by default the diagnosis chooses the structure.
        split: shares of a damper's recordings, in time order, on which effects are searched and validated. The rest is read once, at the end.
        out, engine, retries, retry_failures, progress: as in :func:`evaluate`.
        options: those of :func:`mr_damper.close`.
    """
    load = _load_options(options)
    _check_load(load)
    groups = _by_damper(recordings)
    _check_close(_text_of(base, groups[0][0].damper, {}), options)
    search, confirm = (_number("split", share, 0.01, 0.98) for share in split)
    if search + confirm > 0.99:
        why = "leaves no recording for the test; the shares must sum to less than 1"
        raise UsageError(f"split is {split!r}, which {why}", "usage", {"name": "split"})
    given = {"split": [search, confirm], "options": options, "load": load}
    return _run("close", groups, base, out, given, (engine, retries, retry_failures, progress))


def models(out: Union[str, "os.PathLike[str]"]) -> Dict[str, DamperModel]:
    """The newest model of each damper in table ``models``, as :func:`evaluate`, :func:`effect_values` and :func:`close` take it."""
    rows = _store.read(out, "models", ["damper", "day", "model_toml"])
    newest = {row["damper"]: row["model_toml"] for row in sorted(rows.to_pylist(), key=lambda row: row["day"])}
    return {damper: DamperModel._of(_native.Model.from_toml(text)) for damper, text in newest.items()}


# Planning


def _number(name: str, value: Any, low: float, high: float) -> float:
    try:
        number = float(value) if not isinstance(value, str) else math.nan
    except (TypeError, ValueError):
        number = math.nan
    if not low <= number <= high:
        raise UsageError(f"{name} is {value!r:.80}; give a number from {low:g} to {high:g}", "usage", {"name": name})
    return number


def _borders(name: str, values: Any) -> List[float]:
    borders = [_number(name, value, -1e9, 1e9) for value in values]
    if any(low >= high for low, high in zip(borders, borders[1:])):
        raise UsageError(f"{name} is {values!r:.80}; give borders in ascending order", "usage", {"name": name})
    return borders


def _given(model: Any) -> Any:
    if model is None:
        raise UsageError("model is None; give a DamperModel, a model file, a preset, or a dict of them by damper", "usage", {"name": "model"})
    return model


def _by_day(recordings: Iterable[Recording]) -> List[List[Recording]]:
    return [list(group) for _, group in itertools.groupby(checked(recordings), key=lambda it: it[:2])]


def _by_damper(recordings: Iterable[Recording]) -> List[List[Recording]]:
    return [list(group) for _, group in itertools.groupby(checked(recordings), key=lambda it: it.damper)]


def _check_load(options: Dict[str, Any]) -> None:
    """Raises for an option that no recording could be read with.

    Raises:
        TypeError: there is no such option.
        UsageError: its value is wrong.
        Error: the file of the map cannot be read.
    """
    check_load_options(options)
    try:
        _native.Run.from_columns("options", [], load_words(options))
    except Error as error:
        # The table has no columns. It is read after the options.
        if error.code != "table":
            raise


def _check_identify(model: DamperModel) -> None:
    """Raises what ``model.fit`` would raise for each damper because of an option."""
    _check_load({name: value for name, value in model.get_params().items() if name in LOAD_OPTIONS})
    try:
        _native.identify(model._words(), [], [], None)
    except Error as error:
        # The options are checked before the number of runs.
        if error.code != "no_runs":
            raise


def _check_close(model_toml: Optional[str], options: Dict[str, Any]) -> None:
    """Raises what :func:`mr_damper.close` would raise for each damper because of an option; ``model_toml`` is the base of one of them."""
    base = None if model_toml is None else _native.Model.from_toml(model_toml)
    absent = os.path.join(os.sep, "no such folder", "run.csv")
    try:
        _native.close([*words(options), f"--estimate={absent}", f"--confirm={absent}"], base, [], None)
    except Error as error:
        # The options are checked before the runs are read.
        if error.code != "io":
            raise


def _run(
    kind: str,
    groups: List[List[Recording]],
    model: Any,
    out: Union[str, "os.PathLike[str]"],
    options: Dict[str, Any],
    how: Tuple[Any, int, bool, Progress],
) -> Outcome:
    engine, retries, retry_failures, progress = how
    _store.arrow()
    out = os.path.abspath(out)
    try:
        os.makedirs(out, exist_ok=True)
    except OSError as error:
        raise Error(f"{out}: {error.strerror}; give a folder that can be written", "io", {"file": out}) from None
    for table in [*TABLES_OF[kind], "failures"]:
        _store.remove_parts(out, table)
    texts: Dict[int, str] = {}
    waiting: List[_Task] = []
    failures: List[Failure] = []
    kept = done = ended = logged = 0
    for group in groups:
        task = _task(kind, group, _text_of(model, group[0].damper, texts), options, out)
        # A task writes its tables in order, so the last one says that all are there.
        made = _store.is_made(_store.file_of(out, TABLES_OF[kind][-1], task.damper, task.day), task.key)
        before = _store.rows_of(_failures_file(task))
        rows: List[Dict[str, Any]] = []
        if before is None:
            again = not made
        else:
            key, rows = before
            again = key != task.key or retry_failures or not (made or rows[0]["task_failed"])
            # A file that could not be opened may be open to the next worker. A file that was absent changes the key when it appears.
            again = again or any(row["code"] == "io" and row["run"] not in task.gone for row in rows)
        if again:
            waiting.append(task)
        else:
            kept += made
            failures.extend(_failures(task, rows))
    if failures:
        why = "because their recordings have not changed; give retry_failures=True to try them again"
        _LOG.warning("%d failures of an earlier call remain, %s", len(failures), why)
    show = _Shown(progress)
    for task, result in _engine.results(engine, _work, waiting, retries):
        if isinstance(result, UsageError):
            # An option is wrong, for every task.
            raise result
        ended += 1
        if isinstance(result, _Result):
            new = _failures(task, result.failures)
            done += result.done
        else:
            new = [Failure(task.damper, task.day, type(result).__name__, str(result))]
        if new:
            show.end_line()
        for failure in new:
            logged += 1
            level = logging.WARNING if logged <= _MOST_WARNINGS else logging.INFO
            _LOG.log(level, "%s of %s, %s: %s", kind, failure.damper, failure.day, failure.message)
        failures.extend(new)
        show(ended, len(waiting))
    if logged > _MOST_WARNINGS:
        _LOG.warning("%d more failures; see failures of the result, or table failures", logged - _MOST_WARNINGS)
    return Outcome(done, kept, sorted(failures))


def _task(kind: str, group: List[Recording], model_toml: Optional[str], options: Dict[str, Any], out: str) -> _Task:
    sources: List[List[Any]] = []
    for recording in group:
        try:
            stat = os.stat(recording.path)
            sources.append([recording.path, stat.st_size, stat.st_mtime_ns])
        except OSError:
            # The worker says why the file cannot be read. The key changes when the file is there.
            sources.append([recording.path, None, None])
    made_from = [_native.__version__, _store.LAYOUT, kind, model_toml, options, sources]
    key = hashlib.sha256(json.dumps(made_from, sort_keys=True, default=str).encode()).hexdigest()
    damper, day = group[-1].damper, group[-1].day
    gone = tuple(path for path, size, _ in sources if size is None)
    return _Task(kind, damper, day, tuple(recording.path for recording in group), model_toml, options, out, key, gone)


def _failures_file(task: _Task) -> pathlib.Path:
    """The file of the task's failures. The kinds of work share table ``failures``, so the file has the name of the kind."""
    return _store.file_of(task.out, "failures", task.damper, task.day).with_name(f"{task.kind}.parquet")


def _failures(task: _Task, rows: List[Dict[str, Any]]) -> List[Failure]:
    return [Failure(task.damper, task.day, row["code"], row["message"], row["run"]) for row in rows]


def _text_of(model: Any, damper: str, texts: Dict[int, str]) -> Optional[str]:
    """The text of the damper's model; ``texts`` keeps those that were read."""
    if isinstance(model, Mapping):
        if damper not in model:
            raise UsageError(f"model has no damper {damper!r}", "usage", {"name": "model", "damper": damper})
        model = model[damper]
    if model is None:
        return None
    if id(model) not in texts:
        texts[id(model)] = (model if isinstance(model, DamperModel) else DamperModel.load(model))._fitted().to_toml()
    return texts[id(model)]


class _Shown:
    """Progress: a line on stderr, a function of the user, or nothing."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._last_s = 0.0
        self._open = False

    def __call__(self, done: int, of: int) -> None:
        if callable(self._progress):
            self._progress(done, of)
        elif self._progress and (done == of or time.monotonic() - self._last_s > 1.0):
            self._last_s = time.monotonic()
            self._open = done != of
            sys.stderr.write(f"\r{done} of {of} tasks" + ("" if self._open else "\n"))
            sys.stderr.flush()

    def end_line(self) -> None:
        """Ends the line, so that what follows begins a new one."""
        if self._open:
            sys.stderr.write("\n")
            self._open = False


# Work


def _work(task: _Task) -> Union[_Result, UsageError]:
    """Runs a task and writes its tables. Errors of the data are a part of the result, because no repetition would mend them."""
    left_out: List[Dict[str, Any]] = []
    tables: Optional[Rows] = None
    try:
        tables = _KINDS[task.kind](task, left_out)
    except UsageError as error:
        return error
    except _NothingLeft:
        pass
    except Error as error:
        left_out.append(_failed("", error))
    rows = [{"task": task.kind, **row, "task_failed": tables is None} for row in left_out]
    # The failures are there before the results, so results never lack a recording without a reason.
    if rows:
        _store.write(_failures_file(task), "failures", rows, task.key)
    else:
        _store.remove(_failures_file(task))
    for table in TABLES_OF[task.kind] if tables is not None else []:
        _store.write(_store.file_of(task.out, table, task.damper, task.day), table, tables[table], task.key)  # type: ignore[index]
    return _Result(tables is not None, rows)


class _NothingLeft(Exception):
    """Each recording of the task has failed, and is in the list of those."""


def _failed(path: str, error: Error) -> Dict[str, Any]:
    """The row of a recording that failed, or with an empty path of the whole task."""
    return {"run": path, "code": error.code, "message": str(error)}


def _readable(task: _Task, load: Mapping[str, Any], left_out: List[Dict[str, Any]]) -> "List[_native.Run]":
    """The recordings that can be read; the others join ``left_out``.

    Raises:
        _NothingLeft: none can be read.
    """
    runs = []
    for path in task.paths:
        try:
            runs.append(read_run(path, **load))
        except UsageError:
            raise
        except Error as error:
            row = _failed(path, error)
            if error.code == "io":
                row["message"] += "; is the recording still there, and can the workers open it under this path?"
            left_out.append(row)
    if not runs:
        raise _NothingLeft
    return runs


def _usable(
    function: "Callable[[List[_native.Run]], Found]", runs: "List[_native.Run]", left_out: List[Dict[str, Any]]
) -> "Tuple[Found, List[_native.Run]]":
    """What ``function`` makes of the runs, and these runs. A run that an error names joins ``left_out``, and the function gets the others.

    Raises:
        _NothingLeft: an error names the last run.
        Error: an error that names no run.
    """
    while True:
        try:
            return function(runs), runs
        except UsageError:
            raise
        except Error as error:
            name = error.fields.get("run", error.fields.get("file"))
            rest = [run for run in runs if run.name != name]
            if len(rest) == len(runs):
                raise
            left_out.append(_failed(str(name), error))
            if not rest:
                raise _NothingLeft from None
            runs = rest


def _model_of(task: _Task) -> DamperModel:
    assert task.model_toml is not None
    return DamperModel._of(_native.Model.from_toml(task.model_toml))


def _evaluate(task: _Task, left_out: List[Dict[str, Any]]) -> Rows:
    model = _model_of(task)
    rows: List[Dict[str, Any]] = []
    regions: List[Dict[str, Any]] = []
    for run in _readable(task, task.options["load"], left_out):
        try:
            row, found = _evaluated(model, run, task.options)
        except Error as error:
            left_out.append(_failed(run.name, error))
            continue
        rows.append(row)
        regions.extend(found)
    if not rows:
        raise _NothingLeft
    return {"runs": rows, "residuals": regions}


def _evaluated(model: DamperModel, run: "_native.Run", options: Dict[str, Any]) -> Tuple[Dict[str, Any], List[Dict[str, Any]]]:
    """The row of table ``runs``, and the rows of table ``residuals``."""
    [figures] = model.evaluate(run).to_dict()["runs"]
    if figures["free_run"] is None:
        raise Error(f"{run.name}: no sample has a measured force and a simulated one", "no_force", {"file": run.name})
    traces = run.traces()
    time_ns = _begin_ns(traces)
    row = {
        "run": run.name,
        "sha256": run.sha256,
        "time": time_ns,
        "duration_s": run.duration_s,
        "samples": figures["free_run"]["samples"],
        "rmse_n": figures["free_run"]["rsse_n"],
        "nmse": figures["free_run"]["esr"],
        "one_step_rmse_n": (figures["one_step"] or {}).get("rsse_n"),
        "persistence_rmse_n": (figures["persistence"] or {}).get("rsse_n"),
        "offset_n": figures["offset_n"],
        "refused": figures["refused"],
    }
    found = _regions(traces, run.drive, model.predictions(run), options)
    return row, [{"run": run.name, "time": time_ns, **region} for region in found]


def _begin_ns(traces: Traces) -> int:
    return int.from_bytes(traces["displacement_m"][0][:8], sys.byteorder, signed=True)


def _regions(of_run: Traces, drive_name: Optional[str], predictions: Any, options: Dict[str, Any]) -> List[Dict[str, Any]]:
    """The residual in each region of velocity and drive that has samples."""
    import numpy as np

    traces = {name: (np.frombuffer(at, "i8"), np.frombuffer(values, "f8")) for name, (at, values) in of_run.items()}
    begin = predictions.time_ns[0]
    at_s = (predictions.time_ns - begin) * 1e-9
    stamps, displacement_m = traces["displacement_m"]
    moved_m = [np.interp(at_s + side, (stamps - begin) * 1e-9, displacement_m) for side in (-_SIDE_S, _SIDE_S)]
    velocity_m_s = (moved_m[1] - moved_m[0]) / (2.0 * _SIDE_S)
    drive = np.zeros_like(at_s)
    if drive_name is not None:
        held, values = traces[drive_name]
        drive = values[np.clip(np.searchsorted(held, predictions.time_ns, side="right") - 1, 0, None)]
    known = np.isfinite(predictions.residual_n)
    edges = [np.array([-np.inf, *options[name], np.inf]) for name in ("velocities", "drives")]
    places = [np.digitize(values[known], edge[1:-1]) for values, edge in zip((velocity_m_s, drive), edges)]
    residual_n, width = predictions.residual_n[known], len(edges[1]) - 1
    region = places[0] * width + places[1]
    size = (len(edges[0]) - 1) * width
    counts, sums, squares = (np.bincount(region, weights, size) for weights in (None, residual_n, residual_n**2))
    return [
        {
            "velocity_from_m_s": edges[0][at // width],
            "velocity_to_m_s": edges[0][at // width + 1],
            "drive_from": edges[1][at % width],
            "drive_to": edges[1][at % width + 1],
            "samples": int(counts[at]),
            "mean_n": sums[at] / counts[at],
            "rmse_n": (squares[at] / counts[at]) ** 0.5,
        }
        for at in np.flatnonzero(counts)
    ]


def _effect_values(task: _Task, left_out: List[Dict[str, Any]]) -> Rows:
    model, options = _model_of(task), task.options
    read = _readable(task, options["load"], left_out)
    needed = [name for name in ("force_n", model.model_.drive) if name]
    complete = [run for run in read if set(needed) <= set(run.channels)]
    for run in read if complete else []:
        if run not in complete:
            [lacking, *_] = [name for name in needed if name not in run.channels]
            error = Error(f"{run.name}: has no {lacking}, which the values of effects need; record it, or leave the recording out", "missing_channel")
            left_out.append(_failed(run.name, error))
    runs = _in_order(complete or read, task.day)
    found, runs = _usable(lambda some: model.effect_values(some, window=options["window"]), runs, left_out)
    values = found.to_dict()
    values["time"] = values.pop("time_ns")
    names = list(values)
    rows = [dict(zip(names, row)) for row in zip(*(_plain(values[name]) for name in names))]
    if not rows:
        missing = [name for name in needed if not all(name in run.channels for run in runs)]
        why = f"{missing[0]} is missing" if missing else f"they last {sum(run.duration_s for run in runs):.0f} s"
        raise Error(
            f"the recordings of the day make no whole window of {options['window']:g} s with measured force and motion: {why}",
            "no_window",
            {"damper": task.damper, "missing": missing},
        )
    made_with = {"window_s": options["window"], "model_hash": hashlib.sha256((task.model_toml or "").encode()).hexdigest()}
    return {"values": [{**row, **made_with} for row in rows]}


def _in_order(runs: "List[_native.Run]", day: datetime.date) -> "List[_native.Run]":
    """The runs of a day in the order of their stamps; runs whose stamps are of another day follow each other from the begin of the day on."""
    midnight_ns = int(datetime.datetime.combine(day, datetime.time(), datetime.timezone.utc).timestamp()) * 10**9
    begins_ns = [_begin_ns(run.traces()) for run in runs]
    if all(-_DAY_NS <= begin_ns - midnight_ns < 2 * _DAY_NS for begin_ns in begins_ns):
        order = sorted(range(len(runs)), key=begins_ns.__getitem__)
        for before, after in zip(order, order[1:]):
            if begins_ns[after] < begins_ns[before] + runs[before].duration_s * 1e9:
                raise Error(
                    f"{runs[after].name} begins before {runs[before].name} ends; leave one of the recordings out",
                    "overlap",
                    {"file": runs[after].name, "other": runs[before].name},
                )
        return [runs[at] for at in order]
    moved, at_ns = [], midnight_ns
    for run, begin_ns in zip(runs, begins_ns):
        moved.append(_moved(run, at_ns - begin_ns))
        at_ns += int(run.duration_s * 1e9) + _APART_NS
    return moved


def _moved(run: "_native.Run", by_ns: int) -> "_native.Run":
    """The run with stamps that are ``by_ns`` later."""
    import numpy as np

    traces = [(name, (np.frombuffer(at, "i8") + by_ns).tobytes(), values) for name, (at, values) in run.traces().items()]
    return _native.Run.from_traces(run.name, bytes.fromhex(run.sha256), run.drive, traces)


def _plain(column: Any) -> List[Any]:
    """The column as a list, in which a value that does not exist is ``None``."""
    return [None if isinstance(value, float) and value != value else value for value in (column if isinstance(column, list) else column.tolist())]


def _identify(task: _Task, left_out: List[Dict[str, Any]]) -> Rows:
    options = dict(task.options["options"])
    load = {name: options[name] for name in LOAD_OPTIONS if options.get(name) is not None}

    def held_out(runs: "List[_native.Run]") -> int:
        return min(round(float(task.options["validate"]) * len(runs)), len(runs) - 1)

    def fitted(runs: "List[_native.Run]") -> DamperModel:
        count = len(runs) - held_out(runs)
        return DamperModel(**options).fit(runs[:count], validate=runs[count:] or None)

    model, runs = _usable(fitted, _readable(task, load, left_out), left_out)
    result = model.result_.to_dict()  # type: ignore[union-attr]
    row: Dict[str, Any] = {"model": model.model, "training_runs": len(runs) - held_out(runs), "validation_runs": held_out(runs)}
    for role in ("training", "validation"):
        figures = (result[role] or {}).get("free_run") or {}
        row[f"{role}_rmse_n"], row[f"{role}_nmse"] = figures.get("rsse_n"), figures.get("esr")
    row["model_toml"] = model._fitted().to_toml()
    names = [name for name, _, _ in _store.TABLES["coefficients"]]
    return {"coefficients": [{name: each.get(name) for name in names} for each in result["estimates"]], "models": [row]}


def _close(task: _Task, left_out: List[Dict[str, Any]]) -> Rows:
    base = "auto" if task.model_toml is None else _model_of(task)

    def ends(runs: "List[_native.Run]") -> Tuple[int, int]:
        """Number of the first validation run, and of the first test run."""
        count = len(runs)
        if count < 3:
            raise Error(
                f"{task.damper} has {count} usable recordings, but a diagnosis needs three: to search effects, to validate them, and to test",
                "too_few_recordings",
                {"damper": task.damper, "recordings": count},
            )
        shares = [round(share * count) for share in itertools.accumulate(task.options["split"])]
        first = min(max(shares[0], 1), count - 2)
        return first, min(max(shares[1], first + 1), count - 1)

    def diagnosed(runs: "List[_native.Run]") -> Closing:
        first, second = ends(runs)
        return close_one(base, estimate=runs[:first], confirm=runs[first:second], test=runs[second:], **task.options["options"])

    found, runs = _usable(diagnosed, _readable(task, task.options["load"], left_out), left_out)
    data = found.to_dict()
    error = data["test"] or {}
    common = {
        "verdict": data["verdict"],
        "test_runs": len(runs) - ends(runs)[1],
        "before_rmse_n": (error.get("before") or {}).get("rsse_n"),
        "after_rmse_n": (error.get("after") or {}).get("rsse_n"),
        "text": str(found),
        "model_toml": None if found.model is None else found.model._fitted().to_toml(),
    }
    rows = []
    for each in [*data["effects"], *({"id": "term", **term} for term in data["terms"])]:
        for name, value in each["parameters"].items():
            low, high = each["ci95"].get(name, (None, None))
            rows.append({**common, "effect": each["id"], "parameter": name, "value": value, "low": low, "high": high})
    return {"diagnoses": rows or [common]}


#: Tables of each kind of work, in the order in which they are written.
TABLES_OF = {
    "evaluate": ["residuals", "runs"],
    "effect_values": ["values"],
    "identify": ["coefficients", "models"],
    "close": ["diagnoses"],
}
_KINDS: Dict[str, Callable[[_Task, List[Dict[str, Any]]], Rows]] = {
    "evaluate": _evaluate,
    "effect_values": _effect_values,
    "identify": _identify,
    "close": _close,
}
