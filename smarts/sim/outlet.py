"""The connection of a publisher to a viewer's server, in a thread of its own."""

from __future__ import annotations

import os
import re
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from smarts.errors import RecordError, SmartsError
from smarts.stream.container import pack

MOST_WAITING = 4 << 20
"""Bytes that wait to be sent; beyond, all of them are dropped."""
_RETRY = 2.0
"""From one attempt to connect to the next [s]."""
_LAST_WORDS = 0.5
"""How long `close` waits for what is still to be sent [s]."""
Content = Mapping[str, Any]
_ADDRESS = re.compile(r"(?:(?P<token>[^@\s]+)@)?(?P<host>[^@\s/]+):(?P<port>\d{1,5})")


@dataclass(frozen=True)
class Address:
    """Where a viewer's server is."""

    host: str
    port: int
    token: str = ""
    """That the server asks for, "" on loopback."""

    @classmethod
    def parse(cls, text: str, place: str) -> Address:
        """Return the address in a text "host:port" or "token@host:port".

        Raises:
            SmartsError: It is none.
        """
        found = _ADDRESS.fullmatch(text)
        if found is None or not 0 < int(found["port"]) < 1 << 16:
            raise SmartsError(
                f"'{text}' is no address of a viewer",
                place=place,
                remedy="give host:port, such as 127.0.0.1:8081, and token@host:port for another machine",
            )
        return cls(found["host"], int(found["port"]), found["token"] or "")


class Outlet:
    """Sends messages to a server while there is one; `put` never waits and never raises.

    Args:
        address: Of the server.
    """

    def __init__(self, address: Address) -> None:
        self._address = address
        self.process = os.getpid()
        """The process that sends: after a fork, the child needs another outlet."""
        self.epoch = 0
        """Grows whenever what was put before may not have arrived: all that lasts is to be put again."""
        self.is_open = False
        """Whether there is a server."""
        self._waiting: deque[Content | Callable[[], Content]] = deque()
        self._bytes = 0
        self._closing = False
        self._changed = threading.Condition()
        # A daemon, since a program that ends without closing is not to hang.
        self._thread = threading.Thread(target=self._work, name="envision-outlet", daemon=True)
        self._thread.start()

    def put(self, message: Content | Callable[[], Content], size: int) -> None:
        """Queue a message of about so many bytes; if too much waits, all of it is dropped.

        A message that takes time to make can be a function that returns it, called by the thread.
        """
        with self._changed:
            if not self.is_open:
                return
            self._waiting.append(message)
            self._bytes += size
            if self._bytes > MOST_WAITING:
                self._drop()
            self._changed.notify()

    def close(self) -> None:
        """Send what waits, for half a second at most, and end; may be called again."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        if self.process == os.getpid():
            self._thread.join(_LAST_WORDS)

    def _drop(self) -> None:
        self._waiting.clear()
        self._bytes = 0
        self.epoch += 1

    def _work(self) -> None:
        # Only runs that are watched wait for it.
        from websockets.exceptions import WebSocketException
        from websockets.sync.client import connect

        address = self._address
        headers = {"Authorization": f"Bearer {address.token}"} if address.token else {}
        uri = f"ws://{address.host}:{address.port}/publish"
        options: dict[str, Any] = {
            "open_timeout": 5,
            "close_timeout": 1,
            "max_size": 4096,
            "compression": None,
        }
        while not self._closing:
            try:
                with connect(uri, additional_headers=headers, proxy=None, **options) as connection:
                    self._send(connection)
            # Whatever is wrong with a viewer is none of the simulation's business.
            except (OSError, WebSocketException, EOFError, RecordError):
                pass
            with self._changed:
                self.is_open = False
                self._drop()
                if not self._closing:
                    self._changed.wait(_RETRY)

    def _send(self, connection: Any) -> None:
        """Send messages as they come, until the outlet is closed or the server is gone."""
        with self._changed:
            self._drop()
            self.is_open = True
        while True:
            with self._changed:
                while not self._waiting and not self._closing:
                    self._changed.wait()
                messages = [*self._waiting]
                self._waiting.clear()
                self._bytes = 0
                if not messages:
                    return
            for message in messages:
                connection.send(pack(message() if callable(message) else message))
