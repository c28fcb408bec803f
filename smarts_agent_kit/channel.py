"""A stream socket that carries messages."""

from __future__ import annotations

import select
import socket
import time
from contextlib import suppress

from smarts_agent_kit.wire import LARGEST, Message, WireError, decode, encode, frame_size

_CHUNK = 2**18


class ClosedError(Exception):
    """The other side is gone."""


class Channel:
    """Sends and receives messages without blocking, or waits until a time.

    Args:
        connection: A connected stream socket, which the channel closes.

    Attributes:
        largest: The most bytes of a message that is received.
    """

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        with suppress(OSError):  # of a socket pair
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, LARGEST)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.largest = LARGEST
        self._socket = connection
        self._incoming, self._outgoing = bytearray(), memoryview(b"")

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
            wanted = frame_size(self._incoming, self.largest) if len(self._incoming) >= 4 else 4
            if len(self._incoming) >= wanted > 4:
                frame = bytes(self._incoming[:wanted])
                del self._incoming[:wanted]
                return decode(frame)
            try:
                more = self._socket.recv(_CHUNK)
            except (BlockingIOError, InterruptedError):
                return None
            except OSError as error:
                raise ClosedError(str(error)) from error
            if not more:
                raise ClosedError("the connection has ended")
            self._incoming += more

    def wait(self, until: float | None = None) -> Message:
        """Send what is left and return the next message.

        Args:
            until: Of `time.monotonic()`; None: for ever.

        Raises:
            WireError: What arrives is no message.
            ClosedError: The other side is gone.
            TimeoutError: The time is over.
        """
        while True:
            self.flush()
            message = self.receive()
            if message is not None:
                return message
            if not wait_for([self], until):
                raise TimeoutError("no message has come in time")

    def close(self) -> None:
        """Close the socket; may be called again."""
        self._socket.close()


def wait_for(channels: list[Channel], until: float | None) -> bool:
    """Wait until one of several channels can receive, or send what it has left; return whether one can."""
    poll = select.poll()
    for channel in channels:
        poll.register(channel.fileno(), select.POLLIN | (select.POLLOUT if channel.has_outgoing else 0))
    left = None if until is None else max(0.0, until - time.monotonic()) * 1000.0
    return bool(poll.poll(left))


__all__ = ["Channel", "ClosedError", "WireError", "wait_for"]
