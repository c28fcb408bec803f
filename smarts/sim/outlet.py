"""The connection of a publisher to a viewer's server."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import re
import select
import socket
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any

from smarts.errors import SmartsError
from smarts.stream.container import pack

if TYPE_CHECKING:
    from websockets.client import ClientProtocol

MOST_WAITING = 4 << 20
"""Bytes that wait to be sent; beyond, all of them are dropped."""
_RETRY = 2.0
"""Time from one attempt to connect to the next [s]."""
_CONNECTING = 5.0
"""The longest time that an attempt takes [s]."""
_LAST_WORDS = 0.5
"""How long `close` waits for what is still to be sent [s]."""
_STANDSTILL = 30_000
"""A server that takes nothing for so long is given up [ms]."""
_LOOK = 0.01
"""Time between two checks of an ending outlet for what is still to be sent [s]."""
_AT_ONCE = 64
"""The most frames of one call of the system."""
_REFUSED = (401, 403)
"""Statuses of a server that does not take simulations from this process."""
Content = Mapping[str, Any]
_ADDRESS = re.compile(r"(?:(?P<token>[^@\s]+)@)?(?P<host>[^@\s/]+):(?P<port>\d{1,5})")


@dataclass(frozen=True)
class Address:
    """The address of a viewer's server."""

    host: str
    port: int
    token: str = ""
    """Token that the server asks for, "" on loopback."""

    @classmethod
    def parse(cls, text: str, place: str) -> Address:
        """Return the address in a text "host:port" or "token@host:port".

        Raises:
            SmartsError: The text is no address.
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

    The caller's thread writes to the socket what that takes at once: to hand each message to another thread
    would cost the caller several times as much. A thread of the outlet connects, answers the server, and
    sends what the socket did not take; it sleeps while there is nothing of that, since each look at the
    queue would interrupt the simulation.

    Args:
        address: Address of the server.
    """

    def __init__(self, address: Address) -> None:
        self._address = address
        self.process = os.getpid()
        """The process that sends: after a fork, the child needs another outlet."""
        self.epoch = 0
        """Grows whenever what was put before may not have arrived: all that lasts is to be put again."""
        self.is_open = False
        """Whether there is a server."""
        self.observed: Mapping[str, Sequence[int]] = {}
        """Agents whose observations viewers look at, by the simulation's id: their numbers in the episode."""
        self._connection: socket.socket | None = None
        self._protocol: ClientProtocol | None = None
        self._begun = memoryview(b"")
        """The rest of a frame whose beginning has been sent."""
        self._waiting: deque[bytes] = deque()
        """Frames."""
        self._to_make: deque[Callable[[], Content] | bytes] = deque()
        """Messages that the thread makes, and those that came after them."""
        self._bytes = 0
        """Bytes that wait; messages that are still to be made count as none."""
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._bell, self._ringing = socket.socketpair()
        """Wakes the thread: it waits for the second one to be readable."""
        for each in (self._bell, self._ringing):
            each.setblocking(False)
        _outlets.add(self)
        # A daemon, since a program that ends without closing is not to hang.
        self._thread = threading.Thread(target=self._work, name="envision-outlet", daemon=True)
        self._thread.start()

    def put(self, message: Content | Callable[[], Content], epoch: int, *, is_last: bool = True) -> None:
        """Send a message, or queue it; if too much waits, all of it is dropped.

        Args:
            message: One that takes time to make can be a function that returns it, called by the thread.
            epoch: Epoch of what the message builds on; in another one, the message is ignored.
            is_last: Whether to send now; otherwise `flush` is to be called, and sends several in one call of
                the system, which takes longer than all else.
        """
        if not self.is_open or self.process != os.getpid():
            return
        packed = message if callable(message) else _packed(message)
        if packed is None:
            return
        with self._lock:
            if not self.is_open or self.epoch != epoch:
                return
            if callable(packed) or self._to_make:
                self._to_make.append(packed)
                self._bytes += 0 if callable(packed) else len(packed)
                self._wake()
            else:
                self._queue(packed)
                if is_last or self._bytes > MOST_WAITING:
                    self._flush_or_wake()
            if self._bytes > MOST_WAITING:
                self._drop()

    def flush(self) -> None:
        """Send what was put and is not the last."""
        if self._waiting and self.process == os.getpid():
            with self._lock:
                if self.is_open:
                    self._flush_or_wake()

    def close(self) -> None:
        """Send what waits, for half a second at most, and end; may be called again."""
        # In a process that was forked off, the thread and perhaps a lock that it held stayed behind.
        if self.process == os.getpid():
            self._closing.set()
            self._wake()
            if threading.current_thread() is self._thread:
                return
            self._thread.join(_LAST_WORDS + 0.2)

    def _queue(self, packed: bytes) -> None:
        """Queue a message as a WebSocket frame."""
        assert self._protocol is not None
        self._protocol.send_binary(packed)
        self._take_frames()

    def _take_frames(self) -> None:
        """Queue the frames that the protocol has made."""
        assert self._protocol is not None
        for frame in self._protocol.data_to_send():
            self._waiting.append(frame)
            self._bytes += len(frame)

    def _flush_or_wake(self) -> None:
        """Send what the socket takes; leave the rest to the thread."""
        self._flush()
        if self._begun or self._waiting or not self.is_open:
            self._wake()

    def _wake(self) -> None:
        # If it cannot be told, it has been told often enough.
        with contextlib.suppress(OSError):
            self._bell.send(b"!")

    def _flush(self) -> None:
        """Send what waits, as far as the socket takes it."""
        connection = self._connection
        while connection is not None and (self._begun or self._waiting):
            # A frame is sent to its end, whatever is dropped behind it.
            parts: list[Any] = [self._begun] if self._begun else []
            parts += islice(self._waiting, _AT_ONCE)
            try:
                sent = connection.sendmsg(parts)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:
                # The thread finds the same, and connects again.
                self.is_open = False
                return
            self._forget(sent)

    def _forget(self, sent: int) -> None:
        """Take off the queues what has been sent [bytes]."""
        while sent:
            if not self._begun:
                self._begun = memoryview(self._waiting.popleft())
                self._bytes -= len(self._begun)
            whole = min(sent, len(self._begun))
            self._begun, sent = self._begun[whole:], sent - whole

    def _drop(self) -> None:
        self._waiting.clear()
        self._to_make.clear()
        self._bytes = 0
        self.epoch += 1

    def _work(self) -> None:
        while not self._closing.is_set():
            # Whatever is wrong with a viewer is none of the simulation's business.
            try:
                self._serve()
            except Exception as error:
                _warn_refused(error, self._address)
            with self._lock:
                self.is_open = False
                self._drop()
                if self._connection is not None:
                    self._connection.close()
                self._connection = self._protocol = None
            self.observed = {}
            self._closing.wait(_RETRY)
        self._bell.close()
        self._ringing.close()

    def _serve(self) -> None:
        """Connect, and send until the outlet is closed or the server is gone."""
        connection = socket.create_connection((self._address.host, self._address.port), _CONNECTING)
        self._connection = connection
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # A server that stands still, or whose machine is gone, is given up.
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _STANDSTILL)
        protocol = _shaken(connection, self._address)
        connection.setblocking(False)
        with self._lock:
            self._protocol, self._begun = protocol, memoryview(b"")
            self._drop()
            self.is_open = True
        while not self._closing.is_set() and self.is_open:
            readable = _ready(connection, self._ringing, has_rest=bool(self._begun or self._waiting))
            if self._ringing in readable:
                with contextlib.suppress(BlockingIOError):
                    self._ringing.recv(4096)
            with self._lock:
                if connection in readable:
                    self._listen(connection, protocol)
                self._flush()
            self._make()
        self._say_last(protocol)

    def _listen(self, connection: socket.socket, protocol: ClientProtocol) -> None:
        """Take what the server says: pings, which are answered, what viewers look at, or its end."""
        data = connection.recv(1 << 16)
        if data:
            protocol.receive_data(data)
        else:
            protocol.receive_eof()
        for event in protocol.events_received():
            observed = _observed(event)
            if observed is not None:
                self.observed = observed
        self._take_frames()
        if not data or protocol.close_expected():
            self.is_open = False

    def _make(self) -> None:
        """Make and send the messages that wait to be made, and those behind them.

        One is made when all before it is on its way, so that it is begun at once and never dropped.
        """
        while self._to_make:
            with self._lock:
                if not self._to_make:
                    return
                epoch, first = self.epoch, self._to_make[0]
                if callable(first) and (self._begun or self._waiting):
                    return
            packed = _packed(first()) if callable(first) else first
            with self._lock:
                if self.epoch != epoch:
                    continue
                self._to_make.popleft()
                self._bytes -= 0 if callable(first) else len(first)
                if packed is not None and self.is_open:
                    self._queue(packed)
                    self._flush()

    def _say_last(self, protocol: ClientProtocol) -> None:
        """Send what is still to be sent, for half a second at most, and part."""
        until = time.monotonic() + _LAST_WORDS
        self._send_rest(until)
        with self._lock:
            self.is_open = False
            self._to_make.clear()
            protocol.send_close(1000)
            self._take_frames()
        self._send_rest(until)

    def _send_rest(self, until: float) -> None:
        self._make()
        while (self._begun or self._waiting) and time.monotonic() < until:
            time.sleep(_LOOK)
            with self._lock:
                self._flush()
            self._make()


def _ready(connection: socket.socket, ringing: socket.socket, *, has_rest: bool) -> list[socket.socket]:
    """Wait until one of two sockets can be read, or the connection written; return those that can be read.

    `select.select` would refuse those of processes with more than 1,024 files.
    """
    poll = select.poll()
    poll.register(connection, select.POLLIN | (select.POLLOUT if has_rest else 0))
    poll.register(ringing, select.POLLIN)
    found = dict(poll.poll())
    return [each for each in (connection, ringing) if found.get(each.fileno(), 0) & ~select.POLLOUT]


_outlets: weakref.WeakSet[Outlet] = weakref.WeakSet()


def _leave_parent() -> None:
    """Close what a process that was forked off has of its parent's connections, which end with the parent."""
    for outlet in [*_outlets]:
        if outlet._connection is not None:
            outlet._connection.close()


os.register_at_fork(after_in_child=_leave_parent)


def _shaken(connection: socket.socket, address: Address) -> ClientProtocol:
    """Return the protocol of a connection whose server has taken it.

    Raises:
        Exception: It has not.
    """
    # Only runs that are watched wait for it.
    from websockets.client import ClientProtocol
    from websockets.uri import parse_uri

    host = f"[{address.host}]" if ":" in address.host else address.host
    protocol = ClientProtocol(parse_uri(f"ws://{host}:{address.port}/publish"), max_size=4096)
    request = protocol.connect()
    if address.token:
        request.headers["Authorization"] = f"Bearer {address.token}"
    protocol.send_request(request)
    connection.sendall(b"".join(protocol.data_to_send()))
    while not protocol.events_received():
        if protocol.handshake_exc is not None:
            raise protocol.handshake_exc
        data = connection.recv(4096)
        if not data:
            raise ConnectionError("the server has ended the connection")
        protocol.receive_data(data)
    if protocol.handshake_exc is not None:
        raise protocol.handshake_exc
    return protocol


_warned: set[Address] = set()
"""Addresses whose servers have refused this process, each of which is named once."""


def _warn_refused(error: Exception, address: Address) -> None:
    """Warn if a server has answered and refused; one that is not there may come."""
    status = getattr(getattr(error, "response", None), "status_code", 0)
    if status not in _REFUSED or address in _warned:
        return
    _warned.add(address)
    token = "the token is wrong" if address.token else "no token is given"
    logging.getLogger("smarts").warning(
        "the viewer at %s:%d refuses simulations (%d): %s, or the server runs without --live; "
        "set SMARTS_ENVISION=TOKEN@%s:%d with the token that `smarts-bench view --live` printed",
        *(address.host, address.port, status, token, address.host, address.port),
    )


def _observed(event: Any) -> dict[str, list[int]] | None:
    """Return what viewers look at, if a server's message says it."""
    try:
        given = json.loads(event.data)["observe"]
        return {str(source): [*map(int, agents)] for source, agents in given.items()}
    except (AttributeError, ValueError, TypeError, KeyError, RecursionError):
        return None


def _packed(message: Content) -> bytes | None:
    """Return the bytes of a message, None if it has none: then it is too large, or a number is."""
    try:
        return pack(message)
    except (SmartsError, ValueError, TypeError, OverflowError):
        return None
