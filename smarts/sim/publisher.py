"""The publisher: shows running simulations to a viewer's server, and never waits for it.

It has the recorder's interface. Each message of a frame is a whole picture of one simulation, so a frame that
is dropped loses nothing but itself; what lasts (agents, holds, outcomes, names of vehicles) is sent again
when it may not have arrived.
"""

from __future__ import annotations

import itertools
import os
import socket
import time
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.arrays import Bools, Floats, Ints
from smarts.geometry.binding import LateBound
from smarts.roads.scene import Scene
from smarts.sim.agent_pool import AgentPool
from smarts.sim.outlet import Address, Content, Outlet
from smarts.sim.publisher_kernel import Rows, take_row
from smarts.sim.publisher_maps import PublishedMaps
from smarts.sim.publisher_sight import PublishedSight
from smarts.sim.publisher_tables import static_tables
from smarts.sim.recorder import OBSERVED
from smarts.stream.road_map import MOST_MAPS, origin_of
from smarts.types.actions import Actions
from smarts.types.agent_states import UNSET
from smarts.types.episode import EpisodeStart
from smarts.types.events import Outcome
from smarts.types.frame import Frame

MOST_SHOWN = 9
"""Simulations of a process that are sent: the first ones."""
INTERVAL = 1 / 60
"""From one frame of a simulation to the next, at least [s]."""
_numbers = itertools.count()


@dataclass
class _Row:
    """What is known of one simulation that is shown."""

    source: str
    start: EpisodeStart | None = None
    serial: int = 0
    """Counts its episodes."""
    is_over: bool = True
    epoch: int = -1
    """Of the outlet, when all that lasts was last sent."""
    due: float = 0.0
    known: tuple[int, int, int] = (0, 0, 0)
    """How many agents, holds and outcomes were sent."""
    named: Ints = field(default_factory=lambda: np.zeros(0, np.int32))
    """Generation of the vehicle in each slot whose name was sent, 0 for none."""
    outcomes: dict[int, tuple[int, ...]] = field(default_factory=dict)
    """Agent's number -> step, outcome, slot and generation of the vehicle that it collided with."""
    extras: dict[str, tuple[int, NDArray, NDArray]] = field(default_factory=dict)
    """Name -> step, agent_ids (N,) and values (N, ...) of the newest annotation."""
    sight: PublishedSight = field(default_factory=PublishedSight)


class EpisodePublisher:
    """Sends frames of some simulations to a server, at most 60 a second of each.

    Args:
        scene: The world and its maps.
        address: Of the server, which need not be there.
        pool: The agents of each episode.
        policies: Names of the social policies, by number.
    """

    def __init__(self, scene: Scene, address: Address, pool: AgentPool, policies: Sequence[str] = ()) -> None:
        world = scene.world
        self._scene, self._address, self._pool, self._policies = scene, address, pool, tuple(policies)
        self._rows = [_Row("") for _ in range(min(world.worlds, room()))]
        self._unsent = world.worlds - len(self._rows)
        self._maps = PublishedMaps(scene.atlas.graphs)
        self._origins: dict[int, Floats] = {}
        _publishers.add(self)
        self._connect()
        agents = world.agents.slot.shape
        self._nobody = np.zeros(agents, np.bool_)
        self._no_actions = Actions.allocate(*agents)
        self._buffers = Rows.allocate(world.vehicles.capacity, agents[1])
        self._take = LateBound(take_row, world.state, self._buffers)

    @property
    def observers(self) -> Bools:
        """Agents whose observations viewers look at now, shape (B, A)."""
        if not self._outlet.observed:
            return self._nobody
        mask = np.zeros_like(self._nobody)
        for row, shown in enumerate(self._rows):
            mask[row, shown.sight.agent_ids] = True
        return mask

    @property
    def wants_terms(self) -> bool:
        """Whether a viewer looks at an agent, and so at the terms of its reward."""
        return bool(self._outlet.observed)

    def record(self, frame: Frame) -> None:
        """Send what is due of a frame, before the next step overwrites it."""
        self._prepare()
        for row, start in frame.starts.items():
            if row < len(self._rows):
                self._begin(self._rows[row], start)
        now, events, outlet = time.monotonic(), frame.events, self._outlet
        some_news = np.count_nonzero(events.just_done) or np.count_nonzero(events.finished)
        for row, shown in enumerate(self._rows):
            has_news = bool(some_news and (events.just_done[row].any() or events.finished[row]))
            if has_news:
                self._take_outcomes(row, shown, frame)
            if shown.is_over:
                continue
            if outlet.observed and frame.env_mask[row]:
                shown.sight.look(frame, row, outlet.observed.get(shown.source, ()))
            is_due = has_news or now >= shown.due or shown.epoch != outlet.epoch
            assert shown.start is not None
            is_refused = shown.start.map in self._maps.refused
            if is_due and outlet.is_open and frame.env_mask[row] and not is_refused:
                shown.due = now + INTERVAL
                self._send(row, shown, frame)
            if row in frame.failures:
                self._end(shown, False, f"invalid: {frame.failures[row].problem}")
            elif has_news and events.finished[row]:
                self._end(shown, True, "")

    def annotate(self, name: str, values: ArrayLike, agent_ids: Bools, step: Ints | None = None) -> None:
        """Send what an algorithm says with the next frame, of each name the newest; as in `EpisodeRecorder`.

        Of what agents observe, that of `observers` is sent.
        """
        if not self._outlet.is_open:
            return
        table = np.asarray(values, np.float64)
        steps = self._scene.world.step if step is None else step
        for row, shown in enumerate(self._rows):
            if name.startswith(OBSERVED):
                what = name.removeprefix(OBSERVED)
                shown.sight.annotate(what, int(steps[row]), table[row], agent_ids[row])
                continue
            chosen = np.flatnonzero(agent_ids[row])
            if len(chosen):
                # Fancy indexing copies: the caller may reuse its array.
                shown.extras[name] = int(steps[row]), chosen, table[row, chosen]

    def finish(self, env_mask: Bools) -> None:
        """Do nothing: rewards of the last decision come after the last frame."""

    def close(self) -> None:
        """Say that the simulations are over, and end; may be called again."""
        for shown in self._rows:
            self._end(shown, False, "closed before its end")
        self._rows = []
        self._outlet.close()

    def _connect(self) -> None:
        """Open a connection, under names that no other process has."""
        self._outlet = Outlet(self._address)
        # Also for a publisher that nobody closes.
        weakref.finalize(self, self._outlet.close)
        machine, process, number = socket.gethostname(), os.getpid(), next(_numbers)
        for row, shown in enumerate(self._rows):
            shown.source, shown.epoch = f"{machine}-{process}-{number}-{row}", -1
        self._maps_sent: tuple[int, set[int]] = -1, set()
        self._told = -1
        """Epoch in which the server was told how many simulations are not sent."""

    def _begin(self, shown: _Row, start: EpisodeStart) -> None:
        self._end(shown, False, "reset before its end")
        shown.start, shown.is_over, shown.serial = start, False, shown.serial + 1
        shown.epoch = -1
        shown.outcomes.clear()
        shown.extras.clear()
        shown.sight.begin()

    def _end(self, shown: _Row, is_complete: bool, remark: str) -> None:
        if not shown.is_over:
            shown.is_over = True
            if shown.start is not None and shown.start.map in self._maps.refused:
                return
            self._put(shown, {"type": "end", "is_complete": is_complete, "remark": remark})

    def _put(self, shown: _Row, message: Content) -> None:
        self._outlet.put({**message, "source": shown.source, "serial": shown.serial}, shown.epoch)

    def _send(self, row: int, shown: _Row, frame: Frame) -> None:
        """Send a frame of one simulation, and before it what lasts and has not been sent."""
        epoch = self._outlet.epoch
        if shown.epoch != epoch:
            shown.epoch, shown.known = epoch, (0, 0, 0)
            shown.named = np.zeros(self._scene.world.vehicles.capacity, np.int32)
            if not self._open(row, shown, epoch):
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
        blocks = [
            block[:used].tobytes()
            for block, used in zip(self._buffers[:3], self._buffers.used.tolist(), strict=True)
        ]
        message = {
            "type": "frame",
            "step": int(frame.world.step[row]),
            "rows": blocks,
            "agent": frame.world.agents.agent[row].tolist(),
            "names": self._new_names(row, shown),
            "signals": self._signals(row),
            "bubbles": self._bubbles(row, shown, frame),
            "extras": [
                (name, step, agent_ids.tolist(), values.reshape(len(agent_ids), -1).tolist())
                for name, (step, agent_ids, values) in shown.extras.items()
            ],
            "observations": self._observations(row, shown, frame),
        }
        shown.extras.clear()
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

    def _open(self, row: int, shown: _Row, epoch: int) -> bool:
        """Send the map if the server has none, and which episode it is; return whether it is shown."""
        start = shown.start
        assert start is not None
        if self._maps_sent[0] != epoch:
            self._maps_sent = epoch, set()
        if start.map not in self._maps_sent[1]:
            if len(self._maps_sent[1]) >= MOST_MAPS:
                self._maps.refuse(start.map, f"more than {MOST_MAPS} maps of one process")
                return False
            self._maps_sent[1].add(start.map)
            self._outlet.put(partial(self._maps.message, start.map), epoch)
        facts = {
            "scenario": start.scenario,
            "traffic": start.traffic_name or "",
            "seed": start.seed,
            "world": start.world,
            "episode": start.episode,
            "dt": self._scene.world.dt,
            "traffic_engine": start.engine,
            "traffic_seed": start.traffic_seed,
        }
        who = {"host": socket.gethostname(), "pid": os.getpid(), "world": row}
        self._put(shown, {"type": "begin", "facts": facts, "map": start.map, **who})
        return True

    def _new_names(self, row: int, shown: _Row) -> list[tuple[int, int, str]]:
        """Return slot, generation and name of the vehicles that are new."""
        world = self._scene.world
        generations = world.vehicles.generation[row]
        is_new = world.vehicles.alive[row] & (shown.named != generations)
        if not np.count_nonzero(is_new):
            return []
        slots = np.flatnonzero(is_new)
        shown.named[slots] = generations[slots]
        return [(slot, int(generations[slot]), world.registry.name(row, slot)) for slot in slots.tolist()]

    def _signals(self, row: int) -> list[tuple[int, int]]:
        """Return lane and light where there is one."""
        lights = self._scene.world.signals[row]
        if not np.count_nonzero(lights):
            return []
        lanes = np.flatnonzero(lights)
        return [*zip(lanes.tolist(), lights[lanes].tolist(), strict=True)]

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


def room() -> int:
    """Return how many further simulations of this process are shown."""
    # A process that was forked off has its parent's publishers, too, which show nothing here unless used.
    here = [each for each in _publishers if each._outlet.process == os.getpid()]
    return max(0, MOST_SHOWN - sum(len(each._rows) for each in here))


_publishers: weakref.WeakSet[EpisodePublisher] = weakref.WeakSet()
"""Those of this process."""
