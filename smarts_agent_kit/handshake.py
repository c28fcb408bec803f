"""The first messages of a connection: versions, and proofs that both sides know the secret.

The server asks first; until the client has proved that it knows the secret, nothing else is read from it.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import time
from collections.abc import Callable

from smarts_agent_kit.channel import Channel
from smarts_agent_kit.wire import LARGEST, VERSION, Message

SECRET = "SMARTS_AGENT_SECRET"
"""The environment variable that holds the secret."""
LARGEST_GREETING = 4096
"""The most bytes of a message before the proof."""
GREETING_TIME = 5.0
"""How long the other side may take [s]."""


class RefusedError(Exception):
    """The other side is of another version, or does not know the secret."""


class BusyError(RefusedError):
    """The other side serves as many simulators as it can."""


def admit(channel: Channel, secret: str, has_room: Callable[[], bool] = lambda: True) -> None:
    """Let a client in, as its server.

    Args:
        channel: To the client.
        secret: Shared with it.
        has_room: Returns whether the client can be served; it is asked when the client has proved that it
            knows the secret.

    Raises:
        BusyError: There is no room.
        RefusedError: Its version or its secret is another one.
        WireError: It sends no messages.
        ClosedError: It is gone.
        TimeoutError: It is silent.
    """
    channel.expect(LARGEST_GREETING)
    until = time.monotonic() + GREETING_TIME
    own = os.urandom(32).hex()
    channel.send(Message("hello", {"version": VERSION, "nonce": own}))
    hello = channel.wait(until)
    problem = _problem(hello, secret, "client", own)
    if problem:
        channel.send(Message("refused", {"problem": problem}))
        raise RefusedError(problem)
    if not has_room():
        problem = "it serves as many simulators as it can"
        channel.send(Message("refused", {"busy": True, "problem": problem}))
        raise BusyError(problem)
    proof = _proof(secret, "server", own, str(hello.values["nonce"]))
    channel.send(Message("proof", {"proof": proof}))
    channel.expect(LARGEST)


def greet(channel: Channel, secret: str, until: float) -> None:
    """Introduce the simulator to a server.

    Args:
        channel: To the server.
        secret: Shared with it.
        until: When the server has to have answered, of `time.monotonic()`.

    Raises:
        BusyError: It has no room.
        RefusedError: Its version or its secret is another one.
        WireError: It sends no messages.
        ClosedError: It is gone.
        TimeoutError: It is silent.
    """
    channel.expect(LARGEST_GREETING)
    hello, own = channel.wait(until), os.urandom(32).hex()
    if hello.kind != "hello" or hello.values.get("version") != VERSION:
        raise RefusedError(f"it speaks version {hello.values.get('version')!r:.50}, not {VERSION}")
    theirs = hello.values.get("nonce")
    if not _is_nonce(theirs):
        raise RefusedError("it sends no nonce")
    values = {"version": VERSION, "nonce": own, "proof": _proof(secret, "client", theirs, own)}
    channel.send(Message("hello", values))
    answer = channel.wait(until)
    if answer.kind == "refused":
        kind = BusyError if answer.values.get("busy") else RefusedError
        raise kind(f"{answer.values.get('problem')!s:.500}")
    if answer.kind != "proof" or not _is_same(answer, _proof(secret, "server", theirs, own)):
        raise RefusedError("it does not know the secret")
    channel.expect(LARGEST)


def _problem(hello: Message, secret: str, side: str, nonce: str) -> str:
    """Return why a client is refused, "" if it is not."""
    values = hello.values
    if hello.kind != "hello" or not _is_nonce(values.get("nonce")):
        return "no greeting"
    if values.get("version") != VERSION:
        return f"the simulator speaks version {values.get('version')!r:.50}, the agent {VERSION}"
    return (
        "" if _is_same(hello, _proof(secret, side, nonce, values["nonce"])) else "the secret is another one"
    )


def _is_nonce(value: object) -> bool:
    return isinstance(value, str) and len(value) == 64


def _proof(secret: str, side: str, *nonces: object) -> str:
    text = "|".join((f"smarts agent {VERSION}", side, *map(str, nonces)))
    return hmac.new(secret.encode(), text.encode(), hashlib.sha256).hexdigest()


def _is_same(message: Message, proof: str) -> bool:
    return hmac.compare_digest(str(message.values.get("proof")).encode(), proof.encode())
