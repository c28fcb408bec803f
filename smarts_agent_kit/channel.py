"""A stream socket that carries messages."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Iterable
from contextlib import suppress

import msgpack

from smarts_agent_kit.wire import LARGEST, Message, WireError, encode, message_of

_CHUNK = 2**16
"""Bytes that are received at once."""


class ClosedError(Exception):
    """The other side is gone."""


class Channel:
    """Sends and receives messages without blocking, or waits until a time.

    Args:
        connection: A connected stream socket, which the channel closes.
    """

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        with suppress(OSError):  # of a socket pair
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, LARGEST)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = connection
        self._outgoing = memoryview(b"")
        self.expect(LARGEST)

    def expect(self, largest: int) -> None:
        """Refuse messages of more bytes from now on; forget what has arrived of a message."""
        self._incoming = msgpack.Unpacker(max_buffer_size=largest + _CHUNK)

    def fileno(self) -> int:
        """Return the socket's file descriptor, -1 after `close`."""
        return self._socket.fileno()

    @property
    def has_outgoing(self) -> bool:
        """Whether bytes are left to be sent."""
        return len(self._outgoing) > 0

    def send(self, message: Message | bytes) -> None:
        """Send as much of a message, or of its bytes, as goes without waiting; `flush` sends the rest.

        Raises:
            WireError: It cannot be sent.
            ClosedError: The other side is gone.
        """
        frame = encode(message) if isinstance(message, Message) else message
        self._outgoing = memoryview(bytes(self._outgoing) + frame if self.has_outgoing else frame)
        self.flush()

    def flush(self) -> None:
        """Send more of what is left.

        Raises:
            ClosedError: The other side is gone.
        """
        while self.has_outgoing:
            try:
                self._outgoing = self._outgoing[self._socket.send(self._outgoing) :]
            except (BlockingIOError, InterruptedError):
                return
            except OSError as error:
                raise ClosedError(str(error)) from error

    def receive(self) -> Message | None:
        """Return the next message, None if it is not complete yet.

        Raises:
            WireError: What has arrived is no message.
            ClosedError: The other side is gone.
        """
        while True:
            try:
                for found in self._incoming:
                    return message_of(found)
                arrived = self._socket.recv(_CHUNK)
                self._incoming.feed(arrived)
            except (BlockingIOError, InterruptedError):
                return None
            except OSError as error:
                raise ClosedError(str(error)) from error
            except (ValueError, msgpack.UnpackException) as error:
                raise WireError(f"no message: {error}") from error
            if not arrived:
                raise ClosedError("the connection has ended")

    def wait(self, until: float | None = None) -> Message:
        """Send what is left and return the next message.

        Args:
            until: Latest time, of `time.monotonic()`; None: no limit.

        Raises:
            WireError: What arrives is no message.
            ClosedError: The other side is gone.
            TimeoutError: The time is over.
        """
        self.flush()
        while (message := self.receive()) is None:
            if not wait_for([self], until):
                raise TimeoutError("no message has come in time")
            self.flush()
        return message

    def end(self) -> None:
        """End the connection, whatever forked processes hold it too, and close the socket."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self.close()

    def close(self) -> None:
        """Close the socket; may be called again."""
        self._socket.close()


def wait_for(channels: Iterable[Channel], until: float | None) -> list[Channel]:
    """Wait until one of several channels can receive, or send what it has left; return which ones can."""
    poll, found = select.poll(), {}
    for channel in channels:
        fd = channel.fileno()
        found[fd] = channel
        poll.register(fd, select.POLLIN | (select.POLLOUT if channel.has_outgoing else 0))
    left = None if until is None else max(0.0, until - time.monotonic()) * 1000.0
    return [found[fd] for fd, _ in poll.poll(left)]


__all__ = ["Channel", "ClosedError", "WireError", "wait_for"]
