"""Limits of a bubble."""

from __future__ import annotations

from dataclasses import dataclass

from smarts.errors import ContradictionError
from smarts.sstudio.sstypes.constants import MAX
from smarts.sstudio.sstypes.identity import Described


@dataclass(frozen=True, eq=False)
class BubbleLimits(Described):
    """The most vehicles that a bubble may hold; each limit is 1 or more."""

    hijack_limit: int = MAX
    """Most vehicles at a time that agents drive, those included that are to go back to traffic."""
    shadow_limit: int = MAX
    """Most vehicles at a time that agents drive or observe; not below `hijack_limit`."""

    def __post_init__(self) -> None:
        if self.shadow_limit < self.hijack_limit:
            raise ContradictionError(
                f"{self.shadow_limit} is below hijack_limit, {self.hijack_limit}:"
                " every vehicle is shadowed before it is taken over",
                place="BubbleLimits.shadow_limit",
                remedy=f"give {self.hijack_limit} or more",
            )
