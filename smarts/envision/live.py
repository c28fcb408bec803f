"""Running simulations: takes what publishers send, and gives each viewer what it watches."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from starlette.websockets import WebSocket, WebSocketDisconnect

from smarts.errors import RecordError, SmartsError
from smarts.stream.arrays import unpacked_array
from smarts.stream.container import Message, pack, unpack
from smarts.stream.live_encoder import LiveEncoder
from smarts.stream.road_map import LANE_COLUMNS, MOST_MAPS

MOST_SOURCES = 32
"""Simulations that are known at a time."""
MOST_WATCHED = 9
"""Simulations that one viewer watches."""
MOST_WAITING = 8 << 20
"""Bytes that wait for one viewer; beyond, all are dropped, and it gets a snapshot when it has caught up."""
STALLED = 30.0
"""A viewer that takes nothing for so long is disconnected [s]."""
MOST_REQUEST = 4096
"""Bytes of what a viewer sends."""
MOST_REQUESTS = 20
"""That a viewer sends in a second."""
KEPT = 60.0
"""A simulation that is gone stays in the list for so long [s]."""
_LISTED = 0.5
"""From one list of simulations to the next [s]."""
_POLICY, _TOO_BIG = 1008, 1009


@dataclass
class Source:
    """One simulation."""

    id: str
    about: dict[str, Any]
    encoder: LiveEncoder
    is_running: bool = True
    step: int = 0
    rate: float = 0.0
    """Steps in a second."""
    gone: float = 0.0
    """When its connection ended, 0 while there is one [s]."""
    _counted: tuple[float, int] = (0.0, 0)

    def count(self, now: float) -> None:
        """Bring the rate up to date."""
        since, step = self._counted
        if now - since >= 1.0:
            self.rate = max(0, self.step - step) / (now - since) if since else 0.0
            self._counted = now, self.step

    def row(self) -> dict[str, Any]:
        """Return the line of the list."""
        more = {"episode": self.about["episode"], "step": self.step, "rate": round(self.rate, 1)}
        return {**self.about, **more, "id": self.id, "running": self.is_running}


@dataclass(eq=False)
class Viewer:
    """One browser."""

    watched: tuple[str, ...] = ()
    owed: deque[str] = field(default_factory=deque)
    """Simulations of which it gets a snapshot next; until then, nothing else of them."""
    is_stale: bool = False
    waiting: deque[bytes] = field(default_factory=deque)
    size: int = 0
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def put(self, packed: bytes) -> None:
        """Queue a message; if too much waits, drop all. One that waits alone is kept, however large."""
        if self.is_stale:
            return
        self.waiting.append(packed)
        self.size += len(packed)
        if self.size > MOST_WAITING and len(self.waiting) > 1:
            self.waiting.clear()
            self.size, self.is_stale = 0, True
        self.news.set()

    def owe(self, number: str) -> None:
        """Queue a snapshot of a simulation, which is made when its turn has come."""
        if number not in self.owed:
            self.owed.append(number)
        self.news.set()

    def follows(self, number: str) -> bool:
        """Return whether it gets each frame of a simulation."""
        return number in self.watched and number not in self.owed and not self.is_stale


class LiveHub:
    """All simulations and viewers of a server; used by one event loop."""

    def __init__(self) -> None:
        self._sources: dict[str, Source] = {}
        self._viewers: set[Viewer] = set()
        self._listing: asyncio.Task | None = None

    async def publish(self, socket: WebSocket) -> None:
        """Take messages of one process until it is gone or sends what is none."""
        if socket.headers.get("origin") is not None:
            # Browsers name the page's site; simulations do not.
            await socket.close(_POLICY, "a browser publishes nothing")
            return
        await socket.accept()
        self._start_listing()
        maps: dict[int, Message] = {}
        mine: set[str] = set()
        try:
            while True:
                self._take(unpack(await socket.receive_bytes()), maps, mine)
        except (WebSocketDisconnect, RuntimeError, AssertionError):
            pass
        # A message that was made with care can raise anything: its sender is at fault, whatever it is.
        except Exception as error:
            text = error.problem if isinstance(error, SmartsError) else f"a message is damaged: {error!r}"
            with contextlib.suppress(RuntimeError):
                await socket.close(_POLICY, text.encode(errors="replace")[:120].decode(errors="ignore"))
        finally:
            for number in mine & self._sources.keys():
                # One that cannot be ended, or is forgotten, leaves the others what they are.
                try:
                    self._lose(self._sources[number])
                except Exception:
                    logging.getLogger("smarts").exception("envision: simulation %s cannot be ended", number)

    async def watch(self, socket: WebSocket) -> None:
        """Send one viewer what it watches until it is gone."""
        await socket.accept()
        self._start_listing()
        viewer = Viewer()
        self._viewers.add(viewer)
        viewer.put(self._list())
        tasks = {asyncio.create_task(each(socket, viewer)) for each in (self._listen, self._send)}
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                with contextlib.suppress(WebSocketDisconnect, RuntimeError):
                    task.result()
        finally:
            self._viewers.discard(viewer)
            for task in tasks:
                task.cancel()

    async def _listen(self, socket: WebSocket, viewer: Viewer) -> None:
        times: deque[float] = deque(maxlen=MOST_REQUESTS)
        while True:
            received = await socket.receive()
            if received["type"] == "websocket.disconnect":
                return
            text, now = received.get("text"), time.monotonic()
            size = len(text or "") + len(received.get("bytes") or b"")
            is_too_often = len(times) == MOST_REQUESTS and now - times[0] < 1.0
            times.append(now)
            wanted = None if text is None or size > MOST_REQUEST else _wanted(text)
            if size > MOST_REQUEST or is_too_often or wanted is None:
                reason = "too large" if size > MOST_REQUEST else "too often" if is_too_often else "no request"
                await socket.close(_TOO_BIG if size > MOST_REQUEST else _POLICY, reason)
                return
            new = [number for number in wanted if number not in viewer.watched]
            viewer.watched = wanted
            for number in new:
                viewer.owe(number)

    async def _send(self, socket: WebSocket, viewer: Viewer) -> None:
        """Send what waits and what is owed; a viewer that has lost something gets all snapshots again."""
        while await viewer.news.wait():
            viewer.news.clear()
            while viewer.waiting or viewer.owed or viewer.is_stale:
                if viewer.is_stale:
                    viewer.is_stale = False
                    viewer.owed = deque(viewer.watched)
                    viewer.put(self._list())
                # What waits now goes first, since it is older than the next snapshot.
                for _ in range(len(viewer.waiting)):
                    if not viewer.waiting:
                        break
                    packed = viewer.waiting.popleft()
                    viewer.size -= len(packed)
                    if not await _is_taken(socket, packed):
                        return
                if viewer.owed and not viewer.is_stale:
                    # One at a time, and beside what waits: together they may be more than that may be.
                    for packed in self._snapshot(viewer, viewer.owed.popleft()):
                        if not await _is_taken(socket, packed):
                            return

    def _snapshot(self, viewer: Viewer, number: str) -> list[bytes]:
        """Return all that a viewer needs that watches a simulation from now on."""
        if number not in viewer.watched or number not in self._sources:
            return []
        return [pack(message) for message in self._sources[number].encoder.snapshot()]

    def _take(self, message: dict[str, Any], maps: dict[int, Message], mine: set[str]) -> None:
        """Take one message of a publisher: the map first, then episodes, each with frames."""
        if message["type"] == "map":
            x, y = map(float, message["origin"])
            maps[int(message["map"])] = {**checked_map(message["message"]), "origin": [x, y]}
            if len(maps) > MOST_MAPS:
                raise RecordError(f"more than {MOST_MAPS} maps", place="a publisher")
            return
        number = str(message["source"])
        if message["type"] == "begin":
            self._begin(number, message, maps, mine)
            return
        if number not in mine:
            raise RecordError("a simulation that has not begun", place=number)
        source = self._sources[number]
        if int(message["serial"]) != source.encoder.serial:
            return
        is_watched = any(viewer.follows(number) for viewer in self._viewers)
        if message["type"] == "frame":
            source.step, source.is_running = int(message["step"]), True
            source.count(time.monotonic())
        elif message["type"] == "end":
            source.is_running = False
        for made in source.encoder.take(message, is_watched=is_watched):
            self._relay(number, made)

    def _begin(
        self, number: str, message: dict[str, Any], maps: Mapping[int, Message], mine: set[str]
    ) -> None:
        if number not in self._sources and len(self._sources) >= MOST_SOURCES:
            gone = [each for each in self._sources.values() if each.gone]
            if not gone:
                raise RecordError(f"more than {MOST_SOURCES} simulations at a time", place=number)
            # Programs that make one environment after another.
            del self._sources[min(gone, key=lambda each: each.gone).id]
        if number in self._sources and number not in mine and not self._sources[number].gone:
            raise RecordError("a simulation of another process has the same id", place=number)
        facts = {str(name): value for name, value in message["facts"].items()}
        if any(not isinstance(value, str | int | float) for value in facts.values()):
            raise RecordError("facts that are no numbers and no texts", place=number)
        if int(message["map"]) not in maps:
            raise RecordError(f"map {int(message['map'])} has not been sent", place=number)
        encoder = LiveEncoder(maps[int(message["map"])], facts, number, int(message["serial"]))
        about = {
            "title": f"{facts['scenario']} {facts['traffic']} [{message['world']}]",
            "scenario": str(facts["scenario"]),
            "traffic": str(facts["traffic"]),
            "host": str(message["host"]),
            "pid": int(message["pid"]),
            "world": int(message["world"]),
            "episode": int(facts["episode"]),
        }
        before = self._sources.get(number)
        self._sources[number] = source = Source(number, about, encoder)
        if before is not None:
            source.rate = before.rate
        mine.add(number)
        for made in encoder.opening():
            self._relay(number, made)

    def _relay(self, number: str, message: Message) -> None:
        watching = [viewer for viewer in self._viewers if viewer.follows(number)]
        if watching:
            packed = pack(message)
            for viewer in watching:
                viewer.put(packed)

    def _lose(self, source: Source) -> None:
        """Note that a simulation's process is gone."""
        was_running = source.is_running
        source.is_running, source.gone, source.rate = False, time.monotonic(), 0.0
        if was_running:
            end = {"type": "end", "is_complete": False, "remark": "the simulation's process has gone"}
            for message in source.encoder.take(end, is_watched=True):
                self._relay(source.id, message)

    def _start_listing(self) -> None:
        if self._listing is None or self._listing.done():
            self._listing = asyncio.create_task(self._keep_listing())

    async def _keep_listing(self) -> None:
        """Send all viewers the list whenever it has changed; forget simulations that are long gone."""
        last = b""
        while self._viewers or self._sources:
            await asyncio.sleep(_LISTED)
            now = time.monotonic()
            for number in [n for n, each in self._sources.items() if each.gone and now - each.gone > KEPT]:
                del self._sources[number]
            packed = self._list()
            if packed != last:
                last = packed
                for viewer in self._viewers:
                    viewer.put(packed)

    def _list(self) -> bytes:
        return pack({"type": "sources", "sources": [source.row() for source in self._sources.values()]})


async def _is_taken(socket: WebSocket, packed: bytes) -> bool:
    """Send a message; return whether the viewer has taken it. One that takes nothing is told no good-bye."""
    try:
        await asyncio.wait_for(socket.send_bytes(packed), STALLED)
    except (TimeoutError, WebSocketDisconnect, RuntimeError):
        return False
    return True


def checked_map(message: Any) -> Message:
    """Return a publisher's map without what does not belong to it, since viewers get it as it is.

    Raises:
        RecordError: It is no map; `KeyError`, `TypeError` and the like say the same.
    """
    if not isinstance(message, dict) or message.get("type") != "map":
        raise RecordError("no map", place="a publisher")
    given = {name: message["lanes"][name] for name in LANE_COLUMNS}
    start = unpacked_array(given["start"]).astype(np.int64)
    lanes = len(start) - 1
    if lanes < 1 or start[0] != 0 or (np.diff(start) < 0).any():
        raise RecordError("a map with lanes in disorder", place="a publisher")
    for name, column in given.items():
        length = len(unpacked_array(column))
        if length != {"start": lanes + 1, "x": start[-1], "y": start[-1]}.get(name, lanes):
            raise RecordError(f"a map whose column {name} has {length} values", place="a publisher")
    return {
        "type": "map",
        "digest": str(message["digest"]),
        "bounds": [*map(float, message["bounds"])],
        "lanes": given,
        "edges": [*map(str, message["edges"])],
    }


def _wanted(text: str) -> tuple[str, ...] | None:
    """Return the ids in a viewer's request, None if it is none."""
    try:
        wanted = json.loads(text)["watch"]
    except (ValueError, TypeError, KeyError, RecursionError):
        return None
    if (
        not isinstance(wanted, list)
        or len(wanted) > MOST_WATCHED
        or not all(isinstance(w, str) for w in wanted)
    ):
        return None
    return tuple(dict.fromkeys(wanted))
