"""Runs in which agents of the zoo drive vehicles of traffic in bubbles, and the same runs without."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from perf.handover_safety import Safety, Watch
from smarts.agents.benchmark import benchmark_interface
from smarts.agents.social import NO_CAST, BubbleLearning
from smarts.env.casting import cast_of
from smarts.env.runner import EpisodeKey, SimulationRunner
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.assembly import assemble
from smarts.sim.schedule import Schedule
from smarts.sstudio import build_scenario
from smarts.sstudio import sstypes as t
from smarts.sstudio.built import BuiltScenario
from smarts.types.episode import EpisodeStart
from smarts.types.frame import Frame
from smarts.types.transfers import Reason

BUBBLES, SIZE, MARGIN = 6, 90.0, 20.0
"""Bubbles on a map, at random places; length of their sides and their margin [m]."""
LIMIT = 8
"""Most vehicles that agents drive in a bubble."""
IDLE = "nobody-learns-here"
"""Id of the bubble of the learning agent that a run has: it takes no vehicle."""

Change = Callable[[EpisodeStart], EpisodeStart]


class _Changed:
    """A schedule whose starts are changed."""

    def __init__(self, schedule: Schedule, change: Change) -> None:
        self._schedule, self._change = schedule, change

    def start(self, world: int, episode: int, seed: int | None = None) -> EpisodeStart:
        return self._change(self._schedule.start(world, episode, seed))


class _Listener:
    """Shows each step to a watch, and counts hand-overs."""

    def __init__(self, watch: Watch) -> None:
        self.watch, self.handovers = watch, 0

    def collect(self, frame: Frame, is_last: bool) -> None:
        if frame.failures:
            raise next(iter(frame.failures.values()))
        self.watch.take(frame)
        of = (Reason.TAKE, Reason.RELEASE)
        self.handovers += sum(
            int(done.transfer["reason"]) in of and done.transfer["from_owner"] != done.transfer["to_owner"]
            for done in frame.transfers
        )

    def reset(self, egos: object) -> None:
        """Do nothing."""


def with_bubbles(built: BuiltScenario, driver: str, seed: int) -> BuiltScenario:
    """Return a scenario with bubbles at random places of its roads, in which agents drive."""
    roads, generator = built.roads(), np.random.Generator(np.random.Philox(seed))
    actor = t.SocialAgentActor("driver", agent_locator=f"smarts.zoo:{driver}-v0")
    places = [_place(roads, generator) for _ in range(BUBBLES)]
    limits = t.BubbleLimits(LIMIT, LIMIT + 4)
    bubbles = [
        t.Bubble(t.PositionalZone(place, (SIZE, SIZE)), actor, margin=MARGIN, limit=limits)
        for place in places
    ]
    never = t.TimeWindowCondition(1e6, 2e6)
    idle = t.Bubble(t.PositionalZone(places[0], (SIZE, SIZE)), actor, id=IDLE, active_condition=never)
    return _with(built, [*bubbles, idle])


def _with(built: BuiltScenario, bubbles: Sequence[t.Bubble]) -> BuiltScenario:
    """Return a scenario with other bubbles, and the same artefacts."""
    changed = replace(built)
    # As if it had been read so.
    vars(changed)["scenario"] = replace(built.scenario, bubbles=tuple(bubbles))
    return changed


def _place(roads: LaneGraph, generator: np.random.Generator) -> tuple[float, float]:
    point = roads.point_xy[int(generator.integers(len(roads.point_xy)))]
    return float(point[0]), float(point[1])


def run_driven(
    name: str, driver: str, handovers: int, seed: int, steps: int, change: Change, safety: Safety
) -> int:
    """Let agents of the zoo drive in one scenario until some hand-overs are made; return how many were."""
    made, episode = 0, 0
    while made < handovers:
        built = with_bubbles(
            build_scenario(name).with_traffic(["random_social_vehicles"]), driver, seed + episode
        )
        with_agents = _play(built, True, episode, seed, steps, change)
        safety.driven.append(with_agents.watch)
        safety.plain.append(_play(built, False, episode, seed, steps, change).watch)
        made += with_agents.handovers
        episode += 1
    return made


def _play(
    built: BuiltScenario, takes: bool, episode: int, seed: int, steps: int, change: Change
) -> _Listener:
    """Play an episode, with or without the bubbles."""
    if not takes:
        built = _with(built, [bubble for bubble in built.scenario.bubbles or () if bubble.id == IDLE])
    learning = BubbleLearning(steps * 0.1, (IDLE,))
    cast = cast_of([built], (), learning) or replace(NO_CAST, learning=learning)
    parts = assemble([built], [benchmark_interface()], cast=cast, worlds=1, seed=seed)
    parts = replace(parts, schedule=_Changed(parts.schedule, change))  # type: ignore[arg-type]
    listener = _Listener(Watch(parts.simulation.world.dt))
    runner = SimulationRunner(parts, [listener])
    try:
        # No agent learns: the runner steps until the episode is over.
        runner.reset({0: EpisodeKey(0, episode, seed)})
        while runner.running.any():
            runner.step()
    finally:
        runner.close()
    listener.watch.end(parts.ownership)
    return listener
