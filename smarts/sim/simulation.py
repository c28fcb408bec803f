"""The simulation: B worlds that advance together, in the order that `Simulation.step` gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from smarts.arrays import Bools
from smarts.controllers.action_masks import ActionMasker
from smarts.controllers.set import ControllerSet
from smarts.errors import SmartsError
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.providers.traffic_engine import TrafficEngine
from smarts.providers.vehicle import FleetVehicles
from smarts.roads.scene import Scene
from smarts.sensors.suite import SensorSuite
from smarts.sim.bubble_rules import BubbleRules
from smarts.sim.contacts import FootprintContacts
from smarts.sim.entries import Entries
from smarts.sim.events import AgentEvents
from smarts.sim.manoeuvres import plan_manoeuvres
from smarts.sim.map_matching import MapMatcher
from smarts.sim.ownership import Ownership
from smarts.sim.recorders import Recorders
from smarts.sim.transfer_rules import HandoverRules
from smarts.sim.turn_signals import TurnSignals
from smarts.types.actions import Actions
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode import EpisodeStart
from smarts.types.events import Events, Outcome
from smarts.types.frame import Frame
from smarts.types.tracks import Tracks
from smarts.types.world import State, World

_SHADOWING, _ACTIVE = int(AgentStatus.SHADOWING), int(AgentStatus.ACTIVE)


class MatcherStage:
    """Matches vehicles to the map, then writes turn signals, where tasks lead, and legal lane actions."""

    def __init__(self, scene: Scene) -> None:
        plan = bind(plan_manoeuvres, scene.world.state, scene.atlas.roads)
        self._parts = MapMatcher(scene).match, TurnSignals(scene).show, plan, ActionMasker(scene).write

    def match(self, env_mask: Bools) -> None:
        """Write all vehicles' places and signals, the agents' progress, guidance and action masks."""
        for part in self._parts:
            part(env_mask)


@dataclass(frozen=True)
class Stages:
    """The parts of a simulation.

    A stage gets the world when it is made. `env_mask` says which simulations take part, shape (B,); a stage
    leaves every array of the others as it is. What a stage returns, its next call refills in place.
    """

    ownership: Ownership
    entries: Entries
    controllers: ControllerSet
    vehicles: FleetVehicles
    traffic: TrafficEngine
    matcher: MatcherStage
    contacts: FootprintContacts
    events: AgentEvents
    transfer_rules: HandoverRules
    sensors: SensorSuite
    bubbles: BubbleRules
    recorder: Recorders | None
    """None: nothing is recorded or shown."""


def invalidate(world: World, events: Events, row: int) -> None:
    """End the episode of one simulation for all of its agents, and mark it invalid."""
    agents = world.agents
    there = (agents.state[row] == AgentStatus.ACTIVE) | (agents.state[row] == AgentStatus.SHADOWING)
    agents.state[row, there] = AgentStatus.DONE
    for status in (AgentStatus.WAITING, AgentStatus.LEAVING):
        agents.state[row, agents.state[row] == status] = AgentStatus.VACANT
    agents.outcome[row, there] = Outcome.INVALID
    events.just_done[row] |= there
    events.truncated[row] |= there
    events.finished[row] = True


def _without(env_mask: Bools, failures: Mapping[int, SmartsError]) -> Bools:
    """Return which simulations make the rest of the step."""
    if failures:
        env_mask = env_mask.copy()
        env_mask[list(failures)] = False
    return env_mask


class Simulation:
    """B simulations; an episode does not depend on the other simulations, nor on how many there are.

    Args:
        world: The state, written by the stages.
        stages: The parts.
    """

    def __init__(self, world: World, stages: Stages) -> None:
        self.world = world
        self._stages = stages
        worlds, agents = world.agents.slot.shape
        self._no_tracks = Tracks.allocate(worlds, agents, world.vehicles.capacity, 0)
        self._nobody = np.zeros(world.agents.slot.shape, np.bool_)
        self._see = bind(find_seen, world.state, world.egos)

    def step(
        self,
        actions: Actions,
        env_mask: Bools,
        observe_mask: Bools,
        social_failures: Mapping[tuple[int, int], str] | None = None,
    ) -> Frame:
        """Advance some simulations by `dt`; the order of these lines is the contract.

        Args:
            actions: Actions of all agents.
            env_mask: Which simulations make the step, shape (B,).
            observe_mask: Which agents are to be observed, shape (B, A); those whose agent is done always are.
            social_failures: See `Frame`.

        Returns:
            What happened. Where traffic failed, or a vehicle's motion is not finite, the frame's
            `failures` has the error, and the episode is invalid: its agents are done, and the simulation is
            to be reset. The others have made the step.
        """
        world, stages = self.world, self._stages
        world.advance(env_mask)
        # Agents that are done still have their vehicles in the last frame.
        stages.ownership.apply(env_mask, actions.fresh)
        stages.entries.enter(env_mask)
        commands = stages.controllers.command(actions, env_mask)
        # Before traffic, so that its drivers find agents where they are at the end of the step.
        tracks = stages.vehicles.step(commands, env_mask)
        failures = dict(stages.vehicles.failures)
        env_mask = _without(env_mask, failures)
        stages.traffic.step(env_mask)
        stages.ownership.drop_vanished(env_mask)
        stages.matcher.match(env_mask)
        failures |= stages.traffic.failures
        env_mask = _without(env_mask, stages.traffic.failures)
        contacts = stages.contacts.find(tracks, env_mask)
        stages.ownership.note_collisions(contacts, env_mask)
        # Before the events: an agent that learns in a bubble ends where its vehicle leaves it.
        stages.bubbles.place(env_mask)
        # Before the sensors: the last observation of an agent is of the step that ended it.
        events = stages.events.detect(contacts, env_mask)
        for row in failures:
            invalidate(world, events, row)
        self._propose(events, env_mask)
        seen = self._see(env_mask, observe_mask, events.just_done)
        happened = commands, contacts, events, seen, stages.sensors.observe(seen), failures
        frame = Frame(
            world,
            env_mask,
            actions,
            *happened,
            transfers=stages.ownership.carried_out,
            bubbles=stages.bubbles.states,
            social_failures=social_failures or {},
        )
        if stages.recorder is not None:
            stages.recorder.record(frame)
        return frame

    def reset(self, starts: Mapping[int, EpisodeStart]) -> Frame:
        """Begin an episode in some simulations, by row; the others stay as they are.

        Raises:
            TrafficError: A traffic engine refused; all these simulations are to be reset again.
        """
        world, stages = self.world, self._stages
        rows = np.zeros(world.worlds, np.bool_)
        rows[list(starts)] = True
        starts = {row: self._begin(row, start) for row, start in starts.items()}
        # After agents, since traffic makes room for them.
        stages.traffic.reset(starts)
        stages.vehicles.reset(rows)
        stages.matcher.match(rows)
        for row in starts:
            stages.entries.clear_way(row)
            world.settle(row)
        contacts = stages.contacts.find(self._no_tracks, rows)
        stages.bubbles.place(rows)
        events = stages.events.reset(contacts, rows)
        self._propose(events, rows)
        seen = self._see(rows, ~self._nobody, self._nobody)
        happened = None, contacts, events, seen, stages.sensors.observe(seen)
        frame = Frame(world, rows, None, *happened, starts=starts, bubbles=stages.bubbles.states)
        if stages.recorder is not None:
            stages.recorder.record(frame)
        return frame

    def close(self) -> None:
        """Free the parts' resources; may be called again."""
        self._stages.traffic.close()
        self._stages.vehicles.close()
        # The last, since it may raise that the disk is full.
        if self._stages.recorder is not None:
            self._stages.recorder.close()

    def _propose(self, events: Events, env_mask: Bools) -> None:
        """Submit the transfers for the beginning of the next step."""
        ownership, stages = self._stages.ownership, self._stages
        ownership.submit(stages.transfer_rules.propose(events, env_mask))
        ownership.submit(stages.bubbles.propose(events, env_mask))

    def _begin(self, row: int, start: EpisodeStart) -> EpisodeStart:
        """Empty one simulation and let its agents in; return the episode with room for all their vehicles."""
        world, stages = self.world, self._stages
        world.clear(row)
        world.map[row], world.episode[row] = start.map, start.episode
        stages.ownership.clear(row)
        stages.transfer_rules.clear(row)
        stages.entries.reset(row, start)
        stages.bubbles.begin(row, start)
        others = np.count_nonzero(world.agents.slot[row, world.egos :] != UNSET)
        return replace(start, limit=start.limit + others) if others else start


@kernel
def find_seen(state: State, egos: int, env_mask: Bools, observe_mask: Bools, just_done: Bools) -> Bools:
    """Return which agents are observed, shape (B, A).

    An agent is observed if it has a vehicle and is in `observe_mask`, if it is done in this step, and, if it
    is no ego, in the step in which it enters.
    """
    seen = just_done.copy()
    for b in range(len(env_mask)):
        for a in range(seen.shape[1]):
            is_wanted = observe_mask[b, a] or (a >= egos and state.agents.entry_step[b, a] == state.step[b])
            if env_mask[b] and is_wanted and state.agents.state[b, a] in (_ACTIVE, _SHADOWING):
                seen[b, a] = True
    return seen
