"""Road users that a scenario describes."""

from __future__ import annotations

from dataclasses import dataclass

from smarts.sstudio.sstypes.identity import Described


@dataclass(frozen=True, eq=False)
class Actor(Described):
    """A road user."""

    name: str
    """What people call it. Two actors of one name and other content are two actors."""
