"""Options as the words of a command line.

The native module parses options with the parser of the command ``mr-damper``, so names, values and error messages are those of the
command: ``restarts=5`` is ``--restarts=5``, ``all_samples=True`` is ``--all-samples``.
"""

import os
from typing import Any, Dict, List, Mapping

# Options whose values are separated by commas. All other lists repeat the option.
_COMMAS = frozenset({"centres", "models", "experiments", "pictures", "effects"})

#: The options that say how runs are read; see ``read_runs``.
LOAD_OPTIONS = ("skip_bad_rows", "thesis_txt", "drive", "bag_namespace", "bag_joint", "dbc", "map", "column", "sign", "map_file")


def words(options: Mapping[str, Any]) -> List[str]:
    """The options as words. ``None`` and ``False`` leave an option out."""
    out: List[str] = []
    for name, value in options.items():
        flag = "--" + name.rstrip("_").replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            out.append(flag)
        elif isinstance(value, Mapping):
            out.extend(f"{flag}={key}={_pair(item)}" for key, item in value.items())
        elif name in _COMMAS and not isinstance(value, str):
            out.append(f"{flag}={','.join(_text(item) for item in value)}")
        elif isinstance(value, (list, tuple)):
            out.extend(f"{flag}={_text(item)}" for item in value)
        else:
            out.append(f"{flag}={_text(value)}")
    return out


def load_words(options: Mapping[str, Any]) -> List[str]:
    """The words of those options that say how runs are read."""
    return words({name: options.get(name) for name in LOAD_OPTIONS})


def without_load(options: Mapping[str, Any]) -> Dict[str, Any]:
    """The other options."""
    return {name: value for name, value in options.items() if name not in LOAD_OPTIONS}


def _pair(value: Any) -> str:
    """The right-hand side of ``ID=VALUE``; a range of two numbers is ``LOW:HIGH``."""
    if isinstance(value, (list, tuple)):
        return ":".join(_text(item) for item in value)
    return _text(value)


def _text(value: Any) -> str:
    """The value as a word. Floats keep all digits."""
    if isinstance(value, (str, bool)):
        return str(value)
    if isinstance(value, os.PathLike):
        return str(os.fspath(value))
    if isinstance(value, int):
        return str(value)
    try:
        # NumPy's numbers are written as plain ones.
        number = float(value)
    except (TypeError, ValueError):
        return str(value)
    return str(int(number)) if number.is_integer() and abs(number) < 2**53 and not isinstance(value, float) else repr(number)
