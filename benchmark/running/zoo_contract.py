"""What every agent of the zoo has to keep, tried out in a simulation; `smarts-bench zoo test`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.agents.hosting.facts import check_period
from smarts.agents.policy import ActionBatch, Agent, BatchAgent
from smarts.agents.spec import AgentSpec
from smarts.controllers import action_format
from smarts.env.hiway import HiWayEnv
from smarts.errors import OwnCodeError, ScenarioError, SmartsError, shown
from smarts.observations.action_mask import MASK
from smarts.sstudio.build import build_scenario
from smarts.sstudio.built import BuiltScenario
from smarts.types.streams import hold_seed
from smarts.zoo import make_agent, make_spec
from smarts_agent_kit.service import FAILURES, checked_actions, problem_of

ROWS = 17
"""Size of the batch whose rows are compared with a vehicle alone."""
MOST_EGOS = 4
STEPS = 300
"""Number of steps of the episode that is driven."""
Asked = tuple[ActionBatch, NDArray]
"""A request and its answer."""
Answers = tuple[int, NDArray, NDArray]
"""Step, and two answers."""


def check_entry(
    locator: str,
    options: Mapping[str, Any] | None = None,
    *,
    scenario: str = "loop",
    steps: int = STEPS,
) -> Iterator[str]:
    """Yield what an agent has been found to keep, one line a check.

    Args:
        locator: Locator of the agent.
        options: Its options.
        scenario: Name or folder of the scenario that it drives in.
        steps: Simulation steps, at most; it ends earlier if its vehicles have.

    Raises:
        SmartsError: A check has failed; names what the agent did, and what it has to do.
    """
    options = options or {}
    spec = make_spec(locator, **options)
    agent, interface = make_agent(locator, **options)
    kind = interface.action.name if interface.action is not None else "no action"
    yield f"imports: {type(agent).__module__}:{type(agent).__name__}"
    yield f"interface: {kind}, {interface.vehicle_model} {interface.vehicle_class}"
    if not isinstance(agent, BatchAgent):
        driven = _drive_objects(spec, scenario, steps)
        yield f"acts on observations in {scenario!r} for {driven} steps"
        return
    check_period(agent.period, locator)
    with ZooDrive(spec, agent, scenario) as drive:
        drive.reset()
        asked = (drive.step() for _ in range(0, steps, agent.period))
        requests = [request for request in asked if request is not None]
    if not requests:
        raise SmartsError(
            f"no vehicle has driven in {steps} steps",
            place=f"scenario {scenario!r}",
            remedy="take another one, whose missions begin at once: --scenario",
        )
    _check_bounds(locator, interface.action, requests)
    yield f"acts in {scenario!r}: {len(requests)} decisions within the bounds of its actions"
    for answers, kept, problem, remedy in CHECKS:
        for step, one, other in answers(spec, requests):
            if not np.array_equal(one, other):
                raise SmartsError(f"{problem} at step {step}", place=f"agent {locator!r}", remedy=remedy)
        yield kept


class ZooDrive:
    """One simulation of a scenario whose egos are driven by an agent of the zoo.

    Args:
        spec: Spec of the agent.
        agent: The agent that acts.
        scenario: Name or folder.
        egos: How many; None: as many as the scenario has missions for, at most 4.
        seed: Seed of the run.
        traffic: Variation of the scenario's traffic; None: all in turn.
    """

    def __init__(
        self,
        spec: AgentSpec,
        agent: BatchAgent,
        scenario: str,
        *,
        egos: int | None = None,
        seed: int = 42,
        traffic: str | None = None,
    ) -> None:
        names = [f"agent-{number}" for number in range(egos or _most_egos(build_scenario(scenario)))]
        self._agent, self._seed = agent, seed
        self.env = HiWayEnv(
            [scenario],
            dict.fromkeys(names, spec),
            decision_interval=agent.period,
            seed=seed,
            traffic=None if traffic is None else [traffic],
        )
        self._seen = self.env.watch(agent.observation)
        self._decisions = 0
        self._asked: set[int] = set()
        self.active: set[str] = set()
        """Egos that drive."""
        self.outcomes: dict[str, str] = {}
        """Outcomes of the egos whose episodes have ended."""

    def __enter__(self) -> ZooDrive:
        return self

    def __exit__(self, *error: object) -> None:
        self.env.close()

    def reset(self) -> None:
        """Begin the next episode."""
        observations, _ = self.env.reset()
        self.active, self._decisions = {*observations}, 0
        self._asked.clear()
        self.outcomes.clear()

    def step(self) -> Asked | None:
        """Step to the next decision; return the request and its answer if a vehicle drives.

        Raises:
            SmartsError: The agent raises, or its answer is no action.
        """
        places = [place for place, name in enumerate(self.env.agent_ids) if name in self.active]
        asked, actions = None, {}
        if places:
            batch = self._batch(np.array(places))
            answer = _act(self._agent, batch)
            actions = {self.env.agent_ids[place]: answer[row] for row, place in enumerate(places)}
            self._asked |= {*places}
            asked = batch, answer
        self._decisions += 1
        observations, _, terminated, truncated, infos = self.env.step(actions)
        self.active = {name for name in observations if not (terminated[name] or truncated[name])}
        self.outcomes |= {name: each["outcome"] for name, each in infos.items() if "outcome" in each}
        return asked

    def _batch(self, places: NDArray) -> ActionBatch:
        nothing = np.zeros(len(places), np.int32)
        seen = {name: array[0, places] for name, array in self._seen.observations.items()}
        seeds = [hold_seed(self._seed, self.env.agent_ids[k], world=0, episode=0) for k in places.tolist()]
        return ActionBatch(
            observations={name: array for name, array in seen.items() if name != MASK},
            action_mask=self.env._env.runner.world.agents.action_mask[0, places],
            env_id=nothing,
            agent_id=places.astype(np.int32),
            hold=places.astype(np.int64),
            episode=nothing,
            step=nothing + np.int32(self._decisions * self._agent.period),
            is_first=np.array([place not in self._asked for place in places.tolist()]),
            seed=np.array(seeds, np.uint64),
            drives=np.ones(len(places), np.bool_),
        )


def _most_egos(built: BuiltScenario) -> int:
    """Return 4, or 1 if a scenario has too few missions for them."""
    try:
        built.episodes(MOST_EGOS)
    except ScenarioError:
        return 1
    return MOST_EGOS


def _act(agent: Agent, batch: ActionBatch) -> NDArray:
    """Return an agent's answer to a copy of a request, which it may change.

    Raises:
        OwnCodeError: It raises, or answers by no array of numbers.
    """
    copies = {name: array.copy() for name, array in batch.observations.items()}
    with _named(agent):
        return checked_actions(agent.act(batch._replace(observations=copies)), len(batch.env_id))


@contextmanager
def _named(agent: Agent) -> Iterator[None]:
    """Name an agent and its line in what it raises."""
    try:
        yield
    except SmartsError:
        raise
    except FAILURES as error:
        raise OwnCodeError(f"the agent {problem_of(error)}", place=f"{type(agent).__name__}.act") from error


def _check_bounds(locator: str, kind: Any, requests: Sequence[Asked]) -> None:
    """Raise unless all actions are in their space, which the simulation would clip them to."""
    form = action_format(kind)
    for _, answer in requests:
        parsed: Any = form.parse_batch(answer)  # of `Direct` with a number more
        parsed = parsed.reshape(len(answer), -1)[:, : answer[0].size].reshape(answer.shape)
        out = ~np.isclose(parsed, answer, rtol=0, atol=1e-6)
        if out.any():
            raise SmartsError(
                f"the action {shown(answer[np.argwhere(out)[0, 0]], 100)} is out of bounds",
                place=f"agent {locator!r}",
                remedy=form.remedy(),
            )


def _repeated(spec: AgentSpec, requests: Sequence[Asked]) -> Iterator[Answers]:
    """Yield the answers of two instances."""
    agent = spec.build_agent()
    for batch, answer in requests:
        yield int(batch.step.max()), answer, _act(agent, batch)


def _alone_and_among(spec: AgentSpec, requests: Sequence[Asked]) -> Iterator[Answers]:
    """Yield the answers to a vehicle alone, and among others of other simulations."""
    alone, among = spec.build_agent(), spec.build_agent()
    place = ROWS // 2
    others = [_rows(batch, np.array([row])) for batch, _ in requests for row in range(len(batch.env_id))]
    for number, one in enumerate(_of_first_vehicle(requests)):
        # Others' requests of any step, as of vehicles that have nothing to do with this one.
        row = [others[(number * ROWS + k * k) % len(others)] for k in range(ROWS)]
        row[place] = one
        many = _joined(row)._replace(env_id=np.arange(ROWS, dtype=np.int32))
        one = one._replace(env_id=many.env_id[place : place + 1])
        yield int(one.step[0]), _act(alone, one)[0], _act(among, many)[place]


def _first_and_next(spec: AgentSpec, requests: Sequence[Asked]) -> Iterator[Answers]:
    """Yield the answers to a vehicle, and to another one that gets its column."""
    agent, own = spec.build_agent(), _of_first_vehicle(requests)
    first = [_act(agent, one) for one in own]
    for one, before in zip(own, first, strict=True):
        yield int(one.step[0]), before, _act(agent, one._replace(hold=one.hold + 1))


CHECKS = (
    (
        _repeated,
        "repeats bit for bit",
        "the same requests get other actions",
        "draw random numbers from batch.seed alone, and keep nothing outside of the agent",
    ),
    (
        _alone_and_among,
        f"a vehicle alone acts as among {ROWS}, bit for bit",
        f"a vehicle alone acts otherwise than among {ROWS}",
        "key memories by (env_id, agent_id), and let no row depend on others: matrix products of BLAS depend "
        "on their number in the last bits",
    ),
    (
        _first_and_next,
        "forgets a vehicle when the next one comes",
        "the next vehicle in a column gets other actions",
        "let what is kept of (env_id, agent_id) start over where batch.is_first",
    ),
)
"""What yields answers that have to be equal; what an agent keeps then; what it does else; the remedy."""


def _of_first_vehicle(requests: Sequence[Asked]) -> list[ActionBatch]:
    """Return the requests of the vehicle that is asked first, alone."""
    batches = [batch for batch, _ in requests]
    rows = [np.flatnonzero(batch.agent_id == batches[0].agent_id[0]) for batch in batches]
    return [_rows(batch, row) for batch, row in zip(batches, rows, strict=True) if len(row)]


def _joined(batches: Sequence[ActionBatch]) -> ActionBatch:
    """Return the rows of several requests as one request."""
    seen, *columns = zip(*batches, strict=True)
    observations = {name: np.concatenate([each[name] for each in seen]) for name in seen[0]}
    return ActionBatch(observations, *map(np.concatenate, columns))


def _rows(batch: ActionBatch, rows: NDArray) -> ActionBatch:
    columns: list[Any]
    seen, *columns = batch
    return ActionBatch({name: array[rows] for name, array in seen.items()}, *(each[rows] for each in columns))


def _drive_objects(spec: AgentSpec, scenario: str, steps: int) -> int:
    """Drive one vehicle by an agent that acts on observations as objects; return the steps."""
    with closing(HiWayEnv([scenario], {"agent": spec})) as env:
        agent = spec.build_agent()
        observations, _ = env.reset()
        for step in range(steps):
            if "agent" not in observations:
                return step
            with _named(agent):
                action = agent.act(observations["agent"])
            observations, _, terminated, truncated, _ = env.step({"agent": action})
            if terminated["agent"] or truncated["agent"]:
                return step + 1
    return steps
