"""What vehicles see, by hand: requests to the zoo's drivers without a simulation."""

import numpy as np

from smarts.agents.policy import ActionBatch
from smarts.observations.lane_ways import BEHIND, LANE_WAYS, POINTS
from smarts.observations.nearby import NEARBY
from smarts.observations.surroundings import LANE_TRAFFIC, OWN_VEHICLE, Lane, Own
from smarts.zoo.driving import Seen


def seen_of(count=1, **own):
    """Return what vehicles see on an empty road of one lane."""
    vehicle, lanes = np.zeros((count, len(Own))), np.zeros((count, 3, len(Lane)))
    vehicle[:, Own.LENGTH], vehicle[:, Own.WIDTH] = 5.0, 1.8
    vehicle[:, [Own.LIGHT_GAP, Own.YIELD_GAP, Own.REMAINING]] = np.inf
    lanes[:, :, [Lane.AHEAD, Lane.BEHIND, Lane.LEFT, Lane.END]] = np.inf
    lanes[:, 0, Lane.OPEN] = 1.0
    for name, value in own.items():
        vehicle[:, Own[name.upper()]] = value
    return Seen(vehicle, lanes)


def batch_of(seen, step=0, is_first=True, mask=True, env_id=0, drives=True):
    count = len(seen.own)
    return ActionBatch(
        {OWN_VEHICLE: seen.own, LANE_TRAFFIC: seen.lanes},
        np.full((count, 4), mask),
        np.full(count, env_id, np.int32),
        np.arange(count, dtype=np.int32),
        np.arange(count, dtype=np.int32),
        np.zeros(count, np.int32),
        np.full(count, step, np.int32),
        np.full(count, is_first),
        np.arange(count, dtype=np.uint64),
        np.full(count, drives),
    )


def two_lanes(**values):
    """A vehicle at 10 m/s behind one at 5 m/s, with a free lane to the left."""
    seen = seen_of(speed=10.0, allowed=14.0, **values)
    seen.lanes[:, 1, Lane.OPEN] = 1.0
    seen.lanes[:, 0, [Lane.AHEAD, Lane.AHEAD_SPEED]] = 20.0, 5.0
    return seen


def with_ways(batch):
    """Return a batch on a straight road of three lanes along x, with nobody near."""
    count = len(batch.env_id)
    ways = np.zeros((count, 3, POINTS, 3))
    ways[..., 0] = 2.0 * (np.arange(POINTS) - BEHIND)
    ways[:, 1, :, 1], ways[:, 2, :, 1] = 3.2, -3.2
    more = {LANE_WAYS: ways, NEARBY: np.zeros((count, 8, 6))}
    return batch._replace(observations={**batch.observations, **more})
