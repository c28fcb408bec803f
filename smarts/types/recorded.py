"""Recorded traffic of an episode: a log, and where in it the episode begins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

MODES = ("log", "reactive")
"""How recorded vehicles drive: exactly as recorded; as recorded until something is in their way."""


@dataclass(frozen=True)
class RecordedTraffic:
    """A log that an episode plays to its end; times are in s since the recording's first sample."""

    log: Path
    """A `smarts.recordings.log.Log`, written by the build."""
    mode: str
    """One of `MODES`."""
    begin: float
    """Where the episode begins; before `drawn`, the earliest time at which episodes begin."""
    latest: float
    """The latest time at which episodes begin."""

    def drawn(self, share: float) -> RecordedTraffic:
        """Return the recording of an episode that begins at a share, in [0, 1), of the possible times."""
        begin = self.begin + share * (self.latest - self.begin)
        return replace(self, begin=begin, latest=begin)
