"""Recordings of a fleet: which file is of which damper and day."""

import datetime
import os
import pathlib
import re
from typing import Iterable, Iterator, List, NamedTuple, Optional, Union

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
    try:
        compiled = re.compile(pattern)
    except re.error as error:
        raise UsageError(f"the pattern {pattern!r} is no regular expression: {error}", "usage", {"name": "pattern"}) from None
    if missing := {"damper", "day"} - set(compiled.groupindex):
        raise UsageError(f"the pattern has no group {missing.pop()!r}; write (?P<damper>...) and (?P<day>...)", "usage", {"name": "pattern"})
    found, other = [], None
    for path in _files(pathlib.Path(folder)):
        below = path.relative_to(folder).as_posix()
        match = compiled.search(below)
        if match is None:
            other = other or below
            continue
        if not match["damper"]:
            raise UsageError(f"{below}: the pattern gives no name of a damper; the group must not be optional", "usage", {"name": "pattern"})
        found.append(Recording(match["damper"], _day(match["day"], below), str(path.resolve())))
    if not found:
        seen = f"it does not match {other}" if other else "the folder has no file"
        raise Error(f"{os.fspath(folder)}: no recording matches the pattern {pattern!r}: {seen}", "no_recordings", {"file": str(folder)})
    return sorted(found)


def checked(recordings: Iterable[Recording]) -> List[Recording]:
    """The recordings, sorted, each once.

    Raises:
        UsageError: they are no recordings, or a field has another type.
    """
    if isinstance(recordings, (str, os.PathLike, Recording)):
        raise UsageError(f"recordings is {recordings!r:.80}; give a list of Recording, as fleet.find makes it", "usage", {"name": "recordings"})
    found = set()
    for each in recordings:
        if not isinstance(each, tuple) or len(each) != 3:
            raise UsageError(f"{each!r:.80} is no Recording; see mr_damper.fleet.find", "usage", {"name": "recordings"})
        damper, day, path = each
        if not isinstance(damper, str) or not damper or len(damper.encode()) > 80 or damper == "__HIVE_DEFAULT_PARTITION__":
            raise UsageError(f"damper is {damper!r:.80}; give a name of 1 to 80 bytes", "usage", {"name": "damper"})
        if isinstance(day, datetime.datetime):
            day = day.date()
        if not isinstance(day, datetime.date):
            raise UsageError(f"day is {day!r:.80}; give a datetime.date", "usage", {"name": "day"})
        if not isinstance(path, (str, os.PathLike)):
            raise UsageError(f"path is {path!r:.80}; give a text", "usage", {"name": "path"})
        found.add(Recording(damper, day, os.fspath(path)))
    if not found:
        raise UsageError("recordings is empty; see mr_damper.fleet.find", "usage", {"name": "recordings"})
    return sorted(found)


def _files(folder: pathlib.Path) -> Iterator[pathlib.Path]:
    if (folder / "metadata.yaml").is_file():
        yield folder
        return
    if not folder.is_dir():
        raise Error(f"{folder}: no such folder; give the folder of the recordings", "io", {"file": str(folder)})
    for path in sorted(folder.iterdir()):
        if path.is_dir():
            yield from _files(path)
        elif not path.name.startswith("."):
            yield path


def _day(text: Optional[str], below: str) -> datetime.date:
    try:
        if text is None or re.fullmatch(r"\d{4}-\d\d-\d\d|\d{8}", text) is None:
            raise ValueError
        return datetime.datetime.strptime(text.replace("-", ""), "%Y%m%d").date()
    except ValueError:
        raise UsageError(f"{below}: the day {text!r} is no date; give days as 2026-11-27 or 20261127", "usage", {"value": text}) from None
