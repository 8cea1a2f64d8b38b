"""Columns of numbers with and without NumPy."""

import array
from typing import Any, Tuple

#: Kind of a column for the native module, and its values.
Column = Tuple[str, Any]


def floats(data: bytes) -> Any:
    """The numbers in bytes of float64: a NumPy array, or an ``array.array`` without NumPy."""
    return _of(data, "d")


def ints(data: bytes) -> Any:
    """The numbers in bytes of int64."""
    return _of(data, "q")


def _of(data: bytes, code: str) -> Any:
    try:
        import numpy
    except ImportError:
        return array.array(code, data)
    # A read-only view on the bytes would surprise users who write into a result.
    return numpy.frombuffer(data, {"d": "f8", "q": "i8"}[code]).copy()


def column(name: str, values: Any, nan: str = "n") -> Column:
    """``values`` as the native module takes them: kind and data.

    Args:
        name: name of the column, for messages.
        values: one-dimensional: a NumPy array, a pandas Series, anything with the buffer protocol, or a sequence of numbers, in which
            ``None`` is an empty cell.
        nan: ``"n"``: NaN is an empty cell of a channel with a lower rate, and an error elsewhere; ``"e"``: NaN is an empty cell.
    """
    values = _of_series(values)
    if isinstance(values, list):
        return _of_sequence(name, values, nan)
    kind = getattr(getattr(values, "dtype", None), "kind", None)
    if kind in ("M", "m"):
        return "t", values.astype(f"{kind}8[ns]").tobytes()
    if kind is not None and kind in "fiub" and values.dtype.str[1:] not in ("f8", "i8"):
        # Unsigned numbers of 64 bits may exceed int64, and a float64 is exact for all that a stamp or a reading can be.
        values = values.astype("f8" if kind == "f" or values.dtype.str[1:] == "u8" else "i8")
    try:
        view = memoryview(values)
    except TypeError:
        return _of_sequence(name, values, nan)
    if view.ndim != 1:
        raise _wrong(name, f"has {view.ndim} dimensions; give a one-dimensional array")
    if view.format in ("d", "<d", "=d"):
        return nan, view.tobytes()
    if view.format in ("q", "l", "<q", "<l") and view.itemsize == 8:
        return "q", view.tobytes()
    if view.format is not None and view.format.lstrip("<=@") in "efbBhHiIlLqQ?":
        return _of_sequence(name, view.tolist(), nan)
    raise _wrong(name, f"holds values of the format {view.format!r}; give numbers")


def _of_series(values: Any) -> Any:
    """A column of a data frame as a NumPy array or, if cells are empty, as a list. Other objects are returned as they are."""
    library = type(values).__module__.partition(".")[0]
    if library == "pandas" and hasattr(values, "dtype"):
        if type(values.dtype).__module__.partition(".")[0] == "numpy":
            return values.to_numpy()
        if hasattr(values.dtype, "tz"):
            return values.dt.tz_convert("UTC").dt.tz_localize(None).to_numpy()
        # A nullable type: a missing value is an empty cell, and not a NaN that a computation gave.
        missing = values.isna()
        return [None if gone else value for gone, value in zip(missing, values)] if missing.any() else values.to_numpy()
    if hasattr(values, "to_numpy") and hasattr(values, "null_count"):
        count = values.null_count() if callable(values.null_count) else values.null_count
        if count:
            return values.to_list() if hasattr(values, "to_list") else values.to_pylist()
        return values.to_numpy()
    return values


def _of_sequence(name: str, values: Any, nan: str) -> Column:
    if isinstance(values, (str, bytes)) or not hasattr(values, "__iter__"):
        raise _wrong(name, f"is {values!r:.60}; give a sequence of numbers, one for each row")
    listed = list(values)
    try:
        if all(isinstance(value, int) for value in listed):
            return "q", array.array("q", listed).tobytes()
        if any(value is None for value in listed):
            return "o", [None if value is None else float(value) for value in listed]
        return nan, array.array("d", listed).tobytes()
    except (TypeError, ValueError, OverflowError) as error:
        raise _wrong(name, f"holds a value that is not a number ({error}); give numbers, or None for an empty cell") from None


def _wrong(name: str, why: str) -> Exception:
    from mr_damper._errors import Error

    return Error(f"column `{name}` {why}", "column", {"column": name, "why": why})
