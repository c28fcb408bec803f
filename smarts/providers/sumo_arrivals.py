"""Where and how fast vehicles are to arrive: read from the route files, since TraCI does not give it."""

from __future__ import annotations

import gzip
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

_ATTRIBUTES = ("arrivalLane", "arrivalPos", "arrivalSpeed")
"""Attributes of a vehicle; arguments of TraCI's `vehicle.add` have the same names."""
_DRAWN = "random"
"""A value that SUMO draws when it adds a vehicle: what it has drawn is not known."""
_FILES_KEPT = 16

Arrival = Mapping[str, str]
"""Arguments of TraCI's `vehicle.add`."""


class SumoArrivals:
    """The arrivals of the vehicles of some route files, which are read when one is asked for."""

    def __init__(self, files: Sequence[Path] = ()) -> None:
        self._files = tuple(files)

    def of(self, name: str) -> Arrival:
        """Return the arrival of a vehicle, or of the flow that it belongs to; {} if its file says nothing."""
        for file in self._files:
            found = _read(file, file.stat().st_mtime_ns)
            for each in (name, name.rpartition(".")[0]):
                if each in found:
                    return found[each]
        return {}


@lru_cache(maxsize=_FILES_KEPT)
def _read(file: Path, changed: int) -> dict[str, Arrival]:
    """Return the arrivals that a file gives, by the ids of vehicles and flows.

    Args:
        file: A route file that SUMO has read.
        changed: When it was changed last; reads a file again that has been changed.
    """
    found: dict[str, Arrival] = {}
    with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as stream:
        for _, element in ElementTree.iterparse(stream):
            if element.tag in ("vehicle", "trip", "flow"):
                given = {each: element.get(each, "") for each in _ATTRIBUTES}
                arrival = {key: value for key, value in given.items() if value not in ("", _DRAWN)}
                if arrival:
                    found[element.get("id", "")] = arrival
                element.clear()
    return found
