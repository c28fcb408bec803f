"""The loop around the step: decisions that last several steps, episodes, and their listeners.

Axis letters: B simulations, A agents, E egos.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.arrays import Bools, Bytes, Ints
from smarts.env.actions import ActionEncoder
from smarts.env.decisions import choose_observed, join_events
from smarts.env.listeners import DecisionNotes, StepListener
from smarts.env.social_agents import SocialAgentRequests
from smarts.errors import ScenarioError, SmartsError
from smarts.geometry.binding import bind
from smarts.sim.assembly import Assembly
from smarts.types.agent_states import AgentStatus
from smarts.types.bubbles import BubbleStates
from smarts.types.episode import EpisodeStart
from smarts.types.frame import Frame

# A number: to compare an array with a member of an enumeration takes three times as long.
_ACTIVE = int(AgentStatus.ACTIVE)

MAX_ENTRY_WAIT = 6000
"""Steps without any ego after which a simulation gives up."""


class NotCopied:
    """Refuses to be pickled and copied: an environment stays in the process that made it."""

    def __reduce__(self) -> NoReturn:
        raise SmartsError(
            "an environment can be neither pickled nor copied: the state of SUMO and Bullet is not Python's",
            place=type(self).__name__,
            remedy="hand over what makes it, such as functools.partial(HiWayEnv, ...), and make it there: "
            "with the same seed it plays the same episodes",
        )


class EpisodeKey(NamedTuple):
    """Identifies an episode; the schedule makes it out of this."""

    world: int
    episode: int
    seed: int | None = None


@dataclass(frozen=True)
class Transition:
    """The result of one decision of the egos, shape (B, E); arrays are valid until the next one."""

    acted: Bools
    """Egos that were active when the decision began. Only these have rewards and endings: an ego that entered
    later and ended before its first decision is recorded, but was never observed."""
    events: Ints
    """`Event` bits of all its steps."""
    outcome: Bytes
    """An `Outcome`."""
    terminated: Bools
    """The episode terminated, among `acted`."""
    truncated: Bools
    """The episode was truncated, among `acted`."""
    finished: Bools
    """Simulations whose episode is over, shape (B,)."""
    failures: Mapping[int, SmartsError]
    """Simulations whose traffic failed: their decision is invalid, and they are to be reset."""


class SimulationRunner:
    """Advances B simulations together, one decision of their egos at a time.

    All egos decide every `period` steps, counted from the beginning of the episode. An ego that enters
    between decisions keeps its lane until the next one. A simulation without agents left is not stepped until
    `reset`. A simulation whose egos have all yet to enter is stepped until one enters. So is one whose egos
    learn in bubbles, while no vehicle is in a bubble, until its episode is over.

    Args:
        assembly: The simulations, and what belongs to them.
        listeners: Get every step.
        period: Steps from one decision of the egos to the next.
    """

    def __init__(
        self,
        assembly: Assembly,
        listeners: Sequence[StepListener],
        *,
        period: int = 1,
    ) -> None:
        self.simulation, self.actions, self.scene = assembly.simulation, assembly.actions, assembly.scene
        self.world = self.simulation.world
        self.period = period
        self.starts: list[EpisodeStart | None] = [None] * self.world.worlds
        """The present episode of each simulation."""
        self.encoder = ActionEncoder(self.actions, self.world, assembly.latency_steps)
        """Takes the egos' actions."""
        self._schedule, self.recorder = assembly.schedule, assembly.recorder
        self.change_start: Callable[[EpisodeStart], EpisodeStart] = lambda start: start
        """Maps what the schedule gives to the episode that is played."""
        self._listeners = tuple(listeners)
        self._notes: list[DecisionNotes] = []
        self._requests = SocialAgentRequests(assembly) if assembly.policies else None
        self._entries = assembly.entries
        self._pool, self.learns_in_bubbles = assembly.pool, assembly.learns_in_bubbles
        """Whether the egos come and go with the vehicles in bubbles."""
        worlds, egos = self.world.worlds, self.world.egos
        shape = (worlds, egos)
        self.running = np.zeros(worlds, np.bool_)
        """Simulations whose episode is not over, shape (B,)."""
        self.alive = np.zeros(shape, np.bool_)
        """Egos that decide now, shape (B, E)."""
        self._every = np.ones(worlds, np.bool_)
        self._state = self.world.agents.state[:, :egos]
        self._observe_mask = np.zeros(self.world.agents.state.shape, np.bool_)
        self._ended = np.zeros(shape, np.bool_)
        self._acted = np.zeros(shape, np.bool_)
        self._events = np.zeros(shape, np.int32)
        self._terminated = np.zeros(shape, np.bool_)
        self._truncated = np.zeros(shape, np.bool_)
        self._failures: dict[int, SmartsError] = {}
        self.social_failures: dict[int, dict[str, str]] = {}
        """Social agents that have failed since `take_social_failures`, by simulation and name, and why: the
        fallback controller drives their vehicles."""
        self._decided = np.zeros(worlds, np.int32)  # steps of the states that the last decisions were made on
        self._seen = np.zeros_like(self._observe_mask)  # agents whose readings are of now
        self._frame: Frame | None = None
        self._closed = False
        agents = self.world.agents
        due = agents.state, agents.next_due, self.world.step, egos, self._observe_mask
        self._choose_observed = bind(choose_observed, *due)
        self._join = bind(join_events, self._events, self._terminated, self._truncated, self.running)

    def listen(self, listener: StepListener) -> None:
        """Show every step to one more listener."""
        self._listeners = (*self._listeners, listener)

    def note(self, notes: DecisionNotes) -> None:
        """Add to the record of each decision from now on."""
        self._notes.append(notes)
        self.listen(notes)

    def reset(self, episodes: Mapping[int, EpisodeKey]) -> None:
        """Begin episodes in some simulations, by row.

        Raises:
            SmartsError: The environment was closed.
            TrafficError: The traffic engine refused, or failed before an ego was there.
            ScenarioError: No ego enters.
        """
        self._check_open()
        starts = {
            row: self.change_start(self._schedule.start(key.world, key.episode, key.seed))
            for row, key in episodes.items()
        }
        for row, start in starts.items():
            self.starts[row] = start
        rows = np.zeros(self.world.worlds, np.bool_)
        rows[list(episodes)] = True
        for mask in (self.running, self.alive, self._ended, self.actions.given, self.actions.fresh):
            mask[rows] = False
        self.encoder.forget(episodes)
        if self._requests is not None:
            self._requests.begin(episodes)
        for listener in self._listeners:
            listener.reset(np.repeat(rows[:, None], self.world.egos, axis=1))
        frame = self._keep(self.simulation.reset(starts))
        self.running[rows] = True
        self.world.agents.period[rows, : self.world.egos] = self.period
        for listener in self._listeners:
            listener.collect(frame, True)
        self._find_alive()
        waiting = rows & ~self.alive.any(axis=1)
        if waiting.any():
            self.dispatch()
            self._decide(waiting)
            for error in self._failures.values():
                raise error

    def step(self) -> Transition:
        """Step the running simulations until the egos' next decision, with the actions in `actions`.

        Raises:
            ScenarioError: No ego enters.
        """
        for notes in self._notes:
            notes.before_decision()
        self._decide(self._every)
        return Transition(
            self._acted,
            self._events,
            self.world.agents.outcome[:, : self.world.egos],
            self._terminated & self._acted,
            self._truncated & self._acted,
            ~self.running,
            dict(self._failures),
        )

    @property
    def bubbles(self) -> BubbleStates | None:
        """States of the bubbles; None: before the first reset."""
        return None if self._frame is None else self._frame.bubbles

    def take_social_failures(self) -> dict[int, dict[str, str]]:
        """Return `social_failures`, and forget them."""
        taken, self.social_failures = self.social_failures, {}
        return taken

    def _decide(self, env_mask: Bools) -> None:
        """Step some simulations, shape (B,), until the egos' next decision."""
        pending, waited = env_mask & self.running, 0
        self._begin_decision(env_mask)
        while pending.any():
            for number in range(self.period):
                is_last = number == self.period - 1
                self.encoder.release(pending)
                failed = self._gather()
                self._choose_observed(is_last)
                frame = self.simulation.step(self.actions, pending, self._observe_mask, failed)
                if not self._take(frame, is_last, pending):
                    break
            pending = self._without_agents(env_mask, waited)
            waited += self.period
            if pending.any():
                self.dispatch()
        self._find_alive()
        self._ended[env_mask] = (self._terminated | self._truncated)[env_mask]

    def check_begun(self) -> None:
        """Raise if there is nothing to step.

        Raises:
            SmartsError: The environment was closed, or a simulation was never reset.
        """
        self._check_open()
        for row, start in enumerate(self.starts):
            if start is None:
                problem = f"simulation {row} has no episode to step"
                raise SmartsError(problem, place="step", remedy="call reset() first")

    def social_info(self, row: int) -> dict[str, Any]:
        """Return what users are to know of a simulation's other agents; empty where all is well.

        `kept_out` are the names of agents whose time has come and that cannot enter yet, `bubbles` the counts
        of the present episode by bubble, see `BubbleStates`; `late_decisions` counts the decisions of
        social agents in it that came after their deadline, or whose agent owed another then, by the policy's
        name; `traffic_overlaps` the pairs of vehicles of traffic that have come to overlap.
        """
        start, kept_out = self.starts[row], self._entries.kept_out(row)
        info: dict[str, Any] = {"kept_out": kept_out} if kept_out else {}
        if start is not None and start.bubbles and self.bubbles is not None:
            info["bubbles"] = self.bubbles.counted(row, start.bubbles)
        if self._requests is not None and (late := self._requests.late_decisions(row)):
            info["late_decisions"] = late
        if overlaps := int(self.world.traffic_overlaps[row]):
            info["traffic_overlaps"] = overlaps
        return info

    def annotate(self, name: str, values: ArrayLike, egos: Bools) -> None:
        """Add values to the record of the egos' next decision; without a record, a no-op.

        Args:
            name: What the values are.
            values: Values of each ego, shape (B, E, ...).
            egos: Which egos have one, shape (B, E); only active egos are recorded.
        """
        if self.recorder is not None:
            self.recorder.annotate(name, values, egos & self.alive)

    def conclude(self, rewards: NDArray, has_reward: Bools) -> None:
        """Record the rewards of the last decision, and let the episodes that ended with it be written.

        Args:
            rewards: Rewards as the user gets them, shape (B, E).
            has_reward: Which egos have one that is a number, shape (B, E); only egos that acted are
                recorded.
        """
        if self.recorder is None:
            return
        has_reward = has_reward & self._acted
        if self._failures:
            has_reward[list(self._failures)] = False
        self.recorder.annotate("reward", rewards, has_reward, self._decided)
        for notes in self._notes:
            for name, values in notes.rewards().items():
                self.recorder.annotate(name, values, has_reward & notes.mask, self._decided)
        self.recorder.finish(~self.running)

    def dispatch(self) -> None:
        """Ask the social agents whose decision is due; the last call before the user's turn.

        `reset` and `step` ask them before each further step that they make themselves.
        """
        if self._requests is not None and self._frame is not None:
            self._requests.dispatch(self._frame, self._seen & self.running[:, None])

    def close(self) -> None:
        """Free the simulations and the social agents; may be called again."""
        self._closed = True
        self.running[:] = False
        if self._requests is not None:
            self._requests.close()
        self.simulation.close()

    def _check_open(self) -> None:
        if self._closed:
            raise SmartsError(
                "the environment was closed", place=type(self).__name__, remedy="make another one"
            )

    def _begin_decision(self, env_mask: Bools) -> None:
        """Forget the last decision of some simulations, and the egos that ended with it."""
        ended = self._ended & env_mask[:, None]
        if ended.any():
            for listener in self._listeners:
                listener.reset(ended)
        acts = self.alive & env_mask[:, None]
        self._acted[env_mask] = acts[env_mask]
        self._decided[env_mask] = self.world.step[env_mask]
        for sums in (self._events, self._terminated, self._truncated):
            sums[env_mask] = 0
        self._pool.busy[env_mask] = False
        self._failures.clear()
        next_due = self.world.agents.next_due[:, : self.world.egos]
        due_then = np.broadcast_to((self.world.step + self.period)[:, None], next_due.shape)
        np.copyto(next_due, due_then, where=acts)

    def _take(self, frame: Frame, is_last: bool, pending: Bools) -> int:
        """Take in a step of a decision; return how many simulations are to make the next one."""
        self._keep(frame)
        self.actions.fresh[:] = False
        for listener in self._listeners:
            listener.collect(frame, is_last)
        self._failures.update(frame.failures)
        events = frame.events
        left = self._join(events.bits, events.terminated, events.truncated, events.finished, pending)
        if self.learns_in_bubbles:
            np.logical_or(self._terminated, self._truncated, out=self._pool.busy)
        if not is_last:
            self.dispatch()
        return left

    def _gather(self) -> dict[tuple[int, int], str]:
        """Take the social agents' answers; return which agents have failed."""
        failed = {} if self._requests is None else self._requests.gather()
        for (row, number), problem in failed.items():
            self.social_failures.setdefault(row, {})[self._pool.starts[row][number].name] = problem
        return failed

    def _keep(self, frame: Frame) -> Frame:
        """Keep a frame; simulations that are not in it keep the readings of their last frame."""
        self._frame = frame
        if self._requests is not None:
            self._requests.collect(frame)
        np.copyto(self._seen, frame.observe_mask, where=frame.env_mask[:, None])
        return frame

    def _without_agents(self, env_mask: Bools, waited: int) -> Bools:
        """Return which of some simulations run without any ego, all being still to enter, shape (B,).

        Raises:
            ScenarioError: They have waited too long.
        """
        waiting = env_mask & self.running & ~(self._state == _ACTIVE).any(axis=1)
        if self.learns_in_bubbles:
            # The decision in which agents have ended is returned first: their columns are free after it.
            return waiting & ~(self._acted & (self._terminated | self._truncated)).any(axis=1)
        if waited >= MAX_ENTRY_WAIT and waiting.any():
            row = int(np.argmax(waiting))
            agents = np.flatnonzero(self._state[row] == AgentStatus.WAITING).tolist()
            raise ScenarioError(
                f"no agent has entered simulation {row} within {MAX_ENTRY_WAIT * self.world.dt:g} s",
                place=f"episode {self.world.episode[row]}, agents {agents}",
                remedy="give their missions earlier start times, or traps with a time limit",
            )
        return waiting

    def _find_alive(self) -> None:
        np.logical_and(self._state == _ACTIVE, self.running[:, None], out=self.alive)
