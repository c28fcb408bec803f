"""Recorded traffic of an episode: a log and the window of it that is played."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

MODES = ("log", "reactive")
"""How recorded vehicles drive: exactly as recorded; as recorded until something is in their way."""


@dataclass(frozen=True)
class RecordedTraffic:
    """A part of a log; times are in s since the recording's first sample."""

    log: Path
    """A `smarts.recordings.log.Log`, written by the build."""
    mode: str
    """One of `MODES`."""
    begin: float
    """Where the episode begins, after `drawn_window`."""
    end: float
    """Where the recording ends for the episode."""
    window: float | None = None
    """Length of an episode [s]; None: from `begin` to `end`."""
    time_step: float = 0.1
    """Windows begin at `begin` plus a multiple of this [s]."""


def drawn_window(recording: RecordedTraffic, seed: int) -> RecordedTraffic:
    """Return the window of an episode, all of them equally likely.

    Args:
        recording: The recording from which it is drawn.
        seed: The traffic's seed of the episode.
    """
    if recording.window is None:
        return recording
    # Slack, so that a last window that fits exactly is among them.
    last = int((recording.end - recording.begin - recording.window) / recording.time_step + 1e-6)
    place = int(np.random.Generator(np.random.Philox(seed)).integers(last + 1))
    begin = recording.begin + place * recording.time_step
    return replace(recording, begin=begin, end=begin + recording.window, window=None)
