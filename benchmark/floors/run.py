"""Plays floor policies in scenarios, and counts how the agents end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.joint.worlds import REPORTED_WORLDS
from benchmark.floors import FLOORS, SUMO_DRIVER
from benchmark.floors.protocol import Floor
from benchmark.floors.sumo_driver import sumo_episodes
from benchmark.floors.tally import Tally
from smarts.env.vector import VectorHiWayEnv, VectorStep
from smarts.errors import SmartsError, TrafficError
from smarts.sim.assembly import Options
from smarts.sstudio.build import build_scenario
from smarts.types.actions import LaneAction
from smarts.types.episode import EpisodeStart

AGENTS = 4


class Ended(NamedTuple):
    """An episode that is over."""

    outcomes: Counter[str]
    """Agents by outcome."""
    steps: float


def play(
    policy: str,
    scenario: str,
    *,
    episodes: int,
    seed: int = 42,
    first_world: int = REPORTED_WORLDS,
    record: Path | None = None,
) -> Iterator[Tally]:
    """Play a scenario with every agent driven by a policy; yield a tally for each of its traffics.

    Episode k is that of world `first_world` + k, as in the evaluation of learners.

    Args:
        policy: A name of `FLOORS`, or `SUMO_DRIVER`.
        scenario: Folder, or name of the suite.
        episodes: How many are counted of each traffic: the first ones that are not void.
        seed: Of the run.
        first_world: See above.
        record: Folder to which what is played is recorded; the last episode of each traffic is cut short.

    Raises:
        SmartsError: SUMO's driver is to be recorded.
        TrafficError: Traffic failed.
    """
    for traffic in build_scenario(scenario).traffic:
        tally = Tally(policy, scenario, traffic, AGENTS)
        if policy == SUMO_DRIVER:
            if record is not None:
                raise SmartsError("only agents are recorded", place="record", remedy="leave out sumo_driver")
            played = sumo_episodes(scenario, traffic, AGENTS, seed, first_world)
        else:
            played = _episodes(policy, scenario, traffic, seed, first_world, record)
        for outcomes, steps in played:
            # One that began with vehicles inside each other tells nothing.
            if not outcomes["void"]:
                tally.add(outcomes, steps)
            if tally.episodes >= episodes:
                break
        played.close()
        yield tally


def _episodes(
    policy: str, scenario: str, traffic: str, seed: int, first_world: int, record: Path | None
) -> Generator[Ended]:
    """Yield one episode of each world after the other."""
    options = Options(record=record)
    env = VectorHiWayEnv(1, [scenario], AGENTS, seed=seed, simulation=options, traffic=[traffic])
    with closing(env):
        yield from episodes_of(env, policy, seed, first_world)


def episodes_of(env: VectorHiWayEnv, policy: str, seed: int, first_world: int) -> Generator[Ended]:
    """Yield one episode of each world after the other, with every agent driven by a policy.

    Args:
        env: With one simulation, and what the policy can see and do.
        policy: A name of `FLOORS`, or `module:Class` of a user's own.
        seed: Of the run.
        first_world: The world of the first episode.

    Raises:
        TrafficError: Traffic failed.
    """
    drivers: list[Floor] = [FLOORS[policy]() for _ in env.agents]
    now = env.reset(seed, np.array([first_world]), stride=1)
    start = _begin(drivers, env)
    while True:
        now = env.step(_actions(drivers, now, env))
        for error in now.failed.values():
            place = f"{start.scenario}, world {start.world}"
            raise TrafficError("the traffic failed", place=place) from error
        for shares in now.metrics.values():
            yield Ended(_outcomes(shares, len(env.agents)), shares["steps"])
            start = _begin(drivers, env)


def _begin(drivers: Sequence[Floor], env: VectorHiWayEnv) -> EpisodeStart:
    (start,) = env.episodes
    for agent, driver in enumerate(drivers):
        driver.begin(start, agent)
    return start


def _actions(drivers: Sequence[Floor], now: VectorStep, env: VectorHiWayEnv) -> list[NDArray]:
    """Return the actions of all active agents, for each block of agents, shape (1, n, ...)."""
    actions, first = [], 0
    for block, leaves, mask in zip(env.spaces.blocks, now.observations, now.masks, strict=True):
        shape = (1, len(block.agents), *(block.action.shape or ()))
        chosen = np.zeros(shape, block.action.dtype)
        for place in np.flatnonzero(now.alive[0, first : first + len(block.agents)]).tolist():
            seen = {name: leaf[0, place] for name, leaf in leaves.items()}
            action_mask = np.ones(len(LaneAction), np.bool_) if mask is None else mask[0, place]
            driver: Any = drivers[first + place]
            chosen[0, place] = driver.act(_shown(driver, seen), action_mask)
        actions.append(chosen)
        first += len(block.agents)
    return actions


def _shown(driver: Floor, seen: Mapping[str, NDArray]) -> Any:
    """Return what a policy gets to see: the only array, or all of them by name.

    The policies of this package look at the benchmark's vector, whatever is beside it.
    """
    if [*seen] == [""]:
        return seen[""]
    is_ours = type(driver).__module__.startswith("benchmark.floors.")
    return seen["observation"] if is_ours and "observation" in seen else dict(seen)


def _outcomes(shares: Mapping[str, float], agents: int) -> Counter[str]:
    return Counter(
        {name: round(share * agents) for name, share in shares.items() if name != "steps" and share}
    )
