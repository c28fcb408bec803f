"""Which agents of recorded episodes have a way that meets another agent's, whatever the policy does.

A way leads from where the agent begins over its route to its goal, lane by lane. Two meet as those of drawn
missions do (`smarts.sstudio.drawn_missions`): they arrive within some seconds at the speed limits.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics.lane_paths import path_book
from benchmark.metrics.results import Frame
from smarts.errors import RecordError
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.episode_files import MAPS, RecordedEpisode, episodes_in
from smarts.sstudio.drawn_missions import Way, meetings, way_between
from smarts.sstudio.missions import LanePoint

ARRIVALS = 5.0
"""Largest difference between the arrivals of two agents that meet [s]."""


def meetings_in(record: Path, table: Frame) -> NDArray[np.float64]:
    """Return for each row of a table 1 if the agent's way meets another's, 0 if not, NaN without a way.

    Args:
        record: Folder of the recorded episodes that were measured.
        table: A row for each agent of each episode.
    """
    found: dict[tuple[int, int, str], float] = {}
    measured = {*zip(table["world"], table["episode"], strict=True)}
    for path in episodes_in(record):
        with suppress(RecordError):  # of damaged episodes, which the table does not have
            episode = RecordedEpisode(path)
            place = int(episode.facts["world"]), int(episode.facts["episode"])
            if place in measured:
                names, meets = _meetings_of(episode)
                found |= {(*place, name): each for name, each in zip(names, meets, strict=True)}
    keys = zip(table["world"], table["episode"], table["agent"], strict=True)
    return np.array([found[key] for key in keys])


def _meetings_of(episode: RecordedEpisode) -> tuple[NDArray, NDArray[np.float64]]:
    """Return names of the egos, and which meet, shape (A,)."""
    agents = episode.table("agents")
    egos = np.flatnonzero(agents["interface"] < 0)
    roads = path_book(episode.folder.parent / MAPS / f"{episode.facts['map']}.npz").graph
    ways = {ego: way for ego in egos.tolist() if (way := _way(episode, roads, ego)) is not None}
    meets = np.full(len(agents["name"]), np.nan)
    meets[[*ways]] = meetings(roads, [*ways.values()], ARRIVALS).any(axis=1)
    return agents["name"][egos], meets[egos]


def _way(episode: RecordedEpisode, roads: LaneGraph, agent: int) -> Way | None:
    """Return the way of an agent, None if it never began, or has no goal on a lane or no route."""
    agents = {name: column[agent] for name, column in episode.table("agents").items()}
    vehicles, routes = episode.table("vehicles"), episode.table("routes")
    is_begin = vehicles["step"] == agents["entry_step"]
    rows = np.flatnonzero(
        is_begin & (vehicles["slot"] == agents["slot"]) & (vehicles["generation"] == agents["generation"])
    )
    known = np.flatnonzero(routes["route"] == agents["route"])
    if not len(rows) or not len(known) or agents["goal_lane"] < 0 or vehicles["lane"][rows[0]] < 0:
        return None
    begin = LanePoint(int(vehicles["lane"][rows[0]]), float(vehicles["s"][rows[0]] + agents["length"] / 2))
    end = LanePoint(int(agents["goal_lane"]), float(agents["goal_s"]))
    entry = float(agents["entry_step"] * episode.facts["dt"])
    return way_between(roads, routes["edges"][known[0]].tolist(), begin, end, 0.0, entry)
