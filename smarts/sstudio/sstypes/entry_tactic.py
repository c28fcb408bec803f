"""Entry tactics: how an agent gets its vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from smarts.sstudio.sstypes.condition import ALWAYS, Condition
from smarts.sstudio.sstypes.constants import MISSING
from smarts.sstudio.sstypes.identity import Described
from smarts.sstudio.sstypes.zone import MapZone


@dataclass(frozen=True, eq=False)
class EntryTactic(Described):
    """A new vehicle, put into a cleared gap."""

    start_time: float = MISSING
    """The earliest time of entry [s]; unless given, the mission's."""


@dataclass(frozen=True, eq=False)
class TrapEntryTactic(EntryTactic):
    """Take over the first vehicle that enters an area."""

    wait_to_hijack_limit_s: float = 0
    """Waiting time before a new vehicle is added instead [s]."""
    zone: MapZone | None = None
    """The area; unless given, around the mission's start."""
    exclusion_prefixes: Sequence[str] = ()
    """Vehicles whose names begin with one of these are left alone."""
    default_entry_speed: float | None = None
    """The speed of the new vehicle if none came [m/s]."""
    condition: Condition = ALWAYS
    """A further condition."""


@dataclass(frozen=True, eq=False)
class IdEntryTactic(EntryTactic):
    """Take over the vehicle of a given name."""

    actor_id: str = ""
    """The vehicle's name; required."""
    condition: Condition = ALWAYS
    """A further condition."""

    def __post_init__(self) -> None:
        if not (isinstance(self.actor_id, str) and self.actor_id):
            raise ValueError(f"an IdEntryTactic needs the actor_id of a vehicle, got {self.actor_id!r}")
