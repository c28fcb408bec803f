"""Random streams: every draw in a simulation is a function of (seed, world, episode, purpose)."""

from __future__ import annotations

import enum
import hashlib
from typing import Any

import numpy as np

from smarts.errors import SmartsError
from smarts_agent_kit.draws import uniform as uniform

LARGEST_SEED = 2**63 - 1


class Purpose(enum.IntEnum):
    """The use of a stream. Values are part of the seeds: never renumber, only append."""

    TRAFFIC = 0
    """SUMO's own seed."""
    STARTS = 1
    """Start offsets and speeds of the egos."""
    MISSIONS = 2
    """Random routes and random offsets."""
    SENSORS = 3
    """Sensor noise."""
    AGENTS = 4
    """Scripted agents' own choices."""
    BUILD = 5
    """Draws made while a scenario is built."""
    SCENARIOS = 6
    """The order in which a run's scenarios, traffic and missions come."""
    RESAMPLING = 7
    """Bootstrap samples of episodes."""
    SOCIAL = 8
    """Random routes, offsets and speeds of social agents' missions."""


def is_seed(seed: Any) -> bool:
    """Return whether a value is a seed: a whole number from 0 to `LARGEST_SEED`."""
    is_whole = isinstance(seed, int | np.integer) and not isinstance(seed, bool)
    return is_whole and 0 <= int(seed) <= LARGEST_SEED


def check_seed(seed: Any, place: str) -> None:
    """Raise if `seed` is not a whole number from 0 to `LARGEST_SEED`.

    Raises:
        SmartsError: Names the value and its place.
    """
    if not is_seed(seed):
        raise SmartsError(f"{seed!r} is not a seed", place=place, remedy="use 0, 1, 2, ..., below 2**63")


def stream(seed: int, purpose: Purpose, *, world: int = 0, episode: int = 0) -> np.random.Generator:
    """Return the generator of one purpose in one episode of one simulation.

    Counter-based (Philox) and keyed by a hash, so streams are independent whatever the order in which
    they are made; a worker's index never enters, so runs do not depend on how work is spread.
    """
    text = f"smarts-bench|{seed}|{world}|{episode}|{int(purpose)}"
    key = np.frombuffer(hashlib.blake2b(text.encode(), digest_size=16).digest(), np.uint64)
    return np.random.Generator(np.random.Philox(key=key))


def hold_seed(seed: int, name: str, *, world: int = 0, episode: int = 0) -> int:
    """Return the seed of a social agent's own draws, in [0, 2^64).

    Args:
        seed: Seed of the run.
        name: Name of the agent, unique in its episode.
        world: Number of the simulation in its run.
        episode: Number of the simulation's episode.
    """
    text = f"smarts-bench|{seed}|{world}|{episode}|hold|{name}"
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")


def traffic_seed(seed: int, *, world: int = 0, episode: int = 0) -> int:
    """Return the seed that the traffic engine gets for one episode, in [0, 2^31)."""
    return int(stream(seed, Purpose.TRAFFIC, world=world, episode=episode).integers(2**31))
