"""The publisher: shows running simulations to a viewer's server, and never waits for it.

It has the recorder's interface. A frame is what a recorder takes of a step, of all vehicles; of what holds
until it changes (tables of agents, names, lights, bubbles), what has changed since the last one, or all when
that may not have arrived. Frames that are not due are left out.
"""

from __future__ import annotations

import os
import socket
import time
import uuid
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from smarts.arrays import Bools, Ints
from smarts.geometry.binding import LateBound
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.memory import remembered
from smarts.roads.scene import Scene
from smarts.sim.agent_pool import AgentPool
from smarts.sim.episode_tables import Ending, columns_of, new_endings, start_facts
from smarts.sim.observation_notes import observation_notes
from smarts.sim.outlet import Address, Content, Outlet
from smarts.sim.publisher_extras import PublishedExtras
from smarts.sim.publisher_tables import agent_tables, bubble_tables, outcomes_table
from smarts.sim.recorder import OBSERVED, ROWS, newcomers
from smarts.sim.recorder_handovers import HandoverNotes
from smarts.sim.recorder_kernel import NEWCOMERS, Buffers, take_frame
from smarts.stream.container import Message
from smarts.stream.road_map import map_message, origin_of
from smarts.types.actions import Actions
from smarts.types.episode import EpisodeStart
from smarts.types.episode_schema import BUBBLE_POSES, EXTRAS, NAMES, OBSERVATIONS, VEHICLES
from smarts.types.frame import Frame

MOST_SHOWN = 9
"""Simulations of a process that are sent: the first ones."""
SHORTEST = 1 / 60
"""Shortest time from one frame of a simulation to the next [s]."""
LONGEST = 0.2
"""And at most, where steps are no longer [s]."""
SHARE = 0.025
"""The part of the time that frames may take."""
OBSERVED_EVERY = 0.05
"""Shortest time from one frame with observations to the next [s]: grids take a millisecond each."""


@dataclass
class _Row:
    """What is known of one simulation that is shown."""

    source: str
    start: EpisodeStart | None = None
    """Its episode; None: it is over."""
    serial: int = 0
    """Counts its episodes."""
    epoch: int = -1
    """Epoch of the outlet when all that lasts was last sent."""
    known: tuple[int, ...] = ()
    """How many agents, holds and outcomes were sent; empty: no table was."""
    endings: dict[int, Ending] = field(default_factory=dict)
    """By the agent's number."""
    notes: HandoverNotes = field(default_factory=HandoverNotes)
    agent_ids: list[int] = field(default_factory=list)
    """Agents whose observations viewers look at."""
    seen: dict[int, int] = field(default_factory=dict)
    """The step in which each of them has observed since the last frame."""
    next_look: float = 0.0
    """Time from which on observations are sent again [s]."""


class EpisodePublisher:
    """Sends frames of some simulations to a server, at most 60 a second of each.

    Args:
        scene: The world and its maps.
        address: Address of the server, which need not be there.
        pool: The agents of each episode.
        policies: Names of the social policies, by number.
        policy: Name of what drives the egos, "" if it has none.
    """

    def __init__(
        self,
        scene: Scene,
        address: Address,
        pool: AgentPool,
        policies: Sequence[str] = (),
        policy: str = "",
    ) -> None:
        world = scene.world
        self._scene, self._address, self._pool = scene, address, pool
        self._policies, self._policy = tuple(policies), policy
        self._rows = [_Row("") for _ in range(min(world.worlds, room()))]
        self._unsent = world.worlds - len(self._rows)
        _publishers.add(self)
        self._connect()
        self._no_actions = Actions.allocate(*world.agents.slot.shape)
        self._extras = PublishedExtras(len(self._rows))
        self._due = 0.0
        """Time from which on the next frame is sent [s]."""
        self._buffers = Buffers.allocate(world, rows=0)
        self._take = LateBound(take_frame, world.state, 0, np.inf, self._buffers)

    @property
    def observers(self) -> Bools | None:
        """Agents whose observations viewers look at now, shape (B, A); None: of no agent."""
        if not self._outlet.observed:
            return None
        mask = np.zeros(self._scene.world.agents.slot.shape, np.bool_)
        for row, shown in enumerate(self._rows):
            mask[row, shown.agent_ids] = True
        return mask

    @property
    def wants_terms(self) -> bool:
        """Whether a viewer looks at an agent, and so at the terms of its reward."""
        return bool(self._outlet.observed)

    def record(self, frame: Frame) -> None:
        """Send what is due of a frame, before the next step overwrites it."""
        now, events, outlet = time.monotonic(), frame.events, self._outlet
        has_news = bool(np.count_nonzero(events.just_done) or np.count_nonzero(events.finished))
        actions = self._no_actions if frame.actions is None else frame.actions
        if outlet.is_open:
            np.copyto(self._buffers.decided, frame.world.step[:, None] - 1 - actions.age, where=actions.fresh)
        is_due = outlet.is_open and (now >= self._due or self._epoch != outlet.epoch)
        # Most steps end here.
        is_quiet = not (is_due or has_news or frame.starts or frame.failures or outlet.observed)
        if is_quiet and outlet.process == os.getpid():
            return
        self._prepare()
        self._epoch = self._outlet.epoch
        for row, start in frame.starts.items():
            if row < len(self._rows):
                self._begin(row, self._rows[row], start)
        self._send_due(frame, actions, is_due, has_news)
        for row, shown in enumerate(self._rows):
            if row in frame.failures:
                self._end(shown, False, f"invalid: {frame.failures[row].problem}")
            elif events.finished[row]:
                self._end(shown, True, "")

    def _send_due(self, frame: Frame, actions: Actions, is_due: bool, has_news: bool) -> None:
        """Send the frame of each simulation that is due or has news; say when the next one is due."""
        used = time.thread_time()
        due = np.zeros(len(frame.env_mask), np.bool_)
        for row, shown in enumerate(self._rows):
            due[row] = self._is_sent(row, shown, frame, is_due, has_news)
        if due.any():
            self._buffers.used[due] = 0
            self._take.to(frame.events, frame.contacts, actions)(due)
            for row in np.flatnonzero(due).tolist():
                self._send(row, self._rows[row], frame)
            self._due = time.monotonic() + min(max(SHORTEST, (time.thread_time() - used) / SHARE), LONGEST)

    def _is_sent(self, row: int, shown: _Row, frame: Frame, is_due: bool, has_news: bool) -> bool:
        """Note what lasts of one simulation's frame; return whether the frame is sent."""
        events, outlet = frame.events, self._outlet
        has_news = has_news and bool(events.finished[row] or events.just_done[row].any())
        if has_news:
            shown.endings |= new_endings(frame, row, shown.endings)
        if shown.start is None or not frame.env_mask[row]:
            return False
        if outlet.observed:
            looked_at = np.isin(frame.world.agents.agent[row], outlet.observed.get(shown.source, ()))
            shown.agent_ids = np.flatnonzero(looked_at).tolist()
            step = int(frame.world.step[row])
            shown.seen |= {each: step for each in shown.agent_ids if frame.observe_mask[row, each]}
        epoch = outlet.epoch
        is_sent = outlet.is_open and (is_due or has_news or shown.epoch != epoch)
        if is_sent and shown.epoch != epoch:
            self._open(row, shown, shown.start, epoch)
        return is_sent

    def annotate(self, name: str, values: ArrayLike, agent_ids: Bools, step: Ints | None = None) -> None:
        """Send what an algorithm says with the next frame, of each name the newest; as in `EpisodeRecorder`.

        Of what agents observe, that of `observers` is sent.
        """
        if not self._outlet.is_open:
            return
        if name.startswith(OBSERVED):
            observers = self.observers
            if observers is None:
                return
            agent_ids = agent_ids & observers[:, : agent_ids.shape[1]]
        self._extras.take(name, values, agent_ids, self._scene.world.step if step is None else step)

    def finish(self, env_mask: Bools) -> None:
        """Do nothing: rewards of the last decision come after the last frame."""

    def close(self) -> None:
        """Say that the simulations are over, and end; may be called again."""
        for shown in self._rows:
            self._end(shown, False, "closed before its end")
        self._rows = []
        self._outlet.close()

    def _connect(self) -> None:
        """Open a connection, under names that no other publisher of any process has."""
        self._outlet = Outlet(self._address)
        # Also for a publisher that nobody closes.
        weakref.finalize(self, self._outlet.close)
        # Containers may share a host name and process numbers.
        name = uuid.uuid4().hex
        for row, shown in enumerate(self._rows):
            shown.source, shown.epoch = f"{name}-{row}", -1
        self._maps_sent: tuple[int, set[int]] = -1, set()
        self._epoch = -1
        """Epoch of the outlet when a frame was last looked at."""
        self._told = -1
        """Epoch in which the server last got the number of simulations that are not sent."""

    def _prepare(self) -> None:
        """Connect a process that was forked off; say how many simulations are not sent."""
        if self._outlet.process != os.getpid():
            # The thread and the connection stayed in the process that forked.
            self._connect()
        outlet = self._outlet
        if self._unsent and outlet.is_open and self._told != outlet.epoch:
            self._told = outlet.epoch
            outlet.put({"type": "unsent", "count": self._unsent}, self._told)

    def _begin(self, row: int, shown: _Row, start: EpisodeStart) -> None:
        self._end(shown, False, "reset before its end")
        shown.start, shown.serial, shown.epoch = start, shown.serial + 1, -1
        shown.endings, shown.agent_ids, shown.seen = {}, [], {}
        self._extras.pop(row)

    def _end(self, shown: _Row, is_complete: bool, remark: str) -> None:
        if shown.start is not None:
            shown.start = None
            self._put(shown, {"type": "end", "is_complete": is_complete, "remark": remark})

    def _put(self, shown: _Row, message: Content) -> None:
        self._outlet.put({**message, "source": shown.source, "serial": shown.serial}, shown.epoch)

    def _open(self, row: int, shown: _Row, start: EpisodeStart, epoch: int) -> None:
        """Send the map if the server has none, and which episode it is; all that lasts is to be sent."""
        shown.epoch, shown.known, shown.notes = epoch, (), HandoverNotes()
        self._buffers.clear(row)
        if self._maps_sent[0] != epoch:
            self._maps_sent = epoch, set()
        if start.map not in self._maps_sent[1]:
            self._maps_sent[1].add(start.map)
            graph = self._scene.atlas.graphs[start.map]
            known_as = {"type": "map", "map": start.map, "origin": list(origin_of(graph))}
            self._outlet.put({**known_as, "message": _map_of(graph)}, epoch)
        facts = start_facts(start, self._scene.world.dt) | {"policy": self._policy}
        who = {"host": socket.gethostname(), "pid": os.getpid(), "world": row}
        self._put(shown, {"type": "begin", "facts": facts, "map": start.map, **who})

    def _send(self, row: int, shown: _Row, frame: Frame) -> None:
        """Send the rows that were taken of one simulation's frame, and what lasts and has changed."""
        assert shown.start is not None
        step, buffers, bubbles = int(frame.world.step[row]), self._buffers, shown.start.bubbles
        tables: dict[str, Any] = self._lasting(row, shown, shown.start)
        used = buffers.used[row].tolist()
        for name, column in ROWS:
            if used[column] or name == VEHICLES.name:
                tables[name] = getattr(buffers, name)[row, : used[column]].tobytes()
        extras, seen = [], []
        for step_of, agent_id, name, values in self._extras.pop(row):
            rows = seen if name.startswith(OBSERVED) else extras
            rows.append((step_of, agent_id, name.removeprefix(OBSERVED), values))
        if frame.bubbles is not None and bubbles:
            shown.notes.take_bubbles(step, row, len(bubbles), frame.bubbles)
        poses, shown.notes.poses = shown.notes.poses, []
        seen += self._observed(row, shown, frame)
        for table, rows in ((EXTRAS, extras), (OBSERVATIONS, seen), (BUBBLE_POSES, poses)):
            if rows:
                tables[table.name] = columns_of(table.names, rows)
        if used[NEWCOMERS]:
            tables[NAMES.name] = columns_of(NAMES.names[:3], newcomers(frame.world, buffers, row))
        self._put(shown, {"type": "frame", "step": step, "tables": tables})

    def _lasting(self, row: int, shown: _Row, start: EpisodeStart) -> dict[str, Any]:
        """Return the tables that last and have changed since they were sent."""
        starts, holds, before = self._pool.starts[row], self._pool.holds[row], shown.known
        shown.known = len(starts), len(holds), len(shown.endings)
        tables: dict[str, Any] = {} if before else bubble_tables(start.bubbles)
        if before[:2] != shown.known[:2]:
            tables |= agent_tables(starts, holds, self._policies, self._scene.atlas.graphs[start.map])
        if before[2:] != shown.known[2:]:
            tables["outcomes"] = outcomes_table(shown.endings)
        return tables

    def _observed(self, row: int, shown: _Row, frame: Frame) -> Iterator[tuple[int, int, str, bytes]]:
        """Yield step, agent_id, name and the bytes of float32 of what agents have observed since."""
        now, seen = time.monotonic(), shown.seen
        if not seen or now < shown.next_look or shown.start is None:
            return
        shown.next_look, shown.seen = now + OBSERVED_EVERY, {}
        kept = {each: step for each, step in seen.items() if each in shown.agent_ids}
        origin = np.array(origin_of(self._scene.atlas.graphs[shown.start.map]))
        for step, agent_id, name, values in observation_notes(frame, row, kept, origin):
            yield step, agent_id, name, values.astype(np.float32).tobytes()


@remembered(most=MOST_SHOWN)
def _map_of(graph: LaneGraph) -> Message:
    return map_message(graph, "")


def room() -> int:
    """Return how many further simulations of this process are shown."""
    # A process that was forked off has its parent's publishers, too, which show nothing here unless used.
    here = [each for each in _publishers if each._outlet.process == os.getpid()]
    return max(0, MOST_SHOWN - sum(len(each._rows) for each in here))


_publishers: weakref.WeakSet[EpisodePublisher] = weakref.WeakSet()
"""Publishers of this process."""
