"""Exceptions and warnings."""

import json
import warnings
from typing import Any, Dict


class Error(Exception):
    """An error of the library. Its text says what failed, where, and what to do.

    Attributes:
        code: stable name of the kind of error, such as ``"cell"`` or ``"missing_channel"``.
        fields: the details by name, such as ``file``, ``line``, ``column`` and ``value``. Each is an attribute, too.
    """

    code: str
    fields: Dict[str, Any]

    def __init__(self, message: str, code: str = "other", fields: "Dict[str, Any] | None" = None) -> None:
        super().__init__(message)
        self.code = code
        self.fields = dict(fields or {})

    def __getattr__(self, name: str) -> Any:
        # Called only for names that are not found otherwise.
        try:
            return self.__dict__["fields"][name]
        except KeyError:
            raise AttributeError(f"{type(self).__name__} of code {self.__dict__.get('code')!r} has no {name!r}") from None

    def __reduce__(self) -> Any:
        return (type(self), (str(self), self.code, self.fields))


class UsageError(Error, ValueError):
    """An argument is wrong, or arguments do not fit together. Its text is that of the command line."""


class NotFittedError(Error, ValueError, AttributeError):
    """The model is used before ``fit`` or ``load``."""


class MrDamperWarning(UserWarning):
    """A fact about runs or results that a user should know."""


_USAGE = frozenset({"usage", "parameter", "unknown_parameter"})


def of_native(message: str, code: str, fields: str) -> Error:
    """The exception for an error of the native module; ``fields`` is JSON."""
    kind = UsageError if code in _USAGE else Error
    return kind(message, code, json.loads(fields))


def warn(message: str) -> None:
    """Issue a warning at the line of the user's code that called the library."""
    import sys

    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("mr_damper"):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, MrDamperWarning, stacklevel=level + 1)
