"""The stages of the step: what each takes, and what it may write.

`rows` says which simulations take part, shape (B,); a stage leaves every array of the others as it is.
Whatever a stage returns is refilled in place by its next call. The stage of traffic is a
`smarts.providers.traffic_engine.TrafficEngine`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.errors import SmartsError
from smarts.types.actions import Actions, Commands
from smarts.types.episode import EpisodeStart
from smarts.types.events import Contacts, Events
from smarts.types.frame import Frame, Readings
from smarts.types.tracks import Tracks
from smarts.types.transfers import Transfers
from smarts.types.world import World

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]


class EntryRules(Protocol):
    """Let agents in; write missions, and through `Ownership` the agents."""

    def reset(self, world: World, row: int, start: EpisodeStart) -> None:
        """Begin an episode of one simulation, which is empty."""
        ...

    def clear_way(self, world: World, row: int) -> None:
        """Make room for those who are in at the beginning; everybody has been located."""
        ...

    def enter(self, world: World, env_mask: Bools) -> None:
        """Let in those whose time has come."""
        ...


class Controllers(Protocol):
    """Turn actions into commands; write the latch of lane changes in the agents."""

    def command(self, world: World, actions: Actions, env_mask: Bools) -> Commands:
        """Return what the vehicles of all active agents are to do in this step."""
        ...


class Vehicles(Protocol):
    """Move the vehicles of owner AGENT; write their rows, and the agents' actuators."""

    @property
    def failures(self) -> Mapping[int, SmartsError]:
        """What went wrong in the last step, by row; those rows are to be reset."""
        ...

    def reset(self, world: World, env_mask: Bools) -> None:
        """Forget all vehicles of some simulations; those in their rows now are new."""
        ...

    def step(self, world: World, commands: Commands, env_mask: Bools) -> Tracks:
        """Move them by one step; return how."""
        ...

    def can_accept(self, rows: Ints, slots: Ints) -> NDArray[np.int8]:
        """Return for each vehicle the `Refusal` to let an agent drive on with it."""
        ...

    def close(self) -> None:
        """Give back what is held."""
        ...


class Matcher(Protocol):
    """Find all vehicles on the map; write lane, lane_position, lane_offset, and the agents' progress."""

    def locate(self, world: World, env_mask: Bools) -> None:
        """Say where everybody is now."""
        ...


class ContactFinder(Protocol):
    """Tells which vehicles touch; writes nothing."""

    def find(self, world: World, tracks: Tracks, env_mask: Bools) -> Contacts:
        """Return the first contact of each agent's vehicle during the step."""
        ...


class EventDetector(Protocol):
    """Judges what happened; writes state, outcome, last lap, rest, off_route_since, via_hit, tickets."""

    def reset(self, world: World, contacts: Contacts, env_mask: Bools) -> Events:
        """Return the (usually absent) events at the beginning of an episode."""
        ...

    def detect(self, world: World, contacts: Contacts, env_mask: Bools) -> Events:
        """Return what happened to the agents in this step."""
        ...


class TransferRules(Protocol):
    """Decide which vehicles are to change hands; write nothing."""

    def propose(self, world: World, events: Events, env_mask: Bools) -> Transfers:
        """Return the transfers that are to happen at the beginning of the next step."""
        ...


class Sensors(Protocol):
    """See the world for the agents; write nothing."""

    def observe(self, world: World, observe_mask: Bools) -> Readings:
        """Return the readings of the wanted agents, shape (B, A)."""
        ...


class Recorder(Protocol):
    """Keeps what happened."""

    def record(self, frame: Frame) -> None:
        """Take what is wanted out of a frame, before the next step overwrites it."""
        ...

    def close(self) -> None:
        """Write what is left, and end."""
        ...
