"""The maps of a publisher as messages, made by its outlet's thread."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from smarts.errors import SmartsError
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.outlet import Content
from smarts.stream.container import pack
from smarts.stream.road_map import map_message, origin_of

_MOST_KEPT = 9
"""Messages, one for each simulation that a process shows."""


class PublishedMaps:
    """Messages of maps. It knows no publisher, so that the outlet's thread keeps none alive.

    Args:
        graphs: The maps, by number.
    """

    def __init__(self, graphs: Sequence[LaneGraph]) -> None:
        self._graphs = graphs
        self._kept: dict[int, Content] = {}
        self.refused: set[int] = set()
        """Maps that cannot be shown."""

    def message(self, number: int) -> Content:
        """Return the message of a map; one that is too large is refused from now on."""
        if number not in self._kept:
            if len(self._kept) >= _MOST_KEPT:
                self._kept.clear()
            graph = self._graphs[number]
            made = {"origin": list(origin_of(graph)), "message": map_message(graph, "")}
            # Large ones take seconds. If the outlet drops what waits meanwhile, they are asked for again.
            self._kept[number] = {"type": "map", "map": number, **made}
            try:
                pack(self._kept[number])
            except SmartsError as error:
                self.refused.add(number)
                logging.getLogger("smarts").warning(
                    "envision: simulations on map %d are not shown: %s; use a smaller map, or record the "
                    "episodes and open them with `smarts-bench view`",
                    number,
                    error.problem,
                )
        return self._kept[number]
