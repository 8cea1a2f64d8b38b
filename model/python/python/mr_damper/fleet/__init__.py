"""Many dampers: identify, evaluate, follow and diagnose them from thousands of recordings, on Dask, on Ray, or on one machine.

    >>> from dask.distributed import Client
    >>> from mr_damper import fleet
    >>> recordings = fleet.find("recordings", r"(?P<damper>[^/]+)/(?P<day>\\d{4}-\\d\\d-\\d\\d)")
    >>> fleet.effect_values(recordings, "damper.toml", out="results", engine=Client())
    >>> fleet.ageing("results").save("fleet.html")

The work is split into tasks, one for each damper and day, or one for each damper. A task writes its rows into one Parquet file,
``results/values/damper=FL-017/day=2026-11-27/part.parquet``, which appears whole or not at all. A task that ran before is not run again,
unless its recordings, its model or its options have changed. So work that was interrupted goes on where it stopped, a task that ran twice
leaves one file, and DuckDB, Polars, pandas and pyarrow read the results while they grow.

It needs ``pip install 'mr-damper[fleet]'`` (NumPy and pyarrow), and the engine: ``pip install dask[distributed]`` or ``ray``.
"""

from mr_damper.fleet._ageing import Ageing, ageing
from mr_damper.fleet._recordings import Recording, find
from mr_damper.fleet._store import read
from mr_damper.fleet._tasks import Failure, Outcome, close, effect_values, evaluate, identify, models

__all__ = [
    "Ageing",
    "Failure",
    "Outcome",
    "Recording",
    "ageing",
    "close",
    "effect_values",
    "evaluate",
    "find",
    "identify",
    "models",
    "read",
]
