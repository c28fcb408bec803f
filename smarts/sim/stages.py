"""The stages of the step: their inputs, and what they may write.

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
from smarts.types.bubbles import BubbleStates
from smarts.types.episode import EpisodeStart
from smarts.types.events import Contacts, Events
from smarts.types.frame import Frame, Readings
from smarts.types.tracks import Tracks
from smarts.types.transfers import NO_TRANSFERS, Transfers


class EntryRules(Protocol):
    """Lets agents enter; writes missions and, through `Ownership`, the agents."""

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
    """Turns actions into commands; writes the latch of lane changes in the agents."""

    def command(self, actions: Actions, env_mask: Bools) -> Commands:
        """Return the commands to the vehicles of all active agents for this step."""
        ...


class Vehicles(Protocol):
    """Moves the vehicles of owner AGENT; writes their rows, and the agents' actuators."""

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
        """Return each vehicle's `Refusal` to be driven by an agent."""
        ...

    def close(self) -> None:
        """Free resources."""
        ...


class Matcher(Protocol):
    """Matches all vehicles to the map; writes lane, lane_position, lane_offset, and the agents' progress."""

    def match(self, env_mask: Bools) -> None:
        """Match all vehicles of some simulations."""
        ...


class ContactFinder(Protocol):
    """Finds vehicles that touch; writes nothing."""

    def find(self, tracks: Tracks, env_mask: Bools) -> Contacts:
        """Return the first contact of each agent's vehicle during the step."""
        ...


class Bubbles(Protocol):
    """Finds which vehicles are in bubbles; writes `release_step` and `next_due` of the agents in them."""

    @property
    def states(self) -> BubbleStates | None:
        """Where the bubbles are; None: the run has none."""
        ...

    def begin(self, row: int, start: EpisodeStart) -> None:
        """Begin an episode of one simulation."""
        ...

    def place(self, env_mask: Bools) -> None:
        """Move the bubbles, and find the vehicles in them; at a reset and after every step."""
        ...

    def propose(self, events: Events, env_mask: Bools) -> Transfers:
        """Return the vehicles that agents are to observe, to drive, or to observe no longer."""
        ...


class NoBubbles:
    """Bubbles of a run without any."""

    states: BubbleStates | None = None

    def begin(self, row: int, start: EpisodeStart) -> None:
        """Do nothing."""

    def place(self, env_mask: Bools) -> None:
        """Do nothing."""

    def propose(self, events: Events, env_mask: Bools) -> Transfers:
        """Return no transfers."""
        return NO_TRANSFERS


class EventDetector(Protocol):
    """Finds events; writes state, outcome, lap*, last_moved_*, off_route_since, via_hit, arrival_*."""

    def reset(self, contacts: Contacts, env_mask: Bools) -> Events:
        """Return the (usually absent) events at the beginning of an episode."""
        ...

    def detect(self, contacts: Contacts, env_mask: Bools) -> Events:
        """Return what happened to the agents in this step."""
        ...


class TransferRules(Protocol):
    """Proposes which vehicles change hands; writes nothing."""

    def clear(self, row: int) -> None:
        """Forget the episode of one simulation."""
        ...

    def propose(self, events: Events, env_mask: Bools) -> Transfers:
        """Return the transfers that are to happen at the beginning of the next step."""
        ...


class Sensors(Protocol):
    """Observes for the agents; writes nothing."""

    def observe(self, observe_mask: Bools) -> Readings:
        """Return the readings of the agents of a mask, shape (B, A)."""
        ...


class Recorder(Protocol):
    """Records frames."""

    def record(self, frame: Frame) -> None:
        """Copy the frame's data that is recorded, before the next step overwrites it."""
        ...

    def close(self) -> None:
        """Write the rest, and end."""
        ...
