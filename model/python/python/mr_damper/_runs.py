"""Runs from files, data frames and dictionaries."""

import os
from collections.abc import Iterable, Mapping
from typing import Any, List, Optional

from mr_damper import _arrays
from mr_damper._errors import Error, UsageError, warn
from mr_damper._native import Run
from mr_damper._options import load_words

_WHAT = (
    "a run is a path of a CSV file, rosbag2 directory or .mcap file, a mr_damper.Run, a dict of columns, a pandas DataFrame, or a table with "
    "the Arrow PyCapsule interface (polars, pyarrow, DuckDB)"
)


def read_runs(source: Any, *, name: Optional[str] = None, nan: str = "error", **options: Any) -> List[Run]:
    """Read recorded runs.

    Args:
        source: one run or a list of runs. A run is

            * a path of a CSV file, a rosbag2 directory, or an ``.mcap`` or ``.db3`` file,
            * a pandas DataFrame, a polars or pyarrow table, a DuckDB result, or a dict of columns, whose names have the unit:
              ``time_s``, ``displacement_m`` (or ``_mm``, ``_in``), ``force_n`` (``_kn``, ``_lbf``), ``current_a`` (``_ma``) or ``command_v``,
              and, if recorded, ``velocity_m_s``, ``case_temp_c``, ``body_velocity_m_s``, ``force_request_n``,
            * a :class:`Run`.

            Times are seconds; a column of time stamps or, with ``map={"time": "t,unit=ns"}``, of whole nanoseconds is exact at any epoch.
            A null is an empty cell: the channel has no sample at that time. NaN is an error, except in an array or pandas column whose
            samples are evenly spaced among NaNs: such a channel has a lower rate, like a thermocouple.
        name: name of a table in messages and model files; by default ``table``. Tables of a list are numbered.
        nan: ``"empty"``: NaN in arrays and pandas columns is an empty cell.
        options: as on the command line: ``skip_bad_rows`` (bool), ``thesis_txt`` (bool), ``drive`` (``"current_a"`` or ``"command_v"``),
            ``bag_namespace``, ``bag_joint``, ``dbc`` (path or list of paths, for logs of a CAN bus), ``map`` (dict of channel and source, or list of ``"CHANNEL=SOURCE[,sign=-1][,unit=U]"``),
            ``column`` (dict of a name of the run format and the column's own name, such as ``{"force_lbf": "F_lbf"}``), ``sign`` (dict
            of channel and -1, for a sensor that counts in the opposite direction), ``map_file``.

    Returns:
        The runs in order.

    Raises:
        Error: for a source that is not a run, wrong units, missing columns, cells that are not finite numbers, or stamps that do not increase.
    """
    check_load_options(options)
    if nan not in ("error", "empty"):
        raise UsageError(f'nan is {nan!r}; give "error" or "empty"', "usage", {"name": "nan"})
    words = load_words(options)
    if is_one(source):
        return [_read(source, name or "table", nan, words)]
    if isinstance(source, Iterable):
        return [_read(one, f"{name or 'table'}[{index}]", nan, words) for index, one in enumerate(source)]
    raise _not_a_run(source)


def read_run(source: Any, *, name: Optional[str] = None, nan: str = "error", **options: Any) -> Run:
    """Read one run; see :func:`read_runs`."""
    if not is_one(source):
        raise _not_a_run(source)
    return read_runs(source, name=name, nan=nan, **options)[0]


def load_options() -> Any:
    """Names of the options that say how runs are read."""
    from mr_damper._options import LOAD_OPTIONS

    return LOAD_OPTIONS


def check_load_options(options: Mapping[str, Any]) -> None:
    """Raises TypeError for an option that does not say how runs are read."""
    unknown = set(options) - set(load_options())
    if unknown:
        raise TypeError(f"unknown options: {', '.join(sorted(unknown))}; known are {', '.join(load_options())}")


def is_one(source: Any) -> bool:
    return isinstance(source, (str, os.PathLike, Run, Mapping)) or _is_pandas(source) or hasattr(source, "__arrow_c_stream__")


def _is_pandas(source: Any) -> bool:
    return type(source).__module__.partition(".")[0] == "pandas" and hasattr(source, "columns")


def _read(source: Any, name: str, nan: str, words: List[str]) -> Run:
    if isinstance(source, Run):
        return source
    if isinstance(source, (str, os.PathLike)):
        run = Run.read(os.fspath(source), words)
    elif isinstance(source, Mapping) or _is_pandas(source):
        run = _of_columns(source, name, nan, words)
    elif hasattr(source, "__arrow_c_stream__"):
        run = Run.from_arrow(name, source, words)
    else:
        raise _not_a_run(source)
    for note in run.notes:
        warn(f"{run.name}: {note}")
    return run


def _of_columns(source: Any, name: str, nan: str, words: List[str]) -> Run:
    columns = [(str(key), *_arrays.column(str(key), source[key], "e" if nan == "empty" else "n")) for key in _keys(source)]
    try:
        return Run.from_columns(name, columns, words)
    except Error as error:
        if error.code != "row" or error.fields.get("value") != "NaN":
            raise
        advice = '; or give nan="empty" to read_runs if NaN means that the channel has no sample'
        raise type(error)(f"{error}{advice}", error.code, error.fields) from None


def _keys(source: Any) -> List[Any]:
    keys = list(source.keys()) if isinstance(source, Mapping) else list(source.columns)
    repeated = next((key for key in keys if keys.count(key) > 1), None)
    if repeated is not None:
        raise Error(f"column `{repeated}` occurs twice; rename or remove one", "table", {"column": str(repeated)})
    return keys


def _not_a_run(source: Any) -> Error:
    return Error(f"{type(source).__name__} is not a run; {_WHAT}", "not_a_run", {"type": type(source).__name__})


