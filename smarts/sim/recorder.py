"""The recorder: copies rows out of every frame, and writes an episode when it has ended."""

from __future__ import annotations

import atexit

# pyarrow imports it for its first file otherwise, which is too late at the end of a program.
import concurrent.futures.thread  # noqa: F401
import math
import os
import weakref
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from smarts.arrays import Bools, Floats, Ints
from smarts.errors import TrafficError
from smarts.geometry.binding import LateBound
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.scene import Scene
from smarts.sim.agent_pool import AgentPool
from smarts.sim.episode_files import EpisodeStore, EpisodeWriter
from smarts.sim.episode_tables import (
    Ending,
    agents_table,
    columns_of,
    extras_table,
    new_endings,
    routes_table,
    rows_by_name,
    start_facts,
)
from smarts.sim.observation_notes import ObservationRows, observation_notes
from smarts.sim.recorder_handovers import HandoverNotes, handover_tables
from smarts.sim.recorder_kernel import (
    AGENT_ROWS,
    DECISION_ROWS,
    FOR_A_WHILE,
    NEAR,
    NEWCOMERS,
    SIGNAL_ROWS,
    VEHICLE_ROWS,
    Buffers,
    take_frame,
)
from smarts.stream.road_map import origin_of
from smarts.types.actions import Actions
from smarts.types.episode import AgentStart, EpisodeStart
from smarts.types.episode_schema import (
    AGENT_STATES,
    DECISIONS,
    NAMES,
    OBSERVATIONS,
    SIGNALS,
    VEHICLES,
    VERSION,
)
from smarts.types.events import Outcome
from smarts.types.frame import Frame
from smarts.types.world import World

OBSERVED = "observation/"
"""Begins the names of annotations that say what an agent observes."""
_CUT_SHORT = "reset or closed before its end"
_OVERLAP = "vehicles overlapped at the start"

ROWS = (
    (VEHICLES.name, VEHICLE_ROWS),
    (AGENT_STATES.name, AGENT_ROWS),
    (DECISIONS.name, DECISION_ROWS),
    (SIGNALS.name, SIGNAL_ROWS),
)
"""Tables whose rows `take_frame` copies, with their columns of `Buffers.used`."""


@dataclass
class _Episode:
    """The notes on an unfinished episode."""

    start: EpisodeStart
    graph: LaneGraph
    writer: EpisodeWriter
    steps: int = 0
    overlaps: int = 0
    is_complete: bool = False
    invalid: str = ""
    """Why the episode is to be discarded, "" if it is not."""
    routes: list[Ints] = field(default_factory=list)
    names: list[tuple[Any, ...]] = field(default_factory=list)
    """Rows of the table."""
    agents: list[AgentStart] = field(default_factory=list)
    """Agents by their number."""
    handovers: HandoverNotes = field(default_factory=HandoverNotes)
    endings: dict[int, Ending] = field(default_factory=dict)
    """Endings by the agent's number."""
    extras: list[tuple[str, int, Ints, Floats]] = field(default_factory=list)
    """Name, step, agents (S,), values (S, ...)."""
    observations: ObservationRows = field(default_factory=ObservationRows)
    small: dict[str, list[Floats]] = field(
        default_factory=lambda: {table.name: [] for table in (AGENT_STATES, DECISIONS, SIGNALS)}
    )
    """Rows of the tables that are written in one piece."""

    def annotate(self, name: str, step: int, agents: Ints, values: Floats) -> None:
        """Record values (S, ...) of agents (S,)."""
        if name.startswith(OBSERVED):
            what = name.removeprefix(OBSERVED)
            pairs = zip(agents.tolist(), values, strict=True)
            self.observations.add((step, each, what, numbers) for each, numbers in pairs)
        else:
            self.extras.append((name, step, agents, values))


class EpisodeRecorder:
    """Records all simulations into a folder; `smarts.types.episode_schema` says what.

    An episode is written at `finish`, or else when the next one of its simulation begins, or at `close`;
    until then `annotate` can add to it. Copying is done in one compiled call. A store never holds half an
    episode.

    Args:
        scene: The world and its maps.
        folder: Folder of the store; several recorders may share one.
        pool: The agents of each episode.
        policies: Names of the social policies, by number.
        everything: Whether to record vehicles far from agents, too.
        observers: Agent_ids of the egos whose observations are recorded.

    Raises:
        RecordError: The folder cannot be written to.
    """

    def __init__(
        self,
        scene: Scene,
        folder: Path,
        pool: AgentPool,
        policies: Sequence[str] = (),
        *,
        everything: bool = False,
        observers: Sequence[int] = (),
    ) -> None:
        world = scene.world
        worlds, agents = world.agents.slot.shape
        self._scene, self._pool, self._policies = scene, pool, tuple(policies)
        self._observers = np.zeros((worlds, agents), np.bool_)
        self._observers[:, list(observers)] = True
        self.observers = self._observers if len(observers) else None
        self.wants_terms = True
        self._store = EpisodeStore(folder)
        self._owner = os.getpid()
        self._episodes: list[_Episode | None] = [None] * worlds
        self._unfinished: list[EpisodeWriter] = []
        self._no_actions = Actions.allocate(worlds, agents)
        self._buffers = Buffers.allocate(world, everything=everything)
        keep, near = round(FOR_A_WHILE / world.dt), math.inf if everything else NEAR
        self._take = LateBound(take_frame, world.state, keep, near, self._buffers)
        self._program = version("smarts-bench")
        _open.add(self)

    def record(self, frame: Frame) -> None:
        """Take what is wanted out of a frame, before the next step overwrites it.

        Raises:
            RecordError: An episode cannot be written.
        """
        for row, start in frame.starts.items():
            self._finish(row)
            self._begin(row, start)
        events, contacts = frame.events, frame.contacts
        actions = self._no_actions if frame.actions is None else frame.actions
        is_busy = self._take.to(events, contacts, actions)(frame.env_mask)
        if frame.transfers or frame.social_failures:
            self._take_handovers(frame)
        for row in np.flatnonzero(frame.env_mask).tolist():
            episode = self._episodes[row]
            if episode is not None:
                self._take_notes(row, episode, is_busy)
                self._observe(frame, row, episode)
                if frame.bubbles is not None and episode.start.bubbles:
                    episode.handovers.take_bubbles(
                        episode.steps, row, len(episode.start.bubbles), frame.bubbles
                    )
        if events.just_done.any() or events.finished.any():
            self._take_endings(frame)
        for row, failure in frame.failures.items():
            episode = self._episodes[row]
            if episode is not None:
                failed = "traffic" if isinstance(failure, TrafficError) else "a vehicle"
                episode.invalid = f"{failed} failed: {failure.problem}"

    def annotate(self, name: str, values: ArrayLike, agent_ids: Bools, step: Ints | None = None) -> None:
        """Add to the record what an algorithm says about its decisions, or what came of them.

        Args:
            name: Name, such as "reward"; behind `OBSERVED`, an observation, of `observers` alone.
            values: Numbers of each agent, shape (B, N, ...), N at most A.
            agent_ids: Mask of the agents whose values are recorded, shape (B, N).
            step: Step of the state on which each simulation's decision was made, shape (B,); by default now,
                which is right for notes made before the step.
        """
        if name.startswith(OBSERVED):
            agent_ids = agent_ids & self._observers[:, : agent_ids.shape[1]]
        table = np.asarray(values, np.float64)
        steps = self._scene.world.step if step is None else step
        for row in np.flatnonzero(agent_ids.any(axis=1)).tolist():
            episode = self._episodes[row]
            if episode is not None:
                chosen = np.flatnonzero(agent_ids[row]).astype(np.int32)
                # Fancy indexing copies: the caller may reuse its array.
                episode.annotate(name, int(steps[row]), chosen, table[row, chosen])

    def finish(self, env_mask: Bools) -> None:
        """Write the episodes of some simulations; they are fully annotated.

        Args:
            env_mask: Which simulations, shape (B,); entries of simulations without an episode are ignored.
        """
        for row in np.flatnonzero(env_mask).tolist():
            self._finish(row)

    def close(self) -> None:
        """Write what is left, and end; may be called again. In a forked process it does nothing.

        Raises:
            RecordError: An episode cannot be written.
        """
        if self._owner != os.getpid():
            return
        try:
            for row in range(len(self._episodes)):
                self._finish(row)
        finally:
            # After a failure these stay unfinished.
            for writer in self._unfinished:
                writer.abandon()
            self._unfinished.clear()
            self._store.close()
            _open.discard(self)

    def _begin(self, row: int, start: EpisodeStart) -> None:
        name = f"seed{start.seed}_world{start.world}_episode{start.episode:05d}"
        graph = self._scene.atlas.graphs[start.map]
        writer = self._store.begin(name)
        self._unfinished.append(writer)
        self._episodes[row] = _Episode(start, graph, writer)
        self._buffers.clear(row)

    def _take_notes(self, row: int, episode: _Episode, is_busy: bool) -> None:
        """Note what is new in a simulation's step; `is_busy` if vehicles are new or a buffer is full."""
        world, notes, written = self._scene.world, episode.handovers, len(episode.routes)
        episode.steps, episode.overlaps = int(world.step[row]), int(world.traffic_overlaps[row])
        # The table of routes and the pool of agents are emptied before the episode is written.
        episode.routes += [
            world.routes.edges(row, number) for number in range(written, world.routes.count(row))
        ]
        episode.agents += self._pool.starts[row][len(episode.agents) :]
        notes.take_holds(self._pool.holds[row][len(notes.holds) :])
        if is_busy:
            self._take_names(row, episode)
            self._flush(row, episode)

    def _observe(self, frame: Frame, row: int, episode: _Episode) -> None:
        """Note what the chosen agents observe."""
        chosen, rows = np.flatnonzero(self._observers[row] & frame.observe_mask[row]), episode.observations
        if len(chosen):
            seen = dict.fromkeys(chosen.tolist(), episode.steps)
            rows.add(observation_notes(frame, row, seen, np.array(origin_of(episode.graph))))
        if rows.are_many:
            episode.writer.append(OBSERVATIONS.name, rows.taken())

    def _take_handovers(self, frame: Frame) -> None:
        """Note the transfers, before the new holds, and which policies have failed."""
        world = frame.world
        for carried_out in frame.transfers:
            row = carried_out.transfer.row
            episode = self._episodes[row]
            if episode is not None:
                step, numbers = int(world.step[row]), world.agents.agent[row]
                episode.handovers.take_transfer(step, carried_out, numbers)
        for (row, number), text in frame.social_failures.items():
            episode = self._episodes[row]
            if episode is not None:
                episode.handovers.failures.append((int(world.step[row]), number, text))

    def _take_names(self, row: int, episode: _Episode) -> None:
        world = self._scene.world
        vehicles, step = world.vehicles, int(world.step[row])
        for slot, generation, name in newcomers(world, self._buffers, row):
            shape = vehicles.kind[row, slot], vehicles.length[row, slot], vehicles.width[row, slot]
            episode.names.append((slot, generation, name, step, *shape))

    def _take_endings(self, frame: Frame) -> None:
        """Note how agents have ended, as long as their vehicles are there."""
        agents, events = frame.world.agents, frame.events
        for row in np.flatnonzero(events.just_done.any(axis=1) | events.finished).tolist():
            episode = self._episodes[row]
            if episode is None:
                continue
            episode.is_complete |= bool(events.finished[row])
            episode.endings |= new_endings(frame, row, episode.endings)
            if (agents.outcome[row] == Outcome.INVALID).any():
                episode.invalid = episode.invalid or _OVERLAP

    def _flush(self, row: int, episode: _Episode) -> None:
        """Move the rows of full buffers on; those of vehicles, the most by far, are written."""
        for name, column in ROWS:
            used = int(self._buffers.used[row, column])
            if used > len(getattr(self._buffers, name)[row]) // 2:
                self._empty(row, episode, name, column)

    def _empty(self, row: int, episode: _Episode, name: str, column: int) -> None:
        used = int(self._buffers.used[row, column])
        rows = getattr(self._buffers, name)[row, :used].copy()
        self._buffers.used[row, column] = 0
        if name in episode.small:
            episode.small[name].append(rows)
        elif used:
            episode.writer.append(name, rows_by_name(name, rows))

    def _finish(self, row: int) -> None:
        """Write the rest of a simulation's episode, if it has one."""
        episode, self._episodes[row] = self._episodes[row], None
        if episode is None:
            return
        for name, column in ROWS:
            self._empty(row, episode, name, column)
        writer, most = episode.writer, int(self._buffers.most[row])
        small = {name: rows_by_name(name, np.concatenate(rows)) for name, rows in episode.small.items()}
        for name, rows in small.items():
            writer.append(name, rows)
        writer.append("episode", self._facts(episode, most))
        writer.append("routes", routes_table(episode.routes))
        names = episode.graph.edge_ids
        numbers = {
            tuple(names[edge] for edge in route.tolist()): number
            for number, route in enumerate(episode.routes)
        }
        notes, starts = episode.handovers, episode.agents
        writer.append("agents", agents_table(starts, notes.holds, episode.endings, small, numbers))
        writer.append("extras", extras_table(episode.extras))
        writer.append(OBSERVATIONS.name, episode.observations.taken())
        writer.append(NAMES.name, columns_of(NAMES.names, episode.names))
        vehicles = {(slot, generation): name for slot, generation, name, *_ in episode.names}
        states, bubbles = small[AGENT_STATES.name], episode.start.bubbles
        for name, rows in handover_tables(notes, starts, states, vehicles, self._policies, bubbles).items():
            writer.append(name, rows)
        writer.finish()
        self._unfinished.remove(writer)

    def _facts(self, episode: _Episode, most: int) -> dict[str, list[Any]]:
        start = episode.start
        facts = start_facts(start, self._scene.world.dt) | {
            "version": VERSION,
            "program": self._program,
            "map": self._store.map(episode.graph),
            "steps": episode.steps,
            "is_complete": episode.is_complete,
            "is_invalid": bool(episode.invalid),
            "remark": episode.invalid or ("" if episode.is_complete else _CUT_SHORT),
            "limit": start.limit,
            "most_vehicles": most,
            "traffic_overlaps": episode.overlaps,
        }
        return {name: [value] for name, value in facts.items()}


def newcomers(world: World, buffers: Buffers, row: int) -> Iterator[tuple[int, int, str]]:
    """Yield slot, generation and name of the vehicles that the last frame was the first to have."""
    for slot in buffers.newcomers[row, : buffers.used[row, NEWCOMERS]].tolist():
        yield slot, int(buffers.named[row, slot]), world.registry.name(row, slot)


_open: weakref.WeakSet[EpisodeRecorder] = weakref.WeakSet()
"""Recorders that were not closed."""


@atexit.register
def _close_all() -> None:
    """Write what programs have recorded that end without closing their environments."""
    with ExitStack() as ends:
        for recorder in [*_open]:
            ends.callback(recorder.close)
