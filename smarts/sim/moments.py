"""What a scenario looks like right after a reset, for pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace

import numpy as np

from smarts.agents.interface import AgentInterface
from smarts.errors import ScenarioError
from smarts.sim.assembly import assemble
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.episodes import drawn_mission, expand
from smarts.types.vehicles import VehicleStates


@dataclass(frozen=True)
class Moment:
    """The vehicles of one simulation at one instant."""

    states: VehicleStates
    egos: Sequence[int] = ()
    """Slot of the vehicle on each mission, -1 where no ego has entered."""
    names: Mapping[str, int] = field(default_factory=dict)
    """Slot of each vehicle by its public name; empty if names are not known."""


def reset_moment(
    built: BuiltScenario, traffic: str | None, *, seconds: float = 0.0, seed: int = 42
) -> Moment:
    """Return the vehicles after the reset of an episode in which every mission has an ego.

    Egos are placed, and traffic that is in their way is removed. Where missions start in one place, so that
    they are for one ego in turn, one of them has an ego; a scenario without missions has none.

    Args:
        built: The scenario.
        traffic: Variation of its traffic; None for empty roads.
        seconds: Time that the traffic flows before, on top of its warm-up [s].
        seed: Seed of the run.

    Raises:
        SmartsError: The scenario cannot be played.
    """
    played = built if traffic is None else built.with_traffic([traffic])
    missions = built.scenario.ego_missions or ()
    egos = len(expand(missions))
    if egos and not drawn_mission(missions):
        try:
            return _reset(played, egos, seconds, seed)
        except ScenarioError:
            if egos == 1:
                raise
            return _reset(played, 1, seconds, seed)
    with traffic_run(built, traffic, seed=seed) as run:
        for _ in run.steps(seconds):
            pass
        return Moment(run.states)


def _reset(played: BuiltScenario, egos: int, seconds: float, seed: int) -> Moment:
    parts = assemble([played], [AgentInterface()] * egos, seed=seed)
    with closing(parts.simulation):
        start = parts.schedule.start(0, 0)
        files = replace(start.traffic, warm_up=start.traffic.warm_up + seconds)
        parts.simulation.reset({0: replace(start, traffic=files)})
        world = parts.scene.world
        columns = (column.copy() for column in world.vehicles.of(0))
        missions = expand(played.scenario.ego_missions or ())
        slots = [-1] * len(missions)
        for agent_id, mission in enumerate(parts.schedule.combination(0, 0).plan.missions):
            number = next(n for n, each in enumerate(missions) if each == mission and slots[n] < 0)
            slots[number] = int(world.agents.slot[0, agent_id])
        names = {
            world.registry.name(0, slot): slot for slot in np.flatnonzero(world.vehicles.alive[0]).tolist()
        }
        return Moment(VehicleStates._make(columns), slots, names)
