"""The connection of a publisher to a viewer's server."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import re
import select
import socket
import struct
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from smarts.errors import SmartsError
from smarts.stream.container import pack

if TYPE_CHECKING:
    from websockets.sync.client import ClientConnection

_RETRY = 2.0
"""Time from one attempt to connect to the next [s]."""
_CONNECTING = 5.0
"""The longest time that an attempt takes [s]."""
_LONGEST = 0.5
"""How long a server that takes nothing may hold up the simulation before the connection ends [s]."""
Content = Mapping[str, Any]
_ADDRESS = re.compile(r"(?P<host>[^@\s/]+):(?P<port>\d{1,5})")


@dataclass(frozen=True)
class Address:
    """The address of a viewer's server."""

    host: str
    port: int

    @classmethod
    def parse(cls, text: str, place: str) -> Address:
        """Return the address in a text "host:port".

        Raises:
            SmartsError: The text is no address.
        """
        found = _ADDRESS.fullmatch(text)
        if found is None or not 0 < int(found["port"]) < 1 << 16:
            raise SmartsError(
                f"'{text}' is no address of a viewer",
                place=place,
                remedy="give host:port, such as 127.0.0.1:8081",
            )
        return cls(found["host"], int(found["port"]))


class Outlet:
    """Sends messages to a server while there is one; `put` never raises.

    The caller's thread sends: to hand each message to another thread would cost the caller several times as
    much. A thread of the outlet connects, and takes what the server says.

    Args:
        address: Address of the server.
    """

    def __init__(self, address: Address) -> None:
        self._address = address
        self.process = os.getpid()
        """The process that sends: after a fork, the child needs another outlet."""
        self.epoch = 0
        """Grows whenever what was put before may not have arrived: all that lasts is to be put again."""
        self.observed: Mapping[str, Sequence[int]] = {}
        """Agents whose observations viewers look at, by the simulation's id: their numbers in the episode."""
        self._connection: ClientConnection | None = None
        self._was_too_large = False
        """Whether a message was too large, which is said once."""
        self._closing = threading.Event()
        # A daemon, since a program that ends without closing is not to hang.
        threading.Thread(target=self._work, name="envision-outlet", daemon=True).start()

    @property
    def is_open(self) -> bool:
        """Whether there is a server."""
        return self._connection is not None

    def put(self, message: Content, epoch: int) -> None:
        """Send a message, or drop it if the server does not take it now.

        Args:
            message: The message.
            epoch: Epoch of what the message builds on; in another one, the message is ignored.
        """
        connection = self._connection
        if connection is None or self.epoch != epoch or self.process != os.getpid():
            return
        poll = select.poll()
        # Whatever is wrong with a viewer is none of the simulation's business.
        try:
            packed = pack(message)
            poll.register(connection.socket, select.POLLOUT)
            if poll.poll(0):
                connection.send(packed)
            else:
                self.epoch += 1
        except SmartsError as error:
            if self._was_too_large:
                return
            self._was_too_large = True
            logging.getLogger("smarts").warning("envision: %s is not shown: record instead", error.problem)
        except Exception:
            if self._connection is connection:
                self._connection = None

    def close(self) -> None:
        """End the connection behind what was sent; may be called again."""
        self._closing.set()
        if self._connection is not None and self.process == os.getpid():
            with contextlib.suppress(OSError):
                self._connection.socket.shutdown(socket.SHUT_WR)

    def _work(self) -> None:
        while not self._closing.is_set():
            # A server that is not there, or runs without --live, may come.
            with contextlib.suppress(Exception):
                self._serve()
            self._connection, self.observed = None, {}
            self._closing.wait(_RETRY)

    def _serve(self) -> None:
        """Connect, and take what viewers look at until the server is gone."""
        # Only runs that are watched wait for it.
        from websockets.sync.client import connect

        host = self._address.host
        uri = f"ws://{f'[{host}]' if ':' in host else host}:{self._address.port}/publish"
        times = {"open_timeout": _CONNECTING, "close_timeout": _LONGEST, "ping_interval": None}
        with connect(uri, compression=None, proxy=None, max_size=4096, **times) as connection:
            longest = struct.pack("ll", 0, round(1e6 * _LONGEST))
            connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, longest)
            self.epoch += 1
            self._connection = connection
            while True:
                observed = json.loads(connection.recv())["observe"]
                self.observed = {str(source): [*map(int, agents)] for source, agents in observed.items()}
