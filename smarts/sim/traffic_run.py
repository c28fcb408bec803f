"""The traffic of a scenario on its own, without an ego: for pictures, measurements and tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import numpy as np

from smarts.providers.traffic_engines import traffic_of
from smarts.sim.schedule import engine_of, traffic_files
from smarts.sstudio.built import BuiltScenario
from smarts.types.episode import EpisodeStart
from smarts.types.streams import traffic_seed
from smarts.types.vehicles import VehicleStates
from smarts.types.world import World

CAPACITY = 4096
"""Slots; more than any map of the suite can hold."""


class TrafficRun:
    """The traffic of one episode, step by step. Use `traffic_run`, which ends it.

    Args:
        built: The scenario.
        traffic: Variation of its traffic; None for empty roads.
        seed: Seed of the run.
        episode: Counts episodes of one run: each has its own traffic.
        dt: Length of a step [s].
        engine: Name among `TRAFFIC_ENGINES` of the one that drives; by default the scenario's.
    """

    def __init__(
        self,
        built: BuiltScenario,
        traffic: str | None,
        *,
        seed: int = 42,
        episode: int = 0,
        dt: float = 0.1,
        engine: str | None = None,
    ) -> None:
        roads, engine = built.roads(), engine or engine_of(built, traffic)
        self.dt = dt
        self.world = World(worlds=1, capacity=CAPACITY, agents=0, lanes=len(roads.lane_ids), dt=dt)
        self.states = self.world.vehicles.of(0)
        self.start = EpisodeStart(
            seed=seed,
            world=0,
            episode=episode,
            scenario=built.name,
            map=0,
            traffic=traffic_files(built, traffic, seed, 0, episode),
            traffic_name=traffic,
            traffic_seed=traffic_seed(seed, episode=episode),
            limit=CAPACITY,
            agents=(),
            engine=engine,
        )
        self.engine = traffic_of([engine], self.world, [roads])
        self.engine.reset({0: self.start})

    def steps(self, seconds: float) -> Iterator[VehicleStates]:
        """Yield the vehicles after each step, for a span of simulated time [s].

        Raises:
            TrafficError: The engine failed.
        """
        rows = np.ones(1, np.bool_)
        for _ in range(round(seconds / self.dt)):
            self.world.advance(rows)
            self.engine.step(rows)
            if self.engine.failures:
                raise self.engine.failures[0]
            yield self.states


@contextmanager
def traffic_run(built: BuiltScenario, traffic: str | None, **options: Any) -> Iterator[TrafficRun]:
    """Warm a scenario's traffic up and lend it for a while; see `TrafficRun`.

    Raises:
        TrafficError: The engine failed.
        ScenarioError: There is no such traffic.
    """
    run = TrafficRun(built, traffic, **options)
    with closing(run.engine):
        yield run
