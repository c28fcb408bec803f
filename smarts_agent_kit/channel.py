"""A stream socket that carries messages."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Iterable
from contextlib import suppress

from smarts_agent_kit.wire import LARGEST, Message, WireError, decode, encode, frame_size

_CHUNK = 2**16
"""Bytes of a channel's buffer, until a larger message arrives."""


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
        self._outgoing = memoryview(b"")
        self._buffer = memoryview(bytearray(_CHUNK))
        self._begin = self._end = 0  # of what has arrived, in the buffer
        self._poll = select.poll()
        self._poll.register(connection.fileno(), select.POLLIN)

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
            frame = self._arrived()
            if frame is not None:
                return decode(frame)
            try:
                count = self._socket.recv_into(self._buffer[self._end :])
            except (BlockingIOError, InterruptedError):
                return None
            except OSError as error:
                raise ClosedError(str(error)) from error
            if not count:
                raise ClosedError("the connection has ended")
            self._end += count

    def _arrived(self) -> bytearray | None:
        """Return the next frame if it is complete; else make room for more."""
        begin, end = self._begin, self._end
        size = frame_size(self._buffer[begin : begin + 4], self.largest) if end - begin >= 4 else 4
        if end - begin >= size > 4:
            self._begin, self._end = (0, 0) if begin + size == end else (begin + size, end)
            return bytearray(self._buffer[begin : begin + size])
        if begin:
            self._buffer[: end - begin] = self._buffer[begin:end]
            self._begin, self._end = 0, end - begin
        elif end == len(self._buffer):  # it grows with what arrives, not with what is announced
            self._buffer = memoryview(bytearray(self._buffer) + bytes(end))
        return None

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
        message = self.receive() if self._begin < self._end else None
        while message is None:
            if not self._may_continue(until):
                raise TimeoutError("no message has come in time")
            self.flush()
            message = self.receive()
        return message

    def _may_continue(self, until: float | None) -> bool:
        """Wait until bytes have arrived, or what is left can be sent; return whether in time."""
        if self.has_outgoing:
            return bool(wait_for([self], until))
        return bool(self._poll.poll(_milliseconds(until)))

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
    return [found[fd] for fd, _ in poll.poll(_milliseconds(until))]


def _milliseconds(until: float | None) -> float | None:
    return None if until is None else max(0.0, until - time.monotonic()) * 1000.0


__all__ = ["Channel", "ClosedError", "WireError", "wait_for"]
