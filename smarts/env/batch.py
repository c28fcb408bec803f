"""The loop around the step: decisions, agents that act by themselves, and episodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.agents.acting import ActionRequest, AgentHost
from smarts.env.adapters.actions import encode_one
from smarts.env.batch_kernels import choose_wanted, join_events
from smarts.env.parts import Parts, StepListener
from smarts.env.setting_checks import check_instance
from smarts.errors import ScenarioError, SmartsError
from smarts.geometry.binding import bind
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import AgentStatus
from smarts.types.episode import EpisodeStart
from smarts.types.frame import Frame

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]

# A number: to compare an array with a member of an enumeration takes three times as long.
_ACTIVE = int(AgentStatus.ACTIVE)

PATIENCE = 6000
"""Steps after which agents that have not entered are given up."""


@dataclass(frozen=True)
class SocialAgents:
    """The agents that are not the user's, in the agents behind the egos'."""

    acting: AgentHost
    observe: Callable[[Frame, int, int], Any]
    """Makes what the agent of (row, agent) sees out of a frame; valid after the frame."""
    names: Sequence[str]
    """Of the agents by agent, the egos' included."""
    deadline: float = 0.5
    """How long to wait for answers [s]."""


class EpisodeKey(NamedTuple):
    """Names an episode for good; the schedule makes it out of this."""

    world: int
    episode: int
    seed: int | None = None


@dataclass(frozen=True)
class Transition:
    """What one decision of the egos led to; arrays are valid until the next one, shape (B, N)."""

    acted: Bools
    """Who was there to decide when it began. Only of these there are rewards and endings: who entered later
    and was gone before its first decision is in the record, but was never there for the user."""
    events: Ints
    """`Event` bits of all its steps."""
    outcome: NDArray[np.int8]
    """An `Outcome`."""
    terminated: Bools
    """Ended for good, among those who acted."""
    truncated: Bools
    """Ended although it could have gone on, among those who acted."""
    finished: Bools
    """Whose episode is over, shape (B,)."""
    failures: Mapping[int, SmartsError]
    """Simulations whose traffic failed: their decision is invalid, and they are to be reset."""


class Batch:
    """B simulations that advance together, a decision of their egos at a time.

    All egos decide every `period` steps, counted from the beginning of the episode; who enters in between
    decides from the next time on, and drives on in its lane until then. A simulation whose last agent has
    ended stands still until it is reset. One in which all are still to enter is stepped on until somebody is
    there, so that there is always somebody to observe.

    Args:
        parts: The simulation, and what belongs to it.
        watchers: Are shown every step.
        period: Steps from one decision of the egos to the next.
        others: The agents that act by themselves.
    """

    def __init__(
        self,
        parts: Parts,
        watchers: Sequence[StepListener],
        *,
        period: int = 1,
        others: SocialAgents | None = None,
    ) -> None:
        self.simulation, self.actions, self.scene = parts.simulation, parts.actions, parts.scene
        self.world = self.simulation.world
        self.period = period
        self.starts: list[EpisodeStart | None] = [None] * self.world.worlds
        """The present episode of each simulation."""
        self.late = 0
        """Answers of other agents that did not come in time."""
        self._schedule, self._recorder = parts.schedule, parts.recorder
        self._watchers = tuple(watchers)
        self._others = others
        worlds, egos = self.world.worlds, self.world.egos
        shape = (worlds, egos)
        self.running = np.zeros(worlds, np.bool_)
        """Whose episode is going on, shape (B,)."""
        self.alive = np.zeros(shape, np.bool_)
        """Which egos decide now, shape (B, N)."""
        self._wanted = np.zeros(self.world.agents.state.shape, np.bool_)
        self._open: dict[tuple[int, int], ActionRequest] = {}
        self._ended = np.zeros(shape, np.bool_)
        self._acted = np.zeros(shape, np.bool_)
        self._events = np.zeros(shape, np.int32)
        self._terminated = np.zeros(shape, np.bool_)
        self._truncated = np.zeros(shape, np.bool_)
        self._failures: dict[int, SmartsError] = {}
        self._decided = np.zeros(worlds, np.int32)  # steps of the states that the last decisions were made on
        self._seen = np.zeros_like(self._wanted)  # whose readings are of now
        self._frame: Frame | None = None
        self._closed = False
        self._choose_wanted = bind(
            choose_wanted, self.world.agents.next_due, self.world.step, self.world.egos, self._wanted
        )
        self._join = bind(join_events, self._events, self._terminated, self._truncated, self.running)
        self._kept = {name: column.copy() for name, column in self.actions._asdict().items()}

    def watch(self, watcher: StepListener) -> None:
        """Show one more watcher every step."""
        self._watchers = (*self._watchers, watcher)

    def reset(self, episodes: Mapping[int, EpisodeKey]) -> None:
        """Begin episodes in some simulations, by row.

        Raises:
            SmartsError: The environment was closed.
            TrafficError: The traffic engine refused.
            ScenarioError: Nobody ever enters.
        """
        self._refuse_closed()
        starts = {
            row: self._schedule.start(key.world, key.episode, key.seed) for row, key in episodes.items()
        }
        for row, start in starts.items():
            self.starts[row] = start
        rows = np.zeros(self.world.worlds, np.bool_)
        rows[list(episodes)] = True
        self.running[rows] = False
        self.alive[rows] = False
        self._ended[rows] = False
        self._close_questions(rows)
        for watcher in self._watchers:
            watcher.reset(rows[:, None] & np.ones(self.world.egos, np.bool_))
        for field in (self.actions.given, self.actions.fresh):
            field[rows] = False
        frame = self._look(self.simulation.reset(starts))
        self.running[rows] = True
        self.world.agents.period[rows, : self.world.egos] = self.period
        for watcher in self._watchers:
            watcher.collect(frame, True)
        self._wait_for_entries(rows)
        self._find_alive()

    def step(self) -> Transition:
        """Carry out a decision of the egos, which is in `actions`.

        Raises:
            ScenarioError: Nobody ever enters.
        """
        self._begin()
        self._advance(self.running)
        self._wait_for_entries(self.running)
        self._find_alive()
        self._ended = self._terminated | self._truncated
        agents = self.world.agents
        return Transition(
            self._acted,
            self._events,
            agents.outcome[:, : self.world.egos],
            self._terminated & self._acted,
            self._truncated & self._acted,
            ~self.running,
            dict(self._failures),
        )

    @contextmanager
    def all_or_none(self) -> Iterator[None]:
        """Take nobody's action in if one is refused, or an adapter fails, so that the user may try again."""
        for name, kept in self._kept.items():
            np.copyto(kept, getattr(self.actions, name))
        try:
            yield
        except BaseException:
            for name, kept in self._kept.items():
                np.copyto(getattr(self.actions, name), kept)
            raise

    def check_begun(self) -> None:
        """Refuse a step that nothing can come of.

        Raises:
            SmartsError: The environment was closed, or a simulation was never reset.
        """
        self._refuse_closed()
        if None in self.starts:
            raise SmartsError(
                f"simulation {self.starts.index(None)} has no episode to step",
                place="step",
                remedy="call reset() first",
            )

    def annotate(self, name: str, values: ArrayLike, who: Bools) -> None:
        """Add to the record what is said about the egos' next decision; nothing if nothing is recorded.

        Args:
            name: What it is.
            values: Of each ego, shape (B, N, ...).
            who: Of whom it is said, shape (B, N); only of those who are alive it is noted.

        Raises:
            InterfaceError: The name is not a text.
        """
        check_instance("name", name, str, "a text, such as 'probabilities'")
        if self._recorder is not None:
            self._recorder.annotate(name, values, who & self.alive)

    def conclude(self, rewards: NDArray, paid: Bools) -> None:
        """Note what the last decision has earned, and have the episodes that ended with it written.

        Args:
            rewards: As the user is told them, shape (B, N).
            paid: Who has one that is a number, shape (B, N); only of those who acted it is noted.
        """
        if self._recorder is None:
            return
        paid = paid & self._acted
        paid[list(self._failures)] = False
        self._recorder.annotate("reward", rewards, paid, self._decided)
        self._recorder.finish(~self.running)

    def dispatch(self) -> None:
        """Ask those of the other agents who are to decide now; the last thing before the user's turn."""
        if self._others is None or self._frame is None:
            return
        world, agents = self.world, self.world.agents
        due = (agents.state == AgentStatus.ACTIVE) | (agents.state == AgentStatus.SHADOWING)
        due &= self._seen & (agents.next_due <= world.step[:, None]) & self.running[:, None]
        due[:, : world.egos] = False
        asked = {}
        for row, agent_id in np.argwhere(due).tolist():
            step = int(world.step[row])
            generation = int(agents.generation[row, agent_id])
            question = ActionRequest(row, int(world.episode[row]), agent_id, generation, step)
            asked[question] = self._others.observe(self._frame, row, agent_id)
            agents.next_due[row, agent_id] = step + agents.period[row, agent_id]
            self._open[row, agent_id] = question
        if asked:
            self._others.acting.dispatch(asked)

    def close(self) -> None:
        """Give back what the simulation and the other agents hold; may be called again."""
        self._closed = True
        self.running[:] = False
        if self._others is not None:
            self._others.acting.close()
        self.simulation.close()

    def _refuse_closed(self) -> None:
        if self._closed:
            raise SmartsError("the environment was closed", place="Batch", remedy="make another one")

    def _begin(self) -> None:
        """Begin a decision: forget the last one, and who has ended with it."""
        if self._ended.any():
            for watcher in self._watchers:
                watcher.reset(self._ended)
        self._acted[:] = self.alive
        self._decided[:] = self.world.step
        self._events[:] = 0
        self._terminated[:] = self._truncated[:] = False
        self._failures.clear()
        next_due = self.world.agents.next_due[:, : self.world.egos]
        due_then = np.broadcast_to((self.world.step + self.period)[:, None], next_due.shape)
        np.copyto(next_due, due_then, where=self.alive)

    def _advance(self, env_mask: Bools) -> None:
        """Step some simulations by a decision; none beyond the end of its last agent."""
        pending = env_mask & self.running
        left = np.count_nonzero(pending)
        for number in range(self.period):
            if not left:
                return
            is_last = number == self.period - 1
            self._gather()
            self._choose_wanted(is_last)
            frame = self._look(self.simulation.step(self.actions, pending, self._wanted))
            self.actions.fresh[:] = False
            for watcher in self._watchers:
                watcher.collect(frame, is_last)
            self._failures.update(frame.failures)
            events = frame.events
            left = self._join(events.bits, events.terminated, events.truncated, events.finished, pending)
            if not is_last:
                self.dispatch()

    def _look(self, frame: Frame) -> Frame:
        # What was seen of simulations that are not in this frame is still there.
        self._frame = frame
        np.copyto(self._seen, frame.observe_mask, where=frame.env_mask[:, None])
        return frame

    def _gather(self) -> None:
        """Put the answers of other agents into the actions; who has not answered goes on as before."""
        if self._others is None or not self._open:
            return
        for question, action in self._others.acting.gather(self._others.deadline).items():
            row, agent_id = question.row, question.agent_id
            if self._open.get((row, agent_id)) != question:
                continue
            del self._open[row, agent_id]
            kind = ActionSpaceType(int(self.actions.kind[row, agent_id]))
            action_mask = self.world.agents.action_mask[row, agent_id]
            encode_one(self._others.names[agent_id], kind, action, row, agent_id, action_mask, self.actions)
        self.late += len(self._open)
        self._open.clear()

    def _close_questions(self, env_mask: Bools) -> None:
        for place in [place for place in self._open if env_mask[place[0]]]:
            del self._open[place]

    def _wait_for_entries(self, env_mask: Bools) -> None:
        """Step on where agents are still to enter and none is there, by whole decisions."""
        agents, waited = self.world.agents, 0
        while True:
            state = agents.state[:, : self.world.egos]
            idle = env_mask & self.running & ~(state == _ACTIVE).any(axis=1)
            if not idle.any():
                return
            if waited >= PATIENCE:
                row = int(np.argmax(idle))
                waiting = np.flatnonzero(state[row] == AgentStatus.WAITING).tolist()
                raise ScenarioError(
                    f"no agent has entered simulation {row} within {PATIENCE * self.world.dt:g} s",
                    place=f"episode {self.world.episode[row]}, agents {waiting}",
                    remedy="give their missions earlier start times, or traps with a time limit",
                )
            self._advance(idle)
            waited += self.period

    def _find_alive(self) -> None:
        state = self.world.agents.state[:, : self.world.egos]
        np.logical_and(state == _ACTIVE, self.running[:, None], out=self.alive)
