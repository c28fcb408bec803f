"""Running simulations: takes what publishers send, and gives each viewer what it watches."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from smarts.envision.viewers import MOST_REQUEST, Packed, Request, Viewer, packed_message
from smarts.stream.container import Message, pack, unpack
from smarts.stream.live_encoder import LiveEncoder

MOST_OBSERVED = 4
"""Agents of one simulation whose observations are asked for."""
KEPT = 60.0
"""A simulation that is gone stays in the list for so long [s]."""
_LISTED = 0.5
"""Time from one list of simulations to the next [s]."""
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
    """Time at which its connection ended, 0 while there is one [s]."""
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
class Publisher:
    """One connection of a process that runs simulations."""

    maps: dict[int, Message] = field(default_factory=dict)
    sources: set[str] = field(default_factory=set)
    """Ids of its simulations that are shown."""
    unsent: int = 0
    """Simulations that it does not send."""
    observed: dict[str, list[int]] = field(default_factory=dict)
    """Agents of its simulations whose observations it was asked for last."""
    news: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when it may have to be asked for other ones."""


class LiveHub:
    """All simulations and viewers of a server; used by one event loop."""

    def __init__(self) -> None:
        self._sources: dict[str, Source] = {}
        self._viewers: set[Viewer] = set()
        self._publishers: set[Publisher] = set()
        self._listing: asyncio.Task | None = None

    async def publish(self, socket: WebSocket) -> None:
        """Take messages of one process until it is gone or sends what is none."""
        if socket.headers.get("origin") is not None:
            # Browsers name the page's site; simulations do not.
            await socket.close(_POLICY, "a browser publishes nothing")
            return
        await socket.accept()
        self._start_listing()
        publisher = Publisher()
        self._publishers.add(publisher)
        asking = asyncio.create_task(self._keep_asking(socket, publisher))
        try:
            while True:
                self._take(unpack(await socket.receive_bytes()), publisher)
        except (WebSocketDisconnect, RuntimeError, AssertionError):
            pass
        # A damaged message can raise anything: its sender is at fault, whatever it is.
        except Exception as error:
            text = f"a message is damaged: {error!r}"
            with contextlib.suppress(RuntimeError):
                await socket.close(_POLICY, text.encode(errors="replace")[:120].decode(errors="ignore"))
        finally:
            asking.cancel()
            self._publishers.discard(publisher)
            for number in publisher.sources & self._sources.keys():
                self._lose(self._sources[number])

    async def watch(self, socket: WebSocket) -> None:
        """Send one viewer what it watches until it is gone."""
        await socket.accept()
        self._start_listing()
        viewer = Viewer(socket)
        viewer.put(self._list())
        self._viewers.add(viewer)
        tasks = {asyncio.create_task(each(viewer)) for each in (self._listen, self._send)}
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                with contextlib.suppress(WebSocketDisconnect, RuntimeError):
                    task.result()
        finally:
            self._viewers.discard(viewer)
            self._ask_again()
            for task in tasks:
                task.cancel()

    async def _listen(self, viewer: Viewer) -> None:
        while True:
            received = await viewer.socket.receive()
            if received["type"] == "websocket.disconnect":
                return
            text = received.get("text")
            size = len(text or "") + len(received.get("bytes") or b"")
            request = None if text is None or size > MOST_REQUEST else Request.parse(text)
            if request is None:
                is_large = size > MOST_REQUEST
                await viewer.socket.close(*((_TOO_BIG, "too large") if is_large else (_POLICY, "no request")))
                return
            new = [number for number in request.watch if number not in viewer.request.watch]
            viewer.request = request
            for number in new:
                viewer.owe(number)
            self._ask_again()

    async def _send(self, viewer: Viewer) -> None:
        """Send what waits and what is owed; a viewer that has lost something gets all snapshots again."""
        while await viewer.news.wait():
            viewer.news.clear()
            while viewer.waiting or viewer.owed or viewer.is_stale:
                if viewer.is_stale:
                    viewer.is_stale = False
                    viewer.owed = deque(viewer.request.watch)
                    viewer.put(self._list())
                # What waits now goes first, since it is older than the next snapshot.
                for _ in range(len(viewer.waiting)):
                    if not viewer.waiting:
                        break
                    if not await viewer.send(viewer.take()):
                        return
                if viewer.owed and not viewer.is_stale:
                    # One at a time, and beside what waits: together they may be more than that may be.
                    for packed in self._snapshot(viewer, viewer.owed.popleft()):
                        if not await viewer.send(packed):
                            return

    def _snapshot(self, viewer: Viewer, number: str) -> list[Packed]:
        """Return all that a viewer needs that watches a simulation from now on."""
        if number not in viewer.request.watch or number not in self._sources:
            return []
        return [packed_message(message) for message in self._sources[number].encoder.snapshot()]

    async def _keep_asking(self, socket: WebSocket, publisher: Publisher) -> None:
        """Tell a publisher which agents' observations its viewers look at, whenever that changes."""
        while await publisher.news.wait():
            publisher.news.clear()
            observed: dict[str, list[int]] = {}
            for viewer in self._viewers:
                for number, agent in viewer.request.observe.items():
                    agents = observed.setdefault(number, [])
                    if agent not in agents and len(agents) < MOST_OBSERVED:
                        agents.append(agent)
            observed = {number: sorted(observed[number]) for number in observed.keys() & publisher.sources}
            if observed != publisher.observed:
                publisher.observed = observed
                # One that takes nothing is found by `publish`.
                with contextlib.suppress(RuntimeError, WebSocketDisconnect):
                    await socket.send_text(json.dumps({"observe": observed}))

    def _ask_again(self) -> None:
        for publisher in self._publishers:
            publisher.news.set()

    def _take(self, message: dict[str, Any], publisher: Publisher) -> None:
        """Take one message of a publisher: the map first, then episodes, each with frames."""
        if message["type"] == "map":
            road_map = {**message["message"], "origin": message["origin"]}
            # Viewers keep maps by it.
            digest = hashlib.sha256(pack(road_map)).hexdigest()
            publisher.maps[message["map"]] = {**road_map, "digest": digest}
            return
        if message["type"] == "unsent":
            publisher.unsent = int(message["count"])
            return
        number = str(message["source"])
        if message["type"] == "begin":
            self._begin(number, message, publisher)
        else:
            self._continue(number, message, publisher)

    def _continue(self, number: str, message: dict[str, Any], publisher: Publisher) -> None:
        """Take a message of a simulation that has begun."""
        source = self._sources.get(number)
        if source is None or int(message["serial"]) != source.encoder.serial:
            return
        is_watched = any(viewer.follows(number) for viewer in self._viewers)
        if message["type"] == "frame":
            source.step, source.is_running = int(message["step"]), True
            source.count(time.monotonic())
        elif message["type"] == "end":
            source.is_running = False
        for made in source.encoder.take(message, is_watched=is_watched):
            self._relay(number, made)

    def _begin(self, number: str, message: dict[str, Any], publisher: Publisher) -> None:
        facts, before = message["facts"], self._sources.get(number)
        road_map, serial = publisher.maps.get(message["map"]), int(message["serial"])
        if road_map is None:
            # The map has not arrived: it was too large, or was dropped.
            return
        encoder = LiveEncoder(road_map, facts, number, serial, before and before.encoder)
        about = {
            "title": f"{facts['scenario']} {facts['traffic']} [{message['world']}]",
            "scenario": str(facts["scenario"]),
            "traffic": str(facts["traffic"]),
            "policy": str(facts.get("policy", "")),
            "host": str(message["host"]),
            "pid": int(message["pid"]),
            "world": int(message["world"]),
            "episode": int(facts["episode"]),
        }
        self._sources[number] = source = Source(number, about, encoder)
        if before is not None:
            source.rate = before.rate
        publisher.sources.add(number)
        publisher.news.set()
        for made in encoder.opening():
            self._relay(number, made)

    def _relay(self, number: str, message: Message) -> None:
        watching = [viewer for viewer in self._viewers if viewer.follows(number)]
        if watching:
            packed = packed_message(message)
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
        hidden = sum(each.unsent for each in self._publishers)
        rows = [source.row() for source in self._sources.values()]
        return pack({"type": "sources", "sources": rows, "hidden": hidden})
