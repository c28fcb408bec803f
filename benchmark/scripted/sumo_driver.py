"""SUMO's driver model in the agents' vehicles: a rule-based driver with full knowledge of the simulation.

The vehicles are handed to the traffic engine after half a second, and judged by the events of agents. SUMO's
drivers get roads, not lanes: any lane of the goal's road will do for them.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Generator, Iterable

import numpy as np

from smarts.agents.benchmark import benchmark_interface
from smarts.errors import TrafficError
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.assembly import Assembly, assemble
from smarts.sim.outcomes import outcome_of
from smarts.sstudio.build import build_scenario
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode import AgentStart, EpisodeStart
from smarts.types.events import Outcome
from smarts.types.frame import Frame
from smarts.types.transfers import Reason, transfers
from smarts.types.vehicles import Owner

UNTIL_HANDED_OVER = 5
"""Steps. A vehicle that is handed to SUMO as soon as SUMO knows it has no route."""


def sumo_episodes(
    scenario: str, traffic: list[str] | None, agents: int, seed: int, first_episode: int
) -> Generator[tuple[Counter[str], float]]:
    """Yield how the agents end, and after how many steps, in one episode of each world after the other.

    Raises:
        TrafficError: The traffic failed.
    """
    built = build_scenario(scenario)
    if traffic is not None:
        built = built.with_traffic(traffic)
    parts = assemble([built], [benchmark_interface() for _ in range(agents)], seed=seed)
    try:
        world = first_episode
        while True:
            start = parts.schedule.start(world, 0)
            yield _episode(parts, _freed(start, parts.schedule.maps[start.map]))
            world += 1
    finally:
        parts.simulation.close()


def _freed(start: EpisodeStart, roads: LaneGraph) -> EpisodeStart:
    """Return an episode whose goals are reached in any lane, with ways on beyond them."""
    return dataclasses.replace(
        start, agents=tuple(_freed_agent(agent_start, roads) for agent_start in start.agents)
    )


def _freed_agent(agent_id: AgentStart, roads: LaneGraph) -> AgentStart:
    mission = agent_id.mission
    goal = mission.goal_lane
    beside = np.flatnonzero(roads.lane_edge == roads.lane_edge[goal])
    # SUMO removes a vehicle at the end of its route, which may be before the goal.
    onward = [lane for lane in roads.successors(goal).tolist() if not roads.is_internal[lane]]
    inner = [lane for lane in roads.successors(goal).tolist() if roads.is_internal[lane]]
    onward += [int(lane) for each in inner for lane in roads.successors(each) if not roads.is_internal[lane]]
    more = tuple(roads.edge_ids[roads.lane_edge[lane]] for lane in onward[:1])
    radius = max(mission.goal_radius, float(roads.width[beside].sum()))
    route = (*mission.route, *more)
    return dataclasses.replace(
        agent_id, mission=dataclasses.replace(mission, route=route, goal_radius=radius)
    )


def _episode(parts: Assembly, start: EpisodeStart) -> tuple[Counter[str], float]:
    """Play an episode; return the agents by outcome, and the steps it took."""
    simulation, world = parts.simulation, parts.simulation.world
    frame = simulation.reset({0: start})
    outcomes: Counter[str] = Counter()
    if frame.events.finished[0]:
        return Counter({"invalid": len(start.agents)}), 0.0
    left = set(range(len(start.agents)))
    env_mask, observe_mask = np.ones(1, np.bool_), np.zeros(world.agents.state.shape, np.bool_)
    while left:
        if world.step[0] >= UNTIL_HANDED_OVER:
            # Again in each step until SUMO takes the vehicle.
            driving = world.agents.state[0] == AgentStatus.ACTIVE
            _hand_over(parts, (agent_id for agent_id in left if driving[agent_id]), Owner.TRAFFIC)
        frame = simulation.step(parts.actions, env_mask, observe_mask)
        for error in frame.failures.values():
            raise TrafficError("the traffic failed", place=f"world {start.world}") from error
        ended = {agent_id: outcome for agent_id in left if (outcome := _outcome(parts, frame, agent_id))}
        outcomes.update(Outcome(outcome).name.lower() for outcome in ended.values())
        left -= {*ended}
        _hand_over(parts, ended, Owner.NOBODY)
    return outcomes, float(world.step[0])


def _outcome(parts: Assembly, frame: Frame, agent_id: int) -> int:
    """Return how an agent's episode has ended in this step, 0 while it drives."""
    agents = parts.simulation.world.agents
    if agents.state[0, agent_id] == AgentStatus.DONE:
        return int(agents.outcome[0, agent_id])
    return int(outcome_of(int(frame.events.bits[0, agent_id] & parts.rules.ending[agent_id])))


def _hand_over(parts: Assembly, chosen: Iterable[int], owner: Owner) -> None:
    """Give the vehicles of some agents to another driver in the next step, or take them out of the world."""
    world = parts.simulation.world
    rows = []
    for agent_id in chosen:
        slot = int(world.agents.slot[0, agent_id])
        if slot == UNSET:
            continue
        to_agent = UNSET if owner == Owner.NOBODY else agent_id
        reason = Reason.LEAVE if owner == Owner.NOBODY else Reason.RELEASE
        generation, now = int(world.agents.generation[0, agent_id]), int(world.vehicles.owner[0, slot])
        rows.append((0, slot, generation, now, agent_id, owner, to_agent, reason))
    parts.ownership.submit(transfers(rows))
