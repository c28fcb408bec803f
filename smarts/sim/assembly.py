"""Assembly: scenarios and interfaces in, a simulation that is ready to run out."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from smarts.agents.interface import AgentInterface
from smarts.agents.options import InterfaceError
from smarts.agents.pooled import PooledAgents, merge_pools
from smarts.agents.rules import agent_rules, alive_rules
from smarts.agents.social import NO_CAST, Cast, SocialPolicy
from smarts.controllers import action_format
from smarts.controllers.set import ControllerSet
from smarts.errors import ScenarioError, nearest_names
from smarts.providers.traffic_engine import TrafficEngine
from smarts.providers.traffic_engines import traffic_of
from smarts.providers.vehicle import FleetVehicles
from smarts.providers.vehicle_surface import DRY, RoadSurfaces
from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import RoadAtlas
from smarts.roads.scene import Scene
from smarts.sensors.suite import SensorSuite
from smarts.sim.agent_pool import AgentPool
from smarts.sim.bubble_rules import BubbleRules
from smarts.sim.contacts import FootprintContacts
from smarts.sim.entries import Entries
from smarts.sim.events import AgentEvents, LearningInBubbles
from smarts.sim.interest import interest_of
from smarts.sim.options import ENVISION, Options
from smarts.sim.outlet import Address
from smarts.sim.ownership import Ownership
from smarts.sim.recorders import Recorders
from smarts.sim.schedule import Schedule
from smarts.sim.simulation import MatcherStage, Simulation, Stages
from smarts.sim.starts import shape_of
from smarts.sim.transfer_rules import HandoverRules
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.episodes import check_without_handovers
from smarts.types.actions import Actions
from smarts.types.agent_states import agent_names
from smarts.types.interface import AgentRules
from smarts.types.vehicles import Owner
from smarts.types.world import World


@dataclass(frozen=True)
class Assembly:
    """A simulation and its parts that callers use."""

    simulation: Simulation
    schedule: Schedule
    """The episodes of the run; `simulation.reset({row: schedule.start(world, episode)})`."""
    scene: Scene
    """The state, the maps and the routes, for sensors, controllers and adapters."""
    rules: AgentRules
    """The rules of all agents."""
    actions: Actions
    """Buffers with the kinds of all agents."""
    pool: AgentPool
    """The agents of each episode, and the columns that they hold."""
    ownership: Ownership
    """Carries out transfers of vehicles between owners."""
    entries: Entries
    """Lets agents enter, and knows which cannot."""
    recorder: Recorders | None
    """Takes annotations of the episodes that are recorded or shown; None if none are."""
    cast: Cast = NO_CAST
    latency_steps: int = 0
    """Steps from an action of an ego to when it is carried out."""

    @property
    def policies(self) -> tuple[SocialPolicy, ...]:
        """The policies of the social agents, by number."""
        return self.cast.policies

    @property
    def learns_in_bubbles(self) -> bool:
        """Whether the egos' columns are a pool of agents that drive the vehicles in bubbles."""
        return self.cast.learning is not None


def assemble(
    scenarios: Sequence[BuiltScenario],
    interfaces: Sequence[AgentInterface],
    *,
    agents: Sequence[str] = (),
    pool: Sequence[PooledAgents] = (),
    cast: Cast = NO_CAST,
    looked_at: Mapping[int, Collection[str]] | None = None,
    worlds: int = 1,
    seed: int = 42,
    options: Options | None = None,
) -> Assembly:
    """Return B simulations of some scenarios, to be reset before the first step.

    Args:
        scenarios: The scenarios, played in turns.
        interfaces: One per ego, in the order of their columns.
        agents: The egos' names; by default `agent_names`.
        pool: Room for agents that come and go: social agents, and agents that take vehicles over. Their
            columns are behind the egos', vacant until an agent enters. Entries of one interface are merged.
        cast: The social policies. With them, the scenarios' social agents and bubbles take part, and the pool
            has room for them before its other entries.
        looked_at: Names of the sensors that are read, by agent_id: the others are not observed. An agent that
            is missing has all of its sensors observed.
        worlds: B.
        seed: Seed of the run.
        options: How the simulations are run.

    Raises:
        ScenarioError: A scenario cannot be played with so many egos.
        InterfaceError: A social policy counts in steps of another length, or there is no agent of a name in
            `Options.record_observations`.
        UnknownNameError: There is no such traffic engine.
    """
    options = options or Options()
    _check_step_lengths(cast, options)
    names = tuple(agents) or agent_names(len(interfaces))
    shapes = [shape_of(interface) for interface in interfaces]
    engine, weights = options.traffic_engine, options.weights
    schedule = Schedule(scenarios, names, shapes=shapes, seed=seed, engine=engine, cast=cast, weights=weights)
    if options.latency_steps and cast.learning is not None:
        raise ScenarioError(
            f"action_latency is {options.action_latency} s, and the egos learn in bubbles",
            place="Options.action_latency",
            remedy="leave out action_latency: an action would arrive at another vehicle than it is meant for",
        )
    if options.traffic_step is not None:
        for built in scenarios:
            check_without_handovers(built.scenario, built.name)
        if cast or pool:
            raise ScenarioError(
                "traffic_step is set, and agents come and go beside the learning ones",
                place="Options.traffic_step",
                remedy="leave out traffic_step, or social agents and bubbles",
            )
    merged = merge_pools([*_pool_of(cast, schedule), *merge_pools(pool)])
    every = [*interfaces, *(each.interface for each in merged for _ in range(each.capacity))]
    scene = _scene(schedule, worlds, len(interfaces), len(every), options)
    capacities = [each.capacity for each in merged]
    agent_pool = AgentPool(scene.world, scene.routes, [each.interface for each in merged], capacities)
    with ExitStack() as on_failure:
        vehicles = _vehicles(scene, every, schedule, options)
        on_failure.callback(vehicles.close)
        traffic = traffic_of(schedule.engines, scene.world, schedule.maps, options.traffic_step)
        on_failure.callback(traffic.close)
        parts = _assemble(
            scene, every, names, schedule, agent_pool, vehicles, traffic, options, looked_at or {}, cast
        )
        on_failure.pop_all()
    return parts


def _check_step_lengths(cast: Cast, options: Options) -> None:
    for policy in cast.policies:
        if policy.step_length not in (None, options.dt):
            raise InterfaceError(
                f"a step of {options.dt} s, and {policy.locator!r} counts in steps of {policy.step_length} s",
                place="Options.dt",
                remedy="leave out dt, or let other agents drive",
            )


def _pool_of(cast: Cast, schedule: Schedule) -> list[PooledAgents]:
    """Return room for the social agents, by the number of their interface."""
    rooms = zip(*schedule.rooms, strict=True)
    return [
        PooledAgents(interface, max(1, *room)) for interface, room in zip(cast.interfaces, rooms, strict=True)
    ]


def _scene(schedule: Schedule, worlds: int, egos: int, agents: int, options: Options) -> Scene:
    atlas = RoadAtlas(schedule.maps)
    world = World(
        worlds=worlds,
        # The pool twice: traffic may have filled the places of agents that have gone.
        capacity=schedule.limit + agents + (agents - egos),
        agents=agents,
        egos=egos,
        lanes=max(len(graph.lane_ids) for graph in schedule.maps),
        vias=schedule.vias,
        dt=options.dt,
    )
    return Scene(world, atlas, AgentRoutes(atlas, worlds, agents))


def _vehicles(
    scene: Scene, interfaces: Sequence[AgentInterface], schedule: Schedule, options: Options
) -> FleetVehicles:
    friction = DRY if options.friction is None else options.friction
    has_surfaces = any(schedule.surfaces) or options.friction is not None
    return FleetVehicles(
        scene.world,
        [interface.vehicle_model for interface in interfaces],
        surfaces=RoadSurfaces(schedule.surfaces, schedule.maps, friction) if has_surfaces else None,
        tyres=[interface.tyre_model for interface in interfaces],
        flat_tyres={agent_id: interface.flat_tyres for agent_id, interface in enumerate(interfaces)},
    )


def _assemble(
    scene: Scene,
    interfaces: Sequence[AgentInterface],
    names: Sequence[str],
    schedule: Schedule,
    pool: AgentPool,
    vehicles: FleetVehicles,
    traffic: TrafficEngine,
    options: Options,
    looked_at: Mapping[int, Collection[str]],
    cast: Cast,
) -> Assembly:
    world, rules = scene.world, agent_rules(interfaces, options.dt)
    ownership = Ownership(world, {Owner.TRAFFIC: traffic, Owner.AGENT: vehicles}, pool)
    entries = Entries(world, ownership, scene.routes, pool)
    observers = _observers(names, options)
    recorder = _recorder(scene, pool, options, [policy.name for policy in cast.policies], observers)
    looked_at = {**looked_at, **_unread(cast, pool)}
    for agent_id in observers:
        looked_at.pop(agent_id, None)
    controllers = ControllerSet(scene, rules.action.tolist(), schedule.speeds)
    alive = alive_rules(interfaces, names, world.egos)
    interest = interest_of(world, interfaces, schedule, entries)
    contacts = FootprintContacts(world)
    bubbles = BubbleRules(world, scene.routes, pool, vehicles.can_accept)
    learning = None
    if cast.learning is not None:
        learning = LearningInBubbles(bubbles, max(1, round(cast.learning.episode_time / options.dt)))
    events = AgentEvents(scene, rules, alive, interest, entries.coming, learning)
    sensors = SensorSuite(scene, interfaces, looked_at)
    stages = Stages(
        ownership=ownership,
        entries=entries,
        controllers=controllers,
        vehicles=vehicles,
        traffic=traffic,
        matcher=MatcherStage(scene),
        contacts=contacts,
        events=events,
        transfer_rules=HandoverRules(world, entries, pool, ownership.can_take),
        sensors=sensors,
        bubbles=bubbles,
        recorder=recorder,
    )
    has_paths = any(action_format(int(kind)).has_path for kind in rules.action)
    actions = Actions.allocate(world.worlds, len(rules.action), options.path if has_paths else 0)
    actions.kind[:] = rules.action
    for columns in (actions, controllers.columns, vehicles.columns, contacts.contacts, events.columns):
        pool.clear_with(columns)
    pool.clear_readings_with(sensors.readings)
    simulation = Simulation(world, stages)
    return Assembly(
        *(simulation, schedule, scene, rules, actions, pool, ownership, entries, recorder, cast),
        latency_steps=options.latency_steps,
    )


def _unread(cast: Cast, pool: AgentPool) -> dict[int, Collection[str]]:
    """Return the columns whose agents all observe by features, which read no sensor."""
    reads = {policy.interface for policy in cast.policies if policy.observation is None}
    numbers = {policy.interface for policy in cast.policies} - reads
    columns = (pool.columns(number) for number in sorted(numbers))
    return {agent_id: () for part in columns for agent_id in range(part.start, part.stop)}


def _observers(names: Sequence[str], options: Options) -> list[int]:
    """Return the agent_ids of the egos whose observations are recorded."""
    for name in options.record_observations:
        if name not in names:
            raise InterfaceError(
                f"there is no agent {name!r}",
                place="Options.record_observations",
                remedy=nearest_names(str(name), names),
            )
    return [names.index(name) for name in dict.fromkeys(options.record_observations)]


def _recorder(
    scene: Scene, pool: AgentPool, options: Options, policies: Sequence[str], observers: Sequence[int]
) -> Recorders | None:
    parts: list[Any] = []
    if options.record is not None:
        # Only recording runs wait for pyarrow.
        from smarts.sim.recorder import EpisodeRecorder

        folder = Path(options.record)
        chosen = {"everything": options.record_all, "observers": observers}
        parts.append(EpisodeRecorder(scene, folder, pool, policies, **chosen))
    viewer = os.environ.get(ENVISION, "") if options.envision is None else options.envision
    if viewer:
        from smarts.sim.publisher import EpisodePublisher

        address = Address.parse(viewer, "Options.envision" if options.envision else ENVISION)
        parts.append(EpisodePublisher(scene, address, pool, policies, options.policy))
    return Recorders(parts) if parts else None
