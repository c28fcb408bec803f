"""What every agent of the zoo has to keep, tried out in a simulation; `smarts-bench zoo test`."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.agents.hosting.facts import check_period
from smarts.agents.policy import ActionBatch, Agent, BatchAgent
from smarts.agents.spec import AgentSpec
from smarts.arrays import Bools
from smarts.controllers import action_format
from smarts.controllers.action_formats import Rejected
from smarts.env.hiway import HiWayEnv
from smarts.errors import OwnCodeError, ScenarioError, SmartsError, shown
from smarts.observations.arrays import ArrayObservation
from smarts.observations.context import AdapterContext
from smarts.observations.lists import feature_list
from smarts.sim.assembly import Assembly, Options, assemble
from smarts.sstudio.build import build_scenario
from smarts.sstudio.built import BuiltScenario
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import AgentStatus
from smarts.types.events import Outcome
from smarts.zoo import make_agent, make_spec

ROWS = 17
"""Size of the batch whose rows are compared with a vehicle alone."""
SEEN = "observations"
MOST_EGOS = 4
STEPS = 300
"""Number of steps of the episode that is driven."""


def check_entry(
    locator: str,
    options: Mapping[str, Any] | None = None,
    *,
    scenario: str = "loop",
    steps: int = STEPS,
    seed: int = 42,
) -> Iterator[str]:
    """Yield what an agent has been found to keep, one line a check.

    Args:
        locator: Locator of the agent.
        options: Its options.
        scenario: Name or folder of the scenario that it drives in.
        steps: Simulation steps, at most; it ends earlier if its vehicles have.
        seed: Seed of the run.

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
        driven = _drive_objects(locator, spec, scenario, steps)
        yield f"acts on observations in {scenario!r} for {driven} steps"
        return
    check_period(agent.period, locator)
    feature_list(agent.observation)
    with ZooDrive(locator, spec, agent, scenario, seed=seed) as drive:
        drive.reset()
        requests = [request for _ in range(steps) if (request := drive.step()) is not None]
    if not requests:
        raise SmartsError(
            f"no vehicle has driven in {steps} steps",
            place=f"scenario {scenario!r}",
            remedy="take another one, whose missions begin at once: --scenario",
        )
    yield f"acts in {scenario!r}: {len(requests)} decisions within the bounds of its actions"
    _check_repeats(locator, spec, requests)
    yield "repeats bit for bit"
    _check_rows(locator, spec, [batch for batch, _ in requests])
    yield f"a vehicle alone acts as among {ROWS}, bit for bit"
    _check_restart(locator, spec, [batch for batch, _ in requests])
    yield "forgets a vehicle when the next one comes"


class ZooDrive:
    """One simulation of a scenario whose egos are driven by an agent of the zoo.

    Args:
        name: Name of the agent, for errors.
        spec: Spec of the agent.
        agent: The agent that acts.
        scenario: Name or folder.
        egos: How many; None: as many as the scenario has missions for, at most 4.
        worlds: Simulations side by side.
        seed: Seed of the run.
        traffic: Variation of the scenario's traffic; None: all in turn.
    """

    def __init__(
        self,
        name: str,
        spec: AgentSpec,
        agent: BatchAgent,
        scenario: str,
        *,
        egos: int | None = None,
        worlds: int = 1,
        seed: int = 42,
        traffic: str | None = None,
    ) -> None:
        built = build_scenario(scenario)
        built = built if traffic is None else built.with_traffic([traffic])
        count = egos or _most_egos(built)
        self._name, self._agent, self._seed, self.egos = name, agent, seed, count
        if spec.interface is None:
            raise OwnCodeError(f"the agent {name!r} has no interface", place="zoo")
        self._parts: Assembly = assemble(
            [built], [spec.interface] * count, worlds=worlds, seed=seed, options=Options(path=64)
        )
        self.scene = self._parts.scene
        self.world = self.scene.world
        kind = ActionSpaceType(self._parts.rules.action[0])
        names = tuple(f"agent-{number}" for number in range(count))
        ids = np.arange(count, dtype=np.int32)
        context = AdapterContext(self._parts.scene, names, ids, kind, agent.period, 0, ())
        self._observation = ArrayObservation(context, agent.observation)
        self._format = action_format(kind)
        self._was_asked: Bools = np.zeros((worlds, count), np.bool_)
        self.outcomes: dict[tuple[int, int], Outcome] = {}
        """Outcomes of the vehicles whose episodes have ended, by (simulation, ego)."""
        self._numbers: Sequence[int] = ()

    def __enter__(self) -> ZooDrive:
        return self

    def __exit__(self, *error: object) -> None:
        self._parts.simulation.close()

    def reset(self, episode: int = 0, worlds: Sequence[int] | None = None) -> None:
        """Begin an episode in all simulations.

        Args:
            episode: Its number.
            worlds: Numbers of the simulations, which starts and seeds depend on; by default their rows.
        """
        self._numbers = worlds or range(self.world.worlds)
        start = self._parts.schedule.start
        self._parts.simulation.reset({row: start(each, episode) for row, each in enumerate(self._numbers)})
        self._was_asked[:] = False
        self.outcomes.clear()
        self._observation.reset(np.ones_like(self._was_asked))

    @property
    def active(self) -> Bools:
        """Egos that drive, shape (B, E)."""
        return self.world.agents.state[:, : self.egos] == AgentStatus.ACTIVE

    def step(self) -> tuple[ActionBatch, NDArray] | None:
        """Step all simulations; return the request and its answer if the agent was asked.

        Raises:
            SmartsError: The agent raises, or its answer is no action.
        """
        actions, chosen, asked = self._parts.actions, self.active, None
        actions.fresh[:] = False
        if chosen.any() and self.world.step.max() % self._agent.period == 0:
            batch = self._batch(chosen)
            given = _act(self._agent, batch)
            parsed = _parsed(self._name, self._format, given, len(batch.env_id))
            places = batch.env_id, batch.agent_id
            self._format.write(parsed, places, actions)
            actions.given[places], actions.fresh[places] = True, True
            actions.action_mask[places] = batch.action_mask
            self._was_asked |= chosen
            asked = batch, given
        everyone = np.ones(self.world.worlds, np.bool_)
        frame = self._parts.simulation.step(actions, everyone, np.zeros(actions.given.shape, np.bool_))
        for row, ego in np.argwhere(frame.events.just_done[:, : self.egos]).tolist():
            self.outcomes[row, ego] = Outcome(self.world.agents.outcome[row, ego])
        return asked

    def _batch(self, chosen: Bools) -> ActionBatch:
        arrays = self._observation.observe(chosen)
        env_id, agent_id = (each.astype(np.int32) for each in np.nonzero(chosen))
        episode = self.world.episode[env_id].astype(np.int32)
        seeds = [
            _seed_of(self._seed, self._numbers[env], number, agent)
            for env, number, agent in zip(env_id.tolist(), episode.tolist(), agent_id.tolist(), strict=True)
        ]
        return ActionBatch(
            observations={name: array[chosen] for name, array in arrays.items()},
            action_mask=self.world.agents.action_mask[:, : self.egos][chosen],
            env_id=env_id,
            agent_id=agent_id,
            hold=agent_id.astype(np.int64),
            episode=episode,
            step=self.world.step[env_id].astype(np.int32),
            is_first=~self._was_asked[chosen],
            seed=np.array(seeds, np.uint64),
            drives=np.ones(len(env_id), np.bool_),
        )


def _most_egos(built: BuiltScenario) -> int:
    """Return 4, or 1 if a scenario has too few missions for them."""
    try:
        built.episodes(MOST_EGOS)
    except ScenarioError:
        return 1
    return MOST_EGOS


def _seed_of(*keys: int) -> int:
    text = "|".join(map(str, keys))
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")


def _act(agent: Agent, batch: ActionBatch) -> NDArray:
    """Return an agent's answer to a copy of a request, which it may change.

    Raises:
        OwnCodeError: It raises.
    """
    copies = {name: array.copy() for name, array in batch.observations.items()}
    try:
        return np.asarray(agent.act(batch._replace(observations=copies)))
    except SmartsError:
        raise
    except Exception as error:
        raise OwnCodeError(
            f"the agent raises {type(error).__name__}: {error}", place=f"{type(agent).__name__}.act"
        ) from error


def _parsed(name: str, form: Any, given: NDArray, count: int) -> NDArray:
    """Return the numbers of actions that are in their space.

    Raises:
        SmartsError: One is not, or their shape or type is wrong.
    """
    shape = form.space().shape
    place, remedy = f"agent {name!r}", form.remedy()
    wanted = (count, *shape) if not form.has_path else (count, shape[0], given.shape[-1])
    if given.dtype.kind not in "iufb" or given.shape != wanted:
        raise SmartsError(
            f"{count} vehicles get actions of shape {given.shape} and type {given.dtype}",
            place=place,
            remedy=f"{remedy} for each vehicle: shape {wanted}",
        )
    parsed = form.parse_batch(given)
    if isinstance(parsed, Rejected):
        raise SmartsError(
            f"the action {shown(given[parsed.first], 100)} {parsed.problem}", place=place, remedy=remedy
        )
    out = ~np.isclose(parsed.reshape(count, -1), given.reshape(count, -1), rtol=0, atol=1e-6).all(axis=1)
    if out.any():
        raise SmartsError(
            f"the action {shown(given[np.argmax(out)], 100)} is out of bounds", place=place, remedy=remedy
        )
    return parsed


def _check_repeats(locator: str, spec: AgentSpec, requests: Sequence[tuple[ActionBatch, NDArray]]) -> None:
    """Raise unless another instance gives the same answers."""
    agent = spec.build_agent()
    for batch, answer in requests:
        if not np.array_equal(answer, _act(agent, batch)):
            raise SmartsError(
                f"the same requests get other actions at step {int(batch.step.max())}",
                place=f"agent {locator!r}",
                remedy="draw random numbers from batch.seed alone, and keep nothing outside of the agent",
            )


def _check_rows(locator: str, spec: AgentSpec, batches: Sequence[ActionBatch]) -> None:
    """Raise unless a vehicle alone gets the same actions as among others of other simulations."""
    alone, among = spec.build_agent(), spec.build_agent()
    place, own = ROWS // 2, _of_first_vehicle(batches)
    others = [_rows(batch, np.array([row])) for batch in batches for row in range(len(batch.env_id))]
    for number, one in enumerate(own):
        # Others' requests of any step, as of vehicles that have nothing to do with this one.
        row = [others[(number * ROWS + k * k) % len(others)] for k in range(ROWS)]
        row[place] = one
        many = _joined(row)._replace(env_id=np.arange(ROWS, dtype=np.int32))
        one = one._replace(env_id=many.env_id[place : place + 1])
        if not np.array_equal(_act(alone, one)[0], _act(among, many)[place]):
            raise SmartsError(
                f"a vehicle alone acts otherwise than among {ROWS} at step {int(one.step[0])}",
                place=f"agent {locator!r}",
                remedy="key memories by (env_id, agent_id), and let no row depend on others: "
                "matrix products of BLAS depend on their number in the last bits",
            )


def _check_restart(locator: str, spec: AgentSpec, batches: Sequence[ActionBatch]) -> None:
    """Raise unless an agent forgets a vehicle when another one gets its column."""
    agent, own = spec.build_agent(), _of_first_vehicle(batches)
    first = [_act(agent, one) for one in own]
    again = [_act(agent, one._replace(hold=one.hold + 1)) for one in own]
    for one, before, after in zip(own, first, again, strict=True):
        if not np.array_equal(before, after):
            raise SmartsError(
                f"the next vehicle in a column gets other actions at step {int(one.step[0])}",
                place=f"agent {locator!r}",
                remedy="let what is kept of (env_id, agent_id) start over where batch.is_first",
            )


def _of_first_vehicle(batches: Sequence[ActionBatch]) -> list[ActionBatch]:
    """Return the requests of the vehicle that is asked first, alone."""
    env_id, agent_id = batches[0].env_id[0], batches[0].agent_id[0]
    rows = [np.flatnonzero((batch.env_id == env_id) & (batch.agent_id == agent_id)) for batch in batches]
    return [_rows(batch, row) for batch, row in zip(batches, rows, strict=True) if len(row)]


def _joined(batches: Sequence[ActionBatch]) -> ActionBatch:
    """Return the rows of several requests as one request."""
    names = [*batches[0].observations]
    seen = {name: np.concatenate([each.observations[name] for each in batches]) for name in names}
    fields = [name for name in ActionBatch._fields if name != SEEN]
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(each, name) for each in batches]) for name in fields
    }
    return ActionBatch(seen, **columns)


def _rows(batch: ActionBatch, rows: NDArray) -> ActionBatch:
    columns: dict[str, Any] = {name: array[rows] for name, array in batch._asdict().items() if name != SEEN}
    return ActionBatch({name: array[rows] for name, array in batch.observations.items()}, **columns)


def _drive_objects(locator: str, spec: AgentSpec, scenario: str, steps: int) -> int:
    """Drive one vehicle by an agent that acts on observations as objects; return the steps."""
    with closing(HiWayEnv([scenario], {"agent": spec})) as env:
        agent = spec.build_agent()
        observations, _ = env.reset()
        for step in range(steps):
            if "agent" not in observations:
                return step
            try:
                action = agent.act(observations["agent"])
            except SmartsError:
                raise
            except Exception as error:
                raise OwnCodeError(
                    f"the agent raises {type(error).__name__}: {error}", place=f"agent {locator!r}"
                ) from error
            observations, _, terminated, truncated, _ = env.step({"agent": action})
            if terminated["agent"] or truncated["agent"]:
                return step + 1
    return steps
