"""Links over sockets: to a child process, or to an address."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from smarts.agents.hosting.options import ADDRESS, HostError
from smarts_agent_kit.channel import Channel, ClosedError
from smarts_agent_kit.handshake import SECRET, RefusedError, greet
from smarts_agent_kit.processes import end_process, ending, start_process
from smarts_agent_kit.server import AddressError, parse_address, secret_for
from smarts_agent_kit.wire import Message, WireError

CONNECT_TIME = 5.0
"""How long a connection may take [s]."""
END_TIME = 5.0
"""How long a child process may take to end [s]."""
BROKEN = (ClosedError, WireError, RefusedError, TimeoutError, OSError)
"""What a connection raises that does not come about."""


class SocketLink:
    """A link over a socket.

    Args:
        channel: To the agent.
        process: The child process behind it, if there is one, which `close` ends.
        folder: Folder of its temporary files, which `close` removes.
    """

    def __init__(self, channel: Channel, process: subprocess.Popen | None = None, folder: str = "") -> None:
        self.channel, self._process, self._folder = channel, process, folder
        self._owner = os.getpid()
        self.about: Mapping[str, Any] | None = None

    @property
    def pid(self) -> int:
        """Number of the child process, 0 without one."""
        return self._process.pid if self._process else 0

    def send(self, message: Message | bytes) -> None:
        """Send a message; see `Link`."""
        try:
            self.channel.send(message)
        except ClosedError as error:
            raise self._named(error) from error

    def receive(self) -> Message | None:
        """Return the next message; see `Link`."""
        try:
            self.channel.flush()
            return self.channel.receive()
        except ClosedError as error:
            raise self._named(error) from error

    def wait(self, until: float) -> Message:
        """Return the next message; see `Link`."""
        try:
            return self.channel.wait(until)
        except ClosedError as error:
            raise self._named(error) from error

    def _named(self, error: ClosedError) -> ClosedError:
        """Return the error of a connection that has ended, with how the agent's process has."""
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                return ClosedError(ending(self._process.wait(END_TIME)))
        return error

    def close(self) -> None:
        """Close the socket and end the child process; may be called again.

        In a process that was forked off the owner, only its ends of socket and lifeline are closed.
        """
        process, self._process = self._process, None
        if self._owner != os.getpid():
            self.channel.close()
            if process is not None and process.stdin is not None:
                process.stdin.close()
            return
        self.channel.end()
        if process is not None:
            end_process(process, self._folder)


@dataclass(frozen=True)
class AtAddress:
    """Connects to an agent that is served at an address.

    Raises:
        HostError: The address is invalid, or is not of this machine and there is no secret.
    """

    locator: str
    """"tcp://HOST:PORT"."""

    def __post_init__(self) -> None:
        try:
            secret_for(parse_address(self.locator)[0])
        except AddressError as error:
            raise HostError(
                str(error), place=self.place, remedy=f"give tcp://HOST:PORT, and the {SECRET} of its server"
            ) from error

    @property
    def place(self) -> str:
        """Place that errors name."""
        return f"agent {self.locator!r}"

    def open(self) -> SocketLink:
        """Return a new connection; see `Starter`."""
        host, port = parse_address(self.locator)
        try:
            channel = Channel(socket.create_connection((host, port), CONNECT_TIME))
        except OSError as error:
            raise HostError(
                f"cannot be reached: {error}",
                place=self.place,
                remedy="start it there: smarts-bench serve AGENT --address HOST:PORT",
            ) from error
        try:
            greet(channel, secret_for(host), time.monotonic() + CONNECT_TIME)
        except BROKEN as error:
            channel.close()
            raise HostError(
                f"the agent there does not take the connection: {error}",
                place=self.place,
                remedy=f"both sides need one version and one {SECRET}, and the server a free place",
            ) from error
        link = SocketLink(channel)
        link.send(Message("make"))
        return link


@dataclass(frozen=True)
class InChildProcess:
    """Starts a process of this machine."""

    module: str
    """Has the function `load`, which makes the agent."""
    values: Mapping[str, Any]
    """Say which agent it makes."""
    place: str
    """Place that errors name."""
    memory: float
    """[GB]"""

    def open(self) -> SocketLink:
        """Start a process; see `Starter`."""
        paths = [os.path.abspath(path) for path in sys.path]
        near, far = socket.socketpair()
        with far:
            started = start_process(far.fileno(), self.module, memory=self.memory, paths=paths)
        link = SocketLink(Channel(near), *started)
        try:
            link.send(Message("make", self.values))
        except WireError as error:
            link.close()
            raise HostError(
                f"the agent's options cannot be sent: {error}",
                place=self.place,
                remedy="give texts, numbers, lists and dicts, or let the agent act in process",
            ) from error
        return link


def is_address(locator: Any) -> bool:
    """Return whether a locator is the address of an agent."""
    return isinstance(locator, str) and locator.startswith(ADDRESS)
