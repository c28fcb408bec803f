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
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.arrays import Bools, Ints
from smarts.geometry.binding import LateBound
from smarts.roads.scene import Scene
from smarts.sim.agent_pool import AgentPool
from smarts.sim.outlet import Address, Content, Outlet
from smarts.sim.publisher_kernel import Rows, take_row
from smarts.sim.publisher_tables import static_tables
from smarts.stream.road_map import map_message, origin_of
from smarts.types.actions import Actions
from smarts.types.agent_states import UNSET
from smarts.types.episode import EpisodeStart
from smarts.types.events import Outcome
from smarts.types.frame import Frame

MOST_SHOWN = 9
"""Simulations of a process that are sent: the first ones."""
INTERVAL = 1 / 60
"""From one frame of a simulation to the next, at least [s]."""
_MOST_EXTRAS = 256
"""Annotations that wait for the next frame."""
_numbers = itertools.count()
_shown = 0


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
    named: dict[int, int] = field(default_factory=dict)
    """Slot -> generation of the vehicle whose name was sent."""
    outcomes: dict[int, tuple[int, ...]] = field(default_factory=dict)
    """Agent's number -> step, outcome, slot and generation of the vehicle that it collided with."""
    extras: list[tuple[str, int, int, list[float]]] = field(default_factory=list)
    """Name, step, agent_id, values."""


class EpisodePublisher:
    """Sends frames of some simulations to a server, at most 60 a second of each.

    Args:
        scene: The world and its maps.
        address: Of the server, which need not be there.
        pool: The agents of each episode.
        policies: Names of the social policies, by number.
    """

    def __init__(self, scene: Scene, address: Address, pool: AgentPool, policies: Sequence[str] = ()) -> None:
        global _shown
        world = scene.world
        self._scene, self._address, self._pool, self._policies = scene, address, pool, tuple(policies)
        self._outlet = Outlet(address)
        machine, process, number = socket.gethostname(), os.getpid(), next(_numbers)
        count = min(world.worlds, max(0, MOST_SHOWN - _shown))
        _shown += count
        self._rows = [_Row(f"{machine}-{process}-{number}-{row}") for row in range(count)]
        self._maps_sent: tuple[int, set[int]] = -1, set()
        agents = world.agents.slot.shape
        self._no_actions = Actions.allocate(*agents)
        self._buffers = Rows.allocate(world.vehicles.capacity, agents[1])
        self._take = LateBound(take_row, world.state, self._buffers)

    def record(self, frame: Frame) -> None:
        """Send what is due of a frame, before the next step overwrites it."""
        if self._outlet.process != os.getpid():
            # The thread and the connection stayed in the process that forked.
            self._outlet = Outlet(self._address)
        for row, start in frame.starts.items():
            if row < len(self._rows):
                self._begin(self._rows[row], start)
        now, events = time.monotonic(), frame.events
        for row, shown in enumerate(self._rows):
            has_news = bool(events.just_done[row].any() or events.finished[row])
            if has_news:
                self._take_outcomes(row, shown, frame)
            if shown.is_over or not self._outlet.is_open:
                continue
            if frame.env_mask[row] and (has_news or now >= shown.due or shown.epoch != self._outlet.epoch):
                shown.due = now + INTERVAL
                self._send(row, shown, frame)
            if row in frame.failures:
                self._end(shown, False, f"invalid: {frame.failures[row].problem}")
            elif events.finished[row]:
                self._end(shown, True, "")

    def annotate(self, name: str, values: ArrayLike, agent_ids: Bools, step: Ints | None = None) -> None:
        """Send what an algorithm says with the next frame; as in `EpisodeRecorder`."""
        if not self._outlet.is_open:
            return
        table = np.asarray(values, np.float64)
        steps = self._scene.world.step if step is None else step
        for row, shown in enumerate(self._rows):
            for agent_id in (
                np.flatnonzero(agent_ids[row]).tolist() if len(shown.extras) < _MOST_EXTRAS else ()
            ):
                numbers = np.ravel(table[row, agent_id]).tolist()
                shown.extras.append((name, int(steps[row]), agent_id, numbers))

    def finish(self, env_mask: Bools) -> None:
        """Do nothing: rewards of the last decision come after the last frame."""

    def close(self) -> None:
        """Say that the simulations are over, and end; may be called again."""
        global _shown
        for shown in self._rows:
            self._end(shown, False, "closed before its end")
        _shown -= len(self._rows)
        self._rows = []
        self._outlet.close()

    def _begin(self, shown: _Row, start: EpisodeStart) -> None:
        self._end(shown, False, "reset before its end")
        shown.start, shown.is_over, shown.serial = start, False, shown.serial + 1
        shown.epoch = -1
        shown.outcomes.clear()
        shown.extras.clear()

    def _end(self, shown: _Row, is_complete: bool, remark: str) -> None:
        if not shown.is_over:
            shown.is_over = True
            self._put(shown, {"type": "end", "is_complete": is_complete, "remark": remark})

    def _put(self, shown: _Row, message: Content, size: int = 200) -> None:
        self._outlet.put({**message, "source": shown.source, "serial": shown.serial}, size)

    def _send(self, row: int, shown: _Row, frame: Frame) -> None:
        """Send a frame of one simulation, and before it what lasts and has not been sent."""
        epoch = self._outlet.epoch
        if shown.epoch != epoch:
            shown.epoch, shown.known = epoch, (0, 0, 0)
            shown.named.clear()
            self._open(row, shown, epoch)
        known = len(self._pool.starts[row]), len(self._pool.holds[row]), len(shown.outcomes)
        if known != shown.known:
            shown.known = known
            assert shown.start is not None
            graph = self._scene.atlas.graphs[shown.start.map]
            starts, holds = self._pool.starts[row], self._pool.holds[row]
            tables = static_tables(starts, holds, shown.outcomes, self._policies, graph, shown.start.bubbles)
            self._put(shown, {"type": "static", "tables": tables}, 200 * len(starts))
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
            "extras": shown.extras[:],
        }
        shown.extras.clear()
        self._put(shown, message, 500 + sum(map(len, blocks)))

    def _open(self, row: int, shown: _Row, epoch: int) -> None:
        """Send which episode it is, and its map if the server does not have it."""
        start = shown.start
        assert start is not None
        if self._maps_sent[0] != epoch:
            self._maps_sent = epoch, set()
        if start.map not in self._maps_sent[1]:
            self._maps_sent[1].add(start.map)
            graph = self._scene.atlas.graphs[start.map]
            number, size = start.map, 8 * len(graph.point_xy)
            self._outlet.put(
                lambda: {
                    "type": "map",
                    "map": number,
                    "origin": list(origin_of(graph)),
                    "message": map_message(graph, ""),
                },
                size,
            )
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
        self._put(shown, {"type": "begin", "facts": facts, "map": start.map, **who}, 500)

    def _new_names(self, row: int, shown: _Row) -> list[tuple[int, int, str]]:
        """Return slot, generation and name of the vehicles that are new."""
        world, used = self._scene.world, int(self._buffers.used[0])
        vehicles = self._buffers.vehicles[:used, 1:3].astype(int).tolist()
        found = []
        for slot, generation in vehicles:
            if shown.named.get(slot) != generation:
                shown.named[slot] = generation
                found.append((slot, generation, world.registry.name(row, slot)))
        return found

    def _signals(self, row: int) -> list[tuple[int, int]]:
        """Return lane and light where there is one."""
        lights = self._scene.world.signals[row]
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
