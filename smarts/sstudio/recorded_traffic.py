"""Recorded traffic in the build: a recording becomes the log of a traffic variation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from smarts.errors import ScenarioError
from smarts.recordings.log import make_log
from smarts.recordings.matching import share_on_lanes
from smarts.recordings.tracks import TRACKS, read_tracks
from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio.sstypes.recording import Recording
from smarts.sstudio.sstypes.scenario import Scenario

LEAST_ON_LANES = 0.9
"""Least share of a recording's positions that lie on lanes of its map."""


def recording_files(scenario: Scenario) -> list[str]:
    """Return the files of the recordings that a scenario's traffic names."""
    recordings = (traffic.recording for traffic in (scenario.traffic or {}).values())
    return [(Path(each.source) / TRACKS).as_posix() for each in recordings if each is not None]


def write_log(recording: Recording, roads: LaneGraph, directory: Path, file: Path, at: str) -> dict[str, Any]:
    """Write a recording's log, and return what the manifest holds of it.

    Args:
        recording: The recording.
        roads: The scenario's map.
        directory: The scenario's folder.
        file: Where to.
        at: The recording's place in the scenario's file, for errors.

    Raises:
        SmartsError: The recording cannot be read, is no traffic, or does not belong to the map, or nothing
            is recorded in the part that is asked for.
    """
    tracks = read_tracks(directory / recording.source)
    if tracks.facts.get("is_traffic") == "false":
        problem = f"{recording.source!r} is no traffic: its tracks begin at one time in one place"
        raise ScenarioError(problem, place=at, remedy="use a recording of vehicles that drove side by side")
    share = share_on_lanes(tracks, roads)
    if share < LEAST_ON_LANES:
        problem = f"only {share:.0%} of the positions of {recording.source!r} lie on lanes of the map"
        raise ScenarioError(problem, place=at, remedy="give the map of this recording")
    end = min(recording.end if recording.end is not None else tracks.t.max(), tracks.t.max())
    latest = end - recording.window if recording.window is not None else recording.begin
    if not recording.begin <= latest < end:
        problem = f"begin={recording.begin:g}, window={recording.window} do not fit: it ends at {end:.4g} s"
        raise ScenarioError(
            problem, place=at, remedy="use an earlier begin, a later end, or a shorter window"
        )
    log = make_log(tracks, roads, recording.begin, end)
    log.save(file)
    return {
        "mode": recording.mode,
        "begin": recording.begin,
        "latest": float(latest),
        "vehicles": log.most_at_once(),
    }
