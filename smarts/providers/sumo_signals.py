"""The signals of one simulation's lanes, read from SUMO."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Bytes
from smarts.providers.sumo_library import SumoLibrary
from smarts.roads.lane_graph import LaneGraph
from smarts.types.traffic import Signal

_LIGHTS = np.full(256, Signal.NONE, np.int8)
_LIGHTS[list(b"rR")] = Signal.STOP
_LIGHTS[list(b"yYuoOs")] = Signal.CAUTION
_LIGHTS[list(b"gG")] = Signal.GO
"""`Signal` of each letter of SUMO's signal states; lights that are off (o, O) and green right-turn arrows
after a stop (s) mean caution."""


class SumoSignals:
    """Writes the signals of a map's lanes.

    Args:
        library: The copy of libsumo that runs the simulation.
        signals: The world's signals of the simulation.
    """

    def __init__(self, library: SumoLibrary, signals: Bytes) -> None:
        self._library, self._signals = library, signals

    def reset(self, roads: LaneGraph) -> None:
        """Begin an episode on a map."""
        self._of_lanes = self._signals[: len(roads.lane_ids)]
        self._of_lanes[:] = Signal.NONE
        lanes_of = [np.flatnonzero(roads.signal == number) for number in range(len(roads.signal_ids))]
        self._lights = [
            (signal, lanes, roads.signal_link[lanes])
            for signal, lanes in zip(roads.signal_ids, lanes_of, strict=True)
            if len(lanes)
        ]
        self._names = [signal for signal, _, _ in self._lights]
        self._shown: list[str] = [""] * len(self._names)

    def read(self) -> None:
        """Write SUMO's present signals."""
        shown = [*map(self._library.trafficlight.getRedYellowGreenState, self._names)]
        if shown == self._shown:
            return
        # A light's state changes once in some seconds, and to write it takes ten times as long as to read it.
        for (_, lanes, links), light, last in zip(self._lights, shown, self._shown, strict=True):
            if light != last:
                self._of_lanes[lanes] = _LIGHTS[np.frombuffer(light.encode(), np.uint8)[links]]
        self._shown = shown
