"""The schedule: the episodes of each simulation of a run, as a pure function of its seed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from smarts.agents.social import NO_CAST, Cast
from smarts.bubbles.placing import Driver, agent_actor, columns_needed, place_bubbles
from smarts.errors import ScenarioError
from smarts.roads.atlas import ROAD_LANES
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.social_starts import Role, draw_social_starts, roles_of, room_of, wanted_by
from smarts.sim.starts import Shape, draw_starts, place_agents
from smarts.sstudio import sstypes as t
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.episodes import EpisodePlan, check_engine
from smarts.sstudio.sstypes.scenario import ScenarioMetadataFields
from smarts.sstudio.sstypes.zone import RoadSurfacePatch
from smarts.types.agent_states import UNSET
from smarts.types.bubbles import PlacedBubble
from smarts.types.episode import EpisodeStart
from smarts.types.streams import Purpose, check_seed, stream, traffic_seed
from smarts.types.traffic import DEFAULT_ENGINE, TRAFFIC_ENGINES, TrafficFiles
from smarts.types.vehicles import VehicleKind

JAM_SPACING = 7.5
"""Road that a standing vehicle takes up [m]."""
LANE_SPEED = "lane_speed"
"""Key of a scenario's metadata: the largest speed of the discrete lane actions [m/s]."""
EVEN_STEPS = 0.7548776662466927, 0.5698402909980532
MOST_VEHICLES = 1024
"""Most vehicles of traffic in a simulation, however large the map."""


def vehicle_limit(built: BuiltScenario) -> int:
    """Return the most vehicles of traffic at a time: as many as fill a scenario's roads, or were recorded."""
    if not built.traffic:
        return 0
    roads = built.roads()
    is_road = np.isin(roads.kind, list(ROAD_LANES))
    room = math.ceil(float(roads.length[is_road].sum()) / JAM_SPACING)
    return min(MOST_VEHICLES, max(room, built.most_recorded))


def traffic_files(
    built: BuiltScenario, traffic: str | None, seed: int, world: int, episode: int
) -> TrafficFiles:
    """Return a variation of the traffic as an episode plays it.

    Recordings begin at times that are spread evenly over episodes and simulations, as additive recurrences
    of irrational numbers are (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
    """
    files = built.traffic_files(traffic)
    if files.recording is None:
        return files
    share = traffic_seed(seed) / 2**31 + EVEN_STEPS[0] * episode + EVEN_STEPS[1] * world
    return replace(files, recording=files.recording.drawn(share % 1.0))


def engine_of(built: BuiltScenario, traffic: str | None) -> str:
    """Return the engine that drives a variation of a scenario's traffic.

    It is the one that the scenario names, else SUMO: on empty roads, and where the scenario names an engine
    of the language that does not exist yet.
    """
    described = (built.scenario.traffic or {}).get(traffic or "")
    return described.engine if described and described.engine in TRAFFIC_ENGINES else DEFAULT_ENGINE


def _check_given(scenarios: Sequence[BuiltScenario], weights: Sequence[float]) -> None:
    """Raise unless there are scenarios, with names of their own, and weights of all or none."""
    if not scenarios:
        raise ScenarioError("there is no scenario to play", remedy="name at least one")
    if weights and len(weights) != len(scenarios):
        problem = f"{len(weights)} weights, and {len(scenarios)} scenarios"
        raise ScenarioError(problem, place="weights", remedy="give one for each scenario")
    # Results and recordings tell scenarios apart by their names.
    known: dict[str, BuiltScenario] = {}
    for built in scenarios:
        first = known.setdefault(built.name, built)
        if first.directory != built.directory:
            raise ScenarioError(
                f"two scenarios are called {built.name!r}",
                place=f"{first.source}, {built.source}",
                remedy="rename one of the folders or map files",
            )


def _refuse_unplayable(combinations: Iterable[Combination]) -> None:
    """Raise if an engine is to drive a recording that drives routes, or the other way round."""
    for each in combinations:
        name = each.plan.traffic
        is_recorded = name is not None and each.built.traffic[name].recording is not None
        check_engine(each.engine, name, is_recorded, each.built.name)


def _ground(built: BuiltScenario) -> tuple[Path, tuple[RoadSurfacePatch, ...], float]:
    """Return what scenarios that share a map in the atlas have in common: map, surface, largest speed."""
    speed = (built.scenario.scenario_metadata or {}).get(LANE_SPEED)
    patches = tuple(built.scenario.friction_maps or ())
    return built.directory, patches, math.inf if speed is None else float(speed)


def _interests(scenarios: Iterable[BuiltScenario]) -> dict[str, str]:
    """Return the pattern of the names of the vehicles that each scenario marks, "" for none."""
    key = ScenarioMetadataFields.actor_of_interest_re_filter.name
    return {built.name: str((built.scenario.scenario_metadata or {}).get(key) or "") for built in scenarios}


@dataclass(frozen=True)
class Combination:
    """A variation of a scenario's traffic with a set of its missions."""

    built: BuiltScenario
    map: int
    plan: EpisodePlan
    engine: str
    """Name among `TRAFFIC_ENGINES` of the one that drives the traffic."""


class Schedule:
    """The episodes of a run.

    Each simulation plays all combinations of scenarios, traffic and missions in an order of its own, then all
    of them in another order, and so on. With weights, each episode draws a scenario, and one of its
    combinations.

    Args:
        scenarios: The scenarios.
        agents: Names of the egos.
        shapes: The egos' vehicles, by default cars.
        seed: Seed of the run.
        engine: One of `TRAFFIC_ENGINES`; by default the one that each scenario names.
        cast: The social policies; without any, scenarios' social agents and bubbles have no effect.
        weights: Weight of each scenario, by default none.

    Raises:
        ScenarioError: There is no scenario, two different ones have one name, one has fewer missions than
            there are egos, or a mission is closed to an ego's vehicle.
    """

    def __init__(
        self,
        scenarios: Sequence[BuiltScenario],
        agents: Sequence[str],
        *,
        shapes: Sequence[Shape] | None = None,
        seed: int = 42,
        engine: str | None = None,
        cast: Cast = NO_CAST,
        weights: Sequence[float] = (),
    ) -> None:
        _check_given(scenarios, weights)
        check_seed(seed, "seed")
        self.seed = seed
        self.agents = tuple(agents)
        self._shapes = tuple(shapes) if shapes else (Shape(),) * len(self.agents)
        grounds = [_ground(built) for built in scenarios]
        unique = [*dict.fromkeys(grounds)]
        self.maps: tuple[LaneGraph, ...] = tuple(scenarios[grounds.index(each)].roads() for each in unique)
        """Each map once, or as often as it is driven on differently, in the order of its number."""
        self.surfaces = tuple(surface for _, surface, _ in unique)
        """Places on each map whose friction differs from a dry road's."""
        self.speeds = np.array([speed for _, _, speed in unique])
        """The largest speed of the discrete lane actions on each map [m/s]."""
        # Agents that learn in bubbles have no missions.
        self._egos = () if cast.learning else self.agents
        missions = len(self._egos)
        self.combinations = tuple(
            Combination(built, unique.index(ground), plan, engine or engine_of(built, plan.traffic))
            for built, ground in zip(scenarios, grounds, strict=True)
            for plan in built.episodes(missions)
        )
        """All combinations, in the order of the scenarios."""
        _refuse_unplayable(self.combinations)
        self._shares = np.array(weights, float) / (sum(weights) or 1.0)
        names = [each.built.name for each in self.combinations]
        self._rows = [np.flatnonzero(np.array(names) == built.name) for built in scenarios if weights]
        self.interests = _interests(scenarios)
        """Pattern of the names of the vehicles that each scenario marks, "" for none."""
        self._limits = {built.name: vehicle_limit(built) for built in scenarios}
        self._cast = cast
        self._bubbles = {built.name: self._placed(built) for built in scenarios}
        self._rooms = {built.name: self._room(built) for built in scenarios}
        self._refuse_closed_ways()

    @property
    def limit(self) -> int:
        """The most vehicles of traffic in any scenario."""
        return max(self._limits.values())

    @property
    def rooms(self) -> tuple[tuple[int, ...], ...]:
        """The most social agents of each interface in each scenario."""
        return tuple(self._rooms.values())

    @property
    def engines(self) -> tuple[str, ...]:
        """The traffic engines of all episodes, in order of appearance."""
        return tuple(dict.fromkeys(each.engine for each in self.combinations))

    @property
    def vias(self) -> int:
        """The most via points of any mission."""
        egos = (mission for each in self.combinations for mission in each.plan.missions)
        others = (role.mission for each in self.combinations for role in self._roles(each))
        return max((len(mission.via) for mission in itertools.chain(egos, others)), default=0)

    def combination(self, world: int, episode: int, seed: int | None = None) -> Combination:
        """Return what a simulation of the run plays in an episode."""
        seed = self.seed if seed is None else seed
        if len(self._shares):
            draws = stream(seed, Purpose.SCENARIOS, world=world, episode=episode)
            rows = self._rows[draws.choice(len(self._shares), p=self._shares)]
            return self.combinations[rows[draws.integers(len(rows))]]
        round_number, place = divmod(episode, len(self.combinations))
        order = stream(seed, Purpose.SCENARIOS, world=world, episode=round_number)
        return self.combinations[order.permutation(len(self.combinations))[place]]

    def start(self, world: int, episode: int, seed: int | None = None) -> EpisodeStart:
        """Return an episode of one simulation, drawn by the run's seed unless another is given.

        Raises:
            ScenarioError: A mission cannot be on its map.
        """
        seed = self.seed if seed is None else seed
        chosen = self.combination(world, episode, seed)
        built = chosen.built
        generator = stream(seed, Purpose.STARTS, world=world, episode=episode)
        shapes = self._shapes[: len(self._egos)]
        plan = chosen.plan.dealt(len(self._egos), generator)
        egos = draw_starts(built, plan.missions, self._egos, shapes, generator)
        # Of its own: social agents change nothing of the egos.
        generator = stream(seed, Purpose.SOCIAL, world=world, episode=episode)
        roles = roles_of(plan, self._cast, built.name)
        others = draw_social_starts(built, roles, egos, self._cast.policies, generator)
        return EpisodeStart(
            seed=seed,
            world=world,
            episode=episode,
            scenario=built.name,
            map=chosen.map,
            traffic=traffic_files(built, plan.traffic, seed, world, episode),
            traffic_name=plan.traffic,
            traffic_seed=traffic_seed(seed, world=world, episode=episode),
            limit=self._limits[built.name] + len(self._egos),
            agents=(*egos, *others),
            engine=chosen.engine,
            bubbles=self._bubbles[built.name],
            room=self._rooms[built.name] if self._cast.policies else None,
        )

    def _refuse_closed_ways(self) -> None:
        """Raise if a mission of an agent that drives no car is closed to its vehicle; cars' are built so."""
        cars = {shape.kind for shape in self._shapes} <= {VehicleKind.PASSENGER}
        for each in () if cars else self.combinations:
            generator = stream(self.seed, Purpose.STARTS, world=0, episode=0)
            shapes = self._shapes[: len(self._egos)]
            built, missions = each.built, each.plan.dealt(len(self._egos), generator).missions
            place_agents(built, missions, shapes, generator, built.scenario.start_variation, built.name)

    def _roles(self, chosen: Combination) -> tuple[Role, ...]:
        return roles_of(chosen.plan, self._cast, chosen.built.name)

    def _placed(self, built: BuiltScenario) -> tuple[PlacedBubble, ...]:
        if not self._cast or not built.scenario.bubbles:
            return ()
        return place_bubbles(built.scenario.bubbles, built.roads(), self._driver_of)

    def _driver_of(self, bubble: t.Bubble) -> Driver:
        learning, actor = self._cast.learning, agent_actor(bubble)
        if learning and learning.has(bubble.id):
            return Driver(UNSET, UNSET)
        assert actor is not None
        number = self._cast.numbers[wanted_by(actor)]
        policy = self._cast.policies[number]
        return Driver(number, policy.interface, policy.period)

    def _room(self, built: BuiltScenario) -> tuple[int, ...]:
        """Return the most social agents of each interface in a scenario."""
        plans = [self._roles(each) for each in self.combinations if each.built.name == built.name]
        bubbles = [
            (self._driver_of(bubble).policy, columns_needed(bubble))
            for bubble in built.scenario.bubbles or ()
            if self._bubbles[built.name] and agent_actor(bubble)
        ]
        bubbles = [each for each in bubbles if each[0] != UNSET]
        return room_of(plans, bubbles, self._cast)
