"""Recordings of a fleet: which file is of which damper and day."""

import datetime
import os
import pathlib
import re
from typing import Iterator, List, NamedTuple, Union

from mr_damper._errors import Error, UsageError


class Recording(NamedTuple):
    """A recorded run of a damper."""

    damper: str
    """Name of the damper."""
    day: datetime.date
    """Day of the recording."""
    path: str
    """A CSV file, rosbag2 directory, ``.mcap`` file or log of a CAN bus. All workers must find it under this path."""


def find(folder: Union[str, "os.PathLike[str]"], pattern: str) -> List[Recording]:
    """The recordings below ``folder``, in the order of damper, day and path.

    Args:
        folder: the folder. A directory with a ``metadata.yaml`` is one rosbag2 recording.
        pattern: regular expression with the groups ``damper`` and ``day`` (``2026-11-27`` or ``20261127``), searched in the path below the
            folder, which has ``/`` on every system. Files that it does not match are left out.

    Raises:
        UsageError: the pattern has no group ``damper`` or ``day``, or a day is no date.
        Error: the pattern matches no file.
    """
    compiled = re.compile(pattern)
    if missing := {"damper", "day"} - set(compiled.groupindex):
        raise UsageError(f"the pattern has no group {missing.pop()!r}; write (?P<damper>...) and (?P<day>...)", "usage", {"name": "pattern"})
    found, other = [], None
    for path in _files(pathlib.Path(folder)):
        below = path.relative_to(folder).as_posix()
        match = compiled.search(below)
        if match is None:
            other = other or below
            continue
        found.append(Recording(match["damper"], _day(match["day"], below), str(path.resolve())))
    if not found:
        seen = f"it does not match {other}" if other else "the folder has no file"
        raise Error(f"{os.fspath(folder)}: no recording matches the pattern {pattern!r}: {seen}", "no_recordings", {"file": str(folder)})
    return sorted(found)


def _files(folder: pathlib.Path) -> Iterator[pathlib.Path]:
    if (folder / "metadata.yaml").is_file():
        yield folder
        return
    for path in sorted(folder.iterdir()):
        if path.is_dir():
            yield from _files(path)
        elif not path.name.startswith("."):
            yield path


def _day(text: str, below: str) -> datetime.date:
    try:
        return datetime.datetime.strptime(text.replace("-", ""), "%Y%m%d").date()
    except ValueError:
        raise UsageError(f"{below}: the day {text!r} is no date; give days as 2026-11-27 or 20261127", "usage", {"value": text}) from None
