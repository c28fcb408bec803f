"""Recorded traffic as a variation of a scenario's traffic."""

from __future__ import annotations

from dataclasses import dataclass

from smarts.sstudio.sstypes.dataset import TrafficHistoryDataset
from smarts.sstudio.sstypes.identity import Described


@dataclass(frozen=True, eq=False)
class Recording(Described):
    """What `Traffic(flows=[], engine="Recorded", recording=...)` drives (an extension)."""

    source: str
    """The folder that `smarts-bench data import` wrote, from the scenario's folder."""
    mode: str = "reactive"
    """"log": exactly as recorded; "reactive": as recorded until something is in a vehicle's way."""
    begin: float = 0.0
    """What was recorded before is not used [s]."""
    end: float | None = None
    """What was recorded after is not used, and the road empties there [s]; None: the recording's end."""
    window: float | None = None
    """Episodes begin at random times, at least so long before the recording's end [s]; None: at `begin`."""
    history: TrafficHistoryDataset | None = None
    """The entry of `Scenario.traffic_histories` that it stands for; `source` is then the file of that."""
