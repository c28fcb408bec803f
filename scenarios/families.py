"""What families of maps share: SUMO's plain XML, curves, traffic from none to dense."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from scenarios.drivers import ALL_KINDS, Drivers, inattentive_car
from smarts.sstudio import types as t

Point = tuple[float, float]

FULL = "random_social_vehicles"
DENSITIES = {"sparse": 0.4, "dense": 1.25}
"""Multiples of the usual rate of vehicles, which `random_social_vehicles` has."""


class PlainMap:
    """A map that is written road by road; lanes are `width` metres wide."""

    def __init__(self, width: float) -> None:
        self._width = width
        self._elements: dict[str, list[str]] = {"nodes": [], "edges": [], "connections": []}

    def node(self, name: str, place: Point, kind: str = "priority") -> None:
        """Add a node of a kind of SUMO's."""
        self._add("nodes", "node", id=name, x=f"{place[0]:.2f}", y=f"{place[1]:.2f}", type=kind)

    def road(
        self,
        name: str,
        ends: tuple[str, str],
        lanes: int,
        speed: float,
        line: Sequence[Point] = (),
        **more: str,
    ) -> None:
        """Add a road between two nodes.

        Args:
            name: Its id.
            ends: The nodes from and to which it leads.
            lanes: How many it has.
            speed: Its limit [m/s].
            line: Its points [m], where it is not straight.
            more: Further attributes of SUMO's.
        """
        values = {"id": name, "from": ends[0], "to": ends[1], "numLanes": lanes, "speed": f"{speed:.2f}"}
        values["width"] = f"{self._width:.2f}"
        shape = {"shape": " ".join(f"{x:.2f},{y:.2f}" for x, y in line)} if line else {}
        self._add("edges", "edge", **values, **shape, **more)

    def link(self, begin: str, end: str, lanes: tuple[int, int], **more: str) -> None:
        """Connect a lane of a road to a lane of the next road."""
        values = {"from": begin, "to": end, "fromLane": lanes[0], "toLane": lanes[1]}
        self._add("connections", "connection", **values, **more)

    def _add(self, kind: str, tag: str, **values: object) -> None:
        attributes = " ".join(f'{name}="{value}"' for name, value in values.items())
        self._elements[kind].append(f"    <{tag} {attributes}/>\n")

    def spec(self) -> t.MapSpec:
        """Return the map."""
        texts = {
            kind[:3] if kind != "edges" else "edg": f"<{kind}>\n{''.join(elements)}</{kind}>\n"
            for kind, elements in self._elements.items()
        }
        return t.MapSpec(plain=texts)


def curve(begin: Point, corner: Point, end: Point) -> list[Point]:
    """Return nine points of a curve that is tangent to begin-corner and to corner-end [m]."""
    first, middle, last = (np.array(each) for each in (begin, corner, end))
    return [
        tuple((1 - u) ** 2 * first + 2 * u * (1 - u) * middle + u**2 * last) for u in np.linspace(0, 1, 9)
    ]


def along(place: Point, heading: float, distance: float) -> Point:
    """Return the point `distance` metres from `place` in the direction of `heading` [rad]."""
    return place[0] + distance * math.cos(heading), place[1] + distance * math.sin(heading)


def from_none_to_dense(
    social: Callable[[float, Drivers], dict[str, t.Traffic]], inattentive: t.TrafficActor = inattentive_car
) -> dict[str, t.Traffic]:
    """Return the traffic variations of a map.

    Args:
        social: Takes a multiple of the usual rate and the drivers, and returns traffic as `drivers.traffic`.
        inattentive: The family's inattentive drivers.
    """
    drivers = {inattentive if each is inattentive_car else each: share for each, share in ALL_KINDS.items()}
    sparse, dense = (social(DENSITIES[name], drivers)[FULL] for name in ("sparse", "dense"))
    alone = social(1.0, {inattentive: 1.0})[FULL]
    return {**social(1.0, drivers), "sparse": sparse, "inattentive": alone, "dense": dense}
