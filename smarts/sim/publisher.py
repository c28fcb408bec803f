"""The publisher: shows running simulations to a viewer's server, and never waits for it.

It has the recorder's interface. Each message of a frame is a whole picture of one simulation, so a frame that
is dropped loses nothing but itself; what lasts (agents, holds, outcomes, names of vehicles) is sent again
when it may not have arrived.
"""

from __future__ import annotations

import logging
import os
import socket
import time
import uuid
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.arrays import Bools, Floats, Ints
from smarts.geometry.binding import LateBound
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.memory import remembered
from smarts.roads.scene import Scene
from smarts.sim.agent_pool import AgentPool
from smarts.sim.episode_tables import start_facts
from smarts.sim.outlet import Address, Content, Outlet
from smarts.sim.publisher_extras import PublishedExtras
from smarts.sim.publisher_kernel import Rows, take_row
from smarts.sim.publisher_sight import PublishedSight
from smarts.sim.publisher_tables import static_tables
from smarts.sim.recorder import OBSERVED
from smarts.stream.container import Message
from smarts.stream.road_map import map_message, origin_of
from smarts.types.actions import Actions
from smarts.types.agent_states import UNSET
from smarts.types.episode import EpisodeStart
from smarts.types.events import Outcome
from smarts.types.frame import Frame

MOST_SHOWN = 9
"""Simulations of a process that are sent: the first ones."""
SHORTEST = 1 / 60
"""Shortest time from one frame of a simulation to the next [s]."""
LONGEST = 0.2
"""And at most, where steps are no longer [s]."""
SHARE = 0.025
"""The part of the time that frames may take."""


@dataclass
class _Row:
    """What is known of one simulation that is shown."""

    source: str
    start: EpisodeStart | None = None
    serial: int = 0
    """Counts its episodes."""
    is_over: bool = True
    epoch: int = -1
    """Epoch of the outlet when all that lasts was last sent."""
    known: tuple[int, int, int] = (0, 0, 0)
    """How many agents, holds and outcomes were sent."""
    outcomes: dict[int, tuple[int, ...]] = field(default_factory=dict)
    """Agent's number -> step, outcome, slot and generation of the vehicle that it collided with."""
    sight: PublishedSight = field(default_factory=PublishedSight)


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
        self._refused: set[int] = set()
        """Maps that cannot be shown."""
        self._origins: dict[int, Floats] = {}
        _publishers.add(self)
        self._connect()
        agents = world.agents.slot.shape
        self._no_actions = Actions.allocate(*agents)
        self._extras = PublishedExtras(len(self._rows))
        self._due = 0.0
        """Time from which on the next frame is sent [s]."""
        self._buffers = Rows.allocate(
            world.vehicles.capacity, world.worlds, world.signals.shape[1], agents[1]
        )
        self._take = LateBound(take_row, world.state, self._buffers)

    @property
    def observers(self) -> Bools | None:
        """Agents whose observations viewers look at now, shape (B, A); None: of no agent."""
        if not self._outlet.observed:
            return None
        mask = np.zeros(self._scene.world.agents.slot.shape, np.bool_)
        for row, shown in enumerate(self._rows):
            mask[row, shown.sight.agent_ids] = True
        return mask

    @property
    def wants_terms(self) -> bool:
        """Whether a viewer looks at an agent, and so at the terms of its reward."""
        return bool(self._outlet.observed)

    def record(self, frame: Frame) -> None:
        """Send what is due of a frame, before the next step overwrites it."""
        now, events, outlet = time.monotonic(), frame.events, self._outlet
        has_news = bool(np.count_nonzero(events.just_done) or np.count_nonzero(events.finished))
        if outlet.is_open and frame.actions is not None:
            actions = frame.actions
            decided = frame.world.step[:, None] - 1 - actions.age
            np.copyto(self._buffers.decided, decided, where=actions.fresh)
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
        used = time.thread_time()
        sent = [self._record_row(row, frame, is_due, has_news) for row in range(len(self._rows))]
        if any(sent):
            self._due = now + min(max(SHORTEST, (time.thread_time() - used) / SHARE), LONGEST)

    def _record_row(self, row: int, frame: Frame, is_due: bool, has_news: bool) -> bool:
        """Take what is new of one simulation; return whether its frame was sent."""
        shown, events, outlet = self._rows[row], frame.events, self._outlet
        is_finished = has_news and bool(events.finished[row])
        has_news = is_finished or (has_news and bool(events.just_done[row].any()))
        if has_news:
            self._take_outcomes(row, shown, frame)
        if shown.is_over:
            return False
        is_stepped = bool(frame.env_mask[row])
        if outlet.observed and is_stepped:
            shown.sight.look(frame, row, outlet.observed.get(shown.source, ()))
        assert shown.start is not None
        is_due = (is_due or has_news or shown.epoch != outlet.epoch) and outlet.is_open and is_stepped
        is_sent = is_due and shown.start.map not in self._refused
        if is_sent:
            self._send(row, shown, frame)
        if row in frame.failures:
            self._end(shown, False, f"invalid: {frame.failures[row].problem}")
        elif is_finished:
            self._end(shown, True, "")
        return is_sent

    def annotate(self, name: str, values: ArrayLike, agent_ids: Bools, step: Ints | None = None) -> None:
        """Send what an algorithm says with the next frame, of each name the newest; as in `EpisodeRecorder`.

        Of what agents observe, that of `observers` is sent.
        """
        if not self._outlet.is_open:
            return
        steps = self._scene.world.step if step is None else step
        if name.startswith(OBSERVED):
            table, what = np.asarray(values, np.float64), name.removeprefix(OBSERVED)
            for row, shown in enumerate(self._rows):
                shown.sight.annotate(what, int(steps[row]), table[row], agent_ids[row])
        else:
            self._extras.take(name, values, agent_ids, steps)

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

    def _begin(self, row: int, shown: _Row, start: EpisodeStart) -> None:
        self._end(shown, False, "reset before its end")
        shown.start, shown.is_over, shown.serial = start, False, shown.serial + 1
        shown.epoch = -1
        shown.outcomes.clear()
        self._extras.forget(row)
        self._buffers.decided[row] = UNSET
        shown.sight.begin()

    def _end(self, shown: _Row, is_complete: bool, remark: str) -> None:
        if not shown.is_over:
            shown.is_over = True
            if shown.start is not None and shown.start.map in self._refused:
                return
            self._put(shown, {"type": "end", "is_complete": is_complete, "remark": remark})

    def _put(self, shown: _Row, message: Content) -> None:
        self._outlet.put({**message, "source": shown.source, "serial": shown.serial}, shown.epoch)

    def _send(self, row: int, shown: _Row, frame: Frame) -> None:
        """Send a frame of one simulation, and before it what lasts and has not been sent."""
        epoch = self._outlet.epoch
        if shown.epoch != epoch:
            shown.epoch, shown.known = epoch, (0, 0, 0)
            self._buffers.named[row] = 0
            self._open(row, shown, epoch)
            if shown.start is not None and shown.start.map in self._refused:
                return
        known = len(self._pool.starts[row]), len(self._pool.holds[row]), len(shown.outcomes)
        if known != shown.known:
            shown.known = known
            assert shown.start is not None
            graph = self._scene.atlas.graphs[shown.start.map]
            starts, holds = self._pool.starts[row], self._pool.holds[row]
            tables = static_tables(starts, holds, shown.outcomes, self._policies, graph, shown.start.bubbles)
            self._put(shown, {"type": "static", "tables": tables})
        actions = self._no_actions if frame.actions is None else frame.actions
        self._take.to(frame.events, frame.contacts, actions)(row)
        buffers = self._buffers
        vehicles, agents, decisions, signals, new = buffers.used.tolist()
        message = {
            "type": "frame",
            "step": int(frame.world.step[row]),
            "rows": [
                buffers.vehicles[:vehicles].tobytes(),
                buffers.agent_states[:agents].tobytes(),
                buffers.decisions[:decisions].tobytes(),
            ],
            "agent": frame.world.agents.agent[row].tolist(),
            "names": self._names(row, buffers.newcomers[:new]) if new else [],
            "signals": buffers.signals[:signals].tolist() if signals else [],
            "bubbles": self._bubbles(row, shown, frame),
            "extras": self._extras.pop(row),
            "observations": self._observations(row, shown, frame),
        }
        self._put(shown, message)

    def _prepare(self) -> None:
        """Connect a process that was forked off; say how many simulations are not sent."""
        if self._outlet.process != os.getpid():
            # The thread and the connection stayed in the process that forked.
            self._connect()
        outlet = self._outlet
        if self._unsent and outlet.is_open and self._told != outlet.epoch:
            self._told = outlet.epoch
            outlet.put({"type": "unsent", "count": self._unsent}, self._told)

    def _observations(self, row: int, shown: _Row, frame: Frame) -> list[tuple[Any, ...]]:
        if not shown.sight.agent_ids:
            return []
        assert shown.start is not None
        number = shown.start.map
        if number not in self._origins:
            self._origins[number] = np.array(origin_of(self._scene.atlas.graphs[number]))
        return shown.sight.take(frame, row, self._origins[number], time.monotonic())

    def _open(self, row: int, shown: _Row, epoch: int) -> None:
        """Send the map if the server has none, and which episode it is."""
        start = shown.start
        assert start is not None
        if self._maps_sent[0] != epoch:
            self._maps_sent = epoch, set()
        if start.map not in self._maps_sent[1]:
            self._maps_sent[1].add(start.map)
            self._put_map(start.map, epoch)
        facts = start_facts(start, self._scene.world.dt) | {"policy": self._policy}
        who = {"host": socket.gethostname(), "pid": os.getpid(), "world": row}
        self._put(shown, {"type": "begin", "facts": facts, "map": start.map, **who})

    def _put_map(self, number: int, epoch: int) -> None:
        """Send a map; one that is too large is refused from now on."""
        graph = self._scene.atlas.graphs[number]
        message = {"type": "map", "map": number, "origin": list(origin_of(graph)), "message": _map_of(graph)}
        if not self._outlet.put(message, epoch):
            self._refused.add(number)
            logging.getLogger("smarts").warning(
                "envision: map %d is too large, its simulations are not shown; record episodes, and open "
                "them with `smarts-bench view`",
                number,
            )

    def _names(self, row: int, slots: Ints) -> list[tuple[int, int, str]]:
        """Return slot, generation and name of vehicles."""
        world = self._scene.world
        generations = world.vehicles.generation[row, slots].tolist()
        return [
            (slot, generation, world.registry.name(row, slot))
            for slot, generation in zip(slots.tolist(), generations, strict=True)
        ]

    def _bubbles(self, row: int, shown: _Row, frame: Frame) -> list[tuple[float, ...]]:
        """Return x, y, angle and whether it is active of each bubble."""
        assert shown.start is not None
        count = len(shown.start.bubbles)
        if frame.bubbles is None or not count:
            return []
        pose: NDArray = frame.bubbles.pose[row, :count]
        active = frame.bubbles.is_active[row, :count].tolist()
        return [(*each, float(is_active)) for each, is_active in zip(pose.tolist(), active, strict=True)]

    def _take_outcomes(self, row: int, shown: _Row, frame: Frame) -> None:
        """Note how agents have ended, as long as their vehicles are there."""
        agents, contacts = frame.world.agents, frame.contacts
        for agent_id in np.flatnonzero(agents.outcome[row] != Outcome.NONE).tolist():
            number = int(agents.agent[row, agent_id])
            if number != UNSET and number not in shown.outcomes:
                partner: tuple[Any, ...] = (
                    contacts.partner[row, agent_id],
                    contacts.partner_generation[row, agent_id],
                )
                shown.outcomes[number] = (
                    int(frame.world.step[row]),
                    int(agents.outcome[row, agent_id]),
                    *map(int, partner),
                )


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
