"""The work on a fleet: tasks, and what a worker does with one."""

import datetime
import hashlib
import itertools
import json
import math
import os
import sys
import time
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from mr_damper import _native
from mr_damper._errors import Error, UsageError
from mr_damper._functions import _load_options
from mr_damper._functions import close as close_one
from mr_damper._model import DamperModel
from mr_damper._runs import check_load_options, read_run
from mr_damper.fleet import _engine, _store
from mr_damper.fleet._recordings import Recording, checked

ModelLike = Union[DamperModel, str, "os.PathLike[str]"]
Progress = Union[bool, Callable[[int, int], None], None]
Rows = Dict[str, List[Dict[str, Any]]]
Traces = Dict[str, Tuple[bytes, bytes]]

#: Time by which the velocity of a region is taken to each side, s.
_SIDE_S = 0.01
_DAY_NS = 86_400_000_000_000
#: Time between two recordings whose stamps do not say it, ns.
_APART_NS = 60_000_000_000


class Failure(NamedTuple):
    """A task that failed. The next call tries it again."""

    damper: str
    day: datetime.date
    code: str
    """Kind of the error: :attr:`mr_damper.Error.code`, or the name of another exception."""
    message: str


class Outcome(NamedTuple):
    """What a call did."""

    done: int
    """Tasks that were done."""
    kept: int
    """Tasks whose results were there already."""
    failures: List[Failure]
    """Tasks that failed. The results that a task had before stay; if it never succeeded, it has none."""

    def __repr__(self) -> str:
        return f"Outcome(done={self.done}, kept={self.kept}, failures={len(self.failures)})"


class _Task(NamedTuple):
    kind: str
    damper: str
    day: datetime.date
    paths: Tuple[str, ...]
    model_toml: Optional[str]
    options: Dict[str, Any]
    out: str
    key: str


def evaluate(
    recordings: Iterable[Recording],
    model: Union[ModelLike, Mapping[str, ModelLike]],
    out: Union[str, "os.PathLike[str]"],
    *,
    velocities: Sequence[float] = (-0.15, -0.05, 0.05, 0.15),
    drives: Sequence[float] = (0.5, 1.0, 1.5, 2.0),
    engine: Any = None,
    retries: int = 2,
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
        progress: ``True`` writes progress to stderr; a function receives the number of tasks done and of all tasks.
        options: how recordings are read; see :func:`mr_damper.read_runs`.
    """
    check_load_options(options)
    options = {"velocities": _borders("velocities", velocities), "drives": _borders("drives", drives), "load": options}
    return _run("evaluate", _by_day(recordings), _given(model), out, options, engine, retries, progress)


def effect_values(
    recordings: Iterable[Recording],
    model: Union[ModelLike, Mapping[str, ModelLike]],
    out: Union[str, "os.PathLike[str]"],
    *,
    window: float = 60.0,
    engine: Any = None,
    retries: int = 2,
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
        recordings, model, out, engine, retries, progress, options: as in :func:`evaluate`.
    """
    window = _number("window", window, 48.0, 86400.0)
    check_load_options(options)
    given = {"window": window, "load": options}
    return _run("effect_values", _by_day(recordings), _given(model), out, given, engine, retries, progress)


def identify(
    recordings: Iterable[Recording],
    model: str = "fuzzy-tanh",
    *,
    out: Union[str, "os.PathLike[str]"],
    validate: float = 0.25,
    engine: Any = None,
    retries: int = 2,
    progress: Progress = None,
    **options: Any,
) -> Outcome:
    """A model for each damper: tables ``models`` (errors, and the model file as text) and ``coefficients``.

    Args:
        recordings: see :func:`find`. There is one task for each damper; its results have the day of its last recording.
        model: structure, as in :class:`mr_damper.DamperModel`.
        validate: share of a damper's recordings, the last ones, that is not fitted; 0 for none.
        out, engine, retries, progress: as in :func:`evaluate`.
        options: those of :class:`mr_damper.DamperModel`.
    """
    DamperModel(model, **options)
    validate = _number("validate", validate, 0.0, 0.9)
    options = {"options": {"model": model, **options}, "validate": validate}
    return _run("identify", _by_damper(recordings), None, out, options, engine, retries, progress)


def close(
    recordings: Iterable[Recording],
    base: Union[ModelLike, Mapping[str, ModelLike], None] = None,
    *,
    out: Union[str, "os.PathLike[str]"],
    split: Tuple[float, float] = (0.5, 0.25),
    engine: Any = None,
    retries: int = 2,
    progress: Progress = None,
    **options: Any,
) -> Outcome:
    """The physical effects that the model of each damper lacks: table ``diagnoses``, one row for each value of an effect.

    A damper without an effect has one row, with the verdict and the text of the diagnosis.

    Args:
        recordings: see :func:`find`. There is one task for each damper, which needs three recordings or more.
        base: the model of the damper; by default the diagnosis chooses the structure.
        split: shares of a damper's recordings, in time order, on which effects are searched and validated. The rest is read once, at the end.
        out, engine, retries, progress: as in :func:`evaluate`.
        options: those of :func:`mr_damper.close`.
    """
    load = _load_options(options)
    search, confirm = (_number("split", share, 0.01, 0.98) for share in split)
    if search + confirm > 0.99:
        why = "leaves no recording for the test; the shares must sum to less than 1"
        raise UsageError(f"split is {split!r}, which {why}", "usage", {"name": "split"})
    given = {"split": [search, confirm], "options": options, "load": load}
    return _run("close", _by_damper(recordings), base, out, given, engine, retries, progress)


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


def _run(
    kind: str,
    groups: List[List[Recording]],
    model: Any,
    out: Union[str, "os.PathLike[str]"],
    options: Dict[str, Any],
    engine: Any,
    retries: int,
    progress: Progress,
) -> Outcome:
    _store.arrow()
    out = os.path.abspath(out)
    try:
        os.makedirs(out, exist_ok=True)
    except OSError as error:
        raise Error(f"{out}: {error.strerror}; give a folder that can be written", "io", {"file": out}) from None
    for table in TABLES_OF[kind]:
        _store.remove_parts(out, table)
    texts: Dict[int, str] = {}
    waiting: List[_Task] = []
    failures: List[Failure] = []
    kept = done = ended = 0
    for group in groups:
        try:
            task = _task(kind, group, _text_of(model, group[0].damper, texts), options, out)
        except OSError as error:
            failures.append(Failure(group[-1].damper, group[-1].day, "io", f"{error.filename}: {error.strerror}; is the recording still there?"))
            continue
        # A task writes its tables in order, so the last one says that all are there.
        if _store.is_made(_store.file_of(out, TABLES_OF[kind][-1], task.damper, task.day), task.key):
            kept += 1
        else:
            waiting.append(task)
    show = _shown(progress)
    for task, result in _engine.results(engine, _work, waiting, retries):
        if isinstance(result, UsageError):
            # An option is wrong, for every task.
            raise result
        ended += 1
        if isinstance(result, BaseException):
            code = result.code if isinstance(result, Error) else type(result).__name__
            failures.append(Failure(task.damper, task.day, code, str(result)))
        else:
            done += 1
        show(ended, len(waiting))
    return Outcome(done, kept, sorted(failures))


def _task(kind: str, group: List[Recording], model_toml: Optional[str], options: Dict[str, Any], out: str) -> _Task:
    sources = []
    for recording in group:
        stat = os.stat(recording.path)
        sources.append([recording.path, stat.st_size, stat.st_mtime_ns])
    made_from = [_native.__version__, _store.LAYOUT, kind, model_toml, options, sources]
    key = hashlib.sha256(json.dumps(made_from, sort_keys=True, default=str).encode()).hexdigest()
    damper, day = group[-1].damper, group[-1].day
    return _Task(kind, damper, day, tuple(recording.path for recording in group), model_toml, options, out, key)


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


def _shown(progress: Progress) -> Callable[[int, int], None]:
    if callable(progress):
        return progress
    if not progress:
        return lambda done, of: None
    last = [0.0]

    def write(done: int, of: int) -> None:
        if done == of or time.monotonic() - last[0] > 1.0:
            last[0] = time.monotonic()
            sys.stderr.write(f"\r{done} of {of} tasks" + ("\n" if done == of else ""))
            sys.stderr.flush()

    return write


# Work


def _work(task: _Task) -> Optional[Error]:
    """Runs a task and writes its tables. Returns an error of its data, which no repetition would mend."""
    try:
        tables = _KINDS[task.kind](task)
    except Error as error:
        return error
    for table in TABLES_OF[task.kind]:
        _store.write(_store.file_of(task.out, table, task.damper, task.day), table, tables[table], task.key)
    return None


def _model_of(task: _Task) -> DamperModel:
    assert task.model_toml is not None
    return DamperModel._of(_native.Model.from_toml(task.model_toml))


def _evaluate(task: _Task) -> Rows:
    model, load = _model_of(task), task.options["load"]
    rows: List[Dict[str, Any]] = []
    regions: List[Dict[str, Any]] = []
    for path in task.paths:
        run = read_run(path, **load)
        [figures] = model.evaluate(run).to_dict()["runs"]
        if figures["free_run"] is None:
            raise Error(f"{path}: no sample has a measured force and a simulated one", "no_force", {"file": path})
        traces = run.traces()
        time_ns = _begin_ns(traces)
        rows.append(
            {
                "run": path,
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
        )
        found = _regions(traces, run.drive, model.predictions(run), task.options)
        regions.extend({"run": path, "time": time_ns, **region} for region in found)
    return {"runs": rows, "residuals": regions}


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


def _effect_values(task: _Task) -> Rows:
    model, options = _model_of(task), task.options
    runs = _in_order([read_run(path, **options["load"]) for path in task.paths], task.day)
    values = model.effect_values(runs, window=options["window"]).to_dict()
    values["time"] = values.pop("time_ns")
    names = list(values)
    rows = [dict(zip(names, row)) for row in zip(*(_plain(values[name]) for name in names))]
    if not rows:
        lacking = [name for name in ("force_n", model.model_.drive) if name and not all(name in run.channels for run in runs)]
        why = f"{lacking[0]} is missing" if lacking else f"they last {sum(run.duration_s for run in runs):.0f} s"
        raise Error(
            f"{task.damper}, {task.day}: the recordings make no whole window of {options['window']:g} s with measured force and motion: {why}",
            "no_window",
            {"damper": task.damper, "missing": lacking},
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


def _identify(task: _Task) -> Rows:
    options = dict(task.options["options"])
    count = len(task.paths)
    held_out = min(round(task.options["validate"] * count), count - 1)
    training, validation = task.paths[: count - held_out], task.paths[count - held_out :]
    model = DamperModel(**options).fit(list(training), validate=list(validation) or None)
    result = model.result_.to_dict()  # type: ignore[union-attr]
    row: Dict[str, Any] = {"model": model.model, "training_runs": len(training), "validation_runs": held_out}
    for role in ("training", "validation"):
        figures = (result[role] or {}).get("free_run") or {}
        row[f"{role}_rmse_n"], row[f"{role}_nmse"] = figures.get("rsse_n"), figures.get("esr")
    row["model_toml"] = model._fitted().to_toml()
    names = [name for name, _, _ in _store.TABLES["coefficients"]]
    return {"coefficients": [{name: each.get(name) for name in names} for each in result["estimates"]], "models": [row]}


def _close(task: _Task) -> Rows:
    count = len(task.paths)
    if count < 3:
        raise Error(
            f"{task.damper} has {count} recordings, but a diagnosis needs three: to search effects, to validate them, and to test",
            "too_few_recordings",
            {"damper": task.damper, "recordings": count},
        )
    ends = [round(share * count) for share in itertools.accumulate(task.options["split"])]
    first = min(max(ends[0], 1), count - 2)
    second = min(max(ends[1], first + 1), count - 1)
    runs = [read_run(path, **task.options["load"]) for path in task.paths]
    base = "auto" if task.model_toml is None else _model_of(task)
    found = close_one(base, estimate=runs[:first], confirm=runs[first:second], test=runs[second:], **task.options["options"])
    data = found.to_dict()
    error = data["test"] or {}
    common = {
        "verdict": data["verdict"],
        "test_runs": count - second,
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
_KINDS: Dict[str, Callable[[_Task], Rows]] = {
    "evaluate": _evaluate,
    "effect_values": _effect_values,
    "identify": _identify,
    "close": _close,
}
