"""Results of the functions: records with fields, data frames, and reports."""

import html
import json
from typing import Any, Dict, Iterator, List, Optional, Tuple

from mr_damper import _native
from mr_damper._arrays import floats, ints
from mr_damper._errors import Error


class Record:
    """Read-only fields, by attribute (``record.free_run``) or key (``record["free_run"]``).

    The fields are those of the command's JSON; a value that is not known is ``None``.
    """

    _data: Dict[str, Any]

    def __init__(self, data: Dict[str, Any]) -> None:
        object.__setattr__(self, "_data", data)

    def __getattr__(self, name: str) -> Any:
        try:
            return _wrapped(self.__dict__["_data"][name])
        except KeyError:
            raise AttributeError(f"{type(self).__name__} has no field {name!r}; it has {', '.join(self)}") from None

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{type(self).__name__} is read-only")

    def __getitem__(self, name: str) -> Any:
        return _wrapped(self._data[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self.__dict__.get("_data", ()))

    def __len__(self) -> int:
        return len(self._data)

    def __contains__(self, name: object) -> bool:
        return name in self._data

    def __dir__(self) -> List[str]:
        return sorted({*super().__dir__(), *self._data})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Record) and self._data == other._data

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        fields = ", ".join(f"{name}={value!r:.60}" for name, value in self._data.items())
        return f"{type(self).__name__}({fields})"

    def __reduce__(self) -> Tuple[Any, ...]:
        return (type(self), (self._data,))

    def to_dict(self) -> Dict[str, Any]:
        """A copy as plain dicts, lists, strings and numbers."""
        return json.loads(json.dumps(self._data))  # type: ignore[no-any-return]


def _wrapped(value: Any) -> Any:
    if isinstance(value, dict):
        return Record(value)
    if isinstance(value, list):
        return [_wrapped(item) for item in value]
    return value


class FitResult(Record):
    """The figures of a fit, as ``mr-damper identify --json`` gives them.

    Errors are root mean squares in newtons (``rsse_n``) and normalised mean squares (``esr``, 1 - R²): ``training.free_run`` and
    ``validation.free_run`` of the simulation, ``one_step`` of the one-step-ahead prediction, ``persistence`` of the baseline.
    ``estimates`` lists parameters with standard errors, ``runs`` the training runs. ``swept`` is the model on sines over the whole range
    of the runs, and ``without_prior`` the fit by least squares alone, if that did there what no damper does.
    """

    _native_part: "Optional[_native.Identification]"

    def __init__(self, data: Dict[str, Any], native: "Optional[_native.Identification]" = None) -> None:
        super().__init__(data)
        object.__setattr__(self, "_native_part", native)

    @property
    def remarks(self) -> List[str]:
        """Sentences that a user should know before using the model."""
        return self._native_part.remarks if self._native_part is not None else list(self._data["warnings"])

    def to_html(self) -> str:
        """The report with plots of every run, one self-contained page. It is made when it is asked for."""
        if self._native_part is None:
            raise Error("the report needs the runs, which a copy of a result does not hold; call fit again", "no_runs")
        return self._native_part.html()

    def to_frame(self, table: str = "estimates", library: Optional[str] = None) -> Any:
        """``"estimates"`` (parameters with standard errors) or ``"runs"`` (training runs) as a data frame.

        Args:
            table: the table.
            library: ``"pandas"`` or ``"polars"``; by default the first that is installed.
        """
        return frame_of_rows(_choice(self._data, table, ("estimates", "runs")), library)

    def _repr_html_(self) -> str:
        return _embedded(self.to_html()) if self._native_part is not None else _table(self._data["estimates"])


class Evaluation(Record):
    """Errors of a model on runs, as ``mr-damper evaluate --json`` gives them: ``runs``, and ``other_runs`` over all runs that the model was
    not made with. Each has ``free_run``, ``free_run_without_offset``, ``one_step`` and ``persistence`` with ``rsse_n`` (RMSE, N), ``esr`` (NMSE)
    and ``samples``."""

    def to_frame(self, library: Optional[str] = None) -> Any:
        """One row a run as a data frame; nested fields are joined by ``_`` (``free_run_rsse_n``)."""
        return frame_of_rows(self._data["runs"], library)

    def _repr_html_(self) -> str:
        return _table([_flat(row) for row in self._data["runs"]])


class _Reported(Record):
    """A result with a report and a text."""

    _html: str
    _text: str

    def __init__(self, data: Dict[str, Any], html_page: str = "", text: str = "") -> None:
        super().__init__(data)
        object.__setattr__(self, "_html", html_page)
        object.__setattr__(self, "_text", text)

    def __reduce__(self) -> Tuple[Any, ...]:
        return (type(self), (self._data, self._html, self._text))

    def __str__(self) -> str:
        return self._text

    def to_html(self) -> str:
        """The report with plots, one self-contained page."""
        return self._html

    def _repr_html_(self) -> str:
        return _embedded(self._html)


class Closing(_Reported):
    """A diagnosis, as ``mr-damper close --json`` gives it: ``verdict``, ``effects`` with parameters and intervals, ``refused`` effects, the error
    before and after. ``str(closing)`` is the text of the command."""

    _model: Any

    def __init__(self, data: Dict[str, Any], html_page: str = "", text: str = "", model: Any = None) -> None:
        super().__init__(data, html_page, text)
        object.__setattr__(self, "_model", model)

    def __reduce__(self) -> Tuple[Any, ...]:
        return (type(self), (self._data, self._html, self._text, self._model))

    @property
    def model(self) -> Any:
        """The model with the effects that were found; ``None`` if none was found."""
        return self._model

    def to_frame(self, table: str = "effects", library: Optional[str] = None) -> Any:
        """The list ``table`` (``"effects"``, ``"refused"``, ``"confirm"``, ...) as a data frame."""
        lists = tuple(name for name, value in self._data.items() if isinstance(value, list))
        return frame_of_rows(_choice(self._data, table, lists), library)


class Comparison(_Reported):
    """A comparison of models, as ``mr-damper compare --json`` gives it: ``identification``, ``cross_validation``, ``persistence``, ``models``."""

    def to_frame(self, table: str = "cross_validation", library: Optional[str] = None) -> Any:
        """``"cross_validation"``, ``"identification"``, ``"persistence"``, ``"experiments"`` or ``"models"`` as a data frame."""
        tables = ("cross_validation", "identification", "persistence", "experiments", "models")
        return frame_of_rows(_choice(self._data, table, tables), library)


class Columns:
    """A table with a column for each attribute."""

    #: The columns with stamps in nanoseconds, with numbers, and the others.
    TIMES: Tuple[str, ...] = ("time_ns",)
    NUMBERS: Tuple[str, ...] = ()
    TEXTS: Tuple[str, ...] = ()

    time_ns: Any

    def __init__(self, columns: Dict[str, Any]) -> None:
        for name in self.TIMES:
            setattr(self, name, ints(columns[name]))
        for name in self.NUMBERS:
            setattr(self, name, floats(columns[name]))
        for name in self.TEXTS:
            setattr(self, name, columns[name])

    def __len__(self) -> int:
        return len(self.time_ns)

    def to_dict(self) -> Dict[str, Any]:
        """The columns by name."""
        return {name: getattr(self, name) for name in (*self.TIMES, *self.NUMBERS, *self.TEXTS)}

    def to_frame(self, library: Optional[str] = None) -> Any:
        """The columns as a data frame."""
        return frame(self.to_dict(), library)


class Prediction(Columns):
    """Forces of a model at each displacement of a run, as ``mr-damper predict`` writes them.

    Attributes (one value for each displacement; NaN where a value does not exist):
        time_ns: stamps in nanoseconds (int64).
        estimate_n: force that the node would publish, N.
        simulation_n: force of the simulation, from displacement and drive alone, N.
        one_step_n: one-step-ahead prediction from measured force, N.
        band_low_n, band_high_n: 90 % band of the estimate, N.
        measured_n: measured force, filtered like the model's output, N.
        residual_n: measured minus simulated reading of the load cell, N.
        band_calibrated, mode, validity, reasons: lists of bool and str.
    """

    NUMBERS = ("estimate_n", "simulation_n", "one_step_n", "band_low_n", "band_high_n", "measured_n", "residual_n")
    TEXTS = ("band_calibrated", "mode", "validity", "reasons")

    estimate_n: Any
    simulation_n: Any
    one_step_n: Any
    band_low_n: Any
    band_high_n: Any
    measured_n: Any
    residual_n: Any
    band_calibrated: List[bool]
    mode: List[str]
    validity: List[str]
    reasons: List[str]

    def __repr__(self) -> str:
        return f"Prediction({len(self)} displacements)"


class EffectValues(Columns):
    """Values of a model's effects over time, one row for each window and value.

    Attributes (NaN where the window does not determine a value):
        time_ns: stamp of the last sample of the window in nanoseconds (int64).
        effect, form, parameter: lists of str. The ratio of measured to expected force has an empty effect and the parameter ``force_ratio``;
            other names are those of model files and end in the unit.
        running: the value in the model; 1 for the ratio.
        value: the estimate.
        low, high: its 95 % interval, which contains chance alone.
        displacement_std_m, velocity_rms_m_s, drive_share: excitation of the window: standard deviation of displacement, m; effective
            velocity, m/s; mean drive as a share of the largest one in the data of the model.
    """

    NUMBERS = ("running", "value", "low", "high", "displacement_std_m", "velocity_rms_m_s", "drive_share")
    TEXTS = ("effect", "form", "parameter")

    effect: List[str]
    form: List[str]
    parameter: List[str]
    running: Any
    value: Any
    low: Any
    high: Any
    displacement_std_m: Any
    velocity_rms_m_s: Any
    drive_share: Any

    def __repr__(self) -> str:
        return f"EffectValues({len(self)} values)"


def frame(columns: Dict[str, Any], library: Optional[str] = None) -> Any:
    """A data frame of pandas or polars.

    Args:
        columns: the columns by name.
        library: ``"pandas"`` or ``"polars"``; by default the first that is installed.
    """
    for name in (library,) if library else ("pandas", "polars"):
        if name not in ("pandas", "polars"):
            raise Error(f"data frames of {name!r} are not known; give library=\"pandas\" or \"polars\"", "usage")
        try:
            module = __import__(name)
        except ImportError:
            continue
        return module.DataFrame(columns)  # type: ignore[no-untyped-call, unused-ignore]
    missing = library or "pandas nor polars"
    raise Error(f"{missing} is not installed; install one (pip install pandas), or use to_dict()", "no_frames")


def frame_of_rows(rows: List[Dict[str, Any]], library: Optional[str] = None) -> Any:
    """A data frame with one row for each dict; nested dicts become columns whose names are joined by ``_``."""
    flat = [_flat(row) for row in rows]
    names = list(dict.fromkeys(name for row in flat for name in row))
    return frame({name: [row.get(name) for row in flat] for name in names}, library)


def _flat(row: Dict[str, Any], prefix: str = "") -> Dict[str, Any]:
    out: Dict[str, Any] = {}
    for name, value in row.items():
        if isinstance(value, dict):
            out.update(_flat(value, f"{prefix}{name}_"))
        else:
            out[prefix + name] = value
    return out


def _choice(data: Dict[str, Any], table: str, known: Tuple[str, ...]) -> List[Dict[str, Any]]:
    if table not in known:
        raise Error(f"there is no table {table!r}; there are {', '.join(known)}", "usage", {"table": table, "known": list(known)})
    return data[table]  # type: ignore[no-any-return]


def _table(rows: List[Dict[str, Any]]) -> str:
    """An HTML table for a notebook."""
    if not rows:
        return "<p>no rows</p>"

    def cell(value: Any) -> str:
        return html.escape("" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value))

    head = "".join(f"<th>{html.escape(name)}</th>" for name in rows[0])
    body = "".join("<tr>" + "".join(f"<td>{cell(value)}</td>" for value in row.values()) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _embedded(page: str) -> str:
    """A whole page within a notebook. The page has styles of its own, which must not reach the notebook."""
    return f'<iframe srcdoc="{html.escape(page)}" style="width:100%;height:800px;border:0"></iframe>'
