"""Road users that a scenario describes."""

from __future__ import annotations

from dataclasses import dataclass

from smarts.sstudio.sstypes.identity import Described


@dataclass(frozen=True, eq=False)
class Actor(Described):
    """A road user."""

    name: str
    """Display name. Actors with equal names but different fields are distinct."""
