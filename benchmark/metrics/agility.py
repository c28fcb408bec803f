"""Agility: travel time of agents that arrive; beside it, progress speed of all agents along their routes."""

import numpy as np

from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.measure import Columns, ended_by, ratio, share
from smarts.types.events import Event, Outcome


def measure(episode: EpisodeData) -> Columns:
    """Return free-flow time / travel time, at most 1, of agents that arrived."""
    arrived = ended_by(episode, Outcome.GOAL) * (episode.duration > 0)
    ratio = share(episode.agents["free_flow_time"], episode.duration)
    return {"agility": np.where(arrived > 0, np.minimum(ratio, 1.0), 0.0), "arrivals": arrived}


def measure_progress(episode: EpisodeData) -> Columns:
    """Return metres gained along the route on the road, and seconds."""
    done = episode.agent_column("route_progress")
    agents = np.arange(episode.count)
    # Off the road, progress keeps its value; what the first step back on it adds was not driven on it.
    was_off = np.nan_to_num(episode.agent_column("events")[:-1]).astype(int) & Event.OFF_ROAD != 0
    skipped = np.where(was_off, np.fmax(np.diff(done, axis=0), 0.0), 0.0).sum(axis=0)
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
