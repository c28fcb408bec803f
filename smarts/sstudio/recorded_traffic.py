"""Recorded traffic in the build: a recording becomes the log of a traffic variation.

Functions import what has kernels when they are called: experiments are read without compiling any.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from smarts.errors import ScenarioError, nearest_names
from smarts.recordings.headings import HeadingRule
from smarts.recordings.reading import READERS, Source, read
from smarts.recordings.signals import SIGNALS
from smarts.recordings.tracks import TRACKS, Tracks, read_tracks
from smarts.recordings.transforms import Transform, transformed
from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio.checks import Checks
from smarts.sstudio.sstypes.dataset import TrafficHistoryDataset
from smarts.sstudio.sstypes.entry_tactic import IdEntryTactic
from smarts.sstudio.sstypes.recording import Recording
from smarts.sstudio.sstypes.scenario import Scenario
from smarts.sstudio.sstypes.traffic import Traffic

WITHOUT_ROUTES = {"routes": [], "additional": [], "warm_up": 0.0, "options": {}, "reaction_time": 0.0}
"""What the manifest holds of traffic for which SUMO has no files."""
BEFORE_IT_LEAVES = 1.0
"""Episodes begin at least so long before a vehicle that an agent takes over leaves [s]."""


def with_histories(scenario: Scenario, checks: Checks) -> Scenario:
    """Return a scenario whose traffic histories are variations of its traffic, in mode "log".

    Those without an `input_path` are placeholders, and stay.

    Raises:
        ScenarioError: One is of no known format, or has the name of another variation.
    """
    traffic, placeholders = dict(scenario.traffic or {}), []
    for where, history in checks.each(scenario.traffic_histories, TrafficHistoryDataset, "traffic_histories"):
        checks.choice(history.source_type, tuple(READERS), f"{where}.source_type")
        if history.input_path is None:
            placeholders.append(history)
            continue
        problem = f"there is another traffic {history.name!r}"
        checks.require(history.name not in traffic, f"{where}.name", problem, "give it another name")
        recording = Recording(history.input_path, "log", history=replace(history, input_path=None))
        traffic[history.name] = Traffic((), engine="Recorded", recording=recording)
    return replace(scenario, traffic=traffic or None, traffic_histories=tuple(placeholders) or None)


def recording_files(scenario: Scenario, directory: Path) -> list[str]:
    """Return the files of the recordings that a scenario's traffic names; folders have Parquet files."""
    recordings = (traffic.recording for traffic in (scenario.traffic or {}).values())
    found = [each for each in recordings if isinstance(each, Recording)]
    files: list[Path] = []
    for each in found:
        inside = [Path(each.source, file.name) for file in (directory / each.source).glob("*.parquet")]
        own = [file for file in sorted(inside) if each.history or file.name in (TRACKS, SIGNALS)]
        files += own or [Path(each.source, "" if each.history else TRACKS)]
    return [file.as_posix() for file in files]


def taken_vehicles(scenario: Scenario) -> dict[str, float]:
    """Return the vehicles that `IdEntryTactic`s name, and their latest start times [s]."""
    groups = (scenario.social_agent_missions or {}).values()
    missions = [*(scenario.ego_missions or ()), *(each for _, own in groups for each in own or ())]
    found: dict[str, float] = {}
    for tactic in (getattr(each, "entry_tactic", None) for each in missions):
        if isinstance(tactic, IdEntryTactic):
            found[tactic.actor_id] = max(found.get(tactic.actor_id, 0.0), tactic.start_time)
    return found


def write_log(
    recording: Recording, roads: LaneGraph, directory: Path, file: Path, at: str, taken: Mapping[str, float]
) -> tuple[dict[str, Any], str]:
    """Write a recording's log; return what the manifest holds of it, and a note.

    Args:
        recording: The recording.
        roads: The scenario's map.
        directory: The scenario's folder.
        file: Where to.
        at: The recording's place in the scenario's file, for errors.
        taken: See `taken_vehicles`; episodes begin while these are there.

    Raises:
        SmartsError: The recording cannot be read, is no traffic, or does not belong to the map, or nothing
            is recorded in the part that is asked for, or not the vehicles that are taken over.
    """
    from smarts.recordings.checks import on_lanes, share_of_vehicles
    from smarts.recordings.importing import LEAST_ON_LANES
    from smarts.recordings.log import NAME, make_log

    if recording.history is None:
        tracks = read_tracks(directory / recording.source)
    else:
        tracks = _tracks_of(recording.history, directory / recording.source, roads)
    if tracks.facts.get("is_traffic") == "false":
        problem = f"{recording.source!r} is no traffic: its tracks begin at one time in one place"
        raise ScenarioError(problem, place=at, remedy="use a recording of vehicles that drove side by side")
    share = share_of_vehicles(on_lanes(tracks, roads), tracks)
    if share < LEAST_ON_LANES:
        problem = f"only {share:.0%} of the positions of {recording.source!r} lie on lanes of the map"
        raise ScenarioError(problem, place=at, remedy="give the map of this recording")
    end = min(recording.end if recording.end is not None else tracks.t.max(), tracks.t.max())
    latest = end - recording.window if recording.window is not None else recording.begin
    if not recording.begin <= latest < end:
        problem = f"begin={recording.begin:g}, window={recording.window} do not fit: it ends at {end:.4g} s"
        raise ScenarioError(problem, place=at, remedy="use an earlier begin, or a shorter window")
    log = make_log(tracks, roads, recording.begin, np.inf if recording.end is None else recording.end)
    log.save(file)
    ends = {NAME + name: end for name, end in zip(log.names, log.paths.end.tolist(), strict=True)}
    latest = float(_latest_begin(ends, taken, recording.begin, latest, at))
    entry = {"mode": recording.mode, "begin": recording.begin, "latest": latest}
    entry["vehicles"] = log.most_at_once()
    first = f"{end - latest:.4g} to " if latest > recording.begin else ""
    return entry, f"ends {first}{end - recording.begin:.4g} s after an episode's begin"


def _latest_begin(
    ends: Mapping[str, float], taken: Mapping[str, float], begin: float, latest: float, at: str
) -> float:
    """Return the latest begin of episodes at which all vehicles to take over have not left yet [s]."""
    for name, start in taken.items():
        until = {each: end - start - BEFORE_IT_LEAVES for each, end in ends.items()}
        known = [each for each in until if until[each] >= begin]
        if name not in known:
            problem = f"no vehicle {name!r} to take over is recorded {start:g} s after the begin, or later"
            raise ScenarioError(problem, place=at, remedy=nearest_names(name, known))
        latest = min(latest, until[name])
    return latest


def _tracks_of(history: TrafficHistoryDataset, file: Path, roads: LaneGraph) -> Tracks:
    """Return the recording of a traffic history, in the coordinates of the map."""
    from smarts.recordings.checks import check, on_lanes

    scale = history.map_lane_width / history.real_lane_width_m
    rule = HeadingRule(
        history.heading_inference_window,
        history.heading_inference_min_speed,
        history.max_angular_velocity,
        history.default_heading,
    )
    least, most = roads.point_xy.min(axis=0), roads.point_xy.max(axis=0)
    transform = Transform(
        history.swap_xy,
        scale,
        history.x_margin_px / scale,
        history.y_margin_px / scale,
        float(most[1]) if history.flip_y else None,
    )
    if history.scenario_id is not None:
        file = file.with_name(f"{file.name}#{history.scenario_id}")
    tracks = transformed(read(Source(file, rule), history.source_type), transform)
    xy = np.column_stack([tracks.x, tracks.y])
    inside = ((xy >= least) & (xy <= most)).all(axis=1) | (not history.filter_off_map)
    if history.source_type in ("Argoverse", "Waymo"):  # whose maps end before the vehicles do
        inside &= on_lanes(tracks, roads)
    tracks = tracks.of_samples(inside)
    is_traffic = check(tracks, roads).is_traffic
    return replace(tracks, facts={**tracks.facts, "is_traffic": str(is_traffic).lower()})
