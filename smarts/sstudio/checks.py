"""Checks of values, each of which raises an error that names the value and its place."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from smarts import errors
from smarts.errors import ScenarioError, nearest_names


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
        """Return an error to raise, where its texts take long to make."""
        return ScenarioError(problem, place=self.at(where), remedy=remedy)

    def require(self, holds: bool, where: str, problem: str, remedy: str) -> None:
        """Raise unless a condition holds."""
        if not holds:
            raise self.error(where, problem, remedy)

    def number(self, value: Any, where: str, least: float = 0.0, most: float = math.inf) -> None:
        """Require a number from `least` to `most`."""
        if not isinstance(value, int | float) or not least <= value <= most:
            bounds = f"from {least:g}" if most == math.inf else f"from {least:g} to {most:g}"
            raise self.error(where, f"{shown(value)} is not a number {bounds}", f"use a number {bounds}")

    def numbers(self, owner: Any, where: str, *names: str, least: float = 0.0) -> None:
        """Require a number from `least` in each of some fields of `owner`."""
        for name in names:
            self.number(getattr(owner, name), f"{where}.{name}", least)

    def choice(self, value: Any, known: Collection[str], where: str) -> None:
        """Require one of the known names."""
        if value not in known:
            raise self.error(where, f"there is no {shown(value)}", nearest_names(str(value), known))

    def type(self, value: Any, expected: type | tuple[type, ...], where: str) -> None:
        """Require a value of a type."""
        if not isinstance(value, expected):
            kinds = expected if isinstance(expected, tuple) else (expected,)
            names = " or ".join(kind.__name__ for kind in kinds)
            raise self.error(where, f"not a {names}: {shown(value)}", f"use a {names}")

    def named(self, value: Any, kind: type | tuple[type, ...], where: str) -> list[tuple[str, Any]]:
        """Require a dict of values of a type by name, or None; return the values with their places."""
        if not isinstance(value, Mapping | None):
            raise self.error(where, f"not a dict by name: {shown(value)}", 'use {"name": ...}')
        found = [(f"{where}[{name!r}]", item) for name, item in (value or {}).items()]
        for at, item in found:
            self.type(item, kind, at)
        return found

    def each(self, value: Any, kind: type | tuple[type, ...], where: str) -> list[tuple[str, Any]]:
        """Require a list of values of a type, or None; return the values with their places."""
        if not isinstance(value, list | tuple | None):
            raise self.error(where, f"not a list: {shown(value)}", "use [...]")
        found = [(f"{where}[{number}]", item) for number, item in enumerate(value or ())]
        for at, item in found:
            self.type(item, kind, at)
        return found

    def unique(self, name: str, seen: dict[str, str], where: str) -> None:
        """Require a name that is not in `seen`, the names so far with their places; add it."""
        earlier = seen.setdefault(name, where)
        self.require(earlier == where, where, f"{earlier} is {name!r}, too", "rename one of them")


def shown(value: Any) -> str:
    """Return the shortened `repr` of a value for messages."""
    return errors.shown(value, 100)
