"""Collaborative: giving way where one could have gone first."""

import numpy as np

from benchmark.metrics.encounters import COLLIDED, UNRESOLVED, WENT_FIRST, YIELDED, find_encounters
from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.measure import Columns, Measure, share

_RESULTS = {
    "yielded": YIELDED,
    "went_first": WENT_FIRST,
    "collided_encounters": COLLIDED,
    "unresolved_encounters": UNRESOLVED,
}


def measure(episode: EpisodeData) -> Columns:
    """Return how the encounters ended that the agent could have won."""
    encounters = episode.shared(find_encounters)
    columns = {}
    for name, result in _RESULTS.items():
        chosen = encounters.could_win & (encounters.result == result)
        columns[name] = np.bincount(encounters.agent[chosen], minlength=episode.count).astype(float)
    return columns


METRIC = Measure(
    name="collaborative",
    label="Collaborative",
    meaning="giving way: yielded / (yielded + went first + collided) over conflict encounters that the "
    "agent could have won; where two agents meet, one goes first and one yields as a rule, so without "
    "traffic it is near 0.5 whatever they do",
    columns=tuple(_RESULTS),
    measure=measure,
    value=lambda totals: share(
        totals["yielded"], totals["yielded"] + totals["went_first"] + totals["collided_encounters"]
    ),
    hits="yielded",
    count=("yielded", "went_first", "collided_encounters"),
    counted="encounters",
    missing="no encounter that the agents could have won",
    better="higher",
)
