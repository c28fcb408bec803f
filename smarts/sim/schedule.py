"""The schedule: which episode each simulation of a run plays when, as a pure function of its seed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smarts.errors import ScenarioError
from smarts.roads.atlas import ROAD_LANES
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.starts import Shape, draw_starts
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.episodes import EpisodePlan
from smarts.sstudio.sstypes.scenario import ScenarioMetadataFields
from smarts.sstudio.sstypes.zone import RoadSurfacePatch
from smarts.types.episode import EpisodeStart
from smarts.types.streams import Purpose, check_seed, stream, traffic_seed
from smarts.types.traffic import DEFAULT_ENGINE, TRAFFIC_ENGINES

JAM_SPACING = 7.5
"""Road that a standing vehicle takes up [m]."""
LANE_SPEED = "lane_speed"
"""Of a scenario's metadata: the largest speed of the discrete lane actions [m/s]."""
MOST_VEHICLES = 1024
"""Of traffic in a simulation, however large the map."""


def vehicle_limit(built: BuiltScenario) -> int:
    """Return the most vehicles of traffic that a scenario has at a time: as many as fill its roads."""
    if not built.traffic:
        return 0
    roads = built.roads()
    is_road = np.isin(roads.kind, list(ROAD_LANES))
    return min(MOST_VEHICLES, math.ceil(float(roads.length[is_road].sum()) / JAM_SPACING))


def engine_of(built: BuiltScenario, traffic: str | None) -> str:
    """Return the engine that drives a variation of a scenario's traffic.

    It is the one that the scenario names, else SUMO: on empty roads, and where the scenario names an engine
    of the language that does not exist yet.
    """
    described = (built.scenario.traffic or {}).get(traffic or "")
    return described.engine if described and described.engine in TRAFFIC_ENGINES else DEFAULT_ENGINE


def _ground(built: BuiltScenario) -> tuple[int, tuple[RoadSurfacePatch, ...], float]:
    """Return what scenarios that share a map in the atlas have in common: map, surface, largest speed."""
    speed = (built.scenario.scenario_metadata or {}).get(LANE_SPEED)
    patches = tuple(built.scenario.friction_maps or ())
    return id(built.roads()), patches, math.inf if speed is None else float(speed)


def _interest(built: BuiltScenario) -> str:
    metadata = built.scenario.scenario_metadata or {}
    return str(metadata.get(ScenarioMetadataFields.actor_of_interest_re_filter.name) or "")


@dataclass(frozen=True)
class Combination:
    """A variation of a scenario's traffic with a set of its missions."""

    built: BuiltScenario
    map: int
    plan: EpisodePlan
    engine: str
    """Which of `TRAFFIC_ENGINES` drives the traffic."""


class Schedule:
    """The episodes of a run.

    Each simulation goes through all combinations of scenarios, traffic and missions in an order of its own,
    then through all of them in another order.

    Args:
        scenarios: What is played.
        agents: Names of the egos.
        shapes: Their vehicles', by default cars.
        others: How many further agents there may be, whose vehicles come on top of traffic's, too.
        seed: Of the run.
        engine: Which of `TRAFFIC_ENGINES` drives, whatever the scenarios say; by default as they say.

    Raises:
        ScenarioError: There is no scenario, or one has fewer missions than there are egos.
    """

    def __init__(
        self,
        scenarios: Sequence[BuiltScenario],
        agents: Sequence[str],
        *,
        shapes: Sequence[Shape] | None = None,
        others: int = 0,
        seed: int = 42,
        engine: str | None = None,
    ) -> None:
        if not scenarios:
            raise ScenarioError("there is no scenario to play", remedy="name at least one")
        check_seed(seed, "seed")
        self.seed = seed
        self.agents = tuple(agents)
        self._most_agents = len(self.agents) + others
        self._shapes = tuple(shapes) if shapes else (Shape(),) * len(self.agents)
        grounds = [_ground(built) for built in scenarios]
        unique = [*dict.fromkeys(grounds)]
        first = [scenarios[grounds.index(ground)] for ground in unique]
        self.maps: tuple[LaneGraph, ...] = tuple(built.roads() for built in first)
        """Each map once, or as often as it is driven on differently, in the order of its number."""
        self.surfaces = tuple(surface for _, surface, _ in unique)
        """Where each map has another friction than a dry road."""
        self.speeds = np.array([speed for _, _, speed in unique])
        """The largest speed of the discrete lane actions on each map [m/s]."""
        self.combinations = tuple(
            Combination(built, unique.index(ground), plan, engine or engine_of(built, plan.traffic))
            for built, ground in zip(scenarios, grounds, strict=True)
            for plan in built.episodes(len(self.agents))
        )
        """Everything that is played, in the order of the scenarios."""
        self.interests = {built.name: _interest(built) for built in scenarios}
        """Pattern of the names of the vehicles that each scenario marks, "" for none."""
        self._limits = {built.name: vehicle_limit(built) for built in scenarios}

    @property
    def limit(self) -> int:
        """The most vehicles of traffic in any scenario."""
        return max(self._limits.values())

    @property
    def engines(self) -> tuple[str, ...]:
        """The traffic engines of all episodes, in order of appearance."""
        return tuple(dict.fromkeys(each.engine for each in self.combinations))

    @property
    def vias(self) -> int:
        """The most via points of any mission."""
        missions = (mission for each in self.combinations for mission in each.plan.missions)
        return max((len(mission.via) for mission in missions), default=0)

    def combination(self, world: int, episode: int, seed: int | None = None) -> Combination:
        """Return what a simulation of the run plays in an episode."""
        round_number, place = divmod(episode, len(self.combinations))
        seed = self.seed if seed is None else seed
        order = stream(seed, Purpose.SCENARIOS, world=world, episode=round_number)
        return self.combinations[order.permutation(len(self.combinations))[place]]

    def start(self, world: int, episode: int, seed: int | None = None) -> EpisodeStart:
        """Return an episode of one simulation, drawn by the run's seed unless another is given.

        Raises:
            ScenarioError: A mission cannot be on its map.
        """
        seed = self.seed if seed is None else seed
        chosen = self.combination(world, episode, seed)
        built, plan = chosen.built, chosen.plan
        generator = stream(seed, Purpose.STARTS, world=world, episode=episode)
        return EpisodeStart(
            seed=seed,
            world=world,
            episode=episode,
            scenario=built.name,
            map=chosen.map,
            traffic=built.traffic_files(plan.traffic),
            traffic_name=plan.traffic,
            traffic_seed=traffic_seed(seed, world=world, episode=episode),
            limit=self._limits[built.name] + self._most_agents,
            agents=draw_starts(built, plan.missions, self.agents, self._shapes, generator),
            engine=chosen.engine,
        )
