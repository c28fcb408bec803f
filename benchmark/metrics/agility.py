"""Agility: travel time of agents that arrive; beside it, progress speed of all agents along their routes."""

import numpy as np

from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.measure import Columns, ended_by, ratio, share
from smarts.arrays import Floats
from smarts.types.events import Event, Outcome


def measure(episode: EpisodeData) -> Columns:
    """Return free-flow time / travel time, at most 1, of agents that arrived."""
    arrived = ended_by(episode, Outcome.GOAL) * (episode.duration > 0)
    ratio = share(episode.agents["free_flow_time"], episode.duration)
    return {"agility": np.where(arrived > 0, np.minimum(ratio, 1.0), 0.0), "arrivals": arrived}


def _skipped(done: Floats, events: Floats) -> Floats:
    """Return the progress of agents, shape (A,), that was not driven on the road [m].

    Off the road, progress keeps its value; what it gains when it is next written was not driven on the road.
    """
    was_off = np.nan_to_num(events[:-1]).astype(int) & Event.OFF_ROAD != 0
    skipped, has_left = np.zeros(done.shape[1]), np.zeros(done.shape[1], np.bool_)
    for is_off, gain in zip(was_off, np.nan_to_num(np.diff(done, axis=0)), strict=True):
        has_left |= is_off
        skipped += np.where(has_left, np.maximum(gain, 0.0), 0.0)
        has_left &= gain == 0.0
    return skipped


def measure_progress(episode: EpisodeData) -> Columns:
    """Return metres gained along the route on the road, and seconds."""
    done = episode.agent_column("route_progress")
    agents = np.arange(episode.count)
    skipped = _skipped(done, episode.agent_column("events"))
    ends = [np.maximum(episode.agents[name], 0) for name in ("entry_step", "end_step")]
    first, last = (done[step, agents] for step in ends)
    known = episode.entered & np.isfinite(first) & np.isfinite(last)
    return {
        "progress": np.where(known, last - first - skipped, 0.0),
        "progress_time": np.where(known, episode.duration, 0.0),
    }


METRIC = ratio(
    "agility",
    "arrivals",
    name="agility",
    label="Agility",
    meaning="free-flow time / travel time over completed agent-episodes",
    measure=measure,
    counted="arrivals",
    missing="no agent arrived",
    better="higher",
    is_axis=True,
)
PROGRESS_SPEED = ratio(
    "progress",
    "progress_time",
    name="progress_speed",
    label="Progress speed",
    meaning="metres gained along the route / driving time, over all agent-episodes",
    measure=measure_progress,
    counted="s of driving",
    missing="no agent drove",
    better="higher",
    unit="m/s",
    is_share=False,
)
