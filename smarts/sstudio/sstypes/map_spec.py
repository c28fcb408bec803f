"""The map of a scenario."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from smarts.sstudio.sstypes.identity import Described

MapBuilder = Callable[[Any], Any]


@dataclass(frozen=True, eq=False)
class MapSpec(Described):
    """A map and how to read it."""

    source: str = "."
    """A map file, or a folder that holds one; relative paths start at the scenario's folder."""
    lanepoint_spacing: float = 1.0
    """The distance between points along a lane [m]."""
    default_lane_width: float | None = None
    """The width of lanes that name none [m]."""
    shift_to_origin: bool = False
    """Whether to move a map that does not surround the origin there."""
    builder_fn: MapBuilder | None = None
    """The original's hook for other map formats: kept in the signature, refused by the build if set."""
    plain: Mapping[str, str] | None = None
    """The map itself instead of `source`: texts of SUMO's plain XML by kind, such as "nod" and "edg" (an
    extension)."""
