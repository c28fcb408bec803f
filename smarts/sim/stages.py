"""The stages of the step: what each takes, and what it may write.

A stage gets the world when it is made. `env_mask` says which simulations take part, shape (B,); a stage
leaves every array of the others as it is. What a stage returns, its next call refills in place. The stage of
traffic is a `smarts.providers.traffic_engine.TrafficEngine`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from smarts.arrays import Bools, Bytes, Ints
from smarts.errors import SmartsError
from smarts.types.actions import Actions, Commands
from smarts.types.episode import EpisodeStart
from smarts.types.events import Contacts, Events
from smarts.types.frame import Frame, Readings
from smarts.types.tracks import Tracks
from smarts.types.transfers import Transfers


class EntryRules(Protocol):
    """Let agents in; write missions, and through `Ownership` the agents."""

    def reset(self, row: int, start: EpisodeStart) -> None:
        """Begin an episode of one simulation, which is empty."""
        ...

    def clear_way(self, row: int) -> None:
        """Clear traffic that blocks agents' spawns; requires map matching."""
        ...

    def enter(self, env_mask: Bools) -> None:
        """Let in the agents whose time has come."""
        ...


class Controllers(Protocol):
    """Turn actions into commands; write the latch of lane changes in the agents."""

    def command(self, actions: Actions, env_mask: Bools) -> Commands:
        """Return what the vehicles of all active agents are to do in this step."""
        ...


class Vehicles(Protocol):
    """Move the vehicles of owner AGENT; write their rows, and the agents' actuators."""

    @property
    def failures(self) -> Mapping[int, SmartsError]:
        """Errors of the last step, by row; those rows are to be reset."""
        ...

    def reset(self, env_mask: Bools) -> None:
        """Forget all vehicles of some simulations; those in their rows now are new."""
        ...

    def step(self, commands: Commands, env_mask: Bools) -> Tracks:
        """Move them by one step; return how."""
        ...

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """Return for each vehicle the `Refusal` to let an agent drive on with it."""
        ...

    def close(self) -> None:
        """Give back what is held."""
        ...


class Matcher(Protocol):
    """Match all vehicles to the map; write lane, lane_position, lane_offset, and the agents' progress."""

    def match(self, env_mask: Bools) -> None:
        """Match all vehicles of some simulations."""
        ...


class ContactFinder(Protocol):
    """Tells which vehicles touch; writes nothing."""

    def find(self, tracks: Tracks, env_mask: Bools) -> Contacts:
        """Return the first contact of each agent's vehicle during the step."""
        ...


class EventDetector(Protocol):
    """Judge what happened; write state, outcome, lap, last_moved_*, off_route_since, via_hit, arrival_*."""

    def reset(self, contacts: Contacts, env_mask: Bools) -> Events:
        """Return the (usually absent) events at the beginning of an episode."""
        ...

    def detect(self, contacts: Contacts, env_mask: Bools) -> Events:
        """Return what happened to the agents in this step."""
        ...


class TransferRules(Protocol):
    """Decide which vehicles are to change hands; write nothing."""

    def propose(self, events: Events, env_mask: Bools) -> Transfers:
        """Return the transfers that are to happen at the beginning of the next step."""
        ...


class Sensors(Protocol):
    """See the world for the agents; write nothing."""

    def observe(self, observe_mask: Bools) -> Readings:
        """Return the readings of the agents of a mask, shape (B, A)."""
        ...


class Recorder(Protocol):
    """Keeps what happened."""

    def record(self, frame: Frame) -> None:
        """Take what is wanted out of a frame, before the next step overwrites it."""
        ...

    def close(self) -> None:
        """Write what is left, and end."""
        ...
