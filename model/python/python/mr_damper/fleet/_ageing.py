"""Ageing: how the values of each damper change over days, and a page about the fleet."""

import datetime
import html
import os
import pathlib
import statistics
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple, Union

from mr_damper import _native
from mr_damper._errors import Error, UsageError, warn
from mr_damper._results import _embedded, frame
from mr_damper.fleet import _store

#: Share of a damper's windows at the begin, and at the end, that are compared.
_SHARE = 0.2
#: Fewest windows of each, so that their means have an interval.
_FEWEST = 3
#: Effects of the load cell and its converter: the sensor has changed, not the damper.
_SENSOR = frozenset({"sensor_delay", "anti_alias_mismatch", "load_cell_drift"})

#: Most failures on the page.
_MOST_FAILURES = 200

_COLUMNS = (
    *("damper", "effect", "parameter", "days", "windows", "first", "last"),
    *("change_percent", "change_low_percent", "change_high_percent", "changed", "changed_at"),
)


class _Series(NamedTuple):
    """One value of one damper over time, without windows that do not determine it."""

    damper: str
    effect: str
    parameter: str
    time_ns: Any
    value: Any
    half: Any
    excitation: Any

    @property
    def name(self) -> str:
        return f"{self.effect}.{self.parameter}" if self.effect else self.parameter


class Ageing:
    """One row for each damper and value; ``changed`` says whether the value has changed, and ``change_percent`` by how much.

    Columns: ``damper``, ``effect`` and ``parameter`` (both as in table ``values``), ``days`` with data, ``windows``, ``first`` and ``last``
    (means of the first and the last fifth of the windows), ``change_percent`` from first to last with its 95 % interval, ``changed``, and
    ``changed_at``: the end of the window that completed the evidence. A value that changed and came back is ``changed`` with a small
    ``change_percent``, and a value near zero has a large one.

    ``failures`` are the rows of table ``failures`` of :func:`effect_values`: recordings and days without values.
    """

    def __init__(self, rows: List[Dict[str, Any]], series: List[_Series], days_per_alarm: float, failures: Sequence[Dict[str, Any]] = ()) -> None:
        self.rows = rows
        self.failures = list(failures)
        self._series = series
        self._days_per_alarm = days_per_alarm

    def __repr__(self) -> str:
        changed = sum(row["changed"] for row in self.rows)
        return f"Ageing({len(self.rows)} values of {len({row['damper'] for row in self.rows})} dampers, {changed} changed)"

    def to_frame(self, library: Optional[str] = None) -> Any:
        """The rows as a data frame of pandas or polars."""
        return frame({name: [row[name] for row in self.rows] for name in _COLUMNS}, library)

    def to_html(self) -> str:
        """A page about the fleet: the dampers and sensors that have changed, the clearest change first, with their values over time, and the failures."""
        return _page(self.rows, self._series, self._days_per_alarm, self.failures)

    def save(self, path: Union[str, "os.PathLike[str]"]) -> None:
        """Write the page."""
        pathlib.Path(path).write_text(self.to_html(), encoding="utf-8")

    def _repr_html_(self) -> str:
        return _embedded(self.to_html())


def ageing(out: Union[str, "os.PathLike[str]"], *, days_per_alarm: float = 1000.0) -> Ageing:
    """Which dampers and sensors of a fleet have changed, from the table ``values`` in ``out``.

    Each value is compared with those of earlier windows, most closely with windows of similar stroke, speed and drive, as a node does with
    ``effects.track``. If a damper has values of several models or lengths of windows, the newest ones count, and a warning says how many are left
    out. The result is also written to ``ageing.parquet`` in ``out``, one file for questions in SQL.

    Args:
        out: folder of the results of :func:`effect_values`.
        days_per_alarm: bound of false alarms: the mean number of days of a damper before one, over all its values together. It holds if the
            values scatter normally and independently about what the excitation explains.
    """
    if not isinstance(days_per_alarm, (int, float)) or not days_per_alarm >= 1.0:
        raise UsageError(f"days_per_alarm is {days_per_alarm!r}; give a number of days, 1 or more", "usage", {"name": "days_per_alarm"})
    series = list(_read(out))
    if not series:
        raise Error(f"{os.fspath(out)}: no window determines a value; it needs measured force and motion", "no_results", {"file": str(out)})
    failures = [row for row in _store.read(out, "failures").to_pylist() if row["task"] == "effect_values"]
    values_of: Dict[str, int] = {}
    for one in series:
        values_of[one.damper] = values_of.get(one.damper, 0) + 1
    rows = [_row(one, days_per_alarm * values_of[one.damper]) for one in series]
    pa = _store.arrow()
    columns = {name: [row[name] for row in rows] for name in _COLUMNS}
    columns["changed_at"] = pa.array(columns["changed_at"], pa.timestamp("us", tz="UTC"))
    _store.write_whole(pathlib.Path(out, "ageing.parquet"), pa.table(columns))
    return Ageing(rows, series, days_per_alarm, failures)


def _read(out: Union[str, "os.PathLike[str]"]) -> Iterator[_Series]:
    """The series of table ``values``."""
    import numpy as np

    excitation = ["displacement_std_m", "velocity_rms_m_s", "drive_share"]
    pa = _store.arrow()
    keys = ["damper", "effect", "parameter"]
    table = _newest(_store.read(out, "values", [*keys, "time", "value", "low", "high", "window_s", "model_hash", *excitation]))
    table = table.filter(pa.compute.is_finite(table["value"]).combine_chunks().fill_null(False))
    table = table.sort_by([(name, "ascending") for name in (*keys, "time")])
    names = list(zip(*(table[name].to_pylist() for name in keys)))
    time_ns = table["time"].cast(pa.int64()).to_numpy()
    value, low, high, stroke_m, speed_m_s, drive = (table[name].to_numpy() for name in ("value", "low", "high", *excitation))
    with np.errstate(divide="ignore", invalid="ignore"):
        described = np.column_stack([np.log(stroke_m), np.log(speed_m_s), drive])
    ends = [at for at in range(1, len(names)) if names[at] != names[at - 1]]
    for begin, end in zip([0, *ends], [*ends, len(names)]):
        if begin < end:
            part = slice(begin, end)
            damper, effect, parameter = names[begin]
            yield _Series(damper, effect, parameter, time_ns[part], value[part], 0.5 * (high[part] - low[part]), described[part])


def _newest(table: Any) -> Any:
    """The rows of each damper that were made like its newest one: with the same model and the same length of windows."""
    made_like = ["damper", "window_s", "model_hash"]
    groups = table.group_by(made_like).aggregate([("time", "max")]).sort_by("time_max")
    newest = {row["damper"]: {name: row[name] for name in made_like} for row in groups.to_pylist()}
    if len(newest) == len(groups):
        return table
    taken = _store.arrow().Table.from_pylist(list(newest.values()), schema=table.select(made_like).schema)
    kept = table.join(taken, made_like, join_type="inner")
    left_out = len(table) - len(kept)
    warn(f"{left_out} of {len(table)} values are left out: they were made with another model or window than the newest ones of their damper")
    return kept


def _row(one: _Series, days_per_alarm: float) -> Dict[str, Any]:
    import numpy as np

    days = len(np.unique(one.time_ns // 86_400_000_000_000))
    windows = len(one.value)
    flags = _native.changes(one.value.tolist(), one.half.tolist(), [tuple(z) for z in one.excitation.tolist()], days_per_alarm * windows / days)
    at = flags.index(True) if True in flags else None
    first, last, change, low, high = _change(one.value)
    return {
        "damper": one.damper,
        "effect": one.effect,
        "parameter": one.parameter,
        "days": days,
        "windows": windows,
        "first": first,
        "last": last,
        "change_percent": change,
        "change_low_percent": low,
        "change_high_percent": high,
        "changed": at is not None,
        "changed_at": None if at is None else _time(int(one.time_ns[at])),
    }


def _change(value: Any) -> Tuple[Optional[float], Optional[float], Optional[float], Optional[float], Optional[float]]:
    """Means of the first and the last fifth, and the change between them in percent with its 95 % interval (Welch)."""
    import numpy as np

    size = max(round(_SHARE * len(value)), _FEWEST)
    if len(value) < 2 * size:
        return None, None, None, None, None
    parts = value[:size], value[-size:]
    first, last = (float(np.mean(part)) for part in parts)
    errors = [float(np.var(part, ddof=1)) / size for part in parts]
    degrees = sum(errors) ** 2 / (sum(error**2 for error in errors) / (size - 1)) if sum(errors) > 0.0 else size - 1
    half = t975(degrees) * sum(errors) ** 0.5
    if first == 0.0:
        return first, last, None, None, None
    change, half = 100.0 * (last - first) / abs(first), 100.0 * half / abs(first)
    return first, last, change, change - half, change + half


def t975(degrees: float) -> float:
    """The 97.5 % quantile of Student's t, within 1 % from 2 degrees on.

    Source: G. W. Hill, *Algorithm 396: Student's t-quantiles*, Communications of the ACM 13, 1970, equation (1).
    """
    z = statistics.NormalDist().inv_cdf(0.975)
    terms = [
        (z**3 + z) / 4.0,
        (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0,
        (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0,
        (79.0 * z**9 + 776.0 * z**7 + 1482.0 * z**5 - 1920.0 * z**3 - 945.0 * z) / 92160.0,
    ]
    return z + sum(term / degrees ** (1 + power) for power, term in enumerate(terms))


# The page

_STYLE = """
:root { color-scheme: light dark; --line: #8884; --mark: #2a6fb0; --quiet: #777; }
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .3rem .6rem; border-bottom: 1px solid var(--line); white-space: nowrap; }
th:first-child, td:first-child, th:nth-child(2), td:nth-child(2), th:last-child, td:last-child { text-align: left; }
td:last-child { white-space: normal; overflow-wrap: anywhere; }
p.quiet, td.quiet { color: var(--quiet); } svg { display: block; } polyline { fill: none; stroke: var(--mark); stroke-width: 1.3; }
line { stroke: #c33; stroke-width: 1; stroke-dasharray: 2 2; }
"""


def _page(rows: Sequence[Dict[str, Any]], series: Sequence[_Series], days_per_alarm: float, failures: Sequence[Dict[str, Any]]) -> str:
    dampers = {row["damper"] for row in rows}
    changed = [(row, one) for row, one in zip(rows, series) if row["changed"]]
    changed.sort(key=lambda pair: -_clearness(pair[0]))
    groups = {
        "Dampers whose force has changed": [pair for pair in changed if not pair[0]["effect"]],
        "Dampers with a changed effect": [pair for pair in changed if pair[0]["effect"] and pair[0]["effect"] not in _SENSOR],
        "Sensors that have changed": [pair for pair in changed if pair[0]["effect"] in _SENSOR],
    }
    begin, end = min(int(one.time_ns[0]) for one in series), max(int(one.time_ns[-1]) for one in series)
    damper_days = sum({row["damper"]: row["days"] for row in rows}.values())
    parts = [
        "<!doctype html><html lang='en'><head><meta charset='utf-8'><meta name='viewport' content='width=device-width'>",
        f"<title>Fleet: {len(dampers)} dampers</title><style>{_STYLE}</style></head><body>",
        f"<h1>{len({row['damper'] for row, _ in changed})} of {len(dampers)} dampers have changed</h1>",
        f"<p>Data from {_time(begin):%Y-%m-%d} to {_time(end):%Y-%m-%d}: {sum(row['windows'] for row in rows)} values. "
        f"A damper without a change gives a false alarm once in {days_per_alarm:g} days at most, if its values scatter normally and "
        f"independently about what the excitation explains. So up to {damper_days / days_per_alarm:.0f} of the dampers "
        "below, most of them with small changes, may not have changed.</p>",
    ]
    for title, pairs in groups.items():
        parts.append(f"<h2>{title}: {len(pairs)}</h2>")
        if pairs:
            heads = ("damper", "value", "first", "last", "change", "95 % interval", "noticed", "over time")
            parts.append(f"<table><thead><tr>{''.join(f'<th>{head}</th>' for head in heads)}</tr></thead><tbody>")
            parts.extend(_table_row(row, one, begin, end) for row, one in pairs)
            parts.append("</tbody></table>")
        else:
            parts.append("<p class='quiet'>none</p>")
    if failures:
        parts.append(f"<h2>Recordings without values: {len(failures)}</h2>")
        parts.append("<table><thead><tr><th>damper</th><th>day</th><th>reason</th></tr></thead><tbody>")
        for failure in failures[:_MOST_FAILURES]:
            cells = failure["damper"], failure["day"].isoformat(), failure["message"]
            parts.append(f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in cells)}</tr>")
        parts.append("</tbody></table>")
        if len(failures) > _MOST_FAILURES:
            parts.append(f"<p class='quiet'>Table failures has the other {len(failures) - _MOST_FAILURES}.</p>")
    parts.append(
        "<p class='quiet'>First and last are means of the first and the last fifth of a damper's windows. The ratio is that of measured to expected "
        "force. What the base of a model lacks moves a value, too: diagnose a damper (mr_damper.close) before its name is believed.</p></body></html>"
    )
    return "".join(parts)


def _clearness(row: Dict[str, Any]) -> float:
    """The change over half of its interval; 0 if it is not known."""
    if row["change_percent"] is None:
        return 0.0
    return float(abs(row["change_percent"]) / max(row["change_high_percent"] - row["change_percent"], 1e-9))


def _time(time_ns: int) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(time_ns // 1000 / 1e6, datetime.timezone.utc)


def _table_row(row: Dict[str, Any], one: _Series, begin: int, end: int) -> str:
    def number(value: Optional[float], form: str = ".4g") -> str:
        return "" if value is None else format(value, form)

    interval = "" if row["change_low_percent"] is None else f"{row['change_low_percent']:+.1f} to {row['change_high_percent']:+.1f} %"
    change = "" if row["change_percent"] is None else f"{row['change_percent']:+.1f} %"
    names = html.escape(row["damper"]), html.escape(one.name)
    cells = [*names, number(row["first"]), number(row["last"]), change, interval, f"{row['changed_at']:%Y-%m-%d}"]
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + f"<td>{_curve(one, row['changed_at'], begin, end)}</td></tr>"


def _curve(one: _Series, changed_at: datetime.datetime, begin: int, end: int, width: int = 220, height: int = 34) -> str:
    """The values over time, with a line where the change was noticed."""
    low, high = float(one.value.min()), float(one.value.max())
    spread = (high - low) or 1.0

    def across(time_ns: int) -> float:
        return 2.0 + (width - 4.0) * (time_ns - begin) / max(end - begin, 1)

    step = max(len(one.value) // width, 1)
    points = " ".join(
        f"{across(int(time)):.1f},{height - 3 - (height - 6) * (float(value) - low) / spread:.1f}"
        for time, value in zip(one.time_ns[::step], one.value[::step])
    )
    noticed = across(int(changed_at.timestamp() * 1e9))
    mark = f"<line x1='{noticed:.1f}' x2='{noticed:.1f}' y1='0' y2='{height}'/>"
    label = html.escape(f"{one.name} of {one.damper}, {low:.4g} to {high:.4g}")
    return f"<svg width='{width}' height='{height}' role='img' aria-label='{label}'>{mark}<polyline points='{points}'/></svg>"
