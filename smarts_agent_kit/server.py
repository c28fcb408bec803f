"""Serves an agent to simulators at an address."""

from __future__ import annotations

import ipaddress
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from typing import Any

from smarts_agent_kit.channel import Channel, ClosedError
from smarts_agent_kit.handshake import SECRET, RefusedError, admit
from smarts_agent_kit.processes import end_process, start_process
from smarts_agent_kit.wire import WireError

MOST_CONNECTIONS = 64
"""Simulators that are served at a time."""
MOST_GREETED = 64
"""Connections that are greeted at a time: the oldest gives way to one more."""
PAUSE = 0.1
"""Pause after a connection that cannot be taken [s]."""
SHORTEST_SECRET = 16
"""Characters."""
KEEP_ALIVE = {"TCP_KEEPIDLE": 60, "TCP_KEEPINTVL": 15, "TCP_KEEPCNT": 4}
"""A simulator whose machine is gone gives its place back after two minutes [s, s, number]."""


class AddressError(ValueError):
    """An address cannot be used."""


def parse_address(text: str) -> tuple[str, int]:
    """Return host and port of "HOST:PORT", perhaps behind "tcp://".

    Raises:
        AddressError: It has another form.
    """
    host, _, port = text.removeprefix("tcp://").rpartition(":")
    if not host or not (port.isascii() and port.isdecimal()) or not 0 <= int(port) < 65536:
        raise AddressError(f"{text!r} is no address: give HOST:PORT, such as 127.0.0.1:7007")
    return host.strip("[]"), int(port)


def secret_for(host: str) -> str:
    """Return the secret, which addresses of other machines need.

    Raises:
        AddressError: The secret is missing or short, and the host is not this machine.
    """
    secret = os.environ.get(SECRET, "")
    if len(secret) < SHORTEST_SECRET and (secret or not _is_loopback(host)):
        problem = (
            f"the secret has {len(secret)} characters"
            if secret
            else f"{host!r} is not this machine alone, and there is no secret"
        )
        raise AddressError(
            f"{problem}: set the environment variable {SECRET} to the same {SHORTEST_SECRET} or more "
            "characters on both sides"
        )
    return secret


def serve_address(
    address: str,
    module: str,
    values: Mapping[str, Any],
    *,
    paths: Sequence[str],
    memory: float = 8.0,
    ready: Callable[[str], object] = print,
) -> None:
    """Serve an agent at an address until the process is interrupted: a process for each simulator.

    Args:
        address: HOST:PORT; port 0: any free one.
        module: Has the function `load`, which makes the agent.
        values: Say which agent; simulators have no choice.
        paths: `sys.path` of the processes.
        memory: The most that each may write to [GB].
        ready: Is called with the address that is served.

    Raises:
        AddressError: It cannot be used, or is not of this machine and there is no secret.
    """
    host, port = parse_address(address)
    secret = secret_for(host)
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        listening = socket.create_server((host, port), family=family)
    except OSError as error:
        remedy = "give this machine's address and a free port; 0 is any"
        raise AddressError(f"{address!r} cannot be served: {error}; {remedy}") from error
    server = _Server(secret, module, {"memory": memory, "paths": paths, **values})
    with closing(listening):
        ready(f"tcp://{f'[{host}]' if ':' in host else host}:{listening.getsockname()[1]}")
        while True:
            try:
                connection, _ = listening.accept()
            except OSError as error:  # the client is gone again, or there are too many files
                print(f"cannot take a connection: {error}", file=sys.stderr)
                time.sleep(PAUSE)
                continue
            server.take(connection)


class _Server:
    """Greets simulators, and serves each by a process, each in a thread.

    Args:
        secret: Shared with the simulators.
        module: Has the function `load`, which makes the agent.
        values: For the processes.
    """

    def __init__(self, secret: str, module: str, values: Mapping[str, Any]) -> None:
        self._secret, self._module, self._values = secret, module, values
        self._places = threading.BoundedSemaphore(MOST_CONNECTIONS)
        self._lock = threading.Lock()
        self._greeted: list[socket.socket] = []  # the oldest first

    def take(self, connection: socket.socket) -> None:
        """Begin to greet; a connection that says nothing keeps no other out."""
        with self._lock:
            if len(self._greeted) >= MOST_GREETED:
                with suppress(OSError):
                    self._greeted.pop(0).shutdown(socket.SHUT_RDWR)
            self._greeted.append(connection)
        threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        """Greet a simulator, then serve it by a process until it is gone."""
        with ExitStack() as held:

            def has_room() -> bool:
                is_free = self._places.acquire(blocking=False)
                if is_free:
                    held.callback(self._places.release)
                return is_free

            try:
                with closing(Channel(connection)) as channel:
                    try:
                        keep_alive(connection)
                        admit(channel, self._secret, has_room)
                    finally:
                        self._end_greeting(connection)
                    started = start_process(channel.fileno(), self._module, **self._values)
            except (RefusedError, TimeoutError, WireError, ClosedError, OSError) as error:
                print(f"refused a connection: {error}", file=sys.stderr)
            else:
                started[0].wait()
                end_process(*started)

    def _end_greeting(self, connection: socket.socket) -> None:
        with self._lock, suppress(ValueError):  # it has given way
            self._greeted.remove(connection)


def keep_alive(connection: socket.socket) -> None:
    """Let the system end a connection whose other side is gone without a word."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in KEEP_ALIVE.items():
        connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def _is_loopback(host: str) -> bool:
    """Return whether a host's addresses are of this machine alone."""
    try:
        found = {str(each[4][0]) for each in socket.getaddrinfo(host, None)}
        return all(ipaddress.ip_address(each).is_loopback for each in found)
    except (OSError, ValueError):
        return False
