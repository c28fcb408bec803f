"""The errors that users meet: each names what is wrong, where, and what to do about it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LONGEST_MESSAGE = 1000
"""How many characters of a problem, place or remedy are shown; scenario files can raise megabytes."""

LONGEST_VALUE = 200
"""How many characters of a value are shown in one of them."""


def shortened(text: str, limit: int = LONGEST_MESSAGE) -> str:
    """Return a text with what is in the middle left out, if it is longer than `limit` characters."""
    if len(text) <= limit:
        return text
    tail = limit // 4
    return f"{text[: limit - tail - 5]} ... {text[len(text) - tail :]}"


def shown(value: object, limit: int = LONGEST_VALUE) -> str:
    """Return a value as Python would show it, but never more than `limit` characters of it."""
    try:
        return shortened(repr(value), limit)
    except ValueError:
        # Python prints no whole number of more than 4300 digits, nor what holds one.
        return f"of type {type(value).__name__}, with thousands of digits"


class SmartsError(Exception):
    """Something the user can mend.

    Args:
        problem: What is wrong, with the offending value.
        place: File and object that hold the value.
        remedy: What to do about it.

    The command line prints the message without a traceback and exits with `exit_code`.
    """

    exit_code = 2

    def __init__(self, problem: str, *, place: str = "", remedy: str = "") -> None:
        self.problem = shortened(problem)
        self.place = shortened(place)
        self.remedy = shortened(remedy)
        super().__init__(self.problem, self.place, self.remedy)

    def __reduce__(self):
        # Keyword-only arguments do not survive the default pickling, and errors cross process borders.
        return _rebuild, (type(self), self.problem, self.place, self.remedy)

    def __str__(self) -> str:
        where = f"{self.place}: " if self.place else ""
        remedy = f"\n  remedy: {self.remedy}" if self.remedy else ""
        return f"{where}{self.problem}{remedy}"


def _rebuild(kind: type[SmartsError], problem: str, place: str, remedy: str) -> SmartsError:
    return kind(problem, place=place, remedy=remedy)


class MapError(SmartsError):
    """A road map is missing, broken, or lacks what was asked of it."""


class ScenarioError(SmartsError):
    """A scenario file says something that cannot be built."""


class ContradictionError(ScenarioError, ValueError):
    """An object of a scenario file contradicts itself; it is a `ValueError`, too, as in the original."""


class TrafficError(SmartsError):
    """The traffic engine failed to start or to continue."""


class RecordError(SmartsError):
    """Episodes cannot be written, or what is there is not an episode."""


class ActionError(SmartsError):
    """An action is of the wrong kind, not finite, or for an agent that does not exist."""


class UnknownNameError(SmartsError):
    """A name that is not in a registry."""


class OwnCodeError(SmartsError):
    """Code of the user's cannot be imported, is not what it should be, or raises; names its file and line."""


def nearest_names(name: str, known: Iterable[str]) -> str:
    """Return a remedy that offers the known names closest to `name`."""
    known = sorted(known)
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.6)
    if close:
        return f"did you mean {' or '.join(map(repr, close))}?"
    shown = ", ".join(map(repr, known[:12]))
    return f"known: {shown}{', ...' if len(known) > 12 else ''}" if known else "none is known"
