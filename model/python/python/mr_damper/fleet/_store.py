"""Results on disk: one Parquet file for each table, damper and day, and CSV files that nodes write."""

import datetime
import os
import pathlib
import urllib.parse
import uuid
from typing import Any, Dict, List, Optional, Sequence, Tuple, Union

from mr_damper._errors import Error, UsageError

#: Columns of each table: name, type, unit. The columns ``damper`` and ``day`` are in the names of the folders.
TABLES: Dict[str, List[Tuple[str, str, str]]] = {
    "runs": [
        ("run", "string", ""),
        ("sha256", "string", ""),
        ("time", "time", "UTC"),
        ("duration_s", "double", "s"),
        ("samples", "int", ""),
        ("rmse_n", "double", "N"),
        ("nmse", "double", "1"),
        ("one_step_rmse_n", "double", "N"),
        ("persistence_rmse_n", "double", "N"),
        ("offset_n", "double", "N"),
        ("refused", "int", ""),
    ],
    "hours": [
        ("time", "time", "UTC"),
        ("duration_s", "double", "s"),
        ("estimates", "int", ""),
        ("valid", "int", ""),
        ("residuals", "int", ""),
        ("rmse_n", "double", "N"),
        ("refused", "int", ""),
        ("mode_changes", "int", ""),
        ("alarms", "int", ""),
    ],
    "residuals": [
        ("run", "string", ""),
        ("time", "time", "UTC"),
        ("velocity_from_m_s", "double", "m/s"),
        ("velocity_to_m_s", "double", "m/s"),
        ("drive_from", "double", "A or V"),
        ("drive_to", "double", "A or V"),
        ("samples", "int", ""),
        ("mean_n", "double", "N"),
        ("rmse_n", "double", "N"),
    ],
    "values": [
        ("time", "time", "UTC"),
        ("effect", "string", ""),
        ("form", "string", ""),
        ("parameter", "string", "the unit ends the name"),
        ("running", "double", "that of the parameter"),
        ("value", "double", "that of the parameter"),
        ("low", "double", "that of the parameter"),
        ("high", "double", "that of the parameter"),
        ("displacement_std_m", "double", "m"),
        ("velocity_rms_m_s", "double", "m/s"),
        ("drive_share", "double", "1"),
        ("window_s", "double", "s"),
        ("model_hash", "string", ""),
    ],
    "models": [
        ("model", "string", ""),
        ("training_runs", "int", ""),
        ("training_rmse_n", "double", "N"),
        ("training_nmse", "double", "1"),
        ("validation_runs", "int", ""),
        ("validation_rmse_n", "double", "N"),
        ("validation_nmse", "double", "1"),
        ("model_toml", "string", ""),
    ],
    "coefficients": [
        ("parameter", "string", "the unit ends the name"),
        ("value", "double", "that of the parameter"),
        ("standard_error", "double", "that of the parameter"),
    ],
    "diagnoses": [
        ("verdict", "string", ""),
        ("effect", "string", ""),
        ("parameter", "string", "the unit ends the name"),
        ("value", "double", "that of the parameter"),
        ("low", "double", "that of the parameter"),
        ("high", "double", "that of the parameter"),
        ("test_runs", "int", ""),
        ("before_rmse_n", "double", "N"),
        ("after_rmse_n", "double", "N"),
        ("text", "string", ""),
        ("model_toml", "string", ""),
    ],
    "failures": [
        ("task", "string", ""),
        ("run", "string", ""),
        ("code", "string", ""),
        ("message", "string", ""),
        ("task_failed", "bool", ""),
    ],
}

#: Number of this layout: results of another one are made again.
LAYOUT = 1

#: Name of a file, and of the metadata that tell from what it was made.
_FILE = "part.parquet"
_KEY = b"mr_damper.key"


def arrow() -> Any:
    """The module pyarrow.

    Raises:
        Error: pyarrow or NumPy is not installed.
    """
    try:
        import numpy  # noqa: F401
        import pyarrow
        import pyarrow.compute
        import pyarrow.csv
        import pyarrow.dataset
        import pyarrow.parquet
    except ImportError as error:
        raise Error(f"{error.name} is not installed; install it with pip install 'mr-damper[fleet]'", "no_arrow") from None
    return pyarrow


def file_of(out: str, table: str, damper: str, day: datetime.date) -> pathlib.Path:
    """The file of a damper's day."""
    return pathlib.Path(out) / table / f"damper={urllib.parse.quote(damper, safe='')}" / f"day={day.isoformat()}" / _FILE


def is_made(path: pathlib.Path, key: str) -> bool:
    """True if ``path`` was made from what ``key`` stands for."""
    try:
        metadata = arrow().parquet.read_schema(path).metadata or {}
    except (OSError, ValueError):
        return False
    return bool(metadata.get(_KEY) == key.encode())


def rows_of(path: pathlib.Path) -> Optional[Tuple[str, List[Dict[str, Any]]]]:
    """What ``path`` was made from, and its rows; ``None`` if there is no such file or it is not whole."""
    try:
        table = arrow().parquet.ParquetFile(path).read()
    except (OSError, ValueError):
        return None
    return (table.schema.metadata or {}).get(_KEY, b"").decode(), table.to_pylist()


def remove(path: pathlib.Path) -> None:
    """Removes a file of a damper's day, if it is there."""
    path.unlink(missing_ok=True)


def write(path: pathlib.Path, table: str, rows: List[Dict[str, Any]], key: str) -> None:
    """Writes the rows in place of the file that was there."""
    schema = _schema(table).with_metadata({_KEY: key.encode()})
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, arrow().Table.from_pylist(rows, schema=schema))


def write_whole(path: pathlib.Path, table: Any) -> None:
    """Writes a ``pyarrow.Table`` in place of the file that was there. A reader sees the old file or the new one, whole."""
    # Readers take files that end in .parquet. One that a dying worker leaves behind does not.
    new = path.with_name(f".{uuid.uuid4().hex}.part")
    for last in (False, True):
        try:
            arrow().parquet.write_table(table, new, compression="zstd")
            os.replace(new, path)
            return
        except FileNotFoundError:
            # Another call that started meanwhile took the file for one that was left behind, and removed it.
            if last or not path.parent.is_dir():
                raise
        finally:
            new.unlink(missing_ok=True)


def _schema(table: str) -> Any:
    pa = arrow()
    types = {"string": pa.string(), "double": pa.float64(), "int": pa.int64(), "bool": pa.bool_(), "time": pa.timestamp("ns", tz="UTC")}
    return pa.schema([pa.field(name, types[kind], metadata={"unit": unit} if unit else None) for name, kind, unit in TABLES[table]])


def remove_parts(out: str, table: str) -> None:
    """Removes what workers that died left behind."""
    for part in pathlib.Path(out, table).glob("damper=*/day=*/.*.part"):
        part.unlink(missing_ok=True)


def read(out: Union[str, "os.PathLike[str]"], table: str, columns: Optional[Sequence[str]] = None) -> Any:
    """A table of the results as ``pyarrow.Table``, sorted by damper and day.

    Args:
        out: folder of the results.
        table: ``"runs"``, ``"residuals"``, ``"values"``, ``"models"``, ``"coefficients"``, ``"diagnoses"``, ``"failures"``, or ``"hours"``, which
            nodes write. Table ``failures`` has a row for each recording that was left out, and for each task that failed as a whole:
            ``task`` is the function (``"evaluate"``, ...), ``run`` the path of the recording (empty if the error is not of one recording),
            ``code`` and ``message`` are the code and the text of the :class:`mr_damper.Error`, ``task_failed`` is true if the task has no results.
        columns: names of the columns; by default all, ``damper`` and ``day`` first.

    Returns:
        The table. Names of dampers are text, even if they consist of digits. Table ``failures`` is empty if nothing has failed.

    Raises:
        Error: the folder has no such table.
    """
    if table not in TABLES:
        raise UsageError(f"there is no table {table!r}; there are {', '.join(TABLES)}", "usage", {"table": table})
    known = ["damper", "day", *(name for name, _, _ in TABLES[table])]
    names = known if columns is None else list(columns)
    if isinstance(columns, str) or not set(names) <= set(known):
        raise UsageError(f"columns is {columns!r}; give a list of names among {', '.join(known)}", "usage", {"name": "columns"})
    pa = arrow()
    folder = pathlib.Path(out, table)
    # Nodes write CSV.
    convert = pa.csv.ConvertOptions(column_types=_schema(table), strings_can_be_null=False)
    formats = {"*.parquet": pa.dataset.ParquetFileFormat(), "*.csv": pa.dataset.CsvFileFormat(convert_options=convert)}
    keys = pa.schema([("damper", pa.string()), ("day", pa.date32())])
    whole = pa.schema([*_schema(table), *keys])
    found = []
    for pattern, form in formats.items():
        files = sorted(str(path) for path in folder.glob(f"damper=*/day=*/{pattern}"))
        if files:
            parts = pa.dataset.partitioning(keys, flavor="hive")
            found.append(pa.dataset.dataset(files, whole, form, partitioning=parts, partition_base_dir=str(folder)))
    if not found and table == "failures" and folder.parent.is_dir():
        return whole.empty_table().select(names).replace_schema_metadata(None)
    if not found:
        failed = any(pathlib.Path(out, "failures").glob("damper=*/day=*/*.parquet"))
        advice = "tasks have failed; table failures says why" if failed else "write them with mr_damper.fleet"
        raise Error(f"{folder} has no results; {advice}", "no_results", {"file": str(folder)})
    data = pa.concat_tables([each.to_table(columns=names).replace_schema_metadata(None) for each in found])
    return data if len(found) == 1 else data.sort_by([(name, "ascending") for name in ("damper", "day", "time") if name in names])
