"""Collaborative: giving way where one was predicted to go first."""

from collections.abc import Mapping

import numpy as np

from benchmark.metrics.encounters import (
    COLLIDED,
    FIRST,
    SECOND,
    UNRESOLVED,
    WAITING,
    Encounters,
    find_encounters,
)
from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.measure import Columns, Floats, Measure, Totals, share
from smarts.arrays import Bools

LEAST_ENCOUNTERS = 10
"""Resolved, for a share."""

_RESOLVED = ("gave_way", "kept_first", "collided_first")


def measure(episode: EpisodeData) -> Columns:
    """Return how the encounters ended in which the agent was predicted first."""
    encounters = episode.shared(find_encounters)
    with_ego = np.isin(encounters.other, episode.own)
    columns = {}
    for name, chosen in _endings(encounters).items():
        columns[name] = np.bincount(encounters.agent[chosen], minlength=episode.count).astype(float)
        if name in _RESOLVED:
            agents = encounters.agent[chosen & with_ego]
            columns[f"{name}_egos"] = np.bincount(agents, minlength=episode.count).astype(float)
    return columns


def _endings(encounters: Encounters) -> Mapping[str, Bools]:
    first, result = encounters.is_predicted_first, encounters.result
    return {
        "gave_way": first & (result == SECOND) & encounters.is_courtesy,
        "kept_first": first & (result == FIRST),
        "collided_first": first & (result == COLLIDED),
        "lost_first": first & (result == SECOND) & ~encounters.is_courtesy,
        "unresolved_first": first & np.isin(result, (UNRESOLVED, WAITING)),
    }


def terms(totals: Totals) -> Mapping[str, Floats]:
    """Return the shares with egos and with social vehicles, and how many encounters do not count.

    Lost are those in which the other went first without courtesy of the agent.
    """
    egos = {name: totals[f"{name}_egos"] for name in _RESOLVED}
    social = {name: totals[name] - egos[name] for name in _RESOLVED}
    return {
        "encounters_with_egos": share(egos["gave_way"], sum(egos.values())),
        "encounters_with_social_vehicles": share(social["gave_way"], sum(social.values())),
        "unresolved": totals["unresolved_first"],
        "lost": totals["lost_first"],
    }


METRIC = Measure(
    name="collaborative",
    label="Collaborative",
    meaning="giving way: gave way / (gave way + went first + collided) over conflict encounters in which the "
    "agent was predicted first by 0.2 s to 3 s; so exactly one of two agents that meet counts",
    columns=(*_RESOLVED, *(f"{name}_egos" for name in _RESOLVED), "lost_first", "unresolved_first"),
    measure=measure,
    value=lambda totals: share(totals["gave_way"], sum(totals[name] for name in _RESOLVED)),
    hits="gave_way",
    count=_RESOLVED,
    counted="resolved encounters",
    least=LEAST_ENCOUNTERS,
    missing=f"fewer than {LEAST_ENCOUNTERS} resolved encounters in which an agent was predicted first",
    better="higher",
    terms=terms,
)
