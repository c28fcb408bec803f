"""Browsers that watch running simulations: what each has asked for, what waits for it, which maps it has."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from smarts.stream.container import pack

MOST_WATCHED = 9
"""Simulations that one viewer watches."""
MOST_WAITING = 8 << 20
"""Bytes that wait for one viewer; beyond, all are dropped, and it gets a snapshot when it has caught up."""
MOST_MAPS = 16
"""The last maps that a viewer was sent; it keeps as many, so that these need not be sent again."""
MOST_REQUEST = 4096
"""Bytes of what a viewer sends."""


_Agent = Annotated[int, Field(ge=0, lt=1 << 31)]


class Request(BaseModel):
    """What a viewer asks for."""

    model_config = ConfigDict(strict=True)

    watch: Annotated[list[str], Field(max_length=MOST_WATCHED)]
    """Ids of simulations."""
    observe: Annotated[dict[str, _Agent], Field(max_length=MOST_WATCHED)] = {}
    """The agent of a simulation whose observations are to be shown: its row in `agents`."""

    @classmethod
    def parse(cls, text: str) -> Request | None:
        """Return the request in a text, None if it is none."""
        try:
            return cls.model_validate_json(text)
        except ValidationError:
            return None


class PackedMap(NamedTuple):
    """A map on its way to viewers, which get it once, and then its digest alone."""

    digest: str
    packed: bytes
    reference: bytes
    """The message that names it to a viewer that has it."""


Packed = bytes | PackedMap


def packed_message(message: Mapping) -> Packed:
    """Return a message as it waits for viewers."""
    if message["type"] != "map":
        return pack(message)
    address = {name: message[name] for name in ("digest", "source", "serial")}
    return PackedMap(message["digest"], pack(message), pack({"type": "known_map", **address}))


def _size(packed: Packed) -> int:
    return len(packed.packed if isinstance(packed, PackedMap) else packed)


@dataclass(eq=False)
class Viewer:
    """One browser."""

    socket: WebSocket
    request: Request = field(default_factory=lambda: Request(watch=[]))
    owed: deque[str] = field(default_factory=deque)
    """Simulations of which it gets a snapshot next; until then, nothing else of them."""
    is_stale: bool = False
    waiting: deque[Packed] = field(default_factory=deque)
    size: int = 0
    news: asyncio.Event = field(default_factory=asyncio.Event)
    maps: deque[str] = field(default_factory=lambda: deque(maxlen=MOST_MAPS))
    """Digests of the maps that it has received, the oldest first."""

    def put(self, packed: Packed) -> None:
        """Queue a message; if too much waits, drop all. One that waits alone is kept, however large."""
        if self.is_stale:
            return
        self.waiting.append(packed)
        self.size += _size(packed)
        if self.size > MOST_WAITING and len(self.waiting) > 1:
            self.waiting.clear()
            self.size, self.is_stale = 0, True
        self.news.set()

    def take(self) -> Packed:
        """Return the message that has waited longest."""
        packed = self.waiting.popleft()
        self.size -= _size(packed)
        return packed

    def owe(self, number: str) -> None:
        """Queue a snapshot of a simulation, which is made when its turn has come."""
        if number not in self.owed:
            self.owed.append(number)
        self.news.set()

    def follows(self, number: str) -> bool:
        """Return whether it gets each frame of a simulation."""
        return number in self.request.watch and number not in self.owed and not self.is_stale

    async def send(self, packed: Packed) -> bool:
        """Send a message, however slowly the viewer takes it; return whether the viewer is still there.

        The system ends the connection of one that takes nothing (`server._STANDSTILL`).
        """
        try:
            await self.socket.send_bytes(self._bytes_of(packed))
        except (WebSocketDisconnect, RuntimeError):
            return False
        return True

    def _bytes_of(self, packed: Packed) -> bytes:
        if not isinstance(packed, PackedMap):
            return packed
        # Decided as it is sent: what was dropped before does not count.
        if packed.digest in self.maps:
            return packed.reference
        self.maps.append(packed.digest)
        return packed.packed
