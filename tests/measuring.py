"""Computes metrics of hand-made episodes, and makes the encounters that several tests use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.registry import METRICS
from smarts.roads.lane_graph import LaneGraph
from smarts.types.events import Outcome
from tests.recordings import LENGTH, Drive, across, at_speed, at_speeds, crossroads, episode_of, straight

ROAD = straight(lanes=3, length=400.0)
CROSS = crossroads()
WEST_EAST, SOUTH_NORTH = ("west_in", "east_out"), ("south_in", "north_out")
SLOWLY, QUICKLY = [10.0] * 10 + [3.0] * 50 + [10.0] * 60, [10.0] * 120


def totals(*episodes: EpisodeData, times: int = 1) -> dict[str, np.ndarray]:
    """Return the sums of all metrics' columns over episodes, each counted `times` times."""
    found: dict[str, np.ndarray] = {}
    for episode in episodes:
        rows = {"agents": episode.entered.astype(float)}
        for metric in METRICS.values():
            rows |= metric.measure(episode)
        for name, column in rows.items():
            found[name] = found.get(name, np.array(0.0)) + times * column.sum()
    return found


def value(name: str, *episodes: EpisodeData, times: int = 1) -> float:
    """Return a metric of episodes, NaN if there is not enough data."""
    return float(METRICS[name].known(totals(*episodes, times=times)))


def term(name: str, which: str, *episodes: EpisodeData) -> float:
    """Return one term of a metric."""
    terms = METRICS[name].terms
    assert terms
    return float(terms(totals(*episodes))[which])


def sums(name: str, episode: EpisodeData) -> dict[str, float]:
    """Return the sums of one metric's columns over the agents of an episode."""
    return {column: float(each.sum()) for column, each in METRICS[name].measure(episode).items()}


def meeting(
    folder: Path,
    mine: ArrayLike,
    others: ArrayLike,
    *,
    begin: float = 30.0,
    other_begin: float = 20.0,
    acceleration: ArrayLike | None = None,
    **more: Any,
) -> EpisodeData:
    """Return an episode of an agent from the west and a vehicle from the south that meet at the crossing.

    Their paths overlap from 89.75 m to 93.5 m along the agent's, and from 86.5 m to 90.25 m along the
    vehicle's.

    Args:
        folder: Folder of the recording.
        mine: Speeds of the agent in each step [m/s].
        others: Speeds of the other vehicle in each step [m/s].
        begin: Initial position of the agent's centre along its path [m].
        other_begin: Initial position of the other vehicle's centre [m].
        acceleration: Acceleration of the other vehicle, by default that of its speeds [m/s^2].
        more: Further fields of the agent's `Drive`.
    """
    return episode_of(
        folder,
        CROSS,
        Drive(
            across(CROSS, *WEST_EAST),
            at_speeds(mine, begin),
            **{"agent": "a", "route": WEST_EAST, "outcome": Outcome.GOAL, **more},
        ),
        Drive(
            across(CROSS, *SOUTH_NORTH),
            at_speeds(others, other_begin),
            route=SOUTH_NORTH,
            acceleration=acceleration,
        ),
    )


def following(
    folder: Path,
    t: ArrayLike = 0.0,
    *,
    speed: float = 8.0,
    steps: int = 150,
    gap: float = 20.0,
    graph: LaneGraph = ROAD,
    lane: str = "road_0",
    leader: dict[str, Any] | None = None,
    **more: Any,
) -> EpisodeData:
    """Return an episode of an agent with a desired speed of 13 m/s behind a leader that drives at 5 m/s.

    Args:
        folder: Folder of the recording.
        t: Offset of the agent to the left of the centreline [m].
        speed: Speed of the agent [m/s].
        steps: Number of steps of 0.1 s.
        gap: Initial gap from bumper to bumper [m].
        graph: The map.
        lane: Lane of both vehicles.
        leader: Further fields of the leader's `Drive`.
        more: Further fields of the agent's `Drive`.
    """
    own = {"s": at_speed(speed, steps, 10.0), "agent": "a", "desired_speed": 13.0, "route": ["road"], **more}
    ahead = at_speed(5.0, steps, 10.0 + gap + LENGTH)
    others = {"s": ahead, "desired_speed": 5.0, "route": ["road"], **(leader or {})}
    return episode_of(folder, graph, Drive([lane], t=t, **own), Drive([lane], **others))


def parked(folder: Path) -> EpisodeData:
    """Return an episode of an agent that stands before a crossing while another vehicle crosses."""
    return episode_of(
        folder,
        CROSS,
        Drive(across(CROSS, *WEST_EAST), at_speed(0.0, 100, 70.0), agent="a", route=WEST_EAST),
        Drive(across(CROSS, *SOUTH_NORTH), at_speed(10.0, 100, 20.0), route=SOUTH_NORTH),
    )
