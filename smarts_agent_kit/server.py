"""Serves an agent to simulators at an address."""

from __future__ import annotations

import ipaddress
import os
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from typing import Any

from smarts_agent_kit.channel import Channel, ClosedError
from smarts_agent_kit.child import command
from smarts_agent_kit.environment import clean_environment
from smarts_agent_kit.handshake import SECRET, RefusedError, admit
from smarts_agent_kit.wire import WireError

MOST_CONNECTIONS = 64
"""Simulators that are served at a time, and as many that are being greeted."""
SHORTEST_SECRET = 16
"""Characters."""


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
        AddressError: There is none, or it is short, and the host is not this machine.
    """
    secret = os.environ.get(SECRET, "")
    if len(secret) < SHORTEST_SECRET and (secret or not _is_loopback(host)):
        raise AddressError(
            f"{host!r} is not this machine alone, or the secret is short: set the environment variable "
            f"{SECRET} to the same {SHORTEST_SECRET} or more characters on both sides"
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
        raise AddressError(f"{address!r} cannot be served: {error}") from error
    free = threading.BoundedSemaphore(MOST_CONNECTIONS)

    def start(fd: int) -> subprocess.Popen:
        folder = tempfile.mkdtemp(prefix="smarts-agent-")
        more = {"folder": folder, "memory": memory, "paths": paths, **values}
        return subprocess.Popen(
            command([sys.executable], fd, module, **more),
            env=clean_environment(),
            stdin=subprocess.PIPE,
            pass_fds=[fd],
            start_new_session=True,
        )

    with closing(listening):
        ready(f"tcp://{f'[{host}]' if ':' in host else host}:{listening.getsockname()[1]}")
        while True:
            connection, _ = listening.accept()
            if free.acquire(blocking=False):
                threading.Thread(target=_serve, args=(connection, secret, start, free), daemon=True).start()
            else:
                connection.close()


def _serve(
    connection: socket.socket,
    secret: str,
    start: Callable[[int], subprocess.Popen],
    free: threading.BoundedSemaphore,
) -> None:
    """Greet a simulator, then serve it by a process until it is gone."""
    process = None
    try:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        with closing(Channel(connection)) as channel:
            admit(channel, secret)
            process = start(channel.fileno())
    except (RefusedError, TimeoutError, WireError, ClosedError, OSError) as error:
        print(f"refused a connection: {error}", file=sys.stderr)
    finally:
        if process is not None:
            process.wait()
        free.release()


def _is_loopback(host: str) -> bool:
    """Return whether a host's addresses are of this machine alone."""
    try:
        found = {str(each[4][0]) for each in socket.getaddrinfo(host, None)}
        return all(ipaddress.ip_address(each).is_loopback for each in found)
    except (OSError, ValueError):
        return False
