"""Checks of values, each of which raises an error that names the value and its place."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

from smarts import errors
from smarts.errors import ScenarioError, nearest_names

LONGEST_NAME = 100
"""Characters of a name, which becomes part of file names."""


@dataclass(frozen=True)
class Checks:
    """Checks of the values of one file.

    In every method `where` is the place of the value in the file, as in "traffic['dense'].flows[2].rate".

    Raises:
        ScenarioError: In every method, if the value is not what it should be.
    """

    place: str
    """The file."""

    def at(self, where: str) -> str:
        """Return the place of an error: file and object."""
        return f"{self.place}: {where}"

    def error(self, where: str, problem: str, remedy: str) -> ScenarioError:
        """Return an error for the caller to raise."""
        return ScenarioError(problem, place=self.at(where), remedy=remedy)

    def require(self, holds: bool, where: str, problem: str, remedy: str) -> None:
        """Raise unless a condition holds."""
        if not holds:
            raise self.error(where, problem, remedy)

    def number(
        self, value: Any, where: str, above: float | None = None, most: float = math.inf, least: float = 0.0
    ) -> None:
        """Require a finite number from `least`, or greater than `above`, to `most`."""
        bound = f"{least:g} or more" if above is None else f"above {above:g}"
        bound += "" if most == math.inf else f" and at most {most:g}"
        numeric = is_number(value) and math.isfinite(value)
        holds = numeric and (value >= least if above is None else value > above) and value <= most
        if not holds:
            raise self.error(where, f"{shown(value)} is not a number {bound}", f"use a number {bound}")

    def numbers(
        self, owner: Any, where: str, above: float | None = None, least: float = 0.0, **most: float
    ) -> None:
        """Require a number in each of some fields of `owner`; `most` gives their largest values."""
        for name, limit in most.items():
            self.number(getattr(owner, name), f"{where}.{name}", above, limit, least)

    def name(self, value: Any, where: str) -> None:
        """Require a name that files can have too."""
        self.type(value, str, where)
        fits = (
            1 <= len(value) <= LONGEST_NAME and value.isprintable() and len(quote(value)) <= 2 * LONGEST_NAME
        )
        if not fits:
            remedy = f"use 1 to {LONGEST_NAME} letters, digits and signs"
            raise self.error(where, f"{shown(value)} is not a name", remedy)

    def count(self, value: Any, where: str) -> None:
        """Require a whole number of at least 1."""
        whole = isinstance(value, int) and not isinstance(value, bool) and value >= 1
        self.require(whole, where, f"{shown(value)} is not a count", "use 1, 2, 3, ...")

    def index(self, value: Any, where: str) -> None:
        """Require a whole number of at least 0."""
        whole = isinstance(value, int) and not isinstance(value, bool) and value >= 0
        self.require(whole, where, f"{shown(value)} is not an index", "use 0, 1, 2, ...")

    def order(self, first: float, last: float, where: str, name: str) -> None:
        """Require that `last` is not less than `first`, which is the field `name`."""
        self.require(last >= first, where, f"{last} is before {name}, {first}", "exchange the two")

    def choice(self, value: Any, known: Collection[str], where: str) -> None:
        """Require one of the known names."""
        if not isinstance(value, str) or value not in known:
            raise self.error(where, f"there is no {shown(value)}", nearest_names(str(value)[:99], known))

    def type(self, value: Any, expected: type | tuple[type, ...], where: str) -> None:
        """Require a value of a type."""
        if not isinstance(value, expected):
            kinds = expected if isinstance(expected, tuple) else (expected,)
            names = " or ".join(kind.__name__ for kind in kinds)
            raise self.error(where, f"a {type(value).__name__}: {shown(value)}", f"use a {names}")

    def named(self, value: Any, where: str) -> Iterator[tuple[str, Any]]:
        """Require a dict by name, or None; return the items with their places."""
        if not isinstance(value, Mapping | None) or not all(isinstance(name, str) for name in value or ()):
            raise self.error(where, f"not a dict by name: {shown(value)}", 'use {"name": ...}')
        return ((f"{where}[{name!r}]", item) for name, item in (value or {}).items())

    def listed(self, value: Any, where: str) -> Iterator[tuple[str, Any]]:
        """Require a list, or None; return the items with their places."""
        if not isinstance(value, list | tuple | None):
            raise self.error(where, f"not a list: {shown(value)}", "use [...]")
        return ((f"{where}[{number}]", item) for number, item in enumerate(value or ()))

    def each(self, value: Any, kind: type, where: str) -> Iterator[tuple[str, Any]]:
        """Require a list of values of a type, or None; yield the items with their places."""
        for at, item in self.listed(value, where):
            self.type(item, kind, at)
            yield at, item

    def unique(self, name: str, seen: dict[str, str], where: str) -> None:
        """Require a name that is not in `seen`, the names so far with their places; add it."""
        earlier = seen.setdefault(name, where)
        self.require(earlier == where, where, f"{earlier} is {name!r}, too", "rename one of them")


def is_number(value: Any) -> bool:
    """Return whether a value is a number and not a bool."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def shown(value: Any) -> str:
    """Return the shortened `repr` of a value for messages."""
    return errors.shown(value, 100)
