"""The traffic of a scenario on its own, without an ego: for pictures, measurements and tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from smarts.providers.sumo_traffic import SumoTraffic
from smarts.sim.roster import Roster
from smarts.sstudio.built import BuiltScenario
from smarts.types.streams import sumo_seed
from smarts.types.vehicles import VehicleStates

CAPACITY = 4096
"""Slots; more than any map of the suite can hold."""


class TrafficRun:
    """SUMO's traffic of one episode, step by step. Use `traffic_run`, which ends it."""

    def __init__(
        self, built: BuiltScenario, traffic: str | None, *, seed: int = 42, episode: int = 0, dt: float = 0.1
    ) -> None:
        self.states = VehicleStates.allocate(CAPACITY)
        self.dt = dt
        self.provider = SumoTraffic(dt=dt)
        roster = Roster(self.states)
        self.provider.reset(
            built.traffic_files(traffic), sumo_seed(seed, episode=episode), self.states, roster, built.roads()
        )

    def steps(self, seconds: float) -> Iterator[VehicleStates]:
        """Yield the vehicles after each step, for a span of simulated time [s]."""
        for _ in range(round(seconds / self.dt)):
            self.provider.step(self.states)
            yield self.states


@contextmanager
def traffic_run(
    built: BuiltScenario, traffic: str | None, *, seed: int = 42, episode: int = 0, dt: float = 0.1
) -> Iterator[TrafficRun]:
    """Warm a scenario's traffic up and lend it for a while.

    Args:
        built: The scenario.
        traffic: Which variation of its traffic; None for empty roads.
        seed: Of the run.
        episode: Counts episodes of one run: each has its own traffic.
        dt: Length of a step [s].

    Raises:
        TrafficError: SUMO failed.
        ScenarioError: There is no such traffic.
    """
    run = TrafficRun(built, traffic, seed=seed, episode=episode, dt=dt)
    try:
        yield run
    finally:
        run.provider.close()
