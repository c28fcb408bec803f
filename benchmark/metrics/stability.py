"""Stability: smooth speed, gentle sideways forces, a steady place in the lane."""

from collections.abc import Mapping

import numpy as np

from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.lane_changes import find_lane_changes
from benchmark.metrics.measure import Columns, Floats, Totals, ratio, share
from smarts.types.agent_states import ChangePhase

HALF_JERK, HALF_LATERAL_ACCELERATION, HALF_OFFSET = 2.0, 1.5, 0.5
"""Values at which one term alone halves the index [m/s^3, m/s^2, m]."""
MIN_SPEED = 1.0
"""Only time above this speed is measured [m/s]."""
MIN_TIME = 2.0
"""Time that an agent needs above `MIN_SPEED` [s]."""
WINDOW = 0.5
"""Window of the moving average of accelerations before differencing [s]."""

_TERMS = ("mean_jerk", "mean_lateral_acceleration", "offset_deviation")
_CHANGING = (ChangePhase.REQUESTED, ChangePhase.MOVING)


def measure(episode: EpisodeData) -> Columns:
    """Return the index and its terms of each agent that was fast enough for long enough, and their count.

    An agent with nothing to measure for one of the terms is ignored.
    """
    columns = {name: np.zeros(episode.count) for name in METRIC.columns}
    changes = episode.shared(find_lane_changes)
    phase = episode.agent_column("change_phase")
    for agent in np.flatnonzero(episode.entered & (episode.own >= 0)).tolist():
        moving = episode.driving[:, agent] & (episode.motion.speed[:, episode.own[agent]] > MIN_SPEED)
        if moving.sum() * episode.dt < MIN_TIME:
            continue
        is_changing = changes.under_way[:, agent] | np.isin(phase[:, agent], _CHANGING)
        found = _terms_of(episode, int(episode.own[agent]), moving, is_changing)
        # Stop and go in stretches shorter than the window has an undefined jerk.
        if not np.isfinite(found).all():
            continue
        columns["stable_agents"][agent] = 1.0
        for name, each in zip(_TERMS, found, strict=True):
            columns[name][agent] = each
        scales = (HALF_JERK, HALF_LATERAL_ACCELERATION, HALF_OFFSET)
        columns["stability"][agent] = 1.0 / (1.0 + sum(np.divide(found, scales)))
    return columns


def _terms_of(
    episode: EpisodeData, own: int, moving: np.ndarray, is_changing: np.ndarray
) -> tuple[float, float, float]:
    """Return the three terms, NaN where there is nothing to measure."""
    motion = episode.motion
    jerks = [_jerks(motion.acceleration[run, own], episode.dt) for run in _runs(moving)]
    jerk = _finite(np.concatenate(jerks))
    sideways = _finite(motion.lateral_acceleration[moving, own])
    offset = _finite(motion.t[moving & ~is_changing, own])
    return (
        float(np.abs(jerk).mean()) if len(jerk) else np.nan,
        float(np.abs(sideways).mean()) if len(sideways) else np.nan,
        float(offset.std()) if len(offset) else np.nan,
    )


def _finite(values: Floats) -> Floats:
    return values[np.isfinite(values)]


def _runs(moving: np.ndarray) -> list[slice]:
    """Return the stretches of time without a break."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], moving, [False]))))
    return [slice(first, last) for first, last in edges.reshape(-1, 2).tolist()]


def _jerks(acceleration: Floats, dt: float) -> Floats:
    """Return differences of the moving average of an acceleration [m/s^3]."""
    window = max(1, round(WINDOW / dt))
    if len(acceleration) < window + 1:
        return np.zeros(0)
    return np.diff(np.convolve(acceleration, np.full(window, 1.0 / window), mode="valid")) / dt


def terms(totals: Totals) -> Mapping[str, Floats]:
    """Return the means of the terms over agent-episodes."""
    return {name: share(totals[name], totals["stable_agents"]) for name in _TERMS}


METRIC = ratio(
    "stability",
    "stable_agents",
    columns=_TERMS,
    name="stability",
    label="Stability",
    meaning="1 / (1 + mean |longitudinal jerk| / 2.0 + mean |lateral acceleration| / 1.5 "
    "+ std(lane offset) / 0.5) while faster than 1 m/s",
    measure=measure,
    counted="agents that moved",
    missing="no agent was faster than 1 m/s for 2 s, with a jerk and a place in a lane to measure",
    better="higher",
    is_axis=True,
    terms=terms,
)
