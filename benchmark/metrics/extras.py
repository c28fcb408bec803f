"""Metrics beside the paper's: distance to the goal, return, time to collision, hard brakes, decisions."""

import numpy as np

from benchmark.metrics.collision_times import HORIZON, time_to_collision
from benchmark.metrics.encounters import find_encounters
from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.leaders import leader_of
from benchmark.metrics.measure import Columns, ratio
from benchmark.metrics.safety import drove_enough

HARD = 4.0
"""A harder deceleration than this is a hard brake [m/s^2]."""
CAUSE_HEADWAY = 2.0
"""A vehicle that brakes for the one ahead is, at most, this and a hard stop's length behind it [s]."""
CAUSE_TIME = 3.0
"""How long after an encounter began a hard brake is put down to it [s]."""
PAUSE = 1.0
"""After which a hard brake is another one [s]."""
REWARD = "reward"
"""Name of the extra."""


def measure_goal_distance(episode: EpisodeData) -> Columns:
    """Return what was left of each agent's route."""
    left = np.asarray(episode.agents["remaining"], float)
    known = episode.entered & np.isfinite(left) & (episode.agents["route_length"] > 0)
    return {"goal_distance": np.where(known, left, 0.0), "bound_agents": known.astype(float)}


def measure_return(episode: EpisodeData) -> Columns:
    """Return the sum of each agent's rewards, if they were recorded."""
    found = [episode.extras(agent, REWARD) for agent in range(episode.count)]
    return {
        "return": np.array([sum(float(each.sum()) for each in rewards.values()) for rewards in found]),
        "returns": np.array([float(bool(rewards)) for rewards in found]),
    }


def measure_least_time(episode: EpisodeData) -> Columns:
    """Return each agent's least time to collision, at most that of the horizon."""
    times = episode.shared(time_to_collision)
    known = episode.entered & ~np.isnan(times).all(axis=0)
    least = np.where(np.isnan(times), HORIZON, times).min(axis=0)
    return {
        "least_collision_time": np.where(known, np.minimum(least, HORIZON), 0.0),
        "timed_agents": known.astype(float),
    }


def measure_hard_brakes(episode: EpisodeData) -> Columns:
    """Return how often others began to brake hard because of an agent, and kilometres driven.

    Because of it: the agent is the next vehicle ahead and near, or has met the one that brakes within the
    last 3 s.
    """
    motion = episode.motion
    brakes = np.zeros(episode.count)
    hard = motion.present & (np.nan_to_num(motion.acceleration) < -HARD)
    begins = hard.copy()
    for since in range(1, round(PAUSE / episode.dt) + 1):
        begins[since:] &= ~hard[:-since]
    encounters = episode.shared(find_encounters)
    agent_of = {int(own): agent for agent, own in enumerate(episode.own.tolist()) if own >= 0}
    for k, other in np.argwhere(begins).tolist():
        leader, ahead = leader_of(motion, episode.paths, episode.lanes, other, k)
        since = (k - encounters.step) * episode.dt
        met = (encounters.other == other) & (since >= 0) & (since <= CAUSE_TIME)
        causes = set(encounters.agent[met].tolist())
        speed = motion.speed[k, other]
        near = speed * CAUSE_HEADWAY + speed**2 / (2 * HARD)
        if leader in agent_of and ahead - (motion.length[leader] + motion.length[other]) / 2 <= near:
            causes.add(agent_of[leader])
        for agent in causes:
            brakes[agent] += episode.driving[k, agent]
    drove = drove_enough(episode)
    kilometres = np.where(drove, episode.agents["distance_travelled"] / 1000.0, 0.0)
    return {"hard_brakes": np.where(drove, brakes, 0.0), "kilometres": kilometres}


def measure_decisions(episode: EpisodeData) -> Columns:
    """Return decisions and seconds."""
    counts = [len(episode.decisions(agent).step) for agent in range(episode.count)]
    return {"decisions": np.array(counts, float), "seconds": episode.duration}


GOAL_DISTANCE = ratio(
    "goal_distance",
    "bound_agents",
    name="goal_distance",
    label="Goal distance",
    meaning="what was left of the route at the end",
    measure=measure_goal_distance,
    counted="agent-episodes with a goal",
    missing="no agent had a goal",
    better="lower",
    unit="m",
    is_share=False,
)
RETURN = ratio(
    "return",
    "returns",
    name="return",
    label="Return",
    meaning="sum of an agent's rewards",
    measure=measure_return,
    counted="agent-episodes with rewards",
    missing="no rewards were recorded",
    better="higher",
    is_share=False,
)
LEAST_TIME_TO_COLLISION = ratio(
    "least_collision_time",
    "timed_agents",
    name="least_time_to_collision",
    label="Least time to collision",
    meaning="the least time to collision of an agent-episode, at most 3 s",
    measure=measure_least_time,
    counted="agent-episodes with decisions",
    missing="no agent drove",
    better="higher",
    unit="s",
    is_share=False,
)
HARD_BRAKES = ratio(
    "hard_brakes",
    "kilometres",
    name="hard_brakes",
    label="Hard brakes caused",
    meaning="how often others had to brake harder than 4 m/s^2 because of the agent, per km",
    measure=measure_hard_brakes,
    counted="km",
    missing="no agent drove 5 m",
    better="lower",
    unit="1/km",
    is_share=False,
)
DECISION_RATE = ratio(
    "decisions",
    "seconds",
    name="decision_rate",
    label="Decisions per second",
    meaning="decisions / driving time",
    measure=measure_decisions,
    counted="s of driving",
    missing="no agent drove",
    unit="1/s",
    is_share=False,
)
