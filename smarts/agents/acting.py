"""The social policies of this process: `ask` takes a request, `take` computes and returns the answer.

Policies elsewhere compute in between (`smarts.agents.hosting`). A request has all vehicles of one policy that
decide now, in all simulations, so a policy gets one request in a step.

Axis letter: N agents of a request.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.agents.options import InterfaceError
from smarts.agents.policy import ActionBatch, Agent
from smarts.agents.social import SocialPolicy
from smarts.agents.spec import AgentSpec
from smarts.arrays import Bools
from smarts_agent_kit.service import FAILURES, WrongActionsError, checked_actions, problem_of

Actions = NDArray | Sequence[Any]


class Request(NamedTuple):
    """Asks a policy for the actions of N agents."""

    batch: ActionBatch
    seen: Sequence[Any] = ()
    """An `Observation` of each agent, for policies that are no `BatchAgent`."""
    vehicles: Sequence[str] = ()
    """Names of their vehicles, for the same policies."""
    held: Collection[tuple[int, int]] = ()
    """Simulation and hold of all agents of the policy that act now, due or not, for the same policies."""


class Failed(NamedTuple):
    """The answer of an agent that has failed."""

    problem: str


class Late(NamedTuple):
    """Stands for an answer that has not come by its deadline: the agent's last action continues."""


class Answer(NamedTuple):
    """What a policy answers to a request."""

    policy: int
    """Its number."""
    request: Request
    actions: Actions
    """An array of shape (N, ...), or N actions; a `Failed` or a `Late` in place of a missing action."""

    def at(self, chosen: Bools) -> Answer:
        """Return the answer to some of its agents, shape (N,)."""
        if isinstance(self.actions, np.ndarray):
            actions = self.actions[chosen]
        else:
            actions = [self.actions[place] for place in np.flatnonzero(chosen).tolist()]
        return Answer(self.policy, part_of(self.request, chosen), actions)


class LocalPolicy:
    """A policy of this process: it decides when its answers are taken, however long it takes.

    Args:
        policy: What makes its agents.
    """

    def __init__(self, policy: SocialPolicy) -> None:
        self._policy = policy
        self._asked: list[Request] = []

    def act(self, request: Request) -> Actions:
        """Return the actions of all agents of a request."""
        raise NotImplementedError

    def ask(self, request: Request) -> None:
        """Keep a request."""
        self._asked.append(request)

    def take(self) -> list[tuple[Request, Actions]]:
        """Return the answers to all requests."""
        asked, self._asked = self._asked, []
        return [(request, self.act(request)) for request in asked]

    def forget(self, rows: Collection[int]) -> None:
        """Drop the requests and the agents of some simulations."""
        left = [part_of(request, ~np.isin(request.batch.env_id, [*rows])) for request in self._asked]
        self._asked = [request for request in left if len(request.batch.env_id)]


def local_policy(policy: SocialPolicy) -> LocalPolicy:
    """Return a policy that acts in this process.

    Raises:
        Exception: Whatever its agent raises when it is made.
    """
    if policy.observation is not None:
        return BatchPlayer(policy)
    return (FlockPlayer if policy.is_boid else SinglePlayer)(policy)


def built_agent(spec: AgentSpec, place: str) -> Agent:
    """Return a new agent.

    Raises:
        InterfaceError: What the spec makes has no method `act`.
    """
    agent = spec.build_agent()
    if not callable(getattr(agent, "act", None)):
        raise InterfaceError(
            f"{agent!r} is no agent: it has no method act", place=place, remedy="derive it from Agent"
        )
    return agent


class BatchPlayer(LocalPolicy):
    """Asks a `BatchAgent`, once for each request: if it raises, all agents of the request fail.

    What the agent remembers starts over where a hold begins.
    """

    def __init__(self, policy: SocialPolicy) -> None:
        super().__init__(policy)
        self._agent: Any = built_agent(policy.spec, policy.name)

    def act(self, request: Request) -> Actions:
        """Return the actions of all agents of a request."""
        batch = request.batch
        count = len(batch.env_id)
        try:
            return checked_actions(self._agent.act(batch), count)
        except WrongActionsError as error:
            return [Failed(str(error))] * count
        except FAILURES as error:
            return [failed_by(error)] * count


def part_of(request: Request, chosen: Bools) -> Request:
    """Return a request for some of its agents, shape (N,)."""
    batch = request.batch
    places = np.flatnonzero(chosen)
    observations = {name: array[places] for name, array in batch.observations.items()}
    others: dict[str, Any] = {name: getattr(batch, name)[places] for name in ActionBatch._fields[1:]}
    seen, vehicles = ([each[place] for place in places.tolist()] if each else () for each in request[1:3])
    return Request(ActionBatch(observations, **others), seen, vehicles, request.held)


class SinglePlayer(LocalPolicy):
    """Asks an agent of its own for each hold."""

    def __init__(self, policy: SocialPolicy) -> None:
        super().__init__(policy)
        self._agents: dict[tuple[int, int], tuple[int, Agent]] = {}

    def act(self, request: Request) -> Actions:
        """Return the actions of all agents of a request."""
        batch = request.batch
        places = zip(batch.env_id.tolist(), batch.agent_id.tolist(), batch.hold.tolist(), strict=True)
        return [self._act(*place, seen) for place, seen in zip(places, request.seen, strict=True)]

    def forget(self, rows: Collection[int]) -> None:
        """Drop the requests and the agents of some simulations."""
        super().forget(rows)
        self._agents = {place: agent for place, agent in self._agents.items() if place[0] not in rows}

    def _act(self, env_id: int, agent_id: int, hold: int, seen: Any) -> Any:
        spec, place = self._policy.spec, (env_id, agent_id)
        try:
            if place not in self._agents or self._agents[place][0] != hold:
                self._agents[place] = hold, built_agent(spec, self._policy.name)
            return spec.action_adapter(self._agents[place][1].act(spec.observation_adapter(seen)))
        except FAILURES as error:
            return failed_by(error)


class FlockPlayer(LocalPolicy):
    """Asks one agent for all vehicles of a simulation: it gets and returns dicts by the vehicles' names."""

    def __init__(self, policy: SocialPolicy) -> None:
        super().__init__(policy)
        # By simulation: holds that the agent was asked for, the agent.
        self._flocks: dict[int, tuple[set[int], Agent]] = {}

    def act(self, request: Request) -> Actions:
        """Return the actions of all agents of a request."""
        batch = request.batch
        actions: list[Any] = [None] * len(batch.env_id)
        for env_id in dict.fromkeys(batch.env_id.tolist()):
            places = np.flatnonzero(batch.env_id == env_id).tolist()
            for place, action in zip(places, self._act(env_id, places, request), strict=True):
                actions[place] = action
        return actions

    def forget(self, rows: Collection[int]) -> None:
        """Drop the requests and the agents of some simulations."""
        super().forget(rows)
        self._flocks = {env_id: flock for env_id, flock in self._flocks.items() if env_id not in rows}

    def _act(self, env_id: int, places: Sequence[int], request: Request) -> list[Any]:
        """Return the actions of the agents of one simulation, which have these places in the request."""
        batch, spec = request.batch, self._policy.spec
        names = [request.vehicles[place] for place in places]
        try:
            agent = self._agent(env_id, set(batch.hold[places].tolist()), request.held)
            seen = {
                name: spec.observation_adapter(request.seen[place])
                for name, place in zip(names, places, strict=True)
            }
            answer: Any = agent.act(seen)
            return [_of_flock(answer, name, spec) for name in names]
        except FAILURES as error:
            return [failed_by(error)] * len(places)

    def _agent(self, env_id: int, holds: set[int], held: Collection[tuple[int, int]]) -> Agent:
        """Return the agent of a simulation's episode: a new one if the last has lost all vehicles."""
        last, agent = self._flocks.get(env_id, (set(), None))
        kept = {hold for hold in last if (env_id, hold) in held}
        if agent is None or not (self._policy.keep_alive or kept):
            agent = built_agent(self._policy.spec, self._policy.name)
        self._flocks[env_id] = kept | holds, agent
        return agent


def _of_flock(answer: Any, name: str, spec: AgentSpec) -> Any:
    if not isinstance(answer, Mapping):
        return Failed(f"answered by {type(answer).__name__}, not by a dict of the vehicles' names")
    if name not in answer:
        return Failed(f"answered without an action of {name!r}")
    return spec.action_adapter(answer[name])


def failed_by(error: BaseException) -> Failed:
    """Return the answer of an agent that has raised."""
    return Failed(problem_of(error))
