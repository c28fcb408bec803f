"""Families of maps, drawn by name, so that no two of a family are equal."""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from types import MappingProxyType
from typing import TYPE_CHECKING

from smarts.errors import ScenarioError
from smarts.sstudio.encoding import digest
from smarts.sstudio.sstypes.scenario import Scenario

if TYPE_CHECKING:
    from numpy.random import Generator

SPLITS = MappingProxyType({"train": 50, "validation": 10, "test": 30})
"""Usual numbers of maps."""
TRIES = 20
"""Draws until one differs from all earlier maps of the family."""


def draw_map(draw: Callable[[Generator], Scenario], names: Sequence[str], wanted: str) -> Scenario:
    """Return the map `wanted` of a family; maps are drawn in the order of `names`, equal ones again.

    Raises:
        ScenarioError: All draws of a map equal earlier ones.
    """
    seen: set[str] = set()
    for name in names[: names.index(wanted)]:
        seen.add(digest(_draw_another(draw, name, seen).map_spec))
    return _draw_another(draw, wanted, seen)


def _draw_another(draw: Callable[[Generator], Scenario], name: str, seen: Set[str]) -> Scenario:
    """Return a map whose digest is none of those in `seen`."""
    # Local: scenario files that draw nothing need not wait for NumPy.
    from smarts.types.streams import Purpose, stream

    seed = int(digest(name, size=6), 16)
    for attempt in range(TRIES):
        scenario = draw(stream(seed, Purpose.BUILD, episode=attempt))
        if digest(scenario.map_spec) not in seen:
            return scenario
    raise ScenarioError(
        f"map {name} equals earlier ones in {TRIES} draws",
        remedy="let more of the map depend on the generator, or ask for fewer maps",
    )
